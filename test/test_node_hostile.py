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


"""Huge texts, long lists, reloads with other settings; and what stands costs nothing."""

from geometry_msgs.msg import PoseArray, WrenchStamped
from node_process import Client, NodeProcess, PARTS, SAPLING, SCENE
import pytest
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

MEGABYTE = 1_200_000
BRICKS = 400  # fewer than the wall has
WHOLE_SETS = 3  # of markers that a new subscriber gets, lest the first come too early


@pytest.fixture(scope='module')
def node(tmp_path_factory):
    """Run one node for all tests of this file."""
    process = NodeProcess(tmp_path_factory.mktemp('node'), SCENE)
    process.wait_for_banner()
    yield process
    process.kill()


@pytest.fixture(scope='module')
def client(node):
    """Make a client of the node."""
    rclpy.init()
    made = Client()
    yield made
    made.close()
    rclpy.shutdown()


@pytest.fixture(autouse=True)
def good_scene(client):
    """Leave the node with the scene that it began with."""
    yield
    for name, value in (('scene.objects', ['sapling', 'post']), ('scene.cues', ['']),
                        ('post.grammar_text', SAPLING), ('time_step', 1.0 / 60.0),
                        ('culling.sleeping', False), ('dust.enabled', True)):
        assert client.set_parameter(name, value).successful, name
    client.switch('set_pause', False)
    assert client.trigger('reload_scene').success


def parts(client):
    """Count the parts that are published."""
    return len(client.next_message(PoseArray, '/sim/poses').poses)


def test_a_long_grammar_is_read(client):
    """Take a text that is long because much is explained in it."""
    text = SAPLING + '\n'.join(['# ' + 'why ' * 20] * 2000)
    assert len(text) > 100_000
    assert client.set_parameter('post.grammar_text', text).successful
    answer = client.trigger('reload_scene')
    assert answer.success, answer.message
    assert parts(client) == PARTS


@pytest.mark.parametrize('text', ['F(' * (MEGABYTE // 2), '🌳' * (MEGABYTE // 4), 'x' * MEGABYTE,
                                  'axiom: ' + 'F(1) ' * (MEGABYTE // 5)])
def test_a_megabyte_of_nonsense_is_refused_in_few_words(client, text):
    """Say how long a text may be, keep the old scene, and answer on."""
    assert client.set_parameter('post.grammar_text', text).successful
    answer = client.trigger('reload_scene')
    assert not answer.success and len(answer.message) < 1000
    assert 'post' in answer.message and 'the scene stays' in answer.message
    assert 'characters, at most' in answer.message
    assert parts(client) == PARTS


@pytest.mark.parametrize('name, value, words', [
    ('scene.objects', [f'o{i}/' for i in range(100_000)], 'cannot name an object'),
    ('scene.cues', ['1 gust'] * 5 + ['2 gale'], 'scene.cues[5]'),
    ('scene.cues', ['x' * MEGABYTE], 'scene.cues[0]'),
    ('demolition.delays', [1.0] * 99 + [float('nan')], 'demolition.delays'),
    ('projectile.size', [1.0] * 100_000, 'projectile.size'),
    ('world_frame', '', 'world_frame'),
])
def test_long_and_strange_values_are_refused(client, name, value, words):
    """Say the name of the parameter and what is wrong, in few words."""
    result = client.set_parameter(name, value)
    if result.successful:  # what only its use can judge
        result = client.trigger('launch_projectile')
        assert not result.success and words in result.message and len(result.message) < 1000
    else:
        assert words in result.reason or 'read' in result.reason
        assert len(result.reason) < 1000


def test_reload_takes_other_settings(client):
    """Go over to another time step, seed, and schemes without a restart."""
    for name, value in (('time_step', 0.01), ('seed', 99), ('culling.sleeping', True),
                        ('dust.enabled', False)):
        assert client.set_parameter(name, value).successful
    assert client.trigger('reload_scene').success
    client.switch('set_pause', True)
    before = float(client.trigger('step_simulation').message.split()[-2])
    after = float(client.trigger('step_simulation').message.split()[-2])
    assert after - before == pytest.approx(0.01, abs=1e-6)


def test_a_standing_wall_costs_no_markers(client):
    """Send all markers to a new subscriber, and then nothing while nothing moves."""
    assert client.set_parameter('scene.objects', ['wall']).successful
    assert client.set_parameter('wall.grammar', 'garden_wall.wall').successful
    assert client.trigger('reload_scene').success
    received = client.listen(MarkerArray, '/sim/markers')
    client.spin_until(lambda: received, 'the whole set')
    clock = client.listen(Clock, '/clock')
    client.spin_until(lambda: len(clock) > 200, 'seven seconds')
    assert len(received) <= WHOLE_SETS + 1  # that of the scene loaded before may be late
    assert all(len(array.markers) > BRICKS for array in received)


def test_a_bad_change_among_good_ones_changes_nothing(client):
    """Refuse changes that belong together as a whole, and leave what was."""
    names = ('publish_rate', 'gust.duration', 'wind.velocity')
    before = [client.get_parameter(name) for name in names]
    request = SetParametersAtomically.Request(parameters=[
        Parameter(name, value=value).to_parameter_msg()
        for name, value in zip(names, (12.0, 3.0, [1.0, 2.0, 999.0]))])
    result = client.call(SetParametersAtomically, '/sim/set_parameters_atomically', request).result
    assert not result.successful and 'wind.velocity' in result.reason
    assert [client.get_parameter(name) for name in names] == before


def test_messages_of_another_type_are_not_heard(client):
    """Go on when somebody publishes another type on a topic that is listened to."""
    publisher = client.node.create_publisher(String, '/sim/wind', 10)
    status = client.watch_status()
    before = int(status()['commands rejected']), int(status()['commands taken'])
    for _ in range(5):
        publisher.publish(String(data='a gale from the west'))
        assert parts(client) == PARTS
    seen = status()
    client.spin_until(lambda: status() != seen, 'the next status')
    assert (int(status()['commands rejected']), int(status()['commands taken'])) == before
    client.node.destroy_publisher(publisher)


def count(values, key):
    """Read a number of a status; what has never happened is not listed."""
    return int(values.get(key, 0))


def push(part):
    """Make a light impulse on a part."""
    message = WrenchStamped()
    message.header.frame_id = part
    message.wrench.force.x = 1e-3
    return message


def test_a_thousand_commands_are_all_answered_for(node, client):
    """Count every command of a flood as taken or as rejected; warn of few, to fill no disk."""
    publisher = client.publisher(WrenchStamped, '/sim/impulse')
    status = client.watch_status()
    first = count(status(), 'rejected impulse')
    client.send_until(lambda: count(status(), 'rejected impulse') > first, 'a rejection',
                      (publisher, push('nobody/1')))
    before = status()
    for i in range(1000):
        publisher.publish(push('sapling_0/1' if i % 2 else 'nobody/1'))
    for key in ('commands taken', 'commands rejected'):
        goal = int(before[key]) + 500
        client.spin_until(lambda: int(status()[key]) >= goal, f'{goal} {key}')  # noqa: B023
        assert int(status()[key]) == goal
    warnings = node.complaints().count(' rejected: ')
    assert 1 <= warnings <= 250


def test_overloaded_node_slows_down_and_still_answers(client):
    """Ask for far more than can be computed: services answer, the status warns."""
    assert client.set_parameter('real_time_factor', 1000.0).successful
    values = client.diagnostics_where(lambda v: v['message'].startswith('overloaded'))
    assert float(values['real-time factor']) < 950.0
    assert client.switch('set_wind_enabled', True).success
    assert client.set_parameter('real_time_factor', 1.0).successful
    client.diagnostics_where(lambda v: v['real-time factor wanted'] == '1')
