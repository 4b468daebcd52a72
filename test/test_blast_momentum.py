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


"""Momentum of blasts: what leaves a wall carries what reached it, less what the ground got."""

from masonry_walls import bonded, wall, wall_boxes
import numpy as np
from numpy.testing import assert_allclose
import pytest

from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.blasts import on_everything


def stand(built, **settings):
    """Make a simulation of a blueprint without gravity."""
    scene = Scene(Settings(gravity=0.0, **settings))
    scene.add(built)
    return Simulation(scene)


def reached(simulation, point, charge):
    """Sum what a charge gives to everything [N·s], (3,)."""
    return sum(gift.linear.sum(axis=0) for _, gift in on_everything(
        simulation.model, simulation.state, point, charge, 0.0))


def flying(simulation):
    """Sum the momentum of what flies [N·s], (3,)."""
    rows = list(simulation.state.bodies.members)
    bodies = simulation.state.world.bodies
    return bodies.mass[rows] @ bodies.velocities[rows, :3]


def random_case(seed):
    """Choose a wall, its thickness and mortar, what hides part of it, and a charge before it."""
    rng = np.random.default_rng(seed)
    length, courses = int(rng.integers(10, 20)), int(rng.integers(12, 24))
    boxes = [wall_boxes(length, courses, shift=(0.0, 0.1125 * leaf, 0.0))
             for leaf in range(int(rng.integers(1, 3)))]
    strength = float(10.0 ** rng.uniform(4.0, 5.5))
    middle = 0.225 * length * rng.uniform(0.3, 0.7)
    if rng.random() < 0.5:  # a block of steel hides the foot
        boxes.append((np.array([[middle, -0.5, 0.3]]), np.array([[0.225 * length, 0.2, 0.6]])))
    centres, sizes = (np.vstack(column) for column in zip(*boxes))
    density = np.where(sizes[:, 0] > 1.0, 7800.0, 1900.0)
    built = bonded(centres, sizes, density, tension=strength, cohesion=strength)
    return built, (middle, -float(rng.uniform(1.5, 4.0)), 1.0), float(rng.uniform(8.0, 30.0))


@pytest.mark.parametrize('seed', range(8))
def test_debris_carries_what_reached_it_at_most(seed):
    """Blow walls about: the books agree with what flies, and never say more than the wave gave."""
    built, point, charge = random_case(seed)
    simulation = stand(built)
    given = reached(simulation, point, charge)
    simulation.explode(point, charge)
    simulation.step(6)
    ledger = simulation.state.ledger
    assert_allclose(ledger.waves, given, rtol=1e-9, atol=1e-6)
    assert 0.3 * given[1] < ledger.blown[1] <= given[1] * (1.0 + 1e-9)
    assert flying(simulation)[1] <= 1.005 * ledger.blown[1]


@pytest.mark.parametrize('step', [1 / 20, 1 / 60, 1 / 240])
def test_a_block_in_the_open_keeps_all_of_it(step):
    """Apply the whole impulse to a dry block, which nothing holds back, at every time step."""
    built = bonded([[0.0, 10.0, 0.5]], [[1.0, 1.0, 1.0]], 500.0, tension=0.0, cohesion=0.0,
                   friction=0.0)
    simulation = stand(built, time_step=step)
    given = reached(simulation, (0.0, 0.0, 1.0), 30.0)
    simulation.explode((0.0, 0.0, 1.0), 30.0)
    simulation.step(round(0.1 / step))
    assert_allclose(flying(simulation)[1], given[1], rtol=0.01)


def test_debris_has_the_same_momentum_at_every_time_step():
    """Compare what leaves a wall at 1/20, 1/60 and 1/240 s, within 3 %."""
    found = []
    for step in (1 / 20, 1 / 60, 1 / 240):
        simulation = stand(wall(16, 24), time_step=step)
        simulation.explode((1.8, -3.0, 1.0), 20.0)
        simulation.step(round(0.1 / step))
        found.append(simulation.state.ledger.blown[1])
    assert max(found) < 1.03 * min(found)


def test_what_a_wave_does_not_reach_gets_nothing_besides():
    """Throw a wall over of which a strip is in the shadow: it adds nothing to the momentum."""
    centres, sizes = wall_boxes(24, 32)
    built = bonded(np.vstack([centres, [[2.7, -0.3, 1.3]]]), np.vstack([sizes, [[0.6, 0.2, 2.6]]]),
                   np.append(np.full(len(centres), 1900.0), 20_000.0))
    simulation = stand(built)
    given = reached(simulation, (2.7, -4.0, 1.2), 3.0)
    simulation.explode((2.7, -4.0, 1.2), 3.0)
    simulation.step(30)
    left = centres[simulation.state.standing[:len(centres)]]
    assert len(left) < 10 and (left[:, 2] < 0.15).all()  # on the ground, behind the strip
    assert (np.abs(left[:, 0] - 2.7) < 0.3 + 0.3).all()
    assert 0.8 * given[1] < flying(simulation)[1] < 1.001 * given[1]
