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

from procphys_ros.errors import CommandError

CAPACITY = 10_000  # commands that may wait for the next step


@dataclass(frozen=True)
class Command:
    """
    Something to do to the simulation between two steps.

    :ivar name: topic or service that it came by.
    :ivar carry_out: does it and says what happened; raises CommandError to refuse.
    """

    name: str
    carry_out: Callable[[], str]


class CommandQueue:
    """
    Holds commands until the next step; each is counted as taken or as rejected.

    :param on_rejection: called with the name of the command and the reason.
    :ivar taken: number of commands carried out, by name.
    :ivar rejected: number of commands refused, by name.
    :ivar last_rejection: name and reason of the last one refused.
    """

    def __init__(self, on_rejection: Callable[[str, str], None]):
        self._waiting: deque[Command] = deque()
        self._on_rejection = on_rejection
        self.taken: Counter[str] = Counter()
        self.rejected: Counter[str] = Counter()
        self.last_rejection = ''

    def __len__(self) -> int:
        return len(self._waiting)

    def submit(self, command: Command) -> None:
        """Append a command; one too many is rejected at once."""
        if len(self._waiting) >= CAPACITY:
            self.reject(command.name, f'{CAPACITY} commands are waiting already')
        else:
            self._waiting.append(command)

    def reject(self, name: str, reason: str) -> None:
        """Count and report a command that is not carried out."""
        self.rejected[name] += 1
        self.last_rejection = f'{name}: {reason}'
        self._on_rejection(name, reason)

    def drain(self) -> None:
        """Carry out everything that waits, in the order it came."""
        while self._waiting:
            self._carry_out(self._waiting.popleft())

    def run(self, command: Command) -> tuple[bool, str]:
        """
        Carry out a command behind all that wait; only between two steps.

        :returns: whether it was carried out, and what happened or why not.
        """
        self.drain()
        return self._carry_out(command)

    def _carry_out(self, command: Command) -> tuple[bool, str]:
        try:
            message = command.carry_out()
        except CommandError as error:
            self.reject(command.name, str(error))
            return False, str(error)
        self.taken[command.name] += 1
        return True, message
