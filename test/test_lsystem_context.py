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

"""Rules of L-systems: contexts, expressions, and errors with their place."""

from lark import Lark
from lark.exceptions import UnexpectedInput
import numpy as np
import pytest

from procphys_ros.errors import GrammarError, GrammarWarning, ProcPhysError
from procphys_ros.files.resources import shared_folder
from procphys_ros.language import (
    compile_expression,
    EXPRESSION_GRAMMAR,
    resolve_defines,
    syntax_error,
)
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.wallgrammar import WallGrammar


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


@pytest.mark.parametrize('left, right', [
    ('*', 'A'), ('BA', 'AB'), ('*', '[A]B'), ('BA', '[A]'), ('*', '[A][B]'), ('BA', '[A=]'),
    ('*', '[B[A]]'), ('BA', '[AB=]A'), ('BA', '[[B]A]'), ('*', '[A[B=]][A]')])
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


@pytest.mark.parametrize('text, line, column, words', [
    ('production:\nA -> B', 0, 0, 'the section "axiom:" is missing'),
    ('', 0, 0, 'the section "axiom:" is missing'),
    ('axoim: A', 1, 1, 'unknown section "axoim:"; did you mean axiom?'),
    ('axiom: A\nprodution:\nA -> B', 2, 1, 'did you mean production'),
    ('A -> B', 1, 1, 'outside any section'),
    ('\x1b[2J\x00', 1, 1, r'"\x1b[2J\x00" outside any section'),
    ('axiom: A\nangle: 3\nB', 3, 1, 'outside any section'),
    ('axiom: A\nproduction:\nmaximum depth: 2\n\n  A -> ]', 5, 8, 'without a "["'),
    ('axiom: A\nproduction:\nangle: 2\n  A F', 4, 0, 'expected'),
    ('axiom: A\naxiom: B', 2, 1, '"axiom:" stands twice, first on line 1'),
    ('axiom:', 1, 0, 'found the end, expected "*", a bracket or a module'),
    ('axiom: A [ B', 1, 10, 'this "[" is never closed'),
    ('axiom: A ] B', 1, 10, 'found "]" without a "["'),
    ('axiom: A\nproduction:\n  A -> [ B ] ]', 3, 14, 'found "]" without a "["'),
    ('axiom: A ? B', 1, 10, 'no query "?" (?P, ?H'),
    ('axiom: ?E(lihgt; 1)', 1, 8, 'no query "lihgt"; did you mean light?'),
    ('axiom: ?E(light, 1)', 1, 8, 'no query "?E"'),
    ('axiom: ?P(1)', 1, 8, '?P takes 3 parameters, found 1'),
    ('axiom: ?E(light; 1, 2)', 1, 8, '?E light takes 1 or 4 parameters, found 2'),
    ('axiom: F\ninterpretation:\n  F -> F ?P(0, 0, 0)', 3, 3, 'neither write nor replace'),
    ('axiom: F\ncurve f: (0, 1)', 2, 0, 'expected "("'),
    ('axiom: F\ncurve f: (0, 1) (0, 2)', 2, 7, 'must go from left to right'),
    ('axiom: F\ncurve sin: (0, 1) (1, 2)', 2, 7, 'a function already'),
    ('axiom: F\ncurve f: (0, 1) (1, 2)\ncurve f: (0, 1) (1, 2)', 3, 7, 'stands twice'),
    ('axiom: @Q A', 1, 8, 'unknown module "@Q"'),
    ('axiom: Trunk(1)', 1, 8, 'unknown module "Trunk"; names longer than one letter'),
    ('axiom: Widht(0.3) F', 1, 8, 'unknown module "Widht"; did you mean Width'),
    ('axiom: A_2', 1, 8, 'unknown module "A_2"'),
    ('axiom: F LeafBud', 1, 10, 'unknown module "LeafBud"; did you mean Leaf'),
    ('axiom: F Leafs(1)', 1, 10, 'unknown module "Leafs"; did you mean Leaf'),
    ('axiom: F WidthRat(0.9)', 1, 10, 'unknown module "WidthRat"; did you mean WidthRate'),
    ('axiom: A\nproduction:\nA -> F ApexBud(1)', 3, 8, 'unknown module "ApexBud"; names longer'),
    ('axiom: A\nmodule: ApexBud\nproduction:\nApxBud -> F', 4, 1, 'did you mean ApexBud?'),
    ('axiom: A\nproduction:\nA > LeafBud -> F', 3, 5, 'unknown module "LeafBud"'),
    # what cpfg and the like read
    ('#define STEPS 5\naxiom: A', 1, 1, 'write "define: STEPS = 5"'),
    ('axiom: A\n  # define R 0.9 /* ratio */', 2, 1, 'write "define: R = 0.9"'),
    ('#define SQUARE(x) x*x\naxiom: A', 1, 1, 'no macros'),
    ('#include "twig.h"\naxiom: A', 1, 1, 'write "include: twig.h"'),
    ('#ifdef X\naxiom: A', 1, 1, 'no preprocessor'),
    ('axiom: A\nproduction:\np1: A -> F', 3, 1, 'leave "p1:" out'),
    ('axiom: A(1)\nproduction:\np12 : A(x) : x > 0 --> F', 3, 1, 'leave "p12:" out'),
    ('axiom: A\np1: A -> F', 2, 1, 'begin them with a line "production:"'),
    ('axiom: F " F', 1, 10, 'a length is scaled by a parameter'),
    ('axiom: A\nproduction:\nA -> F "(0.9) F', 3, 8, 'a length is scaled by a parameter'),
    ('axiom: F ; F', 1, 10, 'colours are textures'),
    ('axiom: F\nhomomorphism\nA -> F', 2, 1, 'begun with a colon, "homomorphism:"'),
    ('axiom: F\nendlsystem', 2, 1, 'a text ends by itself'),
    ('axiom: A\nrules:\nA -> B', 2, 1, 'unknown section "rules:"'),
    ('axiom: F\ntextures: bark, oka', 2, 17, 'unknown texture "oka"; did you mean oak'),
    ('axiom: A\nproduction:\nA -> Foo(1)', 3, 6, 'unknown module "Foo"'),
    ('axiom: Width(0.3, 2) F', 1, 8, 'Width takes 1 parameter, found 2'),
    ('axiom: F(1, 2)', 1, 8, 'F takes 0 or 1 parameters, found 2'),
    ('axiom: A Tropism(1)', 1, 10, 'Tropism takes 4 parameters, found 1'),
    ('axiom: A\nproduction:\nA -> B : -0.5', 3, 10, 'weight -0.5 is negative'),
    ('axiom: A\nproduction:\nA -> B : 1e300', 3, 10, 'weight 1e+300 must be from 0 to 1e+12'),
    ('axiom: A\nproduction:\nA -> B : ', 3, 0, 'found the end, expected "(", a name'),
    ('axiom: A\nproduction:\nA -> B : heavy', 3, 10, 'unknown name "heavy"'),
    ('axiom: A\nproduction:\nA -> B : 1 2', 3, 12, 'found "2", expected an operator'),
    ('axiom: A\nproduction:\nA(l) -> F(lenght)', 3, 11, 'unknown name "lenght"'),
    ('axiom: A\nproduction:\nA(l) : l > -> F(l)', 3, 13, 'found ">", expected "(", a name'),
    ('axiom: A\nproduction:\nA(1) -> F', 3, 3, 'found "1", expected a name'),
    ('axiom: A\nproduction:\nA F', 3, 0, 'expected'),
    ('axiom: A\nproduction:\nA ->', 3, 0, 'expected "*", a bracket or a module'),
    ('axiom: A(sin())', 1, 10, 'sin takes 1 argument, found 0'),
    ('axiom: A(rnd(1))', 1, 10, 'unknown function "rnd"; did you mean rand'),
    ('axiom: A(1', 1, 0, 'expected ")"'),
    ('axiom: A\ndefine: a = 1, a = 2', 2, 16, '"a" is defined twice'),
    ('axiom: A\ndefine: a = b', 2, 13, 'unknown name "b"'),
    ('axiom: A\ndefine: a 3', 2, 11, 'found "3", expected "="'),
    ('axiom: A\ndefine: seed = 3', 2, 9, 'cannot be a define'),
    ('axiom: A\nignore: +\nconsider: A', 0, 0, 'either "ignore:" or "consider:"'),
    ('axiom: A\nderivation length: three', 2, 20, 'unknown name "three"'),
    ('axiom: A\nproduction:\nA -> * B', 3, 6, '"*" stands alone'),
    ('axiom: A\nproduction:\nA -> B =] C', 3, 0, ''),
    ('axiom: A(__import__("os"))', 1, 0, 'found'),
    ('axiom: A(' + '-' * 5000 + '1)', 1, 0, 'nested deeper'),
    ('axiom: A(' + '1+' * 5000 + '1)', 1, 0, 'nested deeper'),
    ('axiom: A\nproduction:\nA -> B(open("/etc/passwd"))', 3, 0, 'found'),
])
def test_message(text, line, column, words):
    """Name line and column, what was found and what was expected."""
    with pytest.raises(GrammarError) as caught:
        LSystem.parse(text, 'tree.lsys')
    error = caught.value
    assert words in str(error) and str(error).startswith('tree.lsys')
    assert error.line == line and column in (0, error.column)
    assert '\n' not in str(error)


def test_garbage():
    """Answer every damaged grammar with an error of our own, or a tree."""
    random = np.random.default_rng(3)
    whole = (shared_folder() / 'grammars' / 'abop_2_8.lsys').read_text()
    for _ in range(150):
        text = list(whole)
        for _ in range(3):
            text[random.integers(len(text))] = random.choice(list('()[]<>:,.+-*/%^&|!~#@ \n1AFe"'))
        try:
            LSystem.parse(''.join(text), max_modules=20_000).draw(2)
        except ProcPhysError as error:
            assert str(error)


@pytest.mark.parametrize('text, words', [
    ('axiom: F X X', 'tree.lsys:1:10: no rule and no meaning for the module X'),
    ('axiom: A2\nproduction:\nA -> F', 'tree.lsys:1:8: no rule and no meaning for the module 2'),
    ('axiom: A(1)\nproduction:\nA(l, w) -> F(l)',
     'tree.lsys:3:1: this rule never applies: it takes A with 2 parameters, which is written '
     'with 1 only')])
def test_slips_are_warned_of(text, words):
    """Warn once, with the place, of what is legal but mostly a slip."""
    with pytest.warns(GrammarWarning) as caught:
        LSystem.parse(text, 'tree.lsys')
    assert [str(warning.message)[:len(words)] for warning in caught] == [words]


@pytest.mark.parametrize('text', [
    'axiom: S F\nproduction:\nS < F -> F F', 'module: X\naxiom: F X',
    'axiom: A(1)\nproduction:\nA(l) -> A(l, 2)\nA(l, w) -> F(l)'])
def test_what_a_rule_knows_is_not_warned_of(text, recwarn):
    """Leave marks in contexts, declared names and rules that come to apply alone."""
    LSystem.parse(text)
    assert not list(recwarn)


@pytest.mark.parametrize('path', sorted((shared_folder() / 'grammars').glob('*.lsys')))
def test_shipped_grammars_hold_no_slips(path, recwarn):
    """Read every shipped tree without a warning."""
    LSystem.load(path)
    assert not list(recwarn)


@pytest.mark.parametrize('value', [None, 3, b'oak.lsys', ['oak.lsys']])
@pytest.mark.parametrize('load', [LSystem.load, WallGrammar.load, Scene.from_yaml])
def test_what_is_no_path(load, value):
    """Say so, in place of an error of Python."""
    with pytest.raises(ProcPhysError, match='is not the path of a'):
        load(value)


@pytest.mark.parametrize('steps', [1.5, '3', float('nan'), -1, 10**9])
def test_steps_are_a_whole_number(steps):
    """Say what a number of derivation steps can be."""
    with pytest.raises(GrammarError, match='steps must be a whole number, 0 to 10000, found'):
        LSystem.parse('axiom: F').derive(steps)


def test_declared_names():
    """Read declared names whole, and everything else letter by letter."""
    text = 'module: Trunk, Trunks\naxiom: {}\nproduction:\nTrunk(l) -> F(l) Trunk(l)'
    names = [m.name for m in LSystem.parse(text.format('Trunks Trunk(2) FFTrunk(1)')).derive(0)]
    assert names == ['Trunks', 'Trunk', 'F', 'F', 'Trunk']
    assert str(LSystem.parse(text.format('Trunk(2)')).derive(1)) == 'F(2)Trunk(2)'
    assert str(LSystem.parse('axiom: WidthRate(1)Width(2)').derive(0)) == 'WidthRate(1)Width(2)'


def test_symbols_are_operators_inside_parentheses():
    """Tell modules from operators by where they stand."""
    text = 'axiom: A(8)\nproduction:\nA(x) : !(x<2) -> -(-x)+(x%3)/(x/2)^(x^2)&(x&&0)|!(x-1)%'
    assert str(LSystem.parse(text).derive(1)) == '-(-8)+(2)/(4)^(64)&(0)|!(7)%'


def test_arrows():
    """Read both arrows beside minus signs."""
    assert str(LSystem.parse('axiom: A-\nproduction:\nA->-A-\n- --> +').derive(1)) == '-A-+'


def test_comments_and_spacing():
    """Skip comments and blank lines anywhere."""
    text = '# tree\n\naxiom: A # start\n\nproduction: # rules\n# none\n A -> B # end\n\n   C # on'
    assert str(LSystem.parse(text).derive(1)) == 'BC'


def test_every_section():
    """Read the settings of a grammar."""
    system = LSystem.parse("""
        name: oak
        axiom: A
        derivation length: 2

        angle: 25
        define: r = 0.9
        module: Twig
        consider: A
        textures: oak_bark, oak_leaf
        production:
          A
            # with a condition that always holds

            : 2 > 1
            -> F A
        decomposition:
        interpretation:
          A -> + Twig
        maximum depth: 1""")
    assert system.name == 'oak' and str(system.interpret()) == 'FF+Twig'


@pytest.mark.parametrize('seed', range(20))
def test_undeclared_names_do_not_fall_apart_into_letters(seed):
    """Make names of syllables and of known names: the whole one is refused, the nearest named."""
    rng = np.random.default_rng(seed)
    syllables = ('Bud', 'Apex', 'Inter', 'Node', 'Twig', 'ro', 'ku', 'Leaf', 'Width', 'Density')
    word = ''.join(rng.choice(syllables, rng.integers(2, 4))).capitalize()
    declared = f'{word[:2]}x{word[2:]}'
    for text in (f'axiom: F {word}', f'axiom: F FF{word}(1, 2)',
                 f'axiom: A\nproduction:\nA -> [ {word} ] A',
                 f'axiom: A\nproduction:\n{word} -> F'):
        with pytest.raises(GrammarError) as caught:
            LSystem.parse(f'{text}\nmodule: {declared}')
        assert f'{word}"' in caught.value.message
        assert declared in caught.value.message or 'FF' in caught.value.message


def test_letters_and_comments_stay_what_they_are():
    """Read rows of letters with a meaning, declared labels, and comments like other programs'."""
    text = """# include the twigs; define them below
#define
axiom: FfFAbF
module: p1
production:
A -> FbFf p1
b -> Ff
p1 : 1 > 0 -> F   # p2: none
"""
    assert LSystem.parse(text).build() is not None


@pytest.mark.parametrize(('text', 'line'), [
    ('axiom: A\nproduction:\nA -> F A', 3), ('axiom: A\ndecomposition:\nA -> F A', 3),
    ('axiom: A\nmaximum depth: 9999\ninterpretation:\nA -> F A', 4),
    ('axiom: ' + 'A ' * 400 + '\nproduction:\nA -> A', 3)])
def test_derivations_are_bounded_by_their_work(text, line):
    """End a derivation of short strings in many steps or passes, and say how far it came."""
    system = LSystem.parse(text, max_modules=1000)
    with pytest.raises(GrammarError, match='100,.* modules were looked at in .* steps') as told:
        system.interpret(steps=9999)
    assert told.value.line == line
    if 'production' in text:
        assert len(system.derive(steps=200)) <= 400


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
