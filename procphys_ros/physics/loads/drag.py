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


"""Wind on boxes: pressure and suction on the faces of buildings, drag on loose debris."""

import numpy as np

from procphys_ros import rotation
from procphys_ros.physics.air import AIR_DENSITY, CUBE_DRAG
from procphys_ros.physics.loads import faces
from procphys_ros.physics.loads.sight import Sight
from procphys_ros.physics.terrain import FLAT, Terrain

_WINDWARD = 0.8      # EN 1991-1-4, table 7.1, zone D, height over depth 1
_ELSEWHERE = -0.5    # same table, zones C and E: sides and lee
_APART = 0.15        # lack of correlation of push ahead and pull behind, 7.2.2 (3)
_OFF_FACE = 1e-4     # [m] rays start this far off a face


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
                centres: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """
    Compute the wind pressure on buildings.

    Pressure = 1/2 · density · speed² · c; c is 0.8 square to the wind and -0.5 on faces along it
    and in the lee (EN 1991-1-4, table 7.1), between them it follows the square of the cosine.
    What acts along the wind is reduced to 0.85 of it, for push ahead and pull behind are never at
    their peaks together (7.2.2 (3), height over depth up to 1): 1.1 on a building as a whole.

    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m]; see `wall_faces.with_joints`.
    :param exposed: from `exposed_faces`, (N, 6) bool.
    :param wind: air velocity at the boxes, (N, 3) [m/s], world.
    :param centres: about which moments are taken, (N, 3) [m]; None = those of the boxes.
    :returns: forces and moments about the centres, (N, 3) [N] and (N, 3) [N·m], world.
    """
    patches = faces.cut(poses, sizes, exposed, patch=np.inf)
    air = np.asarray(wind, float)[patches.owner]
    square = np.einsum('ki,ki->k', air, air)
    along = np.einsum('ki,ki->k', air, patches.normal)
    pressure = 0.5 * AIR_DENSITY * (
        _ELSEWHERE * square + (_WINDWARD - _ELSEWHERE) * np.minimum(along, 0.0) ** 2)
    pressure *= 1.0 - _APART * along ** 2 / np.maximum(square, 1e-12)
    return faces.gather(patches, -(pressure * patches.area)[:, None] * patches.normal,
                        np.asarray(poses, float)[:, :3] if centres is None else centres)


def drag_coefficients(quaternions: np.ndarray, sizes: np.ndarray,
                      relative_velocity: np.ndarray) -> np.ndarray:
    """
    Compute what the drag of loose boxes is over their velocity through the air.

    The force is the coefficient times the air's velocity relative to the box. An implicit step
    v' = (v + h u) / (1 + h), with h = coefficient · dt / mass and u the air's velocity, is stable
    whatever the step.

    :param quaternions: (N, 4) xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param relative_velocity: air minus box, (N, 3) [m/s], world.
    :returns: (N,) [N·s/m].
    """
    local = np.abs(rotation.rotate(rotation.conjugate(quaternions), relative_velocity))
    x, y, z = np.asarray(sizes, float).T
    # Speed times the area that the flow sees.
    flow = local[:, 0] * y * z + local[:, 1] * z * x + local[:, 2] * x * y
    return 0.5 * AIR_DENSITY * CUBE_DRAG * flow
