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


"""Backdrop: ground with a metre grid that fades into the horizon."""

import numpy as np

from procphys_ros.palette import rgba
from procphys_ros.render import light
from procphys_ros.render.mesh import Mesh

SKY_BOTTOM = np.array([0.87, 0.91, 0.94])
SKY_TOP = np.array([0.42, 0.62, 0.84])
SHADOW = 0.55  # brightness of the ground in shadow, over that in the sun
_SPOKES = 96
_RINGS = np.array([0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 40.0])  # radii over the scene's radius
_HAZE = np.array([0.0, 0.0, 0.15, 0.4, 0.7, 0.9, 1.0])  # share of sky colour at each ring
_LINES = 24  # about so many grid lines across the scene
_GRID_TONE = 0.90  # brightness of a grid line over that of the ground
_LIFT = 2e-4  # height of the grid above the ground, over the scene's radius


def ground_colour() -> np.ndarray:
    """Give the colour of sunlit ground, (3,)."""
    up = np.array([[0.0, 0.0, 1.0]])
    return np.asarray(rgba('ground')[:3]) * light.on_surfaces(up, np.ones(1), np.ones(1))[0]


def ground(low: np.ndarray, high: np.ndarray) -> list[tuple[Mesh, np.ndarray]]:
    """
    Build the ground and its grid as meshes with vertex colours.

    :param low, high: corners of the scene's box [m], (3,).
    """
    middle = 0.5 * (low + high)[:2]
    radius = max(1.0, 0.5 * float(np.linalg.norm(high - low)))
    return [_disc(middle, radius), _grid(middle, radius)]


def _disc(middle: np.ndarray, radius: float) -> tuple[Mesh, np.ndarray]:
    turn = np.linspace(0.0, 2.0 * np.pi, _SPOKES + 1)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    points = np.zeros((len(_RINGS), _SPOKES + 1, 3))
    points[..., :2] = middle + radius * _RINGS[:, None, None] * circle
    points[..., 2] = -2.0 * _LIFT * radius
    index = np.arange(len(_RINGS) * (_SPOKES + 1)).reshape(len(_RINGS), -1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3),
                            np.stack([a, c, d], -1).reshape(-1, 3)])
    haze = np.repeat(_HAZE, _SPOKES + 1)[:, None]
    return _flat(points.reshape(-1, 3), faces), (1 - haze) * ground_colour() + haze * SKY_BOTTOM


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
