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


"""Backdrop: ground with a metre grid that fades into the horizon, and the sky above it."""

import numpy as np

from procphys_ros.palette import rgba
from procphys_ros.render import light
from procphys_ros.render.mesh import Mesh

SKY_BOTTOM = np.array([0.87, 0.91, 0.94])
SKY_TOP = np.array([0.30, 0.53, 0.80])
SHADOW = 0.55  # brightness of the ground in shadow, over that in the sun
_SPOKES = 96
_RINGS = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0])  # radii over the scene's radius
_HAZE = np.array([0.0, 0.0, 0.15, 0.4, 0.7, 0.9, 1.0])  # share of sky colour at each ring
_SKY_RISE = np.array([0.0, 3.0, 7.0, 13.0, 22.0, 40.0, 90.0])  # [degrees]
_LINES = 24  # about so many grid lines across the scene
_GRID_TONE = 0.90  # brightness of a grid line over that of the ground
_LIFT = 2e-4  # height of the grid above the ground, over the scene's radius


def ground_colour() -> np.ndarray:
    """Give the colour of sunlit ground, (3,)."""
    up = np.array([[0.0, 0.0, 1.0]])
    return np.asarray(rgba('ground')[:3]) * light.on_surfaces(up, np.ones(1), np.ones(1))[0]


def backdrop(points: np.ndarray) -> list[tuple[Mesh, np.ndarray]]:
    """
    Build the sky, the ground and its grid as meshes with vertex colours.

    :param points: of the scene [m], (V, 3).
    """
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)[:2]
    radius = max(1.0, 0.5 * float(np.linalg.norm(high - low)))
    return [_sky(middle, radius), _disc(middle, radius), _grid(middle, radius)]


def _sky(middle: np.ndarray, radius: float) -> tuple[Mesh, np.ndarray]:
    rise = np.radians(_SKY_RISE)
    points, faces = _rings(np.cos(rise), np.sin(rise))
    points *= radius * _RINGS[-1]
    points[:, :2] += middle
    share = np.repeat(np.sin(rise) ** 0.6, _SPOKES + 1)[:, None]
    return _flat(points, faces), (1.0 - share) * SKY_BOTTOM + share * SKY_TOP


def _disc(middle: np.ndarray, radius: float) -> tuple[Mesh, np.ndarray]:
    points, faces = _rings(_RINGS, np.zeros(len(_RINGS)))
    points *= radius
    points += [*middle, -2.0 * _LIFT * radius]
    haze = np.repeat(_HAZE, _SPOKES + 1)[:, None]
    return _flat(points, faces), (1.0 - haze) * ground_colour() + haze * SKY_BOTTOM


def _rings(radii: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lay a surface of revolution around the vertical: points (V, 3) and triangles (F, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, _SPOKES + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    points = np.zeros((len(radii), _SPOKES + 1, 3))
    points[..., :2] = radii[:, None, None] * circle
    points[..., 2] = heights[:, None]
    index = np.arange(len(radii) * (_SPOKES + 1)).reshape(len(radii), -1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3),
                            np.stack([a, c, d], -1).reshape(-1, 3)])
    return points.reshape(-1, 3), faces


def _grid(middle: np.ndarray, radius: float) -> tuple[Mesh, np.ndarray]:
    """Lay lines at a round spacing (1, 2 or 5 times a power of ten) around the scene."""
    step = 2.0 * radius / _LINES
    power = 10.0 ** np.floor(np.log10(step))
    step = power * (1.0, 2.0, 5.0, 10.0)[int(np.searchsorted((1.0, 2.0, 5.0), step / power))]
    reach = np.ceil(1.6 * radius / step) * step
    ticks = np.arange(-reach, reach + 0.5 * step, step)
    start = np.round(middle / step) * step
    half = 0.012 * step
    quad = np.array([[-half, -reach], [half, -reach], [half, reach], [-half, reach]])
    along_y = quad + np.stack([ticks, 0 * ticks], -1)[:, None]
    flat = np.concatenate([along_y, along_y[..., ::-1]]).reshape(-1, 2) + start
    points = np.column_stack([flat, np.full(len(flat), -_LIFT * radius)])
    faces = (4 * np.arange(len(flat) // 4)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]]))
    return (_flat(points, faces.reshape(-1, 3)),
            np.tile(_GRID_TONE * ground_colour(), (len(points), 1)))


def _flat(points: np.ndarray, faces: np.ndarray) -> Mesh:
    return Mesh(points, faces, np.tile([0.0, 0.0, 1.0], (len(points), 1)),
                np.zeros((len(points), 2)), np.zeros(len(points), int))
