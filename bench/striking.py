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
Time a ball through two walls of a whole building, with each engine that is installed.

The baseline is the way of Baxter et al. (2010) in PyBullet, a joint per mortar bond, at a size
that it can stand. Run with `python bench/striking.py [seconds]`.
"""

from pathlib import Path
import sys
import time

import numpy as np
from world import jointed

from procphys_ros.physics.world import installed_engines
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.wallgrammar import WallGrammar

OFFICE = Path(__file__).parents[1] / 'grammars' / 'office.wall'
SIZES = ({'bays': 1, 'deep': 1, 'storeys': 1}, {'bays': 3, 'deep': 2, 'storeys': 1}, {})
SECONDS = 5.0
BALL = {'shape': 'sphere', 'size': 0.8, 'mass': 1500.0}
WORST = 30  # steps of half a second
BASELINE = (20, 50)  # columns and courses of the wall that a joint per bond has to hold


def office(size, engine):
    """Make a simulation of an office; return it and its number of bricks."""
    blueprint = WallGrammar.load(OFFICE).build(seed=0, **size)
    bricks = sum(int((blueprint.kind == i).sum()) for i, kind in enumerate(blueprint.kinds)
                 if kind in ('brick', 'partition'))
    scene = Scene(Settings())
    scene.add(blueprint, (0.0, 0.0, 0.0), 0.0, 'office')
    return Simulation(scene, engine=engine), bricks


def strike(size, seconds, engine):
    """Throw a ball along y; return the measurements."""
    simulation, bricks = office(size, engine)
    ground = simulation.blueprint.poses
    middle = 0.25 * float(ground[:, 0].max()) + 0.1
    still = timed(simulation, 30)[0]
    ball = simulation.launch(Projectile(position=(middle, -3.0, 1.6), velocity=(0.0, 25.0, 1.0),
                                        **BALL))
    steps, stages = timed(simulation, round(seconds * 60))
    worst = max(steps[i:i + WORST].sum() for i in range(0, len(steps) - WORST + 1, 5))
    torn = np.unique(np.concatenate([i.parts for i in simulation.impacts if i.torn]
                                    or [np.zeros(0, int)]))
    print(f'{bricks} bricks, {engine}: real-time factor {seconds / steps.sum():.2f} '
          f'over {seconds:g} s, {0.5 / worst:.2f} in the worst half second; '
          f'{1e3 * np.median(still):.2f} ms per step standing, '
          f'{1e3 * np.median(steps):.1f} while struck, slowest {1e3 * steps.max():.0f}')
    print(f'  the ball came to y = {simulation.poses[ball, 1]:.1f} m, tore out {len(torn)} parts, '
          f'{simulation.bonds_broken} bonds broke, {simulation.awake_bodies} bodies still move')
    print('  ' + ', '.join(f'{name} {1e3 * spent / len(steps):.2f}' for name, spent in
                           sorted(stages.items(), key=lambda s: -s[1])) + ' ms per step')
    return float(np.median(steps)), bricks


def timed(simulation, count):
    """Step; return the wall time of each step and the sum of each stage [s]."""
    steps, stages = np.empty(count), {}
    for i in range(count):
        start = time.perf_counter()
        simulation.step()
        steps[i] = time.perf_counter() - start
        for name, spent in simulation.timings.items():
            stages[name] = stages.get(name, 0.0) + spent
    return steps, stages


def main():
    """Print all figures."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    engines = installed_engines()
    for engine in engines:
        strike(SIZES[0], seconds, engine)  # compile
    for size in SIZES:
        for engine in reversed(engines):  # the reference last, which is compared below
            ours, bricks = strike(size, seconds, engine)
    theirs, sag = jointed(*BASELINE, 50)
    count = BASELINE[0] * BASELINE[1]
    print(f'a joint per bond needs {theirs:.1f} ms per step for {count} bricks that only stand '
          f'(sagging {1e3 * sag:.0f} mm), {theirs / count * 1e3:.1f} µs per brick; struck, '
          f'{bricks} bricks take {ours / bricks * 1e6:.2f} µs each here: '
          f'{theirs * 1e-3 / count / (ours / bricks):.0f} times less')


if __name__ == '__main__':
    main()
