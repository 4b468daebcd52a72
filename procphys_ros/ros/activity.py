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

"""Activity: what a thread does that takes long, how far it is, and for how long."""

from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

_LONG = 1.0  # [s] after which work is reported
_INTERVAL = 5.0  # [s] between lines about the same work
_SHORT = 0.05  # [s] below which a share of it is not reported


@dataclass(frozen=True)
class _Stage:
    name: str
    detail: str
    began: float


class Activity:
    """
    Track the progress of one thread for other threads.

    :param clock: returns steady real time [s].
    :ivar last: summary of the last long work: its duration, and that of its stages.
    """

    def __init__(self, clock: Callable[[], float] = monotonic):
        self._clock = clock
        self.last = ''
        self._stages: tuple[_Stage, ...] = ()
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._counts: Counter[str] = Counter()

    def begin(self, name: str, detail: str) -> None:
        """Record the beginning of a stage; in the working thread."""
        if not self._stages:
            self._seconds.clear()
            self._counts.clear()
        self._counts[name] += 1
        self._stages = (*self._stages, _Stage(name, detail, self._clock()))

    def end(self) -> None:
        """Record the end of the newest stage; in the working thread."""
        last = self._stages[-1]
        self._stages = self._stages[:-1]
        if last.name not in [stage.name for stage in self._stages]:  # kernels call kernels
            self._seconds[last.name] += self._clock() - last.began
        if not self._stages and self._seconds[last.name] >= _LONG:
            self.last = self._summary(last.name)

    @property
    def seconds(self) -> float:
        """Return the duration of the work so far [s]; 0 = none is under way."""
        stages = self._stages
        return self._clock() - stages[0].began if stages else 0.0

    def now(self) -> str:
        """Describe the present work, its duration and its progress; '' = none."""
        stages = self._stages
        if not stages:
            return ''
        whole, newest = stages[0], stages[-1]
        text = f'{whole.name} for {self._clock() - whole.began:.1f} s'
        if newest is not whole:
            text += f': {newest.name}'
        if newest.detail:
            text += f', {newest.detail}'
        if self._counts[newest.name] > 1:
            text += f' ({self._counts[newest.name]} so far)'
        return text

    def _summary(self, whole: str) -> str:
        counts = self._counts
        shares = ', '.join(
            f'{name}{f" ({counts[name]})" if counts[name] > 1 else ""} {seconds:.1f} s'
            for name, seconds in sorted(self._seconds.items(), key=lambda row: -row[1])
            if name != whole and seconds > _SHORT)
        return f'{whole} took {self._seconds[whole]:.1f} s' + (f' ({shares})' if shares else '')


class LongWork:
    """
    Report long work: after a second, every few seconds, and when it is done.

    :param activity: to be reported.
    :param say: called with each line.
    """

    def __init__(self, activity: Activity, say: Callable[[str], None]):
        self._activity = activity
        self._say = say
        self._next = _LONG
        self._before = 0.0

    def look(self) -> None:
        """Report the work if that is due."""
        seconds = self._activity.seconds
        if seconds < self._before:  # the long work has ended
            if self._next > _LONG:
                self._say(self._activity.last)
            self._next = _LONG
        if seconds >= self._next:
            self._say(self._activity.now())
            self._next = seconds + _INTERVAL
        self._before = seconds
