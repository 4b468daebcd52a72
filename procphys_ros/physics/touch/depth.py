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


"""Overlap: penetration depth of a ball or a box in boxes."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear_kernels import dot, transformed, transformed_back
from procphys_ros.geometry.rotation_kernels import matrix

Overlap = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Depths, 0 where nothing touches [m], (B,), ways out of each box, (B, 3), and a point where they
press on each other [m], world, (B, 3)."""


def overlap_ball(centre: np.ndarray, radius: float, poses: np.ndarray,
                 sizes: np.ndarray) -> Overlap:
    """
    Compute the penetration depth of a ball in each of many boxes.

    :param centre: [m], (3,), world.
    :param radius: [m].
    :param poses: of the boxes, (B, 7).
    :param sizes: full extents [m], (B, 3).
    """
    return _overlap_ball(np.ascontiguousarray(centre, float), float(radius), poses, sizes)


def overlap_box(pose: np.ndarray, size: np.ndarray, poses: np.ndarray,
                sizes: np.ndarray) -> Overlap:
    """
    Compute the penetration depth of a box in each of many boxes.

    :param pose: (7,).
    :param size: full extents [m], (3,).

    The other parameters are those of `overlap_ball`.
    """
    return _overlap_box(np.asarray(pose, float), np.asarray(size, float), poses, sizes)


@kernel
def _overlap_ball(centre, radius, poses, sizes):
    depth, normal = np.zeros(len(poses)), np.zeros((len(poses), 3))
    point = np.zeros((len(poses), 3))
    for i in range(len(poses)):
        turn = matrix(poses[i, 3:])
        d, n = _ball(transformed_back(turn, centre - poses[i, :3]), 0.5 * sizes[i], radius)
        if d > 0.0:
            depth[i], normal[i] = d, transformed(turn, n)
            point[i] = centre - radius * normal[i]
    return depth, normal, point


@kernel
def _overlap_box(pose, size, poses, sizes):
    depth, normal = np.zeros(len(poses)), np.zeros((len(poses), 3))
    point = np.zeros((len(poses), 3))
    mine = matrix(pose[3:])
    for i in range(len(poses)):
        turn, half = matrix(poses[i, 3:]), 0.5 * sizes[i]
        arm = pose[:3] - poses[i, :3]
        d, n = _boxes(arm, mine, 0.5 * size, turn, half)
        if d > 0.0:
            depth[i], normal[i] = d, n
            inside = np.minimum(np.maximum(transformed_back(turn, arm), -half), half)
            point[i] = poses[i, :3] + transformed(turn, inside)
    return depth, normal, point


@subroutine
def _ball(centre, half, radius):
    """Return penetration depth and outward normal of a ball in a box, in the box's frame."""
    away = centre - np.minimum(np.maximum(centre, -half), half)
    far = np.sqrt((away ** 2).sum())
    if far > 1e-9:
        return radius - far, away / far
    room = np.abs(centre) - half
    k = np.argmax(room)
    n = np.zeros(3)
    n[k] = 1.0 if centre[k] >= 0.0 else -1.0
    return radius - room[k], n


@subroutine
def _boxes(arm, mine, size, turn, half):
    """Return least overlap and normal of two boxes, by the separating axis test."""
    least, normal = np.inf, np.zeros(3)
    for a in range(15):
        if a < 3:
            axis = mine[:, a].copy()
        elif a < 6:
            axis = turn[:, a - 3].copy()
        else:
            u, v = mine[:, (a - 6) // 3], turn[:, (a - 6) % 3]
            axis = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                             u[0] * v[1] - u[1] * v[0]])
            length = np.sqrt((axis ** 2).sum())
            if length < 1e-6:
                continue
            axis /= length
        reach = (dot(np.abs(transformed_back(mine, axis)), size)
                 + dot(np.abs(transformed_back(turn, axis)), half))
        along = (arm * axis).sum()
        room = reach - abs(along)
        if room < least - (1e-6 if a >= 6 else 0.0):
            least = room
            normal = axis if along >= 0.0 else -axis
    return least, normal
