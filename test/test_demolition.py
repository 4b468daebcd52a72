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


"""Demolition: timed charges in walls."""

from masonry_walls import building, wall
import numpy as np
import pytest

from procphys_ros.errors import CommandError
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Demolition
from procphys_ros.simulation import Cause, demolition, Simulation

DT = 1.0 / 60.0


def stand(built):
    """Give a simulation of one building."""
    scene = Scene()
    scene.add(built, name='house')
    return Simulation(scene)


def test_charges_go_off_in_their_order_at_their_time():
    """Fire each charge in the step that holds its moment, whatever the order of the list."""
    simulation = stand(wall(30, 16))
    assert simulation.demolish(Demolition([0.5, 0.1], [1.0, 0.0, 0.6, 5.5, 0.0, 0.6],
                                          [0.3, 0.3])) == 2
    moments = {}
    for _ in range(60):
        simulation.step()
        for x in (1.0, 5.5):
            near = np.linalg.norm(simulation.blueprint.poses[:, :3] - [x, 0.0, 0.6], axis=1) < 0.1
            if np.isnan(simulation.poses[near, 0]).any():
                moments.setdefault(x, simulation.time)
    assert moments[5.5] == pytest.approx(0.1, abs=1.01 * DT)
    assert moments[1.0] == pytest.approx(0.5, abs=1.01 * DT)


def test_a_charge_turns_its_surroundings_to_dust_and_throws_the_rim():
    """Take away what is inside, throw what is at the rim, and spare all else."""
    simulation = stand(wall(30, 16))
    distance = np.linalg.norm(simulation.blueprint.poses[:, :3] - [3.0, 0.0, 0.6], axis=1)
    simulation.demolish(Demolition([0.0], [3.0, 0.0, 0.6], [0.5]))
    simulation.step(1)
    gone = np.isnan(simulation.poses[:, 0])
    assert gone[distance < 0.44].all() and not gone[distance > 0.46].any()
    rim = (distance > 0.46) & (distance < 0.49)
    assert rim.any() and not simulation.state.standing[rim].any()
    assert simulation.state.standing[distance > 1.0].all()
    events = simulation.events
    assert len(events) and (events['cause'] == Cause.DEMOLITION).mean() > 0.8


def test_a_small_charge_leaves_an_arch():
    """Let a wall span the hole of a charge: nothing but the charge breaks it."""
    simulation = stand(wall(30, 40))
    simulation.demolish(Demolition([0.0], [3.3, 0.0, 0.6], [0.4]))
    simulation.step(120)
    above = np.abs(simulation.blueprint.poses[:, 0] - 3.3) < 0.5
    above &= simulation.blueprint.poses[:, 2] > 2.0
    assert simulation.state.standing[above].all()


def test_a_building_without_its_ground_floor_comes_down():
    """Implode a building by the default plan: its top falls, its roof ends near the ground."""
    simulation = stand(building(side=12, storeys=1, courses=34, windows=2))
    top = np.argsort(simulation.poses[:, 2])[-20:]
    height = simulation.poses[top, 2].mean()
    assert simulation.demolish() > 4
    simulation.step(240)
    there = top[np.isfinite(simulation.poses[top, 0])]
    assert simulation.poses[there, 2].mean() < height - 1.0
    assert np.nanmin(simulation.poses[:, 2]) > -0.02


def test_default_charges_are_fired_from_the_middle_out():
    """Lay charges along the walls, the later the farther from the middle."""
    simulation = stand(building(side=12, storeys=1, courses=34, windows=2))
    plan = demolition.implosion(simulation.model, simulation.state)
    away = np.linalg.norm(plan.places[:, :2] - plan.places[:, :2].mean(axis=0), axis=1)
    assert np.all(np.diff(np.asarray(plan.delays)[np.argsort(away)]) >= 0.0)
    assert (plan.places[:, 2] > 0.2).all() and (plan.places[:, 2] < 2.2).all()


@pytest.mark.parametrize(('plan', 'word'), [
    (([0.0], [], [1.0]), 'three numbers'), (([0.0], [0, 0, 1], []), 'radii'),
    (([-1.0], [0, 0, 1], [1.0]), 'delays'), (([0.0], [0, 0, 1], [0.0]), 'radii'),
    (([float('nan')], [0, 0, 1], [1.0]), 'delays'), (([0.0], [0, 0, 'x'], [1.0]), 'positions'),
])
def test_bad_plans_are_refused(plan, word):
    """Refuse lists that do not fit together and numbers out of range."""
    with pytest.raises(CommandError, match=word):
        Demolition(*plan)


def test_there_must_be_something_to_demolish():
    """Refuse to demolish an empty scene."""
    with pytest.raises(CommandError, match='no building'):
        Simulation(Scene()).demolish()


def test_reset_disarms_charges():
    """Forget charges that have not gone off."""
    simulation = stand(wall(10, 10))
    simulation.demolish(Demolition([0.2], [1.0, 0.0, 0.4], [0.5]))
    simulation.reset()
    simulation.step(30)
    assert simulation.state.standing.all() and simulation.bonds_broken == 0
