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
Cracked joints: no-tension beds of springs with Coulomb friction.

The normal law is exact for rigid parts: pressure k·w wherever the faces overlap by w, integrated
over the pressed part of the rectangle, which the straight line w = 0 bounds. So a joint opens and
closes reversibly, and its resultant comes as near to an edge as the load requires. Coulomb
friction is bounded by the last pressure, elastic up to the bound (return mapping; Simo &
Hughes 1998, Computational Inelasticity, 2.2), and acts at the centroid of the part pressed then;
slip is permanent.

For the solver every joint is, at any moment, a link with a bias: its tangent, and the remainder
of the true force. Where a joint is open or slides the tangent vanishes; a small share of the whole
stiffness replaces it, which slows free motions and leaves the forces unchanged.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.physics.masonry import joint_kernels, links
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.joint_kernels import SOFTER

SHARE = 1e-3         # of the whole stiffness: initial tangent stiffness of open joints
_LEAST_SHARE = 1e-7  # of the whole stiffness: least tangent stiffness of open joints
_SHORT, _LONG = 0.3, 0.9         # reach of badly predicted steps, and of well-predicted ones
_STIFFEST = 1e4                  # largest factor on the share after the former
_STUCK = 1e12        # [N] bound of friction in sticking joints
_HINGE = 0.5         # of the fastest relative motion: joints that move as fast are hinges


class Reach(NamedTuple):
    """
    Opening or slip beyond which joints count as hinges: the larger of both thresholds.

    :ivar way: [m].
    :ivar angle: times the length of the joint across the hinge, or along the slide [rad].
    """

    way: float
    angle: float


# On the way to an equilibrium: arches 3 % thicker than necessary stay below at every size, as
# structural forces depend on angles; beyond, the geometry has changed.
PLAY = Reach(2e-3, 0.05)
# Under loads that end soon, such as blows: no equilibrium with them is sought, and a leaf of 10
# cm that is overturned has to open by 2 mm before they end.
BRIEF = Reach(2e-3, 0.02)
# Where no equilibrium is found: ten times the motion of a brick hanging on a joint in one step of
# Newton's method.
CREEP = Reach(1e-5, 2.5e-4)


class CrackedJoints:
    """
    The joints of a graph that have cracked: their friction, tangents and biases.

    :param graph: the bonds; links, coupling and grip of the cracked ones are updated here.
    """

    graph: BondGraph

    def __init__(self, graph: BondGraph):
        self.graph = graph
        count = len(graph)
        self._bias = np.zeros((count, 6))    # of the link about its point, world [N, N·m]
        self._slip = np.zeros((count, 3))    # along x, y and about z of the bond frame [m, rad]
        self._middle = np.zeros((count, 2))  # centroid of the pressed part, where the link is [m]
        self._place = np.zeros((count, 2))   # friction point: `_middle` at the last pressure [m]
        self._bound = np.zeros(count)        # of friction [N]
        self._pace = np.ones(count)          # see `joint_kernels._follow`
        self._share = np.full(count, SHARE)
        self._way = np.zeros((count, 3))  # direction of friction after the last step, unit vectors
        self._secant = np.zeros(count)    # share of the secant stiffness along the slide
        self._sticks = np.zeros(count, bool)  # at any pressure, until an equilibrium is found
        self._normal = np.ascontiguousarray(graph.spring[:, 2])
        self._shear = np.ascontiguousarray(graph.spring[:, 0])

    def reset(self) -> None:
        """Reset the state of all joints to uncracked."""
        for array in (self._bias, self._slip, self._middle, self._place, self._bound, self._way,
                      self._secant):
            array[:] = 0.0
        self._share[:], self._pace[:] = SHARE, 1.0
        self._sticks[:] = False

    def adopt(self, other: 'CrackedJoints', mine: np.ndarray) -> None:
        """
        Copy the state of the joints of another graph, whose bonds this one has adopted.

        :param mine: rows here of all bonds there, (K,).
        """
        for name in ('_bias', '_slip', '_middle', '_place', '_bound', '_pace', '_share', '_way',
                     '_secant', '_sticks'):
            getattr(self, name)[mine] = getattr(other, name)
        cracked = self.graph.cracked[mine]
        for name in ('links', 'coupling'):
            getattr(self.graph, name)[mine[cracked]] = getattr(other.graph, name)[cracked]

    @property
    def _geometry(self) -> tuple[np.ndarray, ...]:
        graph = self.graph
        return graph.first, graph.second, graph.centroid, graph.centre, graph.axes, graph.extent

    def linearise(self, rows: np.ndarray, displacement: np.ndarray, residual: np.ndarray,
                  renew: bool = True) -> float:
        """
        Update the tangents of joints to the present displacements.

        :param rows: of the graph, (K,).
        :param displacement: of the parts [m, rad], (N + 1, 6).
        :param residual: receives the difference between true forces and the previous model
            [N, N·m], (N + 1, 6).
        :param renew: whether bound and point of friction follow the pressure; while they stay
            fixed, forces have an energy that steps can reduce.
        :returns: largest force by which friction lags behind the pressure [N].
        """
        graph, lag = self.graph, 0.0
        sticks = self._sticks[rows]
        for some, follows in ((rows[~sticks], renew), (rows[sticks], False)):
            if len(some):
                lag = max(lag, joint_kernels.linearise(
                    some, *self._geometry, self._normal, self._shear, graph.mortar.friction,
                    self._slip, self._middle, self._place, self._bound, self._pace, self._bias,
                    graph.links, graph.coupling, graph.grip, displacement, residual, self._share,
                    self._way, self._secant, follows))
        return lag

    def stick(self, rows: np.ndarray) -> None:
        """Prevent sliding in joints until `release`."""
        self._sticks[rows] = True
        self._bound[rows] = _STUCK

    def release(self) -> None:
        """Limit the friction of all joints by their pressure from now on."""
        self._sticks[:] = False

    @property
    def sticking(self) -> bool:
        """Whether any joints stick until `release`."""
        return bool(self._sticks.any())

    def damp(self, rows: np.ndarray, reach: np.ndarray) -> None:
        """Stiffen or soften tangents by the reach of the last step: its completed share, (K,)."""
        factor = np.where(reach < _SHORT, np.clip(_SHORT / reach, 1.0 / SOFTER, _STIFFEST),
                          np.where(reach > _LONG, SOFTER, 1.0))
        self._share[rows] = np.clip(factor * self._share[rows], _LEAST_SHARE, 1.0)

    def soften(self, rows: np.ndarray) -> None:
        """Reset tangents to their initial share of the stiffness."""
        self._share[rows] = SHARE

    def power(self, rows: np.ndarray, label: np.ndarray, start: np.ndarray, step: np.ndarray,
              reach: np.ndarray) -> np.ndarray:
        """
        Compute the power of the true forces along a step minus that of their tangents.

        :param label: island of each row, (K,).
        :param start, step: displacements and their change, (N + 1, 6).
        :param reach: completed share of the step of each island, (I,).
        :returns: per unit of reach [J], (I,).
        """
        out = np.empty(len(reach))
        joint_kernels.power(
            rows, label, *self._geometry, self._normal, self._shear, self._slip, self._place,
            self._bound, self._bias, self.graph.links, self.graph.coupling, start, step, reach,
            out)
        return out

    def hinges(self, rows: np.ndarray, motion: np.ndarray, least: Reach = PLAY) -> np.ndarray:
        """
        List the joints that act as hinges in a motion of the parts.

        :param motion: of the parts since they were in equilibrium [m, rad], (N + 1, 6).
        :param least: least motion of hinges; by default larger than that of any joint in
            equilibrium.
        :returns: rows of the joints that moved fastest.
        """
        if not len(rows):
            return rows  # skip compiling the kernel
        gap, slid, span = np.empty((3, len(rows)))
        joint_kernels.motions(rows, *self._geometry, motion, gap, slid, span)
        relative = np.maximum(gap, slid) / np.maximum(least.way, least.angle * span)
        return rows[relative > max(1.0, _HINGE * relative.max(initial=0.0))]

    def openings(self, rows: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Return the opening of joints at their widest corner [m], (K,)."""
        gap, slid, span = np.empty((3, len(rows)))
        joint_kernels.motions(rows, *self._geometry, displacement, gap, slid, span)
        return np.maximum(gap, 0.0)

    def settle(self, rows: np.ndarray, displacement: np.ndarray) -> None:
        """Make slip permanent."""
        joint_kernels.settle(rows, *self._geometry, self._shear, self._slip, self._place,
                             self._bound, displacement)

    def wrenches(self, rows: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Return force and moment of the second part on the first, bond frame, (K, 6)."""
        graph, out = self.graph, np.empty((len(rows), 6))
        joint_kernels.wrenches(rows, graph.first, graph.second, graph.axes, self._middle,
                               self._bias, graph.links, graph.coupling, displacement, out)
        return out

    def add_pulls(self, bonds: np.ndarray, displacement: np.ndarray, out: np.ndarray,
                  sign: float) -> None:
        """
        Add sign times the forces of bonds, whole or cracked, to the parts.

        :param bonds: rows of the graph, (K,).
        :param displacement: of the parts [m, rad], (N + 1, 6).
        :param out: forces and moments [N, N·m], (N + 1, 6), changed in place.
        """
        graph = self.graph
        cracked = graph.cracked[bonds]
        links.add_pulls(bonds[~cracked], graph.links, graph.first, graph.second, displacement,
                        out, sign)
        joint_kernels.add_forces(bonds[cracked], graph.first, graph.second, self._bias,
                                 graph.links, graph.coupling, displacement, out, sign)
