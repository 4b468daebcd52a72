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
Growth in a running scene: milliseconds per step of a growing tree, and a wood of fifty.

Run `python bench/growing.py`. Steps within a year change constants only; at the beginning of a
year its string is derived and the scene extended, which is told apart.
"""

from pathlib import Path
import sys
import time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from procphys_ros.scene import Scene
from procphys_ros.simulation import growth, Simulation

_WIND = {'velocity': [4.0, 1.0, 0.0]}
_SHOWN = 5  # [years] between two lines of a wood


def _planted(**tree: object) -> Simulation:
    return Simulation(Scene.from_parameters({
        'engine': 'native', 'wind': _WIND, 'scene': {'objects': ['tree']},
        'tree': {'grammar': 'garden_tree.lsys', **tree}}))


def tree(first: int = 10, years: int = 12, rate: float = 2.0) -> None:
    """Time the steps of one tree, growing and not."""
    simulation = _planted(steps=first)
    simulation.step(30)
    simulation.grow(rate=rate, years=years)
    steps = round(1.0 / (rate * simulation.time_step))
    for year in range(first + 1, first + years + 1):
        spent, own = _timed(simulation, steps)
        print(f'{year:3d} years: {simulation.exists.sum():5d} segments, year begins in '
              f'{spent[0]:6.0f} ms, a step then takes {np.median(spent[1:]):5.2f} ms, '
              f'{np.median(own[1:]):5.2f} ms of it for growth', flush=True)
    print(f'a step of the tree that has grown: {np.median(_timed(simulation, 60)[0]):.2f} ms')


def _timed(simulation: Simulation, steps: int) -> tuple[list[float], list[float]]:
    """Return the times of steps, and of their stage of growth [ms]."""
    spent, own = [], []
    for _ in range(steps):
        began = time.perf_counter()
        simulation.step()
        spent.append(1e3 * (time.perf_counter() - began))
        own.append(1e3 * simulation.timings[growth.STAGE])
    return spent, own


def wood(count: int = 50, years: int = 60, rate: float = 4.0) -> None:
    """Grow a wood from one-year-old trees, and print how it thins itself."""
    began = time.time()
    simulation = _planted(steps=1, count=count, layout='scatter', spacing=3.0,
                          defines=['shoot=1.0', 'least=0.55', 'leaf=0.35', 'vigour=0.7'])
    simulation.grow('tree', rate=rate, years=years - 1)
    steps = round(1.0 / (rate * simulation.time_step))
    for year in range(2, years + 1):
        simulation.step(steps)
        if year % _SHOWN == 0:
            parts, exists = simulation.state.parts, simulation.exists
            alive = [plant.all_parts() for plant in simulation.state.growing.plants.values()]
            mass = [parts.mass[rows].sum() for rows in alive if len(rows)]
            print(f'{year:3d} years: {len(mass):3d} of {count} alive, mean {np.mean(mass):7.1f} '
                  f'kg, {exists.sum():6d} of {len(exists):6d} segments, '
                  f'{simulation.bonds_broken} broken, {time.time() - began:5.1f} s', flush=True)


if __name__ == '__main__':
    tree()
    wood()
