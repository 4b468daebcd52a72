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

"""The world of loose bodies against closed forms and numpy."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G
from lowest_points import lowest
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.world import (
    BodyState,
    expand,
    installed_engines,
    Pieces,
    rigid_sum,
    solid_inertia,
    World,
)

engines = pytest.mark.parametrize('engine', installed_engines())


def random_parts(rng, count):
    """Draw masses, inertias, poses and sizes of scattered boxes."""
    sizes = rng.uniform(0.05, 0.3, (count, 3))
    mass = rng.uniform(0.5, 4.0, count)
    quaternions = rng.normal(size=(count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    poses = np.column_stack([rng.uniform(-1, 1, (count, 3)) + [0, 0, 20.0], quaternions])
    return mass, box_inertia(mass, sizes), poses, sizes


def momentum(mass, inertia, poses, velocities):
    """Compute linear and angular momentum about the origin, summed over parts."""
    axes = rotation.to_matrix(poses[:, 3:])
    spin = np.einsum('pij,pj,pkj,pk->pi', axes, inertia, axes, velocities[:, 3:])
    linear = mass[:, None] * velocities[:, :3]
    return linear.sum(axis=0), (np.cross(poses[:, :3], linear) + spin).sum(axis=0)


def add_sum(world, total, shapes, sizes, **more):
    """Add a rigid sum as a fragment."""
    return world.add_fragment(shapes, sizes, total.local_poses, total.mass, total.inertia,
                              total.pose, total.velocity, **more)


def run(world, seconds):
    """Step until the time is over."""
    for _ in range(round(seconds / DT)):
        world.step(DT)


@pytest.mark.report('laws')
@engines
def test_free_fall_follows_the_closed_form(measured, engine):
    """Compare a second of fall with ½ g t²: nothing damps it."""
    with World(engine=engine) as world:
        body = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 30), [2, 0, 0, 0, 0, 1])
        run(world, 1.0)
        measured('height of a rigid body after a second of fall from 30 m',
                 world.poses([body])[0, 2], 30.0 - 0.5 * G, 'm', atol=1e-9)
        assert world.velocities([body])[0, 2] == pytest.approx(-G, abs=1e-9)
        assert world.velocities([body])[0, 0] == pytest.approx(2.0, abs=1e-9)


@engines
def test_projectile_flies_the_parabola(engine):
    """Compare a projectile with the parabola."""
    with World(engine=engine) as world:
        ball = world.add_projectile(Shape.CAPSULE, [0.2, 0.2, 0.2], 5.0, at(0, 0, 50),
                                    [10, 0, 3, 0, 0, 0])
        run(world, 2.0)
        height = 50 + 3 * 2.0 - 0.5 * G * 2.0 ** 2
        np.testing.assert_allclose(world.poses([ball])[0, :3], [20, 0, height], atol=1e-9)


def test_rigid_sum_keeps_mass_and_both_momenta():
    """Split a random swarm's momentum into a rigid motion and back."""
    rng = np.random.default_rng(1)
    mass, inertia, poses, _ = random_parts(rng, 30)
    velocities = rng.normal(size=(30, 6))
    total = rigid_sum(mass, inertia, poses, velocities)
    got = momentum(np.array([total.mass]), total.inertia[None], total.pose[None],
                   total.velocity[None])
    want = momentum(mass, inertia, poses, velocities)
    np.testing.assert_allclose(got[0], want[0], rtol=1e-12)
    np.testing.assert_allclose(got[1], want[1], rtol=1e-10)
    np.testing.assert_allclose(rotation.compose(total.pose, total.local_poses)[:, :3],
                               poses[:, :3], atol=1e-12)


def test_rigid_sum_of_a_cut_box_is_the_box():
    """Cut a box into 24 and add it up again."""
    size = np.array([0.6, 0.4, 0.3])
    x, y, z = np.meshgrid(range(4), range(3), range(2), indexing='ij')
    cell = size / [4, 3, 2]
    centres = (np.column_stack([x.ravel(), y.ravel(), z.ravel()]) + 0.5) * cell - 0.5 * size
    turn = rotation.from_axis_angle(np.array([0.6, 0.0, 0.8]), np.array(0.7))
    poses = rotation.compose(at(1, 2, 3, turn),
                             np.column_stack([centres, np.tile([0, 0, 0, 1.0], (24, 1))]))
    mass = np.full(24, 0.5)
    total = rigid_sum(mass, box_inertia(mass, np.tile(cell, (24, 1))), poses)
    want = box_inertia(np.array([12.0]), size[None])[0]
    np.testing.assert_allclose(np.sort(total.inertia), np.sort(want), rtol=1e-12)
    np.testing.assert_allclose(total.pose[:3], [1, 2, 3], atol=1e-12)


def test_split_keeps_momentum_and_energy():
    """Expect for each half of a spinning fragment its velocity as a part of the whole."""
    rng = np.random.default_rng(2)
    mass, inertia, poses, _ = random_parts(rng, 40)
    whole = rigid_sum(mass, inertia, poses)
    motion = rng.normal(size=(1, 6))
    out_poses, out_velocities = np.zeros((40, 7)), np.zeros((40, 6))
    expand(whole.pose[None], motion, np.zeros(40, np.intp), whole.local_poses,
           np.arange(40), out_poses, out_velocities)
    np.testing.assert_allclose(out_poses[:, :3], poses[:, :3], atol=1e-12)
    halves = [rigid_sum(mass[rows], inertia[rows], out_poses[rows], out_velocities[rows])
              for rows in (slice(0, 15), slice(15, 40))]
    got = momentum(np.array([h.mass for h in halves]), np.stack([h.inertia for h in halves]),
                   np.stack([h.pose for h in halves]), np.stack([h.velocity for h in halves]))
    want = momentum(np.array([whole.mass]), whole.inertia[None], whole.pose[None], motion)
    np.testing.assert_allclose(got[0], want[0], rtol=1e-12)
    np.testing.assert_allclose(got[1], want[1], rtol=1e-10)
    for half in halves:
        np.testing.assert_allclose(half.velocity[3:], motion[0, 3:], rtol=1e-10)


@engines
def test_fragment_answers_an_off_centre_impulse_like_a_rigid_body(engine):
    """Push 40 scattered boxes (Bullet's own compounds stop at 16) and compare with numpy."""
    rng = np.random.default_rng(3)
    mass, inertia, poses, sizes = random_parts(rng, 40)
    total = rigid_sum(mass, inertia, poses)
    push, point = np.array([30.0, -12.0, 7.0]), np.array([0.4, 0.9, 20.5])
    with World(gravity=(0, 0, 0), engine=engine) as world:
        body = add_sum(world, total, np.full(40, Shape.BOX), sizes)
        np.testing.assert_allclose(world.poses([body])[0], total.pose, atol=1e-12)
        world.apply_impulse(body, push, point)
        axes = rotation.to_matrix(total.pose[3:])
        spin = axes @ (axes.T @ np.cross(point - total.pose[:3], push) / total.inertia)
        want = np.concatenate([push / total.mass, spin])
        np.testing.assert_allclose(world.velocities([body])[0], want, rtol=1e-12)
        world.step(DT)
        kept = world.velocities([body])[0]
        np.testing.assert_allclose(kept[:3], want[:3], rtol=1e-9)


@pytest.mark.parametrize('held_before', [False, True])
@engines
def test_contact_uses_the_exact_inertia_of_a_fragment(held_before, engine):
    """Let a dumbbell land on one end: the bounce-free spin follows from its inertia alone."""
    mass = np.array([2.0, 2.0])
    sizes = np.tile([0.2, 0.2, 0.2], (2, 1))
    poses = np.array([at(-1, 0, 0.1001), at(1, 0, 0.1001)])
    total = rigid_sum(mass, box_inertia(mass, sizes), poses)
    with World(gravity=(0, 0, 0), friction=0.0, engine=engine) as world:
        pad = world.add_bricks(np.array([at(1, 0, -0.05)]), np.array([[0.2, 0.2, 0.1]]),
                               np.array([5.0]), friction=0.0)
        world.remove(np.array([world.ground]))
        body = add_sum(world, total, np.full(2, Shape.BOX), sizes, friction=0.0)
        if held_before:
            world.freeze([body])
            world.step(DT)
            world.thaw([body])
        world.set_velocities([body], np.array([[0, 0, -1.0, 0, 0, 0]]))
        for _ in range(3):
            world.step(DT)
        speed, spin = world.velocities([body])[0, 2], world.velocities([body])[0, 4]
        lever = (speed + 1.0) * total.mass  # impulse through the pad
        inertia = np.sort(total.inertia)[-1]
        arm = -spin * inertia / lever
        assert lever > 1.0
        assert 0.89 < arm < 1.11  # the pad's width, and a margin
        assert world.bodies.state[pad[0]] == BodyState.FIXED


def test_solid_inertia_of_sphere_and_rod():
    """Compare with 2/5 m r² and m l²/12 + m r²/4."""
    np.testing.assert_allclose(solid_inertia(Shape.CAPSULE, [0.4, 0.4, 0.4], 5.0),
                               np.full(3, 0.4 * 5 * 0.04))
    rod = solid_inertia(Shape.CAPSULE, [0.1, 0.1, 2.0], 3.0)
    assert rod[0] == pytest.approx(3 * 4 / 12 + 3 * 0.0025 / 4)


@pytest.mark.report('laws')
@pytest.mark.parametrize('angle', [28.0, 36.0])
@engines
def test_friction_holds_or_slides_as_coulomb_says(angle, measured, engine):
    """Tilt gravity: below atan μ a brick stays, above it slides with g (sin - μ cos)."""
    friction, tilt = 0.6, np.radians(angle)
    gravity = (G * np.sin(tilt), 0.0, -G * np.cos(tilt))
    with World(gravity=gravity, friction=friction, engine=engine) as world:
        body = world.add_projectile(Shape.BOX, [0.4, 0.4, 0.1], 5.0, at(0, 0, 0.0501),
                                    np.zeros(6), friction=friction, restitution=0.0)
        run(world, 0.5)
        start = world.velocities([body])[0, 0]
        run(world, 0.5)
        gain = (world.velocities([body])[0, 0] - start) / 0.5
    if np.tan(tilt) < friction:
        measured('speed of a block on a slope below atan μ', world.velocities([body])[0, 0], 0.0,
                 'm/s', atol=0.01)
    else:
        felt = (np.sin(tilt) - gain / G) / np.cos(tilt)
        measured('friction of a block that slides at 36°', felt, friction, rtol=0.04)


def test_lowest_point_of_a_compound_is_that_of_its_corners():
    """Turn boxes and capsules at random: compare with all corners and round ends."""
    rng = np.random.default_rng(8)
    _, _, local, sizes = random_parts(rng, 12)
    sizes[6:, 1] = sizes[6:, 0]
    sizes[6:, 2] += sizes[6:, 0]
    shapes = np.array([Shape.BOX] * 6 + [Shape.CAPSULE] * 6)
    pieces = Pieces(shapes, sizes, local)
    pose = at(1, 2, 30, rotation.from_axis_angle(np.array([0.6, 0.8, 0]), np.array(1.1)))
    world = rotation.compose(pose, local)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    heights = [(world[i, :3] + rotation.rotate(world[i, 3:], 0.5 * corners * sizes[i]))[:, 2].min()
               for i in range(6)]
    for i in range(6, 12):
        half = 0.5 * (sizes[i, 2] - sizes[i, 0])
        ends = world[i, 2] + half * rotation.rotate(world[i, 3:], np.array([0, 0, 1.0]))[2] * \
            np.array([-1.0, 1.0])
        heights.append(ends.min() - 0.5 * sizes[i, 0])
    assert lowest(pieces, pose) == pytest.approx(min(heights), abs=1e-12)
    whole = [Pieces(shapes[i:i + 1], sizes[i:i + 1], local[i:i + 1]) for i in range(12)]
    np.testing.assert_allclose([lowest(one, pose) for one in whole], heights, atol=1e-12)


@engines
def test_two_worlds_do_not_disturb_each_other(engine):
    """Run the same fall alone and beside a busy second world."""
    with World(engine=engine) as alone:
        body = alone.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 1, (0.6, 0, 0, 0.8)))
        run(alone, 1.0)
        want = alone.poses([body]).copy()
    with World(engine=engine) as first, World(gravity=(0, 0, 5.0)) as second:
        one = first.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 1, (0.6, 0, 0, 0.8)))
        two = second.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 1))
        for _ in range(60):
            first.step(DT)
            second.step(0.5 * DT)
        np.testing.assert_array_equal(first.poses([one]), want)
        assert second.poses([two])[0, 2] > 1.5


@engines
def test_same_calls_give_identical_poses(engine):
    """Drop 20 bricks on each other twice."""
    def pile():
        rng = np.random.default_rng(5)
        with World(engine=engine) as world:
            ids = [world.add_body(Shape.BOX, BRICK, BRICK_MASS,
                                  at(*rng.uniform(-0.2, 0.2, 2), 0.2 + 0.1 * i))
                   for i in range(20)]
            run(world, 1.5)
            return world.poses(ids).copy()
    np.testing.assert_array_equal(pile(), pile())


@engines
def test_memory_does_not_grow_with_worlds(engine):
    """Make and close 60 worlds; the last 40 may not take more than a megabyte."""
    def resident():
        with open('/proc/self/statm', encoding='ascii') as file:
            return int(file.read().split()[1]) * 4096
    poses = np.array([at(i, 0, 1) for i in range(50)])
    for i in range(60):
        with World(engine=engine) as world:
            world.add_bricks(poses, np.tile(BRICK, (50, 1)), np.full(50, BRICK_MASS))
            world.step(DT)
        if i == 19:
            before = resident()
    assert resident() - before < 1_000_000
