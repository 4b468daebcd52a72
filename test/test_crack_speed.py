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

"""Test that the time from cause to collapse depends on the structure, not on its size."""

from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.files.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.simulation import breaking, Cause, masonry, Simulation
from procphys_ros.wallgrammar import WallGrammar

SPAN, PIER, SPRING = 2.25, 0.45, 0.8  # [m] ten bricks and two with their joints: bays are alike
HOLE = 1.15  # [m] height of what is knocked out: the pier and what springs from it
FRAME = 1.0 / 60.0  # [s]


def arcade(bays):
    """Build an arcade."""
    return WallGrammar.load(shared_folder() / 'grammars' / 'arcade.wall').build(
        seed=0, bays=bays, span=SPAN, pier=PIER, spring=SPRING, wall_height=2.2)


def fall(blueprint, bays):
    """Knock out a pier and what springs from it; return when what it bore comes loose [s]."""
    scene = Scene(Settings(engine='native'))  # to let bricks loose takes it no time
    scene.add(blueprint, name='arcade')
    simulation = Simulation(scene, time_step=FRAME)
    x, z = blueprint.poses[:, 0], blueprint.poses[:, 2]
    over = (x > bays // 2 * (SPAN + PIER)) & (x < bays // 2 * (SPAN + PIER) + PIER)
    pier, above = np.flatnonzero(over & (z < HOLE)), np.flatnonzero(over & (z > HOLE))
    breaking.destroy(simulation.model, simulation.state, pier, Cause.DEMOLITION, 1.0)
    loose = np.inf
    while np.median(z[above] - simulation.poses[above, 2]) < 0.1:
        simulation.step()
        assert simulation.time < 0.6
        if simulation.state.standing[above].mean() < 0.5:
            loose = min(loose, simulation.time)
    simulation.close()
    return loose


def test_an_arcade_falls_as_fast_however_long_it_is():
    """Take a pier out of 4 and of 6 bays: what it bore comes loose as soon."""
    short = fall(arcade(4), 4)
    assert short < 0.25
    assert fall(arcade(6), 6) == pytest.approx(short, abs=2.1 * FRAME)


@pytest.mark.parametrize('time_step', [FRAME, FRAME / 4.0])
def test_rounds_under_a_blow_have_their_pace(time_step):
    """Strike a wall so that joints crack far beyond their strength: once in 1/60 s at most."""
    scene = Scene(Settings(engine='native'))  # to let bricks loose takes it no time
    scene.add(wall(14, 20, tension=0.4e6, cohesion=0.5e6))
    simulation = Simulation(scene, time_step=time_step)
    masonry.apply_impulses(simulation.state, np.arange(130, 134),
                           np.tile([0.0, 200.0, 0.0], (4, 1)))
    cracked = []
    for _ in range(round(0.05 / time_step)):
        count = len(simulation.events)
        simulation.step()
        if len(simulation.events) > count:
            cracked.append(simulation.time)
    assert len(cracked) > 1 and (simulation.events['load'] > 3.0).any()
    assert np.diff(cracked).min() > FRAME - 1e-6
