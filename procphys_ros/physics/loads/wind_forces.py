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


"""Wind on boxes: pressure and suction on the faces of buildings."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.loads import faces, wind_pressure
from procphys_ros.physics.loads.sight import Sight
from procphys_ros.physics.terrain import FLAT, Terrain

_WINDWARD = 0.8      # EN 1991-1-4, table 7.1, zone D, height over depth 1
_ELSEWHERE = -0.5    # same table, zones C and E: sides and lee
_APART = 0.15        # lack of correlation of push ahead and pull behind, 7.2.2 (3)
_OFF_FACE = 1e-4     # [m] rays start this far off a face


@dataclass(frozen=True)
class Skin:
    """
    Faces of boxes with a room behind them.

    :ivar faces: from `skin.outer_faces`, (N, 6) bool.
    :ivar building: number of what each box belongs to, (N,).
    :ivar gone: boxes that are not there any more and leave openings, (N,) bool.
    """

    faces: np.ndarray
    building: np.ndarray
    gone: np.ndarray


def exposed_faces(poses: np.ndarray, sizes: np.ndarray, reach: float = 25.0,
                  sight: Sight | None = None, terrain: Terrain = FLAT) -> np.ndarray:
    """
    Find the faces that the wind can reach: nothing stands in front of them, nor the ground.

    A face towards a room sees the opposite wall, so it is not exposed (internal pressure 0). It
    takes a ray per face: ask again only when something has moved or broken.

    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param reach: how far ahead a face must be free [m].
    :param sight: the boxes as already listed for rays; None = list them now.
    :param terrain: the surface of the ground.
    :returns: (N, 6) bool, sides -x +x -y +y -z +z of each box.
    """
    poses, sizes = np.asarray(poses, float), np.asarray(sizes, float)
    one = faces.cut(poses, sizes, np.ones((len(poses), 6), bool), patch=np.inf)
    ahead = one.centre + reach * one.normal
    free = (sight or Sight(poses, sizes)).clear(one.centre + _OFF_FACE * one.normal, ahead,
                                                one.owner)
    exposed = np.zeros((len(poses), 6), bool)
    exposed[one.owner, one.face] = free & (ahead[:, 2] > terrain.height(ahead))
    return exposed


def wall_forces(poses: np.ndarray, sizes: np.ndarray, exposed: np.ndarray, wind: np.ndarray,
                centres: np.ndarray | None = None,
                skin: Skin | None = None) -> tuple[np.ndarray, np.ndarray]:
    """
    Compute the wind pressure on buildings and free-standing walls.

    Pressure = 1/2 · density · speed² · c. On the skins of buildings c is that of `wind_pressure`,
    outside less inside. On walls that stand free, c is 0.8 square to the wind and -0.5 on faces
    along it and in the lee (EN 1991-1-4, table 7.1), between them it follows the square of the
    cosine. What acts along the wind is reduced to 0.85 of it, for push ahead and pull behind are
    never at their peaks together (7.2.2 (3), height over depth up to 1).

    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m]; see `wall_faces.with_joints`.
    :param exposed: from `exposed_faces`, (N, 6) bool.
    :param wind: air velocity at the boxes, (N, 3) [m/s], world.
    :param centres: about which moments are taken, (N, 3) [m]; None = those of the boxes.
    :param skin: which faces belong to the skins of buildings; None = none.
    :returns: forces and moments about the centres, (N, 3) [N] and (N, 3) [N·m], world.
    """
    wanted = exposed if skin is None else exposed | skin.faces
    patches = faces.cut(poses, sizes, wanted, patch=np.inf)
    air = np.asarray(wind, float)[patches.owner]
    square = np.einsum('ki,ki->k', air, air)
    along = np.einsum('ki,ki->k', air, patches.normal)
    coefficient = _ELSEWHERE + (_WINDWARD - _ELSEWHERE) * (
        np.minimum(along, 0.0) ** 2 / np.maximum(square, 1e-12))
    inner = np.zeros(len(along))
    if skin is not None:
        rows = np.flatnonzero(skin.faces[patches.owner, patches.face])
        coefficient[rows], inner[rows] = _on_skin(skin, patches.take(rows), air[rows])
    correlated = 1.0 - _APART * along ** 2 / np.maximum(square, 1e-12)
    pressure = 0.5 * AIR_DENSITY * square * (coefficient * correlated - inner)
    if skin is not None:
        pressure[skin.gone[patches.owner]] = 0.0
    return faces.gather(patches, -(pressure * patches.area)[:, None] * patches.normal,
                        np.asarray(poses, float)[:, :3] if centres is None else centres)


def _on_skin(skin: Skin, patches: faces.Patches,
             air: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give c_pe and c_pi on faces of skins, (K,) each."""
    level = np.linalg.norm(air[:, :2], axis=1, keepdims=True)
    way = air[:, :2] / np.maximum(level, 1e-9)
    _, building = np.unique(skin.building[patches.owner], return_inverse=True)
    outer = wind_pressure.external(patches.normal, way,
                                   wind_pressure.outline(patches.centre, way, building))
    gone = patches.area * skin.gone[patches.owner]
    inner = wind_pressure.internal(patches.area, gone, outer, building)
    return outer, inner[building]
