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


"""Bytes of ROS messages written straight from numpy arrays; nothing here needs ROS."""

from procphys_ros.messages.cdr import clock, Stamp, stamp, stamped_numbers
from procphys_ros.messages.ground import ground_markers
from procphys_ros.messages.markers import MarkerStyle, SceneMarkers
from procphys_ros.messages.points import break_rows, dust_rows, point_cloud, scan_rows
from procphys_ros.messages.poses import pose_array
from procphys_ros.messages.scene_description import SceneDescription

__all__ = ['break_rows', 'clock', 'dust_rows', 'ground_markers', 'MarkerStyle', 'point_cloud',
           'pose_array', 'scan_rows', 'SceneDescription', 'SceneMarkers', 'Stamp', 'stamp',
           'stamped_numbers']
