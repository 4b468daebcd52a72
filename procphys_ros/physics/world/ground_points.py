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
from procphys_ros.linear_kernels import product, transformed
from procphys_ros.physics.terrain import height_at, normal_at
from procphys_ros.rotation_kernels import matrix, matrix_rows

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
    point = np.empty(3)
    count = 0
    for p in range(len(poses)):
        own = matrix_rows(poses[p, 3:])
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
            x = sizes[p, 0] * (0.5 - (corner & 1))
            y = sizes[p, 1] * (0.5 - ((corner >> 1) & 1))
            z = sizes[p, 2] * (0.5 - ((corner >> 2) & 1))
            for c in range(3):
                point[c] = poses[p, c] + own[c][0] * x + own[c][1] * y + own[c][2] * z
            if not _is_inside(point, near, many, merged_poses, merged_sizes, axes):
                found[count] = point
                count += 1
    return count


@kernel
def _diagonal(size):
    """Give half of the diagonal of a box [m]."""
    return 0.5 * np.sqrt(size[0] ** 2 + size[1] ** 2 + size[2] ** 2)


@kernel
def _is_inside(point, near, many, poses, sizes, axes):
    """Return whether a point is in one of the boxes; that box is tried first from now on."""
    for n in range(many):
        k = near[n]
        inside = True
        for c in range(3):
            arm = 0.0
            for d in range(3):
                arm += (point[d] - poses[k, d]) * axes[k, d, c]
            if abs(arm) >= 0.5 * sizes[k, c] + _OUT:
                inside = False
                break
        if inside:
            near[n], near[0] = near[0], k
            return True
    return False


@kernel
def resolve_ground_contacts(first, number, points, poses, velocities, mass, inertia, friction,
                            time_step, terrain):
    """
    Stop the points that penetrate the ground, and move them out of it.

    Perfectly plastic impulses with Coulomb friction at all points of a body in the ground
    together, by projected Gauss-Seidel; then the same in displacements for the depth that is left.

    :param first: row of the first point of each body, (B,) int.
    :param number: of points of each body, (B,) int.
    :param points: in the bodies' frames [m], (Q, 3).
    :param poses: (B, 7), changed in place.
    :param velocities: world axes, (B, 6), changed in place.
    :param mass: [kg], (B,).
    :param inertia: principal moments [kg·m²], (B, 3).
    :param friction: coefficient of each body on the ground, (B,).
    :param time_step: [s].
    :param terrain: the surface of the ground.
    :returns: contacts as of `Engine.contacts`, with the row of the body for its id, (C, 13).
    """
    table = np.zeros((number.sum(), _COLUMNS))
    level = len(terrain.heights) == 0
    count = 0
    for b in range(len(poses)):
        axes = matrix_rows(poses[b, 3:])
        begin = count
        for t in range(first[b], first[b] + number[b]):
            x, y, z = points[t, 0], points[t, 1], points[t, 2]
            up = axes[2][0] * x + axes[2][1] * y + axes[2][2] * z
            if level and poses[b, 2] + up >= 0.0:
                continue
            along = axes[0][0] * x + axes[0][1] * y + axes[0][2] * z
            across = axes[1][0] * x + axes[1][1] * y + axes[1][2] * z
            x, y = poses[b, 0] + along, poses[b, 1] + across
            height = poses[b, 2] + up - height_at(terrain, x, y)
            if height < 0.0:
                normal = normal_at(terrain, x, y)
                table[count, 0] = b
                table[count, 2], table[count, 3], table[count, 4] = along, across, up
                table[count, 5], table[count, 6], table[count, 7] = normal
                table[count, 8] = height * normal[2]
                count += 1
        if count > begin:
            turn = matrix(poses[b, 3:])
            compliance = product(turn / inertia[b], turn.T)
            rows, where = table[begin:count], poses[b, :3].copy()
            effects = _effects(rows, mass[b], compliance)
            _solve_velocities(rows, effects, velocities[b], mass[b], friction[b])
            _solve_positions(rows, effects[:, 2], poses[b], mass[b])
            rows[:, 2:5] += where
            rows[:, 9:] /= time_step
    return table[:count]


@kernel
def _effects(rows, mass, compliance):
    """
    Compute the effect of unit impulses at points: along the ground, two ways, and upwards.

    :returns: for each way its direction, the spin that it gives, its moment, and the change of
        speed at the point, (C, 3, 10).
    """
    out = np.empty((len(rows), 3, 10))
    for i in range(len(rows)):
        arm, ways = rows[i, 2:5], _ways(rows[i, 5:8])
        for axis in range(3):
            push = ways[axis]
            moment = np.cross(arm, push)
            turn = transformed(compliance, moment)
            out[i, axis, :3], out[i, axis, 3:6], out[i, axis, 6:9] = push, turn, moment
            out[i, axis, 9] = 1.0 / mass + (turn * moment).sum()
    return out


@kernel
def _speed(motion, effect):
    """Give the speed that a motion, (6,), has at a point along its direction [m/s]."""
    return (motion[0] * effect[0] + motion[1] * effect[1] + motion[2] * effect[2]
            + motion[3] * effect[6] + motion[4] * effect[7] + motion[5] * effect[8])


@kernel
def _add(motion, effect, mass, impulse):
    """Add to a motion, (6,), what an impulse does."""
    for c in range(3):
        motion[c] += effect[c] * impulse / mass
        motion[3 + c] += effect[3 + c] * impulse


@kernel
def _solve_velocities(rows, effects, velocity, mass, friction):
    """Bring the points to rest; impulses go to columns 9 to 12."""
    for _ in range(_ITERATIONS):
        for i in range(len(rows)):
            for axis in (2, 0, 1):
                effect = effects[i, axis]
                before = rows[i, 9 + axis]
                most = friction * rows[i, 11]
                after = before - _speed(velocity, effect) / effect[9]
                after = max(after, 0.0) if axis == 2 else min(max(after, -most), most)
                rows[i, 9 + axis] = after
                _add(velocity, effect, mass, after - before)
    for i in range(len(rows)):
        rows[i, 12] = rows[i, 11]
        along, across, up = rows[i, 9], rows[i, 10], rows[i, 11]
        for c in range(3):
            rows[i, 9 + c] = (along * effects[i, 0, c] + across * effects[i, 1, c]
                              + up * effects[i, 2, c])


@kernel
def _ways(normal):
    """Give two directions along the ground and its normal, (3, 3); of level ground x, y and z."""
    ways = np.zeros((3, 3))
    scale = 1.0 / np.sqrt(normal[0] ** 2 + normal[2] ** 2)
    ways[0, 0], ways[0, 2] = normal[2] * scale, -normal[0] * scale
    ways[1] = np.cross(normal, ways[0])
    ways[2] = normal
    return ways


@kernel
def _solve_positions(rows, effects, pose, mass):
    """Shift and turn the body until its points have recovered their share of the depth."""
    moved, given = np.zeros(6), np.zeros(len(rows))
    for _ in range(_ITERATIONS):
        for i in range(len(rows)):
            wanted = _RECOVERY * (-rows[i, 8] - _SLOP)
            got = _speed(moved, effects[i])
            more = max(given[i] + (wanted - got) / effects[i, 9], 0.0) - given[i]
            given[i] += more
            _add(moved, effects[i], mass, more)
    pose[:3] += moved[:3]
    half = 0.5 * moved[3:]
    x, y, z, w = pose[3:]
    pose[3] += half[0] * w + half[1] * z - half[2] * y
    pose[4] += half[1] * w + half[2] * x - half[0] * z
    pose[5] += half[2] * w + half[0] * y - half[1] * x
    pose[6] -= half[0] * x + half[1] * y + half[2] * z
    pose[3:] /= np.sqrt((pose[3:] ** 2).sum())
