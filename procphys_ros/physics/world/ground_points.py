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
Ground contact points: corners of bricks that stick out of the merged boxes of a fragment.

The merged boxes of a toothed edge end half way (`merging`), otherwise broken walls would interlock
for good. The ground is flat, so against it the true corners count.
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.rotation_kernels import matrix

_OUT = 0.01  # [m] by which a corner must stick out to be kept
_SLOP = 0.002  # [m] that a point at rest may sink, so that it stays in touch
_RECOVERY = 0.5  # share of the depth that is corrected per step
_ITERATIONS = 12  # over the points of a body that touch
_COLUMNS = 13  # of the rows of `Engine.contacts`


def corners_outside(poses: np.ndarray, sizes: np.ndarray, merged_poses: np.ndarray,
                    merged_sizes: np.ndarray) -> np.ndarray:
    """
    List the corners of boxes that lie outside of the merged boxes.

    :param poses: (P, 7), in the body's frame.
    :param sizes: full extents [m], (P, 3).
    :param merged_poses: (K, 7).
    :param merged_sizes: (K, 3).
    :returns: points in the body's frame [m], (T, 3).
    """
    found = np.empty((8 * len(poses), 3))
    return found[:_corners_outside(poses, sizes, merged_poses, merged_sizes, found)].copy()


@kernel
def _corners_outside(poses, sizes, merged_poses, merged_sizes, found):
    axes = np.empty((len(merged_poses), 3, 3))
    reach = np.empty(len(merged_poses))
    for k in range(len(merged_poses)):
        axes[k] = matrix(merged_poses[k, 3:])
        reach[k] = _diagonal(merged_sizes[k]) + 2.0 * _OUT
    near = np.empty(len(merged_poses), np.int64)
    count = 0
    for p in range(len(poses)):
        own = matrix(poses[p, 3:])
        far = _diagonal(sizes[p])
        many = 0
        for k in range(len(merged_poses)):
            x = poses[p, 0] - merged_poses[k, 0]
            y = poses[p, 1] - merged_poses[k, 1]
            z = poses[p, 2] - merged_poses[k, 2]
            if x * x + y * y + z * z < (reach[k] + far) ** 2:
                near[many] = k
                many += 1
        for corner in range(8):
            point = poses[p, :3].copy()
            for axis in range(3):
                point += own[:, axis] * sizes[p, axis] * (0.5 - ((corner >> axis) & 1))
            if not _is_inside(point, near[:many], merged_poses, merged_sizes, axes):
                found[count] = point
                count += 1
    return count


@kernel
def _diagonal(size):
    """Give half of the diagonal of a box [m]."""
    return 0.5 * (size[0] ** 2 + size[1] ** 2 + size[2] ** 2) ** 0.5


@kernel
def _is_inside(point, near, poses, sizes, axes):
    for k in near:
        inside = True
        for c in range(3):
            arm = 0.0
            for d in range(3):
                arm += (point[d] - poses[k, d]) * axes[k, d, c]
            if abs(arm) >= 0.5 * sizes[k, c] + _OUT:
                inside = False
                break
        if inside:
            return True
    return False


@kernel
def resolve_ground_contacts(start, points, poses, velocities, mass, inertia, friction, time_step):
    """
    Stop the points that penetrate the ground, and move them out of it.

    Perfectly plastic impulses with Coulomb friction at all points below z = 0 of a body together,
    by projected Gauss-Seidel; then the same in displacements for the depth that is left.

    :param start: first point of each body, one more at the end, (B + 1,) int.
    :param points: in the bodies' frames [m], (Q, 3).
    :param poses: (B, 7), changed in place.
    :param velocities: world axes, (B, 6), changed in place.
    :param mass: [kg], (B,).
    :param inertia: principal moments [kg·m²], (B, 3).
    :param friction: of the bodies on the ground.
    :param time_step: [s].
    :returns: contacts as of `Engine.contacts`, with the row of the body for its id, (C, 13).
    """
    table = np.zeros((len(points), _COLUMNS))
    count = 0
    for b in range(len(poses)):
        axes = matrix(poses[b, 3:])
        first = count
        for t in range(start[b], start[b + 1]):
            arm = axes @ points[t]
            height = poses[b, 2] + arm[2]
            if height < 0.0:
                table[count, 0] = b
                table[count, 2:5] = arm
                table[count, 7] = 1.0
                table[count, 8] = height
                count += 1
        if count > first:
            compliance = (axes / inertia[b]) @ axes.T
            rows, where = table[first:count], poses[b, :3].copy()
            _solve_velocities(rows, velocities[b], mass[b], compliance, friction)
            _solve_positions(rows, poses[b], mass[b], compliance)
            rows[:, 2:5] += where
            rows[:, 9:] /= time_step
    return table[:count]


@kernel
def _solve_velocities(rows, velocity, mass, compliance, friction):
    """Bring the points to rest; impulses go to columns 9 to 12."""
    for _ in range(_ITERATIONS):
        for row in rows:
            arm = row[2:5]
            for axis in (2, 0, 1):
                push = np.zeros(3)
                push[axis] = 1.0
                turn = compliance @ np.cross(arm, push)
                softness = 1.0 / mass + np.cross(turn, arm)[axis]
                slip = velocity[axis] + np.cross(velocity[3:], arm)[axis]
                before = row[9 + axis]
                most = friction * row[11]
                after = before - slip / softness
                after = max(after, 0.0) if axis == 2 else min(max(after, -most), most)
                row[9 + axis] = after
                velocity[axis] += (after - before) / mass
                velocity[3:] += turn * (after - before)
    rows[:, 12] = rows[:, 11]


@kernel
def _solve_positions(rows, pose, mass, compliance):
    """Shift and turn the body until its points have recovered their share of the depth."""
    shift, turned = np.zeros(3), np.zeros(3)
    given = np.zeros(len(rows))
    for _ in range(_ITERATIONS):
        for i in range(len(rows)):
            arm = rows[i, 2:5]
            wanted = _RECOVERY * (-rows[i, 8] - _SLOP)
            turn = compliance @ np.array([arm[1], -arm[0], 0.0])
            softness = 1.0 / mass + turn[0] * arm[1] - turn[1] * arm[0]
            got = shift[2] + turned[0] * arm[1] - turned[1] * arm[0]
            more = max(given[i] + (wanted - got) / softness, 0.0) - given[i]
            given[i] += more
            shift[2] += more / mass
            turned += turn * more
    pose[:3] += shift
    half = 0.5 * turned
    x, y, z, w = pose[3:]
    pose[3] += half[0] * w + half[1] * z - half[2] * y
    pose[4] += half[1] * w + half[2] * x - half[0] * z
    pose[5] += half[2] * w + half[0] * y - half[1] * x
    pose[6] -= half[0] * x + half[1] * y + half[2] * z
    pose[3:] /= np.sqrt((pose[3:] ** 2).sum())
