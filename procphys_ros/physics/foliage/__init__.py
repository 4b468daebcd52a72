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

"""Foliage: leaves that flutter about their petioles, tear off in gales, and fall."""

from procphys_ros.physics.foliage.fall import FallingLeaves
from procphys_ros.physics.foliage.flutter import carried, Flutter
from procphys_ros.physics.foliage.petioles import (
    air_speeds,
    drag_pressure,
    SHEDDING_SPEED,
    speed_of,
    strengths,
)

__all__ = ['air_speeds', 'carried', 'drag_pressure', 'FallingLeaves', 'Flutter',
           'SHEDDING_SPEED', 'speed_of', 'strengths']
