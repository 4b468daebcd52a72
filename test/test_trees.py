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

"""Trees at rest and swaying, against beam theory and the conservation of energy."""

from dataclasses import replace

from grown_trees import beam, BENDING, bush, DENSITY, LENGTH, RADIUS
import numpy as np
import pytest
from random_grammars import draw
from scipy.linalg import eigh

from procphys_ros.blueprint import skeleton
from procphys_ros.blueprint.skeleton import LEAF_AREAL_DENSITY
from procphys_ros.errors import GrammarError, SceneError
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.layout import HARDENING, YIELD
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_OMEGA = 1.87510407 ** 2 * np.sqrt(BENDING / (DENSITY * np.pi * RADIUS ** 2)) / LENGTH ** 2
_NO_WEIGHT = (0.0, 0.0, 0.0)


def _swing_freely(forest: Forest, dt: float, count: int) -> np.ndarray:
    """Pull the tip of a beam aside, let go, and record its sway once higher modes are gone."""
    tip = len(forest) - 1
    for _ in range(int(6.0 / dt)):
        forest.apply_impulse(tip, linear=(20.0 * dt, 0.0, 0.0))
        forest.step(dt)
    path = np.empty(count)
    for i in range(count):
        forest.step(dt)
        path[i] = forest.poses[tip, 0]
    return path


def _peaks(path: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Find times and heights of the maxima by a parabola through three samples."""
    i = np.flatnonzero((path[1:-1] > path[:-2]) & (path[1:-1] >= path[2:])) + 1
    left, middle, right = path[i - 1], path[i], path[i + 1]
    offset = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return (i + offset) * dt, middle - 0.25 * (left - right) * offset


def _sag(segments: int) -> float:
    """Pull the tip of a beam aside with 20 N until it is at rest; return its displacement [m]."""
    forest, last = Forest(beam(segments, damping_ratio=0.7), gravity=_NO_WEIGHT), segments - 1
    end = [0.0, 0.0, LENGTH]
    for _ in range(1200):
        forest.apply_impulse(last, end, (20.0 / 60.0, 0.0, 0.0))
        forest.step(1.0 / 60.0)
        end = 2.0 * forest.poses[last, :3] - forest.poses[last - 1, :3]
        end = forest.poses[last, :3] + 0.5 * (end - forest.poses[last, :3])
    return end[0]


@pytest.mark.report('laws')
def test_tip_load_sags_as_beam_theory(measured):
    """Expect P·L³/3EI at the tip; the joints integrate it to 0.5/n² from above."""
    measured('tip of a beam of 20 segments under 20 N, P·L³/3EI', _sag(20),
             20.0 * LENGTH ** 3 / (3.0 * BENDING), 'm', rtol=5e-3)


@pytest.mark.report('convergence')
def test_sag_converges_with_the_square_of_the_segments(measured):
    """Expect a quarter of the error from twice as many segments."""
    exact, counts = 20.0 * LENGTH ** 3 / (3.0 * BENDING), np.array([4, 8, 16, 32])
    errors = np.array([_sag(n) / exact - 1.0 for n in counts])
    measured.curve('Trees: segments of a beam', 'sag of the tip', counts, errors,
                   ('segments', 'relative error'), ('log', 'log'))
    measured.curve('Trees: segments of a beam', '0.5/n², expected', counts, 0.5 / counts ** 2,
                   ('segments', 'relative error'), ('log', 'log'))
    measured('order of the sag of a beam in its segments, 16 to 32',
             np.log2(errors[-2] / errors[-1]), 2.0, atol=0.1)


@pytest.mark.report('laws')
def test_first_frequency_is_that_of_the_beam(measured):
    """Expect the Euler-Bernoulli frequency within a fifth of a percent from twenty segments."""
    segments, tolerance = 20, 0.002
    dt = 1.0 / 600.0
    forest = Forest(beam(segments, damping_ratio=0.02), gravity=_NO_WEIGHT, air_density=0.0)
    times, _ = _peaks(_swing_freely(forest, dt, 3000), dt)
    period = np.diff(times).mean()
    measured(f'first frequency of a clamped beam of {segments} segments, Euler-Bernoulli',
             1.0 / period, _OMEGA / (2.0 * np.pi), 'Hz', rtol=tolerance)


def _pole(frequency: float, ratio: float) -> Forest:
    """Stand up a single segment whose joint makes it sway with a frequency [Hz], no weight."""
    soft = Forest(beam(1), gravity=_NO_WEIGHT)._model
    mass, across, reach = soft.body[0, [0, 1, 3]]
    stiffness = (2.0 * np.pi * frequency) ** 2 * (across + mass * reach ** 2)
    modulus = 8e9 * stiffness / soft.swing[0, 0]
    return Forest(beam(1, damping_ratio=ratio, modulus=modulus), gravity=_NO_WEIGHT,
                  air_density=0.0)


def _sway(forest: Forest, seconds: float) -> np.ndarray:
    """Push a pole once and follow it and its energy at 60 Hz, (T, 2)."""
    forest.apply_impulse(0, linear=(1.0, 0.0, 0.0))
    track = []
    for _ in range(round(60.0 * seconds)):
        forest.step(1.0 / 60.0)
        track.append((forest.poses[0, 0], forest.energy()))
    return np.array(track)


def _frequency(path: np.ndarray) -> float:
    """Count how often a pole followed at 60 Hz passes the upright [Hz]."""
    before = np.flatnonzero(path[1:] * path[:-1] < 0.0)
    times = (before + path[before] / (path[before] - path[before + 1])) / 60.0
    return (len(times) - 1) / (2.0 * (times[-1] - times[0]))


@pytest.mark.parametrize('frequency, tolerance', [
    (1.0, 0.1), (6.0, 0.1), (10.0, 0.25)])
@pytest.mark.parametrize('ratio', [0.02, 0.1])
@pytest.mark.report('laws')
def test_damping_ratio_is_what_was_asked(frequency: float, ratio: float, tolerance: float,
                                         measured):
    """Expect the energy to fall by exp(-4π·ζ) in each cycle at 60 Hz, whatever the frequency."""
    path, energy = _sway(_pole(frequency, ratio), 12.0 / frequency).T
    decay = -np.polyfit(np.arange(len(energy)) / 60.0, np.log(energy), 1)[0]
    measured('damping ratio of a pole at 60 steps per second, 1 to 10 Hz',
             decay / (4.0 * np.pi * _frequency(path)), ratio, rtol=tolerance)


@pytest.mark.parametrize('frequency, tolerance', [
    (1.0, 0.01), (3.0, 0.01), (10.0, 0.08)])
@pytest.mark.report('laws')
def test_frequency_is_that_of_the_spring(frequency: float, tolerance: float, measured):
    """Expect the trapezoidal rule's own error and no more, (ω·dt)²/12 below."""
    path = _sway(_pole(frequency, 0.0), 21.0 / frequency)[:, 0]
    measured('frequency of a pole at 60 steps per second, 1 to 10 Hz', _frequency(path),
             frequency, 'Hz', rtol=tolerance)


@pytest.mark.parametrize('frequency, segments', [(1.0, 1), (2.0, 10)])
def test_undamped_sway_goes_on(frequency: float, segments: int):
    """Expect 95 % of the energy after 30 s, of one joint and of a whole pole, with weight."""
    if segments == 1:
        energy = _sway(_pole(frequency, 0.0), 30.0)[:, 1]
    else:
        scale = (2.0 * np.pi * frequency / _OMEGA) ** 2
        forest = Forest(beam(segments, damping_ratio=0.0, modulus=8e9 * scale),
                        gravity=(0.0, 0.0, 0.5), air_density=0.0)
        height = forest.poses[:, 2] / LENGTH
        forest.velocities[:, 0] = 1.5 * frequency * height ** 2
        energy = []
        for _ in range(1800):
            forest.step(1.0 / 60.0)
            energy.append(forest.energy())
    assert 0.95 * energy[0] < energy[-1] <= energy[0] * (1.0 + 1e-9)


@pytest.mark.report('convergence')
def test_steps_converge_with_their_square(measured):
    """Expect a quarter of the error from half the step, of a bush that lost a bough and sways."""
    def rebound(steps: int) -> np.ndarray:
        forest = Forest(bush(16, stiffness=2e8, damping_ratio=0.05))
        forest.detach(8)
        for _ in range(steps):
            forest.step(0.8 / steps)
        return forest.poses[forest.active, :3]

    exact = rebound(3200)
    counts = np.array([50, 100, 200])
    errors = np.array([np.abs(rebound(n) - exact).max() for n in counts])
    axes, logs = ('time step [s]', 'largest error of a position [m]'), ('log', 'log')
    measured.curve('Trees: time step', 'a bush that lost a bough', 0.8 / counts, errors, axes,
                   logs)
    measured.curve('Trees: time step', 'its square, expected', 0.8 / counts,
                   errors[0] * (counts[0] / counts) ** 2, axes, logs)
    assert errors[0] > 1e-5
    for order in np.log2(errors[:-1] / errors[1:]):
        measured('order of the tree kernel in the time step', order, 2.0, atol=0.2)


def test_weight_of_what_hangs_stiffens_and_thins_the_damping():
    """Expect ζ·ω to stay as the pull of gravity adds to the spring of a single joint."""
    dt, found = 1.0 / 600.0, []  # short, lest the time step's own damping shows
    for pull in (0.0, 600.0):  # [m/s²] upwards, the way the beam points
        forest = Forest(beam(1, damping_ratio=0.05), gravity=(0.0, 0.0, pull), air_density=0.0)
        times, heights = _peaks(_swing_freely(forest, dt, 1800), dt)
        decrement = np.log(heights[:-1] / heights[1:])[:5].mean()
        found.append((2.0 * np.pi / np.diff(times).mean(),
                      decrement / np.hypot(2.0 * np.pi, decrement)))
    (slow, thick), (fast, thin) = found
    assert fast > 2.0 * slow and thick == pytest.approx(0.05, rel=0.02)
    assert thin * fast == pytest.approx(thick * slow, rel=0.05)


def test_damping_ratio_holds_on_side_branches():
    """Expect each branch's dampers from its own frequency: a thin one is damped less per k."""
    forest = Forest(bush())
    rate = forest._model.swing[:, 1] / forest._model.swing[:, 0]
    assert np.all(rate > 0.0) and rate.max() > 3.0 * rate.min()


def test_rest_is_exact():
    """Expect a preloaded tree to stay at its authored pose to the last bit."""
    blueprint = bush()
    forest = Forest(blueprint)
    assert np.allclose(forest.poses, blueprint.poses[forest.parts], atol=1e-12)
    before = forest.poses.copy()
    for i in range(600):
        forest.step(1.0 / 60.0 if i % 2 else 1.0 / 240.0)
    assert np.array_equal(forest.poses, before)
    assert not forest.velocities.any()
    assert forest.energy() == 0.0


def test_root_carries_the_weight():
    """Expect the trunk's joint to push up with the weight of the tree at rest."""
    blueprint = bush()
    forest = Forest(blueprint)
    forest.step(1.0 / 60.0)
    force, moment = forest.joint_wrenches[0, :3], forest.joint_wrenches[0, 3:]
    assert np.allclose(force, [0, 0, 9.81 * blueprint.mass.sum()], atol=1e-9)
    lever = (blueprint.mass[:, None] * blueprint.poses[:, :3]).sum(axis=0)
    assert np.allclose(moment, 9.81 * np.array([lever[1], -lever[0], 0.0]), atol=1e-8)


def _shoved(forest: Forest) -> list[float]:
    """Shove all segments at random; return the energy after each of ten seconds' steps [J]."""
    forest.velocities[:] = np.random.default_rng(1).normal(size=forest.velocities.shape)
    energy = []
    for _ in range(601):
        forest.step(1.0 / 60.0)
        energy.append(forest.energy())
    return energy


@pytest.mark.parametrize('stiffness, ratio', [(8e7, 0.0), (8e9, 0.05), (8e13, 0.0)])
def test_energy_never_rises_without_wind(stiffness: float, ratio: float):
    """Expect no step to add energy after a shove, springs, preload and weight included."""
    energy = _shoved(Forest(bush(stiffness=stiffness, damping_ratio=ratio), air_density=0.0))
    assert np.diff(energy).max() <= 1e-9 * energy[0]
    assert ratio == 0.0 or energy[-1] < 0.5 * energy[0]


def _pulled(forest: Forest, seconds: float, force: float, angle: float, dt: float) -> np.ndarray:
    """Pull a tip slowly, hold it, let it go slowly; return moments at the joints while held."""
    tip, way = len(forest) - 1, np.array([np.cos(angle), np.sin(angle), 0.0])
    rise = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, int(seconds / dt)))
    for share in [*rise, *np.ones(len(rise))]:
        forest.apply_impulse(tip, linear=share * force * dt * way)
        forest.step(dt)
    held = np.linalg.norm(forest.joint_wrenches[:, 3:], axis=1)
    for share in [*rise[::-1], *np.zeros(len(rise))]:
        forest.apply_impulse(tip, linear=share * force * dt * way)
        forest.step(dt)
    return held


@pytest.mark.report('laws')
@pytest.mark.parametrize('dt', [1.0 / 30.0, 1.0 / 60.0, 1.0 / 240.0])
def test_wood_stays_bent_by_what_is_beyond_its_yield_moment(dt, measured):
    """Keep (M - Y)/H in every joint, whatever the time step and the way; nothing below Y."""
    # 20 N at 5 m of 9.8e-5 m³.
    forest = Forest(beam(yield_stress=0.6e6, damping_ratio=0.2), gravity=_NO_WEIGHT)
    moment = _pulled(forest, 6.0, 20.0, 0.5, dt)
    limit, hardening = forest.model.swing[:, YIELD], forest.model.swing[:, HARDENING]
    expected = np.maximum(moment - limit, 0.0) / hardening
    bend = np.linalg.norm(forest.bends[:, :2], axis=1)
    assert 3 < np.count_nonzero(expected) < 7 and np.abs(forest.velocities).max() < 1e-4
    np.testing.assert_allclose(bend, expected, atol=0.005 * expected.max())
    measured('bend that stays at the foot of a beam pulled beyond yielding', bend[0], expected[0],
             'rad', rtol=0.01)
    assert np.arctan2(-forest.bends[0, 0], forest.bends[0, 1]) == pytest.approx(0.5, abs=0.01)


@pytest.mark.report('laws')
def test_bending_green_wood_takes_the_work_that_tests_have(measured):
    """Bend a beam to its strength: over the elastic work that is 3.8 to 6.3 in four woods."""
    # Work to the greatest load over MOR²/18E of square beams with a load in the middle; green
    # white oak, loblolly pine, red oak and yellow birch (Wood Handbook, FPL-GTR-282, table 5-3).
    handbook = np.array([80e3, 57e3, 91e3, 111e3]) * 18.0 * np.array([8.6e9, 9.7e9, 9.3e9, 10.3e9])
    handbook /= np.square([57e6, 50e6, 57e6, 57e6])
    strength, dt = 1e6, 1.0 / 60.0
    works = []
    for share in (np.inf, 0.6):
        forest = Forest(beam(40, yield_stress=share * strength, damping_ratio=0.1),
                        gravity=_NO_WEIGHT)
        force, way, work = strength * np.pi / 4.0 * RADIUS ** 3 / LENGTH, forest.poses[-1, 0], 0.0
        for part in np.linspace(0.0, 1.0, 1200):
            forest.apply_impulse(len(forest) - 1, linear=(part * force * dt, 0.0, 0.0))
            forest.step(dt)
            work += part * force * (forest.poses[-1, 0] - way)
            way = forest.poses[-1, 0]
        works.append(work)
    measured.within('work of bending green wood to its strength over elastic work',
                    works[1] / works[0], handbook.min(), handbook.max())
    assert works[1] / works[0] == pytest.approx(np.median(handbook), rel=0.15)


def test_yielding_only_takes_energy():
    """Shove a bush beyond its yield moments: no step adds energy, and far more is lost."""
    left = []
    for stress in (np.inf, 3e6):
        energy = _shoved(Forest(bush(yield_stress=stress, damping_ratio=0.0), air_density=0.0))
        assert np.diff(energy).max() <= 1e-9 * energy[0]
        left.append(energy[300] / energy[0])
    assert left[0] > 0.99 and left[1] < 0.8


def test_what_was_drawn_unloaded_and_yields_by_its_weight_begins_at_rest():
    """Let a level branch hang by more than its yield moment: nothing moves, and after a reset."""
    forest = _branch('Preload(0) Yield(1e6)', 20)
    assert np.linalg.norm(forest.bends[:, :2]) > 1.5 * np.linalg.norm(
        _branch('Preload(0)', 20).bends[:, :2])
    for _ in range(2):
        rest = forest.poses.copy()
        for _ in range(30):
            forest.step(1.0 / 60.0)
        np.testing.assert_allclose(forest.poses, rest, atol=1e-5)
        forest.reset()


def test_what_never_yields_moves_as_what_cannot():
    """Expect the same bits with a yield stress that is never reached as without one."""
    moved = []
    for stress in (np.inf, 1e12):
        forest = Forest(bush(yield_stress=stress))
        wind = np.tile([20.0, 3.0, 0.0], (len(forest), 1))
        for _ in range(60):
            forest.step(1.0 / 60.0, wind)
        moved.append(forest.poses.copy())
    np.testing.assert_array_equal(*moved)


def test_a_wind_that_bends_for_good_does_so_from_the_start():
    """Begin in a wind beyond the yield moments: bent as one that it has risen on slowly."""
    blueprint = bush(yield_stress=8e6, damping_ratio=0.5)
    begun, risen = Forest(blueprint), Forest(blueprint)
    wind = np.tile([30.0, 0.0, 0.0], (len(begun), 1))
    begun.lean(np.arange(1), wind)
    for share in np.minimum(np.arange(1500) / 1200.0, 1.0):
        risen.step(1.0 / 60.0, np.sqrt(share) * wind)
    bends = [np.linalg.norm(forest.bends[:, :2], axis=1) for forest in (begun, risen)]
    for forest in (begun, risen):
        for _ in range(1200):
            forest.step(1.0 / 60.0)
    kept = [np.linalg.norm(forest.bends[:, :2], axis=1) for forest in (begun, risen)]
    assert kept[0].max() > 0.02
    np.testing.assert_allclose(bends[0], bends[1], atol=0.03 * bends[1].max())
    np.testing.assert_allclose(kept[0], kept[1], atol=0.05 * kept[1].max())
    begun.reset()
    np.testing.assert_array_equal(begun.poses, Forest(blueprint).poses)


def test_grammars_say_where_wood_yields():
    """Read `Yield` as a stress; refuse it below its range, by its name."""
    tree = LSystem.parse('axiom: Width(0.1) Yield(4e7) F(1) YieldRate(0.5) F(1) F(1)').build()
    assert tree.hinges.yield_stress.tolist() == [4e7, 4e7, 2e7]
    assert np.isinf(LSystem.parse('axiom: F(1)').build().hinges.yield_stress).all()
    with pytest.raises(GrammarError, match='Yield.*from 1 to 1e'):
        LSystem.parse('axiom: Yield(0) F(1)').build()
    with pytest.raises(SceneError, match='yield stress'):
        beam(yield_stress=0.0)


def test_drag_falls_with_the_leaves_that_are_left():
    """Expect half the leaves to take half the push, and all of them back after a reset."""
    forest = Forest(replace(beam(1), leaf_area=np.array([1e4])), gravity=_NO_WEIGHT)
    push = []
    for share in (1.0, 0.5, None):
        if share is None:
            forest.reset()
        else:
            forest.keep_leaves(np.array([0]), np.array([share]))
        forest.release(0)
        forest.velocities[:] = 0.0
        forest.step(1e-9, np.array([[8.0, 0.0, 0.0]]))
        push.append(forest.velocities[0, 0])
    assert push[1] / push[0] == pytest.approx(0.5, rel=1e-3)
    assert push[2] == push[0]


def test_wind_may_come_in_any_layout():
    """Expect single precision and strided wind to do as contiguous doubles do."""
    wind = np.ones((44, 6), np.float32)[:, ::2]
    first, second = Forest(bush()), Forest(bush())
    first.step(1.0 / 60.0, wind)
    second.step(1.0 / 60.0, np.ones((44, 3)))
    assert np.array_equal(first.poses, second.poses)
    with pytest.raises(ValueError, match='must be'):
        first.step(1.0 / 60.0, np.ones((43, 3)))


_BRACKET = 'axiom: Strength({}) !(0.1) F(2) &(90) F(1) F(1) F(1) F(1)'
_STRESS = 0.25 * np.pi * 0.01 * 900 * 9.81 * 4.0 * 2.0 / (np.pi / 32.0 * 0.001)  # [Pa] at its root


def simulation(text, *more):
    """Make a simulation of a tree, and of others beside it."""
    scene = Scene()
    for i, tree in enumerate((text, *more)):
        scene.add(LSystem.parse(tree).build(), (20.0 * i, 0.0, 0.0), 0.0, f'tree_{i}')
    return Simulation(scene)


def mass(text):
    """Return the masses of the segments of a tree [kg]."""
    return LSystem.parse(f'axiom: {text}').build().mass


@pytest.mark.parametrize('share', [0.99, 1.01, 58.0])
def test_a_tree_that_cannot_carry_itself_is_told_of(share):
    """Warn from m·g·L/2 = σ·Z on, and say by how much; what is told of breaks at once."""
    sim = simulation(_BRACKET.format(_STRESS / share), 'axiom: Strength(60e6) F(2)')
    if share < 1.0:
        assert not sim.warnings
    else:
        line, = sim.warnings
        assert line.startswith('tree_0 does not carry its own weight: ') and 'Strength' in line
        # The bend of the stem is as long a lever as the first joint of the arm.
        assert float(line.split(' m by ')[1].split()[0]) == pytest.approx(share, rel=5e-3)
    sim.step()
    assert (len(sim.events) > 0) == (share > 1.0)


def test_trees_that_join_are_told_of():
    """Warn of what is added to a running scene, and of that alone."""
    sim = simulation(_BRACKET.format(0.5 * _STRESS))
    before = sim.warnings
    pole = LSystem.parse('axiom: BreakForce(10) !(0.1) F(1)').build()
    sim.add(pole, (0.0, 9.0, 0.0), 0.0, 'new')
    assert sim.warnings[:len(before)] == before and len(sim.warnings) == len(before) + 1
    assert 'new does not carry its own weight: 1 of 1 joints are overloaded' in sim.warnings[-1]
    assert sim.warnings[-1].endswith('times its BreakForce')


@pytest.mark.parametrize('seed', range(12))
def test_weight_overloads_what_breaks_in_the_first_step(seed):
    """Compare with the joints that a forest at rest finds overloaded, for trees of all sorts."""
    for sample in draw(seed, 3, 0)[0]:
        forest = Forest(LSystem.parse(sample.text).build(seed=sample.seed))
        if forest.has_sagged:
            continue
        rows, causes, ratio = forest.overloaded_by_weight()
        forest.step(1.0 / 60.0)
        found, found_causes, _, _ = forest.overloaded()
        sure = ratio > 1.0 + 1e-6
        assert set(rows[sure]) <= set(found) and len(found) <= len(rows) + np.sum(~sure)
        told = dict(zip(rows.tolist(), causes.tolist()))
        assert all(told.get(row, cause) == cause for row, cause in
                   zip(found.tolist(), found_causes.tolist()))


def test_trees_that_hold_are_not_told_of():
    """Stay silent about trees without weight or strength, and where the roots hold."""
    scene = simulation('axiom: !(0.1) F(9)', 'axiom: RootMoment(1e5) !(0.1) F(2) &(30) F(3)')
    assert not scene.warnings
    line, = simulation('axiom: RootMoment(1) !(0.1) F(2) &(30) F(3)').warnings
    assert line.endswith('times its RootMoment')
    blueprint = LSystem.parse(_BRACKET.format(1.0)).build()
    assert len(Forest(blueprint, gravity=(0.0, 0.0, 0.0)).overloaded_by_weight()[0]) == 0
    rows, causes, _ = Forest(blueprint).overloaded_by_weight()
    assert len(rows) == 5 and set(causes.tolist()) == {Cause.BENDING}


@pytest.mark.parametrize(('polygon', 'area'), [
    ('{ . f(1) +(90) . f(1) +(90) . f(1) +(90) . }', 1.0),
    ('{ . f(2) +(90) f(0.5) +(90) f(2) }', 1.0), ('[ +(90) { . f(1) +(90) f(1) } ]', 0.5),
    ('{ f(1) }', 0.0), ('{ . f(1) +(120) . f(1) . } ~(0.5)', 0.25 + 0.75 ** 0.5 / 2)])
def test_polygons_weigh_and_catch_wind_as_leaves_do(polygon, area):
    """Add the area of what is drawn to that of the leaves of the segment."""
    bare, tree = (LSystem.parse(f'axiom: !(0.03) F(1) F(1) {more}').build()
                  for more in ('', polygon))
    assert tree.leaf_area == pytest.approx([0.0, area])
    assert tree.mass - bare.mass == pytest.approx([0.0, LEAF_AREAL_DENSITY * area])
    leaf = LSystem.parse(f'axiom: !(0.03) F(1) F(1) ~({max(area, 1e-6) ** 0.5})').build()
    leant = [Forest(blueprint) for blueprint in (tree, leaf)]
    for forest in leant:
        forest.lean(np.arange(1), np.tile([10.0, 0.0, 0.0], (2, 1)))
    assert leant[0].poses == pytest.approx(leant[1].poses, abs=1e-6)


def test_segments_end_as_wide_as_the_next_one_begins():
    """Taper to what goes on; keep the width before a branch, and where nothing follows."""
    cylinder = 900 * np.pi * 0.25 * 0.01
    assert mass('!(0.1) F(1) !(0.1) F(1)')[0] == pytest.approx(cylinder)
    total = mass('!(0.1) F(1) !(0.05) F(1)').sum()
    assert total == pytest.approx(cylinder * (1.75 / 3.0 + 0.25))
    assert mass('!(0.1) F(1) [ !(0.05) F(1) ]') == pytest.approx([cylinder, 0.25 * cylinder])
    stalk = 'F(0.1) [ !(0.1) F(0.1) ]'
    assert mass(f'!(0.01) {stalk}') == pytest.approx([0.001 * cylinder, 0.1 * cylinder])
    assert mass('!(0.1) WidthRate(0.5) F(1)') == pytest.approx([cylinder * 1.75 / 3.0])


@pytest.mark.parametrize('branch', [False, True])
def test_a_column_buckles_at_greenhills_height(branch):
    """Stand below 7.837·E·I/(w·h³) = 1, be told of above; a branch weighs where it sits."""
    height = (7.8373 * 1e10 * 0.05**2 / 16.0 / 800.0 / 9.81) ** (1.0 / 3.0)
    pole = 'axiom: Density(800) Modulus(1e10) !(0.05) ' + 'F({0})' * 20
    pole += ' [ &(90) !(0.02) F(0.5) ]' * branch
    low, high = (simulation(pole.format(part * height / 20.0))
                 for part in (0.93 if branch else 0.99, 1.01))
    assert not low.warnings
    line, = high.warnings
    assert line.startswith('tree_0 is too slender to stand upright: it buckles under 0.9')
    share = high.state.forest.buckling()[1][0]
    lightest = 0.92 if branch else 0.998
    assert lightest < share * 1.01**3 < (0.99 if branch else 1.001)


def test_what_is_told_to_buckle_topples():
    """Let a touch decide: a column above Greenhill's height falls, one below swings back."""
    for part, falls in ((0.9, False), (1.15, True)):
        height = part * (7.8373 * 1e10 * 0.05**2 / 16.0 / 800.0 / 9.81) ** (1.0 / 3.0)
        sim = simulation('axiom: Density(800) Modulus(1e10) DampingRatio(0.3) !(0.05) '
                         + f'F({height / 12.0})' * 12)
        sim.apply_impulse(11, (0.02, 0.0, 0.0))
        while abs(sim.poses[11, 0]) <= 0.5 and sim.time < 15.0:
            sim.step(30)
        assert (abs(sim.poses[11, 0]) > 0.5) == falls


_HEIGHT, _WIDTH, _DENSITY, _MODULUS = 10.0, 0.3, 900.0, 8e9  # SI
_BRANCH = 'axiom: Width(0.04) &(90) Density(800) Modulus(8e9) {shape} {segments}\n'


def _beam_frequency(taper: float, elements: int = 200) -> float:
    """Compute f1 of a tapered cantilever by Euler-Bernoulli elements [Hz]."""
    length = _HEIGHT / elements
    stiffness, mass = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    bend = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]], float)
    carry = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22],
                      [-13, -3, -22, 4]], float) / 420.0
    unit = np.array([1.0, length, 1.0, length])
    for i in range(elements):
        width = _WIDTH * (1.0 + (taper - 1.0) * (i + 0.5) / elements)
        at = slice(2 * i, 2 * i + 4)
        inertia = _MODULUS * np.pi * width ** 4 / 64.0
        stiffness[at, at] += inertia / length ** 3 * bend * np.outer(unit, unit)
        mass[at, at] += (_DENSITY * np.pi * width ** 2 / 4.0 * length * carry
                         * np.outer(unit, unit))
    square = eigh(stiffness[2:, 2:], mass[2:, 2:], eigvals_only=True, subset_by_index=[0, 0])
    return float(np.sqrt(square[0])) / (2.0 * np.pi)


@pytest.mark.parametrize('taper', [1.0, 0.5, 0.3, 0.1])
def test_ten_tapered_segments_sway_like_the_beam(taper):
    """Hold f1 of a stem that tapers down to a tenth within 2 %."""
    nodes = np.zeros((11, 3))
    nodes[:, 2] = np.linspace(0.0, _HEIGHT, 11)
    stem = skeleton.from_nodes(nodes, np.arange(11) - 1,
                               0.5 * _WIDTH * np.linspace(1.0, taper, 11), density=_DENSITY,
                               modulus=_MODULUS, damping_ratio=0.01)
    forest, path, dt = Forest(stem, (0.0, 0.0, 0.0), 0.0), [], 1.0 / 400.0
    forest.apply_impulse(9, linear=(0.1, 0.0, 0.0))
    for _ in range(1600):
        forest.step(dt)
        path.append(forest.poses[3, 0])
    free = np.array(path)
    # The higher modes of the push die out first; what is left is counted from zero to zero.
    late = free[-800:]
    before = np.flatnonzero(late[1:] * late[:-1] < 0.0)
    times = dt * (before + late[before] / (late[before] - late[before + 1]))
    frequency = (len(times) - 1) / (2.0 * (times[-1] - times[0]))
    assert frequency == pytest.approx(_beam_frequency(taper), rel=0.02)


def _branch(shape: str, count: int) -> Forest:
    return Forest(LSystem.parse(_BRANCH.format(shape=shape, segments='F(0.1) ' * count)).build())


def test_a_branch_drawn_unloaded_sags_as_beam_theory():
    """Expect w·L⁴/8EI at the tip of a level branch of 2 m, and no motion afterwards."""
    forest = _branch('Preload(0)', 20)
    drawn = _branch('', 20).poses[19]
    weight = 800.0 * np.pi / 4.0 * 0.04 ** 2 * 9.81
    sag = weight * 2.0 ** 4 / (8.0 * 8e9 * np.pi * 0.04 ** 4 / 64.0)
    tip = forest.poses[19, 2] + 0.05 * (forest.poses[19, 2] - forest.poses[18, 2]) / 0.1
    assert drawn[2] - tip == pytest.approx(sag, rel=0.02)
    rest = forest.poses.copy()
    for _ in range(120):
        forest.step(1.0 / 60.0)
    np.testing.assert_allclose(forest.poses, rest, atol=1e-9)
    forest.reset()
    np.testing.assert_array_equal(forest.poses, rest)


def test_a_whip_that_is_drawn_level_hangs():
    """Let a branch sag that its weight outdoes: it hangs down, at rest, in balance."""
    text = _BRANCH.format(shape='Width(0.004) SwingLimit(90) Preload(0)', segments='F(0.1) ' * 20)
    forest = Forest(LSystem.parse(text).build())
    rest = forest.poses.copy()
    assert rest[19, 2] < -1.0
    for _ in range(120):
        forest.step(1.0 / 60.0)
    np.testing.assert_allclose(forest.poses, rest, atol=1e-6)


def test_half_a_preload_sags_half():
    """Allow for half of the weight in the drawn shape: half of the small sag is left."""
    drawn, half, none = (_branch(shape, 5).poses[4, 2]
                         for shape in ('', 'Preload(0.5)', 'Preload(0)'))
    assert drawn - half == pytest.approx(0.5 * (drawn - none), rel=1e-3)


def test_a_scene_begins_sagged():
    """Show the sagged pose before the first step already."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['twig']},
        'twig': {'grammar_text': _BRANCH.format(shape='Preload(0)', segments='F(0.1) ' * 20)}})
    simulation = Simulation(scene)
    first = simulation.poses.copy()
    assert first[19, 2] < scene.blueprint.poses[19, 2] - 0.01
    simulation.step(30)
    np.testing.assert_allclose(simulation.poses, first, atol=1e-9)


def test_a_root_plate_turns_out_of_the_ground():
    """Push a stem beyond its root moment: it falls whole, and the event says why."""
    text = ('axiom: Width(0.2) Strength(60e6) RootMoment({:g}) F(2) F(2) F(2) F(2) F(2) F(2) F(2) '
            'F(2) F(2)\n')
    holds = 60e6 * np.pi / 32.0 * 0.2 ** 3
    for moment, cause in ((0.8 * holds, Cause.UPROOTING), (1.2 * holds, Cause.BENDING)):
        simulation = Simulation(Scene.from_parameters({
            'scene': {'objects': ['mast']}, 'wind': {'turbulence_intensity': 0.0},
            'mast': {'grammar_text': text.format(moment)}}))
        simulation.set_wind((150.0, 0.0, 0.0))
        while not len(simulation.events) and simulation.time < 20.0:
            simulation.step()
        assert simulation.events['cause'][0] == cause
        assert simulation.events['part_a'][0] == -1
        assert 1.0 < simulation.events['load'][0] < 1.2
        simulation.set_wind((0.0, 0.0, 0.0))
        simulation.step(600)
        assert simulation.poses[:, 2].max() < 4.0


def test_only_joints_in_the_ground_are_uprooted():
    """Leave the root moment of all segments to the first."""
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    stem = skeleton.from_nodes(nodes, [-1, 0, 1], [0.1] * 3)
    loads = Forest(replace(stem, hinges=replace(stem.hinges, root_moment=np.full(2, 10.0))))
    loads.apply_impulse(1, linear=(50.0, 0.0, 0.0))
    loads.step(1.0 / 60.0)
    assert Cause.UPROOTING in loads.overloaded()[1]
    grown = LSystem.parse('axiom: RootMoment(10) F F F\n').build()
    assert np.isinf(grown.hinges.root_moment[1:]).all() and grown.hinges.root_moment[0] == 10.0


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
    """Expect momentum to change by what the ground and the weight give, and by nothing else."""
    # The wrenches of the roots hold what the ground gives; contacts act inside.
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
