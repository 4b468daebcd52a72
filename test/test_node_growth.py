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


"""Growth through the node, over loopback: the service, the new parts, and their sizes."""

import json

from geometry_msgs.msg import PoseArray
from node_process import EVEN, reset_client, serve
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SCENE = {'scene': {'objects': ['tree', 'wall']}, 'wind': EVEN, 'grow': {'rate': 4.0, 'years': 2},
         'tree': {'grammar': 'garden_tree.lsys', 'steps': 5, 'count': 2},
         'wall': {'grammar': 'garden_wall.wall', 'origin': [9.0, 9.0, 0.0]}}


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), SCENE)


@pytest.fixture
def client():
    """Make a client to a node that has just been reset."""
    yield from reset_client()


def test_plants_grow_and_what_is_published_follows(client):
    """Append poses and descriptions of new parts, send markers of another size, and start anew."""
    count = len(client.next_message(PoseArray, '/sim/poses').poses)
    answer = client.trigger('grow')
    assert answer.success and answer.message == '2 plants grow on for 2 years, 4 a second'
    described = json.loads(client.next_message(
        String, '/sim/scene_description', LATCHED,
        lambda message: 'tree_1_year_7' in message.data).data)
    names = [one['name'] for one in described['objects']]
    assert {'tree_0_year_6', 'tree_1_year_6', 'tree_0_year_7'} <= set(names)
    grown = len(client.next_message(PoseArray, '/sim/poses').poses)
    assert grown == len(described['parts']['name']) > count
    markers = client.next_message(MarkerArray, '/sim/markers').markers
    assert any(marker.ns.startswith('tree_0') for marker in markers)
    client.diagnostics_where(lambda v: int(v['parts']) == grown)
    assert client.trigger('reset_simulation').success
    assert len(client.next_message(PoseArray, '/sim/poses').poses) == count


@pytest.mark.parametrize(('name', 'value', 'said'), [
    ('grow.target', 'wall', 'is no plant'), ('grow.target', 'tre', 'did you mean')])
def test_what_cannot_grow_is_refused(client, name, value, said):
    """Refuse with the reason, and go on."""
    assert client.set_parameter(name, value).successful
    answer = client.trigger('grow')
    assert not answer.success and said in answer.message
    assert client.set_parameter(name, '').successful
