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

"""Facades: splits, repeats, borders, grids, extrusions, weights and conditions."""

from pathlib import Path

import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.language import Place
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


def test_split_shares_what_is_left():
    """Expect three, then one and two thirds of the rest."""
    assert sizes((absolute(3), floating(1), floating(2)), 9.0) == pytest.approx([3, 2, 4])


def test_relative_sizes_count_the_whole_scope():
    """Take 30 % of 10 m whatever else there is."""
    assert sizes((absolute(2), relative(0.3), floating(1)), 10.0) == pytest.approx([2, 3, 5])


def test_floating_part_without_room_is_dropped():
    """Drop what has no size, and keep the order of the rest."""
    assert sizes((absolute(2), floating(1), absolute(3)), 5.0) == pytest.approx([2, 3])


def test_parts_that_do_not_fit_are_refused():
    """Say what parts of a fixed size need, and what there is; rounding fits."""
    with pytest.raises(GrammarError, match='need 7 m and do not fit into 5 m'):
        sizes((absolute(3), floating(1), absolute(4)), 5.0)
    assert sizes((absolute(3), absolute(2.00001)), 5.0) == pytest.approx([3, 2])


def test_repeat_takes_the_nearest_whole_count():
    """Fit 2.1 m into 10 m five times at 2.0 m, and into 4 m twice."""
    body = (Repeated((floating(2.1),)),)
    assert sizes(body, 10.0) == pytest.approx([2.0] * 5)
    assert sizes(body, 4.0) == pytest.approx([2.0, 2.0])
    assert sizes(body, 1.0) == pytest.approx([1.0])


def test_repeat_leaves_room_for_fixed_parts():
    """Repeat between two piers, a group at a time."""
    body = (absolute(0.5), Repeated((floating(1), absolute(1))), absolute(0.5))
    assert sizes(body, 7.0) == pytest.approx([0.5, 1, 1, 1, 1, 1, 1, 0.5])


def test_repeat_of_fixed_parts_never_overflows():
    """Repeat a 2 m part four times on 9 m and leave the rest empty."""
    assert sizes((Repeated((absolute(2),)),), 9.0) == pytest.approx([2] * 4)


def test_nested_splits_share_edges():
    """Meet exactly where one panel ends and the next begins."""
    found = derive('rule start -> split(x) { ~1: wall | ~1: two | ~1: wall }\n'
                   'rule two -> split(y) { 1: gap | ~1: wall }')
    assert found == [('wall', 0, 0, 3, 3, 0), ('gap', 3, 0, 6, 1, 0), ('wall', 3, 1, 6, 3, 0),
                     ('wall', 6, 0, 9, 3, 0)]


def test_border_frames_its_inner_part():
    """Cut a border of 0.5 m off all sides; a scope too small is all border."""
    found = derive('rule start -> border(0.5) { gap | wall }')
    assert ('gap', 0.5, 0.5, 8.5, 2.5, 0) in found and len(found) == 5
    area = sum((r - x) * (t - b) for _, x, b, r, t, _ in found)
    assert area == pytest.approx(27.0)
    assert derive('rule start -> border(2) { gap | wall }') == [('wall', 0, 0, 9, 3, 0)]


def test_grid_divides_both_ways():
    """Cut 9 x 3 m into cells of about 2 x 1 m: 4 columns or 5, 3 rows."""
    found = derive('rule start -> grid(2, 1) { wall }')
    widths = {round(r - x, 6) for _, x, _, r, _, _ in found}
    assert len(found) == 12 and widths == {2.25}


def test_insert_sits_in_the_middle():
    """Set a panel of 1 x 1 m into the middle."""
    found = derive('rule start -> insert(1, 1) { gap | wall }')
    assert found[0] == ('gap', 4, 1, 5, 2, 0) and len(found) == 5


def test_extrusion_adds_up():
    """Move a panel outwards twice; depth counts inwards."""
    found = derive('rule start -> extrude(0.02) { again }\nrule again -> extrude(0.03) { wall }')
    assert found == [('wall', 0, 0, 9, 3, -0.05)]


def test_first_rule_with_true_condition_wins():
    """Choose by argument and building parameter."""
    rules = ('rule start -> part(n)\nrule part(k) : k > 3 -> gap\nrule part(k) -> wall\n')
    assert derive(rules)[0][0] == 'wall'
    assert derive(rules, n=4.0)[0][0] == 'gap'


def test_scope_size_is_known_to_rules():
    """Turn to another rule where the scope is small."""
    rules = ('rule start -> split(x) { 2: part | ~1: part }\n'
             'rule part : scope_x < 3 -> gap\nrule part -> wall\n')
    assert [p[0] for p in derive(rules)] == ['gap', 'wall']


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
