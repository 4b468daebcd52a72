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

"""OpenStreetMap extracts: XML, and PBF by the package osmium."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

import numpy as np

from procphys_ros.errors import SceneError
from procphys_ros.maps.features import kind_of, Map

Members = list[tuple[str, int, str]]  # type, id and role
_MOST_REFS = 2000  # nodes of a way, as OpenStreetMap allows


@dataclass
class _Extract:
    """Elements of an extract by id, with their tags."""

    nodes: dict[int, tuple[float, float]] = field(default_factory=dict)
    trees: list[tuple[int, dict[str, str]]] = field(default_factory=list)
    ways: dict[int, tuple[list[int], dict[str, str]]] = field(default_factory=dict)
    relations: list[tuple[int, Members, dict[str, str]]] = field(default_factory=list)

    def line(self, refs: Iterable[int]) -> np.ndarray:
        """Return the places of nodes; those outside of the extract are missing, (n, 2)."""
        return np.array([self.nodes[ref] for ref in refs if ref in self.nodes],
                        float).reshape(-1, 2)


def read(raw: bytes, path: Path) -> Map:
    """
    Read an extract.

    :raises SceneError: naming line and element, when it cannot be read.
    """
    extract = _parsed_pbf(path) if path.suffix == '.pbf' else _Reader(path).parsed(raw)
    found = Map()
    parts: set[int] = set()
    for number, members, tags in extract.relations:
        if tags.get('type') == 'multipolygon' and kind_of(tags) == 'building':
            outer, inner = (_rings([extract.ways[ref][0] for kind, ref, role in members
                                    if kind == 'w' and ref in extract.ways
                                    and (role or 'outer') == wanted])
                            for wanted in ('outer', 'inner'))
            parts |= {ref for kind, ref, _ in members if kind == 'w'}
            for ring in outer:
                inside = inner if len(outer) == 1 else []
                found.add('building', [extract.line(r) for r in (ring, *inside)], tags,
                          f'{path}: relation {number}')
    for number, (refs, tags) in extract.ways.items():
        kind = kind_of(tags)
        if kind == 'tree' or kind is None or kind == 'building' and refs[0] != refs[-1]:
            if tags and number not in parts:
                found.leave_out('way')
        elif not (kind == 'building' and number in parts):
            found.add(kind, [extract.line(refs)], tags, f'{path}: way {number}')
    for number, tags in extract.trees:
        found.add('tree', [extract.line([number])], tags, f'{path}: node {number}')
    return found


def _rings(ways: list[list[int]]) -> list[list[int]]:
    """Join ways end to end to closed rings; what does not close is dropped."""
    left, found = [list(way) for way in ways if way], []
    while left:
        ring = left.pop()
        while ring[0] != ring[-1]:
            for k, way in enumerate(left):
                if ring[-1] in (way[0], way[-1]):
                    ring += (way if way[0] == ring[-1] else way[::-1])[1:]
                    del left[k]
                    break
            else:
                break
        if len(ring) > 3 and ring[0] == ring[-1]:
            found.append(ring)
    return found


class _Reader:
    """Reads the XML of an extract."""

    def __init__(self, path: Path):
        self._path, self._extract = path, _Extract()
        self._tags: dict[str, str] = {}
        self._refs: list[int] = []
        self._members: Members = []
        self._id = 0
        self._gone = False
        self._parser = expat.ParserCreate()
        self._parser.StartDoctypeDeclHandler = self._refuse
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end

    def parsed(self, raw: bytes) -> _Extract:
        """Parse the text."""
        try:
            self._parser.Parse(raw, True)
        except expat.ExpatError as problem:
            raise SceneError(f'{self._path}:{problem.lineno}: this is no XML: '
                             f'{expat.ErrorString(problem.code)}') from None
        return self._extract

    def _refuse(self, *_: Any) -> None:
        raise self._error('a DOCTYPE is not allowed')

    def _error(self, text: str) -> SceneError:
        return SceneError(f'{self._path}:{self._parser.CurrentLineNumber}: {text}')

    def _number(self, given: Mapping[str, str], name: str, kind: type) -> Any:
        try:
            return kind(given[name])
        except (KeyError, ValueError):
            raise self._error(f'{name} is {given.get(name)!r}, it must be a '
                              f'{"whole " if kind is int else ""}number') from None

    def _start(self, name: str, given: dict[str, str]) -> None:
        if name in ('node', 'way', 'relation'):
            self._tags, self._refs, self._members = {}, [], []
            self._id = self._number(given, 'id', int)
            self._gone = given.get('visible') == 'false' or given.get('action') == 'delete'
            if name == 'node' and not self._gone:
                self._extract.nodes[self._id] = (self._number(given, 'lon', float),
                                                 self._number(given, 'lat', float))
        elif name == 'tag':
            self._tags[given.get('k', '')] = given.get('v', '')
        elif name == 'nd':
            self._refs.append(self._number(given, 'ref', int))
            if len(self._refs) > _MOST_REFS:
                raise self._error(f'a way has more than {_MOST_REFS} nodes')
        elif name == 'member':
            self._members.append((given.get('type', '')[:1], self._number(given, 'ref', int),
                                  given.get('role', '')))

    def _end(self, name: str) -> None:
        if self._gone:
            return
        if name == 'node' and kind_of(self._tags) == 'tree':
            self._extract.trees.append((self._id, self._tags))
        elif name == 'way' and self._refs:
            self._extract.ways[self._id] = self._refs, self._tags
        elif name == 'relation':
            self._extract.relations.append((self._id, self._members, self._tags))


def _parsed_pbf(path: Path) -> _Extract:
    """Read a PBF file."""
    try:
        import osmium
    except ImportError:
        raise SceneError(f'{path}: .osm.pbf needs the package osmium: '
                         'pip install "procphys_ros[maps]"') from None
    extract = _Extract()
    try:
        element: Any
        for element in osmium.FileProcessor(str(path)):
            tags = {tag.k: tag.v for tag in element.tags}
            if element.is_node():
                extract.nodes[element.id] = element.location.lon, element.location.lat
                if kind_of(tags) == 'tree':
                    extract.trees.append((element.id, tags))
            elif element.is_way():
                refs = [node.ref for node in element.nodes]
                if refs:
                    extract.ways[element.id] = refs, tags
            elif element.is_relation():
                extract.relations.append((element.id, [
                    (member.type, member.ref, member.role) for member in element.members], tags))
    except (RuntimeError, ValueError) as problem:
        raise SceneError(f'{path}: this is no PBF extract: {problem}') from None
    return extract
