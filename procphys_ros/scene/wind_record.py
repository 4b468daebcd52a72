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

from pathlib import Path

from procphys_ros.elementary import hypot
from procphys_ros.errors import SceneError
from procphys_ros.physics.wind import FASTEST, Record
from procphys_ros.scene.data_file import check_row, find_data_file, read_table

_COLUMNS = ('time', 'speed', 'direction', 'up')  # the last one may be missing
_LONGEST = 100_000  # rows; a day of seconds


def read_wind_record(name: str, beside: Path | None = None) -> Record:
    """
    Read a CSV file of time [s], speed [m/s], direction [degrees], and perhaps upward speed [m/s].

    Lines that start with `#` and a first line of names are skipped.

    :param name: file beside the scene file, a path, or package://procphys_ros/…; '' = none.
    :param beside: folder of the scene file, searched first; None = there is none.
    :returns: rows in ascending time; () when there is no file to read.
    :raises SceneError: naming file, line, fault and what is allowed.
    """
    if not name.strip():
        return ()
    path = find_data_file('wind.file', name, beside)
    rows: list[tuple[float, ...]] = []

    def take(cells: list[str]) -> None:
        if rows or tuple(cell.lower() for cell in cells) not in (_COLUMNS[:3], _COLUMNS):
            rows.append(_read_row(cells, rows))

    read_table('wind.file', path, take)
    if not rows:
        raise SceneError(f'wind.file: {path} has no rows of {", ".join(_COLUMNS[:3])}')
    return tuple(rows)


def _read_row(cells: list[str], rows: list[tuple[float, ...]]) -> tuple[float, ...]:
    width = len(rows[0]) if rows else 4 if len(cells) == 4 else 3
    time, speed, direction, *up = check_row(cells, _COLUMNS[:width], rows, _LONGEST)
    if not 0.0 <= speed <= FASTEST:
        raise SceneError(f'speed is {speed:g}, it must be a number from 0 to {FASTEST:g} m/s')
    if not 0.0 <= direction <= 360.0:
        raise SceneError(f'direction is {direction:g}, it must be a number from 0 to 360 degrees')
    if up and not hypot(speed, up[0]) <= FASTEST:
        raise SceneError(f'up is {up[0]:g}, it must be a number from {-FASTEST:g} to {FASTEST:g} '
                         'm/s, and less with the speed')
    return time, speed, direction, *up
