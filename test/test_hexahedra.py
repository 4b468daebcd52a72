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

"""Test solids with eight corners: mass, contacts, both engines, pictures, messages, exports."""

from dataclasses import replace
from types import SimpleNamespace

from building_checks import are_convex
from exported import scene_of, written
from lowest_points import lowest
from masonry_walls import blueprint as masonry
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from scipy.spatial.distance import cdist
from visualization_msgs.msg import Marker, MarkerArray

from procphys_ros import messages
from procphys_ros.appearance.mesh import solids as meshes
from procphys_ros.blueprint import Blueprint, box_inertia, chain, GROUND, Hexahedra, Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners, faces, inset, solids
from procphys_ros.physics.world import installed_engines, rigid_sum, World
from procphys_ros.wallgrammar.polygons import meet

DENSITY = 2000.0  # [kg/m³]


def trapezoid(bottom=0.3, top=0.2, height=0.2, width=0.15):
    """Return the corners of a stone that narrows upwards, its base on the ground, (1, 8, 3)."""
    unit = box_corners(np.array([[-0.5, -0.5, 0.0]]), np.array([[0.5, 0.5, 1.0]]))
    length = np.where(unit[..., 2] > 0.0, top, bottom)
    return np.stack([unit[..., 0] * length, unit[..., 1] * width, unit[..., 2] * height], axis=-1)


def stones(corners, **strengths):
    """Bond stones wherever they touch; return the blueprint."""
    made = solids(corners)
    patches = meet(corners, np.ones(len(corners), bool), 0.002)
    plan = masonry(made.poses[:, :3], made.size, patches.pair, patches.pose, patches.extent,
                   DENSITY, **strengths)
    mass = DENSITY * made.volume
    return replace(plan, mass=mass, inertia=DENSITY * made.inertia, poses=made.poses,
                   bond_area=patches.area,
                   hexahedra=Hexahedra(np.arange(len(corners), dtype=np.int32), made.corners))


def voussoirs(count, ratio, breadth=0.2):
    """Cut a semicircular ring of mean radius 1 m and thickness `ratio` into stones."""
    at = np.pi - np.arange(count + 1) * np.pi / count
    out = np.stack([np.cos(at), np.sin(at)], axis=-1)
    corners = np.empty((count, 8, 3))
    for corner in range(8):
        radius = 1.0 + ratio * (0.5 if corner & 4 else -0.5)
        corners[:, corner, [0, 2]] = radius * out[corner & 1:][:count]
        corners[:, corner, 1] = breadth * (0.5 if corner & 2 else -0.5)
    return corners


def test_two_halves_of_a_box_weigh_what_it_weighs():
    """Cut a box obliquely: mass, centre and inertia of both halves add up to its own."""
    low, high = np.zeros((1, 3)), np.array([[0.3, 0.2, 0.5]])
    halves = np.repeat(box_corners(low, high), 2, axis=0)
    cut = 0.05 + 0.3 * halves[0, :, 2] + 0.2 * halves[0, :, 1]  # x on the plane of the cut
    halves[0, :, 0] = np.where(halves[0, :, 0] > 0.0, cut, 0.0)
    halves[1, :, 0] = np.where(halves[1, :, 0] > 0.0, 0.3, cut)
    assert are_convex(halves).all()
    made = solids(halves)
    total = rigid_sum(DENSITY * made.volume, DENSITY * made.inertia, made.poses)
    np.testing.assert_allclose(total.mass, DENSITY * 0.03, rtol=1e-12)
    np.testing.assert_allclose(total.pose[:3], [0.15, 0.1, 0.25], atol=1e-12)
    np.testing.assert_allclose(np.sort(total.inertia), np.sort(box_inertia(
        np.array([DENSITY * 0.03]), high)[0]), rtol=1e-9)
    np.testing.assert_allclose(Hexahedra(np.arange(2), made.corners).points(made.poses), halves,
                               atol=1e-12)


def test_a_wedge_is_a_solid_with_coinciding_corners():
    """Let the top of a stone shrink to an edge: a prism on a triangle, by closed form."""
    wedge = trapezoid(0.3, 0.0, 0.2, 0.15)
    made = solids(wedge)
    assert are_convex(wedge).all()
    np.testing.assert_allclose(made.volume, 0.5 * 0.3 * 0.2 * 0.15)
    np.testing.assert_allclose(made.poses[0, :3], [0.0, 0.0, 0.2 / 3.0], atol=1e-12)
    across = 0.3 ** 2 / 24.0 + 0.2 ** 2 / 18.0  # of an isosceles triangle about its centroid
    np.testing.assert_allclose(made.inertia[0, 1] / made.volume[0], across, rtol=1e-9)
    bent = trapezoid()
    bent[0, 7] *= 0.8
    assert not are_convex(bent).any()


def test_faces_move_inwards():
    """Shrink a box and a wedge: every face lies deeper by what was asked for."""
    low, high = np.zeros((1, 3)), np.array([[0.3, 0.2, 0.5]])
    np.testing.assert_allclose(inset(box_corners(low, high), 0.01),
                               box_corners(low + 0.01, high - 0.01), atol=1e-12)
    wedge = trapezoid(0.3, 0.0)
    _, normal, middle = faces(wedge)
    _, _, moved = faces(inset(wedge, 0.01))
    depth = ((middle - moved) * normal).sum(axis=2)[np.linalg.norm(normal, axis=2) > 0.5]
    np.testing.assert_allclose(depth, 0.01, atol=1e-9)


def test_contact_polygons_have_their_own_moments():
    """Stack a turned stone on another: area and second moments of an octagon."""
    lower = box_corners(np.array([[-0.1, -0.1, 0.0]]), np.array([[0.1, 0.1, 0.2]]))
    turn = rotation.from_yaw(0.25 * np.pi)
    upper = rotation.rotate(turn, lower) + [0.0, 0.0, 0.201]
    found = meet(np.concatenate([lower, upper]), np.array([True, False]), 0.005)
    assert found.pair.tolist() == [[0, 1], [GROUND, 0]]
    octagon = 8.0 * (np.sqrt(2.0) - 1.0) * 0.1 ** 2  # of inradius 0.1 m
    np.testing.assert_allclose(found.area, [octagon, 0.04], rtol=1e-9)
    side = 0.2 * (np.sqrt(2.0) - 1.0)
    second = octagon / 48.0 * (12.0 * 0.1 ** 2 + side ** 2)  # regular polygon about any axis
    np.testing.assert_allclose(octagon * found.extent[0] ** 2 / 12.0, second, rtol=1e-9)
    np.testing.assert_allclose(found.pose[:, 2], [0.2005, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.gap, [0.001, 0.0], atol=1e-9)


@pytest.mark.parametrize('engine', installed_engines())
def test_engines_let_stones_rest_on_their_own_faces(engine):
    """Drop a trapezoid alone and two as one body; both come to rest with their base down."""
    corners = trapezoid()
    made = solids(corners)
    one = Hexahedra(np.zeros(1, np.int32), made.corners)
    mass, inertia = DENSITY * made.volume, DENSITY * made.inertia
    start = made.poses[0] + [0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.0]
    pair = start + np.array([[-0.16, 0, 0, 0, 0, 0, 0], [0.16, 0, 0, 0, 0, 0, 0]])
    both = rigid_sum(np.tile(mass, 2), np.tile(inertia, (2, 1)), pair)
    with World(engine=engine) as world:
        single = world.add_body(Shape.BOX, made.size[0], float(mass[0]), start,
                                inertia=inertia[0], hexahedra=one)
        double = world.add_fragment(
            np.full(2, Shape.BOX), np.tile(made.size, (2, 1)), both.local_poses, both.mass,
            both.inertia, both.pose + [3.0, 0, 0, 0, 0, 0, 0],
            hexahedra=Hexahedra(np.arange(2), np.tile(made.corners, (2, 1))))
        fixed = world.add_bricks(made.poses + [6.0, 0, 0, 0, 0, 0, 0], made.size, mass,
                                 hexahedra=one, inertia=inertia)
        world.thaw(fixed)
        for _ in range(90):
            world.step(1.0 / 60.0)
        saved = world.save_state()
        heights = world.poses(np.array([single, double, fixed[0]]))[:, 2]
        np.testing.assert_allclose(heights, made.poses[0, 2], atol=1.5e-4)
        assert lowest(world.pieces(double), world.poses(np.array([double]))[0]) == pytest.approx(
            0.0, abs=1.5e-4)
    with World.restore(saved, engine) as world:
        world.apply_impulse(single, np.array([2.0, 0.0, 0.0]))
        world.step(1.0 / 60.0)
        assert world.velocities(np.array([single]))[0, 0] > 0.0
        assert len(world.pieces(double).hexahedra) == 2


def test_blueprints_with_stones_are_chained():
    """Put stones behind a brick: their corners stay with them."""
    stone = stones(np.concatenate([trapezoid(), trapezoid() + [0.0, 0.0, 0.2]]))
    brick = replace(stone.placed((0, 0, 0)), hexahedra=Hexahedra())
    both = chain([brick, stone.placed((5.0, 0.0, 0.0), 0.5 * np.pi)])
    assert both.hexahedra.part.tolist() == [2, 3]
    assert isinstance(both, Blueprint)
    assert len(both.hexahedra.among(np.array([0, 3]))) == 1
    assert both.hexahedra.among(np.array([0, 3])).part.tolist() == [1]
    np.testing.assert_allclose(both.hexahedra.points(both.poses)[..., 0].max(), 5.075, atol=1e-9)


def arch():
    """Make a ring of twelve stones."""
    return stones(voussoirs(12, 0.15))


def shows_corners(points, plan):
    """Return whether points, (N, 3), are exactly the corners of all stones, to 10 µm."""
    away = cdist(points, plan.hexahedra.points(plan.poses).reshape(-1, 3))
    return max(away.min(axis=0).max(), away.min(axis=1).max()) < 1e-5


def test_meshes_and_markers_show_true_corners():
    """Draw stones by their corners, as a mesh and as a triangle list per part."""
    plan = arch()
    (rows, mesh), = meshes(plan, plan.poses, np.arange(12))
    assert rows.tolist() == list(range(12)) and len(mesh.triangles) == 12 * 12
    assert shows_corners(mesh.points, plan)
    owner = [SimpleNamespace(name='arch', first=0, count=12)]
    data = messages.SceneMarkers(plan, owner, 'map').whole(plan.poses, (1, 0))
    found = [m for m in deserialize_message(data, MarkerArray).markers if m.ns == 'arch']
    assert sorted(m.id for m in found) == list(range(12))
    seen = []
    for marker in found:
        assert marker.type == Marker.TRIANGLE_LIST and len(marker.points) == 36
        own = np.array([[p.x, p.y, p.z] for p in marker.points])
        place = marker.pose.position, marker.pose.orientation
        turn = np.array([getattr(place[1], c) for c in 'xyzw'])
        at = np.array([getattr(place[0], c) for c in 'xyz'])
        seen.append(at + rotation.rotate(turn, own))
    assert shows_corners(np.concatenate(seen), plan)


def test_exports_hold_the_stones(tmp_path):
    """Load MJCF and URDF: MuJoCo agrees on mass and bounds, PyBullet on bounds."""
    mujoco, pybullet = pytest.importorskip('mujoco'), pytest.importorskip('pybullet')
    scene = scene_of(arch=arch())
    path, content = written(scene, tmp_path / 'arch.xml')
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ids = [model.body(name).id for name in content.full_names]
    np.testing.assert_allclose(model.body_mass[ids], content.blueprint.mass, rtol=1e-6)
    np.testing.assert_allclose(data.xipos[ids], content.poses[:, :3], atol=1e-6)
    hulls = [model.body_geomadr[i] for i in ids]
    where = content.blueprint.hexahedra.points(content.poses)
    for hull, corners in zip(hulls, where):
        mesh = model.geom_dataid[hull]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        turn = data.geom_xmat[hull].reshape(3, 3)
        points = model.mesh_vert[first:first + count] @ turn.T + data.geom_xpos[hull]
        np.testing.assert_allclose(np.sort(points, axis=0), np.sort(corners, axis=0), atol=1e-5)
    path, _ = written(scene, tmp_path / 'arch.urdf')
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
    joints = range(pybullet.getNumJoints(body, physicsClientId=client))
    bounds = np.array([pybullet.getAABB(body, joint, physicsClientId=client)
                       for joint in joints]).reshape(-1, 2, 3)
    pybullet.disconnect(client)
    np.testing.assert_allclose(bounds[:, 0].min(axis=0), where.min(axis=(0, 1)), atol=0.05)
    np.testing.assert_allclose(bounds[:, 1].max(axis=0), where.max(axis=(0, 1)), atol=0.05)
