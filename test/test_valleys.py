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

"""Gable roofs over L, T, U and H: cut at the valleys, closed, bonded, and borne by girders."""

from building_checks import corners_of, count_loose, deepest_overlap, OVERLAP
import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.geometry.hexahedron import faces
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.wallgrammar import WallGrammar

TEXT = """
building b
  footprint: {footprint}
  facades: wall
  storey_height: {height}
  roof: gable({pitch})
layout {layout} {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
panel wall: {layout}
"""
PLANS = {
    'L': [(0, 0), (6, 0), (6, 4), (4, 4), (4, 7), (0, 7)],
    'T': [(0, 0), (7, 0), (7, 4), (5.2, 4), (5.2, 6), (2.2, 6), (2.2, 4), (0, 4)],
    'U': [(0, 0), (3, 0), (3, 3), (5, 3), (5, 0), (8, 0), (8, 6), (0, 6)],
    'H': [(0, 0), (2, 0), (2, 3), (5, 3), (5, 0), (7, 0), (7, 8), (5, 8), (5, 5.8), (2, 5.8),
          (2, 8), (0, 8)],
}


def built(plan, pitch=40, turn=0.0, height=1.2, layout='running'):
    """Build low walls on a plan, turned by an angle [rad], with a gable roof."""
    c, s = np.cos(turn), np.sin(turn)
    points = np.array(PLANS[plan] if isinstance(plan, str) else plan) @ np.array([[c, s], [-s, c]])
    footprint = ' '.join(f'({x:.9f}, {y:.9f})' for x, y in points)
    return WallGrammar.parse(TEXT.format(footprint=footprint, pitch=pitch, height=height,
                                         layout=layout)).build(), points


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
    corners = corners_of(blueprint)
    dry = np.zeros(len(points), bool)
    for row in np.flatnonzero(blueprint.kind == blueprint.kinds.index('tile')):
        flat = corners[row, :, :2]
        near = np.flatnonzero(~dry & (points > flat.min(axis=0)).all(axis=1)
                              & (points < flat.max(axis=0)).all(axis=1))
        _, normals, middles = faces(corners[row:row + 1])
        distance = (middles[0] * normals[0]).sum(axis=1) - points[near] @ normals[0, :, :2].T
        rise = normals[0, :, 2]
        with np.errstate(divide='ignore', invalid='ignore'):
            level = distance / rise
        ceiling = np.where(rise > 1e-9, level, np.inf).min(axis=1)
        floor = np.where(rise < -1e-9, level, -np.inf).max(axis=1)
        beside = ((np.abs(rise) <= 1e-9) & (distance < 0.0)).any(axis=1)
        dry[near[(floor < ceiling) & ~beside]] = True
    return ~dry


@pytest.mark.parametrize(('plan', 'pitch', 'turn'), [
    ('L', 20, 0.5), ('T', 60, np.pi / 2), ('U', 40, 2.0), ('H', 45, 0.0)])
def test_roofs_with_valleys_are_sound(plan, pitch, turn):
    """Bond all parts, let none overlap, and no rain in but through the joints of tiles."""
    house, points = built(plan, pitch, turn)
    assert count_loose(house) == 0
    assert deepest_overlap(house) < OVERLAP
    drops = np.random.default_rng(0).uniform(points.min(axis=0), points.max(axis=0), (6000, 2))
    drops = drops[inside(drops, points)]
    joints = 0.002 * (1.0 / 0.40 + 1.0 / 0.25)
    assert wet(house, drops).mean() < joints


@pytest.mark.parametrize(('plan', 'foot'), [('L', (4, 4)), ('T', (2.2, 4))])
def test_valleys_let_nothing_in(plan, foot):
    """Rain along the valley, 6 cm to both sides of it: hardly more comes in than elsewhere."""
    house, _ = built(plan)
    way = np.array([1.0, -1.0]) if foot[0] in (0, 2.2) else np.array([-1.0, -1.0])
    generator = np.random.default_rng(1)
    along = generator.uniform(0.05, 1.45 if plan == 'T' else 1.95, (4000, 1))
    drops = np.array(foot) + along * way + generator.uniform(-0.06, 0.06, (4000, 1)) * [1.0, 0.0]
    assert wet(house, drops).mean() < 0.002 / 0.12 + 0.02


def test_a_check_of_valleys_can_fail():
    """Take the tiles that are cut away: it rains in."""
    house, _ = built('L')
    poses = house.poses.copy()
    poses[house.hexahedra.part, 0] += 100.0
    drops = np.array([4.0, 4.0]) - np.linspace(0.05, 1.95, 500)[:, None]
    assert wet(type(house)(**{**vars(house), 'poses': poses}), drops).mean() > 0.5


def tiles(blueprint):
    """Sum the volume of all tiles [m³]."""
    tile = blueprint.kind == blueprint.kinds.index('tile')
    return float((blueprint.mass / blueprint.density)[tile].sum())


@pytest.mark.parametrize('pitch', [25, 55])
def test_what_the_bar_loses_at_valleys_the_stem_gains(pitch):
    """
    Compare the volume of the tiles of an L, 4 m wide, with those of two rectangles.

    At a distance u from the eaves in plan, measured on top of the tiles, the bar lacks 4 - 2u, or
    over the eaves, where one end of it is the corner, 4 - u; both slopes of the stem go on by u.
    """
    house, _ = built('L', pitch)
    bar = built([(0, 0), (6, 0), (6, 4), (0, 4)], pitch)[0]
    stem = built([(0, 4), (0, 1), (4, 1), (4, 4)], pitch)[0]
    turn = np.radians(pitch)
    level = max(0.12, 2.0 / np.cos(turn) / 25.0) + 0.045
    last = (2.0 - 0.0375 - 0.005) / np.cos(turn) - 0.025  # middle of the uppermost batten
    ridge = (2.0 + level * np.sin(turn)) / np.cos(turn) - 0.001
    layers = ((-0.25 / np.cos(turn) + 0.025, last, 0.0), (last - 0.15, ridge, 0.04))
    covered = lost = gained = 0.0
    for low, high, room in layers:
        x = np.linspace(low, high, 20001)
        step = x[1] - x[0]
        u = x * np.cos(turn) - level * np.sin(turn)
        covered += 2.0 * 6.0 * (high - low)
        gained += 2.0 * step * u.sum()
        u -= room * np.sin(turn)  # where the ridge tiles of the stem reach over those of the bar
        lost += step * np.where(u < 0.0, 4.0 - u, np.maximum(4.0 - 2.0 * u, 0.0)).sum()
    joints = tiles(bar) / (0.02 * covered)
    assert 0.985 < joints < 0.995
    more = tiles(house) - tiles(bar) - tiles(stem)
    assert more == pytest.approx(0.02 * joints * (gained - lost), abs=0.002 * tiles(house))


def test_girders_carry_the_roof_over_the_mouths():
    """Load one-brick walls with their roof: nothing cracks; without its girder the roof falls."""
    plan = [(0, 0), (4, 0), (4, 2.6), (2.6, 2.6), (2.6, 4.2), (0, 4.2)]
    house, _ = built(plan, layout='english', height=1.0)
    found = Fracture(StressSolver(BondGraph(house)))
    found.advance(20_000)
    assert found.stable and found.solver.supported.all() and found.solver.graph.alive.all()
    assert not found.solver.graph.cracked.any()
    kinds = np.array(house.kinds)[house.kind]
    assert {'girder', 'padstone', 'sleeper'} <= set(kinds)


def test_tiles_hang_on_their_battens_by_single_nails():
    """Pull off tiles, whole and cut ones: each nail holds 0.3 kN (EN 1995-1-1)."""
    house, _ = built('L')
    tile, batten = (house.kind == house.kinds.index(name) for name in ('tile', 'batten'))
    pair = house.bonds
    nail = ((tile[pair].any(axis=1) & batten[pair].any(axis=1)) & (pair >= 0).all(axis=1))
    cut = np.isin(pair, house.hexahedra.part).any(axis=1)
    holds = house.bond_area * house.mortar.tension
    for some in (nail & cut, nail & ~cut):
        assert some.sum() > 50
        np.testing.assert_allclose(np.median(holds[some]), 300.0)
        assert holds[some].max() < 300.1


@pytest.mark.parametrize(('plan', 'pitch', 'height', 'message'), [
    ([(0, 0), (6, 0), (6, 4), (3.7, 4), (3.7, 7), (0, 7)], 40, 2,
     'is 3.7 m wide, the bar that it joins 4 m: under a gable roof it must be as wide, or at '),
    (PLANS['L'], 65, 2, 'the pitch of a gable roof with valleys must be from 20 to 60, found 65'),
    (PLANS['L'], 40, 0.3, 'lies a girder that needs 0.675 m of wall below the roof, found 0.3 m'),
    ([(0, 0), (7, 0), (7, 4), (4.3, 4), (4.3, 7), (0.3, 7), (0.3, 4), (0, 4)], 40, 2,
     'let it start at the corner, or at least 0.6 m away'),
    ([(0, 0), (4, 0), (4, 3), (8, 3), (8, 6), (3, 6), (3, 3), (0, 3)], 40, 2,
     'is 3 m wide, the bar that it joins 1 m'),
    ([(0, 0), (6, 0), (6, 2), (4, 2), (4, 4), (2, 4), (2, 6), (0, 6)], 40, 2,
     'a bar with narrower wings at right angles (L, T, U, H), found 8 corners'),
])
def test_plans_without_room_for_valleys_are_refused(plan, pitch, height, message):
    """Say what was found and what is allowed."""
    with pytest.raises(GrammarError) as refused:
        built(plan, pitch, height=height)
    assert message in str(refused.value)


def test_girders_of_dry_walls_have_room():
    """Lay a girder over the mouth between walls without joints: no brick stands in it."""
    text = TEXT.replace('joint: 0.01', 'joint: 0').replace('0.215', '0.205')
    house = WallGrammar.parse(text.format(
        footprint='(0, 0) (4, 0) (4, 2.6) (2.6, 2.6) (2.6, 4.2) (0, 4.2)', pitch=40, height=1.2,
        layout='flemish')).build()
    assert 'girder' in house.kinds
    assert deepest_overlap(house) < OVERLAP
