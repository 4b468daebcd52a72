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

"""Thousands of random commands, parameters, names and texts: none ends the node or its sense."""

import math
from random import Random

from geometry_msgs.msg import PointStamped, PoseArray, PoseStamped, Vector3Stamped, WrenchStamped
from node_process import Client, PARTS, SAPLING
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from procphys_ros.ros.node import SimNode
from procphys_ros.scene.parameter_table import GLOBAL, OBJECT

MESSAGES, CHANGES, CALLS, SCENES = 4000, 1500, 200, 40
AT_ONCE = 50  # changes of parameters in one request
BURST = 1000  # messages between looks at what became of them
PARAMETERS = {'scene.objects': ['sapling', 'post'], 'sapling.grammar_text': SAPLING,
              'sapling.count': 3, 'post.grammar_text': SAPLING, 'post.origin': [0.0, 6.0, 0.0],
              'service_deadline': 3600.0}
NUMBERS = (0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, -1e-9, 5e-324, 9.99e3, 1e9, 1e38, 1.7e308, math.nan,
           math.inf, -math.inf)
TEXTS = ('', ' ', '0', '15', '16', '-1', '1e3', 'sapling_0', 'sapling_0/', 'sapling_0/1',
         'sapling_0/segment_2', 'sapling_0/brick_1', 'sapling_9/0', 'post/3', 'post//3', '/', '//',
         '9' * 4301, 'sapling_0/' + '7' * 5000, 'world', 'map', '~nobody/x', '~', '.', '..',
         '/dev/zero', '/dev/stdin', '/root', '/proc/self/mem', '/etc', 'x' * 5000, '\ufeffaxiom',
         '🌳' * 300, 'é', '\t\n', '%s%n{0}', 'a\x00b', '\x1b[2J', 'oak.lsys', 'NaN', 'null',
         'package://procphys_ros/grammars/oak.lsys', 'package://other/x.lsys', '../' * 200)
GRAMMARS = ('', 'axiom:', 'axiom: F(', 'axiom: F(1e300)', 'axiom: !(0) F(1)', SAPLING[:40],
            '\ufeff' + SAPLING, SAPLING + '\x00', 'building', 'building x\n' * 50, '[' * 3000,
            'axiom: ' + 'F(1) [' * 200, 'axiom: A\nA -> A A', '#' * 9000, SAPLING.upper())
TOPICS = {'wind': Vector3Stamped, 'impulse': WrenchStamped, 'wrench': WrenchStamped,
          'explosion': PointStamped, 'observer': PoseStamped, 'intruder': PoseStamped}
TRIGGERS = ('gust', 'apply_impulse', 'launch_projectile', 'explode', 'demolish', 'cut',
            'earthquake', 'grow', 'clear_wrenches', 'step_simulation', 'cancel_reload')
# Left as they are: how often it publishes, how long it waits, what a step costs.
KEPT = ('service_deadline', 'publish_rate', 'marker_rate', 'real_time_factor', 'time_step',
        'dust.capacity', 'scene.objects', 'post.count', 'sapling.count', 'sapling.variants')


@pytest.fixture(scope='module')
def client():
    """Make a client that serves a node of this process, too."""
    rclpy.init()
    client = Client()
    client.sim = SimNode(parameter_overrides=[Parameter(n, value=v)
                                              for n, v in PARAMETERS.items()])
    client.host(client.sim)
    client.next_message(PoseArray, '/sim/poses')
    yield client
    while not client.sim.destroy_node():
        pass
    client.close()
    rclpy.shutdown()


def number(rng: Random) -> float:
    """Draw a number that is nice, odd, or none."""
    return rng.choice(NUMBERS) if rng.random() < 0.5 else rng.uniform(-200.0, 200.0)


def message(rng: Random, kind: type):
    """Fill a message with random values of its fields."""
    made = kind()
    made.header.frame_id = rng.choice(TEXTS)
    if rng.random() < 0.3:
        made.header.frame_id = rng.choice(('', 'world', 'post/2', 'sapling_1/3'))
    if kind is WrenchStamped:
        targets = [(made.wrench.force, 'xyz'), (made.wrench.torque, 'xyz')]
    elif kind is PoseStamped:
        targets = [(made.pose.position, 'xyz'), (made.pose.orientation, 'xyzw')]
    else:
        targets = [(made.vector if kind is Vector3Stamped else made.point, 'xyz')]
    for target, axes in targets:
        for axis in axes:
            setattr(target, axis, number(rng))
    return made


def value(rng: Random):
    """Draw a value of any type that a parameter can have."""
    whole = rng.choice((0, 1, -1, 3, 2**31, 2**62, -2**63, 2**63 - 1))
    length = rng.choice((0, 1, 2, 3, 3, 3, 4, 300))
    return rng.choice((
        lambda: rng.random() < 0.5, lambda: whole, lambda: number(rng), lambda: rng.choice(TEXTS),
        lambda: [number(rng) for _ in range(length)], lambda: [rng.choice(TEXTS)] * length,
        lambda: [whole] * length, lambda: [True] * length, lambda: None,
        lambda: [f'{number(rng)} {rng.choice(("gust", "launch", "explode", "gale"))} mass=1']))()


def parameter(rng: Random) -> Parameter:
    """Draw a change of a parameter, known or not."""
    names = [row.name for row in GLOBAL] + [f'post.{row.name}' for row in OBJECT]
    name = rng.choice([n for n in names if n not in KEPT] + ['elm.count', 'no.such', 'wind'])
    drawn = value(rng)
    return (Parameter(name, Parameter.Type.NOT_SET) if drawn is None
            else Parameter(name, value=drawn))


def change(client, parameters: list[Parameter]) -> list:
    """Set parameters through the service, each by itself."""
    return client.call(SetParameters, '/sim/set_parameters', SetParameters.Request(
        parameters=[p.to_parameter_msg() for p in parameters])).results


def is_well(client) -> None:
    """See that the node answers, and that what it publishes makes sense."""
    assert client.trigger('reset_simulation').success
    poses = client.next_message(PoseArray, '/sim/poses').poses
    assert len(poses) == PARTS
    assert np.isfinite([[p.position.x, p.position.y, p.position.z] for p in poses]).all()
    assert client.sim.session.failure == ''


def test_random_messages_are_taken_or_rejected(client):
    """Count each of them as one or the other, and stay well."""
    rng = Random(20100615)
    publishers = {topic: client.publisher(kind, f'/sim/{topic}') for topic, kind in TOPICS.items()}

    def counted() -> int:
        return sum(sum(counts.get(topic, 0) for topic in TOPICS)
                   for counts in client.sim.commands.counts())

    calm = WrenchStamped()  # until the node knows each publisher
    calm.header.frame_id = 'post/0'
    for topic, publisher in publishers.items():
        sent = calm if TOPICS[topic] is WrenchStamped else TOPICS[topic]()
        before = counted()
        client.send_until(lambda before=before: counted() > before, topic, (publisher, sent))
    for _ in range(MESSAGES // BURST):
        before = counted()
        for _ in range(BURST):
            topic, kind = rng.choice(list(TOPICS.items()))
            publishers[topic].publish(message(rng, kind))
        client.spin_until(lambda before=before: counted() >= before + BURST,
                          'all of them')
        is_well(client)
    for publisher in publishers.values():
        client.node.destroy_publisher(publisher)


def test_random_parameters_are_taken_or_refused(client):
    """Refuse with a reason or take over what is drawn, and stay well."""
    rng = Random(1998)
    outcomes = set()
    for _ in range(CHANGES // AT_ONCE):
        for result in change(client, [parameter(rng) for _ in range(AT_ONCE)]):
            outcomes.add(result.successful)
            assert result.successful or 0 < len(result.reason.encode('utf-8')) < 3000
    is_well(client)
    assert outcomes == {True, False}


def test_random_calls_are_answered(client):
    """Answer every call, whatever the parameters are by now, and stay well."""
    rng = Random(42)
    for _ in range(CALLS):
        if rng.random() < 0.2:
            name = rng.choice(('set_pause', 'set_wind_enabled'))
            answer = client.call(SetBool, f'/sim/{name}', SetBool.Request(data=rng.random() < 0.5))
        else:
            answer = client.call(Trigger, f'/sim/{rng.choice(TRIGGERS)}', Trigger.Request())
            change(client, [parameter(rng)])
        assert answer.message
    assert client.trigger('reset_simulation').success
    assert client.sim.session.failure == ''


def test_random_scenes_are_built_or_refused(client):
    """Refuse grammars that are none, with a reason, and keep the scene; then take a good one."""
    rng = Random(7)
    for name, default in (('seed', 0), ('gravity', 9.81), ('scene.cues', ['']), ('wind.file', ''),
                          ('wind.map', ''), ('wind.zones', ['']),
                          ('ground.motion', ['']), ('terrain.erosion', 0.0),
                          ('terrain.file', '')):
        assert client.sim.set_parameters([Parameter(name, value=default)])[0].successful
    for row in OBJECT:
        if f'post.{row.name}' not in KEPT and row.name not in ('grammar', 'grammar_text'):
            default = [''] if row.default == [] else row.default
            change = Parameter(f'post.{row.name}', value=default)
            assert client.sim.set_parameters([change])[0].successful, row.name
    for _ in range(SCENES):
        by_name = rng.random() < 0.5
        client.sim.set_parameters([
            Parameter('post.grammar', value=rng.choice(TEXTS) if by_name else ''),
            Parameter('post.grammar_text', value='' if by_name else rng.choice(GRAMMARS))])
        answer = client.trigger('reload_scene')
        assert answer.message and (answer.success or 'stays as it was' in answer.message)
        assert len(answer.message) < 1500
    client.sim.set_parameters([Parameter('post.grammar', value=''),
                               Parameter('post.grammar_text', value=SAPLING)])
    answer = client.trigger('reload_scene')
    assert answer.success, answer.message
    is_well(client)
