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

"""Ranges of a simulated lidar against closed forms, and against every ray with every part."""

import math

from masonry_walls import wall
import numpy as np
import pytest
import trimesh

from procphys_ros.blueprint import Shape
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.lidar import cast, GROUND, NOTHING, pinhole, spherical
from procphys_ros.scene import Scene
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.readings import FIRST_INTRUDER
from procphys_ros.simulation.spawned_parts import shards

AHEAD = [0.0, 0.0, 0.0, 1.0]
RING = spherical(1, 720, 0.01, 2.0 * math.pi)


def look(shape, size, pose, sensor=(0.0, 0.0, 5.0, *AHEAD), pattern=RING, reach=100.0):
    """Cast rays at one part."""
    return cast(pattern, np.array(sensor), reach, np.array([shape]), np.array([pose], float),
                np.array([size], float))


def test_a_wall_is_as_far_as_the_secant_says():
    """Stand 4 m before a wall: the range over the cosine of the azimuth, and nothing beside it."""
    ranges, hit = look(Shape.BOX, (2.0, 6.0, 4.0), (5.0, 0.0, 5.0, *AHEAD))
    azimuth = np.arctan2(RING.directions[0, :, 1], RING.directions[0, :, 0])
    seen = np.abs(4.0 * np.tan(azimuth)) < 3.0
    seen &= np.abs(azimuth) < 0.5 * math.pi
    np.testing.assert_array_equal(hit[0] == 0, seen)
    np.testing.assert_allclose(ranges[0, seen], 4.0 / np.cos(azimuth[seen]))
    assert np.isinf(ranges[0, ~seen]).all() and (hit[0, ~seen] == NOTHING).all()


def test_a_trunk_is_met_as_a_circle():
    """See a long upright capsule as the chord of a circle in the plane."""
    radius, distance = 0.25, 3.0
    ranges, hit = look(Shape.CAPSULE, (2 * radius, 2 * radius, 8.0), (0.0, distance, 5.0, *AHEAD))
    azimuth = np.arctan2(RING.directions[0, :, 1], RING.directions[0, :, 0]) - 0.5 * math.pi
    chord = radius ** 2 - (distance * np.sin(azimuth)) ** 2
    seen = (chord > 0.0) & (np.cos(azimuth) > 0.0)
    np.testing.assert_array_equal(hit[0] == 0, seen)
    np.testing.assert_allclose(ranges[0, seen],
                               distance * np.cos(azimuth[seen]) - np.sqrt(chord[seen]))


def test_a_ball_fills_its_solid_angle():
    """Count the rays of a camera that meet a ball; the middle one meets it first."""
    camera = pinhole(401, 401, 1.0, 1.0)
    ranges, hit = look(Shape.CAPSULE, (2.0, 2.0, 2.0), (10.0, 0.0, 5.0, *AHEAD), pattern=camera)
    assert ranges[200, 200] == pytest.approx(9.0)
    across = (2.0 * math.tan(0.5) / 401) ** 2  # of a ray, in the plane 1 m ahead
    disc = math.pi / (10.0 ** 2 - 1.0)  # the shadow of the ball there
    assert across * np.count_nonzero(hit == 0) == pytest.approx(disc, rel=5e-3)


def test_the_ground_is_met_below_the_horizon_up_to_the_reach():
    """Divide the height by the sine of the depression, up to the longest range."""
    pattern = spherical(90, 4, math.pi / 2.0, 2.0 * math.pi)
    ranges, hit = cast(pattern, np.array([3.0, 2.0, 2.0, *AHEAD]), 20.0, np.zeros(0, np.uint8),
                       np.zeros((0, 7)), np.zeros((0, 3)))
    down = -pattern.directions[..., 2]
    seen = down > 2.0 / 20.0
    np.testing.assert_array_equal(hit == GROUND, seen)
    np.testing.assert_allclose(ranges[seen], 2.0 / down[seen])
    assert np.isinf(ranges[~seen]).all()


def test_the_nearer_of_two_is_seen_and_what_holds_the_sensor_is_not():
    """Hide a ball behind a box; a box around the sensor is looked through."""
    shapes = np.array([Shape.CAPSULE, Shape.BOX, Shape.BOX])
    poses = np.array([[6.0, 0, 5, *AHEAD], [3.0, 0, 5, *AHEAD], [0.0, 0, 5, *AHEAD]])
    sizes = np.array([[2.0, 2, 2], [0.2, 0.5, 0.5], [1.0, 1, 1]])
    ranges, hit = cast(RING, np.array([0.0, 0, 5, *AHEAD]), 50.0, shapes, poses, sizes)
    middle = np.argmax(RING.directions[0, :, 0])
    assert hit[0, middle] == 1 and ranges[0, middle] == pytest.approx(2.9, abs=1e-3)
    assert set(np.unique(hit)) == {NOTHING, 0, 1}


def every_ray_with_every_part(pattern, sensor, shapes, poses, sizes):
    """Walk along each ray in small steps to the surface of each part; slow, but plain."""
    directions = rotation.rotate(sensor[3:], pattern.directions.reshape(-1, 3))
    best = np.full(len(directions), np.inf)
    for shape, pose, size in zip(shapes, poses, sizes):
        inverse = rotation.conjugate(pose[3:])
        start = rotation.rotate(inverse, sensor[:3] - pose[:3])
        course = rotation.rotate(inverse, directions)
        far = np.zeros(len(directions))
        for _ in range(200):  # sphere tracing: as far as the surface is away, none can be missed
            far += gap(shape, size, start + far[:, None] * course)
        met = gap(shape, size, start + far[:, None] * course) < 1e-6
        best = np.where(met, np.minimum(best, far), best)
    return best.reshape(pattern.directions.shape[:2])


def gap(shape, size, points):
    """Compute the distance of points from the surface of a part in its own frame."""
    if shape == Shape.BOX:
        return np.linalg.norm(np.maximum(np.abs(points) - 0.5 * size, 0.0), axis=1)
    straight = max(0.5 * (size[2] - size[0]), 0.0)
    end = points.copy()
    end[:, 2] -= np.clip(end[:, 2], -straight, straight)
    return np.linalg.norm(end, axis=1) - 0.5 * size[0]


@pytest.mark.parametrize('pattern', [spherical(16, 40, 2.4, 2.0 * math.pi),
                                     pinhole(20, 24, 1.8, 2.2)], ids=['round', 'camera'])
def test_no_ray_misses_a_part(pattern):
    """Put turned parts everywhere, also overhead, behind and close by, and check each ray."""
    rng = np.random.default_rng(5)
    count = 40
    shapes = rng.choice([Shape.BOX, Shape.CAPSULE], count).astype(np.uint8)
    poses = np.concatenate([rng.uniform(-6.0, 6.0, (count, 3)), rng.normal(size=(count, 4))], 1)
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    poses[:, 2] += 50.0
    sizes = rng.uniform(0.2, 3.0, (count, 3))
    round_ = shapes == Shape.CAPSULE
    sizes[round_, 1] = sizes[round_, 0]
    sizes[round_, 2] = np.maximum(sizes[round_, 2], sizes[round_, 0])
    sensor = np.array([0.0, 0.0, 50.0, *rotation.from_axis_angle(
        np.array([0.6, 0.0, 0.8]), np.asarray(2.0))])
    outside = np.array([gap(shape, size, rotation.rotate(
        rotation.conjugate(pose[3:]), (sensor - pose)[None, :3]))[0] > 0.3
        for shape, size, pose in zip(shapes, sizes, poses)])
    shapes, poses, sizes = shapes[outside], poses[outside], sizes[outside]
    expected = every_ray_with_every_part(pattern, sensor, shapes, poses, sizes)
    ranges, hit = cast(pattern, sensor, 1000.0, shapes, poses, sizes)
    ranges = np.where(hit == GROUND, np.inf, ranges)
    both = np.isfinite(expected) & np.isfinite(ranges)
    grazing = np.isfinite(expected) != np.isfinite(ranges)  # tracing crawls along a surface
    assert np.count_nonzero(both) > 100 and np.count_nonzero(grazing) <= 2
    close = np.abs(expected[both] - ranges[both]) < 1e-3
    assert np.count_nonzero(~close) <= 2


def test_cut_stones_are_seen_as_they_are():
    """Cut up stones, and take most pieces out: rays meet the hulls of the others, not boxes."""
    rng, scene = np.random.default_rng(7), Scene()
    for number in range(5):
        pose = np.array([*rng.uniform(-2.0, 2.0, 2), rng.uniform(1.5, 4.0), *rng.normal(size=4)])
        pose[3:] /= np.linalg.norm(pose[3:])
        scene.add(shards(rng.uniform(0.8, 1.6, 3), 2000.0, pose, 'brick', 'brick', 0, rng),
                  (0.0, 0.0, 0.0), 0.0, f'stone_{number}')
    simulation = Simulation(scene)
    gone = rng.random(len(simulation.blueprint)) < 0.6
    simulation.state.parts.owner[gone] = Owner.GONE
    scan = simulation.scan(LidarSettings(rows=24, columns=60, vertical_field=1.0,
                                         horizontal_field=1.0, position=(-5.0, 0.2, 2.5)))
    wanted = np.where(scan.parts < 0, scan.ranges, np.inf).ravel()
    way = rotation.rotate(scan.pose[3:], scan.directions.reshape(-1, 3))
    for points in simulation.blueprint.hexahedra.points(simulation.poses)[~gone]:
        met, ray, _ = trimesh.convex.convex_hull(points).ray.intersects_location(
            np.tile(scan.pose[:3], (len(way), 1)), way)
        np.minimum.at(wanted, ray, np.linalg.norm(met - scan.pose[:3], axis=1))
    assert np.count_nonzero(scan.parts >= 0) > 100
    np.testing.assert_allclose(scan.ranges.ravel(), wanted, rtol=1e-9)


def test_a_scene_is_seen_as_it_is_now():
    """Name the parts that are hit; a ball that is launched is seen, a removed wall is not."""
    scene = Scene()
    scene.add(wall(8, 10), (4.0, -1.0, 0.0), math.pi / 2.0, 'wall')
    scene.add(LSystem.parse('axiom: Width(0.2) F(3)').build(), (-3.0, 0.0, 0.0), 0.0, 'post')
    simulation = Simulation(scene)
    lidar = LidarSettings(rows=16, columns=360, position=(0.0, 0.0, 0.5), range=30.0)
    scan = simulation.scan(lidar)
    parts = np.unique(scan.parts[scan.parts >= 0])
    names = {simulation.names.name(part).partition('/')[0] for part in parts.tolist()}
    assert names == {'wall', 'post'}
    points = scan.points(in_world=True)
    on_wall = (scan.parts >= 0) & (points[..., 0] > 0.0)
    assert np.ptp(points[on_wall][:, 0]) < 0.2
    ahead = ((scan.directions[..., 0] > 0.98) & (scan.directions[..., 2] < 0.04)
             & (scan.directions[..., 2] > -0.1))
    assert np.count_nonzero(ahead) > 20 and on_wall[ahead].all()  # none slips through a joint
    np.testing.assert_allclose(np.linalg.norm(scan.points(in_world=False), axis=-1)[on_wall],
                               scan.ranges[on_wall])
    assert np.isnan(points[np.isinf(scan.ranges)]).all()
    simulation.remove('wall')
    ball = simulation.launch(Projectile('sphere', 0.5, 1.0, (0.0, 3.0, 0.8), (0.0, 0.0, 0.0)))
    again = simulation.scan(lidar)
    assert ball in again.parts and not np.isin(again.parts, scan.parts[on_wall]).any()


def test_a_sensor_rides_on_an_intruder_and_does_not_see_it():
    """Attach it: no scan before the intruder is there, then one from where it has been driven."""
    scene = Scene.from_parameters({'scene': {'objects': []}})
    scene.add(wall(8, 10), (4.0, -1.0, 0.0), math.pi / 2.0, 'wall')
    simulation = Simulation(scene)
    riding = LidarSettings(rows=1, columns=5, position=(0.0, 0.0, 0.3), attached_to='intruder')
    assert simulation.scan(riding) is None
    simulation.place_intruder((1.0, -0.4, 0.1, *rotation.from_yaw(0.0)))
    simulation.step()
    scan = simulation.scan(riding)
    np.testing.assert_allclose(scan.pose[:3], [1.0, -0.4, 0.4], atol=1e-6)
    assert (scan.parts != FIRST_INTRUDER).all() and (scan.parts >= 0).any()
    standing = LidarSettings(rows=1, columns=1, position=(-2.0, -0.4, 0.3), horizontal_field=0.1)
    scan = simulation.scan(standing)
    assert scan.parts.tolist() == [[FIRST_INTRUDER]] and scan.ranges[0, 0] == pytest.approx(2.5)
    with pytest.raises(CommandError, match='"intrude"; did you mean intruder'):
        simulation.scan(LidarSettings(attached_to='intrude'))


@pytest.mark.parametrize('values', [
    {'rows': 0}, {'pattern': 'round'}, {'horizontal_field': 7.0}, {'rate': -1.0},
    {'pattern': 'pinhole', 'horizontal_field': 3.1}, {'rows': 4096, 'columns': 4096}])
def test_settings_that_make_no_sense_are_refused(values):
    """Name the key and what is allowed."""
    with pytest.raises(SceneError, match='lidar'):
        LidarSettings(**values)
