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

"""Progress bar on a terminal: one line that is drawn over."""

from time import monotonic
from types import TracebackType
from typing import Self, TextIO

_WIDTH = 30      # characters
_INTERVAL = 0.1  # [s] between two drawings


class Bar:
    """
    Draws how far something is; on what is no terminal it stays silent.

    :param label: what is being done.
    :param stream: where to draw.
    """

    def __init__(self, label: str, stream: TextIO):
        self._label, self._stream = label, stream
        self._shown = stream.isatty()
        self._last = float('-inf')
        self._drawn = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._drawn:
            self._stream.write('\r\x1b[K')
            self._stream.flush()

    def show(self, done: float, whole: float) -> None:
        """
        Draw the state, at most ten times a second.

        :param done: how much has been done, in any unit.
        :param whole: how much there is to do, in the same unit.
        """
        now = monotonic()
        if not self._shown or now - self._last < _INTERVAL:
            return
        self._last, self._drawn = now, True
        share = min(1.0, done / whole) if whole > 0.0 else 1.0
        filled = round(share * _WIDTH)
        self._stream.write(f'\r\x1b[K{self._label} [{"#" * filled}{"." * (_WIDTH - filled)}] '
                           f'{100.0 * share:3.0f} %')
        self._stream.flush()
