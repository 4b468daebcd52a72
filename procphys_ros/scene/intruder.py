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


"""Settings of the intruder: a body moved from outside the simulation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.scene.solids import edges_of, SHAPES
from procphys_ros.schema import declared, ParameterGroup

_LARGEST = 50.0  # [m]
FASTEST_SAW = 10.0  # [m/s]


@dataclass(frozen=True)
class IntruderSettings(ParameterGroup, group='intruder'):
    """Collision body of a robot, a drone or a vehicle of another simulator."""

    shape: str = declared('box', 'of the body that ~/intruder moves', choices=SHAPES)
    size: float | Sequence[float] = declared(
        (1.0, 1.0, 1.0), 'its diameter, or three edges', 'm', 1e-3, _LARGEST, any_length=True)
    cuts: float = declared(
        0.0, 'how fast it saws through branches and bricks that it is moved into; 0 = it only '
        'pushes', 'm/s', 0.0, FASTEST_SAW)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, 'size', tuple(self.edges.tolist()))  # however it was written

    @property
    def edges(self) -> np.ndarray:
        """Return the full extents along its axes [m], (3,)."""
        return edges_of(self)


@dataclass(frozen=True)
class Downwash(ParameterGroup, group='downwash'):
    """Jet of air below the rotors of an intruder."""

    radius: float = declared(
        0.3, 'of one disk as large as all rotors of the intruder whose thrust ~/downwash sets',
        'm', 0.01, 20.0)
