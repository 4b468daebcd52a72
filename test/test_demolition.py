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
from procphys_ros.simulation import Cause, charges, Simulation

DT = 1.0 / 60.0
PLACE, RADIUS = [3.0, 0.0, 0.6], 0.59


def stand(built):
    """Make a simulation of one building."""
    scene = Scene()
    scene.add(built, name='house')
    return Simulation(scene)


def test_charges_go_off_in_their_order_at_their_time():
    """Fire each charge in the step that holds its moment, whatever the order of the list."""
    simulation = stand(wall(30, 16))
    assert simulation.demolish(Demolition([0.5, 0.1], [1.0, 0.0, 0.6, 5.5, 0.0, 0.6],
                                          [0.3, 0.3])) == 2
    moments, poses = {}, simulation.blueprint.poses
    for _ in range(60):
        simulation.step()
        for x in (1.0, 5.5):
            near = np.linalg.norm(poses[:, :3] - [x, 0.0, 0.6], axis=1) < 0.1
            if np.isnan(simulation.poses[:len(near)][near, 0]).any():
                moments.setdefault(x, simulation.time)
    assert moments[5.5] == pytest.approx(0.1, abs=1.01 * DT)
    assert moments[1.0] == pytest.approx(0.5, abs=1.01 * DT)


@pytest.fixture(scope='module')
def fired():
    """Fire one charge in the middle of a wall, and give the simulation after that step."""
    simulation = stand(wall(30, 16))
    simulation.demolish(Demolition([0.0], PLACE, [RADIUS]))
    while simulation.state.charges:  # its own stage, before the engine moves anything
        charges.step(simulation.model, simulation.state, DT)
    return simulation


def momenta(simulation):
    """Compute the momentum of all existing parts [N·s], (K, 3)."""
    there = simulation.exists
    return simulation.blueprint.mass[there, None] * simulation.velocities[there, :3]


def bodies(simulation):
    """Return masses and velocities of the loose bodies, (K,), (K, 3)."""
    ids = np.array(list(simulation.state.bodies.members))
    table = simulation.state.world.bodies
    return table.mass[ids], table.velocities[ids, :3]


def test_a_charge_breaks_what_it_reaches_and_nothing_else(fired):
    """Loosen all within the radius, break the nearest bricks, and let the rest stand."""
    count = len(fired.model.blueprint)
    distance = np.linalg.norm(fired.model.blueprint.poses[:, :3] - PLACE, axis=1)
    stands = fired.state.standing[:count]
    np.testing.assert_array_equal(stands, distance >= RADIUS)
    broken = np.flatnonzero(~fired.exists)
    assert 10 < len(broken) < np.count_nonzero(~stands)
    assert distance[broken].max() < np.sort(distance[~stands & fired.exists[:count]])[0]
    kinds = np.array(fired.blueprint.kinds)[fired.blueprint.kind]
    assert np.count_nonzero(kinds == 'fragment') == 4 * len(broken)
    assert np.all(fired.events['cause'] == Cause.DEMOLITION)


def test_a_charge_loses_no_mass(fired):
    """Weigh bricks and fragments: as much as the wall before."""
    there = fired.exists
    assert fired.blueprint.mass[there].sum() == pytest.approx(fired.model.blueprint.mass.sum(),
                                                              rel=1e-12)
    low = np.flatnonzero(~there)
    for name, weight in (('mass', 1.0), ('volume', 1.0 / fired.model.blueprint.density[0])):
        kinds = np.array(fired.blueprint.kinds)[fired.blueprint.kind]
        pieces = weight * fired.blueprint.mass[kinds == 'fragment'].sum()
        assert pieces == pytest.approx(weight * fired.blueprint.mass[low].sum(), rel=1e-12), name


def test_charges_throw_to_both_sides_by_the_energy_of_their_gas(fired):
    """Compare speeds with √(2·0.03·4.2 MJ/kg·0.5 kg/m³/ρ), and half of that at the rim."""
    mass, velocity = bodies(fired)
    speed = np.linalg.norm(velocity, axis=1)
    most = np.sqrt(2.0 * 0.03 * 4.2e6 * 0.5 / 1900.0)
    assert 0.95 * most < speed.max() <= most * (1.0 + 1e-9)
    assert 0.5 * most * (1.0 - 1e-9) <= speed.min() < 0.6 * most
    out = np.sign(velocity[:, 1])
    assert np.all(np.abs(velocity[:, 1]) > 0.8 * speed)
    assert mass[out > 0].sum() == pytest.approx(mass[out < 0].sum(), rel=0.1)


def test_the_ledger_knows_what_charges_threw(fired):
    """Sum up the momentum of all bodies; what stands got the same the other way."""
    mass, velocity = bodies(fired)
    np.testing.assert_allclose(fired.ledger.thrown, mass @ velocity, rtol=1e-9, atol=1e-9)
    energy = 0.5 * mass @ (velocity ** 2).sum(axis=1)
    assert fired.ledger.released == pytest.approx(energy, rel=1e-9)
    total = np.linalg.norm(velocity, axis=1) @ mass
    assert np.linalg.norm(fired.ledger.thrown) < 0.1 * total  # both sides are alike


def test_what_a_charge_throws_never_becomes_faster():
    """Follow all that flies for a second: it gains no more than by its fall."""
    simulation = stand(wall(30, 16))
    simulation.demolish(Demolition([0.0], PLACE, [0.5]))
    weight = simulation.blueprint.mass.sum()
    most = np.sqrt(2.0 * 0.03 * 4.2e6 * 0.5 / 1900.0)
    for _ in range(60):
        simulation.step()
        assert np.linalg.norm(simulation.velocities[:, :3], axis=1).max() < np.hypot(
            most, np.sqrt(2.0 * 9.81 * 1.3)) + 0.3
    assert simulation.blueprint.mass[simulation.exists].sum() == pytest.approx(weight, rel=1e-12)
    assert np.nanmin(simulation.poses[:, 2]) > -0.02


def test_a_small_charge_leaves_an_arch():
    """Let a wall span the hole of a charge: nothing but the charge breaks it."""
    simulation = stand(wall(30, 40))
    simulation.demolish(Demolition([0.0], [3.3, 0.0, 0.6], [0.4]))
    simulation.step(60)
    above = np.abs(simulation.blueprint.poses[:, 0] - 3.3) < 0.5
    above &= simulation.blueprint.poses[:, 2] > 2.0
    assert simulation.state.standing[above].all()


def test_default_charges_are_fired_from_the_middle_out():
    """Lay charges along the walls, the later the farther from the middle."""
    simulation = stand(building(side=12, storeys=1, courses=34, windows=2))
    plan = charges.implosion(simulation.model, simulation.state)
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
