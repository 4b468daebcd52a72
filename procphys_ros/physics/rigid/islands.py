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


"""Islands: groups of bodies connected by contacts or joints, solved independently in a step."""

import math
from typing import NamedTuple, Self

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.rigid.vectors import LEAN

_LEVEL = 1e-6  # [m] resolution of heights of contacts
_DIGIT = 1 << 11  # radix of the sort; two digits cover 4 m


class Islands(NamedTuple):
    """
    Islands, each with its bodies, contacts and joints.

    :ivar bodies: rows, island by island, (N,).
    :ivar body_start: start of the bodies of each island, and the end, (I + 1,).
    :ivar contacts, contact_start: likewise.
    :ivar joints, joint_start: likewise.
    """

    bodies: np.ndarray
    body_start: np.ndarray
    contacts: np.ndarray
    contact_start: np.ndarray
    joints: np.ndarray
    joint_start: np.ndarray

    @classmethod
    def found(cls, contacts: tuple[np.ndarray, np.ndarray],
              joints: tuple[np.ndarray, np.ndarray], count: int) -> Self:
        """
        Sort bodies, contacts and joints by island, in the order of the first body of each.

        :param contacts: bodies of contacts, (C,) twice; numbers from `count` on are immovable and
            connect no islands.
        :param joints: likewise, (J,) twice.
        :param count: number of movable bodies.
        """
        pairs = [np.concatenate(ends) for ends in zip(contacts, joints)]
        bodies, body_start, rows, start = _components(*pairs, count)
        touches = rows < len(contacts[0])  # contacts come first in each island
        begin = np.concatenate([[0], np.cumsum(touches)])[start]
        return cls(bodies, body_start, rows[touches], begin, rows[~touches] - len(contacts[0]),
                   start - begin)

    def taken(self, chosen: np.ndarray) -> Self:
        """Return some islands, in this order."""
        out = []
        for column, start in zip(self[::2], self[1::2]):
            size = np.diff(start)[chosen]
            begin = np.concatenate([[0], np.cumsum(size)])
            shift = start[:-1][chosen] - begin[:-1]
            rows = np.arange(begin[-1]) + np.repeat(shift, size)
            out += [column[rows], begin]
        return type(self)(*out)

    def between(self, low: int, high: int) -> Self:
        """Return a range of islands."""
        out = []
        for column, start in zip(self[::2], self[1::2]):
            out += [column[start[low]:start[high]], start[low:high + 1] - start[low]]
        return type(self)(*out)


@subroutine(**LEAN)
def _root(parent, i):
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def _components(first, second, count):
    """Sort bodies and pairs by island; return bodies and their starts, pairs and their starts."""
    parent = np.arange(count)
    for c in range(len(first)):
        a, b = first[c], second[c]
        if 0 <= a < count and 0 <= b < count:
            a, b = _root(parent, a), _root(parent, b)
            parent[max(a, b)] = min(a, b)
    number, found = np.full(count, -1), 0
    for i in range(count):
        root = _root(parent, i)
        if number[root] < 0:
            number[root] = found
            found += 1
        number[i] = number[root]
    own = np.empty(len(first), np.int64)
    for c in range(len(first)):
        own[c] = number[first[c] if 0 <= first[c] < count else second[c]]
    bodies, body_start = _sorted(number, found)
    rows, start = _sorted(own, found)
    return bodies, body_start, rows, start


@kernel
def upwards(contacts, rows, gravity):
    """
    Sort contacts from the ground up: first those with force or overlap, then the open ones.

    :param contacts: with their forces of the previous step.
    :param rows: rows of contacts to sort, (C,).
    :param gravity: [m/s²], (3,).
    :returns: rows, (C,).
    """
    point, count = contacts.point, len(rows)
    order, level = np.arange(count), np.zeros(count, np.int64)
    waits = np.zeros(count, np.int64)
    strength = math.sqrt(gravity[0] * gravity[0] + gravity[1] * gravity[1]
                         + gravity[2] * gravity[2])
    for n in range(count):
        c = rows[n]
        waits[n] = contacts.gap[c] > 0.0 and contacts.force[c, 0] == 0.0
        if strength > 0.0:
            along = (point[c, 0] * gravity[0] + point[c, 1] * gravity[1]
                     + point[c, 2] * gravity[2])
            level[n] = -int(along / strength / _LEVEL)
    if count > 0:
        level -= level.min()
    while count > 0 and level.max() > 0:  # digit by digit
        order = order[_sorted(level[order] % _DIGIT, _DIGIT)[0]]
        level //= _DIGIT
    return rows[order[_sorted(waits[order], 2)[0]]]


@subroutine
def _sorted(number, count):
    """Sort by number, stably; return the order and the start of each number."""
    start = np.zeros(count + 1, np.int64)
    for i in range(len(number)):
        start[number[i] + 1] += 1
    for k in range(count):
        start[k + 1] += start[k]
    out, fill = np.empty(len(number), np.int64), start[:-1].copy()
    for i in range(len(number)):
        out[fill[number[i]]] = i
        fill[number[i]] += 1
    return out, start
