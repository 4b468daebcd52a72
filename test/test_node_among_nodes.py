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

"""The node among other nodes: late joiners, other clocks, dumps of parameters, life cycles."""

from threading import enumerate as enumerate_threads
from threading import Event, Thread
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from node_process import Client, PARTS, SAPLING, values_of
import pytest
from rcl_interfaces.msg import Log
import rclpy
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray
import yaml

from procphys_ros.errors import SceneError
from procphys_ros.ros import building
from procphys_ros.ros.commands import Command
from procphys_ros.ros.managed import ManagedSimNode
from procphys_ros.ros.node import banner, SimNode
from procphys_ros.scene import Scene
from procphys_ros.scene.spawn import Spawn

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
WEAK = SAPLING.replace('DampingRatio', 'Strength(1e6) DampingRatio')
PARAMETERS = {'scene.objects': ['sapling', 'post'], 'sapling.grammar_text': SAPLING,
              'sapling.count': 3, 'post.grammar_text': WEAK, 'post.origin': [0.0, 6.0, 0.0],
              'service_deadline': 3600.0}
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


def made(kind=SimNode, arguments=(), **changes):
    """Make a node of this process."""
    values = {**PARAMETERS, **changes}
    return kind(cli_args=['--ros-args', *arguments],
                parameter_overrides=[Parameter(n, value=v) for n, v in values.items()])


def end(node):
    """End a node as soon as its threads have."""
    while not node.destroy_node():
        pass


@pytest.fixture(scope='module')
def client(tmp_path_factory):
    """Make a client that serves a node of this process, too."""
    rclpy.init()
    client = Client()
    node = made(**{'files.root': [str(tmp_path_factory.getbasetemp())]})
    client.host(node)
    client.sim = node
    client.next_message(Bool, '/sim/ready', LATCHED, lambda message: message.data)
    yield client
    end(node)
    client.close()
    rclpy.shutdown()


def test_who_joins_late_learns_of_all_broken_bonds(client):
    """Latch what is broken, and nothing once the scene is whole again."""
    push = WrenchStamped()
    push.header.frame_id = 'post/3'
    push.wrench.force.x = 3000.0
    status = client.watch_status()
    client.send_until(lambda: int(status().get('bonds broken', 0)) > 0, 'a break',
                      (client.publisher(WrenchStamped, '/sim/wrench'), push))
    cloud = client.next_message(PointCloud2, '/sim/broken_bonds', LATCHED, lambda m: m.width)
    assert cloud.width >= 1 and {f.name for f in cloud.fields} >= {'part_a', 'part_b', 'load'}
    assert client.trigger('clear_wrenches').success and client.trigger('reset_simulation').success
    client.next_message(PointCloud2, '/sim/broken_bonds', LATCHED, lambda m: not m.width)


def test_a_restored_state_brings_its_broken_bonds_along(client, tmp_path):
    """Latch what is broken in a saved state when it is restored, and tell it on ~/breaks once."""
    assert client.set_parameter('state.file', str(tmp_path / 'state')).successful
    push = WrenchStamped()
    push.header.frame_id = 'post/3'
    push.wrench.force.x = 3000.0
    told = client.listen(PointCloud2, '/sim/breaks', 100)
    client.send_until(lambda: told, 'a break', (client.publisher(WrenchStamped, '/sim/wrench'),
                                                push))
    assert client.switch('set_pause', True).success
    assert client.trigger('save_state').success and client.trigger('reset_simulation').success
    client.next_message(PointCloud2, '/sim/broken_bonds', LATCHED, lambda m: not m.width)
    before = len(told)
    assert client.trigger('restore_state').success
    broken = client.next_message(PointCloud2, '/sim/broken_bonds', LATCHED, lambda m: m.width)
    assert broken.width == client.sim.session.simulation.bonds_broken
    assert len(told) == before
    assert client.trigger('reset_simulation').success and client.switch('set_pause', False).success
    assert client.trigger('clear_wrenches').success


def test_the_parameter_says_what_blows(client):
    """Set wind.velocity to the value from the topic, and to that after a reset."""
    wind = Vector3Stamped()
    wind.vector.y = 7.0
    client.send_until(lambda: client.get_parameter('wind.velocity')[1] == 7.0, 'the parameter',
                      (client.publisher(Vector3Stamped, '/sim/wind'), wind))
    assert client.trigger('reset_simulation').success
    client.spin_until(lambda: client.get_parameter('wind.velocity')[1] == 0.0, 'the parameter')


def test_a_reload_can_be_cancelled(client):
    """Tell that a scene is built, give it up when told to, and go on with the old one."""
    assert not client.trigger('cancel_reload').success
    assert client.set_parameter('sapling.count', 50_000).successful
    reload = client.node.create_client(Trigger, '/sim/reload_scene')
    client.spin_until(reload.service_is_ready, 'the service')
    waiting = reload.call_async(Trigger.Request())
    status = client.watch_status()
    client.spin_until(lambda: 'building the scene' in status()['under way'], 'the building')
    second = client.trigger('reload_scene')
    assert not second.success and 'cancel_reload' in second.message
    assert client.trigger('cancel_reload').success
    client.spin_until(waiting.done, 'its answer')
    assert not waiting.result().success and 'stays as it was' in waiting.result().message
    assert client.set_parameter('sapling.count', 3).successful
    assert f'{PARTS} parts' in client.trigger('reload_scene').message


def test_arguments_are_those_at_the_time_of_the_call(client):
    """Carry a call out with the parameters that it was made with, when they have changed since."""
    gust = client.node.create_client(Trigger, '/sim/gust')
    client.spin_until(gust.service_is_ready, 'the service')
    assert client.set_parameter('gust.direction', [1.0, 0.0, 0.0]).successful
    assert client.set_parameter('gust.amplitude', 3.0).successful
    held = Event()
    client.sim.commands.call(Command('hold', lambda: str(held.wait())))
    client.spin_until(lambda: client.sim.commands.under_way == 'hold', 'a busy simulation')
    answer = gust.call_async(Trigger.Request())
    client.spin_until(lambda: len(client.sim.commands), 'a waiting call')
    assert client.set_parameter('gust.amplitude', 4.0).successful
    held.set()
    client.spin_until(answer.done, 'its answer')
    assert answer.result().success and 'gust of 3 m/s' in answer.result().message


def dump(node) -> str:
    """Write the parameters of a node as `ros2 param dump` does."""
    tree: dict = {}
    for name in sorted(node.list_parameters([], 0).names):
        value = node.get_parameter(name).to_parameter_msg().value
        *groups, last = name.split('.')
        target = tree
        for group in groups:
            target = target.setdefault(group, {})
        target[last] = parameter_value_to_python(value)
    return yaml.dump({'/sim': {'ros__parameters': tree}}, default_flow_style=False)


def test_lists_can_be_emptied_however_that_is_said(client):
    """Take a list without a type, and no value at all, for an empty list."""
    for name in ('scene.cues', 'demolition.delays'):
        for kind in (Parameter.Type.BOOL_ARRAY, Parameter.Type.NOT_SET):
            value = [] if kind != Parameter.Type.NOT_SET else None
            result = client.sim.set_parameters([Parameter(name, kind, value)])[0]
            assert result.successful, result.reason
            assert list(client.get_parameter(name)) == []


def test_another_publisher_of_the_clock_is_warned_of(client):
    """Warn once of two nodes that publish time; one can be told not to."""
    said = client.listen(Log, '/rosout', 100)
    quiet = made(arguments=('-r', '__node:=quiet'), publish_clock=False)
    assert '/clock' not in dict(quiet.get_publisher_names_and_types_by_node('quiet', '/'))
    end(quiet)
    other = made(arguments=('-r', '__node:=other'))
    client.spin_until(lambda: any('publish /clock' in m.msg and m.level == 30 for m in said),
                      'a warning')
    end(other)


def test_a_node_in_a_process_of_users_tells_why_it_ended(client):
    """Log once, and answer, why there is no scene, where no main function says so."""
    said = client.listen(Log, '/rosout', 100)
    broken = made(arguments=('-r', '__node:=broken'), publish_clock=False,
                  **{'post.grammar_text': 'axiom: F(1) ]'})
    client.host(broken)
    client.spin_until(lambda: any(m.level == 50 and 'found "]"' in m.msg for m in said),
                      'the reason')
    answer = client.call(Trigger, '/broken/gust', Trigger.Request())
    assert not answer.success and 'found "]"' in answer.message
    end(broken)


@pytest.mark.parametrize('wrong', [
    {'seed': 1.5}, {'qos_overrides./failed/wind.subscription.depth': -5},
    {'qos_overrides./failed/poses.publisher.depth': -5}], ids=str)
def test_a_node_that_cannot_be_made_leaves_nothing(client, wrong):
    """Take the node, and that of its topics, out of the graph when its parameters are refused."""
    threads = set(enumerate_threads())
    with pytest.raises(SceneError):
        made(arguments=('-r', '__node:=failed'), publish_clock=False, **wrong)
    client.spin_until(lambda: not {'failed', 'failed_commands'} & set(
        client.node.get_node_names()), 'the end of the nodes')
    assert {thread.name for thread in set(enumerate_threads()) - threads} == set()


def test_a_node_of_the_same_name_is_warned_of(client):
    """Warn once when another node has the name: clients cannot tell whom they call."""
    said = client.listen(Log, '/rosout', 100)
    other = made(publish_clock=False)
    client.spin_until(lambda: any('2 nodes are called /sim:' in m.msg and m.level == 30
                                  for m in said), 'a warning')
    end(other)


def test_commands_that_are_not_heard_are_warned_of(client, capfd):
    """Name who sends poses as sensors do, best effort, which a reliable subscription refuses."""
    said = []
    publisher = client.node.create_publisher(PoseStamped, '/sim/intruder', qos_profile_sensor_data)
    client.spin_until(lambda: said.append(capfd.readouterr().err) or any(
        '/test_client publishes /sim/intruder, which is not heard: ' in text
        and 'qos_overrides./sim/intruder.subscription' in text for text in said), 'a warning')
    client.node.destroy_publisher(publisher)
    assert 'publishes /sim/wind' not in ''.join(said)


def test_the_banner_has_the_names_as_remapped(client):
    """Name topics as they are after remapping."""
    node = made(arguments=('-r', '__node:=east', '-r', '~/markers:=/world/markers'))
    client.spin_until(lambda: node.session.has_scene, 'the scene')
    text = banner(node)
    assert '/world/markers' in text and '/east/poses' in text and '/sim/' not in text
    end(node)


def test_quality_of_service_can_be_overridden(client):
    """Publish as parameters ask for, and refuse what makes no sense."""
    name = 'qos_overrides./other/poses.publisher.reliability'
    node = made(arguments=('-r', '__node:=other'), **{name: 'best_effort'})
    client.spin_until(lambda: client.node.get_publishers_info_by_topic('/other/poses'), 'it')
    info = client.node.get_publishers_info_by_topic('/other/poses')[0]
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    end(node)
    with pytest.raises(SceneError, match='/other/poses'):
        made(arguments=('-r', '__node:=other'), **{name: 'sometimes'})


def test_unused_parameters_are_told_in_one_line(client):
    """Name objects that are not in the scene once, whatever was given of them."""
    given = {f'elm.{name}': 1 for name in ('count', 'spacing', 'seed', 'yaw')}
    node = made(arguments=('-r', '__node:=other'), **given,
                **{'fir.count': 2, 'publish_clokc': True})
    absent, unknown = node.parameters.unused_overrides()
    assert absent == 'parameters of elm, fir are not used, scene.objects does not name them'
    assert unknown.startswith('there is no parameter publish_clokc; did you mean publish_clock, '
                              'publish_tf, publish_rate? (they begin with camera, ')
    end(node)


def test_a_manager_leads_a_managed_node(client):
    """Build when configured, run when active, stand still when not, and say what fails."""
    node = made(ManagedSimNode, ('-r', '__node:=managed'))
    ready = client.listen(Bool, '/managed/ready', LATCHED)
    client.host(node)
    client.spin_until(lambda: ready and not ready[-1].data, 'an empty node')
    assert node.trigger_configure() == SUCCESS
    client.spin_until(lambda: ready[-1].data, 'a scene')

    def status(message):
        return client.next_message(
            DiagnosticArray, '/diagnostics', 10, lambda array: array.status[0].name.startswith(
                '/managed') and array.status[0].message == message)

    assert float(values_of(status('paused'))['simulation time [s]']) == 0.0
    assert node.trigger_activate() == SUCCESS
    assert float(values_of(status('running'))['simulation time [s]']) > 0.0
    assert node.trigger_deactivate() == SUCCESS
    status('paused')
    shown = client.listen(MarkerArray, '/managed/markers', 100)
    client.spin_until(lambda: shown, 'markers')
    drawn = {(m.ns, m.id) for array in shown for m in array.markers if m.action == m.ADD}
    shown.clear()
    assert node.trigger_cleanup() == SUCCESS
    client.spin_until(lambda: not ready[-1].data, 'an empty node')
    client.spin_until(lambda: drawn <= {(m.ns, m.id) for array in shown for m in array.markers
                                        if m.action == m.DELETE}, 'an empty view')
    reload = client.call(Trigger, '/managed/reload_scene', Trigger.Request())
    assert not reload.success and 'no scene' in reload.message
    reset = client.call(Trigger, '/managed/reset_simulation', Trigger.Request())
    assert not reset.success and 'until the node is configured' in reset.message
    node.set_parameters([Parameter('post.grammar_text', value='axiom: F(1')])
    assert node.trigger_configure() == FAILURE
    node.set_parameters([Parameter('post.grammar_text', value=SAPLING)])
    assert node.trigger_configure() == SUCCESS and node.trigger_shutdown() == SUCCESS
    assert node.loop.ended.done()
    end(node)


def test_a_managed_node_answers_while_it_configures(client, monkeypatch):
    """Say that it configures while a scene is built, refuse a second transition, and cancel."""
    held = Event()

    class Held:
        @staticmethod
        def from_parameters(parameters):
            held.wait()
            return Scene.from_parameters(parameters)

    monkeypatch.setattr(building, 'Scene', Held)
    node = made(ManagedSimNode, ('-r', '__node:=led'))
    client.host(node)

    def change(label):
        changes = client.node.create_client(ChangeState, '/led/change_state')
        client.spin_until(changes.service_is_ready, 'the service')
        return changes.call_async(ChangeState.Request(transition=Transition(label=label)))

    def state():
        return client.call(GetState, '/led/get_state', GetState.Request()).current_state.label

    def is_done(future):
        client.spin_until(future.done, 'its answer')
        return future.result().success

    try:
        configured = change('configure')
        client.spin_until(lambda: node.builder.activity.now(), 'the building')
        assert state() == 'configuring' and not configured.done()
        assert not is_done(change('activate'))
        assert client.call(Trigger, '/led/cancel_reload', Trigger.Request()).success
        assert not is_done(configured) and state() == 'unconfigured'
    finally:
        held.set()
    assert is_done(change('configure')) and state() == 'inactive'
    assert is_done(change('activate')) and state() == 'active'
    assert is_done(change('shutdown')) and node.loop.ended.done()
    end(node)


def test_a_node_ends_in_time_whatever_it_is_about(client, monkeypatch):
    """Wait for threads that build, join and compute for 2 s in all at most, and say they go on."""
    held, building_, joining, stepping = Event(), Event(), Event(), Event()

    def hold(entered):
        def wait(*_):
            entered.set()
            held.wait()
            raise SceneError('let go')
        return wait

    node = made(SimNode, ('-r', '__node:=stuck'), **{'spawn.grammar_text': SAPLING})
    client.host(node)
    client.spin_until(lambda: node.session.has_scene, 'a scene')
    monkeypatch.setattr(building, 'Scene', SimpleNamespace(from_parameters=hold(building_)))
    monkeypatch.setattr(Spawn, 'build', hold(joining))
    patience = []
    try:
        for service in ('reload_scene', 'spawn'):
            caller = client.node.create_client(Trigger, f'/stuck/{service}')
            client.spin_until(caller.service_is_ready, 'the service')
            caller.call_async(Trigger.Request())
        client.spin_until(lambda: building_.is_set() and joining.is_set(), 'both')
        node.commands.call(Command('hold', hold(stepping)))
        client.spin_until(stepping.is_set, 'the simulation')
        with monkeypatch.context() as change:
            change.setattr(Thread, 'join', lambda _, timeout=None: patience.append(timeout))
            assert not node.destroy_node()
    finally:
        held.set()
    assert len(patience) == 4 and sum(patience) <= 1.5  # the rest is for a child that compiles
    end(node)


# The last: when a node goes, ROS takes the log from others of its name.
def test_a_dump_of_parameters_can_be_read_back(client, tmp_path):
    """Start another node with what was dumped, empty lists included; it dumps the same."""
    written = dump(client.sim)
    assert 'delays: []' in written and 'cues: []' in written and 'qos_overrides' in written
    path = tmp_path / 'dump.yaml'
    path.write_text(written, 'utf-8')
    node = SimNode(cli_args=['--ros-args', '--params-file', str(path)])
    assert dump(node) == written
    end(node)
