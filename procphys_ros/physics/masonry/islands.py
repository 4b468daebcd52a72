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

"""Islands: connected parts and bonds out of equilibrium, concatenated."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry.equilibrium import Equilibrium
from procphys_ros.physics.masonry.graph import BondGraph


class BondIslands(NamedTuple):
    """
    Islands to be solved; the parts of island i are `parts[part[i]:part[i + 1]]`.

    :ivar parts: of all islands, (P,).
    :ivar bonds: their living bonds, (B,).
    :ivar part, bond: start of the parts and bonds of each island, (I + 1,).
    """

    parts: np.ndarray
    bonds: np.ndarray
    part: np.ndarray
    bond: np.ndarray

    def cracked(self, graph: BondGraph) -> np.ndarray:
        """List the cracked bonds of the islands."""
        return self.bonds[graph.cracked[self.bonds]]


def out_of_balance(equilibrium: Equilibrium, sizes: np.ndarray, goal: float) -> BondIslands:
    """
    List the supported islands in which a nodal residual is too large.

    :param sizes: nodal residuals [N], (N,).
    :param goal: largest tolerated residual [N].
    """
    graph = equilibrium.graph
    return BondIslands(*_gather(sizes, goal, equilibrium.labels, equilibrium.supported,
                                graph.first, graph.second, graph.alive))


@kernel
def _gather(sizes, goal, labels, supported, first, second, alive):
    """List parts and bonds island by island, islands in the order of their labels."""
    count = len(sizes)
    island = np.full(count, -1)  # by label, 0 where out of balance, then the island's number
    found = 0
    for i in range(count):
        if sizes[i] > goal:
            island[labels[i]] = 0
            found += supported[i]
    if not found:
        none = np.zeros(0, np.int64)
        return none, none.copy(), np.zeros(1, np.int64), np.zeros(1, np.int64)
    part, bond = np.zeros(count + 2, np.int64), np.zeros(count + 2, np.int64)
    found = 0
    for i in range(count):
        if island[i] == 0:
            island[i] = found if supported[i] else -1
            found += supported[i]
    place = np.zeros(len(first), np.int32)  # 1 + island of each bond
    for i in range(count):
        part[island[labels[i]] + 2] += 1
    for m in range(len(first)):
        if alive[m]:
            place[m] = island[labels[min(first[m], second[m])]] + 1
            bond[place[m] + 1] += 1
    part[1], bond[1] = 0, 0  # parts and bonds outside all islands
    for k in range(1, found + 2):
        part[k] += part[k - 1]
        bond[k] += bond[k - 1]
    parts, bonds = np.empty(part[found + 1], np.int64), np.empty(bond[found + 1], np.int64)
    for i in range(count):
        k = island[labels[i]] + 1
        if k > 0:
            parts[part[k]] = i
            part[k] += 1
    for m in range(len(first)):
        k = place[m]
        if k > 0:
            bonds[bond[k]] = m
            bond[k] += 1
    return parts, bonds, part[:found + 1], bond[:found + 1]
