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

"""What lies on the ground lies on it, not in it."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G, rest
from lowest_points import lowest
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.world import installed_engines, rigid_sum, World
from procphys_ros.physics.world.merging import LEVEL

engines = pytest.mark.parametrize('engine', installed_engines())

LEVELLED = 0.12  # [m] within which ends of courses are made one: half a brick and a joint


def toothed_wall(courses):
    """Lay courses in running bond whose ends stick out by half a brick in turn, (P, 7)."""
    column, row = np.meshgrid(np.arange(4), np.arange(courses))
    poses = np.tile(at(0, 0, 0), (column.size, 1))
    poses[:, 0] = 0.225 * (column + 0.5 * (row % 2)).ravel()
    poses[:, 2] = 0.075 * row.ravel()
    return poses


def lowest_corner(frame, local):
    """Compute the height of the lowest corner of the bricks of a body."""
    axes = rotation.to_matrix(frame[3:])
    down = np.abs(axes[2] @ rotation.to_matrix(local[:, 3:]))
    return (frame[2] + local[:, :3] @ axes[2] - 0.5 * down @ BRICK).min()


@pytest.mark.parametrize(('engine', 'courses', 'tolerance', 'tilt'), [
    *(('native', courses, LEVELLED, tilt) for courses, tilt in (
        (2, 0.4), (2, -0.5 * np.pi), (6, 0.0), (6, 1.2), (6, -0.5 * np.pi), (20, 0.5 * np.pi),
        (20, 2.0))),
    *((engine, 6, LEVEL, tilt) for engine in installed_engines() for tilt in (0.4, 0.5 * np.pi))])
def test_the_ground_meets_every_brick_of_a_toothed_piece(tilt, engine, courses, tolerance):
    """
    Drop a broken wall on its toothed edge: no corner sinks in, and none is thrown up.

    Where its outline is levelled, corners that stand out of that meet the ground as points,
    but not in Bullet.
    """
    poses = toothed_wall(courses)
    sizes, mass = np.tile(BRICK, (len(poses), 1)), np.full(len(poses), BRICK_MASS)
    whole = rigid_sum(mass, box_inertia(mass, sizes), poses)
    turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array([tilt]))[0]
    start = at(0, 0, 3.0, rotation.multiply(turn, whole.pose[3:]))
    with World(engine=engine) as world:
        body = world.add_fragment(np.full(len(poses), int(Shape.BOX)), sizes, whole.local_poses,
                                  whole.mass, whole.inertia, start, tolerance=tolerance)
        assert (len(world.pieces(body).ground_points) > 0) == (tolerance == LEVELLED)
        least = whole.mass * G * start[2]
        for _ in range(round(60.0 / DT)):  # it rocks on its thickness: 1 % of energy per blow
            world.step(DT)
            frame, speed = world.poses([body])[0], world.velocities([body])[0]
            spin = rotation.rotate(rotation.conjugate(frame[3:]), speed[3:])
            energy = (whole.mass * (G * frame[2] + 0.5 * speed[:3] @ speed[:3])
                      + 0.5 * spin @ (whole.inertia * spin))
            assert energy < least + whole.mass * G * 0.02
            least = min(least, energy)
            assert lowest_corner(frame, whole.local_poses) > -0.05
            if not len(world.awake):
                break
        assert not len(world.awake)
        assert lowest_corner(world.poses([body])[0], whole.local_poses) > -0.01


def test_corners_slide_on_ice():
    """Let a toothed piece stand on its teeth and slide without friction: it keeps its speed."""
    poses = toothed_wall(4)
    sizes, mass = np.tile(BRICK, (len(poses), 1)), np.full(len(poses), BRICK_MASS)
    whole = rigid_sum(mass, box_inertia(mass, sizes), poses)
    turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array([0.5 * np.pi]))[0]
    attitude = rotation.multiply(turn, whole.pose[3:])
    height = -lowest_corner(np.array([0, 0, 0, *attitude]), whole.local_poses) + 0.05
    with World(friction=0.0, engine='native') as world:
        body = world.add_fragment(np.full(len(poses), int(Shape.BOX)), sizes, whole.local_poses,
                                  whole.mass, whole.inertia, at(0, 0, height, attitude),
                                  np.array([0, 1.0, 0, 0, 0, 0]), friction=0.0,
                                  tolerance=LEVELLED)
        touched = 0
        for _ in range(40):
            world.step(DT)
            touched += len(world.contacts())
            np.testing.assert_allclose(world.velocities([body])[0, :2], [0.0, 1.0], atol=1e-6)
        assert touched


@engines
def test_overlapping_bodies_part_without_being_thrown(engine):
    """Put a brick 3 cm into a slab at rest: it is moved out, and gains no speed by it."""
    with World(engine=engine) as world:
        world.add_body(Shape.BOX, [2.0, 2.0, 0.2], 2000.0, at(0, 0, 0.1005))
        rest(world, limit=20.0)
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 0.2025))
        fastest = 0.0
        for _ in range(60):
            world.step(DT)
            fastest = max(fastest, float(world.velocities([brick])[0, 2]))
        assert fastest < 0.1
        assert world.poses([brick])[0, 2] == pytest.approx(0.2325, abs=5e-3)


@engines
def test_what_a_slab_falls_on_is_not_pressed_into_the_ground(engine):
    """Drop a slab of 1.3 t on 40 bricks: all come to rest, and none of them in the ground."""
    rng = np.random.default_rng(11)
    with World(engine=engine) as world:
        ids = [world.add_body(Shape.BOX, BRICK, BRICK_MASS,
                              at(*rng.uniform(-0.9, 0.9, 2), 0.05 + 0.02 * i,
                                 rotation.from_yaw(rng.uniform(0.0, 3.0)))) for i in range(40)]
        rest(world, limit=20.0)
        world.add_body(Shape.BOX, [2.0, 2.0, 0.15], 1300.0, at(0, 0, 2.0))
        rest(world, limit=20.0)
        down = np.abs(rotation.to_matrix(world.poses(ids)[:, 3:])[:, 2] @ np.diag(BRICK))
        assert (world.poses(ids)[:, 2] - 0.5 * down.sum(axis=1)).min() > -0.0101


@engines
def test_the_end_of_a_turning_rod_does_not_dig_into_the_ground(engine):
    """Let rods turn while they slide or fall: no end digs in, none gains energy."""
    size, mass, rng = np.array([0.1, 0.1, 4.0]), 20.0, np.random.default_rng(2)
    inertia = np.array([mass * 16.0 / 12.0, mass * 16.0 / 12.0, mass * 0.1 ** 2 / 8.0])
    for _ in range(3):
        turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array(rng.uniform(0.8, 1.5)))
        with World(engine=engine) as world:
            rod = world.add_body(Shape.CAPSULE, size, mass, at(0, 0, 1.6, turn),
                                 [20.0, 0, -1.0, 0, rng.uniform(2.0, 8.0), 0], inertia)
            most = np.inf
            for _ in range(120):
                world.step(DT)
                pose, speed = world.poses([rod])[0], world.velocities([rod])[0]
                assert lowest(world.pieces(rod), pose) > -0.045
                spin = rotation.rotate(rotation.conjugate(pose[3:]), speed[3:])
                energy = (mass * (G * pose[2] + 0.5 * speed[:3] @ speed[:3])
                          + 0.5 * spin @ (inertia * spin))
                assert energy < most + mass * G * 0.02
                most = min(most, energy)
