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


"""Pairs: broad phase that updates only pieces that have left their enlarged bounds."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.rigid.contacts import split_key
from procphys_ros.physics.rigid.pieces import PieceRows
from procphys_ros.physics.touch import overlaps

_ROOM = 0.01  # [m] margin around pieces in which they move without an update of their pairs


class PairList:
    """
    Pairs of pieces, kept as long as the pieces stay in their enlarged bounds.

    The result depends on the present bounds of the pieces only, not on their history.
    """

    def __init__(self) -> None:
        self._keys = np.zeros(0, np.int64)
        self._around = np.zeros((0, 6))
        self._moves = self._excluded = np.zeros(0, np.int64)

    def forget(self) -> None:
        """Invalidate all pairs after pieces were added, removed or placed elsewhere."""
        self._around = self._around[:0]

    def near(self, rows: np.ndarray, way: np.ndarray, pieces: PieceRows, moves: np.ndarray,
             excluded: np.ndarray) -> np.ndarray:
        """
        List the keys of pairs whose bounds overlap, ascending, (K,).

        :param rows: pieces that move, ascending, (M,).
        :param way: estimate of their motion in the near future [m], (M,).
        :param moves, excluded: see `meeting`.
        """
        if (len(self._around) == len(pieces.body) and np.array_equal(moves, self._moves)
                and np.array_equal(excluded, self._excluded)):
            away = _away(rows, pieces.bounds, self._around)
        else:
            self._around, self._keys = pieces.bounds.copy(), self._keys[:0]
            self._moves, self._excluded = moves, excluded
            away = np.ones(len(rows), bool)
        left = rows[away]
        if len(left):
            room = _ROOM + way[away, None]
            self._around[left, :3] = pieces.bounds[left, :3] - room
            self._around[left, 3:] = pieces.bounds[left, 3:] + room
            sought = np.zeros(len(pieces.body), bool)
            sought[left] = True
            one, other = overlaps(self._around[left], self._around)
            fresh = meeting(one, other, left, sought, pieces.body, moves, excluded)
            first, second = split_key(self._keys)
            kept = self._keys[~(sought[first] | sought[second])]
            self._keys = np.sort(np.concatenate([kept, fresh]))
        return _overlapping(self._keys, pieces.bounds)


@kernel
def meeting(one, other, rows, sought, body, moves, excluded):
    """
    Choose the pairs of pieces that may collide, each once.

    :param one, other: indices in `rows` and other pieces, (K,).
    :param rows: pieces whose pairs are sought, ascending, (M,).
    :param sought: whether each piece is one of these, (P,) bool.
    :param body: of each piece, (P,).
    :param moves: motion of each body: 2 = free, 1 = kinematic, 0 = none, (B,).
    :param excluded: pairs of bodies, lower id first, as keys, ascending, (E,).
    :returns: keys of the pairs, the lower piece first, (L,).
    """
    out, count = np.empty(len(one), np.int64), 0
    for k in range(len(one)):
        p, q = rows[one[k]], other[k]
        a, b = body[p], body[q]
        if a == b or moves[a] + moves[b] < 2 or (sought[q] and p > q):
            continue
        if moves[a] == 1 and moves[b] == 1:
            continue
        if len(excluded):
            key = (min(a, b) << 32) | max(a, b)
            place = np.searchsorted(excluded, key)
            if place < len(excluded) and excluded[place] == key:
                continue
        out[count] = (min(p, q) << 32) | max(p, q)
        count += 1
    return out[:count]


@kernel
def _away(rows, bounds, around):
    """Mark the pieces that have left their enlarged bounds, (M,) bool."""
    out = np.zeros(len(rows), np.bool_)
    for m in range(len(rows)):
        p = rows[m]
        for i in range(3):
            if bounds[p, i] < around[p, i] or bounds[p, 3 + i] > around[p, 3 + i]:
                out[m] = True
    return out


@kernel
def _overlapping(keys, bounds):
    """List the keys of pairs whose bounds overlap, (K,)."""
    out, count = np.empty(len(keys), np.int64), 0
    for key in keys:
        p, q = key >> 32, key & 0xffffffff
        out[count] = key
        count += ((bounds[p, 0] <= bounds[q, 3]) & (bounds[p, 3] >= bounds[q, 0])
                  & (bounds[p, 1] <= bounds[q, 4]) & (bounds[p, 4] >= bounds[q, 1])
                  & (bounds[p, 2] <= bounds[q, 5]) & (bounds[p, 5] >= bounds[q, 2]))
    return out[:count]
