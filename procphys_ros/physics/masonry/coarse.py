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
The coarse space of the stress solver: aggregates of parts that move as rigid bodies.

Two-level preconditioning by rigid body modes: Nicolaides 1987, SIAM J. Numer. Anal. 24(2);
Vaněk, Mandel, Brezina 1996, Computing 56.
"""

from collections.abc import Sequence
from typing import Self

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry.coarse_matrix import CoarseMatrix
from procphys_ros.physics.masonry.factor import Factor
from procphys_ros.physics.masonry.graph import BondGraph, HUB

_LONG = 2.5    # of the length of the median part
_LOOSE = 0.99
_STRONG = 0.3  # of the stiffest bond of the more flexible neighbour


@kernel(nogil=True)
def _aggregate(parts, alone, start, incident, alive, first, second, size):
    """
    Grow breadth-first aggregates of about `size` parts; -1 marks parts that are not listed.

    A part marked `alone` is an aggregate by itself.
    """
    count = len(start) - 1
    owner = np.full(count + 1, -1, np.int32)  # the last entry is the ground
    open_ = np.zeros(count, np.bool_)
    open_[parts] = True
    queue = np.empty(len(parts), np.int32)
    seeds = np.empty(count + len(incident), np.int32)
    made = 0
    for source in parts:
        seeds[0] = source
        head, tail = 0, 1
        while head < tail:
            seed = seeds[head]
            head += 1
            if not open_[seed]:
                continue
            open_[seed] = False
            owner[seed] = made
            queue[0] = seed
            filled, taken = 1, 0
            while taken < filled:
                i = queue[taken]
                taken += 1
                for n in range(start[i], start[i + 1]):
                    m = incident[n]
                    if not alive[m]:
                        continue
                    j = second[m] if first[m] == i else first[m]
                    if j == count or not open_[j]:
                        continue
                    if filled < size and not (alone[i] or alone[j]):
                        open_[j] = False
                        owner[j] = made
                        queue[filled] = j
                        filled += 1
                    elif tail < len(seeds):
                        seeds[tail] = j
                        tail += 1
            made += 1
    return owner, made


@kernel
def _merge_small(parts, owner, made, alone, start, incident, alive, first, second, least):
    """Merge tiny aggregates into their neighbours; renumber the aggregates."""
    population = np.zeros(made, np.int64)
    closed = np.zeros(made, np.bool_)
    for i in parts:
        population[owner[i]] += 1
        closed[owner[i]] |= alone[i]
    for i in parts:
        old = owner[i]
        if population[old] >= least or closed[old]:
            continue
        for n in range(start[i], start[i + 1]):
            m = incident[n]
            j = second[m] if first[m] == i else first[m]
            if alive[m] and j < len(owner) - 1 and owner[j] != old and not closed[owner[j]]:
                population[old] -= 1
                population[owner[j]] += 1
                owner[i] = owner[j]
                break
    number = np.full(made, -1, np.int32)
    kept = 0
    for i in parts:
        if number[owner[i]] < 0:
            number[owner[i]] = kept
            kept += 1
        owner[i] = number[owner[i]]
    return kept


def _alone(graph: BondGraph, parts: np.ndarray) -> np.ndarray:
    """
    Mark the parts that are aggregates by themselves, (N,) bool.

    These are hubs, which would fuse their neighbours, and long parts: a timber is as long as
    an aggregate of bricks is wide, and frames of timbers bend and sway, unlike rigid bodies.
    """
    typical = np.median(graph.reach[parts]) if len(parts) else np.inf
    loose = np.flatnonzero(graph.cracked & (graph.grip < _LOOSE))
    hinged = np.zeros(graph.count + 1, bool)
    hinged[graph.first[loose]] = hinged[graph.second[loose]] = True
    return (np.diff(graph.start) > HUB) | (graph.reach > _LONG * typical) | hinged[:-1]


def _strong(graph: BondGraph, bonds: np.ndarray) -> np.ndarray:
    """
    Mark the living bonds across which aggregates may grow, (M,) bool.

    Rigid modes suit stiff bonds: a bond much softer than others of both its parts (a board on
    brickwork, a bond that has opened) stays between aggregates.
    """
    return _stiff_enough(bonds, graph.grip, graph.spring, graph.first, graph.second,
                         np.zeros(graph.count + 1))


@kernel
def _stiff_enough(bonds, grip, spring, first, second, stiffest):
    """Mark bonds that are stiff beside the stiffest one of each part, (N + 1,), written."""
    strong = np.zeros(len(grip), np.bool_)
    for m in bonds:
        stiffness = grip[m] * spring[m, 2]
        stiffest[first[m]] = max(stiffest[first[m]], stiffness)
        stiffest[second[m]] = max(stiffest[second[m]], stiffness)
    stiffest[-1] = np.inf  # the ground is rigid
    for m in bonds:
        least = min(stiffest[first[m]], stiffest[second[m]])
        strong[m] = grip[m] * spring[m, 2] >= _STRONG * least
    return strong


class CoarseSpace:
    """
    Aggregates of a set of parts and the factored coarse matrix over them.

    :param graph: the bond graph.
    :param parts: supported parts, (P,) int.
    :param bonds: their living bonds, (B,); other parts at these bonds are fixed like the ground.
    :param size: parts per aggregate.

    :ivar owner: aggregate of each part, -1 where not in the set and for the
        ground, (N + 1,) int32.
    :ivar arm: part centre relative to its aggregate's reference [m], (N, 3).
    :ivar count: number of aggregates.
    :ivar factor: of the coarse matrix.
    """

    factor: Factor

    def __init__(self, graph: BondGraph, parts: np.ndarray, bonds: np.ndarray, size: int):
        alone, strong = _alone(graph, parts), _strong(graph, bonds)
        self.owner, made = _aggregate(parts, alone, graph.start, graph.incident, strong,
                                      graph.first, graph.second, size)
        merged = _merge_small(parts, self.owner, made, alone, graph.start, graph.incident,
                              graph.alive, graph.first, graph.second, max(size // 3, 1))
        self.count = max(merged, 1)  # without any part one empty aggregate stays
        member = self.owner[parts]
        population = np.bincount(member, minlength=self.count)
        total = np.column_stack([
            np.bincount(member, graph.centre[parts, c], self.count) for c in range(3)])
        self.middle = total / np.maximum(population, 1)[:, None]
        self.arm = graph.centre - self.middle[np.maximum(self.owner[:-1], 0)]
        matrix = CoarseMatrix(graph, bonds, self.owner, self.middle)
        self.factor = Factor(matrix.start, matrix.column, matrix.blocks)

    @classmethod
    def chained(cls, count: int, spaces: Sequence[tuple['CoarseSpace', int]]) -> Self:
        """
        Concatenate the coarse spaces of graphs whose parts follow each other in one graph.

        :param count: number of parts of that graph.
        :param spaces: each with the row of its first part there.
        """
        space = cls.__new__(cls)
        space.owner, space.arm = np.full(count + 1, -1, np.int32), np.zeros((count, 3))
        space.count = 0
        for known, first in spaces:
            rows = slice(first, first + len(known.arm))
            owner = known.owner[:-1]
            space.owner[rows] = np.where(owner < 0, -1, owner + space.count)
            space.arm[rows] = known.arm
            space.count += known.count
        space.middle = np.concatenate([known.middle for known, _ in spaces])
        space.factor = Factor.chained([known.factor for known, _ in spaces])
        return space

    def reached(self, parts: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        List the columns of the factor that islands need, see `Factor.reached`.

        :param parts: of all islands, (P,).
        :param start: start of the parts of each island, (I + 1,).
        """
        return self.factor.reached(self.owner[parts], start)
