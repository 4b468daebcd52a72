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


"""Arithmetic on floats and arrays alike that refuses results that are not finite."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from procphys_ros import elementary
from procphys_ros.elementary import acos, asin, atan2, cos, exp, sin, tan

Value: TypeAlias = 'float | np.ndarray'


class ArithmeticRefusal(Exception):
    """Operation without a finite result; the evaluator adds the place in the text."""


def _finite(value: Value, what: str) -> Value:
    if not np.all(np.isfinite(value)):
        raise ArithmeticRefusal(f'{what} overflows the range of numbers')
    return value


def _first(values: Value, wrong: np.ndarray) -> str:
    """Format the first of the offending values."""
    shown, wrong = np.broadcast_arrays(values, wrong)
    return f'{shown[wrong].flat[0]:g}'


def _refuse_where(wrong: np.ndarray, values: Value, what: str) -> None:
    if np.any(wrong):
        raise ArithmeticRefusal(what.format(_first(values, np.asarray(wrong))))


def divide(a: Value, b: Value) -> Value:
    """Divide; zero divisors are refused."""
    _refuse_where(np.equal(b, 0.0), a, 'division of {} by zero')
    return _finite(np.true_divide(a, b), 'the division')


def modulo(a: Value, b: Value) -> Value:
    """Take the remainder, which has the sign of the divisor; zero divisors are refused."""
    _refuse_where(np.equal(b, 0.0), a, 'remainder of {} by zero')
    return np.mod(a, b)


def power(a: Value, b: Value) -> Value:
    """Raise to a power; roots of negative numbers and powers of zero below 0 are refused."""
    a = np.asarray(a, float)
    b = np.asarray(b, float)
    _refuse_where((a < 0.0) & (b != np.floor(b)), a, 'a fractional power of {} is not real')
    _refuse_where((a == 0.0) & (b < 0.0), b, 'zero to the power {} is a division by zero')
    return _finite(elementary.power(a, b), 'the power')


def sqrt(x: Value) -> Value:
    """Take the root; negative numbers are refused."""
    _refuse_where(np.less(x, 0.0), x, 'sqrt({}) is not real')
    return np.sqrt(x)


def log(x: Value) -> Value:
    """Take the natural logarithm; values that are not positive are refused."""
    _refuse_where(np.less_equal(x, 0.0), x, 'log({}) does not exist')
    return elementary.log(x)


def _arc(function: Callable, name: str) -> Callable[[Value], Value]:
    def arc(x: Value) -> Value:
        _refuse_where(np.abs(x) > 1.0, x, name + '({}) does not exist, it needs -1 to 1')
        return np.degrees(function(x))
    return arc


def _turned(function: Callable) -> Callable[[Value], Value]:
    return lambda x: function(np.radians(x))


FUNCTIONS: dict[str, tuple[Callable[..., Value], int, int]] = {
    # name: (function, least arguments, most arguments)
    'sin': (_turned(sin), 1, 1),
    'cos': (_turned(cos), 1, 1),
    'tan': (_turned(tan), 1, 1),
    'asin': (_arc(asin, 'asin'), 1, 1),
    'acos': (_arc(acos, 'acos'), 1, 1),
    'atan2': (lambda y, x: np.degrees(atan2(y, x)), 2, 2),
    'sqrt': (sqrt, 1, 1),
    'abs': (np.abs, 1, 1),
    'min': (lambda *x: np.min(np.broadcast_arrays(*x), axis=0), 2, 16),
    'max': (lambda *x: np.max(np.broadcast_arrays(*x), axis=0), 2, 16),
    'floor': (np.floor, 1, 1),
    'ceil': (np.ceil, 1, 1),
    'exp': (lambda x: _finite(exp(x), 'exp'), 1, 1),
    'log': (log, 1, 1),
    'pow': (power, 2, 2),
}


def rand(generator: np.random.Generator, count: int, low: Value, high: Value) -> Value:
    """Draw uniformly between two bounds, once per element."""
    _refuse_where(np.less(high, low), high, 'rand(a, b) needs a <= b, b is {}')
    drawn = low + np.subtract(high, low) * generator.random(count)
    return _finite(drawn, 'rand')


def nran(generator: np.random.Generator, count: int, mean: Value, spread: Value) -> Value:
    """Draw from a normal distribution, once per element."""
    _refuse_where(np.less(spread, 0.0), spread, 'nran(mean, sd) needs sd >= 0, it is {}')
    return _finite(mean + spread * elementary.standard_normal(generator, count), 'nran')


RANDOM_FUNCTIONS = {'rand': (rand, 2, 2), 'nran': (nran, 2, 2)}

OPERATORS: dict[str, Callable[..., Value]] = {
    'add': lambda a, b: _finite(np.add(a, b), 'the sum'),
    'subtract': lambda a, b: _finite(np.subtract(a, b), 'the difference'),
    'multiply': lambda a, b: _finite(np.multiply(a, b), 'the product'),
    'divide': divide,
    'modulo': modulo,
    'power': power,
    'negative': lambda a: np.negative(a),
    'negation': lambda a: np.equal(a, 0.0) * 1.0,
    'less': lambda a, b: np.less(a, b) * 1.0,
    'more': lambda a, b: np.greater(a, b) * 1.0,
    '==': lambda a, b: np.equal(a, b) * 1.0,
    '!=': lambda a, b: np.not_equal(a, b) * 1.0,
    '<=': lambda a, b: np.less_equal(a, b) * 1.0,
    '>=': lambda a, b: np.greater_equal(a, b) * 1.0,
}
