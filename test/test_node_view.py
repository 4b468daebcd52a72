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

"""What a viewer shows: it follows what moves, comes, vanishes, and is loaded anew."""

import json
from time import monotonic

from geometry_msgs.msg import PoseArray
from node_process import Client, EVEN, SAPLING, serve
import numpy as np
import pytest
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from procphys_ros.ros import qos

WALL = {'grammar': 'garden_wall.wall', 'defines': ['length=4.4925', 'height=1.5']}
SCENE = {'scene': {'objects': ['sapling', 'wall']}, 'wind': EVEN,
         'wall': WALL, 'sapling': {'grammar_text': SAPLING, 'origin': [0.0, 8.0, 0.0]},
         'projectile': {'position': [0.0, -30.0, 2.0], 'velocity': [0.0, -10.0, 10.0]},
         'demolition': {'delays': [0.1], 'positions': [2.0, 0.0, 0.5], 'radii': [0.6]}}


class Viewer:
    """Does with markers what RViz does: adds, replaces, deletes."""

    def __init__(self, client: Client):
        self._client = client
        self.shown: dict[tuple[str, int], Marker] = {}
        self.deltas: list[MarkerArray] = []
        self._end = monotonic() + 7.0  # [s]
        client.node.create_subscription(MarkerArray, '/sim/markers', self._draw, 1000)

    @property
    def parts(self) -> set[int]:
        """Return the ids of the parts that are shown."""
        return {number for name, number in self.shown if name != '/dust'}

    def wait_for_last_whole_set(self) -> None:
        """Wait until the node has told a new subscriber everything as often as it does."""
        self._client.spin_until(lambda: monotonic() > self._end, 'the last whole set')

    def wait_for(self, parts: set[int], what: str) -> None:
        """Wait until just these parts are shown."""
        self._client.spin_until(lambda: self.parts == parts, what)

    def _draw(self, array: MarkerArray) -> None:
        if not array.markers or array.markers[0].action != Marker.DELETEALL:
            self.deltas.append(array)
        for marker in array.markers:
            if marker.action == Marker.DELETEALL:
                self.shown.clear()
            elif marker.action == Marker.DELETE:
                self.shown.pop((marker.ns, marker.id), None)
            else:
                self.shown[marker.ns, marker.id] = marker


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), SCENE)


@pytest.fixture(scope='module')
def watching(process):
    """Make a client with a viewer that has looked for long when the last test begins."""
    client = Client()
    yield client, Viewer(client)
    client.close()


@pytest.fixture
def client(watching):
    """Return a client to a node that runs the first scene from time 0."""
    client, _ = watching
    for name, value in (('scene.objects', ['sapling', 'wall']),
                        ('sapling.grammar_text', SAPLING), ('wind.velocity', [0.0, 0.0, 0.0])):
        assert client.set_parameter(name, value).successful
    assert client.switch('set_pause', False).success
    assert client.trigger('reload_scene').success
    return client


@pytest.fixture
def viewer(watching):
    """Return the viewer, which remembers no changes of other tests."""
    watching[1].deltas.clear()
    return watching[1]


def description(client: Client, fits=lambda scene: True) -> dict:
    """Read the description of the scene of which something is true."""
    return json.loads(client.next_message(String, '/sim/scene_description', qos.latched(),
                                          lambda m: fits(json.loads(m.data))).data)


def existing(client: Client) -> set[int]:
    """Return the parts that have a pose."""
    poses = client.next_message(PoseArray, '/sim/poses').poses
    return {i for i, pose in enumerate(poses) if np.isfinite(pose.position.x)}


def test_a_reload_changes_all_that_is_published(client, viewer):
    """Show other objects and parts in description, poses and markers after a reload."""
    before = description(client)
    parts = len(before['parts']['name'])
    viewer.wait_for(set(range(parts)), 'the first scene')
    assert {name for name, _ in viewer.shown} == {'sapling', 'wall'}
    for name, value in (('scene.objects', ['sapling', 'post']),
                        ('post.grammar_text', SAPLING),
                        ('sapling.grammar_text', SAPLING.replace('F(1) [', 'F(1) F(2) ['))):
        assert client.set_parameter(name, value).successful
    assert client.trigger('reload_scene').success
    after = description(client, lambda scene: len(scene['parts']['name']) == 9)
    assert after['objects'] == [{'name': 'sapling', 'first': 0, 'count': 5},
                                {'name': 'post', 'first': 5, 'count': 4}]
    longest = [max(size[2] for size in scene['parts']['size'][:4]) for scene in (before, after)]
    assert longest[1] == pytest.approx(2.0 * longest[0])
    viewer.wait_for(set(range(9)), 'the second scene')
    assert {name for name, _ in viewer.shown} == {'sapling', 'post'}
    assert existing(client) == set(range(9))


def test_the_old_scene_goes_on_after_a_reload_that_failed(client, viewer):
    """Keep objects, markers and time when a grammar cannot be read."""
    before = description(client)
    every = set(range(len(before['parts']['name'])))
    viewer.wait_for(every, 'the scene')
    descriptions = client.listen(String, '/sim/scene_description', qos.latched())
    poses = client.listen(PoseArray, '/sim/poses')
    client.spin_until(lambda: poses and poses[-1].header.stamp.sec >= 1, 'one second')
    assert client.set_parameter('sapling.grammar_text', 'axiom: F(1) [ F(1)').successful
    answer = client.trigger('reload_scene')
    assert not answer.success and 'sapling.grammar_text:1' in answer.message
    then = poses[-1].header.stamp.sec
    client.spin_until(lambda: poses[-1].header.stamp.sec >= then + 1, 'time that goes on')
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in poses]
    assert np.all(np.diff(stamps) >= 0.0)
    assert {len(m.poses) for m in poses} == {len(every)} and viewer.parts == every
    assert all(json.loads(m.data) == before for m in descriptions)


def test_only_what_moves_is_sent(client, viewer):
    """Send a ball that flies by and a tree that sways, and no brick of the wall that stands."""
    parts = len(description(client)['parts']['name'])
    viewer.wait_for(set(range(parts)), 'the scene')
    assert client.set_parameter('wind.velocity', [5.0, 0.0, 0.0]).successful
    client.spin_until(lambda: len(viewer.deltas) > 20, 'a tree that sways')
    assert client.trigger('launch_projectile').success
    client.spin_until(lambda: ('projectile_0', parts) in viewer.shown, 'the ball')
    client.spin_until(lambda: len(viewer.deltas) > 40, 'a ball that flies')
    moving = set(range(4)) | {parts}
    for array in viewer.deltas:
        assert {marker.id for marker in array.markers if marker.ns != '/dust'} <= moving
        assert len({(marker.ns, marker.id) for marker in array.markers}) == len(array.markers)


def test_what_vanishes_is_deleted_and_a_reset_brings_it_back(client, viewer):
    """Delete the markers of bricks that a charge breaks, and of pieces and ball at the reset."""
    every = set(range(len(description(client)['parts']['name'])))
    viewer.wait_for_last_whole_set()
    viewer.wait_for(every, 'the scene')
    assert client.trigger('launch_projectile').success
    client.spin_until(lambda: len(every) in viewer.parts, 'the ball')
    assert client.trigger('demolish').success
    client.spin_until(lambda: not viewer.parts >= every, 'bricks that vanish')
    client.spin_until(lambda: any(name == '/dust' for name, _ in viewer.shown), 'dust')
    assert client.switch('set_pause', True).success
    left = existing(client)
    assert every - left and left - every > {len(every)}  # quarters of bricks, and the ball
    viewer.wait_for(left, 'just what is left')
    deleted = {marker.id for array in viewer.deltas for marker in array.markers
               if marker.action == Marker.DELETE and marker.ns == 'wall'}
    assert deleted == every - left
    assert client.trigger('reset_simulation').success
    viewer.wait_for(every, 'the scene from the start')
    assert existing(client) == every
