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

"""Leaves: fine motion in the wind, tearing off in a gale, falling, and their switches."""

from dataclasses import replace

import numpy as np
import pytest

from procphys_ros.blueprint import Leaves
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.air import FOLIAGE_DRAG
from procphys_ros.physics.foliage import (
    carried,
    drag_pressure,
    FallingLeaves,
    Flutter,
    SHEDDING_SPEED,
    speed_of,
    strengths,
)
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.wind import WindSettings
from procphys_ros.render.film import moment_of
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import read_settings, Settings
from procphys_ros.simulation import breaking, Simulation
from procphys_ros.simulation.parts import drag_area

SPRAY = ' '.join(f'[ +({40 * i}) &(60) Leaf({0.1 + 0.02 * i:.2f}, 1) ]' for i in range(9))
TREE = f"""
angle: 40
axiom: Width(0.12) Density(800) Modulus(8e9) DampingRatio(0.05) F(1) F(1)
  [ +(30) &(50) Width(0.05) F(0.8) {SPRAY} F(0.8) {SPRAY} ] F(1) Width(0.06) F(0.8) {SPRAY}
"""
FRAME = np.array([[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]])
UP = np.array([0.0, 0.0, 1.0])


def some_leaves(count=400, size=0.1):
    """Make leaves that point every way, all on one part."""
    rng = np.random.default_rng(3)
    turn = rng.standard_normal((count, 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    pose = np.hstack([rng.uniform(-1.0, 1.0, (count, 3)), turn])
    return Leaves(np.zeros(count, np.int32), pose, np.full(count, size), np.zeros(count, np.int16))


def in_wind(flutter, leaves, speed, time):
    """Compute the poses of leaves in a level wind."""
    carrier = np.zeros(len(leaves), np.intp)
    return flutter.poses(carrier, FRAME, np.array([[speed, 0.0, 0.0]]), time)


def swing(speed):
    """Compute the swing of leaves of 10 cm at a wind speed, as a standard deviation [rad]."""
    leaves = some_leaves()
    flutter = Flutter(leaves, 1)
    turns = np.array([in_wind(flutter, leaves, speed, 0.037 * i)[:, 3:] for i in range(120)])
    return 2.0 * np.sqrt((turns.std(axis=0) ** 2).sum(axis=1)).mean()


def simulate(speed, seed=0, **groups):
    """Make a simulation of one small tree in a steady level wind."""
    settings = read_settings(groups)
    wind = WindSettings((speed, 0.0, 0.0), turbulence_intensity=0.0, profile='uniform')
    scene = Scene(Settings(wind=wind, leaves=settings.leaves))
    scene.add(LSystem.parse(TREE).build(), name='tree')
    return Simulation(scene, seed=seed)


def test_leaves_rest_exactly_in_still_air():
    """Expect the rest pose bit for bit in still air."""
    leaves = some_leaves()
    assert np.array_equal(in_wind(Flutter(leaves, 1), leaves, 0.0, 12.3), leaves.pose)
    simulation = simulate(0.0)
    simulation.step(5)
    tree = simulation.blueprint
    rest = rotation.compose(tree.poses[tree.leaves.part], tree.leaves.pose)
    assert np.abs(simulation.leaf_poses() - rest).max() < 1e-9


def test_petioles_stay_where_they_grow_and_attitudes_stay_unit():
    """Turn the blade about its base only, at every wind speed."""
    leaves = some_leaves()
    for speed in (0.1, 5.0, 60.0):
        poses = in_wind(Flutter(leaves, 1), leaves, speed, 7.0)
        assert np.array_equal(poses[:, :3], leaves.pose[:, :3])
        assert np.linalg.norm(poses[:, 3:], axis=1) == pytest.approx(1.0)


def test_flutter_grows_with_the_wind_and_levels_off():
    """Flutter more in more wind, up to a bound below half a radian."""
    speeds = [0.5, 1.0, 2.0, 4.0, 8.0, 16.0]
    swings = [swing(speed) for speed in speeds]
    assert all(a < 1.02 * b for a, b in zip(swings, swings[1:]))
    assert swings[0] < 0.1 * swings[-1]
    assert swing(32.0) == pytest.approx(swings[-1], rel=0.05)
    assert 0.2 < swings[-1] < 0.5


def test_small_leaves_flutter_faster():
    """Scale the frequency with size to the power of minus one half, 5 Hz at 6 cm."""
    for size in (0.06, 0.24):
        frequency = Flutter(some_leaves(4000, size), 1).frequency
        assert np.median(frequency) == pytest.approx(5.0 * np.sqrt(0.06 / size), rel=0.02)


def test_blades_turn_downwind():
    """Turn the axes of leaves towards where the wind blows, further in more wind."""
    leaves = some_leaves(2000)
    poses = [in_wind(Flutter(leaves, 1), leaves, speed, 1.0) for speed in (0.0, 5.0, 10.0, 30.0)]
    along = [rotation.rotate(some[:, 3:], UP)[:, 0].mean() for some in poses]
    assert along[0] == pytest.approx(0.0, abs=0.05)
    assert along[0] + 0.05 < along[1] < along[2] < along[3] and along[3] > 0.4


def test_the_turn_downwind_balances_drag_and_petiole():
    """Stop where C·sin(angle to the wind) = sin(angle from rest), with C = 0.45 at 10 m/s."""
    upright = Leaves(np.zeros(1, np.int32), np.array([[0, 0, 0, 0, 0, 0, 1.0]]), np.full(1, 0.1),
                     np.zeros(1, np.int16))
    flutter = Flutter(upright, 1)
    mean = np.mean([rotation.rotate(in_wind(flutter, upright, 10.0, t)[:, 3:], UP)[0]
                    for t in np.linspace(0.0, 200.0, 8000)], axis=0)
    tilt = np.arctan2(mean[0], mean[2])
    assert np.sin(tilt) == pytest.approx(0.45 * np.sin(0.5 * np.pi - tilt), rel=0.01)


def test_flutter_is_smooth_in_time_and_in_the_wind():
    """Move by angles in proportion to small changes of time and of speed."""
    leaves = some_leaves()
    flutter = Flutter(leaves, 1)
    fastest = 2.0 * np.pi * flutter.frequency.max()
    for speed in (0.0, 3.0, 9.99, 12.0, 40.0):
        here = in_wind(flutter, leaves, speed, 1.0)
        assert np.abs(in_wind(flutter, leaves, speed, 1.0 + 1e-4) - here).max() < fastest * 1e-4
        assert np.abs(in_wind(flutter, leaves, speed + 1e-4, 1.0) - here).max() < 1e-4


def test_the_same_seed_gives_the_same_flutter_whatever_was_asked_before():
    """Depend on seed, place, wind and time alone."""
    leaves = some_leaves()
    first = Flutter(leaves, 5)
    in_wind(first, leaves, 9.0, 0.3)
    expected = in_wind(Flutter(leaves, 5), leaves, 6.0, 2.5)
    assert np.array_equal(in_wind(first, leaves, 6.0, 2.5), expected)
    assert not np.allclose(in_wind(Flutter(leaves, 6), leaves, 6.0, 2.5), expected)


def test_leaves_that_join_leave_the_others_as_they_were():
    """Move no leaf by adding a tree: a later one may not draw the flutter of those before it."""
    simulation = simulate(9.0)
    simulation.step(5)
    before = simulation.leaf_poses()
    simulation.add(LSystem.parse(TREE).build(), (9.0, 0.0, 0.0), name='late')
    after = simulation.leaf_poses()
    assert len(after) == 2 * len(before)
    assert np.array_equal(after[:len(before)], before)


def test_the_wind_counts_in_the_frame_of_the_branch():
    """Expect the same world poses whether the leaf or its part is turned."""
    leaves = some_leaves(50)
    turn = np.array([0.5, 0.5, -0.5, 0.5])
    plain, frame = (np.array([[0, 0, 0, *q]], float) for q in ([0, 0, 0, 1], turn))
    back = rotation.compose(np.array([0, 0, 0, *rotation.conjugate(turn)]), leaves.pose)
    turned = Leaves(leaves.part, back, leaves.size, leaves.texture)
    carrier, air = np.zeros(50, np.intp), np.array([[6.0, 2.0, 1.0]])
    straight = Flutter(leaves, 1).poses(carrier, plain, air, 1.0)
    local = Flutter(turned, 1).poses(carrier, frame, air, 1.0)
    assert np.abs(carried(carrier, plain, straight) - straight).max() < 1e-12
    assert np.abs(carried(carrier, frame, local) - straight).max() < 1e-12
    assert np.abs(rotation.compose(frame, local) - straight).max() < 1e-12


def test_drag_pressure_and_speed_are_inverse():
    """Recover the speed from the drag over all three ranges of streamlining."""
    speed = np.linspace(0.1, 80.0, 300)
    assert speed_of(drag_pressure(speed)) == pytest.approx(speed)
    assert drag_pressure(5.0) == pytest.approx(0.5 * 1.225 * 0.4 * 25.0)
    assert drag_pressure(20.0) / drag_pressure(10.0) == pytest.approx(2.0 ** (2.0 - 0.85))


def test_strengths_follow_their_distribution():
    """Hold all leaves below 17 m/s, and 37 % of them at 50 m/s, whatever their size."""
    area = np.random.default_rng(0).uniform(0.001, 0.5, 20_000)
    speed = speed_of(strengths(area, SHEDDING_SPEED, np.random.default_rng(1)) / area)
    assert speed.min() >= SHEDDING_SPEED * (1.0 - 1e-12)
    assert (speed > 50.0).mean() == pytest.approx(np.exp(-1.0), abs=0.01)
    assert abs(np.corrcoef(speed, area)[0, 1]) < 0.03


def test_more_wind_takes_more_leaves_and_little_wind_none():
    """Shed nothing below the shedding speed; above it, what the drag exceeds and no more."""
    counts = []
    for speed in (16.9, 25.0, 40.0, 70.0):
        simulation = simulate(speed)
        critical = simulation.model.leaves.critical_speed
        simulation.step()
        gone = np.zeros(len(critical), bool)
        gone[simulation.state.leaves.fallen.leaf] = True
        # The branches have started to move with the wind, by very little.
        assert not gone[critical > speed].any() and gone[critical < 0.95 * speed].all()
        counts.append(gone.sum())
    assert counts[0] == 0 and counts == sorted(counts) and counts[1] < 9 and counts[3] > 20


def test_a_bare_tree_feels_less_wind():
    """Bend less without leaves, and exactly as before after a reset."""
    bends = {}
    for shedding in (True, False):
        simulation = simulate(60.0, leaves={'shedding': shedding})
        simulation.step(300)
        bends[shedding] = np.abs(simulation.state.forest.bends).max()
    assert bends[True] < 0.95 * bends[False]
    simulation = simulate(60.0)
    simulation.step(20)
    first = simulation.poses.copy()
    simulation.reset()
    assert len(simulation.state.leaves.fallen) == 0 and simulation.state.leaves.attached.all()
    simulation.step(20)
    assert np.array_equal(simulation.poses, first)


def test_a_forest_without_leaves_moves_as_if_it_never_had_any():
    """Expect the poses of a tree of no leaf area, bit for bit, once all leaves are gone."""
    tree = LSystem.parse(TREE).build()
    stripped, bare = Forest(tree), Forest(replace(tree, leaf_area=np.zeros(len(tree))))
    stripped.keep_leaves(np.arange(len(stripped)), np.zeros(len(stripped)))
    leafy, wind = Forest(tree), np.tile([15.0, 3.0, 0.0], (len(bare), 1))
    for _ in range(60):
        for forest in (stripped, bare, leafy):
            forest.step(1 / 60, wind)
    assert np.array_equal(stripped.poses, bare.poses)
    assert not np.allclose(stripped.poses, leafy.poses)


def test_leaf_area_that_is_left_adds_up():
    """Take exactly the area of the leaves that fell out of the drag."""
    simulation = simulate(45.0)
    simulation.step(10)
    foliage, tree = simulation.state.leaves, simulation.blueprint
    left = np.bincount(tree.leaves.part, tree.leaves.size ** 2 * foliage.attached,
                       minlength=len(tree))
    assert foliage.left == pytest.approx(left, abs=1e-12)
    assert 0 < foliage.attached.sum() < len(tree.leaves)


def test_a_branch_that_fell_has_the_drag_of_the_leaves_it_kept():
    """Break a tree that a storm has stripped: its rigid pieces no longer catch that wind."""
    simulation = simulate(45.0)
    simulation.step(10)
    tree, left = simulation.blueprint, simulation.state.leaves.left
    bare = drag_area(replace(tree, leaf_area=np.zeros(len(tree))))
    rows, _, velocities = simulation.state.forest.detach(2)
    parts = simulation.state.forest.parts[rows]
    body, = breaking.release(simulation.model, simulation.state, [parts], velocities)
    assert left[parts].sum() < 0.6 * tree.leaf_area[parts].sum()
    assert simulation.state.bodies.drag_area[body] == pytest.approx(
        bare[parts].sum() + FOLIAGE_DRAG * left[parts].sum())


def test_switched_off_leaves_change_nothing():
    """Ride on the parts exactly, and leave every pose as it is without leaves' doings."""
    off = {'flutter': False, 'shedding': False}
    storm, calm, on = simulate(30.0, leaves=off), simulate(14.0, leaves=off), simulate(14.0)
    for simulation in (storm, calm, on):
        simulation.step(30)
        simulation.leaf_poses()
        simulation.step(30)
    tree = storm.blueprint
    riding = rotation.compose(storm.poses[tree.leaves.part], tree.leaves.pose)
    assert np.abs(storm.leaf_poses() - riding).max() < 1e-12
    assert len(storm.state.leaves.fallen) == 0
    assert np.array_equal(on.poses, calm.poses)  # flutter is for the eye and changes no drag


@pytest.mark.parametrize('time_step', [1 / 240, 1 / 60, 0.05])
def test_a_leaf_falls_at_its_terminal_speed(time_step):
    """Reach the speed where drag balances weight, 1 to 2.5 m/s, and drift with the wind."""
    falling, count = FallingLeaves(9.81, 1), 200
    pose = np.tile([0.0, 0.0, 1e4, 0.0, 0.0, 0.0, 1.0], (count, 1))
    falling.let_go(np.arange(count), pose, np.zeros((count, 3)), np.full(count, 0.1))
    air = np.tile([4.0, 0.0, 0.0], (count, 1))
    for _ in range(round(12.0 / time_step)):
        falling.step(np.arange(count), air, time_step)
    speed = -falling.velocities[:, 2]
    assert speed == pytest.approx(np.sqrt(9.81 / falling._drag), rel=1e-6)
    assert np.median(speed) == pytest.approx(np.sqrt(2 * 0.2 * 9.81 / (1.225 * 1.17)), rel=0.02)
    assert speed.min() > 1.0 and speed.max() < 2.5
    assert falling.velocities[:, 0] == pytest.approx(4.0, abs=1e-6)


def test_leaves_that_blow_far_away_are_let_go():
    """Fly 200 m and no further, however long the storm."""
    falling = FallingLeaves(9.81, 1)
    falling.let_go(np.arange(1), np.array([[5.0, 0.0, 900.0, 0.0, 0.0, 0.0, 1.0]]),
                   np.zeros((1, 3)), np.array([0.1]))
    while falling.flying.any():
        falling.step(np.arange(1), np.array([[30.0, 0.0, 3.0]]), 1 / 60)
    assert falling.poses[0, 0] == pytest.approx(205.0, abs=1.0) and falling.poses[0, 2] < 0.1


def test_fallen_leaves_come_down_and_stay():
    """Lie flat on the ground, every leaf once, after the wind has dropped."""
    simulation = simulate(60.0)
    simulation.step(5)
    simulation.set_wind((0.0, 0.0, 0.0))
    simulation.step(600)
    fallen = simulation.state.leaves.fallen
    assert len(fallen) > 0 and len(np.unique(fallen.leaf)) == len(fallen)
    assert not fallen.flying.any()
    poses = simulation.leaf_poses()[fallen.leaf]
    assert poses[:, 2] == pytest.approx(0.01)
    assert np.array_equal(np.flatnonzero(moment_of(simulation).lying), np.sort(fallen.leaf))
    assert rotation.rotate(poses[:, 3:], UP)[:, 2] == pytest.approx(0.0, abs=1e-9)
    simulation.step(60)
    assert np.array_equal(simulation.leaf_poses()[fallen.leaf], poses)


def test_the_same_seed_sheds_the_same_leaves():
    """Repeat a gale bit for bit, and lose other leaves with another seed."""
    runs = []
    for seed in (4, 4, 5):
        simulation = simulate(35.0, seed=seed)
        simulation.step(60)
        runs.append(simulation.leaf_poses())
    assert np.array_equal(runs[0], runs[1]) and not np.array_equal(runs[0], runs[2])


@pytest.mark.parametrize('exponent', [-0.5, -1.0, -1.3])
def test_foliage_folds_by_the_vogel_exponent_of_its_species(exponent):
    """Let the drag of leaves grow with u^(2 + V) from 10 to 25 m/s, else with the square."""
    text = f'axiom: !(0.001) SwingLimit(0.001) SwingForce(1e9) Vogel({exponent}) F(0.01) Leaf(3)'
    forest, drag = Forest(LSystem.parse(text).build(), (0.0, 0.0, 0.0)), []
    for speed in (5.0, 10.0, 25.0, 50.0):
        for _ in range(3):
            forest.step(1.0 / 60.0, np.array([[speed, 0.0, 0.0]]))
        drag.append(-forest.joint_wrenches[0, 0])
    growth = np.diff(np.log(drag)) / np.log([2.0, 2.5, 2.0])
    assert growth == pytest.approx([2.0, 2.0 + exponent, 2.0], abs=0.01)


def test_species_hold_their_leaves_differently():
    """Shed no needle at a wind that takes leaves, and let the scene's speed scale both."""
    text = 'axiom: !(0.05) F(1) {hold} [ Leaf(0.3) Leaf(0.3) Leaf(0.3) ]'
    scene = {'scene': {'objects': ['leaf', 'needle']},
             'leaf': {'grammar_text': text.format(hold='')},
             'needle': {'grammar_text': text.format(hold='SheddingSpeed(34)')}}
    for usual in (17.0, 8.5):
        critical = Simulation(Scene.from_parameters(
            {**scene, 'leaves': {'shedding_speed': usual}})).model.leaves.critical_speed
        assert usual <= critical[:3].min() and 2.0 * usual <= critical[3:].min() * (1.0 + 1e-9)
