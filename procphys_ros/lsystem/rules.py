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


"""Rules: productions compiled from their syntax trees."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
import re

from lark import Token, Tree
import numpy as np

from procphys_ros.environment import KINDS
from procphys_ros.errors import nearest_names
from procphys_ros.language import compile_expression, ControlCurve, Expression, Place, Value
from procphys_ros.lsystem.contexts import CLOSE, EXACT_CLOSE, OPEN
from procphys_ros.lsystem.modules import POP, PUSH, Vocabulary
from procphys_ros.lsystem.symbols import asking, FRAME_QUERIES, LONG_NAMES, Op, SYMBOLS

# Words that are not meant letter by letter; FfA is, and Ab may be.
_CAMEL_CASE = re.compile(r'[A-Z][a-z]{2}|[A-Z][a-z]+[A-Z][a-z]')
_HEAVIEST = 1e12  # weight of a rule; sums stay finite


def check_weight(weight: Value, place: Place) -> None:
    """
    Check that weights are within bounds.

    :param weight: of a rule, at each place where it applies.
    :param place: where it is written.
    """
    if np.any(np.less(weight, 0.0)):
        raise place.error(f'weight {np.min(weight):g} is negative')
    if np.any(np.greater(weight, _HEAVIEST)):
        raise place.error(f'weight {np.max(weight):g} must be from 0 to {_HEAVIEST:g}')


@dataclass(frozen=True)
class Produced:
    """
    A module written in an axiom or a successor.

    :ivar key: of the module.
    :ivar origin: index of this piece of the grammar, see `RuleCompiler.origins`.
    :ivar arguments: of its parameters.
    :ivar may_draw: whether it, or what interprets it, may be a segment.
    """

    key: int
    origin: int
    arguments: tuple[Expression, ...] = ()
    may_draw: bool = False


@dataclass(frozen=True)
class Production:
    """
    A compiled production.

    :ivar label: predecessor as written, for errors.
    :ivar place: where it begins.
    :ivar predecessor: key.
    :ivar left: keys of the left context, nearest first.
    :ivar right: keys and bracket codes of the right context.
    :ivar formals: for each parameter its name, the side it is on (-1 left, 0 predecessor,
        1 right), the place in that pattern, and its number in the module.
    :ivar condition: None = always.
    :ivar successor: modules that it writes.
    :ivar weight: None = the first that matches wins.
    """

    label: str
    place: Place
    predecessor: int
    left: tuple[int, ...]
    right: tuple[int, ...]
    formals: tuple[tuple[str, int, int, int], ...]
    condition: Expression | None
    successor: tuple[Produced, ...]
    weight: Expression | None

    @property
    def pattern(self) -> tuple:
        """Return the key that rules share if they are alternatives of one draw."""
        return self.predecessor, self.left, self.right, self.weight is None

    @cached_property
    def heir(self) -> int:
        """
        Return the place in the successor of the module that continues the predecessor, -1 = none.

        That is one of its own kind, else one that may draw a segment; the first outside of
        brackets, else the first within.
        """
        depth = np.cumsum([(piece.key == PUSH) * 1 - (piece.key == POP) * 1
                           for piece in self.successor])
        places = range(len(self.successor))
        for alike in ([i for i in places if self.successor[i].key == self.predecessor],
                      [i for i in places if self.successor[i].may_draw]):
            if alike:
                return min(alike, key=lambda i: (depth[i] > 0, i))
        return -1


@dataclass
class RuleCompiler:
    """
    Compiles trees against one vocabulary.

    :ivar source: name of the text.
    :ivar declared: long names that the grammar declares.
    :ivar defines: names of the defines.
    :ivar curves: functions of the grammar, by name.
    :ivar vocabulary: extended while rules are compiled.
    :ivar origins: place and name of every module written anywhere.
    :ivar words: words that were split into letters, with their places.
    """

    source: str
    declared: Collection[str]
    defines: Collection[str]
    curves: Mapping[str, ControlCurve] = field(default_factory=dict)
    vocabulary: Vocabulary = field(default_factory=Vocabulary)
    origins: list[tuple[Place, str]] = field(default_factory=list)
    words: list[tuple[str, Place]] = field(default_factory=list)

    def of(self, source: str) -> 'RuleCompiler':
        """Switch to another text."""
        self.source = source
        return self

    def rule(self, tree: Tree, line: int) -> Production:
        """
        Compile one production.

        :param tree: parsed rule.
        :param line: line of the file on which its text began.
        :raises GrammarError: for unknown modules or names, or brackets that do not match.
        """
        head, condition, _, successor, weight = tree.children
        sides = {'left_head': 'lp', 'right_head': 'pr', 'both_head': 'lpr'}.get(head.data, 'p')
        patterns = dict(zip(sides, head.children))
        place = Place.of(head, self.source, line)
        left, left_formals = self._context(patterns.get('l'), line)
        right, right_formals = self._context(patterns.get('r'), line)
        known_words = len(self.words)
        strict, strict_formals = self._context(patterns['p'], line)
        if len(self.words) > known_words:  # "Bud(x) -> F": no letter of it is meant
            raise self._undeclared(*self.words[-1])
        if len(strict) != 1 or strict[0] < 0:
            raise place.error('a rule replaces exactly one module; neighbours go into contexts: '
                              'left < module > right -> successor')
        if min(left, default=0) < 0:
            raise place.error('a left context is a path without brackets')
        formals = [(name, -1, len(left) - 1 - at, n) for name, at, n in left_formals]
        formals += [(name, 0, at, n) for name, at, n in strict_formals]
        formals += [(name, 1, at, n) for name, at, n in right_formals]
        names = [formal[0] for formal in formals]
        for name in names:
            if names.count(name) > 1:
                raise place.error(f'parameter "{name}" stands twice before the arrow')
        known = {*names, *self.defines}
        return Production(
            self._label(strict[0], [f[0] for f in strict_formals]), place, strict[0],
            tuple(reversed(left)), tuple(right), tuple(formals),
            self._optional(condition, line, known), self.produced(successor, line, known),
            self._weight(weight, line, known))

    def _label(self, key: int, names: list[str]) -> str:
        return self.vocabulary.names[key] + (f'({", ".join(names)})' if names else '')

    def _optional(self, tree: Tree | Token | None, line: int, known: set[str]):
        if tree is None or isinstance(tree, Token):  # a "*" is always true
            return None
        return compile_expression(tree, self.source, line, known, self.curves)

    def _weight(self, tree: Tree | None, line: int, known: set[str]) -> Expression | None:
        weight = self._optional(tree, line, known)
        if weight is not None and not weight.names:
            check_weight(weight.number({}, np.random.default_rng(0)), weight.place)
        return weight

    def _context(self, pattern: Tree | None, line: int) -> tuple[list[int], list[tuple]]:
        """Compile a pattern into codes, and names with their place in it."""
        codes: list[int] = []
        formals: list[tuple[str, int, int]] = []
        if pattern is None or self._is_anything(pattern, line):
            return codes, formals
        for child in pattern.children:
            if child.data == 'bracket':
                codes.append({'[': OPEN, ']': CLOSE, '=]': EXACT_CLOSE}[child.children[0]])
                continue
            names = [str(t) for t in child.children[1:] if t is not None]
            *letters, last = self._split(child.children[0].children[0], line)
            codes += [self.vocabulary.key(letter, 0) for letter in letters]
            formals += [(name, len(codes), n) for n, name in enumerate(names)]
            codes.append(self.vocabulary.key(last, len(names)))
        self._check_brackets(pattern, line)
        return codes, formals

    def _is_anything(self, tree: Tree, line: int) -> bool:
        """Return whether a tree is a lone `*`, which stands for an empty string."""
        stars = [child for child in tree.children if child.data != 'bracket'
                 and child.children[0].children[0].type == 'ANYTHING']
        if stars and len(tree.children) > 1:
            raise Place.of(stars[0], self.source, line).error(
                '"*" stands alone, for an empty context or successor')
        return bool(stars)

    def produced(self, tree: Tree, line: int, known: Collection[str]) -> tuple[Produced, ...]:
        """
        Compile an axiom or a successor.

        :param tree: parsed successor.
        :param line: line of the file on which its text began.
        :param known: names that its expressions may use.
        """
        result: list[Produced] = []
        if self._is_anything(tree, line):
            return ()
        for child in tree.children:
            place = Place.of(child, self.source, line)
            if child.data == 'bracket':
                if child.children[0] == '=]':
                    raise place.error('"=]" belongs into a right context')
                result.append(self._one(PUSH if child.children[0] == '[' else POP, place))
                continue
            *letters, last = self._split(child.children[0].children[0], line)
            arguments = tuple(compile_expression(t, self.source, line, known, self.curves)
                              for t in child.children[1:] if t is not None)
            result += [self._one(self.vocabulary.key(x, 0), place) for x in letters]
            result.append(self._one(self.vocabulary.key(last, len(arguments)), place, arguments))
        self._check_brackets(tree, line)
        return tuple(result)

    def _one(self, key: int, place: Place, arguments: tuple[Expression, ...] = ()) -> Produced:
        name = self.vocabulary.names[key]
        self.origins.append((place, name))
        may_draw = SYMBOLS[name].op == Op.SEGMENT if name in SYMBOLS else True
        return Produced(key, len(self.origins) - 1, arguments, may_draw)

    def _check_brackets(self, tree: Tree, line: int) -> None:
        opened: list[Place] = []
        for child in tree.children:
            if child.data == 'bracket':
                place = Place.of(child, self.source, line)
                if child.children[0] == '[':
                    opened.append(place)
                elif not opened:
                    raise place.error('found "]" without a "[" before it')
                else:
                    opened.pop()
        if opened:
            raise opened[-1].error('this "[" is never closed with "]"')

    def names(self, tree: Tree, line: int) -> list[str]:
        """List the symbols of an `ignore` or `consider` statement."""
        return [name for token in tree.children
                for name in (map(asking, KINDS) if token == '?E' else self._split(token, line))]

    def _split(self, token: Token, line: int) -> list[str]:
        """Split a word into declared names, known names and single letters."""
        text = str(token)
        place = Place.of(token, self.source, line)
        if text[0] == '?':
            return [self._query(text, place)]
        if not text[0].isalnum() or text in self.declared or text in LONG_NAMES:
            if text not in SYMBOLS and text not in self.declared:
                raise place.error(f'unknown module "{text}"{nearest_names(text, SYMBOLS)}')
            return [text]
        pieces = self._pieces(text)
        if not all(piece[0].isalnum() for piece in pieces):
            raise self._undeclared(text, place)
        if _CAMEL_CASE.search(text):
            self.words.append((text, place))
        return pieces

    def _query(self, text: str, place: Place) -> str:
        """Return the name of a query module."""
        if text in FRAME_QUERIES:
            return text
        kind = text[2:].strip(' \t\n(;')
        if kind not in KINDS:
            what = f'"{kind}"{nearest_names(kind, KINDS)}' if kind else f'"{text}"'
            raise place.error(f'no query {what} (?P, ?H, ?L and ?U take (x, y, z); ?E(kind; …) '
                              f'asks for {", ".join(KINDS)})')
        return asking(kind)

    def _pieces(self, word: str) -> list[str]:
        """Cut a word into the longest names that are known, and letters."""
        pieces: list[str] = []
        while word:
            size = max((len(name) for name in (*self.declared, *LONG_NAMES)
                        if word.startswith(name)), default=1)
            pieces.append(word[:size])
            word = word[size:]
        return pieces

    def _undeclared(self, word: str, place: Place):
        near = nearest_names(word, {*self.declared, *LONG_NAMES})
        return place.error(f'unknown module "{word}"{near}; names longer than one letter are '
                           f'declared: "module: {word}"')

    def check_words(self, meanings: Collection[str]) -> None:
        """
        Check that no word that looks like one name was read letter by letter.

        :param meanings: letters that rules replace or that the turtle knows.
        :raises GrammarError: for a capitalised word with a letter that has no meaning.
        """
        for word, place in self.words:
            if not {*self._pieces(word)} <= {*meanings, *self.declared}:
                raise self._undeclared(word, place)
