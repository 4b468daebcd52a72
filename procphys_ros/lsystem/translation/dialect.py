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

"""Dialects: how other programs write modules and arithmetic."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from lark import Lark, Tree
from lark.exceptions import UnexpectedInput

from procphys_ros.errors import GrammarError
from procphys_ros.language import EXPRESSION_GRAMMAR, Place, syntax_error
from procphys_ros.language.parsers import make_parser
from procphys_ros.lsystem.syntax import MODULE_WORDS, STARTS, STATEMENT_GRAMMAR
from procphys_ros.lsystem.translation.meanings import (
    CPFG,
    CPFG_FUNCTIONS,
    LPY,
    LPY_CONSTANTS,
    LPY_FUNCTIONS,
    LPY_NAMES,
    Meaning,
)


@dataclass(frozen=True)
class Dialect:
    """
    Notation and defaults of another program.

    :ivar program: its name.
    :ivar terminals: of modules, for lark.
    :ivar expressions: its arithmetic, for lark.
    :ivar meanings: of its symbols.
    :ivar names: symbols that its longer names stand for.
    :ivar functions: number of arguments, and expression of ours, of functions that we lack.
    :ivar constants: values of names that it knows.
    :ivar angle: of turns without a parameter [degrees].
    :ivar width: of its first segments, in its unit of length.
    :ivar chains: whether `a < b < c` compares the first answer with c.
    """

    program: str
    terminals: str
    expressions: str
    meanings: Mapping[str, Meaning]
    names: Mapping[str, str]
    functions: Mapping[str, tuple[int, str]]
    constants: Mapping[str, str]
    angle: float
    width: float
    chains: bool

    @cached_property
    def _parser(self) -> Lark:
        return make_parser(__name__, _STATEMENTS + self.terminals + self.expressions,
                           start=STARTS)

    def read(self, start: str, text: str, place: Place) -> Tree:
        """
        Read one statement.

        :param start: rule of lark that it is.
        :param text: that begins on the line of the place.
        :raises GrammarError: saying what was found and what was expected.
        """
        try:
            return self._parser.parse(text, start=start)
        except UnexpectedInput as problem:
            raise self._explain(problem, place) from None

    def _explain(self, problem: UnexpectedInput, place: Place) -> GrammarError:
        error = syntax_error(problem, place.source, place.line, _WORDS)
        found = str(getattr(problem, 'char', '') or getattr(problem, 'token', ''))
        if found not in _ANSWERS:
            return error
        return Place(error.source, error.line, error.column).error(
            f'{error.message}; {_ANSWERS[found]}')


_WORDS = {**MODULE_WORDS, '_FLOOR': 'an operator'}
_ANSWERS = {
    '{': 'blocks of code in rules are not read: write expressions as parameters',
    '?': 'choices "a ? b : c" are not read: write two rules with conditions',
    'if': 'choices "a if c else b" are not read: write two rules with conditions',
    'lambda': 'functions of Python are not read', '"': 'texts as parameters are not read',
    "'": 'texts as parameters are not read',
    '=': 'only values are read, and no parameters by name',
}


def _altered(grammar: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        if grammar.count(old) != 1:
            raise ValueError(f'{old!r} stands {grammar.count(old)} times in the grammar')
        grammar = grammar.replace(old, new)
    return grammar


# Both write `A()` for `A` as well, and consider brackets, as contexts always do here.
_STATEMENTS = _altered(
    STATEMENT_GRAMMAR,
    ('named [_OPEN NAME (_COMMA NAME)* _CLOSE]', 'named [_OPEN [NAME (_COMMA NAME)*] _CLOSE]'),
    ('module: named [_OPEN expression (_COMMA expression)* _CLOSE]',
     'module: named [_OPEN [expression (_COMMA expression)*] _CLOSE]'),
    ('symbols: (WORD | SYMBOL)*', 'symbols: (WORD | SYMBOL | BRACKET)*'))
CPFG_DIALECT = Dialect(
    'cpfg', r"""
WORD: /[A-Za-z0-9]/
SYMBOL: /@([GP][a-zA-Z]|T[a-z]|D[id]?|b[oc]?|[^\s<>:()\[\]])|\?[PHLUE]?|[-+&^\\\/|$!%.'~{};,_"#`]/
""",
    _altered(  # signs bind tighter than powers, which group to the left
        EXPRESSION_GRAMMAR,
        ('product _TIMES unary', 'product _TIMES power'),
        ('product _OVER unary', 'product _OVER power'),
        ('product _MODULO unary', 'product _MODULO power'),
        ('?product: unary', '?product: power'),
        ('?unary: power', '?unary: atom'),
        ('?power: atom', '?power: unary'),
        ('    | atom _POWER unary -> power', '    | power _POWER unary -> power')),
    CPFG, {}, CPFG_FUNCTIONS, {}, angle=45.0, width=0.1, chains=True)
LPY_DIALECT = Dialect(
    'L-Py', r"""
WORD: /[A-Za-z0-9]+/
SYMBOL: /@(G[ce]|T[sp]|D[id]?|[23]D|[^\s<>:()\[\]])|\?[A-Z]?|[-+&^\\\/|$!%.'~{};,_"#]/
""",
    _altered(
        EXPRESSION_GRAMMAR,
        ('?conjunction: comparison', '?conjunction: negated'),
        ('conjunction _AND comparison -> both',
         'conjunction _AND negated -> both\n?negated: comparison\n    | _NOT negated -> negation'),
        ('    | _NOT unary -> negation\n', ''),
        ('product _MODULO unary -> modulo',
         'product _MODULO unary -> modulo\n    | product _FLOOR unary -> floor_divide'),
        ('_OR: "||"', '_OR.2: /or\\b/'), ('_AND: "&&"', '_AND.2: /and\\b/'),
        ('_NOT: "!"', '_NOT.2: /not\\b/'), ('_POWER: "^"', '_POWER: "**"\n_FLOOR: "//"')),
    LPY, LPY_NAMES, LPY_FUNCTIONS, LPY_CONSTANTS, angle=60.0, width=0.2, chains=False)
