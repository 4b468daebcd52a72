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

"""Whole buildings: nothing hangs, nothing overlaps, and the work grows with the parts."""

from pathlib import Path
import re

from building_checks import count_loose, deepest_overlap, OVERLAP
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.wallgrammar import contacts, WallGrammar

_GRAMMARS = Path(__file__).parents[1] / 'grammars'

_TEXT = """
building b(height = 1.8)
  footprint: {footprint}
  facades: wall
  storey_height: height
  {extra}
layout {layout} {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
panel wall: {layout}
"""
_RECTANGLE = '(0, 0) (6, 0) (6, 4) (0, 4)'
_ANGLE = '(0, 0) (5, 0) (5, 2.5) (2.5, 2.5) (2.5, 5) (0, 5)'
_STAR = '(0, 0) (3, 1) (6, 0) (5, 3) (6, 6) (3, 5) (0, 6) (1, 3)'
_CASES = [
    (_RECTANGLE, 'running', 'roof: hip(40)'), (_RECTANGLE, 'english', 'roof: gable(30)'),
    (_RECTANGLE, 'flemish', 'roof: flat'),
    (_RECTANGLE, 'running', 'storeys: 2 floors: slab(0.2) roof: flat partitions: halves(1.5)'),
    (_RECTANGLE, 'english', 'floors: timber roof: gable(45) partitions: halves(1.2)'),
    (_ANGLE, 'flemish', 'floors: slab(0.15)'), (_ANGLE, 'english', 'partitions: halves(1)'),
    ('(0, 0) (4, 3) (2.5, 5) (-1.5, 2)', 'running', 'floors: timber roof: gable(35)'),
    ('(0, 0) (3, 0) (4.2, 2.1) (1.5, 4) (-1, 2)', 'running', ''), (_STAR, 'english', ''),
    ('(0, 0) (4, 0) (1, 3)', 'flemish', ''), ('(0, 0) (3, 0)', 'english', ''),
]


@pytest.fixture(scope='module')
def shipped():
    """Build every shipped building once."""
    return {path.stem: WallGrammar.load(path).build() for path in sorted(_GRAMMARS.glob('*.wall'))}


def check_sound(blueprint):
    """Check what holds for every building."""
    assert count_loose(blueprint) == 0
    assert deepest_overlap(blueprint) < OVERLAP
    assert (blueprint.mass > 0.0).all() and np.isfinite(blueprint.poses).all()
    assert (blueprint.bond_area > 0.0).all() and (blueprint.mortar.normal_stiffness > 0.0).all()
    assert len(np.unique(blueprint.bonds, axis=0)) == len(blueprint.bonds)
    norm = np.linalg.norm(blueprint.bond_frame[:, 3:], axis=1)
    np.testing.assert_allclose(norm, 1.0, atol=1e-9)


@pytest.mark.parametrize('name', [
    'barn', 'cottage', 'dry_stone', 'garden_wall', 'office', 'terrace', 'tower'])
def test_shipped_buildings_are_sound(shipped, name):
    """Bond every part to the ground, and let none overlap."""
    check_sound(shipped[name])


@pytest.mark.parametrize('footprint, layout, extra', _CASES)
def test_buildings_of_all_sorts_are_sound(footprint, layout, extra):
    """Build convex and re-entrant, turned and odd-angled plans, with floors and roofs."""
    text = _TEXT.format(footprint=footprint, layout=layout, extra=extra)
    check_sound(WallGrammar.parse(text).build())


def test_overlap_check_can_fail(shipped):
    """Find the overlap when a brick is pushed 5 mm into the next."""
    wall = shipped['garden_wall']
    poses = wall.poses.copy()
    poses[5, 0] += 0.015
    moved = type(wall)(**{**vars(wall), 'poses': poses})
    assert deepest_overlap(moved) == pytest.approx(0.005, abs=1e-6)


def test_office_has_the_number_of_bricks_of_the_paper(shipped):
    """Hit 15,196 exactly, and give the smaller sizes that the file names."""
    grammar = WallGrammar.load(_GRAMMARS / 'office.wall')

    def bricks(blueprint):
        return int(np.isin(np.array(blueprint.kinds)[blueprint.kind],
                           ('brick', 'partition')).sum())

    assert bricks(shipped['office']) == 15196
    assert bricks(grammar.build(bays=1, deep=1, storeys=1, module=2.8)) == 2072
    assert bricks(grammar.build(bays=2, deep=1, storeys=1)) == 2723
    assert bricks(grammar.build(storeys=1)) == 5026
    assert bricks(grammar.build(storeys=2)) == 10111


def test_buildings_have_their_parts(shipped):
    """Name what each part is."""
    assert {'brick', 'frame', 'pane', 'board', 'lintel', 'joist', 'partition', 'plate', 'ridge',
            'rafter', 'batten', 'tile', 'tie', 'verge'} == set(shipped['cottage'].kinds)
    assert 'slab' in shipped['office'].kinds
    assert 'brick' not in shipped['barn'].kinds


def test_the_documentation_tells_their_sizes(shipped):
    """Find bricks, parts, bonds and mass of each in the table of docs/walls.md."""
    page = (_GRAMMARS.parent / 'docs' / 'walls.md').read_text('utf-8')
    for name, built in shipped.items():
        row = re.search(rf'^\| {name} \|[^|]*\|[^|]*\| (.*) \|[^|]*\|$', page, re.MULTILINE)[1]
        kind = np.array(built.kinds)[built.kind]
        bricks = np.isin(kind, ('brick', 'partition')).sum()
        assert row == (f'{bricks:,} | {len(built):,} | {len(built.bonds):,} | '
                       f'{built.mass.sum() / 1000.0:.1f}'), name


def test_joists_rest_in_pockets_with_little_tension(shipped):
    """Bear every joist on masonry, dry."""
    cottage = shipped['cottage']
    kind = np.array(cottage.kinds)[cottage.kind]
    ends = np.isin(kind[cottage.bonds], ('joist',)).any(axis=1)
    masonry = np.isin(kind[cottage.bonds], ('brick', 'partition')).any(axis=1)
    bearing = ends & masonry & (cottage.bonds[:, 0] != GROUND)
    assert bearing.sum() > 100
    np.testing.assert_allclose(cottage.mortar.tension[bearing], 0.1e6)


def test_partitions_make_rooms():
    """Halve a plan of 12 x 6 m into eight rooms by seven walls with doors."""
    text = _TEXT.format(footprint='(0, 0) (12, 0) (12, 6) (0, 6)', layout='running',
                        extra='partitions: halves(2.8)').replace('1.8', '2.7')
    blueprint = WallGrammar.parse(text).build()
    kind = np.array(blueprint.kinds)[blueprint.kind]
    assert np.count_nonzero(kind == 'lintel') == 14  # of two pieces each
    inside = blueprint.poses[kind == 'partition']
    assert np.abs(inside[:, 0] - 6.0).min() < 0.01
    assert not ((np.abs(inside[:, 0] - 6.0) < 0.06) & (np.abs(inside[:, 1] - 2.25) < 0.4)
                & (inside[:, 2] < 2.0)).any()


def test_odd_corners_are_bonded_within_and_across_courses():
    """Join the walls of a hexagon by wedges of mortar and by overlapping beds."""
    points = [(2 * np.cos(a), 2 * np.sin(a)) for a in np.arange(6) * np.pi / 3]
    text = _TEXT.format(footprint=' '.join(f'({x:.9f}, {y:.9f})' for x, y in points),
                        layout='running', extra='')
    blueprint = WallGrammar.parse(text).build()
    yaw = 2.0 * np.arctan2(blueprint.poses[:, 5], blueprint.poses[:, 6])
    first, second = blueprint.bonds[blueprint.bonds[:, 0] != GROUND].T
    turn = (yaw[first] - yaw[second]) % (0.5 * np.pi)
    crossing = (turn > 0.1) & (turn < 0.5 * np.pi - 0.1)
    level = np.abs(blueprint.poses[first, 2] - blueprint.poses[second, 2]) < 1e-6
    assert np.count_nonzero(crossing & level) == 6 * 24
    assert np.count_nonzero(crossing & ~level) >= 6 * 23


def test_work_grows_linearly(monkeypatch):
    """Compare no more faces per brick in a wall ten times as large."""
    work = []
    original = contacts.spread

    def counting(count):
        work.append(int(count.sum()))
        return original(count)

    monkeypatch.setattr(contacts, 'spread', counting)
    text = _TEXT.format(footprint='(0, 0) (width, 0) (width, width) (0, width)', layout='running',
                        extra='').replace('height = 1.8', 'height = 3, width = 4')
    per_brick = []
    for width in (4, 20, 40):
        work.clear()
        parts = len(WallGrammar.parse(text).build(width=width))
        per_brick.append(sum(work) / parts)
    assert per_brick[2] < 1.05 * per_brick[1] < 1.1 * per_brick[0]


def test_panels_meet_without_a_gap_that_is_too_thin_for_bricks():
    """Divide a wall a joint and a little below a course line: what is above still stands on it."""
    text = """building b(level = 0.666)
  footprint: (0, 0) (2.8, 0)
  facades: front
  storey_height: 1.33
rule front -> split(y) { level: wall | ~1: other }
material stone { density: 2000 tension: 1e5 cohesion: 2e5 compression: 1e7 }
layout laid { bond: running unit: 0.2805 0.181 0.2153 joint: 0.0166 material: stone }
panel wall: laid
panel other: laid
"""
    for level in np.arange(0.64, 0.72, 0.005):
        assert len(WallGrammar.parse(text).build(level=float(level))) > 40


@pytest.mark.parametrize('footprint', [
    '(0, 0) (4, 0) (4, 3) (0, 3)', '(0, 0) (5, 0) (5, 3) (3, 3) (3, 5) (0, 5)'])
def test_rooms_leave_space_for_panels_that_are_set_back(footprint):
    """Set panels back into rooms with partitions and boards: nothing reaches into another part."""
    house = WallGrammar.parse(f"""building b
  footprint: {footprint}
  facades: front
  storey_height: 2.5
  floors: timber
  roof: flat
  partitions: halves(1.2)
rule front -> split(x) {{ 0.3: wall | ~1: extrude(-0.04) {{ wall }} | 0.3: wall }}
layout running {{ unit: 0.3 0.15 0.1 joint: 0.01 material: brick }}
panel wall: running
""").build()
    assert {'partition', 'board'} <= set(house.kinds)
    assert deepest_overlap(house) < OVERLAP
    assert count_loose(house) == 0
    kind = np.array(house.kinds)[house.kind[house.bonds]]
    assert ((kind == 'partition').any(axis=1) & (kind == 'brick').any(axis=1)).sum() > 20
