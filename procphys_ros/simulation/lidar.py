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


"""Lidar: ranges that a sensor measures in a scene."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import product
from procphys_ros.physics.lidar import cast, NOTHING, Pattern, pinhole, spherical
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.schema import short
from procphys_ros.simulation import intruder
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

INTRUDER = -3  # in place of a part; named ones are -4, -5, … in their order


@dataclass(frozen=True)
class Scan:
    """
    Ranges measured at one instant.

    :ivar pose: of the sensor, world, (7,).
    :ivar ranges: [m], inf = nothing, (V, H).
    :ivar parts: hit parts, (V, H); `lidar.GROUND`, `lidar.NOTHING`, or `INTRUDER` and less.
    :ivar directions: of the rays in the frame of the sensor, (V, H, 3).
    """

    pose: np.ndarray
    ranges: np.ndarray
    parts: np.ndarray
    directions: np.ndarray

    def points(self, in_world: bool) -> np.ndarray:
        """Return the hit points [m], (V, H, 3), in the world or the sensor's frame; NaN = none."""
        ranges = np.where(np.isfinite(self.ranges), self.ranges, np.nan)
        points = self.directions * ranges[..., None]
        if not in_world:
            return points
        return product(points, rotation.to_matrix(self.pose[3:]).T) + self.pose[:3]


def scan(model: Model, state: State, settings: LidarSettings) -> Scan | None:
    """
    Take one scan of the scene at the present instant.

    Parts are seen as their collision boxes and capsules, those in walls with the mortar around
    them, so that no ray slips through a joint; leaves and dust are not seen.

    :returns: None if the sensor is attached to an intruder that has not been placed.
    :raises CommandError: if these are not settings of a lidar, or there is no such intruder.
    """
    if not isinstance(settings, LidarSettings):
        raise CommandError(f'{short(settings)} is no LidarSettings')
    pose, carrier = _pose(state, settings)
    if pose is None:
        return None
    parts = state.parts
    seen = np.flatnonzero(parts.owner != Owner.GONE)
    shapes, poses, sizes = parts.shape[seen], parts.poses[seen], parts.solid_size[seen]
    stands = parts.owner[seen] == Owner.STANDING
    sizes[stands] = model.masonry.closed_sizes[seen[stands]]
    numbers = {name: INTRUDER - i for i, name in enumerate(state.intruders)}
    bodies = {numbers[name]: body for name, body in intruder.bodies(state).items()
              if body != carrier}
    others = [(state.world.pieces(body), state.world.bodies.poses[body])
              for body in bodies.values()]
    shapes = np.concatenate([shapes, *(pieces.shapes for pieces, _ in others)])
    poses = np.concatenate([poses, *(rotation.compose(place, pieces.local_poses)
                                     for pieces, place in others)])
    sizes = np.concatenate([sizes, *(pieces.sizes for pieces, _ in others)])
    pattern = _pattern(settings.pattern, settings.rows, settings.columns, settings.vertical_field,
                       settings.horizontal_field)
    ranges, row = cast(pattern, pose, settings.range, shapes, poses, sizes,
                       model.terrain)
    met = np.concatenate([seen, *(np.full(len(pieces.shapes), number)
                                  for number, (pieces, _) in zip(bodies, others)), [NOTHING]])
    return Scan(pose, ranges, np.where(row < 0, row, met[row]), pattern.directions)


def _pose(state: State, settings: LidarSettings) -> tuple[np.ndarray | None, int]:
    """Return the pose of the sensor, (7,), and the body that carries it, -1 for none."""
    own = np.concatenate([settings.position, _attitude(settings.rotation)])
    if not settings.attached_to:
        return own, -1
    intruder.named(state, settings.attached_to)
    carrier = intruder.bodies(state).get(settings.attached_to)
    if carrier is None:
        return None, -1
    return rotation.compose(state.world.bodies.poses[carrier], own), carrier


def _attitude(angles: tuple[float, ...]) -> np.ndarray:
    """Convert roll, pitch and yaw about the fixed axes x, y, z to a quaternion (4,)."""
    roll, pitch, yaw = (rotation.from_axis_angle(axis, np.asarray(angle))
                        for axis, angle in zip(np.eye(3), angles))
    return rotation.multiply(yaw, rotation.multiply(pitch, roll))


@lru_cache(maxsize=4)
def _pattern(kind: str, rows: int, columns: int, height: float, width: float) -> Pattern:
    return (spherical if kind == 'spherical' else pinhole)(rows, columns, height, width)
