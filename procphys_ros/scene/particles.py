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

"""Settings of particles: leaves, attached and shed, and dust."""

from dataclasses import dataclass

from procphys_ros.physics.foliage import SHEDDING_SPEED
from procphys_ros.schema import declared, ParameterGroup


@dataclass(frozen=True)
class LeafSettings(ParameterGroup, group='leaves'):
    """
    Flutter and shedding of leaves.

    :ivar shedding_speed: least local wind that sheds leaves [m/s]; at three times as much two
        thirds of them are gone. Low values are for autumn. Species whose grammar names a
        speed of their own keep its ratio to 17 m/s.
    """

    flutter: bool = declared(True, 'whether leaves move finely about their petioles')
    shedding: bool = declared(True, 'whether strong wind tears leaves off')
    shedding_speed: float = declared(SHEDDING_SPEED, 'least local wind that takes a leaf', 'm/s',
                                     0.5, 150.0)


@dataclass(frozen=True)
class DustSettings(ParameterGroup, group='dust'):
    """Dust of breaking mortar, and of bodies that hit the ground and each other."""

    enabled: bool = declared(True, 'whether mortar and impacts raise dust')
    capacity: int = declared(20_000, 'puffs of dust; beyond it the oldest are forgotten', '',
                             1, 1_000_000)
