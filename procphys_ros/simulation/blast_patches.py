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


"""Pieces of wall before a blast: which of them are torn from what surrounds them."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry import rotation
from procphys_ros.physics.masonry.capacity import fails, joints_of
from procphys_ros.simulation.masonry import WALL_RATE
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.state import State

_STOREY = 2.7        # [m] height of the wall whose rate is `masonry.WALL_RATE`, ...
_LEAF = 0.1025       # [m] ... and its thickness
_BRICK = 0.225       # [m] smallest piece of wall that comes out as one
_BENDING = 5.0       # bending strength over shear strength, times span over thickness


class BlastPatches:
    """
    Select the pieces of wall that a wave tears out, from the bond forces at its arrival.

    :param model, state: the stresses must not change meanwhile.
    :param shaken: parts that pieces consist of, (S,).
    :ivar alive: bonds not cut yet, (M,) bool; to be updated as pieces come out.
    """

    def __init__(self, model: Model, state: State, shaken: np.ndarray):
        self._state = state
        self.alive = state.solver.graph.alive.copy()
        graph, own = state.solver.graph, state.blasts
        poses, size = model.blueprint.poses[shaken], model.blueprint.size[shaken]
        momentum, mass = own.momentum[shaken], state.parts.mass[shaken]
        self._shaken = np.asarray(shaken, np.int64)
        self._bodies = (np.ascontiguousarray(poses[:, :3]),
                        rotation.to_matrix(poses[:, 3:]) * size[:, None, :], momentum,
                        0.5 * (momentum * momentum).sum(axis=1) / mass, own.pulse[shaken])
        self._topology = (graph.start, graph.incident, graph.first, graph.second, self.alive)
        self._inside = np.zeros(graph.count + 1, bool)
        self._wrench = state.solver.wrenches()

    def comes_out(self, rows: np.ndarray) -> bool:
        """
        Return whether a piece of wall is torn from its surroundings.

        The static force equivalent to a short pulse is the impulse times the angular frequency of
        the loaded member, at most twice the mean force of the pulse (Biggs 1964, Introduction to
        Structural Dynamics, 2.5); the frequency of a plate goes with its thickness over its span
        squared.

        A piece that is short for its thickness is sheared off all around; a plate of span a and
        thickness t bends, and arches between its surroundings. A square one carries 8·f·t² by
        yield lines and 0.72·f_c·t² by arching (EN 1996-1-1, 6.3.2; f_c is about 17 times f), over
        4·a·t·f in shear.

        Friction work is not counted: joints in a wall that is shaken as a whole are not compressed
        as before. With this the damage to houses is as published (decision 33).

        :param rows: of its parts among the shaken ones, (K,).
        """
        joints, strength = joints_of(self._state.solver.graph)
        return bool(_comes_out(rows, self._shaken, self._inside, self._bodies, self._topology,
                               self._wrench, joints, strength))


@kernel
def _comes_out(rows, shaken, inside, bodies, topology, wrench, joints, strength):
    places, edges, momentum, energy, pulse = bodies
    total = np.zeros(3)
    moved = 0.0
    for row in rows:
        moved += energy[row]
        for c in range(3):
            total[c] += momentum[row, c]
    size = np.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2)
    if size == 0.0:
        return False
    way = total / size
    force, work = _withstood(shaken[rows], inside, way, topology, wrench, joints, strength)
    if not moved > work:
        return False
    span = max(_middle_extent(places, edges, rows), _BRICK)
    thickness = _thickness(places, edges, rows, way)
    rate = WALL_RATE * thickness / _LEAF * (_STOREY / span) ** 2
    rate = min(rate, 2.0 / _quantile(np.sort(pulse[rows]), 0.5))
    return size * rate > min(_BENDING * thickness / span, 1.0) * force


@subroutine
def _withstood(parts, inside, way, topology, wrench, joints, strength):
    """Return force and work of fracture at which all bonds around some parts fail."""
    start, incident, first, second, alive = topology
    for part in parts:
        inside[part] = True
    force = work = 0.0
    for part in parts:
        for k in range(start[part], start[part + 1]):
            m = np.int64(incident[k])
            is_first = first[m] == part
            if not alive[m] or inside[second[m] if is_first else first[m]]:
                continue
            one = fails(m, 1.0 if is_first else -1.0, way, wrench[m], joints, strength)
            force += one[0]
            work += one[1]
    for part in parts:
        inside[part] = False
    return force, work


@subroutine
def _middle_extent(places, edges, rows):
    """Return the median of the three extents of some positions along the first's edges [m]."""
    extent, edge = np.empty(3), edges[rows[0]]
    for c in range(3):
        length = np.sqrt(edge[0, c] ** 2 + edge[1, c] ** 2 + edge[2, c] ** 2)
        low, high = np.inf, -np.inf
        for row in rows:
            place = (places[row, 0] * edge[0, c] + places[row, 1] * edge[1, c]
                     + places[row, 2] * edge[2, c]) / length
            low, high = min(low, place), max(high, place)
        extent[c] = high - low
    return extent.sum() - extent.min() - extent.max()


@subroutine
def _thickness(places, edges, rows, way):
    """Return the prevailing thickness of a piece of wall along a direction [m]."""
    depth, reach = np.empty(len(rows)), np.zeros(len(rows))
    for k in range(len(rows)):
        row = rows[k]
        depth[k] = (places[row, 0] * way[0] + places[row, 1] * way[1] + places[row, 2] * way[2])
        for c in range(3):
            reach[k] += abs(edges[row, 0, c] * way[0] + edges[row, 1, c] * way[1]
                            + edges[row, 2, c] * way[2])
    depth, reach = np.sort(depth), np.sort(reach)
    return _quantile(depth, 0.9) - _quantile(depth, 0.1) + _quantile(reach, 0.5)


@subroutine
def _quantile(ascending, share):
    """Return a quantile of sorted numbers, interpolated linearly."""
    place = share * (len(ascending) - 1)
    below = int(place)
    above = min(below + 1, len(ascending) - 1)
    return ascending[below] + (place - below) * (ascending[above] - ascending[below])
