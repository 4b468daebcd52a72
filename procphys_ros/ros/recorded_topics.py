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

"""Recorded topics: which they are, of what type, and at what quality of service."""

from geometry_msgs.msg import PoseArray, Vector3Stamped, WrenchStamped
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from procphys_ros.ros import qos

# Names are relative to that of the node, except absolute ones.
TOPICS: dict[str, tuple[type, QoSProfile]] = {
    'poses': (PoseArray, qos.arrays()), 'markers': (MarkerArray, qos.changes()),
    'scene_description': (String, qos.latched()), 'ground': (MarkerArray, qos.latched()),
    'breaks': (PointCloud2, qos.changes()),
    'dust': (PointCloud2, qos.newest()), 'wind_info': (Vector3Stamped, qos.arrays()),
    'intruder_wrench': (WrenchStamped, qos.arrays()), '/clock': (Clock, qos.newest())}
KIND_NAMES = {kind: f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
              for kind, _ in TOPICS.values()}
