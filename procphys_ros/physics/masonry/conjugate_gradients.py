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


"""Conjugate gradients on the islands of a bond graph: their preconditioner and search vectors."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.physics.masonry import links, pcg
from procphys_ros.physics.masonry.coarse import CoarseSpace
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.islands import BondIslands

_AGGREGATE = 8  # parts per aggregate: cheapest sum of iterations and coarse solves (bench)
_CONFINED = 16  # the same for sets of parts, whose coarse spaces serve one step (decision 57)


class ConjugateGradients:
    """
    Conjugate gradients on tangents of K·u = f, preconditioned by part blocks and aggregates.

    :param graph: the bonds.

    :ivar blocks: inverses of the diagonal blocks of K, in single precision as the coarse factor
        is, (N, 6, 6).
    :ivar coarse: aggregates of the parts that stood when they were formed; None without any.
    :ivar fresh: whether the bonds are unchanged since then.
    :ivar islands: islands being solved.
    """

    _graph: BondGraph
    coarse: CoarseSpace | None
    _space: CoarseSpace | None
    _columns: tuple[np.ndarray, np.ndarray] | None
    islands: BondIslands

    def __init__(self, graph: BondGraph):
        self._graph = graph
        self._search = np.zeros((3, graph.count + 1, 6))  # z, p, q
        self.blocks = np.empty((graph.count, 6, 6), np.float32)
        self.coarse = None
        self.fresh = False

    def adopt(self, others: Sequence[tuple['ConjugateGradients', int]]) -> None:
        """Copy blocks and aggregates from concatenated graphs, each with its first part here."""
        for other, first in others:
            self.blocks[first:first + len(other.blocks)] = other.blocks
        spaces = [(other.coarse, first) for other, first in others if other.coarse]
        self.coarse = CoarseSpace.chained(len(self.blocks), spaces) if spaces else None
        self.fresh = all(other.fresh for other, _ in others)

    def invert_blocks(self, parts: np.ndarray) -> None:
        """Recompute the blocks of parts whose bonds have changed, (K,)."""
        graph = self._graph
        if not len(graph):  # trees only: skip compiling the kernel
            return
        links.diagonal_inverses(parts, graph.start, graph.incident, graph.alive, graph.links,
                                graph.first, self.blocks)

    def aggregate(self, parts: np.ndarray) -> None:
        """Rebuild the aggregates of all standing parts, (K,), and factor their matrix."""
        graph = self._graph
        self.coarse = (CoarseSpace(graph, parts, np.flatnonzero(graph.alive), _AGGREGATE)
                       if len(parts) else None)
        self.fresh = True

    def begin(self, islands: BondIslands) -> None:
        """Start the iterations of islands anew."""
        self.islands, self._space = islands, self.coarse
        self._columns = None
        curved = self._graph.cracked[islands.bonds]
        self._cracked = (islands.bonds[curved],
                         np.concatenate([[0], np.cumsum(curved)])[islands.bond])
        self._products = np.zeros(len(islands.part) - 1)

    def confine(self, sets: BondIslands) -> None:
        """Start the iterations of sets of parts anew, with all other parts held fixed."""
        graph = self._graph
        self.begin(sets)
        self._space = None  # formed when it is needed
        for side in (graph.first, graph.second):
            self._search[1, side[sets.bonds]] = 0.0  # all other parts are fixed

    def iterate(self, displacement: np.ndarray, residual: np.ndarray, target: float,
                limit: int) -> tuple[np.ndarray, np.ndarray]:
        """
        Continue the iterations that were started last.

        :param displacement, residual: [m, rad] and [N, N·m], (N + 1, 6), changed in place.
        :param target: largest nodal residual to stop at [N].
        :param limit: largest number of iterations on each island.
        :returns: iterations done on each island, and its largest nodal residual [N], (I,) each.
        """
        parts, bonds, part, bond = self.islands
        cracked, crack = self._cracked
        graph, coarse = self._graph, self._space
        if coarse is None:
            coarse = self._space = CoarseSpace(graph, parts, bonds, _CONFINED)
        preconditioner = (self.blocks, coarse.owner, coarse.arm, coarse.factor.panels,
                          *np.empty((2, coarse.count, 6)))
        if self._columns is None:
            self._columns = coarse.reached(parts, part)
        return pcg.iterate(
            (parts, bonds, cracked, self._columns[0], part, bond, crack, self._columns[1]),
            (graph.links, graph.coupling, graph.first, graph.second), preconditioner,
            (displacement, residual, *self._search), graph.reach, self._products, target, limit)
