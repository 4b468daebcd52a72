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


"""Extents: bounds of bodies and proximity of pairs."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.rotation_kernels import carried, matrix_rows
from procphys_ros.physics.touch import half_extent
from procphys_ros.physics.world.body_table import BodyTable

_BOX = int(Shape.BOX)  # numba does not support enums
_PARALLEL = 1e-6  # length of the cross product of parallel unit vectors


def bounds(table: BodyTable, ids: np.ndarray) -> np.ndarray:
    """Compute axis-aligned bounds [m], (K, 6): three minima, three maxima; hexahedra as boxes."""
    return _bounds(ids, table.poses, table.first_piece, table.piece_count, table.piece_shape,
                   table.piece_size, table.piece_pose)


def are_near(table: BodyTable, pairs: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """
    Mark the pairs of bodies that are less than a distance apart, (P,) bool.

    Other shapes count as their bounding boxes, and boxes are enlarged by the distance at edges.

    :param pairs: ids, (P, 2).
    :param distance: [m], (P,).
    """
    return _are_near(np.ascontiguousarray(pairs), distance, table.poses, table.radius,
                     table.first_piece, table.piece_count, table.piece_shape, table.piece_size,
                     table.piece_pose)


@kernel
def _bounds(ids, poses, first, count, shapes, sizes, local):
    out = np.empty((len(ids), 6))
    for k in range(len(ids)):
        body = ids[k]
        out[k, :3], out[k, 3:] = np.inf, -np.inf
        for p in range(first[body], first[body] + count[body]):
            place, turn = _placed(poses[body], local[p])
            for c in range(3):
                room = half_extent(shapes[p], sizes[p], turn[c])
                out[k, c] = min(out[k, c], place[c] - room)
                out[k, 3 + c] = max(out[k, 3 + c], place[c] + room)
    return out


@kernel
def _are_near(pairs, distance, poses, radius, first, count, shapes, sizes, local):
    near = np.zeros(len(pairs), np.bool_)
    for n in range(len(pairs)):
        one, other = pairs[n, 0], pairs[n, 1]
        for p in range(first[one], first[one] + count[one]):
            place, turn = _placed(poses[one], local[p])
            half = _half(shapes[p], sizes[p], distance[n])
            arm = (place[0] - poses[other, 0], place[1] - poses[other, 1],
                   place[2] - poses[other, 2])
            if _dot(arm, arm) > (np.sqrt(_dot(half, half)) + radius[other]) ** 2:
                continue
            for q in range(first[other], first[other] + count[other]):
                centre = carried(poses[other], local[q])
                arm = place[0] - centre[0], place[1] - centre[1], place[2] - centre[2]
                other_half = _half(shapes[q], sizes[q], 0.0)
                if _dot(arm, arm) > (np.sqrt(_dot(half, half))
                                     + np.sqrt(_dot(other_half, other_half))) ** 2:
                    continue
                if _boxes_meet(arm, turn, half, _placed(poses[other], local[q])[1], other_half):
                    near[n] = True
                    break
            if near[n]:
                break
    return near


@subroutine
def _placed(pose, local):
    """Return the centre of a piece and the rows of its rotation matrix, in the world."""
    a, b = matrix_rows(pose[3:]), matrix_rows(local[3:])
    return carried(pose, local), (_times(a[0], b), _times(a[1], b), _times(a[2], b))


@subroutine
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@subroutine
def _times(row, m):
    """Multiply a row by a matrix of rows."""
    return (row[0] * m[0][0] + row[1] * m[1][0] + row[2] * m[2][0],
            row[0] * m[0][1] + row[1] * m[1][1] + row[2] * m[2][1],
            row[0] * m[0][2] + row[1] * m[1][2] + row[2] * m[2][2])


@subroutine
def _half(shape, size, room):
    """Return the half extents of the bounding box of a piece, with a margin around it."""
    length = size[2] if shape == _BOX else max(size[0], size[2])
    return 0.5 * size[0] + room, 0.5 * size[1] + room, 0.5 * length + room


@subroutine
def _boxes_meet(arm, turn, half, other, other_half):
    """Return whether two boxes overlap, by the separating axis test over faces and edge pairs."""
    for a in range(15):
        if a < 3:
            axis = (turn[0][a], turn[1][a], turn[2][a])
        elif a < 6:
            axis = (other[0][a - 3], other[1][a - 3], other[2][a - 3])
        else:
            i, j = (a - 6) // 3, (a - 6) % 3
            axis = (turn[1][i] * other[2][j] - turn[2][i] * other[1][j],
                    turn[2][i] * other[0][j] - turn[0][i] * other[2][j],
                    turn[0][i] * other[1][j] - turn[1][i] * other[0][j])
            if _dot(axis, axis) < _PARALLEL ** 2:
                continue
        one, two = _times(axis, turn), _times(axis, other)
        reach = (abs(one[0]) * half[0] + abs(one[1]) * half[1] + abs(one[2]) * half[2]
                 + abs(two[0]) * other_half[0] + abs(two[1]) * other_half[1]
                 + abs(two[2]) * other_half[2])
        if abs(_dot(arm, axis)) >= reach:
            return False
    return True
