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


"""Terrain: one surface for bodies, branches, rays, dust and wind; objects stand on it."""

from lowest_points import lowest
from masonry_walls import bonded
import numpy as np
from PIL import Image
import pytest
import trimesh

from procphys_ros.blueprint import GROUND, Shape
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.export import export
from procphys_ros.geometry import rotation
from procphys_ros.physics.lidar import cast, spherical
from procphys_ros.physics.lidar import GROUND as GROUND_HIT
from procphys_ros.physics.loads import exposed_faces
from procphys_ros.physics.skyline import keep_out, Skyline
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.touch import meet_ground
from procphys_ros.physics.wind import Wind, WindSettings
from procphys_ros.physics.world import installed_engines, World
from procphys_ros.physics.world.rolling import ROLLING
from procphys_ros.scene import Scene
from procphys_ros.scene.placement import stand_on
from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.simulation import Simulation

G, STEP = 9.81, 1.0 / 60.0
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def slope(angle: float, heading: float = 0.0) -> Terrain:
    """Make a plane that falls along a heading, over a grid about the origin."""
    along = np.arange(-20.0, 21.0)
    x, y = np.meshgrid(along, along, indexing='ij')
    heights = 20.0 - (x * np.cos(heading) + y * np.sin(heading)) * np.tan(angle)
    return Terrain(heights, np.array([-20.0, -20.0]), 1.0)


def rough() -> Terrain:
    """Make a grid of random heights."""
    return Terrain(np.random.default_rng(1).uniform(0.0, 3.0, (12, 9)), np.array([-5.0, -3.0]),
                   0.7)


def bowl() -> Terrain:
    """Make a round hollow."""
    along = np.linspace(-12.0, 12.0, 49)
    x, y = np.meshgrid(along, along, indexing='ij')
    return Terrain(0.04 * (x ** 2 + y ** 2), np.array([-12.0, -12.0]), 0.5)


def scene_on(**parameters) -> Scene:
    """Build a scene from parameters."""
    names = [name for name, value in parameters.items()
             if isinstance(value, dict) and ('grammar' in value or 'grammar_text' in value)]
    return Scene.from_parameters({'scene': {'objects': names}, **parameters})


def test_height_normal_and_range_are_those_of_the_mesh():
    """Find the same surface by all questions, beyond the edges too; the anchor is trimesh."""
    terrain, rng = rough(), np.random.default_rng(2)
    mesh = trimesh.Trimesh(*terrain.mesh(margin=20.0), process=False)
    assert (mesh.face_normals[:, 2] > 0.0).all()
    places = rng.uniform(-9.0, 9.0, (500, 2))
    above = np.column_stack([places, np.full(500, 50.0)])
    met, ray, face = mesh.ray.intersects_location(above, np.tile([0.0, 0.0, -1.0], (500, 1)),
                                                  multiple_hits=False)
    assert len(ray) == 500
    np.testing.assert_allclose(met[:, 2], terrain.height(places)[ray], atol=1e-9)
    np.testing.assert_allclose(mesh.face_normals[face], terrain.normal(places)[ray], atol=1e-9)
    ways = rng.normal(size=(500, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    starts = np.column_stack([places, terrain.height(places) + rng.uniform(0.01, 6.0, 500)])
    met, ray, _ = mesh.ray.intersects_location(starts, ways, multiple_hits=False)
    wanted = np.full(500, np.inf)
    wanted[ray] = np.linalg.norm(met - starts[ray], axis=1)
    wanted[wanted > 12.0] = np.inf
    found = [terrain.range(start, way, 12.0) for start, way in zip(starts, ways)]
    np.testing.assert_allclose(found, wanted, atol=1e-6)


@pytest.mark.parametrize('height', [0.0, 0.7])
def test_rays_meet_level_heights_wherever_they_come_from(height):
    """Look down on a grid whose heights are all the same: the highest ground is everywhere."""
    terrain = Terrain(np.full((5, 5), height), np.array([-2.0, -2.0]), 1.0)
    rng = np.random.default_rng(8)
    ways = rng.normal(size=(300, 3))
    ways[:, 2] = -np.abs(ways[:, 2]) - 0.01
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    starts = np.column_stack([rng.uniform(-6.0, 6.0, (300, 2)), rng.uniform(0.8, 9.0, 300)])
    found = [terrain.range(start, way) for start, way in zip(starts, ways)]
    np.testing.assert_allclose(found, (height - starts[:, 2]) / ways[:, 2], rtol=1e-9)
    assert terrain.range([0.0, 0.0, height - 0.1], ways[0]) == np.inf


def test_rays_meet_the_ground_far_beyond_a_fine_grid():
    """Look out of narrow cells beside a hill: the level ground is met, however far away."""
    heights = np.zeros((5, 5))
    heights[2, 2] = 1.0
    terrain = Terrain(heights, np.array([-0.2, -0.2]), 0.1)
    for turn in np.linspace(0.1, 1.4, 9):
        way = np.array([np.cos(turn), np.sin(turn), -0.02]) / np.sqrt(1.0004)
        assert terrain.range([0.15, 0.15, 0.8], way) == pytest.approx(40.0 * np.sqrt(1.0004))


def test_flat_ground_is_the_plane():
    """Take ground without heights for z = 0."""
    assert FLAT.is_flat and not FLAT.height(np.ones((2, 2))).any()
    assert FLAT.range([0.0, 0.0, 2.0], [0.0, 0.6, -0.8]) == pytest.approx(2.5)
    assert FLAT.range([0.0, 0.0, 2.0], [1.0, 0.0, 0.0]) == np.inf


@pytest.mark.parametrize('engine', installed_engines())
def test_ball_rolls_downhill(engine):
    """Reach 5/7 g (sin α - cos α · lever / r) t on a slope, whichever way it falls; stay on it."""
    angle, radius = 0.2, 0.3
    for heading in (0.0, 0.7):
        terrain = slope(angle, heading)
        down = np.array([np.cos(heading), np.sin(heading)])
        height = terrain.height([-8.0 * down])[0] + radius / np.cos(angle)
        with World(engine=engine, terrain=terrain) as world:
            ball = world.add_body(Shape.CAPSULE, np.full(3, 2.0 * radius), 100.0,
                                  np.array([*(-8.0 * down), height, *LEVEL]))
            for _ in range(90):
                world.step(STEP)
            pose, velocity = (found[0] for found in (world.poses([ball]),
                                                     world.velocities([ball])))
        drive = np.sin(angle) - np.cos(angle) * ROLLING / radius
        wanted = 5.0 / 7.0 * G * drive * 90.0 * STEP
        # Bullet loses some on the edges of triangles.
        assert np.linalg.norm(velocity[:3]) == pytest.approx(
            wanted, rel=0.1 if engine == 'bullet' else 0.01)
        over = (pose[2] - terrain.height(pose[None])[0]) * np.cos(angle)
        assert over == pytest.approx(radius, abs=0.01)


@pytest.mark.parametrize('engine', installed_engines())
def test_contacts_with_a_slope_carry_the_weight(engine):
    """Lay a slab on a slope across many triangles: contacts tell its weight, and nothing else."""
    terrain, mass = slope(0.2), 500.0
    attitude = np.array([0.0, np.sin(0.1), 0.0, np.cos(0.1)])
    with World(engine=engine, terrain=terrain) as world:
        world.add_body(Shape.BOX, np.array([3.0, 2.0, 0.2]), mass,
                       np.array([0.2, 0.3, terrain.height(np.array([[0.2, 0.3]]))[0]
                                 + 0.1 / np.cos(0.2), *attitude]))
        forces = []
        for step in range(25):
            world.step(STEP)
            if step >= 15:
                forces.append(-world.contacts().on(world.ground)[2].sum(axis=0) / STEP)
    np.testing.assert_allclose(np.mean(forces, axis=0), [0.0, 0.0, mass * G], atol=0.01 * mass * G)


@pytest.mark.parametrize('engine', installed_engines())
def test_things_come_to_rest_in_a_hollow(engine):
    """Let boxes and a log fall into a bowl; they end near its bottom, on the ground, at rest."""
    terrain = bowl()
    with World(engine=engine, terrain=terrain) as world:
        log = world.add_body(Shape.CAPSULE, np.array([0.3, 0.3, 1.5]), 60.0,
                             np.array([1.5, 1.0, 2.0, 0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]))
        boxes = [world.add_body(Shape.BOX, np.array([0.4, 0.3, 0.2]), 40.0,
                                np.array([x, 0.4 * x, 2.0, *LEVEL])) for x in (-4.0, 2.0, 3.0)]
        ids = np.array([log, *boxes])
        for _ in range(420):
            world.step(STEP)
        poses, velocities = world.poses(ids), world.velocities(ids)
        rooms = [lowest(world.pieces(body), pose, terrain) for body, pose in zip(ids, poses)]
    assert np.abs(velocities[:, :3]).max() < 0.3
    assert (np.linalg.norm(poses[:, :2], axis=1) < 5.0).all()
    assert np.min(rooms) > -0.04 and np.max(rooms) < 0.05


def test_a_fast_body_does_not_go_through_the_ground():
    """Stop a ball at 80 m/s on a hillside."""
    terrain = slope(0.5)
    with World(terrain=terrain) as world:
        ball = world.add_projectile(Shape.CAPSULE, np.full(3, 0.2), 30.0,
                                    np.array([-6.0, 0.0, 30.0, *LEVEL]),
                                    np.array([-50.0, 0.0, -60.0, 0.0, 0.0, 0.0]))
        low = np.inf
        for _ in range(60):
            world.step(STEP)
            pose = world.poses([ball])[0]
            low = min(low, pose[2] - terrain.height(pose[None])[0])
    assert low > 0.05


def ridged(kind, height):
    """Return a level field of 8 m with a ridge, a diagonal ridge or a peak in its middle."""
    heights = np.zeros((9, 9))
    if kind == 'peak':
        heights[4, 4] = height
    elif kind == 'ridge':
        heights[4] = height
    else:
        heights[np.arange(9), 8 - np.arange(9)] = height
    return Terrain(heights, np.zeros(2), 1.0)


@pytest.mark.parametrize('engine', installed_engines())
@pytest.mark.parametrize('kind', ['ridge', 'diagonal', 'peak'])
@pytest.mark.parametrize(('shape', 'size'), [
    (Shape.BOX, [4.0, 0.2, 0.2]), (Shape.BOX, [3.0, 3.0, 0.2]), (Shape.CAPSULE, [0.2, 0.2, 4.0])])
def test_what_bridges_uneven_ground_lies_on_it(engine, kind, shape, size):
    """Lay a beam, a slab and a pole over what stands up between their corners."""
    turn = rotation.from_axis_angle(np.array([0.0, 0.0, 1.0]),
                                    np.array(0.25 * np.pi if kind == 'diagonal' else 0.05))
    if shape == Shape.CAPSULE:
        turn = rotation.multiply(turn, rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]),
                                                                np.array(0.5 * np.pi)))
    for height in (0.05, 1.0):
        with World(engine=engine, terrain=ridged(kind, height)) as world:
            body = world.add_body(shape, np.array(size), 20.0,
                                  np.array([4.0, 4.0, height + 0.2, *turn]))
            for _ in range(24):
                world.step(STEP)
            assert world.poses([body])[0, 2] - height == pytest.approx(0.1, abs=0.01)


def test_rubble_does_not_sink_into_rough_ground():
    """Pour boxes and poles on sharp hills: no point of them ends below the surface by far."""
    rng = np.random.default_rng(1)
    terrain = Terrain(rng.uniform(0.0, 0.6, (25, 25)), np.zeros(2), 0.5)
    with World(engine='native', terrain=terrain) as world:
        shapes = [(Shape.CAPSULE, [0.2, 0.2, rng.uniform(0.3, 3.0)]) if k % 3 == 0 else
                  (Shape.BOX, rng.uniform(0.1, 1.8, 3)) for k in range(20)]
        for k, (shape, size) in enumerate(shapes):
            turn = rng.normal(size=4)
            world.add_body(shape, np.array(size), 200.0, np.array([
                *rng.uniform(2.0, 10.0, 2), 1.5 + 0.25 * k, *turn / np.linalg.norm(turn)]))
        for _ in range(360):
            world.step(STEP)
        for body, (shape, size) in enumerate(shapes, 1):
            along = np.linspace(-0.5, 0.5, 21)
            inside = np.stack(np.meshgrid(along, along, along), axis=-1).reshape(-1, 3) * size
            if shape == Shape.CAPSULE:
                inside = inside[np.hypot(*inside[:, :2].T) < 0.09]
            pose = world.poses([body])[0]
            points = rotation.rotate(pose[3:], inside) + pose[:3]
            assert (terrain.height(points) - points[:, 2]).max() < 0.1


def test_a_world_takes_its_terrain_along():
    """Restore a world on its hillside from what was saved."""
    with World(terrain=slope(0.2)) as world:
        ball = world.add_body(Shape.CAPSULE, np.full(3, 0.4), 50.0,
                              np.array([0.0, 0.0, 20.25, *LEVEL]))
        for _ in range(20):
            world.step(STEP)
        world.rebuild()
        with World.restore(world.save_state()) as other:
            for each in (world, other):
                for _ in range(20):
                    each.step(STEP)
            np.testing.assert_array_equal(world.poses([ball]), other.poses([ball]))


def test_trees_stand_where_their_roots_are():
    """Raise each plant of a scene by the ground at its root, and let it stand there."""
    scene = scene_on(terrain={'noise': 8.0, 'wavelength': 30.0, 'extent': 60.0, 'seed': 2},
                     oak={'grammar': 'oak.lsys', 'count': 4, 'spacing': 9.0, 'variants': 1})
    flat = scene_on(oak={'grammar': 'oak.lsys', 'count': 4, 'spacing': 9.0, 'variants': 1})
    terrain, tree = scene.settings.terrain, scene.blueprint
    roots = np.flatnonzero(tree.bonds[:, 0] == GROUND)
    places = tree.bond_frame[roots]
    assert np.ptp(places[:, 2]) > 1.0
    np.testing.assert_allclose(places[:, 2], terrain.height(places), atol=1e-9)
    lift = tree.poses[:, 2] - flat.blueprint.poses[:, 2]
    for thing in scene.objects:
        assert np.ptp(lift[thing.first:thing.first + thing.count]) < 1e-9
    simulation = Simulation(scene)
    before = simulation.poses.copy()
    simulation.step(30)
    assert not simulation.warnings and not len(simulation.events)
    assert np.abs(simulation.poses[:, :3] - before[:, :3]).max() < 0.01


def test_a_wall_stands_on_footings():
    """Raise a wall to the highest ground below it, and fill the air under it down to the soil."""
    scene = scene_on(terrain={'noise': 8.0, 'wavelength': 30.0, 'extent': 60.0, 'seed': 2},
                     wall={'grammar': 'garden_wall.wall', 'origin': [6.0, 0.0, 0.0], 'yaw': 0.4})
    terrain, wall = scene.settings.terrain, scene.blueprint
    footing = wall.kind == wall.kinds.index('footing')
    bricks = np.unique(wall.bonds[np.isin(wall.bonds[:, 0], np.flatnonzero(footing)), 1])
    assert footing.sum() > 3 and len(bricks) > 10
    base = (wall.poses[bricks, 2] - 0.5 * wall.size[bricks, 2]).min()
    top = wall.poses[footing, 2] + 0.5 * wall.size[footing, 2]
    np.testing.assert_allclose(top, base, atol=1e-6)
    low = wall.poses[footing, 2] - 0.5 * wall.size[footing, 2]
    assert (low < terrain.height(wall.poses[footing]) - 0.05).all()
    assert len(np.unique(low.round(3))) > 1  # it goes down in steps
    on_soil = np.setdiff1d(wall.bonds[wall.bonds[:, 0] == GROUND, 1], np.flatnonzero(footing))
    assert (base - terrain.height(wall.poses[on_soil]) < 0.1).all()
    simulation = Simulation(scene)
    simulation.step(5)
    assert not simulation.warnings and not len(simulation.events)


@pytest.mark.parametrize('yaw', [0.0, 0.7, 2.0])
def test_no_wall_is_buried_by_a_peak_between_samples(yaw):
    """Stand a closed wall over one peak of a coarse grid: it is raised to the peak, no higher."""
    heights = np.zeros((5, 5))
    heights[2, 2] = 1.0
    terrain = Terrain(heights, np.array([-19.1, -20.7]), 10.0)
    ring = np.array([[x, y, 0.1] for x in np.linspace(-2.0, 2.0, 11) for y in (-2.0, 2.0)]
                    + [[x, y, 0.1] for y in np.linspace(-1.6, 1.6, 9) for x in (-2.0, 2.0)])
    built = bonded(ring, (0.38, 0.2, 0.2), gap=0.25)
    raised = stand_on(terrain, built.placed((0.3, -0.2, 0.0), yaw), 'ring')
    assert raised.poses[0, 2] == pytest.approx(1.1)


def test_doors_stand_on_footings():
    """Fill the air below a door as well as below the walls at its sides."""
    scene = scene_on(terrain={'noise': 8.0, 'wavelength': 30.0, 'extent': 60.0, 'seed': 2},
                     barn={'grammar': 'barn.wall', 'yaw': 0.4})
    barn, terrain = scene.blueprint, scene.settings.terrain
    up = np.abs(rotation.to_matrix(barn.poses[:, 3:])[:, 2])
    low = barn.poses[:, 2] - 0.5 * (up * barn.size).sum(axis=1)
    footings = np.flatnonzero(barn.kind == barn.kinds.index('footing'))
    building = np.setdiff1d(np.arange(len(barn)), footings)
    feet = building[low[building] < low[building].min() + 0.02]
    open_below = feet[low[feet] - terrain.height(barn.poses[feet]) > 0.1]
    assert len(open_below) > 40
    for part in open_below:
        back = rotation.conjugate(barn.poses[footings, 3:])
        inside = rotation.rotate(back, barn.poses[part, :3] - barn.poses[footings, :3])
        on = (np.abs(inside[:, :2]) <= 0.5 * barn.size[footings, :2] + 0.03).all(axis=1)
        assert on.any(), barn.poses[part, :3]


def test_branches_meet_the_slope():
    """Find where the tip of a branch is near a hillside, how far from it and which way."""
    terrain = slope(0.3)
    size = np.array([[0.2, 0.2, 1.0]])
    turn = np.array([0.0, np.sin(0.65), 0.0, np.cos(0.65)])  # 1.3 rad about y: nearly along x
    for room in (0.003, -0.02, 0.3):
        axis = np.array([np.sin(1.3), 0.0, np.cos(1.3)])
        tip = np.array([3.0, 1.0, 0.0])
        tip[2] = terrain.height(tip[None])[0] + (0.1 + room) / np.cos(0.3)
        pose = np.concatenate([tip - 0.4 * axis, turn])[None]
        found = meet_ground(np.zeros(1, int), np.zeros(1, bool), pose, size, np.zeros((1, 6)),
                            STEP, terrain)
        if room > 0.1:
            assert not len(found.pair)
            continue
        np.testing.assert_allclose(found.gap, room, atol=1e-9)
        np.testing.assert_allclose(found.normal, terrain.normal(tip[None]), atol=1e-12)
        np.testing.assert_allclose(found.point[0], tip - (0.1 + 0.5 * room) * found.normal[0],
                                   atol=1e-9)


def test_lidar_sees_the_hillside():
    """Measure ranges to the ground that lie on it."""
    terrain, pattern = rough(), spherical(16, 64, 1.2, 2.0 * np.pi)
    pose = np.array([-2.0, 0.0, 4.0, *LEVEL])
    ranges, row = cast(pattern, pose, 30.0, np.zeros(0, np.uint8), np.zeros((0, 7)),
                       np.zeros((0, 3)), terrain)
    hit = row == GROUND_HIT
    points = pose[:3] + pattern.directions[hit] * ranges[hit][:, None]
    assert hit.sum() > 100
    np.testing.assert_allclose(points[:, 2], terrain.height(points), atol=1e-6)


def test_leaves_and_dust_come_down_on_the_slope():
    """Use the hillside as the floor, beside and below standing boxes."""
    terrain = slope(0.3)
    house = np.array([[2.0, 2.0, 18.0, 4.0, 4.0, 22.0]])
    open_, built = Skyline.over(house[:0], terrain), Skyline.over(house, terrain)
    before = np.array([-3.0, 0.0, 21.2])
    _, _, floor = keep_out(open_, before, -4.0, 0.0, 21.0)
    assert floor == pytest.approx(terrain.height([[-4.0, 0.0]])[0])
    assert keep_out(built, np.array([3.0, 3.0, 30.0]), 3.0, 3.0, 29.0)[2] == 22.0
    x, y, floor = keep_out(built, np.array([1.0, 3.0, 20.5]), 2.5, 3.0, 20.4)
    assert (x, y) == (1.0, 3.0) and floor == pytest.approx(terrain.height([[1.0, 3.0]])[0])


def test_wind_follows_the_ground():
    """Blow at a height over the hillside as at that height over a plain."""
    settings = WindSettings((8.0, 0.0, 0.0), turbulence_intensity=0.1)
    terrain = slope(0.3)
    points = np.array([[1.0, 2.0, 3.0], [-5.0, 4.0, 0.5], [0.0, 0.0, 12.0]])
    raised = points + terrain.height(points)[:, None] * [0.0, 0.0, 1.0]
    np.testing.assert_allclose(Wind(settings, 3, terrain=terrain).velocity(raised, 2.0),
                               Wind(settings, 3).velocity(points, 2.0), atol=1e-9)


@pytest.mark.parametrize('heading', [0.0, 1.3, 4.0])
def test_wind_reaches_walls_on_a_slope_as_on_a_plain(heading):
    """Stand boxes on hillsides: rising ground 25 m away covers none of their faces."""
    poses = np.array([[x, y, z, *LEVEL] for x in (0.0, 0.9) for y in (0.0, 5.0)
                      for z in (0.5, 1.5)])
    sizes = np.full((8, 3), [0.9, 0.3, 1.0])
    level = exposed_faces(poses, sizes)
    terrain = slope(0.3, heading)
    poses[:, 2] += terrain.height(poses).max()
    np.testing.assert_array_equal(exposed_faces(poses, sizes, terrain=terrain), level)
    assert 0 < np.count_nonzero(level) < level.size


def test_strikes_count_from_the_ground():
    """Refuse what starts inside of the hill, and name its height."""
    scene = scene_on(terrain={'noise': 8.0, 'wavelength': 30.0, 'extent': 60.0, 'seed': 2})
    simulation = Simulation(scene)
    top = scene.settings.terrain.heights.argmax()
    x, y = scene.settings.terrain.mesh()[0][top, :2]
    for command in (Explosion((x, y, 7.0), 1.0), Projectile(position=(x, y, 7.0))):
        with pytest.raises(CommandError, match='8.00 m high'):
            simulation.apply(command)
    simulation.apply(Projectile(position=(x, y, 9.0)))


def test_files_of_heights_agree(tmp_path):
    """Read the same hills from a PNG, an NPZ and an ESRI grid; their lowest point is z = 0."""
    north_first = np.array([[5, 6, 7], [2, 3, 4]], float)
    Image.fromarray((north_first * 8191).astype(np.uint16)).save(tmp_path / 'a.png')
    np.savez(tmp_path / 'a.npz', heights=north_first, cell=2.0)
    (tmp_path / 'a.asc').write_text(
        'ncols 3\nnrows 2\nxllcorner 500000\nyllcorner 4000000\ncellsize 2\nNODATA_value -9999\n'
        '5 6 7\n2 3 4\n')
    for name, about in (('a.png', {'height': 65535 / 8191, 'cell': 2.0}), ('a.npz', {}),
                        ('a.asc', {})):
        scene = Scene.from_parameters({'terrain': {'file': name, **about}}, tmp_path)
        terrain = scene.settings.terrain
        np.testing.assert_allclose(terrain.heights, [[0, 3], [1, 4], [2, 5]], atol=1e-6)
        np.testing.assert_allclose([*terrain.low, terrain.edge], [-2.0, -1.0, 2.0])


@pytest.mark.parametrize('name, content, message', [
    ('none.npz', None, 'there is no file "none.npz"'),
    ('a.tif', b'', 'end in .png, .npz or .asc'),
    ('a.png', b'no picture', 'cannot be read'),
    ('a.asc', b'ncols 2\nnrows 2\n1 2\n3 4\n', 'no cellsize above 0'),
    ('a.asc', b'ncols 2\nnrows 2\ncellsize 1\n1 2 3\n', '3 heights, 2 columns and 2 rows need 4'),
    ('a.asc', b'ncols 2\nnrows 2\ncellsize 1\n1 -9999\n3 4\n',
     '1 cells without a height, the first in row 1, column 2'),
    ('a.asc', b'ncols 2\nnrows 2\ncellsize 1\n1 -3.4e38\n3 4\n',
     'heights from -3.4e+38 to 4 m, at most 9300 m'),
    ('a.asc', b'\xef\xbb\xbfncols 2\nnrows 2\ncellsize 1\n1 -9999\n3 4\n',
     '1 cells without a height, the first in row 1, column 2'),
    ('a.asc', b'ncols 1\nnrows 2\ncellsize 1\n1\n3\n', 'at least 2 x 2'),
    ('a.npz', b'', 'it is no .npz file'),
    ('a.asc', b'colour red\n', 'line 1 is not one of a header'),
    ('a.asc', b'ncols inf\nnrows 2\ncellsize 1\n1 2\n3 4\n', 'no ncols above 0'),
    ('a.asc', b'ncols 2\nnrows 2\ncellsize 1\n1 2\nx 4\n', 'line 5 has a word that is no number'),
])
def test_bad_files_are_told(tmp_path, name, content, message):
    """Name the key, the file and what is allowed."""
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match='terrain.file') as error:
        Scene.from_parameters({'terrain': {'file': name}}, tmp_path)
    assert message in str(error.value)


def test_bad_settings_are_told(tmp_path):
    """Name keys that exclude each other, NaN cells, and objects beyond the edge."""
    with pytest.raises(SceneError, match='either terrain.file or terrain.noise'):
        Scene.from_parameters({'terrain': {'file': 'a.png', 'noise': 2.0}})
    with pytest.raises(SceneError, match='terrain.noise is -1'):
        Scene.from_parameters({'terrain': {'noise': -1.0}})
    with pytest.raises(SceneError, match='no such key, did you mean "noise"|terrain.noice'):
        Scene.from_parameters({'terrain': {'noice': 1.0}})
    np.savez(tmp_path / 'a.npz', heights=np.array([[1.0, np.nan], [2.0, 3.0]]))
    with pytest.raises(SceneError, match='1 cells without a height'):
        Scene.from_parameters({'terrain': {'file': 'a.npz'}}, tmp_path)
    np.savez(tmp_path / 'b.npz', heights=np.zeros((2, 2)), cell=0.0)
    with pytest.raises(SceneError, match='b.npz has cells of 0.0 m, they must be larger than 0'):
        Scene.from_parameters({'terrain': {'file': 'b.npz'}}, tmp_path)
    with pytest.raises(SceneError, match=r'oak stands at \(90.0, .*outside of the terrain'):
        scene_on(terrain={'noise': 2.0, 'extent': 40.0},
                 oak={'grammar': 'oak.lsys', 'origin': [90.0, 0.0, 0.0]})


@pytest.fixture(scope='module')
def hills():
    """Make a scene of a tree on hills."""
    return scene_on(terrain={'noise': 8.0, 'wavelength': 30.0, 'extent': 40.0, 'seed': 2},
                    oak={'grammar': 'oak.lsys', 'origin': [3.0, 2.0, 0.0]})


def test_glb_has_the_hills(hills, tmp_path):
    """Read the ground back with trimesh, y up, where it is here."""
    export(hills, tmp_path / 'a.glb')
    read = trimesh.load(tmp_path / 'a.glb')
    ground = next(mesh for name, mesh in read.geometry.items() if 'ground' in name)
    x, y, z = ground.vertices.T
    x, y, z = (x, -z, y) if np.ptp(y) < 10.0 else (x, y, z)
    np.testing.assert_allclose(z, hills.settings.terrain.height(np.column_stack([x, y])),
                               atol=1e-4)


def test_usd_has_the_hills(hills, tmp_path):
    """Read the ground back with Pixar's library: a mesh that bodies collide with as it is."""
    pxr = pytest.importorskip('pxr.Usd')
    physics, geometry = pytest.importorskip('pxr.UsdPhysics'), pytest.importorskip('pxr.UsdGeom')
    export(hills, tmp_path / 'a.usda')
    stage = pxr.Stage.Open(str(tmp_path / 'a.usda'))
    ground = stage.GetPrimAtPath('/World/ground')
    points = np.array(geometry.Mesh(ground).GetPointsAttr().Get())
    np.testing.assert_allclose(points[:, 2], hills.settings.terrain.height(points), atol=1e-4)
    assert ground.HasAPI(physics.CollisionAPI) and ground.HasAPI(physics.MeshCollisionAPI)


def test_mjcf_has_the_hills(hills, tmp_path):
    """Measure heights by MuJoCo's rays; its diagonals may lie the other way."""
    mujoco = pytest.importorskip('mujoco')
    export(hills, tmp_path / 'a.xml')
    model = mujoco.MjModel.from_xml_path(str(tmp_path / 'a.xml'))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    terrain = hills.settings.terrain
    field = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, 'ground')]
    for x, y in terrain.mesh()[0][100:1500:200, :2] + 0.01:
        far = mujoco.mj_rayHfield(model, data, field[0], np.array([x, y, 50.0]),
                                  np.array([0.0, 0.0, -1.0]))
        assert 50.0 - far == pytest.approx(terrain.height([[x, y]])[0], abs=0.02)


def test_sdf_has_the_hills(hills, tmp_path):
    """Read the ground's mesh, which lies beside an SDF world, with trimesh."""
    export(hills, tmp_path / 'a.sdf')
    mesh = trimesh.load(tmp_path / 'a_ground.obj', process=False)
    terrain = hills.settings.terrain
    np.testing.assert_allclose(mesh.vertices[:, 2], terrain.height(mesh.vertices), atol=1e-4)
    assert '<uri>a_ground.obj</uri>' in (tmp_path / 'a.sdf').read_text()
