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

"""Loose bricks with every engine: stacks, the ground under them, blows, and sleep."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G, heap, rest
from lowest_points import lowest
from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Hexahedra, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.air import AIR_DENSITY, CUBE_DRAG
from procphys_ros.physics.world import (
    BodyState,
    FRICTION,
    installed_engines,
    rigid_sum,
    velocity_between,
    World,
)
from procphys_ros.physics.world.merging import LEVEL
from procphys_ros.physics.world.pieces import single
from procphys_ros.physics.world.rolling import ROLLING
from procphys_ros.physics.world.sleeping import SLEEP_TIME
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.fragments import holding_wind

engines = pytest.mark.parametrize('engine', installed_engines())
exact = pytest.mark.parametrize('engine', [name for name in installed_engines()
                                           if name != 'bullet'])  # see docs/limits.md


def run(world, seconds):
    """Step until the time is over."""
    for _ in range(round(seconds / DT)):
        world.step(DT)


def moved(world, ids, seconds):
    """Run a world and compute the largest displacement of the centre of any body [m]."""
    start = world.poses(ids)[:, :3].copy()
    run(world, seconds)
    return np.linalg.norm(world.poses(ids)[:, :3] - start, axis=1).max()


def voussoir(low, high, inner, outer, width):
    """Compute corners in its own frame (24,), size, centre (2,), area and lean of a voussoir."""
    points = np.array([[radius * np.cos(angle), radius * np.sin(angle)]
                       for angle, radius in ((high, inner), (low, inner), (high, outer),
                                             (low, outer))])
    x, y = points[[1, 3, 2, 0]].T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * cross.sum()
    centre = np.array([((x + np.roll(x, -1)) * cross).sum(),
                       ((y + np.roll(y, -1)) * cross).sum()]) / (6.0 * area)
    middle = 0.5 * (low + high)
    across = np.array([np.sin(middle), -np.cos(middle)])
    up = np.array([np.cos(middle), np.sin(middle)])
    flat = (points - centre) @ np.column_stack([across, up])
    corners = np.array([[flat[(i & 1) + (i >> 2) * 2, 0], width * ((i >> 1 & 1) - 0.5),
                         flat[(i & 1) + (i >> 2) * 2, 1]] for i in range(8)])
    return corners, 2.0 * np.abs(corners).max(axis=0), centre, area, 0.5 * np.pi - middle


def arch(engine, ratio, count=24, width=0.3, foot=0.5):
    """Set up a loose semicircle of mean radius 1 m on fixed blocks; see how it goes [m]."""
    with World(engine=engine) as world:
        world.add_bricks(np.array([at(-1, 0, 0.5 * foot), at(1, 0, 0.5 * foot)]),
                         np.tile([0.6, 0.6, foot], (2, 1)), np.full(2, 400.0))
        ids = []
        for low in np.pi * np.arange(count) / count:
            corners, size, centre, area, lean = voussoir(
                low, low + np.pi / count, 1.0 - 0.5 * ratio, 1.0 + 0.5 * ratio, width)
            turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array(lean))
            ids.append(world.add_body(
                Shape.BOX, size, 2000.0 * area * width, at(centre[0], 0, foot + centre[1], turn),
                hexahedra=Hexahedra(np.zeros(1, np.int32), corners.reshape(1, 24))))
        return moved(world, ids, 2.0)


@exact
def test_a_loose_arch_stands_down_to_its_least_thickness(engine):
    """Set up 24 voussoirs of t/R 0.13 and 0.10; limit analysis has 0.1075 (Milankovitch)."""
    assert arch(engine, 0.13) < 0.02
    assert arch(engine, 0.10) > 0.2


@engines
def test_a_ball_rolls_to_a_stop(engine):
    """Roll a ball at 1 m/s: v² / 2a with a = 5/7 g · lever / r, and no boxes are held by it."""
    radius, speed = 0.1, 1.0
    with World(engine=engine) as world:
        ball = world.add_body(Shape.CAPSULE, np.full(3, 2.0 * radius), 5.0, at(0, 0, radius),
                              [speed, 0, 0, 0, speed / radius, 0])
        run(world, 4.0)
        want = 0.5 * speed ** 2 / (5.0 / 7.0 * G * ROLLING / radius)
        assert world.poses([ball])[0, 0] == pytest.approx(want, rel=0.03)
        assert not len(world.awake)


@engines
def test_settled_rubble_hardly_overlaps(engine):
    """Drop 150 bricks: still within seconds, as high with any engine, overlaps of 1 cm at most."""
    with World(engine=engine) as world:
        ids = heap(world, 1, 5, 150)
        rest(world, 10.0 if engine == 'bullet' else 6.0)
        height = world.poses(ids)[:, 2]
        assert height.mean() == pytest.approx(0.192, rel=0.03)  # with PyBullet 0.193 m
        assert height.max() == pytest.approx(0.354, rel=0.03)
        world.thaw(np.array(ids))
        world.step(1e-4)
        assert world.contacts().distance.min() > -0.01


def test_wind_that_holds_and_wind_that_does_not():
    """Compare the wind that slides a cube, and tips a slab, with the balance of forces."""
    bounds = np.array([[0, 0, 0, 0.2, 0.2, 0.2], [0, 0, 0, 2.0, 0.1, 1.0]])
    got = holding_wind(np.array([80.0, 4000.0]), np.full(2, FRICTION), bounds,
                       np.array([0.05, 2.4]))
    want = np.sqrt([80.0 * FRICTION / (0.5 * AIR_DENSITY * 0.05),
                    4000.0 * 0.1 / (0.5 * AIR_DENSITY * 2.4)])
    np.testing.assert_allclose(got, want)


def test_rubble_wakes_in_a_storm_but_not_in_a_breeze():
    """Let a light box come to rest: 5 m/s leave it where it is, 60 m/s carry it off."""
    simulation = Simulation(Scene(Settings()))
    box = simulation.launch(Projectile('box', 0.4, 2.0, (0.0, 0.0, 0.25), (0.0, 0.0, 0.0)))
    simulation.step(90)
    assert not len(simulation.state.world.awake)
    place = simulation.poses[box].copy()
    simulation.set_wind([5.0, 0.0, 0.0])
    simulation.step(30)
    np.testing.assert_array_equal(simulation.poses[box], place)
    simulation.set_wind([60.0, 0.0, 0.0])
    simulation.step(60)
    assert simulation.poses[box, 0] > place[0] + 0.5


def test_wind_blows_on_the_outside_of_a_piece_of_wall():
    """Let a cube of 125 bonded blocks fall in a storm: it is pushed like one block of its size."""
    edge = 0.2 * np.arange(5)
    built = bonded(np.stack(np.meshgrid(edge, edge, edge), -1).reshape(-1, 3), (0.2, 0.2, 0.2),
                   ground=False)
    scene = Scene.from_parameters({'scene': {'objects': []}, 'wind': {
        'velocity': [40.0, 0.0, 0.0], 'profile': 'uniform', 'turbulence_intensity': 0.0}})
    scene.add(built, (0.0, 0.0, 5.0), 0.3, 'cube')
    simulation = Simulation(scene)
    simulation.step()
    force = 0.5 * AIR_DENSITY * CUBE_DRAG * 1.5 * 40.0 ** 2
    assert simulation.velocities[0, 0] == pytest.approx(
        force / built.mass.sum() * simulation.time_step, rel=0.01)


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
        (2, 0.4), (6, 0.0), (6, -0.5 * np.pi), (20, 2.0))),
    *((engine, 6, LEVEL, 0.4) for engine in installed_engines())])
def test_the_ground_meets_every_brick_of_a_toothed_piece(tilt, engine, courses, tolerance):
    """Drop a broken wall on its toothed edge: no corner sinks in, and none is thrown up."""
    # Where its outline is levelled, corners that stand out of that meet the ground as points,
    # but not in Bullet.
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
    for _ in range(2):
        turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array(rng.uniform(0.8, 1.5)))
        with World(engine=engine) as world:
            rod = world.add_body(Shape.CAPSULE, size, mass, at(0, 0, 1.6, turn),
                                 [20.0, 0, -1.0, 0, rng.uniform(2.0, 8.0), 0], inertia)
            most = np.inf
            for _ in range(90):
                world.step(DT)
                pose, speed = world.poses([rod])[0], world.velocities([rod])[0]
                assert lowest(world.pieces(rod), pose) > -0.045
                spin = rotation.rotate(rotation.conjugate(pose[3:]), speed[3:])
                energy = (mass * (G * pose[2] + 0.5 * speed[:3] @ speed[:3])
                          + 0.5 * spin @ (inertia * spin))
                assert energy < most + mass * G * 0.02
                most = min(most, energy)


def wall(world, rows=14, columns=10):
    """Add a standing half-brick wall in the plane y = 0."""
    poses = [at(0.225 * (i - columns / 2) + 0.1125 * (row % 2), 0, 0.0325 + 0.075 * row)
             for row in range(rows) for i in range(columns)]
    return world.add_bricks(np.array(poses), np.tile(BRICK, (len(poses), 1)),
                            np.full(len(poses), BRICK_MASS))


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


def asleep(world, ids):
    """Return whether all of these bodies sleep."""
    return (world.bodies.state[ids] == BodyState.RESTING).all()


def column(world, x, count):
    """Stack bricks on the ground, the lowest first."""
    return [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(x, 0, BRICK[2] * (n + 0.5)))
            for n in range(count)]


def test_dominoes_that_sleep_all_fall():
    """Push the first of twelve that have come to rest, in rows that run along and askew."""
    count, height, pitch = 12, 0.24, 0.13
    for heading in (0.0, 0.6):
        way = np.array([np.cos(heading), np.sin(heading), 0.0])
        turn = (0.0, 0.0, np.sin(0.5 * heading), np.cos(0.5 * heading))
        with World(engine='native') as world:
            ids = [world.add_body(Shape.BOX, np.array([0.05, 0.12, height]), 2.6,
                                  at(*(pitch * n * way)[:2], 0.5 * height, turn))
                   for n in range(count)]
            rest(world)
            world.apply_impulse(ids[0], 2.6 * 0.5 * way,
                                world.poses(ids[:1])[0, :3] + [0.0, 0.0, 0.4 * height])
            for _ in range(30):
                run(world, 0.2)
                upright = 1.0 - 2.0 * np.square(world.poses(ids)[:, 3:5]).sum(axis=1)
                if (upright < 0.95).all():
                    break
            assert (upright < 0.95).all()


@engines
def test_a_blow_goes_through_a_row_that_sleeps(engine):
    """Push a brick at 2 m/s into five on ice, 1 mm apart: none of them is a wall for a step."""
    with World(friction=0.0, engine=engine) as world:
        ids = [world.add_body(Shape.BOX, BRICK, BRICK_MASS,
                              at((BRICK[0] + 0.001) * n, 0, 0.5 * BRICK[2]), friction=0.0)
               for n in range(5)]
        rest(world)
        ids.append(world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(-0.5, 0, 0.5 * BRICK[2]),
                                  [2.0, 0, 0, 0, 0, 0], friction=0.0))
        run(world, 0.5)
        assert world.velocities(ids)[:, 0].sum() == pytest.approx(2.0, rel=0.05)


@engines
def test_a_weight_tips_a_plank_that_sleeps(engine):
    """Set eleven times what tips it down on the end of a plank: not a wall, but a see-saw."""
    with World(engine=engine) as world:
        world.add_bricks(at(0, 0, 0.1)[None], np.array([[0.4, 0.4, 0.2]]), np.array([60.0]))
        plank = world.add_body(Shape.BOX, [2.0, 0.2, 0.05], 10.0, at(0, 0, 0.225))
        rest(world)
        tips = 10.0 * 0.2 / 0.7  # on an arm of 0.7 m about the edge of the block
        weight = world.add_body(Shape.BOX, np.full(3, 0.15), 11.0 * tips, at(0.9, 0, 0.3251))
        run(world, 1.0)
        assert world.poses([weight])[0, 2] < 0.2
        assert np.abs(2.0 * np.arctan2(world.poses([plank])[0, 4],
                                       world.poses([plank])[0, 6])) > 0.1


def test_an_island_sleeps_and_wakes_as_a_whole():
    """Set one of eight stacked bricks free: all of its stack wakes, and none of the other."""
    with World(engine='native') as world:
        one, other = column(world, 0.0, 8), column(world, 1.0, 8)
        moves = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(1.0, 0, 8.5 * BRICK[2]),
                               [0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
        run(world, SLEEP_TIME + 2 * DT)
        states = world.bodies.state
        assert asleep(world, one)
        assert len(set(states[other + [moves]].tolist())) == 1
        rest(world)
        world.thaw([one[5]])
        assert (world.bodies.state[one] == BodyState.AWAKE).all() and asleep(world, other)


@engines
def test_what_sleeps_keeps_its_pose_to_the_bit(engine):
    """Let bricks fall beside a stack that sleeps: not a bit of it changes."""
    with World(engine=engine) as world:
        ids = column(world, 0.0, 3)
        rest(world)
        before = world.poses(ids).copy()
        heap(world, 0, 2, 12)
        world.set_poses(world.awake, world.poses(world.awake) + [2, 0, 0, 0, 0, 0, 0])
        run(world, 2.0)
        np.testing.assert_array_equal(world.poses(ids), before)
        assert asleep(world, ids)


@pytest.mark.parametrize(('share', 'wakes'), [(0.05, False), (0.3, True)])
def test_a_change_of_load_wakes_when_it_is_a_tenth(share, wakes):
    """Lay a pebble, and a heavier one, on a brick that sleeps: the first one wakes nothing."""
    with World(engine='native') as world:
        brick = column(world, 0.0, 1)
        rest(world)
        world.add_body(Shape.BOX, np.full(3, 0.04), share * BRICK_MASS,
                       at(0.0, 0.0, BRICK[2] + 0.02))
        woken = False
        for _ in range(30):
            world.step(DT)
            woken |= not asleep(world, brick)
        assert woken == wakes


@engines
@pytest.mark.parametrize('how', ['removed', 'moved'])
def test_taking_away_one_of_the_supports_wakes(engine, how):
    """Let a slab lie on four bricks, then take one away, or push it out: the slab tips over."""
    with World(engine=engine) as world:
        low = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(x, y, 0.5 * BRICK[2]))
               for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
        slab = world.add_body(Shape.BOX, [1.1, 1.1, 0.1], 50.0, at(0.1, 0.1, BRICK[2] + 0.05))
        rest(world)
        if how == 'removed':
            world.remove(low[-1:])
        else:
            world.thaw(low[-1:])
            world.set_poses(low[-1:], world.poses(low[-1:]) + [1.0, 1.0, 0, 0, 0, 0, 0])
        run(world, 2.0)
        assert np.linalg.norm(world.poses([slab])[0, 3:5]) > 0.02


@engines
def test_a_heap_that_sleeps_is_restored_asleep(engine):
    """Save a heap at rest and restore it: it stays to the bit, and wakes on the same blow."""
    with World(engine=engine) as world:
        ids = heap(world, 3, 2, 12)
        rest(world)
        world.rebuild()
        with World.restore(world.save_state(), engine) as copy:
            before = world.poses(ids).copy()
            run(copy, 1.0)
            np.testing.assert_array_equal(copy.poses(ids), before)
            np.testing.assert_array_equal(copy.asleep.body_a, world.asleep.body_a)
            for each in (world, copy):
                each.apply_impulse(ids[0], [5.0, 1.0, 0.0])
                run(each, 0.5)
            np.testing.assert_array_equal(copy.poses(ids), world.poses(ids))
            assert np.abs(copy.poses(ids) - before).max() > 0.03
