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


"""Clearance: how high bodies are over the ground."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel
from procphys_ros.physics.terrain import height_at, normal_at
from procphys_ros.physics.touch import half_extent
from procphys_ros.rotation_kernels import carried, matrix, matrix_rows

_BOX = int(Shape.BOX)  # numba reads no enums


@kernel
def clearance(terrain, pose, shapes, sizes, local, points, cut, corners):
    """
    Give the height over the ground of the lowest point of a body [m].

    Over a terrain, corners of boxes, ends of capsules and the middles of all are looked at.

    :param terrain: the surface of the ground.
    :param pose: of the body, (7,).
    :param shapes: of its pieces, (P,).
    :param sizes: likewise [m], (P, 3).
    :param local: their poses in the frame of the body, (P, 7).
    :param points: further points of the body in its frame [m], (Q, 3).
    :param cut: pieces that are hexahedra, ascending, (H,).
    :param corners: of these in the frames of the pieces [m], (H, 24).
    """
    turn, level = matrix(pose[3:]), len(terrain.heights) == 0
    room, hexahedron = np.inf, 0
    for p in range(len(shapes)):
        if hexahedron < len(cut) and cut[hexahedron] == p:
            for corner in range(8):
                own = corners[hexahedron, 3 * corner:3 * corner + 3]
                room = min(room, _over(terrain, pose, turn, carried(local[p], own), 0.0))
            hexahedron += 1
        elif level:
            room = min(room, _low(pose, turn, shapes[p], sizes[p], local[p]))
        else:
            room = min(room, _over_piece(terrain, pose, turn, shapes[p], sizes[p], local[p]))
    for q in range(len(points)):
        room = min(room, _over(terrain, pose, turn, (points[q, 0], points[q, 1], points[q, 2]),
                               0.0))
    return room


@kernel
def clearances(terrain, ids, poses, first_piece, piece_count, shapes, sizes, local, first_point,
               point_count, points, first_hexahedron, hexahedron_count, cut, corners):
    """Give the same for many bodies of a `BodyTable`, (K,); columns as there."""
    out = np.empty(len(ids))
    for k in range(len(ids)):
        body = ids[k]
        a, b = first_piece[body], first_piece[body] + piece_count[body]
        c, d = first_point[body], first_point[body] + point_count[body]
        e, f = first_hexahedron[body], first_hexahedron[body] + hexahedron_count[body]
        out[k] = clearance(terrain, poses[body], shapes[a:b], sizes[a:b], local[a:b],
                           points[c:d], cut[e:f], corners[e:f])
    return out


@kernel
def _low(pose, turn, shape, size, local):
    """Give the height of the lowest point of a piece [m]."""
    axes = matrix_rows(local[3:])
    room, height = np.zeros(3), pose[2]
    for c in range(3):
        height += turn[2, c] * local[c]
        for k in range(3):
            room[k] += turn[2, c] * axes[c][k]
    return height - half_extent(shape, size, room)


@kernel
def _over_piece(terrain, pose, turn, shape, size, local):
    """Give the room under a piece [m]."""
    room = _over(terrain, pose, turn, carried(local, np.zeros(3)), 0.0)
    if shape == _BOX:
        for corner in range(8):
            own = size * np.array([0.5 - (corner & 1), 0.5 - ((corner >> 1) & 1),
                                   0.5 - ((corner >> 2) & 1)])
            room = min(room, _over(terrain, pose, turn, carried(local, own), 0.0))
    else:
        end = np.array([0.0, 0.0, 0.5 * max(size[2] - size[0], 0.0)])
        for own in (end, -end):
            room = min(room, _over(terrain, pose, turn, carried(local, own), 0.5 * size[0]))
    return room


@kernel
def _over(terrain, pose, turn, point, radius):
    """Give how high a ball in a body is over the plane of the ground below it, straight down."""
    height = pose[2] + turn[2, 0] * point[0] + turn[2, 1] * point[1] + turn[2, 2] * point[2]
    if len(terrain.heights) == 0:
        return height - radius
    x = pose[0] + turn[0, 0] * point[0] + turn[0, 1] * point[1] + turn[0, 2] * point[2]
    y = pose[1] + turn[1, 0] * point[0] + turn[1, 1] * point[1] + turn[1, 2] * point[2]
    return height - height_at(terrain, x, y) - radius / normal_at(terrain, x, y)[2]
