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


"""Resumable conjugate gradients preconditioned by blocks and rigid aggregates."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.masonry import factor, links


@subroutine
def residual_size(parts, residual, reach):
    """Return the largest nodal residual [N]: its force, or its moment over the part's reach."""
    worst = 0.0
    for i in parts:
        r = residual[i]
        force = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
        moment = (r[3] * r[3] + r[4] * r[4] + r[5] * r[5]) / (reach[i] * reach[i])
        worst = max(worst, force, moment)
    return np.sqrt(worst)


@kernel(nogil=True)
def residual_sizes(residual, reach):
    """Return the nodal residuals [N], (N,): force, or moment over the part's reach."""
    sizes = np.empty(len(reach))
    for i in range(len(reach)):
        r = residual[i]
        force = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        sizes[i] = max(force, np.sqrt(r[3] * r[3] + r[4] * r[4] + r[5] * r[5]) / reach[i])
    return sizes


@subroutine
def _precondition(parts, residual, blocks, owner, arm, panels, columns, rigid, work, z):
    """Write z = block-Jacobi + coarse correction of the residual; return residual·z."""
    factor.clear(panels, columns, rigid)
    for i in parts:
        a = owner[i]
        r = residual[i]
        rigid[a, 0] += r[0]
        rigid[a, 1] += r[1]
        rigid[a, 2] += r[2]
        rigid[a, 3] += r[3] + arm[i, 1] * r[2] - arm[i, 2] * r[1]
        rigid[a, 4] += r[4] + arm[i, 2] * r[0] - arm[i, 0] * r[2]
        rigid[a, 5] += r[5] + arm[i, 0] * r[1] - arm[i, 1] * r[0]
    factor.solve(panels, columns, rigid, work)
    product = 0.0
    for i in parts:
        a = owner[i]
        r0, r1, r2 = residual[i, 0], residual[i, 1], residual[i, 2]
        r3, r4, r5 = residual[i, 3], residual[i, 4], residual[i, 5]
        for c in range(6):
            b = blocks[i, c]
            z[i, c] = (b[0] * r0 + b[1] * r1 + b[2] * r2 + b[3] * r3 + b[4] * r4 + b[5] * r5
                       + rigid[a, c])
        z[i, 0] += rigid[a, 4] * arm[i, 2] - rigid[a, 5] * arm[i, 1]
        z[i, 1] += rigid[a, 5] * arm[i, 0] - rigid[a, 3] * arm[i, 2]
        z[i, 2] += rigid[a, 3] * arm[i, 1] - rigid[a, 4] * arm[i, 0]
        product += (r0 * z[i, 0] + r1 * z[i, 1] + r2 * z[i, 2]
                    + r3 * z[i, 3] + r4 * z[i, 4] + r5 * z[i, 5])
    return product


@subroutine
def _turn(parts, z, beta, p, q):
    """Compute the next search direction p and clear q for K·p."""
    for i in parts:
        for c in range(6):
            p[i, c] = z[i, c] + beta * p[i, c]
            q[i, c] = 0.0


@subroutine
def _dot(parts, p, q):
    product = 0.0
    for i in parts:
        for c in range(6):
            product += p[i, c] * q[i, c]
    return product


@subroutine
def _go(parts, step, x, residual, p, q, reach):
    """Step along p; return the largest nodal residual then [N], see `residual_size`."""
    worst = 0.0
    for i in parts:
        r = residual[i]
        for c in range(6):
            x[i, c] += step * p[i, c]
            r[c] -= step * q[i, c]
        force = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
        moment = (r[3] * r[3] + r[4] * r[4] + r[5] * r[5]) / (reach[i] * reach[i])
        worst = max(worst, force, moment)
    return np.sqrt(worst)


@kernel(nogil=True)
def iterate(islands, graph, preconditioner, state, reach, old, tolerance, limit):
    """
    Run conjugate gradients on each island until its largest nodal residual is small.

    :param islands: parts, bonds, cracked bonds, columns of the coarse factor, and start of those
        of each island, (I + 1,) each.
    :param graph: links, coupling, first, second.
    :param preconditioner: blocks, owner, arm, panels, rigid, work.
    :param state: x, residual, z, p, q, each (N + 1, 6); all but z and q are kept between
        calls.
    :param old: residual·z of the last iteration, 0 starts anew, (I,); changed in place.
    :param tolerance: [N].
    :param limit: largest number of iterations on each island.
    :returns: iterations done on each island, and its largest nodal residual [N], (I,) each.
    """
    parts, bonds, cracked, columns, part, bond, crack, column = islands
    done, worst = np.empty(len(old), np.int64), np.empty(len(old))
    for k in range(len(old)):
        island = (parts[part[k]:part[k + 1]], bonds[bond[k]:bond[k + 1]],
                  cracked[crack[k]:crack[k + 1]], columns[column[k]:column[k + 1]])
        done[k], old[k], worst[k] = _iterate(island, graph, preconditioner, state, reach, old[k],
                                             tolerance, limit)
    return done, worst


@subroutine
def _iterate(island, graph, preconditioner, state, reach, old, tolerance, limit):
    """Run conjugate gradients (Saad 2003, algorithm 9.1) on one island, see `iterate`."""
    parts, bonds, cracked, columns = island
    all_links, coupling, first, second = graph
    blocks, owner, arm, panels, rigid, work = preconditioner
    x, residual, z, p, q = state
    worst = residual_size(parts, residual, reach)
    done = 0
    while done < limit and worst > tolerance:
        product = _precondition(parts, residual, blocks, owner, arm, panels, columns, rigid, work,
                                z)
        beta = product / old if old > 0.0 else 0.0
        old = product
        _turn(parts, z, beta, p, q)
        links.add_pulls(bonds, all_links, first, second, p, q, -1.0)
        links.add_couplings(cracked, all_links, coupling, first, second, p, q, -1.0)
        bend = _dot(parts, p, q)
        if not bend > 0.0:  # the remaining motion strains no bond
            break
        worst = _go(parts, product / bend, x, residual, p, q, reach)
        done += 1
    return done, old, worst
