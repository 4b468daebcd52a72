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

"""Commands to plants, walls, joints and intruders through one node, over loopback."""

import json

from geometry_msgs.msg import (
    PointStamped,
    Pose,
    PoseArray,
    PoseStamped,
    Quaternion,
    WrenchStamped,
)
from node_process import Client, EVEN, reset_client, SAPLING, serve
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from visualization_msgs.msg import MarkerArray

from procphys_ros.ros import qos

MACHINE = """
mechanism m {
    box load { size: 0.2, 0.2, 0.2  mass: 10  at: 0, 0, 2  slider lift { motor: 0, 500 } }
    box arm { size: 1, 0.1, 0.1  at: 2, 0, 2  hinge slew { at: 1.5, 0, 2  motor: 0, 100 } }
    ball bob { diameter: 0.2  at: 4, 0, 2  hinge pin { at: 4, 0, 3  axis: 0, 1, 0 } }
}
"""
SCENE = {'scene': {'objects': ['stem', 'tree', 'wall', 'machine']}, 'wind': EVEN,
         'stem': {'grammar_text': SAPLING, 'origin': [0.0, -20.0, 0.0]},
         'tree': {'grammar': 'garden_tree.lsys', 'steps': 5, 'count': 2,
                  'origin': [20.0, 20.0, 0.0]},
         'wall': {'grammar': 'garden_wall.wall', 'defines': ['length=4.4925', 'height=1.5']},
         'machine': {'grammar_text': MACHINE, 'origin': [-20.0, 20.0, 0.0]},
         'grow': {'rate': 4.0, 'years': 2},
         'intruder': {'shape': 'sphere', 'size': [0.3]},
         'intruders': {'names': ['drone', 'arm'], 'shapes': ['sphere 0.3', 'capsule 0.1 0.8']},
         'projectile': {'mass': 50.0, 'position': [2.0, -3.0, 0.8], 'velocity': [0.0, 25.0, 0.0]},
         'explosion': {'charge': 5.0, 'position': [2.0, -1.5, 0.8]}}
LIFT = ['machine/lift']


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), SCENE)


@pytest.fixture
def client():
    """Make a client to a node that has just been reset, and runs."""
    for made in reset_client():
        assert made.switch('set_pause', False).success
        yield made


def parts(client: Client) -> int:
    """Count the parts that the node publishes now."""
    return len(client.next_message(PoseArray, '/sim/poses').poses)


def broken(client: Client, least: int) -> None:
    """Wait until the node has told of broken bonds."""
    client.diagnostics_where(lambda v: int(v['bonds broken']) >= least)


def place(x: float, y: float, z: float) -> Pose:
    """Make a pose beside the stem."""
    made = Pose(orientation=Quaternion(w=1.0))
    made.position.x, made.position.y, made.position.z = x, y - 20.0, z
    return made


def push(frame: str, x: float = 0.0, y: float = 0.0) -> WrenchStamped:
    """Make a force on a part or of rotors."""
    message = WrenchStamped(header=Header(frame_id=frame))
    message.wrench.force.x, message.wrench.force.y = x, y
    return message


def test_a_projectile_becomes_a_part_and_breaks_the_wall(client):
    """Append the ball to poses and description, let it break bonds, and forget it at a reset."""
    before = parts(client)
    answer = client.trigger('launch_projectile')
    assert answer.success and f'part {before}' in answer.message
    client.spin_until(lambda: parts(client) == before + 1, 'the ball among the poses')
    client.next_message(String, '/sim/scene_description', qos.latched(), lambda message:
                        json.loads(message.data)['objects'][-1]['name'] == 'projectile_0')
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
    status = client.watch_status()
    client.send_until(lambda: int(status()['bonds broken']) >= 1, 'a broken bond', (
        client.publisher(WrenchStamped, '/sim/impulse'), push('wall/20', y=400.0)))


def test_plants_grow_and_what_is_published_follows(client):
    """Append poses and descriptions of new parts, send markers of another size, and start anew."""
    count = parts(client)
    answer = client.trigger('grow')
    assert answer.success and answer.message == '3 plants grow on for 2 years, 4 a second'
    described = json.loads(client.next_message(
        String, '/sim/scene_description', qos.latched(),
        lambda message: 'tree_1_year_7' in message.data).data)
    names = [one['name'] for one in described['objects']]
    assert {'tree_0_year_6', 'tree_1_year_6', 'tree_0_year_7'} <= set(names)
    grown = parts(client)
    assert grown == len(described['parts']['name']) > count
    markers = client.next_message(MarkerArray, '/sim/markers').markers
    assert any(marker.ns.startswith('tree_0') for marker in markers)
    client.diagnostics_where(lambda v: int(v['parts']) == grown)
    assert client.trigger('reset_simulation').success
    assert parts(client) == count


def test_joints_are_told_and_driven_by_name(client):
    """Hear of each joint with an axis, and see two move to where one message sends them."""
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


def test_rotors_of_an_intruder_move_the_tree_below(client):
    """Hover beside the stem, switch the rotors on, and see the twig go."""
    hover = client.publisher(PoseStamped, '/sim/intruders/drone')
    rotors = client.publisher(WrenchStamped, '/sim/downwash')
    poses = client.listen(PoseArray, '/sim/poses')
    felt = client.listen(WrenchStamped, '/sim/intruders/drone/wrench')
    client.send_until(lambda: poses and len(felt) > 2, 'poses',
                      (hover, PoseStamped(pose=place(-1.0, 0.0, 1.8))))

    def reach():
        return max(pose.position.x for pose in poses[-1].poses[:4])
    start = reach()  # the air flows along +x, against the stem
    client.send_until(lambda: reach() > start + 1e-5, 'a stem that bends',
                      (rotors, push('drone', x=-60.0)))


@pytest.mark.parametrize('topic, told, way, others', [
    ('/sim/intruder', '/sim/intruder_wrench', (0.02, 0.0), ()),
    ('/sim/intruders/arm', '/sim/intruders/arm/wrench', (0.0, 0.03), ('drone',))])
def test_a_robot_leans_on_a_tree_and_feels_it(client, topic, told, way, others):
    """Move one body against a stem, and hear of the force that holds it off, and it alone."""
    publisher, felt = client.publisher(PoseStamped, topic), client.listen(WrenchStamped, told)
    far = {name: client.listen(WrenchStamped, f'/sim/intruders/{name}/wrench') for name in others}
    x, y = (-0.4 * (step > 0.0) for step in way)
    if others:  # all of them come by one message
        array = PoseArray(poses=[place(9.0, 9.0, 2.0), place(x, y, 1.5)])
        client.send_until(lambda: felt and all(far.values()), 'wrenches of both',
                          (client.publisher(PoseArray, '/sim/intruders'), array))
    client.send_until(lambda: felt, 'a force', (publisher, PoseStamped(pose=place(x, y, 1.5))))
    for i in range(12):
        publisher.publish(PoseStamped(pose=place(x + i * way[0], y + i * way[1], 1.5)))
        seen = len(felt)
        client.spin_until(lambda: len(felt) > seen, 'the next force')  # noqa: B023
    client.spin_until(lambda: felt[-1].wrench.force.x < -1.0 if way[0] else
                      felt[-1].wrench.force.y < -1.0, 'the stem that pushes back')
    assert felt[0].wrench.force.x == felt[0].wrench.force.y == 0.0
    assert all(heard[-1].wrench.force.y == 0.0 for heard in far.values())


@pytest.mark.parametrize(('name', 'value', 'service', 'said'), [
    ('projectile.position', [0.0, -3.0, 0.01], 'launch_projectile', 'ground'),
    ('explosion.position', [0.0, 0.0, -2.0], 'explode', 'ground'),
    ('demolition.delays', [1.0, 2.0], 'demolish', 'delays'),
    ('grow.target', 'wall', 'grow', 'is no plant'), ('grow.target', 'tre', 'grow', 'did you mean'),
])
def test_what_cannot_be_done_is_refused(client, name, value, service, said):
    """Refuse with the reason, change nothing, and go on."""
    assert client.switch('set_pause', True).success
    before = parts(client)
    assert client.set_parameter(name, value).successful
    answer = client.trigger(service)
    assert not answer.success and said in answer.message
    assert parts(client) == before


@pytest.mark.parametrize('topic, message, reason', [
    ('joint_command', JointState(), 'there are 0 names of joints'),
    ('joint_command', JointState(name=LIFT), 'nothing is given, it must be one of'),
    ('joint_command', JointState(name=LIFT, position=[1.0], velocity=[1.0]),
     'position and velocity is given, it must be one of'),
    ('joint_command', JointState(name=LIFT, velocity=[1.0, 2.0]),
     '2 values in velocity for 1 names'),
    ('joint_command', JointState(name=LIFT * 2, velocity=[1.0, 2.0]), 'a joint is named twice'),
    ('joint_command', JointState(name=LIFT, velocity=[float('nan')]), 'joint.value is nan'),
    ('joint_command', JointState(name=[*LIFT, 'machine/lft'], velocity=[1.0, 1.0]),
     'there is no joint "machine/lft"; did you mean machine/lift'),
    ('joint_command', JointState(name=['machine/pin'], effort=[1.0]),
     'machine/pin has no motor'),
    ('joint_command', JointState(name=['x' * 1000], effort=[1.0]),
     'the name of a joint has 1000 characters'),
    ('intruder', PoseStamped(pose=Pose(orientation=Quaternion(w=0.0))),
     'intruder: intruder orientation'),
    ('intruders', PoseArray(), 'drone, arm'),
    ('downwash', push('kite'), 'there is no intruder "kite"')])
def test_messages_that_make_no_sense_are_rejected(client, topic, message, reason):
    """Reject the whole message, and say why."""
    assert client.switch('set_pause', True).success
    status = client.watch_status()
    client.send_until(lambda: reason in status()['last rejection'], reason,
                      (client.publisher(type(message), f'/sim/{topic}'), message))
