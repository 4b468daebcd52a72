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
Print how branches calm down and how a wall stands, and draw both for docs/flaws.md.

Left: the fastest segment of one tree per species once a gale of 15 m/s has stopped. Right: how far
the top of a wall of 200 bricks has gone from its place, here and with a joint of PyBullet per
bond. Run: python bench/flaws.py [docs/images/flaws.png] (a picture needs matplotlib)
"""

from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from jointed_bodies import JointedBodies
from masonry_walls import wall
import numpy as np

from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_SPECIES = ('oak', 'pine', 'birch', 'palm', 'willow')
_STEP = 1.0 / 60.0  # [s]


def calming(name: str, seconds: float) -> np.ndarray:
    """Measure the speed of the fastest segment of a tree, in every second after a gale [m/s]."""
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': [name]}, name: {'grammar': f'{name}.lsys'},
        'wind': {'velocity': [15.0, 0.0, 0.0]}}))
    simulation.step(900)
    simulation.set_wind_enabled(False)
    speeds = []
    for _ in range(round(seconds)):
        fastest = 0.0
        for _ in range(60):
            simulation.step()
            fastest = max(fastest, np.linalg.norm(simulation.velocities[:, :3], axis=1).max())
        speeds.append(fastest)
    return np.array(speeds)


def standing(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Measure the largest shift of the top course [m], ours and with a joint per bond, (T,)."""
    plan = wall(12, 16)
    top = plan.poses[:, 2] > plan.poses[:, 2].max() - 0.01
    scene, ours, theirs = Scene(), [], []
    scene.add(plan, name='wall')
    simulation = Simulation(scene)
    with JointedBodies(plan) as jointed:
        for _ in range(round(seconds / _STEP)):
            simulation.step()
            jointed.step()
            for way, poses in ((ours, simulation.poses), (theirs, jointed.poses)):
                away = poses[top, :3] - plan.poses[top, :3]
                way.append(np.linalg.norm(away, axis=1).max())
    return np.array(ours), np.array(theirs)


def main() -> None:
    """Measure both, and draw them where a file is named."""
    speeds = {name: calming(name, 60.0) for name in _SPECIES}
    for name, speed in speeds.items():
        print(f'{name}: {speed[0]:.2f} m/s when the wind stops, {speed[30]:.4f} after 30 s, '
              f'{speed[-1]:.1e} after 60 s')
    ours, theirs = standing(5.0)
    print(f'top of the wall after 5 s: {ours[-1]} m, a joint per bond {theirs[-1]:.2f} m')
    if len(sys.argv) > 1:
        draw(speeds, ours, theirs, Path(sys.argv[1]))


def draw(speeds: dict[str, np.ndarray], ours: np.ndarray, theirs: np.ndarray,
         path: Path) -> None:
    """
    Draw the measurements.

    :param speeds: from `calming`, by species.
    :param ours, theirs: from `standing`.
    :param path: of the picture.
    """
    from matplotlib import pyplot as plt

    _, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.6), layout='constrained')
    for name, speed in speeds.items():
        left.semilogy(np.arange(1, len(speed) + 1), speed, label=name)
    left.set(xlabel='time in still air [s]', ylabel='fastest segment [m/s]', ylim=(1e-5, 10.0),
             title='after a gale of 15 m/s')
    left.legend()
    time = _STEP * np.arange(1, len(ours) + 1)
    right.plot(time, 1e3 * theirs, label='a joint of the engine per bond, as in the paper')
    right.plot(time, 1e3 * ours, label='procphys_ros')
    right.set(xlabel='time [s]', ylabel='way of the top course [mm]',
              title='a wall of 200 bricks, nobody touches it')
    right.legend()
    plt.savefig(path, dpi=90)


if __name__ == '__main__':
    main()
