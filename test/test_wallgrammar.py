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

"""Facades and whole wall grammars: what they build, and what is refused and where."""

from pathlib import Path
import tracemalloc

import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.language import Place
from procphys_ros.lsystem import LSystem
from procphys_ros.wallgrammar import WallGrammar
from procphys_ros.wallgrammar.derivation import Deriver
from procphys_ros.wallgrammar.division import divide, Repeated, Share
from procphys_ros.wallgrammar.parser import parse
from procphys_ros.wallgrammar.spec import Call

_HEAD = """
building b(n = 2)
  footprint: (0, 0) (4, 0) (4, 4) (0, 4)
  facades: start
  storey_height: 3
layout running { unit: 0.215 0.1025 0.065 material: brick }
panel wall: running
panel other: running
panel gap: none
"""


def sizes(shares, length):
    """Return the sizes of the parts [m]."""
    return [(end - start) * 1e-6 for start, end, _ in divide(shares, round(length * 1e6))]


def derive(rules, seed=0, length=9.0, height=3.0, **values):
    """Derive one facade: panel, left, bottom, right, top [m], depth [m]."""
    spec = parse(_HEAD + rules, 'test')
    values = {'n': 2.0, 'storey_height': 3.0, 'storeys': 1.0, **values}
    deriver = Deriver(spec, values, np.random.default_rng(seed))
    pieces = deriver.facade(Call('start', (), Place()), round(length * 1e6), round(height * 1e6))
    return [(p.panel, *(round(v * 1e-6, 6) for v in p.scope)) for p in pieces]


def absolute(size):
    """Make a part of fixed size."""
    return Share('absolute', size, None)


def floating(weight):
    """Make a part that takes a share of what is left."""
    return Share('floating', weight, None)


def relative(fraction):
    """Make a part that takes a fraction of the whole."""
    return Share('relative', fraction, None)


@pytest.mark.parametrize('parts, length, wanted', [
    ((absolute(3), floating(1), floating(2)), 9.0, [3, 2, 4]),
    ((absolute(2), relative(0.3), floating(1)), 10.0, [2, 3, 5]),  # 30 % of 10 m
    ((absolute(2), floating(1), absolute(3)), 5.0, [2, 3]),  # no room for the one between
    ((Repeated((floating(2.1),)),), 10.0, [2.0] * 5),  # the nearest whole number
    ((Repeated((floating(2.1),)),), 4.0, [2.0] * 2), ((Repeated((floating(2.1),)),), 1.0, [1.0]),
    ((absolute(0.5), Repeated((floating(1), absolute(1))), absolute(0.5)), 7.0,
     [0.5, 1, 1, 1, 1, 1, 1, 0.5]),
    ((Repeated((absolute(2),)),), 9.0, [2] * 4)])
def test_parts_share_a_length(parts, length, wanted):
    """Share what fixed and relative parts leave among the others; repeat what is repeated."""
    assert sizes(parts, length) == pytest.approx(wanted)


@pytest.mark.parametrize('rules, wanted', [
    ('rule start -> split(x) { ~1: wall | ~1: two | ~1: wall }\n'
     'rule two -> split(y) { 1: gap | ~1: wall }',
     [('wall', 0, 0, 3, 3, 0), ('gap', 3, 0, 6, 1, 0), ('wall', 3, 1, 6, 3, 0),
      ('wall', 6, 0, 9, 3, 0)]),
    ('rule start -> grid(2, 1) { wall }',  # 9 m by 2 m are 4 columns
     [('wall', 2.25 * i, j, 2.25 * (i + 1), j + 1, 0) for i in range(4) for j in range(3)]),
    ('rule start -> insert(1, 1) { gap | wall }',
     [('gap', 4, 1, 5, 2, 0), ('wall', 0, 0, 9, 1, 0), ('wall', 0, 1, 4, 2, 0),
      ('wall', 5, 1, 9, 2, 0), ('wall', 0, 2, 9, 3, 0)]),
    ('rule start -> extrude(0.02) { again }\nrule again -> extrude(0.03) { wall }',
     [('wall', 0, 0, 9, 3, -0.05)]),
    ('rule start -> part(n)\nrule part(k) : k > 3 -> gap\nrule part(k) -> wall\n',
     [('wall', 0, 0, 9, 3, 0)]),
    ('rule start -> part(n + 3)\nrule part(k) : k > 3 -> gap\nrule part(k) -> wall\n',
     [('gap', 0, 0, 9, 3, 0)]),
    ('rule start -> split(x) { 2: part | ~1: part }\n'
     'rule part : scope_x < 3 -> gap\nrule part -> wall\n',
     [('gap', 0, 0, 2, 3, 0), ('wall', 2, 0, 9, 3, 0)])])
def test_rules_divide_a_facade(rules, wanted):
    """Find each panel in its place: name, edges, and how far inwards it is."""
    assert sorted(derive(rules)) == sorted(wanted)


def test_parts_that_do_not_fit_are_refused():
    """Say what parts of a fixed size need, and what there is; rounding fits."""
    with pytest.raises(GrammarError, match='need 7 m and do not fit into 5 m'):
        sizes((absolute(3), floating(1), absolute(4)), 5.0)
    assert sizes((absolute(3), absolute(2.00001)), 5.0) == pytest.approx([3, 2])


def test_border_frames_its_inner_part():
    """Cut a border of 0.5 m off all sides; a scope too small is all border."""
    found = derive('rule start -> border(0.5) { gap | wall }')
    assert ('gap', 0.5, 0.5, 8.5, 2.5, 0) in found and len(found) == 5
    area = sum((r - x) * (t - b) for _, x, b, r, t, _ in found)
    assert area == pytest.approx(27.0)
    assert derive('rule start -> border(2) { gap | wall }') == [('wall', 0, 0, 9, 3, 0)]


def test_weights_are_drawn_and_seeded():
    """Draw about 80 % of one kind, the same for the same seed."""
    rules = ('rule start -> grid(0.1, 0.1) { one }\n'
             'rule one -> wall : 0.8\nrule one -> gap : 0.2\n')
    found = [p[0] for p in derive(rules, seed=3)]
    share = found.count('wall') / len(found)
    assert len(found) == 2700
    assert share == pytest.approx(0.8, abs=4 * np.sqrt(0.16 / 2700))
    assert found == [p[0] for p in derive(rules, seed=3)]
    assert found != [p[0] for p in derive(rules, seed=4)]


def test_last_start_rule_repeats():
    """Use the last facade for all further edges."""
    text = _HEAD.replace('facades: start', 'facades: solid hollow')
    rules = 'rule solid -> wall\nrule hollow -> split(y) { 1.5: wall }\n'
    blueprint = WallGrammar.parse(text + rules).build()
    high = blueprint.poses[blueprint.poses[:, 2] > 1.6]
    assert len(high) and (high[:, 1] < 0.11).all()


def test_same_seed_builds_the_same():
    """Repeat every number for the same seed."""
    grammar = WallGrammar.parse(_HEAD + 'rule start -> split(x) { { ~0.5: one }* }\n'
                                'rule one -> wall : 1\nrule one -> other : 1\n')
    first, second, third = grammar.build(5), grammar.build(5), grammar.build(6)
    np.testing.assert_array_equal(first.poses, second.poses)
    np.testing.assert_array_equal(first.bonds, second.bonds)
    assert len(first) != len(third)


def test_defines_replace_parameters():
    """Build larger when asked to, through every expression that uses the parameter."""
    text = _HEAD.replace('b(n = 2)', 'b(n = 2, width = 2 * n)').replace('4, 0', 'width, 0')
    text = text.replace('(4, 4)', '(width, 4)') + 'rule start -> wall\n'
    grammar = WallGrammar.parse(text)
    for n in (2, 4):
        blueprint = grammar.build(n=n)
        along = np.abs(blueprint.poses[:, 5]) < 1e-9  # bricks that lie along x
        ends = blueprint.poses[along, 0] + 0.5 * blueprint.size[along, 0]
        assert ends.max() == pytest.approx(2.0 * n)


def test_the_example_of_the_documentation_builds():
    """Build what docs/walls.md shows: walls with a door under a roof."""
    document = (Path(__file__).parents[1] / 'docs' / 'walls.md').read_text(encoding='utf-8')
    text = document[document.index('building shed'):].split('```')[0]
    shed = WallGrammar.parse(text).build()
    assert {'brick', 'board', 'lintel', 'rafter', 'tile', 'verge'} <= set(shed.kinds)
    assert shed.poses[:, 2].max() > 3.0


_SQUARE = '(0, 0) (width, 0) (width, 4) (0, 4)'
_GOOD = """building b(width = 4)
  footprint: (0, 0) (width, 0) (width, 4) (0, 4)
  facades: front
  storey_height: 3
rule front -> wall
layout running { unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }
panel wall: running
panel window: glazing(timber, glass)
panel lintel: beam(concrete)
"""


def refusal(old, new, most_parts=200_000, **defines):
    """Replace a piece of a sound grammar, build it and give the error."""
    assert old in _GOOD
    with pytest.raises(GrammarError) as caught:
        WallGrammar.parse(_GOOD.replace(old, new), 'bad.wall', most_parts).build(**defines)
    return caught.value


def test_the_unspoilt_grammar_builds():
    """Build, so that every refusal below is caused by its change."""
    assert len(WallGrammar.parse(_GOOD).build()) > 1000


@pytest.mark.parametrize('old, new, line, words', [
    # syntax
    ('facades: front', 'facades front', 3, 'list of corners'),
    ('-> wall', '-> split(z) { ~1: wall }', 5, 'split(x) or split(y)'),
    ('(0, 4)', '(0, 4', 3, 'expected'),
    ('storey_height: 3', 'storey_heigth: 3', 4, 'storey_height'),
    ('  facades: front\n', '', 1, 'needs "facades:"'),
    # names
    ('rule front -> wall', 'rule front -> wal', 5, 'did you mean wall'),
    ('rule front -> wall', 'rule front(n) -> wall', 3, 'takes 1 arguments, found 0'),
    ('rule front -> wall', 'rule front -> wall(3)', 5, 'takes no arguments'),
    ('rule front -> wall', 'rule front : width > x -> wall', 5, 'unknown name "x"'),
    ('material: brick', 'material: brik', 6, 'did you mean brick'),
    ('panel wall: running', 'panel wall: runing', 7,
     'unknown kind "runing" of panel "wall"; did you mean running?'),
    ('panel wall: running', 'panel wall: running(brick)', 7, 'layout "running" of panel "wall" '
     'takes no arguments'),
    ('beam(concrete)', 'beem(concrete)', 9, 'did you mean beam?'),
    ('beam(concrete)', 'beam(3)', 9, 'expected the name of a material'),
    ('beam(concrete)', 'timber(7, 2)', 9, 'unknown kind "timber"'),
    ('beam(concrete)', 'beam', 9, '"beam" takes one name of a material, found 0'),
    ('beam(concrete)', '1 + 2', 9, 'a panel is the name of a layout, or boards(material)'),
    ('glazing(timber, glass)', 'glazing(timber)', 8, 'takes 2'),
    ('glazing(timber, glass)', 'glazing(timber, glas)', 8, 'did you mean glass'),
    ('layout running { unit: 0.215 0.1025', 'layout english { unit: 0.215 0.09', 6,
     'english bond needs'),
    ('layout running', 'layout zigzag', 6, 'running, stack, english, flemish'),
    ('panel lintel', 'panel wall', 9, 'exists already'),
    # numbers
    ('joint: 0.01', 'joint: 0.5', 6, 'joint'),
    ('unit: 0.215 0.1025 0.065', 'unit: 0.215 0.1025', 6, 'length, width and height'),
    ('unit: 0.215 0.1025 0.065', 'unit: 0.215 0.1025 0', 6, 'each from'),
    ('storey_height: 3', 'storey_height: 0', 4, '0.1 to 100'),
    ('storey_height: 3', 'storey_height: 1/0', 4, 'zero'),
    ('storey_height: 3', 'storey_height: 3 storeys: 1.5', 4, 'whole number'),
    ('storey_height: 3', 'storey_height: 3 floors: lava', 4, 'timber'),
    ('storey_height: 3', 'storey_height: 3 floors: slab(9)', 4, '0.05 to 1'),
    ('storey_height: 3', 'storey_height: 3 roof: hip(5)', 4, '10 to 70'),
    (_SQUARE, '(0, 0) (5, 0) (5.3, 2.5) (4.2, 4.6) (1.5, 5) (-0.3, 3) roof: hip(40)', 2,
     'roof meet near'),
    ('storey_height: 3', 'storey_height: 3 partitions: halves', 4, 'takes 1'),
    # splits
    ('-> wall', '-> split(x) { 9: wall | 2: wall }', 5, 'need 11 m and do not fit into 4 m'),
    ('-> wall', "-> split(x) { 3.9: wall | '0.1: wall }", 5, 'need 4.3 m and do not fit'),
    ('-> wall', '-> split(x) { { 5: wall }* }', 5, 'do not fit'),
    ('panel wall', 'material brick { texture: brik }\npanel wall', 7, 'did you mean brick'),
    ('-> wall', '-> split(x) { { 0: wall }* }', 5, 'greater than 0'),
    ('-> wall', '-> split(x) { { ~0.000001: wall }* }', 5, 'repeats are too many'),
    ('-> wall', '-> insert(5, 1) { window | wall }', 5, 'does not fit'),
    ('-> wall', '-> border(-1) { window | wall }', 5, 'from 0 to 1e+06 m, found -1'),
    ('-> wall', '-> wall : 0', 3, 'no rule'),
    ('-> wall', '-> split(x) { -1: wall | ~1: wall }', 5, 'from 0 to 1e+06, found -1'),
    ('-> wall', '-> split(x) { 1e300: wall | ~1: wall }', 5, 'from 0 to 1e+06, found 1e+300'),
    ('-> wall', '-> extrude(1e300) { wall }', 5, 'from -1e+06 to 1e+06 m, found 1e+300'),
    ('-> wall', '-> insert(1e300, 1) { wall | wall }', 5, 'from 0 to 1e+06 m'),
    ('-> wall', '-> grid(1e-300, 1) { wall }', 5, 'repeats are too many'),
    ('-> wall', '-> wall : 1e300', 5, 'a weight must be from 0 to 1e+12, found 1e+300'),
    (_SQUARE, '(1e13, 0) (1e13 + 4, 0) (1e13, 4)', 2, 'coordinates must be from -100000 to'),
    # numbers that are none
    ('(width, 0)', '(sqrt(-width), 0)', 2, 'sqrt(-4) is not real'),
    ('(width, 0)', '(1e308 * 10, 0)', 2, 'overflows'),
    ('(width, 0)', '(1e999, 0)', 2, 'beyond the range'),
    ('(width, 0)', '(0 / 0, 0)', 2, 'division of 0 by zero'),
    ('-> wall', '-> split(x) { ~log(width - 4): wall }', 5, 'log(0) does not exist'),
    ('front -> wall', 'front : width % 0 -> wall', 5, 'remainder of 4 by zero'),
    ('joint: 0.01', 'joint: 0.01 offset: 7', 6, 'from -1 to 1'),
    # geometry
    (_SQUARE, '', 2, 'nothing stands behind "footprint:"'),
    ('facades: front', 'facades:', 3, 'nothing stands behind "facades:"'),
    (_SQUARE, '(0, 0)', 2, 'at least 2 corners'),
    (_SQUARE, '(0, 0) (4, 0) (4, 0) (4, 4) (0, 4)', 2, 'this corner and the next one are'),
    (_SQUARE, '(0, 0) (4, 0) (4, 0.01) (4, 4) (0, 4)', 2, 'shorter than 0.1 m'),
    (_SQUARE, '(0, 0) (4, 0) (4, 4) (0, 4) (0, 0)', 2, 'the last corner repeats the first'),
    (_SQUARE, '(0, 0) (0, 4) (4, 4) (4, 0) (0, 0)', 2, 'the last corner repeats the first'),
    (_SQUARE, '(0, 0) (2e4, 0) (0, 4)', 2, 'longer than 10000 m'),
    (_SQUARE, '(0, 0) (2, 0) (4, 0)', 2, 'on one line'),
    (_SQUARE, '(0, 0) (4, 0) (4, 4) (2, 0) (0, 4)', 2, 'crosses itself'),
    ('-> wall', '-> window', 1, 'no facade has a panel with a layout'),
    ('-> wall', '-> split(x) { 1: window | ~1: wall }', 5, 'corner'),
    ('-> wall', '-> extrude(0.09) { wall }', 5, 'keeps it bonded'),
    ('-> wall', '-> split(x) { ~1: wall | 0.08: window | ~1: wall }', 5, 'too small'),
    ('-> wall', '-> split(y) { ~1: column }\nrule column -> split(x) { 0.18: wall | ~1: band | '
     '0.18: wall }\nrule band -> split(y) { 1: window | 0.3: lintel | ~1: wall }', 7,
     'bears only'),
    (_SQUARE, '(0, 0) (0, 4) (width, 4) (width, 0)', 2,
     'counter-clockwise'),
    (_SQUARE, '(0, 0) (width, 4) (width, 0) (0, 4)', 2,
     'crosses itself'),
    (_SQUARE, '(0, 0) (4, 0) (0, 0.5)', 2, 'degrees'),
    (_SQUARE, '(0, 0) (4, 0) (4, 0.15) (0, 0.15)', 2, 'too short'),
    ('unit: 0.215 0.1025 0.065', 'unit: 5 0.1025 0.065', 5, 'larger than the panel'),
    ('unit: 0.215 0.1025 0.065', 'unit: 0.215 0.1025 3.5', 5, 'larger than the panel'),
    # materials without finite masses and stiffnesses
    ('panel wall', 'material mud { density: 1500 }\npanel wall', 7, 'needs tension, cohesion, '),
    *(('panel wall', f'material brick {{ {entry} }}\npanel wall', 7, allowed)
      for entry, allowed in (
          ('density: 1e300', '1 to 25000'), ('density: 0', '1 to 25000'),
          ('tension: 1e100', '0 to 1e+12'), ('tension: -1', '0 to 1e+12'),
          ('friction: -1', '0 to 10'), ('cohesion: -1', 'must be from 0'),
          ('compression: 0', 'must be from'), ('modulus: 1', '1000 to 2e+12'))),
    # what has no end
    ('-> wall', '-> front', 5, 'deep'),
    ('-> wall', '-> split(x) { ~1: front | ~1: front }', 5, 'deep'),
    ('-> wall', '-> grid(0.002, 0.002) { wall }', 5, '100000 cells'),
    ('-> wall', '-> grid(0.1, 0.1) { cell }\nrule cell -> grid(0.01, 0.01) { wall }', 3,
     '100000 divisions'),
    (_SQUARE, ' '.join(f'({200 * np.cos(a):.4f}, {200 * np.sin(a):.4f})'
                       for a in np.linspace(0.0, 6.28, 501)), 2, 'at most 500 corners, found 501'),
    # what does not carry or has no room
    ('-> wall', '-> split(y) { 1: wall | 1: gap | ~1: wall }\npanel gap: none', 1,
     'hang in the air, the first a brick'),
    *((_SQUARE, f'(0, 0) (2, 0) (3, 1.7) (2, 3.4) (0, 3.4) (-1, 1.7)\n  {timber}', 3,
       'right angles only')
      for timber in ('floors: timber', 'roof: flat', 'partitions: halves(2)')),
    (_SQUARE, '(0, 0) (3, 0) (3, 0.6) (0, 0.6)\n  roof: hip(40)', 3,
     'at least 0.5 m between opposite walls'),
    ('rule front -> wall', 'floors: slab(0.2)\nrule front -> split(x) '
     '{ ~1: wall | 1: window | ~1: wall }', 1, 'meets the panel "window"'),
])
def test_refusal_names_the_place(old, new, line, words):
    """Say where and why."""
    error = refusal(old, new)
    assert error.source == 'bad.wall' and error.line == line, str(error)
    assert words in error.message, str(error)


def test_deep_nesting_is_refused():
    """Refuse what is written too deep, before Python's own stack ends."""
    for head, tail in (('split(x) { ~1: ', ' }'), ('split(x) { { ~1: wall }* | ~1: ', ' }')):
        error = refusal('-> wall', '-> ' + head * 1200 + 'wall' + tail * 1200)
        assert 'nested more than' in error.message
    error = refusal('-> wall', '-> split(x) { ' + '{' * 1200 + '~1: wall' + '}*' * 1200 + '}')
    assert 'nested more than' in error.message


def test_a_million_bricks_are_refused_before_they_are_built():
    """Refuse by the count, with the bound and the remedy."""
    error = refusal('storey_height: 3', 'storey_height: 90', width=200.0)
    assert '200000 parts' in error.message and 'most_parts' in error.message
    assert 'more than 100 parts' in refusal('rule', 'rule', most_parts=100).message


def test_unknown_define_is_refused():
    """Offer the parameters that exist."""
    with pytest.raises(GrammarError, match='width'):
        WallGrammar.parse(_GOOD).build(widht=3.0)


@pytest.mark.parametrize('text, words', [
    ('', 'found the end, expected "building"'), ('# nothing\n\n', 'found the end'),
    ('\0\1\2ELF\x7f', r'found "\x00", expected "building"'), ('@@ ]] }}', 'found "@"'),
    ('rule a -> b\n', 'exactly one building, found 0'),
    (_GOOD + _GOOD, 'exactly one building, found 2'), ('#' * 300_000, 'at most 200000')])
def test_what_is_no_grammar_is_refused(text, words):
    """Say what was found, for nothing, noise, half a grammar and far too much."""
    with pytest.raises(GrammarError) as caught:
        WallGrammar.parse(text, 'bad.wall')
    assert words in caught.value.message and caught.value.source == 'bad.wall'


@pytest.mark.parametrize('extra', ['partitions: halves(1)', 'floors: slab(0.2)', 'floors: timber',
                                   'roof: hip(40)', 'roof: lean_to(40)'])
def test_endless_interiors_are_refused_before_they_are_built(extra):
    """Count rooms, slabs, joists and tiles of a hall of 6 x 3 km before making any."""
    text = _GOOD.replace(_SQUARE, '(0, 0) (6000, 0) (6000, 3000) (0, 3000)')
    text = text.replace('storey_height: 3', f'storey_height: 0.15\n  {extra}')
    tracemalloc.start()
    with pytest.raises(GrammarError, match='more than 200000 parts'):
        WallGrammar.parse(text).build()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200e6


@pytest.mark.parametrize('path', ['/dev/zero', '/dev/null', '/dev/tty', '/etc', 'nowhere.wall'])
@pytest.mark.parametrize('load', [WallGrammar.load, LSystem.load])
def test_what_is_no_file_is_refused(load, path):
    """Refuse what never ends, what waits for a key, a folder, and what is not there."""
    with pytest.raises(GrammarError, match='cannot read'):
        load(path)
