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


"""Loads on parts: air blast, wind pressure on boxes, swept projectiles."""

from procphys_ros.physics.loads import air_blast, faces, wind_pressure
from procphys_ros.physics.loads.blast import blast_boxes, blast_capsules, Impulses
from procphys_ros.physics.loads.gas_pressure import gas_impulse, peak_pressure
from procphys_ros.physics.loads.lattice import heading
from procphys_ros.physics.loads.room import find_room, Room
from procphys_ros.physics.loads.sight import Sight
from procphys_ros.physics.loads.skin import outer_faces
from procphys_ros.physics.loads.sweep import (
    Hits,
    sweep_box_boxes,
    sweep_box_capsules,
    sweep_boxes,
    sweep_capsules,
)
from procphys_ros.physics.loads.wall_faces import with_joints
from procphys_ros.physics.loads.wind_forces import exposed_faces, Skin, WallPressure

__all__ = ['Hits', 'Impulses', 'Room', 'Sight', 'Skin', 'WallPressure', 'air_blast',
           'blast_boxes', 'blast_capsules', 'exposed_faces', 'faces', 'find_room',
           'gas_impulse', 'heading', 'outer_faces', 'peak_pressure',
           'sweep_box_boxes', 'sweep_box_capsules', 'sweep_boxes', 'sweep_capsules',
           'wind_pressure', 'with_joints']
