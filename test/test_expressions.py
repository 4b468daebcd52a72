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


"""Expressions of the grammar languages: values, vectors, randomness and refusals."""

from lark import Lark
from lark.exceptions import UnexpectedInput
import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.language import (
    compile_expression,
    EXPRESSION_GRAMMAR,
    resolve_defines,
    syntax_error,
)

_PARSER = Lark('start: expression\n%ignore /\\s+/\n' + EXPRESSION_GRAMMAR, parser='lalr',
               propagate_positions=True)


def _compile(text, known=None):
    return compile_expression(_PARSER.parse(text).children[0], 'x.lsys', known=known)


def _evaluate(text, count=1, seed=0, **values):
    return _compile(text).evaluate(values, count, np.random.default_rng(seed))


@pytest.mark.parametrize('text, value', [
    ('1 + 2 * 3', 7), ('(1 + 2) * 3', 9), ('-2^2', -4), ('2^3^2', 512), ('2^-1', 0.5),
    ('10 - 4 - 3', 3), ('24 / 4 / 2', 3), ('-7 % 3', 2), ('.5e1', 5), ('3.', 3),
    ('1 < 2', 1), ('2 <= 1', 0), ('3 == 3 && 2 != 3', 1), ('0 || 0', 0), ('!0 + !5', 1),
    ('sin(30)', 0.5), ('cos(60)', 0.5), ('tan(45)', 1), ('asin(1)', 90), ('acos(0)', 90),
    ('atan2(1, 1)', 45), ('sqrt(2)^2', 2), ('abs(-3)', 3), ('min(3, 1, 2)', 1), ('max(3, 4)', 4),
    ('floor(-1.5)', -2), ('ceil(1.2)', 2), ('exp(log(5))', 5), ('pow(2, 10)', 1024),
    ('1 > 2 || 3 > 2', 1), ('(3 > 2) * 4', 4), ('+3', 3), ('- -3', 3),
])
def test_value(text, value):
    """Follow the precedence and the functions of the language."""
    assert _evaluate(text) == pytest.approx(value)


def test_arrays():
    """Evaluate for many elements as for each of them."""
    x = np.linspace(0.13, 5, 50)  # none at 1 or 4, where rounding decides
    got = _evaluate('x * k + sqrt(x) ^ 2 > 3 && x < 4', 50, x=x, k=2.0)
    assert np.array_equal(got, [float(3 * v > 3 and v < 4) for v in x])


def test_short_circuit():
    """Do not evaluate the right side where the left side decides."""
    x = np.array([0.0, 1.0, 2.0])
    assert np.array_equal(_evaluate('x != 0 && 1 / x > 0.7', 3, x=x), [0, 1, 0])
    assert np.array_equal(_evaluate('x == 0 || 1 / x > 0.7', 3, x=x), [1, 1, 0])
    assert _evaluate('0 && 1 / 0') == 0


def test_random_numbers():
    """Draw once per element, from the generator that is given."""
    uniform = _evaluate('rand(2, 3)', 10000, seed=1)
    assert uniform.shape == (10000,) and uniform.min() >= 2 and uniform.max() <= 3
    assert uniform.mean() == pytest.approx(2.5, abs=0.02)
    normal = _evaluate('nran(5, 0.5)', 10000, seed=1)
    assert normal.mean() == pytest.approx(5, abs=0.03) and normal.std() == pytest.approx(
        0.5, rel=0.05)
    assert np.array_equal(uniform, _evaluate('rand(2, 3)', 10000, seed=1))
    assert not np.array_equal(uniform, _evaluate('rand(2, 3)', 10000, seed=2))


@pytest.mark.parametrize('text, column, words', [
    ('1 / (2 - 2)', 1, 'division of 1 by zero'), ('3 + 5 % 0', 5, 'remainder of 5 by zero'),
    ('sqrt(-1)', 1, 'sqrt(-1) is not real'), ('1 + log(0)', 5, 'log(0)'),
    ('asin(2)', 1, 'asin(2)'), ('acos(-3)', 1, 'acos(-3)'), ('(-8) ^ 0.5', 1, 'not real'),
    ('0 ^ -1', 1, 'division by zero'), ('exp(1000)', 1, 'overflows'),
    ('1e308 * 10 > 1', 1, 'overflows'), ('10 ^ 400', 1, 'overflows'),
    ('rand(2, 1)', 1, 'a <= b'), ('nran(0, -1)', 1, 'sd >= 0'),
])
def test_refusal(text, column, words):
    """Refuse what has no finite value, with its place."""
    with pytest.raises(GrammarError) as caught:
        _evaluate(text)
    assert words in str(caught.value) and (caught.value.line, caught.value.column) == (1, column)


def test_refusal_inside_an_array():
    """Name the first element that cannot be divided."""
    with pytest.raises(GrammarError, match='division of 4 by zero'):
        _evaluate('y / x', 3, x=np.array([1.0, 0.0, 2.0]), y=np.array([3.0, 4.0, 5.0]))


@pytest.mark.parametrize('text, words', [
    ('lenght * 2', 'unknown name "lenght"; did you mean length? (known here: length, width)'),
    ('sine(3)', 'unknown function "sine"; did you mean sin'),
    ('sin(1, 2)', 'sin takes 1 argument, found 2'), ('min(1)', 'min takes 2 to 16 arguments'),
    ('rand()', 'rand takes 2 arguments, found 0'), ('1e999', 'beyond the range'),
    ('(' * 400 + '-' * 400 + '1' + ')' * 400, 'nested deeper'),
    ('__import__("os")', None), ('x.__class__', None), ('x[0]', None),
])
def test_compile_error(text, words):
    """Refuse unknown names, wrong counts and anything that is not arithmetic."""
    with pytest.raises(GrammarError if words else UnexpectedInput) as caught:
        _compile(text, known=('length', 'width'))
    assert words is None or words in str(caught.value)


@pytest.mark.parametrize('text, words, column', [
    ('1 + ', 'found the end, expected "(", a name or a number', 0),
    ('1 + * 2', 'found "*", expected "("', 5),
    ('1 $ 2', 'found "$", expected an operator or the end', 3),
    ('(1 + 2', 'expected ")"', 0),
])
def test_syntax_error(text, words, column):
    """Say what was found and what was expected, in words."""
    with pytest.raises(UnexpectedInput) as caught:
        _PARSER.parse(text)
    error = syntax_error(caught.value, 'x.lsys', first_line=7)
    assert words in str(error) and error.line == 7
    assert not column or error.column == column
    assert '_' not in str(error)


def test_defines():
    """Let defines use earlier ones and be overridden by numbers."""
    definitions = [('a', _compile('2')), ('b', _compile('a * 3'))]
    generator = np.random.default_rng(0)
    assert resolve_defines(definitions, {}, generator) == {'a': 2, 'b': 6}
    assert resolve_defines(definitions, {'a': 5}, generator) == {'a': 5, 'b': 15}
    with pytest.raises(GrammarError, match=r'unknown define "aa".*defines: a, b'):
        resolve_defines(definitions, {'aa': 1}, generator)
    for value in (float('nan'), 'three', [1, 2]):
        with pytest.raises(GrammarError, match='finite number'):
            resolve_defines(definitions, {'a': value}, generator)
