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


"""Syntax of one statement of an L-system: from text to a lark tree."""

from functools import cache, lru_cache

from lark import Lark, Tree
from lark.exceptions import UnexpectedInput

from procphys_ros.language import EXPRESSION_GRAMMAR, Place, syntax_error
from procphys_ros.language.parsers import make_parser
from procphys_ros.lsystem.dialects import SYMBOLS
from procphys_ros.lsystem.statements import Statement

STATEMENT_GRAMMAR = r"""
rule: head [":" (expression | ANYTHING)] ARROW successor [":" expression]
head: pattern
    | pattern "<" pattern -> left_head
    | pattern ">" pattern -> right_head
    | pattern "<" pattern ">" pattern -> both_head
pattern: (matcher | bracket)+
matcher: named [_OPEN NAME (_COMMA NAME)* _CLOSE] | asked NAME (_COMMA NAME)* _CLOSE
axiom: successor
successor: (module | bracket)+
module: named [_OPEN expression (_COMMA expression)* _CLOSE]
    | asked expression (_COMMA expression)* _CLOSE
named: WORD | SYMBOL | ANYTHING
asked: ASKED
bracket: BRACKET
symbols: (WORD | SYMBOL)*
names: [NAME (_COMMA NAME)*]
defines: [definition (_COMMA definition)*]
definition: NAME "=" expression
value: expression
curve: NAME ":" point point+
point: _OPEN expression _COMMA expression _CLOSE

ARROW.4: /-{1,2}>/
ASKED.5: /\?E\s*\(\s*[A-Za-z_]+\s*;/
ANYTHING: "*"
BRACKET.3: "[" | "]" | "=]"
%ignore /\s+/
"""  # of which each dialect has its own modules
_MODULES = r"""
WORD: /[A-Za-z0-9][A-Za-z0-9_]*/
SYMBOL: /@[A-Za-z]*|\?[A-Z]?|[-+&^\\\/|$!%.'~{}]/
"""

MODULE_WORDS = {
    'ARROW': '"->"', 'WORD': 'a module', 'SYMBOL': 'a module', 'ASKED': 'a module',
    'ANYTHING': '"*"', 'BRACKET': 'a bracket', 'COLON': '":"', 'EQUAL': '"="', 'LESSTHAN': '"<"',
    'MORETHAN': '">"',
}
_START = {
    'axiom': 'axiom', 'production': 'rule', 'decomposition': 'rule', 'interpretation': 'rule',
    'define': 'defines', 'module': 'names', 'textures': 'names', 'ignore': 'symbols',
    'consider': 'symbols', 'curve': 'curve', 'derivation length': 'value', 'angle': 'value',
    'unit': 'value', 'maximum depth': 'value',
}
STARTS = sorted(set(_START.values()))
_KEPT = 1000  # cached trees of statements, which reloads, batch runs and variants share


@cache
def _parser() -> Lark:
    return make_parser(__name__, STATEMENT_GRAMMAR + _MODULES + EXPRESSION_GRAMMAR, start=STARTS)


@lru_cache(_KEPT)
def _tree(text: str, start: str) -> Tree:
    return _parser().parse(text, start=start)


def parse_statement(statement: Statement) -> Tree:
    """
    Read one statement.

    :param statement: cut from the text by `split_statements`.
    :returns: its tree, shared by all equal statements, read-only.
    :raises GrammarError: saying what was found and what was expected.
    """
    if statement.tree is not None:
        return statement.tree
    try:
        return _tree(statement.text, _START[statement.section])
    except UnexpectedInput as problem:
        error = syntax_error(problem, statement.source, statement.line, MODULE_WORDS)
        answer = SYMBOLS.get(getattr(problem, 'char', ''))
        if answer and MODULE_WORDS['WORD'] in error.message:
            error = Place(error.source, error.line, error.column).error(
                f'{error.message}; {answer}')
        raise error from None
