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
Run the paper's sweep (section 4.3, figure 9) without any culling, published at 30 frames a second.

50 to 250 trees in a turbulent wind, and offices of 2,000 to 15,196 bricks: standing in a storm,
and while they come down; then 250 trees and 15,196 bricks together, in a wind in which all stands
and in one that breaks hundreds of branches. Each frame is two steps of 1/60 s and the bytes of
`~/poses` and of `~/markers`, with moving leaves and dust, as for a node with a subscriber to each.
Prints frames per second on as many cores as there are (NUMBA_NUM_THREADS=1: on one), medians over
blocks of one simulated second, and the worst block; at or above 30 is real time. Scenes in which
bodies fall run with each engine that is installed.
Run: python bench/paper.py [seconds per scene]
"""

from collections.abc import Callable
from functools import partial
from itertools import count
import sys
from time import perf_counter

import numpy as np

from procphys_ros import messages
from procphys_ros.compilation.threads import beside
from procphys_ros.messages import MarkerStyle, SceneMarkers
from procphys_ros.physics.world import DEFAULT_ENGINE, installed_engines
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Demolition
from procphys_ros.simulation import Simulation

_FRAMES = 30  # [Hz] published, the paper's border of real time
_SPECIES = ('oak', 'pine', 'birch', 'willow', 'palm')
_TREES = (50, 100, 150, 200, 250)
_OFFICES = (['bays=1', 'deep=1', 'storeys=1', 'module=2.8'],
            ['bays=3', 'deep=2', 'storeys=1'], [])
STORM = [25.0, 0.0, 0.0]  # [m/s] at 10 m, Beaufort 10
_GALE = [14.0, 0.0, 0.0]  # [m/s] Beaufort 7, from the first moment: the most in which all hold
BREEZE = [12.0, 0.0, 0.0]  # [m/s]
_TREE_SPACING = 10.0  # [m]
# Frames per second as the paper's section 5.3 tells them; figure 9 prints no numbers.
_PAPER_TREES = {50: '27.75', 200: '< 10', 250: '< 10'}
_PAPER_BRICKS = ('just above 15', '< 10', '< 10')


def trees(number: int) -> dict:
    """Describe a mixed stand of a number of trees, scattered over squares."""
    side = _TREE_SPACING * (np.sqrt(number / len(_SPECIES)) + 1.0)
    share = number // len(_SPECIES)
    return {name: {'grammar': f'{name}.lsys', 'count': share, 'layout': 'scatter',
                   'spacing': _TREE_SPACING,
                   'origin': [(i % 3) * side, 40.0 + (i // 3) * side, 0.0]}
            for i, name in enumerate(_SPECIES)}


def simulate(objects: dict, wind: list[float], engine: str = DEFAULT_ENGINE) -> Simulation:
    """Set objects up in a turbulent wind."""
    return Simulation(Scene.from_parameters({
        'scene': {'objects': list(objects)}, **objects, 'engine': engine,
        'wind': {'velocity': wind, 'turbulence_intensity': 0.2}}))


class Frames:
    """
    Runs a simulation frame by frame and writes its messages, as the node does.

    With several threads, markers are written beside the steps of the next frame.

    :param simulation: what is shown.
    """

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        self._markers = SceneMarkers(simulation.blueprint, simulation.objects, 'world',
                                     MarkerStyle())
        self._markers.whole(simulation.poses, (0, 0), simulation.leaf_poses(), simulation.dust)
        self.finish: Callable = lambda: None  # waits for the markers of the last frame

    def frame(self) -> None:
        """Run one frame."""
        simulation, markers = self.simulation, self._markers
        simulation.step(2)
        at = messages.stamp(simulation.time)
        poses = simulation.poses.copy()
        messages.pose_array(poses, at, 'world')
        self.finish()
        if len(markers) < len(simulation.blueprint):
            markers.grow(simulation.blueprint, simulation.objects)
        leaves = simulation.leaf_poses() if markers.shows_leaf_poses else None
        self.finish = beside('markers', partial(markers.changes, poses, at, leaves,
                                                simulation.dust), simulation.model.threads)

    def second(self) -> float:
        """Run one simulated second, and give the time that it took [s]."""
        start = perf_counter()
        for _ in range(_FRAMES):
            self.frame()
        self.finish()
        return perf_counter() - start


def report(name: str, theirs: str, simulation: Simulation, seconds: int) -> None:
    """Measure a scene for some simulated seconds, and print a row of the table."""
    frames = Frames(simulation)
    taken = np.array([frames.second() for _ in range(seconds)])
    rate = _FRAMES / taken
    print(f'| {name} | {len(simulation.blueprint)} | {theirs} | {np.median(rate):.0f} | '
          f'{rate.min():.0f} | {seconds / taken.sum():.2f} | {simulation.bonds_broken} |',
          flush=True)
    simulation.close()


def main() -> None:
    """Print the table."""
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    warm = simulate({'office': {'grammar': 'office.wall', 'defines': _OFFICES[0]}, **trees(5)},
                    STORM)
    warm.demolish(Demolition())
    Frames(warm).second()
    print('| scene | parts | paper, frames/s | here, frames/s (median second) | worst second | '
          'real-time factor | bonds broken |\n|---|---|---|---|---|---|---|')
    for number in _TREES:
        report(f'{number} trees, wind 12 m/s', _PAPER_TREES.get(number, '10–27'),
               simulate(trees(number), BREEZE), seconds)
    for defines, theirs, size in zip(_OFFICES, _PAPER_BRICKS, count()):
        office = {'office': {'grammar': 'office.wall', 'defines': defines}}
        report(f'office {size + 1}, standing in 25 m/s', theirs, simulate(office, STORM),
               seconds)
        for engine in installed_engines():
            falling = simulate(office, [0.0, 0.0, 0.0], engine)
            falling.demolish(Demolition())
            report(f'office {size + 1}, demolished, {engine}', theirs, falling, seconds)
    both = {'office': {'grammar': 'office.wall', 'origin': [0.0, -60.0, 0.0]}, **trees(250)}
    report('250 trees and office 3, standing in 14 m/s', '', simulate(both, _GALE), seconds)
    for engine in installed_engines():
        report(f'250 trees and office 3, breaking in 25 m/s, {engine}', '',
               simulate(both, STORM, engine), seconds)


if __name__ == '__main__':
    main()
