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


"""Grammars of other programs: cpfg and L-Py, read as L-systems of ours."""

import pickle
import warnings

import numpy as np
import pytest
from random_grammars import as_cpfg, as_lpy, as_lsys, draw_productions

from procphys_ros.errors import GrammarError, GrammarWarning
from procphys_ros.export.command import main as export
from procphys_ros.files.file_bounds import FileBounds, within
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.lsystem.inclusion import gather_statements
from procphys_ros.lsystem.symbols import SYMBOLS
from procphys_ros.lsystem.writing import write_statements
from procphys_ros.scene import Scene

pytestmark = pytest.mark.filterwarnings('ignore::procphys_ros.errors.GrammarWarning')
_WOOD = 2  # modules that come before the axiom: Strength and Width


def _cpfg(text: str, **options) -> LSystem:
    return LSystem.parse(text, 'plant.l', **options)


def _lpy(text: str) -> LSystem:
    return LSystem.parse(text, 'plant.lpy')


def _drawn(system: LSystem, **options) -> str:
    """Return the modules that the turtle knows."""
    return ''.join(str(module) for module in system.interpret(**options)
                   if module.name in SYMBOLS)


_HEAD = 'axiom: Strength(6.3e7) Width(0.1) '
_PAIRS = {
    'defines, labels, a homomorphism': (
        _cpfg, '#define N 3\n#define R (1/2)\nLsystem: 1\nderivation length: N\nAxiom: A(1)\n'
        'p1: A(l) : l > 0.2 --> F(l)[+(30)A(l*R)]A(l*R)\nhomomorphism\nA(l) --> F(l)\nendlsystem',
        f'{_HEAD} A(1)\nderivation length: 3\nproduction:\n'
        'A(l) : l > 0.2 -> F(l)[+(30)A(l/2)]A(l/2)\ninterpretation:\nA(l) -> F(l)'),
    'macros of modules and with parameters': (
        _cpfg, '#define up(x) ((x)+1)\n#define RED ;(2)\n#define LEAF [RED~l(0.3)]\n'
        'Lsystem: 1\nderivation length: 2\nAxiom: A(0)\nA(n) --> F(up(n))LEAF A(up(n))\n',
        f'{_HEAD} A(0)\nderivation length: 2\nproduction:\nA(n) -> F(n+1)[Leaf(0.3)]A(n+1)'),
    'macros are texts': (
        _cpfg, '#define SUM 1+2\nLsystem: 1\nderivation length: 0\nAxiom: F(SUM*2)\n',
        f'{_HEAD} F(5)\nderivation length: 0'),
    'defines that our language reserves': (
        _cpfg, '#define steps 2\nLsystem: 1\nderivation length: steps\nAxiom: F\nF --> F F\n',
        f'{_HEAD} F\nderivation length: 2\nproduction:\nF -> F F'),
    'signs before powers, powers to the left': (
        _cpfg, 'Lsystem: 1\nderivation length: 0\nAxiom: F(-2^2)F(2^3^2)F(2^-1)\n',
        f'{_HEAD} F(4)F(64)F(0.5)\nderivation length: 0'),
    'comments and rolls': (
        _cpfg, '// of a line\n/* of\n two */Lsystem: 1\nderivation length: 0\n'
        'Axiom: F//(30)F[F]//F // to the end\n',
        f'{_HEAD} F//(30)F[F]//F\nangle: 45\nderivation length: 0'),
    'functions': (
        _cpfg, 'Lsystem: 1\nderivation length: 0\nAxiom: F(sin(90))F(fabs(-2))F(trunc(2.6))'
        'F(2+sign(-3))F(atan(1))\n',
        f'{_HEAD} F(1)F(2)F(3)F(1)F(45)\nderivation length: 0'),
    'segments, widths and turns with more parameters': (
        _cpfg, 'Lsystem: 1\nderivation length: 0\nAxiom: G(2)#(0.2)F(1,7)+(20,3)f(1,2)g(1)F\n',
        f'{_HEAD} F(2)Width(0.2)F(1)+(20)f(1)f(1)F\nderivation length: 0'),
    'rules that read what is drawn otherwise': (
        _cpfg, 'Lsystem: 1\nderivation length: 2\nAxiom: G(2)#(0.2)F\nG(x) --> G(2*x)\n'
        '#(w) --> #(w/2)\n',
        f'{_HEAD} F(8)Width(0.05)F\nderivation length: 0'),
    'contexts over branches': (
        _cpfg, 'Lsystem: 1\nderivation length: 1\nconsider: AB[]\nAxiom: A+F[+(9)B]-F[&A]B\n'
        'A < B --> F F\nA > [A=]B --> ^(3)\n',
        'module: C\naxiom: Strength(6.3e7) Width(0.1) ^(3) +F[+(9)F F]-F[&A]F F\n'
        'derivation length: 0\nangle: 45'),
    'a decomposition': (
        _cpfg, 'Lsystem: 1\nderivation length: 1\nAxiom: A(3)\ndecomposition\nmaximum depth: 9\n'
        'A(n) : n > 0 --> F A(n-1)\n',
        f'{_HEAD} F F F A(0)\nderivation length: 0'),
    'no productions, an empty successor': (
        _cpfg, 'Lsystem: 1\nderivation length: 1\nAxiom: F A F\nA --> *\nEndlsystem\n',
        f'{_HEAD} F F\nderivation length: 0'),
    'a heading: y is up, left is -x': (
        _cpfg, 'Lsystem: 1\nderivation length: 0\nAxiom: @R(1,2,3)F\n',
        f'{_HEAD} @R(-1,3,2)F\nderivation length: 0'),
    'plain productions': (
        _lpy, 'r = 1 / 2\nmodule Apex(age), B\nAxiom: Apex(0)\nderivation length: 2\n'
        'production:\nApex(n) --> F(r)[+(30)B]SB()Left(10)F(n+1)EB()Apex(n+1)\n'
        'interpretation:\nB --> F(0.2)\nendlsystem\n',
        'axiom: Strength(6.3e7) Width(0.2) A(0)\nderivation length: 2\nproduction:\n'
        'A(n) -> F(0.5)[+(30)B][+(10)F(n+1)]A(n+1)\ninterpretation:\nB -> F(0.2)'),
    'choices': (
        _lpy, 'Axiom: A(0)\nderivation length: 4\nproduction:\nA(n):\n  if n < 2:\n'
        '    if n == 0: produce F(1)A(n+1)\n  elif n == 2 or not n > 0:\n    produce F(2)A(n+1)\n'
        '  else:\n    produce F(3)\nA(n) --> F(4)A(n+1)\n',
        'axiom: Strength(6.3e7) Width(0.2) F(1)F(4)F(2)F(3)\nderivation length: 0'),
    'radii, and radii at the top': (
        _lpy, 'Axiom: _(0.1)F(1)!(0.05)F(1,0.02)F\nderivation length: 1\nproduction:\n'
        '_(r) --> _(2*r)\n',
        'axiom: Strength(6.3e7) Width(0.2) Width(0.4)F(1)Width(0.1)F(1)Width(0.04)F\n'
        'derivation length: 0'),
    'arithmetic of Python': (
        _lpy, 'Axiom: F(-2**2+8)F(2**3**0)F(7//2)F(sin(radians(90)))F(degrees(pi)/180)'
        'F(int(-0.5)+1)\nderivation length: 0\nproduction:\n',
        'axiom: Strength(6.3e7) Width(0.2) F(4)F(2)F(3)F(1)F(1)F(1)\nderivation length: 0'),
    'names that mean something here': (
        _lpy, 'module Leaf, Width\nAxiom: Leaf(2)G(1)Width\nderivation length: 0\nproduction:\n'
        'interpretation:\nLeaf(s) --> ~l(s)\nG(x) --> F(x)\nWidth --> F\n',
        'axiom: Strength(6.3e7) Width(0.2) Leaf(2)F(1)F\nderivation length: 0'),
    'rolls the other way': (
        _lpy, 'Axiom: /(30)F\\(20)F\nderivation length: 0\nproduction:\n',
        'axiom: Strength(6.3e7) Width(0.2) \\(30)F/(20)F\nderivation length: 0'),
}


@pytest.mark.parametrize('name', _PAIRS)
def test_draws_what_a_translation_by_hand_draws(name):
    """Interpret a small text as its translation by hand."""
    read, text, ours = _PAIRS[name]
    assert _drawn(read(text)) == _drawn(LSystem.parse(ours))


@pytest.mark.parametrize('seed', range(16))
def test_random_productions_derive_the_same_string(seed):
    """Derive the same string from one grammar in the notations of all three programs."""
    rng = np.random.default_rng(seed)
    weighted = bool(seed % 2)
    rules = draw_productions(rng, weighted)
    wanted = LSystem.parse(as_lsys(rules, 3), max_modules=20_000)
    try:
        string = list(wanted.derive(seed=seed))
    except GrammarError as error:
        assert 'the string would grow' in error.message
        return
    assert len(string) > 3
    found = [_cpfg(as_cpfg(rules, 3))] + ([] if weighted else [_lpy(as_lpy(rules, 3))])
    for system in found:
        assert list(system.derive(seed=seed))[_WOOD:] == string


# Figures of The Algorithmic Beauty of Plants (Prusinkiewicz and Lindenmayer 1990): steps,
# productions from F or X, and the number of segments, by their recurrences: 5^n, 8^n,
# 2 (3^n - 2^n), 3/2 (4^n - 2^n).
_FIGURES = {
    '1.24 a': (5, 'F', ['F --> F[+F]F[-F]F'], 5 ** 5),
    '1.24 b': (5, 'F', ['F --> F[+F]F[-F][F]'], 5 ** 5),
    '1.24 c': (4, 'F', ['F --> FF-[-F+F+F]+[+F-F-F]'], 8 ** 4),
    '1.24 d': (7, 'X', ['X --> F[+X]F[-X]+X', 'F --> FF'], 2 * (3 ** 7 - 2 ** 7)),
    '1.24 e': (7, 'X', ['X --> F[+X][-X]FX', 'F --> FF'], 2 * (3 ** 7 - 2 ** 7)),
    '1.24 f': (5, 'X', ['X --> F-[[X]+X]+F[+FX]-X', 'F --> FF'], 3 * (4 ** 5 - 2 ** 5) // 2),
}


@pytest.mark.parametrize('read', [_cpfg, _lpy])
@pytest.mark.parametrize('figure', _FIGURES)
def test_plants_of_the_book(figure, read):
    """Derive the bracketed plants of figure 1.24 to their numbers of segments."""
    steps, axiom, rules, count = _FIGURES[figure]
    start = f'Axiom: {axiom}' if read is _cpfg else f'Axiom: {axiom}\nproduction:'
    text = '\n'.join(['Lsystem: 1'] * (read is _cpfg)
                     + [f'derivation length: {steps}', start, *rules, 'endlsystem'])
    assert sum(module.name == 'F' for module in read(text).derive()) == count


_TREES = {  # as the book writes them, with the sizes of the shipped translations
    'abop_2_6.lsys': ("""
#define r1 0.9 /* contraction ratio for the trunk */
#define r2 0.6
#define a0 45
#define a2 45
#define d 137.5
#define wr 0.707
Lsystem: 1
derivation length: 10
Axiom: A(1.2,0.14)
p1 : A(l,w) : * --> !(w)F(l)[&(a0)B(l*r2,w*wr)]/(d)A(l*r1,w*wr)
p2 : B(l,w) : * --> !(w)F(l)[-(a2)$C(l*r2,w*wr)]C(l*r1,w*wr)
p3 : C(l,w) : * --> !(w)F(l)[+(a2)$B(l*r2,w*wr)]B(l*r1,w*wr)
endlsystem
""", 2 ** 10 - 1),
    'abop_2_7.lsys': ("""
#define r1 0.9
#define r2 0.7
#define a1 5
#define a2 65
#define wr 0.707
Lsystem: 1
derivation length: 10
Axiom: A(1.2,0.14)
p1 : A(l,w) : * --> !(w)F(l)[&(a1)B(l*r1,w*wr)]/(180)[&(a2)B(l*r2,w*wr)]
p2 : B(l,w) : * --> !(w)F(l)[+(a1)$B(l*r1,w*wr)][-(a2)$B(l*r2,w*wr)]
endlsystem
""", 2 ** 10 - 1),
}


@pytest.mark.parametrize('shipped', _TREES)
def test_trees_of_the_book_are_the_shipped_ones(shipped):
    """Read figures 2.6 a and 2.7 a as the trees that their translations by hand are."""
    text, count = _TREES[shipped]
    found, wanted = _cpfg(text).build(), LSystem.load(shipped).build()
    assert len(found) == count
    np.testing.assert_allclose(found.poses, wanted.poses, atol=1e-9)
    np.testing.assert_allclose(found.mass, wanted.mass, rtol=1e-12)


def test_ternary_tree_of_the_book():
    """Derive figure 2.8 a, whose segments grow and are 1 + 2 (3^n - 1), in its own units."""
    text = """
#define d1 94.74
#define d2 132.63
#define a 18.95
#define lr 1.109
#define vr 1.732
Lsystem: 1
derivation length: 6
Axiom: !(1)F(200)/(45)A
p1 : A : * --> !(vr)F(50)[&(a)F(50)A]/(d1)[&(a)F(50)A]/(d2)[&(a)F(50)A]
p2 : F(l) : * --> F(l*lr)
p3 : !(w) : * --> !(w*vr)
endlsystem
"""
    tree = _cpfg(text).build(unit=0.004)
    assert len(tree) == 1 + 2 * (3 ** 6 - 1)
    trunk = 200 * 1.109 ** 6 * 0.004
    np.testing.assert_allclose(tree.poses[0, 2], 0.5 * trunk, rtol=1e-9)


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _places(turns: list[tuple[str, float]], program: str) -> np.ndarray:
    """
    Follow a string of turns, each before a segment of 1, in the program's own frame.

    In cpfg each turn rotates one axis towards another, as its source has it, and up is -z; in
    PlantGL each turns about an axis.
    """
    if program == 'cpfg':
        frame = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, -1]])  # heading, left, up
        towards = {'+': (0, 1, 1), '-': (0, 1, -1), '&': (0, 2, 1), '^': (0, 2, -1),
                   '/': (1, 2, 1), '\\': (1, 2, -1)}
    else:
        frame = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]])
        about = {'+': (2, 1), '-': (2, -1), '&': (1, 1), '^': (1, -1), '/': (0, 1), '\\': (0, -1)}
    at, middles = np.zeros(3), []
    for sign, angle in turns:
        if program == 'cpfg':
            a, b, way = towards[sign]
            c, s = np.cos(np.radians(angle)), way * np.sin(np.radians(angle))
            frame[a], frame[b] = c * frame[a] + s * frame[b], c * frame[b] - s * frame[a]
        else:
            axis, way = about[sign]
            frame = frame @ _about(frame[axis], way * np.radians(angle)).T
        middles.append(at + 0.5 * frame[0])
        at = at + frame[0]
    return np.array(middles)


@pytest.mark.parametrize('program', ['cpfg', 'L-Py'])
def test_turtles_go_the_same_way(program):
    """Stand where the other program's turtle does, in its axes turned into ours."""
    rng = np.random.default_rng(4)
    turns = [(rng.choice(list('+-&^/\\')), float(rng.integers(5, 60))) for _ in range(12)]
    string = ''.join(f'{sign}({angle})F(1)' for sign, angle in turns)
    read = _cpfg if program == 'cpfg' else _lpy
    start = 'Lsystem: 1\n' * (program == 'cpfg')
    built = read(f'{start}derivation length: 0\nAxiom: {string}\n').build().poses[:, :3]
    own = _places(turns, program)
    wanted = {'cpfg': own[:, [0, 2, 1]] * [-1, 1, 1], 'L-Py': own[:, [1, 0, 2]] * [-1, 1, 1]}
    np.testing.assert_allclose(built, wanted[program], atol=1e-9)


_TOP = 'Lsystem: 1\nderivation length: 1\n'


@pytest.mark.parametrize('source, text, line, words', [
    ('l', f'{_TOP}Axiom: A\nA(l --> F', 4, 'expected'),
    ('l', f'{_TOP}Axiom: A(1)\n\nA(x) : x > --> F', 5, 'found ">"'),
    ('l', f'{_TOP}Axiom: A(1)\nA(x) : x > 1 {{y = 2;}} --> F', 4, 'blocks of code in rules'),
    ('l', f'{_TOP}Axiom: A(1)\nA(x) --> F(x > 1 ? 2 : 3)', 4, 'two rules with conditions'),
    ('l', f'{_TOP}Axiom: A(1)\nA(x) --> F(func(1, x))', 4, 'unknown function "func"'),
    ('l', f'{_TOP}Axiom: A(1)\nA(x) -->\n\tF(x)\n\tF(y)', 6, 'unknown name "y"'),
    ('l', f'{_TOP}Axiom: A(1)\nA(x) --> F(ran())', 4, 'ran takes 1 argument'),
    ('l', f'{_TOP}Axiom: A ]', 3, 'without a "["'),
    ('l', f'{_TOP}A --> F\nAxiom: A', 3, 'before the axiom'),
    ('l', f'{_TOP}A: A', 3, 'before the axiom'),
    ('l', 'Lsystem: 1\nF --> F', 2, 'before the axiom'),
    ('l', '', 0, 'the section "axiom:" is missing'),
    ('l', '#ifdef X\n#endif\n', 1, '"#ifdef" is not read'),
    ('l', '#define f(a, b) a+b\nLsystem: 1\nAxiom: F(f(1))', 3, 'takes 2 parameters, found 1'),
    ('l', '#include <lpfgall.h>\nmodule A(float);', 1, 'a program for lpfg'),
    ('l', 'Axiom: A(1.0);\nA(x) :\n{\n  produce F(x);\n}', 4, 'a program for lpfg'),
    ('l', f'{_TOP}Axiom: A /* once\nA --> F\n', 3, ':3:10: this comment is never closed'),
    ('lpy', 'a = 1; b = 2\nAxiom: F', 1, 'expected ",", an operator or the end'),
    ('lpy', 'Axiom: A\nproduction:\nA --> F(l)', 3, 'unknown name "l"'),
    ('lpy', 'def f(x):\n  return 2\nAxiom: A', 1, 'only plain productions are read'),
    ('lpy', 'Axiom: A(1)\nproduction:\nA(x):\n  y = x\n  produce F(y)', 4, 'only plain'),
    ('lpy', 'Axiom: A(1)\nproduction:\nA(x):\n  for i in x:\n    nproduce F', 4, 'only plain'),
    ('lpy', 'Axiom: A(1)\nproduction:\nA(x):\n  if x > 1:\n    produce F(z)', 5, 'name "z"'),
    ('lpy', 'Axiom: A(1)\nproduction:\nA(x):\n  if x >:\n    produce F(z)', 4, 'found the end'),
    ('lpy', 'Axiom: A(1)\nproduction:\nA(x):\n', 3, 'has no body'),
    ('lpy', 'Axiom: A\nproduction:\nA << B --> F', 3, 'contexts "<<" and ">>"'),
    ('lpy', 'a = [1, 2]\nAxiom: A', 1, 'found "["'),
    ('lpy', 'a = lambda x: 2\nAxiom: A', 1, ''),
    ('lpy', 'a = __import__("os").remove("x")\nAxiom: A', 1, ''),
    ('lpy', '__import__("os").remove("x")\nAxiom: A', 1, 'only plain productions'),
    ('lpy', 'Axiom: A(1)\nproduction:\nA(x):\n  if 1 < x < 2: produce F', 4, 'a chain'),
    ('lpy', 'Axiom: A(int(random()))', 1, 'int of a random number'),
    ('lpy', 'Axiom: A\nproduction:\nA:\n  if random() < 1:\n    if random() < 1: produce F\n'
     '    produce G', 4, 'exactly one'),
    ('lpy', 'module my_leaf\nAxiom: A', 1, 'no name of a module'),
])
def test_errors_name_the_line(source, text, line, words):
    """Name the line of the file that was written, and what was found or is read instead."""
    with pytest.raises(GrammarError) as caught:
        LSystem.parse(text, f'plant.{source}')
    assert words in str(caught.value) and str(caught.value).startswith(f'plant.{source}')
    assert caught.value.line == line
    assert '\n' not in str(caught.value)


def test_errors_name_the_column():
    """Point at the column of the file although names are longer here."""
    with pytest.raises(GrammarError) as caught:
        _cpfg(f'{_TOP}Axiom: ;;;A(1)\nA(x) --> ;;;G(x);;;F(y)')
    assert (caught.value.line, caught.value.column) == (4, 22)


def test_errors_while_it_grows_name_the_place():
    """Name the place of a segment that is too long once the string is drawn."""
    with pytest.raises(GrammarError, match=r'plant\.l:4:10: F is 2000, it must be from'):
        _cpfg(f'{_TOP}Axiom: A(1)\nA(x) --> F(2000*x)').build()


def _told(text: str, source: str) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        LSystem.parse(text, source)
    return [str(one.message) for one in caught if one.category is GrammarWarning]


@pytest.mark.parametrize('source, text, told', [
    ('l', f'{_TOP}Axiom: ;(2)F;F,F', ['3:8: ";": colours', '3:15: ",": colours']),
    ('l', f'{_TOP}Axiom: F_(1)F_', ['3:9: "_": tropisms']),
    ('l', f'{_TOP}Axiom: F"(0.9)F', ['3:9: """: scales of lengths']),
    ('l', f'{_TOP}Axiom: #F', ['3:8: "#": changes of width']),
    ('l', f'{_TOP}Axiom: F[~l(2)]~k', ['3:11: the surface "l"', '3:17: the surface "k"']),
    ('l', f'{_TOP}Axiom: @#(1)@Gs F@Ge', ['3:8: "@#": surfaces', '3:13: "@Gs"', '3:18: "@Ge"']),
    ('l', f'{_TOP}Axiom: F@O(1)@c(2)', ['3:9: "@O": spheres', '3:14: "@c": spheres']),
    ('l', f'{_TOP}Axiom: F@Ts(1,0.2)', ['3:9: "@Ts": tropisms']),
    ('l', f'{_TOP}Axiom: @M(1,2,3)F', ['3:8: "@M": jumps']),
    ('l', f'{_TOP}Axiom: F?P(0,0,0)', ['3:9: "?P": queries']),
    ('l', f'{_TOP}Axiom: F`F', ['3:9: "`": a symbol without a meaning']),
    ('l', f'{_TOP}Axiom: F X', ['3:10: no rule and no meaning for the module X']),
    ('l', f'seed: 3\n{_TOP}Axiom: F', ['1:1: seeds are those of the scene']),
    ('l', f'{_TOP}Start: {{\n n = 1;\n}}\nAxiom: F', ['3:1: blocks of code are left out']),
    ('l', f'{_TOP}define: {{ array a[2] = {{1, 2}};\n}}\nAxiom: F', ['3:1: arrays']),
    ('l', f'{_TOP}ring L-system\nAxiom: F', ['3:1: ends are not joined']),
    ('l', f'{_TOP}Axiom: F\nendlsystem\nLsystem: 2\nAxiom: B', ['5:1: sub-L-systems']),
    ('l', f'#include "none.h"\n{_TOP}Axiom: F', ['1:2: there is no "none.h"']),
    ('l', f'{_TOP}Axiom: F\ndecomposition\nmaximum depth: 3\nF --> G', ['5:1: decomposition']),
    ('lpy', 'import os\nseed(3)\nAxiom: F', ['1:1: "import os" is', '2:1: "seed(3)" is']),
    ('lpy', 'Axiom: F\nendlsystem\nx = 3', ['2:1: what follows the rules']),
    ('lpy', 'module A : scale = 2\nAxiom: F', ['1:1: scales and bases']),
    ('lpy', 'Axiom: F\ngroup 1:\nproduction:\nendgroup', ['2:1: groups', '4:1: groups']),
    ('lpy', 'Axiom: F;(3)SetColor(2)F', ['1:9: ";": colours', '1:13: "SetColor": colours']),
])
def test_what_is_left_out_is_told(source, text, told):
    """Warn in a line for each thing left out, with its place, besides that of the units."""
    found = _told(text, f'plant.{source}')
    assert sum('read as' in one and '(unit)' in one for one in found) == 1
    rest = [one.removeprefix(f'plant.{source}:') for one in found if 'read as' not in one]
    assert len(rest) == len(told)
    for wanted in told:
        assert any(one.startswith(wanted) for one in rest), (wanted, rest)


def test_units_are_defines():
    """Scale a plant by `unit`, turn by `angle`, and begin with `width` and `strength`."""
    text = 'Lsystem: 1\nderivation length: 0\nAxiom: FF+F\n'
    system = _cpfg(text)
    assert set(system.defines) == {'unit', 'angle', 'width', 'strength'}
    metre, inch = system.build(angle=90.0), system.build(angle=90.0, unit=0.0254)
    np.testing.assert_allclose(inch.poses[:, :3], 0.0254 * metre.poses[:, :3], atol=1e-12)
    np.testing.assert_allclose(inch.mass, 0.0254 ** 3 * metre.mass)
    assert metre.poses[2, 2] == pytest.approx(2.0)  # a right angle
    assert float(str(system.derive(width=0.5)[1]).strip('Width()')) == 0.5
    with pytest.raises(GrammarError, match=r'3:8: F is 5e-05 m long, it must be from 0.0001'):
        system.build(unit=5e-5, width=2.0)
    with pytest.raises(GrammarError, match='the unit is 0, it must be'):
        system.build(unit=0.0)
    own = _cpfg('#define unit 7\n' + text)
    assert {'unit', 'unit_'} <= set(own.defines)


def test_expansion_is_bounded():
    """End with an error where defines of defines grow without bounds, at once."""
    doubling = '\n'.join(f'#define x{n} x{n + 1} x{n + 1}' for n in range(40))
    for last in ('', 'F'):
        with pytest.raises(GrammarError, match='grow past'):
            _cpfg(f'{doubling}\n#define x40 {last}\nLsystem: 1\nAxiom: x0 F\n')
    with pytest.raises(GrammarError, match=r'plant\.l:4.*once its defines are replaced'):
        _cpfg(f'#define X {"F" * 90_000}\nX\nX\nX\n')
    with pytest.raises(GrammarError, match='at most 200000'):
        _cpfg('F' * 200_001)
    assert str(_cpfg('#define A A F\nLsystem: 1\nderivation length: 0\nAxiom: A\n')
               .derive()).endswith('AF')


@pytest.mark.parametrize('source, text', [
    ('l', f'{_TOP}Axiom: F({"-" * 3000}1)'), ('l', f'{_TOP}Axiom: F({"1+" * 3000}1)'),
    ('l', f'{_TOP}Axiom: F({"(" * 3000}1{")" * 3000})'),
    ('l', f'#define f(x) x\n{_TOP}Axiom: F({"f(" * 3000}1{")" * 3000})'),
    ('lpy', f'Axiom: A\nproduction:\nA: {"if 1:" * 3000} produce F'),
    ('lpy', 'Axiom: A(1)\nproduction:\nA(x):\n  if x < 1:\n    if x < 0: produce F\n'
     + '  elif x < 2:\n    if x < 1: produce F\n' * 3000),
    ('lpy', f'Axiom: F({"not " * 3000}1)'), ('lpy', f'Axiom: {"[" * 3000}F'),
])
def test_depth_is_bounded(source, text):
    """Answer texts that nest thousands deep with an error of our own, or a tree."""
    try:
        LSystem.parse(text, f'plant.{source}')
    except GrammarError as error:
        assert error.line


@pytest.mark.parametrize('name', ['defines, labels, a homomorphism', 'choices',
                                  'macros of modules and with parameters', 'plain productions'])
def test_damaged_texts(name):
    """Answer every damaged text with an error of our own, or a grammar."""
    read, text, _ = _PAIRS[name]
    rng = np.random.default_rng(5)
    for _ in range(150):
        letters = list(text)
        for at in rng.integers(0, len(letters), 3):
            letters[at] = rng.choice(list('()[]{}:;<>=-+*/#@~"\'\\ \n\tA1.,|&!?'))
        try:
            read(''.join(letters))
        except GrammarError as error:
            assert '\n' not in str(error)


def test_includes_bring_defines(tmp_path):
    """Take defines of files beside the text, and nothing from outside of the bounds."""
    (tmp_path / 'inner').mkdir()
    (tmp_path / 'size.h').write_text('#define LEN 3 /* m */\n')
    (tmp_path / 'inner' / 'plant.l').write_text(
        '#include "../size.h"\nLsystem: 1\nderivation length: 0\nAxiom: F(LEN)\n')
    plant = tmp_path / 'inner' / 'plant.l'
    assert str(LSystem.load(plant).derive(LEN=2.0)).endswith('F(2)')
    with within(FileBounds((tmp_path / 'inner',), {})), pytest.raises(
            GrammarError, match='unknown name "LEN"'):
        LSystem.load(plant)
    with pytest.warns(GrammarWarning, match='it lies outside of the folders'), within(
            FileBounds((tmp_path / 'inner',), {})), pytest.raises(GrammarError):
        LSystem.load(plant)
    plant.write_text('#include "/etc/passwd"\nLsystem: 1\nAxiom: F\n')
    with pytest.warns(GrammarWarning, match='cannot be included: grammars end in .l, .h'):
        LSystem.load(plant)


_PLANT = """#define N 4
Lsystem: 1
derivation length: N
ignore: +-/;
Axiom: ;A(1)
A(l) > A(m) : l > m --> A(l)
A(l) : l^2 > 0.1 --> #(0.1*l)F(l)[+(30)~l(l)A(l*0.6)]/(137.5)A(l*-(0-0.7)) : 2
A(l) : !(l < 0.1) && l - (2 - l) < 3 --> G(l)A(l*0.7) : 1
homomorphism
maximum depth: 2
A(l) --> ;F(l, 2)
endlsystem
"""


def test_scenes_take_them(tmp_path):
    """Name one in a scene file, beside it, with its defines."""
    (tmp_path / 'plant.l').write_text(_PLANT)
    (tmp_path / 'plant.yaml').write_text(
        '/**:\n  ros__parameters:\n    scene.objects: [a]\n    a.grammar: plant.l\n'
        '    a.defines: [N=2, unit=2]\n')
    scene = Scene.from_yaml(tmp_path / 'plant.yaml')
    assert len(scene.blueprint) == len(_cpfg(_PLANT).build(N=2.0))


def test_copies_in_other_processes_are_the_same():
    """Compile a pickled one again, as batches do."""
    system = _cpfg(_PLANT)
    assert str(pickle.loads(pickle.dumps(system)).derive(seed=2)) == str(system.derive(seed=2))


def test_ours_includes_them(tmp_path):
    """Include the rules of one in a grammar of our own."""
    (tmp_path / 'plant.l').write_text(_PLANT)
    text = 'include: plant.l\naxiom: A(1)\nderivation length: 4\nangle: 30'
    found = LSystem.parse(text, folder=tmp_path).derive(seed=1)
    wanted = list(_cpfg(_PLANT).derive(seed=1))[_WOOD + 1:]
    assert list(found) == wanted


@pytest.mark.parametrize('name', ['plant.l', 'plant.lpy'])
def test_export_writes_the_translation(tmp_path, name, capsys):
    """Write a text of our language that derives the same string, and nothing else as one."""
    text = {'plant.l': _PLANT, 'plant.lpy': _PAIRS['choices'][1]}[name]
    path, out = tmp_path / name, tmp_path / 'plant.lsys'
    path.write_text(text)
    assert export([str(path), '--out', str(out)]) == 0
    assert 'plant.lsys: a grammar of' in capsys.readouterr().out
    for seed in range(3):
        found, wanted = LSystem.load(out), LSystem.load(path)
        assert str(found.interpret(seed=seed)) == str(wanted.interpret(seed=seed))
        assert found.defines == wanted.defines
    assert export([str(path), '--out', str(out), '--seed', '3']) == 1
    assert export(['oak.lsys', '--out', str(out)]) == 1
    assert 'is a grammar (.l, .lpy)' in capsys.readouterr().err


@pytest.mark.parametrize('name', ['oak', 'pine', 'willow', 'ivy', 'abop_2_8', 'hedge'])
def test_what_is_written_reads_the_same(name):
    """Write a shipped grammar, and derive the same string from what was written."""
    path = shared_folder() / 'grammars' / f'{name}.lsys'
    wanted = LSystem.load(path)
    statements = gather_statements(path.read_text('utf-8'), str(path))
    found = LSystem.parse(write_statements(statements, name))
    assert found.defines == wanted.defines
    assert str(found.interpret(4, seed=1)) == str(wanted.interpret(4, seed=1))


def test_spawning_sends_the_translation(tmp_path):
    """Send a text of our language to a node, and an error of the file as one of the command."""
    from procphys_ros.errors import CommandError
    from procphys_ros.ros.command import _text_of

    path = tmp_path / 'plant.l'
    path.write_text(_PLANT)
    assert str(LSystem.parse(_text_of(path)).derive()) == str(LSystem.load(path).derive())
    path.write_text('Lsystem: 1\nAxiom: F(l)\n')
    with pytest.raises(CommandError, match=r'plant\.l:2:10: unknown name "l"'):
        _text_of(path)
