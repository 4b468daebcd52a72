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


"""Commands: wait in one queue, take effect between two steps, and are answered for."""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from time import monotonic

from procphys_ros.errors import CommandError

CAPACITY = 10_000  # commands that may wait for the next step
_LONGEST = 0.05  # [s] of commands between two steps, so that a flood leaves time for steps
_LONGEST_REASON = 600  # [characters]


def _nobody(success: bool, message: str) -> None:
    """Answer a command that came on a topic: nobody waits for it."""


@dataclass(frozen=True)
class Command:
    """
    Something to do to the simulation between two steps.

    :ivar name: topic or service that it came by.
    :ivar carry_out: does it and says what happened; raises CommandError to refuse.
    :ivar answer: told whether it was done, and what happened or why not.
    """

    name: str
    carry_out: Callable[[], str]
    answer: Callable[[bool, str], None] = _nobody


class CommandQueue:
    """
    Holds commands until the next step; each is counted as taken or as rejected.

    Commands come from the thread that talks to ROS and are carried out by the one that
    simulates.

    :param on_arrival: called when a command has begun to wait.
    :param on_rejection: called with the name of the command and the reason.
    :param clock: gives steady real time [s].
    :ivar taken: number of commands carried out, by name.
    :ivar rejected: number of commands refused, by name.
    :ivar last_rejection: name and reason of the last one refused.
    :ivar under_way: name of the command that is being carried out; '' = none.
    """

    def __init__(self, on_arrival: Callable[[], None], on_rejection: Callable[[str, str], None],
                 clock: Callable[[], float] = monotonic):
        self._waiting: deque[Command] = deque()
        self._on_arrival = on_arrival
        self._on_rejection = on_rejection
        self._clock = clock
        self._counting = Lock()
        self.taken: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self.last_rejection = ''
        self.under_way = ''

    def __len__(self) -> int:
        return len(self._waiting)

    def submit(self, command: Command) -> None:
        """Append a command; one too many is rejected at once."""
        if len(self._waiting) >= CAPACITY:
            reason = f'{CAPACITY} commands are waiting already'
            self.reject(command.name, reason)
            command.answer(False, reason)
        else:
            self._waiting.append(command)
            self._on_arrival()

    def reject(self, name: str, reason: str) -> None:
        """Count and report a command that is not carried out."""
        with self._counting:
            self.rejected[name] += 1
            self.last_rejection = f'{name}: {reason}'
        self._on_rejection(name, reason)

    def drain(self) -> None:
        """Carry out what waits, in the order it came, but no longer than `_LONGEST`."""
        begin = self._clock()
        while self._waiting:
            self._carry_out(self._waiting.popleft())
            if self._clock() - begin > _LONGEST:
                break

    def counts(self) -> tuple[dict[str, int], dict[str, int]]:
        """Give how many commands were taken, and rejected, by name."""
        with self._counting:
            return dict(self.taken), dict(self.rejected)

    def _carry_out(self, command: Command) -> None:
        self.under_way = command.name
        try:
            message = command.carry_out()
        except CommandError as error:
            reason = str(error)
            if len(reason) > _LONGEST_REASON:  # whoever sent a long list need not get it back
                reason = f'{reason[:_LONGEST_REASON // 2]} … {reason[-_LONGEST_REASON // 2:]}'
            self.reject(command.name, reason)
            command.answer(False, reason)
        else:
            with self._counting:
                self.taken[command.name] += 1
            command.answer(True, message)
        finally:
            self.under_way = ''
