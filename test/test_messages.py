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
"""Messages and transforms: bytes that ROS reads back, and the mesh that viewers load."""

from dataclasses import replace
import struct
import sys
from types import SimpleNamespace
from xml.etree import ElementTree

from geometry_msgs.msg import PoseArray, TransformStamped
from grown_trees import beam
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from procphys_ros import messages
from procphys_ros.appearance.palette import look
from procphys_ros.blueprint import Blueprint, Leaves, Ornaments, Shape
from procphys_ros.files.resources import PACKAGE, shared_folder
from procphys_ros.geometry.rotation import compose, rotate
from procphys_ros.messages.transforms import TransformMessage
from procphys_ros.ros import qos
from procphys_ros.ros.transforms import frames, TransformPublisher
from procphys_ros.scene.parameter_table import GLOBAL

AT = (12, 345_678_900)
FRAMES = ['', 'w', 'ma', 'map', 'odom', 'world', 'a/very/long/frame_id', 'wörld']


def random_poses(count: int, seed: int = 0) -> np.ndarray:
    """Draw poses with unit quaternions."""
    rng = np.random.default_rng(seed)
    poses = rng.normal(size=(count, 7)) * 10
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return poses


def mixed_blueprint(segments: int = 5, bricks: int = 4) -> Blueprint:
    """Make capsules and boxes without bonds, with leaves and ornaments on some of them."""
    count = segments + bricks
    rng = np.random.default_rng(1)
    shape = np.repeat([Shape.CAPSULE, Shape.BOX], [segments, bricks]).astype(np.uint8)
    part = np.array([0, 2, 2, 3], np.int32)[:max(0, segments)]
    return Blueprint(
        shape=shape, size=rng.uniform(0.1, 1, (count, 3)),
        visual_size=rng.uniform(0.1, 1, (count, 3)), density=np.full(count, 800.0),
        mass=rng.uniform(1, 2, count), inertia=np.ones((count, 3)),
        poses=random_poses(count), kind=shape.astype(np.int16),
        material=shape.astype(np.int16), texture=shape.astype(np.int16),
        leaf_area=np.zeros(count),
        leaves=Leaves(part, random_poses(len(part), 3), np.full(len(part), 0.2),
                      np.array([2, 2, 3, 2], np.int16)[:len(part)]),
        ornaments=Ornaments(np.array([1], np.int32), rng.normal(size=(1, 9)),
                            np.array([3], np.int16)),
        kinds=('segment', 'brick'), materials=('wood', 'clay'),
        textures=('bark_oak', 'brick_red', 'leaf_oak', 'flower'))


def objects_of(*named: tuple[str, int, int]) -> list[SimpleNamespace]:
    """Make owners from name, first part and count."""
    return [SimpleNamespace(name=n, first=f, count=c) for n, f, c in named]


def read_markers(data: bytes) -> dict[tuple[str, int], Marker]:
    """Read a MarkerArray by namespace and id, and check that no key comes twice."""
    markers = deserialize_message(data, MarkerArray).markers
    found = {(m.ns, m.id): m for m in markers if m.action != Marker.DELETEALL}
    assert len(found) == sum(m.action != Marker.DELETEALL for m in markers)
    return found


def pose_of(message) -> list[float]:
    """Read a pose as seven numbers."""
    p, q = message.position, message.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


@pytest.mark.parametrize('frame', FRAMES)
@pytest.mark.parametrize('count', [0, 1, 17])
def test_pose_array_is_read_back(frame, count):
    """Read every field of a PoseArray back, whatever the alignment of its frame_id."""
    poses = random_poses(count)
    message = deserialize_message(messages.pose_array(poses, AT, frame), PoseArray)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == AT
    assert message.header.frame_id == frame
    np.testing.assert_array_equal(np.array([pose_of(p) for p in message.poses]).reshape(-1, 7),
                                  poses)


@pytest.mark.parametrize('frame', FRAMES)
def test_pose_array_has_the_length_that_ros_gives_it(frame):
    """Leave nothing behind the last pose: the length equals that of ROS' own serialisation."""
    data = messages.pose_array(random_poses(3), AT, frame)
    assert len(data) == len(serialize_message(deserialize_message(data, PoseArray)))


@pytest.mark.parametrize('frame', FRAMES)
@pytest.mark.parametrize('names', [('oak', 'wall'), ('a', 'bcdef'), ('trèe_12', 'x' * 40)])
def test_whole_marker_set_is_read_back(frame, names):
    """Read back markers of parts and leaves for namespaces of several lengths."""
    blueprint = mixed_blueprint()
    scene = messages.SceneMarkers(blueprint, objects_of((names[0], 0, 5), (names[1], 5, 4)),
                                  frame)
    data = scene.whole(blueprint.poses, AT)
    assert deserialize_message(data, MarkerArray).markers[0].action == Marker.DELETEALL
    found = read_markers(data)
    assert len(found) == 9 + 2
    for part in range(9):
        marker = found[names[part >= 5], part]
        assert marker.header.frame_id == frame
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == AT
        assert marker.action == Marker.ADD
        assert marker.type == (Marker.CYLINDER if part < 5 else Marker.CUBE)
        np.testing.assert_array_equal(pose_of(marker.pose), blueprint.poses[part])
        size = blueprint.visual_size[part].copy()
        if part < 5:
            size[:2] = size[:2].mean()
        np.testing.assert_array_equal([marker.scale.x, marker.scale.y, marker.scale.z], size)
        assert marker.color.a == 1.0
        assert not marker.points and not marker.mesh_resource and not marker.text.strip()
        assert marker.lifetime.sec == marker.lifetime.nanosec == 0


def test_leaves_and_ornaments_ride_on_their_parts():
    """Place corners by the poses of the parts, one marker per texture."""
    blueprint = mixed_blueprint()
    scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 9)), 'world')
    poses = random_poses(9, seed=5)
    found = read_markers(scene.whole(poses, AT))
    oak, flower = found['oak/leaves', 2], found['oak/leaves', 3]
    assert oak.type == flower.type == Marker.TRIANGLE_LIST
    assert len(oak.points) == 3 * 6 and len(flower.points) == 6 + 3
    assert oak.color.g == pytest.approx(look('leaf_oak').rgba[1])
    petiole = compose(poses[0], blueprint.leaves.pose[0])
    corners = np.array([[p.x, p.y, p.z] for p in oak.points])
    np.testing.assert_allclose(corners[[0, 3]], [petiole[:3]] * 2, atol=1e-12)
    tip = petiole[:3] + rotate(petiole[3:], [0, 0, 0.2])
    np.testing.assert_allclose(corners[[1, 2]].mean(axis=0), tip, atol=1e-12)
    triangle = blueprint.ornaments.triangle.reshape(3, 3)
    expected = poses[1, :3] + rotate(poses[1, 3:], triangle)
    np.testing.assert_allclose([[p.x, p.y, p.z] for p in flower.points[6:]], expected,
                               atol=1e-12)


def test_too_many_leaves_are_drawn_by_fewer_and_larger_ones():
    """Leave the twigs out first, then leaves, and keep the area of green."""
    blueprint = mixed_blueprint()
    alike = replace(blueprint.leaves, texture=np.full(4, 2, np.int16))
    blueprint = replace(blueprint, leaves=alike)
    areas, corners = [], []
    for most in (9, 8, 4):
        scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 9)), 'world',
                                      messages.MarkerStyle(most))
        found = read_markers(scene.whole(blueprint.poses, AT))
        points = np.array([[p.x, p.y, p.z] for p in found['oak/leaves', 2].points])
        a, b, c = points.reshape(-1, 3, 3).swapaxes(0, 1)
        areas.append(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        corners.append(len(points))
        assert (('oak/leaves', 3) in found) == (most == 9)
    assert corners == [24, 24, 12]
    np.testing.assert_allclose(areas, areas[0])


def test_only_what_moved_is_sent_again():
    """Send nothing for what stands still, and a moved part with the leaves on it."""
    blueprint = mixed_blueprint()
    scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 5), ('wall', 5, 4)), 'world')
    poses = blueprint.poses.copy()
    scene.whole(poses, AT)
    assert scene.changes(poses, AT) is None
    poses[7, 0] += 0.01
    assert set(read_markers(scene.changes(poses, AT))) == {('wall', 7)}
    poses[3, 2] += 0.01
    assert set(read_markers(scene.changes(poses, AT))) == {('oak', 3), ('oak/leaves', 2)}
    assert scene.changes(poses, AT) is None


def test_leaves_of_what_is_gone_shrink_to_a_point():
    """Leave no twigs in the air, or where the scene begins, when their part has vanished."""
    blueprint = mixed_blueprint()
    blueprint = replace(blueprint, ornaments=Ornaments(
        np.array([1, 4], np.int32), np.ones((2, 9)), np.array([3, 3], np.int16)))
    scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 9)), 'world',
                                  messages.MarkerStyle(most_triangles=10))
    scene.whole(blueprint.poses, AT)
    poses = blueprint.poses.copy()
    poses[1] = np.nan
    found = read_markers(scene.changes(poses, AT))
    points = np.array([[p.x, p.y, p.z] for p in found['oak/leaves', 3].points])
    gone = ~points.reshape(-1, 3, 3).any(axis=(1, 2))
    assert found['oak/leaves', 3].action == Marker.ADD and gone.sum() == 1 < len(gone)


@pytest.mark.parametrize('most', [40_000, 6])  # leaves one by one, and few large ones
@pytest.mark.parametrize('shard', ['', 'shard_1'])
@pytest.mark.parametrize('write', ['changes', 'whole'])
def test_leaves_of_an_object_that_is_gone_are_deleted(most, shard, write):
    """Delete what rides on nothing but vanished parts, once, and show it when they return."""
    blueprint = mixed_blueprint()
    owners = objects_of(('ash', 0, 3), ('oak', 3, 6))
    scene = messages.SceneMarkers(blueprint, owners, 'world',
                                  messages.MarkerStyle(most, shard=shard))
    crowns = {key for key in read_markers(scene.whole(blueprint.poses, AT)) if '/' in key[0]}
    felled = {key for key in crowns if key[0] == 'oak/leaves'}
    assert felled and felled < crowns
    poses = blueprint.poses.copy()
    poses[3:] = np.nan
    found = read_markers(getattr(scene, write)(poses, AT))
    assert {key for key in found if key[0] == 'oak/leaves'} == felled
    assert {found[key].action for key in felled} == {Marker.DELETE}
    assert scene.changes(poses, AT) is None
    left = {key for key in read_markers(scene.whole(poses, AT)) if '/' in key[0]}
    assert left == crowns - felled
    back = read_markers(scene.changes(blueprint.poses, AT))
    assert {back[key].action for key in felled} == {Marker.ADD}


@pytest.mark.parametrize('chosen', [[0], [2], [0, 2], [1, 2, 3], [0, 1, 2, 3]])
def test_leaves_are_told_of_the_trees_that_moved_and_no_others(chosen):
    """Read back any choice of markers from the block that holds them all."""
    blueprint = mixed_blueprint()
    leaves = replace(blueprint.leaves, part=np.arange(4, dtype=np.int32),
                     texture=np.array([2, 3, 2, 2], np.int16))
    blueprint = replace(blueprint, leaves=leaves, ornaments=Ornaments())
    owners = objects_of(('a', 0, 1), ('bc', 1, 1), ('d', 2, 1), ('e', 3, 6))
    scene = messages.SceneMarkers(blueprint, owners, 'world')
    scene.whole(blueprint.poses, AT)
    poses = blueprint.poses.copy()
    poses[chosen, 0] += 5.0
    later = AT[0] + 1, 7
    markers = {key: marker for key, marker in read_markers(scene.changes(poses, later)).items()
               if '/' in key[0]}
    assert list(markers) == [(f'{owners[k].name}/leaves', leaves.texture[k]) for k in chosen]
    for part, marker in zip(chosen, markers.values()):
        petiole = compose(poses[part], leaves.pose[part])
        corners = np.array([[p.x, p.y, p.z] for p in marker.points])
        np.testing.assert_allclose(corners[[0, 3]], [petiole[:3]] * 2, atol=1e-12)
        assert (marker.header.stamp.sec, marker.header.stamp.nanosec) == later


def test_slow_creep_is_not_lost():
    """Compare with what was sent, so that many small moves add up to one that is sent."""
    blueprint = mixed_blueprint()
    scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 9)), 'world')
    poses = blueprint.poses.copy()
    scene.whole(poses, AT)
    sent = 0
    for _ in range(100):
        poses[8, 1] += 1e-5
        sent += scene.changes(poses, AT) is not None
    assert 5 <= sent <= 10


def test_vanished_part_is_deleted_once_and_can_return():
    """Delete the marker of a part without a pose; add it again when it has one."""
    blueprint = mixed_blueprint()
    scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 9)), 'world')
    poses = blueprint.poses.copy()
    scene.whole(poses, AT)
    poses[6] = np.nan
    gone = read_markers(scene.changes(poses, AT))
    assert gone.keys() == {('oak', 6)} and gone['oak', 6].action == Marker.DELETE
    assert scene.changes(poses, AT) is None
    assert len(read_markers(scene.whole(poses, AT))) == 8 + 2
    poses[6] = blueprint.poses[6]
    assert read_markers(scene.changes(poses, AT))['oak', 6].action == Marker.ADD


def test_whole_set_deletes_what_has_just_vanished():
    """Leave no ghosts in a view that several scenes share, and that none of them may clear."""
    blueprint = mixed_blueprint()
    scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 9)), 'world',
                                  messages.MarkerStyle(shard='shard_1'))
    poses = blueprint.poses.copy()
    scene.whole(poses, AT)
    poses[6] = np.nan
    found = read_markers(scene.whole(poses, AT))
    assert [key for key, marker in found.items() if marker.action == Marker.DELETE] == [('oak', 6)]
    assert len(found) == 9 + 2
    assert len(read_markers(scene.whole(poses, AT))) == 8 + 2


@pytest.mark.parametrize('frame', FRAMES)
@pytest.mark.parametrize('count', [0, 1, 5])
def test_breaks_are_read_back(frame, count):
    """Read a PointCloud2 of break events back, data and description."""
    events = np.zeros(count, [('time', 'f8'), ('position', 'f8', 3), ('bond', 'i4'),
                              ('part_a', 'i4'), ('part_b', 'i4'), ('cause', 'u1'),
                              ('load', 'f4'), ('crack', 'u1')])
    events['position'] = np.arange(3 * count).reshape(-1, 3)
    events['bond'], events['part_a'] = np.arange(count) + 7, -1
    events['cause'], events['load'], events['crack'] = 3, 1.25, 1
    rows = messages.break_rows(events)
    message = deserialize_message(messages.point_cloud(rows, AT, frame), PointCloud2)
    assert message.header.frame_id == frame and message.is_dense and not message.is_bigendian
    assert (message.height, message.width) == (1, count)
    assert [f.name for f in message.fields] == ['x', 'y', 'z', 'bond', 'part_a', 'part_b',
                                                'cause', 'load', 'crack']
    assert message.row_step == message.point_step * count == len(message.data)
    layout = np.dtype({'names': [f.name for f in message.fields],
                       'formats': ['f4', 'f4', 'f4', 'i4', 'i4', 'i4', 'u4', 'f4', 'u4'],
                       'offsets': [f.offset for f in message.fields],
                       'itemsize': message.point_step})
    assert [f.datatype for f in message.fields] == [7, 7, 7, 5, 5, 5, 6, 7, 6]
    np.testing.assert_array_equal(np.frombuffer(bytes(message.data), layout), rows)
    assert np.all(rows['part_a'] == -1) and np.all(rows['y'] == np.arange(count) * 3 + 1)


def test_leaves_are_drawn_where_they_are():
    """Follow the pose of a leaf that moves by itself, and draw no other anew."""
    blueprint = replace(mixed_blueprint(), ornaments=Ornaments())
    scene = messages.SceneMarkers(blueprint, objects_of(('oak', 0, 9)), 'world')
    assert scene.shows_leaf_poses
    leaves = random_poses(4, seed=9)
    scene.whole(blueprint.poses, AT, leaves)
    assert scene.changes(blueprint.poses, AT, leaves) is None
    leaves[2, :3] = 1.0, 2.0, 3.0  # the only one with texture 3
    found = read_markers(scene.changes(blueprint.poses, AT, leaves))
    assert found.keys() == {('oak/leaves', 3)}
    corners = np.array([[p.x, p.y, p.z] for p in found['oak/leaves', 3].points])
    np.testing.assert_allclose(corners[[0, 3]], [[1.0, 2.0, 3.0]] * 2, atol=1e-12)


def test_ball_is_a_sphere_without_a_skin():
    """Draw a launched ball by the marker made for it, not by its triangles."""
    blueprint = replace(mixed_blueprint(), kinds=('projectile', 'brick'), leaves=Leaves())
    scene = messages.SceneMarkers(blueprint, objects_of(('shot', 0, 9)), 'world')
    found = read_markers(scene.whole(blueprint.poses, AT))
    assert len(found) == 9
    marker = found['shot', 1]
    assert marker.type == Marker.SPHERE
    np.testing.assert_array_equal([marker.scale.x, marker.scale.y, marker.scale.z],
                                  blueprint.size[1])


@pytest.mark.parametrize('name', ['dust', 'torn_wood'])
def test_no_object_shares_markers_with_dust_and_torn_wood(name):
    """Write each marker once, whatever objects are called."""
    tree = beam(5)
    scene = messages.SceneMarkers(tree, objects_of((name, 0, 5)), 'world')
    poses = tree.poses.copy()
    poses[:, 2] += np.array([1.0, 1.0, 2.0, 2.0, 2.0])
    puff = SimpleNamespace(positions=np.zeros((1, 3)), sizes=np.array([0.2]),
                           opacity=np.array([0.5]))
    found = [read_markers(scene.whole(poses, AT, None, puff)) for _ in range(12)][-1]
    assert {number for space, number in found if space == name} == {0, 1, 2, 3, 4}
    assert len(found) > 6


def test_dust_is_read_back():
    """Read puffs back as a PointCloud2."""
    rows = messages.dust_rows(SimpleNamespace(
        positions=np.arange(6.0).reshape(2, 3), sizes=np.array([0.1, 0.2]),
        opacity=np.array([0.5, 0.6])))
    message = deserialize_message(messages.point_cloud(rows, AT, 'world'), PointCloud2)
    assert [f.name for f in message.fields] == ['x', 'y', 'z', 'size', 'opacity']
    table = np.frombuffer(bytes(message.data), np.float32).reshape(2, 5)
    np.testing.assert_allclose(table, [[0, 1, 2, 0.1, 0.5], [3, 4, 5, 0.2, 0.6]], rtol=1e-6)


@pytest.mark.parametrize(('time', 'expected'), [
    (0.0, (0, 0)), (1.5, (1, 500_000_000)), (2.9999999999, (3, 0)), (1e-9, (0, 1))])
def test_stamp_never_reaches_a_whole_second(time, expected):
    """Split times so that nanoseconds stay below one second."""
    assert messages.stamp(time) == expected


_SPACE = '{http://www.collada.org/2005/11/COLLADASchema}'


def _mesh():
    default = next(p.default for p in GLOBAL if p.name == 'marker_mesh')
    path = shared_folder() / default.removeprefix(f'package://{PACKAGE}/')
    return path, ElementTree.parse(path)


def _array(tree, name):
    element = next(e for e in tree.iter(f'{_SPACE}float_array') if e.get('id') == name)
    values = np.array(element.text.split(), float)
    assert len(values) == int(element.get('count'))
    return values.reshape(-1, 3)


def test_the_default_mesh_is_shipped_with_its_image():
    """Find the mesh that the parameter names, and the image that the mesh names."""
    path, tree = _mesh()
    image = tree.find(f'.//{_SPACE}image/{_SPACE}init_from').text
    assert (path.parent / image).read_bytes().startswith(b'\x89PNG')


def test_the_mesh_is_a_unit_cube_seen_from_outside():
    """Markers scale it to the brick: it spans one metre, its triangles face outwards."""
    _, tree = _mesh()
    points, normals = _array(tree, 'cube_positions_array'), _array(tree, 'cube_normals_array')
    assert np.all(points.min(axis=0) == -0.5) and np.all(points.max(axis=0) == 0.5)
    corners = np.array(tree.find(f'.//{_SPACE}triangles/{_SPACE}p').text.split(), int)
    corners = corners.reshape(12, 3, 3)
    a, b, c = np.moveaxis(points[corners[:, :, 0]], 1, 0)
    facing = np.cross(b - a, c - a)
    assert np.allclose(facing, normals[corners[:, 0, 1]])
    assert np.all(np.einsum('ij,ij->i', facing, a) > 0.0)
    assert np.isclose(0.5 * np.linalg.norm(facing, axis=1).sum(), 6.0)


def test_messages_are_those_that_ros_writes():
    """Compare with bytes that ROS makes of one transform after the other."""
    names = ['a', 'oak_0', 'a_longer_name']
    poses = np.random.default_rng(0).random((3, 7))
    data = TransformMessage(names, 'world').write(poses, (5, 7))
    assert struct.unpack_from('<I', data, 4) == (3,)
    for name, pose in zip(names, poses):
        stamped = TransformStamped(child_frame_id=name)
        stamped.header.frame_id = 'world'
        stamped.header.stamp.sec, stamped.header.stamp.nanosec = 5, 7
        for target, values in ((stamped.transform.translation, pose[:3]),
                               (stamped.transform.rotation, pose[3:])):
            for axis, value in zip('xyzw', values):
                setattr(target, axis, value)
        whole = serialize_message(stamped)
        # Numbers have the same bytes wherever they are; what lies between only fills up.
        assert whole[-56:] in data
    alone = TransformMessage(['oak'], 'map').write(poses[:1], (5, 7))
    assert struct.unpack_from('<iI', alone, 8) == (5, 7)
    assert alone[16:24] == b'\x04\0\0\0map\0' and alone[24:32] == b'\x04\0\0\0oak\0'
    assert np.frombuffer(alone[36:], '<f8').tolist() == poses[0].tolist()


def test_frames_are_at_the_first_part_that_is_left():
    """Leave out objects of which nothing is left."""
    poses = np.zeros((7, 7))
    poses[[0, 1, 5, 6]] = np.nan
    objects = [SimpleNamespace(name=name, first=first, count=count) for name, first, count in
               (('wall', 0, 3), ('oak', 3, 2), ('ball', 5, 1), ('none', 7, 0))]
    names, parts = frames(SimpleNamespace(poses=poses, objects=objects))
    assert names == ('wall', 'oak') and parts.tolist() == [2, 3]


class Node:
    """Takes down what is said, and publishes nothing."""

    def __init__(self):
        self.said = []
        self.context = SimpleNamespace(ok=lambda: True)

    def get_logger(self):
        """Return an object that records warnings."""
        return SimpleNamespace(warning=self.said.append)


@pytest.mark.parametrize('messages', [None, SimpleNamespace(),
                                      SimpleNamespace(TFMessage=SimpleNamespace)])
def test_without_tf2_msgs_one_warning_is_all(monkeypatch, messages):
    """Say what is missing, and how to get it; then do nothing. Half of it is as good as none."""
    monkeypatch.setitem(sys.modules, 'tf2_msgs', SimpleNamespace())
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', messages)
    node = Node()
    publisher = TransformPublisher(node, 'world')
    for moved in (True, False):
        publisher.publish(SimpleNamespace(), moved)
    assert len(node.said) == 1 and 'tf2-msgs' in node.said[0]


def test_an_object_called_as_the_world_has_no_frame(monkeypatch):
    """Send no transform from a frame to itself, which tf refuses, and say so once."""
    sent = []
    topic = SimpleNamespace(publish=sent.append, get_subscription_count=lambda: 1)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', SimpleNamespace(TFMessage=object))
    monkeypatch.setattr(qos, 'publisher', lambda *given, **options: topic)
    node = Node()
    publisher = TransformPublisher(node, 'oak')
    objects = [SimpleNamespace(name=name, first=i, count=1)
               for i, name in enumerate(('wall', 'oak', 'ball'))]
    simulation = SimpleNamespace(poses=np.arange(21.0).reshape(3, 7), objects=objects, time=1.5)
    for _ in range(2):
        publisher.publish(simulation, True)
    expected = TransformMessage(('wall', 'ball'), 'oak').write(simulation.poses[[0, 2]],
                                                               messages.stamp(1.5))
    assert sent == [expected, expected]
    assert len(node.said) == 1 and 'oak' in node.said[0]
