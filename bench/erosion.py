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
Measure erosion: processor time by size of the grid, and what fewer or more steps of rain change.

Run `python bench/erosion.py`. Times are without compiling, on one core.
"""

from time import process_time

import numpy as np

from procphys_ros.physics import erosion
from procphys_ros.scene.terrain import make_terrain, TerrainSettings

_HILLS = {'noise': 8.0, 'wavelength': 70.0, 'seed': 1}
_SIZES = (129, 257, 512, 1025)  # [corners]
_STEPS = (512, 256, 128, 64, 32)


def _worn(corners: int, hours: float) -> tuple[np.ndarray, float]:
    """Make worn hills; returns heights [m], and the processor time of it [s]."""
    settings = TerrainSettings(extent=corners - 1.0, erosion=hours, **_HILLS)
    start = process_time()
    return make_terrain(settings, 0).heights, process_time() - start


def main() -> None:
    """Print both tables."""
    _worn(5, 1.0)
    print('corners    seconds   of which hills')
    for corners in _SIZES:
        print(f'{corners:4d}²  {_worn(corners, 200.0)[1]:10.1f} {_worn(corners, 0.0)[1]:10.1f}')
    print(f'\nsteps   mean height [m]   mean difference from {_STEPS[0]} steps [m]')
    finest = None
    for erosion.STEPS in _STEPS:
        heights = _worn(257, 200.0)[0]
        finest = heights if finest is None else finest
        print(f'{erosion.STEPS:5d} {heights.mean():12.3f} '
              f'{np.abs(heights - finest).mean():12.3f}')


if __name__ == '__main__':
    main()
