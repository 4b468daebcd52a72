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
Time the contacts of trees beside the rest of a step.

A stand of 250 trees that touch nothing; the same with resting debris on the ground, with loose
boughs that rain into the crowns, with trees that are felled flexibly, and the broad phase alone
with thousands of bodies. Prints medians, and ratios to the same step without the search for
contacts, alternated in one run. Run: python bench/contact.py
"""

from time import perf_counter

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.touch import capsule_bounds, overlaps
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.stages import STAGES

_TREES = 250
_SPECIES = ('oak', 'pine', 'birch', 'willow', 'palm')
_ROUNDS = 40  # of each variant
_STAGES = ('contact', 'waking')


def stand(wind: float) -> Simulation:
    """Plant a mixed stand, blown by a steady wind [m/s]."""
    scene = Scene()
    folder = shared_folder() / 'grammars'
    grown = [LSystem.load(folder / f'{name}.lsys').build() for name in _SPECIES]
    side = int(np.ceil(np.sqrt(_TREES)))
    for i in range(_TREES):
        scene.add(grown[i % len(grown)], (9.0 * (i % side), 9.0 * (i // side), 0.0), 0.7 * i,
                  f'tree_{i}')
    simulation = Simulation(scene)
    simulation.set_wind((wind, 0.0, 0.0))
    simulation.step(20)
    return simulation


def compare(name: str, simulation: Simulation) -> None:
    """Print the stages of a step, and its ratio to one that looks for no contacts."""
    blind = tuple(stage for stage in STAGES if stage.name not in _STAGES)
    times: dict[bool, list[float]] = {True: [], False: []}
    spent, touching = [], []
    for i in range(2 * _ROUNDS):
        looks = i % 2 == 0
        simulation.stages = STAGES if looks else blind
        start = perf_counter()
        simulation.step()
        times[looks].append(perf_counter() - start)
        if looks:
            spent.append(sum(map(simulation.timings.get, _STAGES)))
            touching.append(len(simulation.state.contacts))
    simulation.stages = STAGES
    print(f'{name:38s} contact {1e3 * np.median(spent):5.2f} ms (worst {1e3 * max(spent):5.2f}), '
          f'step {1e3 * np.median(times[True]):5.2f} ms, '
          f'x{np.median(times[True]) / np.median(times[False]):.2f} of one without; '
          f'{np.median(touching):.0f} touches, {simulation.awake_bodies} loose')


def rain(simulation: Simulation, count: int) -> None:
    """Drop branches into the crowns."""
    rng = np.random.default_rng(0)
    roots = simulation.state.forest.plan.start[:-1]
    for tree in rng.integers(len(roots), size=count):
        row = simulation.state.forest.plan.row[roots[tree]]
        place = simulation.state.forest.poses[row, :3] + rng.uniform([-1, -1, 5], [1, 1, 9])
        turn = rng.normal(size=4)
        simulation.state.world.add_body(Shape.CAPSULE, np.array([0.08, 0.08, 1.5]), 5.0,
                                        np.concatenate([place, turn / np.linalg.norm(turn)]))


def broad_phase(simulation: Simulation) -> None:
    """Time thousands of bodies against all segments, far and near."""
    forest = simulation.state.forest
    sizes = simulation.blueprint.size[forest.parts]
    rng = np.random.default_rng(1)
    for count in (1000, 3000, 10_000):
        low = rng.uniform([0, 0, 0], [140, 140, 1.0], (count, 3))
        balls = np.hstack([low, low + 0.25])
        spent, found = [], 0
        for _ in range(30):
            start = perf_counter()
            bounds = capsule_bounds(forest.plan.row, forest.poses, sizes, forest.velocities, 0.025,
                                    0.004)
            first = forest.plan.start[:-1]
            trees = np.hstack([np.minimum.reduceat(bounds[:, :3], first),
                               np.maximum.reduceat(bounds[:, 3:], first)])
            found = len(overlaps(trees, balls)[0])
            spent.append(perf_counter() - start)
        print(f'broad phase: {count:6d} bodies against {len(sizes)} segments of {len(trees)} '
              f'trees: {1e3 * np.median(spent):.2f} ms, {found} near a tree')


def main() -> None:
    """Run all cases."""
    simulation = stand(8.0)
    compare('nothing loose, wind 8 m/s', simulation)
    broad_phase(simulation)
    rain(simulation, 100)
    simulation.step(30)
    compare('100 branches fall into crowns', simulation)
    simulation.step(600)
    compare('the same 10 s later', simulation)
    simulation = stand(8.0)
    forest = simulation.state.forest
    for first in forest.plan.start[:12].tolist():
        forest.release(int(forest.plan.row[first]) + 1)
    simulation.step(60)
    compare('12 trees felled flexibly, after 1 s', simulation)
    simulation.step(120)
    compare('the same, 3 s later', simulation)


if __name__ == '__main__':
    main()
