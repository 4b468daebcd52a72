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
Snow: what crowns, roofs and ledges catch of it, while it falls straight down.

Crowns let pass exp(-G·L) of it, for the leaf area L above a unit of ground (Beer and Lambert, as
light; G = 1/2 for leaves in all directions). What they hold has been found not to depend on what
they hold already (Cebulski and Pomeroy 2025, Snow interception relationships with meteorology and
canopy structure in a subalpine forest), so that catching areas do not depend on the load, either.

Of what falls on a roof, snow of the share μ stays (EN 1991-1-3, 5.3.3, table 5.2, duopitch).
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import acos, expm1, functions
from procphys_ros.geometry import rotation

LEAF_PLAN = 0.5       # G: area of leaves in all directions across a direction, over one side
ICE_DENSITY = 900.0   # [kg/m³] of glaze (ISO 12494, table 1)
_SPREAD = 0.3         # [m] about a twig, in which its leaves spread: beyond it they shade nothing
_EDGE = 0.1           # [m] of the columns of snow that roofs are looked at in: less than a tile
_MOST = 4_000_000     # columns; beyond, they are doubled: 64 MB
_FLATTEST, _STEEPEST = np.pi / 6.0, np.pi / 3.0  # [rad] slopes between which μ falls to 0, ...
_LEVEL = 0.8          # ... and that of flatter ones


class Tops(NamedTuple):
    """
    Topmost surfaces of boxes, a column of snow each.

    :ivar height: [m], (X, Y); -inf where there is none.
    :ivar box: number of the box, (X, Y); -1 where there is none.
    :ivar upward: vertical component of the normal there, (X, Y).
    :ivar low: least corner of the columns [m], (2,).
    :ivar edge: of a column [m].
    """

    height: np.ndarray
    box: np.ndarray
    upward: np.ndarray
    low: np.ndarray
    edge: float

    @classmethod
    def over(cls, poses: np.ndarray, sizes: np.ndarray) -> 'Tops':
        """Find those of boxes, (K, 7) and (K, 3) [m]."""
        axes = np.ascontiguousarray(rotation.to_matrix(poses[:, 3:]))
        reach = 0.5 * (np.abs(axes[:, :2]) * sizes[:, None, :]).sum(axis=2)
        low = (poses[:, :2] - reach).min(axis=0, initial=np.inf)
        high = (poses[:, :2] + reach).max(axis=0, initial=-np.inf)
        if not len(poses):
            low = high = np.zeros(2)
        edge = _EDGE
        while ((high - low) / edge + 1.0).prod() > _MOST:
            edge *= 2.0
        shape = tuple(((high - low) / edge).astype(int) + 1)
        tops = cls(np.full(shape, -np.inf), np.full(shape, -1, np.int64), np.zeros(shape), low,
                   edge)
        _look_down(np.ascontiguousarray(poses), np.ascontiguousarray(sizes, float), axes, reach,
                   tops)
        return tops

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the boxes of the columns that end on one, and where they do [m], (M, 3)."""
        x, y = np.nonzero(self.box >= 0)
        place = self.low + self.edge * (np.column_stack([x, y]) + 0.5)
        return self.box[x, y], np.column_stack([place, self.height[x, y]])

    def areas(self) -> np.ndarray:
        """Return the areas of open ground whose snow stays on them [m²], (M,)."""
        upward = self.upward[self.box >= 0]
        return self.edge * self.edge * shape_coefficient(acos(np.minimum(upward, 1.0)))

    def cover(self, points: np.ndarray) -> np.ndarray:
        """Mark the points that are below a box, (N, 3), (N,) bool."""
        place = np.floor((points[:, :2] - self.low) / self.edge).astype(int)
        inside = ((place >= 0) & (place < self.height.shape)).all(axis=1)
        out = np.zeros(len(points), bool)
        x, y = place[inside].T
        out[inside] = self.height[x, y] > points[inside, 2]
        return out


def shape_coefficient(slope: np.ndarray) -> np.ndarray:
    """Return μ: the share of the snow of open ground that stays on a slope [rad]."""
    return _LEVEL * np.clip((_STEEPEST - slope) / (_STEEPEST - _FLATTEST), 0.0, 1.0)


def segment_points(poses: np.ndarray,
                   lengths: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Divide segments so finely that their leaves spread over what is between the points.

    :param poses: of their middles, z along them [m], (S, 7).
    :param lengths: [m], (S,).
    :returns: the segment of each point, (P,), the points [m], (P, 3), and the number of those of
        each segment, (S,).
    """
    count = np.ceil(lengths / _SPREAD).astype(int)
    count = np.maximum(count, 1)
    segment = np.repeat(np.arange(len(poses)), count)
    number = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    along = ((number + 0.5) / count[segment] - 0.5) * lengths[segment]
    axis = rotation.rotate(poses[segment, 3:], np.array([0.0, 0.0, 1.0]))
    return segment, poses[segment, :3] + along[:, None] * axis, count


def plan_areas(poses: np.ndarray, lengths: np.ndarray, widths: np.ndarray,
               leaves: np.ndarray) -> np.ndarray:
    """
    Compute the areas of segments and their leaves as seen from above [m²], (S,).

    :param poses: z along them, (S, 7).
    :param lengths, widths: [m], (S,).
    :param leaves: one-sided area [m²], (S,).
    """
    upright = np.abs(rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2])
    level = np.sqrt(np.maximum(1.0 - upright * upright, 0.0))
    return (lengths * widths * level + 0.25 * np.pi * widths * widths * upright
            + LEAF_PLAN * leaves)


def glaze(thickness: float, lengths: np.ndarray, widths: np.ndarray,
          leaves: np.ndarray) -> np.ndarray:
    """
    Compute the mass of a coat of ice around segments and on one side of their leaves [kg], (S,).

    :param thickness: of the coat [m].
    :param lengths, widths, leaves: see `plan_areas`.
    """
    return ICE_DENSITY * thickness * (np.pi * (widths + thickness) * lengths + leaves)


def passed(places: np.ndarray, points: np.ndarray, plan: np.ndarray) -> np.ndarray:
    """
    Compute the share of the snow that crowns let pass to places, (Q,).

    :param places: [m], (Q, 3).
    :param points: of crowns [m], (P, 3).
    :param plan: area at each of them, seen from above [m²], (P,).
    """
    out = np.ones(len(places))
    if len(points) and len(places):
        low = points[:, :2].min(axis=0)
        cell = np.floor((points[:, :2] - low) / _SPREAD).astype(np.int64)
        wide = int(cell[:, 1].max()) + 1
        key = cell[:, 0] * wide + cell[:, 1]
        order = np.argsort(key, kind='stable')
        first = np.searchsorted(key[order], np.arange((int(cell[:, 0].max()) + 1) * wide + 1))
        _shade(np.ascontiguousarray(places), np.ascontiguousarray(points[order]), plan[order],
               first, low, wide, out)
    return out


def caught(points: np.ndarray, plan: np.ndarray, tops: Tops) -> np.ndarray:
    """
    Compute the areas of open ground whose snow crowns catch at their points [m²], (P,).

    :param points: [m], (P, 3).
    :param plan: area at each of them, seen from above [m²], (P,).
    :param tops: of what keeps the snow from them.
    """
    own = np.maximum(plan / (np.pi * _SPREAD * _SPREAD), 1e-12)
    mean = -expm1(-own) / own
    return plan * mean * passed(points, points, plan) * ~tops.cover(points)


@kernel
def _look_down(poses, sizes, axes, reach, tops):
    """Follow each column down to the topmost box in it."""
    height, box, upward, low, edge = tops
    for k in range(len(poses)):
        from_x = int(np.floor((poses[k, 0] - reach[k, 0] - low[0]) / edge))
        to_x = int(np.floor((poses[k, 0] + reach[k, 0] - low[0]) / edge))
        from_y = int(np.floor((poses[k, 1] - reach[k, 1] - low[1]) / edge))
        to_y = int(np.floor((poses[k, 1] + reach[k, 1] - low[1]) / edge))
        for i in range(max(from_x, 0), min(to_x, height.shape[0] - 1) + 1):
            for j in range(max(from_y, 0), min(to_y, height.shape[1] - 1) + 1):
                x = low[0] + edge * (i + 0.5) - poses[k, 0]
                y = low[1] + edge * (j + 0.5) - poses[k, 1]
                bottom, top, face = -np.inf, np.inf, -1
                for c in range(3):
                    here = axes[k, 0, c] * x + axes[k, 1, c] * y
                    rise, half = axes[k, 2, c], 0.5 * sizes[k, c]
                    if abs(rise) < 1e-9:
                        if abs(here) > half:
                            top = -np.inf
                        continue
                    one, other = (-half - here) / rise, (half - here) / rise
                    bottom = max(bottom, min(one, other))
                    if max(one, other) < top:
                        top, face = max(one, other), c
                if top > bottom and top + poses[k, 2] > height[i, j]:
                    height[i, j], box[i, j] = top + poses[k, 2], k
                    upward[i, j] = abs(axes[k, 2, face])


@kernel
def _shade(places, points, plan, first, low, wide, out):
    """Pass the snow through what spreads over each place and is above it."""
    deep = (len(first) - 1) // wide
    disk = np.pi * _SPREAD * _SPREAD
    for q in range(len(places)):
        x = int(np.floor((places[q, 0] - low[0]) / _SPREAD))
        y = int(np.floor((places[q, 1] - low[1]) / _SPREAD))
        area = 0.0
        for i in range(max(x - 1, 0), min(x + 1, deep - 1) + 1):
            for j in range(max(y - 1, 0), min(y + 1, wide - 1) + 1):
                for n in range(first[i * wide + j], first[i * wide + j + 1]):
                    if points[n, 2] > places[q, 2]:
                        u, v = points[n, 0] - places[q, 0], points[n, 1] - places[q, 1]
                        if u * u + v * v < _SPREAD * _SPREAD:
                            area += plan[n]
        out[q] = functions.exp(-area / disk)
