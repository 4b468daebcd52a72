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
Time from cause to collapse: a pier in the middle of an arcade goes, and what it bore comes down.

For arcades of 4, 16 and 64 bays, whose joints lie alike, the simulated time until the wall above
the pier has lost the ground and until it has fallen by 10 cm, the iterations of the stress solver,
and the work per step until then. Run with `python bench/arcades.py [bays ...]`.
"""

import sys
from time import process_time

import numpy as np

from procphys_ros.files.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.simulation import breaking, Cause, Simulation
from procphys_ros.wallgrammar import WallGrammar

SPAN, PIER, SPRING = 2.25, 0.45, 0.8  # [m] ten bricks and two with their joints: bays are alike
HOLE = 1.15  # [m] height of what is knocked out: the pier and what springs from it
SECONDS = 5.0  # to wait for the fall at most


def knocked_out(bays, wall_height=2.2):
    """
    Build an arcade and take its middle pier away.

    :returns: the simulation, and the parts above that pier.
    """
    blueprint = WallGrammar.load(shared_folder() / 'grammars' / 'arcade.wall').build(
        seed=0, bays=bays, span=SPAN, pier=PIER, spring=SPRING, wall_height=wall_height)
    scene = Scene()
    scene.add(blueprint, name='arcade')
    simulation = Simulation(scene)
    x, z = blueprint.poses[:, 0], blueprint.poses[:, 2]
    left = bays // 2 * (SPAN + PIER)
    pier = np.flatnonzero((x > left) & (x < left + PIER) & (z < HOLE))
    above = np.flatnonzero((x > left) & (x < left + PIER) & (z > HOLE))
    breaking.destroy(simulation.model, simulation.state, pier, Cause.DEMOLITION, 1.0)
    return simulation, above


def main():
    """Print a row per arcade."""
    print('| bays | parts | loose after [s] | fallen 10 cm after [s] | bonds broken | iterations '
          '| mean step [ms] | longest [ms] |\n|---|---|---|---|---|---|---|---|')
    for bays in [int(number) for number in sys.argv[1:]] or [4, 16, 64]:
        simulation, above = knocked_out(bays)
        before, start = simulation.poses[above, 2], simulation.state.solver.spent
        loose, times = np.nan, []
        while simulation.time < SECONDS:
            begun = process_time()
            simulation.step()
            times.append(process_time() - begun)
            if np.isnan(loose) and not simulation.state.standing[above].all():
                loose = simulation.time
            if np.median(before - simulation.poses[above, 2]) > 0.1:
                break
        print(f'| {bays} | {len(simulation.blueprint)} | {loose:.2f} | {simulation.time:.2f} | '
              f'{simulation.bonds_broken} | {simulation.state.solver.spent - start} | '
              f'{1e3 * np.mean(times):.1f} | {1e3 * max(times):.0f} |', flush=True)
        simulation.close()


if __name__ == '__main__':
    main()
