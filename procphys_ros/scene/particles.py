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

"""Settings of what is small and light: leaves on their petioles and off, and dust."""

from dataclasses import dataclass
import numbers

from procphys_ros.errors import SceneError
from procphys_ros.physics.foliage import SHEDDING_SPEED
from procphys_ros.physics.wind.settings import check_number

_MOST_PUFFS = 1_000_000


@dataclass(frozen=True)
class LeafSettings:
    """
    What leaves do beyond riding on their branches.

    :ivar flutter: whether they move finely about their petioles.
    :ivar shedding: whether strong wind tears them off.
    :ivar shedding_speed: the least local wind that takes a leaf [m/s]; at three times as much
        two thirds of them are gone. Low values are for autumn.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    flutter: bool = True
    shedding: bool = True
    shedding_speed: float = SHEDDING_SPEED

    def __post_init__(self) -> None:
        _check_switch('leaves.flutter', self.flutter)
        _check_switch('leaves.shedding', self.shedding)
        check_number('leaves.shedding_speed', self.shedding_speed, 0.5, 150.0)


@dataclass(frozen=True)
class DustSettings:
    """
    Dust of bursting mortar and of things that hit the ground and each other.

    :ivar enabled: whether there is any.
    :ivar capacity: number of puffs; when there are more, the oldest are forgotten.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    enabled: bool = True
    capacity: int = 20_000

    def __post_init__(self) -> None:
        _check_switch('dust.enabled', self.enabled)
        if isinstance(self.capacity, bool) or not isinstance(self.capacity, numbers.Integral) \
                or not 1 <= self.capacity <= _MOST_PUFFS:
            raise SceneError(f'dust.capacity is {self.capacity!r}, it must be a whole number from '
                             f'1 to {_MOST_PUFFS}')


def _check_switch(name: str, value: bool) -> None:
    if not isinstance(value, bool):
        raise SceneError(f'{name} is {value!r}, it must be true or false')
