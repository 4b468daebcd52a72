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

"""Grammars of plants: the language, the book that it comes from, and its reference."""

from pathlib import Path
import re

import numpy as np
import pytest

from procphys_ros.appearance.palette import LOOKS
from procphys_ros.errors import GrammarError
from procphys_ros.files.resources import shared_folder
from procphys_ros.language.arithmetic import FUNCTIONS, RANDOM_FUNCTIONS
from procphys_ros.lsystem import LSystem
from procphys_ros.lsystem.statements import HEADERS
from procphys_ros.lsystem.symbols import ATTRIBUTES, LEAF_SIZE, LENGTH, RATE, REACH, STEP, SYMBOLS

# Lengths of the strings of published systems at n = 0, 1, 2, ... and the final number of F.
_BUSH = """
axiom: A
production:
  A -> [&FL!A]/////'[&FL!A]///////'[&FL!A]
  F -> S/////F
  S -> FL
  L -> ['''^^{-f+f+f-|-f+f+f}]
"""
_KNOWN = {
    '1.24a': ('axiom: F\nproduction:\nF -> F[+F]F[-F]F', [1, 11, 61, 311, 1561, 7811], 3125),
    '1.24b': ('axiom: F\nproduction:\nF -> F[+F]F[-F][F]', [1, 13, 73, 373, 1873, 9373], 3125),
    '1.24c': ('axiom: F\nproduction:\nF -> FF-[-F+F+F]+[+F-F-F]',
              [1, 20, 172, 1388, 11116], 4096),
    '1.24d': ('axiom: X\nproduction:\nX -> F[+X]F[-X]+X\nF -> FF',
              [1, 12, 47, 156, 491, 1512, 4607, 13956], 4118),
    '1.24e': ('axiom: X\nproduction:\nX -> F[+X][-X]FX\nF -> FF',
              [1, 11, 43, 143, 451, 1391, 4243, 12863], 4118),
    '1.24f': ('axiom: X\nproduction:\nX -> F-[[X]+X]+F[+FX]-X\nF -> FF',
              [1, 18, 89, 379, 1551, 6263], 1488),
    'koch': ('axiom: F-F-F-F\nproduction:\nF -> F-F+F+FF-F-F+F', [7, 59, 475, 3803], 2048),
    'dragon': ('axiom: F l\nproduction:\nl -> l + r F +\nr -> - F l - r',
               [2 ** (n + 2) - 2 for n in range(11)], 1024),
    'sierpinski': ('axiom: A\nproduction:\nA -> B+A+B\nB -> A-B-A',
                   [1, 5, 17, 53, 161, 485, 1457], 0),
    'hilbert': ('axiom: L\nproduction:\nL -> +RF-LFL-FR+\nR -> -LF+RFR+FL-',
                [1, 11, 51, 211, 851, 3411], 1023),
    'bush': (_BUSH, [1, 35, 221, 800, 2642, 8294, 25481, 77399], 3891),
    '2.6': ('axiom: A\nproduction:\nA -> !F[&B]/A\nB -> !F[-$C]C\nC -> !F[+$B]B',
            [1, 8, 22, 50, 106, 218, 442, 890, 1786, 3578, 7162], 1023),
    '2.7': ('axiom: A\nproduction:\nA -> !F[&B]/[&B]\nB -> !F[+$B][-$B]',
            [1, 11, 33, 77, 165, 341, 693, 1397, 2805, 5621, 11253], 1023),
    '2.8': ('axiom: !F/A\nproduction:\nA -> !F[&FA]/[&FA]/[&FA]',
            [4, 22, 76, 238, 724, 2182, 6556, 19678, 59044], 13121),
}


def _text(text, steps, **arguments):
    return str(LSystem.parse(text).derive(steps, **arguments))


@pytest.mark.parametrize('name', _KNOWN)
def test_known_lengths(name):
    """Agree with the lengths and the number of segments of published systems."""
    text, lengths, segments = _KNOWN[name]
    system = LSystem.parse(text)
    assert [len(system.derive(n)) for n in range(len(lengths))] == lengths
    last = system.derive(len(lengths) - 1)
    assert sum(module.name == 'F' for module in last) == segments


@pytest.mark.parametrize('name, lengths', [('2_6', 13), ('2_7', 16), ('2_8', 28)])
def test_shipped_figures(name, lengths):
    """Ship the figures of the book with the strings of the book."""
    system = LSystem.load(shared_folder() / 'grammars' / f'abop_{name}.lsys')
    preamble = len(system.derive(0)) - {'2_6': 1, '2_7': 1, '2_8': 4}[name]
    known = _KNOWN[name.replace('_', '.')][1]
    assert [len(system.derive(n)) - preamble for n in range(7)] == known[:7]
    assert len(system.derive(1)) == lengths


def test_algae():
    """Rewrite all modules in parallel: the algae of chapter 1.2."""
    system = LSystem.parse('axiom: A\nproduction:\nA -> AB\nB -> A')
    assert [str(system.derive(n)) for n in range(5)] == ['A', 'AB', 'ABA', 'ABAAB', 'ABAABABA']
    assert _text('axiom: I\nproduction:\nI -> I[+L]-L', 1) == 'I[+L]-L'


def test_parametric():
    """Derive the parametric system (1.5) of the book."""
    system = LSystem.parse("""
        axiom: B(2)A(4,4)
        production:
          A(x, y) : y <= 3 -> A(x*2, x+y)
          A(x, y) : y > 3  -> B(x)A(x/y, 0)
          B(x)    : x < 1  -> C
          B(x)    : x >= 1 -> B(x-1)""")
    assert [str(system.derive(n)) for n in range(5)] == [
        'B(2)A(4,4)', 'B(1)B(4)A(1,0)', 'B(0)B(3)A(2,1)', 'CB(2)A(4,3)', 'CB(1)A(8,7)']


def test_modules():
    """Index, slice and iterate over the string as over a list of modules."""
    modules = LSystem.parse('axiom: A B(1,2) [ C(3) ]').derive()
    assert len(modules) == 5
    assert (modules[1].name, modules[1].parameters) == ('B', (1.0, 2.0))
    assert str(modules[-2]) == 'C(3)' and [str(m) for m in modules[2:4]] == ['[', 'C(3)']
    assert [m.name for m in modules] == ['A', 'B', '[', 'C', ']']
    with pytest.raises(IndexError):
        modules[5]


def test_first_rule_wins():
    """Take the first rule in file order whose condition holds; else copy the module."""
    text = """
        axiom: A(1) A(5) A(9) A
        production:
          A(x) : x > 8 -> X
          A(x) : x > 3 -> Y
          A(x) : x > 4 -> Z"""
    assert _text(text, 1) == 'A(1)YXA'


def test_parameters_count():
    """Match by name and number of parameters."""
    assert _text('axiom: A A(1) A(1,2)\nproduction:\nA(x) -> B(x)', 1) == 'AB(1)A(1,2)'


def test_empty_successor():
    """Delete what has a star for a successor, down to the empty string."""
    system = LSystem.parse('axiom: A B\nproduction:\nA -> *\nB : * --> *')
    assert str(system.derive(1)) == '' and len(system.derive(3)) == 0


def test_defines():
    """Use defines in the axiom, the rules and the settings, and let them be overridden."""
    system = LSystem.parse("""
        define: n = 2, k = 3
        define: kk = k * k
        derivation length: n
        axiom: A(kk)
        production:
          A(x) -> A(x + k)""")
    assert str(system.derive()) == 'A(15)' and system.defines == ('n', 'k', 'kk')
    assert str(system.derive(n=1, k=10)) == 'A(110)'
    with pytest.raises(GrammarError, match=r'unknown define "m".*n, k, kk'):
        system.derive(m=1)
    with pytest.raises(GrammarError, match='derivation length must be a whole number'):
        system.derive(n=1.5)


_CHANCE = """
    axiom: A(1)
    production:
      A(x) : x > 0 -> A(x) B : 3
      A(x) : x > 0 -> A(x) C : 1
      A(x) : x < 0 -> D : 100
"""


def test_seed():
    """Derive the same string for the same seed, and others for others."""
    system = LSystem.parse(_CHANCE)
    first = str(system.derive(60, seed=1))
    assert first == str(system.derive(60, seed=1)) and 'D' not in first
    assert first != str(system.derive(60, seed=2))
    noise = LSystem.parse('define: a = rand(0, 1)\naxiom: A(a) A(nran(0, 1))')
    assert str(noise.derive(seed=3)) == str(noise.derive(seed=3)) != str(noise.derive(seed=4))


def test_weights():
    """Draw rules by weight, each module for itself, among those whose condition holds."""
    many = 'axiom:' + ' A(1)' * 8000 + _CHANCE.replace('axiom: A(1)', '')
    text = _text(many, 1)
    assert text.count('B') / 8000 == pytest.approx(0.75, abs=0.02)
    assert text.count('B') + text.count('C') == 8000


def test_weights_may_depend_on_parameters():
    """Evaluate weights for each module; what weighs nothing is not drawn."""
    text = """
        axiom: A(0) A(1)
        production:
          A(x) -> B : x
          A(x) -> C : 1 - x"""
    assert {_text(text, 1, seed=seed) for seed in range(20)} == {'CB'}
    assert _text('axiom: A\nproduction:\nA -> B : 0', 1) == 'A'
    guarded = 'axiom: A(0)A(1)\nproduction:\nA(x) : x > 0 -> B : 1/x\nA(x) : x == 0 -> C : 1'
    assert _text(guarded, 1) == 'CB'


def test_random_arguments_differ():
    """Draw anew for each module that a rule writes."""
    modules = LSystem.parse('axiom: A A A\nproduction:\nA -> A(rand(0, 1))').derive(1, seed=5)
    assert len({m.parameters for m in modules}) == 3


def test_decomposition():
    """Apply decomposition to its own result, to the axiom, and after every step."""
    text = """
        axiom: A(2)
        production:
          B -> A(1) C
        decomposition:
          A(n) : n > 0 -> F A(n - 1)
          A(n) -> B"""
    assert [_text(text, n) for n in range(3)] == ['FFB', 'FFFBC', 'FFFFBCC']


def test_interpretation():
    """Apply interpretation to the final string alone, to its depth."""
    text = """
        axiom: A(1)
        production:
          A(x) -> A(x + 1)
        interpretation:
        maximum depth: {}
          A(x) : x > 0 -> F(x) A(x - 1)"""
    for depth, result in ((1, 'F(3)A(2)'), (2, 'F(3)F(2)A(1)'), (9, 'F(3)F(2)F(1)A(0)')):
        system = LSystem.parse(text.format(depth))
        assert str(system.interpret(2)) == result and str(system.derive(2)) == 'A(3)'


def test_rules_over_lines():
    """Read rules that run over several lines."""
    text = """
        axiom: A(3) B
        production:
          A(x)
            : x > 2
              && x < 4
            -> B
               [ C ]
            : 0.5
          !(w) -> !(w*2)
          B -> D(
            4,
            5)"""
    assert _text(text, 1) == 'B[C]D(4,5)'


def test_growth_is_bounded():
    """Stop growth past the limit with the rule and the count, not with the machine."""
    system = LSystem.parse('axiom: A\nproduction:\n  A -> AAAAAAAAAA', max_modules=50_000)
    assert len(system.derive(4)) == 10_000
    with pytest.raises(GrammarError, match=r'x?:3:3: .*100000 modules, the limit is 50000; '
                                           'the rule for A writes 100000'):
        system.derive(5)
    with pytest.raises(GrammarError, match='2000000'):
        LSystem.parse('axiom: A\nproduction:\nA -> AA').derive(1000)
    endless = 'axiom: A\ndecomposition:\n  A -> {}'
    with pytest.raises(GrammarError, match='decomposition of A did not end after 1000 passes'):
        LSystem.parse(endless.format('A')).derive(0)
    with pytest.raises(GrammarError, match='the limit is 2000000'):
        LSystem.parse(endless.format('A A')).derive(0)
    with pytest.raises(GrammarError, match='number of steps'):
        system.derive(-1)


def test_errors_while_deriving():
    """Name the place of an expression that has no value."""
    for rule, words in (('A(x) -> A(1/x)', 'division of 1 by zero'),
                        ('A(x) -> A(x/0)', 'division of 0 by zero'),
                        ('A(x) -> A(x % 0)', 'remainder of 0 by zero'),
                        ('A(x) : log(x) > 0 -> B', r'log\(0\)'),
                        ('A(x) -> B : x - 1', 'weight -1 is negative')):
        with pytest.raises(GrammarError, match=words) as caught:
            LSystem.parse(f'axiom: A(0)\nproduction:\n  {rule}').derive(1)
        assert caught.value.line == 3 and caught.value.column > 2


def test_large_string_equals_small_ones():
    """Derive a long string as the concatenation of what its modules derive into."""
    rules = """
        production:
          A(l, w) : l > 0.3 -> !(w) F(l) [ &(45) A(l*0.6, w*0.7) ] /(137) A(l*0.9, w*0.7)
          A(l, w) -> F(l)"""
    starts = [(1.0, 0.1), (0.35, 0.2), (0.2, 0.3)] * 5
    together = _text('axiom: ' + ' '.join(f'A({a},{b})' for a, b in starts) + rules, 6)
    alone = ''.join(_text(f'axiom: A({a},{b})' + rules, 6) for a, b in starts)
    assert together == alone and np.isclose(together.count('F'), alone.count('F'))


# Figure: successor of the module in the middle for left, middle, right of 000, 001, … 111;
# derivation length; number of segments that the string then holds, counted by `_derive` below.
_FIGURES = {
    'a': ('0 1[+F1F1] 1 1 0 1F1 0 0', 30, 2501),
    'b': ('1 1[-F1F1] 1 1 0 1F1 1 0', 30, 5626),
    'c': ('0 1 0 1[+F1F1] 0 1F1 0 0', 26, 944),
    'd': ('1 0 0 1F1 1 1[+F1F1] 1 0', 24, 2356),
    'e': ('0 1[-F1F1] 1 1 0 1F1 1 0', 26, 824),
}


def _grammar(successors: str) -> str:
    rules = [f'{n >> 2 & 1} < {n >> 1 & 1} > {n & 1} -> {successor}'
             for n, successor in enumerate(successors.split())]
    return '\n'.join(['axiom: F1F1F1', 'ignore: + - F', 'production:', *rules,
                      '* < + > * -> -', '* < - > * -> +'])


def _neighbours(text: str, place: int) -> str:
    """Find the symbols before and behind a place on the tree, by the words of the book (p. 32)."""
    left = right = ''
    i = place - 1
    while i >= 0 and not left:
        if text[i] == ']':
            depth = 1
            while depth:
                i -= 1
                depth += {']': 1, '[': -1}.get(text[i], 0)
        elif text[i] not in '+-F[':
            left = text[i]
        i -= 1
    i = place + 1
    while i < len(text) and text[i] != ']' and not right:
        if text[i] == '[':
            depth = 1
            while depth:
                i += 1
                depth += {'[': 1, ']': -1}.get(text[i], 0)
        elif text[i] not in '+-F':
            right = text[i]
        i += 1
    return (left or '.') + text[place] + (right or '.')


def _derive(successors: str, steps: int) -> str:
    rules = {f'{n:03b}': successor for n, successor in enumerate(successors.split())}
    text = 'F1F1F1'
    for _ in range(steps):
        text = ''.join({'+': '-', '-': '+'}.get(c) or (
            rules.get(_neighbours(text, i), c) if c in '01' else c) for i, c in enumerate(text))
    return text


@pytest.mark.parametrize('figure', _FIGURES)
def test_figures_with_digits_as_modules(figure, recwarn):
    """Derive the figures from F1F1F1 to their full length, as an independent reading does."""
    successors, steps, segments = _FIGURES[figure]
    system = LSystem.parse(_grammar(successors))
    for length in (1, 2, steps // 2, steps):
        assert str(system.derive(length)) == _derive(successors, length)
    assert str(system.derive(steps)).count('F') == segments
    assert not list(recwarn)


_TEXT = (Path(__file__).resolve().parents[1] / 'docs' / 'lsystem.md').read_text('utf-8')


def _rows(heading: str) -> list[list[str]]:
    """Return the cells of the table under a heading; names lose their backquotes."""
    section = re.split(r'^#+ ', _TEXT.split(f'# {heading}\n', 1)[1], flags=re.MULTILINE)[0]
    rows = [[cell.strip() for cell in re.split(r'(?<!\\)\|', line)[1:-1]]
            for line in section.splitlines() if line.startswith('| `')]
    assert rows
    return rows


def _names(cell: str) -> list[str]:
    return [name.replace('\\|', '|') for name in re.findall(r'`([^`]+)`', cell)]


def test_sections():
    """List every section, in whatever order."""
    assert sorted(_names(row[0])[0] for row in _rows('Sections')) == sorted(HEADERS)


def test_symbols():
    """List every symbol and every query with its numbers of parameters."""
    rows = _rows('Symbols') + _rows('Queries')
    found = {re.sub(r'^[?]E[(](\w+);.*', r'?E \1', _names(row[0])[0]):
             tuple(int(n) for n in row[1].split(',')) for row in rows}
    physics = {name for a in ATTRIBUTES for name in (a.name, a.name + 'Rate')} - {'Leaf'}
    assert found == {name: symbol.arities for name, symbol in SYMBOLS.items()
                     if name not in physics}


def test_physics():
    """Check the documented default, range and unit of every attribute."""
    rows = {_names(row[0])[0]: row[1:5] for row in _rows('Physics')}
    assert list(rows) == [a.name for a in ATTRIBUTES if a.name != 'Leaf']
    for attribute in ATTRIBUTES[:-1]:
        default, low, high, unit = rows[attribute.name]
        assert (float(low), float(high), unit) == tuple(attribute.allowed)
        if np.isinf(attribute.default):
            assert default == 'never'
        elif not np.isnan(attribute.default):
            assert float(default) == attribute.default
        else:
            assert default in ('E·I/L', 'locked', 'derived')


@pytest.mark.parametrize('words, allowed', [
    ('segments are from {:g} to {:g} m', LENGTH), ('moves from {:g} to {:g} m', STEP),
    ('leaves from {:g} to {:g} m', LEAF_SIZE), ('factor from {:g} to {:g}', RATE)])
def test_ranges_in_the_text(words, allowed):
    """Say the ranges of all other parameters."""
    assert words.format(allowed.low, allowed.high) in _TEXT.replace('\n', ' ')
    assert REACH.high == 1e4 and 'beyond 10 km' in _TEXT


def test_functions():
    """List every function with its number of arguments."""
    found = {name: row[1] for row in _rows('Expressions') for name in _names(row[0])}
    wanted = {**FUNCTIONS, **RANDOM_FUNCTIONS}
    assert found == {name: f'{least}' if least == most else f'{least} to {most}'
                     for name, (_, least, most) in wanted.items()}


def test_textures():
    """List every texture."""
    section = _TEXT.split('## Textures\n', 1)[1].split('\n## ', 1)[0]
    assert _names(section) == list(LOOKS)
