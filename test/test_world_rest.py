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

"""Standing still, coming to rest, and moving again when there is reason to."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G, rest
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.world import (
    BodyState,
    FRICTION,
    installed_engines,
    JointKind,
    merge_boxes,
    rigid_sum,
    World,
)

engines = pytest.mark.parametrize('engine', installed_engines())


def bricks(world, *poses):
    """Add standing bricks."""
    return world.add_bricks(np.array(poses), np.tile(BRICK, (len(poses), 1)),
                            np.full(len(poses), BRICK_MASS))


@engines
def test_standing_bricks_do_not_move_at_all(engine):
    """Leave bricks in mid-air: held means held, to the last bit."""
    with World(engine=engine) as world:
        ids = bricks(world, at(0, 0, 5), at(0.225, 0, 5), at(0, 0, 0.0325))
        before, bounds = world.poses(ids).copy(), world.bounds(ids)
        for _ in range(120):
            world.step(DT)
        np.testing.assert_array_equal(world.poses(ids), before)
        np.testing.assert_array_equal(world.velocities(ids), 0.0)
        np.testing.assert_array_equal(world.bounds(ids), bounds)


@engines
def test_bricks_of_many_sizes_and_attitudes_stand_where_they_were_put(engine):
    """Create bricks in batches of equal size and attitude; each keeps its own row."""
    rng = np.random.default_rng(0)
    sizes = BRICK * rng.choice([0.5, 1.0], (60, 1))
    turns = rotation.from_axis_angle(np.array([0, 0, 1.0]),
                                     rng.choice([0.0, 0.5 * np.pi], 60))
    poses = np.column_stack([rng.uniform(0, 50, (60, 3)), turns])
    with World(engine=engine) as world:
        ids = world.add_bricks(poses, sizes, np.full(60, 2.0))
        assert len(set(ids.tolist())) == 60
        bounds = world.bounds(ids)
        np.testing.assert_allclose(0.5 * (bounds[:, :3] + bounds[:, 3:]), poses[:, :3], atol=1e-9)
        extent = world.bodies.bounds[ids, 3:] - world.bodies.bounds[ids, :3]
        want = np.where(np.abs(turns[:, 3:]) > 0.9, sizes, sizes[:, [1, 0, 2]])
        np.testing.assert_allclose(extent, want, atol=2e-3)


@engines
def test_thawed_brick_falls_with_g_and_its_own_inertia(engine):
    """Thaw one of two bricks with a velocity: it falls, turns and answers as a free body."""
    with World(engine=engine) as world:
        ids = bricks(world, at(0, 0, 5), at(1, 0, 5))
        world.step(DT)
        world.thaw(ids[:1], np.array([[1.0, 0, 0, 0, 0, 2.0]]))
        world.step(DT)
        velocity = world.velocities(ids[:1])[0]
        np.testing.assert_allclose(velocity[:3], [1, 0, -G * DT], atol=2e-3)
        assert velocity[5] == pytest.approx(2.0, abs=5e-3)
        world.apply_impulse(int(ids[0]), [0, 0.5, 0], world.poses(ids[:1])[0, :3] + [0.1, 0, 0])
        inertia = box_inertia(np.array([BRICK_MASS]), BRICK[None])[0]
        assert world.velocities(ids[:1])[0, 5] - velocity[5] == pytest.approx(
            0.05 / inertia[2], rel=1e-3)
        assert world.poses(ids[1:])[0, 2] == 5.0


@engines
def test_thawed_frozen_and_thawed_again(engine):
    """Stop a falling brick in mid-air and let it go again: it starts from rest."""
    with World(engine=engine) as world:
        ids = bricks(world, at(0, 0, 8))
        world.thaw(ids)
        for _ in range(20):
            world.step(DT)
        world.freeze(ids)
        held = world.poses(ids).copy()
        for _ in range(20):
            world.step(DT)
        np.testing.assert_array_equal(world.poses(ids), held)
        world.thaw(ids)
        world.step(DT)
        assert world.velocities(ids)[0, 2] == pytest.approx(-G * DT, rel=1e-9)


@engines
def test_what_passes_around_a_resting_body_does_not_wake_it(engine):
    """Swing an L of two bars about a brick that lies in its corner: bounds meet, bars do not."""
    with World(engine=engine) as world:
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(1.0, 0, 0.0335))
        rest(world)
        sizes = np.array([[0.1, 0.1, 0.95], [2.0, 0.1, 0.1]])
        poses = np.array([at(-1.0, 0, 0.53), at(0.0, 0, 1.0)])
        mass = np.array([30.0, 60.0])
        total = rigid_sum(mass, box_inertia(mass, sizes), poses)
        bars = world.add_fragment(np.array([Shape.BOX] * 2), sizes, total.local_poses,
                                  total.mass, total.inertia, total.pose,
                                  np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0]))
        bounds = world.bounds(np.array([brick, bars]))
        assert (bounds[0, :3] < bounds[1, 3:]).all() and (bounds[1, :3] < bounds[0, 3:]).all()
        world.step(DT)
        assert world.bodies.state[brick] == BodyState.RESTING
        world.set_velocities(np.array([bars]), np.array([[0.0, 0.0, -6.0, 0.0, 0.0, 0.0]]))
        for _ in range(20):
            world.step(DT)
        assert world.bodies.state[brick] == BodyState.AWAKE


@engines
def test_what_is_clamped_comes_to_rest_beside_its_support(engine):
    """Put a plank into a slot, its centre outside of it: it lies still after little over 1 s."""
    with World(engine=engine) as world:
        world.add_bricks(np.array([at(0, 0, 0.5), at(0, 0, 1.6005)]),
                         np.tile([0.4, 0.4, 1.0], (2, 1)), np.full(2, 400.0))
        plank = world.add_body(Shape.BOX, [1.2, 0.2, 0.1], 15.0, at(0.27, 0, 1.05))
        assert rest(world) < 1.5
        np.testing.assert_allclose(world.poses([plank])[0, :3], [0.27, 0.0, 1.05], atol=3e-3)


@engines
def test_a_tower_of_resting_bricks_comes_down_with_its_foot(engine):
    """Remove the lowest of six: the release climbs the tower."""
    with World(engine=engine) as world:
        ids = []
        for i in range(6):
            ids.append(world.add_body(Shape.BOX, BRICK, BRICK_MASS,
                                      at(0.002 * i, 0, 0.0335 + 0.0655 * i)))
            rest(world)
        world.remove([ids[0]])
        rest(world)
        heights = np.sort(world.poses(ids[1:])[:, 2])
        assert heights[0] < 0.06
        assert heights[-1] < 0.0335 + 0.0655 * 4.6


@engines
def test_toppling_slab_is_not_taken_for_one_at_rest(engine):
    """Stand a slab 1 % of its height beyond its balance: it starts slowly, yet falls."""
    tilt = np.arctan2(0.1, 3.0) + 0.006
    turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array(tilt))
    corner = rotation.rotate(turn, np.array([0.1, 0, -3.0]))
    with World(engine=engine) as world:
        slab = world.add_body(Shape.BOX, [0.2, 2.0, 6.0], 4000.0, at(0, 0, -corner[2], turn))
        rest(world, 20.0)
        assert world.poses([slab])[0, 2] < 0.2


@engines
def test_nothing_ends_below_the_ground(engine):
    """Rain 60 bricks, and shoot 20 small balls down at 60 m/s; CCD and the lift hold them."""
    rng = np.random.default_rng(6)
    with World(engine=engine) as world:
        ids = [world.add_body(Shape.BOX, BRICK, BRICK_MASS,
                              at(*rng.uniform(-1, 1, 2), 0.5 + 0.06 * i)) for i in range(60)]
        ids += [world.add_projectile(Shape.CAPSULE, np.full(3, 0.06), 0.2,
                                     at(*rng.uniform(2, 4, 2), 5.0), [0, 0, -60, 0, 0, 0])
                for _ in range(20)]
        lowest = np.inf
        for _ in range(150):
            world.step(DT)
            lowest = min(lowest, float(world.poses(ids)[:, 2].min()))
        assert lowest > 0.0
        bottom = world.bounds(ids)[:, 2]
        assert bottom.min() > -0.015


@engines
def test_heavy_fragment_at_speed_is_put_back_to_the_ground(engine):
    """Let a compound, which has no CCD, hit the ground at 40 m/s: it neither sinks nor jumps."""
    size = np.array([[2.0, 2.0, 0.2], [0.2, 0.2, 0.5]])
    poses = np.array([at(0, 0, 6), at(0, 0, 6.35)])
    mass = np.array([1600.0, 40.0])
    total = rigid_sum(mass, box_inertia(mass, size), poses)
    with World(engine=engine) as world:
        slab = world.add_fragment(np.full(2, Shape.BOX), size, total.local_poses, total.mass,
                                  total.inertia, total.pose, [0, 0, -40, 0, 0, 0])
        heights = []
        for _ in range(120):
            world.step(DT)
            heights.append(world.poses([slab])[0, 2])
        assert min(heights) > 0.05
        assert max(heights[15:]) < 0.5


def test_wall_merges_into_its_rows_and_keeps_its_faces():
    """Merge a running-bond wall: one box per course, fewer when its teeth are levelled."""
    poses, sizes = [], []
    for row in range(12):
        for i in range(8):
            poses.append(at(0.225 * i + 0.1125 * (row % 2), 0, 0.075 * row))
            sizes.append(BRICK)
    poses, sizes = np.array(poses), np.array(sizes)
    turn = at(3, 1, 2, rotation.from_yaw(0.4))
    merged, extents = merge_boxes(rotation.compose(turn, poses), sizes, tolerance=2e-3)
    assert len(merged) == 12
    np.testing.assert_allclose(extents[:, 0], 7 * 0.225 + 0.215, atol=1e-9)
    assert len(merge_boxes(rotation.compose(turn, poses), sizes)[0]) == 12
    block, extent = merge_boxes(rotation.compose(turn, poses), sizes, tolerance=0.12)
    assert len(block) == 1
    np.testing.assert_allclose(extent[0], [7 * 0.225 + 0.215, 0.1025, 11 * 0.075 + 0.065],
                               atol=1e-9)


def test_thick_and_thin_walls_do_not_merge_and_joints_are_closed():
    """Put a thin wall on a thick one: two boxes that touch where the joint was."""
    sizes = np.array([[1.0, 0.215, 0.3], [1.0, 0.1025, 0.3]])
    poses = np.array([at(0, 0, 0.15), at(0, 0.05, 0.46)])
    merged, extents = merge_boxes(poses, sizes)
    assert len(merged) == 2
    tops, bottoms = merged[:, 2] + 0.5 * extents[:, 2], merged[:, 2] - 0.5 * extents[:, 2]
    assert np.sort(tops)[0] == pytest.approx(np.sort(bottoms)[1])


@pytest.mark.parametrize(('slope', 'rolls'), [(0.07, False), (0.09, True)])
def test_a_rod_stays_on_a_slope_until_it_is_steeper_than_rolling_resists(slope, rolls):
    """Lay a rod of 0.1 m radius across a slope: the lever arm of 8 mm holds it up to 0.08."""
    gravity = [G * np.sin(slope), 0.0, -G * np.cos(slope)]
    across = rotation.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(0.5 * np.pi))
    with World(gravity, engine='native') as world:
        rod = world.add_body(Shape.CAPSULE, np.array([0.2, 0.2, 2.0]), 40.0,
                             np.array([0.0, 0.0, 0.1, *across]))
        for _ in range(60):
            world.step(DT)
        drive = np.sin(slope) - np.cos(slope) * 0.08
        # A rod of radius r has I = m·r²/2, but for its round ends.
        want = 0.5 * G * drive / 1.5 if rolls else 0.0
        assert world.poses([rod])[0, 0] == pytest.approx(want, rel=0.03, abs=1e-5)


def test_a_ball_that_spins_where_it_lies_stops_by_the_moment_of_its_weight():
    """Spin a ball about the vertical: its lever arm of 8 mm takes I·ω/(m·g·lever) to stop it."""
    radius, mass, spin = 0.2, 10.0, 5.0
    with World(engine='native') as world:
        ball = world.add_body(Shape.CAPSULE, [2.0 * radius] * 3, mass, at(0, 0, radius))
        world.set_velocities(np.array([ball]), np.array([[0.0, 0.0, 0.0, 0.0, 0.0, spin]]))
        duration = 0.4 * radius ** 2 * spin / (G * 0.008)
        for _ in range(round(0.5 * duration / DT)):
            world.step(DT)
        assert world.velocities([ball])[0, 5] == pytest.approx(0.5 * spin, rel=0.05)
        for _ in range(round(0.6 * duration / DT)):
            world.step(DT)
        assert abs(world.velocities([ball])[0, 5]) < 1e-3


@pytest.mark.parametrize(('lean', 'into'), [(0.0, 0.003), (0.05, 0.02), (0.3, 0.02)])
def test_what_is_wedged_in_is_not_thrown_out(lean, into):
    """Press a brick between two plates of one body, both of which it overlaps: it creeps out."""
    axis, size = np.array([1.0, 0.0, 0.0]), np.array([0.5, 0.05, 0.3])
    aside = 0.5 * (BRICK[1] + size[1]) - into
    poses = np.array([at(0, s * aside, 0, rotation.from_axis_angle(axis, np.array(-s * lean)))
                      for s in (1.0, -1.0)])
    mass, sizes = np.full(2, 100.0), np.tile(size, (2, 1))
    whole = rigid_sum(mass, box_inertia(mass, sizes), poses)
    with World((0.0, 0.0, 0.0), engine='native') as world:
        world.add_fragment(np.full(2, int(Shape.BOX)), sizes, whole.local_poses, whole.mass,
                           whole.inertia, whole.pose)
        heading = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(0.03))
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 0, heading))
        for _ in range(120):
            world.step(DT)
            assert np.linalg.norm(world.velocities([brick])[0, :3]) < 0.3


def test_what_spins_on_a_corner_stops_by_friction_within_its_point():
    """
    Spin a cube on its corner under a weight that slides down with it, about the vertical.

    The corner crushes until 10 MPa bear the load, and rubs by 2/3·μ·N·r.
    """
    edge, mass, weight, spin, height = 0.3, 20.0, 100.0, 4.0, 0.5 * 3.0 ** 0.5 * 0.3
    tip = rotation.from_axis_angle(np.array([1.0, -1.0, 0.0]) / 2.0 ** 0.5,
                                   np.array(np.arccos(3.0 ** -0.5)))
    up = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-0.5 * np.pi))
    with World(engine='native') as world:
        cube = world.add_body(Shape.BOX, [edge] * 3, mass, at(0, 0, height, tip))
        load = world.add_body(Shape.BOX, [0.1] * 3, weight, at(0, 0, 1.0))
        for kind, first, second in ((JointKind.HINGE, cube, load), (JointKind.SLIDER, load, 0)):
            world.join(kind, first, second, at(0, 0, 0.8, up))
        world.step(DT)
        world.set_velocities(np.array([cube]), np.array([[0.0, 0.0, 0.0, 0.0, 0.0, spin]]))
        force, inertia = (mass + weight) * G, mass * edge ** 2 / 6.0
        slows = 2.0 / 3.0 * FRICTION * force * np.sqrt(force / (np.pi * 1e7)) / inertia
        for _ in range(round(0.5 * spin / slows / DT)):
            world.step(DT)
        left = spin - slows * DT * round(0.5 * spin / slows / DT)
        assert world.velocities([cube])[0, 5] == pytest.approx(left, rel=0.05)
        for _ in range(round(0.6 * spin / slows / DT)):
            world.step(DT)
        assert abs(world.velocities([cube])[0, 5]) < 1e-3
