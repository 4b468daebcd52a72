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

"""Merging: fewer, larger boxes for a block of bricks, so that it collides at a fraction."""

from numba import njit
import numpy as np

from procphys_ros import rotation
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
        taken. Toothed ends, if kept, wedge into each other and never come to rest.
    :returns: poses (K, 7) and sizes (K, 3), K ≤ P.
    """
    frame = poses[0].copy()
    inside = relative_rows(frame, poses)
    aligned, extent = aligned_extents(inside, sizes, _ALIGNED)
    centre, extent = inside[aligned, :3], extent[aligned]
    bounds = np.stack([centre - 0.5 * extent, centre + 0.5 * extent], axis=1)
    for axis, slack in ((0, _FLUSH), (1, _FLUSH), (2, tolerance)):
        bounds = _merge_along(bounds, axis, slack)
    _close_joints(bounds)
    centres = frame[:3] + bounds.mean(axis=1) @ rotation.to_matrix(frame[3:]).T
    merged = np.column_stack([centres, np.tile(frame[3:], (len(bounds), 1))])
    return (np.concatenate([merged, poses[~aligned]]),
            np.concatenate([bounds[:, 1] - bounds[:, 0], sizes[~aligned]]))


def _merge_along(bounds: np.ndarray, axis: int, tolerance: float) -> np.ndarray:
    """Join neighbours along one axis whose faces across are flush, (K, 2, 3) -> fewer."""
    across = [a for a in range(3) if a != axis]
    # Sort into lanes of equal faces; lanes are told apart by neighbouring values, not by
    # rounding, so that values at the edge of a rounding cell stay together.
    lanes = [_clusters(bounds[:, side, a], tolerance) for a in across for side in (0, 1)]
    order = np.lexsort([bounds[:, 0, axis], *lanes])
    bounds = bounds[order]
    breaks = np.zeros(len(bounds), bool)
    for lane in lanes:
        breaks[1:] |= np.diff(lane[order]) != 0
    extent = (bounds[:, 1] - bounds[:, 0])[:, across]
    breaks[1:] |= (np.abs(np.diff(extent, axis=0)) > _ALIKE * extent[1:]).any(axis=1)
    gap = bounds[1:, 0, axis] - bounds[:-1, 1, axis]
    breaks[1:] |= (gap > JOINT) | (gap < -JOINT)
    breaks[0] = True
    start = np.flatnonzero(breaks)
    count = np.diff(np.append(start, len(bounds)))
    merged = np.add.reduceat(bounds, start, axis=0) / count[:, None, None]
    merged[:, 0, axis] = np.minimum.reduceat(bounds[:, 0, axis], start)
    merged[:, 1, axis] = np.maximum.reduceat(bounds[:, 1, axis], start)
    return merged


def _close_joints(bounds: np.ndarray) -> None:
    """
    Stretch boxes over the joints to their neighbours, (K, 2, 3), in place.

    The edge of another body that gets into an open joint would never come out again.
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


@njit(cache=True)
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
