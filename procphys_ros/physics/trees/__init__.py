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

"""Trees: an O(n) articulated kernel for swaying, bending and breaking branches."""

from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.trees.anchors import Anchors
from procphys_ros.physics.trees.breaks import carried_rows, CAUSES
from procphys_ros.physics.trees.contact_response import ContactResponse
from procphys_ros.physics.trees.forest import Forest

__all__ = ['AIR_DENSITY', 'Anchors', 'carried_rows', 'CAUSES', 'ContactResponse', 'Forest']
