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


"""Terrain: the surface of the ground, shared by physics, sensors and rendering."""

from typing import NamedTuple
import zlib

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear import norm


class Terrain(NamedTuple):
    """
    Height field over a grid of square cells, extended level beyond its edges.

    Each cell is two triangles. They share the diagonal from the corner of the largest x to the
    corner of the largest y, as in the height fields of Bullet and of parry, so that all use the
    same surface.

    :ivar heights: at the corners of the cells [m], (X, Y), X along x; no corners = flat ground.
    :ivar low: position of the first corner [m], (2,), world.
    :ivar edge: of a cell [m].
    """

    heights: np.ndarray
    low: np.ndarray
    edge: float

    @property
    def is_flat(self) -> bool:
        """Return whether this is the plane z = 0."""
        return not len(self.heights)

    def __repr__(self) -> str:
        """Return a line that identifies the terrain."""
        return (f'Terrain({self.heights.shape}, {zlib.crc32(self.heights.tobytes()):x}, '
                f'{self.low.tolist()}, {self.edge})')

    def height(self, points: np.ndarray) -> np.ndarray:
        """
        Compute the heights of the ground at points.

        :param points: [m], (K, 2) or (K, 3), of which x and y count.
        :returns: heights [m], (K,).
        """
        points = np.asarray(points, float)
        if self.is_flat:
            return np.zeros(len(points))
        return _heights(self, np.ascontiguousarray(points[:, :2]))

    def normal(self, points: np.ndarray) -> np.ndarray:
        """Compute the upward unit normals at points, (K, 2) or (K, 3), as (K, 3)."""
        return _normals(self, np.ascontiguousarray(np.asarray(points, float)[:, :2]))

    def range(self, origin: np.ndarray, direction: np.ndarray, reach: float = np.inf) -> float:
        """
        Compute the range of the ground along a ray from above; inf = the ray misses it.

        :param origin: [m], (3,).
        :param direction: unit, (3,).
        :param reach: longest range [m].
        """
        x, y, z = np.asarray(origin, float).tolist()
        u, v, w = np.asarray(direction, float).tolist()
        return float(ray_range(self, *self.bounds(), x, y, z, u, v, w, float(reach)))

    def mesh(self, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """
        Build the triangle mesh of the surface, counterclockwise from above.

        :param margin: extension beyond the edges of the grid [m].
        :returns: points [m], (P, 3), and their indices, (F, 3); empty for flat ground.
        """
        if self.is_flat:
            return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        x, y = (self.low[a] + self.edge * np.arange(self.heights.shape[a]) for a in (0, 1))
        heights = self.heights
        if margin > 0.0:
            x, y = (np.concatenate([[v[0] - margin], v, [v[-1] + margin]]) for v in (x, y))
            heights = np.pad(heights, 1, mode='edge')
        across = len(y)
        points = np.column_stack([np.repeat(x, across), np.tile(y, len(x)), heights.ravel()])
        first = (np.arange(len(x) - 1)[:, None] * across + np.arange(across - 1)).ravel()
        faces = np.concatenate([np.column_stack([first, first + across, first + 1]),
                                np.column_stack([first + across, first + across + 1, first + 1])])
        return points, faces

    def vertex_normals(self, margin: float = 0.0) -> np.ndarray:
        """Compute upward unit normals at the points of `mesh`, for smooth shading, (P, 3)."""
        slope = np.stack(np.gradient(self.heights, self.edge), axis=-1)
        if margin > 0.0:
            slope = np.pad(slope, ((1, 1), (1, 1), (0, 0)))
        normals = np.concatenate([-slope, np.ones((*slope.shape[:2], 1))], axis=-1).reshape(-1, 3)
        return normals / norm(normals, axis=1, keepdims=True)

    def padded(self, margin: float) -> 'Terrain':
        """Return the terrain extended beyond its edges by level cells, by a margin or more [m]."""
        cells = int(np.ceil(margin / self.edge))
        return Terrain(np.pad(self.heights, cells, mode='edge'), self.low - cells * self.edge,
                       self.edge)

    def bounds(self) -> tuple[float, float]:
        """Return the heights of the lowest and of the highest point [m]."""
        return (0.0, 0.0) if self.is_flat else (float(self.heights.min()),
                                                float(self.heights.max()))


FLAT = Terrain(np.zeros((0, 0)), np.zeros(2), 1.0)  # the plane z = 0


@subroutine
def _cell(terrain, x, y):
    """Find the cell of a point: two indices, and two fractions within the cell."""
    u, v = (x - terrain.low[0]) / terrain.edge, (y - terrain.low[1]) / terrain.edge
    columns, rows = terrain.heights.shape
    u = min(u, columns - 1.0) if u > 0.0 else 0.0  # NaN becomes 0, too
    v = min(v, rows - 1.0) if v > 0.0 else 0.0
    i, j = min(int(u), columns - 2), min(int(v), rows - 2)
    return i, j, u - i, v - j


@subroutine
def height_at(terrain, x, y):
    """Compute the height of the ground at a point [m]."""
    h = terrain.heights
    if h.shape[0] == 0:
        return 0.0
    i, j, a, b = _cell(terrain, x, y)
    if a + b <= 1.0:
        return h[i, j] + a * (h[i + 1, j] - h[i, j]) + b * (h[i, j + 1] - h[i, j])
    return (h[i + 1, j + 1] + (1.0 - a) * (h[i, j + 1] - h[i + 1, j + 1])
            + (1.0 - b) * (h[i + 1, j] - h[i + 1, j + 1]))


@subroutine
def normal_at(terrain, x, y):
    """Compute the upward unit normal of the ground at a point, three numbers."""
    h = terrain.heights
    if h.shape[0] == 0:
        return 0.0, 0.0, 1.0
    i, j, a, b = _cell(terrain, x, y)
    if a + b <= 1.0:
        u, v = h[i + 1, j] - h[i, j], h[i, j + 1] - h[i, j]
    else:
        u, v = h[i + 1, j + 1] - h[i, j + 1], h[i + 1, j + 1] - h[i + 1, j]
    u, v = u / terrain.edge, v / terrain.edge
    columns, rows = h.shape
    if not terrain.low[0] <= x <= terrain.low[0] + (columns - 1) * terrain.edge:
        u = 0.0
    if not terrain.low[1] <= y <= terrain.low[1] + (rows - 1) * terrain.edge:
        v = 0.0
    scale = 1.0 / np.sqrt(u * u + v * v + 1.0)
    return -u * scale, -v * scale, scale


@kernel
def _heights(terrain, points):
    out = np.empty(len(points))
    for k in range(len(points)):
        out[k] = height_at(terrain, points[k, 0], points[k, 1])
    return out


@kernel
def _normals(terrain, points):
    out = np.empty((len(points), 3))
    for k in range(len(points)):
        out[k, 0], out[k, 1], out[k, 2] = normal_at(terrain, points[k, 0], points[k, 1])
    return out


@subroutine
def _next_line(place, way, count):
    """
    Compute the ray parameter at the first of the grid lines 0, 1, … count - 1.

    :param place: start of the ray, in line spacings.
    :param way: length of the ray, in line spacings.
    :returns: ray parameter at the first line, between lines, and half a line beyond the last one;
        inf = it crosses none.
    """
    if way == 0.0:
        return np.inf, np.inf, np.inf
    if way > 0.0:
        line = max(np.floor(place) + 1.0, 0.0)
        if line > count - 1.0:
            return np.inf, np.inf, np.inf
        beyond = count - 0.5
    else:
        line = min(np.ceil(place) - 1.0, count - 1.0)
        if line < 0.0:
            return np.inf, np.inf, np.inf
        beyond = -0.5
    return (line - place) / way, abs(1.0 / way), (beyond - place) / way


@kernel
def ray_range(terrain, bottom, top, x, y, z, dx, dy, dz, reach):
    """
    Compute the range of the ground along a ray from above [m], inf = the ray misses it.

    Along a ray the height over the ground is linear between grid lines and diagonals. They are
    traversed in order (Amanatides and Woo 1987, with the diagonals as a third set).

    :param bottom, top: see `Terrain.bounds`.
    :param x, y, z: origin [m].
    :param dx, dy, dz: direction, unit.
    :param reach: longest range [m].
    """
    h = terrain.heights
    if h.shape[0] == 0:
        return z / -dz if -dz * reach > z >= 0.0 and dz < 0.0 else np.inf
    start = 0.0 if z <= top else ((z - top) / -dz if dz < 0.0 else np.inf)
    end = reach if dz >= 0.0 else min(reach, (z - bottom) / -dz + terrain.edge)
    if not start < end:
        return np.inf
    if end == np.inf:  # level or upwards, out of the grid
        end = (top - z) / dz if dz > 0.0 else 0.0
        end = max(end, start) + terrain.edge * (h.shape[0] + h.shape[1]) + abs(
            x - terrain.low[0]) + abs(y - terrain.low[1])
    long = end - start
    u = (x + start * dx - terrain.low[0]) / terrain.edge
    v = (y + start * dy - terrain.low[1]) / terrain.edge
    du, dv = dx * long / terrain.edge, dy * long / terrain.edge
    a, to_a, past_a = _next_line(u, du, h.shape[0])
    b, to_b, past_b = _next_line(v, dv, h.shape[1])
    c, to_c, past_c = _next_line(u + v, du + dv, h.shape[0] + h.shape[1] - 1)
    s, over = start, z + start * dz - height_at(terrain, x + start * dx, y + start * dy)
    if over < 0.0:  # by rounding where the ray comes down on the highest ground, else from below
        return start if start > 0.0 else np.inf
    most = 2 * (h.shape[0] + h.shape[1]) + 4
    for _ in range(most):
        share = min(min(a, b), min(c, 1.0))
        t = start + share * long
        now = z + t * dz - height_at(terrain, x + t * dx, y + t * dy)
        if now < 0.0:
            return s + (t - s) * over / (over - now)
        if share >= 1.0:
            break
        s, over = t, now
        if a == share:
            a = a + to_a if a + to_a < past_a else np.inf
        if b == share:
            b = b + to_b if b + to_b < past_b else np.inf
        if c == share:
            c = c + to_c if c + to_c < past_c else np.inf
    return np.inf
