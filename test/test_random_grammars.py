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


"""No ordinary grammar fails: thousands of random trees and walls, in wind, struck and shot at."""

from energy_ledger import EnergyLedger
from hypothesis import given, HealthCheck, Phase, settings
from hypothesis import strategies as st
import numpy as np
from random_grammars import even, trees, walls
from random_scenes import faults

from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_SCENES = 50  # of 40 grammars each; hypothesis varies what it drew: some 530 of the 2,000 differ


@settings(max_examples=_SCENES, derandomize=True, database=None, deadline=None,
          phases=[Phase.generate], suppress_health_check=list(HealthCheck))
@given(st.lists(trees(), min_size=38, max_size=38), st.lists(walls(), min_size=2, max_size=2),
       even(0.0, 50.0))
def test_random_grammars_neither_fail_nor_make_energy(grown, built, wind):
    """Simulate 60 steps of 40 grammars side by side: all finite, no energy from nothing."""
    found = list(faults(grown + built, wind))
    assert not found, '\n'.join(found)


def test_the_ledger_sees_energy_from_nothing():
    """Keep within the bound in a storm; pass it by an impulse that nobody has booked."""
    scene = Scene()
    scene.add(LSystem.parse('axiom: !(0.05) F(0.04) F(1.2) [ &(40) F ] F').build(), name='tree')
    simulation = Simulation(scene)
    simulation.set_wind((0.0, 20.0, 0.0))
    ledger = EnergyLedger(simulation, np.zeros(0))
    for _ in range(30):
        simulation.step()
        ledger.note()
        assert ledger.kinetic()[0] <= ledger.bound()[0]
    mass = float(simulation.blueprint.mass[-1])
    ledger.struck(3, 5.0 * mass)
    simulation.apply_impulse('tree/3', (5.0 * mass, 0.0, 0.0))
    simulation.step()
    ledger.note()
    assert 0.0 < ledger.kinetic()[0] <= ledger.bound()[0]
    simulation.apply_impulse('tree/3', (30.0 * mass, 0.0, 0.0))
    simulation.step()
    ledger.note()
    assert ledger.kinetic()[0] > ledger.bound()[0]
