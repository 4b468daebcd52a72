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

"""Timber floors and flat roofs: no joist is left out, whatever the openings of the walls are."""

from building_checks import count_loose, deepest_overlap, OVERLAP
import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.wallgrammar import WallGrammar

_TEXT = """
building b
  footprint: {footprint}
  facades: {facades}
  storey_height: {height}
  {extra}
rule lit(strip) -> split(x) {{ 0.45: wall | {{ ~1.4: bay(strip) }}* | 0.45: wall }}
rule bay(strip) -> split(x) {{ ~1: wall | 0.7: column(strip) | ~1: wall }}
rule column(strip) -> split(y) {{ ~1: wall | 0.6: window | 0.15: lintel | strip: wall }}
rule open -> split(x) {{ 0.45: wall | ~1: gap | 0.45: wall }}
rule low -> split(y) {{ 1: wall }}
layout running {{ unit: 0.44 0.15 0.14 joint: 0.01 material: brick }}
panel wall: running
panel gap: none
panel window: glazing(timber, glass)
panel lintel: beam(concrete)
"""
_PACED = 0.451  # [m] between joists, and rounding


def build(footprint, facades, extra, height=2.4):
    """Build a house, and give it with the names of the kinds of its parts."""
    house = WallGrammar.parse(_TEXT.format(footprint=footprint, facades=facades, height=height,
                                           extra=extra)).build()
    return house, np.array(house.kinds)[house.kind]


def joist_lines(house, kind):
    """Find the axis along which joists run, and their middle lines across [m]."""
    across = np.ptp(house.poses[kind == 'joist', :2], axis=0)
    lines = [np.unique(house.poses[kind == 'joist', axis].round(4)) for axis in (0, 1)]
    spaced = [len(found) > 1 and np.diff(found).max() < _PACED for found in lines]
    axis = 1 - int(np.argmax(spaced)) if any(spaced) else int(np.argmax(across))
    return axis, lines[1 - axis]


@pytest.mark.parametrize('seed', range(12))
def test_no_joist_is_lost(seed):
    """Draw openings below floors and flat roofs: all joists are there, or it says what is met."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(1.6, 5.0, 2).round(2)
    lit = f'lit({rng.uniform(0, 0.6):.2f})'
    facades = ' '.join(rng.choice(['wall', 'wall', 'open', 'low', lit], 4))
    footprint = '(0, 0) ({0}, 0) ({0}, {1}) (0, {1})'.format(*size)
    try:
        house, kind = build(footprint, facades, rng.choice(['floors: timber', 'roof: flat']))
    except GrammarError as error:
        assert 'need wall to lie in' in error.message and ' at (' in error.message
        return
    axis, lines = joist_lines(house, kind)
    assert np.diff(lines).max() < _PACED and count_loose(house) == 0
    assert lines[0] < 0.3 and lines[-1] > size[1 - axis] - 0.3
    for line in lines:
        rows = np.flatnonzero((kind == 'joist') & (abs(house.poses[:, 1 - axis] - line) < 1e-3))
        held = house.bonds[np.isin(house.bonds, rows).any(axis=1)]
        ends = house.poses[held[(kind[held] == 'brick').any(axis=1)].max(axis=1), axis]
        assert np.ptp(ends) > 0.5 * size[axis]


def test_a_shelter_has_its_roof():
    """Turn the joists where one of the longer sides is open."""
    house, kind = build('(0, 0) (3, 0) (3, 1.5) (0, 1.5)', 'open wall', 'roof: flat')
    axis, lines = joist_lines(house, kind)
    assert axis == 0 and len(lines) == 4


@pytest.mark.parametrize(('facades', 'extra', 'line', 'words'), [
    ('open', 'roof: flat', 6, 'along the shorter side of the building one meets the panel "gap"'),
    ('low', 'floors: timber', 6, 'a place without wall at (0.29, 0.00, 2.33) m'),
    ('lit(0)', 'floors: timber', 6, 'along the longer side the panel "window" at ('),
    ('lit(0.1)', 'floors: timber', 6, 'the joists below 2.4 m need wall to lie in'),
])
def test_walls_that_joists_cannot_lie_in_are_named(facades, extra, line, words):
    """Say which panel is met, whichever way the joists run."""
    with pytest.raises(GrammarError) as caught:
        build('(0, 0) (4, 0) (4, 3) (0, 3)', facades, extra)
    assert words in caught.value.message and caught.value.line == line


@pytest.mark.parametrize('height', [2.25, 2.4, 2.55, 2.7])
def test_joists_pass_over_the_doors_of_partitions(height):
    """Lay all joists in storeys that have little or no room above doors."""
    house, kind = build('(0, 0) (6, 0) (6, 3.5) (0, 3.5)', 'wall',
                        'partitions: halves(2) floors: timber', height)
    axis, lines = joist_lines(house, kind)
    assert axis == 1 and len(lines) > 12 and np.diff(lines).max() < _PACED + 0.15
    assert count_loose(house) == 0 and deepest_overlap(house) < OVERLAP
    assert ('lintel' in kind) == (height > 2.4)


@pytest.mark.parametrize('jog', [0.45, 0.55, 0.7, 1.1])
def test_narrow_parts_of_a_plan_have_a_joist(jog):
    """Carry the boards over a step of the plan by a joist, however narrow it is."""
    house, kind = build(f'(0, 0) (4, 0) (4, 2.5) ({4 - jog}, 2.5) ({4 - jog}, 3) (0, 3)', 'wall',
                        'floors: timber')
    lines = np.unique(house.poses[kind == 'joist', 0].round(4))
    assert (lines > 4 - jog).any() and count_loose(house) == 0
