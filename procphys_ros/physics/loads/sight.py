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
Lines of sight among many oriented boxes, by ray casting.

Boxes are listed in the cells of a grid, and a ray tests those listed in the cells that it passes
(Amanatides & Woo 1987). A ray inside a wall hits its neighbours in the first cell.
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import cbrt
from procphys_ros.geometry import rotation

_MOST_CELLS = 2_000_000  # more would cost more time to clear than they save
_LEAST_CELL = 0.25       # [m] about the size of a brick
OFF_FACE = 1e-4          # [m] offset of the start of rays from the face that they leave
SEAL = 0.011             # [m] offset of the faces of boxes: more than the width of a mortar joint


class Sight:
    """Boxes that block rays."""

    def __init__(self, poses: np.ndarray, sizes: np.ndarray, seal: float = SEAL,
                 blocking: np.ndarray | None = None):
        """
        List the boxes in a grid.

        :param poses: (N, 7) [m], xyzw, world.
        :param sizes: full extents, (N, 3) [m].
        :param seal: outward offset of every face of a box [m]: more than the width of a mortar
            joint, so that no ray escapes through one.
        :param blocking: boxes that block rays, (N,) bool; None = all.
        """
        matrices = rotation.to_matrix(poses[:, 3:])
        halves = 0.5 * np.asarray(sizes, float) + seal
        reach = np.einsum('nij,nj->ni', np.abs(matrices), halves)
        # One row per box: centre, rotation matrix, half extents.
        self._boxes = np.hstack([poses[:, :3], matrices.reshape(-1, 9), halves])
        low, high = poses[:, :3] - reach, poses[:, :3] + reach
        self._blocking = (np.ones(len(poses), bool) if blocking is None
                          else np.asarray(blocking, bool))
        rows = np.flatnonzero(self._blocking)
        origin = low[rows].min(axis=0) if len(rows) else np.zeros(3)
        span = high[rows].max(axis=0) - origin if len(rows) else np.zeros(3)
        cell = max(_LEAST_CELL, float(cbrt(np.prod(np.maximum(span, 1.0)) / _MOST_CELLS)))
        shape = np.floor(span / cell).astype(np.int64) + 1
        self._grid = (origin, cell, shape, *_list_boxes(low, high, rows, origin, cell, shape))

    def clear(self, starts: np.ndarray, ends: np.ndarray, owners: np.ndarray) -> np.ndarray:
        """
        Mark the rays that are not blocked; boxes around the end of a ray do not block it.

        :param starts: (K, 3) [m], world.
        :param ends: (K, 3) or (3,) [m], world.
        :param owners: box that a ray starts from and that does not block it, or -1, (K,).
        """
        starts = np.ascontiguousarray(starts, float)
        ends = np.ascontiguousarray(np.broadcast_to(ends, starts.shape), float)
        return _trace(starts, ends, np.asarray(owners, np.int64), self._boxes,
                      self._blocking, self._grid)

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Mark the points that lie in a blocking box, (K,) bool; points (K, 3), world."""
        return _hold(np.ascontiguousarray(points, float), self._boxes, self._grid)


@kernel(error_model='numpy')
def _hold(points, boxes, grid):
    """Mark the points that lie in a box."""
    origin, cell, shape, starts, lists = grid
    held = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        x = int(np.floor((points[i, 0] - origin[0]) / cell))
        y = int(np.floor((points[i, 1] - origin[1]) / cell))
        z = int(np.floor((points[i, 2] - origin[2]) / cell))
        if min(x, y, z) < 0 or x >= shape[0] or y >= shape[1] or z >= shape[2]:
            continue
        at = (x * shape[1] + y) * shape[2] + z
        for n in range(starts[at], starts[at + 1]):
            box, inside = boxes[lists[n]], True
            for k in range(3):
                p = (box[3 + k] * (points[i, 0] - box[0]) + box[6 + k] * (points[i, 1] - box[1])
                     + box[9 + k] * (points[i, 2] - box[2]))
                inside = inside and abs(p) <= box[12 + k]
            held[i] = held[i] or inside
    return held


@kernel
def _list_boxes(low, high, rows, origin, cell, shape):
    """List the boxes whose bounds overlap each cell: start of each list, and the lists."""
    starts = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int32)
    bounds = np.empty((len(rows), 6), np.int64)
    for i, row in enumerate(rows):
        for k in range(3):
            bounds[i, k] = int((low[row, k] - origin[k]) / cell)
            bounds[i, 3 + k] = min(int((high[row, k] - origin[k]) / cell), shape[k] - 1)
    for write in range(2):
        if write:
            # Each list is filled from its end, so that `starts` finally holds its start.
            starts = np.cumsum(starts).astype(np.int32)
            lists = np.empty(starts[-1], np.int32)
        for i, row in enumerate(rows):
            for x in range(bounds[i, 0], bounds[i, 3] + 1):
                for y in range(bounds[i, 1], bounds[i, 4] + 1):
                    for z in range(bounds[i, 2], bounds[i, 5] + 1):
                        at = (x * shape[1] + y) * shape[2] + z
                        if write:
                            starts[at] -= 1
                            lists[starts[at]] = row
                        else:
                            starts[at] += 1
    return starts, lists


@subroutine(error_model='numpy')
def _hit(start, along, boxes, row):
    """Return whether the segment from start to start + along enters a box and ends outside it."""
    x, y, z = start[0] - boxes[row, 0], start[1] - boxes[row, 1], start[2] - boxes[row, 2]
    enter, leave = 0.0, 1.0
    holds_end = True
    for k in range(3):
        half = boxes[row, 12 + k]
        p = boxes[row, 3 + k] * x + boxes[row, 6 + k] * y + boxes[row, 9 + k] * z
        v = (boxes[row, 3 + k] * along[0] + boxes[row, 6 + k] * along[1]
             + boxes[row, 9 + k] * along[2])
        holds_end = holds_end and abs(p + v) <= half
        if abs(v) < 1e-12:
            if abs(p) > half:
                return False
            continue
        inverse = 1.0 / v
        middle, reach = -p * inverse, half * abs(inverse)
        enter, leave = max(enter, middle - reach), min(leave, middle + reach)
        if enter > leave:
            return False
    return not holds_end


@subroutine(error_model='numpy')
def _enter(start, along, origin, cell, shape, walk):
    """
    Initialise the walk of a ray at the first grid cell that it enters.

    :param walk: (4, 3), written: cell, step, ray parameter at the next border, between borders.
    :returns: ray parameter at which it leaves the grid, -1 when it misses the grid.
    """
    enter, leave = 0.0, 1.0
    for k in range(3):
        low, high = origin[k] - start[k], origin[k] + cell * shape[k] - start[k]
        if abs(along[k]) < 1e-12:
            if low > 0.0 or high < 0.0:
                return -1.0
            continue
        a, b = low / along[k], high / along[k]
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    if enter > leave:
        return -1.0
    for k in range(3):
        place = np.floor((start[k] + enter * along[k] - origin[k]) / cell)
        walk[0, k] = min(max(place, 0.0), shape[k] - 1.0)
        walk[1, k] = 1.0 if along[k] > 0.0 else -1.0
        ahead = origin[k] + cell * (walk[0, k] + max(walk[1, k], 0.0)) - start[k]
        still = abs(along[k]) < 1e-12
        walk[2, k] = np.inf if still else ahead / along[k]
        walk[3, k] = np.inf if still else cell / abs(along[k])
    return leave


@subroutine(error_model='numpy')
def _hinder(start, along, owner, boxes, grid, walk):
    """Walk one ray through the grid; return the first box found to block it, or -1."""
    origin, cell, shape, starts, lists = grid
    leave = _enter(start, along, origin, cell, shape, walk)
    if leave < 0.0:
        return -1
    strides = (shape[1] * shape[2], shape[2], 1)
    index = int(walk[0, 0]) * strides[0] + int(walk[0, 1]) * strides[1] + int(walk[0, 2])
    while True:
        for i in range(starts[index], starts[index + 1]):
            row = lists[i]
            if row != owner and _hit(start, along, boxes, row):
                return row
        k = 0 if walk[2, 0] <= walk[2, 1] else 1
        if walk[2, 2] < walk[2, k]:
            k = 2
        walk[0, k] += walk[1, k]
        if walk[2, k] > leave or walk[0, k] < 0.0 or walk[0, k] >= shape[k]:
            return -1
        index += strides[k] if walk[1, k] > 0.0 else -strides[k]
        walk[2, k] += walk[3, k]


@kernel
def _trace(begins, ends, owners, boxes, blocking, grid):
    """
    Mark the rays that are not blocked.

    Rays of adjacent boxes in a wall are blocked by adjacent boxes: the box at the same offset of
    rows from the owner as for the previous ray is tested first, which saves most walks.
    """
    free = np.empty(len(begins), np.bool_)
    walk, along = np.empty((4, 3)), np.empty(3)
    ahead = 0
    for i in range(len(begins)):
        for k in range(3):
            along[k] = ends[i, k] - begins[i, k]
        guess = owners[i] + ahead
        if (ahead != 0 and 0 <= guess < len(boxes) and blocking[guess]
                and _hit(begins[i], along, boxes, guess)):
            free[i] = False
            continue
        row = _hinder(begins[i], along, owners[i], boxes, grid, walk)
        free[i] = row < 0
        if row >= 0:
            ahead = row - owners[i]
    return free
