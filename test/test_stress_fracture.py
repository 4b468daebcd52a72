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


"""Progressive failure: what stands, what arches, what falls, what topples."""

from masonry_walls import admissible, blueprint, bonded, BRICK, DENSITY, wall, wall_boxes
import numpy as np
import pytest

from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import BondGraph, Failures, Fracture, StressSolver
from procphys_ros.physics.masonry.solver import DRIFT

G = 9.81  # [m/s²]


def settle(fracture, iterations=200000):
    """Advance until stable; return all failures as (bond, cause, utilisation, broken) columns."""
    rounds = fracture.advance(iterations)
    assert fracture.stable
    return [np.concatenate([getattr(r, name) for r in rounds] or [np.zeros(0)])
            for name in ('bond', 'cause', 'utilisation', 'broken')]


def start(plan, **kwargs):
    """Build graph, solver and fracture."""
    return Fracture(StressSolver(BondGraph(plan), **kwargs))


def block_wall(height, courses, tension, thickness=0.1025):
    """Stack wide blocks into a wall whose only joints are full beds."""
    lift = height / courses
    centres = np.column_stack([np.zeros((courses, 2)), (np.arange(courses) + 0.5) * lift])
    return bonded(centres, [1.0, thickness, lift - 1e-9], tension=tension, gap=1e-3)


def push(fracture, plan, ratio):
    """Accelerate everything along y by a ratio of g."""
    force = np.zeros((len(plan), 3))
    force[:, 1] = plan.mass * G * ratio
    fracture.solver.set_loads(force)


def test_sound_wall_breaks_nothing():
    """Judge a free-standing wall with a window under its weight: all bonds within strength."""
    plan = wall(14, 20, holes=[(1.0, 0.5, 1.6, 1.0)])
    fracture = start(plan)
    bond, *_ = settle(fracture)
    assert not len(bond)
    assert fracture.solver.utilisation()[0].max() < 1.0
    assert fracture.advance(1000) == []


def test_what_sags_soundly_is_no_mechanism():
    """Count from where all held: a wall that gave way by more than a centimetre does not drift."""
    fracture = start(wall(8, 20, tension=1e12, cohesion=1e12), gravity=(0.0, 0.0, -1e5))
    fracture.solver.graph.mortar.compression[:] = 1e12
    settle(fracture)
    solver = fracture.solver
    assert fracture.stable and np.abs(solver.displacement[:, 2]).max() > 2.0 * DRIFT
    assert not len(solver.adrift(DRIFT))
    load = np.zeros((solver.graph.count, 3))
    load[:, 0] = 1e-3 * solver.graph.mass
    solver.set_loads(load)
    solver.iterate(10000)
    assert solver.converged and not len(solver.mechanisms(DRIFT))


def waiting(ratio):
    """Push a wall, spend one iteration at a time until something breaks; return the residuals."""
    plan = wall(12, 14)
    fracture = start(plan)
    settle(fracture)
    push(fracture, plan, ratio)
    residuals = []
    while not (rounds := fracture.advance(1)):
        assert not fracture.stable
        residuals.append(fracture.solver.residual / fracture.solver.goal)
    assert len(residuals) > 5
    return residuals, rounds[0], fracture


def test_nothing_breaks_before_the_stresses_have_nearly_converged():
    """Break what is far overloaded when the residual is ten tolerances, and no sooner."""
    residuals, first, _ = waiting(3.0)
    assert first.utilisation.max() > 2.0
    assert min(residuals) > 10.0


def test_bonds_near_their_limit_wait_for_equilibrium():
    """Break what is overloaded by less than its strength in full equilibrium only."""
    residuals, first, fracture = waiting(0.5)
    assert 1.0 < first.utilisation.max() < 2.0
    assert 1.0 < min(residuals) < 10.0


def test_what_breaks_early_is_what_breaks_in_equilibrium():
    """Break the worst bonds and none that would hold, at stresses right to a tenth of limits."""
    plan = wall(30, 20, holes=[(1.0, 0.5, 1.6, 1.0)])
    for seed in range(4):
        force = np.random.default_rng(seed).normal(scale=400.0, size=(len(plan), 3))
        fracture = start(plan)
        settle(fracture)
        fracture.solver.set_loads(force)
        early = fracture.advance(1)
        while not early:
            early = fracture.advance(1)
        exact = StressSolver(BondGraph(plan), tolerance=1e-4)
        exact.set_loads(force)
        exact.iterate(20_000)
        share, _ = exact.utilisation()
        assert fracture.solver.residual > fracture.solver.tolerance and share.max() > 2.0
        np.testing.assert_allclose(early[0].utilisation, share[early[0].bond], atol=0.1)
        assert np.argmax(share) in early[0].bond
        assert share[early[0].bond].min() > 0.6 * min(share.max(), 3.0 / fracture.band)


def gap_in_wall(tension):
    """Remove the foot of a wall over 1.2 m at once; return the fracture, centres and what fell."""
    centres, sizes = wall_boxes(16, 20)
    gone = np.flatnonzero((centres[:, 2] < 0.15) & (np.abs(centres[:, 0] - 1.8) < 0.6))
    fracture = start(bonded(centres, sizes, tension=tension, cohesion=1.5 * tension, friction=0.6))
    settle(fracture)
    assert fracture.solver.supported.all()
    fracture.solver.cut(fracture.solver.graph.neighbours(gone), 2.0)
    settle(fracture)
    return fracture, centres, np.setdiff1d(np.flatnonzero(~fracture.solver.supported), gone)


def test_sound_wall_spans_a_removed_support():
    """Lose nothing above the gap with ordinary mortar."""
    _, _, fallen = gap_in_wall(0.2e6)
    assert not len(fallen)


def test_poor_wall_arches_over_a_removed_support():
    """Drop a stepped triangle above the gap with mortar of a fortieth of the strength."""
    _, centres, fallen = gap_in_wall(0.005e6)
    assert 8 < len(fallen) < 60
    height = centres[fallen, 2]
    aside = np.abs(centres[fallen, 0] - 1.8)
    assert height.max() < 0.75  # the arch keeps the courses above
    low, high = aside[height < 0.2].max(), aside[height > height.max() - 0.1].max()
    assert high < 0.5 * low < 0.5  # it narrows upwards


def test_dry_wall_arches_over_a_removed_support():
    """Drop a stepped triangle above the gap of a dry wall; what stays is what can stay."""
    fracture, centres, fallen = gap_in_wall(0.0)
    assert 4 < len(fallen) < 40
    assert centres[fallen, 2].max() < 1.0
    assert np.abs(centres[fallen, 0] - 1.8).max() < 0.8
    plan = bonded(*wall_boxes(16, 20))
    assert admissible(plan, 0.6, fracture.solver.supported)
    assert not admissible(plan, 0.6, plan.poses[:, 2] > 0.15)  # nothing hangs in the air


def test_dry_wall_cracks_at_the_kern_but_topples_at_its_aspect_ratio():
    """Open the foot of a dry wall from t/3h on, and let it go only near t/h."""
    height, thickness = 2.5, 0.1025
    for ratio, opens, falls in ((0.95 / 3, False, False), (0.5, True, False), (0.85, True, False),
                                (1.02, True, True)):
        plan = block_wall(height, 10, tension=0.0)
        fracture = start(plan, tolerance=1e-3)
        push(fracture, plan, ratio * thickness / height)
        _, cause, _, _ = settle(fracture)
        assert bool(len(cause)) == opens
        assert (not fracture.solver.supported.all()) == falls
        assert (not fracture.solver.graph.alive.all()) == falls


def test_mortared_wall_topples_as_soon_as_it_cracks():
    """Drop a wall lower than f_t/(2ρg) at its first crack, as the closed form has it."""
    height, thickness, tension = 2.5, 0.1025, 0.2e6
    assert height < tension / (2 * DENSITY * G)
    crack = (tension + DENSITY * G * height) * thickness / (3 * DENSITY * G * height ** 2)
    for factor, falls in ((0.99, False), (1.01, True)):
        plan = block_wall(height, 10, tension)
        fracture = start(plan, tolerance=1e-3)
        push(fracture, plan, factor * crack)
        settle(fracture)
        assert not np.any(fracture.solver.supported) if falls else fracture.solver.supported.all()


def test_mechanism_is_reported_and_turned_loose():
    """Hang a block on a bond so soft that it swings away: call it a mechanism, let it fall."""
    frame = [[0.0, 0.0, 0.5, 0.0, 0.5 ** 0.5, 0.0, 0.5 ** 0.5],
             [-0.5, 0, 0, 0, 0, 0, 1.0]]
    plan = blueprint([[-0.5, 0, 0.5], [1.0, 0, 0.5]], [[1.0, 0.1, 1.0], [2.0, 0.1, 0.1]],
                     [[0, 1], [-1, 0]], frame, [[0.1, 0.1], [1.0, 0.1]])
    plan.mortar.normal_stiffness[0] = plan.mortar.shear_stiffness[0] = 1e6
    fracture = start(plan)
    _, cause, _, broken = settle(fracture)
    assert cause.tolist() == [Cause.TENSION]
    assert broken.all()
    assert fracture.solver.supported.tolist() == [True, False]


def test_sudden_removal_breaks_what_slow_removal_spares():
    """Take a prop from a beam: f_t between once and twice the change of stress decides."""
    plan = bonded([[0, 0, 0.05], [0, 0, 0.151], [0.4, 0, 0.05]],
                  [[0.1, 0.1, 0.1], [1.0, 0.1, 0.1], [0.1, 0.1, 0.1]], gap=0.002,
                  density=[1.0, 1.0, 1.0], tension=1e5, cohesion=1e6)
    force = np.zeros((3, 3))
    outcome = []
    for load in (15.0, 40.0, 200.0):
        for factor in (1.0, 2.0):
            fracture = start(plan, tolerance=1e-3)
            settle(fracture)
            force[1] = 0, 0, -load
            fracture.solver.set_loads(force, np.array([[0] * 3, [0, 0.4 * load, 0], [0] * 3]))
            settle(fracture)
            solver = fracture.solver
            solver.cut(solver.graph.neighbours(np.array([2])), dynamic_factor=factor)
            settle(fracture)
            outcome.append(bool(fracture.solver.supported[1]))
    assert outcome == [True, True, True, False, False, False]


@pytest.mark.parametrize('seed', [0, 1])
def test_rounds_of_many_bonds_end_like_breaking_one_at_a_time(seed):
    """Break in bands and singly: the same bricks fall, within two bricks."""
    plan = wall(12, 14, tension=0.02e6, cohesion=0.03e6)
    rng = np.random.default_rng(seed)
    gone = rng.choice(len(plan), 8, replace=False)
    outcome = []
    for band in (0.7, 1.0):
        fracture = start(plan)
        fracture.band = band
        settle(fracture)
        fracture.solver.cut(fracture.solver.graph.neighbours(gone), 2.0)
        settle(fracture)
        outcome.append(fracture.solver.supported.copy())
    assert np.sum(outcome[0] != outcome[1]) <= 2


def test_same_input_breaks_the_same_bonds_in_the_same_order():
    """Repeat a collapse, at once and seven iterations at a time; compare every failure."""
    runs = []
    for share in (200000, 200000, 7):
        plan = wall(12, 14, tension=0.01e6, cohesion=0.02e6)
        fracture = start(plan)
        settle(fracture)
        foot = np.flatnonzero((plan.poses[:, 2] < BRICK[2]) & (plan.poses[:, 0] > 1.0))
        fracture.solver.cut(fracture.solver.graph.neighbours(foot), 2.0)
        failures = []
        while not fracture.stable:
            failures += fracture.advance(share)
        runs.append(failures)
    assert len(runs[0]) > 3
    for other in runs[1:]:
        for one, two in zip(runs[0], other, strict=True):
            np.testing.assert_array_equal(one.bond, two.bond)
            np.testing.assert_array_equal(one.utilisation, two.utilisation)


def test_joints_that_break_take_the_energy_of_a_release():
    """Take a brick out at once: half of force times way is what joints that break may take."""
    solver = {}
    for factor in (1.0, 2.0):  # slowly, and at once
        solver[factor] = StressSolver(BondGraph(wall(12, 16)))
        Fracture(solver[factor]).advance(5000)
        solver[factor].cut(solver[factor].graph.neighbours(np.array([40])), factor)
        solver[factor].iterate(5000)
    sudden = solver[2.0]
    equilibrium, force = sudden.equilibrium, sudden.equilibrium._sudden.copy()
    way = solver[1.0].displacement - sudden.sound
    energy = equilibrium.overshoot(sudden.sound)
    assert energy == pytest.approx(0.5 * (force * way).sum(), rel=1e-3) and energy > 0.0
    bond = np.flatnonzero(sudden.graph.alive)[:1]
    failures = Failures(bond, np.full(1, Cause.TENSION), np.full(1, 1.5), np.zeros(1, bool),
                        np.zeros(1, bool))
    work, fracture = 18.0 * sudden.graph.area[bond[0]], Fracture(sudden)
    fracture._swing_less(4.0 / 3.0 * work, failures)
    np.testing.assert_allclose(equilibrium._sudden, 0.5 * force)
    fracture._swing_less(work, failures)
    assert not equilibrium.sudden and not failures.runs_on
