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
Lines of sight among many oriented boxes: which places a straight ray reaches.

Boxes are listed in the cells of a grid, and a ray tests those listed in the cells that it passes
(Amanatides & Woo 1987). A ray inside a wall meets its neighbours in the first cell.
"""

from numba import njit
import numpy as np

from procphys_ros import rotation

_MOST_CELLS = 2_000_000  # more would cost more time to clear than they save
_LEAST_CELL = 0.25       # [m] about a brick


class Sight:
    """
    Boxes that block rays.

    :ivar centres: (N, 3) [m], world.
    :ivar axes: rotation matrices, columns are the boxes' axes, (N, 3, 3).
    :ivar halves: half extents, grown by the seal, (N, 3) [m].
    """

    def __init__(self, poses: np.ndarray, sizes: np.ndarray, seal: float = 0.006,
                 blocking: np.ndarray | None = None):
        """
        List the boxes in a grid.

        :param poses: (N, 7) [m], xyzw, world.
        :param sizes: full extents, (N, 3) [m].
        :param seal: how much every face of a box is moved out [m], to close mortar joints.
        :param blocking: which boxes block rays, (N,) bool; None = all.
        """
        self.centres = np.ascontiguousarray(poses[:, :3], float)
        self.axes = rotation.to_matrix(poses[:, 3:])
        self.halves = 0.5 * np.asarray(sizes, float) + seal
        reach = np.einsum('nij,nj->ni', np.abs(self.axes), self.halves)
        rows = np.arange(len(poses)) if blocking is None else np.flatnonzero(blocking)
        low, high = self.centres - reach, self.centres + reach
        self._low = low[rows].min(axis=0) if len(rows) else np.zeros(3)
        span = (high[rows].max(axis=0) - self._low) if len(rows) else np.zeros(3)
        self._cell = max(_LEAST_CELL, float(np.cbrt(np.prod(np.maximum(span, 1.0))
                                                    / _MOST_CELLS)))
        self._shape = np.floor(span / self._cell).astype(np.int64) + 1
        self._starts, self._lists = _list_boxes(low, high, rows, self._low, self._cell,
                                                self._shape)

    def clear(self, starts: np.ndarray, ends: np.ndarray, owners: np.ndarray) -> np.ndarray:
        """
        Say which rays pass unhindered; boxes that hold the end of a ray do not hinder it.

        :param starts: (K, 3) [m], world.
        :param ends: (K, 3) or (3,) [m], world.
        :param owners: box that a ray starts from and that does not hinder it, or -1, (K,).
        """
        starts = np.ascontiguousarray(starts, float)
        ends = np.ascontiguousarray(np.broadcast_to(ends, starts.shape), float)
        return _trace(starts, ends, np.asarray(owners, np.int64), self.centres, self.axes,
                      self.halves, self._low, self._cell, self._shape, self._starts, self._lists)


@njit(cache=True)
def _list_boxes(low, high, rows, origin, cell, shape):
    """Write, cell by cell, which boxes' bounds overlap it: start of each list, and the lists."""
    starts = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int32)
    bounds = np.empty((len(rows), 6), np.int64)
    for i, row in enumerate(rows):
        for k in range(3):
            bounds[i, k] = int((low[row, k] - origin[k]) / cell)
            bounds[i, 3 + k] = min(int((high[row, k] - origin[k]) / cell), shape[k] - 1)
    for write in range(2):
        if write:
            # Each list is filled from its end, so that its start remains where it ends up.
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


@njit(cache=True, error_model='numpy')
def _hit(start, along, centre, axes, half):
    """Say whether the segment start + s along, s in [0, 1], enters a box that its end is not in."""
    enter, leave = 0.0, 1.0
    holds_end = True
    for k in range(3):
        p = v = 0.0
        for j in range(3):
            p += axes[j, k] * (start[j] - centre[j])
            v += axes[j, k] * along[j]
        holds_end = holds_end and abs(p + v) <= half[k]
        if abs(v) < 1e-12:
            if abs(p) > half[k]:
                return False
            continue
        a, b = (-half[k] - p) / v, (half[k] - p) / v
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
        if enter > leave:
            return False
    return not holds_end


@njit(cache=True, error_model='numpy')
def _clip(start, along, origin, cell, shape):
    """Return the stretch of the ray, as shares of its length, that lies over the grid."""
    enter, leave = 0.0, 1.0
    for k in range(3):
        low, high = origin[k], origin[k] + cell * shape[k]
        if abs(along[k]) < 1e-12:
            if start[k] < low or start[k] > high:
                return 1.0, 0.0
            continue
        a, b = (low - start[k]) / along[k], (high - start[k]) / along[k]
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter, leave


@njit(cache=True, error_model='numpy')
def _passes(start, along, owner, centres, axes, halves, origin, cell, shape, starts, lists):
    """Walk one ray through the grid until a box hinders it."""
    enter, leave = _clip(start, along, origin, cell, shape)
    if enter > leave:
        return True
    at = np.empty(3, np.int64)
    step, border, stride = np.empty(3, np.int64), np.empty(3), np.empty(3)
    for k in range(3):
        place = (start[k] + enter * along[k] - origin[k]) / cell
        at[k] = min(max(int(np.floor(place)), 0), shape[k] - 1)
        step[k] = 1 if along[k] > 0.0 else -1
        ahead = at[k] + (1 if along[k] > 0.0 else 0)
        still = abs(along[k]) < 1e-12
        border[k] = np.inf if still else (origin[k] + cell * ahead - start[k]) / along[k]
        stride[k] = np.inf if still else cell / abs(along[k])
    while True:
        index = (at[0] * shape[1] + at[1]) * shape[2] + at[2]
        for i in range(starts[index], starts[index + 1]):
            row = lists[i]
            if row != owner and _hit(start, along, centres[row], axes[row], halves[row]):
                return False
        k = 0 if border[0] <= border[1] else 1
        if border[2] < border[k]:
            k = 2
        if border[k] > leave:
            return True
        at[k] += step[k]
        if at[k] < 0 or at[k] >= shape[k]:
            return True
        border[k] += stride[k]


@njit(cache=True)
def _trace(begins, ends, owners, centres, axes, halves, origin, cell, shape, starts, lists):
    free = np.empty(len(begins), np.bool_)
    for i in range(len(begins)):
        free[i] = _passes(begins[i], ends[i] - begins[i], owners[i], centres, axes, halves,
                          origin, cell, shape, starts, lists)
    return free
