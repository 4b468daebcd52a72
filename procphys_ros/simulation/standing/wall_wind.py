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


"""Wind pressure on standing walls, renewed only when the wind has changed noticeably."""

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.loads import exposed_faces, wall_forces
from procphys_ros.physics.wind import Wind
from procphys_ros.simulation.standing.buildings import Buildings
from procphys_ros.simulation.standing.standing_loads import StandingLoads

_INTERVAL = 0.25     # [s] between looks at the wind
_BREEZE = 60.0       # [Pa] dynamic pressure, 10 m/s, which walls stand without being asked
_CHANGE = 0.25       # of the dynamic pressure that was last applied
_GONE = 0.02         # share of the standing parts whose loss calls for a new look at the faces
_LAYER = 'wind'


class WallWind:
    """
    Presses the wind on the outsides of buildings.

    Each building feels the air at its top as a whole (EN 1991-1-4, 7.2.2: the reference height of
    walls no higher than wide; it overrates the lower storeys of towers). Eddies smaller than a
    building press on parts of it at different times, which codes leave out as well. The air inside
    keeps the pressure of the air at rest; in truth it lies between 0.2 and -0.3 of that of the
    wind (7.2.9).

    :param blueprint: all parts of the scene.
    :param buildings: what stands.
    :param loads: on what stands.
    """

    def __init__(self, blueprint: Blueprint, buildings: Buildings, loads: StandingLoads):
        self._blueprint = blueprint
        self._buildings = buildings
        self._loads = loads
        self.begin()

    def begin(self) -> None:
        """Forget what the wind did."""
        self._next_look = 0.0
        self._parts = np.zeros(0, np.intp)
        self._tops = self._applied = np.zeros((0, 3))

    def advance(self, wind: Wind, time: float) -> None:
        """
        Renew the pressure if it has changed.

        :param wind: blows on the buildings.
        :param time: [s].
        """
        if time < self._next_look - 1e-9 or not self._buildings.standing.any():
            return
        self._next_look = time + _INTERVAL
        lost = self._has_lost_parts()
        if lost:
            self._survey()
        air = wind.velocity(self._tops, time)
        now, before = _pressure(air), _pressure(self._applied)
        if now.max(initial=0.0) < _BREEZE:
            if before.any():
                self._applied = np.zeros_like(air)
                self._loads.take_off(_LAYER)
            return
        turned = AIR_DENSITY * np.sqrt(((air - self._applied) ** 2).sum(axis=1) * 2.0 * now
                                       / AIR_DENSITY)
        if lost or np.any(turned > _CHANGE * np.maximum(before, _BREEZE)):
            self._applied = air
            self._press()

    def _survey(self) -> None:
        """Find the outsides of what stands, and the top of each building."""
        source = self._blueprint
        self._parts = np.flatnonzero(self._buildings.standing & (source.shape == Shape.BOX))
        poses = source.poses[self._parts]
        self._exposed = exposed_faces(poses, source.size[self._parts])
        _, self._owner = np.unique(self._buildings.solver.labels[self._parts],
                                   return_inverse=True)
        count = np.bincount(self._owner)
        self._tops = np.column_stack([np.bincount(self._owner, poses[:, axis]) / count
                                      for axis in range(3)])
        np.maximum.at(self._tops[:, 2], self._owner, poses[:, 2])
        self._applied = np.zeros_like(self._tops)

    def _press(self) -> None:
        source = self._blueprint
        chosen = self._exposed.any(axis=1) & self._buildings.standing[self._parts]
        parts = self._parts[chosen]
        force, moment = wall_forces(source.poses[parts], source.size[parts],
                                    self._exposed[chosen], self._applied[self._owner[chosen]])
        self._loads.put(_LAYER, parts, np.hstack([force, moment]))

    def _has_lost_parts(self) -> bool:
        count = np.count_nonzero(self._buildings.standing)
        return not len(self._parts) or bool(count < (1.0 - _GONE) * len(self._parts))


def _pressure(air: np.ndarray) -> np.ndarray:
    return 0.5 * AIR_DENSITY * np.einsum('ki,ki->k', air, air)
