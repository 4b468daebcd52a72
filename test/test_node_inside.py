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

"""A node in this process: saved states, objects that come and go, a lidar, and faults inside."""

# States are written to a file, restored from it, or refused in one line. What goes wrong inside
# the node says so, lives on, and can be brought back.

import errno
import json
import os
import sys
from types import SimpleNamespace
from unittest.mock import Mock

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseArray, Vector3Stamped, WrenchStamped
from node_process import Client, SAPLING
import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from procphys_ros.messages.points import SCAN
from procphys_ros.physics.lidar import GROUND
from procphys_ros.ros import qos
from procphys_ros.ros.lidar import LidarPublisher
from procphys_ros.ros.node import SimNode
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

PARAMETERS = {'scene.objects': ['sapling'], 'sapling.grammar_text': SAPLING,
              'service_deadline': 3600.0, 'status_line': 'off', 'real_time_factor': 1.0}
PARTS_OF_SAPLING = 4


@pytest.fixture(scope='module')
def client(tmp_path_factory):
    """Make a client that serves a node of this process, too."""
    rclpy.init()
    made = Client()
    values = {**PARAMETERS, 'files.root': [str(tmp_path_factory.getbasetemp())]}
    made.sim = SimNode(parameter_overrides=[Parameter(name, value=value)
                                            for name, value in values.items()])
    made.host(made.sim)
    made.spin_until(lambda: made.sim.session.has_scene, 'the scene')
    yield made
    made.sim.destroy_node()
    made.close()
    rclpy.shutdown()


@pytest.fixture
def mended(client, monkeypatch):
    """Return the client of a node with the scene that it began with, and leave one that runs."""
    assert client.trigger('reload_scene').success
    yield client
    monkeypatch.undo()
    assert client.trigger('reload_scene').success
    assert client.switch('set_pause', False).success


@pytest.fixture
def paused(client):
    """Return the client of a node that is paused in the wind."""
    assert client.switch('set_pause', True).success
    assert client.set_parameter('wind.velocity', [9.0, 0.0, 0.0]).successful
    yield client
    assert client.set_parameter('wind.velocity', [0.0, 0.0, 0.0]).successful
    assert client.trigger('reload_scene').success
    assert client.switch('set_pause', False).success


def _written(path, content):
    path.write_bytes(content)
    return path


def use_file(paused, path):
    """Set the file of the services."""
    assert paused.set_parameter('state.file', str(path)).successful


def test_a_node_goes_back_to_a_saved_state(paused, tmp_path):
    """Save, go on for some steps, restore: time and poses are those of the file."""
    use_file(paused, tmp_path / 'state.bin')
    assert paused.trigger('step_simulation').success
    saved = paused.trigger('save_state')
    assert saved.success and 'state.bin' in saved.message
    simulation = paused.sim.session.simulation
    time, poses = simulation.time, simulation.poses.copy()
    for _ in range(5):
        assert paused.trigger('step_simulation').success
    assert not np.array_equal(simulation.poses, poses)
    restored = paused.trigger('restore_state')
    assert restored.success and f'{time:.3f} s' in restored.message
    np.testing.assert_array_equal(simulation.poses, poses)
    assert simulation.time == time


def test_a_saved_state_is_a_file_like_others_and_may_lie_at_home(paused, tmp_path, monkeypatch):
    """Write it with the mode that the umask leaves, and read ~ as other parameters do."""
    monkeypatch.setenv('HOME', str(tmp_path))
    use_file(paused, '~/state.bin')
    assert paused.trigger('save_state').success and paused.trigger('restore_state').success
    (tmp_path / 'other').write_bytes(b'')
    assert (tmp_path / 'state.bin').stat().st_mode == (tmp_path / 'other').stat().st_mode


@pytest.mark.parametrize(('prepare', 'word'), [
    (lambda folder: '', 'state.file is empty'),
    (lambda folder: folder / 'nothing.bin', 'cannot be read'),
    (lambda folder: folder, 'not a regular file'),
    (lambda folder: '/dev/zero', 'files.root allows'),
    (lambda folder: '~/.bashrc', 'files.root allows'),
    (lambda folder: _written(folder / 'other.bin', b'something else'), 'no snapshot')])
def test_what_is_no_state_is_refused_and_nothing_changes(paused, tmp_path, prepare, word):
    """Answer with one line that says what is wrong, and stay where it is."""
    simulation = paused.sim.session.simulation
    time, poses = simulation.time, simulation.poses.copy()
    use_file(paused, prepare(tmp_path))
    answer = paused.trigger('restore_state')
    assert not answer.success and word in answer.message and '\n' not in answer.message
    assert simulation.time == time
    np.testing.assert_array_equal(simulation.poses, poses)


def test_a_file_that_cannot_be_written_is_refused(paused, tmp_path):
    """Name the file and the reason."""
    use_file(paused, tmp_path / 'no folder' / 'state.bin')
    answer = paused.trigger('save_state')
    assert not answer.success and 'cannot be written' in answer.message


@pytest.mark.parametrize('make', [os.mkfifo, os.mkdir])
def test_what_is_no_plain_file_is_not_replaced(paused, tmp_path, make):
    """Leave a pipe, as a device, and a folder where they are."""
    path = tmp_path / 'state'
    make(path)
    before = path.stat()
    use_file(paused, path)
    answer = paused.trigger('save_state')
    assert not answer.success and 'is not a regular file' in answer.message
    assert path.stat().st_ino == before.st_ino and path.stat().st_mode == before.st_mode


def test_a_scene_file_is_not_replaced(paused, tmp_path):
    """Save where a file of another kind is: it stays, and the answer says why."""
    path = _written(tmp_path / 'scene.yaml', b'/**:')
    use_file(paused, path)
    answer = paused.trigger('save_state')
    assert not answer.success and 'no saved state' in answer.message
    assert path.read_bytes() == b'/**:'


def test_a_reload_reads_what_the_start_gave_and_nothing_outside(paused):
    """Refuse an include that came later in one line, and go on with the old scene."""
    assert paused.trigger('reload_scene').success
    text = f'include: /etc/passwd\n{SAPLING}'
    assert paused.set_parameter('sapling.grammar_text', text).successful
    answer = paused.trigger('reload_scene')
    assert not answer.success and 'files.root allows' in answer.message
    assert 'root:' not in answer.message
    assert paused.set_parameter('sapling.grammar_text', SAPLING).successful
    assert paused.trigger('reload_scene').success
    assert not paused.set_parameter('files.root', ['/']).successful


def describe(client, **values):
    """Set parameters `spawn.*`."""
    defaults = {'name': '', 'grammar': '', 'grammar_text': '', 'defines': [], 'seed': 0,
                'position': [0.0, 5.0, 0.0], 'yaw': 0.0}
    for name, value in (defaults | values).items():
        assert client.set_parameter(f'spawn.{name}', value).successful, name


def objects(client, fits):
    """Wait until the description holds objects that fit, and give them by name."""
    def read(message):
        return {o['name']: o for o in json.loads(message.data)['objects']}
    return read(client.next_message(String, '/sim/scene_description', qos.latched(),
                                    lambda message: fits(read(message))))


def test_an_object_joins_and_is_described_and_drawn(client):
    """Spawn a shipped shrub: parts are appended, description, markers and late joiners follow."""
    received = client.listen(MarkerArray, '/sim/markers', qos.changes())
    client.spin_until(lambda: received, 'markers')
    before = len(client.sim.session.simulation.poses)
    describe(client, grammar='shrub.lsys', position=[3.0, 4.0, 0.0], yaw=0.5)
    answer = client.trigger('spawn')
    assert answer.success and answer.message.startswith('shrub_0 stands at [3.0, 4.0, 0.0] m')
    told = objects(client, lambda found: 'shrub_0' in found)
    assert told['shrub_0']['first'] == before and 'removed' not in told['shrub_0']

    def drawn():
        return {m.ns for array in received for m in array.markers if m.action == Marker.ADD}
    client.spin_until(lambda: {'shrub_0', 'shrub_0/leaves'} <= drawn(), 'markers of the shrub')
    late = client.next_message(MarkerArray, '/sim/markers', qos.changes(),
                               lambda array: len(array.markers) > before)
    assert 'shrub_0' in {m.ns for m in late.markers}
    assert client.trigger('spawn').message.startswith('shrub_1 ')


def test_an_object_leaves_and_its_markers_go(client):
    """Remove an object of the scene: its markers are deleted, its name is not given again."""
    received = client.listen(MarkerArray, '/sim/markers', qos.changes())
    client.spin_until(lambda: received, 'markers')
    describe(client, name='sapling')
    assert client.trigger('remove').success

    def deleted():
        return {m.ns for array in received for m in array.markers if m.action == Marker.DELETE}
    client.spin_until(lambda: 'sapling' in deleted(), 'deletions')
    told = objects(client, lambda found: found['sapling'].get('removed'))
    assert told['sapling']['count'] == 4
    again = client.trigger('remove')
    assert not again.success and 'no object "sapling"' in again.message
    describe(client, name='sapling', grammar_text=SAPLING)
    refused = client.trigger('spawn')
    assert not refused.success and 'choose another name' in refused.message
    assert client.trigger('reload_scene').success


@pytest.mark.parametrize(('values', 'reason'), [
    ({}, 'either spawn.grammar'), ({'name': 'a b', 'grammar_text': SAPLING}, 'cannot name'),
    ({'grammar': '/etc/passwd'}, 'files.root allows'),
    ({'grammar_text': f'include: /etc/passwd\n{SAPLING}'}, 'files.root allows'),
    ({'grammar': 'no_such.lsys'}, 'spawn.grammar: there is no grammar'),
    ({'grammar_text': 'axiom: F(1'}, 'spawn.grammar_text:1:'),
    ({'grammar_text': 'module: A\naxiom: A'}, 'draws no segment'),
    ({'grammar_text': SAPLING, 'defines': ['height']}, "spawn.defines: 'height'"),
    ({'grammar_text': SAPLING, 'defines': ['seed=3']}, 'spawn.defines'),
    ({'name': 'sapling', 'grammar_text': SAPLING}, 'choose another name')])
def test_what_cannot_join_leaves_the_world_as_it_was(client, values, reason):
    """Say why in one line with its place, and change nothing."""
    simulation = client.sim.session.simulation
    before, poses = list(simulation.objects), simulation.poses.copy()
    describe(client, **values)
    answer = client.trigger('spawn')
    assert not answer.success and reason in answer.message and '\n' not in answer.message
    assert simulation.objects == before
    np.testing.assert_allclose(simulation.poses, poses, atol=1e-3)


def test_values_out_of_range_are_refused_when_they_are_set(client):
    """Keep a place that is none out of the parameters."""
    for name, value in (('position', [float('nan'), 0.0, 0.0]), ('position', [1.0, 2.0]),
                        ('seed', -1), ('yaw', 1e9)):
        assert not client.set_parameter(f'spawn.{name}', value).successful


def test_boxes_of_the_wind_come_and_go_while_it_runs(client):
    """Set boxes at once, keep them on reset and reload, and leave none once they are gone."""
    def count():
        return len(client.sim.session.simulation.wind.zones)
    boxes = ['size=4,4,4 speed=0.5', 'size=9,9,9 turn=1']
    assert client.set_parameter('wind.zones', boxes).successful
    client.spin_until(lambda: count() == 2, 'boxes')
    for service in ('reset_simulation', 'reload_scene'):
        assert client.trigger(service).success and count() == 2
    assert client.set_parameter('wind.zones', ['']).successful
    client.spin_until(lambda: count() == 0, 'no boxes')
    assert client.trigger('reload_scene').success and count() == 0


def test_reset_keeps_what_was_spawned_and_saved_states_have_it(client, tmp_path):
    """Reset and restore with a spawned object; only a reload is the scene of the parameters."""
    simulation = client.sim.session.simulation
    describe(client, name='late', grammar_text=SAPLING)
    assert client.trigger('spawn').success
    client.set_parameter('state.file', str(tmp_path / 'state.bin'))
    assert client.trigger('save_state').success
    assert client.trigger('reset_simulation').success
    assert simulation.added[-1] == 'late'
    assert client.trigger('remove').success and 'late' not in simulation.added
    assert client.trigger('restore_state').success and simulation.added[-1] == 'late'
    objects(client, lambda found: 'late' in found and not found['late'].get('removed'))
    assert client.trigger('reload_scene').success
    assert client.sim.session.simulation.added == ()


@pytest.mark.parametrize('rate, steps', [(5.0, [4, 16, 28, 40]), (25.0, [4, 7, 9, 12, 14, 16]),
                                         (90.0, [4, 5, 6, 7, 8])])
def test_scans_are_a_period_apart_from_the_first_one_on(rate, steps):
    """Begin to listen late, and go back in time: the next scan is as far from that as others."""
    publisher = Mock()
    lidar = LidarPublisher(Mock(create_publisher=lambda *a, **k: publisher,
                                get_fully_qualified_name=lambda: '/sim'),
                           Mock(nested=lambda: {'lidar': {'rate': rate}}))
    scanned = []
    simulation = Mock(time_step=1.0 / 60.0, timings={}, scan=lambda settings: scanned.append(step))
    for first in (4, 2):
        scanned.clear()
        for step in range(steps[-1] + first - 3):
            simulation.time = step * simulation.time_step
            publisher.get_subscription_count.return_value = int(step >= first)
            lidar.look(simulation)
        assert scanned == [step + first - 4 for step in steps]


def test_a_lidar_scans_at_its_rate_of_simulated_time(client):
    """Hear organised clouds at stamps a period apart, with the parts that were hit."""
    assert not client.set_parameter('lidar.horizontal_field', 9.0).successful
    refused = client.set_parameter('lidar.attached_to', 'drone')
    assert not refused.successful and 'no intruder "drone"' in refused.reason
    assert client.set_parameter('lidar.columns', 91).successful
    assert client.set_parameter('lidar.position', [-2.0, 0.0, 0.5]).successful
    received = client.listen(PointCloud2, '/sim/lidar')
    assert client.set_parameter('lidar.rate', 5.0).successful
    client.spin_until(lambda: len(received) > 3, 'scans')
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in received]
    np.testing.assert_allclose(np.diff(stamps), 0.2, atol=1e-6)
    cloud = received[-1]
    assert (cloud.height, cloud.width, cloud.is_dense) == (64, 91, False)
    assert cloud.header.frame_id == 'world' and cloud.row_step * cloud.height == len(cloud.data)
    rows = np.frombuffer(cloud.data, SCAN).reshape(64, 91)
    stem = rows[rows['part'] == 0]
    assert len(stem) and np.hypot(stem['x'], stem['y']).max() < 0.1
    ground = rows[rows['part'] == GROUND]
    np.testing.assert_allclose(ground['z'], 0.0, atol=1e-4)
    assert client.set_parameter('lidar.frame', 'sensor').successful
    client.spin_until(lambda: received[-1].header.frame_id == 'sensor', 'another frame')
    rows = np.frombuffer(received[-1].data, SCAN)
    np.testing.assert_allclose(rows['z'][rows['part'] == GROUND], -0.5, atol=1e-4)
    assert client.set_parameter('lidar.rate', 0.0).successful


def status_where(client, fits) -> DiagnosticStatus:
    """Wait for a status that fits."""
    return client.next_message(DiagnosticArray, '/diagnostics', 10,
                               lambda array: fits(array.status[0])).status[0]


def break_steps(monkeypatch) -> None:
    """Make every step raise an error."""
    def step(self, n=1):
        raise ZeroDivisionError('division by zero')
    monkeypatch.setattr(Simulation, 'step', step)


@pytest.mark.parametrize('remedy', ['reset_simulation', 'reload_scene'])
def test_a_step_that_raises_stops_time_and_nothing_else(mended, monkeypatch, remedy):
    """Say so as an error, answer on, refuse to go on, and start anew when told to."""
    break_steps(monkeypatch)
    status = status_where(mended, lambda s: s.level == DiagnosticStatus.ERROR)
    assert 'ZeroDivisionError: division by zero' in status.message and remedy in status.message
    assert mended.switch('set_wind_enabled', True).success
    for refused in (mended.switch('set_pause', False), mended.trigger('step_simulation')):
        assert not refused.success and 'ZeroDivisionError' in refused.message
        assert remedy in refused.message
    monkeypatch.undo()
    assert mended.trigger(remedy).success
    status = status_where(mended, lambda s: s.message in ('running', 'paused'))
    assert status.level == DiagnosticStatus.OK
    assert len(mended.next_message(PoseArray, '/sim/poses').poses) == PARTS_OF_SAPLING


def test_a_step_on_demand_that_raises_is_refused(mended, monkeypatch):
    """Answer with the reason, and let time stand still as after any step that went wrong."""
    assert mended.switch('set_pause', True).success
    break_steps(monkeypatch)
    answer = mended.trigger('step_simulation')
    assert not answer.success and 'ZeroDivisionError' in answer.message
    monkeypatch.undo()
    assert 'went wrong' in mended.trigger('step_simulation').message
    assert mended.trigger('reset_simulation').success
    assert mended.trigger('step_simulation').success


@pytest.mark.parametrize('owner, name', [(Scene, 'from_parameters'), (Simulation, '__init__')])
def test_a_reload_that_raises_leaves_the_scene(mended, monkeypatch, owner, name):
    """Refuse it with the reason; the old scene goes on."""
    def fail(*_, **__):
        raise IndexError('list index out of range')
    monkeypatch.setattr(owner, name, fail)
    answer = mended.trigger('reload_scene')
    assert not answer.success
    assert 'IndexError' in answer.message and 'stays as it was' in answer.message
    begin = status_where(mended, lambda s: s.message == 'running')
    assert begin.level == DiagnosticStatus.OK
    assert len(mended.next_message(PoseArray, '/sim/poses').poses) == PARTS_OF_SAPLING


def test_a_reset_that_raises_can_be_followed_by_a_reload(mended, monkeypatch):
    """Stop time, since nothing can be said of the state then, until a scene was built."""
    def fail(self):
        raise KeyError('poses')
    monkeypatch.setattr(Simulation, 'reset', fail)
    answer = mended.trigger('reset_simulation')
    assert not answer.success and 'KeyError' in answer.message
    status_where(mended, lambda s: s.level == DiagnosticStatus.ERROR)
    monkeypatch.undo()
    assert mended.trigger('reload_scene').success


@pytest.mark.parametrize('topic, kind', [('impulse', WrenchStamped), ('wind', Vector3Stamped)])
def test_a_message_that_is_not_text_is_rejected(client, topic, kind):
    """Count a message whose name of a frame is no UTF-8, and take the next."""
    message = kind()
    message.header.frame_id = 'AAAA'
    data = serialize_message(message).replace(b'AAAA', b'\xff\xfe\x80\xc1')
    publisher = client.publisher(kind, f'/sim/{topic}')
    status = client.watch_status()
    before = int(status().get(f'rejected {topic}', 0))
    client.send_until(lambda: int(status().get(f'rejected {topic}', 0)) > before, 'a rejection',
                      (publisher, data))
    assert status()['last rejection'].startswith(f'{topic}: ')
    client.node.destroy_publisher(publisher)


def test_a_status_line_that_nobody_reads_is_given_up(mended, monkeypatch):
    """Say once that the reader of the output has gone, and go on without the line."""
    node, told = mended.sim, []
    mended.spin_until(lambda: node.session.has_scene, 'a scene')
    logger = SimpleNamespace(warning=told.append, info=told.append)
    monkeypatch.setattr(node, '_has_status_line', True)
    monkeypatch.setattr(node, 'get_logger', lambda: logger)
    monkeypatch.setattr(sys, 'stdout', _Closed())
    for _ in range(3):
        node._report()
    assert told == ['no more status lines: Broken pipe']


class _Closed:
    """A standard output whose reader has gone."""

    def write(self, text: str) -> None:
        raise BrokenPipeError(errno.EPIPE, 'Broken pipe')

    flush = isatty = lambda self: None
