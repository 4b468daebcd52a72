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


"""The intruder through the node, over loopback."""

from geometry_msgs.msg import PoseStamped, WrenchStamped
from node_process import Client, SAPLING, serve
import pytest

SCENE = {'scene': {'objects': ['sapling']}, 'sapling': {'grammar_text': SAPLING},
         'intruder': {'shape': 'sphere', 'size': [0.3]}}


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), SCENE)


def test_a_robot_leans_on_a_tree_and_feels_it():
    """Move a ball against a stem, and hear of the force that holds it off."""
    client = Client()
    publisher = client.publisher(PoseStamped, '/sim/intruder')
    felt = client.listen(WrenchStamped, '/sim/intruder_wrench')
    message = PoseStamped()
    message.pose.orientation.w = 1.0
    message.pose.position.z = 1.5
    message.pose.position.x = -0.4
    client.send_until(lambda: felt, 'a force', (publisher, message))
    for i in range(12):
        message.pose.position.x = -0.4 + 0.02 * i
        publisher.publish(message)
        seen = len(felt)
        client.spin_until(lambda: len(felt) > seen, 'the next force')  # noqa: B023
    client.spin_until(lambda: felt[-1].wrench.force.x < -1.0, 'the stem that pushes back')
    assert felt[0].wrench.force.x == 0.0
    client.close()


def test_a_pose_that_is_none_is_rejected():
    """Count a quaternion without length as a rejected command."""
    client = Client()
    message = PoseStamped()
    message.pose.orientation.w = 0.0
    status = client.watch_status()
    client.send_until(lambda: int(status()['commands rejected']) > 0, 'a rejection',
                      (client.publisher(PoseStamped, '/sim/intruder'), message))
    assert status()['last rejection'].startswith('intruder: intruder orientation')
    client.close()
