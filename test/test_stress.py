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

"""Stresses of walls: against closed forms, superposed, factorised, and in whole buildings."""

from pathlib import Path

from masonry_walls import blueprint, bonded, building, DENSITY, wall, wall_boxes
import numpy as np
import pytest
from scipy.sparse import bsr_matrix, csc_matrix
from scipy.sparse.linalg import spsolve

from procphys_ros.blueprint import Blueprint, chain
from procphys_ros.geometry import rotation
from procphys_ros.physics.masonry import BondGraph, StressSolver
from procphys_ros.physics.masonry.factor import Factor, solve
from procphys_ros.wallgrammar import WallGrammar

G = 9.81  # [m/s²]
TIGHT = 1e-6  # [N]


def solved(plan, tolerance=TIGHT, gravity=(0.0, 0.0, -G), force=None, moment=None):
    """Solve to a tolerance and insist on convergence."""
    solver = StressSolver(BondGraph(plan), gravity, tolerance)
    if force is not None:
        solver.set_loads(force, moment)
    solver.iterate(5000)
    assert solver.converged
    return solver


def stack(masses, side=0.2, height=0.1):
    """Stack cubes of given masses on the ground; the middle of one is `height` above the last."""
    count = len(masses)
    centres = np.column_stack([np.zeros((count, 2)), (np.arange(count) + 0.5) * height])
    size = np.tile([side, side, height - 0.005], (count, 1))
    return bonded(centres, size, np.asarray(masses) / size.prod(axis=1))


def random_plan(rng, count):
    """Tie random points in space by randomly oriented bonds, some to the ground."""
    centres = rng.uniform(-1.0, 1.0, (count, 3))
    tree = np.column_stack([rng.integers(0, np.arange(1, count)), np.arange(1, count)])
    extra = rng.integers(0, count, (2 * count, 2))
    ground = np.column_stack([np.full(5, -1), rng.choice(count, 5, replace=False)])
    pairs = np.vstack([tree, extra[extra[:, 0] != extra[:, 1]], ground])
    turn = rng.normal(size=(len(pairs), 4))
    middle = np.where(pairs[:, :1] < 0, centres[pairs[:, 1]], centres[pairs].mean(axis=1))
    frames = np.hstack([middle + rng.normal(0.0, 0.05, (len(pairs), 3)),
                        turn / np.linalg.norm(turn, axis=1, keepdims=True)])
    return blueprint(centres, rng.uniform(0.05, 0.2, (count, 3)), pairs, frames,
                     rng.uniform(0.05, 0.3, (len(pairs), 2)), normal=1e9, shear=0.3e9)


def dense_stiffness(plan):
    """Assemble K from 6x12 maps bond by bond, in plain numpy, ground removed."""
    count = len(plan)
    matrix = np.zeros((6 * count + 6, 6 * count + 6))
    for k, (i, j) in enumerate(plan.bonds):
        axes = rotation.to_matrix(plan.bond_frame[k, 3:])
        length, width = plan.bond_extent[k]
        area = plan.bond_area[k]
        normal, shear = plan.mortar.normal_stiffness[k], plan.mortar.shear_stiffness[k]
        inertia = area / 12 * np.array([width ** 2, length ** 2])
        spring = np.diag([shear * area, shear * area, normal * area, *(normal * inertia),
                          shear * inertia.sum()])
        local = np.zeros((6, 12))
        rows = np.concatenate([6 * (body if body >= 0 else count) + np.arange(6)
                               for body in (i, j)])
        for body, at, sign in ((i, 0, -1.0), (j, 6, 1.0)):
            arm = plan.bond_frame[k, :3] - (plan.poses[body, :3] if body >= 0 else 0)
            cross = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
            local[:3, at:at + 3] = sign * axes.T
            local[:3, at + 3:at + 6] = -sign * axes.T @ cross
            local[3:, at + 3:at + 6] = sign * axes.T
        matrix[np.ix_(rows, rows)] += local.T @ spring @ local
    return matrix[:6 * count, :6 * count]


@pytest.mark.report('laws')
def test_cantilever_root_moment_and_deflection(measured):
    """Bend a row of bricks by its weight: M at each joint and the tip of the spring chain."""
    count, pitch, side = 8, 0.2, 0.1
    centres = np.column_stack([(np.arange(count) + 0.5) * pitch, np.zeros((count, 2))])
    frame = np.column_stack([np.arange(count) * pitch, np.zeros((count, 2)),
                             np.tile([0.0, 0.5 ** 0.5, 0.0, 0.5 ** 0.5], (count, 1))])
    pairs = np.column_stack([np.arange(-1, count - 1), np.arange(count)])
    plan = blueprint(centres, np.tile([pitch, side, side], (count, 1)), pairs, frame,
                     np.full((count, 2), side))
    solver = solved(plan)
    weight, area = plan.mass[0] * G, side ** 2
    beyond = np.arange(count, 0, -1)
    moment = weight * pitch * beyond ** 2 / 2
    wrench = solver.wrenches()
    np.testing.assert_allclose(np.linalg.norm(wrench[:, 3:], axis=1), moment, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(wrench[:, :2], axis=1), weight * beyond, rtol=1e-6)
    turn = moment / (1e11 * area * side ** 2 / 12)
    slip = weight * beyond / (0.4e11 * area)
    tip = np.sum(slip + turn * (centres[-1, 0] - frame[:, 0]))
    measured('tip of a cantilever of eight bricks, chain of springs',
             -solver.displacement[count - 1, 2], tip, 'm', rtol=1e-6)
    share, _ = solver.utilisation()
    measured('stress over strength at the root of that cantilever, M/(W·f)', share[0],
             moment[0] / (side ** 3 / 6) / 0.2e6, rtol=1e-6)


@pytest.mark.parametrize(('tension', 'expected'), [(0.2e6, 0.072), (0.1e6, 0.043), (0.0, 0.014)])
@pytest.mark.report('laws')
def test_free_standing_wall_cracks_at_the_closed_form_acceleration(tension, expected, measured):
    """Reach utilisation 1 at a/g = (f_t + ρ g h) t / (3 ρ g h²) for a wall 2.5 m high."""
    height, thickness, courses = 2.5, 0.1025, 25
    lift = height / courses
    centres = np.column_stack([np.zeros((courses, 2)), (np.arange(courses) + 0.5) * lift])
    plan = bonded(centres, [1.0, thickness, lift - 1e-9], tension=tension, gap=1e-3)
    ratio = ((tension + DENSITY * G * height) * thickness
             / (3 * DENSITY * G * height ** 2))
    assert ratio == pytest.approx(expected, abs=6e-4)
    force = np.zeros((courses, 3))
    for factor, cracked in ((0.999, False), (1.001, True)):
        force[:, 1] = plan.mass * G * ratio * factor
        share, cause = solved(plan, force=force).utilisation()
        measured(f'stress over strength at the foot of a wall pushed to {factor:g} of '
                 '(f + ρgh)·t/(3ρgh²)', share.max(), factor, rtol=2e-3)
        assert bool(share.max() > 1.0) == cracked
    assert plan.bond_frame[share.argmax(), 2] == 0.0  # at the foot


@pytest.mark.report('convergence')
def test_displacements_match_a_direct_solver_on_a_random_graph(measured):
    """Solve 300 randomly tied parts under random loads as scipy's sparse solver does."""
    rng = np.random.default_rng(7)
    plan = random_plan(rng, 300)
    force, moment = rng.normal(0, 100, (300, 3)), rng.normal(0, 10, (300, 3))
    solver = solved(plan, 1e-7, force=force, moment=moment)
    push = np.hstack([force, moment])
    push[:, 2] -= plan.mass * G
    expected = spsolve(csc_matrix(dense_stiffness(plan)), push.ravel())
    scale = np.abs(expected).max()
    error = np.abs(solver.displacement[:-1].ravel() - expected).max() / scale
    measured.within('masonry: error of 300 tied parts against a direct solver', error, 0.0, 1e-8)
    slow, errors = StressSolver(BondGraph(plan), (0.0, 0.0, -G), 1e-7), []
    slow.set_loads(force, moment)
    for _ in range(30):
        slow.iterate(5)
        errors.append(np.abs(slow.displacement[:-1].ravel() - expected).max() / scale)
    measured.curve('Masonry: iterations of the stress solver', '300 tied parts',
                   5 * np.arange(1, 31), errors, ('iterations', 'relative error'),
                   ('linear', 'log'))


def test_converged_means_every_part_is_in_balance():
    """Recompute the imbalance of every part from the bond forces alone."""
    plan = wall(12, 15, holes=[(0.8, 0.3, 1.6, 0.7)])
    solver = StressSolver(BondGraph(plan))
    assert solver.tolerance == pytest.approx(0.1 * np.median(plan.mass) * G)
    solver.iterate(5000)
    graph = solver.graph
    balance = np.zeros((graph.count + 1, 6))
    wrench = np.einsum('kij,kaj->kai', graph.axes, solver.wrenches().reshape(-1, 2, 3))
    for part, sign in ((graph.first, 1.0), (graph.second, -1.0)):
        arm = graph.centroid - np.vstack([graph.centre, np.zeros(3)])[part]
        np.add.at(balance, part, sign * np.hstack([
            wrench[:, 0], wrench[:, 1] + np.cross(arm, wrench[:, 0])]))
    balance[:-1, 2] -= plan.mass * G
    force = np.linalg.norm(balance[:-1, :3], axis=1)
    moment = np.linalg.norm(balance[:-1, 3:], axis=1) / graph.reach
    worst = max(force.max(), moment.max())
    assert worst <= solver.tolerance * (1 + 1e-6)
    assert worst == pytest.approx(solver.residual, rel=1e-6)


def test_resuming_in_small_pieces_gives_the_same_answer():
    """Iterate three at a time and land on the solution of one long call."""
    plan = wall(15, 20)
    whole = solved(plan)
    pieces = StressSolver(BondGraph(plan), tolerance=TIGHT)
    while not pieces.converged:
        pieces.iterate(3)
    assert pieces.spent == whole.spent
    np.testing.assert_array_equal(pieces.displacement, whole.displacement)


def test_islands_without_ground_are_left_out():
    """Let a free block carry nothing, and the block on the ground all of its own weight."""
    plan = bonded([[0, 0, 0.05], [0, 0, 0.15], [2, 0, 5.0], [2, 0, 5.1]], [0.1, 0.1, 0.098],
                  gap=0.003)
    solver = solved(plan)
    assert solver.supported.tolist() == [True, True, False, False]
    free = (solver.graph.first == 2) | (solver.graph.second == 2)
    assert np.all(solver.wrenches()[free] == 0.0)
    assert np.all(solver.displacement[2:] == 0.0)
    assert solver.wrenches()[solver.graph.grounded(), 2] == pytest.approx(
        -2 * plan.mass[0] * G)


def test_untouched_islands_cost_nothing():
    """Spend iterations on the wall that was hit, none on the one beside it."""
    one, two = wall_boxes(10, 12), wall_boxes(10, 12, shift=(0, 5.0, 0))
    plan = bonded(np.vstack([one[0], two[0]]), np.vstack([one[1], two[1]]))
    half = len(one[0])
    solver = solved(plan, tolerance=1.0)
    before = solver.iterations.copy()
    solver.iterate(100)
    assert np.array_equal(solver.iterations, before)  # nothing changed: nothing done
    other = solver.displacement[half:].copy()
    solver.cut(solver.graph.neighbours([55]))
    solver.iterate(5000)
    assert solver.converged
    spent = solver.iterations - before
    assert np.all(spent[half:] == 0)
    assert np.all(spent[:half][np.arange(half) != 55] > 0)
    np.testing.assert_array_equal(solver.displacement[half:], other)


def test_loads_below_the_tolerance_do_not_wake_the_solver():
    """Ignore a breath of wind, answer a gale, and return when it stops."""
    plan = wall(10, 12)
    solver = solved(plan, tolerance=2.0)
    rest, spent = solver.displacement.copy(), solver.spent
    solver.set_loads(np.full((len(plan), 3), 0.01))
    solver.iterate(1000)
    assert solver.spent == spent
    solver.set_loads(np.tile([0.0, 50.0, 0.0], (len(plan), 1)))
    solver.iterate(1000)
    assert solver.spent > spent
    bent = np.abs(solver.displacement - rest).max()
    solver.set_loads(np.zeros((len(plan), 3)))
    solver.iterate(1000)
    assert np.abs(solver.displacement - rest).max() < 0.01 * bent


def test_sudden_removal_doubles_the_change_then_dies_away():
    """Release a hanging weight at once: the change of force is twice the static one, then once."""
    plan = stack([10.0, 10.0, 10.0])
    solver = solved(plan)
    foot = np.flatnonzero(solver.graph.grounded())
    assert solver.wrenches()[foot, 2] == pytest.approx(-30 * G)
    solver.cut(solver.graph.neighbours(np.array([2])), dynamic_factor=2.0)
    solver.iterate(1000)
    assert solver.equilibrium.sudden
    assert solver.wrenches()[foot, 2] == pytest.approx(-10 * G, rel=1e-6)
    solver.forget_sudden(0.5)
    solver.iterate(1000)
    assert solver.wrenches()[foot, 2] == pytest.approx(-15 * G, rel=1e-6)
    solver.forget_sudden()
    solver.iterate(1000)
    assert not solver.equilibrium.sudden
    assert solver.wrenches()[foot, 2] == pytest.approx(-20 * G, rel=1e-6)


def test_reset_restores_the_first_solution():
    """Break much, reset, and find the same numbers as at first."""
    plan = wall(10, 12)
    solver = solved(plan)
    first = solver.displacement.copy()
    solver.cut(solver.graph.neighbours(np.arange(30, 40)), 2.0)
    solver.set_loads(np.ones((len(plan), 3)))
    solver.iterate(500)
    solver.reset()
    solver.iterate(5000)
    np.testing.assert_array_equal(solver.displacement, first)
    assert solver.graph.alive.all()


def test_building_under_its_weight_converges_quickly():
    """Solve a two-storey building of 2,000 bricks and slabs within 150 iterations."""
    plan = building(side=14, storeys=2, courses=36, windows=2)
    solver = StressSolver(BondGraph(plan))
    solver.iterate(150)
    assert solver.converged
    feet = solver.graph.grounded()
    assert solver.wrenches()[feet, 2].sum() == pytest.approx(-plan.mass.sum() * G, rel=1e-3)


def test_numbers_that_are_not_finite_are_refused():
    """Refuse NaN loads and leave the solver as it was."""
    solver = solved(stack([1.0, 2.0]))
    with pytest.raises(ValueError, match='finite'):
        solver.set_loads([[0, 0, np.nan], [0, 0, 0]])
    assert solver.converged


@pytest.mark.parametrize('plan', [
    Blueprint(),
    blueprint(np.zeros((2, 3)), np.ones((2, 3)), np.zeros((0, 2)), np.zeros((0, 7)),
              np.zeros((0, 2))),
    blueprint([[0, 0, 0], [1, 0, 0]], np.ones((2, 3)), [[0, 1]], [[0.5, 0, 0, 0, 0, 0, 1]],
              [[1, 1]])], ids=['no parts', 'no bonds', 'no ground'])
def test_nothing_to_carry_is_in_balance(plan):
    """Stay idle where no part stands on the ground through bonds."""
    solver = StressSolver(BondGraph(plan))
    assert solver.iterate(10) == 0.0
    assert solver.converged and solver.spent == 0
    assert not solver.wrenches().any()
    assert not len(solver.mechanisms(0.01))


def test_islands_are_solved_each_for_itself():
    """Spend on a building what it takes alone, whatever stands elsewhere."""
    plans = [wall(15, 20), wall(10, 8, holes=[(0.7, 0.2, 0.6, 0.5)])]
    alone = [StressSolver(BondGraph(plan)) for plan in plans]
    plans[1].poses[:, 1] += 20.0
    plans[1].bond_frame[:, 1] += 20.0
    together = StressSolver(BondGraph(chain(plans)))
    for solver in (*alone, together):
        solver.iterate(1000)
        assert solver.converged
    first, second = (solver.iterations[0] for solver in alone)
    assert abs(first - second) > 3
    count = len(plans[0])
    np.testing.assert_allclose(together.iterations[:count], first, atol=1)
    np.testing.assert_allclose(together.iterations[count:], second, atol=1)
    np.testing.assert_allclose(together.displacement[:count], alone[0].displacement[:-1],
                               atol=1e-3 * np.abs(alone[0].displacement).max())


def test_graphs_that_are_chained_are_those_of_the_chained_blueprint():
    """Chain the bonds of two walls and go on with their answers: nothing is left to be solved."""
    plans = [wall(15, 20), wall(10, 8)]
    plans[1].poses[:, 1] += 20.0
    plans[1].bond_frame[:, 1] += 20.0
    loose = blueprint([[0, 40, 1], [5, 40, 1]], np.ones((2, 3)), np.zeros((0, 2), int),
                      np.zeros((0, 7)), np.zeros((0, 2)))
    whole, first = chain([plans[0], loose, plans[1]]), len(plans[0]) + 2
    solvers = [solved(plan) for plan in plans]
    graph = BondGraph.chained(whole, [(BondGraph(plans[0]), 0), (BondGraph(plans[1]), first)])
    for name, column in vars(BondGraph(whole)).items():
        if isinstance(column, np.ndarray):
            np.testing.assert_array_equal(getattr(graph, name), column, err_msg=name)
    known = len(solvers[0].graph)
    together = StressSolver.joined(graph, (0.0, 0.0, -G), [
        (solvers[0], 0, np.arange(known)), (solvers[1], first, np.arange(known, len(graph)))])
    assert together.converged and together.residual <= 2.0 * TIGHT
    push = np.zeros((len(whole), 3))
    push[-1] = push[0] = [0.0, 50.0, 0.0]
    together.tolerance = TIGHT
    together.set_loads(push)
    together.iterate(2000)
    np.testing.assert_allclose(
        together.displacement, solved(whole, force=push).displacement,
        atol=1e-3 * np.abs(together.displacement).max())


CLOSE = 1e-4  # [N]


def pushed(plan, tolerance=CLOSE):
    """Return a solver in balance under its weight, and three patterns of load."""
    solver = StressSolver(BondGraph(plan), tolerance=tolerance)
    solver.iterate(20_000)
    rng = np.random.default_rng(5)
    return solver, rng.normal(scale=3.0, size=(3, len(plan), 3))


def answer(solver, force):
    """Load a solver, let it come into balance, and give what that took."""
    before = solver.spent
    solver.set_loads(force)
    solver.iterate(20_000)
    assert solver.converged
    return solver.spent - before


def test_a_combination_of_known_loads_is_answered_at_once():
    """Need no more iterations for any sum of loads that were answered before."""
    solver, patterns = pushed(wall(15, 20))
    first = [answer(solver, force) for force in patterns]
    assert min(first) > 50
    for share in ((2.0, 0.0, 0.0), (-1.0, 0.5, 3.0), (0.0, 0.0, 0.0)):
        assert answer(solver, np.tensordot(share, patterns, 1)) < 0.3 * min(first)


def test_the_answer_is_that_of_a_solver_that_knows_nothing():
    """Change nothing but the work by guessing, also after many loads and a restart."""
    plan = wall(15, 20)
    solver, patterns = pushed(plan)
    rng = np.random.default_rng(6)
    for _ in range(30):
        force = np.tensordot(rng.normal(size=3), patterns, 1) + rng.normal(size=(len(plan), 3))
        answer(solver, force)
    cold, _ = pushed(plan)
    answer(cold, force)
    scale = np.abs(cold.displacement).max()
    np.testing.assert_allclose(solver.displacement, cold.displacement, atol=1e-5 * scale)


def test_cutting_bonds_forgets_what_the_whole_wall_answered():
    """Answer a known load as the cut wall does, not as the whole one did."""
    plan = wall(15, 20)
    solver, patterns = pushed(plan)
    answer(solver, patterns[0])
    answer(solver, np.zeros_like(patterns[0]))
    solver.cut(solver.graph.neighbours(np.array([40, 41, 57])), dynamic_factor=1.0)
    solver.iterate(20_000)
    assert answer(solver, patterns[0]) > 50
    cold = StressSolver(BondGraph(plan), tolerance=CLOSE)
    cold.cut(np.flatnonzero(~solver.graph.alive))
    answer(cold, patterns[0])
    scale = np.abs(cold.wrenches()).max()
    assert np.abs(solver.wrenches() - cold.wrenches()).max() < 1e-4 * scale


def test_buildings_are_guessed_each_by_itself():
    """Answer loads on two walls in shares that no common factor would fit."""
    plan = wall(9, 12)
    solver, patterns = pushed(chain([plan, plan.placed((50.0, 0.0, 0.0))]))
    first = answer(solver, patterns[0])
    scale = np.where(np.arange(2 * len(plan)) < len(plan), 2.0, -0.7)
    assert answer(solver, scale[:, None] * patterns[0]) < 0.3 * first


def test_dying_sudden_loads_are_no_part_of_an_answer():
    """Keep guessing right while the dynamic share of a removal dies away between loads."""
    plan = wall(15, 20)
    solver, patterns = pushed(plan)
    solver.cut(solver.graph.neighbours(np.array([40, 41, 57])), dynamic_factor=2.0)
    solver.iterate(20_000)
    for force in patterns:
        solver.set_loads(force)
        solver.forget_sudden(0.5)
        solver.iterate(20_000)
    solver.forget_sudden()
    solver.iterate(20_000)
    cold = StressSolver(BondGraph(plan), tolerance=CLOSE)
    cold.cut(np.flatnonzero(~solver.graph.alive))
    answer(cold, patterns[-1])
    scale = np.abs(cold.displacement).max()
    np.testing.assert_allclose(solver.displacement, cold.displacement, atol=1e-5 * scale)


def matrix(count, density, seed):
    """Make a symmetric positive definite matrix of 6 x 6 blocks, the diagonal ones included."""
    rng = np.random.default_rng(seed)
    pattern = rng.random((count, count)) < density
    full = np.kron(pattern, np.ones((6, 6))) * rng.normal(size=(6 * count, 6 * count))
    made = bsr_matrix(full @ full.T + np.diag(np.full(6 * count, 10.0)), blocksize=(6, 6))
    made.sort_indices()
    return made


def factored(system):
    """Factor a matrix of blocks."""
    return Factor(system.indptr, system.indices, system.data.copy())


def solved_for(factor, load, columns=None):
    """Solve for all unknowns, or those of some columns."""
    found = load.copy()
    columns = np.arange(len(load)) if columns is None else columns
    solve(factor.panels, columns, found, np.empty_like(found))
    return found


@pytest.mark.parametrize('count, density', [(1, 1.0), (5, 0.3), (40, 0.05), (60, 0.5)])
def test_it_solves_as_scipy_does(count, density):
    """Agree to single precision, for matrices from diagonal to full."""
    system = matrix(count, density, count)
    load = np.random.default_rng(1).normal(size=(count, 6))
    found = solved_for(factored(system), load)
    wanted = spsolve(system.tocsc(), load.ravel()).reshape(-1, 6)
    np.testing.assert_allclose(found, wanted, atol=1e-4 * np.abs(wanted).max())


WALLS = sorted((Path(__file__).parents[1] / 'grammars').glob('*.wall'))


def test_tolerance_leaves_utilisations_right_to_one_percent():
    """Compare the default tolerance with one a thousand times tighter on a real building."""
    plan = WallGrammar.load(WALLS[0].with_stem('office')).build(seed=0)
    coarse, fine = StressSolver(BondGraph(plan)), StressSolver(BondGraph(plan))
    fine.tolerance *= 1e-3
    coarse.iterate(5000)
    fine.iterate(5000)
    assert coarse.converged and fine.converged
    difference = np.abs(coarse.utilisation()[0] - fine.utilisation()[0])
    assert difference.max() < 0.01
