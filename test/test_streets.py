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


"""Streets: plans place different houses along streets, fronts to the kerb, and rows of trees."""

import numpy as np
import pytest

from procphys_ros.errors import SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.scene.plan import read_plan
from procphys_ros.simulation.load_checks import check_places

SHED = """
building shed(width = 3.0, depth = 2.0, storeys = 1)
  footprint: (0, 0) (width, 0) (width, depth) (0, depth)
  facades: front back back back
  storey_height: 1.2
rule front -> split(x) { ~1: wall | 1.0: gap | ~1: wall }
rule back -> wall
layout running { unit: 0.45 0.2 0.19  joint: 0.01  material: brick }
panel wall: running
panel gap: none
"""
TWENTY = """
streets:
  high: {from: [0, 0], to: [60, 0], width: 6}
plots:
  - {street: high, side: left, count: 10, grammars: [shed.wall, box.wall], gap: 1.5, setback: 3,
     defines: {width: [2.5, 4.5], depth: [2, 3, 0.5]}}
  - {street: high, side: right, count: 10, grammars: shed.wall, defines: {width: [2.5, 4.5]}}
trees:
  - {street: high, side: left, grammars: birch.lsys, spacing: 20, offset: 1}
"""


@pytest.fixture
def folder(tmp_path):
    """Make a folder with grammars of small buildings and a plan of twenty."""
    (tmp_path / 'shed.wall').write_text(SHED)
    (tmp_path / 'box.wall').write_text(SHED.replace('shed', 'box').replace('1.2', '0.8'))
    (tmp_path / 'block.plan').write_text(TWENTY)
    return tmp_path


def block(folder, **about):
    """Build a scene of one plan."""
    return Scene.from_parameters({'scene': {'objects': ['block']},
                                  'block': {'grammar': 'block.plan', **about}}, folder)


def test_twenty_houses_differ_and_stand_apart(folder):
    """Build twenty houses of different size from ten lines, none in another, and four trees."""
    scene = block(folder)
    names = [thing.name for thing in scene.objects]
    assert names == [*(f'block_house_{i}' for i in range(20)),
                     *(f'block_tree_{i}' for i in range(4))]
    houses = scene.objects[:20]
    extents = {tuple(np.ptp(scene.blueprint.poses[h.first:h.first + h.count, :3], axis=0).round(3))
               for h in houses}
    assert len(extents) == 20
    assert not [line for line in check_places(scene.blueprint, scene.objects) if 'house' in line]


def test_fronts_face_the_street(folder):
    """Put each gap of a front at the setback from the kerb, whichever way the plan is turned."""
    scene, yaw = block(folder, yaw=0.7, origin=[5.0, -3.0, 0.0]), 0.7
    along = np.array([np.cos(yaw), np.sin(yaw)])
    across = np.array([-along[1], along[0]])
    for number, house in enumerate(scene.objects[:20]):
        rows = np.arange(house.first, house.first + house.count)
        place = scene.blueprint.poses[rows, :2] - [5.0, -3.0]
        side, way = place @ across, place @ along
        left = number < 10
        front = side.min() if left else side.max()  # middles of half-brick walls
        assert front == pytest.approx((3.0 + 3.0 + 0.1) if left else -(3.0 + 2.0 + 0.1), abs=0.02)
        beside = np.abs(side - front) < 0.05
        gaps = np.diff(np.sort(way[beside]))
        assert gaps.max() > 0.9  # the opening of the front is on this side
        assert way.min() >= 0.0 and way.max() <= 60.0
    trees = scene.objects[20:]
    roots = scene.blueprint.poses[[t.first for t in trees], :2] - [5.0, -3.0]
    np.testing.assert_allclose(roots @ across, 4.0, atol=0.1)
    np.testing.assert_allclose(roots @ along, [0.0, 20.0, 40.0, 60.0], atol=0.1)


def test_steps_of_a_define_end_at_its_largest_value(folder):
    """Take 2 and 2.6 of what goes from 2 to 3 in steps of 0.6, and no 3.2."""
    (folder / 'block.plan').write_text(TWENTY.replace('depth: [2, 3, 0.5]', 'depth: [2, 3, 0.6]'))
    rng = np.random.default_rng(0)
    row = next(row for row in read_plan(folder / 'block.plan').rows if 'depth' in row.defines)
    depths = {round(values['depth'], 9) for _ in range(9) for _, values in row.choices(rng)}
    assert depths == {2.0, 2.6}


def test_the_same_seed_gives_the_same_street(folder):
    """Repeat a street by its seed, and share one between nodes without a difference."""
    one, same, other = block(folder, seed=4), block(folder, seed=4), block(folder, seed=5)
    np.testing.assert_array_equal(one.blueprint.poses, same.blueprint.poses)
    assert len(one.blueprint) != len(other.blueprint) or not np.array_equal(
        one.blueprint.poses, other.blueprint.poses)


def test_houses_of_a_street_stand_on_the_hill(folder):
    """Raise each house by its own ground."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['block']}, 'block': {'grammar': 'block.plan', 'origin': [-30, 0, 0]},
        'terrain': {'noise': 6.0, 'wavelength': 50.0, 'extent': 120.0}}, folder)
    lows = [plan[2] for plan in (scene.blueprint.poses[h.first] for h in scene.objects[:20])]
    assert np.ptp(lows) > 0.5


def test_the_shipped_plan_says_what_it_is():
    """Read the high street: six houses, three to a side, and birches."""
    rows = read_plan(shared_folder() / 'grammars' / 'high_street.plan').rows
    assert sum(row.count for row in rows if row.is_plots) == 6
    assert {row.left for row in rows} == {True, False}


@pytest.mark.parametrize('old, new, message', [
    ('width: 6}', 'widht: 6}', 'block.plan:3: there is no key "widht"'),
    ('side: right', 'side: north', "block.plan:7: side is 'north', it must be one of left, right"),
    ('street: high, side: left, count', 'street: low, side: left, count',
     "block.plan:5: street is 'low'"),
    ('count: 10, grammars: [', 'count: 0, grammars: [', 'block.plan:5: count is 0, it must be'),
    ('count: 10, grammars: [', 'count: 2.7, grammars: [', 'count is 2.7, it must be a whole'),
    ('to: [60, 0]', 'to: [60]', 'block.plan:3: to is [60], it must be two numbers'),
    ('[shed.wall, box.wall]', '[]', 'it must name files that end in .lsys, .wall, .mech, .urdf,'),
    ('depth: [2, 3, 0.5]', 'depth: [3, 2]', 'block.plan:6: defines has depth: [3, 2]'),
    ('to: [60, 0]', 'to: [9, 0]', 'of a street that is 9.0 m long'),
    ('spacing: 20', 'spacing: 20, [', 'not valid YAML'),
    ('width: 6}', 'width: 6, width: 7}', 'block.plan:3: width stands there twice'),
    ('width: 6}', 'width: 6}\n  high: {from: [0, 0], to: [9, 0]}', 'high stands there twice'),
    ('to: [60, 0]', 'to: &a [60, *a]', 'contains itself'),
    ('to: [60, 0]', 'to: [2026-02-30, 0]', "block.plan:3: to is ['2026-02-30', 0], it must be"),
    ('to: [60, 0]', 'to: [!!bool so, 0]', 'block.plan:3: to cannot be read'),
    ('depth: [2, 3, 0.5]', 'seed: 3', 'block.plan:6: defines has a value "seed"'),
    ('depth: [2, 3, 0.5]', 'depth: 1' + 400 * '0', 'it must be a number, [least'),
    ('shed.wall, box', 'sheds.wall, box', 'there is no grammar "sheds.wall"'),
    (', setback: 3', '', ''),
])
def test_slips_are_told(folder, old, new, message):
    """Name file, line, key and what is allowed; what is left out has a default."""
    assert old in TWENTY
    (folder / 'block.plan').write_text(TWENTY.replace(old, new, 1))
    if not message:
        assert len(block(folder).objects) == 24
        return
    with pytest.raises(SceneError) as error:
        block(folder)
    assert message in str(error.value)


def test_a_plan_is_no_single_grammar(folder):
    """Refuse counts and defines beside a plan, and a plan where one object is asked for."""
    for about in ({'count': 2}, {'defines': ['width=3']}):
        with pytest.raises(SceneError, match='counts and defines of its own'):
            block(folder, **about)
    with pytest.raises(SceneError, match='there is no grammar "hihg_street.plan".*high_street'):
        block(folder, grammar='hihg_street.plan')
