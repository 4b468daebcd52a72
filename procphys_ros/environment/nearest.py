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

"""Nearest: distance and direction to what stands closest to a point."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.geometry import rotation

NOTHING = 1e4  # [m] distance where there is nothing: as far as anything can be drawn


def nearest_boxes(points: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
                  round_by: np.ndarray) -> np.ndarray:
    """
    Find the nearest of rounded boxes; points inside have the distance 0.

    :param points: [m], (Q, 3).
    :param poses, sizes: of boxes [m], (N, 7) and (N, 3).
    :param round_by: radius of their edges, beyond their sizes [m], (N,).
    :returns: distance [m] and unit vector towards it, (Q, 4).
    """
    return _nearest(np.ascontiguousarray(points, float), np.ascontiguousarray(poses, float),
                    np.ascontiguousarray(rotation.to_matrix(poses[:, 3:])),
                    np.ascontiguousarray(0.5 * sizes), round_by, False)


def nearest_others(points: np.ndarray) -> np.ndarray:
    """
    Find the nearest other point of each.

    :param points: [m], (Q, 3).
    :returns: distance [m] and unit vector towards it, (Q, 4).
    """
    count, none = len(points), np.zeros((len(points), 3))
    turns = np.tile(np.eye(3), (count, 1, 1))
    return _nearest(np.ascontiguousarray(points, float),
                    np.ascontiguousarray(np.column_stack([points, none, np.ones(count)])), turns,
                    none, np.zeros(count), True)


@kernel
def _nearest(points, poses, axes, half, round_by, others):
    """Search all boxes; spheres around them leave out most."""
    out = np.zeros((len(points), 4))
    reach = np.empty(len(poses))
    for i in range(len(poses)):
        reach[i] = round_by[i] + np.sqrt(half[i, 0] ** 2 + half[i, 1] ** 2 + half[i, 2] ** 2)
    for q in range(len(points)):
        best = NOTHING
        for i in range(len(poses)):
            x, y, z = (points[q, 0] - poses[i, 0], points[q, 1] - poses[i, 1],
                       points[q, 2] - poses[i, 2])
            limit = best + reach[i]
            if x * x + y * y + z * z >= limit * limit or (others and i == q):
                continue
            u, v, w = 0.0, 0.0, 0.0  # from the box to the point
            for k in range(3):
                along = x * axes[i, 0, k] + y * axes[i, 1, k] + z * axes[i, 2, k]
                over = along - min(max(along, -half[i, k]), half[i, k])
                u, v, w = (u + over * axes[i, 0, k], v + over * axes[i, 1, k],
                           w + over * axes[i, 2, k])
            size = np.sqrt(u * u + v * v + w * w)
            if size - round_by[i] < best:
                best = max(size - round_by[i], 0.0)
                size = max(size, 1e-12)
                out[q, 1], out[q, 2], out[q, 3] = -u / size, -v / size, -w / size
        out[q, 0] = best
    return out
