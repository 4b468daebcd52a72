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


"""The reference of the L-system language says what the code does."""

from pathlib import Path
import re

import numpy as np
import pytest

from procphys_ros.appearance.palette import LOOKS
from procphys_ros.language.arithmetic import FUNCTIONS, RANDOM_FUNCTIONS
from procphys_ros.lsystem.statements import HEADERS
from procphys_ros.lsystem.symbols import ATTRIBUTES, LEAF_SIZE, LENGTH, RATE, REACH, STEP, SYMBOLS

_TEXT = (Path(__file__).resolve().parents[1] / 'docs' / 'lsystem.md').read_text('utf-8')


def _rows(heading: str) -> list[list[str]]:
    """Return the cells of the table under a heading; names lose their backquotes."""
    section = re.split(r'^#+ ', _TEXT.split(f'# {heading}\n', 1)[1], flags=re.MULTILINE)[0]
    rows = [[cell.strip() for cell in re.split(r'(?<!\\)\|', line)[1:-1]]
            for line in section.splitlines() if line.startswith('| `')]
    assert rows
    return rows


def _names(cell: str) -> list[str]:
    return [name.replace('\\|', '|') for name in re.findall(r'`([^`]+)`', cell)]


def test_sections():
    """List every section, in whatever order."""
    assert sorted(_names(row[0])[0] for row in _rows('Sections')) == sorted(HEADERS)


def test_symbols():
    """List every symbol and every query with its numbers of parameters."""
    rows = _rows('Symbols') + _rows('Queries')
    found = {re.sub(r'^[?]E[(](\w+);.*', r'?E \1', _names(row[0])[0]):
             tuple(int(n) for n in row[1].split(',')) for row in rows}
    physics = {name for a in ATTRIBUTES for name in (a.name, a.name + 'Rate')} - {'Leaf'}
    assert found == {name: symbol.arities for name, symbol in SYMBOLS.items()
                     if name not in physics}


def test_physics():
    """Check the documented default, range and unit of every attribute."""
    rows = {_names(row[0])[0]: row[1:5] for row in _rows('Physics')}
    assert list(rows) == [a.name for a in ATTRIBUTES if a.name != 'Leaf']
    for attribute in ATTRIBUTES[:-1]:
        default, low, high, unit = rows[attribute.name]
        assert (float(low), float(high), unit) == tuple(attribute.allowed)
        if np.isinf(attribute.default):
            assert default == 'never'
        elif not np.isnan(attribute.default):
            assert float(default) == attribute.default
        else:
            assert default in ('E·I/L', 'locked', 'derived')


@pytest.mark.parametrize('words, allowed', [
    ('segments are from {:g} to {:g} m', LENGTH), ('moves from {:g} to {:g} m', STEP),
    ('leaves from {:g} to {:g} m', LEAF_SIZE), ('factor from {:g} to {:g}', RATE)])
def test_ranges_in_the_text(words, allowed):
    """Say the ranges of all other parameters."""
    assert words.format(allowed.low, allowed.high) in _TEXT.replace('\n', ' ')
    assert REACH.high == 1e4 and 'beyond 10 km' in _TEXT


def test_functions():
    """List every function with its number of arguments."""
    found = {name: row[1] for row in _rows('Expressions') for name in _names(row[0])}
    wanted = {**FUNCTIONS, **RANDOM_FUNCTIONS}
    assert found == {name: f'{least}' if least == most else f'{least} to {most}'
                     for name, (_, least, most) in wanted.items()}


def test_textures():
    """List every texture."""
    section = _TEXT.split('## Textures\n', 1)[1].split('\n## ', 1)[0]
    assert _names(section) == list(LOOKS)
