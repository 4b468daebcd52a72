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


"""Settings of the level of detail far from the observer."""

from dataclasses import dataclass

from procphys_ros.schema import declared, ParameterGroup

_MOST_STEPS = 4  # longer intervals smooth away the sway of small branches


@dataclass(frozen=True)
class CullingSettings(ParameterGroup, group='culling'):
    """
    Independent schemes that save work, all off by default.

    All but sleeping need an observer, and do nothing before there is one.

    :ivar far_interval: most steps between updates of far trees, which wait one step more for
        every `far_distance` that they are away; 1 = update in every step.
    """

    distance: float = declared(
        0.0, 'trees further from ~/observer stand still; 0 = none do', 'm', 0.0, 1e6)
    frustum: bool = declared(False, 'whether trees outside the widened view stand still')
    field_of_view: float = declared(1.0, 'vertical opening of the view', 'rad', 0.01, 3.13)
    aspect: float = declared(16.0 / 9.0, 'width over height of the picture', '', 0.1, 10.0)
    widening: float = declared(
        0.15, 'by which the view is opened on each side', 'rad', 0.0, 1.57)
    sleeping: bool = declared(False, 'whether trees at rest in still air stop being stepped')
    far_distance: float = declared(40.0, 'where trees count as far', 'm', 1.0, 1e6)
    far_interval: int = declared(
        1, 'far trees go on once in so many steps; 1 = in every one', '', 1, _MOST_STEPS)
    debris_distance: float = declared(
        0.0, 'what falls further from ~/observer breaks into few large pieces; 0 = nowhere', 'm',
        0.0, 1e6)

    @property
    def spares_trees(self) -> bool:
        """Return whether any scheme leaves trees out of steps."""
        return self.sleeping or self.frustum or self.distance > 0.0 or self.far_interval > 1
