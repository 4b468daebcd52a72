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


"""Meshes: many parts as one set of triangles, built without a loop over the parts."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners
from procphys_ros.geometry.hexahedron import faces as faces_of

SIDES = 10  # columns of faces around a branch
# Profile of a branch from pole to pole: height of each ring on its half sphere, and its radius,
# both over the end radius. Round ends close the gap that opens when a joint bends.
RING_HEIGHT = np.array([-1.0, -0.7071, 0.0, 0.0, 0.7071, 1.0])
RING_RADIUS = np.array([0.0, 0.7071, 1.0, 1.0, 0.7071, 0.0])
RING_AT_TIP = np.array([0, 0, 0, 1, 1, 1])
_MERIDIAN = 12  # rows of faces from pole to pole of a ball
_BARK_TILE = np.array([0.25, 0.5])  # [m] around and along the branch, covered by one image
_BRICK_TILE = 0.6  # [m] of wall covered by one image
QUADS = np.concatenate([4 * np.arange(6)[:, None] + [0, 1, 2],
                        4 * np.arange(6)[:, None] + [0, 2, 3]])  # six faces of four corners each


@dataclass(frozen=True)
class Mesh:
    """
    Triangles with per-vertex data for shading.

    :ivar points: [m], world, (V, 3).
    :ivar triangles: vertex indices, (F, 3).
    :ivar normals: unit, world, (V, 3).
    :ivar uv: image coordinates, 1 = one whole image, (V, 2).
    :ivar piece: row of the input for each vertex, (V,).
    """

    points: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    piece: np.ndarray


def branches(poses: np.ndarray, visual_size: np.ndarray) -> Mesh:
    """
    Build tapered cylinders with round ends.

    :param poses: segment midpoints, z along the segment, world, (N, 7).
    :param visual_size: base diameter, tip diameter, length [m], (N, 3).
    """
    count, rings, columns = len(poses), len(RING_HEIGHT), SIDES + 1
    radius = 0.5 * visual_size[:, RING_AT_TIP]
    length = visual_size[:, 2:3]
    along = (RING_AT_TIP - 0.5) * length + RING_HEIGHT * radius
    turn = np.linspace(0.0, 2.0 * np.pi, columns)
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros(columns)], axis=-1)
    local = (radius * RING_RADIUS)[:, :, None, None] * circle
    local[..., 2] = along[:, :, None]
    normal = np.broadcast_to(RING_RADIUS[:, None, None] * circle, local.shape).copy()
    normal[..., 2] = RING_HEIGHT[:, None]
    repeats = np.maximum(1, np.round(np.pi * visual_size[:, 0] / _BARK_TILE[0]))
    uv = np.empty(local.shape[:3] + (2,))
    uv[..., 0] = repeats[:, None, None] * turn / (2.0 * np.pi)
    uv[..., 1] = along[:, :, None] / _BARK_TILE[1]
    vertices = rings * columns
    return _place(poses, local.reshape(count, vertices, 3), normal.reshape(count, vertices, 3),
                  uv.reshape(count, vertices, 2), strips(rings, columns))


def balls(poses: np.ndarray, diameter: np.ndarray) -> Mesh:
    """
    Build balls.

    :param poses: centres and attitudes, world, (N, 7).
    :param diameter: [m], (N,).
    """
    unit, uv, faces = unit_ball(2 * _MERIDIAN, _MERIDIAN)
    local = 0.5 * diameter[:, None, None] * unit
    return _place(poses, local, np.broadcast_to(unit, local.shape),
                  np.broadcast_to(uv, (len(poses), *uv.shape)), faces)


def unit_ball(columns: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Build a ball of radius 1 from columns and rows of faces.

    :returns: points, which are normals, too, (V, 3), image coordinates (V, 2), triangles (F, 3).
    """
    turn = np.linspace(0.0, 2.0 * np.pi, columns + 1)
    rise = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows + 1)[:, None]
    points = np.stack(np.broadcast_arrays(np.cos(turn) * np.cos(rise),
                                          np.sin(turn) * np.cos(rise), np.sin(rise)), -1)
    uv = np.stack(np.broadcast_arrays(turn / np.pi, rise / np.pi), -1)
    return points.reshape(-1, 3), uv.reshape(-1, 2), strips(rows + 1, columns + 1)


def strips(rows: int, columns: int) -> np.ndarray:
    """Join the points of a grid, row after row upwards, by triangles facing outwards, (F, 3)."""
    grid = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3),
                           np.stack([a, c, d], -1).reshape(-1, 3)])


def boxes(poses: np.ndarray, size: np.ndarray) -> Mesh:
    """
    Build boxes with flat faces.

    :param poses: centres and attitudes, world, (N, 7).
    :param size: full extents [m], (N, 3).
    """
    half = 0.5 * np.asarray(size)
    return hexahedra(poses, box_corners(-half, half))


def hexahedra(poses: np.ndarray, corners: np.ndarray) -> Mesh:
    """
    Build hexahedra with flat faces.

    :param poses: frames, world, (N, 7).
    :param corners: as in `Hexahedra.corners` [m], (N, 24).
    """
    points, normals, _ = faces_of(corners.reshape(-1, 8, 3))
    across = np.argmax(np.abs(normals), axis=2)[..., None]
    axes = np.stack([(across + 1) % 3, (across + 2) % 3], axis=-1)
    uv = np.take_along_axis(points, np.broadcast_to(axes, (*points.shape[:3], 2)), 3)
    count = len(poses)
    shift = np.random.default_rng(0).random((count, 1, 2))  # different grain on every brick
    return _place(poses, points.reshape(count, 24, 3), np.repeat(normals, 4, axis=1),
                  uv.reshape(count, 24, 2) / _BRICK_TILE + shift, QUADS)


def solids(blueprint: Blueprint, poses: np.ndarray,
           parts: np.ndarray) -> Iterator[tuple[np.ndarray, Mesh]]:
    """
    Build parts without leaves and ornaments: those of one kind together, with their indices.

    Balls are round, so their skins, which are ornaments, need not be drawn.

    :param poses: of all parts, world, (N, 7).
    :param parts: ascending, (K,).
    """
    cut = blueprint.hexahedra.among(parts)
    ball = blueprint.balls[parts]
    capsule = (blueprint.shape[parts] == Shape.CAPSULE) & ~ball
    box = blueprint.shape[parts] == Shape.BOX
    box[cut.part] = False
    for rows, build in ((parts[capsule], branches), (parts[box], boxes)):
        if len(rows):
            yield rows, build(poses[rows], blueprint.visual_size[rows])
    if ball.any():
        yield parts[ball], balls(poses[parts[ball]], blueprint.size[parts[ball], 0])
    if len(cut):
        rows = parts[cut.part]
        yield rows, hexahedra(poses[rows], cut.corners)


def crossed_quads(poses: np.ndarray, size: np.ndarray, aspect: float) -> Mesh:
    """
    Build two crossed quads per leaf; the normals point along the leaf.

    :param poses: petioles, z along the leaf, world, (L, 7).
    :param size: length of the quads [m], (L,).
    :param aspect: width over length.
    """
    square = np.array([[-0.5, 0.0], [0.5, 0.0], [0.5, 1.0], [-0.5, 1.0]])
    shape = np.zeros((8, 3))
    shape[:4, 0] = shape[4:, 1] = aspect * square[:, 0]
    shape[:, 2] = np.tile(square[:, 1], 2)
    local = shape * size[:, None, None]
    normal = np.broadcast_to([0.0, 0.0, 1.0], local.shape)
    uv = np.broadcast_to(np.tile(square + [0.5, 0.0], (2, 1)), (len(poses), 8, 2))
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    return _place(poses, local, normal, uv, faces)


def loose_triangles(poses: np.ndarray, corners: np.ndarray) -> Mesh:
    """
    Build free triangles, one normal each.

    :param poses: of their carriers, world, (T, 7).
    :param corners: in those frames [m], (T, 9).
    """
    local = corners.reshape(-1, 3, 3)
    one, other = local[:, 1] - local[:, 0], local[:, 2] - local[:, 0]
    normal = np.cross(one, other)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    uv = np.broadcast_to([[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]], (len(local), 3, 2))
    return _place(poses, local, np.repeat(normal[:, None], 3, axis=1), uv,
                  np.array([[0, 1, 2]]))


def _place(poses: np.ndarray, local: np.ndarray, normals: np.ndarray, uv: np.ndarray,
           faces: np.ndarray) -> Mesh:
    """Transform copies (N, V, 3) of one topology to their poses and join them."""
    count, vertices = local.shape[:2]
    attitude = poses[:, None, 3:]
    starts = vertices * np.arange(count)[:, None, None]
    return Mesh(
        points=(poses[:, None, :3] + rotation.rotate(attitude, local)).reshape(-1, 3),
        triangles=(starts + faces).reshape(-1, 3),
        normals=rotation.rotate(attitude, normals).reshape(-1, 3),
        uv=uv.reshape(-1, 2),
        piece=np.repeat(np.arange(count), vertices))
