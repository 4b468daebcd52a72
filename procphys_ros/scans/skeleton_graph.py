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

"""Skeleton graph: PLY files with vertices and edges, such as those of AdTree."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse.csgraph

from procphys_ros.errors import GrammarError
from procphys_ros.language import Place, shorten
from procphys_ros.scans.cylinders import between, Cylinders
from procphys_ros.scans.scan_file import check_count, fault_of, lines_of, plain

_LONGEST_HEADER = 65_536  # [bytes]
_TYPES = {'char': 'i1', 'int8': 'i1', 'uchar': 'u1', 'uint8': 'u1', 'short': 'i2', 'int16': 'i2',
          'ushort': 'u2', 'uint16': 'u2', 'int': 'i4', 'int32': 'i4', 'uint': 'u4',
          'uint32': 'u4', 'float': 'f4', 'float32': 'f4', 'double': 'f8', 'float64': 'f8'}
_RADIUS, _DIAMETER = ('radius', 'vradius', 'r'), ('diameter', 'vdiameter')
_ENDS = (('vertex1', 'vertex2'), ('v1', 'v2'), ('source', 'target'))
_LISTS = ('vertexindices', 'vertexindex')


@dataclass(frozen=True)
class _Element:
    """
    Kind of rows in a PLY file.

    :ivar count: of its rows.
    :ivar names: of its values, in small letters; lists come as `name count` and two values.
    :ivar types: of these values.
    :ivar lists: columns that count the values of a list.
    """

    name: str
    count: int
    names: list[str] = field(default_factory=list)
    types: list[str] = field(default_factory=list)
    lists: list[int] = field(default_factory=list)

    def column(self, names: tuple[str, ...]) -> int:
        """Return the first column that has one of the names, -1 = none."""
        return next((self.names.index(name) for name in names if name in self.names), -1)


def read_skeleton(raw: bytes, source: str) -> tuple[Cylinders, list[str]]:
    """
    Read the tree that spans a graph from the lowest vertex of each of its pieces.

    :param raw: the file.
    :param source: its name, for errors.
    :returns: cylinders along its edges, and what was put right.
    :raises GrammarError: naming the line, or the number of the vertex or edge.
    """
    header, begin = _header(raw, source)
    ascii_text, elements = _elements(header, source)
    tables = dict(_ascii(raw[begin:], elements, len(header) + 1, source) if ascii_text
                  else _binary(raw, begin, elements, source))
    vertex, edge = (next(e for e in elements if e.name == name) for name in ('vertex', 'edge'))
    points, radii = _vertices(vertex, tables['vertex'], source)
    ends = _ends(edge, tables['edge'], len(points), source)
    parent, loops = _spanning(points, ends)
    radius = edge.column(_RADIUS)
    if np.isnan(radii).all() and radius >= 0:
        radii = _radii_of_edges(parent, ends, tables['edge'][:, radius], source)
    return (between(points, parent, radii),
            [f'{loops} edges that close loops left out'] if loops else [])


def _header(raw: bytes, source: str) -> tuple[list[str], int]:
    """Return the lines of the header, and where the rows begin."""
    end = raw.find(b'end_header', 0, _LONGEST_HEADER)
    begin = raw.find(b'\n', end) + 1
    if not raw.startswith(b'ply') or end < 0 or not begin:
        raise GrammarError('this is no PLY file: it has no header from "ply" to "end_header"',
                           source)
    text = raw[:begin].decode('latin-1')
    return [line.strip() for line in text.rstrip().split('\n')], begin


def _elements(header: list[str], source: str) -> tuple[bool, list[_Element]]:
    """Read whether the rows are text, and the elements."""
    ascii_text, elements = None, []
    for number, line in enumerate(header, 1):
        words, place = line.split(), Place(source, number)
        kind = words[0] if words else ''
        if kind == 'format':
            if words[1:2] not in (['ascii'], ['binary_little_endian']):
                raise place.error(f'the format is "{shorten(" ".join(words[1:]), 40)}"; ascii and '
                                  'binary_little_endian are read')
            ascii_text = words[1] == 'ascii'
        elif kind == 'element':
            if len(words) != 3 or not words[2].isdecimal() or len(words[2]) > 12:
                raise place.error('an element has a name and a number of rows')
            elements.append(_Element(words[1].lower(), int(words[2])))
        elif kind == 'property':
            _add_property(elements, words[1:], place)
        elif kind not in ('ply', 'comment', 'obj_info', 'end_header', ''):
            raise place.error(f'"{shorten(kind, 40)}" is not understood')
    names = [element.name for element in elements]
    if ascii_text is None or names.count('vertex') != 1 or names.count('edge') != 1:
        raise GrammarError(f'the elements are {shorten(", ".join(names)) or "none"}; a format, '
                           'vertex and edge are needed (meshes and clouds of points are no '
                           'skeletons)', source)
    return ascii_text, elements


def _add_property(elements: list[_Element], words: list[str], place: Place) -> None:
    is_list = words[:1] == ['list']
    types, name = words[is_list:-1], plain(words[-1]) if words else ''
    if not elements or len(types) != 1 + is_list or any(t not in _TYPES for t in types):
        raise place.error('a property has a type and a name')
    element, codes = elements[-1], [f'<{_TYPES[t]}' for t in types]
    if is_list:
        element.lists.append(len(element.names))
        element.names.extend([f'{name} count', f'{name} 1', f'{name} 2'])
        element.types.extend([codes[0], codes[1], codes[1]])
    else:
        element.names.append(name)
        element.types.extend(codes)


def _needed(elements: list[_Element], source: str) -> Iterator[_Element]:
    """Yield the elements up to the last one that is needed; check their counts."""
    wanted = 2
    for element in elements:
        needed = element.name in ('vertex', 'edge')
        if needed:
            check_count(element.count, f'rows of {element.name}', source)
        elif element.lists:
            raise GrammarError(f'{shorten(element.name, 40)}, which has lists, stands before '
                               'vertex or edge', source)
        yield element
        wanted -= needed
        if not wanted:
            return


def _ascii(body: bytes, elements: list[_Element], first: int,
           source: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the rows of elements as numbers; `first` is the line of the first row."""
    lines = lines_of(body, source, 'latin-1')
    done = 0
    for element in _needed(elements, source):
        rows = lines[done:done + element.count]
        if len(rows) < element.count:
            raise GrammarError(f'the file ends within {element.name}', source,
                               first + len(lines) - 1)
        if element.name in ('vertex', 'edge'):
            yield element.name, _numbers(rows, element, first + done, source)
        done += element.count


def _numbers(rows: list[str], element: _Element, first: int, source: str) -> np.ndarray:
    """Read rows of text."""
    count = len(element.names)
    try:
        table = np.loadtxt(rows, comments=None, ndmin=2, usecols=range(count))
        if len(table) == len(rows):
            return table
    except (ValueError, IndexError):
        pass
    for number, line in enumerate(rows, first):
        words = line.split()
        if len(words) < count:
            raise GrammarError(f'there are {len(words)} numbers, {element.name} has {count}',
                               source, number)
        for name, word in zip(element.names, words):
            try:
                float(word)
            except ValueError:
                raise GrammarError(f'{name} is "{shorten(word, 40)}", it must be a number', source,
                                   number, 1 + line.find(word)) from None
    raise GrammarError(f'{element.name} cannot be read', source, first)


def _binary(raw: bytes, begin: int, elements: list[_Element],
            source: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the rows of elements as numbers; lists must have two values."""
    for element in _needed(elements, source):
        row = np.dtype([(f'{k}', code) for k, code in enumerate(element.types)])
        size = row.itemsize * element.count
        if len(raw) < begin + size:
            raise GrammarError(f'the file ends within {element.name}', source)
        table = np.frombuffer(raw, row, element.count, begin)
        if element.name in ('vertex', 'edge'):
            yield element.name, np.column_stack([table[name].astype(float)
                                                 for name in row.names or ()])
        begin += size


def _vertices(element: _Element, table: np.ndarray,
              source: str) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (K, 3) and radii (K,), NaN = unknown."""
    columns = [element.column((a,)) for a in 'xyz']
    if min(columns) < 0 or element.lists:
        raise GrammarError(f'vertices have {shorten(", ".join(element.names)) or "nothing"}; x, y '
                           'and z are needed, radius may be there, but no lists', source)
    radius, diameter = element.column(_RADIUS), element.column(_DIAMETER)
    used = {**{f'vertex {a}': c for a, c in zip('xyz', columns)},
            'radius': radius, 'diameter': diameter}
    for name, column in used.items():
        if column >= 0 and (fault := fault_of(table[:, column], name)):
            raise GrammarError(f'vertex {fault[0]}: {fault[1].removeprefix("vertex ")}', source)
    radii = (table[:, radius] if radius >= 0 else 0.5 * table[:, diameter] if diameter >= 0
             else np.full(len(table), np.nan))
    return table[:, columns], radii


def _ends(element: _Element, table: np.ndarray, count: int, source: str) -> np.ndarray:
    """Return the vertices that edges join, (E, 2) int."""
    columns = next(([element.names.index(name) for name in pair] for pair in _ENDS
                    if set(pair) <= set(element.names)), None)
    if columns is None:
        at = next((k for k in element.lists if element.names[k].split()[0] in _LISTS), None)
        if at is None:
            raise GrammarError(f'edges have {shorten(", ".join(element.names)) or "nothing"}; '
                               'vertex1 and vertex2 are needed, or a list vertex_indices', source)
        columns = [at + 1, at + 2]
    for k in element.lists:
        if (wrong := table[:, k] != 2.0).any():
            row = int(np.argmax(wrong))
            raise GrammarError(f'edge {row} has {table[row, k]:g} vertices, it must have two',
                               source)
    ends = table[:, columns]
    wrong = ~((ends >= 0.0) & (ends < count) & (np.floor(ends) == ends)).all(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise GrammarError(f'edge {row} joins {ends[row, 0]:g} and {ends[row, 1]:g}, vertices are '
                           f'0 to {count - 1}', source)
    return ends.astype(np.int64)


def _spanning(points: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, int]:
    """Return parents (K,), -1 = the lowest of a piece, and the number of edges not needed."""
    count = len(points)
    links = scipy.sparse.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])),
                                   (count, count)).tocsr()
    pieces, piece = scipy.sparse.csgraph.connected_components(links, directed=False)
    order = np.lexsort((points[:, 2], piece))
    lowest = order[np.searchsorted(piece[order], np.arange(pieces))]
    rooted = scipy.sparse.coo_array(
        (np.ones(len(ends) + pieces), (np.append(ends[:, 0], np.full(pieces, count)),
                                       np.append(ends[:, 1], lowest))),
        (count + 1, count + 1)).tocsr()
    before = scipy.sparse.csgraph.breadth_first_order(rooted, count, directed=False)[1][:count]
    parent = np.where(before == count, -1, before).astype(np.int64)
    return parent, len(ends) - int(np.count_nonzero(parent >= 0))


def _radii_of_edges(parent: np.ndarray, ends: np.ndarray, radius: np.ndarray,
                    source: str) -> np.ndarray:
    """Return the radii of the edges that lead to points, (K,); feet have that of an edge there."""
    if fault := fault_of(radius, 'radius'):
        raise GrammarError(f'edge {fault[0]}: {fault[1]}', source)
    radii = np.full(len(parent), np.nan)
    for near, far in ((0, 1), (1, 0)):
        leads = parent[ends[:, far]] == ends[:, near]
        radii[ends[leads, far]] = radius[leads]
        foot = leads & (parent[ends[:, near]] < 0)
        radii[ends[foot, near]] = np.fmax(radii[ends[foot, near]], radius[foot])
    return radii
