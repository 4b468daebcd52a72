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

"""Maps of the wind: tables of how it differs by place."""

from pathlib import Path

from procphys_ros.errors import SceneError
from procphys_ros.physics.wind.zones import (
    FACTORS,
    FARTHEST,
    HIGHEST,
    map_nodes,
    MapRows,
    TURN,
)
from procphys_ros.scene.data_file import find_data_file, read_number, read_table

_KEY = 'wind.map'
_COLUMNS = {  # least, greatest, where it is not given
    **dict.fromkeys('xyz', (-FARTHEST, FARTHEST, 0.0)), 'speed': (0.0, HIGHEST, 1.0),
    'turn': (-TURN, TURN, 0.0), 'turbulence': (0.0, HIGHEST, 1.0)}
_MOST = 100_000  # rows


def read_wind_map(name: str, beside: Path | None = None) -> MapRows:
    """
    Read a CSV file of a grid of places and the factors there; its first line names its columns.

    :param name: file beside the scene file, a path, or package://procphys_ros/…; '' = none.
    :param beside: folder of the scene file, searched first; None = there is none.
    :returns: rows of x, y, z [m] and `FACTORS`; () when there is no file to read.
    :raises SceneError: naming file, line, fault and what is allowed.
    """
    if not name.strip():
        return ()
    path = find_data_file(_KEY, name, beside)
    names: list[str] = []
    rows: list[tuple[float, ...]] = []

    def take(cells: list[str]) -> None:
        if names:
            rows.append(_read_row(cells, names, len(rows)))
        else:
            names.extend(_read_names(cells))

    read_table(_KEY, path, take)
    if not rows:
        raise SceneError(f'{_KEY}: {path} has no rows of numbers below a line of names')
    try:
        map_nodes(tuple(rows))
    except SceneError as problem:
        raise SceneError(f'{_KEY}: {path}: {problem}') from None
    return tuple(rows)


def _read_names(cells: list[str]) -> list[str]:
    """Read the line of names."""
    names = [cell.lower() for cell in cells]
    if (len(set(names)) < len(names) or not set(names) <= set(_COLUMNS)
            or not {'x', 'y'} <= set(names) or not set(names) & set(FACTORS)):
        raise SceneError('the first line must name the columns, each once: x, y, z if there are '
                         f'several heights, and some of {", ".join(FACTORS)}')
    return names


def _read_row(cells: list[str], names: list[str], count: int) -> tuple[float, ...]:
    if len(cells) != len(names):
        raise SceneError(f'{len(cells)} values, they must be {len(names)}: {", ".join(names)}')
    if count == _MOST:
        raise SceneError(f'there are more than {_MOST} rows')
    values = {name: read_number(cell, name) for cell, name in zip(cells, names)}
    for name, value in values.items():
        least, greatest, _ = _COLUMNS[name]
        if not least <= value <= greatest:
            raise SceneError(f'{name} is {value:g}, it must be a number from {least:g} to '
                             f'{greatest:g}')
    return tuple(values.get(name, default) for name, (_, _, default) in _COLUMNS.items())
