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


"""Contacts: points at which bodies touch, with their forces of the previous step."""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.rigid.ground import MOST_ON_GROUND, touch_ground
from procphys_ros.physics.rigid.manifold import MOST, touch
from procphys_ros.physics.rigid.pieces import point_velocity, SLOP, spin_of
from procphys_ros.physics.rigid.vectors import at, dot, INLINE, LEAN, length, less
from procphys_ros.physics.terrain import height_at, normal_at

_GROUND = (1 << 31) - 2  # first piece in keys of a piece on the ground
POINT = (1 << 31) - 1  # first piece in keys of a ground contact point of a body
_SAME = 0.02  # [m] largest motion of a contact point over a body in a step to be matched
_SAME_TURN = 1e-3  # [rad] largest relative rotation of a reused manifold: friction to 0.1 %
_SAME_WAY = 0.5 * SLOP  # [m] largest relative motion of the points of a reused manifold
_CORNERS = 8  # of a piece that may touch the ground


def split_key(key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the two pieces of keys; numbers beyond all pieces stand for the ground."""
    return key >> 32, key & 0xffffffff


def join_key(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the keys of pairs of pieces, which sort like the pairs."""
    return (first << 32) | second


class ContactRows(NamedTuple):
    """
    Columns of contact points, a row each, in the order of their keys.

    :ivar key: of the pair of pieces, (C,).
    :ivar first, second: bodies, (C,).
    :ivar point: half-way between the surfaces, world [m], (C, 3).
    :ivar normal: unit, from the second to the first, (C, 3).
    :ivar gap: negative where they overlap [m], (C,).
    :ivar radius: of round pieces, whose contact point does not rotate with them; 0 for others
        [m], (C, 2).
    :ivar anchor: point at detection, in the frame of the first body [m], (C, 3).
    :ivar other_anchor: the same in the frame of the second body [m], (C, 3).
    :ivar found: normal in the frame of the first body, attitude of the second in it, and gap [m],
        at detection, (C, 8).
    :ivar shift: tangential displacement of the first body against the second since they stick,
        world [m], (C, 3).
    :ivar force: on the first body, along the normal, and tangential in world axes [N], (C, 4).
    """

    key: np.ndarray
    first: np.ndarray
    second: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    radius: np.ndarray
    anchor: np.ndarray
    other_anchor: np.ndarray
    found: np.ndarray
    shift: np.ndarray
    force: np.ndarray

    def of(self, rows: np.ndarray) -> 'ContactRows':
        """Return some rows of the columns."""
        return ContactRows(*(column[rows] for column in self))

    def head(self, count: int) -> 'ContactRows':
        """Return the first rows of the columns."""
        return ContactRows(*(column[:count] for column in self))


@kernel
def no_contacts(count):
    """Allocate columns for contacts."""
    return ContactRows(np.empty(count, np.int64), np.empty(count, np.int64),
                       np.empty(count, np.int64), np.empty((count, 3)), np.empty((count, 3)),
                       np.empty(count), np.empty((count, 2)), np.empty((count, 3)),
                       np.empty((count, 3)), np.empty((count, 8)), np.empty((count, 3)),
                       np.empty((count, 4)))


@kernel(nogil=True)
def find(rows, is_free, pairs, pieces, poses, velocities, extra, terrain, time_step, before):
    """
    Find the contact points of pieces with each other and the ground, within reach of a step.

    :param rows: pieces that move, ascending, (M,).
    :param is_free: whether they move freely; others pass through the ground, (M,) bool.
    :param pairs: keys of pieces, ascending, (K,).
    :param poses: of bodies, (B, 7); `velocities` (B, 6) likewise.
    :param extra: ground contact points: bodies, (E,), positions in their frames
        [m], (E, 3), and identifying numbers, (E,).
    :param before: contacts of the previous step.
    :returns: contact rows and the number of them in use.
    """
    most = _CORNERS if terrain.heights.shape[0] == 0 else MOST_ON_GROUND
    out = no_contacts(MOST * len(pairs) + most * len(rows) + len(extra[0]))
    points, normals = np.empty((MOST_ON_GROUND, 4)), np.empty((MOST_ON_GROUND, 3))
    count = _find(rows, is_free, pairs, pieces, poses, velocities, extra, terrain, time_step,
                  before, out, points, normals, np.empty((2, 16, 4)))
    return out, count


@subroutine(**LEAN)
def _find(rows, is_free, pairs, pieces, poses, velocities, extra, terrain, time_step, before, out,
          points, normals, work):
    count = old = 0
    for key in pairs:
        p, q = key >> 32, key & 0xffffffff
        way = _approach(p, q, pieces, poses, velocities) * time_step
        old, last = _range(before, old, key)
        if last > old and _lasts(p, q, way, pieces, poses, before, old, last):
            for r in range(old, last):
                _go_on(out, count, before, r, poses)
                count += 1
            continue
        margin = SLOP + way
        found = touch(p, q, pieces, margin, points, normals[0], work)
        for n in range(1, found):
            normals[n, 0], normals[n, 1], normals[n, 2] = at(normals, 0)
        old = _write(out, count, found, key, pieces.body[p], pieces.body[q], points, normals,
                     poses, before, old)
        _roll(out, count, found, pieces.radius[p], pieces.radius[q])
        count += found
    for m in range(len(rows)):
        if is_free[m]:
            p = rows[m]
            found = touch_ground(p, pieces, poses, velocities, terrain, time_step, points,
                                 normals)
            old = _write(out, count, found, (_GROUND << 32) | p, pieces.body[p], 0, points,
                         normals, poses, before, old)
            _roll(out, count, found, pieces.radius[p], 0.0)
            count += found
    return _find_corners(extra, out, count, old, poses, velocities, terrain, time_step, points,
                         normals, before)


@subroutine(**LEAN)
def _range(before, old, key):
    """Return the range of rows of a key in the contacts of the previous step."""
    while old < len(before.key) and before.key[old] < key:
        old += 1
    last = old
    while last < len(before.key) and before.key[last] == key:
        last += 1
    return old, last


@subroutine(**LEAN)
def _lasts(p, q, way, pieces, poses, before, old, last):
    """
    Return whether the previous contact points of a pair can be reused.

    They can as long as relative rotation and motion are too small for other points to come near.

    :param way: largest approach of the two in the step [m].
    """
    if pieces.radius[p] > 0.0 or pieces.radius[q] > 0.0:
        return False
    one, two = poses[pieces.body[p]], poses[pieces.body[q]]
    x, y, z, _ = _relative(before.found[old, 3:7], _relative(one[3:], two[3:]))
    turn = 2.0 * math.sqrt(x * x + y * y + z * z)
    if turn > _SAME_TURN:
        return False
    far = 0.0
    for r in range(old, last):
        far = max(far, length(less(_carried(one, at(before.anchor, r)),
                                   _carried(two, at(before.other_anchor, r)))))
    return far + turn * max(pieces.reach[p], pieces.reach[q]) + way < _SAME_WAY


@subroutine(**INLINE)
def _relative(one, two):
    """Return the second of two attitudes in the frame of the first."""
    a, b, c, d = one[0], one[1], one[2], one[3]
    e, f, g, h = two[0], two[1], two[2], two[3]
    return (d * e - a * h - b * g + c * f, d * f - b * h - c * e + a * g,
            d * g - c * h - a * f + b * e, d * h + a * e + b * f + c * g)


@subroutine(**LEAN)
def _go_on(out, r, before, old, poses):
    """Write a contact point of the previous step at its present position."""
    first, second = before.first[old], before.second[old]
    out.key[r], out.first[r], out.second[r] = before.key[old], first, second
    one = _carried(poses[first], at(before.anchor, old))
    two = _carried(poses[second], at(before.other_anchor, old))
    n = less(_carried(poses[first], at(before.found, old)), at(poses, first))
    gap = before.found[old, 7] + dot(n, less(one, two))
    out.gap[r] = gap
    for i in range(3):
        out.point[r, i], out.normal[r, i] = 0.5 * (one[i] + two[i]), n[i]
        out.anchor[r, i] = before.anchor[old, i]
        out.other_anchor[r, i], out.shift[r, i] = before.other_anchor[old, i], before.shift[old, i]
    for i in range(8):
        out.found[r, i] = before.found[old, i]
    for i in range(4):
        out.force[r, i] = before.force[old, i]
    out.radius[r, 0] = out.radius[r, 1] = 0.0


@subroutine(**LEAN)
def _find_corners(extra, out, count, old, poses, velocities, terrain, time_step, points, normals,
                  before):
    """Find the ground contact points in contact; return the number of all contacts."""
    for e in range(len(extra[0])):
        found = _corner_on_ground(extra[0][e], extra[1][e], poses, velocities, terrain, time_step,
                                  points, normals)
        old = _write(out, count, found, (POINT << 32) | extra[2][e], extra[0][e], 0, points,
                     normals, poses, before, old)
        _roll(out, count, found, 0.0, 0.0)
        count += found
    return count


@subroutine(**LEAN)
def _approach(p, q, pieces, poses, velocities):
    """Compute an upper bound of the approach speed of two pieces [m/s]."""
    a, b = pieces.body[p], pieces.body[q]
    one = point_velocity(poses[a], velocities[a], pieces.centre[p])
    two = point_velocity(poses[b], velocities[b], pieces.centre[q])
    return (length(less(one, two)) + spin_of(velocities[a]) * pieces.reach[p]
            + spin_of(velocities[b]) * pieces.reach[q])


@subroutine(**LEAN)
def _corner_on_ground(body, place, poses, velocities, terrain, time_step, points, normals):
    """Write the contact of a ground contact point; return its number of contacts, 0 or 1."""
    corner = _carried(poses[body], place)
    way = length(point_velocity(poses[body], velocities[body], corner)) * time_step
    n = normal_at(terrain, corner[0], corner[1])
    gap = (corner[2] - height_at(terrain, corner[0], corner[1])) * n[2]
    for i in range(3):
        points[0, i], normals[0, i] = corner[i] - 0.5 * gap * n[i], n[i]
    points[0, 3] = gap
    return 1 if gap < SLOP + way else 0


@subroutine(**LEAN)
def _carried(pose, place):
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    u = (y * place[2] - z * place[1], z * place[0] - x * place[2], x * place[1] - y * place[0])
    return (pose[0] + place[0] + 2.0 * (w * u[0] + y * u[2] - z * u[1]),
            pose[1] + place[1] + 2.0 * (w * u[1] + z * u[0] - x * u[2]),
            pose[2] + place[2] + 2.0 * (w * u[2] + x * u[1] - y * u[0]))


@subroutine(**LEAN)
def _back(pose, place):
    """Transform a point from the world into the frame of a pose."""
    return _unturned(pose, (place[0] - pose[0], place[1] - pose[1], place[2] - pose[2]))


@subroutine(**LEAN)
def _unturned(pose, a):
    """Rotate a direction from the world into the frame of a pose."""
    x, y, z, w = -pose[3], -pose[4], -pose[5], pose[6]
    u = (y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0])
    return (a[0] + 2.0 * (w * u[0] + y * u[2] - z * u[1]),
            a[1] + 2.0 * (w * u[1] + z * u[0] - x * u[2]),
            a[2] + 2.0 * (w * u[2] + x * u[1] - y * u[0]))


@subroutine(**INLINE)
def _roll(out, row, count, radius, other):
    """Write the radii of rolling pieces of contacts."""
    for r in range(row, row + count):
        out.radius[r, 0], out.radius[r, 1] = radius, other


@subroutine(**LEAN)
def _write(out, row, count, key, first, second, points, normals, poses, before, old):
    """Write the points of a pair, with their previous forces; return its first previous row."""
    while old < len(before.key) and before.key[old] < key:
        old += 1
    for k in range(count):
        r = row + k
        out.key[r], out.first[r], out.second[r] = key, first, second
        anchor = _back(poses[first], at(points, k))
        other_anchor = _back(poses[second], at(points, k))
        facing = _unturned(poses[first], at(normals, k))
        attitude = _relative(poses[first, 3:], poses[second, 3:])
        out.found[r, 7] = points[k, 3]
        for i in range(4):
            out.found[r, 3 + i] = attitude[i]
        for i in range(3):
            out.found[r, i], out.other_anchor[r, i] = facing[i], other_anchor[i]
            out.point[r, i], out.normal[r, i] = points[k, i], normals[k, i]
            out.anchor[r, i], out.shift[r, i] = anchor[i], 0.0
        out.gap[r] = points[k, 3]
        for i in range(4):
            out.force[r, i] = 0.0
        nearest, same = _SAME * _SAME, -1
        other = old
        while other < len(before.key) and before.key[other] == key:
            away = less(anchor, at(before.anchor, other))
            if dot(away, away) < nearest:
                nearest, same = dot(away, away), other
            other += 1
        if same >= 0:
            for i in range(4):
                out.force[r, i] = before.force[same, i]
            for i in range(3):
                out.shift[r, i] = before.shift[same, i]
    return old
