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


"""Defines: named numbers of a grammar, which its users may override."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache

from lark import Lark
from lark.exceptions import UnexpectedInput
import numpy as np

from procphys_ros.errors import GrammarError, nearest_names
from procphys_ros.language.expressions import compile_expression, Expression
from procphys_ros.language.grammar import EXPRESSION_GRAMMAR
from procphys_ros.language.syntax import syntax_error


@cache
def _override_parser() -> Lark:
    grammar = 'start: NAME "=" expression\n%ignore /\\s+/\n' + EXPRESSION_GRAMMAR
    return Lark(grammar, parser='lalr', propagate_positions=True,
                maybe_placeholders=True)


def read_overrides(texts: Iterable[str], source: str = 'defines') -> dict[str, float]:
    """
    Read overrides written as `["storeys=3", "width=4*2.5"]`.

    :param texts: one definition each.
    :param source: what to call them in errors.
    :raises GrammarError: when one is not of the form `name=number`.
    """
    overrides: dict[str, float] = {}
    for text in texts:
        try:
            name, value = _override_parser().parse(text).children
        except UnexpectedInput as problem:
            error = syntax_error(problem, source, words={'EQUAL': '"="'})
            raise GrammarError(f'"{text}": {error.message}; write name=number', source) from None
        expression = compile_expression(value, f'{source} "{text}"', known=())
        overrides[str(name)] = expression.number({}, np.random.default_rng(0))
    return overrides


def resolve_defines(definitions: Sequence[tuple[str, Expression]],
                    overrides: Mapping[str, float], generator: np.random.Generator,
                    source: str = '<text>') -> dict[str, float]:
    """
    Evaluate the defines of a grammar in order; each may use those before it.

    :param definitions: name and compiled value.
    :param overrides: values that replace what the grammar says.
    :param generator: source of random numbers.
    :param source: name of the grammar, for errors.
    :returns: value of every define.
    :raises GrammarError: for an override of an unknown define, or one that is not a number.
    """
    known = [name for name, _ in definitions]
    for name, value in overrides.items():
        if name not in known:
            raise GrammarError(f'unknown define "{name}"{nearest_names(name, known)} '
                               f'(defines: {", ".join(known) or "none"})', source)
        if isinstance(value, str) or not np.isscalar(value) or not np.isfinite(value):
            raise GrammarError(f'define "{name}" must be a finite number, found {value!r}', source)
    values: dict[str, float] = {}
    for name, expression in definitions:
        values[name] = (float(overrides[name]) if name in overrides
                        else expression.number(values, generator))
    return values
