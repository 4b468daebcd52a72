# Copyright 2026 The procphys_ros authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Rigid cells: groups of parts that move as one body, and their response to loads.

All bonds between two rigid cells are lumped into one 6 x 6 spring, and all parts of a cell into
one mass. Cells are displaced by q = (u, φ) at their centres of mass; the spring of a pair of cells
is at the centre of its first cell.
"""

import numpy as np

from procphys_ros.compilation import subroutine
from procphys_ros.geometry.linear_kernels import inverse, solve
from procphys_ros.physics.masonry import links


@subroutine
def gather(masses, parts, node, count, wrenches):
    """
    Sum the masses, inertias and loads of cells.

    :param masses: mass, centre, reach and inertia in world axes of all parts.
    :param parts: those of the piece, (P,); node: cell of each, (P,).
    :param wrenches: on the parts, (P, 6).
    :returns: mass (C,), centre (C, 3), inertia about it (C, 3, 3), reach (C,), wrench (C, 6).
    """
    mass, centre, reach = np.zeros(count), np.zeros((count, 3)), np.zeros(count)
    inertia, load = np.zeros((count, 3, 3)), np.zeros((count, 6))
    for p in range(len(parts)):
        i, m = node[p], masses[0][parts[p]]
        mass[i] += m
        for c in range(3):
            centre[i, c] += m * masses[1][parts[p], c]
    for i in range(count):
        for c in range(3):
            centre[i, c] /= mass[i]
    for p in range(len(parts)):
        i, own = node[p], parts[p]
        middle = masses[1][own]
        arm = (middle[0] - centre[i, 0], middle[1] - centre[i, 1], middle[2] - centre[i, 2])
        square = arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2
        reach[i] = max(reach[i], masses[2][own] + np.sqrt(square))
        turn = links.cross(arm, wrenches[p])
        for c in range(3):
            load[i, c] += wrenches[p, c]
            load[i, 3 + c] += wrenches[p, 3 + c] + turn[c]
            inertia[i, c, c] += masses[0][own] * square
            for d in range(3):
                inertia[i, c, d] += masses[3][own, c, d] - masses[0][own] * arm[c] * arm[d]
    return mass, centre, inertia, reach, load


@subroutine
def balanced(label, cell):
    """
    Add the inertia forces of rigid motion to the loads of cells, island by island.

    :param label: island of each cell, (C,).
    :param cell: see `gather`.
    :returns: wrench on each cell, (C, 6); the sum over every island vanishes.
    """
    mass, centre, inertia, _, load = cell
    hub, push = _accelerations(label, cell)
    out = load.copy()
    for i in range(len(mass)):
        arm, spin = centre[i] - hub[label[i]], push[label[i], 3:]
        turn = links.cross(spin, arm)
        for c in range(3):
            out[i, c] -= mass[i] * (push[label[i], c] + turn[c])
            for d in range(3):
                out[i, 3 + c] -= inertia[i, c, d] * spin[d]
    return out


@subroutine
def _accelerations(label, cell):
    """
    Compute the rigid accelerations of free islands under loads.

    :returns: centres of mass (C, 3), linear and angular accelerations (C, 6), by island.
    """
    mass, centre, inertia, _, load = cell
    count = len(mass)
    total, hub = np.zeros(count), np.zeros((count, 3))
    push, tensor = np.zeros((count, 6)), np.zeros((count, 3, 3))
    for i in range(count):
        total[label[i]] += mass[i]
        hub[label[i]] += mass[i] * centre[i]
    for k in range(count):
        if total[k] > 0.0:
            hub[k] /= total[k]
    for i in range(count):
        k = label[i]
        arm = centre[i] - hub[k]
        square = (arm * arm).sum()
        turn = links.cross(arm, load[i])
        for c in range(3):
            push[k, c] += load[i, c]
            push[k, 3 + c] += load[i, 3 + c] + turn[c]
            tensor[k, c, c] += mass[i] * square
            for d in range(3):
                tensor[k, c, d] += inertia[i, c, d] - mass[i] * arm[c] * arm[d]
    for k in range(count):
        if total[k] > 0.0:
            push[k, :3] /= total[k]
            push[k, 3:] = solve(tensor[k], push[k, 3:])
    return hub, push


@subroutine
def pair_up(a, b, count):
    """
    List the pairs of cells that bonds join.

    :param a, b: cells that each bond joins, (K,).
    :param count: of the cells.
    :returns: pair of each bond (K,), and the cells of each pair, the lower one first, (P, 2).
    """
    key = np.empty(len(a), np.int64)
    for k in range(len(a)):
        key[k] = min(a[k], b[k]) * count + max(a[k], b[k])
    order = np.argsort(key, kind='mergesort')
    pair, cells = np.empty(len(a), np.int64), np.empty((len(a), 2), np.int64)
    found = 0
    for n in range(len(order)):
        k = order[n]
        if n == 0 or key[k] != key[order[n - 1]]:
            cells[found, 0], cells[found, 1] = key[k] // count, key[k] % count
            found += 1
        pair[k] = found - 1
    return pair, cells[:found].copy()


@subroutine
def springs(pair, cells, a, packed, alive):
    """
    Sum the stiffness of the living bonds of each pair, (P, 6, 6).

    :param packed: bonds between the cells, see `links.build`, (K, 18).
    """
    out = np.zeros((len(cells), 6, 6))
    for k in range(len(pair)):
        if alive[k]:
            c = 0 if a[k] == cells[pair[k], 0] else 3
            links.add_stiffness(out[pair[k]], packed[k],
                                (packed[k, c], packed[k, c + 1], packed[k, c + 2]))
    return out


@subroutine
def relax(cells, spring, centre, load, reach, accuracy, limit):
    """
    Compute displacements of cells by conjugate gradients (Saad 2003, algorithm 9.1), from zero.

    :param cells: of each pair, (P, 2); spring: see `springs`.
    :param load: on the cells [N, N·m], (C, 6); its sum vanishes over every island.
    :param reach: of the cells [m], (C,).
    :param accuracy: largest residual at the end, of the largest load.
    :param limit: largest number of iterations.
    :returns: displacements [m, rad], (C, 6).
    """
    blocks = _inverses(cells, spring, centre)
    x, residual, z = np.zeros(load.shape), load.copy(), np.zeros(load.shape)
    p, q = np.zeros(load.shape), np.zeros(load.shape)
    goal, old = accuracy * _size(load, reach), 0.0
    for _ in range(limit):
        if _size(residual, reach) <= goal:
            break
        _multiply(blocks, residual, z)
        product = (residual * z).sum()
        beta = product / old if old > 0.0 else 0.0
        old = product
        for i in range(len(p)):
            for c in range(6):
                p[i, c] = z[i, c] + beta * p[i, c]
        _resist(cells, spring, centre, p, q)
        bend = (p * q).sum()
        if not bend > 0.0:  # the remaining motion strains no bond
            break
        step = product / bend
        for i in range(len(p)):
            for c in range(6):
                x[i, c] += step * p[i, c]
                residual[i, c] -= step * q[i, c]
    return x


@subroutine
def _size(wrench, reach):
    """Return the largest force, or moment over the reach of its cell [N]."""
    worst = 0.0
    for i in range(len(reach)):
        w = wrench[i]
        worst = max(worst, w[0] * w[0] + w[1] * w[1] + w[2] * w[2],
                    (w[3] * w[3] + w[4] * w[4] + w[5] * w[5]) / (reach[i] * reach[i]))
    return np.sqrt(worst)


@subroutine
def _inverses(cells, spring, centre):
    """Invert the diagonal blocks; cells without living bonds get zeros and so do not move."""
    blocks, half = np.zeros((len(centre), 6, 6)), np.empty((6, 6))
    for n in range(len(cells)):
        i, j = cells[n, 0], cells[n, 1]
        blocks[i] += spring[n]
        arm = centre[i] - centre[j]  # shifts the spring to the centre of j
        for c in range(6):
            turn = links.cross(arm, spring[n, c])
            for d in range(3):
                half[c, d] = spring[n, c, d]
                half[c, 3 + d] = spring[n, c, 3 + d] + turn[d]
        for d in range(6):
            turn = links.cross(arm, half[:, d])
            for c in range(3):
                blocks[j, c, d] += half[c, d]
                blocks[j, 3 + c, d] += half[3 + c, d] + turn[c]
    for i in range(len(blocks)):
        if blocks[i, 0, 0] > 0.0:
            blocks[i] = inverse(blocks[i])
    return blocks


@subroutine
def _multiply(blocks, residual, z):
    for i in range(len(blocks)):
        for c in range(6):
            total = 0.0
            for d in range(6):
                total += blocks[i, c, d] * residual[i, d]
            z[i, c] = total


@subroutine
def _resist(cells, spring, centre, q, out):
    """Write the elastic forces of displacements, (C, 6)."""
    out[:] = 0.0
    w, f = np.empty(6), np.empty(6)
    for n in range(len(cells)):
        i, j = cells[n, 0], cells[n, 1]
        arm = (centre[i, 0] - centre[j, 0], centre[i, 1] - centre[j, 1],
               centre[i, 2] - centre[j, 2])
        turn = links.cross(q[j, 3:], arm)
        for c in range(3):
            w[c] = q[i, c] - q[j, c] - turn[c]
            w[3 + c] = q[i, 3 + c] - q[j, 3 + c]
        for c in range(6):
            f[c] = 0.0
            for d in range(6):
                f[c] += spring[n, c, d] * w[d]
            out[i, c] += f[c]
            out[j, c] -= f[c]
        turn = links.cross(arm, f)
        for c in range(3):
            out[j, 3 + c] -= turn[c]
