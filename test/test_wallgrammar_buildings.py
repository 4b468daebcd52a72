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

"""Whole buildings: plans, storeys and floors, where nothing hangs or overlaps."""

from pathlib import Path
import re

from building_checks import count_loose, deepest_overlap, OVERLAP, standing, take_out
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.errors import GrammarError
from procphys_ros.simulation import masonry
from procphys_ros.wallgrammar import contacts, WallGrammar
from procphys_ros.wallgrammar.footprint import square_up

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
    (_RECTANGLE, 'flemish', 'floors: timber roof: lean_to(25) partitions: halves(1.2)'),
    (_ANGLE, 'flemish', 'floors: slab(0.15)'), (_ANGLE, 'english', 'partitions: halves(1)'),
    ('(0, 0) (4, 3) (2.5, 5) (-1.5, 2)', 'running', 'floors: timber roof: gable(35)'),
    ('(0, 0) (3, 0) (4.2, 2.1) (1.5, 4) (-1, 2)', 'running', 'floors: slab(0.15) roof: flat'),
    (_STAR, 'english', 'storeys: 2 floors: slab(0.2)'),
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
    'barn', 'cottage', 'dry_stone', 'garden_wall', 'office', 'outhouse', 'terrace', 'tower'])
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


@pytest.mark.parametrize('name', sorted(path.stem for path in _GRAMMARS.glob('*.wall')))
def test_shipped_building_stands_within_its_strength(shipped, name):
    """Carry all parts to the ground, load every bond below its limit; only dry joints open."""
    # Every pose stays to the last bit: the small ones for 20 s, the large ones for 2.
    plan = shipped[name]
    simulation = standing(plan)
    simulation.set_wind_enabled(False)
    solver, graph = simulation.state.solver, simulation.state.solver.graph
    dry = (plan.mortar.tension == 0.0) & (plan.mortar.cohesion == 0.0)
    assert dry[graph.rows[graph.cracked]].all() and graph.alive.all()
    assert masonry.is_stable(simulation.state)
    assert solver.supported.all()
    assert 0.0 < solver.utilisation()[0].max() < 1.0
    spent = solver.spent
    simulation.step(1200 if len(plan) < 1000 else 120)
    assert solver.spent == spent  # standing costs nothing
    assert np.array_equal(simulation.poses, plan.poses)
    assert not simulation.velocities.any() and simulation.bonds_broken == 0
    feet = graph.grounded()
    pull = np.einsum('kij,kj->ki', graph.axes[feet], solver.wrenches()[feet, :3])
    sign = np.where(graph.first[feet] == graph.count, -1.0, 1.0)
    held = (sign[:, None] * pull).sum(axis=0)
    accuracy = 4e-3 if dry.any() else 2e-3  # joints that open are iterated on
    assert held[2] == pytest.approx(plan.mass.sum() * 9.81, rel=accuracy)


def test_all_broken_bonds_are_told_and_reset_makes_whole():
    """Compare events with dead bonds after a collapse; a reset gives the same collapse again."""
    blueprint = wall(8, 12)
    simulation = standing(blueprint)
    outcome = []
    for _ in range(2):
        take_out(simulation, np.flatnonzero(blueprint.poses[:, 2] < 0.15))
        simulation.step(120)
        events = simulation.events
        assert len(np.unique(events['bond'])) == len(events) == simulation.bonds_broken
        outcome.append((simulation.poses.copy(), events.copy()))
        simulation.reset()
        assert np.array_equal(simulation.poses, blueprint.poses)
    np.testing.assert_array_equal(outcome[0][0], outcome[1][0])
    np.testing.assert_array_equal(outcome[0][1], outcome[1][1])


_PLANS = {
    'box': [(0, 0), (5, 0), (5, 3.5), (0, 3.5)],
    'L': [(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)],
    'T': [(0, 0), (7, 0), (7, 3), (5, 3), (5, 6), (2, 6), (2, 3), (0, 3)],
    'U': [(0, 0), (8, 0), (8, 5), (5.5, 5), (5.5, 2.5), (2.5, 2.5), (2.5, 5), (0, 5)],
    'line': [(0, 0), (3, 0), (6, 0), (6, 3), (0, 3)],
}
_SQUARE = """
building house
  footprint: {points}
  facades: wall
  storey_height: 2.4
  {extra}
layout running {{ unit: 0.44 0.15 0.14 joint: 0.01 material: brick }}
panel wall: running
"""


def skewed(name, most, rng):
    """Turn each edge of a plan by at most an angle [degrees], and all of it by any angle."""
    points = np.array(_PLANS[name], float)
    edges = np.roll(points, -1, axis=0) - points
    reach = np.tan(np.radians(most)) * np.hypot(*edges.T)
    reach = 0.5 * np.minimum(reach, np.roll(reach, 1))
    points += rng.uniform(-0.7, 0.7, points.shape) * reach[:, None]
    turn = rng.uniform(0.0, 2.0 * np.pi)
    return points @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])


def build(points, extra):
    """Build a house on a plan."""
    corners = ' '.join(f'({x!r}, {y!r})' for x, y in points.tolist())
    return WallGrammar.parse(_SQUARE.format(points=corners, extra=extra), 'house.wall').build()


def angles(points):
    """Compute the deviation of edges from right angles to the first one [degrees]."""
    edges = np.roll(points, -1, axis=0) - points
    yaw = np.degrees(np.arctan2(*edges.T[::-1]))
    return (yaw - yaw[0] + 45.0) % 90.0 - 45.0


@pytest.mark.parametrize('name', list(_PLANS))
@pytest.mark.parametrize('seed', range(8))
def test_edges_turn_about_their_middles(name, seed):
    """Square plans of all sorts and directions up, by no more than they are off."""
    given = skewed(name, 1.8, np.random.default_rng(seed))
    squared = square_up(given, None)
    assert np.abs(angles(given)).max() > 0.1 and np.abs(angles(squared)).max() < 1e-9
    middles = [0.5 * (p + np.roll(p, -1, axis=0)) for p in (given, squared)]
    assert np.hypot(*(squared - given).T).max() < np.tan(np.radians(2.0)) * 8.0
    assert np.hypot(*(middles[1] - middles[0]).T).max() < 0.15
    assert square_up(squared, None) is squared


@pytest.mark.parametrize(('name', 'most', 'extra'), [
    ('box', 1e-4, 'floors: timber roof: hip(40)'), ('L', 1.0, 'floors: slab(0.2)'),
    ('T', 1e-4, 'roof: gable(40)'), ('T', 1.0, 'floors: timber'),
    ('U', 1.0, 'roof: flat partitions: halves(1.2)'), ('line', 1.0, 'floors: timber')])
def test_floors_and_roofs_fit_plans_that_are_nearly_square(name, most, extra):
    """Build houses on plans out of square by a hair and by a degree."""
    house = build(skewed(name, most, np.random.default_rng(3)), extra)
    assert count_loose(house) == 0
    if 'roof: hip' not in extra and 'gable' not in extra:
        assert deepest_overlap(house) < OVERLAP


def test_plans_without_floors_and_roofs_stay_as_they_are():
    """Keep the corners of plain walls."""
    points = skewed('box', 1.0, np.random.default_rng(5))
    low = build(points, '').poses[:, :2]
    assert np.hypot(*(low[:, None] - points).transpose(2, 0, 1)).min(axis=0).max() < 0.25
    assert len(build(points, '')) != 0


@pytest.mark.parametrize(('off', 'place'), [(0.3, '(5.3, 3.5)'), (-0.4, '(4.6, 3.5)')])
def test_plans_that_are_no_more_square_are_refused(off, place):
    """Name the corner."""
    points = np.array(_PLANS['box'], float)
    points[2, 0] += off
    with pytest.raises(GrammarError, match='to within 2 degrees') as caught:
        build(points, 'floors: timber')
    assert f'({points[1][0]:g}, 0)' in caught.value.message or place in caught.value.message


@pytest.mark.parametrize('seed', range(4))
def test_wings_stay_with_the_walls_that_they_touch(seed):
    """Build a porch on the skew wall of a house: both are squared up, and bonded."""
    rng = np.random.default_rng(seed)
    a, b, c, d = skewed('box', 1.5, rng)
    way = (b - a) / np.hypot(*(b - a))
    out = np.array([way[1], -way[0]])
    porch = [a + 1.5 * way + 1.5 * out, a + 3.2 * way + 1.52 * out, a + 3.2 * way, a + 1.5 * way]
    wing = f"""roof: flat
wing porch
  footprint: {' '.join(f'({x!r}, {y!r})' for x, y in np.array(porch).tolist())}
  facades: wall
  storey_height: 2.1
  roof: flat"""
    house = build(np.array([a, b, c, d]), wing)
    assert count_loose(house) == 0 and deepest_overlap(house) < OVERLAP
    edge = (house.poses[:, :2] - a) @ out
    first, second = (edge[house.bonds[(house.bonds >= 0).all(axis=1)].T] > 0.06)
    assert (first != second).sum() > 10


_FLOORED = """
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


def floored(footprint, facades, extra, height=2.4):
    """Build a house, and give it with the names of the kinds of its parts."""
    house = WallGrammar.parse(_FLOORED.format(footprint=footprint, facades=facades, height=height,
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
        house, kind = floored(footprint, facades, rng.choice(['floors: timber', 'roof: flat']))
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
    house, kind = floored('(0, 0) (3, 0) (3, 1.5) (0, 1.5)', 'open wall', 'roof: flat')
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
        floored('(0, 0) (4, 0) (4, 3) (0, 3)', facades, extra)
    assert words in caught.value.message and caught.value.line == line


@pytest.mark.parametrize('height', [2.25, 2.4, 2.55, 2.7])
def test_joists_pass_over_the_doors_of_partitions(height):
    """Lay all joists in storeys that have little or no room above doors."""
    house, kind = floored('(0, 0) (6, 0) (6, 3.5) (0, 3.5)', 'wall',
                          'partitions: halves(2) floors: timber', height)
    axis, lines = joist_lines(house, kind)
    assert axis == 1 and len(lines) > 12 and np.diff(lines).max() < _PACED + 0.15
    assert count_loose(house) == 0 and deepest_overlap(house) < OVERLAP
    assert ('lintel' in kind) == (height > 2.4)


@pytest.mark.parametrize('jog', [0.45, 0.55, 0.7, 1.1])
def test_narrow_parts_of_a_plan_have_a_joist(jog):
    """Carry the boards over a step of the plan by a joist, however narrow it is."""
    house, kind = floored(f'(0, 0) (4, 0) (4, 2.5) ({4 - jog}, 2.5) ({4 - jog}, 3) (0, 3)', 'wall',
                          'floors: timber')
    lines = np.unique(house.poses[kind == 'joist', 0].round(4))
    assert (lines > 4 - jog).any() and count_loose(house) == 0
