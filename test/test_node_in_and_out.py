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


"""Objects that join a running node and leave it, and a lidar that looks at them."""

import json
import subprocess
import sys
from unittest.mock import Mock

from node_process import Client, SAPLING
import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from procphys_ros.messages.points import SCAN
from procphys_ros.physics.lidar import GROUND
from procphys_ros.ros import qos
from procphys_ros.ros.lidar import LidarPublisher
from procphys_ros.ros.node import SimNode

PARAMETERS = {'scene.objects': ['sapling'], 'sapling.grammar_text': SAPLING,
              'service_deadline': 3600.0, 'status_line': 'off', 'real_time_factor': 1.0}


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


class Speaker:
    """Says sentences on the command line while this thread serves the node."""

    def __init__(self, client):
        self._client = client
        self.heard = ''

    def say(self, *words):
        """Run the command, and give its exit code."""
        speaker = subprocess.Popen(
            [sys.executable, '-m', 'procphys_ros.ros.command', '--timeout', '60', *words],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self._client.spin_until(lambda: speaker.poll() is not None, 'the command')
        self.heard = speaker.stdout.read()
        return speaker.returncode


def test_the_command_line_spawns_and_removes(client, tmp_path):
    """Say it in a sentence, with a file of one's own; what is refused ends with code 1."""
    path = tmp_path / 'mine.lsys'
    path.write_text('define: long = 1\naxiom: Width(0.05) F(long)', 'utf-8')
    speaker = Speaker(client)
    assert speaker.say('spawn', str(path), '4', '-2', '--yaw', '-0.5', '--define', 'long=2') == 0
    assert speaker.heard.startswith('mine_0 stands at [4.0, -2.0, 0.0] m')
    np.testing.assert_allclose(client.sim.session.simulation.blueprint.poses[-1, :3], [4, -2, 1])
    assert speaker.say('remove', 'mine_0') == 0 and 'mine_0 is gone' in speaker.heard
    assert speaker.say('list') == 0 and 'mine_0' not in speaker.heard
    assert 'sapling' in speaker.heard
    scan = tmp_path / 'oak.csv'  # of which the node reads the file itself
    scan.write_text('x1,y1,z1,x2,y2,z2,radius\n0,0,0,0,0,2,0.1\n', 'utf-8')
    assert speaker.say('spawn', str(scan), '9') == 0
    assert speaker.heard.startswith('oak_0 stands at [9.0, 0.0, 0.0] m, 1 parts')


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
