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

"""Cylinder tables: CSV files of TreeQSM, SimpleForest and other structure models."""

import csv
from dataclasses import dataclass
import re

import numpy as np

from procphys_ros.errors import GrammarError
from procphys_ros.geometry.linear import norm
from procphys_ros.language import Place, shorten
from procphys_ros.scans.cylinders import Cylinders, depths
from procphys_ros.scans.linking import gaps_to, link_by_ends
from procphys_ros.scans.scan_file import check_count, fault_of, lines_of, plain

_NEEDED = ('start x, y and z; end x, y and z, or axis x, y and z and length; radius or diameter; '
           'a parent, with the ID that it names, is better than none')
# Names of columns without signs; {a} = x, y, z and {n} = 1, 2, 3.
_POINTS = {
    'start': ('start{a}', '{a}start', 'startpoint{a}', 'startpoint{n}', 'start{n}', 'base{a}',
              '{a}1'),
    'end': ('end{a}', '{a}end', 'endpoint{a}', 'endpoint{n}', 'end{n}', 'tip{a}', '{a}2'),
    'axis': ('axis{a}', '{a}axis', 'axisdirection{a}', 'axisdirection{n}', 'axis{n}',
             'direction{a}', 'direction{n}', 'd{a}')}
_NAMES = {
    **{f'{point} {a}': tuple(name.format(a=a, n=n) for name in names)
       for point, names in _POINTS.items() for n, a in enumerate('xyz', 1)},
    'length': ('length', 'len', 'cylinderlength', 'cyllength', 'l'),
    'radius': ('radius', 'radiuscyl', 'cylinderradius', 'cylradius', 'rad', 'r'),
    'diameter': ('diameter', 'cylinderdiameter', 'cyldiameter', 'diam', 'd'),
    'ID': ('id', 'cylid', 'cylinderid', 'cylinder'),
    'parent': ('parentid', 'parentcylid', 'parentcylinderid', 'parentcylinder', 'parent',
               'parentrow')}
_NO_PARENT = ('', 'nan', 'na', 'none', 'null')
_LARGEST_ID = 2**53


@dataclass(frozen=True)
class _TableRows:
    """
    Rows of a file below the names of their columns.

    :ivar names: of the columns, as written.
    :ivar separator: None = white space.
    :ivar lines: of the rows.
    :ivar numbers: of these lines in the file, from 1.
    :ivar place: of the names.
    """

    names: list[str]
    separator: str | None
    lines: list[str]
    numbers: list[int]
    place: Place

    def fields(self, line: str) -> list[str]:
        if self.separator is None:
            return line.split()
        quoted = csv.reader([line], delimiter=self.separator)
        return [field.strip() for field in next(quoted, [])]

    def place_of(self, row: int, column: int) -> Place:
        """Return the place of a field."""
        line = self.lines[row]
        if self.separator is None:
            starts = [word.start() for word in re.finditer(r'\S+', line)]
        else:
            starts = [0, *(sign.end() for sign in re.finditer(re.escape(self.separator), line))]
        at = starts[column] if column < len(starts) else len(line)
        return Place(self.place.source, self.numbers[row], 1 + at)


def read_table(raw: bytes, source: str) -> Cylinders:
    """
    Read cylinders in rows, with names of the columns above.

    :param raw: the file.
    :param source: its name, for errors.
    :raises GrammarError: naming line and column, or the columns found and needed.
    """
    table = _split(lines_of(raw, source), source)
    found = _columns(table)
    check_count(len(table.lines), 'cylinders', source)
    values = _numbers(table, found)
    start = np.column_stack([values[f'start {a}'] for a in 'xyz'])
    if 'end x' in values:
        end = np.column_stack([values[f'end {a}'] for a in 'xyz'])
    else:
        axis = np.column_stack([values[f'axis {a}'] for a in 'xyz'])
        size = np.asarray(norm(axis, axis=1))
        if (none := (size == 0.0) & (values['length'] > 0.0)).any():
            raise table.place_of(int(np.argmax(none)), found['axis x']).error('the axis is zero')
        end = start + axis * (values['length'] / np.where(size > 0.0, size, 1.0))[:, None]
    radius = values['radius'] if 'radius' in values else 0.5 * values['diameter']
    parent = (_linked(table, found, values, start, end) if 'parent' in found
              else link_by_ends(start, end, radius))
    return Cylinders(parent, start, end, radius, radius, tapered=False)


def _split(lines: list[str], source: str) -> _TableRows:
    """Find the names of the columns and the rows; a comment right above numbers holds names."""
    rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    first = next((i for i, (_, line) in enumerate(rows) if line.lstrip()[0] != '#'), len(rows))
    if first and (first == len(rows) or re.match(r'\s*[-+.\d]', rows[first][1])):
        first -= 1
    if not rows:
        raise GrammarError('the file is empty', source)
    number, head = rows[first]
    head = head.strip().lstrip('#').strip(' ')
    counts = {sign: head.count(sign) for sign in ',;\t'}
    separator = max(counts, key=counts.__getitem__)
    rows = [(row, line) for row, line in rows[first + 1:] if line.lstrip()[0] != '#']
    table = _TableRows([], separator if counts[separator] else None, [line for _, line in rows],
                       [row for row, _ in rows], Place(source, number))
    table.names.extend(table.fields(head))
    return table


def _columns(table: _TableRows) -> dict[str, int]:
    """Find the columns by their names; TreeQSM leaves the second and third of a vector empty."""
    names = [plain(name) for name in table.names]
    for i in range(len(names) - 2):
        if names[i] and not any(names[i + 1:i + 3]):
            names[i:i + 3] = [f'{names[i]}{n}' for n in (1, 2, 3)]
    found = {}
    for meaning, known in _NAMES.items():
        column = next((names.index(name) for name in known if name in names), None)
        if column is not None:
            found[meaning] = column
    has = {name: all(f'{name} {a}' in found for a in 'xyz') for name in _POINTS}
    if not (has['start'] and (has['end'] or has['axis'] and 'length' in found)
            and ('radius' in found or 'diameter' in found)):
        told = (f'the columns are {shorten(", ".join(table.names))}' if any(has.values())
                else 'none of the columns are coordinates')  # of no cylinders: not to be quoted
        raise table.place.error(f'{told}; cylinders need {_NEEDED}')
    unused = {f'axis {a}' for a in 'xyz'} | {'length'} if has['end'] else {
        f'end {a}' for a in 'xyz'}
    unused |= {'diameter'} if 'radius' in found else set()
    unused |= set() if 'parent' in found else {'ID'}
    return {name: column for name, column in found.items() if name not in unused}


def _numbers(table: _TableRows, found: dict[str, int]) -> dict[str, np.ndarray]:
    """Read the numbers of columns by their meaning, (N,) each."""
    try:
        read = np.loadtxt(
            table.lines, delimiter=table.separator, usecols=list(found.values()), ndmin=2,
            comments=None, quotechar=None if table.separator is None else '"', encoding=None,
            converters={found['parent']: _parent_number} if 'parent' in found else None)
        if len(read) != len(table.lines):
            raise ValueError('a quotation mark is not closed')
    except (ValueError, IndexError) as problem:
        raise _first_fault(table, found, problem) from None
    values = dict(zip(found, read.T))
    for name, column in values.items():
        fault = None if name in ('ID', 'parent') else fault_of(column, name)
        if fault is not None:
            raise table.place_of(fault[0], found[name]).error(fault[1])
    return values


def _parent_number(field: str) -> float:
    return -1.0 if field.strip().strip('"').lower() in _NO_PARENT else float(field)


def _first_fault(table: _TableRows, found: dict[str, int], problem: Exception) -> GrammarError:
    """Look for the first field that is no number, which numpy does not name well."""
    for row, line in enumerate(table.lines):
        fields = table.fields(line)
        for name, column in found.items():
            place = table.place_of(row, column)
            if column >= len(fields):
                return place.error(f'there are {len(fields)} columns, the names are '
                                   f'{len(table.names)}')
            if name == 'parent' and fields[column].lower() in _NO_PARENT:
                continue
            try:
                float(fields[column])
            except ValueError:
                return place.error(f'{name} is "{shorten(fields[column], 40)}", it must be a '
                                   'number')
    return table.place.error(f'the rows cannot be read: {shorten(str(problem))}')


def _linked(table: _TableRows, found: dict[str, int], values: dict[str, np.ndarray],
            start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the index of each cylinder's parent, -1 = none, (N,)."""
    named = _whole(table, found, values, 'parent')
    if 'ID' in found:
        parent = _rows_of(table, found, named, _whole(table, found, values, 'ID'))
    else:
        parent = _rows_from(named, start, end)
        if (wrong := parent >= len(parent)).any():
            row = int(np.argmax(wrong))
            raise table.place_of(row, found['parent']).error(
                f'the parent is row {named[row]}, there are {len(parent)}')
    own = depths(parent) < 0
    if own.any():
        row = int(np.argmax(own))
        raise table.place_of(row, found['parent']).error(
            f'the parent is {named[row]}, from which the cylinder comes to itself again')
    return parent


def _whole(table: _TableRows, found: dict[str, int], values: dict[str, np.ndarray],
           name: str) -> np.ndarray:
    """Return a column of whole numbers, (N,) int."""
    column = values[name]
    wrong = ~((np.abs(column) < _LARGEST_ID) & (np.floor(column) == column))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise table.place_of(row, found[name]).error(
            f'{name} is {column[row]:g}, it must be a whole number')
    return column.astype(np.int64)


def _rows_of(table: _TableRows, found: dict[str, int], named: np.ndarray,
             own: np.ndarray) -> np.ndarray:
    """Find the rows of the IDs that parents are named by."""
    order = np.argsort(own, kind='stable')
    ranked = own[order]
    if (twice := ranked[1:] == ranked[:-1]).any():
        row = int(order[1 + int(np.argmax(twice))])
        raise table.place_of(row, found['ID']).error(f'ID {own[row]} stands there twice')
    spot = np.minimum(np.searchsorted(ranked, named), len(ranked) - 1)
    known = ranked[spot] == named
    lost = ~known & (named > 0)
    if lost.any():
        row = int(np.argmax(lost))
        raise table.place_of(row, found['parent']).error(
            f'there is no cylinder {named[row]} to be the parent')
    return np.where(known, order[spot], -1)


def _rows_from(named: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Count rows from 1 as TreeQSM does; from 0 where -1 stands for none and that fits better."""
    from_one = np.where(named > 0, named - 1, -1)
    if named.min() >= 0 or named.max() >= len(named):
        return from_one
    from_zero = np.where(named >= 0, named, -1)
    ends = [np.sum(gaps_to(parent, start, end)) for parent in (from_one, from_zero)]
    return from_zero if ends[1] < ends[0] or from_one.max() < 0 else from_one
