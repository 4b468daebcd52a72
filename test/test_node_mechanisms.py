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


"""Joints of mechanisms through the node, over loopback."""

from node_process import Client, serve
import pytest
from sensor_msgs.msg import JointState

TEXT = """
mechanism m {
    box load { size: 0.2, 0.2, 0.2  mass: 10  at: 0, 0, 2  slider lift { motor: 0, 500 } }
    box arm { size: 1, 0.1, 0.1  at: 2, 0, 2  hinge slew { at: 1.5, 0, 2  motor: 0, 100 } }
    ball bob { diameter: 0.2  at: 4, 0, 2  hinge pin { at: 4, 0, 3  axis: 0, 1, 0 } }
}
"""


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), {
        'scene': {'objects': ['machine']}, 'machine': {'grammar_text': TEXT}})


def test_joints_are_told_and_driven_by_name():
    """Hear of each joint with an axis, and see two move to where one message sends them."""
    client = Client()
    heard = client.listen(JointState, '/sim/joint_states')
    client.spin_until(lambda: heard, 'states')
    assert list(heard[0].name) == ['machine/lift', 'machine/slew', 'machine/pin']
    assert len(heard[0].position) == len(heard[0].velocity) == len(heard[0].effort) == 3
    assert heard[0].header.frame_id == 'world'
    command = client.publisher(JointState, '/sim/joint_command')
    wish = JointState(name=['machine/slew', 'machine/lift'], position=[0.7, 0.4])
    client.send_until(lambda: abs(heard[-1].position[0] - 0.4) < 1e-3
                      and abs(heard[-1].position[1] - 0.7) < 1e-3, 'both there', (command, wish))
    client.spin_until(lambda: abs(heard[-1].effort[0] - 98.1) < 0.5, 'the weight that is held')
    client.close()


@pytest.mark.parametrize('message, reason', [
    (JointState(), 'there are 0 names of joints'),
    (JointState(name=['machine/lift']), 'nothing is given, it must be one of'),
    (JointState(name=['machine/lift'], position=[1.0], velocity=[1.0]),
     'position and velocity is given, it must be one of'),
    (JointState(name=['machine/lift'], velocity=[1.0, 2.0]), '2 values in velocity for 1 names'),
    (JointState(name=['machine/lift'] * 2, velocity=[1.0, 2.0]), 'a joint is named twice'),
    (JointState(name=['machine/lift'], velocity=[float('nan')]), 'joint.value is nan'),
    (JointState(name=['machine/lift', 'machine/lft'], velocity=[1.0, 1.0]),
     'there is no joint "machine/lft"; did you mean machine/lift'),
    (JointState(name=['machine/pin'], effort=[1.0]), 'machine/pin has no motor'),
    (JointState(name=['x' * 1000], effort=[1.0]), 'the name of a joint has 1000 characters')])
def test_commands_that_make_no_sense_are_rejected(message, reason):
    """Reject the whole message, and say why."""
    client = Client()
    status = client.watch_status()
    command = client.publisher(JointState, '/sim/joint_command')
    client.send_until(lambda: reason in status()['last rejection'], reason, (command, message))
    client.close()
