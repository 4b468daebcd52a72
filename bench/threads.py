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

The stand of 250 trees and the storm beside 15,196 bricks of `bench/paper.py`, with their messages,
as twins that differ in the number of threads only and must stay equal to the bit. The twins take
turns frame by frame, two steps of 1/60 s and the bytes of poses and markers. Printed are medians
over all frames of wall time, and of the processor time of the main thread: it waits for the others
where they take longer, which is what a frame takes where nothing else runs on the cores.
Run: python bench/threads.py [frames] [threads ...]
"""

from dataclasses import replace
import os
import sys
from time import thread_time

import numpy as np
import paper


def twins(objects: dict, wind: list[float], counts: list[int]) -> list[paper.Frames]:
    """Build a scene once per number of threads."""
    found = []
    for count in counts:
        simulation = paper.simulate(objects, wind)
        settings = replace(simulation.model.settings, threads=count)
        simulation.model = replace(simulation.model, settings=settings)
        found.append(paper.Frames(simulation))
    return found


def measure(name: str, scenes: list[paper.Frames], counts: list[int], frames: int) -> None:
    """Print a row per number of threads, and check that the twins stayed equal."""
    wall, own, steps = np.empty((3, frames, len(counts)))
    for frame in range(frames):
        for k in np.roll(np.arange(len(counts)), frame):  # none is always the first
            start = thread_time()
            stepped, written = scenes[k].frame()
            own[frame, k] = thread_time() - start
            wall[frame, k], steps[frame, k] = stepped + written, stepped
    poses = [scene.simulation.poses for scene in scenes]
    for other in poses[1:]:
        np.testing.assert_array_equal(poses[0], other)
    wall, own, steps = (np.median(each, axis=0) for each in (wall, own, steps))
    for k, count in enumerate(counts):
        print(f'| {name} | {count} | {1e3 * wall[k]:.1f} | {wall[0] / wall[k]:.2f} | '
              f'{steps[0] / steps[k]:.2f} | {1e3 * own[k]:.1f} | {own[0] / own[k]:.2f} |',
              flush=True)


def main() -> None:
    """Print the table."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    cores = len(os.sched_getaffinity(0))
    counts = [int(word) for word in sys.argv[2:]] or [
        1, *(n for n in (2, 4, 8, 16) if n <= cores)]
    print('| scene | threads | frame [ms] | speed-up | of its steps | main thread [ms] | '
          'speed-up |\n|---|---|---|---|---|---|---|')
    measure('250 trees, wind 12 m/s', twins(paper.trees(250), paper.BREEZE, counts), counts,
            frames)
    both = {'office': {'grammar': 'office.wall', 'origin': [0.0, -60.0, 0.0]},
            **paper.trees(250)}
    measure('250 trees and office 3, breaking in 25 m/s', twins(both, paper.STORM, counts),
            counts, frames)


if __name__ == '__main__':
    main()
