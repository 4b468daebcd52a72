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


"""Paving of a plan's streets: roads and pavements, cut at each other and laid onto the terrain."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from procphys_ros.appearance.paving import Paving
from procphys_ros.errors import SceneError
from procphys_ros.geometry.linear import product
from procphys_ros.physics.terrain import Terrain
from procphys_ros.scene.plan import Street

_LIFT = 0.02  # [m] over the ground, against z-fighting
_LEAST = 1e-6  # [m²] of a piece
_MOST_CELLS = 20_000  # of a terrain that one plan's streets may cover


def pave(streets: Sequence[Street], terrain: Terrain, origin: np.ndarray,
         turn: np.ndarray, where: str) -> list[Paving]:
    """
    Lay the surfaces of streets; where two cross, the first one's road continues.

    :param streets: of a plan.
    :param terrain: that they lie on.
    :param origin: of the plan [m], (2,), world.
    :param turn: its attitude, (2, 2).
    :param where: file, for messages.
    :raises SceneError: when they cover too many cells of the terrain.
    """
    surfaces = [(s.surface, s.strip(-0.5 * s.width, 0.5 * s.width)) for s in streets
                if s.surface and s.width > 0.0]
    for s in streets:
        if s.pavement > 0.0:
            kerb, end = 0.5 * s.width, 0.5 * s.width + s.pavement
            surfaces += [(s.pavement_surface, s.strip(kerb, end)),
                         (s.pavement_surface, s.strip(-end, -kerb))]
    laid: list[np.ndarray] = []
    bounds = np.zeros((len(surfaces), 2, 2))  # of those that are laid
    pieces: dict[str, list[np.ndarray]] = {}
    for texture, corners in surfaces:
        outline = np.asarray(origin) + product(corners, turn.T)
        left = [outline]
        low, high = outline.min(axis=0), outline.max(axis=0)
        near = np.flatnonzero((bounds[:len(laid), 0] < high).all(axis=1)
                              & (bounds[:len(laid), 1] > low).all(axis=1))
        for k in near.tolist():
            left = [rest for piece in left for rest in without(piece, laid[k])]
        bounds[len(laid)] = low, high
        laid.append(outline)
        pieces.setdefault(texture, []).extend(left)
    area = sum(_area(piece) for group in pieces.values() for piece in group)
    if not terrain.is_flat and area > _MOST_CELLS * (terrain.edge * terrain.edge):
        raise SceneError(
            f'{where}: the surfaces of the streets cover {area:.0f} m², on a terrain in cells of '
            f'{terrain.edge:g} m at most {_MOST_CELLS * np.square(terrain.edge):.0f} m²; make '
            'terrain.cell larger, or leave out some surface')
    return [_laid_on(terrain, texture, group) for texture, group in pieces.items() if group]


def without(piece: np.ndarray, other: np.ndarray) -> Iterator[np.ndarray]:
    """
    Subtract a convex polygon from another one; yield the rest as convex polygons.

    :param piece: corners, (K, 2), counterclockwise; other likewise.
    """
    for start, end in zip(other, np.roll(other, -1, axis=0)):
        along = end - start
        side = product(piece - start, np.array([along[1], -along[0]]))  # positive: outside
        outside, piece = _cut(piece, side), _cut(piece, -side)
        if _area(outside) > _LEAST:
            yield outside
        if _area(piece) <= _LEAST:
            return


def _laid_on(terrain: Terrain, texture: str, pieces: Iterable[np.ndarray]) -> Paving:
    """Cut polygons along the edges of a terrain's triangles, and lift them to its height."""
    if not terrain.is_flat:
        for way in ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0)):
            normal = np.array(way) / terrain.edge
            pieces = [part for piece in pieces
                      for part in _split(piece, product(piece - terrain.low, normal))]
    pieces = list(pieces)
    corners = np.concatenate(pieces)
    starts = np.cumsum([0, *(len(piece) for piece in pieces[:-1])])
    faces = np.concatenate([[[start, start + i, start + i + 1] for i in range(1, len(piece) - 1)]
                            for start, piece in zip(starts, pieces)])
    plan, index = np.unique(corners.round(6), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)  # slivers have lost a corner
    points = np.column_stack([plan, terrain.height(plan) + _LIFT])
    return Paving(texture, points, faces[whole])


def _split(piece: np.ndarray, level: np.ndarray) -> Iterator[np.ndarray]:
    """Cut a polygon wherever a value that is linear over it is a whole number."""
    rows = np.column_stack([piece, level])
    for line in range(int(np.floor(level.min())) + 1, int(np.ceil(level.max()))):
        below = _cut(rows, line - rows[:, 2])
        rows = _cut(rows, rows[:, 2] - line)
        if _area(below[:, :2]) > _LEAST:
            yield below[:, :2]
    if _area(rows[:, :2]) > _LEAST:
        yield rows[:, :2]


def _cut(values: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Keep the part of a polygon where side is not negative; values are linear along edges."""
    kept = []
    for i in range(len(values)):
        a, b = side[i - 1], side[i]
        if a * b < 0.0:
            kept.append(values[i - 1] + (values[i] - values[i - 1]) * (a / (a - b)))
        if b >= 0.0:
            kept.append(values[i])
    return np.array(kept).reshape(-1, values.shape[1])


def _area(polygon: np.ndarray) -> float:
    if len(polygon) < 3:
        return 0.0
    x, y = (polygon - polygon[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
