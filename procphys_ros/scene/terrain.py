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


"""Terrain of a scene: settings, heights made up from noise, and rain that wears them."""

from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np

from procphys_ros.elementary import cos, power, sin
from procphys_ros.errors import SceneError
from procphys_ros.physics.erosion import erode, Rain, SOILS
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.scene.height_file import MOST_CORNERS, read_heights
from procphys_ros.schema import declared, ParameterGroup

_OCTAVES = 4   # of noise, each of half the wavelength of the one before
_LESS = 0.35   # of its height, so that small hills are not as steep as large ones
_WAVES = 24    # per octave; with fewer, hills line up


@dataclass(frozen=True)
class TerrainSettings(ParameterGroup, group='terrain'):
    """
    Shape of the ground; without a file and without noise it is the plane z = 0.

    Heights count from the lowest point of the grid, which is z = 0.
    """

    file: str = declared('', 'heights of the ground: a PNG, NPZ or ESRI ASCII grid (.asc) beside '
                         'the scene file, or a path; empty = none')
    cell: float = declared(1.0, 'edge of a cell of terrain.file, where that does not say it, and '
                           'of made-up hills', 'm', 0.1, 1000.0)
    height: float = declared(10.0, 'height of white over black in a PNG', 'm', 0.0, 5000.0)
    noise: float = declared(0.0, 'height of made-up hills over their valleys; 0 = none', 'm', 0.0,
                            500.0)
    wavelength: float = declared(40.0, 'of the largest made-up hills', 'm', 1.0, 1e4)
    extent: float = declared(160.0, 'side of the square that has made-up hills', 'm', 4.0, 1e4)
    seed: int = declared(-1, 'of made-up hills and of patches of harder soil; -1 = from the seed '
                         'of the scene', '', -1, 2**62)
    erosion: float = declared(0.0, 'how long rain has worn the ground, of a file or of hills; 0 = '
                              'never', 'h', 0.0, 1e4)
    rain: float = declared(50.0, 'how fast that rain fell', 'mm/h', 1.0, 500.0)
    soil: str = declared('loam', 'what that ground was made of', choices=tuple(SOILS))
    center: tuple[float, ...] = declared(
        (0.0, 0.0), 'where the middle of the terrain lies', 'm', -1e6, 1e6)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.file and self.noise > 0.0:
            raise SceneError('terrain: give either terrain.file or terrain.noise, not both')
        if self.erosion > 0.0 and not self.file and self.noise == 0.0:
            raise SceneError('terrain: terrain.erosion wears the ground of terrain.file or '
                             'terrain.noise; give one of them')
        if self.noise > 0.0 and np.square(self.extent / self.cell + 1.0) > MOST_CORNERS:
            raise SceneError(f'terrain: terrain.extent {self.extent:g} m in cells of '
                             f'{self.cell:g} m makes more than {MOST_CORNERS} heights; make '
                             'terrain.cell larger')


def make_terrain(settings: TerrainSettings, seed: int, beside: Path | None = None) -> Terrain:
    """
    Read or generate the terrain.

    :param seed: of the scene.
    :param beside: folder of the scene file, searched first; None = there is none.
    :raises SceneError: when the file cannot be read, the message names it and what is allowed; or
        when the ground is too steep to be worn.
    """
    cell = settings.cell
    seed = settings.seed if settings.seed >= 0 else seed
    if settings.file:
        heights, own = read_heights(settings.file, beside, settings.height)
        cell = own or cell
    elif settings.noise > 0.0:
        heights = _hills(settings, seed)
    else:
        return FLAT
    if settings.erosion > 0.0:
        heights = _worn(heights, cell, settings, seed)
    heights = np.ascontiguousarray(heights - heights.min())
    middle = 0.5 * cell * (np.array(heights.shape) - 1.0)
    return Terrain(heights, np.asarray(settings.center, float) - middle, cell)


def _worn(heights: np.ndarray, cell: float, settings: TerrainSettings, seed: int) -> np.ndarray:
    """Let rain wear heights [m]."""
    soil = SOILS[settings.soil]
    eroded = erode(heights, cell, Rain(settings.rain * 1e-3 / 3600.0, settings.erosion * 3600.0),
                   soil, np.random.default_rng([seed, 15]))
    if not eroded.settled:
        raise SceneError(f'terrain: {settings.soil} stands at up to {np.degrees(soil.repose):g} '
                         'degrees, and the ground is so much steeper that terrain.erosion moves '
                         'too much of it; make it lower (terrain.noise, terrain.height), or '
                         'longer (terrain.wavelength, terrain.cell)')
    return eroded.heights


def _hills(settings: TerrainSettings, seed: int) -> np.ndarray:
    """Sum waves of random direction and phase to hills that flatten out at the edges [m]."""
    rng = np.random.default_rng([seed, 14])
    count = max(int(settings.extent / settings.cell), 3) + 1
    along = settings.cell * (np.arange(count) - 0.5 * (count - 1))
    x, y = np.meshgrid(along, along, indexing='ij')
    heights = np.zeros((count, count))
    for octave in range(_OCTAVES):
        number = 2.0 * math.pi * (1 << octave) / settings.wavelength
        for angle, phase in rng.uniform(0.0, 2.0 * math.pi, (_WAVES, 2)):
            heights += power(_LESS, octave) * cos(
                number * (x * cos(angle) + y * sin(angle)) + phase)
    inside = 0.5 * (count - 1) * settings.cell - np.abs(along)
    fade = np.square(sin(0.5 * math.pi * np.clip(inside / (0.2 * settings.extent), 0.0, 1.0)))
    heights = (heights - heights.min()) * fade[:, None] * fade
    return heights * settings.noise / max(float(np.ptp(heights)), 1e-9)
