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


"""Broad phase: which of many boxes overlap which of many others."""

import math

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.rotation_kernels import matrix_rows

_BOX = int(Shape.BOX)  # numba reads no enums
_FEW = 64  # numbers that are sorted one by one
_CELLS = 64  # along x and along y at most; a finer grid takes longer to clear


@kernel
def capsule_bounds(rows, poses, sizes, velocities, reach, margin):
    """
    Give axis-aligned bounds of capsules, swept along their velocities.

    :param rows: chosen, (K,).
    :param poses: of all, (S, 7); `sizes` (S, 3) and `velocities` (S, 6) likewise.
    :param reach: time that they are swept over [s].
    :param margin: further room on all sides [m].
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
    """Give half of what a box or capsule extends over along an axis, a row of its matrix [m]."""
    if shape == _BOX:
        return 0.5 * (abs(row[0]) * size[0] + abs(row[1]) * size[1] + abs(row[2]) * size[2])
    return 0.5 * (abs(row[2]) * max(size[2] - size[0], 0.0) + size[0])


@kernel
def piece_bounds(shapes, poses, sizes, velocities, reach, margin):
    """Give the same for boxes and capsules, (P, 6); all columns have P rows."""
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
    List the pairs of boxes that overlap, sorted, by looking into the cells of a grid.

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
    """Sort boxes into cells by their lower corners, and test each of the others in its cells."""
    near = _in_hull(first, second)
    pairs = np.empty((2, 64), np.int64)
    found = 0
    if not len(near):
        return pairs[:, :0].copy()
    low, high, width = np.full(2, np.inf), np.full(2, -np.inf), np.zeros(2)
    for b in near:
        for c in range(2):
            low[c] = min(low[c], second[b, c])
            high[c] = max(high[c], second[b, c])
            width[c] = max(width[c], second[b, 3 + c] - second[b, c])
    cells = min(int(math.sqrt(len(near))) + 1, _CELLS)
    edge = np.maximum((high - low) / cells, 1e-9)
    first_in, member = _sorted_into_cells(second, near, low, edge, cells)
    held = second[member]  # side by side, as they are gone through
    for a in range(len(first)):
        x0, x1 = _span(first[a, 0] - width[0], first[a, 3], low[0], edge[0], cells)
        y0, y1 = _span(first[a, 1] - width[1], first[a, 4], low[1], edge[1], cells)
        begin = found
        for x in range(x0, x1 + 1):
            start, end = first_in[x * cells + y0], first_in[x * cells + y1 + 1]
            if found + end - start > pairs.shape[1]:
                more = np.empty((2, 2 * found + end - start), np.int64)
                more[:, :found] = pairs[:, :found]
                pairs = more
            found = _test(first, a, held, member, start, end, pairs, found)
        if found - begin > _FEW:
            pairs[1, begin:found].sort()
        else:
            _sort_few(pairs, begin, found)
    return pairs[:, :found].copy()


@subroutine(_nrt=False)  # arrays are not counted, which takes longer than what is done to them
def _test(first, a, held, member, start, end, pairs, found):
    """Append the boxes of some cells that overlap another, and give the number of all pairs."""
    for k in range(start, end):  # no branches, which no processor could foresee
        pairs[0, found], pairs[1, found] = a, member[k]
        found += ((held[k, 0] <= first[a, 3]) & (held[k, 3] >= first[a, 0])
                  & (held[k, 1] <= first[a, 4]) & (held[k, 4] >= first[a, 1])
                  & (held[k, 2] <= first[a, 5]) & (held[k, 5] >= first[a, 2]))
    return found


@subroutine(_nrt=False)
def _sort_few(pairs, begin, end):
    """Sort numbers of the second row one by one."""
    for n in range(begin + 1, end):
        value, k = pairs[1, n], n
        while k > begin and pairs[1, k - 1] > value:
            pairs[1, k] = pairs[1, k - 1]
            k -= 1
        pairs[1, k] = value


@subroutine
def _span(lower, upper, low, edge, cells):
    """Give the first and last cell along an axis that hold what begins between two values."""
    first = min(max(int(math.floor((lower - low) / edge)), 0), cells)
    last = min(max(int(math.floor((upper - low) / edge)), -1), cells - 1)
    return min(first, cells - 1), last


@subroutine
def _sorted_into_cells(second, near, low, edge, cells):
    """Give where the members of each cell begin, row of cells by row, and the members."""
    key = np.empty(len(near), np.int64)
    start = np.zeros(cells * cells + 1, np.int64)
    for n in range(len(near)):
        x = min(int((second[near[n], 0] - low[0]) / edge[0]), cells - 1)
        y = min(int((second[near[n], 1] - low[1]) / edge[1]), cells - 1)
        key[n] = x * cells + y
        start[key[n] + 1] += 1
    for k in range(1, len(start)):
        start[k] += start[k - 1]
    member, fill = np.empty(len(near), np.int64), start[:-1].copy()
    for n in range(len(near)):
        member[fill[key[n]]] = near[n]
        fill[key[n]] += 1
    return start, member
