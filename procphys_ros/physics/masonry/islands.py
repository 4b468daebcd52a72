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

"""Islands: the connected parts and bonds that are out of equilibrium, listed one after another."""

from typing import NamedTuple

import numpy as np

from procphys_ros.physics.masonry import components
from procphys_ros.physics.masonry.equilibrium import Equilibrium


class Islands(NamedTuple):
    """
    The islands to be worked on; those of island i are `parts[part[i]:part[i + 1]]`.

    :ivar parts: of all islands, (P,).
    :ivar bonds: their living bonds, (B,).
    :ivar part, bond: where those of each island start, (I + 1,).
    """

    parts: np.ndarray
    bonds: np.ndarray
    part: np.ndarray
    bond: np.ndarray


def out_of_balance(equilibrium: Equilibrium, sizes: np.ndarray, goal: float) -> Islands:
    """
    List the supported islands in which a nodal residual is too large.

    :param sizes: nodal residuals [N], (N,).
    :param goal: largest one that is left alone [N].
    """
    graph, labels = equilibrium.graph, equilibrium.labels
    active = np.zeros(graph.count + 1, bool)
    if sizes.max(initial=0.0) > goal:
        restless = np.zeros(graph.count, bool)
        restless[labels[sizes > goal]] = True
        active[:-1] = restless[labels] & equilibrium.supported
    parts = np.flatnonzero(active)
    bonds = np.flatnonzero(graph.alive & (active[graph.first] | active[graph.second]))
    ends = np.minimum(graph.first[bonds], graph.second[bonds])  # never the ground
    parts, part = components.grouped(parts, labels[parts])
    bonds, bond = components.grouped(bonds, labels[ends])
    return Islands(parts, bonds, part, bond)
