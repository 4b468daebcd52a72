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

"""Translator: from statements of other programs to those of our language."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
import re
from typing import NamedTuple

from lark import Token, Tree

from procphys_ros.language import Place
from procphys_ros.language.arithmetic import RANDOM_FUNCTIONS
from procphys_ros.lsystem.statements import RULE_SECTIONS, Statement
from procphys_ros.lsystem.symbols import SYMBOLS
from procphys_ros.lsystem.syntax import parse_statement
from procphys_ros.lsystem.translation.dialect import Dialect
from procphys_ros.lsystem.translation.meanings import Meaning

_DEEPEST = 150  # nested operations, as in `compile_expression`
_COMPARISONS = ('less', 'more', 'compare')
_STRENGTH = 63e6  # [Pa] of green silver birch (ForestGALES), whose wood the turtle begins with
_PARAMETER = re.compile(r'a\d+')


class ForeignStatement(NamedTuple):
    """
    One setting or rule in the notation of another program.

    :ivar section: of our language.
    :ivar tree: as its dialect has read it.
    :ivar line: of the file, on which its text began.
    """

    section: str
    tree: Tree
    line: int


@cache
def _ours(section: str, text: str) -> Tree:
    """Read a text of our own language."""
    return parse_statement(Statement(section, text, 1, '<translation>'))


def _filled(form: Tree, arguments: Sequence[Tree], at: Tree) -> Tree:
    """Copy a tree, with arguments for a0, a1, … and all else at one place."""
    if form.data == 'variable' and _PARAMETER.fullmatch(form.children[0]):
        return arguments[int(form.children[0][1:])]
    return Tree(form.data, [_filled(child, arguments, at) if isinstance(child, Tree) else child
                            for child in form.children], at.meta)


class Translator:
    """
    Renames modules and functions of one text.

    :param dialect: of the text.
    :param source: its name.
    :param declared: names of several letters that it declares.
    """

    def __init__(self, dialect: Dialect, source: str, declared: Sequence[str] = ()):
        self.dialect, self.source = dialect, source
        self._line = 1
        self._declared = declared
        self._names = sorted({*declared, *dialect.names, *(
            name for name in dialect.meanings if len(name) > 1 and name.isalpha())},
            key=len, reverse=True)
        self._defined: set[str] = set()
        self._interpreted: set[tuple[str, int]] = set()  # by rules of the text
        self._aliases: dict[str, None] = {}  # names that ours must declare
        self._forms: dict[tuple[str, int], tuple[str, int]] = {}  # what draws them, and line
        self._told: set[str] = set()

    def translate(self, statements: Iterable[ForeignStatement]) -> list[Statement]:
        """
        Translate all statements, and add what they need: names, unit, angle, wood.

        :raises GrammarError: for what cannot be read here.
        """
        statements = list(statements)
        self._defined = {str(one.children[0]) for statement in statements
                         if statement.section == 'define' for one in statement.tree.children}
        self._interpreted = {key for one in statements if one.section == 'interpretation'
                             for key in self._predecessor(one.tree)}
        header = self._header()
        late = [one for one in statements if one.section in ('ignore', 'consider')]
        done = [self._statement(one) for one in (*(
            one for one in statements if one not in late), *late)]
        words = ', '.join({**self._aliases, **dict.fromkeys(map(self._own, self._declared))})
        return [*header, *done, Statement('module', words, 1, self.source), *(
            Statement('interpretation', f'{_written(name, arity)} -> {form}', line, self.source)
            for (name, arity), (form, line) in self._forms.items())]

    def tell(self, place: Place, what: str) -> None:
        """Warn of something that is left out, once."""
        if what not in self._told:
            self._told.add(what)
            place.warn(what)

    def _header(self) -> list[Statement]:
        """Write the settings that the other program has elsewhere, as defines."""
        unit, angle, width, strength = map(
            self._free, ('unit', 'angle', 'width', 'strength'))
        self.tell(Place(self.source, 1), (
            f'read as {self.dialect.program}: a length of 1 is 1 m ({unit}), turns without a '
            f'parameter are {self.dialect.angle:g}° ({angle}), the first segment is '
            f'{self.dialect.width:g} thick ({width}) unless it has a width, and wood is green '
            f'birch, which breaks at 63 MPa ({strength}); the names are those of defines'))
        values = f'{unit} = 1, {angle} = {self.dialect.angle:g}, ' \
                 f'{width} = {self.dialect.width:g}, {strength} = {_STRENGTH:g}'
        return [Statement(section, text, 1, self.source) for section, text in (
            ('name', Path(self.source).stem), ('define', values), ('unit', unit),
            ('angle', angle))]

    def _free(self, name: str) -> str:
        """Return a name for a define that the text does not have itself."""
        while name in self._defined:
            name += '_'
        return name

    def _statement(self, one: ForeignStatement) -> Statement:
        self._line = one.line
        tree = one.tree
        if one.section in RULE_SECTIONS:
            tree = self._rule(tree, one.section == 'interpretation')
        elif one.section == 'axiom':
            wood = f'Strength({self._free("strength")}) Width({self._free("width")})'
            tree = Tree('axiom', [Tree('successor', [
                *_ours('axiom', wood).children[0].children,
                *self._successor(tree.children[0], False).children])], tree.meta)
        elif one.section in ('ignore', 'consider'):
            tree = Tree('symbols', [Token('WORD', name) for token in tree.children
                                    for name in self._skipped(token)], tree.meta)
        else:
            tree = self._expression(tree)
        return Statement(one.section, '', one.line, self.source, tree)

    # modules

    def _pieces(self, token: Token) -> Iterator[Token]:
        """Cut a word into known names and letters, and replace names that stand for symbols."""
        word = str(token)
        while word:
            piece = word[:1] if word[0].isalnum() else word
            piece = next((name for name in self._names if word.startswith(name)), piece)
            word = word[len(piece):]
            if piece not in self._declared:
                piece = self.dialect.names.get(piece, piece)
            yield Token.new_borrow_pos('BRACKET' if piece in ('[', ']') else 'WORD', piece, token)

    def _meaning(self, symbol: str) -> Meaning | None:
        """Return the meaning of a symbol of the program, None = it is a name of the text."""
        if symbol in self._declared:
            return None
        found = self.dialect.meanings.get(symbol)
        if found is None and not symbol.isalnum():
            code = '_'.join(f'{ord(letter):x}' for letter in symbol)
            return Meaning(f'Symbol_{code}', told='a symbol without a meaning here is left out')
        return found

    def _own(self, name: str) -> str:
        """Return the name here of a module of the text."""
        return f'{name}_' if name in SYMBOLS else name

    def _name(self, symbol: str, arity: int) -> str:
        """Return the name here of a module with a number of parameters."""
        meaning = self._meaning(symbol)
        if meaning is None:
            name = self._own(symbol)
        elif arity in meaning.same:
            return meaning.ours
        else:
            name = meaning.alias
            while name in self._declared:
                name += '_'
        if len(name) > 1:
            self._aliases[name] = None
        return name

    def _skipped(self, token: Token) -> Iterator[str]:
        """List the names here of a symbol that contexts skip or consider."""
        for piece in self._pieces(token):
            if piece.type == 'BRACKET':
                continue
            meaning = self._meaning(str(piece))
            if meaning is None:
                yield self._name(str(piece), 0)
            elif meaning.ours:
                yield meaning.ours
            if meaning is not None and meaning.alias in self._aliases:
                yield meaning.alias

    def _matchers(self, pattern: Tree) -> Iterator[Tree]:
        for child in pattern.children:
            token = child.children[0] if child.data == 'bracket' else child.children[0].children[0]
            if child.data == 'bracket' or token.type == 'ANYTHING':
                yield child
                continue
            *letters, last = self._pieces(token)
            for piece, formals in (*((letter, [None]) for letter in letters),
                                   (last, child.children[1:])):
                if piece.type == 'BRACKET':
                    yield Tree('bracket', [piece], child.meta)
                    continue
                count = sum(formal is not None for formal in formals)
                yield _module('matcher', self._name(str(piece), count), piece, formals, child)

    def _predecessor(self, rule: Tree) -> list[tuple[str, int]]:
        """Return name and number of parameters of what a rule without contexts replaces."""
        return [(str(found.children[0].children[0]),
                 sum(formal is not None for formal in found.children[1:]))
                for found in self._matchers(rule.children[0].children[0])
                if found.data == 'matcher']

    def _rule(self, rule: Tree, interprets: bool) -> Tree:
        head, condition, arrow, successor, weight = rule.children
        head = Tree(head.data, [Tree('pattern', list(self._matchers(pattern)), pattern.meta)
                                for pattern in head.children], head.meta)
        return Tree('rule', [head, self._expression(condition), arrow,
                             self._successor(successor, interprets), self._expression(weight)],
                    rule.meta)

    def _successor(self, tree: Tree, interprets: bool) -> Tree:
        """
        Translate modules that are written.

        :param interprets: whether they are drawn, and not rewritten any more.
        """
        result: list[Tree] = []
        surface = False  # whether "~" came before
        for child in tree.children:
            token = child.children[0] if child.data == 'bracket' else child.children[0].children[0]
            if child.data == 'bracket' or token.type == 'ANYTHING':
                result.append(child)
                continue
            *letters, last = self._pieces(token)
            arguments = [self._expression(argument) for argument in child.children[1:]]
            for piece, given in (*((letter, [None]) for letter in letters), (last, arguments)):
                if piece.type == 'BRACKET':
                    result.append(Tree('bracket', [piece], child.meta))
                else:
                    result += self._module(piece, given, child, interprets, surface)
                surface = piece == '~'
        return Tree('successor', result, tree.meta)

    def _module(self, piece: Token, given: list, at: Tree, interprets: bool,
                surface: bool) -> list[Tree]:
        """Translate one module that is written."""
        arity = sum(argument is not None for argument in given)
        place = Place.of(at, self.source, self._line)
        name, meaning = self._name(str(piece), arity), self._meaning(str(piece))
        form = None
        if meaning is None and surface:
            self.tell(place, f'the surface "{piece}" is drawn as a leaf of that size')
            form = 'Leaf(a0)' if arity else 'Leaf(1)'
        elif meaning is not None and arity not in meaning.same:
            form = meaning.form(arity)
            if form is None and meaning.told:
                self.tell(place, f'"{piece}": {meaning.told}')
            if form is None and interprets and (name, arity) not in self._interpreted:
                return []
        if form is not None and (name, arity) not in self._interpreted:
            if interprets:
                return [_filled(module, given, at)
                        for module in _ours('axiom', form).children[0].children]
            self._forms.setdefault((name, arity), (form, place.line))
        return [_module('module', name, piece, given, at)]

    # expressions

    def _expression(self, tree, depth: int = 0):
        """Translate functions and constants of a tree, None and tokens as they are."""
        if not isinstance(tree, Tree):
            return tree
        if depth > _DEEPEST:
            raise Place.of(tree, self.source, self._line).error(
                f'expression nested deeper than {_DEEPEST} operations')
        if tree.data == 'variable' and str(tree.children[0]) not in self._defined:
            value = self.dialect.constants.get(str(tree.children[0]))
            return tree if value is None else _filled(_value(value), (), tree)
        if (not self.dialect.chains and tree.data in _COMPARISONS
                and tree.children[0].data in _COMPARISONS):
            raise Place.of(tree, self.source, self._line).error(
                'a chain of comparisons is not read: write "a < b and b < c"')
        children = [self._expression(child, depth + 1) for child in tree.children]
        if tree.data == 'floor_divide':
            return _filled(_value('floor(a0 / a1)'), children, tree)
        if tree.data == 'call' and str(children[0]) in self.dialect.functions:
            return self._call(children, tree)
        return Tree(tree.data, children, tree.meta)

    def _call(self, children: list, at: Tree) -> Tree:
        name, arguments = str(children[0]), [one for one in children[1:] if one is not None]
        place = Place.of(at, self.source, self._line)
        count, text = self.dialect.functions[name]
        if len(arguments) != count:
            raise place.error(f'{name} takes {count} arguments, found {len(arguments)}')
        twice = [int(word[1:]) for word, n in Counter(_PARAMETER.findall(text)).items() if n > 1]
        for argument in (arguments[index] for index in twice):
            if any(call.children[0] in RANDOM_FUNCTIONS for call in argument.find_data('call')):
                raise place.error(f'{name} of a random number is not read')
        return _filled(_value(text), arguments, at)


def _module(kind: str, name: str, piece: Token, rest: list, at: Tree) -> Tree:
    token = Token.new_borrow_pos('WORD' if name[0].isalnum() else 'SYMBOL', name, piece)
    return Tree(kind, [Tree('named', [token], at.meta), *rest], at.meta)


def _value(text: str) -> Tree:
    return _ours('angle', text).children[0]


def _written(name: str, arity: int) -> str:
    formals = ', '.join(f'a{number}' for number in range(arity))
    return f'{name}({formals})' if arity else name
