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


"""Errors in the texts of L-systems: each says where, what was found and what is allowed."""

import numpy as np
import pytest

from procphys_ros.errors import GrammarError, GrammarWarning, ProcPhysError
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.wallgrammar import WallGrammar


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


def test_missing_file(tmp_path):
    """Say which file cannot be read."""
    with pytest.raises(GrammarError, match='cannot read the grammar'):
        LSystem.load(tmp_path / 'no.lsys')


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
