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


"""
Expressions: arithmetic of both grammar languages, compiled once and evaluated for many at once.

A parsed expression becomes a tree of closures. Names stand for floats or for arrays of one value
per element, so one call evaluates a rule for all the places it applies to. Nothing is ever handed
to Python's own evaluator.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from lark import Token, Tree
import numpy as np

from procphys_ros.errors import nearest_names
from procphys_ros.language.arithmetic import (
    ArithmeticRefusal,
    FUNCTIONS,
    OPERATORS,
    RANDOM_FUNCTIONS,
    Value,
)
from procphys_ros.language.place import Place

_NONE: Mapping[str, Callable[[Value], Value]] = MappingProxyType({})
_DEEPEST = 150  # nested operations; keeps the closures far below Python's recursion limit


@dataclass(frozen=True)
class Scope:
    """
    Evaluation context of an expression.

    :ivar values: float or (count,) array of each name.
    :ivar count: number of elements.
    :ivar generator: source of `rand` and `nran`, one draw per element.
    """

    values: Mapping[str, Value]
    count: int
    generator: np.random.Generator

    def select(self, rows: np.ndarray, names: Collection[str]) -> 'Scope':
        """Keep only some of the elements, (K,) indices, and the names that are needed."""
        values = {n: np.asarray(v)[rows] if np.ndim(v) else v
                  for n, v in self.values.items() if n in names}
        return Scope(values, len(rows), self.generator)


@dataclass(frozen=True)
class Expression:
    """
    A compiled expression.

    :ivar names: every name it reads.
    :ivar place: where it begins.
    """

    names: frozenset[str]
    place: Place
    _run: Callable[[Scope], Value]

    @classmethod
    def constant(cls, value: float, place: Place) -> 'Expression':
        """Return an expression that is always one number."""
        return cls(frozenset(), place, lambda scope: value)

    def evaluate(self, values: Mapping[str, Value], count: int,
                 generator: np.random.Generator) -> Value:
        """
        Evaluate for all elements at once.

        :param values: float or (count,) array for each name.
        :param count: number of elements.
        :param generator: source of random numbers.
        :returns: a float when no array and no random number is involved, else (count,).
        :raises GrammarError: for a division by zero, or where no finite value exists.
        """
        with np.errstate(all='ignore'):  # refusals are checked one by one, with their place
            return self._run(Scope(values, count, generator))

    def number(self, values: Mapping[str, float], generator: np.random.Generator) -> float:
        """
        Evaluate once.

        :param values: float for each name.
        :param generator: source of random numbers.
        """
        return float(np.ravel(self.evaluate(values, 1, generator))[0])


@dataclass(frozen=True)
class _Compiler:
    source: str
    first_line: int
    known: Collection[str] | None
    curves: Mapping[str, Callable[[Value], Value]]

    def build(self, node: Tree, depth: int = 0) -> Expression:
        place = Place.of(node, self.source, self.first_line)
        if depth > _DEEPEST:
            raise place.error(f'expression nested deeper than {_DEEPEST} operations')
        if node.data == 'number':
            return self._number(node.children[0], place)
        if node.data == 'variable':
            return self._variable(node.children[0], place)
        if node.data == 'call':
            return self._call(node, place, depth)
        operands = [self.build(child, depth + 1) for child in node.children
                    if isinstance(child, Tree)]
        names = _names(operands)
        if node.data in ('both', 'either'):
            return Expression(names, place, _choice(operands, node.data == 'both'))
        symbol = node.children[1] if node.data == 'compare' else node.data
        return Expression(names, place, _apply(OPERATORS[str(symbol)], operands, place))

    def _number(self, token: Token, place: Place) -> Expression:
        number = float(token)
        if not np.isfinite(number):
            raise place.error(f'{token} is beyond the range of numbers')
        return Expression.constant(number, place)

    def _variable(self, token: Token, place: Place) -> Expression:
        name = str(token)
        if self.known is not None and name not in self.known:
            listed = ', '.join(sorted(self.known)) or 'none'
            raise place.error(f'unknown name "{name}"{nearest_names(name, self.known)} '
                              f'(known here: {listed})')
        return Expression(frozenset([name]), place, lambda scope: scope.values[name])

    def _call(self, node: Tree, place: Place, depth: int) -> Expression:
        name = str(node.children[0])
        arguments = [self.build(child, depth + 1) for child in node.children[1:]
                     if child is not None]
        table: dict[str, tuple[Callable[..., Value], int, int]] = {
            **FUNCTIONS, **RANDOM_FUNCTIONS,
            **{curve: (run, 1, 1) for curve, run in self.curves.items()}}
        if name not in table:
            raise place.error(f'unknown function "{name}"{nearest_names(name, table)} '
                              f'(functions: {", ".join(sorted(table))})')
        function, least, most = table[name]
        if not least <= len(arguments) <= most:
            wanted = f'{least}' if least == most else f'{least} to {most}'
            raise place.error(f'{name} takes {wanted} argument{"s" if most > 1 else ""}, '
                              f'found {len(arguments)}')
        return Expression(_names(arguments), place, _apply(function, arguments, place,
                                                           name in RANDOM_FUNCTIONS))


def _names(operands: list[Expression]) -> frozenset[str]:
    return frozenset(name for operand in operands for name in operand.names)


def _apply(function: Callable[..., Value], operands: list[Expression], place: Place,
           draws: bool = False) -> Callable[[Scope], Value]:
    """Apply a function to operands; those that draw take the generator and a count first."""
    runs = [operand._run for operand in operands]

    def run(scope: Scope) -> Value:
        values = [part(scope) for part in runs]
        try:
            if draws:
                return function(scope.generator, scope.count, *values)
            return function(*values)
        except ArithmeticRefusal as refusal:
            raise place.error(str(refusal)) from None
    return run


def _choice(operands: list[Expression], conjunction: bool) -> Callable[[Scope], Value]:
    """Evaluate the right side only where the left side leaves the answer open."""
    left, right = operands

    def run(scope: Scope) -> Value:
        truth = np.not_equal(left._run(scope), 0.0)
        if np.ndim(truth) == 0:
            if bool(truth) != conjunction:
                return float(truth)
            return np.not_equal(right._run(scope), 0.0) * 1.0
        rows = np.flatnonzero(truth == conjunction)
        answer = truth * 1.0
        if len(rows):
            answer[rows] = np.not_equal(right._run(scope.select(rows, right.names)), 0.0)
        return answer
    return run


def compile_expression(tree: Tree, source: str = '<text>', first_line: int = 1,
                       known: Collection[str] | None = None,
                       curves: Mapping[str, Callable[[Value], Value]] = _NONE) -> Expression:
    """
    Compile a parsed expression.

    :param tree: of the lark rule `expression`, with positions.
    :param source: name of the file or parameter, for errors.
    :param first_line: line of the file on which the parsed text began.
    :param known: names that may occur; None = any.
    :param curves: functions of one value, by name, besides those that are known everywhere.
    :raises GrammarError: for an unknown name or function, or a wrong number of arguments.
    """
    return _Compiler(source, first_line, known, curves).build(tree)
