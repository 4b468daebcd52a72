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


"""Skyline: grid of the heights of structures, for leaves and dust that settle on them."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.terrain import height_at as ground_at

_EDGE = 0.25   # [m] of a cell: distance from a wall at which leaves and dust stop
_MOST = 1000   # cells along an axis; beyond, they are larger
_LIFTED = 0.1  # [m] above the skyline: least height of points whose support is gone


class Skyline(NamedTuple):
    """
    Heights of structures over cells of the ground.

    :ivar tops: [m], (X, Y); 0, or over a terrain -inf, in empty cells.
    :ivar low: corner of the first cell [m], (2,).
    :ivar edge: of a cell [m].
    :ivar terrain: the surface of the ground.
    """

    tops: np.ndarray
    low: np.ndarray
    edge: float
    terrain: Terrain = FLAT

    @classmethod
    def over(cls, bounds: np.ndarray, terrain: Terrain = FLAT) -> 'Skyline':
        """
        Build the skyline of boxes.

        :param bounds: three minima, three maxima [m], (K, 6), world.
        :param terrain: the surface of the ground.
        """
        if not len(bounds):
            return OPEN._replace(terrain=terrain)
        low, high = bounds[:, :2].min(axis=0), bounds[:, 3:5].max(axis=0)
        edge = max(_EDGE, float((high - low).max()) / _MOST)
        tops = np.full(np.floor((high - low) / edge).astype(int) + 1,
                       0.0 if terrain.is_flat else -np.inf)
        _raise_tops(np.ascontiguousarray(bounds, float), low, edge, tops)
        return cls(tops, low, edge, terrain)

    def left_in_the_air(self, points: np.ndarray) -> np.ndarray:
        """Mark the settled points, (K, 3), whose support is gone, (K,) bool."""
        return _left(self, np.ascontiguousarray(points, float))


OPEN = Skyline(np.zeros((0, 0)), np.zeros(2), _EDGE)  # without structures


@kernel
def _raise_tops(bounds, low, edge, tops):
    """Raise all cells that a box covers, also partly, to its top."""
    for k in range(len(bounds)):
        for x in range(int((bounds[k, 0] - low[0]) / edge),
                       int((bounds[k, 3] - low[0]) / edge) + 1):
            for y in range(int((bounds[k, 1] - low[1]) / edge),
                           int((bounds[k, 4] - low[1]) / edge) + 1):
                tops[x, y] = max(tops[x, y], bounds[k, 5])


@kernel
def height_at(skyline, x, y):
    """Return the height of structures, or of the ground, at a point [m]."""
    return max(_built(skyline, x, y), ground_at(skyline.terrain, x, y))


@subroutine
def _built(skyline, x, y):
    """Return the height of structures at a point [m]."""
    column = np.floor((x - skyline.low[0]) / skyline.edge)
    row = np.floor((y - skyline.low[1]) / skyline.edge)
    if (column < 0 or row < 0 or column >= skyline.tops.shape[0]
            or row >= skyline.tops.shape[1]):
        return 0.0 if skyline.terrain.heights.shape[0] == 0 else -np.inf
    return skyline.tops[int(column), int(row)]


@kernel
def _left(skyline, points):
    out = np.zeros(len(points), np.bool_)
    for k in range(len(points)):
        out[k] = points[k, 2] > height_at(skyline, points[k, 0], points[k, 1]) + _LIFTED
    return out


@kernel
def keep_out(skyline, before, x, y, z):
    """
    Keep a moving point out of structures: stop it at their sides, or on top of them.

    Points already below a top, as in a room or under eaves, move freely.

    :param before: previous position, three coordinates [m].
    :param x, y, z: new position without structures [m].
    :returns: corrected horizontal position, and the height of the surface below it [m].
    """
    floor = height_at(skyline, before[0], before[1])
    ground = ground_at(skyline.terrain, x, y)
    top = _built(skyline, x, y)
    if before[2] < floor or top <= ground:
        return x, y, ground
    if z >= top or before[2] >= top:
        return x, y, top
    return before[0], before[1], floor
