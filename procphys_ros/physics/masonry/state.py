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


"""What can be read off a state of the stress solver."""

import numpy as np

from procphys_ros.physics.masonry import links, pcg, strength
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.joints import CrackedJoints

_ADRIFT = 0.25       # [m] displacement at which a part counts as a mechanism: more than a brick,
#                      so bonds are no longer where linear theory has them; sound masonry moves
#                      by less than a millimetre, timber floors by a few


class StressState:
    """
    Displacements of parts and what they mean for bonds.

    :ivar graph, displacement, tolerance, supported, labels: see `StressSolver`.
    """

    graph: BondGraph
    displacement: np.ndarray
    tolerance: float
    supported: np.ndarray
    labels: np.ndarray
    _residual: np.ndarray
    goal: float
    _joints: CrackedJoints

    @property
    def known(self) -> bool:
        """Whether the residual is that of the true forces, not of tangents."""
        raise NotImplementedError

    def wrenches(self, bonds: np.ndarray | None = None) -> np.ndarray:
        """
        Give force and moment with which the second part pulls the first, in the bond frames.

        :param bonds: rows of the graph, (K,); None = all.
        :returns: tension positive along z [N, N·m], (K, 6); zero for dead bonds and falling
            islands.
        """
        graph = self.graph
        bonds = np.arange(len(graph)) if bonds is None else bonds
        out = np.empty((len(bonds), 6))
        links.pulls(bonds, graph.links, graph.axes, graph.first, graph.second, self.displacement,
                    out)
        cracked = graph.cracked[bonds]
        if cracked.any():
            out[cracked] = self._joints.wrenches(bonds[cracked], self.displacement)
        return out

    def utilisation(self) -> tuple[np.ndarray, np.ndarray]:
        """Give utilisation and `strength.Cause` of every bond, see `strength.utilisation`."""
        return strength.utilisation(self.graph, self.wrenches())

    def unbalanced(self) -> np.ndarray:
        """List the parts whose nodal residual exceeds the tolerance."""
        size = pcg.residual_sizes(self._residual, self.graph.reach)
        return np.flatnonzero((size > self.goal) & self.supported)

    def adrift(self) -> np.ndarray:
        """List the parts displaced by more than 25 cm; none while a step is under way."""
        if not self.known:
            return np.zeros(0, np.intp)
        far = np.abs(self.displacement[:-1, :3]) > _ADRIFT
        return np.flatnonzero(far.any(axis=1)) if far.any() else np.zeros(0, np.intp)

    def settle(self) -> None:
        """Make lasting what has slid in cracked joints, once the present loads are carried."""
        rows = np.flatnonzero(self.graph.cracked)
        if len(rows):
            self._joints.settle(rows, self.displacement)

    def openings(self) -> np.ndarray:
        """Give how far the faces of each cracked joint are apart at their widest [m], (M,)."""
        rows = np.flatnonzero(self.graph.cracked)
        out = np.zeros(len(self.graph))
        out[rows] = self._joints.openings(rows, self.displacement)
        return out

    def _straight(self) -> np.ndarray:
        """Mark the parts of islands that answer loads in proportion, (N,) bool."""
        graph = self.graph
        curved = np.zeros(graph.count, bool)
        rows = np.flatnonzero(graph.cracked)
        curved[self.labels[np.minimum(graph.first[rows], graph.second[rows])]] = True
        return ~curved[self.labels]
