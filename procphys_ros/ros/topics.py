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

"""Topics that a node publishes: of what type each is, and at what quality of service."""

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped, PoseArray, Vector3Stamped, WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Bool, String
from visualization_msgs.msg import MarkerArray

from procphys_ros.ros import qos

# Names are relative to that of the node, except absolute ones.
TOPICS: dict[str, tuple[type, Callable[[], QoSProfile]]] = {
    'poses': (PoseArray, qos.arrays), 'leaf_poses': (PoseArray, qos.arrays),
    'markers': (MarkerArray, qos.changes), 'ground': (MarkerArray, qos.latched),
    'scene_description': (String, qos.latched), 'ready': (Bool, qos.latched),
    'leaves': (PointCloud2, qos.latched), 'broken_bonds': (PointCloud2, qos.latched),
    'breaks': (PointCloud2, qos.changes), 'dust': (PointCloud2, qos.newest),
    'lidar': (PointCloud2, qos.arrays), 'wind_info': (Vector3Stamped, qos.arrays),
    'ground_motion': (AccelStamped, qos.arrays), 'joint_states': (JointState, qos.arrays),
    'intruder_wrench': (WrenchStamped, qos.arrays), '/clock': (Clock, qos.newest),
    '/diagnostics': (DiagnosticArray, qos.arrays)}
RECORDED = ('poses', 'markers', 'scene_description', 'ground', 'breaks', 'dust', 'wind_info',
            'intruder_wrench', '/clock')
KIND_NAMES = {kind: f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
              for kind, _ in (TOPICS[topic] for topic in RECORDED)}


def full_name(source: str, topic: str) -> str:
    """Return the name of a topic of a node."""
    return topic if topic.startswith('/') else f'{source}/{topic}'


def offer(node: Node, topic: str, like: str = '', **options: Any) -> Publisher:
    """
    Create a publisher; see `qos.publisher`.

    :param topic: name without that of the node.
    :param like: topic of the table that has its type and quality; '' = itself.
    """
    kind, profile = TOPICS[like or topic]
    return qos.publisher(node, kind, full_name('~', topic), profile(), **options)


def follow(node: Node, source: str, topic: str, take: Callable[[Any], Any],
           raw: bool = False) -> Subscription:
    """
    Subscribe to a topic of another node.

    :param source: absolute name of that node.
    :param take: called with each message, with its bytes if `raw`.
    """
    kind, profile = TOPICS[topic]
    return node.create_subscription(kind, full_name(source, topic), take, profile(), raw=raw)
