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

"""Cracked joints: walls pushed and let go, saved, broken in any order, and how soon they fall."""

from building_checks import standing
from masonry_walls import building, wall
import numpy as np
import pytest

from procphys_ros.files.resources import shared_folder
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.simulation import breaking, Cause, masonry, Simulation
from procphys_ros.wallgrammar import WallGrammar

G = 9.81  # [m/s²]
THICKNESS = 0.1025  # [m]


def pushed(tension=0.0, length=8):
    """Stand a wall in a simulation; return it, and how to push it by a share of what tips it."""
    plan = wall(length, 20, tension=tension, cohesion=1.5 * tension)
    simulation = standing(plan)
    face = plan.size[:, 0] * plan.size[:, 2]
    force = np.zeros((len(plan), 6))
    force[:, 1] = face * 0.5 * THICKNESS * G * plan.mass.sum() / (face * plan.poses[:, 2]).sum()

    def push(share, steps=60):
        simulation.state.loads.set_layer('push', np.arange(len(plan)), share * force)
        simulation.step(steps)
        return simulation.state.solver.equilibrium.openings().max(initial=0.0)
    return simulation, push


def test_a_dry_wall_pushed_to_and_fro_and_let_go_stands_closed(share=0.9):
    """Push a wall of a simulation both ways and let go: all bricks stand, no joint gapes."""
    simulation, push = pushed()
    widest = max(push(sign * share) for sign in (1.0, -1.0, 1.0, -1.0))
    assert widest > 1e-7
    assert push(0.0) < 0.02 * widest
    assert simulation.state.standing.all() and simulation.state.fracture.stable
    push(1.1)
    assert not simulation.state.standing.any()


def test_a_short_wall_that_leans_falls_under_the_little_that_it_lacks():
    """Push a dry wall two bricks long to 0.97 of what tips it, then a twentieth more: it falls."""
    simulation, push = pushed(length=2)
    push(0.97)
    assert simulation.state.standing.all()
    push(1.03)
    assert not simulation.state.standing.any()


def test_a_wall_of_poor_mortar_cracks_and_stands_again():
    """Crack a wall of 10 kPa by 0.7 of what tips it: nothing falls, and nothing stays open."""
    simulation, push = pushed(1e4)
    widest = push(0.7, 120)
    assert simulation.state.solver.graph.cracked.sum() > 10
    assert push(0.0) < 0.02 * widest
    assert simulation.state.standing.all()


def test_a_snapshot_keeps_cracked_joints():
    """Save a wall that is pushed half open, let go there and in the copy: bit for bit the same."""
    simulation, push = pushed()
    push(0.9, 3)
    saved = simulation.save()
    runs = []
    for _ in range(2):
        simulation.step(60)
        solver = simulation.state.solver
        runs.append((solver.graph.cracked.copy(), solver.displacement.copy()))
        simulation.restore(saved)
    assert runs[0][0].any()
    for one, two in zip(*runs):
        np.testing.assert_array_equal(one, two)


def test_cracked_joints_survive_what_joins_the_scene():
    """Add a wall beside one that is pushed open: it stays as it is, and closes later."""
    simulation, push = pushed()
    widest = push(0.9)
    cracked = simulation.state.solver.graph.cracked.sum()
    simulation.add(wall(3, 4), (5.0, 5.0, 0.0), name='other')
    solver = simulation.state.solver
    assert solver.graph.cracked.sum() == cracked > 0
    assert solver.equilibrium.openings().max() == pytest.approx(widest, rel=1e-6)
    simulation.step(30)
    assert simulation.state.standing.all()
    assert push(0.0) < 0.02 * widest


@pytest.mark.parametrize('seed', [15, 67, 84])
def test_a_cracked_wall_under_loads_that_it_bears_finds_its_balance(seed):
    """Crack joints around a window at random, and push on three bricks: balanced before long."""
    # As long as friction moved along with what was pressed in each of Newton's steps, these three
    # walls went round in circles within micrometres, until patience ran out.
    rng = np.random.default_rng(seed)
    plan = wall(10, 20, [(0.7, 0.4, 1.4, 1.0)])
    solver = StressSolver(BondGraph(plan))
    solver.iterate(5000)
    solver.crack(np.flatnonzero(rng.random(len(solver.graph)) < rng.uniform(0.2, 0.8)))
    solver.iterate(5000)
    force, pushed = np.zeros((len(plan), 3)), rng.integers(len(plan), size=3)
    force[pushed, 1] = rng.uniform(2.0, 12.0) * G * plan.mass[pushed]
    spent = solver.spent
    solver.set_loads(force)
    solver.iterate(2000)
    assert solver.converged and solver.spent - spent < 600


def without(plan, order, turns, each):
    """Take parts out in turns, with so many iterations at a time; say which parts stand then."""
    fracture = Fracture(StressSolver(BondGraph(plan)))
    fracture.advance(5000)
    solver = fracture.solver
    for group in np.array_split(order, turns):
        solver.cut(solver.graph.neighbours(group[solver.supported[group]]), 2.0)
        while not fracture.stable:
            fracture.advance(each)
    return solver.supported.copy()


def a_pier_of_an_arcade(**strengths):
    """Return a wall with three openings, and the bricks of a pier between two of them."""
    plan = wall(28, 26, [(0.9 + 1.8 * k, -0.1, 1.8 + 1.8 * k, 1.2) for k in range(3)],
                **strengths)
    x, z = plan.poses[:, 0], plan.poses[:, 2]
    return plan, np.flatnonzero((x > 1.8) & (x < 2.7) & (z < 1.2))


def a_corner_of_a_house(tension):
    """Return a house with a slab, and the bricks of a corner of it."""
    plan = building(side=12, storeys=1, courses=20, windows=2, tension=tension,
                    cohesion=1.25 * tension)
    x, y, z = plan.poses[:, :3].T
    return plan, np.flatnonzero((x < 0.6) & (y < 0.6) & (z < 0.8))


@pytest.mark.parametrize(('plan', 'gone'), [
    a_pier_of_an_arcade(), a_corner_of_a_house(0.05e6)], ids=['arcade', 'house of lime mortar'])
def test_what_stands_does_not_depend_on_the_order_of_breaking(plan, gone):
    """Knock a pier or a corner out in three orders: the same stands, within 5 % of the parts."""
    stands = [without(plan, np.random.default_rng(seed).permutation(gone), 6, 50).sum()
              for seed in range(3)]
    assert max(stands) - min(stands) < 0.05 * len(plan)


def test_what_stands_does_not_depend_on_iterations_per_step():
    """Knock a corner out, with 3 and 1000 iterations at a time: the very same parts stand."""
    plan, gone = a_corner_of_a_house(0.05e6)
    runs = [without(plan, gone, 1, each) for each in (3, 1000)]
    assert 0 < runs[0].sum() < len(plan) - len(gone)
    np.testing.assert_array_equal(runs[0], runs[1])


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


def push(courses, course, shares):
    """Push a course of some walls by shares of what tips them; return which walls stand."""
    built, thickness = wall(12, courses), 0.1025
    z, mass = built.poses[:, 2], built.mass.sum()
    height, at = z.min() + z.max(), np.unique(z.round(6))[course]
    barrier = mass * 9.81 * 0.5 * (np.hypot(height, thickness) - height)
    row = np.flatnonzero(np.abs(z - at) < 1e-3)
    impulse = np.sqrt(2.0 * barrier * mass / 3.0) * height / at / len(row)
    scene = Scene(Settings())
    for place in range(len(shares)):
        scene.add(built, (0.0, 8.0 * place, 0.0))
    simulation = Simulation(scene)
    for place, share in enumerate(shares):
        masonry.apply_impulses(simulation.state, row + place * len(built),
                               np.tile([0.0, share * impulse, 0.0], (len(row), 1)), speed=10.0)
    simulation.step(40)
    stands = simulation.state.standing[:len(shares) * len(built)].reshape(len(shares), -1)
    assert (stands.all(axis=1) | ~stands.any(axis=1)).all()
    return stands[:, 0].tolist()


@pytest.mark.parametrize('courses, course', [(16, 2), (16, 8), (16, 14), (30, 5), (30, 14)])
def test_a_free_wall_overturns_by_the_energy_of_its_blow(courses, course):
    """
    Push a course: the wall tips beyond the energy that lifts its centre over its edge.

    It does so at 0.86 of that impulse: the motion found turns about a line within the edge.
    """
    assert push(courses, course, [0.8]) == [True]
    assert push(courses, course, [1.0]) == [False]


def test_each_mechanism_takes_its_own_energy():
    """Push three walls at once: those fall that fall alone."""
    assert push(16, 8, [0.8, 1.5, 0.7]) == [True, False, True]
