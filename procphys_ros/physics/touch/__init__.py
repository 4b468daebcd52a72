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


"""Touch: contacts of capsule segments with other shapes, and their impulses."""

from procphys_ros.physics.touch.broad import capsule_bounds, half_extent, overlaps, piece_bounds
from procphys_ros.physics.touch.depth import overlap_ball, overlap_box
from procphys_ros.physics.touch.geometry import meet, meet_ground, Meetings
from procphys_ros.physics.touch.impulses import islands, Partners, resolve, slips

__all__ = ['Meetings', 'Partners', 'capsule_bounds', 'half_extent', 'islands', 'meet',
           'meet_ground', 'overlap_ball', 'overlap_box', 'overlaps', 'piece_bounds', 'resolve',
           'slips']
