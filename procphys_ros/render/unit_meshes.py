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


"""Unit meshes: what is drawn in many copies, one mesh for each kind of piece."""

from enum import Enum
from functools import cache

import numpy as np

from procphys_ros.hexahedron import FACES
from procphys_ros.render import mesh

_SIDES = 10  # columns of faces around a branch
_RINGS = np.array([[0, -1.0, 0.0], [0, -0.7071, 0.7071], [0, 0.0, 1.0],
                   [1, 0.0, 1.0], [1, 0.7071, 0.7071], [1, 1.0, 0.0]])  # as in `mesh.branches`
_BALL = (32, 16)  # columns and rows of a ball


class Kind(Enum):
    """What a piece is; the value names it in the shaders."""

    BOX = 'KIND_BOX'
    HEXAHEDRON = 'KIND_HEXAHEDRON'
    JOINT = 'KIND_JOINT'  # a box without the two faces across z, which nobody sees
    BRANCH = 'KIND_BRANCH'
    BALL = 'KIND_BALL'
    LEAF = 'KIND_LEAF'
    TRIANGLE = 'KIND_TRIANGLE'


@cache
def unit_mesh(kind: Kind) -> tuple[np.ndarray, str, tuple[str, ...], np.ndarray]:
    """
    Give the mesh of a kind.

    :returns: vertices (V, C) float32, their layout and the names of its fields as ModernGL takes
        them, and triangles (F, 3) uint32.
    """
    makers = {Kind.BOX: _box, Kind.HEXAHEDRON: _hexahedron, Kind.JOINT: _joint,
              Kind.BRANCH: _branch, Kind.BALL: _ball, Kind.LEAF: _leaf,
              Kind.TRIANGLE: _triangle}
    vertices, layout, names, faces = makers[kind]()
    return vertices.astype('f4'), layout, names, faces.astype('u4')


_Mesh = tuple[np.ndarray, str, tuple[str, ...], np.ndarray]
_NOWHERE = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])


def _box() -> _Mesh:
    box = mesh.boxes(_NOWHERE, np.ones((1, 3)))
    return np.hstack([box.points, box.normals]), '3f 3f', ('in_corner', 'in_normal'), box.triangles


def _hexahedron() -> _Mesh:
    """Give the numbers of the corners of each face, and which of them each vertex is."""
    vertices = np.column_stack([np.repeat(FACES, 4, axis=0), np.tile(np.arange(4), len(FACES))])
    return vertices, '4f 1f', ('in_face', 'in_own'), mesh.QUADS


def _joint() -> _Mesh:
    vertices, layout, names, faces = _box()
    return vertices, layout, names, faces[np.abs(vertices[faces[:, 0], 5]) < 0.5]


def _branch() -> _Mesh:
    columns = _SIDES + 1
    turn = np.linspace(0.0, 1.0, columns)
    vertices = np.column_stack([np.repeat(_RINGS, columns, axis=0), np.tile(turn, len(_RINGS))])
    return vertices, '4f', ('in_ring',), _strips(len(_RINGS), columns)


def _ball() -> _Mesh:
    columns, rows = _BALL[0] + 1, _BALL[1] + 1
    turn = np.tile(np.linspace(0.0, 2.0 * np.pi, columns), rows)
    rise = np.repeat(np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows), columns)
    points = np.stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], -1)
    return (np.hstack([points, points]), '3f 3f', ('in_corner', 'in_normal'),
            _strips(rows, columns))


def _leaf() -> _Mesh:
    quads = mesh.crossed_quads(_NOWHERE, np.ones(1), 1.0)
    return np.hstack([quads.points, quads.uv]), '3f 2f', ('in_corner', 'in_uv'), quads.triangles


def _triangle() -> _Mesh:
    return np.zeros((3, 1)), '1f', ('in_nothing',), np.array([[0, 1, 2]])


def _strips(rows: int, columns: int) -> np.ndarray:
    """Connect a grid of vertices, row after row upwards, by triangles that face outwards."""
    grid = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3),
                           np.stack([a, c, d], -1).reshape(-1, 3)])
