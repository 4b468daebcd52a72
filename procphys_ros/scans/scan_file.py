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

"""Scan file: its bytes and lines, up to the largest file that is read."""

from pathlib import Path
import re

import numpy as np

from procphys_ros.errors import GrammarError
from procphys_ros.language import read_regular
from procphys_ros.scans.cylinders import LARGEST, MAX_CYLINDERS

_LARGEST_FILE = 128 * MAX_CYLINDERS  # [bytes] a row has some 60 to 250
_MOST_LINES = 2 * MAX_CYLINDERS + 1000
_LONGEST_LINE = 65_536  # [characters]


def read_scan(path: Path, source: str) -> bytes:
    """
    Read a file.

    :param source: its name, for errors.
    :raises GrammarError: when it cannot be read, or is too large.
    """
    try:
        raw = read_regular(path, _LARGEST_FILE + 1)
    except (OSError, ValueError) as problem:
        reason = getattr(problem, 'strerror', None) or problem
        raise GrammarError(f'cannot read the tree: {reason}', source) from None
    if len(raw) > _LARGEST_FILE:
        raise GrammarError(f'the file has more than {_LARGEST_FILE} bytes', source)
    return raw


def lines_of(raw: bytes, source: str, encoding: str = 'utf-8-sig') -> list[str]:
    """
    Split a text into lines.

    :param raw: with or without byte order mark.
    :param source: name of the file, for errors.
    :raises GrammarError: when it is no text, or has very many or very long lines.
    """
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError as problem:
        line = raw.count(b'\n', 0, problem.start) + 1
        raise GrammarError('cannot read the tree: this is no UTF-8 text', source, line) from None
    text = text.replace('\r\n', '\n').replace('\r', '\n')
    if text.count('\n') > _MOST_LINES:
        raise GrammarError(f'there are more than {_MOST_LINES} lines', source)
    lines = text.split('\n')
    if (long := next((n for n, line in enumerate(lines, 1) if len(line) > _LONGEST_LINE), 0)):
        raise GrammarError(f'the line has more than {_LONGEST_LINE} characters', source, long)
    return lines


def fault_of(values: np.ndarray, name: str) -> tuple[int, str] | None:
    """
    Find the first number that is impossible; return its index and what is wrong.

    :param values: (N,); lengths and radii must not be negative.
    :param name: of the column; `start x`, `end y` and the like are coordinates.
    """
    least = -LARGEST if ' ' in name else 0.0
    good = (values >= least) & (values <= LARGEST)
    if good.all():
        return None
    first = int(np.argmin(good))
    allowed = f'{least:g} to {LARGEST:g}' if least else f'0 to {LARGEST:g}'
    return first, f'{name} is {values[first]:g}, it must be from {allowed}'


def plain(name: str) -> str:
    """Return the name of a column in small letters and digits, without what is in brackets."""
    return re.sub(r'[^a-z0-9]', '', re.sub(r'\(.*?\)|\[.*?\]', '', name.lower()))


def check_count(count: int, what: str, source: str) -> None:
    """Raise GrammarError when a file has nothing, or more than is read."""
    if count < 1:
        raise GrammarError(f'there are no {what}', source)
    if count > MAX_CYLINDERS:
        raise GrammarError(f'there are {count} {what}, at most {MAX_CYLINDERS} are read', source)
