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
Time scans of a simulated lidar: 64 x 512 rays, from several places in streets of houses.

Prints medians of CPU time per scan and message, the share of a core at 10 Hz, and the ratio to a
step of the simulation, alternated in one run. Run: python bench/lidar.py
"""

from time import process_time

import numpy as np

from procphys_ros import messages
from procphys_ros.files.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.simulation import Simulation

_ROUNDS = 20
_PLACES = {'in the street': (0.0, 0.0, 1.8), 'by a house': (5.0, -5.0, 1.8),
           'by a wall': (-8.0, 2.0, 1.5), 'above all': (0.0, 0.0, 30.0)}


def main() -> None:
    """Print the times."""
    simulation = Simulation(Scene.from_yaml(shared_folder() / 'config' / 'village_street.yaml'))
    simulation.step(5)
    print(f'{len(simulation.poses)} parts')
    for name, place in _PLACES.items():
        lidar = LidarSettings(position=place)
        simulation.scan(lidar)
        scans, steps = [], []
        for _ in range(_ROUNDS):
            start = process_time()
            scan = simulation.scan(lidar)
            rows = messages.scan_rows(scan.points(in_world=True), scan.ranges, scan.parts)
            messages.point_cloud(rows, (0, 0), 'world')
            middle = process_time()
            simulation.step()
            scans.append(middle - start)
            steps.append(process_time() - middle)
        time = np.median(scans)
        print(f'{name:14} {1e3 * time:5.1f} ms, {1e3 * time:4.1f} % of a core at 10 Hz, '
              f'x{time / np.median(steps):.2f} of a step; '
              f'{(scan.parts >= 0).mean():4.0%} of the rays meet parts')


if __name__ == '__main__':
    main()
