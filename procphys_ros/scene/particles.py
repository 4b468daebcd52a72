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
from procphys_ros.schema import check, declared


@dataclass(frozen=True)
class LeafSettings:
    """
    Flutter and shedding of leaves.

    :ivar flutter: whether they move finely about their petioles.
    :ivar shedding: whether strong wind tears them off.
    :ivar shedding_speed: least local wind that sheds leaves [m/s]; at three times as much two
        thirds of them are gone. Low values are for autumn. Species whose grammar names a
        speed of their own keep its ratio to 17 m/s.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    flutter: bool = declared(True, 'whether leaves move finely about their petioles')
    shedding: bool = declared(True, 'whether strong wind tears leaves off')
    shedding_speed: float = declared(SHEDDING_SPEED, 'least local wind that takes a leaf', 'm/s',
                                     0.5, 150.0)

    def __post_init__(self) -> None:
        check(self, 'leaves')


@dataclass(frozen=True)
class DustSettings:
    """
    Dust of breaking mortar, and of bodies that hit the ground and each other.

    :ivar enabled: whether dust is simulated.
    :ivar capacity: number of puffs; beyond it the oldest are deleted.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    enabled: bool = declared(True, 'whether mortar and impacts raise dust')
    capacity: int = declared(20_000, 'puffs of dust; beyond it the oldest are forgotten', '',
                             1, 1_000_000)

    def __post_init__(self) -> None:
        check(self, 'dust')
