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

"""Equilibrium: bonds, displacements of their parts, and loads that are not yet balanced."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.physics.masonry import components, links, pcg
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.joints import CrackedJoints

_IN_MOTION = 1e-3  # [m] larger displacements are those of a mechanism, not of bending


class Equilibrium:
    """
    A bond graph under load: K·u, f, and the residual f - K·u.

    Every change of bonds or loads keeps the residual exact.
    Parts without a path of bonds to the ground are falling: excluded, all their rows zero.

    :param graph: the bonds; only `cut`, `narrow`, `weaken` and `crack` change them.
    :param gravity: [m/s²], (3,).

    :ivar joints: those of the bonds that have cracked.
    :ivar weight: of the parts [N], (N + 1, 6); like in all arrays the last row is the ground.
    :ivar displacement: of the parts, u and φ [m, rad], world, (N + 1, 6).
    :ivar residual: unbalanced load [N, N·m], (N + 1, 6).
    :ivar sudden: whether dynamic loads of released forces still act.
    :ivar labels: component of each part, see `components.label`, (N,).
    :ivar supported: parts connected to the ground, (N,) bool.
    """

    graph: BondGraph
    joints: CrackedJoints

    def __init__(self, graph: BondGraph, gravity: Sequence[float]):
        self.graph = graph
        self.joints = CrackedJoints(graph)
        self.weight = np.zeros((graph.count + 1, 6))
        self.weight[:-1, :3] = graph.mass[:, None] * np.asarray(gravity, float)
        self.reset()

    def reset(self) -> None:
        """Reset displacements, and all loads but the weight; bonds stay as they are."""
        self.joints.reset()
        self.displacement = np.zeros_like(self.weight)
        self.residual = self.weight.copy()
        self._given = np.zeros_like(self.weight)   # loads besides the weight
        self._sudden = np.zeros_like(self.weight)  # dynamic part of released forces
        self.sudden = False
        self.labels = np.zeros(self.graph.count, np.intp)
        self.supported = np.ones(self.graph.count, bool)

    def adopt(self, other: 'Equilibrium', first: int, bonds: np.ndarray) -> None:
        """
        Copy bonds, displacements and loads of parts that are consecutive here.

        :param first: row of the first of these parts.
        :param bonds: rows here of the bonds there, (M,).
        """
        self.graph.adopt(other.graph, np.arange(len(other.graph)), bonds)
        self.joints.adopt(other.joints, bonds)
        rows = slice(first, first + other.graph.count)
        for mine, theirs in ((self.displacement, other.displacement),
                             (self._given, other._given), (self._sudden, other._sudden),
                             (self.residual, other.residual)):
            mine[rows] = theirs[:-1]
        self.sudden |= other.sudden

    def replace_loads(self, force: np.ndarray, moment: np.ndarray | None) -> np.ndarray:
        """
        Replace the loads besides the weight; the caller updates the residual.

        :param force: at the centres of mass, world [N], (N, 3).
        :param moment: about the centres of mass, world [N·m], (N, 3).
        :returns: change of the residual [N, N·m], (N + 1, 6).
        :raises ValueError: when a load is not finite.
        """
        new = np.zeros_like(self._given)
        new[:-1, :3] = force
        if moment is not None:
            new[:-1, 3:] = moment
        if not np.all(np.isfinite(new)):
            raise ValueError('loads must be finite')
        change = new - self._given
        change[:-1][~self.supported] = 0.0
        self._given = new
        return change

    def cut(self, bonds: np.ndarray, dynamic_factor: float) -> None:
        """
        Break living bonds, (K,) rows; add their forces to the residual.

        :param dynamic_factor: factor on the released forces until they fade.
        """
        released = np.zeros_like(self.residual)
        self.joints.add_pulls(bonds, self.displacement, released, -1.0)
        self.graph.cut(bonds)
        self.residual += dynamic_factor * released
        self._sudden += (dynamic_factor - 1.0) * released
        self.relabel()

    def narrow(self, bonds: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Open bonds partly and permanently, see `BondGraph.narrow`."""
        self.joints.add_pulls(bonds, self.displacement, self.residual, -1.0)
        self.graph.narrow(bonds, low, high)
        self.joints.add_pulls(bonds, self.displacement, self.residual, 1.0)

    def weaken(self, bonds: np.ndarray, share: np.ndarray) -> None:
        """Reduce the stiffness of reinforced bonds, see `BondGraph.weaken`."""
        self.joints.add_pulls(bonds, self.displacement, self.residual, -1.0)
        self.graph.weaken(bonds, share)
        self.joints.add_pulls(bonds, self.displacement, self.residual, 1.0)

    def crack(self, bonds: np.ndarray) -> None:
        """
        Crack whole bonds: from now on they carry only pressure and friction, see `joints`.

        Bonds without any strength crack in an inadmissible state of stress, in tension where the
        true state is compression. Friction under that pressure would hold no flat arch, so they
        stick until a first equilibrium is found.
        """
        mortar = self.graph.mortar
        self.graph.cracked[bonds] = True
        self.joints.stick(bonds[(mortar.tension[bonds] == 0.0) & (mortar.cohesion[bonds] == 0.0)])
        self.linearise(bonds)

    def linearise(self, rows: np.ndarray, renew: bool = True) -> float:
        """Update the tangents of cracked joints to the displacements, see `CrackedJoints`."""
        return self.joints.linearise(rows, self.displacement, self.residual, renew)

    def fade_sudden(self, share: float) -> np.ndarray:
        """
        Subtract a share of the dynamic part of released forces.

        :returns: change of the residual, (N + 1, 6).
        """
        change = -share * self._sudden
        self.residual += change
        self._sudden *= 1.0 - share
        self.sudden = bool(np.any(self._sudden))
        return change

    def overshoot(self, sound: np.ndarray) -> float:
        """
        Compute the energy of the dynamic overshoot after sudden releases [J].

        Half of force times amplitude of an undamped oscillator, which moves twice the amplitude.

        :param sound: displacements before the release, (N + 1, 6).
        """
        if not self.sudden:
            return 0.0
        return 0.25 * float((self._sudden * (self.displacement - sound)).sum())

    def relabel(self) -> None:
        """Label the islands; remove those without support from the system."""
        graph = self.graph
        self.labels, self.supported = components.label(graph.count, graph.first, graph.second,
                                                       graph.alive)
        falls = components.joints_of_fallen(graph.first, graph.second, graph.cracked,
                                            self.supported)
        if len(falls):  # no load presses them together any more
            graph.cut(falls)
            self.relabel()
            return
        self.sudden = components.forget_fallen(self.supported, self.displacement, self.residual,
                                               self._sudden)

    def rewind(self, displacement: np.ndarray) -> None:
        """Restore earlier displacements, (N + 1, 6), and recompute the residual."""
        graph = self.graph
        self.displacement[:-1] = np.where(self.supported[:, None], displacement[:-1], 0.0)
        self.residual = self.weight + self._given + self._sudden
        self.joints.add_pulls(np.flatnonzero(graph.alive), self.displacement, self.residual, 1.0)
        rows = np.flatnonzero(graph.cracked)
        self.linearise(rows)
        self.residual[:-1][~self.supported] = 0.0
        self.residual[-1] = 0.0
        self.joints.soften(rows)

    def moved_from(self, displacement: np.ndarray) -> np.ndarray:
        """List the parts that have moved since earlier displacements, (N + 1, 6)."""
        way = np.abs(self.displacement - displacement)[:-1, :3].max(axis=1)
        return np.flatnonzero(self.supported & (way > _IN_MOTION))

    def wrenches(self, bonds: np.ndarray | None = None) -> np.ndarray:
        """
        Return force and moment of the second part on the first, in the bond frames.

        :param bonds: rows of the graph, (K,); None = all.
        :returns: tension positive along z [N, N·m], (K, 6); zero for dead bonds and falling
            islands.
        """
        graph = self.graph
        if bonds is None:
            out = np.zeros((len(graph), 6))
            rows = components.bonds_of_standing(graph.first, graph.second, graph.alive,
                                                self.supported)
            out[rows] = self.wrenches(rows)
            return out
        out = np.empty((len(bonds), 6))
        links.pulls(bonds, graph.links, graph.axes, graph.first, graph.second, self.displacement,
                    out)
        cracked = graph.cracked[bonds]
        if cracked.any():
            out[cracked] = self.joints.wrenches(bonds[cracked], self.displacement)
        return out

    def residual_sizes(self) -> np.ndarray:
        """Return the nodal residuals [N], (N,): force, or moment over the part's reach."""
        return pcg.residual_sizes(self.residual, self.graph.reach)

    def settle(self) -> None:
        """Make slip in cracked joints permanent once the present loads are balanced."""
        rows = np.flatnonzero(self.graph.cracked)
        if len(rows):
            self.joints.settle(rows, self.displacement)

    def openings(self) -> np.ndarray:
        """Return the widest opening of each cracked joint [m], (M,)."""
        rows = np.flatnonzero(self.graph.cracked)
        out = np.zeros(len(self.graph))
        out[rows] = self.joints.openings(rows, self.displacement)
        return out

    def linear(self) -> np.ndarray:
        """Mark the parts of islands without cracked joints, which respond linearly, (N,) bool."""
        graph = self.graph
        cracked = np.zeros(graph.count, bool)
        rows = np.flatnonzero(graph.cracked)
        cracked[self.labels[np.minimum(graph.first[rows], graph.second[rows])]] = True
        return ~cracked[self.labels]
