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

from procphys_ros import progress_bar
from procphys_ros.progress_bar import ProgressBar


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self):
        return True


def test_it_draws_on_terminals_only(monkeypatch):
    """Draw share, time left and detail on a terminal and clean up; stay silent elsewhere."""
    times = count(0.0, 10.0)
    monkeypatch.setattr(progress_bar, 'monotonic', lambda: next(times))
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file):
        with ProgressBar('export', stream) as bar:
            bar.show(1.0, 4.0)
            bar.show(2.0, 4.0, 'a roof')
    first, second, end = terminal.getvalue().split('\r\x1b[K')[1:]
    assert first.endswith(' 25 %') and second.endswith(' 50 %  0:20 left  a roof')
    assert end == ''
    assert file.getvalue() == ''
