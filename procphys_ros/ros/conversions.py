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

from collections.abc import Callable
import math

from geometry_msgs.msg import Point, Pose, Vector3
from std_msgs.msg import Header

from procphys_ros.errors import CommandError

Triple = tuple[float, float, float]
Act = Callable[[], str]  # does something to the simulation and says what; CommandError = refused
_LONGEST_NAME = 256  # [characters] of a part; those of the longest names that ROS allows


def triple(vector: Vector3 | Point, what: str) -> Triple:
    """
    Read three numbers.

    :param what: names the vector in the message of the error.
    :raises CommandError: when one of them is not finite.
    """
    values = (vector.x, vector.y, vector.z)
    if not all(map(math.isfinite, values)):
        raise CommandError(f'{what} is {list(values)}, its numbers must be finite')
    return values


def check_frame(header: Header, frame: str) -> None:
    """
    Refuse vectors in a frame that is not the world's; no frame given means the world's.

    :param frame: the frame that the simulation lives in.
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

    :param text: what stands where the name belongs.
    :param where: names that place in the message of the error.
    :raises CommandError: when it is empty, or longer than any name.
    """
    if not text:
        raise CommandError(f'{where} is empty, it must name a part, such as oak_0/17')
    if len(text) > _LONGEST_NAME:
        raise CommandError(f'{where} has {len(text)} characters, the name of a part has at most '
                           f'{_LONGEST_NAME}')
    return text
