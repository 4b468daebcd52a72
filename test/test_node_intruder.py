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

from geometry_msgs.msg import Pose, PoseArray, PoseStamped, WrenchStamped
from node_process import Client, EVEN, SAPLING, serve
import pytest

SCENE = {'scene': {'objects': ['sapling']}, 'sapling': {'grammar_text': SAPLING}, 'wind': EVEN,
         'intruder': {'shape': 'sphere', 'size': [0.3]},
         'intruders': {'names': ['drone', 'arm'], 'shapes': ['sphere 0.3', 'capsule 0.1 0.8']}}


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), SCENE)


def test_rotors_of_an_intruder_move_the_tree_below():
    """Hover beside the stem, switch the rotors on, and see the twig go; refuse unknown names."""
    client = Client()
    hover = client.publisher(PoseStamped, '/sim/intruders/drone')
    rotors = client.publisher(WrenchStamped, '/sim/downwash')
    poses = client.listen(PoseArray, '/sim/poses')
    status = client.watch_status()
    message = WrenchStamped()
    message.header.frame_id = 'kite'
    client.send_until(lambda: 'there is no intruder "kite"' in status()['last rejection'],
                      'a rejection', (rotors, message))
    place_of_drone = PoseStamped(pose=place(-1.0, 0.0, 1.8))
    felt = client.listen(WrenchStamped, '/sim/intruders/drone/wrench')
    client.send_until(lambda: poses and len(felt) > 2, 'poses', (hover, place_of_drone))
    message.header.frame_id = 'drone'
    message.wrench.force.x = -60.0  # the air flows along +x, against the stem
    start = max(pose.position.x for pose in poses[-1].poses)
    client.send_until(lambda: max(pose.position.x for pose in poses[-1].poses) > start + 1e-5,
                      'a stem that bends', (rotors, message))
    client.close()


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
    client.send_until(lambda: status()['last rejection'].startswith(
        'intruder: intruder orientation'), 'a rejection',
        (client.publisher(PoseStamped, '/sim/intruder'), message))
    client.close()


def place(x, y, z):
    """Make a pose."""
    made = Pose()
    made.orientation.w = 1.0
    made.position.x, made.position.y, made.position.z = x, y, z
    return made


def test_intruders_by_name_are_moved_together_or_alone():
    """Move two in one message, then one: each has a wrench of its own."""
    client = Client()
    both = client.publisher(PoseArray, '/sim/intruders')
    alone = client.publisher(PoseStamped, '/sim/intruders/arm')
    felt = {name: client.listen(WrenchStamped, f'/sim/intruders/{name}/wrench')
            for name in ('drone', 'arm')}
    array = PoseArray(poses=[place(9.0, 9.0, 2.0), place(0.0, -0.4, 1.5)])
    client.send_until(lambda: all(felt.values()), 'wrenches of both', (both, array))
    message = PoseStamped()
    for i in range(12):
        message.pose = place(0.0, -0.4 + 0.03 * i, 1.5)
        alone.publish(message)
        seen = len(felt['arm'])
        client.spin_until(lambda: len(felt['arm']) > seen, 'the next force')  # noqa: B023
    client.spin_until(lambda: felt['arm'][-1].wrench.force.y < -1.0, 'the stem that pushes back')
    assert felt['drone'][-1].wrench.force.y == 0.0
    client.close()


def test_poses_that_do_not_fit_the_intruders_are_rejected():
    """Count an array of the wrong length as a rejected command, and name the intruders."""
    client = Client()
    status = client.watch_status()
    client.send_until(lambda: 'drone, arm' in status()['last rejection'], 'a rejection',
                      (client.publisher(PoseArray, '/sim/intruders'), PoseArray()))
    client.close()
