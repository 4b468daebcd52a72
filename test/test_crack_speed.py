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

import numpy as np
import pytest

from procphys_ros.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.simulation import Cause, fragments, Simulation
from procphys_ros.wallgrammar import WallGrammar

SPAN, PIER, SPRING = 1.125, 0.45, 0.8  # [m] five bricks and two with their joints: bays are alike
HOLE = 1.15  # [m] without its pier alone an arcade may stand: its bays arch over the gap (ADR 44)
FRAME = 1.0 / 60.0  # [s]


def fall(bays, time_step=FRAME):
    """Knock out a pier with the springings on it; give when the wall above has come down [s]."""
    blueprint = WallGrammar.load(shared_folder() / 'grammars' / 'arcade.wall').build(
        seed=0, bays=bays, span=SPAN, pier=PIER, spring=SPRING, wall_height=1.9)
    scene = Scene()
    scene.add(blueprint, name='arcade')
    simulation = Simulation(scene, time_step=time_step)
    x, z = blueprint.poses[:, 0], blueprint.poses[:, 2]
    over = (x > bays // 2 * (SPAN + PIER)) & (x < bays // 2 * (SPAN + PIER) + PIER)
    pier, above = np.flatnonzero(over & (z < HOLE)), np.flatnonzero(over & (z > HOLE))
    fragments.destroy(simulation.model, simulation.state, pier, Cause.DEMOLITION, 1.0)
    while np.median(z[above] - simulation.poses[above, 2]) < 0.1:
        simulation.step()
        assert simulation.time < 2.0
    taken = simulation.time
    simulation.close()
    return taken


def test_an_arcade_falls_as_fast_however_long_it_is():
    """Take a pier out of 4 and of 24 bays, and step finely: what it bore falls after the same."""
    short = fall(4)
    assert short < 0.7
    assert fall(24) == pytest.approx(short, abs=2.1 * FRAME)  # 4 to 64 bays take 0.55 to 0.58 s
    assert fall(4, FRAME / 4.0) == pytest.approx(short, abs=2.1 * FRAME)
