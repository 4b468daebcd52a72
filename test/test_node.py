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

"""The node over loopback: a real `sim` in another process, a real client in this one."""

# It takes commands, parameters and reloads, refuses huge and strange ones, and sends what changes.

import json
import math
import re

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, Vector3Stamped, WrenchStamped
from node_process import Client, PARTS, SAPLING, SCENE, serve
import numpy as np
import pytest
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.clock import ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
WHOLE_SETS = 3  # of markers that a new subscriber gets, lest the first come too early
MEGABYTE = 1_200_000


@pytest.fixture(scope='module', autouse=True)
def process(tmp_path_factory):
    """Run one node for all tests here."""
    yield from serve(tmp_path_factory.mktemp('node'), SCENE)


@pytest.fixture
def client():
    """Make a client to a node that runs from time 0, in still air."""
    client = Client()
    assert client.switch('set_pause', False).success
    assert client.set_parameter('wind.velocity', [0.0, 0.0, 0.0]).successful
    assert client.trigger('reset_simulation').success
    yield client
    client.close()


@pytest.fixture
def altered(client):
    """Return the client, and leave the node with the scene and settings that it began with."""
    yield client
    for name, value in (('scene.objects', ['sapling', 'post']), ('post.grammar_text', SAPLING),
                        ('time_step', 1.0 / 60.0), ('culling.sleeping', False),
                        ('dust.enabled', True)):
        assert client.set_parameter(name, value).successful, name
    client.switch('set_pause', False)
    assert client.trigger('reload_scene').success


def array_of(message: PoseArray) -> np.ndarray:
    """Read poses as an array (N, 7)."""
    return np.array([[p.position.x, p.position.y, p.position.z, p.orientation.x, p.orientation.y,
                      p.orientation.z, p.orientation.w] for p in message.poses])


def parts(client: Client) -> int:
    """Count the parts that are published."""
    return len(client.next_message(PoseArray, '/sim/poses').poses)


def count(values: dict[str, str], key: str) -> int:
    """Read a number of a status; what has never happened is not listed."""
    return int(values.get(key, 0))


def stamp(message) -> float:
    """Read the time of a message with a header, or of a clock [s]."""
    time = message.clock if isinstance(message, Clock) else message.header.stamp
    return time.sec + 1e-9 * time.nanosec


def wrench(part: str, x: float = 0.0, turn: float = 0.0) -> WrenchStamped:
    """Make an impulse or a force along x, and about z, on a part."""
    message = WrenchStamped()
    message.header.frame_id = part
    message.wrench.force.x = x
    message.wrench.torque.z = turn
    return message


def test_poses_arrive_with_every_part(client):
    """Publish all parts as unit quaternions in the world frame, stamped with growing time."""
    received = client.listen(PoseArray, '/sim/poses')
    client.spin_until(lambda: len(received) >= 5, 'poses')
    poses = array_of(received[-1])
    assert poses.shape == (PARTS, 7)
    assert received[0].header.frame_id == 'world'
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1.0, atol=1e-9)
    assert np.all(np.diff([stamp(m) for m in received]) > 0)


def test_clocks_jump_back_at_a_reset(client):
    """Start anew from zero when reset; nodes that use simulation time are told of a jump."""
    received = client.listen(Clock, '/clock')
    assert client.node.set_parameters([Parameter('use_sim_time', value=True)])[0].successful
    clock = client.node.get_clock()
    jumps: list = []
    handle = clock.create_jump_callback(
        JumpThreshold(min_forward=None, min_backward=Duration(seconds=-0.5),
                      on_clock_change=False), post_callback=jumps.append)
    client.spin_until(lambda: clock.now() > Time(seconds=0.6, clock_type=ClockType.ROS_TIME),
                      'a moment')
    assert client.switch('set_pause', True).success
    assert client.trigger('reset_simulation').success
    client.spin_until(lambda: clock.now().nanoseconds == 0, 'time 0')
    assert len(jumps) == 1 and jumps[0].delta < Duration(seconds=-0.5)
    handle.unregister()
    assert client.switch('set_pause', False).success
    client.spin_until(lambda: stamp(received[-1]) > 0.3, 'time again')
    assert np.count_nonzero(np.diff([stamp(m) for m in received]) < 0) == 1


def test_use_sim_time_at_run_time_changes_nothing(client):
    """Keep stepping, publishing and answering when told to use the clock that it publishes."""
    for value in (True, False):
        assert client.set_parameter('use_sim_time', value).successful
        assert client.trigger('reset_simulation').success
        received = client.listen(Clock, '/clock')
        client.spin_until(lambda: received and stamp(received[-1]) > 0.3, 'time')  # noqa: B023
        assert client.diagnostics_where(lambda v: float(v['simulation time [s]']) > 0.0)


def test_late_joiner_gets_the_scene_description(client):
    """Keep the description for whoever comes later."""
    scene = json.loads(client.next_message(String, '/sim/scene_description', LATCHED).data)
    names = [o['name'] for o in scene['objects']]
    assert names == ['sapling_0', 'sapling_1', 'sapling_2', 'post']
    assert [o['first'] for o in scene['objects']] == [0, 4, 8, 12]
    assert len(scene['parts']['name']) == PARTS
    assert scene['parts']['name'][5] == 'sapling_1/segment_1'
    assert len(scene['bonds']['parts']) == PARTS


def test_little_is_done_while_paused(client):
    """Send who begins to look all markers, then nothing but one time, as seldom as a status."""
    client.switch('set_pause', True)
    received = client.listen(MarkerArray, '/sim/markers')
    statuses = client.listen(DiagnosticArray, '/diagnostics')
    clocks = client.listen(Clock, '/clock')
    client.spin_until(lambda: len(statuses) > 7, 'quiet, also after subscribers of other tests')
    first, begun, told = len(clocks), len(statuses), len(received)
    client.spin_until(lambda: len(statuses) >= begun + 3, 'three seconds')
    assert 1 <= len(clocks) - first <= 6 and len({stamp(clock) for clock in clocks[first:]}) == 1
    assert 1 <= told == len(received) <= WHOLE_SETS + 1  # one may show the reset before
    for array in received:
        markers = [m for m in array.markers if m.action == Marker.ADD]
        assert sorted(m.id for m in markers) == list(range(PARTS))
        assert {m.ns for m in markers} == {'sapling_0', 'sapling_1', 'sapling_2', 'post'}
    client.switch('set_pause', False)
    first, begun = len(clocks), len(statuses)
    client.spin_until(lambda: len(statuses) >= begun + 2, 'two seconds')
    assert len(clocks) - first > 10


def test_impulse_moves_the_named_tree_alone(client):
    """Strike one part by name; its tree moves, the others stand."""
    assert client.switch('set_pause', True).success
    assert client.trigger('reset_simulation').success
    before = array_of(client.next_message(PoseArray, '/sim/poses'))
    status = client.watch_status()
    taken = count(status(), 'commands taken')
    blow = client.publisher(WrenchStamped, '/sim/impulse'), wrench('sapling_1/segment_3', 30.0)
    client.send_until(lambda: count(status(), 'commands taken') > taken, 'the impulse', blow)
    for _ in range(10):
        assert client.trigger('step_simulation').success
    after = client.next_message(PoseArray, '/sim/poses')
    assert stamp(after) == pytest.approx(10 / 60, abs=1e-6)
    moved = np.abs(array_of(after) - before).max(axis=1)
    assert moved[7] > 0.005
    np.testing.assert_allclose(moved[[0, 1, 2, 3, 8, 9, 10, 11]], 0.0, atol=1e-9)


def test_bad_commands_are_rejected_and_counted(client):
    """Drop what names no part, or holds a number that is not finite or absurd; take none."""
    status = client.watch_status()
    before = status()
    impulse = client.publisher(WrenchStamped, '/sim/impulse')
    lasting = client.publisher(WrenchStamped, '/sim/wrench')
    wind = client.publisher(Vector3Stamped, '/sim/wind')
    sent = [(impulse, wrench(part, 1.0))
            for part in ('elm/3', 'sapling_0/99', '', '🌳/1', 'sapling_0/brick_1', '-1')]
    pushes = []
    for value in (math.nan, math.inf, 1e308):
        gale = Vector3Stamped()
        gale.vector.x = value
        sent += [(wind, gale), (impulse, wrench('post/1', value))]
        pushes.append((lasting, wrench('post/1', 0.0, value)))

    def wait_for(what, **counts):
        client.send_until(lambda: all(
            count(status(), f'rejected {name}') >= count(before, f'rejected {name}') + some
            for name, some in counts.items()), 'rejections', *what)
    wait_for(sent, wind=3, impulse=9)
    wait_for(pushes, wrench=3)  # topics keep no order among each other
    assert count(status(), 'commands taken') == count(before, 'commands taken')
    assert status()['last rejection'].startswith('wrench: ')
    assert np.isfinite(array_of(client.next_message(PoseArray, '/sim/poses'))).all()


def test_wind_in_another_frame_is_rejected(client):
    """Refuse vectors that would need a transform."""
    status = client.watch_status()
    before = count(status(), 'rejected wind')
    wind = Vector3Stamped()
    wind.header.frame_id = 'base_link'
    client.send_until(lambda: count(status(), 'rejected wind') > before, 'a rejection',
                      (client.publisher(Vector3Stamped, '/sim/wind'), wind))
    reason = status()['last rejection']
    assert 'base_link' in reason and 'world' in reason


def test_wind_blows_as_told_and_can_be_switched_off(client):
    """Take a mean wind from the topic and show it, turbulence included, on wind_info."""
    client.set_parameter('wind.turbulence_intensity', 0.0)
    wind = Vector3Stamped()
    wind.vector.x = 6.0
    received = client.listen(Vector3Stamped, '/sim/wind_info')
    client.send_until(lambda: received and received[-1].vector.x == pytest.approx(6.0), 'wind',
                      (client.publisher(Vector3Stamped, '/sim/wind'), wind))
    assert client.set_parameter('wind.turbulence_intensity', 0.2).successful
    client.spin_until(lambda: abs(received[-1].vector.x - 6.0) > 1e-3, 'turbulence')
    assert client.switch('set_wind_enabled', False).success
    client.spin_until(lambda: received[-1].vector.x == 0.0, 'still air')
    answer = client.trigger('gust')
    assert answer.success and 'the wind is off' in answer.message
    assert client.switch('set_wind_enabled', True).success
    assert 'off' not in client.trigger('gust').message


def test_strong_wrench_breaks_a_tree_and_the_break_is_told(client):
    """Publish a row per broken bond that names the parts."""
    received = client.listen(PointCloud2, '/sim/breaks')
    text = SAPLING.replace('DampingRatio', 'Strength(1e6) DampingRatio')
    assert client.set_parameter('post.grammar_text', text).successful
    push = client.publisher(WrenchStamped, '/sim/wrench'), wrench('post/3', 3000.0)

    def told():  # who is not heard yet misses it; then all goes from the start
        if not received:
            assert client.trigger('reload_scene').success
            client.send_until(lambda: received or broken() > 0, 'breaks', push)
        return received

    def broken():
        return count(status(), 'bonds broken')

    status = client.watch_status()
    client.spin_until(told, 'a row of breaks')
    fields = {f.name: f.offset for f in received[0].fields}
    row = np.frombuffer(bytes(received[0].data[:received[0].point_step]), np.uint8)
    part = row[fields['part_b']:][:4].view(np.int32)[0]
    assert 12 <= part < 16
    assert row[fields['load']:][:4].view(np.float32)[0] > 1.0
    assert client.trigger('clear_wrenches').success
    assert client.set_parameter('post.grammar_text', SAPLING).successful
    assert client.trigger('reload_scene').success


def test_snow_loads_trees_and_goes(client):
    """Let snow fall on a running scene and melt: the foot of a tree bears it, and is rid of it."""
    assert client.set_parameter('wind.velocity', [0.0, 0.0, 0.0]).successful
    assert client.set_parameter('load.ramp', 0.2).successful
    assert client.set_parameter('inspect.part', 'sapling_0/0').successful
    carried = re.compile(r'carries ([\d.e+]+) N')

    def force() -> float:
        found = carried.search(client.trigger('inspect').message)
        return float(found[1]) if found else 0.0
    client.spin_until(lambda: force() > 0.0, 'the first step')
    bare = force()
    assert client.set_parameter('load.ice', 0.02).successful
    client.spin_until(lambda: force() > 1.1 * bare, 'the ice on the tree')
    refused = client.set_parameter('load.snow', -1.0)
    assert not refused.successful and 'load.snow' in refused.reason
    assert client.trigger('reset_simulation').success
    assert client.get_parameter('load.ice') == 0.02
    assert client.set_parameter('load.ice', 0.0).successful
    client.spin_until(lambda: 0.0 < force() < 1.02 * bare, 'the thaw')


def test_step_is_refused_while_running(client):
    """Say how to step instead."""
    answer = client.trigger('step_simulation')
    assert not answer.success and 'set_pause' in answer.message


def test_apply_impulse_without_a_target_is_refused(client):
    """Name the parameter that is missing."""
    client.set_parameter('impulse.target', '')
    answer = client.trigger('apply_impulse')
    assert not answer.success and 'impulse.target' in answer.message


def test_integers_are_accepted_for_doubles(client):
    """Take whole numbers where the table says double, scalar and vector."""
    assert client.set_parameter('wind.velocity', [5, 0, 0]).successful
    assert client.set_parameter('publish_rate', 25).successful
    assert client.get_parameter('publish_rate') == 25
    assert client.set_parameter('publish_rate', 30.0).successful


@pytest.mark.parametrize(('name', 'value', 'said'), [
    ('wind.velocity', [1.0, math.nan, 0.0], 'wind.velocity'),
    ('wind.velocity', [1.0, 2.0], '3 numbers'),
    ('wind.velocity', [140.0, 140.0, 0.0], '150'),
    ('wind.turbulence_intensity', 3.0, ''),
    ('wind.profile', 'logarithmic', 'log, power, uniform'),
    ('wind.roughness_length', 'rough', 'number'),
    ('wind.zones', ['size=1,1,1', 'size=1,1,1 speed=9'], 'wind.zones[1]'),
    ('wind.zones', ['size=1,1,1 ' + 'x' * MEGABYTE], 'wind.zones[0]'),
    ('publish_rate', 0.0, ''),
    ('world_frame', 'map', 'read-only'),
    ('sapling.count', -1, ''),
    ('sapling.count', 2.5, 'whole number'),
    ('scene.objects', ['wind'], 'cannot name an object'),
    ('scene.objects', ['two words'], 'letters'),
    ('scene.objects', [f'o{i}/' for i in range(100_000)], 'cannot name an object'),
    ('scene.cues', ['1 gust'] * 5 + ['2 gale'], 'scene.cues[5]'),
    ('scene.cues', ['x' * MEGABYTE], 'scene.cues[0]'),
    ('demolition.delays', [1.0] * 99 + [math.nan], 'demolition.delays'),
    ('world_frame', '', 'read'),
])
def test_bad_parameter_is_refused_with_a_reason(client, name, value, said):
    """Leave the old value, and say in few words what is allowed."""
    before = client.get_parameter(name)
    result = client.set_parameter(name, value)
    assert not result.successful and said in result.reason and len(result.reason) < 1000
    assert client.get_parameter(name) == before


def test_a_huge_projectile_is_refused_when_it_is_launched(client):
    """Judge in few words what only its use can judge."""
    size = client.get_parameter('projectile.size')
    assert client.set_parameter('projectile.size', [1.0] * 100_000).successful
    answer = client.trigger('launch_projectile')
    assert not answer.success and 'projectile.size' in answer.message
    assert len(answer.message) < 1000
    assert client.set_parameter('projectile.size', size).successful


@pytest.mark.parametrize(('names', 'said'), [
    (['wind.velocty'], 'there is no parameter wind.velocty; did you mean wind.velocity'),
    (['publish_rate', 'wind.velocty'], 'there is no parameter wind.velocty'),
    (['elm.grammar'], 'elm are not used, scene.objects does not name them'),
    (['scene.objects', 'elm.grammer'], 'no parameter elm.grammer; did you mean elm.grammar'),
    (['scene.objects', 'elm.count'], 'elm.count is 1.5, it must be a whole number'),
    (['scene.objects', 'elm.grammar', 'seed'], 'seed out of range'),
    (['publish_rate', 'wind.velocity'], 'wind.velocity'),
    (['qos_overrides.nothing'], 'qos_overrides.nothing'),
])
def test_an_unknown_parameter_is_named(client, names, said):
    """Say which one of those that are set at once does not exist, and change none."""
    before = client.get_parameter('publish_rate')
    given = {'publish_rate': 7.0, 'scene.objects': ['elm'], 'elm.grammar': 'oak.lsys',
             'elm.count': 1.5, 'seed': -1, 'wind.velocity': [1.0, 2.0, 999.0]}
    result = client.call(
        SetParametersAtomically, '/sim/set_parameters_atomically',
        SetParametersAtomically.Request(parameters=[
            Parameter(name, value=given.get(name, 1.0)).to_parameter_msg() for name in names]))
    assert not result.result.successful and said in result.result.reason
    assert client.get_parameter('publish_rate') == before
    listed = client.call(ListParameters, '/sim/list_parameters',
                         ListParameters.Request(prefixes=['elm'], depth=2))
    assert not listed.result.names and len(client.get_parameter('scene.objects')) == 2
    if len(names) == 1:
        assert client.set_parameter(names[0], 1.0) == result.result


def test_an_object_comes_with_its_parameters(client):
    """Set both in one atomic change: lists, also empty ones, whole numbers and texts."""
    given = {'scene.objects': ['sapling', 'post', 'fir'], 'fir.grammar_text': SAPLING,
             'fir.origin': [0.0, 9.0, 0.0], 'fir.count': 2, 'fir.defines': [], 'fir.yaw': 1}
    result = client.call(
        SetParametersAtomically, '/sim/set_parameters_atomically',
        SetParametersAtomically.Request(parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in given.items()]))
    assert result.result.successful, result.result.reason
    for name, value in given.items():
        assert list(np.ravel(client.get_parameter(name))) == list(np.ravel(value))
    assert client.get_parameter('fir.layout') == 'grid'
    assert client.trigger('reload_scene').success
    assert parts(client) == PARTS + 8
    assert client.set_parameter('scene.objects', ['sapling', 'post']).successful
    assert client.trigger('reload_scene').success


def test_a_long_grammar_is_read(altered):
    """Take a text that is long because much is explained in it."""
    text = SAPLING + '\n'.join(['# ' + 'why ' * 20] * 2000)
    assert len(text) > 100_000
    assert altered.set_parameter('post.grammar_text', text).successful
    answer = altered.trigger('reload_scene')
    assert answer.success, answer.message
    assert parts(altered) == PARTS


@pytest.mark.parametrize('text', ['F(' * (MEGABYTE // 2), '🌳' * (MEGABYTE // 4), 'x' * MEGABYTE,
                                  'axiom: ' + 'F(1) ' * (MEGABYTE // 5)])
def test_a_megabyte_of_nonsense_is_refused_in_few_words(altered, text):
    """Say how long a text may be, keep the old scene, and answer on."""
    assert altered.set_parameter('post.grammar_text', text).successful
    answer = altered.trigger('reload_scene')
    assert not answer.success and len(answer.message) < 1000
    assert 'post' in answer.message and 'the scene stays' in answer.message
    assert 'characters, at most' in answer.message
    assert parts(altered) == PARTS


def test_reload_takes_other_settings(altered):
    """Go over to another time step, seed, and schemes without a restart."""
    for name, value in (('time_step', 0.01), ('seed', 99), ('culling.sleeping', True),
                        ('dust.enabled', False)):
        assert altered.set_parameter(name, value).successful
    assert altered.trigger('reload_scene').success
    altered.switch('set_pause', True)
    before = float(altered.trigger('step_simulation').message.split()[-2])
    after = float(altered.trigger('step_simulation').message.split()[-2])
    assert after - before == pytest.approx(0.01, abs=1e-6)


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


def test_a_thousand_commands_are_all_answered_for(process, client):
    """Count every command of a flood as taken or as rejected; warn of few, to fill no disk."""
    publisher = client.publisher(WrenchStamped, '/sim/impulse')
    status = client.watch_status()
    first = count(status(), 'rejected impulse')
    client.send_until(lambda: count(status(), 'rejected impulse') > first, 'a rejection',
                      (publisher, wrench('nobody/1', 1e-3)))
    before = status()
    for i in range(1000):
        publisher.publish(wrench('sapling_0/1' if i % 2 else 'nobody/1', 1e-3))
    for key in ('commands taken', 'commands rejected'):
        goal = int(before[key]) + 500
        client.spin_until(lambda: int(status()[key]) >= goal, f'{goal} {key}')  # noqa: B023
        assert int(status()[key]) == goal
    warnings = process.complaints().count(' rejected: ')
    assert 1 <= warnings <= 250


def test_overloaded_node_slows_down_and_still_answers(client):
    """Ask for far more than can be computed: services answer, the status warns."""
    assert client.set_parameter('real_time_factor', 1000.0).successful
    values = client.diagnostics_where(lambda v: v['message'].startswith('overloaded'))
    assert float(values['real-time factor']) < 950.0
    assert client.switch('set_wind_enabled', True).success
    assert client.set_parameter('real_time_factor', 1.0).successful
    client.diagnostics_where(lambda v: v['real-time factor wanted'] == '1')
