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
Growth of plants that ask where they stand: answers per second, and a wood of competing trees.

Run `python bench/growth.py`. Woods print by years the trees with leaves, their mean mass, and at
the end the slope of log(mean mass) over log(number) while trees die: that of a crowded stand that
thins itself is -3/2 (Yoda et al. 1963). Of so few trees it scatters: -1.0 to -1.7 for three seeds.
"""

from pathlib import Path
import sys
import time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from procphys_ros.compilation.threads import most_threads
from procphys_ros.environment import KINDS, Plant, Question
from procphys_ros.environment.habitat import Habitat
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.scene.layout import places

_QUERIES = 10_000
_WOODS = ((50, 3.0, 0.2), (80, 1.2, 0.35))  # trees, spacing [m], `dark`: an open and a crowded one
_YEARS = 60
_WOOD = {'shoot': 1.0, 'least': 0.55, 'leaf': 0.35, 'vigour': 0.7}
_SHOWN = 5      # [years] between two lines


def answers() -> None:
    """Time the answers of each kind beside a cottage."""
    house = Scene.from_parameters(
        {'scene': {'objects': ['house']}, 'house': {'grammar': 'cottage.wall'}}).blueprint
    tree = LSystem.load('garden_tree.lsys').build(seed=1, years=20)
    points = np.random.default_rng(0).uniform((-5, -15, 0), (15, 5, 8), (_QUERIES, 3))
    root = np.array([0.0, -6.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    for kind in KINDS:
        plant = Plant(tree, root, [Question(kind, points, np.zeros(_QUERIES, int))])
        spent = []
        for _ in range(3):
            began = time.process_time()
            Habitat(house).answer([plant])
            spent.append(time.process_time() - began)
        print(f'{kind:10s} {_QUERIES / min(spent):10,.0f} answers per second of processor time, '
              f'beside {len(house):,} parts and {len(tree):,} segments', flush=True)


def wood(count: int, spacing: float, dark: float, years: int = _YEARS) -> None:
    """Grow a wood, and print how it thins itself."""
    system, rng = LSystem.load('garden_tree.lsys'), np.random.default_rng(1)
    points, headings = places('scatter', count, spacing, rng)
    plants = [system.plant(np.array([x, y, 0.0, 0.0, 0.0, np.sin(h / 2.0), np.cos(h / 2.0)]), n,
                           {**_WOOD, 'dark': dark, 'years': years})
              for n, ((x, y), h) in enumerate(zip(points, headings))]
    habitat, began, worked = Habitat(threads=most_threads(0)), time.time(), time.process_time()
    alive, mass = [], []
    for year in range(years + 1):
        asked = [plant.ask() for plant in plants]
        for plant, told in zip(plants, habitat.answer(asked)):
            plant.tell(told)
        living = [one.built for one in asked if one.built is not None and len(one.built.leaves)]
        alive.append(len(living))
        mass.append(sum(float(one.mass.sum()) for one in living) / max(len(living), 1))
        if year % _SHOWN == 0 and year:
            print(f'{year:3d} years: {alive[-1]:3d} of {count} alive, mean {mass[-1]:8.1f} kg, '
                  f'{time.time() - began:5.1f} s', flush=True)
        for plant in plants:
            plant.advance()
    print(f'{time.process_time() - worked:.1f} s of processor time')
    thinning = np.flatnonzero((np.array(alive) < 0.9 * count) & (np.array(alive) > 2))
    if len(thinning) > 5:
        slope = np.polyfit(np.log(np.array(alive)[thinning]), np.log(np.array(mass)[thinning]), 1)
        print(f'slope of log(mass) over log(number) while it thins: {slope[0]:.2f}')


if __name__ == '__main__':
    answers()
    for given in _WOODS:
        wood(*given)
