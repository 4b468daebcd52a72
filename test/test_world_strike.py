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

"""Striking: projectiles, contact impulses, driven bodies."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.world import (
    BodyState,
    installed_engines,
    rigid_sum,
    velocity_between,
    World,
)
from procphys_ros.physics.world.pieces import single

engines = pytest.mark.parametrize('engine', installed_engines())


def wall(world, rows=14, columns=10):
    """Add a standing half-brick wall in the plane y = 0."""
    poses = [at(0.225 * (i - columns / 2) + 0.1125 * (row % 2), 0, 0.0325 + 0.075 * row)
             for row in range(rows) for i in range(columns)]
    return world.add_bricks(np.array(poses), np.tile(BRICK, (len(poses), 1)),
                            np.full(len(poses), BRICK_MASS))


@pytest.mark.parametrize('speed', [20.0, 250.0])
@engines
def test_small_fast_projectile_does_not_tunnel(speed, engine):
    """Shoot 0.2 kg at a standing wall from many distances: it never comes out behind."""
    with World(engine=engine) as world:
        ids = wall(world)
        before = world.poses(ids).copy()
        balls = np.array([
            world.add_projectile(Shape.CAPSULE, np.full(3, 0.06), 0.2,
                                 at(0.16 * (i - 5), -2.0 - 0.13 * i, 0.6),
                                 [0, speed, 0, 0, 0, 0], restitution=0.0) for i in range(11)])
        for _ in range(40):
            world.step(DT)
            assert world.poses(balls)[:, 1].max() < 0.0
        np.testing.assert_array_equal(world.poses(ids), before)


@engines
def test_contact_impulse_is_the_change_of_momentum(engine):
    """Throw 50 kg at a wall that stands: the impulses add up to m Δv within 1 %."""
    with World(gravity=(0, 0, 0), engine=engine) as world:
        wall(world)
        ball = world.add_projectile(Shape.CAPSULE, np.full(3, 0.3), 50.0, at(0.03, -0.5, 0.5),
                                    [1.0, 8.0, 0.5, 0, 0, 0], restitution=0.0)
        given = np.zeros(3)
        for _ in range(30):
            world.step(DT)
            others, _, impulse = world.contacts().on(ball)
            given += impulse.sum(axis=0)
            assert (world.bodies.state[others] == BodyState.FIXED).all()
        change = 50.0 * (world.velocities([ball])[0, :3] - [1.0, 8.0, 0.5])
        assert change[1] < -390.0
        np.testing.assert_allclose(given, change, atol=0.01 * np.linalg.norm(change))


@engines
def test_collision_of_loose_bodies_keeps_momentum(engine):
    """Let two tumbling boxes collide in empty space."""
    with World(gravity=(0, 0, 0), engine=engine) as world:
        ids = np.array([
            world.add_projectile(Shape.BOX, [0.5, 0.4, 0.3], 30.0, at(0, 0, 5),
                                 [3, 0, 0, 0, 1, 2], restitution=0.2),
            world.add_projectile(Shape.BOX, [0.3, 0.3, 0.6], 12.0, at(1.2, 0.1, 5.1),
                                 [-2, 0.1, 0, 1, 0, 0], restitution=0.2)])
        mass = world.bodies.mass[ids]
        before = mass @ world.velocities(ids)[:, :3]
        touched = 0
        for _ in range(60):
            world.step(DT)
            touched += len(world.contacts())
        assert touched > 0
        np.testing.assert_allclose(mass @ world.velocities(ids)[:, :3], before, atol=1e-9)


@pytest.mark.parametrize('speed', [2.0, 40.0])
@engines
def test_the_ground_gives_what_a_fall_loses(speed, engine):
    """Book every push of the ground on a compound that falls: m Δv within 1 %."""
    size = np.array([[2.0, 2.0, 0.2], [0.2, 0.2, 0.5]])
    mass = np.array([1600.0, 40.0])
    total = rigid_sum(mass, box_inertia(mass, size), np.array([at(0, 0, 2), at(0, 0, 2.35)]))
    with World(engine=engine) as world:
        slab = world.add_fragment(np.full(2, Shape.BOX), size, total.local_poses, total.mass,
                                  total.inertia, total.pose, [0, 0, -speed, 0, 0, 0])
        given, worst, before = 0.0, 0.0, -speed
        for _ in range(40):
            world.step(DT)
            push = world.contacts().on(slab)[2][:, 2].sum()
            after = world.velocities([slab])[0, 2]
            worst = max(worst, abs(1640.0 * (after - before + G * DT) - push))
            given, before = given + push, after
        assert given > 1640.0 * speed
        assert worst < 0.01 * 1640.0 * speed


@engines
def test_driven_body_keeps_its_course_and_feels_what_it_pushes(engine):
    """Push a crate on ice with 2 m/s²: the course is exact, the force is mass times that."""
    with World(friction=0.0, engine=engine) as world:
        crate = world.add_projectile(Shape.BOX, [0.5, 0.5, 0.5], 20.0, at(0.36, 0, 0.2505),
                                     np.zeros(6), friction=0.0, restitution=0.0)
        pusher = world.add_driven(single(Shape.BOX, [0.2, 0.4, 0.2]), at(0, 0, 0.25), friction=0.0)
        forces = []
        for step in range(120):
            world.drive(pusher, at(((step + 1) * DT) ** 2, 0, 0.25))
            world.step(DT)
            forces.append(world.wrench(pusher)[0])
        np.testing.assert_allclose(world.poses([pusher])[0, :3], [4.0, 0, 0.25], atol=1e-12)
        assert world.poses([crate])[0, 0] == pytest.approx(4.0 + 0.35, abs=0.03)
        assert np.mean(forces[20:]) == pytest.approx(-20.0 * 2.0, rel=0.02)


@engines
def test_contacts_act_where_they_were_found(engine):
    """Graze a crate on ice with a smooth ball: the force goes through the ball's centre."""
    with World(gravity=(0, 0, 0), engine=engine) as world:
        ball = world.add_driven(single(Shape.CAPSULE, np.full(3, 0.4)), at(0, 0, 1), friction=0.0)
        world.add_body(Shape.BOX, [1.0, 4.0, 1.0], 50.0, at(0.75, 0.6, 1), friction=0.0)
        felt = []
        for i in range(1, 20):
            world.drive(ball, at(0.02 * i, 0.06 * i, 1))
            world.step(DT)
            felt.append(world.wrench(ball))
        force, moment = np.abs(np.array(felt)[:, 0]), np.array(felt)[:, 3:]
        assert force.max() > 100.0
        assert np.abs(moment).max() < 0.01 * 0.2 * force.max()


@engines
def test_driven_body_turns_exactly_and_wakes_what_rests(engine):
    """Sweep a bar round: it hits a resting brick, which flies, and ends where it was sent."""
    with World(engine=engine) as world:
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0.8, 0.4, 0.0335))
        for _ in range(90):
            world.step(DT)
        assert world.bodies.state[brick] == BodyState.RESTING
        bar = world.add_driven(single(Shape.BOX, [2.0, 0.1, 0.1]), at(0, 0, 0.07))
        for step in range(60):
            world.drive(bar, at(0, 0, 0.07, rotation.from_yaw(2.0 * DT * (step + 1))))
            world.step(DT)
        np.testing.assert_allclose(world.poses([bar])[0], at(0, 0, 0.07, rotation.from_yaw(2.0)),
                                   atol=1e-12)
        assert np.hypot(*(world.poses([brick])[0, :2] - [0.8, 0.4])) > 0.3


def test_velocity_between_poses_leads_from_one_to_the_other():
    """Turn by less and by more than half a turn: the shorter way is taken."""
    axis = np.array([0.6, 0.0, 0.8])
    for angle in (0.3, -2.0):
        end = at(1, 2, 3, rotation.from_axis_angle(axis, np.array(angle)))
        np.testing.assert_allclose(velocity_between(at(1, 0, 3), end, 0.5),
                                   [0, 4, 0, *(2.0 * angle * axis)], atol=1e-12)
