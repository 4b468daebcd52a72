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


"""Narrow phase: contacts of capsules with capsules and boxes in the next step."""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import functions
from procphys_ros.geometry.linear_kernels import transformed, transformed_back
from procphys_ros.geometry.rotation_kernels import matrix, matrix_rows
from procphys_ros.physics.terrain import FLAT, height_at, normal_at, Terrain

_BOX = int(Shape.BOX)  # numba does not support enums
_AHEAD = 1.5      # steps of prediction: this one, and the lag of joints in the next
_NEAR = 0.004     # [m] gap below which pairs count as near, at any speed
_STRIDE = 0.5     # least distance between two samples, as a share of the thickness of both
_LOOKS = 64       # samples at most along the motion of one step
_SPAN = 0.15      # of its length: a segment lying along a piece over more than this touches twice
_SLANT = 0.05     # sine of the largest angle at which shapes count as parallel
_STEEPEST = 2.0   # largest slope, rise over run, at which no contact with the ground is missed
_HALVINGS = 26    # bisections: the nearest point of an axis to 1e-8 of its length


class Meetings(NamedTuple):
    """
    Contacts of segments with pieces, at most two for each pair.

    :ivar pair: index of the pair, (C,) int.
    :ivar point: half way between the surfaces [m], (C, 3), world.
    :ivar normal: unit, from the piece to the segment, (C, 3).
    :ivar gap: present gap along the normal; negative where they overlap [m], (C,).
    """

    pair: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    gap: np.ndarray


def meet(rows: np.ndarray, poses: np.ndarray, sizes: np.ndarray, velocities: np.ndarray,
         pieces: np.ndarray, shapes: np.ndarray, piece_poses: np.ndarray,
         piece_sizes: np.ndarray, piece_velocities: np.ndarray, dt: float) -> Meetings:
    """
    Find the contacts of pairs that may touch in the next step.

    :param rows: segment of each pair, (K,).
    :param poses: of all segments, (S, 7); `sizes` (S, 3) and `velocities` (S, 6) likewise.
    :param pieces: piece of each pair, (K,).
    :param shapes: `Shape` of all pieces, (P,); further columns likewise.
    :param dt: time step [s].
    """
    pair = np.empty(2 * len(rows), np.int64)
    point, normal = np.empty((2 * len(rows), 3)), np.empty((2 * len(rows), 3))
    gap = np.empty(2 * len(rows))
    count = _meet(rows, poses, sizes, velocities, pieces, shapes, piece_poses, piece_sizes,
                  piece_velocities, dt, pair, point, normal, gap)
    return Meetings(pair[:count], point[:count], normal[:count], gap[:count])


@kernel
def _meet(rows, poses, sizes, velocities, pieces, shapes, piece_poses, piece_sizes,
          piece_velocities, dt, pair, point, normal, gap):
    count = 0
    for n in range(len(rows)):
        i, p = rows[n], pieces[n]
        slip = velocities[i, :3] - piece_velocities[p, :3]
        spin = (math.sqrt((velocities[i, 3:] ** 2).sum()) * 0.5 * sizes[i, 2]
                + math.sqrt((piece_velocities[p, 3:] ** 2).sum()) * 0.5 * piece_sizes[p].max())
        way = dt * (math.sqrt((slip ** 2).sum()) + spin)
        best, late, t, x, y, z, qx, qy, qz = _approach(
            poses[i], sizes[i], slip, way, shapes[p], piece_poses[p], piece_sizes[p], dt)
        if best == np.inf:
            continue
        past = late * (slip[0] * x + slip[1] * y + slip[2] * z)
        pair[count], gap[count] = n, best - past
        _note(count, x, y, z, qx, qy, qz, best, point, normal)
        if late == 0.0:
            low, high = _span(poses[i], sizes[i], shapes[p], piece_poses[p], piece_sizes[p], t)
            if high - low > _SPAN:
                for at in (low, high):
                    found, _, nx, ny, nz, bx, by, bz = _nearest(
                        poses[i, :3], poses[i, 3:], sizes[i], at, shapes[p], piece_poses[p],
                        piece_sizes[p])
                    pair[count], gap[count] = n, found
                    _note(count, nx, ny, nz, bx, by, bz, found, point, normal)
                    count += 1
                continue
            if high > low:  # a shorter overlap has one contact, in its middle
                _, _, nx, ny, nz, bx, by, bz = _nearest(
                    poses[i, :3], poses[i, 3:], sizes[i], 0.5 * (low + high), shapes[p],
                    piece_poses[p], piece_sizes[p])
                _note(count, nx, ny, nz, bx, by, bz, best, point, normal)
        count += 1
    return count


@subroutine
def _approach(pose, size, slip, way, shape, piece_pose, piece_size, dt):
    """
    Find where a segment may touch a piece on its way in a step, by conservative advancement.

    :param slip: velocity of the segment's centre relative to the piece's [m/s], (3,).
    :param way: upper bound of the approach of their points in the step [m].
    :returns: gap [m], inf = none; time [s]; axis parameter, normal, nearest point of the piece.
    """
    thick = 0.5 * _STRIDE * (size[0] + piece_size.min())
    speed = math.sqrt((slip ** 2).sum())
    best = np.inf
    late = time = t = x = y = z = qx = qy = qz = 0.0
    for look in range(_LOOKS):
        found, at, nx, ny, nz, bx, by, bz = _nearest(
            pose[:3] + time * slip, pose[3:], size, -1.0, shape, piece_pose, piece_size)
        if look == 0 and found > _AHEAD * way + _NEAR:
            break
        if found > 0.0 or look == 0:
            best, t, late = found, at, time
            x, y, z, qx, qy, qz = nx, ny, nz, bx, by, bz
        if found <= _NEAR or _AHEAD * way <= thick:
            break
        time += max(found, thick) / max(speed, 1e-9)  # no contact before that
        if time > _AHEAD * dt:
            best = np.inf  # no contact in the step
            break
    return best, late, t, x, y, z, qx, qy, qz


def meet_ground(rows: np.ndarray, both: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
                velocities: np.ndarray, dt: float, terrain: Terrain = FLAT) -> Meetings:
    """
    Find the contacts of segment tips with the ground that are possible in the next step.

    :param rows: of the segments, (K,).
    :param both: whether the start of a segment counts as well as its tip, (K,).
    :param poses: of all segments, (S, 7); `sizes` (S, 3) and `velocities` (S, 6) likewise.
    :param dt: time step [s].
    :param terrain: the surface of the ground.
    :returns: contacts; `pair` is the index in `rows`.
    """
    return Meetings(*_meet_ground(rows, both, poses, sizes, velocities, dt, terrain))


@kernel
def _meet_ground(rows, both, poses, sizes, velocities, dt, terrain):
    pair = np.empty(2 * len(rows), np.int64)
    place, gap = np.empty((2 * len(rows), 3)), np.empty(2 * len(rows))
    normal = np.empty((2 * len(rows), 3))
    steep = 0.0 if len(terrain.heights) == 0 else _STEEPEST
    count = 0
    for n in range(len(rows)):
        i = rows[n]
        over = poses[i, 2] - height_at(terrain, poses[i, 0], poses[i, 1])
        spin = abs(velocities[i, 3]) + abs(velocities[i, 4])
        reach = sizes[i, 2] + _AHEAD * dt * (abs(velocities[i, 2]) + sizes[i, 2] * spin)
        if steep > 0.0:
            slip = functions.hypot(velocities[i, 0], velocities[i, 1])
            reach += steep * (sizes[i, 2] + _AHEAD * dt * slip)
        if over > reach + _NEAR:
            continue
        half, radius = 0.5 * max(sizes[i, 2] - sizes[i, 0], 0.0), 0.5 * sizes[i, 0]
        turned = matrix_rows(poses[i, 3:])
        for end in range(2 if both[n] else 1):
            away = half if end == 0 else -half
            arm = (away * turned[0][2], away * turned[1][2], away * turned[2][2])
            x, y = poses[i, 0] + arm[0], poses[i, 1] + arm[1]
            nx, ny, nz = normal_at(terrain, x, y)
            fall = velocities[i, 2] + velocities[i, 3] * arm[1] - velocities[i, 4] * arm[0]
            room = poses[i, 2] + arm[2] - radius
            if steep > 0.0:
                fall = nz * fall + nx * (
                    velocities[i, 0] + velocities[i, 4] * arm[2] - velocities[i, 5] * arm[1]) + (
                    ny * (velocities[i, 1] + velocities[i, 5] * arm[0]
                          - velocities[i, 3] * arm[2]))
                room = nz * (poses[i, 2] + arm[2] - height_at(terrain, x, y)) - radius
            if room < _NEAR - _AHEAD * dt * min(fall, 0.0):
                pair[count], gap[count] = n, room
                normal[count, 0], normal[count, 1], normal[count, 2] = nx, ny, nz
                place[count, 0], place[count, 1], place[count, 2] = x, y, 0.5 * room
                if steep > 0.0:
                    for c in range(3):
                        place[count, c] = (poses[i, c] + arm[c]
                                           - (radius + 0.5 * room) * normal[count, c])
                count += 1
    return pair[:count], place[:count], normal[:count], gap[:count]


@subroutine
def _note(count, x, y, z, qx, qy, qz, gap, point, normal):
    normal[count, 0], normal[count, 1], normal[count, 2] = x, y, z
    point[count, 0] = qx + 0.5 * gap * x
    point[count, 1] = qy + 0.5 * gap * y
    point[count, 2] = qz + 0.5 * gap * z


@subroutine
def _nearest(centre, attitude, size, at, shape, pose, extent):
    """
    Compute gap, axis parameter of the segment from 0 to 1, normal, and nearest point of the piece.

    :param at: axis parameter to evaluate at; -1 = the nearest.
    """
    half, radius = 0.5 * max(size[2] - size[0], 0.0), 0.5 * size[0]
    axis = matrix(attitude)[:, 2].copy()
    turn = matrix(pose[3:])
    begin = centre + (2.0 * max(at, 0.0) - 1.0) * half * axis
    long = 2.0 * half if at < 0.0 else 0.0
    if shape == _BOX:
        arm = begin - pose[:3]
        p, d = transformed_back(turn, arm), transformed_back(turn, long * axis)
        t, x, y, z, depth, q = _box(p, d, 0.5 * extent)
        n = transformed(turn, (x, y, z))
        q = pose[:3] + transformed(turn, q)
        gap = depth - radius
    else:
        other = 0.5 * max(extent[2] - extent[0], 0.0)
        along = turn[:, 2].copy()
        t, s = _axes(begin, long * axis, pose[:3] - other * along, 2.0 * other * along)
        q = pose[:3] + other * (2.0 * s - 1.0) * along
        n = begin + t * long * axis - q
        far = math.sqrt((n ** 2).sum())
        if far > 1e-9:
            n = n / far
        else:  # axes cross: any common normal will do
            n = np.array([axis[1] * along[2] - axis[2] * along[1],
                          axis[2] * along[0] - axis[0] * along[2],
                          axis[0] * along[1] - axis[1] * along[0]])
            square = math.sqrt((n ** 2).sum())
            n = n / square if square > 1e-9 else np.array([0.0, 0.0, 1.0])
        q = q + 0.5 * extent[0] * n
        gap = far - radius - 0.5 * extent[0]
    place = t if at < 0.0 else at
    return gap, place, n[0], n[1], n[2], q[0], q[1], q[2]


@subroutine
def _span(pose, size, shape, other, extent, t):
    """Return the axis parameters between which a segment lies along a piece, else t twice."""
    half = 0.5 * max(size[2] - size[0], 0.0)
    axis = matrix(pose[3:])[:, 2].copy()
    turn = matrix(other[3:])
    begin, way = pose[:3] - half * axis, 2.0 * half * axis
    if half < 1e-6:
        return t, t
    if shape == _BOX:
        p, d = transformed_back(turn, begin - other[:3]), transformed_back(turn, way)
        x = p + t * d
        far = math.sqrt(((x - np.minimum(np.maximum(x, -0.5 * extent), 0.5 * extent)) ** 2).sum())
        if far < 1e-7:
            return t, t
        room = _SLANT * far * 2.0 * half
        return _rise(p, d, 0.5 * extent, -room), _rise(p, d, 0.5 * extent, room)
    along = turn[:, 2].copy()
    reach = 0.5 * max(extent[2] - extent[0], 0.0)
    cosine = (axis * along).sum()
    if 1.0 - cosine * cosine > _SLANT * _SLANT:
        return t, t
    middle = ((other[:3] - begin) * axis).sum()
    low, high = (middle - reach) / (2.0 * half), (middle + reach) / (2.0 * half)
    return min(max(low, 0.0), 1.0), min(max(high, 0.0), 1.0)


@subroutine
def _rise(p, d, half, level):
    """Find where the slope of half the squared distance to a box exceeds a level, 0 to 1."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):  # the slope grows with t
        t = 0.5 * (low + high)
        slope = 0.0
        for c in range(3):
            x = p[c] + t * d[c]
            slope += d[c] * (x - min(max(x, -half[c]), half[c]))
        if slope < level:
            low = t
        else:
            high = t
    if high < 1e-6:
        high = 0.0
    elif low > 1.0 - 1e-6:
        high = 1.0
    return high


@subroutine
def _axes(p, d, q, e):
    """Compute the parameters of the nearest points of two axes p + t·d and q + s·e, 0 to 1."""
    dd, ee, de = (d ** 2).sum(), (e ** 2).sum(), (d * e).sum()
    r = p - q
    dr, er = (d * r).sum(), (e * r).sum()
    det = dd * ee - de * de
    t = 0.5
    if dd < 1e-18:
        t = 0.0
    elif det > 1e-9 * dd * ee:
        t = min(max((de * er - dr * ee) / det, 0.0), 1.0)
    elif ee < 1e-18:
        t = min(max(-dr / dd, 0.0), 1.0)
    s = 0.0 if ee < 1e-18 else min(max((de * t + er) / ee, 0.0), 1.0)
    if dd >= 1e-18:
        t = min(max((de * s - dr) / dd, 0.0), 1.0)
    return t, s


@subroutine
def _box(p, d, half):
    """
    Find the point of the axis p + t·d nearest to a box, in the box's frame.

    :returns: t, normal outwards, distance (negative inside), nearest point of the surface.
    """
    t = _rise(p, d, half, 0.0) if (d ** 2).sum() > 1e-18 else 0.0
    x = p + t * d
    q = np.minimum(np.maximum(x, -half), half)
    n = x - q
    far = math.sqrt((n ** 2).sum())
    if far > 1e-7:
        return t, n[0] / far, n[1] / far, n[2] / far, far, q
    inner, deepest, side = t, -np.inf, 2
    for trial in range(9):  # the axis enters the box: nearest face at its deepest point
        s = t + (1.0 - t) * trial / 8.0
        y = p + s * d
        outside = np.abs(y) - half
        k = np.argmax(outside)
        if -outside[k] > deepest:
            inner, deepest, side = s, -outside[k], k
    x = p + inner * d
    q = x.copy()
    sign = 1.0 if x[side] >= 0.0 else -1.0
    q[side] = sign * half[side]
    n = np.zeros(3)
    n[side] = sign
    return inner, n[0], n[1], n[2], -deepest, q
