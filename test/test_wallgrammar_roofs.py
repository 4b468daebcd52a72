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

"""Roofs: faces that cover any plan, closed against rain, free of overlaps, and standing."""

from building_checks import (
    corners_of,
    count_loose,
    deepest_overlap,
    OVERLAP,
    standing,
)
import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import faces
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.wallgrammar import WallGrammar
from procphys_ros.wallgrammar.roof_plan import NoRoofError, RoofPlan

TEXT = """
building b
  footprint: {footprint}
  facades: wall
  storey_height: {height}
  roof: {roof}
layout {layout} {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
panel wall: {layout}
"""
PLANS = {
    'rectangle': [(0, 0), (8, 0), (8, 5), (0, 5)],
    'square': [(0, 0), (5, 0), (5, 5), (0, 5)],
    'L': [(0, 0), (6, 0), (6, 4), (4, 4), (4, 7), (0, 7)],
    'T': [(0, 0), (7, 0), (7, 4), (5.2, 4), (5.2, 6), (2.2, 6), (2.2, 4), (0, 4)],
    'U': [(0, 0), (3, 0), (3, 3), (5, 3), (5, 0), (8, 0), (8, 6), (0, 6)],
    'H': [(0, 0), (2, 0), (2, 3), (5, 3), (5, 0), (7, 0), (7, 8), (5, 8), (5, 5.8), (2, 5.8),
          (2, 8), (0, 8)],
    'star': [(0, 0), (3, 1), (6, 0), (5, 3), (6, 6), (3, 5), (0, 6), (1, 3)],
    'triangle': [(0, 0), (5, 0), (1.5, 4)],
    'kite': [(0, 0), (7, 1), (6, 5), (-1, 4.2)],
    'bend': [(0, 0), (5, 0), (8.5, 3.5), (5.7, 6.3), (3.35, 4), (0, 4)],
    'apse': [(0, 0), (6, 0), (7.5, 1), (8, 2.5), (7.5, 4), (6, 5), (0, 5)],
    'octagon': [(1.2, 0), (3.4, 0), (4.6, 1.2), (4.6, 3.4), (3.4, 4.6), (1.2, 4.6), (0, 3.4),
                (0, 1.2)],
}


def built(plan, roof, turn=0.0, height=0.6, layout='running'):
    """Build walls on a plan, turned by an angle [rad], with a roof."""
    c, s = np.cos(turn), np.sin(turn)
    points = np.array(PLANS[plan] if isinstance(plan, str) else plan) @ np.array([[c, s], [-s, c]])
    footprint = ' '.join(f'({x:.9f}, {y:.9f})' for x, y in points)
    return WallGrammar.parse(TEXT.format(footprint=footprint, roof=roof, height=height,
                                         layout=layout)).build(), points


def drawn_plan(rng):
    """Draw a right-angled plan without holes: cells of a grid, each beside an earlier one."""
    while True:
        cells = {(0, 0)}
        for _ in range(rng.integers(0, 7)):
            x, y = sorted(cells)[rng.integers(len(cells))]
            cells.add(((x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1))[rng.integers(4)])
        sides = [((x, y), (x + 1, y), (x, y - 1)) for x, y in cells]
        sides += [((x + 1, y), (x + 1, y + 1), (x + 1, y)) for x, y in cells]
        sides += [((x + 1, y + 1), (x, y + 1), (x, y + 1)) for x, y in cells]
        sides += [((x, y + 1), (x, y), (x - 1, y)) for x, y in cells]
        ahead = {start: end for start, end, other in sides if other not in cells}
        first = min(ahead)
        path = [first]
        while ahead[path[-1]] != first:
            path.append(ahead[path[-1]])
        if len(path) == len(ahead) == sum(other not in cells for *_, other in sides):
            break  # else there is a hole, or cells that touch at a corner
    lines = np.cumsum(rng.choice([1.5, 2.0, 2.4, 3.1], (2, 20)), axis=1)
    points = np.array([(lines[0, x + 8], lines[1, y + 8]) for x, y in path])
    edges = np.roll(points, -1, axis=0) - points
    return points[np.roll(edges, 1, axis=0)[:, 0] * edges[:, 1]
                  != np.roll(edges, 1, axis=0)[:, 1] * edges[:, 0]]


def drawn_outline(rng):
    """Draw a plan without right angles: corners around a middle, or two wings that meet aslant."""
    if rng.integers(2):
        n = rng.integers(4, 8)
        turn = (np.arange(n) + rng.uniform(-0.2, 0.2, n)) * 2.0 * np.pi / n
        return np.column_stack([np.cos(turn), np.sin(turn)]) * rng.uniform(2.5, 4.5, (n, 1))
    wide, turn, (first, second) = rng.uniform(3, 4), rng.uniform(0.3, 1.2), rng.uniform(4, 6, 2)
    along = np.array([np.cos(turn), np.sin(turn)])
    aside, bend = wide * np.array([-along[1], along[0]]), np.array([first, 0.0])
    inner = np.array([first - wide * np.tan(0.5 * turn), wide])
    return np.array([(0, 0), bend, bend + second * along, bend + second * along + aside, inner,
                     (0, wide)])


def inside(points, polygon):
    """Mark the points in a polygon."""
    found = np.zeros(len(points), bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0)):
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        with np.errstate(divide='ignore', invalid='ignore'):
            found ^= crosses & (points[:, 0] < a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / (
                b[1] - a[1]))
    return found


def wet(blueprint, points):
    """Drop rain: mark the points, (n, 2), that no tile covers."""
    corners = corners_of(blueprint)[rows_of(blueprint, 'tile')]
    dry = np.zeros(len(points), bool)
    _, every_normal, every_middle = faces(corners)
    for flat, normals, middles in zip(corners[:, :, :2], every_normal, every_middle):
        near = np.flatnonzero(~dry & (points > flat.min(axis=0)).all(axis=1)
                              & (points < flat.max(axis=0)).all(axis=1))
        distance = (middles * normals).sum(axis=1) - points[near] @ normals[:, :2].T
        rise = normals[:, 2]
        with np.errstate(divide='ignore', invalid='ignore'):
            level = distance / rise
        ceiling = np.where(rise > 1e-9, level, np.inf).min(axis=1)
        floor = np.where(rise < -1e-9, level, -np.inf).max(axis=1)
        beside = ((np.abs(rise) <= 1e-9) & (distance < 0.0)).any(axis=1)
        dry[near[(floor < ceiling) & ~beside]] = True
    return ~dry


def rows_of(blueprint, kind):
    """Return the parts of a kind."""
    return np.flatnonzero(blueprint.kind == blueprint.kinds.index(kind))


def open_share(blueprint, points):
    """Rain on a plan: return the share of drops that no tile stops."""
    drops = np.random.default_rng(0).uniform(points.min(axis=0), points.max(axis=0), (2500, 2))
    return wet(blueprint, drops[inside(drops, points)]).mean()


def area(points):
    """Compute the area of a polygon."""
    after = np.roll(points, -1, axis=0)
    return 0.5 * (points[:, 0] * after[:, 1] - after[:, 0] * points[:, 1]).sum()


def outlines(plan, overhang):
    """Return the trapezia of all faces of a roof plan in its own coordinates, (4, 2) each."""
    return [plan.points[plane] + np.array(
        [(strip.start, strip.foot[0]), (strip.end, strip.foot[1]), (strip.end, strip.head[1]),
         (strip.start, strip.head[0])]) @ np.array([plan.ways[plane], plan.normals[plane]])
        for plane in set(plan.plane[plan.eaves]) for strip in plan.strips(plane, overhang)]


def test_faces_cover_every_plan_once():
    """Compare the area of all faces with that of the plan and its eaves; cover each point once."""
    rng, overhang = np.random.default_rng(0), 0.25
    for points in [*map(np.array, PLANS.values()), *(drawn_plan(rng) for _ in range(40))]:
        plan = RoofPlan(points.astype(float))
        pieces, whole = outlines(plan, overhang), plan.outline(plan.edges, -overhang)[0]
        assert min(map(area, pieces)) > -1e-6
        assert sum(map(area, pieces)) == pytest.approx(area(whole), rel=1e-6)
        drops = rng.uniform(whole.min(axis=0), whole.max(axis=0), (200, 2))
        times = sum(inside(drops, piece).astype(int) for piece in pieces)
        np.testing.assert_array_equal(times, inside(drops, whole))


def test_plans_off_the_square_end_in_a_roof_or_a_refusal():
    """Turn plans, and round them to 0.1 mm: parallels are none, and changes come in bunches."""
    rng, roofs = np.random.default_rng(5), 0
    for _ in range(100):
        points, turn = drawn_plan(rng), rng.uniform(-np.pi, np.pi)
        turned = points @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        try:
            roofs += bool(RoofPlan(np.round(turned, 4)).arcs)
        except NoRoofError:
            pass
    assert roofs > 50


def test_lines_of_an_l():
    """Count hips, valleys and ridges over an L under hips and between gables, all of one pitch."""
    points = np.array(PLANS['L'], float)
    for gables, hips in ((frozenset(), 5), (frozenset((1, 4)), 1)):
        arcs = RoofPlan(points, gables).arcs
        assert [arc.low == arc.high for arc in arcs].count(True) == 2
        assert [arc.valley for arc in arcs].count(True) == 1 and len(arcs) == hips + 3
        assert max(arc.high for arc in arcs) == pytest.approx(2.0)


_JOINTS = 0.002 * (1.0 / 0.40 + 1.0 / 0.25)  # of the plan: joints of 2 mm between tiles


@pytest.mark.parametrize(('plan', 'roof', 'turn'), [
    ('rectangle', 'gable(10)', 0.5 * np.pi), ('rectangle', 'hip(10)', 0.0),
    ([(0, 0), (5, 0), (5, 3), (0, 3)], 'hip(70)', 0.0), ('square', 'hip(50)', 0.0),
    ('L', 'gable(20)', 0.5),
    ('L', 'hip(40)', 0.5), ('T', 'gable(60)', 0.5 * np.pi), ('U', 'hip(30)', 2.0),
    ('H', 'gable(45)', 0.0), ('star', 'hip(40)', 0.0), ('triangle', 'hip(55)', 0.3),
    ('kite', 'hip(20)', 0.0), ('bend', 'hip(50)', 0.0), ('apse', 'gable(35)', 0.5),
    ('octagon', 'hip(45)', 0.0), ('rectangle', 'lean_to(5)', 0.5 * np.pi),
    ('square', 'lean_to(33)', 0.5), ('rectangle', 'lean_to(60)', 0.0)])
def test_roofs_are_sound(plan, roof, turn):
    """Bond all parts, let none overlap, and no rain in but through the joints of tiles."""
    house, points = built(plan, roof, turn)
    assert count_loose(house) == 0
    assert len(np.unique(np.sort(house.bonds, axis=1), axis=0)) == len(house.bonds)
    assert deepest_overlap(house) < OVERLAP
    assert open_share(house, points) < _JOINTS


@pytest.mark.parametrize('seed', range(4))
def test_roofs_over_drawn_plans_are_sound(seed):
    """Roof plans of many corners, of all pitches and turned: sound, and they bear themselves."""
    rng = np.random.default_rng(seed)
    while True:
        roof = f'{("hip", "gable")[seed % 4 == 1]}({rng.integers(15, 60)})'
        plan = drawn_outline(rng) if seed % 2 == 0 else drawn_plan(rng)
        try:
            house, points = built(plan, roof, rng.uniform(0.0, 6.0), layout='english')
            break
        except GrammarError as error:  # draw again
            assert 'roof meet near' in str(error) or 'too low to stand' in str(error)
    assert count_loose(house) == 0
    assert deepest_overlap(house) < OVERLAP
    assert open_share(house, points) < _JOINTS
    assert not standing(house).warnings


@pytest.mark.parametrize('plan', ['rectangle', 'square', 'kite', 'bend'])
def test_ties_hold_flat_hips_together(plan):
    """Crack no half-brick wall by the thrust of a flat hip roof: ties that cross hold, too."""
    assert not standing(built(plan, 'hip(25)', height=1.0)[0]).warnings


@pytest.mark.parametrize('layout', ['running', 'english'])
@pytest.mark.parametrize(('span', 'pitch'), [(2, 10), (2, 60), (6, 5), (6, 25), (6, 45)])
def test_lean_tos_bear_themselves(span, pitch, layout):
    """Crack no wall by rafters that bend between the walls they lie on; let none meet a wall."""
    plan = [(0, 0), (span + 1, 0), (span + 1, span), (0, span)]
    shed = built(plan, f'lean_to({pitch})', height=2.0, layout=layout)[0]
    assert count_loose(shed) == 0 and deepest_overlap(shed) < OVERLAP
    assert not standing(shed).warnings


@pytest.mark.parametrize('turn', [0.0, 0.7])
def test_lean_tos_fall_to_their_first_edge(turn):
    """Seat each rafter at both ends, on walls of full height that interlock in each course."""
    shed, points = built('rectangle', 'lean_to(30)', turn)
    ahead, inwards = ((points[k] - points[0]) / np.linalg.norm(points[k] - points[0])
                      for k in (1, 3))
    rise = 0.6 + 0.075 + 5.0 * np.tan(np.radians(30.0))
    top = {kind: shed.poses[rows_of(shed, kind), 2].max() for kind in ('tile', 'ridge', 'brick')}
    assert rise < top['tile'] < rise + 0.5 and rise - 0.2 < top['ridge'] < rise + 0.3
    tiles = shed.poses[rows_of(shed, 'tile')]
    level = tiles[:, 2] - tiles[:, :2] @ inwards * np.tan(np.radians(30.0))
    assert np.ptp(level) < 0.05
    kinds = np.array(shed.kinds)[shed.kind][shed.bonds]
    seats = (kinds[:, 0] == 'plate') & (kinds[:, 1] == 'rafter')
    place = shed.bond_frame[seats, :2] @ inwards
    assert (place < 0.1).sum() == (place > 4.8).sum() == seats.sum() // 2 > 12
    bricks = shed.poses[rows_of(shed, 'brick')]
    along_head = np.abs(rotation.rotate(bricks[:, 3:], np.array([1.0, 0.0, 0.0]))[:, :2]
                        @ ahead) > 0.5
    for corner in points[2:]:
        away = np.hypot(*(bricks[:, :2] - corner).T)
        owners = []
        for level in np.arange(0.6 + 0.0425, rise - 0.3, 0.075):
            course = np.flatnonzero(np.abs(bricks[:, 2] - level) < 1e-5)
            owners.append(int(along_head[course[np.argmin(away[course])]]))
        assert len(owners) > 30 and (np.abs(np.diff(owners)) == 1).all()


def test_valleys_let_nothing_in():
    """Rain along the valley of an L, 6 cm to both sides of it; without cut tiles it is open."""
    house, _ = built('L', 'hip(40)')
    generator = np.random.default_rng(1)
    drops = np.array([4.0, 4.0]) - generator.uniform(0.05, 1.95, (4000, 1))
    near = drops + generator.uniform(-0.06, 0.06, (4000, 1)) * [1.0, 0.0]
    assert wet(house, near).mean() < 0.002 / 0.12 + 0.02
    poses = house.poses.copy()
    poses[house.hexahedra.part, 0] += 100.0
    assert wet(type(house)(**{**vars(house), 'poses': poses}), drops).mean() > 0.5


@pytest.mark.parametrize('roof', ['hip(40)', 'gable(40)'])
def test_an_l_bears_its_roof_until_a_wall_is_gone(roof):
    """Stand on one-brick walls without a crack in these; come down once one wall is left."""
    plan = [(0, 0), (4, 0), (4, 2.6), (2.6, 2.6), (2.6, 4.2), (0, 4.2)]
    house = built(plan, roof, layout='english')[0]
    found = Fracture(StressSolver(BondGraph(house)))
    found.advance(20_000)
    graph = found.solver.graph
    bricks, tiles = rows_of(house, 'brick'), rows_of(house, 'tile')
    masonry = np.isin(house.bonds, bricks).any(axis=1)
    assert found.stable and found.solver.supported.all()
    assert graph.alive[masonry].all() and not graph.cracked[masonry].any()
    found.solver.cut(graph.neighbours(bricks[house.poses[bricks, 1] > 0.3]))
    found.advance(20_000)
    assert not found.solver.supported[tiles].any()


def test_tiles_hang_on_their_battens_by_single_nails():
    """Pull off tiles, whole and cut ones: each nail holds 0.3 kN (EN 1995-1-1)."""
    house, _ = built('L', 'gable(40)')
    tile, batten = (house.kind == house.kinds.index(name) for name in ('tile', 'batten'))
    pair = house.bonds
    nail = ((tile[pair].any(axis=1) & batten[pair].any(axis=1)) & (pair >= 0).all(axis=1))
    cut = np.isin(pair, house.hexahedra.part).any(axis=1)
    holds = house.bond_area * house.mortar.tension
    for some in (nail & cut, nail & ~cut):
        assert some.sum() > 50
        np.testing.assert_allclose(np.median(holds[some]), 300.0)
        assert holds[some].max() < 300.1


def test_boards_cover_the_steps_of_gables():
    """Put the outer end of every course of a gable behind the boards along the verge."""
    blueprint, _ = built('rectangle', 'gable(40)')
    verges, bricks = rows_of(blueprint, 'verge'), rows_of(blueprint, 'brick')
    assert (np.abs(blueprint.poses[verges, 0] - 4.0) > 4.0).all()  # in front of the walls
    slope = np.tan(np.radians(40.0))
    half = 0.5 * blueprint.size[verges[0], 2] / np.cos(np.radians(40.0))
    peak = (blueprint.poses[verges, 2] + slope * np.abs(blueprint.poses[verges, 1] - 2.5)).mean()
    gable = bricks[(blueprint.poses[bricks, 0] < 0.1) & (blueprint.poses[bricks, 2] > 0.8)]
    places = blueprint.poses[gable]
    for level in np.unique(places[:, 2].round(6)):
        course = np.abs(places[:, 2] - level) < 1e-5
        reach = (np.abs(places[course, 1] - 2.5) + 0.5 * blueprint.size[gable[course], 0]).max()
        line = peak - slope * reach
        assert line - half < level - 0.0325 and level + 0.0325 < line + half


@pytest.mark.parametrize(('plan', 'roof', 'turn'), [
    ('rectangle', 'gable(40)', 0.5), ('rectangle', 'hip(40)', 0.5 * np.pi), ('T', 'hip(40)', 0.0)])
def test_seats_lie_across_what_they_bear(plan, roof, turn):
    """Let seats on plates be as wide as what they bear, and as long as plates, on all sides."""
    house, _ = built(plan, roof, turn)
    kinds = np.array(house.kinds)[house.kind][house.bonds]
    seats = np.flatnonzero((kinds[:, 0] == 'plate')
                           & np.isin(kinds[:, 1], ('rafter', 'hip', 'valley')))
    assert len(seats) >= 2 * 14
    across = rotation.rotate(house.bond_frame[seats, 3:], np.array([1.0, 0.0, 0.0]))
    length = rotation.rotate(house.poses[house.bonds[seats, 1], 3:], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose((across * length).sum(axis=1), 0.0, atol=1e-9)
    wide = np.where(kinds[seats, 1] == 'rafter', 0.05, 0.075)
    np.testing.assert_allclose(house.bond_extent[seats, 0], wide)


@pytest.mark.parametrize(('plan', 'roof', 'message'), [
    ([(0, 0), (5, 0), (5.3, 2.5), (4.2, 4.6), (1.5, 5), (-0.3, 3)], 'hip(40)', 'roof meet near'),
    ('kite', 'gable(40)', 'between two right angles'),
    ('kite', 'lean_to(40)', '<text>:6:9: a lean-to needs a footprint of four corners, all of them '
     'right angles'), ('L', 'lean_to(40)', 'use hip or gable here'),
    ('square', 'lean_to(61)', 'the number of "lean_to" must be from 5 to 60, found 61'),
    ([(0, 0), (3, 0), (3, 3), (3.6, 3), (3.6, 0), (7, 0), (7, 6), (0, 6)], 'hip(40)',
     'meet each other there; leave more room between the wings'),
    ([(0, 0), (3, 0), (3, 0.8), (0, 0.8)], 'hip(15)', 'too low to stand')])
def test_plans_without_room_for_a_roof_are_refused(plan, roof, message):
    """Say what was found and what is allowed."""
    with pytest.raises(GrammarError) as refused:
        built(plan, roof)
    assert message in str(refused.value)
