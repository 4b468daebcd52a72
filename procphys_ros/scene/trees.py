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

"""Settings of trees."""

from dataclasses import dataclass

from procphys_ros.environment import STORM
from procphys_ros.schema import declared, ParameterGroup


@dataclass(frozen=True)
class TreeSettings(ParameterGroup, group='trees'):
    """Settings of all trees."""

    contact: bool = declared(
        False, 'whether the branches of different standing trees touch, instead of passing '
        'through each other')

    growth_wind: tuple[float, ...] = declared(
        (0.0, 0.0, 0.0), 'steady wind that bends plants while they grow, where their grammars '
        'ask for sag', 'm/s', -100.0, 100.0)
    growth_storm: float = declared(
        STORM, 'strongest wind, from any side, that plants grow for, where their grammars ask for '
        'load', 'm/s', 0.0, 100.0)
