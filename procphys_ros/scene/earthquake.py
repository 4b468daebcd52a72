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


"""Earthquakes: what shakes the ground of a scene."""

from collections.abc import Sequence
from dataclasses import dataclass

from procphys_ros.elementary import hypot
from procphys_ros.errors import CommandError
from procphys_ros.schema import declared, ParameterGroup


@dataclass(frozen=True)
class GroundSettings(ParameterGroup, group='ground'):
    """Describe how the ground of a scene can move."""

    motion: Sequence[str] = declared(
        (), 'record that earthquakes follow: a CSV file of time and one to three accelerations, '
        'or one to three PEER files (.AT2): along earthquake.direction, to its left, up; none = '
        'earthquakes are synthetic', takes_effect='reload')


@dataclass(frozen=True)
class Earthquake(ParameterGroup, group='earthquake', error=CommandError):
    """Describe an earthquake."""

    scale: float = declared(1.0, 'of the accelerations of ground.motion', '', -100.0, 100.0)
    start: float = declared(0.0, 'of ground.motion, that is left out', 's', 0.0, 1e6)
    direction: Sequence[float] = declared(
        (1.0, 0.0, 0.0), 'of the first component of ground.motion, or of the strongest shaking; '
        'level, of any length')
    peak: float = declared(3.0, 'greatest acceleration, without ground.motion', 'm/s²', 1e-6, 50.0)
    duration: float = declared(12.0, 'of a synthetic motion, until it fades', 's', 0.5, 600.0)
    frequency: float = declared(
        2.5, 'of the soil, in a synthetic motion: firm 2.5, rock 5, soft 1', 'Hz', 0.1, 20.0)
    damping: float = declared(0.6, 'ratio of the soil, in a synthetic motion', '', 0.05, 0.95)
    seed: int = declared(0, 'of a synthetic motion, beside that of the scene', '', 0, 2**31 - 1)

    def __post_init__(self) -> None:
        super().__post_init__()
        x, y, z = self.direction
        if z != 0.0 or not hypot(x, y) > 0.0:
            raise CommandError(f'earthquake.direction is {list(self.direction)}, it must be level '
                               'and have a length')
