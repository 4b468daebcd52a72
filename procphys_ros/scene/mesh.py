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


"""Meshes as solids: triangles, filled with collision boxes."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.geometry.linear import product
from procphys_ros.physics.world.pieces import merge_pieces, Pieces

_CELLS = 16  # along the longest edge of a mesh
_THINNEST = 1e-3  # [m] of a cell


def boxes_in(triangles: np.ndarray) -> Pieces:
    """
    Fill a closed mesh with boxes: cells whose centres are inside, joined to larger ones.

    A mesh without an inside, such as a sheet, becomes the box around it.

    :param triangles: corners [m], (T, 3, 3).
    """
    low = triangles.reshape(-1, 3).min(axis=0)
    extent = np.maximum(np.ptp(triangles.reshape(-1, 3), axis=0), _THINNEST)
    count = np.maximum(np.round(extent / extent.max() * _CELLS), 1).astype(int)
    cell = extent / count
    filled = np.argwhere(_inside(triangles, low, cell, count))
    if not len(filled):
        filled, cell = np.zeros((1, 3), int), extent
    poses = np.zeros((len(filled), 7))
    poses[:, :3], poses[:, 6] = low + (filled + 0.5) * cell, 1.0
    boxes = Pieces(np.full(len(filled), Shape.BOX, np.int64), np.tile(cell, (len(filled), 1)),
                   poses)
    return merge_pieces(boxes, 1e-6)


def _inside(triangles: np.ndarray, low: np.ndarray, cell: np.ndarray,
            count: np.ndarray) -> np.ndarray:
    """Mark the cells with centres inside, (X, Y, Z): those with an odd number of faces above."""
    # A little off the middle, so that no line runs along an edge that two triangles share.
    off = 0.5 + np.array([1.3e-6, 2.1e-6])
    x = low[0] + (np.arange(count[0]) + off[0]) * cell[0]
    y = low[1] + (np.arange(count[1]) + off[1]) * cell[1]
    z = low[2] + (np.arange(count[2]) + 0.5) * cell[2]
    points = np.stack(np.meshgrid(x, y, indexing='ij'), axis=-1)
    above = np.zeros(count, int)
    for a, b, c in triangles:
        normal = np.cross(b - a, c - a)
        if abs(normal[2]) < 1e-15:
            continue
        sides = [(q[0] - p[0]) * (points[..., 1] - p[1]) - (q[1] - p[1]) * (points[..., 0] - p[0])
                 for p, q in ((a, b), (b, c), (c, a))]
        crossed = np.all(np.sign(sides) == np.sign(normal[2]), axis=0)
        i, j = np.nonzero(crossed)
        height = a[2] - product(points[i, j] - a[:2], normal[:2]) / normal[2]
        above[i, j] += z[None, :] < height[:, None]
    return above % 2 == 1
