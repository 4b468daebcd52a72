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

"""
Sky: the share of it that is seen past crowns, buildings and hills.

Light falls through cells of leaves and wood by the law of Beer and Lambert, exp(-G·a·s) for the
area a per volume [m²/m³] and the way s, with G = 1/2 for leaves and twigs in all directions (Monsi
and Saeki 1953; Ross 1981). All of the sky above the horizon counts alike, as under an evenly
overcast sky.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros import elementary
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.compilation.threads import even_ranges, run
from procphys_ros.elementary import functions
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import product
from procphys_ros.physics.loads.snow import LEAF_PLAN
from procphys_ros.physics.terrain import Terrain

DIRECTIONS = 60      # looked at per query: the resolution of the answer is 1/60 of the sky
CELL = 0.25          # [m] edge of the cells, ...
_MOST = 8_000_000    # ... doubled until there are no more of them than this: 32 MB
_DARK = 20.0         # optical depth beyond which no light is left: exp(-20) is 2e-9
_HORIZON_STEP = 1.1  # ratio of the distances at which hills are looked for


class Cells(NamedTuple):
    """
    Cells of a space, by the area of leaves and wood in them.

    :ivar area: per volume [1/m], inf where something solid stands, (X, Y, Z).
    :ivar low: least corner [m], (3,).
    :ivar edge: of a cell [m].
    """

    area: np.ndarray
    low: np.ndarray
    edge: float

    @classmethod
    def around(cls, points: np.ndarray, poses: np.ndarray, sizes: np.ndarray) -> 'Cells':
        """Make empty cells around points, (N, 3), and boxes, (M, 7) and (M, 3) [m]."""
        reach = 0.5 * product(np.abs(rotation.to_matrix(poses[:, 3:])), sizes[:, :, None])[..., 0]
        every = np.concatenate([points, poses[:, :3] - reach, poses[:, :3] + reach])
        low, high = every.min(axis=0), every.max(axis=0)
        edge = CELL
        while (np.ceil((high - low) / edge) + 3.0).prod() > _MOST:
            edge *= 2.0
        low = edge * (np.floor(low / edge) - 1.0)
        shape = np.ceil((high - low) / edge).astype(int) + 1
        return cls(np.zeros(shape, np.float32), low, edge)

    def spread(self, points: np.ndarray, area: np.ndarray) -> None:
        """Add areas of leaves or wood at points inside [m²], (N,), (N, 3)."""
        _spread(np.ascontiguousarray(points), area, self.low, self.edge, self.area)

    def fill(self, poses: np.ndarray, sizes: np.ndarray) -> None:
        """Fill the cells that boxes reach, (N, 7) and (N, 3)."""
        axes = np.ascontiguousarray(rotation.to_matrix(poses[:, 3:]))
        _fill(poses, np.ascontiguousarray(sizes, float), axes, self.low, self.edge, self.area)

    def seen(self, points: np.ndarray, directions: np.ndarray, clear: np.ndarray,
             threads: int = 1) -> np.ndarray:
        """
        Compute the light that reaches points from directions.

        What is in the cell of a point itself takes no light from it.

        :param points: inside [m], (Q, 3).
        :param directions: unit vectors upwards, (D, 3).
        :param clear: whether no hill hides the sky in a direction, (Q, D) bool.
        :param threads: largest number of threads.
        :returns: share of it, (Q, D).
        """
        points, out = np.ascontiguousarray(points), np.zeros((len(points), len(directions)))

        def look(_: int, first: int, last: int) -> None:
            _look(points, directions, clear, self.area, self.low, self.edge, out, first, last)
        run(look, even_ranges(out.size, threads))
        return out


def sky_directions(count: int = DIRECTIONS) -> np.ndarray:
    """Spread directions over the upper hemisphere, of equal solid angles, (D, 3)."""
    number = np.arange(count)
    up = (number + 0.5) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number  # golden angle
    level = np.sqrt(1.0 - up * up)
    return np.column_stack([level * elementary.cos(turn), level * elementary.sin(turn), up])


def above_horizon(terrain: Terrain, place: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """
    Mark the directions in which no hill hides the sky from a place, (D,) bool.

    :param terrain: the surface of the ground.
    :param place: on it [m], (3,).
    :param directions: unit vectors upwards, (D, 3).
    """
    clear = np.ones(len(directions), bool)
    if terrain.is_flat:
        return clear
    reach = terrain.edge * float(max(terrain.heights.shape)) * np.sqrt(2.0)
    steps = np.arange(np.log(reach / terrain.edge) / np.log(_HORIZON_STEP) + 1.0)
    for way in terrain.edge * elementary.power(np.full(len(steps), _HORIZON_STEP), steps):
        ray = place + (way / np.maximum(np.sqrt(
            directions[:, :1] * directions[:, :1] + directions[:, 1:2] * directions[:, 1:2]),
            1e-9)) * directions
        clear &= terrain.height(ray) <= ray[:, 2]
    return clear


@kernel
def _spread(points, given, low, edge, area):
    """Add areas at points to the cells."""
    volume = edge * edge * edge
    for n in range(len(points)):
        area[int(np.floor((points[n, 0] - low[0]) / edge)),
             int(np.floor((points[n, 1] - low[1]) / edge)),
             int(np.floor((points[n, 2] - low[2]) / edge))] += given[n] / volume


@kernel
def _fill(poses, sizes, axes, low, edge, area):
    """Mark the cells of points that lie no more than half an edge apart in each box."""
    count, local, cell = np.empty(3, np.int64), np.empty(3), np.empty(3, np.int64)
    for n in range(len(poses)):
        for k in range(3):
            count[k] = int(np.ceil(2.0 * sizes[n, k] / edge)) + 1
        for number in range(count[0] * count[1] * count[2]):
            rest = number
            for k in range(3):
                local[k] = (rest % count[k] / max(count[k] - 1, 1) - 0.5) * sizes[n, k]
                rest //= count[k]
            inside = True
            for k in range(3):
                x = poses[n, k] - low[k]
                for m in range(3):
                    x += axes[n, k, m] * local[m]
                cell[k] = int(np.floor(x / edge))
                inside &= 0 <= cell[k] < area.shape[k]
            if inside:
                area[cell[0], cell[1], cell[2]] = np.inf


@subroutine
def _enter(point, way, low, edge, cell, step, next_at, apart):
    """Set up the walk of a ray through the cells, (3,) each (Amanatides and Woo 1987)."""
    for k in range(3):
        x = (point[k] - low[k]) / edge
        cell[k] = int(np.floor(x))
        step[k] = 1 if way[k] > 0.0 else -1
        apart[k], next_at[k] = np.inf, np.inf
        if abs(way[k]) > 1e-12:
            apart[k] = edge / abs(way[k])
            next_at[k] = (cell[k] + 1.0 - x if way[k] > 0.0 else x - cell[k]) * apart[k]


@kernel(nogil=True)
def _look(points, directions, clear, area, low, edge, out, first, last):
    """Follow rays, by number, from cell to cell until they are dark or leave."""
    cell, step = np.empty(3, np.int64), np.empty(3, np.int64)
    next_at, apart = np.empty(3), np.empty(3)
    for ray in range(first, last):
        n, d = ray // len(directions), ray % len(directions)
        if not clear[n, d]:
            continue
        _enter(points[n], directions[d], low, edge, cell, step, next_at, apart)
        depth, at = 0.0, np.inf  # the first cell takes nothing
        while depth <= _DARK:
            k = 0
            if next_at[1] < next_at[k]:
                k = 1
            if next_at[2] < next_at[k]:
                k = 2
            density = area[cell[0], cell[1], cell[2]]
            if density > 0.0 and next_at[k] > at:
                depth += LEAF_PLAN * density * (next_at[k] - at)
            at = next_at[k]
            next_at[k] += apart[k]
            cell[k] += step[k]
            if cell[k] < 0 or cell[k] >= area.shape[k]:
                break
        if depth <= _DARK:
            out[n, d] = functions.exp(-depth)
