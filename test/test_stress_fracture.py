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
"""When bonds fail, and what falls then: strength, progressive failure, and mechanisms."""

from masonry_walls import (
    admissible,
    blueprint,
    bonded,
    BRICK,
    DENSITY,
    resistance_of,
    wall,
    wall_boxes,
)
import numpy as np
import pytest

from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import BondGraph, Failures, Fracture, StressSolver
from procphys_ros.physics.masonry.components import groups, label
from procphys_ros.physics.masonry.mechanisms import loosening
from procphys_ros.physics.masonry.solver import DRIFT
from procphys_ros.physics.masonry.strength import opening, utilisation, worst_first

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


def comes_off(graph, share, drift):
    """Choose bonds where all parts drift; return their rows."""
    labels, _ = label(graph.count, graph.first, graph.second, graph.alive)
    return np.flatnonzero(loosening(graph, share, np.arange(graph.count), labels, drift))


def portal():
    """Lay a beam on two piers of three blocks; return graph, and the beds of each from below."""
    places = [(x, 0.0, 0.05 + 0.1 * k) for x in (0.1, 1.1) for k in range(3)]
    sizes = [(0.2, 0.2, 0.1)] * 6 + [(1.2, 0.2, 0.1)]
    graph = BondGraph(bonded(np.array([*places, (0.6, 0.0, 0.35)]), np.array(sizes)))
    x, z = graph.centroid[:, 0], graph.centroid[:, 2]
    order = np.argsort(z, kind='stable')
    return graph, order[x[order] < 0.6], order[x[order] > 0.6]


def test_what_drifts_comes_off_at_the_worst_bond_on_each_way_to_the_ground():
    """Break one bed of each pier, however overloaded others are, and none that is sound."""
    graph, left, right = portal()
    share = np.empty(len(graph))
    drift = np.append(np.zeros(6), 1.0)  # the beam drifts most
    share[left], share[right] = (2.0, 4.0, 3.0, 3.9), (9.0, 1.5, 8.0, 8.5)
    assert set(comes_off(graph, share, drift)) == {left[1], right[0]}
    share[right] = 0.2, 0.9, 0.5, 0.8
    assert set(comes_off(graph, share, drift)) == {left[1]}
    share[left] = 0.1
    assert not len(comes_off(graph, share, drift))


def test_something_comes_off_in_each_island():
    """Break the worst bed of two columns that stand apart, above and below what drifts most."""
    centres = [(x, 0.0, 0.05 + 0.1 * k) for x in (0.0, 1.0) for k in range(4)]
    graph = BondGraph(bonded(np.array(centres), (0.2, 0.2, 0.1)))
    x, z = graph.centroid[:, 0], graph.centroid[:, 2]
    share = np.where(x > 0.5, 3.0 - 4.0 * z, 2.0 + z)  # worst at the foot, or on top
    drift = np.tile([0.1, 0.2, 0.4, 0.3], 2)  # the third blocks come off
    rows = comes_off(graph, share, drift)
    assert sorted(zip(x[rows].round(), z[rows].round(1))) == [(0.0, 0.2), (1.0, 0.0)]


def test_a_wall_that_a_blow_throws_over_comes_off_as_one():
    """Push 28 bricks of a wall with 800 times their weight: what flies is whole, but a few."""
    plan = wall(14, 20)
    solver = StressSolver(BondGraph(plan))
    fracture = Fracture(solver)
    fracture.advance(5000)
    x, _, z = plan.poses[:, :3].T
    struck = (np.abs(x - x.mean()) < 0.4) & (np.abs(z - 0.6) < 0.3)
    force = np.zeros((len(plan), 3))
    force[struck, 1] = 800.0 * 9.81 * plan.mass[struck]
    solver.set_loads(force)
    while solver.supported[struck].any():
        assert fracture.advance(400)
    sizes = [len(piece) for piece in groups(solver.labels, ~solver.supported)]
    assert max(sizes) > 150 and len(sizes) < 10  # 225 bricks came off one by one before


AREA = 0.1025 ** 2       # [m²], half-lap bed of two bricks
STRENGTH = {'tension': 0.2e6, 'cohesion': 0.3e6, 'friction': 0.7, 'compression': 1e7}


def single(force, moment=(0.0, 0.0, 0.0), extent=(0.1025, 0.1025), **strengths):
    """Load one weightless part on one ground bond; return the solved solver."""
    plan = blueprint([[0.0, 0.0, 0.0]], [[0.2, 0.1, 0.1]], [[-1, 0]], [[0, 0, 0, 0, 0, 0, 1.0]],
                     [extent], **{**STRENGTH, **strengths})
    solver = StressSolver(BondGraph(plan), (0.0, 0.0, 0.0), 1e-6)
    solver.set_loads([force], [moment])
    solver.iterate(100)
    assert solver.converged
    return solver


def share_and_cause(*args, **kwargs):
    """Return utilisation and cause of the one bond."""
    share, cause = single(*args, **kwargs).utilisation()
    return share[0], Cause(cause[0])


def test_single_bond_pull_breaks_at_strength_times_area():
    """Reach the limit of 0.2 MPa on a half-lap bed at 2.10 kN."""
    assert round(0.2e6 * AREA) == 2101
    for factor in (0.5, 0.99, 1.01):
        share, cause = share_and_cause((0, 0, factor * 0.2e6 * AREA))
        assert (share, cause) == (pytest.approx(factor, rel=1e-6), Cause.TENSION)


@pytest.mark.report('laws')
@pytest.mark.parametrize('pressure', [0.0, 0.2e6, 1.0e6])
def test_shear_limit_lies_on_the_mohr_coulomb_line(pressure, measured):
    """Slide at c + μ·p under three pressures."""
    limit = (0.3e6 + 0.7 * pressure) * AREA
    share, cause = share_and_cause((0.6 * limit, 0.8 * limit, -pressure * AREA))
    measured('shear of a joint over c + μ·p, at 0, 0.2 and 1 MPa', share, 1.0, rtol=1e-6)
    assert cause == Cause.SHEAR


def test_pull_lowers_the_shear_limit():
    """Slide at c - μ·σ under tension below the cut-off."""
    share, cause = share_and_cause(((0.3e6 - 0.7 * 0.1e6) * AREA, 0, 0.1e6 * AREA))
    assert (share, cause) == (pytest.approx(1.0, rel=1e-6), Cause.SHEAR)


def test_compression_cap():
    """Crush at f_c under the mean pressure plus the bending at the edge."""
    share, cause = share_and_cause((0, 0, -0.9e7 * AREA))
    assert (share, cause) == (pytest.approx(0.9, rel=1e-6), Cause.COMPRESSION)
    edge = 0.2e7 * AREA * 0.1025 / 6
    share, _ = share_and_cause((0, 0, -0.9e7 * AREA), (edge, 0, 0))
    assert share == pytest.approx(1.1, rel=1e-6)


def test_bending_about_both_axes_adds_at_the_corner():
    """Add M_x/W_x and M_y/W_y of an oblong patch."""
    length, width = 0.2, 0.1
    about_x = 0.1e6 * length * width ** 2 / 6
    about_y = 0.15e6 * width * length ** 2 / 6
    share, cause = share_and_cause((0, 0, 0), (about_x, -about_y, 0), extent=(length, width))
    assert (share, cause) == (pytest.approx(0.25 / 0.2, rel=1e-6), Cause.TENSION)


def test_twist_counts_as_shear_at_the_corner():
    """Add T·r/(I_x + I_y) at the corner to the mean shear."""
    length, width = 0.2, 0.1
    radius, polar = np.hypot(length, width) / 2, length * width * (length ** 2 + width ** 2) / 12
    twist = 0.2e6 * polar / radius
    share, cause = share_and_cause((0.1e6 * length * width, 0, 0), (0, 0, twist),
                                   extent=(length, width))
    assert (share, cause) == (pytest.approx(1.0, rel=1e-6), Cause.SHEAR)


def test_dry_bed_opens_at_the_kern():
    """Overload a bed without tensile strength once the resultant leaves the middle third."""
    press, extent = 1000.0, 0.1025
    for share_of_kern in (0.98, 1.02):
        moment = press * share_of_kern * extent / 6
        share, _ = share_and_cause((0, 0, -press), (moment, 0, 0), tension=0.0)
        assert share == pytest.approx(share_of_kern, rel=1e-6)


def test_opened_patch_is_centred_on_the_resultant():
    """Leave 3·(e/2 - eccentricity) closed: with a linear pressure it balances the resultant."""
    press, extent = 1000.0, 0.12
    eccentricity = 0.03  # along x, beyond the kern
    solver = single((0, 0, -press), (0, press * eccentricity, 0), extent=(extent, extent),
                    tension=0.0)
    wrench = solver.wrenches()
    stays, low, high = opening(solver.graph, np.array([0]), wrench)
    assert stays[0]
    closed = (high - low)[0]
    assert closed == pytest.approx([0.95 * 0.09, extent])
    third = high[0, 0] - 0.09 / 3  # a triangle's resultant, from its high edge
    assert third == pytest.approx(eccentricity)
    solver.narrow(np.array([0]), low, high)
    solver.iterate(100)
    share, _ = solver.utilisation()
    assert share[0] == pytest.approx(3 - 2 / 0.95, rel=1e-5)
    assert solver.graph.area[0] == pytest.approx(closed.prod())


def test_opening_along_both_sides_ends():
    """Open a dry bed loaded off both axes until it is within its strength."""
    solver = single((0, 0, -1000.0), (14.0, -9.0, 0), extent=(0.12, 0.1), tension=0.0)
    rounds = 0
    while solver.utilisation()[0][0] > 1.0:
        stays, low, high = opening(solver.graph, np.array([0]), solver.wrenches())
        assert stays[0]
        solver.narrow(np.array([0]), low, high)
        solver.iterate(100)
        rounds += 1
    assert 1 <= rounds <= 3
    assert 0.25 < solver.graph.area[0] / 0.012 < 0.9


def test_pulled_bond_does_not_open_but_breaks():
    """Keep nothing of a bond in net tension, nor of one whose resultant leaves the patch."""
    for force, moment in (((0, 0, 10.0), 5.0), ((0, 0, -1000.0), 1000.0 * 0.06)):
        solver = single(force, (moment, 0, 0))
        stays, _, _ = opening(solver.graph, np.array([0]), solver.wrenches())
        assert not stays[0]


def test_worst_first_takes_peaks_that_are_far_apart():
    """Break the worst bond and an equal one at the far end, but not the next worst beside it."""
    plan = wall(20, 10)
    graph = BondGraph(plan)
    share = np.zeros(len(graph))
    left = graph.neighbours([60])
    right = graph.neighbours([75])
    share[left[0]], share[left[1]], share[right[0]] = 3.0, 2.9, 2.8
    assert worst_first(graph, share, 0.7).tolist() == sorted([left[0], right[0]])
    assert worst_first(graph, share, 1.0).tolist() == [left[0]]
    share[right[0]] = 1.9
    assert worst_first(graph, share, 0.7).tolist() == [left[0]]
    assert not len(worst_first(graph, np.minimum(share, 1.0), 0.7))


def test_what_is_overloaded_waits_for_the_worst_but_under_blows():
    """Spare what carries four times its strength while another bond carries eighteen times."""
    graph = BondGraph(wall(20, 10))
    share = np.zeros(len(graph))
    worst, other = graph.neighbours([60])[0], graph.neighbours([75])[0]
    share[worst], share[other] = 18.0, 4.0
    assert worst_first(graph, share, 0.7).tolist() == [worst]
    assert worst_first(graph, share, 0.7, hopeless=3.0).tolist() == sorted([worst, other])


def test_dead_bonds_carry_and_count_nothing():
    """Expect no utilisation of a broken bond."""
    graph = BondGraph(wall(5, 5))
    wrench = np.full((len(graph), 6), 1e6)
    graph.cut(np.array([3]))
    share, cause = utilisation(graph, wrench)
    assert share[3] == 0.0
    assert np.all(share[np.arange(len(graph)) != 3] > 1.0)


def test_tearing_a_brick_off_the_ground_takes_its_tensile_force_and_work():
    """Pull one part up: f_t·A and mode I work; push it sideways: c·A and mode II work."""
    solver = single((0, 0, 0))
    up = resistance_of(solver, np.array([0]), np.array([0.0, 0.0, 1.0]))
    assert up.force == pytest.approx(0.2e6 * AREA)
    assert up.energy == pytest.approx(18.0 * AREA)
    side = resistance_of(solver, np.array([0]), np.array([1.0, 0.0, 0.0]))
    assert side.force == pytest.approx(0.3e6 * AREA)
    assert side.energy == pytest.approx(125.0 * AREA)
    down = resistance_of(solver, np.array([0]), np.array([0.0, 0.0, -1.0]))
    assert down.force == pytest.approx(1e7 * AREA)


def test_pressure_raises_the_resistance_to_a_sideways_blow():
    """Add friction of the present pressure to the cohesion of every bond around a brick."""
    loose = single((0, 0, 0))
    pressed = single((0, 0, -1e5 * AREA))
    along = np.array([0.0, 1.0, 0.0])
    blow = [resistance_of(s, np.array([0]), along) for s in (loose, pressed)]
    assert blow[1].force - blow[0].force == pytest.approx(0.7e5 * AREA)


def test_brick_in_a_wall_resists_by_all_its_bonds():
    """Strike a brick square to the wall: its six joints slide, nothing else."""
    solver, across = StressSolver(BondGraph(wall(10, 10))), np.array([0.0, 1.0, 0.0])
    graph, brick = solver.graph, 55
    blow = resistance_of(solver, np.array([brick]), across)
    assert len(blow.bonds) == 6
    assert blow.force == pytest.approx(0.3e6 * graph.area[blow.bonds].sum())
    pair = resistance_of(solver, np.array([brick, brick + 1]), across)
    assert len(pair.bonds) < 12


def test_unequal_strengths_are_read_bond_by_bond():
    """Fail the weaker of two bonds under the same load."""
    plan = bonded([[0, 0, 0.05], [1.0, 0, 0.05]], [0.1, 0.1, 0.098], tension=0.2e6)
    plan.mortar.tension[1] = 0.1e6
    solver = StressSolver(BondGraph(plan), (0, 0, 0), 1e-6)
    solver.set_loads([[0, 0, 1500.0], [0, 0, 1500.0]])
    solver.iterate(100)
    share, _ = solver.utilisation()
    assert share[1] == pytest.approx(2 * share[0])
    assert share[1] > 1.0 > share[0]


def test_overpulled_bond_fails_in_tension_not_in_shear():
    """Name tension as the cause however far a pull with a little shear goes beyond the cut-off."""
    for pull in (0.25e6, 0.5e6, 5e6):
        share, cause = share_and_cause((1.0, 0, pull * AREA))
        assert (share, cause) == (pytest.approx(pull / 0.2e6, rel=1e-6), Cause.TENSION)
