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


"""Reader: the statements of a grammar text, in the manner that walls and mechanisms share."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Self, TypeAlias

from lark import Lark
from lark.exceptions import UnexpectedInput

from procphys_ros.language.expressions import compile_expression, Expression
from procphys_ros.language.includes import read_include
from procphys_ros.language.parsers import make_parser
from procphys_ros.language.place import Place
from procphys_ros.language.syntax import shorten, syntax_error

Node: TypeAlias = Any  # a tree; lark types its children only as trees or tokens


@dataclass(frozen=True)
class Entry:
    """`key: values` of a material or layout; each value is an expression or a bare name."""

    values: 'tuple[Expression | str, ...]'
    place: Place


class GrammarReader:
    """
    Parse tree of a text that holds one statement of a kind and any number of others.

    :cvar grammar: in lark's own language.
    :cvar words: names of its tokens, for errors.
    :cvar what: a text is, for errors.
    :cvar start: kind of the one statement; its parameters follow its name.
    :cvar others: kinds of the other statements, beside includes.
    :ivar trees: statements by kind.
    :ivar parameters: names of those of the one statement.
    """

    grammar: ClassVar[str]
    words: ClassVar[dict[str, str]]
    what: ClassVar[str]
    start: ClassVar[str]
    others: ClassVar[tuple[str, ...]]

    def __init__(self, text: str, source: str, included: bool = False):
        """
        Parse a text.

        :param source: name for errors.
        :param included: whether another text includes it: its one statement does not count.
        :raises GrammarError: where the text does not fit the language.
        """
        self.source = source
        self.trees: dict[str, list[Node]] = {
            kind: [] for kind in ('include', self.start, *self.others)}
        try:
            tree = self._parser().parse(text)
        except UnexpectedInput as problem:
            raise syntax_error(problem, source, words=self.words) from None
        for child in tree.children:
            self.trees[child.data].append(child)
        self.parameters: list[str] = []
        if included:
            return
        found = self.trees[self.start]
        if len(found) != 1:
            place = self.place(found[1]) if found else Place(source)
            raise place.error(f'{self.what} holds exactly one {self.start}, found {len(found)}')
        self.parameters = [str(node.children[0]) for node in found[0].children[1:]
                           if node is not None and node.data == 'parameter']

    @classmethod
    @cache
    def _parser(cls) -> Lark:
        return make_parser(cls.__module__, cls.grammar)

    def included(self, folder: Path | None, seen: set[Path] | None = None) -> Iterator[Self]:
        """
        Read the texts that this one includes, also through others, each once.

        :param folder: searched first for included files; None = the shipped ones only.
        :param seen: files read already; None = this one.
        """
        seen = {Path(shorten(self.source)).resolve()} if seen is None else seen
        for node in self.trees['include']:
            found = read_include(str(node.children[0])[1:-1], folder, self.place(node), seen)
            if found is None:
                continue
            path, text = found
            seen.add(path)
            inner = type(self)(text, str(path), included=True)
            yield inner
            yield from inner.included(path.parent, seen)

    def place(self, node: Node) -> Place:
        return Place.of(node, self.source)

    def expression(self, node: Node, known: Collection[str]) -> Expression:
        return compile_expression(node, self.source, known=known)

    def new(self, name: str, table: Collection[str], kind: str, place: Place) -> None:
        if name in table:
            raise place.error(f'a {kind} named "{name}" exists already')

    def parameter(self, node: Node, before: Sequence[str]) -> tuple[str, Expression]:
        """Read a parameter of the one statement, whose default may use those before it."""
        name = str(node.children[0])
        if name in before:
            raise self.place(node).error(f'the parameter "{name}" is given twice')
        return name, self.expression(node.children[1], before)

    def entries(self, nodes: Sequence[Node]) -> dict[str, Entry]:
        """Read the keys of a material or layout."""
        table: dict[str, Entry] = {}
        for node in nodes:
            key, place = str(node.children[0]), self.place(node)
            self.new(key, table, 'key', place)
            values = tuple(str(value.children[0]) if value.data == 'variable'
                           else self.expression(value, ()) for value in node.children[1:])
            table[key] = Entry(values, place)
        return table
