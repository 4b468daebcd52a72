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

"""Progress bar on a terminal: one line that is overwritten."""

import os
from time import monotonic
from types import TracebackType
from typing import Self, TextIO

_WIDTH = 30      # characters
_INTERVAL = 0.1  # [s] between two drawings
_DETAIL = 40     # characters
_COLUMNS = 80    # of a terminal of unknown width


def draw_over(line: str, stream: TextIO) -> None:
    """Overwrite the last line, cut to the width of the terminal: wrapped lines would stay."""
    try:
        columns = os.get_terminal_size(stream.fileno()).columns or _COLUMNS
    except OSError:
        columns = _COLUMNS
    stream.write(f'\r{line[:columns - 1]}\x1b[K')
    stream.flush()


class ProgressBar:
    """
    Draws the share of work done and the time left, on terminals only.

    :param label: name of the work.
    :param stream: output; None = it is closed.
    """

    def __init__(self, label: str, stream: TextIO | None):
        self._label = label
        self._stream = stream if stream is not None and stream.isatty() else None
        self._drawn_at = float('-inf')
        self._first: tuple[float, float] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._stream is not None and self._first is not None:
            draw_over('', self._stream)

    def show(self, done: float, whole: float, detail: str = '') -> None:
        """
        Draw the state, at most ten times a second.

        :param done: amount of work done, in any unit.
        :param whole: total amount of work, in the same unit.
        :param detail: item done last.
        """
        now = monotonic()
        if self._stream is None or now - self._drawn_at < _INTERVAL:
            return
        self._drawn_at = now
        self._first = self._first or (now, done)
        share = min(1.0, done / whole) if whole > 0.0 else 1.0
        filled = round(share * _WIDTH)
        words = [f'{self._label} [{"#" * filled}{"." * (_WIDTH - filled)}] {100.0 * share:3.0f} %',
                 self._time_left(now, done, whole), detail[:_DETAIL]]
        draw_over('  '.join(word for word in words if word), self._stream)

    def _time_left(self, now: float, done: float, whole: float) -> str:
        """Format the time left at the speed since the first drawing, '' while that is unknown."""
        assert self._first is not None
        began, before = self._first
        if done <= before:
            return ''
        left = int((now - began) / (done - before) * max(whole - done, 0.0))
        return f'{left // 60}:{left % 60:02d} left'
