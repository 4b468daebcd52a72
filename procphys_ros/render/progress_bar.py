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


"""A progress bar on a terminal."""

from time import monotonic
from typing import TextIO

_WIDTH = 30  # characters of the bar
_PERIOD = 0.1  # [s] between two lines


class ProgressBar:
    """
    Shows how much is done, and how long the rest will take; shows nothing if not on a terminal.

    :param stream: where it is written.
    :param total: number of things to do.
    :param unit: what they are called.
    """

    def __init__(self, stream: TextIO, total: int, unit: str):
        self._stream, self._total, self._unit = stream, total, unit
        self._begin = self._shown = monotonic()

    def show(self, done: int) -> None:
        """Show that so many are done."""
        now = monotonic()
        if not self._stream.isatty() or (now - self._shown < _PERIOD and done < self._total):
            return
        self._shown = now
        full = _WIDTH * done // self._total
        left = (now - self._begin) / max(done, 1) * (self._total - done)
        self._stream.write(f'\r[{"#" * full}{"." * (_WIDTH - full)}] {done}/{self._total} '
                           f'{self._unit}, {int(left) // 60}:{int(left) % 60:02d} left ')
        self._stream.flush()

    def close(self) -> None:
        """Take it off the terminal."""
        if self._stream.isatty():
            self._stream.write('\r\033[K')
            self._stream.flush()
