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

"""Data files of scenes: the folders searched for them, and tables in them."""

from collections.abc import Callable, Sequence
import math
import os
from pathlib import Path

from procphys_ros.errors import SceneError
from procphys_ros.files.file_bounds import named_by, outside
from procphys_ros.files.resources import shipped_file
from procphys_ros.language import shorten


def find_data_file(key: str, name: str, beside: Path | None) -> Path:
    """
    Find a data file of a scene.

    :param key: of the scene file, for messages.
    :param name: file beside the scene file, a path, or package://procphys_ros/….
    :param beside: folder of the scene file, searched first; None = there is none.
    :raises SceneError: naming the places searched.
    """
    shipped = shipped_file(name)
    candidates = [shipped or Path(os.path.expanduser(name))]
    if shipped is None and beside is not None:
        candidates.insert(0, beside / name)
    for path in candidates:
        with named_by(key, name):
            reason = outside(path)
        if reason:
            raise SceneError(f'{key}: "{shorten(name)}" cannot be read: {reason}')
        if _is_file(path):
            return path
    where = ' and '.join(dict.fromkeys(shorten(str(path)) for path in candidates))
    raise SceneError(f'{key}: there is no file "{shorten(name)}" (looked for {where})')


def read_lines(key: str, path: Path) -> list[str]:
    """
    Read the lines of a text file.

    :param key: of the scene file, for messages.
    :raises SceneError: when it cannot be read.
    """
    try:
        return path.read_text(encoding='utf-8-sig').splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        reason = getattr(problem, 'strerror', None) or 'it is not UTF-8 text'
        raise SceneError(f'{key}: "{shorten(str(path))}" cannot be read: {reason}') from None


def read_table(key: str, path: Path, take: Callable[[list[str]], None]) -> None:
    """
    Read a CSV file line by line, without comments after `#` and empty lines.

    :param key: of the scene file, for messages.
    :param take: called with the cells of each line.
    :raises SceneError: when it cannot be read, or `take` raises it; it names file and line.
    """
    for number, line in enumerate(read_lines(key, path), 1):
        cells = [cell.strip() for cell in line.split('#')[0].split(',')]
        if cells != ['']:
            try:
                take(cells)
            except SceneError as problem:
                raise SceneError(f'{key}: {path}, line {number}: {problem}') from None


def check_row(cells: Sequence[str], columns: Sequence[str], rows: Sequence[Sequence[float]],
              most: int) -> list[float]:
    """
    Return the numbers in a row of a table over time.

    :param columns: their names; the first is the time.
    :param rows: those before it.
    :param most: largest number of rows.
    :raises SceneError: naming the fault and what is allowed.
    """
    if len(cells) != len(columns):
        raise SceneError(f'{len(cells)} values, they must be {len(columns)}: '
                         f'{", ".join(columns)}')
    if len(rows) == most:
        raise SceneError(f'there are more than {most} rows')
    values = [read_number(cell, column) for cell, column in zip(cells, columns)]
    if not (0.0 <= values[0] < math.inf and (not rows or values[0] > rows[-1][0])):
        raise SceneError(f'time is {values[0]:g}, it must be 0 s or more and later than in the '
                         'row before')
    return values


def read_number(cell: str, column: str) -> float:
    """
    Read a number; errors do not quote what is none.

    :raises SceneError: naming the column.
    """
    try:
        return float(cell)
    except ValueError:
        raise SceneError(f'{column} must be a number') from None


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long, say
        return False
