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

from collections.abc import Callable
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
    def touch(start: np.ndarray, along: np.ndarray, rows: np.ndarray) -> tuple:
        return first_touch.sphere_on_boxes(start, along, radius, *_boxes(poses, sizes, rows))
    return _swept(start, end, radius, poses, sizes, active, touch)


def sweep_capsules(start: np.ndarray, end: np.ndarray, radius: float, poses: np.ndarray,
                   sizes: np.ndarray, active: np.ndarray | None = None) -> Hits:
    """
    Find the capsules that a sphere touches on its path.

    :param sizes: diameter, diameter, length over the round ends, (N, 3) [m]; the axis is z.

    The other parameters are those of `sweep_boxes`.
    """
    def touch(start: np.ndarray, along: np.ndarray, rows: np.ndarray) -> tuple:
        return first_touch.sphere_on_capsules(start, along, radius, *_capsules(poses, sizes, rows))
    return _swept(start, end, radius, poses, sizes, active, touch)


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
    half = 0.5 * np.asarray(extent, float)

    def touch(start: np.ndarray, along: np.ndarray, rows: np.ndarray) -> tuple:
        return first_touch.box_on_boxes(start, along, rotation.to_matrix(attitude), half,
                                        *_boxes(poses, sizes, rows))
    return _swept(start, end, float(norm(half)), poses, sizes, active, touch)


def sweep_box_capsules(start: np.ndarray, end: np.ndarray, attitude: np.ndarray,
                       extent: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
                       active: np.ndarray | None = None) -> Hits:
    """
    Find the capsules that a box, which does not rotate, touches on its path.

    The parameters are those of `sweep_box_boxes` and `sweep_capsules`.
    """
    half = 0.5 * np.asarray(extent, float)

    def touch(start: np.ndarray, along: np.ndarray, rows: np.ndarray) -> tuple:
        return first_touch.box_on_capsules(start, along, rotation.to_matrix(attitude), half,
                                           *_capsules(poses, sizes, rows))
    return _swept(start, end, float(norm(half)), poses, sizes, active, touch)


def _swept(start: np.ndarray, end: np.ndarray, radius: float, poses: np.ndarray,
           sizes: np.ndarray, active: np.ndarray | None,
           touch: Callable[[np.ndarray, np.ndarray, np.ndarray], tuple]) -> Hits:
    """
    Find the targets touched on a path, in order; equal times in order of the rows.

    :param radius: of a sphere around the projectile [m].
    :param touch: returns share of the path, point and normal for each of some targets; called
        with start and path of the projectile, and their rows.
    """
    start = np.asarray(start, float)
    along = np.asarray(end, float) - start
    tested = np.ones(len(poses), bool) if active is None else np.asarray(active, bool)
    rows = _near(start, along, radius, poses, sizes, tested)
    if not len(rows):
        return _NONE
    fraction, point, normal = touch(start, along, rows)
    order = np.argsort(fraction, kind='stable')
    order = order[fraction[order] <= 1.0]
    return Hits(rows[order], fraction[order], point[order], normal[order])


def _boxes(poses: np.ndarray, sizes: np.ndarray, rows: np.ndarray) -> tuple:
    """Return centres, axes and half extents of the boxes in some rows."""
    return poses[rows, :3], rotation.to_matrix(poses[rows, 3:]), 0.5 * sizes[rows]


def _capsules(poses: np.ndarray, sizes: np.ndarray, rows: np.ndarray) -> tuple:
    """Return centres, half axes (vectors) and radii of the capsules in some rows."""
    radii = 0.5 * sizes[rows, 0]
    half = np.maximum(0.5 * sizes[rows, 2] - radii, 0.0)
    axes = rotation.to_matrix(poses[rows, 3:])[:, :, 2] * half[:, None]
    return poses[rows, :3], axes, radii


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
