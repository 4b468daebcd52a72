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

"""Joint drive: the command to the motor of a joint of a mechanism."""

from dataclasses import dataclass

from procphys_ros.errors import CommandError
from procphys_ros.schema import declared, ParameterGroup

_FASTEST = 1e6  # [m], [rad], [m/s], [rad/s], [N] and [N·m], beyond any motor
MODES = ('position', 'velocity', 'effort')


@dataclass(frozen=True)
class DriveJoint(ParameterGroup, group='joint', error=CommandError):
    """
    Let a joint move to a displacement, or at a speed, or drive it with a force or moment.

    A position or velocity is held with the force that the motor has; an effort above that is
    limited to it. A position is approached at the highest speed of the motor.

    :ivar value: [m] or [rad], [m/s] or [rad/s], [N] or [N·m]; an effort of 0 = the motor is off.
    """

    target: str = declared('', 'name of the joint, as crane/slew')
    mode: str = declared('velocity', 'what it is driven to', choices=MODES)
    value: float = declared(0.0, 'that', '', -_FASTEST, _FASTEST)
