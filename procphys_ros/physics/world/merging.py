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

"""Merge the bricks of a fragment into fewer, larger boxes, which collide much faster."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.rotation_kernels import matrix, matrix_rows
from procphys_ros.physics.world.assembly import aligned_extents, relative_rows

JOINT = 0.015  # [m], widest gap (a mortar joint, with tolerance) that a merged box bridges
LEVEL = 0.03   # [m], largest offset of flush ends of courses; larger ones are toothing
_FLUSH = 2e-3  # [m], largest offset of flush faces
_ALIKE = 0.3  # largest relative difference of the transverse extents of boxes that are merged
_OUT = 0.01  # [m], least protrusion of a corner from merged boxes that counts
_ALIGNED = 1e-3  # largest deviation of a rotation matrix from a quarter turn


def merge_boxes(poses: np.ndarray, sizes: np.ndarray, tolerance: float = LEVEL
                ) -> tuple[np.ndarray, np.ndarray]:
    """
    Merge boxes that lie end to end into larger ones.

    First along x and y of the first box (courses), where faces are flush; then courses on top of
    each other, where their ends are about flush.
    Boxes that are rotated against the first by other than quarter turns are left unchanged.

    :param poses: (P, 7).
    :param sizes: full extents [m], (P, 3).
    :param tolerance: largest offset of the ends of stacked courses [m]; the mean is
        taken. The toothing of a bond is kept: level ends would make bricks of two pieces overlap.
    :returns: poses (K, 7) and sizes (K, 3), K ≤ P.
    """
    return _merge(np.ascontiguousarray(poses, float), np.ascontiguousarray(sizes, float),
                  tolerance)


@kernel
def _merge(poses, sizes, tolerance):
    frame = poses[0].copy()
    inside = relative_rows(frame, poses)
    aligned, extent = aligned_extents(inside, sizes, _ALIGNED)
    rows, others = np.flatnonzero(aligned), np.flatnonzero(~aligned)
    bounds = np.empty((len(rows), 2, 3))
    for k in range(len(rows)):
        for c in range(3):
            bounds[k, 0, c] = inside[rows[k], c] - 0.5 * extent[rows[k], c]
            bounds[k, 1, c] = inside[rows[k], c] + 0.5 * extent[rows[k], c]
    bounds = _merge_along(_merge_along(bounds, 0), 1)
    bounds = _stack(bounds[np.argsort(bounds[:, 0, 2], kind='mergesort')], tolerance)
    _close_joints(bounds)
    axes = matrix_rows(frame[3:])
    merged, extents = np.empty((len(bounds), 7)), np.empty((len(bounds), 3))
    for k in range(len(bounds)):
        middle = 0.5 * (bounds[k, 0] + bounds[k, 1])
        for c in range(3):
            merged[k, c] = (frame[c] + middle[0] * axes[c][0] + middle[1] * axes[c][1]
                            + middle[2] * axes[c][2])
        merged[k, 3:] = frame[3:]
        extents[k] = bounds[k, 1] - bounds[k, 0]
    return np.concatenate((merged, poses[others])), np.concatenate((extents, sizes[others]))


@subroutine
def _merge_along(bounds, axis):
    """Merge neighbours along one axis whose transverse faces are flush, (K, 2, 3) -> fewer."""
    lane = _lanes(bounds, axis)
    order = np.argsort(bounds[:, 0, axis], kind='mergesort')
    order = order[np.argsort(lane[order], kind='mergesort')]
    merged = np.empty_like(bounds)
    found = count = 0
    for n in range(len(order)):
        box = bounds[order[n]]
        if n > 0:
            before = bounds[order[n - 1]]
            gap = box[0, axis] - before[1, axis]
            if lane[order[n]] == lane[order[n - 1]] and -JOINT <= gap <= JOINT:
                last = merged[found - 1]
                low, high = min(last[0, axis], box[0, axis]), max(last[1, axis], box[1, axis])
                last += (box - last) / (count + 1)
                last[0, axis], last[1, axis] = low, high
                count += 1
                continue
        merged[found] = box
        found += 1
        count = 1
    return merged[:found].copy()


@subroutine
def _lanes(bounds, axis):
    """
    Label the lane of each box: boxes with the same four transverse faces, (K,).

    Faces are clustered by neighbouring values, not by rounding, so that values at the edge of a
    rounding cell stay together.
    """
    lane = np.zeros(len(bounds), np.int64)
    for across in range(2, -1, -1):
        if across != axis:
            for side in (1, 0):
                lane = lane * len(bounds) + _clusters(bounds[:, side, across], _FLUSH)
    return lane


@subroutine
def _stack(bounds, tolerance):
    """
    Merge courses, sorted from below, that lie on each other with about the same outline.

    Each course is compared with the lowest of its stack; the faces are averaged.
    """
    count = np.zeros(len(bounds))
    lowest = np.empty_like(bounds)
    stacked = np.zeros_like(bounds)
    stacks = 0
    for i in range(len(bounds)):
        box = bounds[i]
        found = stacks
        for s in range(stacks):
            fits = abs(box[0, 2] - stacked[s, 1, 2]) < JOINT
            for axis in range(2):
                extent = lowest[s, 1, axis] - lowest[s, 0, axis]
                other = box[1, axis] - box[0, axis]
                thin = min(extent, other) < 2.0 * tolerance
                fits &= not thin or abs(other - extent) < _ALIKE * max(other, extent)
                for side in range(2):
                    fits &= abs(box[side, axis] - lowest[s, side, axis]) < tolerance
            if fits:
                found = s
                break
        if found == stacks:
            stacks += 1
            lowest[found] = box
            stacked[found] = box
            count[found] = 1.0
            continue
        count[found] += 1.0
        stacked[found, :, :2] += (box[:, :2] - stacked[found, :, :2]) / count[found]
        stacked[found, 1, 2] = box[1, 2]
    return stacked[:stacks].copy()


@subroutine
def _close_joints(bounds):
    """
    Stretch boxes over the joints to their neighbours, (K, 2, 3), in place.

    Otherwise the edge of another body could be caught in an open joint.
    """
    reach = np.empty(len(bounds))
    for axis in range(3):
        for k in range(len(bounds)):
            reach[k] = np.inf
            for other in range(len(bounds)):
                gap = bounds[other, 0, axis] - bounds[k, 1, axis]
                if 0.0 < gap < min(JOINT, reach[k]) and _face(bounds[k], bounds[other], axis):
                    reach[k] = gap
        for k in range(len(bounds)):
            if reach[k] < np.inf:
                bounds[k, 1, axis] += reach[k]


@subroutine
def _face(box, other, axis):
    """Return whether the projections of two boxes along an axis overlap."""
    for across in range(3):
        if across != axis and not (box[1, across] > other[0, across] + _FLUSH
                                   and box[0, across] < other[1, across] - _FLUSH):
            return False
    return True


@subroutine
def _clusters(values, tolerance):
    """Label groups of values that lie within the tolerance of the least value of their group."""
    order = np.argsort(values, kind='mergesort')  # as in `_merge_along`
    label = np.empty(len(values), np.int64)
    current, least = -1, -np.inf
    for i in order:
        if values[i] - least > tolerance:
            current, least = current + 1, values[i]
        label[i] = current
    return label


def corners_outside(poses: np.ndarray, sizes: np.ndarray, merged_poses: np.ndarray,
                    merged_sizes: np.ndarray) -> np.ndarray:
    """
    List the corners of boxes that lie outside the merged boxes.

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


@subroutine
def _diagonal(size):
    """Return half of the diagonal of a box [m]."""
    return 0.5 * np.sqrt(size[0] ** 2 + size[1] ** 2 + size[2] ** 2)


@subroutine
def _is_inside(point, near, many, poses, sizes, axes):
    """Return whether a point is in one of the boxes; move that box to the front of the list."""
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
