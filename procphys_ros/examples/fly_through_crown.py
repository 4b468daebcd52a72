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
Fly a body of the size of a quadrotor through the crown of an oak, and read the wrench on it.

The oak stands at the origin. The drone, a flat box over its rotors, goes straight through the
crown at a steady speed, whatever is in its way; another program would send its poses in the same
way, to `~/intruders` of the node. Printed are the largest force and torque on the way, the
momentum that the branches took from it, and how far they gave way.

Run: python -m procphys_ros.examples.fly_through_crown
"""

from collections.abc import Callable

import numpy as np

from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

SPEED = 3.0                # [m/s]
ASIDE, HEIGHT = -1.5, 6.0  # [m], through limbs of the lower crown
START, END = -4.0, 4.0     # [m] along x
_MASS = 1.5                # [kg] of a quadrotor of this size
_RATE = 50.0               # [Hz] of the poses, as of the state estimate of a real drone
_SIZE = '0.5 0.5 0.15'     # [m], over the rotors


def world() -> Simulation:
    """Grow an oak in still air, and declare the drone."""
    return Simulation(Scene.from_parameters({
        'scene': {'objects': ['oak']},
        'wind': {'turbulence_intensity': 0.0},
        'oak': {'grammar': str(shared_folder() / 'grammars' / 'oak.lsys'), 'seed': 3},
        'intruders': {'names': ['drone'], 'shapes': [f'box {_SIZE}']}}))


def fly(simulation: Simulation, look: Callable[[Simulation], None]) -> None:
    """
    Fly through the crown.

    :param simulation: from `world`.
    :param look: called after each step.
    """
    next_pose = simulation.time
    while (place := START + SPEED * simulation.time) < END:
        if simulation.time >= next_pose - 1e-9:
            next_pose += 1.0 / _RATE
            simulation.place_intruder((place, ASIDE, HEIGHT, *rotation.IDENTITY), name='drone')
        simulation.step()
        look(simulation)


def main() -> None:
    """Fly, and print force, torque, momentum and damage."""
    simulation = world()
    wrenches, moved = [], np.zeros(len(simulation.poses))

    def look(simulation: Simulation) -> None:
        wrenches.append(simulation.wrench_on_intruder('drone').copy())
        away = np.linalg.norm(simulation.poses[:, :3] - simulation.blueprint.poses[:, :3], axis=1)
        np.maximum(moved, away, out=moved)

    fly(simulation, look)
    wrench = np.array(wrenches)
    force, torque = (np.linalg.norm(part, axis=1) for part in (wrench[:, :3], wrench[:, 3:]))
    strongest = int(np.argmax(force))
    where = START + SPEED * strongest * simulation.time_step
    print(f'through {END - START:g} m at {SPEED:g} m/s, {len(simulation.poses)} branches')
    print(f'largest force   {force.max():6.1f} N at x = {where:.2f} m, '
          f'[{" ".join(f"{v:.1f}" for v in wrench[strongest, :3])}] N')
    print(f'largest torque  {torque.max():6.2f} N·m')
    lost = -wrench[:, 0].sum() * simulation.time_step
    fate = 'be stopped' if lost > _MASS * SPEED else 'get through'
    print(f'momentum lost   {lost:6.2f} N·s; {_MASS:g} kg have {_MASS * SPEED:g} N·s at this '
          f'speed, it would {fate}')
    print(f'branches moved  {np.count_nonzero(moved > 0.05)} by more than 5 cm, the farthest by '
          f'{moved.max():.2f} m; {simulation.bonds_broken} broke')


if __name__ == '__main__':
    main()
