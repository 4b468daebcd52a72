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


"""Pieces: collision shapes of bodies in world coordinates."""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.rotation_kernels import carried, matrix_rows
from procphys_ros.physics.rigid.vectors import at, cross, INLINE, LEAN, length, less, scaled

ROUND, BOX, HEXAHEDRON = 0, 1, 2
SLOP = 0.005  # [m] gap in which contacts are created, beyond the motion of one step

# Corners of a face, counterclockwise from outside: low and high along x, y, z.  Corner number i is
# on the high side along x if i & 1, along y if i & 2, along z if i & 4.
FACES = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1],
                  [4, 5, 7, 6]])
EDGES = np.array([[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5],
                  [2, 6], [3, 7]])


class PieceRows(NamedTuple):
    """
    Columns of collision shapes, a row each.

    :ivar body: body of the piece; -1 = removed, (P,).
    :ivar kind: `ROUND`, `BOX` or `HEXAHEDRON`, (P,).
    :ivar size: as in `Blueprint.size` [m], (P, 3).
    :ivar local: pose in the body's frame, (P, 7).
    :ivar cut: corners of hexahedra in the piece's frame [m], (P, 24).
    :ivar centre: world [m], (P, 3).
    :ivar axes: unit axes of boxes, world, a row each, (P, 3, 3).
    :ivar corners: of boxes and hexahedra, and in the first two rows the ends of the axis of
        round pieces, world [m], (P, 8, 3).
    :ivar normals: unit normals of their faces, outwards; zero where corners coincide, (P, 6, 3).
    :ivar radius: of round pieces; 0 for others [m], (P,).
    :ivar reach: radius of the bounding sphere about the centre [m], (P,).
    :ivar bounds: swept bounds of a step, three minima and three maxima [m], (P, 6).
    """

    body: np.ndarray
    kind: np.ndarray
    size: np.ndarray
    local: np.ndarray
    cut: np.ndarray
    centre: np.ndarray
    axes: np.ndarray
    corners: np.ndarray
    normals: np.ndarray
    radius: np.ndarray
    reach: np.ndarray
    bounds: np.ndarray


def no_pieces(count: int) -> PieceRows:
    """Allocate columns for pieces."""
    return PieceRows(np.full(count, -1), np.zeros(count, np.int64), np.zeros((count, 3)),
                     np.zeros((count, 7)), np.zeros((count, 24)), np.zeros((count, 3)),
                     np.zeros((count, 3, 3)), np.zeros((count, 8, 3)), np.zeros((count, 6, 3)),
                     np.zeros(count), np.zeros(count), np.zeros((count, 6)))


@kernel
def place(rows, pieces, poses, velocities, time_step):
    """
    Write the world poses of pieces and their swept bounds in a step.

    :param rows: rows of the pieces, (K,).
    :param poses: of bodies, (B, 7); `velocities` (B, 6) likewise.
    :param time_step: [s].
    """
    for k in range(len(rows)):
        p = rows[k]
        body = pieces.body[p]
        centre = carried(poses[body], pieces.local[p])
        frame, own = matrix_rows(poses[body, 3:]), matrix_rows(pieces.local[p, 3:])
        for i in range(3):
            pieces.centre[p, i] = centre[i]
            for j in range(3):
                pieces.axes[p, j, i] = (frame[i][0] * own[0][j] + frame[i][1] * own[1][j]
                                        + frame[i][2] * own[2][j])
        if pieces.kind[p] == ROUND:
            _place_ends(p, pieces)
        else:
            _place_corners(p, pieces)
        _bound(p, pieces, poses[body], velocities[body], time_step)


@subroutine(**LEAN)
def _place_ends(p, pieces):
    half = 0.5 * max(pieces.size[p, 2] - pieces.size[p, 0], 0.0)
    pieces.radius[p] = 0.5 * pieces.size[p, 0]
    pieces.reach[p] = half + pieces.radius[p]
    for i in range(3):
        pieces.corners[p, 0, i] = pieces.centre[p, i] - half * pieces.axes[p, 2, i]
        pieces.corners[p, 1, i] = pieces.centre[p, i] + half * pieces.axes[p, 2, i]


@subroutine(**LEAN)
def _place_corners(p, pieces):
    far = 0.0
    for c in range(8):
        if pieces.kind[p] == BOX:
            x = 0.5 * pieces.size[p, 0] * (1.0 if c & 1 else -1.0)
            y = 0.5 * pieces.size[p, 1] * (1.0 if c & 2 else -1.0)
            z = 0.5 * pieces.size[p, 2] * (1.0 if c & 4 else -1.0)
        else:
            x, y, z = pieces.cut[p, 3 * c], pieces.cut[p, 3 * c + 1], pieces.cut[p, 3 * c + 2]
        far = max(far, x * x + y * y + z * z)
        for i in range(3):
            pieces.corners[p, c, i] = (pieces.centre[p, i] + x * pieces.axes[p, 0, i]
                                       + y * pieces.axes[p, 1, i] + z * pieces.axes[p, 2, i])
    pieces.radius[p], pieces.reach[p] = 0.0, math.sqrt(far)
    for f in range(6):
        if pieces.kind[p] == BOX:
            n = scaled(1.0 if f & 1 else -1.0, at(pieces.axes[p], f // 2))
        else:
            n = _face_normal(pieces.corners[p], f)
        for i in range(3):
            pieces.normals[p, f, i] = n[i]


@subroutine(**LEAN)
def _face_normal(corners, f):
    n = cross(less(at(corners, FACES[f, 2]), at(corners, FACES[f, 0])),
              less(at(corners, FACES[f, 3]), at(corners, FACES[f, 1])))
    size = length(n)
    return scaled(1.0 / size if size > 1e-12 else 0.0, n)


@subroutine(**INLINE)
def point_velocity(pose, velocity, point):
    """Return the velocity of a point of a body, three numbers [m/s]."""
    x, y, z = point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]
    return (velocity[0] + velocity[4] * z - velocity[5] * y,
            velocity[1] + velocity[5] * x - velocity[3] * z,
            velocity[2] + velocity[3] * y - velocity[4] * x)


@subroutine(**INLINE)
def spin_of(velocity):
    """Return the angular speed of a body [rad/s]."""
    return math.sqrt(velocity[3] * velocity[3] + velocity[4] * velocity[4]
                     + velocity[5] * velocity[5])


@subroutine(**LEAN)
def _bound(p, pieces, pose, velocity, time_step):
    last = 2 if pieces.kind[p] == ROUND else 8
    way = point_velocity(pose, velocity, pieces.centre[p])
    room = pieces.radius[p] + SLOP + spin_of(velocity) * pieces.reach[p] * time_step
    for i in range(3):
        low = high = pieces.corners[p, 0, i]
        for c in range(1, last):
            low, high = min(low, pieces.corners[p, c, i]), max(high, pieces.corners[p, c, i])
        pieces.bounds[p, i] = low - room + min(way[i] * time_step, 0.0)
        pieces.bounds[p, 3 + i] = high + room + max(way[i] * time_step, 0.0)
