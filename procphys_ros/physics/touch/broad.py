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


"""Broad phase: overlapping pairs of two sets of axis-aligned boxes."""

import math

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.rotation_kernels import matrix_rows

_BOX = int(Shape.BOX)  # numba does not support enums
_FEW = 64  # largest count for insertion sort
_CELLS = 32  # along each axis at most; a finer grid takes longer to clear
_NARROW = 1.0 / 16.0  # [m] limit of the first class of widths; each is four times as wide ...
_CLASSES = 8          # ... as the previous one; the last one is unlimited


@kernel
def capsule_bounds(rows, poses, sizes, velocities, reach, margin):
    """
    Compute axis-aligned bounds of capsules, swept along their velocities.

    :param rows: rows of the capsules, (K,).
    :param poses: of all, (S, 7); `sizes` (S, 3) and `velocities` (S, 6) likewise.
    :param reach: duration of the sweep [s].
    :param margin: additional margin on all sides [m].
    :returns: three minima, three maxima [m], (K, 6).
    """
    out = np.empty((len(rows), 6))
    for n in range(len(rows)):
        i = rows[n]
        x, y, z, w = poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6]
        half = 0.5 * max(sizes[i, 2] - sizes[i, 0], 0.0)
        axis = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
        for c in range(3):
            room = half * abs(axis[c]) + 0.5 * sizes[i, 0] + margin
            way = velocities[i, c] * reach
            out[n, c] = poses[i, c] - room + min(way, 0.0)
            out[n, 3 + c] = poses[i, c] + room + max(way, 0.0)
    return out


@subroutine
def half_extent(shape, size, row):
    """Return the half extent of a box or capsule along an axis, a row of its matrix [m]."""
    if shape == _BOX:
        return 0.5 * (abs(row[0]) * size[0] + abs(row[1]) * size[1] + abs(row[2]) * size[2])
    return 0.5 * (abs(row[2]) * max(size[2] - size[0], 0.0) + size[0])


@kernel
def piece_bounds(shapes, poses, sizes, velocities, reach, margin):
    """Compute swept bounds of boxes and capsules, (P, 6); all columns have P rows."""
    out = np.empty((len(shapes), 6))
    for p in range(len(shapes)):
        turn = matrix_rows(poses[p, 3:])
        for c in range(3):
            room = half_extent(shapes[p], sizes[p], turn[c])
            way = velocities[p, c] * reach
            out[p, c] = poses[p, c] - room - margin + min(way, 0.0)
            out[p, 3 + c] = poses[p, c] + room + margin + max(way, 0.0)
    return out


def overlaps(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    List the pairs of boxes that overlap, sorted, by means of grids.

    :param first: three minima, three maxima, (A, 6).
    :param second: likewise, (B, 6).
    :returns: rows of the first and of the second, (K,) each.
    """
    if not len(first) or not len(second):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    second = np.ascontiguousarray(second)
    pairs = _search(first, second)
    return pairs[0], pairs[1]


@subroutine
def _in_hull(first, second):
    """List the boxes of the second that overlap the hull of all of the first."""
    hull = first[0].copy()
    for a in range(1, len(first)):
        for c in range(3):
            hull[c] = min(hull[c], first[a, c])
            hull[3 + c] = max(hull[3 + c], first[a, 3 + c])
    found = np.zeros(len(second), np.bool_)
    for b in range(len(second)):
        found[b] = (second[b, 0] <= hull[3] and second[b, 3] >= hull[0]
                    and second[b, 1] <= hull[4] and second[b, 4] >= hull[1]
                    and second[b, 2] <= hull[5] and second[b, 5] >= hull[2])
    return np.flatnonzero(found)


@kernel
def _search(first, second):
    """
    Sort the second boxes into grid cells by their lower corners, and test the first ones there.

    Boxes of each class of widths have their own grid, so that one large box does not widen
    the search for all others.
    """
    near, start = _by_width(second, _in_hull(first, second))
    pairs = np.empty((2, 64), np.int64)
    grids, found = [], 0
    for k in range(_CLASSES):
        if start[k + 1] > start[k]:
            grids.append(_grid(second, near[start[k]:start[k + 1]]))
    for a in range(len(first)):
        begin = found
        for grid in grids:
            low, width, edge, cells, first_in, member, held = grid
            x0, x1 = _span(first[a, 0] - width, first[a, 3], low[0], edge[0], cells[0])
            y0, y1 = _span(first[a, 1] - width, first[a, 4], low[1], edge[1], cells[1])
            z0, z1 = _span(first[a, 2] - width, first[a, 5], low[2], edge[2], cells[2])
            for x in range(x0, x1 + 1):
                for y in range(y0, y1 + 1):
                    row = (x * cells[1] + y) * cells[2]
                    low_k, high_k = first_in[row + z0], first_in[row + max(z1, z0 - 1) + 1]
                    if found + high_k - low_k > pairs.shape[1]:
                        more = np.empty((2, 2 * found + high_k - low_k), np.int64)
                        more[:, :found] = pairs[:, :found]
                        pairs = more
                    found = _test(first, a, held, member, low_k, high_k, pairs, found)
        if found - begin > _FEW:
            pairs[1, begin:found].sort()
        else:
            _sort_few(pairs, begin, found)
    return pairs[:, :found].copy()


@subroutine
def _by_width(boxes, rows):
    """Sort boxes by the class of their largest width; return order and start of each class."""
    number, start = np.empty(len(rows), np.int64), np.zeros(_CLASSES + 1, np.int64)
    for n in range(len(rows)):
        b, k, limit = rows[n], 0, _NARROW
        width = max(boxes[b, 3] - boxes[b, 0], boxes[b, 4] - boxes[b, 1],
                    boxes[b, 5] - boxes[b, 2])
        while width > limit and k < _CLASSES - 1:
            limit, k = 4.0 * limit, k + 1
        number[n] = k
        start[k + 1] += 1
    for k in range(_CLASSES):
        start[k + 1] += start[k]
    out, fill = np.empty(len(rows), np.int64), start[:-1].copy()
    for n in range(len(rows)):
        out[fill[number[n]]] = rows[n]
        fill[number[n]] += 1
    return out, start


@subroutine
def _grid(boxes, rows):
    """
    Sort boxes into the cells of a grid by their lower corners.

    :returns: lowest corner of all, (3,), largest width, edges of a cell, (3,), cells along each
        axis, (3,), start of the members of each cell, z fastest, the members, and their boxes.
    """
    low, high, width = np.full(3, np.inf), np.full(3, -np.inf), 0.0
    for b in rows:
        for c in range(3):
            low[c], high[c] = min(low[c], boxes[b, c]), max(high[c], boxes[b, c])
            width = max(width, boxes[b, 3 + c] - boxes[b, c])
    edge, cells = np.empty(3), np.empty(3, np.int64)
    most = min(len(rows), _CELLS)
    for c in range(3):
        cells[c] = max(min(int((high[c] - low[c]) / max(width, 1e-9)), most), 1)
        edge[c] = max((high[c] - low[c]) / cells[c], 1e-9)
    key, first_in = np.empty(len(rows), np.int64), np.zeros(cells.prod() + 1, np.int64)
    for n in range(len(rows)):
        k = 0
        for c in range(3):
            place = int((boxes[rows[n], c] - low[c]) / edge[c])
            k = k * cells[c] + min(place, cells[c] - 1)
        key[n] = k
        first_in[k + 1] += 1
    for k in range(1, len(first_in)):
        first_in[k] += first_in[k - 1]
    member, fill = np.empty(len(rows), np.int64), first_in[:-1].copy()
    for n in range(len(rows)):
        member[fill[key[n]]] = rows[n]
        fill[key[n]] += 1
    return low, width, edge, cells, first_in, member, boxes[member]


@subroutine(_nrt=False)  # no reference counting, which would take longer than the computation
def _test(first, a, held, member, start, end, pairs, found):
    """Append the boxes of some cells that overlap another; return the number of all pairs."""
    for k in range(start, end):  # without branches, which would be unpredictable
        pairs[0, found], pairs[1, found] = a, member[k]
        found += ((held[k, 0] <= first[a, 3]) & (held[k, 3] >= first[a, 0])
                  & (held[k, 1] <= first[a, 4]) & (held[k, 4] >= first[a, 1])
                  & (held[k, 2] <= first[a, 5]) & (held[k, 5] >= first[a, 2]))
    return found


@subroutine(_nrt=False)
def _sort_few(pairs, begin, end):
    """Sort a range of the second row by insertion."""
    for n in range(begin + 1, end):
        value, k = pairs[1, n], n
        while k > begin and pairs[1, k - 1] > value:
            pairs[1, k] = pairs[1, k - 1]
            k -= 1
        pairs[1, k] = value


@subroutine
def _span(lower, upper, low, edge, cells):
    """Return the first and last cell along an axis for lower corners between two values."""
    first = min(max(int(math.floor((lower - low) / edge)), 0), cells)
    last = min(max(int(math.floor((upper - low) / edge)), -1), cells - 1)
    return min(first, cells - 1), last
