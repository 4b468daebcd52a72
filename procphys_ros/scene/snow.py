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

"""Snow and ice that lie on a scene."""

from dataclasses import dataclass

from procphys_ros.errors import CommandError
from procphys_ros.schema import declared, ParameterGroup


@dataclass(frozen=True)
class SnowLoad(ParameterGroup, group='load', error=CommandError):
    """Describe the snow and ice that lie on trees and buildings, or a change of them."""

    snow: float = declared(
        0.0, 'snow on open ground; crowns, roofs and ledges carry what they catch of it', 'kg/m²',
        0.0, 2000.0)
    ice: float = declared(
        0.0, 'thickness of a coat of ice around all twigs, and on one side of leaves', 'm', 0.0,
        0.2)
    ramp: float = declared(
        10.0, 'time in which changes of load.snow and load.ice come about', 's', 0.0, 1e6)
