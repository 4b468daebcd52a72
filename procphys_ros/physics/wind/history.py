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

"""Mean wind over time: constant, step changes, ramps, or a record."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
import math
from typing import NamedTuple

from procphys_ros.elementary import atan2, cos, hypot, sin

Vector = tuple[float, ...]
_PAST = 16  # stretches kept: a robot may set the wind a hundred times a second, for days


class _Stretch(NamedTuple):
    """
    Ramp of the wind at `start` from `velocity` to `target` within `duration`, constant afterwards.

    `travelled` is the displacement of the eddies at its start.
    """

    start: float
    velocity: Vector
    travelled: float
    target: Vector
    duration: float


class History:
    """
    The mean wind as a function of time, and the displacement of the eddies.

    During a change, speed and direction are interpolated linearly, the direction by the smaller
    angle.

    :param velocity: initial mean wind [m/s], (3,).
    """

    _stretches: list[_Stretch]

    def __init__(self, velocity: Sequence[float]):
        velocity = tuple(velocity)
        self._stretches = [_Stretch(0.0, velocity, 0.0, velocity, 0.0)]

    def steer(self, velocity: Vector, time: float, duration: float = 0.0) -> None:
        """
        Change the mean wind; discard later changes and the distant past.

        :param velocity: mean wind after the change [m/s], (3,).
        :param time: start of the change, the present time [s].
        :param duration: of the change [s]; 0 = at once.
        """
        self._change(velocity, time, duration)
        del self._stretches[:-_PAST]

    def follow(self, times: Sequence[float], velocities: Sequence[Vector]) -> None:
        """
        Follow a record; the first value holds before it, and the last one after it.

        :param times: ascending [s], (T,).
        :param velocities: [m/s], (T, 3).
        """
        self._change(velocities[0], 0.0, 0.0)
        for (start, end), (_, target) in zip(pairwise(times), pairwise(velocities)):
            self._change(target, start, end - start)

    def velocity(self, time: float) -> Vector:
        """Return the mean wind at the reference height [m/s], (3,)."""
        stretch = self._at(time)
        if time >= stretch.start + stretch.duration:
            return stretch.target
        share = max(0.0, (time - stretch.start) / stretch.duration)
        return _between(stretch.velocity, stretch.target, share)

    def travelled(self, time: float) -> float:
        """Compute the displacement of the eddies along the wind [m]."""
        stretch = self._at(time)
        first, last = hypot(*stretch.velocity), hypot(*stretch.target)
        since = time - stretch.start
        changing = min(since, stretch.duration)
        mean = first
        if changing > 0.0:
            mean += 0.5 * (last - first) * changing / stretch.duration
        return stretch.travelled + mean * changing + last * (since - changing)

    def _change(self, velocity: Vector, time: float, duration: float) -> None:
        """Change the mean wind at a time, and discard later changes."""
        now, travelled = self.velocity(time), self.travelled(time)
        del self._stretches[bisect_left(self._stretches, time, key=_start):]
        first = velocity if duration == 0.0 else now
        if self._stretches and duration == 0.0 and self._lasting(velocity, time):
            return
        self._stretches.append(_Stretch(time, first, travelled, velocity, duration))

    def _lasting(self, velocity: Vector, time: float) -> bool:
        """Return whether the wind already has a velocity permanently."""
        last = self._stretches[-1]
        return last.target == velocity and time >= last.start + last.duration

    def _at(self, time: float) -> _Stretch:
        return self._stretches[max(bisect_right(self._stretches, time, key=_start) - 1, 0)]


def _start(stretch: _Stretch) -> float:
    return stretch.start


def _between(first: Vector, last: Vector, share: float) -> Vector:
    """Interpolate between two winds; still air takes the direction of the other one."""
    slow, fast = hypot(*first), hypot(*last)
    speed = slow + share * (fast - slow)
    here, there = first if slow > 0.0 else last, last if fast > 0.0 else first
    azimuth, turn = atan2(here[1], here[0]), atan2(there[1], there[0])
    azimuth += share * math.remainder(turn - azimuth, 2.0 * math.pi)
    climb = atan2(here[2], hypot(*here[:2]))
    climb += share * (atan2(there[2], hypot(*there[:2])) - climb)
    level = speed * cos(climb)
    return level * cos(azimuth), level * sin(azimuth), speed * sin(climb)
