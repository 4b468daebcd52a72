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

"""Two nodes over DDS simulate one scene: what they publish merges, what is said reaches both."""

import json

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, Vector3Stamped
from node_process import Client, NodeProcess, SAPLING
import pytest
import rclpy
from std_msgs.msg import String
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from procphys_ros.ros import qos
from procphys_ros.scene import Scene

SCENE = {'scene': {'objects': ['sapling', 'post']},
         'wind': {'velocity': [3.0, 0.0, 0.0], 'turbulence_intensity': 0.0},
         'sapling': {'grammar_text': SAPLING, 'count': 5, 'layout': 'row', 'spacing': 4.0},
         'post': {'grammar_text': SAPLING, 'origin': [0.0, 6.0, 0.0]}}
NODES = ('east', 'west')


@pytest.fixture(scope='module')
def client(tmp_path_factory):
    """Start two nodes of one scene that share topics, and give a client."""
    rclpy.init()
    made = Client()
    nodes = []
    for index, name in enumerate(NODES):
        scene = {**SCENE, 'shard': {'index': index, 'count': len(NODES)}}
        nodes.append(NodeProcess(
            tmp_path_factory.mktemp(name), scene, '-r', f'__node:={name}',
            *(word for topic in ('markers', 'wind', 'explosion')
              for word in ('-r', f'~/{topic}:=/world/{topic}'))))
    for node in nodes:
        node.wait_for_banner()
    yield made
    made.close()
    rclpy.shutdown()
    for node in nodes:
        node.kill()


def test_merged_markers_are_those_of_the_whole_scene(client):
    """Get every part of the scene once, though one topic carries the markers of both nodes."""
    whole = Scene.from_parameters(SCENE)
    expected = {(o.name, i) for o in whole.objects for i in range(o.count)}
    received = client.listen(MarkerArray, '/world/markers', qos.changes())
    firsts: dict[str, int] = {}
    owner: dict[str, str] = {}
    for name in NODES:
        text = client.next_message(String, f'/{name}/scene_description', qos.latched()).data
        for o in json.loads(text)['objects']:
            assert o['name'] not in owner
            owner[o['name']], firsts[o['name']] = name, o['first']
    assert set(owner.values()) == set(NODES)

    def seen():
        return {(m.ns, m.id - firsts[m.ns]) for array in received for m in array.markers
                if m.action == m.ADD and m.ns in firsts}
    client.spin_until(lambda: seen() >= expected, 'markers of all parts')
    assert seen() == expected


def test_one_wind_blows_in_both_nodes(client):
    """Say the wind once, and find it in both."""
    winds = {name: client.listen(Vector3Stamped, f'/{name}/wind_info') for name in NODES}
    message = Vector3Stamped()
    message.vector.x, message.vector.y = -4.0, 7.0
    publisher = client.node.create_publisher(Vector3Stamped, '/world/wind', 10)
    client.spin_until(lambda: publisher.get_subscription_count() == 2, 'both nodes')
    client.send_until(lambda: all(heard and heard[-1].vector.y > 6.9 for heard in winds.values()),
                      'wind in both', (publisher, message))
    for heard in winds.values():
        assert heard[-1].vector.x == pytest.approx(-4.0, abs=1e-6)


def test_one_blast_is_carried_out_by_both_nodes(client):
    """Say once that a charge goes off, and have each node tell one more command taken."""
    statuses = client.listen(DiagnosticArray, '/diagnostics')

    def taken(name):
        values = [v.value for array in statuses for status in array.status
                  if status.name == f'/{name}: simulation'
                  for v in status.values if v.key == 'commands taken']
        return int(values[-1]) if values else None
    client.spin_until(lambda: all(taken(n) is not None for n in NODES), 'a status of both')
    before = {name: taken(name) for name in NODES}
    publisher = client.node.create_publisher(PointStamped, '/world/explosion', 10)
    client.spin_until(lambda: publisher.get_subscription_count() == 2, 'both nodes')
    blast = PointStamped()
    blast.point.y, blast.point.z = 3.0, 1.0
    client.send_until(lambda: all(taken(name) > before[name] for name in NODES),
                      'the blast in both', (publisher, blast))
    assert all(taken(name) > before[name] for name in NODES)


def test_what_is_thrown_in_both_nodes_is_told_apart(client):
    """Throw a ball in each node, and see two in the merged view."""
    received = client.listen(MarkerArray, '/world/markers', qos.changes())
    for name in NODES:
        assert client.call(Trigger, f'/{name}/launch_projectile', Trigger.Request()).success
    wanted = {f'projectile_0_shard_{index}' for index in range(len(NODES))}
    client.spin_until(lambda: {m.ns for array in received for m in array.markers} >= wanted,
                      'both balls')


def test_only_the_first_share_tells_the_time(client):
    """Publish one clock, whoever else is there."""
    client.spin_until(lambda: set(client.node.get_node_names()) >= set(NODES), 'both nodes')
    for name in NODES:
        client.next_message(String, f'/{name}/scene_description', qos.latched())
    client.spin_until(lambda: client.node.count_publishers('/clock'), 'a clock')
    assert client.node.count_publishers('/clock') == 1
