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


"""Series: poses, velocities and loads of parts over a stretch of steps, as arrays."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from procphys_ros.errors import CommandError
from procphys_ros.scene.capacity import available_memory
from procphys_ros.simulation.part_loads import loads_of
from procphys_ros.simulation.readings import Readings
from procphys_ros.simulation.validation import checked_count

_WIDTH = 8 * (7 + 6 + 3)  # [bytes] per part and row


@dataclass(frozen=True)
class Series:
    """
    The motion and loads of some parts over a number of steps, a row per recorded step.

    :ivar parts: indices, (K,).
    :ivar names: of these parts.
    :ivar times: simulated time [s], (T,).
    :ivar poses: of centres of mass, world, (T, K, 7); NaN = the part is gone.
    :ivar velocities: linear and angular [m/s], [rad/s], world, (T, K, 6).
    :ivar loads: force [N], moment [N·m] and share of the strength, (T, K, 3), see `PartLoad`.
    """

    parts: np.ndarray
    names: tuple[str, ...]
    times: np.ndarray
    poses: np.ndarray
    velocities: np.ndarray
    loads: np.ndarray

    def save(self, path: Path) -> None:
        """
        Write all arrays, by their names, into a file for `numpy.load`.

        :param path: ends in .npz.
        :raises OSError: if it cannot be written.
        """
        np.savez(path, **vars(self))


def record(readings: Readings, step: Callable[[int], None], steps: int,
           parts: Sequence[int | str] | None = None, every: int = 1) -> Series:
    """
    Advance time, and record parts.

    :param readings: of the simulation.
    :param step: advances it by a number of time steps.
    :param steps: number of time steps in all.
    :param parts: as in `PartNames.indices`.
    :param every: time steps per row.
    :returns: a row after each `every` steps.
    :raises CommandError: if a part is unknown, a number is invalid, or memory is too small.
    """
    steps, every = checked_count('the number of steps', steps), checked_count('every', every)
    if not every:
        raise CommandError('every is 0, it must be a whole number, 1 or more')
    chosen = readings.names.indices(parts)
    rows, rest = divmod(steps, every)
    _check_room(rows * len(chosen) * _WIDTH)
    made = Series(chosen, tuple(readings.names.name(part) for part in chosen.tolist()),
                  np.empty(rows), *(np.empty((rows, len(chosen), width)) for width in (7, 6, 3)))
    for row in range(rows):
        step(every)
        made.times[row] = readings.time
        made.poses[row] = readings.poses[chosen]
        made.velocities[row] = readings.velocities[chosen]
        made.loads[row] = loads_of(readings.state, chosen)
    step(rest)
    return made


def _check_room(size: int) -> None:
    """Raise CommandError for a series that exceeds free memory; [bytes]."""
    free = available_memory()
    if free is not None and size > free:
        raise CommandError(f'the series takes {size / 2 ** 30:.1f} GiB of memory, '
                           f'{free / 2 ** 30:.1f} are free; record fewer parts or steps')
