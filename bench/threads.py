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
Measure how much faster whole scenes run on several threads, side by side in one process.

The stand of 250 trees, the storm beside 15,196 bricks and the demolition of these, all of
`bench/paper.py`, in frames as the node has them: two steps of 1/60 s and the bytes of poses and
markers, these beside the next steps.
They run as twins that differ in the number of threads only and must stay equal to the bit. The
twins take turns, a third of a simulated second each. Printed are medians over all turns: of wall
time per frame, of the processor time of the main thread, which waits for the others where they
take longer (what a frame takes where nothing else runs on the cores), and speed-ups by both.
Run: python bench/threads.py [frames] [threads ...]
"""

from dataclasses import replace
import os
import sys
from time import perf_counter, thread_time

import numpy as np
import paper

from procphys_ros.physics.world import DEFAULT_ENGINE, installed_engines
from procphys_ros.scene.strikes import Demolition

_TURN = 10  # frames


def twins(objects: dict, wind: list[float], counts: list[int],
          engine: str = DEFAULT_ENGINE) -> list[paper.Frames]:
    """Build a scene once per number of threads."""
    found = []
    for count in counts:
        simulation = paper.simulate(objects, wind, engine)
        settings = replace(simulation.model.settings, threads=count)
        simulation.model = replace(simulation.model, settings=settings)
        found.append(paper.Frames(simulation))
    return found


def measure(name: str, scenes: list[paper.Frames], counts: list[int], frames: int) -> None:
    """Print a row per number of threads, and check that the twins stayed equal."""
    turns = max(frames // _TURN, 1)
    wall, own = np.empty((2, turns, len(counts)))
    for turn in range(turns):
        for k in np.roll(np.arange(len(counts)), turn):  # none is always the first
            start, started = perf_counter(), thread_time()
            for _ in range(_TURN):
                scenes[k].frame()
            scenes[k].finish()
            wall[turn, k], own[turn, k] = perf_counter() - start, thread_time() - started
    poses = [scene.simulation.poses for scene in scenes]
    for other in poses[1:]:
        np.testing.assert_array_equal(poses[0], other)
    for k, count in enumerate(counts):
        times = [1e3 / _TURN * np.median(each[:, k]) for each in (wall, own)]
        gains = [np.median(each[:, 0] / each[:, k]) for each in (wall, own)]
        print(f'| {name} | {count} | {times[0]:.1f} | {gains[0]:.2f} | {times[1]:.1f} | '
              f'{gains[1]:.2f} |', flush=True)


def main() -> None:
    """Print the table."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    cores = len(os.sched_getaffinity(0))
    counts = [int(word) for word in sys.argv[2:]] or [
        1, *(n for n in (2, 4, 8, 16) if n <= cores)]
    print('| scene | threads | frame [ms] | speed-up | main thread [ms] | speed-up |\n'
          '|---|---|---|---|---|---|')
    measure('250 trees, wind 12 m/s', twins(paper.trees(250), paper.BREEZE, counts), counts,
            frames)
    both = {'office': {'grammar': 'office.wall', 'origin': [0.0, -60.0, 0.0]},
            **paper.trees(250)}
    measure('250 trees and office 3, breaking in 25 m/s', twins(both, paper.STORM, counts),
            counts, frames)
    for engine in installed_engines():
        falling = twins({'office': {'grammar': 'office.wall'}}, [0.0, 0.0, 0.0], counts, engine)
        for scene in falling:
            scene.simulation.demolish(Demolition())
        measure(f'office 3, demolished, {engine}', falling, counts, frames)


if __name__ == '__main__':
    main()
