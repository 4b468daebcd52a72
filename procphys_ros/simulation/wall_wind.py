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
from procphys_ros.physics.loads import exposed_faces, wall_forces
from procphys_ros.physics.loads.drag import AIR_DENSITY
from procphys_ros.physics.wind import Wind
from procphys_ros.simulation.buildings import Buildings
from procphys_ros.simulation.standing_loads import StandingLoads

_INTERVAL = 0.25     # [s] between looks at the wind
_BREEZE = 60.0       # [Pa] dynamic pressure, 10 m/s, which walls stand without being asked
_CHANGE = 0.25       # of the dynamic pressure that was last applied
_GONE = 0.02         # share of the standing parts whose loss calls for a new look at the faces
_LAYER = 'wind'


class WallWind:
    """
    Presses the wind on the outsides of buildings.

    :param blueprint: all parts of the scene.
    :param buildings: what stands.
    :param loads: on what stands.
    """

    def __init__(self, blueprint: Blueprint, buildings: Buildings, loads: StandingLoads):
        self._blueprint = blueprint
        self._buildings = buildings
        self._loads = loads
        members = buildings.standing & (blueprint.shape == Shape.BOX)
        top = blueprint.poses[members, :3]
        middle = 0.5 * (top.min(axis=0) + top.max(axis=0)) if len(top) else np.zeros(3)
        self._gauge = np.array([[*middle[:2], top[:, 2].max(initial=0.0)]])
        self.begin()

    def begin(self) -> None:
        """Forget what the wind did."""
        self._next_look = 0.0
        self._applied = np.zeros(3)
        self._parts = np.zeros(0, np.intp)

    def advance(self, wind: Wind, time: float) -> None:
        """
        Renew the pressure if it has changed.

        :param wind: blows on the buildings.
        :param time: [s].
        """
        if time < self._next_look - 1e-9 or not self._buildings.standing.any():
            return
        self._next_look = time + _INTERVAL
        air = wind.velocity(self._gauge, time)[0] if wind.enabled else np.zeros(3)
        now, before = _pressure(air), _pressure(self._applied)
        if now < _BREEZE:
            if before:
                self._applied = np.zeros(3)
                self._loads.take_off(_LAYER)
            return
        turned = np.linalg.norm(air - self._applied) * np.linalg.norm(air) * AIR_DENSITY
        if turned > _CHANGE * max(before, _BREEZE) or self._has_lost_parts():
            self._applied = air
            self._press(wind, time)

    def _press(self, wind: Wind, time: float) -> None:
        source = self._blueprint
        if self._has_lost_parts():
            self._parts = np.flatnonzero(self._buildings.standing
                                         & (source.shape == Shape.BOX))
            self._exposed = exposed_faces(source.poses[self._parts], source.size[self._parts])
        chosen = self._exposed.any(axis=1) & self._buildings.standing[self._parts]
        parts = self._parts[chosen]
        poses = source.poses[parts]
        force, moment = wall_forces(poses, source.size[parts], self._exposed[chosen],
                                    wind.velocity(poses[:, :3], time))
        self._loads.put(_LAYER, parts, np.hstack([force, moment]))

    def _has_lost_parts(self) -> bool:
        count = np.count_nonzero(self._buildings.standing)
        return not len(self._parts) or bool(count < (1.0 - _GONE) * len(self._parts))


def _pressure(air: np.ndarray) -> float:
    return float(0.5 * AIR_DENSITY * (air @ air))
