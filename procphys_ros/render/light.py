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


"""Light: sun, sky and the shade inside crowns."""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros.appearance.palette import rgba
from procphys_ros.scene.scenery import SkySettings, SunSettings

SUN = np.array([-0.45, -0.62, 0.64]) / np.linalg.norm([-0.45, -0.62, 0.64])  # towards the sun
ZENITH = np.array([0.0, 0.0, 1.0])
# Unit vectors to five parts of the sky of about equal size: zenith, and 30 degrees high around.
SKY = np.vstack([ZENITH, [[x, y, 0.5] for x, y in 0.75 ** 0.5 * np.array(
    [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])]])
_SUNSHINE = np.array([0.80, 0.76, 0.66])  # colour of full sun on a surface that faces it
_SKYLIGHT = np.array([0.46, 0.50, 0.57])  # colour from the open sky above
SKY_LOW = np.array([0.87, 0.91, 0.94])  # colour of the clear sky at the horizon
SKY_HIGH = np.array([0.30, 0.53, 0.80])  # and at the zenith
# Vertical optical depth of clear air at red, green and blue (Rayleigh and thin haze).
_REDDENING = np.array([0.06, 0.12, 0.26])
EXTINCTION = 0.24  # of light per leaf area index (Beer-Lambert); clusters are full of gaps
_GAMMA = 2.2  # colours are display values; their powers are additive
_CELLS = 96  # cells of the shade grid along its longest side
_SMALLEST_CELL = 0.35  # [m]


class Shade:
    """
    Light from one direction that the leaves of a scene transmit.

    The leaf area is gathered in cells and summed along the ray: exp(-k * leaf area index).

    :param leaves: centres of the leaves [m], (L, 3).
    :param area: of each leaf [m²], (L,).
    :param towards: unit vector to the light, (3,).
    """

    def __init__(self, leaves: np.ndarray, area: np.ndarray, towards: np.ndarray):
        side = np.cross(towards, [0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        self._axes = np.stack([side, np.cross(towards, side), towards])
        if len(leaves) == 0:
            leaves, area = np.zeros((1, 3)), np.zeros(1)
        spots = leaves @ self._axes.T
        self._low = spots.min(axis=0)
        self._cell = max(_SMALLEST_CELL, float((spots.max(axis=0) - self._low).max()) / _CELLS)
        # Empty cells around, the lowest ones of which stand for all below.
        self._low -= self._cell * np.array([1.0, 1.0, 1.5])
        index = ((spots - self._low) / self._cell).astype(int)
        grid = np.zeros(index.max(axis=0) + 2)
        np.add.at(grid, tuple(index.T), area / self._cell ** 2)
        self._depth = np.cumsum(grid[..., ::-1], axis=2)[..., ::-1] - 0.5 * grid

    def light(self, points: np.ndarray) -> np.ndarray:
        """
        Return the share of light transmitted to each point, 0 to 1, (V,).

        :param points: [m], world, (V, 3).
        """
        where = ((points @ self._axes.T - self._low) / self._cell - 0.5).T
        where[2] = np.maximum(where[2], 0.0)
        index = scipy.ndimage.map_coordinates(self._depth, where, order=1, mode='constant')
        return np.exp(-EXTINCTION * index)


def crown_middles(positions: np.ndarray, links: np.ndarray, carriers: np.ndarray) -> np.ndarray:
    """
    Return for every part the middle of the crown of its plant [m], (N, 3).

    Leaves are lit as if their crown were one rounded body, which shows its volume; the normals of
    single leaves would look like noise.

    :param positions: of the parts [m], (N, 3).
    :param links: pairs of connected parts, (M, 2).
    :param carriers: part of each leaf, (L,).
    """
    count = len(positions)
    graph = scipy.sparse.coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])),
                                   shape=(count, count))
    plant = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    weight = np.bincount(plant[carriers], minlength=count)
    total = np.stack([np.bincount(plant[carriers], positions[carriers, axis], minlength=count)
                      for axis in range(3)], axis=-1)
    return (total / np.maximum(weight, 1)[:, None])[plant]


@dataclass(frozen=True)
class Daylight:
    """
    Light of sun and sky.

    :ivar towards: unit vector to the sun, (3,).
    :ivar sunshine: colour of full sun on a surface that faces it, (3,).
    :ivar skylight: colour from the open sky above, (3,).
    :ivar bounce: colour of the light reflected by the ground, (3,).
    :ivar low, high: colour of the sky at the horizon and at the zenith, (3,).
    """

    towards: np.ndarray
    sunshine: np.ndarray
    skylight: np.ndarray
    bounce: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, sun: SunSettings, sky: SkySettings) -> 'Daylight':
        """
        Compute the light of a day.

        :param sun: its position.
        :param sky: its cloudiness.
        """
        azimuth, elevation = np.radians(sun.azimuth), np.radians(sun.elevation)
        towards = np.array([np.sin(azimuth) * np.cos(elevation),
                            np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
        # The longer the path through the air, the redder the sun; see the comment at `_REDDENING`.
        air = 1.0 / max(towards[2], 0.05) - 1.0 / np.sin(np.radians(40.0))
        clear = np.exp(-_REDDENING * air)
        covered = sky.clouds ** 3  # scattered clouds leave the sun; a closed cover removes it
        sunshine = sun.strength * (1.0 - 0.85 * covered) * clear * _SUNSHINE
        grey = 0.35 * covered
        skylight = ((1.0 - grey) * _SKYLIGHT + grey * _SKYLIGHT.mean()) * (1.0 + 0.55 * covered)
        dusk = np.clip(clear, 0.0, 1.0) ** 0.5
        dim = 1.0 - 0.22 * covered
        low = dim * ((1.0 - grey) * SKY_LOW + grey * SKY_LOW.mean()) * (0.4 + 0.6 * dusk)
        high = dim * ((1.0 - grey) * SKY_HIGH + grey * 0.7) * (0.25 + 0.75 * dusk.min())
        skylight = skylight * (0.35 + 0.65 * dusk.min())
        level = (max(towards[2], 0.0) * sunshine) ** _GAMMA + skylight ** _GAMMA
        bounce = np.array(rgba('ground')[:3]) * level ** (1.0 / _GAMMA)
        return cls(towards, sunshine, skylight, bounce, low, high)
