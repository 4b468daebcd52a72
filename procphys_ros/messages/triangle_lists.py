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
Markers with triangles that ride on poses, all of them in one block of bytes.

Crowns move in every frame, and their triangles are half of what is sent: one kernel places the
corners of all markers that change, where they stand in the message.
"""

from collections.abc import Sequence

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.messages.cdr import Stamp
from procphys_ros.messages.foliage import Foliage
from procphys_ros.messages.marker_rows import BEFORE, ListMarker


class TriangleLists:
    """
    Write markers with triangles that are carried by poses.

    :param markers: of type TRIANGLE_LIST.
    :param foliage: triangles of each marker.
    """

    def __init__(self, markers: Sequence[ListMarker], foliage: Sequence[Foliage]):
        self._deletions = [marker.deletion for marker in markers]
        laid = [marker.laid_out(len(one.corners)) for marker, one in zip(markers, foliage)]
        self._start = BEFORE + _starts([len(data) for data, _, _ in laid])
        self._block = np.zeros(int(self._start[-1]) + BEFORE, np.uint8)
        for (data, _, _), start in zip(laid, self._start):
            self._block[start:start + len(data)] = np.frombuffer(data, np.uint8)
        offsets = np.array([place[1:] for place in laid], np.int64).reshape(-1, 2)
        self._stamp_at = (self._start[:-1] + offsets[:, 0]) // 4
        self._points_at = (self._start[:-1] + offsets[:, 1]) // 8
        self._first = _starts([len(one.row) for one in foliage])
        self._row = np.concatenate([np.zeros(0, np.int32), *(one.row for one in foliage)])
        self._corners = np.concatenate([np.zeros((0, 3)), *(one.corners for one in foliage)])
        self._first_carrier = _starts([len(one.carriers) for one in foliage])
        self._carrier = np.concatenate(
            [np.zeros(0, np.int32), *(one.carriers for one in foliage)])

    @property
    def deletions(self) -> list[bytes]:
        """Return the deletions of all markers."""
        return self._deletions

    def write(self, poses: np.ndarray, changed: np.ndarray,
              at: Stamp) -> tuple[list[memoryview], int]:
        """
        Write the markers with moved carriers.

        Corners on missing carriers shrink to a point; a marker without any other carrier is
        deleted.

        :param poses: of the carriers, (M, 7).
        :param changed: whether each has moved, (M,) bool.
        :param at: stamp of the markers.
        :returns: the markers, which the next call overwrites, and their number.
        """
        moved = np.zeros(len(self._deletions), bool)
        _write(poses, changed, self._first_carrier, self._carrier, self._first, self._row,
               self._corners, self._stamp_at, self._points_at, np.array(at, np.uint32),
               self._block.view(np.uint32), self._block.view(np.float64), moved)
        gone = moved & ~self._are_there(poses, moved)
        edges = np.flatnonzero(np.diff(moved & ~gone, prepend=False, append=False))
        block = self._block.data
        runs = [block[self._start[first]:self._start[last]]
                for first, last in edges.reshape(-1, 2)]
        runs += [memoryview(self._deletions[marker]) for marker in np.flatnonzero(gone)]
        return runs, int(np.count_nonzero(moved))

    def _are_there(self, poses: np.ndarray, asked: np.ndarray) -> np.ndarray:
        """Return which of the selected markers have an existing carrier, (K,) bool."""
        there = np.zeros(len(asked), bool)
        for marker in np.flatnonzero(asked):
            carriers = self._carrier[self._first_carrier[marker]:self._first_carrier[marker + 1]]
            # Usually the first one exists, and crowns move in every frame.
            there[marker] = np.isfinite(poses[carriers[:1], 0]).any() or bool(
                np.isfinite(poses[carriers, 0]).any())
        return there


def _starts(lengths: list[int]) -> np.ndarray:
    """Return the start of each of consecutive blocks, and the end of the last."""
    return np.append(0, np.cumsum(np.array(lengths, np.int64)))


@kernel(nogil=True)
def _write(poses, changed, first_carrier, carrier, first, row, corners, stamp_at, points_at, at,
           words, numbers, moved):
    for m in range(len(moved)):
        for k in range(first_carrier[m], first_carrier[m + 1]):
            if changed[carrier[k]]:
                moved[m] = True
                break
        if not moved[m]:
            continue
        words[stamp_at[m]], words[stamp_at[m] + 1] = at[0], at[1]
        out = points_at[m]
        for i in range(first[m], first[m + 1]):
            x, y, z = _placed(poses, row[i], corners, i)
            numbers[out], numbers[out + 1], numbers[out + 2] = x, y, z
            out += 3


@kernel(nogil=True)
def place(poses, row, corners, out):
    """
    Transform corners from the frames of their carriers to the world.

    :param poses: (M, 7).
    :param row: of the pose of each corner, below 0 = no transform, (P,).
    :param corners: in the frames of these poses [m], (P, 3).
    :param out: [m], (P, 3); zero where the pose is missing.
    """
    for i in range(len(row)):
        if row[i] < 0:
            out[i] = corners[i]
        else:
            out[i, 0], out[i, 1], out[i, 2] = _placed(poses, row[i], corners, i)


@subroutine(inline='always')
def _placed(poses, p, corners, i):
    x, y, z, w = poses[p, 3], poses[p, 4], poses[p, 5], poses[p, 6]
    a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    u = poses[p, 0] + a + w * tx + y * tz - z * ty
    v = poses[p, 1] + b + w * ty + z * tx - x * tz
    s = poses[p, 2] + c + w * tz + x * ty - y * tx
    if u != u or v != v or s != s:  # the pose is missing
        return 0.0, 0.0, 0.0
    return u, v, s
