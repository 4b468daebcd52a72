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
Time the whole `Simulation.step` for a mixed stand of trees in a turbulent wind.

Prints the real-time factor and the share of each stage, medians over blocks of one second, and the
paper's sweep from 50 to 250 trees. Run: python bench/step.py
"""

from time import perf_counter

import numpy as np

from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_SPECIES = ('oak', 'pine', 'birch', 'willow', 'palm')
_COUNTS = (50, 100, 150, 200, 250)  # trees, the paper's figure 9
_SECONDS = 12  # simulated seconds per size
_WIND = (12.0, 0.0, 0.0)  # [m/s]


def stand(count: int) -> Simulation:
    """
    Plant a mixed stand of shipped species.

    :param count: trees in all.
    """
    side = 10.0 * np.sqrt(count / len(_SPECIES)) + 10.0
    parameters = {'scene': {'objects': list(_SPECIES)},
                  'wind': {'velocity': list(_WIND), 'turbulence_intensity': 0.2}}
    for i, name in enumerate(_SPECIES):
        parameters[name] = {'grammar': f'{name}.lsys', 'count': count // len(_SPECIES),
                            'spacing': 10.0, 'layout': 'scatter',
                            'origin': [(i % 3) * side, (i // 3) * side, 0.0]}
    return Simulation(Scene.from_parameters(parameters))


def measure(count: int) -> None:
    """Print one line about a stand of a number of trees."""
    simulation = stand(count)
    simulation.step(30)
    rate = round(1.0 / simulation.time_step)
    blocks, stages = [], []
    for _ in range(_SECONDS):
        start = perf_counter()
        simulation.step(rate)
        blocks.append(perf_counter() - start)
        stages.append(dict(simulation.timings))
    parts = '  '.join(f'{name} {1e3 * np.median([s[name] for s in stages]) / rate:.2f}'
                      for name in stages[0])
    print(f'{count:4d} trees {len(simulation.blueprint):6d} segments: real-time factor '
          f'{1.0 / np.median(blocks):6.1f} (worst second {1.0 / max(blocks):5.1f}), '
          f'broken {simulation.bonds_broken}; ms per step: {parts}')


if __name__ == '__main__':
    for trees in _COUNTS:
        measure(trees)
