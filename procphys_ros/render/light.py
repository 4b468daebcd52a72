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


"""Light: sun, sky and the shade inside crowns, worked out per vertex before drawing."""

import numpy as np
from scipy.ndimage import map_coordinates

SUN = np.array([-0.45, -0.62, 0.64]) / np.linalg.norm([-0.45, -0.62, 0.64])  # towards the sun
_SUNSHINE = np.array([0.80, 0.76, 0.66])  # colour of full sun on a surface that faces it
_SKYLIGHT = np.array([0.40, 0.44, 0.50])  # colour from the open sky above
_BOUNCE = np.array([0.20, 0.20, 0.16])  # colour from the ground below
_THROUGH = 0.35  # share of sun that a leaf lets through to its far side
_EXTINCTION = 0.30  # of light per leaf area index (Beer-Lambert); clusters are full of gaps
_CELLS = 96  # cells of the shade grid along its longest side
_SMALLEST_CELL = 0.35  # [m]


def shade(points: np.ndarray, leaves: np.ndarray, area: np.ndarray,
          towards: np.ndarray) -> np.ndarray:
    """
    Tell how much light from one direction gets through the leaves to each point, 0 to 1.

    The leaf area is gathered in cells and summed along the ray: exp(-k * leaf area index).

    :param points: [m], (V, 3).
    :param leaves: centres of the leaves [m], (L, 3).
    :param area: of each leaf [m²], (L,).
    :param towards: unit vector to the light, (3,).
    """
    if len(leaves) == 0:
        return np.ones(len(points))
    side = np.cross(towards, [0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(towards, side), towards])
    spots = leaves @ axes.T
    low = spots.min(axis=0)
    cell = max(_SMALLEST_CELL, float((spots.max(axis=0) - low).max()) / _CELLS)
    index = ((spots - low) / cell).astype(int)
    grid = np.zeros(index.max(axis=0) + 2)
    np.add.at(grid, tuple(index.T), area / cell ** 2)
    depth = np.cumsum(grid[..., ::-1], axis=2)[..., ::-1] - 0.5 * grid
    where = ((points @ axes.T - low) / cell - 0.5).T
    where[2] = np.maximum(where[2], 0.0)  # below all leaves: everything above counts
    return np.exp(-_EXTINCTION * map_coordinates(depth, where, order=1, mode='constant'))


def on_surfaces(normals: np.ndarray, sun: np.ndarray, sky: np.ndarray) -> np.ndarray:
    """
    Give the light on opaque surfaces, rgb, (V, 3).

    :param normals: unit, (V, 3).
    :param sun, sky: share of their light that arrives, (V,).
    """
    facing = np.clip(normals @ SUN, 0.0, None) * sun
    up = 0.5 + 0.5 * normals[:, 2]
    return (facing[:, None] * _SUNSHINE + (up * sky)[:, None] * _SKYLIGHT
            + (1.0 - up)[:, None] * _BOUNCE)


def on_leaves(outward: np.ndarray, sun: np.ndarray, sky: np.ndarray) -> np.ndarray:
    """
    Give the light on leaves, rgb, (V, 3); they shine through and have no one normal.

    :param outward: unit vector out of the crown, (V, 3).
    :param sun, sky: share of their light that arrives, (V,).
    """
    facing = _THROUGH + (1.0 - _THROUGH) * np.clip(0.25 + 0.75 * (outward @ SUN), 0.0, 1.0)
    up = 0.6 + 0.4 * outward[:, 2]
    return ((facing * sun)[:, None] * _SUNSHINE * 1.25 + (up * sky)[:, None] * _SKYLIGHT
            + 0.5 * _BOUNCE)
