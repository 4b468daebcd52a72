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

"""Records of the mean wind, as weather stations write them."""

import math
from pathlib import Path

from procphys_ros.errors import SceneError
from procphys_ros.language import shorten
from procphys_ros.physics.wind import FASTEST, Record
from procphys_ros.scene.data_file import find_data_file

_COLUMNS = ('time', 'speed', 'direction')
_LONGEST = 100_000  # rows; a day of seconds


def read_wind_record(name: str, beside: Path | None = None) -> Record:
    """
    Read a CSV file of time [s], speed [m/s] and direction [degrees].

    Lines that start with `#` and a first line of names are skipped.

    :param name: file beside the scene file, a path, or package://procphys_ros/…; '' = none.
    :param beside: folder of the scene file, searched first; None = there is none.
    :returns: rows in ascending time; () when there is no file to read.
    :raises SceneError: naming file, line, fault and what is allowed.
    """
    if not name.strip():
        return ()
    path = find_data_file('wind.file', name, beside)
    try:
        lines = path.read_text(encoding='utf-8-sig').splitlines()
    except (OSError, UnicodeDecodeError) as problem:
        reason = getattr(problem, 'strerror', None) or 'it is not UTF-8 text'
        raise SceneError(f'wind.file: "{shorten(name)}" cannot be read: {reason}') from None
    rows: list[tuple[float, float, float]] = []
    for number, line in enumerate(lines, 1):
        words = [word.strip() for word in line.split('#')[0].split(',')]
        if words == [''] or (not rows and tuple(w.lower() for w in words) == _COLUMNS):
            continue
        try:
            rows.append(_read_row(words, rows))
        except SceneError as problem:
            raise SceneError(f'wind.file: {path}, line {number}: {problem}') from None
    if not rows:
        raise SceneError(f'wind.file: {path} has no rows of {", ".join(_COLUMNS)}')
    return tuple(rows)


def _read_row(words: list[str], rows: list[tuple[float, float, float]]) -> tuple[
        float, float, float]:
    if len(words) != len(_COLUMNS):
        raise SceneError(f'{len(words)} values, they must be {len(_COLUMNS)}: '
                         f'{", ".join(_COLUMNS)}')
    if len(rows) == _LONGEST:
        raise SceneError(f'there are more than {_LONGEST} rows')
    values = []
    for word, column in zip(words, _COLUMNS):
        try:
            values.append(float(word))
        except ValueError:
            raise SceneError(f'{column} must be a number') from None
    time, speed, direction = values
    if not (math.isfinite(time) and time >= 0.0 and (not rows or time > rows[-1][0])):
        raise SceneError(f'time is {time:g}, it must be 0 s or more and later than in the row '
                         'before')
    if not 0.0 <= speed <= FASTEST:
        raise SceneError(f'speed is {speed:g}, it must be a number from 0 to {FASTEST:g} m/s')
    if not 0.0 <= direction <= 360.0:
        raise SceneError(f'direction is {direction:g}, it must be a number from 0 to 360 degrees')
    return time, speed, direction
