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


"""Command queue: commands take effect between two steps, and each is answered."""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from time import monotonic

from procphys_ros import progress
from procphys_ros.errors import ProcPhysError

CAPACITY = 10_000  # commands from topics that may wait for the next step
_LONGEST = 0.05  # [s] of commands between two steps, so that a flood leaves time for steps
_LONGEST_CALLS = 0.1  # [s] the same while service calls wait
_LONGEST_REASON = 600  # [characters]

Act = Callable[[], str]  # executes a command and describes its result; CommandError = refused
Answer = Callable[[bool, str], None]  # called with success, and the result or the reason


def _nobody(success: bool, message: str) -> None:
    """Ignore the answer to a command from a topic."""


@dataclass(frozen=True, eq=False)
class Command:
    """
    An operation on the simulation between two steps.

    :ivar name: topic or service of its origin.
    :ivar carry_out: executes it and describes the result; raises CommandError to refuse.
    :ivar answer: called with success, and the result or the reason.
    """

    name: str
    carry_out: Act
    answer: Answer = _nobody


class CommandQueue:
    """
    Hold commands until the next step; count each as taken or rejected.

    Commands come from the ROS threads and are executed by the simulation thread, in the order of
    arrival. Only when there are more than fit between two steps, service calls overtake commands
    from topics, until the backlog is gone.

    :param on_call: called when a service call begins to wait.
    :param on_rejection: called with the name of the command, the reason, and an unexpected
        exception, or None.
    :param clock: returns steady real time [s].
    :ivar taken: number of commands executed, by name.
    :ivar rejected: number of commands refused, by name.
    :ivar last_rejection: name and reason of the last refusal.
    :ivar under_way: name of the command being executed; '' = none.
    """

    def __init__(self, on_call: Callable[[], None],
                 on_rejection: Callable[[str, str, Exception | None], None],
                 clock: Callable[[], float] = monotonic):
        # Each command is followed by the number of its arrival.
        self._from_topics: deque[tuple[Command, int]] = deque()
        self._calls: dict[Command, int] = {}
        self._arrivals = 0
        self._on_call = on_call
        self._on_rejection = on_rejection
        self._clock = clock
        self._lock = Lock()
        self._is_behind = False
        self.taken: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self.last_rejection = ''
        self.under_way = ''

    def __len__(self) -> int:
        return len(self._from_topics) + len(self._calls)

    def submit(self, command: Command) -> None:
        """
        Append a command from a topic; if the queue is full, reject it.

        No thread is woken: the command waits for the next step, and a thousand wake-ups a second
        would make the threads wait for each other.
        """
        with self._lock:
            fits = len(self._from_topics) < CAPACITY
            if fits:
                self._arrivals += 1
                self._from_topics.append((command, self._arrivals))
        if not fits:
            self.reject_surplus(command.name)

    @property
    def is_called(self) -> bool:
        """Return whether a service call is waiting."""
        return bool(self._calls)

    @property
    def is_full(self) -> bool:
        """Return whether the queue has no capacity for another command from a topic."""
        return len(self._from_topics) >= CAPACITY

    def reject_surplus(self, name: str) -> None:
        """Count and report a command of a topic that exceeds the capacity."""
        self.reject(name, f'{CAPACITY} commands are waiting already')

    def call(self, command: Command) -> None:
        """Append a service call."""
        with self._lock:
            self._arrivals += 1
            self._calls[command] = self._arrivals
        self._on_call()

    def is_waiting(self, command: Command) -> bool:
        """Return whether the execution of a call has not begun."""
        return command in self._calls

    def withdraw(self, command: Command) -> bool:
        """Withdraw a call; return whether it was still waiting."""
        with self._lock:
            return self._calls.pop(command, None) is not None

    def take(self, name: str) -> None:
        """Count an executed command."""
        with self._lock:
            self.taken[name] += 1

    def reject(self, name: str, why: str | Exception, note: str = '', count: int = 1) -> str:
        """
        Count and report a command that is not executed.

        :param name: of the command.
        :param why: the reason, or the exception; any but an error meant for users is a defect,
            and is reported as one.
        :param note: appended to the reason.
        :param count: number of commands it applies to.
        :returns: the reason, shortened.
        """
        defect = why if isinstance(why, Exception) and not isinstance(why, ProcPhysError) else None
        reason = shortened((describe(why) if isinstance(why, Exception) else why) + note)
        with self._lock:
            self.rejected[name] += count
            self.last_rejection = f'{name}: {reason}'
        self._on_rejection(name, reason, defect)
        return reason

    def drain(self) -> bool:
        """
        Execute waiting commands, for at most `_LONGEST`; calls for up to `_LONGEST_CALLS`.

        :returns: whether any was waiting.
        """
        begin, elapsed = self._clock(), 0.0
        has_waited = len(self) > 0
        while elapsed <= _LONGEST_CALLS:
            command = self._next(elapsed > _LONGEST)
            if command is None:
                break
            self._carry_out(command)
            elapsed = self._clock() - begin
        self._is_behind = bool(self._from_topics)
        return has_waited

    def counts(self) -> tuple[dict[str, int], dict[str, int]]:
        """Return the numbers of commands taken and rejected, by name."""
        with self._lock:
            return dict(self.taken), dict(self.rejected)

    def _next(self, calls_only: bool) -> Command | None:
        """Remove and return the first command."""
        with self._lock:
            call, called = next(iter(self._calls.items()), (None, 0))
            if call is not None and (calls_only or self._is_behind or not self._from_topics
                                     or called < self._from_topics[0][1]):
                del self._calls[call]
                return call
            if calls_only or not self._from_topics:
                return None
            return self._from_topics.popleft()[0]

    def _carry_out(self, command: Command) -> None:
        self.under_way = command.name
        try:
            with progress.stage(command.name):
                message = command.carry_out()
        except Exception as error:  # the simulation goes on unchanged after any exception
            command.answer(False, self.reject(command.name, error))
        else:
            self.take(command.name)
            command.answer(True, message)
        finally:
            self.under_way = ''


def describe(error: Exception) -> str:
    """Describe an exception; with its type unless it is meant for users."""
    if isinstance(error, ProcPhysError):
        return str(error)
    return f'internal error, {type(error).__name__}: {error}'


def shortened(reason: str) -> str:
    """Shorten a reason to one line of a message, without unprintable characters."""
    if not reason.isprintable():  # line breaks of a name, and surrogates, which UTF-8 lacks
        reason = ''.join(c if c.isprintable() else ascii(c)[1:-1] for c in reason)
    if len(reason) <= _LONGEST_REASON:
        return reason
    return f'{reason[:_LONGEST_REASON // 2]} … {reason[-_LONGEST_REASON // 2:]}'
