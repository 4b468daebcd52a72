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
for good. The ground has no such teeth, so against it the true corners count.
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.terrain import height_at, normal_at
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
def resolve_ground_contacts(start, points, poses, velocities, mass, inertia, friction, time_step,
                            terrain):
    """
    Stop the points that penetrate the ground, and move them out of it.

    Perfectly plastic impulses with Coulomb friction at all points of a body in the ground
    together, by projected Gauss-Seidel; then the same in displacements for the depth that is left.

    :param start: first point of each body, one more at the end, (B + 1,) int.
    :param points: in the bodies' frames [m], (Q, 3).
    :param poses: (B, 7), changed in place.
    :param velocities: world axes, (B, 6), changed in place.
    :param mass: [kg], (B,).
    :param inertia: principal moments [kg·m²], (B, 3).
    :param friction: of the bodies on the ground.
    :param time_step: [s].
    :param terrain: the surface of the ground.
    :returns: contacts as of `Engine.contacts`, with the row of the body for its id, (C, 13).
    """
    table = np.zeros((len(points), _COLUMNS))
    count = 0
    for b in range(len(poses)):
        axes = matrix(poses[b, 3:])
        first = count
        for t in range(start[b], start[b + 1]):
            arm = axes @ points[t]
            x, y = poses[b, 0] + arm[0], poses[b, 1] + arm[1]
            height = poses[b, 2] + arm[2] - height_at(terrain, x, y)
            if height < 0.0:
                normal = normal_at(terrain, x, y)
                table[count, 0] = b
                table[count, 2:5] = arm
                table[count, 5], table[count, 6], table[count, 7] = normal
                table[count, 8] = height * normal[2]
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
            ways = _ways(row[5:8])
            for axis in (2, 0, 1):
                push = ways[axis].copy()
                turn = compliance @ np.cross(arm, push)
                softness = 1.0 / mass + (np.cross(turn, arm) * push).sum()
                slip = ((velocity[:3] + np.cross(velocity[3:], arm)) * push).sum()
                before = row[9 + axis]
                most = friction * row[11]
                after = before - slip / softness
                after = max(after, 0.0) if axis == 2 else min(max(after, -most), most)
                row[9 + axis] = after
                velocity[:3] += push * ((after - before) / mass)
                velocity[3:] += turn * (after - before)
    for row in rows:
        row[12] = row[11]
        row[9:12] = row[9:12].copy() @ _ways(row[5:8])


@kernel
def _ways(normal):
    """Give two directions along the ground and its normal, (3, 3); of level ground x, y and z."""
    ways = np.zeros((3, 3))
    scale = 1.0 / (normal[0] ** 2 + normal[2] ** 2) ** 0.5
    ways[0, 0], ways[0, 2] = normal[2] * scale, -normal[0] * scale
    ways[1] = np.cross(normal, ways[0])
    ways[2] = normal
    return ways


@kernel
def _solve_positions(rows, pose, mass, compliance):
    """Shift and turn the body until its points have recovered their share of the depth."""
    shift, turned = np.zeros(3), np.zeros(3)
    given = np.zeros(len(rows))
    for _ in range(_ITERATIONS):
        for i in range(len(rows)):
            arm = rows[i, 2:5]
            wanted = _RECOVERY * (-rows[i, 8] - _SLOP)
            normal = rows[i, 5:8]
            turn = compliance @ np.cross(arm, normal)
            softness = 1.0 / mass + (np.cross(turn, arm) * normal).sum()
            got = ((shift + np.cross(turned, arm)) * normal).sum()
            more = max(given[i] + (wanted - got) / softness, 0.0) - given[i]
            given[i] += more
            shift += normal * (more / mass)
            turned += turn * more
    pose[:3] += shift
    half = 0.5 * turned
    x, y, z, w = pose[3:]
    pose[3] += half[0] * w + half[1] * z - half[2] * y
    pose[4] += half[1] * w + half[2] * x - half[0] * z
    pose[5] += half[2] * w + half[0] * y - half[1] * x
    pose[6] -= half[0] * x + half[1] * y + half[2] * z
    pose[3:] /= np.sqrt((pose[3:] ** 2).sum())
