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


"""What the numbers of a command must be before they may touch the simulation."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.errors import CommandError

_LARGEST = 1e7  # [N·s], [N] and [m]; a loaded lorry at 900 km/h, beyond it numbers run away


def checked_vector(what: str, value: Sequence[float]) -> np.ndarray:
    """
    Turn a command's numbers into a vector (3,).

    :param what: their name, for the message.
    :param value: as the command gave them.
    :raises CommandError: when there are not three, or one is not finite or too large.
    """
    try:
        vector = np.array(value, float)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,):
        raise CommandError(f'{what}: {value!r} is not three numbers [x, y, z]')
    if not np.isfinite(vector).all():
        raise CommandError(f'{what}: {vector.tolist()} is not finite')
    if np.abs(vector).max() > _LARGEST:
        raise CommandError(f'{what}: {vector.tolist()} is larger than {_LARGEST:g}')
    return vector


def checked_rotation(what: str, value: Sequence[float]) -> np.ndarray:
    """
    Turn a command's numbers into a unit quaternion xyzw, (4,).

    :param what: their name, for the message.
    :param value: as the command gave them.
    :raises CommandError: when there are not four, one is not finite, or all are zero.
    """
    try:
        turn = np.array(value, float)
    except (TypeError, ValueError):
        turn = np.empty(0)
    if turn.shape != (4,) or not np.isfinite(turn).all():
        raise CommandError(f'{what} is {value!r}, it must be a quaternion [x, y, z, w]')
    length = float(np.linalg.norm(turn))
    if not 1e-6 <= length < np.inf:
        raise CommandError(f'{what}: {turn.tolist()} is no rotation')
    return turn / length
