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


"""Context-sensitive rules of L-systems, on both sides and across brackets."""

import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.lsystem import LSystem


def _step(axiom, rule, more='', steps=1):
    text = f'{more}\naxiom: {axiom}\nproduction:\n  {rule}'
    return str(LSystem.parse(text).derive(steps))


@pytest.mark.parametrize('axiom, rule, result', [
    ('ABC', 'A < B -> X', 'AXC'), ('ABC', 'C < B -> X', 'ABC'),
    ('ABC', 'B > C -> X', 'AXC'), ('ABC', 'A < B > C -> X', 'AXC'),
    ('ABC', 'A < B > A -> X', 'ABC'), ('ABCD', 'AB < C -> X', 'ABXD'),
    ('ABCD', 'BA < C -> X', 'ABCD'), ('ABCD', 'A > BCD -> X', 'XBCD'),
    ('ABC', '* < B > * -> X', 'AXC'), ('B', 'A < B -> X', 'B'), ('B', 'B > C -> X', 'B'),
])
def test_strings(axiom, rule, result):
    """Match the neighbours of a module in a plain string."""
    assert _step(axiom, rule) == result


@pytest.mark.parametrize('axiom, rule, result', [
    ('A[B]C', 'A < C -> X', 'A[B]X'),            # left context walks past side branches
    ('A[B]C', 'A < B -> X', 'A[X]C'),            # and down to the parent axis
    ('A[[B]]C', 'A < B -> X', 'A[[X]]C'),
    ('A[B]C', 'B < C -> X', 'A[B]C'),            # but not out of a side branch
    ('A[B[C]D]E', 'AB < D -> X', 'A[B[C]X]E'),
    ('A[B]C', 'A > C -> X', 'X[B]C'),            # right context skips unnamed branches
    ('A[B][D]C', 'A > C -> X', 'X[B][D]C'),
    ('A[B]C', 'A > B -> X', 'A[B]C'),            # the branch must be named
    ('A[B]C', 'A > [B] -> X', 'X[B]C'),
    ('A[B]C', 'A > [B]C -> X', 'X[B]C'),
    ('A[B]C', 'A > [C] -> X', 'A[B]C'),
    ('A[B][D]C', 'A > [D]C -> X', 'X[B][D]C'),   # any of the branches may be the named one
    ('A[B][D]C', 'A > [B][D] -> X', 'X[B][D]C'),
    ('A[B][D]C', 'A > [D][B] -> X', 'A[B][D]C'),  # in the order in which they stand
    ('A[B]', 'A > [B]C -> X', 'A[B]'),
    ('A[BE]C', 'A > [B]C -> X', 'X[BE]C'),       # a named branch may go on
    ('A[BE]C', 'A > [B=]C -> X', 'A[BE]C'),      # unless its end is asked for
    ('A[B]C', 'A > [B=]C -> X', 'X[B]C'),
    ('A[B[E]]C', 'A > [B=]C -> X', 'X[B[E]]C'),
    ('A[B[E]D]C', 'A > [B[E]D]C -> X', 'X[B[E]D]C'),
    ('A[B[F]D][B[E]D]C', 'A > [B[E]D]C -> X', 'X[B[F]D][B[E]D]C'),
    ('A[B[F][E]D]C', 'A > [B[E]D=]C -> X', 'X[B[F][E]D]C'),
    ('A[BC]', 'B > C -> X', 'A[XC]'), ('A[B]C', 'B > C -> X', 'A[B]C'),
])
def test_brackets(axiom, rule, result):
    """Follow the tree, not the string."""
    assert _step(axiom, rule) == result


def test_book_example():
    """Match BC < S > G[H]M in the string of page 32 of the book."""
    axiom = 'ABC[DE][SG[HI[JK]L]MNO]'
    assert _step(axiom, 'BC < S > G[H]M -> X') == axiom.replace('S', 'X')
    assert _step(axiom, 'BC < S > G[H=]M -> X') == axiom


@pytest.mark.parametrize('more', ['ignore: + - F', 'consider: A B C'])
def test_ignored(more):
    """Skip ignored modules on both sides, also beside brackets."""
    assert _step('A+F[-B]C', 'A < C -> X', more) == 'A+F[-B]X'
    assert _step('A+F[-B]-C', 'A > [B]C -> X', more) == 'X+F[-B]-C'
    assert _step('A+B', 'A > B -> X', more) == 'X+B'
    assert _step('A+B', 'A > B -> X') == 'A+B'
    assert _step('A[-B-]C', 'A > [B=]C -> X', more) == 'X[-B-]C'


def test_parameters_of_contexts():
    """Use the parameters of both contexts in conditions and successors."""
    rule = 'x(a) < B(l) > [C(k)] D(w) : l > k && a > 0 -> B(a*1000 + l*100 + k*10 + w)'
    assert _step('x(4)B(3)[C(2)]D(1)', rule) == 'x(4)B(4321)[C(2)]D(1)'
    assert _step('x(4)B(2)[C(3)]D(1)', rule) == 'x(4)B(2)[C(3)]D(1)'
    assert _step('A(1)B(2)C', 'A(p)B(q) < C -> C(p, q)') == 'A(1)B(2)C(1,2)'


def test_parameter_count_of_contexts():
    """Match the number of parameters of contexts too."""
    assert _step('A(1)B', 'A < B -> X') == 'A(1)B'
    assert _step('A(1)B', 'A(p) < B -> X') == 'A(1)X'


def test_signals():
    """Carry signals up and down a tree: figures 1.30 and 1.31 of the book."""
    up = _step('J[I]I[I]I[I]I', 'J < I -> J', 'ignore: + -', 2)
    assert up == 'J[J]J[J]J[I]I'
    down = _step('I[I]I[I]I[I]J', 'I > J -> J', 'ignore: + -', 2)
    assert down == 'I[I]J[I]J[I]J'


def test_parallel():
    """Match contexts in the old string, not in what has been written already."""
    assert _step('ABBB', 'A < B -> A', steps=1) == 'AABB'
    assert _step('ABBB', 'A < B -> A', steps=3) == 'AAAA'


def test_weights_with_contexts():
    """Draw only among rules whose contexts are equal."""
    text = """
        axiom: AB
        production:
          A < B -> C : 1
          B -> D : 1000000"""
    assert {str(LSystem.parse(text).derive(1, seed=s)) for s in range(20)} == {'AC'}


def _grow(random, depth):
    """Make a random axis: letters, ignored marks and branches, as text."""
    text = ''
    for _ in range(random.integers(2, 8)):
        kind = random.random()
        if kind < 0.35 and depth:
            text += '[' + _grow(random, depth - 1) + ']'
        else:
            text += random.choice(list('ABAB+'))
    return text


def _read(text, at=0):
    """Read a bracketed text into nested lists."""
    axis = []
    while at < len(text) and text[at] != ']':
        if text[at] == '[':
            branch, at = _read(text, at + 1)
            axis.append(branch)
        else:
            axis.append(text[at])
        at += 1
    return axis, at


def _fits(pattern, axis):
    """Search a pattern in a tree by recursion over nested lists."""
    at = 0
    for wanted in pattern:
        if wanted == '=':
            return not any(isinstance(item, str) and item != '+' for item in axis[at:])
        while at < len(axis):
            item, at = axis[at], at + 1
            if isinstance(wanted, list) and isinstance(item, list) and _fits(wanted, item):
                break
            if isinstance(item, str) and item != '+':
                if item != wanted:
                    return False
                break
        else:
            return False
    return True


def _marked(axis, path, left, right):
    """Write the tree with X for each B that has the contexts, as the definition says."""
    text = ''
    for number, item in enumerate(axis):
        if isinstance(item, list):
            text += '[' + _marked(item, path, left, right) + ']'
            continue
        good = path.endswith(left) and _fits(right, axis[number + 1:])
        text += 'X' if item == 'B' and good else item
        path += item.strip('+')
    return text


@pytest.fixture(scope='module')
def axiom():
    """Grow some random trees."""
    random = np.random.default_rng(7)
    return 'A' + ''.join(f'[{_grow(random, 4)}]' for _ in range(110))


@pytest.mark.parametrize('right', ['A', 'AB', '[A]B', '[A]', '[A][B]', '[A=]', '[B[A]]',
                                   '[AB=]A', '[[B]A]', '[A[B=]][A]'])
@pytest.mark.parametrize('left', ['*', 'BA'])
def test_random_trees(axiom, left, right):
    """Agree with a search over nested lists on random trees."""
    expected = _marked(_read(axiom)[0], '', left.strip('*'), _read(right)[0])
    assert _step(axiom, f'{left} < B > {right} -> X', 'ignore: +') == expected
    assert expected.count('X') > 0


@pytest.mark.parametrize('rule, words', [
    ('A[B] < C -> X', 'left context is a path without brackets'),
    ('A < B C -> X', 'exactly one module'), ('A > [B -> X', 'never closed'),
    ('A > B] -> X', 'without a "\\["'), ('A(x) < B(x) -> X', '"x" stands twice'),
    ('A > + -> X', 'ignore: it would never match'), ('A < * B -> X', 'stands alone'),
])
def test_refused(rule, words):
    """Refuse contexts that mean nothing."""
    with pytest.raises(GrammarError, match=words) as caught:
        _step('A', rule, 'ignore: +')
    assert caught.value.line == 4


def test_contexts_only_in_productions():
    """Refuse contexts where the order of application would decide."""
    with pytest.raises(GrammarError, match='"decomposition:" have no contexts'):
        LSystem.parse('axiom: A\ndecomposition:\nA < B -> C')
