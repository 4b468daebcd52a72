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

from procphys_ros.appearance import mesh, texture
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import FACES
from procphys_ros.geometry.linear import norm, product

# Corners of a leaf: position along it, side of its midrib, half width there, brightness. Its
# outline is that of the images, sin(pi t^0.8).
_BLADE = np.array([[0.0, 0, 0.0, 0.9], [0.35, -1, 0.98, 0.78], [0.35, 0, 0.0, 1.0],
                   [0.35, 1, 0.98, 0.78], [0.7, -1, 0.70, 0.78], [0.7, 0, 0.0, 1.0],
                   [0.7, 1, 0.70, 0.78], [1.0, 0, 0.0, 0.85]])
_BLADE_FACES = np.array([[0, 2, 1], [0, 3, 2], [1, 2, 5], [1, 5, 4], [2, 3, 6], [2, 6, 5],
                         [4, 5, 7], [5, 6, 7]])
_FOLD, _DROOP = 0.3, 0.2  # rise of the edges over the half width, fall of the tip over the length
_BALL = (32, 16)  # columns and rows of a ball
_GOLDEN = 0.5 * (1.0 + np.sqrt(5.0))


class Kind(Enum):
    """The kind of a piece; the value is its name in the shaders."""

    BOX = 'KIND_BOX'
    HEXAHEDRON = 'KIND_HEXAHEDRON'
    JOINT = 'KIND_JOINT'  # a box without the two faces across z, which are never visible
    BRANCH = 'KIND_BRANCH'
    BALL = 'KIND_BALL'
    LEAF = 'KIND_LEAF'    # a cluster of leaves: two crossed images
    SPRAY = 'KIND_SPRAY'  # the same, leaf by leaf
    TRIANGLE = 'KIND_TRIANGLE'


@cache
def unit_mesh(kind: Kind, pattern: str = '') -> '_Mesh':
    """
    Return the mesh of a kind.

    :param kind: of piece.
    :param pattern: of sprays, one of `texture.CLUSTERS`.
    :returns: vertices (V, C) float32, their layout and the names of its fields for ModernGL, and
        triangles (F, 3) uint32.
    """
    makers = {Kind.BOX: _box, Kind.HEXAHEDRON: _hexahedron, Kind.JOINT: _joint,
              Kind.BRANCH: _branch, Kind.BALL: _ball, Kind.LEAF: _leaf,
              Kind.TRIANGLE: _triangle}
    vertices, layout, names, faces = _spray(pattern) if kind is Kind.SPRAY else makers[kind]()
    return vertices.astype('f4'), layout, names, faces.astype('u4')


_Mesh = tuple[np.ndarray, str, tuple[str, ...], np.ndarray]


def _box() -> _Mesh:
    box = mesh.boxes(rotation.ORIGIN[None], np.ones((1, 3)))
    return np.hstack([box.points, box.normals]), '3f 3f', ('in_corner', 'in_normal'), box.triangles


def _hexahedron() -> _Mesh:
    """Return the corner numbers of each face, and the corner of each vertex."""
    vertices = np.column_stack([np.repeat(FACES, 4, axis=0), np.tile(np.arange(4), len(FACES))])
    return vertices, '4f 1f', ('in_face', 'in_own'), mesh.QUADS


def _joint() -> _Mesh:
    vertices, layout, names, faces = _box()
    return vertices, layout, names, faces[np.abs(vertices[faces[:, 0], 5]) < 0.5]


def _branch() -> _Mesh:
    rings = np.column_stack([mesh.RING_AT_TIP, mesh.RING_HEIGHT, mesh.RING_RADIUS])
    turn = np.linspace(0.0, 1.0, mesh.SIDES + 1)
    vertices = np.column_stack([np.repeat(rings, len(turn), axis=0), np.tile(turn, len(rings))])
    return vertices, '4f', ('in_ring',), mesh.strips(len(rings), len(turn))


def _ball() -> _Mesh:
    points, _, faces = mesh.unit_ball(*_BALL)
    return np.hstack([points, points]), '3f 3f', ('in_corner', 'in_normal'), faces


def _leaf() -> _Mesh:
    quads = mesh.crossed_quads(rotation.ORIGIN[None], np.ones(1), 1.0)
    return np.hstack([quads.points, quads.uv]), '3f 2f', ('in_corner', 'in_uv'), quads.triangles


def _spray(pattern: str) -> _Mesh:
    """
    Distribute the leaves of a cluster's image around its twig, each folded along its midrib.

    Vertices have a brightness instead of image coordinates.
    """
    count, (low, high), spread, length, width, (inner, outer) = texture.CLUSTERS[pattern]
    rng = np.random.default_rng(7)
    root = low + (high - low) * rng.random(count)
    bend = np.radians(outer + (inner - outer) * (root - low) / (high - low)
                      + 12.0 * rng.standard_normal(count))
    turn = 2.0 * np.pi * rng.random(count)
    away = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=-1)
    along = np.sin(bend)[:, None] * away + np.cos(bend)[:, None] * [0.0, 0.0, 1.0]
    across = np.stack([-np.sin(turn), np.cos(turn), np.zeros(count)], axis=-1)
    start = (spread * (1.1 - root) * rng.random(count))[:, None] * away
    start[:, 2] = root
    size = length * rng.uniform(0.8, 1.2, (count, 1, 1))
    t, side, wide, bright = (_BLADE[:, i, None] for i in range(4))
    half = 0.5 * width * rng.uniform(0.8, 1.2, (count, 1, 1)) * wide
    points = (start[:, None] + t * size * along[:, None] + side * half * across[:, None]
              + _FOLD * half * np.cross(along, across)[:, None])
    points[..., 2:] -= _DROOP * size * t * t * np.sin(bend)[:, None, None]
    light = (bright * rng.uniform(0.62, 1.0, (count, 1, 1))).reshape(-1, 1)
    faces = _BLADE_FACES + len(_BLADE) * np.arange(count)[:, None, None]
    return (np.hstack([points.reshape(-1, 3), light, light]), '3f 2f', ('in_corner', 'in_uv'),
            faces.reshape(-1, 3))


def _triangle() -> _Mesh:
    return np.zeros((3, 1)), '1f', ('in_nothing',), np.array([[0, 1, 2]])


@cache
def round_skin() -> np.ndarray:
    """Return a unit sphere as 80 triangles, an icosahedron refined once, (80, 9)."""
    corners = np.array([[s, t * _GOLDEN, 0.0] for s in (-1, 1) for t in (-1, 1)])
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)])
    faces = [(a, b, c) for a in range(12) for b in range(a + 1, 12) for c in range(b + 1, 12)
             if max(norm(corners[i] - corners[j])
                    for i, j in ((a, b), (b, c), (a, c))) < 2.01]
    out = []
    for face in faces:
        p = corners[list(face)]
        if product(np.cross(p[1] - p[0], p[2] - p[0]), p[0]) < 0.0:
            p = p[::-1]
        m = 0.5 * (p + np.roll(p, -1, axis=0))
        out += [(p[0], m[0], m[2]), (m[0], p[1], m[1]), (m[2], m[1], p[2]), tuple(m)]
    points = np.array(out)
    return (points / norm(points, axis=2, keepdims=True)).reshape(-1, 9)
