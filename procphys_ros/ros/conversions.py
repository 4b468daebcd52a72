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


"""Read command messages: numbers that are finite, in a frame that is the simulation's."""

import math

from geometry_msgs.msg import Point, Pose, Vector3
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from procphys_ros.errors import CommandError
from procphys_ros.scene.joint_drive import DriveJoint, MODES

Triple = tuple[float, float, float]
_MOST_JOINTS = 10_000  # in a message, as many as a mechanism has parts
_LONGEST_NAME = 256  # [characters] of a part; those of the longest names in ROS


def triple(vector: Vector3 | Point, what: str) -> Triple:
    """
    Read three numbers.

    :param what: name of the vector, for the error message.
    :raises CommandError: if one of them is not finite.
    """
    values = (vector.x, vector.y, vector.z)
    if not all(map(math.isfinite, values)):
        raise CommandError(f'{what} is {list(values)}, its numbers must be finite')
    return values


def check_frame(header: Header, frame: str) -> None:
    """
    Reject vectors in a frame other than the world; an empty frame means the world.

    :param frame: the frame of the simulation.
    :raises CommandError: naming both frames.
    """
    if header.frame_id not in ('', frame):
        raise CommandError(f'frame_id is "{header.frame_id}", it must be "{frame}" or empty; '
                           'there are no transforms here')


def pose(message: Pose) -> tuple[float, ...]:
    """Read a pose as x y z qx qy qz qw, (7,)."""
    place, turn = message.position, message.orientation
    return place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w


def part_name(text: str, where: str) -> str:
    """
    Read the name of a part.

    :param text: the field for the name.
    :param where: name of the field, for the error message.
    :raises CommandError: if it is empty, or longer than any name.
    """
    if not text:
        raise CommandError(f'{where} is empty, it must name a part, such as oak_0/17')
    if len(text) > _LONGEST_NAME:
        raise CommandError(f'{where} has {len(text)} characters, the name of a part has at most '
                           f'{_LONGEST_NAME}')
    return text


def joint_drives(message: JointState) -> list[DriveJoint]:
    """
    Read a command to joints: names, and a position, a velocity or an effort of each.

    :raises CommandError: if there are no names, equal ones, not one kind of values, or not as many
        as names; or if a value is not finite, or out of range.
    """
    names = list(message.name)
    values = {mode: list(getattr(message, mode)) for mode in MODES}
    given = [mode for mode in MODES if values[mode]]
    if not 0 < len(names) <= _MOST_JOINTS:
        raise CommandError(f'there are {len(names)} names of joints, there must be 1 to '
                           f'{_MOST_JOINTS}')
    if len(given) != 1:
        raise CommandError(f'{" and ".join(given) or "nothing"} is given, it must be one of '
                           f'{", ".join(MODES)}')
    if len(values[given[0]]) != len(names):
        raise CommandError(f'there are {len(values[given[0]])} values in {given[0]} for '
                           f'{len(names)} names')
    if len(set(names)) < len(names):
        raise CommandError('a joint is named twice')
    return [DriveJoint(joint_name(name), given[0], value)
            for name, value in zip(names, values[given[0]])]


def joint_name(text: str) -> str:
    """Read the name of a joint; raise CommandError if it is longer than any name."""
    if len(text) > _LONGEST_NAME:
        raise CommandError(f'the name of a joint has {len(text)} characters, it has at most '
                           f'{_LONGEST_NAME}')
    return text
