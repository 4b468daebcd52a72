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


"""Wind on boxes: pressure and suction on faces of buildings, as sums of a few patterns."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.elementary import atan2, cos, sin
from procphys_ros.geometry.linear import product
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.loads import faces, wind_pressure
from procphys_ros.physics.loads.sight import OFF_FACE, Sight
from procphys_ros.physics.terrain import FLAT, Terrain

_WINDWARD = 0.8      # EN 1991-1-4, table 7.1, zone D, height over depth 1
_ELSEWHERE = -0.5    # same table, zones C and E: sides and lee
_APART = 0.15        # lack of correlation of pressure ahead and suction behind, 7.2.2 (3)
_WAYS = 48           # directions of the patterns; the interpolated pressure on a wall normal to a
#                      direction halfway between two of them is 0.6 % too low


@dataclass(frozen=True)
class Skin:
    """
    Faces of boxes with a room behind them.

    :ivar faces: from `skin.outer_faces`, (N, 6) bool.
    :ivar building: number of each box's building, (N,).
    """

    faces: np.ndarray
    building: np.ndarray


def exposed_faces(poses: np.ndarray, sizes: np.ndarray, reach: float = 25.0,
                  sight: Sight | None = None, terrain: Terrain = FLAT) -> np.ndarray:
    """
    Mark the faces exposed to wind: neither boxes nor the ground are in front of them.

    A face towards a room sees the opposite wall, so it is not exposed (internal pressure 0). This
    casts a ray per face: recompute it only after boxes have moved or broken. The wind follows the
    ground, so that counts as level in front of each face: hills shelter nothing.

    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param reach: length that must be free in front of a face [m].
    :param sight: existing lines of sight among the boxes; None = build them.
    :param terrain: the surface of the ground.
    :returns: (N, 6) bool, sides -x +x -y +y -z +z of each box.
    """
    poses, sizes = np.asarray(poses, float), np.asarray(sizes, float)
    one = faces.cut(poses, sizes, np.ones((len(poses), 6), bool), patch=np.inf)
    ahead = one.centre + reach * one.normal
    free = (sight or Sight(poses, sizes)).clear(one.centre + OFF_FACE * one.normal, ahead,
                                                one.owner)
    exposed = np.zeros((len(poses), 6), bool)
    exposed[one.owner, one.face] = free & (ahead[:, 2] > terrain.height(one.centre))
    return exposed


class WallPressure:
    """
    Pressure of a level wind on faces of boxes: 1/2 · density · speed² · c.

    On the skins of buildings c is that of `wind_pressure`, external minus internal. On
    free-standing walls, c is 0.8 normal to the wind and -0.5 on faces along it and in the lee (EN
    1991-1-4, table 7.1), interpolated by the square of the cosine. Pressures along the wind are
    reduced to 0.85, as pressure ahead and suction behind do not peak at the same time (7.2.2
    (3), height over depth up to 1).

    Zones move over walls and roofs with every change of wind direction, so no two gusts would load
    a building alike. Outer coefficients are therefore computed for directions 7.5 degrees apart
    and interpolated linearly: loads are then sums of a few patterns, whose solutions the stress
    solver keeps (decision 47).

    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m]; see `wall_faces.with_joints`.
    :param exposed: from `exposed_faces`, (N, 6) bool.
    :param centres: reference points of moments, (N, 3) [m]; None = those of the boxes.
    :param skin: faces of the skins of buildings; None = none.
    """

    def __init__(self, poses: np.ndarray, sizes: np.ndarray, exposed: np.ndarray,
                 centres: np.ndarray | None = None, skin: Skin | None = None):
        poses = np.asarray(poses, float)
        wanted = exposed if skin is None else exposed | skin.faces
        patches = faces.cut(poses, sizes, wanted, patch=np.inf)
        self._patches, self._count = patches, len(poses)
        self._on_skin = np.flatnonzero(np.zeros(len(patches.owner), bool) if skin is None else
                                       skin.faces[patches.owner, patches.face])
        owner = patches.owner[self._on_skin]
        _, self._building = np.unique(owner if skin is None else skin.building[owner],
                                      return_inverse=True)
        push = -patches.area[:, None] * patches.normal
        arm = patches.centre - (poses[:, :3] if centres is None else centres)[patches.owner]
        self._wrenches = np.hstack([push, np.cross(arm, push)]).T.copy()  # at 1 Pa
        self._patterns: dict[int, np.ndarray] = {}

    def forces(self, air: np.ndarray, place: np.ndarray | None = None,
               gone: np.ndarray | None = None) -> np.ndarray:
        """
        Compute the wind forces and moments on the boxes.

        :param air: velocities of the air [m/s], world, (S, 3) or (3,).
        :param place: index of the velocity at each box, (N,); None = the first.
        :param gone: removed boxes, which leave openings, (N,) bool; None = none.
        :returns: forces and moments about the centres [N], [N·m], world, (N, 6).
        """
        owner, rows, air = self._patches.owner, self._on_skin, np.atleast_2d(air)
        feels = np.zeros(len(owner), np.intp) if place is None else place[owner]
        coefficient = self._outer(air, feels)
        if len(rows):
            area = self._patches.area[rows]
            open_area = np.zeros(len(rows)) if gone is None else area * gone[owner[rows]]
            inner = wind_pressure.internal(area, open_area, coefficient[rows], self._building)
            coefficient[rows] -= inner[self._building]
        pressure = _dynamic_pressure(air)[feels] * coefficient
        if gone is not None:
            pressure[gone[owner]] = 0.0
        return np.column_stack([np.bincount(owner, pressure * column, self._count)
                                for column in self._wrenches])

    def _outer(self, air: np.ndarray, feels: np.ndarray) -> np.ndarray:
        """Compute the outer coefficients of all faces, (K,), in the air of rows `feels`."""
        turn = atan2(air[:, 1], air[:, 0]) * (_WAYS / (2.0 * np.pi)) % _WAYS
        first = turn.astype(np.intp)
        share = turn - first
        total = np.zeros(len(feels))
        for way in np.unique([first % _WAYS, (first + 1) % _WAYS]).tolist():
            own = np.where(first % _WAYS == way, 1.0 - share,
                           np.where((first + 1) % _WAYS == way, share, 0.0))
            total += own[feels] * self._pattern(way)
        return total

    def _pattern(self, number: int) -> np.ndarray:
        """Return the outer coefficients of all faces in one of the directions, (K,)."""
        if number not in self._patterns:
            turn = 2.0 * np.pi * number / _WAYS
            way = np.array([cos(turn), sin(turn)])
            along = product(self._patches.normal[:, :2], way)
            outer = _ELSEWHERE + (_WINDWARD - _ELSEWHERE) * np.square(np.minimum(along, 0.0))
            patches = self._patches.take(self._on_skin)
            ways = np.tile(way, (len(patches.owner), 1))
            outer[self._on_skin] = wind_pressure.external(
                patches.normal, ways,
                wind_pressure.outline(patches.centre, ways, self._building))
            self._patterns[number] = outer * (1.0 - _APART * (along * along))
        return self._patterns[number]


def _dynamic_pressure(air: np.ndarray) -> np.ndarray:
    """Compute the dynamic pressure [Pa]; steep flow is limited by its horizontal component."""
    square = air * air
    return AIR_DENSITY * np.minimum(0.5 * square.sum(axis=1), square[:, :2].sum(axis=1))
