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


"""Records of ground motion: CSV files, and those of PEER."""

from collections.abc import Sequence
import math
from pathlib import Path
import re

from procphys_ros.errors import SceneError
from procphys_ros.physics.ground_motion import GroundRecord
from procphys_ros.scene.data_file import (
    check_row,
    find_data_file,
    read_lines,
    read_number,
    read_table,
)

_KEY = 'ground.motion'
_UNITS = {'m/s2': 1.0, 'm/s²': 1.0, 'g': 9.80665, 'cm/s2': 0.01, 'cm/s²': 0.01, 'gal': 0.01}
_NAMES = ('along', 'across', 'up')
_HEADER = 'time [s], along [g], across [g], up [g]'
_LONGEST = 200_000     # rows: 1,000 s at 200 Hz
_STRONGEST = 200.0     # [m/s²], ten times what was ever recorded
_PEER = re.compile(r'NPTS\s*=?\s*(\d+)\s*,?\s*DT\s*=?\s*([0-9.eE+-]+)', re.IGNORECASE)
_IN_G = re.compile(r'UNITS OF G\b', re.IGNORECASE)


def read_ground_record(names: Sequence[str], beside: Path | None = None) -> GroundRecord:
    """
    Read a recorded ground motion.

    :param names: one CSV file, or one to three files of PEER, as in `find_data_file`.
    :param beside: folder of the scene file, searched first; None = there is none.
    :returns: rows of time [s] and one to three accelerations [m/s²]; () = there is no file.
    :raises SceneError: naming file, line, fault and what is allowed.
    """
    if not names:
        return ()
    paths = [find_data_file(_KEY, name, beside) for name in names]
    peer = [path.suffix.lower() == '.at2' for path in paths]
    if len(paths) > 3 or len(paths) > 1 and not all(peer):
        raise SceneError(f'{_KEY} names {len(paths)} files; it takes one CSV file, or one to '
                         'three files of PEER, which end in .AT2')
    if not peer[0]:
        return _read_csv(paths[0])
    columns = [_read_peer(path) for path in paths]
    steps = {step for step, _ in columns}
    if len(steps) > 1:
        raise SceneError(f'{_KEY}: the files have different steps: '
                         f'{", ".join(f"{step:g} s" for step, _ in columns)}')
    count = min(len(values) for _, values in columns)
    step = columns[0][0]
    return tuple((step * row, *(values[row] for _, values in columns)) for row in range(count))


def _read_csv(path: Path) -> GroundRecord:
    """Read a table whose first line names columns and units."""
    factors: list[float] = []
    rows: list[tuple[float, ...]] = []

    def take(cells: list[str]) -> None:
        if not factors:
            factors.extend(_factors(cells))
            return
        time, *values = check_row(cells, ('time', *_NAMES)[:len(factors)], rows, _LONGEST)
        rows.append((time, *(_checked(factor * value)
                             for factor, value in zip(factors[1:], values))))

    read_table(_KEY, path, take)
    if len(rows) < 2:
        raise SceneError(f'{_KEY}: {path} has {len(rows)} rows of numbers, it must have two or '
                         f'more below a line such as "{_HEADER}"')
    return tuple(rows)


def _factors(words: Sequence[str]) -> list[float]:
    """Read the line of names and units; return the factors to SI units."""
    first, *others = (re.fullmatch(r'(\w+)\s*\[(\S+)\]', word) for word in words)
    names = [found and found[1].lower() for found in others]
    known = first and first[1].lower() == 'time' and first[2] == 's'
    if not known or not others or names != list(_NAMES[:len(others)]) or not all(
            found and found[2].lower() in _UNITS for found in others):
        raise SceneError(f'the first line must be as "{_HEADER}", without the last ones if they '
                         f'are missing; units: {", ".join(_UNITS)}')
    return [1.0, *(_UNITS[found[2].lower()] for found in others if found)]


def _checked(value: float) -> float:
    if not math.isfinite(value) or abs(value) > _STRONGEST:
        raise SceneError(f'an acceleration is {value:g} m/s², it must be a number from '
                         f'{-_STRONGEST:g} to {_STRONGEST:g}')
    return value


def _read_peer(path: Path) -> tuple[float, list[float]]:
    """Read one component of PEER's database; return its step [s] and accelerations [m/s²]."""
    lines = read_lines(_KEY, path)
    head = next((n for n, line in enumerate(lines[:8]) if _PEER.search(line)), None)
    if head is None or not _IN_G.search(' '.join(lines[:head])):
        raise SceneError(f'{_KEY}: {path} is no file of PEER: above its numbers there is no line '
                         'with "UNITS OF G" and one with "NPTS=…, DT=…"')
    count, step = re.findall(_PEER, lines[head])[0]
    try:
        interval = read_number(step, 'DT')
        if not 1e-4 <= interval <= 1.0:
            raise SceneError(f'DT is {interval:g}, it must be from 0.0001 to 1 s')
    except SceneError as problem:
        raise SceneError(f'{_KEY}: {path}, line {head + 1}: {problem}') from None
    values: list[float] = []
    for number, line in enumerate(lines[head + 1:], head + 2):
        try:
            values += [_checked(_UNITS['g'] * read_number(word, 'an acceleration'))
                       for word in line.split()]
            if len(values) > _LONGEST:
                raise SceneError(f'there are more than {_LONGEST} numbers')
        except SceneError as problem:
            raise SceneError(f'{_KEY}: {path}, line {number}: {problem}') from None
    if len(values) < max(int(count[:9]), 2):
        raise SceneError(f'{_KEY}: {path} has {len(values)} numbers, its head says {count[:9]}')
    return interval, values[:max(int(count[:9]), 2)]
