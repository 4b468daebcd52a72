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

from procphys_ros import rotation
from procphys_ros.compilation import kernel
from procphys_ros.physics.world.assembly import aligned_extents, relative_rows

JOINT = 0.015  # [m], widest gap (a mortar joint, with tolerance) that a merged box bridges
TOOTHING = 0.12  # [m], half a brick and a joint: how far courses of a bond stick out
_FLUSH = 2e-3  # [m], faces less apart are one
_ALIKE = 0.3  # largest difference of the extents across of boxes that are joined
_ALIGNED = 1e-3  # largest deviation of a rotation matrix from a quarter turn


def merge_boxes(poses: np.ndarray, sizes: np.ndarray, tolerance: float = TOOTHING
                ) -> tuple[np.ndarray, np.ndarray]:
    """
    Join boxes that lie end to end into larger ones.

    First along x and y of the first box (courses), where faces are flush; then courses on top of
    each other, where their ends are about flush.
    Boxes that are turned against the first by other than quarter turns are kept as they are.

    :param poses: (P, 7).
    :param sizes: full extents [m], (P, 3).
    :param tolerance: how far the ends of courses that are stacked may be apart [m]; the mean is
        taken. Toothed ends, if kept, interlock and never come to rest.
    :returns: poses (K, 7) and sizes (K, 3), K ≤ P.
    """
    frame = poses[0].copy()
    inside = relative_rows(frame, poses)
    aligned, extent = aligned_extents(inside, sizes, _ALIGNED)
    centre, extent = inside[aligned, :3], extent[aligned]
    bounds = np.stack([centre - 0.5 * extent, centre + 0.5 * extent], axis=1)
    for axis in (0, 1):
        bounds = _merge_along(bounds, axis)
    bounds = _stack(bounds[np.argsort(bounds[:, 0, 2], kind='stable')], tolerance)
    _close_joints(bounds)
    centres = frame[:3] + bounds.mean(axis=1) @ rotation.to_matrix(frame[3:]).T
    merged = np.column_stack([centres, np.tile(frame[3:], (len(bounds), 1))])
    return (np.concatenate([merged, poses[~aligned]]),
            np.concatenate([bounds[:, 1] - bounds[:, 0], sizes[~aligned]]))


def _merge_along(bounds: np.ndarray, axis: int) -> np.ndarray:
    """Join neighbours along one axis whose faces across are flush, (K, 2, 3) -> fewer."""
    across = [a for a in range(3) if a != axis]
    # Sort into lanes of equal faces; lanes are told apart by neighbouring values, not by
    # rounding, so that values at the edge of a rounding cell stay together.
    lanes = [_clusters(bounds[:, side, a], _FLUSH) for a in across for side in (0, 1)]
    order = np.lexsort([bounds[:, 0, axis], *lanes])
    bounds = bounds[order]
    breaks = np.zeros(len(bounds), bool)
    for lane in lanes:
        breaks[1:] |= np.diff(lane[order]) != 0
    gap = bounds[1:, 0, axis] - bounds[:-1, 1, axis]
    breaks[1:] |= (gap > JOINT) | (gap < -JOINT)
    breaks[0] = True
    start = np.flatnonzero(breaks)
    count = np.diff(np.append(start, len(bounds)))
    merged = np.add.reduceat(bounds, start, axis=0) / count[:, None, None]
    merged[:, 0, axis] = np.minimum.reduceat(bounds[:, 0, axis], start)
    merged[:, 1, axis] = np.maximum.reduceat(bounds[:, 1, axis], start)
    return merged


@kernel
def _stack(bounds, tolerance):
    """
    Join courses, sorted from below, that lie on each other with about the same outline.

    Each course is compared with the lowest of its stack; mean faces are taken.
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


def _close_joints(bounds: np.ndarray) -> None:
    """
    Stretch boxes over the joints to their neighbours, (K, 2, 3), in place.

    The edge of another body that gets into an open joint would be caught there.
    """
    for axis in range(3):
        low, high = bounds[:, 0], bounds[:, 1]
        facing = np.ones((len(bounds), len(bounds)), bool)
        for across in range(3):
            if across != axis:
                facing &= (high[:, None, across] > low[None, :, across] + _FLUSH)
                facing &= (low[:, None, across] < high[None, :, across] - _FLUSH)
        gap = low[None, :, axis] - high[:, None, axis]
        facing &= (gap > 0.0) & (gap < JOINT)
        reach = np.where(facing, gap, np.inf).min(axis=1, initial=np.inf)
        high[:, axis] += np.where(np.isfinite(reach), reach, 0.0)


@kernel
def _clusters(values, tolerance):
    """Label the groups of values that lie within the tolerance of their group's least."""
    order = np.argsort(values)
    label = np.empty(len(values), np.int64)
    current, least = -1, -np.inf
    for i in order:
        if values[i] - least > tolerance:
            current, least = current + 1, values[i]
        label[i] = current
    return label
