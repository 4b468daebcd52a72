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

"""Joints of the engine of our own, against closed forms."""

import numpy as np
import pytest
from scipy.special import ellipk

from procphys_ros.blueprint import Shape
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.world import BodyState, JointKind, JointOptions, World
from procphys_ros.physics.world.pieces import single

G = 9.81
STEPS = [1.0 / 30.0, 1.0 / 240.0]  # the longest and the shortest; others take 1/60 s
ROD = np.array([1.0, 0.05, 0.05])
ALONG_Y = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.5 * np.pi))
DOWN = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(0.5 * np.pi))
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def pose(place, attitude=UPRIGHT):
    """Join a place and an attitude, (7,)."""
    return np.concatenate([place, attitude])


def bar(world, place, size=ROD, mass=1.0, attitude=UPRIGHT, velocity=None):
    """Add a box."""
    return world.add_body(Shape.BOX, np.asarray(size, float), mass, pose(place, attitude),
                          velocity)


def run(world, seconds, time_step, read):
    """Step for some time; return the reading after each step."""
    found = []
    for _ in range(round(seconds / time_step)):
        world.step(time_step)
        found.append(np.copy(read()))
    return np.array(found)


def energy(world, ids):
    """Compute the mechanical energy of bodies [J]."""
    table = world.bodies
    motion = motion_energy(table.mass[ids], table.inertia[ids], table.poses[ids][:, 3:],
                           table.velocities[ids])
    return float(np.sum(motion) + np.sum(table.mass[ids] * G * table.poses[ids, 2]))


def momenta(world, ids):
    """Compute momentum and angular momentum about the origin, (6,)."""
    table = world.bodies
    speed, turn = table.velocities[ids, :3], table.velocities[ids, 3:]
    attitude = table.poses[ids, 3:]
    own = rotation.rotate(attitude, table.inertia[ids] * rotation.rotate(
        rotation.conjugate(attitude), turn))
    mass = table.mass[ids, None]
    return np.concatenate([(mass * speed).sum(axis=0),
                           (own + np.cross(table.poses[ids, :3], mass * speed)).sum(axis=0)])


def periods(values, time_step):
    """Measure the mean time between rises through zero [s]."""
    rises = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    exact = rises + values[rises] / (values[rises] - values[rises + 1])
    return float(np.diff(exact).mean() * time_step)


def pendulum(kind, angle, **place):
    """Hang a rod by its end, away from the vertical by an angle; return world and body."""
    where = {'gravity': (0.0, 0.0, -G), **place}
    world = World(engine='native', **where)
    turn = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(0.5 * np.pi + angle))
    body = bar(world, np.array([0.0, 0.0, 5.0]) + rotation.rotate(turn, [0.5, 0.0, 0.0]), mass=2.0,
               attitude=turn)
    world.join(kind, body, 0, pose([0.0, 0.0, 5.0], ALONG_Y))
    return world, body


def chain(world, count, end_mass, kind=JointKind.BALL, start=(0.0, 0.0, 10.0)):
    """Stretch links of 0.2 m and 0.1 kg from a point of the world, with a block at the end."""
    start, link = np.array(start), 0.2
    way = np.array([link, 0.0, 0.0])
    ids = [bar(world, start + (k + 0.5) * way, [link, 0.03, 0.03], 0.1) for k in range(count)]
    ids = np.array([*ids, bar(world, start + count * way, [0.2] * 3, end_mass)])
    frames = np.array([pose(start + k * way, ALONG_Y) for k in range(count + 1)])
    return ids, world.join(kind, ids, np.concatenate([[0], ids[:-1]]), frames)


def gaps(world):
    """Compute the distance between the two points of every joint [m], (J,)."""
    rows, poses = world.joints, world.bodies.poses
    points = [rotation.compose(poses[body], frame)[:, :3] for body, frame in (
        (rows.first, rows.frame), (rows.second, rows.other_frame))]
    return np.linalg.norm(points[0] - points[1], axis=1)


@pytest.mark.parametrize('kind, time_step', [
    *((JointKind.HINGE, step) for step in STEPS), (JointKind.BALL, 1.0 / 60.0)])
def test_a_rod_swings_as_a_compound_pendulum(kind, time_step):
    """Keep its period, its energy, and its point; what may be lost goes by the swings."""
    angle, swings = 0.5, 3 if time_step > 0.01 else 2
    world, body = pendulum(kind, angle)
    inertia = 2.0 * (1.0 + 0.05 ** 2) / 12.0 + 2.0 * 0.25
    period = 4.0 * np.sqrt(inertia / (2.0 * G * 0.5)) * ellipk(np.sin(0.5 * angle) ** 2)
    depth = 2.0 * G * 0.5 * (1.0 - np.cos(angle))
    first = energy(world, [body])
    told = run(world, (swings + 0.2) * period, time_step,
               lambda: (world.bodies.poses[body, 0], energy(world, [body]), gaps(world).max()))
    assert periods(told[:, 0], time_step) == pytest.approx(period, rel=1e-3)
    # Within a substep gravity acts before the body moves: 0.1 % to and fro.
    assert np.abs(told[:, 1] - first).max() < 5e-4 * swings * depth
    assert told[:, 2].max() < 1e-5


def test_a_double_pendulum_keeps_its_energy(time_step=1.0 / 30.0):
    """Let two rods fall from the horizontal; what may be lost goes by the time."""
    world = World(engine='native')
    ids = np.array([bar(world, [0.5, 0.0, 5.0]), bar(world, [1.5, 0.0, 5.0], mass=2.0)])
    world.join(JointKind.HINGE, ids, [0, ids[0]],
               np.array([pose([0.0, 0.0, 5.0], ALONG_Y), pose([1.0, 0.0, 5.0], ALONG_Y)]))
    first = energy(world, ids)
    seconds = 5.0
    told = run(world, seconds, time_step, lambda: energy(world, ids) - first)
    assert np.abs(told).max() < 2e-4 * seconds * G * (0.5 + 2.0 * 1.5)
    assert np.abs(world.bodies.poses[ids, 1]).max() < 1e-9


@pytest.mark.parametrize('time_step', STEPS)
@pytest.mark.parametrize('share', [0.99, 1.01])
def test_a_cantilever_breaks_at_the_moment_of_its_weight(share, time_step):
    """Weld three boxes to each other and to the world."""
    world = World(engine='native')
    ids = np.array([bar(world, [0.2 + 0.4 * k, 0.0, 3.0], [0.4, 0.1, 0.1], 5.0)
                    for k in range(3)])
    frames = np.array([pose([0.4 * k, 0.0, 3.0]) for k in range(3)])
    weight, moment = 15.0 * G, 15.0 * G * 0.6
    world.join(JointKind.WELD, ids, [0, *ids[:2]], frames,
               JointOptions(moment=np.array([share * moment, np.inf, np.inf]),
                            force=np.array([np.inf, 1.01 * 10.0 * G, 1.01 * 5.0 * G])))
    world.step(time_step)
    told = np.concatenate([world.joints.force[0] / weight, world.joints.moment[0] / moment])
    # What breaks carries its strength for 1/240 s.
    mean = share / (240.0 * time_step) if share < 1.0 else 1.0
    np.testing.assert_allclose(told, mean * np.array([0, 0, 1, 0, -1, 0]), atol=1e-3)
    assert world.joints.broken.tolist() == [share < 1.0, False, False]
    run(world, 0.5, time_step, lambda: 0)
    fallen = 3.0 - world.bodies.poses[ids, 2]
    if share < 1.0:
        since = 0.5 + time_step - 1.0 / 240.0
        np.testing.assert_allclose(fallen, 0.5 * G * since ** 2, rtol=0.01)
    else:
        assert np.abs(fallen).max() < 1e-6


@pytest.mark.parametrize('time_step', STEPS)
def test_a_hinge_rests_against_its_limit(time_step):
    """Let a rod fall from the horizontal to 30 degrees below; the limit bears its moment."""
    world = World(engine='native')
    body = bar(world, [0.5, 0.0, 5.0], mass=2.0)
    limit = np.pi / 6.0  # about y, x turns downwards
    world.join(JointKind.HINGE, body, 0, pose([0.0, 0.0, 5.0], ALONG_Y),
               JointOptions(low=-0.1, high=limit))
    told = run(world, 2.0, time_step, lambda: world.joints.way[0])
    assert told.max() < limit + 1e-3
    assert told[-1] == pytest.approx(limit, abs=1e-3)
    np.testing.assert_allclose(world.joints.moment[0],
                               [0.0, -2.0 * G * 0.5 * np.cos(limit), 0.0], rtol=5e-3, atol=1e-2)


@pytest.mark.parametrize('kind, damping, time_step', [
    (JointKind.HINGE, 0.05, STEPS[1]), (JointKind.SLIDER, 0.0, STEPS[0])])
def test_a_spring_swings_with_its_period(kind, damping, time_step):
    """Compare period and decay; damping is a share of the critical one."""
    world = World(engine='native', gravity=(0.0, 0.0, 0.0))
    mass, stiffness = 3.0, 200.0
    body = bar(world, [0.0, 0.0, 5.0], mass=mass)
    inertia = mass if kind == JointKind.SLIDER else world.bodies.inertia[body, 0]
    omega = np.sqrt(stiffness / inertia)
    world.join(kind, body, 0, pose([0.0, 0.0, 5.0]), JointOptions(
        stiffness=stiffness, damping=2.0 * damping * inertia * omega, rest=0.1))
    period = 2.0 * np.pi / (omega * np.sqrt(1.0 - damping ** 2))
    fine = min(time_step, 0.05 * period)  # to see it
    told = run(world, 5.2 * period, fine, lambda: world.joints.way[0]) - 0.1
    assert periods(told, fine) == pytest.approx(period, rel=0.01)
    late = np.abs(told[-int(period / fine):]).max() / 0.1
    time = period * np.round(4.7 * 2.0) / 2.0
    assert late == pytest.approx(np.exp(-damping * omega * time), rel=0.05 if damping else 0.01)


@pytest.mark.parametrize('time_step', STEPS)
def test_a_motor_pulls_with_its_force_until_it_has_its_speed(time_step):
    """Lift a block along the vertical."""
    world = World(engine='native')
    body = bar(world, [0.0, 0.0, 1.0], [0.2] * 3, 4.0)
    up = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-0.5 * np.pi))
    world.join(JointKind.SLIDER, body, 0, pose([0.0, 0.0, 1.0], up),
               JointOptions(speed=1.5, drive=4.0 * (G + 2.0)))
    told = run(world, 1.0, time_step, lambda: (world.bodies.velocities[body, 2],
                                               world.joints.force[0, 2]))
    times = time_step * np.arange(1, len(told) + 1)
    np.testing.assert_allclose(told[:, 0], np.minimum(2.0 * times, 1.5), atol=1e-6)
    np.testing.assert_allclose(told[times < 0.74, 1], 4.0 * (G + 2.0), rtol=1e-9)
    np.testing.assert_allclose(told[times > 0.79, 1], 4.0 * G, rtol=1e-9)
    np.testing.assert_allclose(world.bodies.poses[body, :2], 0.0, atol=1e-9)


def test_what_is_round_hangs_by_a_joint_without_rolling_resistance():
    """Spin a log about the axis by which it hangs: it is not braked, as nothing rolls."""
    world = World(engine='native')
    body = world.add_body(Shape.CAPSULE, np.array([0.2, 0.0, 0.5]), 5.0, pose([0.0, 0.0, 5.0]),
                          np.array([0.0, 0.0, 0.0, 0.0, 0.0, 4.0]))
    world.join(JointKind.BALL, body, 0, pose([0.0, 0.0, 5.4]))
    run(world, 2.0, 1.0 / 60.0, lambda: 0)
    assert world.bodies.velocities[body, 5] == pytest.approx(4.0, rel=1e-4)


def test_a_motor_stalls_at_a_limit():
    """Press against the end of a slider with the motor's force, and no more."""
    world = World(engine='native', gravity=(0.0, 0.0, 0.0))
    body = bar(world, [0.0, 0.0, 1.0], [0.2] * 3, 4.0)
    world.join(JointKind.SLIDER, body, 0, pose([0.0, 0.0, 1.0]),
               JointOptions(high=0.3, speed=1.0, drive=50.0))
    told = run(world, 1.0, 1.0 / 60.0, lambda: world.joints.way[0])
    assert told.max() < 0.3 + 1e-6
    assert told[-1] == pytest.approx(0.3, abs=1e-4)


@pytest.mark.parametrize('kind', [JointKind.SLIDER, JointKind.HINGE])
@pytest.mark.parametrize('blow', [10.0, -10.0])
def test_equal_limits_lock_a_joint_both_ways(kind, blow):
    """Strike a joint that may not move at all to either side; its bearing takes the blow."""
    world = World(engine='native', gravity=(0.0, 0.0, 0.0))
    body = bar(world, [0.5, 0.0, 5.0])
    frame = pose([0.0, 0.0, 5.0], UPRIGHT if kind == JointKind.SLIDER else ALONG_Y)
    world.join(kind, body, 0, frame, JointOptions(low=0.0, high=0.0))
    world.apply_impulse(body, np.array([blow, 0.0, blow]))
    moved = run(world, 0.1, 1.0 / 60.0, lambda: world.bodies.poses[body])
    np.testing.assert_allclose(moved[:, :3], [[0.5, 0.0, 5.0]] * 6, atol=1e-12)


def test_a_ball_joint_lets_a_pendulum_go_round_a_cone(time_step=1.0 / 30.0):
    """Throw a small heavy ball aside; it stays at its height."""
    world = World(engine='native')
    length, angle = 1.0, 0.6
    radius, depth = length * np.sin(angle), length * np.cos(angle)
    speed = radius * np.sqrt(G / depth)
    body = world.add_body(Shape.CAPSULE, np.array([0.01, 0.0, 0.0]), 1.0,
                          pose([radius, 0.0, 5.0 - depth]), np.array([0.0, speed, 0.0, 0, 0, 0]),
                          inertia=np.full(3, 1e-6))
    spin = np.array([0.0, 0.0, speed / radius])
    world.set_velocities(np.array([body]), np.concatenate([[0.0, speed, 0.0], spin])[None])
    world.join(JointKind.BALL, body, 0, pose([0.0, 0.0, 5.0]))
    seconds = 4.0  # two rounds
    told = run(world, seconds, time_step, lambda: world.bodies.poses[body, :3])
    assert np.abs(told[:, 2] - 5.0 + depth).max() < 1e-3 * seconds * depth
    assert periods(told[:, 1], time_step) == pytest.approx(
        2.0 * np.pi * np.sqrt(depth / G), rel=0.01)


@pytest.mark.parametrize('time_step', STEPS)
def test_a_rope_is_slack_and_then_taut(time_step):
    """Let a block fall freely by the length of its rope; it then hangs there with its weight."""
    world = World(engine='native')
    body = bar(world, [0.0, 0.0, 5.0], [0.1] * 3, 2.0)
    world.join(JointKind.ROPE, body, 0, pose([0.0, 0.0, 5.0]), JointOptions(high=1.0))
    told = run(world, 2.0, time_step, lambda: (world.bodies.poses[body, 2],
                                               world.joints.force[0, 2]))
    times = time_step * np.arange(1, len(told) + 1)
    falls = times < np.sqrt(2.0 / G) - time_step
    np.testing.assert_allclose(told[falls, 0], 5.0 - 0.5 * G * times[falls] ** 2, atol=3e-3)
    assert not told[falls, 1].any()
    assert told[:, 0].min() > 4.0 - 1e-3
    assert told[-1].tolist() == pytest.approx([4.0, 2.0 * G], abs=1e-3)


@pytest.mark.parametrize('kind, ratio', [
    (JointKind.BALL, 1e4), (JointKind.HINGE, 100.0)])
def test_a_chain_does_not_stretch(kind, ratio):
    """Let twenty links with a block at the end swing down from the horizontal."""
    world = World(engine='native')
    ids, joints = chain(world, 20, 0.1 * ratio, kind)
    told = run(world, 1.5, 1.0 / 60.0,
               lambda: (gaps(world).sum(), world.bodies.poses[ids[-1], 2]))
    assert told[:, 0].max() < 1e-3 * 4.0
    assert told[:, 1].min() < 10.0 - 3.8
    assert not world.joints.broken[joints].any()


def test_it_does_not_matter_in_which_order_joints_are_named():
    """Join a chain from its middle; it moves as before."""
    ends = []
    for order in (np.arange(8), np.random.default_rng(1).permutation(8)):
        world = World(engine='native')
        ids = np.array([bar(world, [0.1 + 0.2 * k, 0.0, 5.0], [0.2, 0.03, 0.03], 0.1)
                        for k in range(8)])
        frames = np.array([pose([0.2 * k, 0.0, 5.0], ALONG_Y) for k in range(8)])
        world.join(JointKind.HINGE, ids[order], np.concatenate([[0], ids[:-1]])[order],
                   frames[order])
        run(world, 0.5, 1.0 / 60.0, lambda: 0)
        ends.append(world.bodies.poses[ids])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


def test_a_ring_of_welds_is_one_body():
    """Weld four bars in a ring, which says more than is needed; it falls and turns as one."""
    world = World(engine='native')
    turn = np.array([0.1, 0.2, 0.3, 0.3, 0.2, 2.0])
    places = np.array([[0.5, 0.0, 0], [0.0, 0.5, 0], [-0.5, 0.0, 0], [0.0, -0.5, 0]])
    ids = np.array([bar(world, place + [0, 0, 50.0], [0.2] * 3, velocity=np.concatenate(
        [turn[:3] + np.cross(turn[3:], place), turn[3:]])) for place in places])
    world.join(JointKind.WELD, ids, np.roll(ids, 1), np.array([
        pose(place + [0, 0, 50.0]) for place in places]))
    told = run(world, 2.0, 1.0 / 60.0, lambda: gaps(world).max())
    assert told.max() < 1e-4
    centre = world.bodies.poses[ids, :3].mean(axis=0)
    np.testing.assert_allclose(centre, [0.2, 0.4, 50.6 - 0.5 * G * 4.0], atol=0.02)


def test_a_ring_of_hinges_has_no_moments_of_its_own():
    """Throw four rods of 1 kg in a plane ring, which turns at 2 rad/s: bearings get a few N·m."""
    world, spin = World(engine='native', gravity=(0.0, 0.0, 0.0)), np.array([1.0, 2.0, 0.5])
    places = np.array([[0.0, 0.5, 5.0], [0.5, 0.0, 5.0], [0.0, -0.5, 5.0], [-0.5, 0.0, 5.0]])
    ids = np.array([bar(world, place, ROD if k % 2 == 0 else ROD[[1, 0, 2]],
                        velocity=np.concatenate([np.cross(spin, place - [0, 0, 5.0]), spin]))
                    for k, place in enumerate(places)])
    upright = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-0.5 * np.pi))
    world.join(JointKind.HINGE, ids, np.roll(ids, -1), np.array([
        pose(place + after - [0, 0, 5.0], upright)
        for place, after in zip(places, np.roll(places, -1, axis=0))]))
    moments = run(world, 0.1, 1.0 / 60.0, lambda: world.joints.moment)
    assert np.abs(moments).max() < 20.0


def tumbling(way=(0.0, 0.0, 0.0), attitude=UPRIGHT, gravity=False):
    """Let three bodies hang by all kinds of joints, and throw them; return world and bodies."""
    down = rotation.rotate(attitude, [0.0, 0.0, -G]) if gravity else np.zeros(3)
    world = World(engine='native', gravity=tuple(down))
    rng = np.random.default_rng(7)
    places = np.array([[0.0, 0.0, 5.0], [1.0, 0.0, 5.0], [1.0, 1.0, 5.0], [0.0, 1.2, 5.2]])
    ids = []
    for place in places:
        speed = rng.normal(size=(2, 3))
        ids.append(bar(world, rotation.rotate(attitude, place) + way, [0.5, 0.2, 0.1],
                       rng.uniform(0.5, 2.0), attitude,
                       np.concatenate(rotation.rotate(attitude, speed))))
    ids = np.array(ids)
    frames = np.array([pose(rotation.rotate(attitude, 0.5 * (places[k] + places[k + 1])) + way,
                            attitude) for k in range(3)])
    kinds = np.array([JointKind.HINGE, JointKind.SLIDER, JointKind.BALL])
    world.join(kinds, ids[:-1], ids[1:], frames, JointOptions(
        low=np.array([-1.0, -0.3, 0.0]), high=np.array([1.0, 0.3, 0.0]), stiffness=3.0,
        damping=0.1, speed=1.0, drive=np.array([0.5, 0.0, 0.0])))
    world.join(JointKind.ROPE, ids[0], ids[3], pose(rotation.rotate(attitude, places[0]) + way),
               JointOptions(high=1.5), pose(rotation.rotate(attitude, places[3]) + way))
    return world, ids


def test_momentum_stays():
    """Let joints with limits, springs and motors act between bodies in free flight."""
    world, ids = tumbling()
    first = momenta(world, ids)
    for _ in range(120):
        world.step(1.0 / 60.0)
        np.testing.assert_allclose(momenta(world, ids), first, atol=2e-9)
    assert gaps(world)[[0, 2]].max() < 1e-3


@pytest.mark.parametrize('way, tolerance', [([0.0, 0.0, 0.0], 1e-8), ([9e4, -9e4, 0.0], 1e-5)])
def test_it_does_not_matter_where_and_how_it_stands(way, tolerance):
    """Turn and move what tumbles: it goes the same way."""
    attitude = np.array([0.1, -0.3, 0.5, 0.8]) / np.linalg.norm([0.1, -0.3, 0.5, 0.8])
    way = np.array(way) + [0.0, 0.0, 50.0]
    plain, ids = tumbling(way=np.array([0.0, 0.0, 50.0]), gravity=True)
    other, _ = tumbling(way=way, attitude=attitude, gravity=True)
    for _ in range(30):
        plain.step(1.0 / 60.0)
        other.step(1.0 / 60.0)
    there = rotation.rotate(attitude, plain.bodies.poses[ids, :3] - [0, 0, 50.0]) + way
    np.testing.assert_allclose(other.bodies.poses[ids, :3], there, atol=tolerance)
    np.testing.assert_allclose(other.joints.way, plain.joints.way, atol=tolerance)


def test_a_saved_world_goes_on_with_the_same_bits():
    """Restore what hangs, with turns that have been counted; it moves and breaks alike."""
    world = World(engine='native')
    ids, _ = chain(world, 5, 1.0)
    spun = bar(world, [5.0, 0.0, 5.0])
    wheel = world.join(JointKind.HINGE, spun, 0, pose([5.0, 0.0, 5.0]),
                       JointOptions(speed=20.0, drive=100.0, force=9.0 * G))[0]
    run(world, 1.0, 1.0 / 60.0, lambda: 0)
    assert world.joints.way[wheel] > 15.0
    other = World.restore(world.save_state(), 'native')
    world.rebuild()
    for one in (world, other):
        run(one, 1.0, 1.0 / 60.0, lambda: 0)
    assert world.bodies.poses[ids].tobytes() == other.bodies.poses[ids].tobytes()
    for one, two in zip(world.joints, other.joints):
        assert one.tobytes() == two.tobytes()


@pytest.mark.parametrize('name, value', [('first', np.array([77])), ('kind', np.array([9])),
                                         ('way', np.zeros((1, 2))), ('force', np.zeros((2, 3)))])
def test_damaged_joints_are_not_restored(name, value):
    """Refuse what names no body, no kind, or has another shape."""
    world, _ = pendulum(JointKind.HINGE, 0.1)
    saved = world.save_state()
    saved[f'joints.{name}'] = value
    with pytest.raises(ValueError, match='joints'):
        World.restore(saved, 'native')


def test_what_is_driven_takes_along_what_hangs_by_it():
    """Move and turn an intruder: what is welded to it goes along, and a pendulum follows."""
    world = World(engine='native')
    driven = world.add_driven(single(Shape.BOX, np.full(3, 0.2)), pose([0.0, 0.0, 5.0]))
    fast = bar(world, [0.6, 0.0, 5.0], [0.4] * 3)
    swings = bar(world, [0.0, 0.0, 4.5], attitude=DOWN)
    world.join([JointKind.WELD, JointKind.BALL], [fast, swings], [driven, driven],
               np.array([pose([0.3, 0.0, 5.0]), pose([0.0, 0.0, 5.0])]))
    for k in range(1, 61):
        turn = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.02 * k))
        world.drive(driven, pose([0.0, 0.02 * k, 5.0], turn))
        world.step(1.0 / 60.0)
        assert gaps(world).max() < 2e-3
    away = rotation.relative(world.bodies.poses[driven], world.bodies.poses[fast])
    np.testing.assert_allclose(away, pose([0.6, 0.0, 0.0]), atol=2e-3)


def test_a_slack_rope_wakes_its_load_before_it_is_taut():
    """Let a block sleep under a driven body, and raise that beyond the length of the rope."""
    world = World(engine='native')
    block = bar(world, [0.0, 0.0, 0.1], [0.2] * 3)
    driven = world.add_driven(single(Shape.BOX, np.full(3, 0.2)), pose([0.0, 0.0, 1.0]))
    world.join(JointKind.ROPE, block, driven, pose([0.0, 0.0, 0.2]), JointOptions(high=1.0),
               pose([0.0, 0.0, 0.9]))
    run(world, 0.75, 1.0 / 60.0, lambda: 0)
    assert world.bodies.state[block] == BodyState.RESTING
    for k in range(1, 61):
        world.drive(driven, pose([0.0, 0.0, 1.0 + k / 60.0]))
        world.step(1.0 / 60.0)
    assert world.bodies.poses[block, 2] == pytest.approx(0.8, abs=1e-3)
    run(world, 0.75, 1.0 / 60.0, lambda: 0)
    assert world.bodies.state[block] == BodyState.RESTING  # what stands still leads nothing


def test_joined_bodies_sleep_and_wake_together():
    """Let two rods that hang still fall asleep; a push on the lower one wakes both."""
    world = World(engine='native')
    ids = np.array([bar(world, [0.0, 0.0, 5.0 - k], attitude=DOWN) for k in range(2)])
    joints = world.join(JointKind.BALL, ids, [0, ids[0]],
                        np.array([pose([0.0, 0.0, 5.5 - k]) for k in range(2)]))
    run(world, 1.0, 1.0 / 60.0, lambda: 0)
    assert (world.bodies.state[ids] == BodyState.RESTING).all()
    world.apply_impulse(ids[1], np.array([0.5, 0.0, 0.0]))
    assert (world.bodies.state[ids] == BodyState.AWAKE).all()
    run(world, 1.0, 1.0 / 60.0, lambda: 0)
    world.freeze(ids[:1])  # what stands still again is as firm as the world
    run(world, 1.0, 1.0 / 60.0, lambda: 0)
    assert gaps(world).max() < 1e-4
    world.thaw(ids)
    world.part(joints[:1])
    run(world, 0.5, 1.0 / 60.0, lambda: 0)
    assert world.bodies.poses[ids[0], 2] < 4.5


def test_what_hung_by_a_removed_body_falls():
    """Remove the upper one of two that sleep: the joint is gone, and the lower one falls."""
    world = World(engine='native')
    ids = np.array([bar(world, [0.0, 0.0, 5.0 - k], attitude=DOWN) for k in range(2)])
    world.join(JointKind.BALL, ids, [0, ids[0]],
               np.array([pose([0.0, 0.0, 5.5 - k]) for k in range(2)]))
    run(world, 1.0, 1.0 / 60.0, lambda: 0)
    world.remove(ids[:1])
    assert not world.joints.kind.any()
    run(world, 0.5, 1.0 / 60.0, lambda: 0)
    assert world.bodies.poses[ids[1], 2] == pytest.approx(4.0 - 0.5 * G * 0.25, abs=0.05)


@pytest.mark.parametrize('collides', [True, False])
def test_joined_bodies_meet_where_that_is_wanted(collides):
    """Let two boxes that overlap push each other apart along a slider, or not."""
    world = World(engine='native', gravity=(0.0, 0.0, 0.0))
    ids = [bar(world, [0.15 * k, 0.0, 5.0], [0.2] * 3) for k in range(2)]
    world.join(JointKind.SLIDER, ids[0], ids[1], pose([0.0, 0.0, 5.0]),
               JointOptions(collides=collides))
    run(world, 1.0, 1.0 / 60.0, lambda: 0)
    apart = world.bodies.poses[ids[1], 0] - world.bodies.poses[ids[0], 0]
    assert apart == pytest.approx(0.2 if collides else 0.15, abs=2e-3)


def test_a_heavy_block_stands_on_what_hangs():
    """Lay 200 kg upon a board of 2 kg that is hinged at one end and hung at the other."""
    world = World(engine='native')
    board = bar(world, [0.0, 0.0, 3.0], [2.0, 0.4, 0.05], 2.0)
    block = bar(world, [0.0, 0.0, 3.225], [0.4] * 3, 200.0)
    world.join(JointKind.HINGE, board, 0, pose([-1.0, 0.0, 3.0], ALONG_Y))
    world.join(JointKind.ROPE, board, 0, pose([1.0, 0.0, 3.0]), JointOptions(high=1.0),
               pose([1.0, 0.0, 4.0]))
    run(world, 2.0, 1.0 / 60.0, lambda: 0)
    np.testing.assert_allclose(world.joints.force[:, 2], 0.5 * 202.0 * G, rtol=0.01)
    assert world.bodies.poses[block, 2] == pytest.approx(3.225, abs=5e-3)


@pytest.mark.parametrize('time_step', STEPS)
def test_a_blow_breaks_a_joint_and_keeps_what_it_could_not_carry(time_step):
    """Throw one of two blocks away: the joint takes its strength times a step at most."""
    world = World(engine='native', gravity=(0.0, 0.0, 0.0))
    ids = np.array([bar(world, [0.2 * k, 0.0, 5.0], [0.2] * 3, 2.0) for k in range(2)])
    world.join(JointKind.WELD, ids[0], ids[1], pose([0.1, 0.0, 5.0]), JointOptions(force=60.0))
    world.apply_impulse(ids[1], np.array([20.0, 0.0, 0.0]))
    world.step(time_step)
    assert world.joints.broken[0]
    # What is so fast is looked at 240 times per second.
    assert 2.0 * world.bodies.velocities[ids[0], 0] == pytest.approx(60.0 / 240.0, rel=1e-6)
    assert 2.0 * world.bodies.velocities[ids, 0].sum() == pytest.approx(20.0, rel=1e-12)


@pytest.mark.parametrize('time_step', STEPS)
@pytest.mark.parametrize('company', [False, True])
def test_a_slow_blow_is_judged_as_a_fast_one(time_step, company):
    """Push a heavy block at 0.25 m/s, in steps of any length, alone or with fast ones far away."""
    world = World(engine='native', gravity=(0.0, 0.0, 0.0))
    body = bar(world, [0.0, 0.0, 5.0], [0.2] * 3, 20.0)
    world.join(JointKind.WELD, body, 0, pose([0.0, 0.0, 5.0]), JointOptions(force=600.0))
    if company:
        bar(world, [100.0, 0.0, 5.0], velocity=np.array([0.0, 0.0, 100.0, 0.0, 0.0, 0.0]))
    world.apply_impulse(body, np.array([5.0, 0.0, 0.0]))
    world.step(time_step)
    assert world.joints.broken[0]
    assert 20.0 * world.bodies.velocities[body, 0] == pytest.approx(5.0 - 600.0 / 240.0, rel=1e-9)


@pytest.mark.parametrize('change, said', [
    ({'first': 77}, 'no body 77'), ({'second': -1}, 'no body -1'), ({'kind': 9}, 'no kind 9'),
    ({'first': 0}, 'cannot move against'), ({'options': JointOptions(low=1.0, high=0.0)}, 'low'),
    ({'options': JointOptions(stiffness=np.nan)}, 'stiffness'),
    ({'options': JointOptions(force=-1.0)}, 'force'),
    ({'options': JointOptions(drive=np.inf)}, 'drive')])
def test_joints_that_cannot_be_are_refused(change, said):
    """Say what is wrong, and change nothing."""
    world = World(engine='native')
    body = bar(world, [0.0, 0.0, 1.0])
    wanted = {'kind': JointKind.BALL, 'first': body, 'second': 0, 'frames': pose([0.0, 0.0, 1.0])}
    with pytest.raises(ValueError, match=said):
        world.join(**wanted | change)
    assert not len(world.joints.kind)


def test_bullet_says_which_engine_has_joints():
    """Name the engine that has them."""
    pytest.importorskip('pybullet')
    world = World(engine='bullet')
    with pytest.raises(SceneError, match='native'):
        world.join(JointKind.BALL, bar(world, [0.0, 0.0, 1.0]), 0, pose([0.0, 0.0, 1.0]))
