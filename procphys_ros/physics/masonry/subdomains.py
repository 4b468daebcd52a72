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
Subdomains: the parts with the largest residuals and their neighbours, set by set.

A crack or a blow first changes stresses nearby, where joints open, close and slide. Steps of
Newton's method on its surroundings, with all other parts fixed, save most of the work of steps on
a whole building (nonlinear elimination; Lanzkron, Rose and Wilkes 1996, SIAM J. Sci. Comput.
17(2)).
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.islands import BondIslands

_LARGE = 6000       # parts: least size of islands for subdomains to pay off
_CARRIES = 0.5      # of the target residual of a step: least residual of seed parts
_RINGS = 2          # bonds: largest distance of other parts in a subdomain from a seed
_MOST = 1.0 / 3.0   # of all parts: beyond this a step on all parts costs little more


def furthest_off(graph: BondGraph, islands: BondIslands, sizes: np.ndarray,
                 goal: float) -> BondIslands | None:
    """
    Find the subdomains that a step over cracked joints is confined to; None for all parts.

    :param graph: the bonds.
    :param islands: islands out of balance.
    :param sizes: nodal residuals [N], (N,).
    :param goal: largest nodal residual at the end of the step [N].
    :returns: connected sets of parts, with the bonds to their surroundings.
    """
    if len(islands.parts) < _LARGE or not graph.cracked[islands.bonds].any():
        return None
    seeds = islands.parts[sizes[islands.parts] > _CARRIES * goal]
    return surroundings(graph, seeds, int(_MOST * len(islands.parts)))


def surroundings(graph: BondGraph, seeds: np.ndarray, most: int) -> BondIslands | None:
    """
    Find the connected sets of parts at most `_RINGS` bonds from some parts.

    :param seeds: (K,).
    :param most: number of parts; None is returned beyond it.
    """
    inside = np.zeros(graph.count, bool)
    around = graph.start, graph.incident, graph.alive, graph.first, graph.second
    if not _surround(seeds, _RINGS, most, *around, inside):
        return None
    return BondIslands(*_gather(inside, *around))


@kernel
def _surround(seeds, rings, most, start, incident, alive, first, second, inside):
    """Mark parts within some rings around seeds; return whether there are at most `most`."""
    count = len(inside)
    queue = np.empty(count, np.int64)
    queue[:len(seeds)] = seeds
    for i in seeds:
        inside[i] = True
    begin, end = 0, len(seeds)
    for _ in range(rings):
        found = end
        for k in range(begin, end):
            i = queue[k]
            for n in range(start[i], start[i + 1]):
                m = incident[n]
                j = second[m] if first[m] == i else first[m]
                if alive[m] and j < count and not inside[j]:
                    inside[j] = True
                    queue[found] = j
                    found += 1
        begin, end = end, found
    return 0 < end <= most


@kernel
def _gather(inside, start, incident, alive, first, second):
    """List parts and bonds set by set, both in ascending order; see `BondIslands`."""
    count, total = len(inside), 0
    open_ = np.zeros(count + 1, np.bool_)  # the last entry is the ground
    for i in range(count):
        open_[i] = inside[i]
        total += start[i + 1] - start[i] if inside[i] else 0
    parts, bonds = np.empty(np.count_nonzero(inside), np.int64), np.empty(total, np.int64)
    part, bond = np.zeros(len(parts) + 1, np.int64), np.zeros(len(parts) + 1, np.int64)
    sets, filled, tied = 0, 0, 0
    for seed in range(count):
        if not open_[seed]:
            continue
        open_[seed] = False
        parts[filled] = seed
        head, filled = filled, filled + 1
        while head < filled:
            i = parts[head]
            head += 1
            for n in range(start[i], start[i + 1]):
                m = incident[n]
                if not alive[m]:
                    continue
                j = second[m] if first[m] == i else first[m]
                if open_[j]:
                    open_[j] = False
                    parts[filled] = j
                    filled += 1
                if j == count or i < j or not inside[j]:
                    bonds[tied] = m
                    tied += 1
        parts[part[sets]:filled].sort()
        bonds[bond[sets]:tied].sort()
        sets += 1
        part[sets], bond[sets] = filled, tied
    return parts, bonds[:tied].copy(), part[:sets + 1].copy(), bond[:sets + 1].copy()
