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
Swept projectiles: targets touched by a sphere or a box on a straight path.

Every target is tested by its bounding sphere first, the few that remain exactly.
"""

from dataclasses import dataclass

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.loads import first_touch


@dataclass(frozen=True)
class Hits:
    """
    Targets touched on the path, in order.

    :ivar index: row of the target, (K,).
    :ivar fraction: share of the path at the first touch, 0 when touching from the start, (K,).
    :ivar point: contact point on the target, (K, 3) [m], world.
    :ivar normal: unit vector out of the target there, (K, 3), world.
    """

    index: np.ndarray
    fraction: np.ndarray
    point: np.ndarray
    normal: np.ndarray

    def __len__(self) -> int:
        return len(self.index)


_NONE = Hits(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)), np.empty((0, 3)))


def sweep_boxes(start: np.ndarray, end: np.ndarray, radius: float, poses: np.ndarray,
                sizes: np.ndarray, active: np.ndarray | None = None) -> Hits:
    """
    Find the boxes that a sphere touches on its path.

    :param start, end: of the sphere's centre, (3,) [m], world.
    :param radius: [m].
    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param active: boxes to test, (N,) bool; None = all.
    """
    start, along = _way(start, end)
    rows = _near(start, along, radius, poses, sizes, _flags(active, len(poses)))
    if not len(rows):
        return _NONE
    axes = rotation.to_matrix(poses[rows, 3:])
    found = first_touch.sphere_on_boxes(start, along, radius, poses[rows, :3], axes,
                                        0.5 * sizes[rows])
    return _sorted(rows, *found)


def sweep_capsules(start: np.ndarray, end: np.ndarray, radius: float, poses: np.ndarray,
                   sizes: np.ndarray, active: np.ndarray | None = None) -> Hits:
    """
    Find the capsules that a sphere touches on its path.

    :param sizes: diameter, diameter, length over the round ends, (N, 3) [m]; the axis is z.

    The other parameters are those of `sweep_boxes`.
    """
    start, along = _way(start, end)
    rows = _near(start, along, radius, poses, sizes, _flags(active, len(poses)))
    if not len(rows):
        return _NONE
    found = first_touch.sphere_on_capsules(start, along, radius, *_capsules(poses, sizes, rows))
    return _sorted(rows, *found)


def sweep_box_boxes(start: np.ndarray, end: np.ndarray, attitude: np.ndarray, extent: np.ndarray,
                    poses: np.ndarray, sizes: np.ndarray,
                    active: np.ndarray | None = None) -> Hits:
    """
    Find the boxes that a box, which does not rotate, touches on its path.

    The point is that of the target nearest to the projectile's centre at the first touch.

    :param attitude: of the projectile, (4,) xyzw, world.
    :param extent: full extents of the projectile, (3,) [m].

    The other parameters are those of `sweep_boxes`.
    """
    start, along = _way(start, end)
    half = 0.5 * np.asarray(extent, float)
    rows = _near(start, along, float(norm(half)), poses, sizes,
                 _flags(active, len(poses)))
    if not len(rows):
        return _NONE
    axes = rotation.to_matrix(poses[rows, 3:])
    found = first_touch.box_on_boxes(start, along, rotation.to_matrix(attitude), half,
                                     poses[rows, :3], axes, 0.5 * sizes[rows])
    return _sorted(rows, *found)


def sweep_box_capsules(start: np.ndarray, end: np.ndarray, attitude: np.ndarray,
                       extent: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
                       active: np.ndarray | None = None) -> Hits:
    """
    Find the capsules that a box, which does not rotate, touches on its path.

    The parameters are those of `sweep_box_boxes` and `sweep_capsules`.
    """
    start, along = _way(start, end)
    half = 0.5 * np.asarray(extent, float)
    rows = _near(start, along, float(norm(half)), poses, sizes,
                 _flags(active, len(poses)))
    if not len(rows):
        return _NONE
    found = first_touch.box_on_capsules(start, along, rotation.to_matrix(attitude), half,
                                        *_capsules(poses, sizes, rows))
    return _sorted(rows, *found)


def _way(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    start = np.asarray(start, float)
    return start, np.asarray(end, float) - start


def _flags(active: np.ndarray | None, count: int) -> np.ndarray:
    return np.ones(count, bool) if active is None else np.asarray(active, bool)


def _capsules(poses: np.ndarray, sizes: np.ndarray, rows: np.ndarray) -> tuple:
    """Return centres, half axes (vectors) and radii of the capsules in some rows."""
    radii = 0.5 * sizes[rows, 0]
    half = np.maximum(0.5 * sizes[rows, 2] - radii, 0.0)
    axes = rotation.to_matrix(poses[rows, 3:])[:, :, 2] * half[:, None]
    return poses[rows, :3], axes, radii


def _sorted(rows: np.ndarray, fraction: np.ndarray, point: np.ndarray,
            normal: np.ndarray) -> Hits:
    """Return the targets touched on the path, in order; equal times in order of the rows."""
    order = np.argsort(fraction, kind='stable')
    order = order[fraction[order] <= 1.0]
    return Hits(rows[order], fraction[order], point[order], normal[order])


@kernel(error_model='numpy')
def _near(start, along, radius, poses, sizes, active):
    """List the rows whose bounding spheres overlap the swept sphere; radius: half of the sum."""
    x0, y0, z0 = start[0], start[1], start[2]
    u, v, w = along[0], along[1], along[2]
    square = u * u + v * v + w * w
    inverse = 1.0 / square if square > 0.0 else 0.0
    rows = np.empty(len(poses), np.int64)
    count = 0
    for i in range(len(poses)):
        x, y, z = poses[i, 0] - x0, poses[i, 1] - y0, poses[i, 2] - z0
        t = min(max((x * u + y * v + z * w) * inverse, 0.0), 1.0)
        x, y, z = x - t * u, y - t * v, z - t * w
        reach = radius + 0.5 * (sizes[i, 0] + sizes[i, 1] + sizes[i, 2])
        if x * x + y * y + z * z <= reach * reach and active[i]:
            rows[count] = i
            count += 1
    return rows[:count]
