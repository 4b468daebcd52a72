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
Wind by place: factors on the wind, from a map over the scene and in boxes.

Each place has three numbers: a factor on the velocity, a turn of its direction about the vertical,
and a factor on the intensity of the turbulence. A map has them at the nodes of a grid, linear
between these and constant beyond the outermost. Boxes are laid over it in their order, each in
full inside and fading out beyond its faces, so that nothing jumps, and overlaps stay in bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import cos, functions, sin
from procphys_ros.errors import SceneError
from procphys_ros.schema import clip, declared, ParameterGroup, read_words

FACTORS = ('speed', 'turn', 'turbulence')
COLUMNS = 12  # centre (3), half of the size (3), cosine, sine of the yaw, fade, `FACTORS`
MapRows = tuple[tuple[float, ...], ...]  # x, y, z [m], `FACTORS`
HIGHEST = 5.0  # factor
FARTHEST = 1e6  # [m]
TURN = 6.3  # [rad], once around
_MOST = 100  # boxes; each costs time at all points


@dataclass(frozen=True)
class WindZone(ParameterGroup):
    """
    Box in which the wind differs.

    :ivar position: of its middle [m], (3,), world; z counts from the ground below each point.
    :ivar size: [m], (3,), along its own axes.
    :ivar yaw: turn about the vertical [rad].
    :ivar fade: distance from its faces at which it has no effect any more [m].
    :ivar speed: factor on the velocity.
    :ivar turn: of the direction to the left, seen from above [rad].
    :ivar turbulence: factor on the intensity of the turbulence.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    position: Sequence[float] = declared((0.0, 0.0, 0.0), '', 'm', -FARTHEST, FARTHEST)
    size: Sequence[float] = declared((0.0, 0.0, 0.0), '', 'm', 0.01, FARTHEST)
    yaw: float = declared(0.0, '', 'rad', -1e3, 1e3)
    fade: float = declared(1.0, '', 'm', 0.01, FARTHEST)
    speed: float = declared(1.0, '', '', 0.0, HIGHEST)
    turn: float = declared(0.0, '', 'rad', -TURN, TURN)
    turbulence: float = declared(1.0, '', '', 0.0, HIGHEST)


def zone_rows(texts: Sequence[str]) -> np.ndarray:
    """
    Read boxes.

    :param texts: of each 'name=value …', as the fields of `WindZone`.
    :returns: one row each, (Z, COLUMNS).
    :raises SceneError: naming the box, the fault and what is allowed.
    """
    if len(texts) > _MOST:
        raise SceneError(f'wind.zones has {len(texts)} boxes, they must be {_MOST} or fewer')
    rows = np.empty((len(texts), COLUMNS))
    for number, text in enumerate(texts):
        try:
            zone = WindZone(**read_words(text.split(), WindZone))
        except SceneError as error:
            raise SceneError(f'wind.zones[{number}] "{clip(text)}": {error}') from None
        rows[number] = (*zone.position, *(0.5 * edge for edge in zone.size), cos(zone.yaw),
                        sin(zone.yaw), zone.fade, zone.speed, zone.turn, zone.turbulence)
    return rows


def map_nodes(rows: MapRows) -> np.ndarray:
    """
    Arrange the rows of a map.

    :returns: nodes in ascending order, (X, Y, Z, 6).
    :raises SceneError: when they are not all nodes of a grid, once each.
    """
    table = np.array(rows, float).reshape(-1, 6)
    shape = tuple(len(np.unique(axis)) for axis in table[:, :3].T)
    nodes = table[np.lexsort(table[:, 2::-1].T)]
    if len(nodes) != np.prod(shape) or not np.diff(nodes[:, :3], axis=0).any(axis=1).all():
        raise SceneError(f'{len(nodes)} rows with {", ".join(map(str, shape))} different x, y, z '
                         'are no grid; each of these must stand with each other one, once')
    return nodes.reshape(*shape, 6)


@kernel
def find_factors(points, nodes, zones):
    """
    Return the factors at points.

    :param points: [m], (N, 3), world, z above the ground.
    :param nodes: of `map_nodes`.
    :param zones: of `zone_rows`.
    :returns: `FACTORS` of each, (N, 3).
    """
    out = np.empty((len(points), 3))
    for i in range(len(points)):
        out[i, 0], out[i, 1], out[i, 2] = 1.0, 0.0, 1.0
        if nodes.size:
            _interpolate(points[i], nodes, out[i])
        for j in range(len(zones)):
            share = _share(points[i, 0], points[i, 1], points[i, 2], zones, j)
            if share > 0.0:
                for k in range(3):
                    out[i, k] += share * (zones[j, 9 + k] - out[i, k])
    return out


@kernel
def turn_wind(air, factors):
    """Turn velocities about the vertical, (N, 3), and scale them; see `find_factors`."""
    for i in range(len(air)):
        c, s = functions.cos(factors[i, 1]), functions.sin(factors[i, 1])
        x, y = air[i, 0], air[i, 1]
        air[i, 0], air[i, 1] = factors[i, 0] * (c * x - s * y), factors[i, 0] * (s * x + c * y)
        air[i, 2] *= factors[i, 0]


@subroutine
def _share(px, py, pz, zones, j):
    """Return 1 inside of a box, 0 beyond its fade, linear in the distance between."""
    x, y, fade = px - zones[j, 0], py - zones[j, 1], zones[j, 8]
    dx = max(abs(zones[j, 6] * x + zones[j, 7] * y) - zones[j, 3], 0.0)
    dy = max(abs(zones[j, 6] * y - zones[j, 7] * x) - zones[j, 4], 0.0)
    dz = max(abs(pz - zones[j, 2]) - zones[j, 5], 0.0)
    square = dx * dx + dy * dy + dz * dz
    return 1.0 - np.sqrt(square) / fade if square < fade * fade else 0.0


@subroutine
def _interpolate(point, nodes, out):
    """Write the factors of a map at a point."""
    i, u = _cell(nodes[:, 0, 0, 0], point[0])
    j, v = _cell(nodes[0, :, 0, 1], point[1])
    k, w = _cell(nodes[0, 0, :, 2], point[2])
    for c in range(3):
        total = 0.0
        for corner in range(8):
            a, b, d = corner & 1, corner >> 1 & 1, corner >> 2
            share = (u if a else 1.0 - u) * (v if b else 1.0 - v) * (w if d else 1.0 - w)
            if share > 0.0:
                total += share * nodes[i + a, j + b, k + d, 3 + c]
        out[c] = total


@subroutine
def _cell(axis, value):
    """Return the last node before a value, and the share of the way to the next."""
    if len(axis) < 2 or not value > axis[0]:
        return 0, 0.0
    low, high = 0, len(axis) - 1
    if value >= axis[high]:
        return high, 0.0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if axis[middle] <= value else (low, middle)
    return low, (value - axis[low]) / (axis[high] - axis[low])
