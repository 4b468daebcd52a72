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

"""Crowns of standing trees that touch where `trees.contact` asks for it."""

from grown_trees import beam, bush
import numpy as np
import pytest

from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_DT = 1.0 / 60.0  # [s]


def _two_poles(contact: bool, apart: float = 0.35) -> Simulation:
    """Stand two undamped poles of 5 m beside each other, in a vacuum but for the scene's air."""
    scene = Scene.from_parameters({'scene': {'objects': []}, 'trees': {'contact': contact}})
    for i in range(2):
        scene.add(beam(4, damping_ratio=0.0), (apart * i, 0.0, 0.0), 0.0, f'pole_{i}')
    return Simulation(scene)


def _swing(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """
    Hit the top of the first pole towards the second.

    :returns: energy after each step [J], (T,), and the second's largest way so far [m], (T,).
    """
    forest, second = simulation.state.forest, simulation.objects[1]
    simulation.apply_impulse(3, (40.0, 0.0, 0.0))
    simulation.step()
    energy, way = [forest.energy()], []
    parts = np.arange(second.first, second.first + second.count)
    for _ in range(150):
        simulation.step()
        energy.append(forest.energy())
        way.append(np.abs(simulation.poses[parts, :3]
                          - simulation.blueprint.poses[parts, :3]).max())
    return np.array(energy), np.array(way)


def test_poles_pass_through_each_other_unless_asked():
    """Leave the second pole exactly where it stands while the first sways through it."""
    energy, way = _swing(_two_poles(False))
    assert energy[0] > 10.0 and not way.any()


def test_poles_push_each_other_and_make_no_energy():
    """Move the second pole by a decimetre, and let the energy of both only fall."""
    energy, way = _swing(_two_poles(True))
    assert way.max() > 0.1
    assert np.diff(energy).max() <= 1e-3 * energy[0]


def test_poles_that_meet_keep_their_momentum():
    """
    Expect momentum to change by what the ground and the weight give, and by nothing else.

    The wrenches of the roots hold what the ground gives; contacts act inside.
    """
    simulation = _two_poles(True)
    forest, mass = simulation.state.forest, simulation.blueprint.mass
    roots = np.flatnonzero(forest.parents < 0)
    simulation.apply_impulse(3, (40.0, 0.0, 0.0))
    simulation.step()
    start = mass[forest.parts] @ forest.velocities[:, 0]
    given, met = 0.0, 0.0
    for _ in range(12):
        simulation.step()
        given += _DT * forest.joint_wrenches[roots, 0].sum()
        met += np.abs(simulation.state.contacts.impulse[:, 0]).sum()
    end = mass[forest.parts] @ forest.velocities[:, 0]
    assert met > 0.3 * start
    assert end - start == pytest.approx(given, abs=0.05 * met)


def test_crowns_that_grew_into_each_other_rest():
    """Leave trees alone whose branches were drawn through each other, in still air."""
    scene = Scene.from_parameters({'scene': {'objects': []}, 'trees': {'contact': True}})
    for i in range(3):
        scene.add(bush(40, seed=i), (0.3 * i, 0.0, 0.0), 0.0, f'bush_{i}')
    simulation = Simulation(scene)
    before = simulation.poses.copy()
    simulation.step(60)
    assert np.abs(simulation.poses - before).max() < 1e-6
