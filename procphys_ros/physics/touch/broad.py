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

from numba import njit
import numpy as np

from procphys_ros.blueprint import Shape

_BOX = int(Shape.BOX)  # numba reads no enums


@njit(cache=True)
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


@njit(cache=True)
def piece_bounds(shapes, poses, sizes, velocities, reach, margin):
    """Give the same for boxes and capsules, (P, 6); all columns have P rows."""
    out = np.empty((len(shapes), 6))
    for p in range(len(shapes)):
        x, y, z, w = poses[p, 3], poses[p, 4], poses[p, 5], poses[p, 6]
        turn = ((1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
                (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
                (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)))
        for c in range(3):
            if shapes[p] == _BOX:
                room = 0.5 * (abs(turn[c][0]) * sizes[p, 0] + abs(turn[c][1]) * sizes[p, 1]
                              + abs(turn[c][2]) * sizes[p, 2])
            else:
                room = 0.5 * (abs(turn[c][2]) * max(sizes[p, 2] - sizes[p, 0], 0.0)
                              + sizes[p, 0])
            way = velocities[p, c] * reach
            out[p, c] = poses[p, c] - room - margin + min(way, 0.0)
            out[p, 3 + c] = poses[p, c] + room + margin + max(way, 0.0)
    return out


def overlaps(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    List the pairs of boxes that overlap, sorted, by sweeping along x.

    :param first: three minima, three maxima, (A, 6).
    :param second: likewise, (B, 6).
    :returns: rows of the first and of the second, (K,) each.
    """
    if not len(first) or not len(second):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    low, high = first[:, :3].min(axis=0), first[:, 3:].max(axis=0)
    near = np.flatnonzero((second[:, :3] <= high).all(axis=1) & (second[:, 3:] >= low).all(axis=1))
    near = near[np.argsort(second[near, 0], kind='stable')]
    pairs = _sweep(first, second[near])
    a, b = pairs[:, 0], near[pairs[:, 1]]
    order = np.lexsort((b, a))
    return a[order], b[order]


@njit(cache=True)
def _sweep(first, second):
    """Test every box against those, sorted by their least x, that can reach it."""
    pairs = np.empty((64, 2), np.int64)
    found = 0
    width = 0.0
    for b in range(len(second)):
        width = max(width, second[b, 3] - second[b, 0])
    least = second[:, 0].copy()
    for a in range(len(first)):
        for b in range(np.searchsorted(least, first[a, 0] - width), len(second)):
            if second[b, 0] > first[a, 3]:
                break
            if (second[b, 3] >= first[a, 0]
                    and second[b, 1] <= first[a, 4] and second[b, 4] >= first[a, 1]
                    and second[b, 2] <= first[a, 5] and second[b, 5] >= first[a, 2]):
                if found == len(pairs):
                    more = np.empty((2 * found, 2), np.int64)
                    more[:found] = pairs
                    pairs = more
                pairs[found, 0], pairs[found, 1] = a, b
                found += 1
    return pairs[:found]
