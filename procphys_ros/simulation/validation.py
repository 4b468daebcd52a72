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


"""Validate the numbers of commands."""

from collections.abc import Sequence
import math
import numbers
from typing import Any

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.geometry.linear import norm
from procphys_ros.schema import short

_LARGEST = 1e7  # [N·s], [N] and [m]; a loaded lorry at 900 km/h, beyond it numbers diverge


def checked_vector(what: str, value: Sequence[float] | np.ndarray) -> np.ndarray:
    """
    Convert a command's numbers to a vector (3,).

    :param what: their name, for the message.
    :param value: as in the command.
    :raises CommandError: if there are not three, or one is not finite or too large.
    """
    vector = _row(value)
    if vector.shape != (3,):
        raise CommandError(f'{what}: {value!r} is not three numbers [x, y, z]')
    if not np.isfinite(vector).all():
        raise CommandError(f'{what}: {vector.tolist()} is not finite')
    if np.abs(vector).max() > _LARGEST:
        raise CommandError(f'{what}: {vector.tolist()} is larger than {_LARGEST:g}')
    return vector


def checked_rotation(what: str, value: Sequence[float] | np.ndarray) -> np.ndarray:
    """
    Convert a command's numbers to a unit quaternion xyzw, (4,).

    :param what: their name, for the message.
    :param value: as in the command.
    :raises CommandError: if there are not four, one is not finite, or all are zero.
    """
    turn = _row(value)
    if turn.shape != (4,) or not np.isfinite(turn).all():
        raise CommandError(f'{what} is {value!r}, it must be a quaternion [x, y, z, w]')
    with np.errstate(over='ignore'):
        length = float(norm(turn))
    if not 1e-6 <= length < np.inf:
        raise CommandError(f'{what}: {turn.tolist()} is no rotation')
    return turn / length


def checked_pose(what: str, value: Sequence[float]) -> np.ndarray:
    """Convert a command's numbers to a pose (7,); raises as `checked_rotation`."""
    pose = _row(value)
    if pose.shape != (7,):
        raise CommandError(f'{what}: {short(value)} is not a pose of seven numbers')
    return np.concatenate([checked_vector(f'{what} position', pose[:3]),
                           checked_rotation(f'{what} orientation', pose[3:])])


def checked_twist(value: Sequence[float]) -> np.ndarray:
    """Convert a command's numbers to velocity and spin (6,); raises as `checked_vector`."""
    twist = _row(value)
    if twist.shape != (6,):
        raise CommandError(f'twist: {short(value)} is not six numbers')
    return np.concatenate([checked_vector('velocity', twist[:3]),
                           checked_vector('spin', twist[3:])])


def checked_number(what: str, value: Any) -> float:
    """Return a finite number, or raise `CommandError`."""
    if not isinstance(value, numbers.Real) or not math.isfinite(value):
        raise CommandError(f'{what} is {short(value)}, it must be a finite number')
    return float(value)


def checked_count(what: str, value: Any) -> int:
    """Return an integer of 0 or more, or raise `CommandError`."""
    if not isinstance(value, numbers.Integral) or value < 0:
        raise CommandError(f'{what} is {short(value)}, it must be a whole number, 0 or more')
    return int(value)


def checked_switch(what: str, value: Any) -> bool:
    """Return True or False, or raise `CommandError`: the text 'off' would count as true."""
    if not isinstance(value, (bool, np.bool_)):
        raise CommandError(f'{what} is {short(value)}, it must be True or False')
    return bool(value)


def _row(value: Sequence[float] | np.ndarray) -> np.ndarray:
    """Convert numbers to an array; empty if they are invalid."""
    try:
        return np.array(value, float)
    except (TypeError, ValueError):
        return np.empty(0)
