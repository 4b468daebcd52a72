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

from procphys_ros.physics.trees import Forest

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


@pytest.mark.parametrize('frequency, segments', [(1.0, 1), (0.3, 10), (2.0, 10)])
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
    dt, found = 1.0 / 1200.0, []  # short, lest the time step's own damping shows
    for pull in (0.0, 600.0):  # [m/s²] upwards, the way the beam points
        forest = Forest(beam(1, damping_ratio=0.05), gravity=(0.0, 0.0, pull), air_density=0.0)
        times, heights = _peaks(_swing_freely(forest, dt, 3600), dt)
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


@pytest.mark.parametrize('stiffness', [8e7, 8e9, 8e13])
@pytest.mark.parametrize('ratio', [0.0, 0.05])
def test_energy_never_rises_without_wind(stiffness: float, ratio: float):
    """Expect no step to add energy after a shove, springs, preload and weight included."""
    forest = Forest(bush(stiffness=stiffness, damping_ratio=ratio), air_density=0.0)
    rng = np.random.default_rng(1)
    forest.velocities[:] = rng.normal(size=forest.velocities.shape)
    forest.step(1.0 / 60.0)
    energy = [forest.energy()]
    for _ in range(600):
        forest.step(1.0 / 60.0)
        energy.append(forest.energy())
    assert np.diff(energy).max() <= 1e-9 * energy[0]
    assert ratio == 0.0 or energy[-1] < 0.5 * energy[0]


def test_motion_dies_out():
    """Expect no branch to move for ever once the wind has stopped."""
    forest = Forest(bush(damping_ratio=0.05))
    wind = np.zeros((len(forest), 3))
    wind[:, 0] = 25.0
    for _ in range(120):
        forest.step(1.0 / 60.0, wind)
    blown = forest.energy()
    for _ in range(1800):
        forest.step(1.0 / 60.0)
    assert forest.energy() < 1e-4 * blown
    assert np.abs(forest.velocities).max() < 1e-2


def test_wind_bends_leeward_and_more_with_speed():
    """Expect the crown to lean the way the wind blows, more at twice the speed."""
    lean = []
    for speed in (10.0, 20.0):
        forest = Forest(bush(damping_ratio=0.5))
        start = forest.poses[:, 1].mean()
        for _ in range(900):
            forest.step(1.0 / 60.0, np.tile([0.0, speed, 0.0], (len(forest), 1)))
        lean.append(forest.poses[:, 1].mean() - start)
    assert 0.0 < 3.0 * lean[0] < lean[1] < 5.0 * lean[0]


def test_leaves_streamline():
    """Expect leaf drag to grow with the square of the speed to 10 m/s, then with the speed."""
    drag = []
    for speed in (5.0, 10.0, 20.0):
        forest = Forest(replace(beam(1), leaf_area=np.array([1e4])), gravity=_NO_WEIGHT)
        forest.release(0)
        forest.step(1e-9, np.array([[speed, 0.0, 0.0]]))
        drag.append(forest.velocities[0, 0])
    assert drag[1] / drag[0] == pytest.approx(4.0, rel=1e-3)
    assert drag[2] / drag[1] == pytest.approx(2.0, rel=1e-3)


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


def test_same_commands_give_identical_poses():
    """Expect two runs, and a run after reset, to agree to the last bit."""
    def run(forest: Forest) -> np.ndarray:
        rng = np.random.default_rng(7)
        for i in range(200):
            forest.step(1.0 / 60.0, rng.normal(10.0, 5.0, (len(forest), 3)))
            if i == 50:
                forest.apply_impulse(20, linear=(5.0, 0.0, 0.0))
            if i == 100:
                forest.detach(30)
                forest.release(12)
        return forest.poses.copy()

    forest = Forest(bush())
    first = run(forest)
    forest.reset()
    assert np.array_equal(first, run(forest))
    assert np.array_equal(first, run(Forest(bush())))
