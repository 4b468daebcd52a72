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
Time buildings: standing, and torn down with secondary fracture.

Demolition takes all walls of the ground floor away up to half its height, at once; all that stood
on them falls: every wall and floor of the building comes down, with each engine that is installed.
The baseline is the way of Baxter et al. (2010) in PyBullet, a joint per mortar bond, side by side
at sizes it can bear, where it only stands. Run with
`python bench/buildings.py [seconds [first size [last size]]]`.
"""

from pathlib import Path
import sys
import time

import numpy as np
from world import jointed

from procphys_ros.physics.world import installed_engines
from procphys_ros.scene import Scene
from procphys_ros.simulation import breaking, Cause, Simulation
from procphys_ros.wallgrammar import WallGrammar

OFFICE = Path(__file__).parents[1] / 'grammars' / 'office.wall'
SIZES = ({'bays': 1, 'deep': 1, 'storeys': 1, 'module': 2.8},
         {'bays': 3, 'deep': 2, 'storeys': 1}, {})
BLOWN = 1.5  # [m] walls below vanish
HEAVY = 200.0  # [kg] slabs, which stay
BASELINES = ((20, 25), (20, 50), (40, 50))  # columns and courses of walls with a joint per bond


def office(size, engine):
    """Make a simulation of an office; return it and its number of bricks."""
    blueprint = WallGrammar.load(OFFICE).build(seed=0, **size)
    scene = Scene()
    scene.add(blueprint, (0.0, 0.0, 0.0), 0.0, 'office')
    masonry = [blueprint.kinds.index(kind) for kind in ('brick', 'partition')
               if kind in blueprint.kinds]
    return Simulation(scene, engine=engine), int(np.isin(blueprint.kind, masonry).sum())


def blow(simulation):
    """Remove the lower half of the ground floor's walls."""
    blueprint = simulation.blueprint
    standing = simulation.state.standing
    parts = np.flatnonzero(standing[:len(blueprint)] & (blueprint.poses[:, 2] < BLOWN)
                           & (blueprint.mass < HEAVY))
    breaking.destroy(simulation.model, simulation.state, parts, Cause.DEMOLITION, 1.0)


def timed(simulation, steps):
    """Step; return the wall time of each step [s] and of each stage in it."""
    times, stages = np.empty(steps), []
    for i in range(steps):
        start = time.perf_counter()
        simulation.step()
        times[i] = time.perf_counter() - start
        stages.append(simulation.timings)
    return times, stages


def demolition(size, seconds, engine):
    """Print how fast a demolition runs, overall and in its worst second, and where time goes."""
    simulation, bricks = office(size, engine)
    dt = simulation.time_step
    standing, _ = timed(simulation, 30)
    start = time.perf_counter()
    blow(simulation)
    first = time.perf_counter() - start
    count = round(seconds / dt)
    times, stages = timed(simulation, count)
    times[0] += first
    window = round(1.0 / dt)
    sums = np.convolve(times, np.ones(window), 'valid')
    worst = int(sums.argmax())
    awake, bodies = simulation.awake_bodies, len(simulation.state.bodies.members)
    print(f'{bricks} bricks, {engine}, standing: {1e3 * np.median(standing):.2f} ms per step, '
          f'real-time factor {dt / np.median(standing):.1f}')
    print(f'{bricks} bricks, {engine}, demolished: real-time factor '
          f'{seconds / times.sum():.2f} over {seconds:g} s, {1.0 / sums[worst]:.2f} in the '
          f'worst second (from {worst * dt:.1f} s), longest step {1e3 * times.max():.0f} ms; '
          f'{simulation.bonds_broken} bonds broken, {bodies} bodies, {awake} awake')
    for name, rows in (('overall', stages), ('worst second', stages[worst:worst + window])):
        total = {k: sum(r[k] for r in rows) for k in rows[0]}
        print(f'  {name}, ms per step: ' + ', '.join(
            f'{k} {1e3 * v / len(rows):.2f}' for k, v in sorted(
                total.items(), key=lambda item: -item[1]) if v > 1e-4 * len(rows)))
    simulation.close()
    return bricks, float(np.median(standing)), times.sum() / count


def compare(ours):
    """Print what a brick costs in a step with a joint per bond, and here."""
    for columns, courses in BASELINES:
        count = columns * courses
        step, sag = jointed(columns, courses, 50)
        each = 1e3 * step / count
        print(f'{count} bricks with a joint per bond, only standing: {step:.1f} ms per step, '
              f'{each:.1f} µs per brick, sagging {1e3 * sag:.0f} mm')
        for bricks, standing, falling in ours:
            print(f'  of it {bricks} bricks here take, each: standing 1/'
                  f'{each * bricks / (1e6 * standing):.0f}, coming down 1/'
                  f'{each * bricks / (1e6 * falling):.1f}')


def warm_up():
    """Compile and load everything once."""
    for engine in installed_engines():
        simulation, _ = office(SIZES[0], engine)
        blow(simulation)
        simulation.step(60)
        simulation.close()


def main():
    """Print all figures."""
    warm_up()
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    last = int(sys.argv[3]) if len(sys.argv) > 3 else len(SIZES) - 1
    found = {engine: [] for engine in installed_engines()}
    for size in SIZES[first:last + 1]:
        for engine, rows in found.items():
            rows.append(demolition(size, seconds, engine))
    compare(next(iter(found.values())))


if __name__ == '__main__':
    main()
