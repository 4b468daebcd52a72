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


"""Settings of the level of detail: what is simulated less, because nobody looks closely."""

from dataclasses import dataclass
import math
import numbers

from procphys_ros.errors import SceneError
from procphys_ros.physics.wind.settings import check_number

_MOST_STEPS = 4  # longer ones smooth the sway of small branches away
_WIDEST = 0.5 * math.pi


@dataclass(frozen=True)
class CullingSettings:
    """
    Schemes that save work, each by itself; none is in use unless it is asked for.

    All but sleeping need an observer, and do nothing before there is one.

    :ivar distance: trees further from the observer stand still [m]; 0 = none do.
    :ivar frustum: whether trees outside the observer's widened view stand still.
    :ivar field_of_view: vertical opening of the view [rad].
    :ivar aspect: width over height of the picture.
    :ivar widening: by which the view is opened on each side [rad].
    :ivar sleeping: whether trees that have come to rest in still air stop being stepped.
    :ivar far_distance: where trees count as far [m].
    :ivar far_interval: far trees go on once in so many steps at most, one step more for every
        `far_distance` that they are away; 1 = always at every step.
    :ivar debris_distance: what falls further from the observer [m] breaks into few large pieces,
        which stand for many small ones; 0 = nowhere.
    :raises SceneError: when a value is out of its range; the message names key and range.
    """

    distance: float = 0.0
    frustum: bool = False
    field_of_view: float = 1.0
    aspect: float = 16.0 / 9.0
    widening: float = 0.15
    sleeping: bool = False
    far_distance: float = 40.0
    far_interval: int = 1
    debris_distance: float = 0.0

    def __post_init__(self) -> None:
        for name in ('frustum', 'sleeping'):
            value = getattr(self, name)
            if not isinstance(value, bool):
                raise SceneError(f'culling.{name} is {value!r}, it must be true or false')
        for name, low, high in (('distance', 0.0, 1e6), ('field_of_view', 0.01, math.pi - 0.01),
                                ('aspect', 0.1, 10.0), ('widening', 0.0, _WIDEST),
                                ('far_distance', 1.0, 1e6), ('debris_distance', 0.0, 1e6)):
            check_number(f'culling.{name}', getattr(self, name), low, high)
        steps = self.far_interval
        if isinstance(steps, bool) or not isinstance(steps, numbers.Integral) \
                or not 1 <= steps <= _MOST_STEPS:
            raise SceneError(f'culling.far_interval is {steps!r}, it must be a whole number from '
                             f'1 to {_MOST_STEPS}')

    @property
    def spares_trees(self) -> bool:
        """Say whether any scheme leaves trees out of steps."""
        return self.sleeping or self.frustum or self.distance > 0.0 or self.far_interval > 1
