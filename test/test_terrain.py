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
"""Terrain, erosion and paving: one surface for bodies, branches, rays, dust and wind."""

import math

from lowest_points import lowest
from masonry_walls import bonded
import numpy as np
from PIL import Image
import pytest
import trimesh

from procphys_ros.blueprint import GROUND, Shape
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.export import export
from procphys_ros.export.content import Content
from procphys_ros.export.surfaces import surfaces
from procphys_ros.geometry import rotation
from procphys_ros.physics import erosion
from procphys_ros.physics.erosion import (
    corner_shares,
    drain,
    drained,
    erode,
    Rain,
    Soil,
    SOILS,
    volume,
)
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
from procphys_ros.scene.paving import pave
from procphys_ros.scene.placement import stand_on
from procphys_ros.scene.plan import read_plan
from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.scene.terrain import make_terrain, TerrainSettings
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
@pytest.mark.parametrize(('kind', 'shape', 'size'), [
    ('ridge', Shape.BOX, [4.0, 0.2, 0.2]), ('diagonal', Shape.BOX, [3.0, 3.0, 0.2]),
    ('peak', Shape.BOX, [3.0, 3.0, 0.2]), ('peak', Shape.CAPSULE, [0.2, 0.2, 4.0]),
    ('diagonal', Shape.CAPSULE, [0.2, 0.2, 4.0])])
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


PLAN = """
streets:
  high: {from: [-30, 0], to: [30, 0], width: 6, surface: asphalt, pavement: 1.5}
  mill: {from: [-8, -20], to: [12, 24], width: 4, surface: cobbles, pavement: 1.2}
  path: {from: [0, 50], to: [9, 50], width: 1}
trees:
  - {street: high, side: left, grammars: [pole.lsys], spacing: 30}
"""
POLE = 'axiom: Width(0.1) Density(700) Modulus(8e9) DampingRatio(0.05) F(1)\n'
ANGLE = math.atan2(44.0, 20.0)  # between the two streets
HILLS = Terrain(np.random.default_rng(2).uniform(0.0, 2.0, (60, 50)), np.array([-41.0, -33.0]),
                1.5)


@pytest.fixture
def folder(tmp_path):
    """Make a folder with a plan and a grammar."""
    (tmp_path / 'pole.lsys').write_text(POLE)
    (tmp_path / 'cross.plan').write_text(PLAN)
    return tmp_path


def paved(folder, terrain, yaw=0.0):
    """Lay the streets of the plan."""
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    streets = read_plan(folder / 'cross.plan').streets
    return {one.texture: one for one in pave(streets, terrain, np.array([2.0, 1.0]), turn, 'x')}


def across(paving):
    """Compute the cross products of the sides of all triangles, twice their areas long."""
    a, b, c = paving.points[paving.faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


@pytest.mark.parametrize('terrain', [FLAT, HILLS], ids=['flat', 'hills'])
def test_surfaces_do_not_overlap(folder, terrain):
    """Cover what the first street leaves of the second, and what both leave of pavements."""
    found = paved(folder, terrain, yaw=0.4)
    areas = {name: 0.5 * across(one)[:, 2].sum() for name, one in found.items()}
    assert set(areas) == {'asphalt', 'cobbles', 'paving'}
    assert areas['asphalt'] == pytest.approx(60.0 * 6.0)
    length = math.hypot(20.0, 44.0)
    assert areas['cobbles'] == pytest.approx(length * 4.0 - 6.0 * 4.0 / math.sin(ANGLE))
    both = (2 * 60.0 * 1.5 + 2 * length * 1.2
            - (2 * 1.5 * (4.0 + 2 * 1.2) + 2 * 1.2 * 6.0) / math.sin(ANGLE))
    assert areas['paving'] == pytest.approx(both)


def test_surfaces_lie_on_the_terrain(folder):
    """Follow each triangle of the terrain exactly, facing upwards, a little above it."""
    for one in paved(folder, HILLS, yaw=0.4).values():
        assert (across(one)[:, 2] > 0.0).all()
        shares = np.random.default_rng(0).dirichlet((1.0, 1.0, 1.0), len(one.faces))
        inside = np.einsum('fk,fkc->fc', shares, one.points[one.faces])
        lift = inside[:, 2] - HILLS.height(inside)
        np.testing.assert_allclose(lift, lift[0], atol=1e-5)
        assert 0.005 < lift[0] < 0.05
        normals = one.vertex_normals()
        assert (normals[:, 2] > 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


@pytest.mark.parametrize('old, new, message', [
    ('surface: asphalt', 'surface: asfalt', "cross.plan:3: surface is 'asfalt', it must be a"),
    ('surface: asphalt', 'surface: asfalt', 'did you mean asphalt'),
    ('surface: asphalt', 'surface: 3', 'such as asphalt, cobbles'),
    ('pavement: 1.5', 'pavement: -1', 'pavement is -1, it must be a number from 0 to 50'),
    ('pavement: 1.2', 'pavement_surface: 1.2', 'pavement_surface is 1.2')])
def test_slips_are_told(folder, old, new, message):
    """Name file, line, key and what is allowed."""
    (folder / 'cross.plan').write_text(PLAN.replace(old, new))
    with pytest.raises(SceneError) as told:
        read_plan(folder / 'cross.plan')
    assert message in str(told.value)


def test_too_fine_a_terrain_is_refused(folder):
    """Say how much may be covered, and what to do."""
    fine = Terrain(np.zeros((900, 900)), np.array([-45.0, -45.0]), 0.1)
    with pytest.raises(SceneError, match='terrain.cell larger'):
        paved(folder, fine)


def test_exports_have_the_surfaces(folder):
    """Hand them to every format that shows surfaces; a scene without them has none."""
    for surface, count in ((', surface: asphalt', 1), ('', 0)):
        (folder / 'cross.plan').write_text(
            'streets:\n  high: {from: [0, 0], to: [9, 0]' + surface + '}\n'
            'trees:\n  - {street: high, side: left, grammars: [pole.lsys]}\n')
        (folder / 'scene.yaml').write_text('/**:\n  ros__parameters:\n    scene: {objects: [s]}\n'
                                           '    s: {grammar: cross.plan, origin: [1, 2, 0]}\n')
        scene = Scene.from_yaml(folder / 'scene.yaml')
        found = [s for s in surfaces(Content.at_rest(scene)) if s.owner == 'paving']
        assert len(found) == len(scene.paving) == count
    (folder / 'cross.plan').write_text(PLAN)
    scene = Scene.from_yaml(folder / 'scene.yaml')
    middle = 0.5 * (scene.paving[0].points.min(axis=0) + scene.paving[0].points.max(axis=0))
    np.testing.assert_allclose(middle[:2], [1.0, 2.0], atol=1e-9)


HOUR, STORM = 3600.0, 50e-3 / 3600.0  # [s], [m/s]
TINY = 1e-9  # [-] rounding of slopes


def drawn_hills(seed, extent=64.0, **about):
    """Make hills up, worn or not."""
    about = {'noise': 8.0, 'wavelength': 40.0, **about}
    return make_terrain(TerrainSettings(seed=seed, extent=extent, **about), 0)


def drawn_ground(seed):
    """Draw the heights of a ground of some kind, and the edge of its cells [m]."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(2, 40, 2))
    x, y = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing='ij')
    grounds = [
        np.full(shape, -3.0),
        rng.uniform(0.0, rng.choice([0.1, 5.0, 40.0]), shape),
        np.where(rng.random(shape) < 0.02, 30.0, 0.0),
        np.where(rng.random(shape) < 0.02, -20.0, 0.0) + x,
        np.where(x > 0.1, 12.0, 100.0),
        8.0 * (x * x + y * y) + 4000.0,
        rng.uniform(-6.0, 6.0) * x + rng.uniform(-6.0, 6.0) * y,
        np.floor(4.0 * np.sin(5.0 * x) * np.cos(4.0 * y)),
    ]
    return grounds[seed % len(grounds)], float(rng.choice([0.1, 1.0, 30.0]))


def steepest(heights, edge):
    """Return the tangent of the steepest of all slopes between neighbours."""
    along = [heights[1:] - heights[:-1], heights[:, 1:] - heights[:, :-1]]
    across = [heights[1:, 1:] - heights[:-1, :-1], heights[1:, :-1] - heights[:-1, 1:]]
    return max(float(np.abs(drop).max(initial=0.0)) / length for drops, length in (
        (along, edge), (across, np.sqrt(2.0) * edge)) for drop in drops)


def streams(heights):
    """Find drainage down the steepest of eight ways."""
    return drain(heights, np.full(heights.shape, np.sqrt(2.0)))


def hack_exponent(heights):
    """Fit how lengths of longest streams grow with the areas that they drain."""
    # Means of classes that each double the area count, from 16 cells, where slopes end, to 1 % of
    # the grid, whose edge cuts larger basins.
    drainage = streams(heights)
    area, length = drained(drainage, corner_shares(heights.shape)), np.zeros(heights.size)
    for c in drainage.order[::-1]:
        r = drainage.receiver[c]
        length[r] = max(length[r], length[c] + drainage.way[c])
    within = (area >= 16.0) & (area <= 0.01 * heights.size)
    classes = np.floor(np.log2(area[within]))
    points = [[np.log(v[within][classes == k]).mean() for v in (area, length)]
              for k in np.unique(classes)]
    return float(np.polyfit(*np.transpose(points), 1)[0])


@pytest.mark.parametrize('seed', range(16))
def test_soil_is_conserved_and_no_slope_is_too_steep(seed):
    """Find on any ground what was there, less what streams took away; nothing gets steeper."""
    before, edge = drawn_ground(seed)
    name = sorted(SOILS)[seed % 3]
    rng = np.random.default_rng(seed)
    rain = Rain(STORM, HOUR * rng.choice([0.1, 30.0, 1e4]))
    eroded = erode(before, edge, rain, SOILS[name], rng)
    assert eroded.settled and np.isfinite(eroded.heights).all()
    moved = volume(np.abs(before - before.min()), edge)
    assert volume(eroded.heights - before, edge) == pytest.approx(
        -eroded.carried_off, abs=1e-9 * moved)
    assert eroded.carried_off >= 0.0
    assert steepest(eroded.heights, edge) <= np.tan(SOILS[name].repose) + TINY * np.ptp(before)
    assert before.min() - TINY <= eroded.heights.min()
    assert eroded.heights.max() <= before.max() + TINY


def test_volumes_are_those_below_the_triangles():
    """Hold the shares of corners to the surface that all else stands on."""
    terrain = drawn_hills(1, 12.0, cell=2.0)
    points, faces = terrain.mesh()
    corners = points[faces]
    across = corners[:, 1:, :2] - corners[:, :1, :2]
    areas = 0.5 * (across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0])
    assert volume(terrain.heights, 2.0) == pytest.approx(
        float((areas * corners[:, :, 2].mean(axis=1)).sum()))


def test_a_column_slides_into_a_cone():
    """End a slide of dry sand between the slopes at which it stops and starts; it is a cone."""
    ground, sand = np.zeros((61, 61)), SOILS['sand']
    ground[30, 30] = 3000.0
    slid = erode(ground, 1.0, Rain(0.0, 0.0), sand, np.random.default_rng(0))
    assert slid.carried_off == 0.0
    assert volume(slid.heights, 1.0) == pytest.approx(3000.0)
    tangent = np.tan(sand.repose - np.radians(1.0))
    assert slid.heights.max() == pytest.approx(
        np.cbrt(3.0 * 3000.0 * tangent * tangent / np.pi), rel=0.1)


def test_what_stands_less_steep_does_not_slide():
    """Leave a slope below the angle of repose as it is, when no rain falls."""
    ground = np.arange(20.0)[:, None] * np.tan(np.radians(32.0)) + np.zeros((20, 20))
    dry = erode(ground, 1.0, Rain(0.0, HOUR), SOILS['sand'], np.random.default_rng(0))
    np.testing.assert_array_equal(dry.heights, ground)


@pytest.mark.parametrize('settling', [0.0, 1.0])
def test_a_stream_wears_as_the_energy_that_it_spends(settling, monkeypatch):
    """Lower one corner over level ground as closed form says, halved where half falls back."""
    monkeypatch.setattr(erosion, '_PATCHES', 0.0)
    ground, edge, soil = np.zeros((3, 3)), 2.0, Soil(1e-6, settling, 1.0)
    ground[1, 1] = 1e-3
    rain = Rain(STORM, HOUR)
    eroded = erode(ground, edge, rain, soil, np.random.default_rng(0))
    discharge = STORM * edge * edge
    # Power per length over the width, 5 √Q: 9810 Q S / (5 √Q).
    rate = 1e-6 * 9810.0 * np.sqrt(discharge) / 5.0 / edge / (1.0 + settling)
    assert eroded.heights[1, 1] == pytest.approx(1e-3 * np.exp(-rate * HOUR), rel=1e-4)
    assert 1e-3 - eroded.heights[1, 1] > 1e-6


def test_water_fills_hollows_and_leaves_over_the_lowest_sill():
    """Drain a bowl over its gap; what is worn above settles in it, up to there at most."""
    ground = np.full((11, 11), 2.0)
    ground[2:9, 2:9] = 0.0
    ground[5, 9:] = 1.0
    drainage = streams(ground)
    surface = drainage.surface.reshape(11, 11)
    assert (surface[2:9, 2:9] == 1.0).all() and (surface[:2] == 2.0).all()
    area = drained(drainage, corner_shares(ground.shape)).reshape(11, 11)
    assert area[5, 10] > 49.0
    light = SOILS['loam']._replace(settling=0.0)  # falls out of still water only
    worn = erode(ground, 4.0, Rain(STORM, 20.0 * HOUR), light, np.random.default_rng(1)).heights
    rise = (worn - ground)[2:9, 2:9]
    assert rise.mean() > 0.1 and rise.min() >= 0.0 and worn[2:9, 2:9].max() <= 1.0 + TINY
    assert steepest(worn, 4.0) < np.tan(light.repose - np.radians(2.0))  # nothing slid


@pytest.mark.parametrize('seed', range(4))
def test_all_water_reaches_the_edge(seed):
    """Follow every corner's water to the edge; the areas that drain there are the whole grid."""
    worn = drawn_hills(seed, erosion=50.0).heights
    drainage = streams(worn)
    at = np.arange(worn.size)
    for _ in range(worn.size):
        then, at = at, drainage.receiver[at]
        if (then == at).all():
            break
    x, y = np.unravel_index(at, worn.shape)
    n = len(worn) - 1
    assert (np.isin(x, (0, n)) | np.isin(y, (0, n))).all()
    area = drained(drainage, corner_shares(worn.shape))
    assert area[np.unique(at)].sum() == pytest.approx(n * n)


@pytest.mark.report('nature')
@pytest.mark.parametrize('seed', range(2))
def test_streams_obey_hacks_law(seed, measured):
    """Grow networks whose streams lengthen with area as those of nature; hills are none."""
    about = {'noise': 8.0, 'wavelength': 70.0, 'extent': 256.0}
    measured.within("Hack's exponent of streams after 200 h of rain of 50 mm/h on loam "
                    '(Hack 1957; Rigon et al. 1996)',
                    hack_exponent(drawn_hills(seed, erosion=200.0, **about).heights), 0.5, 0.65)
    assert hack_exponent(drawn_hills(seed, **about).heights) < 0.4


def test_seeds_are_reproducible():
    """Wear a ground twice alike, and otherwise with another seed, be it from a file."""
    first, again = (drawn_hills(3, erosion=20.0).heights for _ in range(2))
    assert first.tobytes() == again.tobytes()
    ground = drawn_hills(3).heights
    worn = [erode(ground, 1.0, Rain(STORM, 20.0 * HOUR), SOILS['loam'],
                  np.random.default_rng(seed)).heights for seed in (1, 2)]
    assert np.abs(worn[0] - worn[1]).max() > 0.01


def test_more_hours_and_softer_soil_wear_more():
    """Order what is gone by hours, rain and soil."""
    ground = drawn_hills(2).heights

    def gone(rain=STORM, hours=10.0, soil='loam'):
        return erode(ground, 1.0, Rain(rain, hours * HOUR), SOILS[soil],
                     np.random.default_rng(1)).carried_off

    assert 0.0 < gone(hours=5.0) < gone() < gone(hours=20.0)
    assert gone(rain=0.5 * STORM) < gone()
    assert gone(soil='clay') < gone() < gone(soil='sand')


def test_the_edge_stays_and_the_lowest_point_is_zero():
    """Keep the level edge of made-up hills."""
    worn = drawn_hills(1, erosion=100.0).heights
    for side in (worn[0], worn[-1], worn[:, 0], worn[:, -1]):
        assert not side.any()
    assert worn.min() == 0.0 and worn.max() > 2.0


def test_heights_of_a_file_are_worn(tmp_path):
    """Wear a ridge from a file, from its lowest point on."""
    ridge = np.maximum(6.0 - np.abs(np.arange(-12.0, 13.0)), 0.0) + np.full((25, 25), 700.0)
    np.savez(tmp_path / 'a.npz', heights=ridge, cell=2.0)
    terrain = Scene.from_parameters(
        {'terrain': {'file': 'a.npz', 'erosion': 100.0, 'seed': 4}}, tmp_path).settings.terrain
    low, high = terrain.bounds()
    assert low == 0.0 and 3.0 < high <= 6.0


@pytest.mark.parametrize('about, said', [
    ({'erosion': 10.0}, 'terrain.file or terrain.noise'),
    ({'noise': 5.0, 'erosion': -1.0}, 'terrain.erosion is -1, it must be a number from 0 to 1'),
    ({'noise': 5.0, 'erosion': float('nan')}, 'terrain.erosion is nan'),
    ({'noise': 5.0, 'rain': 0.0}, 'terrain.rain is 0, it must be a number from 1 to 500 mm/h'),
    ({'noise': 5.0, 'soil': 'mud'}, 'it must be one of clay, loam, sand'),
    ({'noise': 500.0, 'wavelength': 150.0, 'extent': 160.0, 'erosion': 1.0},
     'loam stands at up to 38 degrees')])
def test_what_cannot_be_is_refused(about, said):
    """Name the key and what is allowed."""
    with pytest.raises(SceneError, match=said):
        Scene.from_parameters({'terrain': about})
