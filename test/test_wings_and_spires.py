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

"""Test piers, wings, spires and pyramids: their volume, their bond, and what is refused."""

from building_checks import are_convex, count_loose, deepest_overlap, OVERLAP, standing
import numpy as np
import pytest
from scipy.spatial import cKDTree

from procphys_ros.errors import GrammarError
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import faces
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.wallgrammar import WallGrammar
from procphys_ros.wallgrammar.polygons import meet

PIER = """
building b
  footprint: {footprint}
  facades: front plain
  storey_height: {height}
  {extra}
rule front -> split(x) {{ {room}: wall | 0.44: pier | ~1: wall }}
rule pier -> split(y) {{ {top}: extrude({out}) {{ thick }} | ~1: wall }}
rule plain -> wall
layout running {{ unit: 0.215 0.1025 0.065  joint: {joint}  material: brick }}
layout {thick}  joint: {joint}  material: brick }}
panel wall: running
panel thick: pier
"""
FREE, SQUARE = '(0, 0) (3, 0)', '(0, 0) (3, 0) (3, 3) (0, 3)'
ENGLISH = 'pier { bond: english  unit: 0.215 0.1025 0.065'
BLOCKS = 'pier { bond: running  unit: 0.44 0.33 0.065'
SPIRE = """
building b
  footprint: {footprint}
  facades: wall
  storey_height: 0.6
  roof: spire({pitch})
layout stone {{ bond: running  unit: 0.6 0.3 {height}  joint: {joint}  material: brick }}
panel wall: stone
"""
OCTAGON = ' '.join(f'({2.5 * np.cos(a):.6f}, {2.5 * np.sin(a):.6f})'
                   for a in 0.3 + np.arange(8) * np.pi / 4)
WINGS = """
building hall
  footprint: (0, 0) (5, 0) (5, 4) (0, 4)
  facades: wall
  storey_height: 2
  roof: gable(45)
wing tower
  footprint: {footprint}
  facades: wall
  storey_height: {height}
  roof: {roof}
layout stone {{ bond: running  unit: 0.6 0.3 0.19  material: brick }}
panel wall: stone
"""


def pier(footprint=FREE, thick=ENGLISH, out=0.1125, height=1.8, top=1.35, room=1.0, joint=0.01,
         extra=''):
    """Build a wall of half a brick with a pier."""
    return WallGrammar.parse(PIER.format(
        footprint=footprint, thick=thick, out=out, height=height, top=top, room=room, joint=joint,
        extra=extra)).build()


def holds(blueprint):
    """Return whether nothing cracks or falls under its own weight."""
    found = Fracture(StressSolver(BondGraph(blueprint)))
    found.advance(20_000)
    return bool(found.stable and found.solver.supported.all() and found.solver.graph.alive.all())


@pytest.mark.parametrize('thick', [ENGLISH, BLOCKS])
@pytest.mark.parametrize('out', [0.0, 0.05])
@pytest.mark.parametrize('footprint', [FREE, SQUARE])
def test_piers_are_sound(footprint, thick, out):
    """Let a pier stand out in front, behind, and on both sides: no overlap, nothing loose."""
    wall = pier(footprint, thick, out)
    assert count_loose(wall) == 0 and deepest_overlap(wall) < OVERLAP


def test_a_pier_adds_what_stands_out():
    """Compare volumes, without joints, with and without a pier: all of it is filled."""
    thick = 'pier { bond: running  unit: 0.44 0.33 0.075'
    text = PIER.replace('0.065  joint', '0.075  joint')
    wall = WallGrammar.parse(text.format(footprint=FREE, thick=thick, out=0.1, height=1.8,
                                         top=1.35, room=1.0, joint=0, extra='')).build()
    assert wall.mass.sum() / 1900.0 == pytest.approx(
        3.0 * 1.8 * 0.1025 + 0.44 * 1.35 * (0.33 - 0.1025), rel=1e-9)


def test_every_other_course_of_the_wall_runs_on_through_its_pier():
    """Find bricks that cross the sides of the pier in all even courses, headers in all odd."""
    wall = pier()
    x, y, z = wall.poses[:, :3].T
    turn = np.abs(2.0 * np.arctan2(wall.poses[:, 5], wall.poses[:, 6])) % np.pi
    half = 0.5 * np.where(np.abs(turn - 0.5 * np.pi) < 0.1, wall.size[:, 1], wall.size[:, 0])
    course = np.round((z - 0.0425) / 0.075).astype(int)
    low = course < 18
    crossing = low & (((x - half < 0.99) & (x + half > 1.01))
                      | ((x - half < 1.43) & (x + half > 1.45)))
    assert set(course[crossing].tolist()) == set(range(0, 18, 2))
    across = low & (np.abs(turn - 0.5 * np.pi) < 0.1) & (np.abs(y + 0.005) < 1e-3)
    assert set(course[across].tolist()) == set(range(1, 18, 2))


def test_piers_stiffen_a_wall():
    """Push walls of 1.4 by 1.8 m: the tension in their joints is lower with a pier."""
    highest = []
    for top in (1.35, 0.0):
        wall = pier('(0, 0) (1.4, 0)', top=max(top, 0.075), room=0.48)
        force = np.zeros((len(wall), 3))
        force[:, 1] = 0.5 * wall.mass
        solver = StressSolver(BondGraph(wall))
        solver.set_loads(force)
        solver.iterate(20_000)
        highest.append(solver.utilisation()[0].max())
    assert highest[0] < 0.7 * highest[1]


def closed_form(side, shell, pitch, gauge):
    """Compute the volume of a square spire without joints [m³]: hollow up to where it is solid."""
    reach = 0.5 * side
    height = reach * np.tan(np.radians(pitch))
    tops = np.arange(gauge, height - 0.5 * gauge, gauge)
    solid = next(top for top in tops if reach * (1.0 - top / height) - shell < 0.4 * shell) - gauge
    wide, narrow = reach - shell, reach * (1.0 - solid / height) - shell
    hollow = 4.0 * solid * (wide ** 2 + wide * narrow + narrow ** 2) / 3.0
    return 4.0 * reach ** 2 * height / 3.0 - hollow


@pytest.mark.parametrize(('side', 'pitch'), [(4.0, 75.0), (3.0, 65.0)])
def test_the_volume_of_a_spire_is_that_of_its_shell(side, pitch):
    """Add up the stones of a spire without joints."""
    plan = f'(0, 0) ({side}, 0) ({side}, {side}) (0, {side})'
    spire = WallGrammar.parse(SPIRE.format(footprint=plan, pitch=pitch, height=0.3,
                                           joint=0)).build()
    stone = np.array(spire.kinds)[spire.kind] == 'spire'
    volume = (spire.mass / spire.density)[stone].sum()
    assert volume == pytest.approx(closed_form(side, 0.3, pitch, 0.3), rel=1e-9)
    assert spire.hexahedra.points(spire.poses)[..., 2].max() == pytest.approx(
        0.6 + 0.5 * side * np.tan(np.radians(pitch)))


@pytest.mark.parametrize('footprint', [SQUARE, OCTAGON])
def test_joints_of_cut_stones_are_as_large_as_their_faces_overlap(footprint):
    """Compare the areas of joints with the polygons in which faces overlap."""
    spire = WallGrammar.parse(SPIRE.format(footprint=footprint, pitch=70, height=0.3,
                                           joint=0.01)).build()
    stones = spire.hexahedra.points(spire.poses)
    found = meet(stones, np.ones(len(stones), bool), 0.02)
    touching = {(*sorted(spire.hexahedra.part[pair].tolist()),): area
                for pair, area in zip(found.pair, found.area) if (pair >= 0).all()}
    rows = [k for k, pair in enumerate(spire.bonds.tolist()) if (*sorted(pair),) in touching]
    areas = [touching[(*sorted(spire.bonds[k].tolist()),)] for k in rows]
    np.testing.assert_allclose(spire.bond_area[rows], areas, rtol=1e-6)
    sides = spire.bond_extent[rows].prod(axis=1)  # of rectangles with the same second moments
    assert len(rows) > 100 and (sides > 1.001 * spire.bond_area[rows]).any()


def inside(points, corners):
    """Count for each point the hexahedra, (N, 8, 3), that it lies inside of."""
    _, normals, middles = faces(corners)
    count, centres = np.zeros(len(points), int), corners.mean(axis=1)
    reach = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    near = cKDTree(points).query_ball_point(centres, reach)
    for normal, middle, some in zip(normals, middles, near):
        beyond = points[some] @ normal.T - (normal * middle).sum(axis=1)
        count[some] += (beyond < -1e-9).all(axis=1)
    return count


def polygon(count, reach=2.5):
    """Format the corners of a regular polygon."""
    return ' '.join(f'({reach * np.cos(a):.6f}, {reach * np.sin(a):.6f})'
                    for a in 0.3 + np.arange(count) * 2.0 * np.pi / count)


@pytest.mark.parametrize(('footprint', 'pitch'), [
    (SQUARE, 82), (OCTAGON, 70), ('(0, 0) (3, 0) (4.2, 2.1) (1.5, 4) (-1, 2)', 70),
    *zip(map(polygon, (7, 24)), (65, 75))])
def test_spires_are_sound(footprint, pitch):
    """Drop points into spires on squares and polygons: none lies in two stones; all are bonded."""
    spire = WallGrammar.parse(SPIRE.format(footprint=footprint, pitch=pitch, height=0.29,
                                           joint=0.01)).build()
    corners = spire.hexahedra.corners.reshape(-1, 8, 3)
    assert are_convex(corners).all() and count_loose(spire) == 0
    points = spire.hexahedra.points(spire.poses)
    samples = np.random.default_rng(0).uniform(points.min(axis=(0, 1)), points.max(axis=(0, 1)),
                                               (20_000, 3))
    found = inside(samples, points)
    assert found.max() == 1 and found.sum() > 300
    assert holds(spire)


def test_spires_are_the_same_whichever_way_they_are_turned(count=6):
    """Choose the corners of solid courses and caps alike, also where two are as near."""
    places = []
    for turn in (0.0, 0.6, 1.1):
        angles = turn + 2.0 * np.pi * np.arange(count) / count
        plan = ' '.join(f'({2 * np.cos(a):.9f}, {2 * np.sin(a):.9f})' for a in angles)
        built = WallGrammar.parse(SPIRE.format(footprint=plan, pitch=76, height=0.19,
                                               joint=0.01)).build().placed((0, 0, 0), -turn)
        places.append(built.poses[built.kind == built.kinds.index('spire'), :3])
    for other in places[1:]:
        assert cKDTree(places[0]).query(other)[0].max() < 1e-4


@pytest.mark.parametrize('seed', range(2))
def test_any_regular_spire_is_built_or_said_to_be_impossible(seed):
    """Draw plans of 4 to 32 sides, pitches, stones and joints: no stone hangs in the air."""
    rng = np.random.default_rng(seed)
    text = SPIRE.replace('unit: 0.6 0.3', f'unit: 0.2 {rng.uniform(0.05, 0.2):.3f}').format(
        footprint=polygon(int(rng.integers(4, 33)), rng.uniform(1.5, 2.0)),
        pitch=rng.uniform(66.0, 80.0), height=f'{rng.uniform(0.1, 0.2):.3f}',
        joint=rng.uniform(0.0, 0.015))
    try:
        assert count_loose(WallGrammar.parse(text).build()) == 0
    except GrammarError as error:
        assert 'hang in the air' not in error.message


@pytest.mark.parametrize(('footprint', 'roof'), [
    ('(-2, 1) (0, 1) (0, 3) (-2, 3)', 'spire(75)'), ('(5, 0) (7, 0) (7, 4) (5, 4)', 'hip(50)'),
    ('(-1, 1.5) (0, 1.5) (0, 2.5) (-1, 2.5)', 'none')])
def test_wings_are_bonded_to_the_building(footprint, roof):
    """Build towers and a chimney against gables: verges end beside them, walls are bonded."""
    church = WallGrammar.parse(WINGS.format(footprint=footprint, height=6, roof=roof)).build()
    poses = church.poses.copy()
    poses[church.hexahedra.part, 0] += 100.0 * np.arange(1, len(church.hexahedra.part) + 1)
    boxes = type(church)(**{**vars(church), 'poses': poses})
    assert count_loose(church) == 0 and deepest_overlap(boxes) < OVERLAP
    x = church.poses[:, 0]
    side = 5.0 if footprint.startswith('(5') else 0.0
    joined = np.abs(church.bond_frame[:, 0] - side) < 1e-6
    first, second = church.bonds[joined].T
    assert joined.sum() > 20 and ((x[first] - side) * (x[second] - side) < 0.0).all()


@pytest.mark.parametrize(('corners', 'along'), [
    ('(8, 0) (11, 0) (11, 5) (8, 5)', 0), ('(11, 0) (11, 5) (8, 5) (8, 0)', 1)])
def test_the_ridge_of_a_wing_runs_along_its_first_edge(corners, along):
    """Turn the roof of a wing by the order of its corners."""
    built = WallGrammar.parse(WINGS.format(footprint=corners, height=2, roof='gable(45)')).build()
    ridges = np.flatnonzero(built.kind == built.kinds.index('ridge'))
    ridges = ridges[built.poses[ridges, 0] > 6.0]
    ways = rotation.rotate(built.poses[ridges, 3:], np.array([1.0, 0.0, 0.0]))
    assert (np.argmax(np.abs(ways), axis=1) == along).all()
    assert count_loose(built) == 0 and deepest_overlap(built) < OVERLAP


@pytest.mark.parametrize(('footprint', 'height', 'roof'), [
    ('(3, -2) (3, 0) (1, 0) (1, -2)', 0.6, 'gable(20)'), ('(3, -2) (3, 0) (1, 0) (1, -2)', 0.2,
                                                          'spire(75)'),
    ('(1, -2) (3, -2) (3, -0.41) (1, -0.41)', 6, 'none')])
def test_wings_below_and_beside_eaves_keep_clear_of_them(footprint, height, roof):
    """Build what is lower than eaves with its roof, or stands off them, without an overlap."""
    built = WallGrammar.parse(WINGS.format(footprint=footprint, height=height, roof=roof)).build()
    assert count_loose(built) == 0 and deepest_overlap(built) < OVERLAP


@pytest.mark.parametrize(('footprint', 'height'), [
    ('(0, -1.2) (5, -1.2) (5, 0) (0, 0)', 0.6), ('(7, 0) (7, 4) (5, 4) (5, 0)', 1.9),
    ('(7, 1) (7, 3) (5, 3) (5, 1)', 3.0), ('(5, 0.5) (7, 0.5) (7, 3) (5, 3)', 1.2)])
def test_lean_tos_stand_against_eaves_and_gables(footprint, height):
    """Build an aisle below eaves, and sheds against a gable, low, high and sidewise."""
    built = WallGrammar.parse(WINGS.format(footprint=footprint, height=height,
                                           roof='lean_to(25)')).build()
    assert count_loose(built) == 0 and deepest_overlap(built) < OVERLAP
    assert not standing(built).warnings
    kinds = np.array(built.kinds)[built.kind][built.bonds]
    axis, side = (1, 0.0) if footprint.startswith('(0') else (0, 5.0)
    between = (kinds == 'brick').all(axis=1) & (
        np.abs(built.bond_frame[:, axis] - side) < 1e-6)
    assert built.bond_frame[between, 2].max() > height + 0.2  # above the low wall, too


@pytest.mark.parametrize(('text', 'message'), [
    (PIER.format(footprint=FREE, thick=ENGLISH, out=0.2, height=1.8, top=1.35, room=1, joint=0.01,
                 extra=''), 'extrude it by 0 to 0.1125 m'),
    (PIER.format(footprint=FREE, thick=ENGLISH, out=0.01, height=1.8, top=1.35, room=1,
                 joint=0.01, extra=''), 'leave it flush, or let it stand out by at least 0.025 m'),
    (PIER.format(footprint=SQUARE, thick=ENGLISH, out=0, height=1.8, top=1.35, room=0.15,
                 joint=0.01, extra=''), 'leave at least 0.215 m of wall'),
    (PIER.format(footprint=SQUARE, thick=ENGLISH, out=0.1125, height=1.8, top=1.75, room=1,
                 joint=0.01, extra='roof: hip(40)'), 'end the piers below 1.56 m'),
    (PIER.format(footprint=SQUARE, thick=ENGLISH, out=0, height=1.8, top=1.35, room=1,
                 joint=0.01, extra='floors: timber'), 'stands out inside'),
    (SPIRE.format(footprint=SQUARE, pitch=40, height=0.3, joint=0), 'must be from 50 to 85'),
    (SPIRE.format(footprint='(0, 0) (4, 0) (4, 4) (2, 1) (0, 4)', pitch=70, height=0.3, joint=0),
     'a spire needs a convex plan'),
    (WINGS.format(footprint='(-1, 1) (1, 1) (1, 3) (-1, 3)', height=6, roof='none'),
     'the plans of "tower" and "hall" overlap'),
    (WINGS.format(footprint='(1, -2) (3, -2) (3, 0) (1, 0)', height=6, roof='none'),
     '"tower" stands there; build it against a gable'),
    (WINGS.format(footprint='(3, -2) (3, 0) (1, 0) (1, -2)', height=1.4, roof='gable(45)'),
     '"tower" stands there; build it against a gable'),
    (WINGS.format(footprint='(3, -2) (3, 0) (1, 0) (1, -2)', height=1.4, roof='spire(80)'),
     '"tower" stands there; build it against a gable'),
    (WINGS.format(footprint='(1, -2) (3, -2) (3, 0) (1, 0)', height=0.9, roof='lean_to(30)'),
     '"tower" stands there; build it against a gable, or keep it below 1.72 m'),
    (WINGS.format(footprint='(5, 3) (5, 1) (7, 1) (7, 3)', height=1, roof='lean_to(30)'),
     '"hall" stands there; build it against a gable'),
    (WINGS.format(footprint='(1, -2) (3, -2) (3, -0.3) (1, -0.3)', height=6, roof='none'),
     'reach 0.40 m out of its walls, and "tower" stands there'),
    (WINGS.format(footprint='(1, -2) (3, -2) (3, 0) (1, 0)', height=6, roof='none').replace(
        '(0, 4)\n  facades: wall\n', '(0, 4)\n'), 'the building needs "facades:"'),
    (WINGS.format(footprint='(-2, 1) (0, 1) (0, 3) (-2, 3)', height=6, roof='none').replace(
        'tower\n', 'tower(size = 3)\n'), 'expected'),
])
def test_what_no_mason_builds_is_refused(text, message):
    """Name file, line and what is allowed."""
    with pytest.raises(GrammarError) as caught:
        WallGrammar.parse(text, 'bad.wall').build()
    assert message in caught.value.message and caught.value.line, str(caught.value)


def test_rubble_is_irregular_and_fills_its_wall():
    """Draw other stones for other seeds; no gaps within but for rough faces; dry, it stands."""
    grammar = WallGrammar.load(shared_folder() / 'grammars' / 'dry_stone.wall')
    first, other = grammar.build(seed=1, length=4.0), grammar.build(seed=2, length=4.0)
    assert count_loose(first) == 0 and deepest_overlap(first) < OVERLAP
    lengths = first.size[:, 0]
    assert np.ptp(lengths) > 0.2 and len(np.unique(lengths.round(4))) > 0.5 * len(first)
    assert len(first) != len(other) or not np.allclose(first.size, other.size)
    volume = (first.mass / first.density).sum()
    solid = 4.0 * (0.30 * 0.64 + 0.45 * 0.54 + 0.45 * 0.44 + 0.15 * 0.52)
    assert 0.92 * solid < volume < solid
    found = Fracture(StressSolver(BondGraph(first)))
    found.advance(20_000)
    assert found.stable and found.solver.supported.all()
    assert found.solver.graph.alive.all()


def test_stones_of_rubble_break_the_joints_below():
    """Keep upright joints off those of the course below, more than chance would."""
    layout = WallGrammar.parse(SPIRE.format(
        footprint=SQUARE, pitch=70, height=0.15, joint=0).replace('running', 'rubble'))
    courses = layout.layouts['stone'].courses(np.random.default_rng(3), 20_000_000, 20)
    places = [np.cumsum(course.widths) for course in courses]
    apart = np.concatenate([np.abs(a[:, None] - b).min(axis=1)
                            for a, b in zip(places, places[1:])])
    assert np.mean(apart < 50_000) < 0.05  # by chance a sixth: 0.1 m of each 0.6 m


@pytest.mark.parametrize('plan, wing', [
    ('(0, 0) (4, 0)', '(2, -2) (2, 2)'), ('(0, 0) (4, 0) (4, 3) (0, 3)', '(0, -0.05) (4, -0.05)'),
    ('(0, 0) (40, 0) (40, 1) (0, 1)', '(11, -100) (12, -100) (12, 105) (11, 105)')])
def test_walls_that_cross_are_refused(plan, wing):
    """Let a free wall or a long wing run through a building: the error names both."""
    with pytest.raises(GrammarError, match='plans of "w" and "b" overlap'):
        WallGrammar.parse(f"""building b
  footprint: {plan}
  facades: wall
  storey_height: 1
wing w
  footprint: {wing}
  facades: wall
  storey_height: 1
layout running {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
panel wall: running
""").build()


@pytest.mark.parametrize('facades, wing, out, words', [
    ('pier', '(1, -1) (2, -1) (2, 0) (1, 0)', 0.1, 'stands 0.1 m out of "b", into "w"'),
    ('pier wall', '(4, 0.05) (5, 0.05) (5, 2) (4, 2)', 0.1, None),
    ('pier', '(4, -2) (5, -2) (5, 0.5) (4, 0.5)', 0.1, 'stands 0.1 m out of "b", into "w"'),
    ('pier wall', '(1, -1) (2, -1) (2, 0) (1, 0)', 0.0, None)])
def test_panels_do_not_stand_out_into_another_body(facades, wing, out, words):
    """Refuse what stands out into a wing or a panel of it, by name; build what keeps clear."""
    grammar = WallGrammar.parse(f"""building b
  footprint: (0, 0) (4, 0) (4, 3) (0, 3)
  facades: {facades}
  storey_height: 1
  floors: none
wing w
  footprint: {wing}
  facades: wall
  storey_height: 1
rule pier -> extrude({out}) {{ wall }}
layout stone {{ bond: running  unit: 0.4 0.2 0.19  material: brick }}
panel wall: stone
""")
    if words is None:
        built = grammar.build()
        assert count_loose(built) == 0 and deepest_overlap(built) < OVERLAP
    else:
        with pytest.raises(GrammarError, match=words):
            grammar.build()


def many_wings(corners):
    """Write a grammar of walls that stand free, each with these corners."""
    text = SPIRE.format(footprint=SQUARE, pitch=75, height=0.19, joint=0.01).replace(
        'roof: spire(75)', '')
    head, tail = text.split('layout')
    wings = ''.join(
        f'wing w{i}\n  footprint: {" ".join(f"({x:g}, {y:g})" for x, y in points)}\n'
        '  facades: wall\n  storey_height: 0.4\n' for i, points in enumerate(corners))
    return WallGrammar.parse(f'{head}{wings}layout{tail}')


def test_plans_around_each_other_are_not_compared_for_minutes():
    """Refuse brackets that lie in each other by the hundred, and name one."""
    corners = [[(a, a), (200, a), (200, a + 1.2), (a + 1.2, a + 1.2), (a + 1.2, 200), (a, 200)]
               for a in np.arange(10, 150, 1.3)]
    with pytest.raises(GrammarError, match='edge by edge, .* in all; at most') as told:
        many_wings(corners).build()
    assert told.value.line
