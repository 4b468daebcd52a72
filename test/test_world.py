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

"""The world of loose bodies: closed forms, extents, what touches what, and how hard."""

from importlib import import_module
from types import ModuleType

from loose_bricks import at, BRICK, BRICK_MASS, DT, G
from lowest_points import lowest
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Hexahedra, Shape
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.masonry.contact_forces import BodyContacts, spread
from procphys_ros.physics.world import (
    BodyState,
    installed_engines,
    Pieces,
    rigid_sum,
    solid_inertia,
    World,
)
from procphys_ros.physics.world.extents import are_near
from procphys_ros.scene import Scene, Settings
from procphys_ros.simulation import contact_exclusions, Simulation

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


_CUBE = np.ones(3)


def _at(x, y, z, yaw=0.0):
    return np.array([x, y, z, *rotation.from_yaw(yaw)])


def _add(world, shape, size, pose):
    return world.add_body(shape, np.asarray(size, float), 1.0, pose,
                          inertia=solid_inertia(shape, np.asarray(size, float), 1.0))


def test_bounds_are_those_of_the_turned_shapes():
    """Turn a cube by an eighth, and lay a rod of half round ends down."""
    with World() as world:
        cube = _add(world, Shape.BOX, _CUBE, _at(3.0, 0.0, 5.0, 0.25 * np.pi))
        turn = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(0.5 * np.pi))
        rod = _add(world, Shape.CAPSULE, [0.2, 0.2, 2.0], np.array([0.0, 0.0, 4.0, *turn]))
        half = 0.5 * np.sqrt(2.0)
        np.testing.assert_allclose(world.bounds([cube, rod]), [
            [3.0 - half, -half, 4.5, 3.0 + half, half, 5.5],
            [-1.0, -0.1, 3.9, 1.0, 0.1, 4.1]], atol=1e-12)


@pytest.mark.parametrize('yaw, gap', [(0.0, 0.5), (0.25 * np.pi, 1.0 - 0.5 * np.sqrt(2.0))])
def test_bodies_are_near_up_to_the_gap_between_them(yaw, gap):
    """Put a cube beside one whose face, or whose edge, looks at it."""
    with World() as world:
        pair = np.array([[_add(world, Shape.BOX, _CUBE, _at(0.0, 0.0, 5.0)),
                          _add(world, Shape.BOX, _CUBE, _at(1.5, 0.0, 5.0, yaw))]])
        for share, near in ((0.99, False), (1.01, True)):
            assert are_near(world.bodies, pair, np.array([share * gap])) == [near]


def test_any_two_pieces_make_bodies_near():
    """Look for a ball beside the far end of a row of cubes, and above the hole in it."""
    with World() as world:
        poses = np.array([_at(x, 0.0, 5.0) for x in (0.0, 1.0, 4.0)])
        total = rigid_sum(np.ones(3), box_inertia(np.ones(3), np.ones((3, 3))), poses)
        row = world.add_fragment(np.full(3, Shape.BOX), np.ones((3, 3)), total.local_poses,
                                 total.mass, total.inertia, total.pose)
        end = _add(world, Shape.CAPSULE, [0.2, 0.2, 0.2], _at(4.7, 0.0, 5.0))
        hole = _add(world, Shape.CAPSULE, [0.2, 0.2, 0.2], _at(2.5, 0.0, 5.0))
        near = are_near(world.bodies, np.array([[row, end], [row, hole]]), np.full(2, 0.2))
        assert near.tolist() == [True, False]


@pytest.mark.parametrize('engine', installed_engines())
@pytest.mark.parametrize('pieces', [2, 16, 17])
def test_compounds_of_any_size_land_flat_on_all_their_shapes(engine, pieces):
    """Let a row of cubes, apart by their width, lie: all its weight is on the ground."""
    poses = np.array([_at(0.2 * n, 0.0, 0.05) for n in range(pieces)])
    mass, size = np.full(pieces, 2.0), np.full((pieces, 3), 0.1)
    total = rigid_sum(mass, box_inertia(mass, size), poses)
    with World(engine=engine) as world:
        row = world.add_fragment(np.full(pieces, Shape.BOX), size, total.local_poses, total.mass,
                                 total.inertia, total.pose)
        for _ in range(20):
            world.step(1.0 / 60.0)
        assert world.poses([row])[0, 2] == pytest.approx(0.05, abs=2e-3)
        assert world.wrench(row)[2] == pytest.approx(total.mass * 9.81, rel=0.02)
        touched = world.contacts().point[:, 0]
        # Bullet has one point under a convex hull, as which it takes the last of 17.
        assert touched.max() - touched.min() == pytest.approx(0.2 * pieces - 0.1, abs=0.06)


@pytest.fixture(scope='module')
def bench() -> ModuleType:
    """Import the comparison, and with it what measures overlaps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(shared_folder() / 'bench'))
        return import_module('contact_engines')


def least_shadow(one, two, rng):
    """Find the least overlap of the shadows of two solids along many directions."""
    best, depth = None, np.inf
    for size in (np.inf, 0.05, 0.01, 0.002, 0.0004):
        ways = rng.normal(size=(20_000, 3))
        ways = ways if best is None else best + size * ways
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        first, second = one @ ways.T, two @ ways.T
        found = np.minimum(first.max(axis=0) - second.min(axis=0),
                           second.max(axis=0) - first.min(axis=0))
        if found.min() < depth:
            best, depth = ways[np.argmin(found)], found.min()
    return max(depth, 0.0)


def test_overlaps_are_the_least_over_all_directions(bench):
    """Place boxes and wedges at random, one of them standing: no direction parts them sooner."""
    rng, deep = np.random.default_rng(2), 0
    for n in range(40):
        sizes, turns = rng.uniform(0.1, 0.5, (2, 3)), rng.normal(size=(2, 4))
        turns /= np.linalg.norm(turns, axis=1)[:, None]
        poses = np.column_stack([[0.0, 0.0, 5.0] + rng.normal(scale=0.12, size=(2, 3)), turns])
        corners = box_corners(-0.5 * sizes, 0.5 * sizes)
        corners[:, 4:, :2] *= rng.uniform(0.3, 1.0) if n % 2 else 1.0
        cut = Hexahedra(np.arange(2), corners.reshape(2, 24)) if n % 2 else None
        wanted = least_shadow(*(poses[:, None, :3] + rotation.rotate(
            poses[:, None, 3:], corners)), rng)
        with World(engine='native') as world:
            ids = world.add_bricks(poses, sizes, np.ones(2), hexahedra=cut)
            world.thaw(ids[:1])
            assert bench.deepest_overlap(world) == pytest.approx(wanted, abs=1e-3)
        deep += wanted > 0.01
    assert deep > 15


def test_overlaps_with_the_ground_and_among_what_stands(bench):
    """Sink a loose box by 3 mm; two that stand in each other count for nothing."""
    with World(engine='native') as world:
        assert bench.deepest_overlap(world) == 0.0
        world.add_bricks(np.array([[5.0, 0, 1, 0, 0, 0, 1], [5.1, 0, 1, 0, 0, 0, 1]]),
                         np.full((2, 3), 0.2), np.ones(2))
        world.add_body(Shape.BOX, np.full(3, 0.2), 8.0, np.array([0, 0, 0.097, 0, 0, 0, 1.0]))
        assert bench.deepest_overlap(world) == pytest.approx(0.003, abs=1e-9)
        assert bench.deepest_overlap(world, awake=False) == 0.0  # it has not come to rest


@pytest.mark.parametrize('name', ['slope', 'slide_90_km', 'bounce', 'cards'])
def test_rows_run_and_keep_their_bounds(bench, name):
    """Run the quickest experiments twice in turns: within bounds, and the same both times."""
    trials = [bench.Trial('native') for _ in range(2)]
    one, two = bench.compare(bench.ROWS[name], trials)
    bounded = [figure for figure in one if figure.bound]
    assert bounded
    for figure in bounded:
        assert figure.low <= figure.value <= figure.high, figure
    assert [f.value for f in bounded] == [f.value for f in two if f.bound]


def test_nudged_runs_differ_and_can_be_repeated(bench):
    """Draw what is added to gravity: nothing in the first run, and always the same in others."""
    first, second, again = (bench.Trial('native', run=run).nudge() for run in (0, 1, 1))
    assert not first.any() and second.any() and (second == again).all()


def test_patterns_choose_rows(bench):
    """Choose by name, by pattern, and nothing that takes minutes without either."""
    assert bench.chosen(['rubble_barn*']) == ['rubble_barn_demolished', 'rubble_barn_blasted']
    assert bench.chosen(['nothing']) == []
    assert not any(name.startswith('rubble') for name in bench.chosen([]))


# Two branches, one inside of the other and both inside of the trunk, that their weight breaks off.
_FORK = 'axiom: Density(600) !(0.1) F(2) BreakForce(1) [ &(100) F(1) ] [ &(105) F(1) ]'
_BLOCK = np.full(3, 0.4)


def broken(engine: str) -> Simulation:
    """Detach the branches."""
    scene = Scene(Settings(engine=engine))
    scene.add(LSystem.parse(_FORK).build(), name='fork')
    simulation = Simulation(scene)
    simulation.step(3)
    assert simulation.bonds_broken >= 2
    return simulation


@pytest.mark.parametrize('engine', installed_engines())
def test_pieces_that_overlap_fall_side_by_side(engine):
    """Let overlapping branches fall: nothing turns them, or throws them to the side."""
    simulation = broken(engine)
    assert {(0, 1), (0, 2), (1, 2)} == {tuple(sorted(pair)) for pair in simulation.state.excluded}
    before = simulation.poses.copy()
    simulation.step(20)
    moved = simulation.poses[1:] - before[1:]
    assert (moved[:, 2] < -0.5).all()
    assert np.abs(moved[:, [0, 1, 3, 4, 5]]).max() < 1e-3


def test_pieces_meet_once_they_are_apart():
    """Push one branch out of the other: no pair is left over, and the trunk stops it again."""
    simulation = broken('bullet')
    mass = float(simulation.blueprint.mass[1])
    simulation.apply_impulse(1, (0.0, 5.0 * mass, 0.0))
    simulation.step(20)
    assert not {(0, 1), (1, 2)} & {tuple(sorted(pair)) for pair in simulation.state.excluded}


@pytest.mark.parametrize('engine', installed_engines())
def test_exclusions_survive_snapshots(engine):
    """Go on from a snapshot to the bit while branches pass through each other."""
    simulation = broken(engine)
    data = simulation.save()
    other = Simulation(simulation.scene)
    other.restore(data)
    for run in (simulation, other):
        run.step(15)
    assert len(simulation.state.excluded)
    np.testing.assert_array_equal(simulation.poses, other.poses)
    np.testing.assert_array_equal(simulation.velocities, other.velocities)


def test_a_flexible_branch_leaves_the_crown_it_grew_in():
    """Cut a branch loose inside of its tree: it falls by its weight, and nothing kicks it."""
    scene = Scene()
    scene.add(LSystem.parse('axiom: Density(600) !(0.06) F(3) [ &(110) '
                            + '[ &(70) F(0.5) ] F(0.3) ' * 6 + '] [ &(115) F(2) ]').build())
    simulation = Simulation(scene)
    simulation.step()
    forest = simulation.state.forest
    branch = max(range(1, len(forest)), key=lambda row: len(forest.subtree(row)))
    contact_exclusions.add_branch(simulation.state, branch, simulation.model.trees.sizes)
    rows = forest.subtree(branch)
    forest.release(branch)
    assert len(rows) == 11 and len(simulation.state.excluded)
    simulation.step(2)
    mass = simulation.blueprint.mass[forest.parts[rows]]
    mean = (mass[:, None] * forest.velocities[rows, :3]).sum(axis=0) / mass.sum()
    np.testing.assert_allclose(mean, [0.0, 0.0, -2.0 * 9.81 / 60.0], atol=0.01)


@pytest.mark.parametrize('engine', installed_engines())
def test_worlds_keep_excluded_bodies_from_meeting(engine):
    """Let cubes overlap: they stay while excluded, also when restored, and part afterwards."""
    with World((0.0, 0.0, 0.0), engine=engine) as world:
        cubes = [world.add_body(Shape.BOX, _BLOCK, 1.0, np.array([x, 0, 5, 0, 0, 0, 1.0]))
                 for x in (0.0, 0.3)]
        world.exclude_contacts(np.array([cubes]))
        world.step(1.0 / 60.0)
        with World.restore(world.save_state(), engine=engine) as restored:
            for each in (world, restored):
                for _ in range(3):
                    each.step(1.0 / 60.0)
                np.testing.assert_allclose(each.poses(cubes)[:, 0], [0.0, 0.3], atol=1e-6)
        world.exclude_contacts(np.zeros((0, 2), int))
        for _ in range(3):
            world.step(1.0 / 60.0)
        assert np.ptp(world.poses(cubes)[:, 0]) > 0.31


@pytest.mark.parametrize('engine', installed_engines())
def test_exclusions_end_with_their_bodies(engine):
    """Remove an excluded body: another one that takes its id meets what is there."""
    with World((0.0, 0.0, 0.0), engine=engine) as world:
        pose = np.array([0.3, 0, 5, 0, 0, 0, 1.0])
        cubes = [world.add_body(Shape.BOX, _BLOCK, 1.0, np.array([x, 0, 5, 0, 0, 0, 1.0]))
                 for x in (0.0, 0.3)]
        world.exclude_contacts(np.array([cubes]))
        world.remove(cubes[1])
        assert world.add_body(Shape.BOX, _BLOCK, 1.0, pose) == cubes[1]
        for _ in range(3):
            world.step(1.0 / 60.0)
        assert np.ptp(world.poses(cubes)[:, 0]) > 0.31


def test_a_contact_without_a_normal_presses_nothing():
    """Put the weight on two bricks as if a contact that has no normal were not there."""
    poses = np.array([[0.0, 0, 0, 0, 0, 0, 1], [0.3, 0, 0, 0, 0, 0, 1]])
    sizes = np.full((2, 3), 0.2)
    points = np.array([[0.15, 0.0, -0.1], [0.2, 0.0, 0.0]])
    normals, forces = np.array([[0.0, 0, 1], [0, 0, 0]]), np.array([[0.0, 0, 50.0], [0, 0, 0]])
    wanted = spread(BodyContacts(points[:1], normals[:1], forces[:1], np.zeros(1, np.int64)),
                    poses, sizes, poses)
    assert wanted[:, 2].sum() > 49.0
    for order in ([0, 1], [1, 0]):
        found = spread(BodyContacts(points[order], normals[order], forces[order],
                                    np.zeros(2, np.int64)), poses, sizes, poses)
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12)
