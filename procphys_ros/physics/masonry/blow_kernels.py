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

"""Blows on free pieces in one kernel: bond stresses, broken bonds, connected components."""

import math

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import functions
from procphys_ros.physics.masonry import cells, components, links, rigid_cells
from procphys_ros.physics.masonry.strength import stays_closed
from procphys_ros.physics.masonry.ties import tie_stress

_ROUNDS = 12       # of stress and breaking per blow; further cracks wait for the next blow
_BAND = 0.4        # bonds above this share of the worst load break at once: the stress arrives
#                    everywhere before the first crack has relieved any bond
_ITERATIONS = 150  # of conjugate gradients per round
_LEAST = 1e4       # [Pa] least strength, also of dry joints: their parts interlock
_ROUNDING = 1e-9   # of the loads: tolerance of their balance
_ACCURACY = 4e-3   # of the largest load on a cell: residual at which the solver stops
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))  # of a stiffness, see `links`


@kernel
def strike(topology, masses, joints, strength, wood, scratch, blows):
    """
    Break free pieces by blows, one after the other; cut the broken bonds in the graph.

    :param topology: start, incident, first, second, alive, cracked, links of the bond graph.
    :param masses: mass, centre, reach of the parts, and their inertia in world axes, (N, 3, 3).
    :param joints: centroid, axes, spring, area, extent, whole extent of the bonds, and `held`.
    :param strength: tension, cohesion, friction, compression and reinforcement of the bonds.
    :param wood: row of each bond in the table of hinges, -1 for mortar, and the break force,
        break torque and strength of that table.
    :param scratch: rank of the parts, see `cells.grow`, and the scratch of `cells.inside`.
    :param blows: parts of all pieces, start of those of each (B + 1,), wrenches on them,
        number of cells wanted and energy of each blow.
    :returns: rows of all broken bonds, their loads over their strengths, start of those of each
        blow (B + 1,), component of each part, and transmitted share of each blow.
    """
    parts, start, wrenches, wanted, energy = blows
    count = len(wanted)
    rows, loads = [np.empty(0, np.int64)], [np.empty(0)]
    ends = np.zeros(count + 1, np.int64)
    label = np.zeros(len(parts), np.int32)
    share = np.ones(count)
    for k in range(count):
        own = parts[start[k]:start[k + 1]]
        bonds, over, share[k] = _strike(topology, masses, joints, strength, wood, scratch, own,
                                        wrenches[start[k]:start[k + 1]], wanted[k], energy[k])
        ends[k + 1] = ends[k] + len(bonds)
        if len(bonds):
            rows.append(bonds)
            loads.append(over)
            _, a, b = _inside(topology, scratch, own)
            label[start[k]:start[k + 1]] = components.label_living(
                len(own), a, b, np.ones(len(a), np.bool_))[0]
    every, load = np.empty(ends[count], np.int64), np.empty(ends[count])
    place = 0
    for n in range(len(rows)):
        every[place:place + len(rows[n])] = rows[n]
        load[place:place + len(rows[n])] = loads[n]
        place += len(rows[n])
    return every, load, ends, label, share


@kernel
def _inside(topology, scratch, parts):
    start, incident, first, second, alive, _, _ = topology
    return cells.inside(parts, start, incident, alive, first, second, scratch[1])


@subroutine
def _strike(topology, masses, joints, strength, wood, scratch, parts, wrenches, wanted, energy):
    """Break a piece by one blow; return broken rows, their loads, and the transmitted share."""
    rows, a, b = _inside(topology, scratch, parts)
    if wanted < len(parts):
        node, count = cells.grow(len(parts), a, b, scratch[0][parts], wanted)
        rows, a, b = _between_cells(rows, a, b, node)
    else:
        node, count = np.arange(len(parts)).astype(np.int32), len(parts)
    cell = rigid_cells.gather(masses, parts, node, count, wrenches)
    packed = _pack(joints, rows, a, b, cell[1])
    pairs, faint = rigid_cells.pair_up(a, b, count), _ROUNDING * _largest(wrenches)
    alive, axes = np.ones(len(rows), np.bool_), joints[1][rows]
    load, wrench = np.zeros(len(rows)), np.zeros((len(rows), 6))
    broken, over, found = np.empty(len(rows), np.int64), np.empty(len(rows)), 0
    worst, gentler = 1.0, 1.0
    for turn in range(_ROUNDS):
        strain = _solve(cell, pairs, packed, axes, a, b, alive, faint, wrench)
        if strain < 0.0:
            break  # the loads accelerate all parts alike
        if turn == 0:
            gentler = _gentler(strain, energy)
        most = _overloads(wrench, rows, alive, joints, strength, wood, gentler, load)
        if most == 0.0:
            break
        for m in range(len(rows)):
            if load[m] > _BAND * most:
                worst = max(worst, load[m]) if turn == 0 else worst
                broken[found], over[found] = rows[m], load[m]
                found += 1
                alive[m] = False
                packed[m, 6:] = 0.0
                _cut(topology, rows[m])
    return broken[:found].copy(), over[:found].copy(), 1.0 / worst


@subroutine
def _between_cells(rows, a, b, node):
    """Return the bonds between different cells, with cells in place of parts."""
    found = 0
    for k in range(len(rows)):
        i, j = node[a[k]], node[b[k]]
        if i != j:
            rows[found], a[found], b[found] = rows[k], i, j
            found += 1
    return rows[:found].copy(), a[:found].copy(), b[:found].copy()


@subroutine
def _pack(joints, rows, a, b, centre):
    """Pack springs between cells into links, see `links.build`."""
    centroid, axes, spring = joints[0], joints[1], joints[2]
    packed = np.empty((len(rows), 18))
    for k in range(len(rows)):
        m = rows[k]
        for c in range(3):
            packed[k, c] = centroid[m, c] - centre[a[k], c]
            packed[k, 3 + c] = centroid[m, c] - centre[b[k], c]
        for place in range(6):
            i, j = _UPPER[place]
            for block in range(2):
                value = 0.0
                for c in range(3):
                    value += axes[m, i, c] * spring[m, 3 * block + c] * axes[m, j, c]
                packed[k, 6 + 6 * block + place] = value
    return packed


@subroutine
def _solve(cell, pairs, packed, axes, a, b, alive, faint, wrench):
    """
    Solve for the wrenches of the bonds; return the strain energy [J], -1 without strain.

    :param cell: see `rigid_cells.gather`; pairs: see `rigid_cells.pair_up`.
    :param faint: largest load that counts as zero [N], [N·m].
    :param wrench: force and moment in the bond frames [N], [N·m], (K, 6), written.
    """
    _, centre, _, reach, _ = cell
    label = components.label_living(len(centre), a, b, alive)[0]
    load = rigid_cells.balanced(label, cell)
    if not alive.any() or _largest(load) < faint:
        return -1.0
    spring = rigid_cells.springs(pairs[0], pairs[1], a, packed, alive)
    moved = rigid_cells.relax(pairs[1], spring, centre, load, reach, _ACCURACY, _ITERATIONS)
    links.pulls(np.arange(len(axes)), packed, axes, a, b, moved, wrench)
    energy = 0.0
    for i in range(len(centre)):
        for c in range(6):
            energy += moved[i, c] * load[i, c]
    return 0.5 * energy


@subroutine
def _largest(values):
    most = 0.0
    for row in values:
        for value in row:
            most = max(most, abs(value))
    return most


@subroutine
def _gentler(strain_energy, energy):
    """
    Return the factor by which the compliance of a piece reduces the forces of a blow.

    Contact and piece are springs in series, T² = T_c² + π²·m·c with the compliance c of the piece.
    The factor T_c/T follows from the strain energy under the forces of a rigid contact, without m.

    :param strain_energy: of the piece under the forces of the blow [J].
    :param energy: kinetic energy taken by the blow [J].
    """
    return 1.0 / math.sqrt(1.0 + math.pi ** 2 * strain_energy / max(energy, 1e-9))


@kernel
def _overloads(wrench, rows, alive, joints, strength, wood, gentler, load):
    """
    Write load over capacity of each failing bond, zero for the others, (K,).

    A bond whose resultant presses inside its patch opens at an edge, but holds.

    :returns: the largest ratio.
    """
    area, extent, whole_extent, held = joints[3], joints[4], joints[5], joints[6]
    tension, cohesion, friction, compression, reinforcement = strength
    most = 0.0
    for k in range(len(rows)):
        load[k] = 0.0
        if not alive[k]:
            continue
        m = rows[k]
        concrete = tension[m] if held[m] == 1.0 else 0.0
        share, opens = _demand(wrench[k], area[m], extent[m], concrete, cohesion[m],
                               friction[m], compression[m], reinforcement[m])
        if wood[0][m] >= 0:
            share = _wood_demand(wrench[k], area[m], wood, wood[0][m])
        share *= gentler
        if share > 1.0 and not (opens and stays_closed(wrench[k], extent[m], whole_extent[m])):
            load[k] = share
            most = max(most, share)
    return most


@subroutine
def _demand(wrench, area, extent, tension, cohesion, friction, compression, reinforcement):
    """
    Return load over capacity of a bond of mortar, and whether the bond opens.

    The bonds are unloaded before the blow, so all stresses grow in proportion; the limits are
    those of `strength.utilisation`, solved for the share of the load at which they are met.
    Reinforced bonds hold until their steel yields, too.
    """
    pull = wrench[2] / area
    bending = 6.0 / area * (abs(wrench[3]) / extent[1] + abs(wrench[4]) / extent[0])
    across = np.sqrt(extent[0] ** 2 + extent[1] ** 2)
    shear = (np.sqrt(wrench[0] ** 2 + wrench[1] ** 2) + 6.0 * abs(wrench[5]) / across) / area
    opening = (bending + pull) / max(tension, _LEAST)
    if reinforcement > 0.0:
        opening = min(opening, tie_stress(pull, bending) / reinforcement)
    other = max((shear + friction * pull) / max(cohesion, _LEAST), (bending - pull) / compression)
    return max(opening, other, 0.0), opening > other


@subroutine
def _wood_demand(wrench, area, wood, row):
    """
    Return load over capacity of a joint in a broken-off branch.

    The limits are those of standing trees: force, torque, and bending stress M/W with
    W = π·d³/32 = A·d/8.
    """
    _, force, torque, stress = wood
    diameter = math.sqrt(4.0 * area / math.pi)
    bending = functions.hypot(wrench[3], wrench[4]) / (area * diameter / 8.0)
    pull = math.sqrt(wrench[0] ** 2 + wrench[1] ** 2 + wrench[2] ** 2)
    return max(pull / force[row], abs(wrench[5]) / torque[row], bending / stress[row])


@subroutine
def _cut(topology, row):
    _, _, _, _, alive, cracked, packed = topology
    alive[row] = False
    cracked[row] = False
    packed[row, 6:] = 0.0
