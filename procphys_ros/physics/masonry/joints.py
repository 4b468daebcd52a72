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
Cracked joints: beds of springs that press and rub, but do not pull.

The normal law is exact for rigid parts: pressure k·w wherever the faces overlap by w, integrated
over the pressed part of the rectangle, which the straight line w = 0 bounds. So a joint opens and
closes without a trace, and its resultant comes as near to an edge as the load asks. Friction is
that of Coulomb with a bound from the last pressure, elastic up to it (return mapping; Simo &
Hughes 1998, Computational Inelasticity, 2.2), about the middle of the part pressed then; what
slid stays slid.

For the solver every joint is, at any moment, a link with a bias: its tangent, and what the true
force is besides. Where a joint is open or slides the tangent vanishes; a small share of the whole
stiffness stands in for it, which slows motions that nothing holds, and forces not at all.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.physics.masonry import joint_kernels, links
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.joint_kernels import SHARE, SOFTER

_LEAST_SHARE = 1e-7  # of the whole stiffness: what tangents of open joints keep at last
_SHORT, _LONG = 0.3, 0.9         # reach of steps that promised too much, and that were right
_STIFFEST = 1e4                  # largest change of the share after the former
_STUCK = 1e12        # [N] friction that nothing overcomes
_HINGE = 0.5         # of the fastest relative motion: joints that move as fast are hinges


class Reach(NamedTuple):
    """
    How far joints open or slide before they count as hinges: the larger of both.

    :ivar way: [m].
    :ivar angle: times the length of the joint across the hinge, or along the slide [rad].
    """

    way: float
    angle: float


# On the way to an equilibrium: arches 3 % thicker than they need stay below at every size, for the
# forces that hold a structure up depend on angles; beyond, its geometry is another one.
PLAY = Reach(2e-3, 0.05)
# Under loads that are soon over, such as blows: no balance is sought with them, and a leaf of 10
# cm that is thrown over has to open by 2 mm before they end.
BRIEF = Reach(2e-3, 0.02)
# Where no balance is found: ten times what a brick that hangs on a joint moves by in a step of
# Newton's method.
CREEP = Reach(1e-5, 2.5e-4)


class CrackedJoints:
    """
    The joints of a graph that have cracked: their friction, tangents and biases.

    :param graph: the bonds; links, coupling and grip of the cracked ones are renewed here.
    """

    graph: BondGraph

    def __init__(self, graph: BondGraph):
        self.graph = graph
        count = len(graph)
        self._bias = np.zeros((count, 6))    # of the link about its point, world [N, N·m]
        self._slip = np.zeros((count, 3))    # along x, y and about z of the bond frame [m, rad]
        self._middle = np.zeros((count, 2))  # of the pressed part, where the link is [m]
        self._place = np.zeros((count, 2))   # where friction acts: the middle at last pressure [m]
        self._bound = np.zeros(count)        # of friction [N]
        self._share = np.full(count, SHARE)
        self._way = np.zeros((count, 3))  # of friction after the last step, unit vectors
        self._firm = np.zeros(count)      # least share of the stiffness against sliding
        self._sticks = np.zeros(count, bool)  # whatever the pressure, until a balance is found
        self._normal = np.ascontiguousarray(graph.spring[:, 2])
        self._shear = np.ascontiguousarray(graph.spring[:, 0])

    def reset(self) -> None:
        """Reset: no bond has cracked."""
        for array in (self._bias, self._slip, self._middle, self._place, self._bound, self._way,
                      self._firm):
            array[:] = 0.0
        self._share[:] = SHARE
        self._sticks[:] = False

    def adopt(self, other: 'CrackedJoints', mine: np.ndarray) -> None:
        """
        Go on with the joints of another graph, whose bonds this one has adopted.

        :param mine: rows here of all bonds there, (K,).
        """
        for name in ('_bias', '_slip', '_middle', '_place', '_bound', '_share', '_way', '_firm',
                     '_sticks'):
            getattr(self, name)[mine] = getattr(other, name)
        cracked = self.graph.cracked[mine]
        for name in ('links', 'coupling'):
            getattr(self.graph, name)[mine[cracked]] = getattr(other.graph, name)[cracked]

    @property
    def _geometry(self) -> tuple[np.ndarray, ...]:
        graph = self.graph
        return graph.first, graph.second, graph.centroid, graph.centre, graph.axes, graph.extent

    def linearise(self, rows: np.ndarray, displacement: np.ndarray, residual: np.ndarray,
                  renew: bool = True) -> None:
        """
        Update the tangents of joints to the present displacements.

        :param rows: of the graph, (K,).
        :param displacement: of the parts [m, rad], (N + 1, 6).
        :param residual: takes what the true forces differ by from the model that was
            [N, N·m], (N + 1, 6).
        :param renew: whether bound and place of friction follow the pressure; while they stay,
            forces have an energy, and steps that lessen it lead somewhere.
        """
        if not len(rows):
            return  # the kernel is one of those that take seconds to compile
        graph = self.graph
        sticks = self._sticks[rows]
        for some, follows in ((rows[~sticks], renew), (rows[sticks], False)):
            if len(some):
                joint_kernels.linearise(
                    some, *self._geometry, self._normal, self._shear, graph.mortar.friction,
                    self._slip, self._middle, self._place, self._bound, self._bias, graph.links,
                    graph.coupling, graph.grip, displacement, residual, self._share, self._way,
                    self._firm, follows)

    def stick(self, rows: np.ndarray) -> None:
        """Prevent sliding in joints until `release`."""
        self._sticks[rows] = True
        self._bound[rows] = _STUCK

    def release(self) -> None:
        """Limit the friction of all joints by their pressure from now on."""
        self._sticks[:] = False

    @property
    def sticking(self) -> bool:
        """Whether there are joints in which nothing slides yet."""
        return bool(self._sticks.any())

    def damp(self, rows: np.ndarray, reach: np.ndarray) -> None:
        """Stiffen or soften tangents after steps that went so far of what they promised, (K,)."""
        factor = np.where(reach < _SHORT, np.clip(_SHORT / reach, 1.0 / SOFTER, _STIFFEST),
                          np.where(reach > _LONG, SOFTER, 1.0))
        self._share[rows] = np.clip(factor * self._share[rows], _LEAST_SHARE, 1.0)

    def soften(self, rows: np.ndarray) -> None:
        """Give tangents the share of the stiffness that they start with."""
        self._share[rows] = SHARE

    def power(self, rows: np.ndarray, label: np.ndarray, start: np.ndarray, step: np.ndarray,
              reach: np.ndarray) -> np.ndarray:
        """
        Give what the true forces do on a step beyond what their tangents do.

        :param label: island of each row, (K,).
        :param start, step: displacements and their change, (N + 1, 6).
        :param reach: how much of the step each island has made, (I,).
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
        Choose the joints that open or slide without end, in a motion of the parts.

        :param motion: of the parts since they were in equilibrium [m, rad], (N + 1, 6).
        :param least: that hinges have moved by; by default further than any joint does in
            equilibrium.
        :returns: rows, those that moved fastest.
        """
        if not len(rows):
            return rows  # nothing to compile for
        gap, slid, span = np.empty((3, len(rows)))
        joint_kernels.motions(rows, *self._geometry, motion, gap, slid, span)
        relative = np.maximum(gap, slid) / np.maximum(least.way, least.angle * span)
        return rows[relative > max(1.0, _HINGE * relative.max(initial=0.0))]

    def openings(self, rows: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Give how far joints are open at their widest corner [m], (K,)."""
        gap, slid, span = np.empty((3, len(rows)))
        joint_kernels.motions(rows, *self._geometry, displacement, gap, slid, span)
        return np.maximum(gap, 0.0)

    def settle(self, rows: np.ndarray, displacement: np.ndarray) -> None:
        """Make slip permanent."""
        joint_kernels.settle(rows, *self._geometry, self._shear, self._slip, self._place,
                             self._bound, displacement)

    def wrenches(self, rows: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Give force and moment with which the second part pulls the first, bond frame, (K, 6)."""
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
