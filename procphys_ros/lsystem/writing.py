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

"""Writing: statements of an L-system as a text of our language."""

from collections.abc import Sequence

from lark import Token, Tree

from procphys_ros.lsystem.statements import RULE_SECTIONS, Statement
from procphys_ros.lsystem.syntax import parse_statement

_SIGNS = {'add': '+', 'subtract': '-', 'multiply': '*', 'divide': '/', 'modulo': '%',
          'power': '^', 'both': '&&', 'either': '||', 'less': '<', 'more': '>'}
# As `EXPRESSION_GRAMMAR` binds them.
_RANKS = {'either': 0, 'both': 1, 'compare': 2, 'less': 2, 'more': 2, 'add': 3, 'subtract': 3,
          'multiply': 4, 'divide': 4, 'modulo': 4, 'negative': 5, 'negation': 5, 'power': 6}
_ATOM = 7
_WIDE = 99  # [columns]


def write_statements(statements: Sequence[Statement], comment: str) -> str:
    """
    Write an L-system: settings first, then the rules of each section.

    :param statements: of one text, without includes and curves.
    :param comment: of the first line.
    """
    lines = [f'# {comment}']
    for one in statements:
        if one.section not in RULE_SECTIONS and (body := _body(one)):
            lines += _folded(f'{one.section}: {body}')
    for section in RULE_SECTIONS:
        rules = [_body(one) for one in statements if one.section == section]
        lines += [f'{section}:'] * bool(rules)
        lines += [line for rule in rules for line in _folded(f'  {rule}')]
    return '\n'.join(lines) + '\n'


def _body(statement: Statement) -> str:
    if statement.section == 'name':
        return statement.text.strip()
    tree = parse_statement(statement)
    if statement.section in RULE_SECTIONS:
        return _rule(tree)
    if tree.data == 'axiom':
        return _string(tree.children[0])
    if tree.data in ('symbols', 'names'):
        between = ' ' if tree.data == 'symbols' else ', '
        return between.join(str(name) for name in tree.children if name is not None)
    if tree.data == 'defines':
        return ', '.join(f'{one.children[0]} = {_expression(one.children[1])}'
                         for one in tree.children)
    return _expression(tree.children[0])


def _folded(line: str) -> list[str]:
    """Fold a line at blanks, so that what follows carries it on."""
    lines = []
    while len(line) > _WIDE and (cut := line.rfind(' ', 8, _WIDE)) > 0:
        lines.append(line[:cut])
        line = f'      {line[cut + 1:]}'
    return [*lines, line]


def _rule(tree: Tree) -> str:
    head, condition, _, successor, weight = tree.children
    signs = {'left_head': '<', 'right_head': '>', 'both_head': '<>'}.get(head.data, '')
    result = _string(head.children[0])
    for sign, pattern in zip(signs, head.children[1:]):
        result += f' {sign} {_string(pattern)}'
    if isinstance(condition, Tree):
        result += f' : {_expression(condition)}'
    result += f' -> {_string(successor)}'
    return result if weight is None else f'{result} : {_expression(weight)}'


def _string(tree: Tree) -> str:
    return ' '.join(str(child.children[0]) if child.data == 'bracket' else _module(child)
                    for child in tree.children) or '*'


def _module(tree: Tree) -> str:
    named, *given = tree.children
    name = named.children[0]
    written = ', '.join(str(one) if isinstance(one, Token) else _expression(one)
                        for one in given if one is not None)
    return f'{name}({written})' if written else str(name)


def _expression(tree: Tree, least: int = 0) -> str:
    """Write an expression, in parentheses if it binds less tightly than it must."""
    kind, rank = tree.data, _RANKS.get(tree.data, _ATOM)
    if kind in ('number', 'variable'):
        return str(tree.children[0])
    if kind == 'call':
        given = ', '.join(_expression(one) for one in tree.children[1:] if one is not None)
        return f'{tree.children[0]}({given})'
    if kind in ('negative', 'negation'):
        result = ('-' if kind == 'negative' else '!') + _expression(tree.children[0], rank)
    else:
        left, right = tree.children[0], tree.children[-1]
        sign = tree.children[1] if kind == 'compare' else _SIGNS[kind]
        power = kind == 'power'  # its right side may have a sign
        result = f'{_expression(left, rank + power)} {sign} ' \
                 f'{_expression(right, rank - 1 if power else rank + 1)}'
    return result if rank >= least else f'({result})'
