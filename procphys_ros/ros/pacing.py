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


"""Pacing: how many steps are due, so that simulated time keeps up or slows; and what else is."""

from collections.abc import Callable
from time import monotonic

_STANDSTILL = 0.25  # [s] between two calls; time beyond it is dropped


class Pacer:
    """
    Run the steps that real time requires, within a budget of real time.

    Steps that miss the budget are dropped: simulated time slows, nothing piles up.

    :param time_step: length of a step [s].
    :param factor: simulated seconds per second; 0 = as many steps as the budget allows.
    :param budget: real time for steps in one call [s].
    :param clock: returns steady real time [s].
    :ivar simulated: total simulated time [s].
    :ivar is_behind: whether the last call left steps that are due.
    """

    def __init__(self, time_step: float, factor: float, budget: float,
                 clock: Callable[[], float] = monotonic):
        self.factor = factor
        self.budget = budget
        self.time_step = time_step
        self._clock = clock
        self.simulated = 0.0
        self.restart()

    def restart(self) -> None:
        """Restart from now without a backlog (after a pause, a reset, a slow command)."""
        self._last = self._clock()
        self._owed = 0.0
        self.is_behind = False

    def advance(self, step: Callable[[], None],
                is_called: Callable[[], bool] = lambda: False) -> int:
        """
        Run the steps that are due.

        :param step: computes one step.
        :param is_called: checked between two steps; True = the rest waits for the next call.
        :returns: number of steps run.
        """
        now = self._clock()
        # After a standstill of the process (a slow command, a busy machine) nothing is caught up.
        self._owed += min(now - self._last, _STANDSTILL) * self.factor
        self._last = now
        steps = 0
        while self._is_due() and (not steps or self._clock() - now < self.budget):
            step()
            steps += 1
            self._owed -= self.time_step
            self.simulated += self.time_step
            if is_called():
                break
        self.is_behind = self._is_due()
        if self.is_behind and self._clock() - now >= self.budget:
            self._owed = 0.0  # overloaded: slow down instead of catching up later
        return steps

    def _is_due(self) -> bool:
        # The tolerance makes a clock that ticks just short of a step count as on time.
        return self.factor == 0.0 or self._owed >= 0.999 * self.time_step


class Speedometer:
    """
    Measure the real-time factor.

    :param pacer: runs the simulation, in any thread.
    :param clock: returns steady real time [s].
    """

    def __init__(self, pacer: Pacer, clock: Callable[[], float] = monotonic):
        self._pacer = pacer
        self._clock = clock
        self._since, self._simulated = clock(), pacer.simulated

    def read(self) -> float:
        """Return simulated over real time since the last call; also during a step."""
        now, simulated = self._clock(), self._pacer.simulated
        elapsed, passed = now - self._since, simulated - self._simulated
        self._since, self._simulated = now, simulated
        return passed / elapsed if elapsed > 0.0 else 0.0


class RateLimiter:
    """
    Decide when periodic work is due; missed periods are not made up.

    :param rate: [Hz].
    :param early: share of its period that it may be due early, as turns jitter.
    :param clock: returns steady real time [s].
    :ivar rate: [Hz].
    """

    def __init__(self, rate: float, early: float = 0.0, clock: Callable[[], float] = monotonic):
        self.rate = rate
        self._early = early
        self._clock = clock
        self._next = clock()

    @property
    def wait(self) -> float:
        """Return the time until it is due [s]; at most one period, also after `rate` changes."""
        self._next = min(self._next, self._clock() + 1.0 / self.rate)
        return max(0.0, self._next - self._clock())

    def is_due(self) -> bool:
        """Return whether it is due; when it is, the next time is one period later."""
        period = 1.0 / self.rate
        if self.wait > self._early * period:
            return False
        now = self._clock()
        self._next = self._next + period if self._next + period > now else now + period
        return True

    def hasten(self) -> None:
        """Make it due now."""
        self._next = self._clock()
