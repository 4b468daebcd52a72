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


"""State of a simulation: who owns which part, what a step is made of, what commands reach."""

from building_checks import take_out
from masonry_walls import bonded, wall
import numpy as np
import pytest

from procphys_ros.errors import CommandError
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import EventLog, Simulation
from procphys_ros.simulation.parts import Columns, Owner
from procphys_ros.simulation.stages import Stage, STAGES

BRICK = [0.215, 0.1025, 0.065]  # [m]


def simulate(blueprint, name='wall'):
    """Make a simulation of one object in still air."""
    scene = Scene()
    scene.add(blueprint, name=name)
    return Simulation(scene)


def test_a_part_without_bonds_is_a_rigid_body():
    """Let a brick that nothing holds fall freely from the first step on."""
    simulation = simulate(bonded([[0.0, 0.0, 2.0]], BRICK, ground=False))
    assert simulation.state.parts.owner[0] == Owner.BODY
    simulation.step(30)
    fallen = 2.0 - simulation.poses[0, 2]
    assert fallen == pytest.approx(0.5 * 9.81 * 0.5 ** 2, rel=0.06)
    assert simulation.apply_impulse(0, (0.1, 0.0, 0.0))
    simulation.step()
    assert simulation.velocities[0, 0] == pytest.approx(0.1 / simulation.blueprint.mass[0],
                                                        rel=0.05)


def test_every_part_has_one_owner_all_the_time():
    """Follow owners while a wall loses bricks: standing, flying or gone, never two of them."""
    simulation = simulate(wall(8, 10))
    state = simulation.state
    assert (state.parts.owner == Owner.STANDING).all()
    take_out(simulation, np.array([40, 41]))
    simulation.launch(Projectile('sphere', 0.3, 40.0, (0.9, -2.0, 0.4), (0.0, 25.0, 0.0)))
    simulation.step(30)
    owner, body = state.parts.owner, state.parts.body
    assert set(owner[[40, 41]]) == {Owner.GONE} and not simulation.exists[[40, 41]].any()
    assert (owner == Owner.BODY).sum() > 1  # the ball, and what it knocked out
    assert (body[owner == Owner.GONE] == -1).all() and (body[owner != Owner.GONE] >= 0).all()
    assert np.isfinite(state.parts.poses).all()
    assert np.isnan(simulation.poses[40]).all() and np.isfinite(simulation.poses[0]).all()


def test_a_blow_beside_the_centre_turns_the_brick_that_comes_out():
    """Strike a weak brick at its end: it leaves its wall spinning about the vertical."""
    spins = []
    for side in (-0.1, 0.0, 0.1):
        simulation = simulate(wall(4, 4, tension=1e3, cohesion=1e3))
        place = simulation.poses[-1, :3] + [side, 0.0, 0.0]
        assert simulation.apply_impulse(len(simulation.poses) - 1, (0.0, 20.0, 0.0), point=place)
        simulation.step()
        spins.append(simulation.velocities[-1, 5])
    assert spins[0] < -1.0 < abs(spins[1]) + 1.0 and spins[2] > 1.0
    assert spins[0] == pytest.approx(-spins[2], rel=0.3)


def test_an_angular_impulse_loads_a_brick_that_holds():
    """Hand the moment of a blow on to the stresses of the wall."""
    simulation = simulate(wall(4, 6))
    state, top = simulation.state, len(simulation.poses) - 1
    before = state.solver.displacement[top].copy()
    assert not simulation.apply_impulse(top, angular=(3.0, 0.0, 0.0))
    simulation.step()
    turned = state.solver.displacement[top, 3:] - before[3:]
    assert abs(turned[0]) > 5.0 * max(abs(turned[1]), abs(turned[2])) > 0.0


def test_what_is_gone_takes_no_force():
    """Refuse impulses and lasting forces on parts that were pulverised."""
    simulation = simulate(wall(4, 4))
    take_out(simulation, np.array([3]))
    for command in (simulation.apply_impulse, simulation.apply_wrench):
        with pytest.raises(CommandError, match='exists no more'):
            command(3, (1.0, 0.0, 0.0))


def test_the_books_of_blows_add_up_and_stay_small():
    """Account for what a ball loses, in sums over all blows and in a list of bounded length."""
    simulation = simulate(wall(8, 10))
    simulation.launch(Projectile('sphere', 0.3, 40.0, (0.9, -2.0, 0.4), (0.0, 25.0, 0.0)))
    simulation.step(20)
    books = simulation.ledger
    assert books.count == len(simulation.impacts) > 0
    np.testing.assert_allclose(books.lost, books.carried + books.grounded, atol=1e-9)
    np.testing.assert_allclose(books.lost, sum(i.lost for i in simulation.impacts), atol=1e-9)
    assert books.recent.maxlen is not None


def test_a_log_of_nothing_stays_empty():
    """Record what broke a thousand times without anything broken: nothing is kept."""
    log, none = EventLog(), np.zeros(0, np.intp)
    for _ in range(1000):
        log.record(0.0, np.zeros((0, 3)), none, np.zeros((0, 2), np.intp), none, none)
    assert not log._chunks and log.total == 0 and not len(log.rows)


def test_a_load_given_in_a_step_acts_in_that_step():
    """Load a wall by a stage of one's own: the bonds carry it in the same step."""
    simulation = simulate(wall(3, 3))
    state, push = simulation.state, np.array([[0.0, 0.0, -500.0, 0.0, 0.0, 0.0]])
    names = [stage.name for stage in STAGES]

    def weigh():
        graph = state.solver.graph
        feet = graph.grounded()
        return (np.einsum('kij,kj->ki', graph.axes[feet], state.solver.wrenches()[feet, :3])
                * np.where(graph.first[feet] == graph.count, -1.0, 1.0)[:, None])[:, 2].sum()
    before = weigh()
    for name in ('cues', 'contact', 'branches'):
        place = names.index(name) + 1
        load = Stage('load', lambda model, state, dt: state.loads.set_layer('x', [8], push))
        simulation.stages = (*STAGES[:place], load, *STAGES[place:])
        simulation.step(1)
        assert weigh() - before == pytest.approx(500.0, rel=0.02), name
        state.loads.remove_layer('x')
        simulation.stages = STAGES
        simulation.step(20)


def test_every_stage_says_what_it_does():
    """Describe each stage where it stands, and time each by its name, which is its own."""
    assert len({stage.name for stage in STAGES}) == len(STAGES)
    for stage in STAGES:
        assert stage.step.__doc__, stage.name
    simulation = simulate(wall(3, 3))
    simulation.step(2)
    assert simulation.timings.keys() == {stage.name for stage in STAGES}


def test_a_stage_can_be_added():
    """Step a stage of somebody else's between the others."""
    simulation, seen = simulate(wall(3, 3)), []
    simulation.stages = (*STAGES, Stage('spy', lambda model, state, dt: seen.append(state.time)))
    simulation.step(3)
    assert seen == pytest.approx([0.0, 1 / 60, 2 / 60])
    assert 'spy' in simulation.timings


def test_columns_grow_and_keep_their_rows():
    """Append rows many times: all arrays stay whole and equally long."""
    columns = Columns(number=np.arange(3), place=np.zeros((3, 2)))
    for i in range(3, 50):
        columns.append(number=np.array([i]), place=np.full((1, 2), i))
    assert len(columns) == len(columns.number) == len(columns.place) == 50
    assert np.array_equal(columns.number, np.arange(50))
    assert columns.place[49, 1] == 49.0
