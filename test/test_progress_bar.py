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

"""The progress bar."""

import io
from itertools import count
import os

import pytest

from procphys_ros.terminal import progress_bar
from procphys_ros.terminal.progress_bar import draw_over, ProgressBar


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self):
        return True


def test_it_draws_on_terminals_only(monkeypatch):
    """Draw share, time left and detail on a terminal and clean up; stay silent elsewhere."""
    times = count(0.0, 10.0)
    monkeypatch.setattr(progress_bar, 'monotonic', lambda: next(times))
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file, None):  # None after 2>&-
        with ProgressBar('export', stream) as bar:
            bar.show(1.0, 4.0)
            bar.show(2.0, 4.0, 'a roof')
    first, second, end = terminal.getvalue().replace('\x1b[K', '').split('\r')[1:]
    assert first.endswith(' 25 %') and second.endswith(' 50 %  0:20 left  a roof')
    assert end == ''
    assert file.getvalue() == ''


@pytest.mark.parametrize('wide, shown', [(40, 39), (0, 79), (200, 120)])
def test_lines_end_where_the_terminal_does(monkeypatch, wide, shown):
    """Draw no line that wraps: only its last row could be drawn over."""
    monkeypatch.setattr(progress_bar.os, 'get_terminal_size',
                        lambda file: os.terminal_size((wide, 24)))
    terminal = Terminal()
    monkeypatch.setattr(terminal, 'fileno', lambda: 2)
    draw_over(120 * 'x', terminal)
    assert terminal.getvalue() == '\r' + shown * 'x' + '\x1b[K'
