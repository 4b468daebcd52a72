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
Time and memory of large scenes against their size, each in a process of its own.

One tree of up to 20,000 segments, forests of up to 10,000 trees with and without culling, offices
of up to 100,000 bricks that stand and that a ball goes through. Printed are the time to build, the
peak of memory, the time per step, and for each family the exponents of both over the number of
parts, fitted to all sizes by least squares of the logarithms. Times are processor time, the
fastest of three blocks of steps.
Run: python bench/scale.py [tree] [forest] [culled] [bricks] [small]
"""

from collections.abc import Callable
import resource
import subprocess
import sys
from time import process_time

import numpy as np

from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

_SPECIES = ('oak', 'pine', 'birch', 'willow', 'palm')
_WIND = {'velocity': [12.0, 0.0, 0.0], 'turbulence_intensity': 0.2}
_CULLING = {'distance': 80.0, 'frustum': True, 'far_interval': 4, 'far_distance': 20.0}
_STEPS, _BLOCKS = 10, 3
_STRUCK = 60  # steps from the launch of the ball
_GROWTH = """
define: forks = 11
derivation length: forks + 1
module: Wood
axiom: Wood Density(800) Modulus(8e9) Strength(6e7) DampingRatio(0.05)
    !(0.01 * 1.3 ^ forks) F(2) F(2) A(forks)
production:
A(k) : k > 0 -> !(0.01 * 1.3 ^ k) F(0.1 + 0.05 * k) F(0.1 + 0.05 * k) F(0.1 + 0.05 * k)
    [ +(25) /(90) A(k - 1) ] [ -(35) /(80) A(k - 1) ]
A(k) : k <= 0 -> *
interpretation:
Wood -> *
"""  # 3 · 2^forks - 1 segments
SIZES: dict[str, tuple[int, ...]] = {
    'tree': (10, 11, 12, 13), 'forest': (1250, 2500, 5000, 10000),
    'culled': (1250, 2500, 5000, 10000), 'bricks': (1, 2, 4, 7)}


def tree(forks: int) -> Simulation:
    """Grow one tree."""
    scene = Scene.from_parameters({'wind': _WIND})
    scene.add(LSystem.parse(_GROWTH).build(seed=1, forks=forks), (0.0, 0.0, 0.0), name='tree')
    return Simulation(scene)


def forest(number: int, culling: dict | None = None) -> Simulation:
    """Plant trees of five species, eight individuals of each, 10 m apart."""
    side = 10.0 * np.sqrt(number / len(_SPECIES))
    parameters = {'scene': {'objects': list(_SPECIES)}, 'wind': _WIND, 'culling': culling or {}}
    for i, name in enumerate(_SPECIES):
        parameters[name] = {'grammar': f'{name}.lsys', 'count': number // len(_SPECIES),
                            'spacing': 10.0, 'variants': 8,
                            'origin': [(i % 3 - 1) * side, (i // 3 - 0.5) * side, 0.0]}
    return Simulation(Scene.from_parameters(parameters))


def culled(number: int) -> Simulation:
    """Plant them around an observer who stands in their midst."""
    simulation = forest(number, _CULLING)
    simulation.set_observer((0.0, 0.0, 3.0), (0.0, 0.0, 0.0, 1.0))
    return simulation


def bricks(times: int) -> Simulation:
    """Build a number of offices of 15,196 bricks in a row."""
    return Simulation(Scene.from_parameters({
        'scene': {'objects': ['office']},
        'office': {'grammar': 'office.wall', 'count': times, 'spacing': 60.0}}))


BUILDERS: dict[str, Callable[[int], Simulation]] = {
    'tree': tree, 'forest': forest, 'culled': culled, 'bricks': bricks}


def per_step(simulation: Simulation, steps: int, blocks: int) -> float:
    """Measure the processor time of a step in the fastest of some blocks [s]."""
    taken = []
    for _ in range(blocks):
        start = process_time()
        simulation.step(steps)
        taken.append(process_time() - start)
    return min(taken) / steps


def strike(simulation: Simulation, offices: int) -> None:
    """Throw a ball of 1.5 t through two walls of the first office, as `bench/striking.py` does."""
    one = simulation.blueprint.poses[:len(simulation.blueprint) // offices, 0]
    middle = one.min() + 0.25 * (one.max() - one.min()) + 0.1
    simulation.launch(Projectile(position=(middle, -3.0, 1.6), velocity=(0.0, 25.0, 1.0),
                                 shape='sphere', size=0.8, mass=1500.0))


def measure(family: str, size: int) -> None:
    """Print number of parts, time to build [s], per step, and struck by a ball [s], peak [MB]."""
    small = BUILDERS[family](SIZES[family][0])  # load kernels
    small.step(3)
    if family == 'bricks':
        strike(small, 1)
        small.step(_STRUCK)
    start = process_time()
    simulation = BUILDERS[family](size)
    built = process_time() - start
    simulation.step(5)
    step, struck = per_step(simulation, _STEPS, _BLOCKS), np.nan
    if family == 'bricks':
        strike(simulation, size)
        struck = per_step(simulation, _STRUCK, 1)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(len(simulation.blueprint), built, step, struck, peak)


def exponent(parts: np.ndarray, times: np.ndarray) -> float:
    """Fit the exponent of a power law."""
    return float(np.polyfit(np.log(parts), np.log(times), 1)[0])


def report(family: str, sizes: tuple[int, ...]) -> None:
    """Print a row per size, and the exponents."""
    rows = []
    for size in sizes:
        output = subprocess.run([sys.executable, __file__, '--one', family, str(size)],
                                check=True, capture_output=True, text=True).stdout
        rows.append([float(word) for word in output.split('\n')[-2].split()])
        parts, built, step, struck, peak = rows[-1]
        print(f'| {family} | {parts:.0f} | {built:.2f} | {1e3 * step:.2f} | {1e3 * struck:.1f} | '
              f'{peak:.0f} |', flush=True)
    table = np.array(rows)
    print(f'| {family}: exponents | | {exponent(table[:, 0], table[:, 1]):.2f} | '
          f'{exponent(table[:, 0], table[:, 2]):.2f} | {exponent(table[:, 0], table[:, 3]):.2f} '
          f'| |', flush=True)


def main() -> None:
    """Print the table."""
    words = sys.argv[1:]
    if words[:1] == ['--one']:
        measure(words[1], int(words[2]))
        return
    print('| scene | parts | built [s] | step [ms] | step while struck [ms] | peak memory [MB] |\n'
          '|---|---|---|---|---|---|')
    for family in [word for word in words if word in SIZES] or SIZES:
        report(family, SIZES[family][:2] if 'small' in words else SIZES[family])


if __name__ == '__main__':
    main()
