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


"""Projectiles, explosions and demolition through the node, over loopback."""

import json

from geometry_msgs.msg import PointStamped, PoseArray, WrenchStamped
from node_process import Client, EVEN, reset_client, serve
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SCENE = {'scene': {'objects': ['wall']}, 'wind': EVEN,
         'wall': {'grammar': 'garden_wall.wall', 'defines': ['length=4.4925', 'height=1.5']},
         'projectile': {'mass': 50.0, 'position': [2.0, -3.0, 0.8], 'velocity': [0.0, 25.0, 0.0]},
         'explosion': {'charge': 5.0, 'position': [2.0, -1.5, 0.8]}}


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), SCENE)


@pytest.fixture
def client():
    """Make a client to a node that has just been reset."""
    yield from reset_client()


def parts(client: Client) -> int:
    """Count the parts that the node publishes now."""
    return len(client.next_message(PoseArray, '/sim/poses').poses)


def broken(client: Client, least: int) -> None:
    """Wait until the node has told of broken bonds."""
    client.diagnostics_where(lambda v: int(v['bonds broken']) >= least)


def test_a_projectile_becomes_a_part_and_breaks_the_wall(client):
    """Append the ball to poses and description, let it break bonds, and forget it at a reset."""
    before = parts(client)
    answer = client.trigger('launch_projectile')
    assert answer.success and f'part {before}' in answer.message
    client.spin_until(lambda: parts(client) == before + 1, 'the ball among the poses')
    client.next_message(String, '/sim/scene_description', LATCHED, lambda message: json.loads(
        message.data)['objects'][-1]['name'] == 'projectile_0')
    broken(client, 5)
    assert client.trigger('reset_simulation').success
    assert parts(client) == before


def test_explosions_break_the_wall(client):
    """Set charges off by the service, and by a point on the topic."""
    assert client.trigger('explode').success
    broken(client, 5)
    assert client.trigger('reset_simulation').success
    client.diagnostics_where(lambda v: int(v['bonds broken']) == 0)
    message = PointStamped()
    message.point.x, message.point.y, message.point.z = 2.0, -1.5, 0.8
    status = client.watch_status()
    client.send_until(lambda: int(status()['bonds broken']) >= 5, 'broken bonds',
                      (client.publisher(PointStamped, '/sim/explosion'), message))


def test_demolition_breaks_the_wall(client):
    """Arm charges along the foot of the wall."""
    answer = client.trigger('demolish')
    assert answer.success and 'charges armed' in answer.message
    broken(client, 5)


def test_a_cut_takes_a_brick_out(client):
    """Saw a brick out of the wall, and refuse to do it once more."""
    assert client.set_parameter('cut.target', 'wall/20').successful
    answer = client.trigger('cut')
    assert answer.success and 'joints of wall/20 cut' in answer.message
    broken(client, 3)
    answer = client.trigger('cut')
    assert not answer.success and 'nothing holds wall/20' in answer.message


def test_a_gentle_impulse_on_a_brick_is_held(client):
    """Say in the answer that the brick did not move."""
    assert client.set_parameter('impulse.target', 'wall/20').successful
    assert client.set_parameter('impulse.linear', [0.0, 1.0, 0.0]).successful
    answer = client.trigger('apply_impulse')
    assert answer.success and 'holds' in answer.message
    message = WrenchStamped()
    message.header.frame_id = 'wall/20'
    message.wrench.force.y = 400.0
    status = client.watch_status()
    client.send_until(lambda: int(status()['bonds broken']) >= 1, 'a broken bond',
                      (client.publisher(WrenchStamped, '/sim/impulse'), message))


@pytest.mark.parametrize(('name', 'value', 'service', 'said'), [
    ('projectile.position', [0.0, -3.0, 0.01], 'launch_projectile', 'ground'),
    ('explosion.position', [0.0, 0.0, -2.0], 'explode', 'ground'),
    ('demolition.delays', [1.0, 2.0], 'demolish', 'delays'),
])
def test_what_cannot_be_done_is_refused(client, name, value, service, said):
    """Refuse with the reason, change nothing, and go on."""
    before = parts(client)
    assert client.set_parameter(name, value).successful
    answer = client.trigger(service)
    assert not answer.success and said in answer.message
    assert parts(client) == before
