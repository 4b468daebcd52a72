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

"""Layouts: places of the instances of one object in a row, on a grid, or scattered."""

from itertools import product
import math

import numpy as np

from procphys_ros.errors import SceneError

LAYOUTS = ('row', 'grid', 'scatter')

_SCATTER_CLEARANCE = 0.55  # smallest distance between scattered instances, as a share of spacing
_SCATTER_TRIES = 60  # throws per instance before the clearance is halved


def places(layout: str, count: int, spacing: float,
           rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """
    Place instances around the origin of their object.

    :param layout: one of `LAYOUTS`.
    :param count: number of instances.
    :param spacing: distance between neighbours [m]; of scattered ones the mean.
    :param rng: draws scattered places and headings.
    :returns: positions [m], (count, 2), and headings about the vertical [rad], (count,).
    :raises SceneError: when the layout is unknown.
    """
    if layout == 'row':
        offsets = (np.arange(count) - 0.5 * (count - 1)) * spacing
        return np.column_stack([offsets, np.zeros(count)]), np.zeros(count)
    if layout == 'grid':
        return _grid(count, spacing), np.zeros(count)
    if layout == 'scatter':
        return _scatter(count, spacing, rng), rng.uniform(-math.pi, math.pi, count)
    raise SceneError(f'layout "{layout}" is not known; use one of {", ".join(LAYOUTS)}')


def _grid(count: int, spacing: float) -> np.ndarray:
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    index = np.arange(count)
    cells = np.column_stack([index % columns, index // columns])
    return (cells - 0.5 * np.array([columns - 1, rows - 1])) * spacing


def _scatter(count: int, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Throw darts into a square of count·spacing² [m²], keeping a clearance between them."""
    half = 0.5 * spacing * math.sqrt(count)
    clearance = _SCATTER_CLEARANCE * spacing
    found = np.empty((count, 2))
    cells: dict[tuple[int, int], list[tuple[float, float]]] = {}  # of the clearance; those around
    for i in range(count):                                         # a point have all that is near
        for throw in range(1, 100 * _SCATTER_TRIES):
            x, y = rng.uniform(-half, half, 2).tolist()
            column, row = math.floor(x / clearance), math.floor(y / clearance)
            limit = clearance / (1 << throw // _SCATTER_TRIES)
            if all(np.square(x - other) + np.square(y - another) >= limit * limit
                   for place in product((column - 1, column, column + 1), (row - 1, row, row + 1))
                   for other, another in cells.get(place, ())):
                break
        cells.setdefault((column, row), []).append((x, y))
        found[i] = x, y
    return found
