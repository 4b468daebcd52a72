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

"""What the node offers to the graph: topics, their quality of service, services, parameters."""

from pathlib import Path
import re
from types import SimpleNamespace

from node_process import Client, NodeProcess, SCENE
import pytest
from rcl_interfaces.srv import DescribeParameters
import rclpy
from rclpy.qos import (
    DurabilityPolicy,
    qos_check_compatible,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
)
import yaml

from procphys_ros.messages.points import BREAK, DUST, SCAN
from procphys_ros.ros.diagnostics import Diagnostics
from procphys_ros.ros.lidar import LidarPublisher
from procphys_ros.ros.node import SimNode
from procphys_ros.ros.publishers import Publishers
from procphys_ros.scene.parameter_table import GLOBAL, listing, OBJECT

PUBLISHED = {
    '/sim/poses': 'geometry_msgs/msg/PoseArray',
    '/sim/markers': 'visualization_msgs/msg/MarkerArray',
    '/sim/scene_description': 'std_msgs/msg/String',
    '/sim/ground': 'visualization_msgs/msg/MarkerArray',
    '/sim/breaks': 'sensor_msgs/msg/PointCloud2',
    '/sim/broken_bonds': 'sensor_msgs/msg/PointCloud2',
    '/sim/ready': 'std_msgs/msg/Bool',
    '/sim/dust': 'sensor_msgs/msg/PointCloud2',
    '/sim/leaves': 'sensor_msgs/msg/PointCloud2',
    '/sim/leaf_poses': 'geometry_msgs/msg/PoseArray',
    '/sim/lidar': 'sensor_msgs/msg/PointCloud2',
    '/sim/wind_info': 'geometry_msgs/msg/Vector3Stamped',
    '/sim/ground_motion': 'geometry_msgs/msg/AccelStamped',
    '/sim/intruder_wrench': 'geometry_msgs/msg/WrenchStamped',
    '/sim/joint_states': 'sensor_msgs/msg/JointState',
    '/clock': 'rosgraph_msgs/msg/Clock',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}
TAKEN = {
    '/sim/wind': 'geometry_msgs/msg/Vector3Stamped',
    '/sim/impulse': 'geometry_msgs/msg/WrenchStamped',
    '/sim/wrench': 'geometry_msgs/msg/WrenchStamped',
    '/sim/explosion': 'geometry_msgs/msg/PointStamped',
    '/sim/observer': 'geometry_msgs/msg/PoseStamped',
    '/sim/intruder': 'geometry_msgs/msg/PoseStamped',
    '/sim/downwash': 'geometry_msgs/msg/WrenchStamped',
    '/sim/joint_command': 'sensor_msgs/msg/JointState',
}
SERVICES = {
    **dict.fromkeys(('/sim/set_wind_enabled', '/sim/set_pause'), 'std_srvs/srv/SetBool'),
    **dict.fromkeys(
        (f'/sim/{name}' for name in (
            'gust', 'apply_impulse', 'launch_projectile', 'explode', 'demolish', 'cut',
            'earthquake', 'grow', 'clear_wrenches', 'step_simulation', 'reset_simulation',
            'reload_scene', 'cancel_reload', 'save_state', 'restore_state', 'spawn', 'remove',
            'inspect')),
        'std_srvs/srv/Trigger'),
}
# What the displays of RViz draw.
DRAWN = {'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
         'rviz_default_plugins/PointCloud2': 'sensor_msgs/msg/PointCloud2',
         'rviz_default_plugins/PoseArray': 'geometry_msgs/msg/PoseArray'}
ROOT = Path(__file__).resolve().parents[1]
LATCHED = ('/sim/scene_description', '/sim/ground', '/sim/broken_bonds', '/sim/ready',
           '/sim/leaves')
# Markers show leaves and what has broken; arrows or points on top would hide them.
NOT_IN_RVIZ = ('/sim/leaf_poses', '/sim/broken_bonds', '/sim/leaves')
OF_EVERY_NODE = ('/rosout', '/parameter_events')


@pytest.fixture(scope='module')
def client(tmp_path_factory):
    """Make a client of a node that runs for all tests of this file."""
    rclpy.init()
    made = Client()
    node = NodeProcess(tmp_path_factory.mktemp('node'), SCENE)
    node.wait_for_banner()
    yield made
    made.close()
    node.kill()
    rclpy.try_shutdown()


def names(pairs) -> dict[str, str]:
    """Read names and types as the graph tells them, without what every node has."""
    return {name: types[0] for name, types in pairs
            if name not in OF_EVERY_NODE and 'rcl_interfaces' not in types[0]}


def test_the_graph_shows_every_topic_and_service(client):
    """Find the names and types of the interface, and no others."""
    graph = client.node

    def seen():
        published = graph.get_publisher_names_and_types_by_node('sim', '/')
        taken = graph.get_subscriber_names_and_types_by_node('sim_commands', '/')
        services = names(graph.get_service_names_and_types_by_node('sim', '/'))
        return names(published), names(taken), {
            name: kind for name, kind in services.items()
            if '/simulation_interfaces/' not in name and 'type_description' not in kind}

    def discovered():  # what is discovered may come in any order, and late
        return ({'sim', 'sim_commands'} <= set(graph.get_node_names())
                and all(len(found) >= len(wanted) for found, wanted in zip(
                    seen(), (PUBLISHED, TAKEN, SERVICES))))

    client.spin_until(discovered, 'the node in the graph')
    assert seen() == (PUBLISHED, TAKEN, SERVICES)


def test_all_topics_are_reliable_and_what_lasts_is_latched(client):
    """Offer what both reliable and best-effort subscribers can hear."""
    for topic in PUBLISHED:
        client.spin_until(lambda topic=topic: client.node.get_publishers_info_by_topic(topic),
                          topic)
        offered = client.node.get_publishers_info_by_topic(topic)[0].qos_profile
        assert offered.reliability == ReliabilityPolicy.RELIABLE, topic
        assert offered.durability == (
            DurabilityPolicy.TRANSIENT_LOCAL if topic in LATCHED
            else DurabilityPolicy.VOLATILE), topic


def profile(topic: dict) -> QoSProfile:
    """Read the quality of service that a display asks for."""
    assert topic['History Policy'] == 'Keep Last'
    return QoSProfile(
        depth=topic['Depth'],
        reliability=ReliabilityPolicy[topic['Reliability Policy'].upper().replace(' ', '_')],
        durability=DurabilityPolicy[topic['Durability Policy'].upper().replace(' ', '_')])


def test_rviz_is_set_up_for_what_the_node_publishes(client):
    """Ask for topics of the right type, with a quality of service that the node offers."""
    manager = yaml.safe_load((ROOT / 'config/procphys.rviz').read_text('utf-8'))[
        'Visualization Manager']
    frame = next(row.default for row in GLOBAL if row.name == 'world_frame')
    assert manager['Global Options']['Fixed Frame'] == frame
    displays = [d for d in manager['Displays'] if 'Topic' in d]
    shown = {d['Topic']['Value'] for d in displays}
    assert shown == {name for name, kind in PUBLISHED.items()
                     if kind in DRAWN.values() and name not in NOT_IN_RVIZ}
    for display in displays:
        topic = display['Topic']['Value']
        client.spin_until(lambda: client.node.get_publishers_info_by_topic(topic),  # noqa: B023
                          topic)
        offered = client.node.get_publishers_info_by_topic(topic)[0]
        assert offered.topic_type == DRAWN[display['Class']], topic
        asked = profile(display['Topic'])
        compatible, reason = qos_check_compatible(offered.qos_profile, asked)
        assert compatible != QoSCompatibility.ERROR, f'{topic}: {reason}'
    assert next(d for d in displays if d['Topic']['Value'] == '/sim/markers')['Enabled']


def test_rviz_colours_clouds_by_what_they_hold():
    """Colour points by a field that the rows of the topic have."""
    displays = yaml.safe_load((ROOT / 'config/procphys.rviz').read_text('utf-8'))[
        'Visualization Manager']['Displays']
    fields = {'/sim/breaks': BREAK.names, '/sim/dust': DUST.names, '/sim/lidar': SCAN.names}
    clouds = [d for d in displays if d['Class'] == 'rviz_default_plugins/PointCloud2']
    assert len(clouds) == len(fields)
    for display in clouds:
        assert display['Channel Name'] in fields[display['Topic']['Value']]


@pytest.mark.parametrize('text', [
    SimNode.__doc__, (ROOT / 'docs' / 'node.md').read_text('utf-8')], ids=['docstring', 'docs'])
def test_everything_offered_is_listed(text):
    """Name every topic and service where people look for them."""
    for name in (*PUBLISHED, *TAKEN, *SERVICES):
        assert name.replace('/sim/', '~/') in text, name


@pytest.mark.parametrize('topic', PUBLISHED)
def test_quality_of_service_is_told_as_it_is(topic):
    """Say in the docs and in the docstring with what quality each topic is published."""
    made = {}
    node = SimpleNamespace(
        create_publisher=lambda kind, name, profile, **_: (
            made.update({name: profile}) or SimpleNamespace(publish=lambda message: None)),
        get_fully_qualified_name=lambda: '/sim')
    parameters = {row.name: row.default for row in GLOBAL}
    Publishers(node, 'world', parameters)
    LidarPublisher(node, SimpleNamespace(nested=lambda: {'lidar': {}}))
    Diagnostics(node, None, None, None, None, None)
    name = topic.replace('/sim/', '~/')
    offered = made[name]
    depth = f'depth {offered.depth}'
    row = next(line for line in (ROOT / 'docs' / 'node.md').read_text('utf-8').splitlines()
               if line.startswith(f'| `{name}` |'))
    entry = next(line for line in SimNode.__doc__.splitlines() if line.strip().startswith(name))
    latched = offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
    for text in (row.split('|')[2], entry):
        assert re.search(rf'\b{depth}\b', text) and ('latched' in text) == latched
    assert offered.reliability == ReliabilityPolicy.RELIABLE and 'reliable' in row


def test_every_parameter_is_listed_in_the_docstring():
    """Name each row of the table with its default, unit, range and description."""
    text = ' '.join(SimNode.__doc__.split())
    for prefix, rows in (('', GLOBAL), ('<object>.', OBJECT)):
        assert listing(rows, prefix).lstrip() in SimNode.__doc__
        for row in rows:
            entry = text[text.index(f' {prefix}{row.name} (') + 1:]
            assert ' '.join(row.description.split()) in entry[:entry.find('): ') + 400], row.name
            assert row.unit in entry.partition(': ')[0]
    assert '{' not in text


def test_parameters_describe_themselves_to_clients(client):
    """Send descriptions, ranges and read-only marks of the table by the parameter services."""
    rows = {**{row.name: row for row in GLOBAL},
            **{f'sapling.{row.name}': row for row in OBJECT}}
    answer = client.call(DescribeParameters, '/sim/describe_parameters',
                         DescribeParameters.Request(names=list(rows)))
    assert [d.name for d in answer.descriptors] == list(rows)
    for descriptor, row in zip(answer.descriptors, rows.values()):
        assert descriptor.description.startswith(row.description), row.name
        assert not row.unit or f'[{row.unit}]' in descriptor.description
        assert descriptor.read_only == row.read_only
        for bounds in (*descriptor.floating_point_range, *descriptor.integer_range):
            assert (bounds.from_value, bounds.to_value) == (row.low, row.high), row.name
        is_number = type(row.default) in (int, float)
        assert is_number == bool(descriptor.floating_point_range or descriptor.integer_range)
