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

"""Mean wind over time: constant, changed at once, changed gradually, or as it was recorded."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
import math
from typing import NamedTuple

from procphys_ros.elementary import atan2, cos, hypot, sin

Vector = tuple[float, ...]
_PAST = 16  # stretches that are kept: a robot may set the wind a hundred times a second, for days


class _Stretch(NamedTuple):
    """
    From `start` on the wind goes from `velocity` to `target` within `duration`, and stays so.

    `travelled` is the way of the eddies at its start.
    """

    start: float
    velocity: Vector
    travelled: float
    target: Vector
    duration: float


class History:
    """
    The mean wind as a function of time, and how far it has carried the eddies.

    While it changes, its speed goes evenly from one to the other, and so does its direction, on
    the shorter way round.

    :param velocity: that blows before anything else is said [m/s], (3,).
    """

    _stretches: list[_Stretch]

    def __init__(self, velocity: Sequence[float]):
        velocity = tuple(velocity)
        self._stretches = [_Stretch(0.0, velocity, 0.0, velocity, 0.0)]

    def steer(self, velocity: Vector, time: float, duration: float = 0.0) -> None:
        """
        Change the mean wind; what was said for later times is forgotten, and so is the far past.

        :param velocity: to blow in the end [m/s], (3,).
        :param time: when the change begins, now [s].
        :param duration: of the change [s]; 0 = at once.
        """
        self._change(velocity, time, duration)
        del self._stretches[:-_PAST]

    def follow(self, times: Sequence[float], velocities: Sequence[Vector]) -> None:
        """
        Blow as recorded: as at the first time before it, as at the last one after it.

        :param times: ascending [s], (T,).
        :param velocities: [m/s], (T, 3).
        """
        self._change(velocities[0], 0.0, 0.0)
        for (start, end), (_, target) in zip(pairwise(times), pairwise(velocities)):
            self._change(target, start, end - start)

    def velocity(self, time: float) -> Vector:
        """Give the mean wind at the reference height [m/s], (3,)."""
        stretch = self._at(time)
        if time >= stretch.start + stretch.duration:
            return stretch.target
        share = max(0.0, (time - stretch.start) / stretch.duration)
        return _between(stretch.velocity, stretch.target, share)

    def travelled(self, time: float) -> float:
        """Give how far the eddies have come [m]."""
        stretch = self._at(time)
        first, last = hypot(*stretch.velocity), hypot(*stretch.target)
        since = time - stretch.start
        changing = min(since, stretch.duration)
        mean = first
        if changing > 0.0:
            mean += 0.5 * (last - first) * changing / stretch.duration
        return stretch.travelled + mean * changing + last * (since - changing)

    def _change(self, velocity: Vector, time: float, duration: float) -> None:
        """Change the mean wind from a time on, and forget what was said for later times."""
        now, travelled = self.velocity(time), self.travelled(time)
        del self._stretches[bisect_left(self._stretches, time, key=_start):]
        first = velocity if duration == 0.0 else now
        if self._stretches and duration == 0.0 and self._lasting(velocity, time):
            return
        self._stretches.append(_Stretch(time, first, travelled, velocity, duration))

    def _lasting(self, velocity: Vector, time: float) -> bool:
        """Return whether a wind blows already, and would go on to."""
        last = self._stretches[-1]
        return last.target == velocity and time >= last.start + last.duration

    def _at(self, time: float) -> _Stretch:
        return self._stretches[max(bisect_right(self._stretches, time, key=_start) - 1, 0)]


def _start(stretch: _Stretch) -> float:
    return stretch.start


def _between(first: Vector, last: Vector, share: float) -> Vector:
    """Go a share of the way between two winds; air that stands still takes the other's way."""
    slow, fast = hypot(*first), hypot(*last)
    speed = slow + share * (fast - slow)
    here, there = first if slow > 0.0 else last, last if fast > 0.0 else first
    azimuth, turn = atan2(here[1], here[0]), atan2(there[1], there[0])
    azimuth += share * math.remainder(turn - azimuth, 2.0 * math.pi)
    climb = atan2(here[2], hypot(*here[:2]))
    climb += share * (atan2(there[2], hypot(*there[:2])) - climb)
    level = speed * cos(climb)
    return level * cos(azimuth), level * sin(azimuth), speed * sin(climb)
