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

"""Plant graph: files in the text format of OpenAlea's multiscale tree graphs (MTG)."""

from collections.abc import Iterator
import re

import numpy as np

from procphys_ros.errors import GrammarError, nearest_names
from procphys_ros.language import Place, shorten
from procphys_ros.scans.cylinders import between, Cylinders, lowest_of
from procphys_ros.scans.scan_file import check_count, fault_of, lines_of, plain

_SECTIONS = ('CODE', 'CLASSES', 'DESCRIPTION', 'FEATURES', 'MTG')
_FIELDS = {'start x': ('xx', 'x'), 'start y': ('yy', 'y'), 'start z': ('zz', 'z'),
           'diameter': ('topdia', 'topdiameter', 'diameter', 'dia', 'diam'),
           'radius': ('topradius', 'radius')}
_ENTITY = re.compile(r'([/<+])([A-Za-z]+)(\d*)')
_CODE = re.compile(r'\^?(?:[/<+][A-Za-z]+\d*)+\Z')


class _Vertices:
    """
    Vertices of all scales.

    :param scales: of the classes.
    """

    def __init__(self, scales: dict[str, int]):
        self._scales = scales
        self.scale: list[int] = []
        self.parent: list[int] = []      # at the same scale, -1 = none
        self._complex: list[int] = []    # that it is a part of, -1 = none
        self._origin: list[int] = []     # that its first part grows from, -1 = none
        self._last: dict[int, int] = {}  # part of each complex

    def add(self, before: int, edge: str, name: str, place: Place) -> int:
        """Add a vertex that an edge leads to from another one, -1 = the scene."""
        if name not in self._scales:
            raise place.error(f'there is no class {name}{nearest_names(name, self._scales)} '
                              f'(classes: {", ".join(self._scales)})')
        scale = self._scales[name]
        if edge == '/':
            whole = self._at(before, scale - 1) if before >= 0 else -1
            source = self._origin[whole] if whole >= 0 and whole not in self._last else -1
            return self._put(scale, self._part(source, scale), whole, source)
        if before < 0:
            raise place.error(f'{edge}{name} has nothing to follow')
        parent = self._part(self._at(before, scale), scale)
        if parent < 0:
            raise place.error(f'{edge}{name} has nothing of its scale to follow')
        return self._put(scale, parent, self._complex[parent],
                         before if self.scale[before] > scale else parent)

    def _at(self, vertex: int, most: int) -> int:
        """Return the vertex, or what it is a part of, at a scale of at most this."""
        while vertex >= 0 and self.scale[vertex] > most:
            vertex = self._complex[vertex]
        return vertex

    def _part(self, vertex: int, scale: int) -> int:
        """Return the last part of a vertex at a scale, or the vertex itself; -1 = none."""
        while vertex >= 0 and self.scale[vertex] < scale:
            vertex = self._last.get(vertex, -1)
        while vertex >= 0 and self.scale[vertex] > scale:
            vertex = self._complex[vertex]
        return vertex

    def _put(self, scale: int, parent: int, whole: int, origin: int) -> int:
        self.scale.append(scale)
        self.parent.append(parent)
        self._complex.append(whole)
        self._origin.append(origin)
        if whole >= 0:
            self._last[whole] = len(self.scale) - 1
        return len(self.scale) - 1


def read_plant(raw: bytes, source: str) -> tuple[Cylinders, list[str]]:
    """
    Read the finest scale that has coordinates.

    :param raw: the file.
    :param source: its name, for errors.
    :returns: cylinders between its points, and what was put right.
    :raises GrammarError: naming line and column.
    """
    lines = list(_sections(lines_of(raw, source), source))
    for number, section, line in lines:
        if section == 'CODE' and 'FORM-A' not in line.upper():
            raise GrammarError(f'the code is "{shorten(line, 40)}"; only FORM-A is understood',
                               source, number)
    scales = _classes([(n, line) for n, section, line in lines if section == 'CLASSES'], source)
    vertices = _Vertices(scales)
    body = [(n, line) for n, section, line in lines if section == 'MTG']
    if not body:
        raise GrammarError('there is no section MTG: with vertices', source)
    given = _read_body(vertices, body, source)
    check_count(len(vertices.scale), 'vertices', source)
    return _points(vertices, given, source)


def _sections(lines: list[str], source: str) -> Iterator[tuple[int, str, str]]:
    """Yield lines with their numbers and sections, comments and headings left out."""
    section = ''
    for number, line in enumerate(lines, 1):
        line = line.partition('#')[0].rstrip()
        heading, colon, rest = line.partition(':')
        if colon and heading.strip().upper() in _SECTIONS:
            section, line = heading.strip().upper(), rest.strip()
        elif line and not section:
            raise GrammarError(f'this stands before the first section; an MTG has '
                               f'{", ".join(_SECTIONS)}', source, number)
        if line.strip():
            yield number, section, line


def _classes(rows: list[tuple[int, str]], source: str) -> dict[str, int]:
    """Read the scales of classes by their symbols."""
    scales = {}
    for number, line in rows:
        words = line.split()
        if words[0].upper() == 'SYMBOL':
            continue
        if len(words) < 2 or not words[1].isdecimal() or len(words[1]) > 3:
            raise GrammarError(f'"{shorten(line, 40)}" is no class with a scale', source, number)
        scales[words[0]] = int(words[1])
    if not scales:
        raise GrammarError('there is no section CLASSES: with symbols and scales', source)
    return scales


def _read_body(vertices: _Vertices, body: list[tuple[int, str]],
               source: str) -> list[tuple[int, int, list[str]]]:
    """Add all vertices; return those that have fields, their lines, and the fields."""
    columns = _columns(body[0], source)
    topology = columns.pop('')
    last = [-1] * topology
    given = []
    for number, line in body[1:]:
        cells = line.split('\t')
        filled = [k for k, cell in enumerate(cells[:topology]) if cell.strip()]
        if len(filled) != 1:
            raise GrammarError(f'{len(filled)} of the {topology} columns before the features hold '
                               'a vertex, one must', source, number)
        k = filled[0]
        code = cells[k].strip()
        place = Place(source, number, 1 + sum(len(cell) + 1 for cell in cells[:k]))
        code = code if code[0] in '^/<+' else f'/{code}'
        if not _CODE.match(code):
            raise place.error(f'"{shorten(code, 40)}" is not understood; vertices are written '
                              '/P1, <N2 or +N3, in a row, with ^ in front to go on in a column')
        vertex = last[k] if code[0] == '^' else next((v for v in last[:k][::-1] if v >= 0), -1)
        for edge, name, _ in _ENTITY.findall(code):
            vertex = vertices.add(vertex, edge, name, place)
        check_count(len(vertices.scale), 'vertices', source)
        last[k:] = [vertex] + [-1] * (topology - k - 1)
        fields = [cells[column].strip() if 0 <= column < len(cells) else ''
                  for column in columns.values()]
        if any(fields):
            given.append((vertex, number, fields))
    return given


def _columns(head: tuple[int, str], source: str) -> dict[str, int]:
    """Find the columns of the features, -1 = none; '' = the number of columns before them."""
    number, line = head
    names = [plain(name) for name in line.split('\t')]
    found = {meaning: next((names.index(name) for name in known if name in names), -1)
             for meaning, known in _FIELDS.items()}
    if min(found[f'start {a}'] for a in 'xyz') < 1:
        written = ', '.join(name.strip() for name in line.split('\t') if name.strip())
        raise GrammarError(f'the columns are {shorten(written)}; XX, YY and ZZ are needed after '
                           'those of the vertices', source, number)
    return {**found, '': next((k for k, name in enumerate(names) if k and name), 1)}


def _points(vertices: _Vertices, given: list[tuple[int, int, list[str]]],
            source: str) -> tuple[Cylinders, list[str]]:
    """Take the points of the finest scale that has any."""
    count = len(vertices.scale)
    line = np.zeros(count, np.int64)
    values = np.full((count, len(_FIELDS)), np.nan)
    for vertex, number, fields in given:
        line[vertex] = number
        values[vertex] = [_number(field, name, source, number)
                          for field, name in zip(fields, _FIELDS)]
    for name, column in zip(_FIELDS, values.T):
        rows = np.flatnonzero(~np.isnan(column))
        if fault := fault_of(column[rows], name):
            raise GrammarError(fault[1].removeprefix('start '), source, int(line[rows[fault[0]]]))
    placed = ~np.isnan(values[:, :3])
    if (partly := placed.any(axis=1) & ~placed.all(axis=1)).any():
        raise GrammarError('one of XX, YY and ZZ is missing', source,
                           int(line[int(np.argmax(partly))]))
    scale = np.array(vertices.scale)
    has = placed.all(axis=1)
    if not has.any():
        raise GrammarError('no vertex has coordinates XX, YY and ZZ', source)
    finest = scale == scale[has].max()
    points = np.flatnonzero(finest & has)
    parent = lowest_of(np.array(vertices.parent), ~finest | has)[np.array(vertices.parent)[points]]
    parent = np.where(np.array(vertices.parent)[points] >= 0, parent, -1)
    place = np.full(count + 1, -1)
    place[points] = np.arange(len(points))
    radii, lacking = _filled(np.where(np.isnan(values[points, 4]), 0.5 * values[points, 3],
                                      values[points, 4]), place[parent])
    notes = [f'{n} {what}' for n, what in (
        (int(np.count_nonzero(finest & ~has)), 'vertices without coordinates left out'),
        (lacking, 'points without a diameter given that of their parents')) if n]
    return between(values[points, :3], place[parent], radii), notes


def _number(field: str, name: str, source: str, line: int) -> float:
    if not field:
        return np.nan
    try:
        value = float(field)
    except ValueError:
        value = np.nan
    if value != value:
        raise GrammarError(f'{name.removeprefix("start ")} is "{shorten(field, 40)}", it must be '
                           'a number', source, line)
    return value


def _filled(radii: np.ndarray, parent: np.ndarray) -> tuple[np.ndarray, int]:
    """Fill gaps with the radii of parents, feet with those of children; return their number."""
    lacking = int(np.count_nonzero(np.isnan(radii)))
    if lacking in (0, len(radii)):
        return radii, 0
    filled = radii.tolist()
    above = parent.tolist()
    for k in range(len(filled) - 1, -1, -1):  # children come after their parents
        if above[k] >= 0 and above[above[k]] < 0 and filled[above[k]] != filled[above[k]]:
            filled[above[k]] = filled[k]
    rest = float(np.nanmax(radii))
    for k, radius in enumerate(filled):
        if radius != radius:
            filled[k] = filled[above[k]] if above[k] >= 0 else rest
    return np.array(filled), lacking
