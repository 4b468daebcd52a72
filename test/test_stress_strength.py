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


"""When a bond fails: Mohr-Coulomb with cut-off, cracked sections, the order of breaking."""

from masonry_walls import blueprint, bonded, resistance_of, wall
import numpy as np
import pytest

from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import BondGraph, StressSolver
from procphys_ros.physics.masonry.strength import opening, utilisation, worst_first

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
