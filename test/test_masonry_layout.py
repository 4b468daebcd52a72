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

"""Masonry: bonds of brick, corners, lintels and the mortar between, against closed forms."""

from building_checks import count_loose, deepest_overlap
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.errors import GrammarError
from procphys_ros.geometry import rotation
from procphys_ros.wallgrammar import WallGrammar

_LENGTH, _WIDTH, _HEIGHT, _JOINT = 0.215, 0.1025, 0.065, 0.010
_PITCH, _GAUGE = _LENGTH + _JOINT, _HEIGHT + _JOINT

_TEXT = """
building b(height = 1.5)
  footprint: {footprint}
  facades: start
  storey_height: height
layout running {{ unit: 0.215 0.1025 0.065 joint: 0.01 offset: 1/2 material: brick }}
layout thirds {{ bond: running unit: 0.215 0.1025 0.065 joint: 0.01 offset: 1/3 material: brick }}
layout stack {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
layout english {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
layout flemish {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
layout planks {{ bond: running unit: 2.4 0.08 0.2 joint: 0 pieces: 4 material: oak }}
panel wall: {layout}
panel twin: {layout}
panel window: glazing(timber, glass)
panel door: boards(oak)
panel lintel: beam(concrete)
{rules}
"""


def build(layout='running', footprint='(0, 0) (4.49, 0)', rules='rule start -> wall', **defines):
    """Build a wall that stands along x, or what the footprint says."""
    text = _TEXT.format(layout=layout, footprint=footprint, rules=rules)
    return WallGrammar.parse(text).build(**defines)


def kinds(blueprint):
    """Return the kind of every part by name."""
    return np.array(blueprint.kinds)[blueprint.kind]


def extents(blueprint):
    """Return the low and high corners of the parts in the building's axes [m]."""
    turned = np.abs(rotation.to_matrix(blueprint.poses[:, 3:]))
    half = (turned @ (0.5 * blueprint.size[:, :, None]))[:, :, 0]
    return blueprint.poses[:, :3] - half, blueprint.poses[:, :3] + half


def perpends(blueprint, course):
    """Return the left ends of the outer bricks of a course [m]."""
    low, high = extents(blueprint)
    rows = np.abs(high[:, 2] - (course + 1) * _GAUGE) < 1e-6
    rows &= low[:, 1] < 1e-6
    return np.sort(low[rows, 0])


def off_lattice(x, pitch):
    """Compute the distance to the nearest multiple of the pitch."""
    return x - np.round(x / pitch) * pitch


@pytest.mark.parametrize('layout, shifts', [
    ('running', [0.0, _PITCH / 2, 0.0]), ('thirds', [0.0, _PITCH / 3, 2 * _PITCH / 3]),
    ('stack', [0.0, 0.0, 0.0])])
def test_courses_are_offset(layout, shifts):
    """Shift the perpends of each course by the offset of the bond."""
    blueprint = build(layout)
    for course, shift in enumerate(shifts):
        inner = perpends(blueprint, course)[2:-2]
        np.testing.assert_allclose(off_lattice(inner - shift, _PITCH), 0.0, atol=2e-6)


def test_running_bond_fills_the_wall():
    """Lay 20 bricks in even courses, 19 and two halves in odd ones."""
    blueprint = build()
    low, high = extents(blueprint)
    assert low[:, 0].min() == pytest.approx(0.0) and high[:, 0].max() == pytest.approx(4.49)
    assert len(perpends(blueprint, 0)) == 20 and len(perpends(blueprint, 1)) == 21
    assert len(blueprint) == 10 * 20 + 10 * 21
    np.testing.assert_allclose(np.unique(blueprint.size[:, 0].round(6)), [_WIDTH, _LENGTH])


def test_english_bond_alternates_stretchers_and_headers():
    """Cross the wall with every unit of odd courses, a quarter brick off the stretchers."""
    blueprint = build('english')
    low, high = extents(blueprint)
    odd = np.round(high[:, 2] / _GAUGE).astype(int) % 2 == 0
    assert (high[~odd, 1] - low[~odd, 1]).max() == pytest.approx(_WIDTH)
    np.testing.assert_allclose(high[odd, 1] - low[odd, 1], _LENGTH)
    headers = perpends(blueprint, 1)[4:-4]
    np.testing.assert_allclose(off_lattice(headers - _PITCH / 4, _PITCH / 2), 0.0, atol=2e-6)


def test_flemish_bond_centres_headers_over_stretchers():
    """Find the middle of a stretcher below the middle of each header."""
    blueprint = build('flemish')
    low, high = extents(blueprint)
    header = high[:, 1] - low[:, 1] > 0.2
    centre, course = blueprint.poses[:, 0], np.round(high[:, 2] / _GAUGE).astype(int)
    whole = np.abs(high[:, 0] - low[:, 0] - _LENGTH) < 1e-6
    checked = 0
    for row in np.flatnonzero(header & (course == 2) & (centre > 0.5) & (centre < 4.0)):
        below = whole & ~header & (course == 1)
        assert np.abs(centre[below] - centre[row]).min() < 1e-5
        checked += 1
    assert checked >= 8


def test_bed_and_perpend_areas():
    """Match half-lap beds of 102.5 x 102.5 mm and cross joints of 102.5 x 65 mm."""
    blueprint = build()
    up = np.abs(rotation.rotate(blueprint.bond_frame[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]) > .5
    ground = blueprint.bonds[:, 0] == GROUND
    np.testing.assert_allclose(blueprint.bond_area[up & ~ground], _WIDTH * _WIDTH)
    np.testing.assert_allclose(blueprint.bond_area[~up], _WIDTH * _HEIGHT)
    np.testing.assert_allclose(blueprint.bond_area[ground], _LENGTH * _WIDTH)
    np.testing.assert_allclose(blueprint.bond_extent.prod(axis=1), blueprint.bond_area)


def test_bonds_lie_in_the_middle_of_the_joint():
    """Find both faces half a joint away, along the normal from the first part to the second."""
    blueprint = build('flemish', '(0, 0) (3, 0) (3, 2) (0, 2)')
    ground = blueprint.bonds[:, 0] == GROUND
    first, second = blueprint.bonds[~ground].T
    frame = blueprint.bond_frame[~ground]
    normal = rotation.rotate(frame[:, 3:], np.array([0.0, 0.0, 1.0]))
    for rows, side in ((first, 1.0), (second, -1.0)):
        turned = rotation.to_matrix(blueprint.poses[rows, 3:])
        reach = 0.5 * (np.abs(np.einsum('nij,ni->nj', turned, normal))
                       * blueprint.size[rows]).sum(axis=1)
        away = ((frame[:, :3] - blueprint.poses[rows, :3]) * normal).sum(axis=1) * side
        np.testing.assert_allclose(away - reach, 0.5 * _JOINT, atol=1e-9)


def test_ground_bonds_carry_the_first_course():
    """Bed every unit of the lowest course, and nothing else, on the ground."""
    blueprint = build()
    rows = blueprint.bonds[blueprint.bonds[:, 0] == GROUND, 1]
    low, _ = extents(blueprint)
    assert set(rows) == set(np.flatnonzero(low[:, 2] < 0.011))
    np.testing.assert_allclose(low[rows, 2], _JOINT)


def test_stiffness_is_two_half_units_and_a_joint_in_series():
    """Expect 1/(h/E + t/E_mortar) for a bed joint, and 0.4 of it in shear."""
    blueprint = build()
    up = np.abs(rotation.rotate(blueprint.bond_frame[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]) > .5
    bed = up & (blueprint.bonds[:, 0] != GROUND)
    expected = 1.0 / (_HEIGHT / 10e9 + _JOINT / 2e9)
    np.testing.assert_allclose(blueprint.mortar.normal_stiffness[bed], expected)
    np.testing.assert_allclose(blueprint.mortar.shear_stiffness[bed], 0.4 * expected)
    np.testing.assert_allclose(blueprint.mortar.tension, 0.2e6)


def test_weaker_side_counts():
    """Join strong bricks by weak mortar, once the grammar declares it."""
    blueprint = build(rules='rule start -> wall\nmaterial mortar { tension: 0.05e6 }\n'
                            'material brick { cohesion: 0.4e6 }')
    np.testing.assert_allclose(blueprint.mortar.tension, 0.05e6)
    np.testing.assert_allclose(blueprint.mortar.cohesion, 0.4e6)


def test_part_frame_runs_along_the_brick():
    """Keep x along the length and z up whichever way the wall runs; mass is density x volume."""
    blueprint = build('english', '(0, 0) (3, 0) (3, 2) (0, 2)')
    assert (blueprint.size[:, 1] <= 0.2150001).all()
    np.testing.assert_allclose(blueprint.size[:, 2], _HEIGHT)
    up = rotation.rotate(blueprint.poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(up[:, 2], 1.0)
    np.testing.assert_allclose(blueprint.mass, 1900.0 * blueprint.size.prod(axis=1))


def test_bricks_run_on_across_borders_of_one_type():
    """Lay the same bricks whether or not the wall is divided."""
    plain = build()
    split = build(rules='rule start -> split(x) { ~1: wall | 1.3: wall | ~1: wall }')
    np.testing.assert_allclose(split.poses, plain.poses, rtol=0.0, atol=1e-9)
    grid = build(rules='rule start -> grid(0.7, 0.31) { wall }')
    np.testing.assert_allclose(grid.poses, plain.poses, rtol=0.0, atol=1e-9)


def test_bricks_are_cut_at_borders_of_another_type():
    """Let no brick cross the border, and mortar the cut ends together."""
    blueprint = build(rules='rule start -> split(x) { 2.0: wall | ~1: twin }')
    low, high = extents(blueprint)
    assert not ((low[:, 0] < 1.99) & (high[:, 0] > 2.01)).any()
    at = np.abs(blueprint.bond_frame[:, 0] - 2.0) < 1e-6
    assert np.count_nonzero(at) >= 20
    assert (blueprint.size[:, 0] > 0.03).all()


def test_no_slivers():
    """Merge what would be shorter than a fifth of a unit."""
    for length in np.arange(3.0, 3.5, 0.037):
        blueprint = build(footprint=f'(0, 0) ({length:.3f}, 0)', height=0.3)
        assert blueprint.size[:, 0].min() > 0.2 * _PITCH - _JOINT
        assert blueprint.size[:, 0].max() < 1.2 * _PITCH


@pytest.mark.parametrize('layout', ['running', 'english', 'flemish', 'stack'])
@pytest.mark.parametrize('footprint, corners', [
    ('(0, 0) (3, 0) (3, 2) (0, 2)', 4), ('(0, 0) (4, 0) (4, 2) (2, 2) (2, 4) (0, 4)', 6),
    ('(0, 0) (2.4, 1.8) (0.6, 4.2) (-1.8, 2.4)', 4)])
def test_corners_interlock(layout, footprint, corners):
    """Let bricks cross the line where the wall ends in every other course."""
    blueprint = build(layout, footprint, height=0.6)
    thickness = _LENGTH if layout in ('english', 'flemish') else _WIDTH
    points = np.array(corners_of(footprint))
    assert len(points) == corners
    course = np.round(blueprint.poses[:, 2] / _GAUGE - 0.5).astype(int)
    turned = rotation.to_matrix(blueprint.poses[:, 3:])
    for i, point in enumerate(points):
        out, back = points[(i + 1) % corners] - point, points[i - 1] - point
        convex = out[0] * back[1] - out[1] * back[0] > 0
        line = thickness if convex else 0.0
        for along in (out / np.hypot(*out), back / np.hypot(*back)):
            axis = np.append(along, 0.0)
            middle = (blueprint.poses[:, :3] - np.append(point, 0.0)) @ axis
            half = 0.5 * (np.abs(np.einsum('nij,i->nj', turned, axis)) * blueprint.size).sum(1)
            beside = np.abs((blueprint.poses[:, :2] - point) @ [-along[1], along[0]]) < thickness
            crossing = beside & (middle - half < line - 0.01) & (middle + half > line + 0.02)
            assert len(np.unique(course[crossing])) >= 4


@pytest.mark.parametrize('layout', ['running', 'english', 'flemish'])
@pytest.mark.parametrize('footprint', [
    '(0, 0) (3, 0) (3, 2) (0, 2)', '(0, 0) (4, 0) (4, 2) (2, 2) (2, 4) (0, 4)',
    '(0, 0) (1.7, 0) (2.9, 1.2) (2.9, 2.9) (1.7, 4.1) (0, 4.1) (-1.2, 2.9) (-1.2, 1.2)',
    '(0, 0) (2, 0) (3, 1.7) (2, 3.4) (0, 3.4) (-1, 1.7)'])
def test_no_straight_joint_cuts_a_corner_off(layout, footprint):
    """Let no perpend near any corner stand over perpends of both courses below."""
    blueprint = build(layout, footprint, height=0.6)
    points = np.array(corners_of(footprint))
    turned = rotation.to_matrix(blueprint.poses[:, 3:])
    course = np.round(blueprint.poses[:, 2] / _GAUGE - 0.5).astype(int)
    for start, end in zip(points, np.roll(points, -1, axis=0)):
        length = np.hypot(*(end - start))
        ahead = np.append((end - start) / length, 0.0)
        inwards = np.array([-ahead[1], ahead[0], 0.0])
        apart = blueprint.poses[:, :3] - np.append(start, 0.0)
        reach = [0.5 * (np.abs(np.einsum('nij,i->nj', turned, a)) * blueprint.size).sum(axis=1)
                 for a in (ahead, inwards)]
        facing = np.abs(apart @ inwards - reach[1]) < 1e-5
        ends = (apart @ ahead + reach[0])[facing]
        near = (ends > 0.02) & (np.minimum(ends, length - ends) < 0.4) & (ends < length - 0.02)
        found = [np.sort(ends[near & (course[facing] == c)]) for c in range(8)]
        assert sum(map(len, found)) >= 8
        for three in zip(found, found[1:], found[2:]):
            assert not [x for x in three[0] if all(np.abs(o - x).min(initial=1.0) < 0.015
                                                   for o in three[1:])]


def corners_of(text):
    """Read the corners of a footprint."""
    return [[float(v) for v in pair.split(',')] for pair in
            text.replace(' ', '').strip('()').split(')(')]


def test_lintels_bear_on_both_sides():
    """Rest at least 100 mm on the wall at each side, and cut the bricks for it."""
    rules = ('rule start -> split(x) { ~1: wall | 1.2: column | ~1: wall }\n'
             'rule column -> split(y) { 0.3: wall | 0.6: window | 0.225: lintel | ~1: wall }')
    blueprint = build(rules=rules)
    kind = kinds(blueprint)
    low, high = extents(blueprint)
    lintel = np.flatnonzero(kind == 'lintel')
    assert low[lintel, 0].min() < 4.49 / 2 - 0.6 - 0.1
    assert high[lintel, 0].max() > 4.49 / 2 + 0.6 + 0.1
    below = blueprint.bonds[np.isin(blueprint.bonds[:, 1], lintel), 0]
    bearing = [row for row in below if row >= 0 and kind[row] == 'brick'
               and high[row, 2] < low[lintel, 2].min()]
    sides = blueprint.poses[bearing, 0] < 4.49 / 2
    assert sides.any() and not sides.all()
    assert {'frame', 'pane'} <= set(kind)


def test_boards_are_pieces_bonded_along_the_grain():
    """Tie the pieces of a plank by the strength of the wood, planks by nails."""
    blueprint = build('planks', footprint='(0, 0) (4.8, 0)')
    assert set(kinds(blueprint)) == {'board'}
    np.testing.assert_allclose(blueprint.size[:, 0].max(), 0.6)
    strengths = np.unique(blueprint.mortar.tension)
    np.testing.assert_allclose(strengths, [0.3e6, 18e6])
    grain = blueprint.mortar.tension > 1e6
    upper = blueprint.bond_frame[grain, 2] > 1.4  # the last course is sawn to half its height
    np.testing.assert_allclose(blueprint.bond_area[grain], np.where(upper, 0.008, 0.016))


def test_extruded_panel_stands_out():
    """Move the plinth outwards by 30 mm; it stays bonded to the wall above."""
    rules = 'rule start -> split(y) { 0.6: foot | ~1: wall }\nrule foot -> extrude(0.03) { twin }'
    blueprint = build(rules=rules)
    low, _ = extents(blueprint)
    foot = low[:, 1] < -0.0299
    assert np.count_nonzero(foot) > 100 and (blueprint.poses[foot, 2] < 0.6).all()
    plinth = foot[np.maximum(blueprint.bonds, 0)]
    across = (plinth[:, 0] != plinth[:, 1]) & (blueprint.bonds[:, 0] != GROUND)
    np.testing.assert_allclose(blueprint.bond_extent[across].min(axis=1).max(), _WIDTH - 0.03)


def test_level_edges_move_to_the_nearest_course():
    """Gauge an opening of 0.61 m to eight courses instead of laying slivers."""
    rules = 'rule start -> split(x) { ~1: wall | 1: column | ~1: wall }\n' \
            'rule column -> split(y) { 0.61: wall | 0.6: window | 0.225: lintel | ~1: wall }'
    blueprint = build(rules=rules)
    assert (blueprint.size[kinds(blueprint) == 'brick', 2] > 0.0649).all()


_DOORS = ('rule start -> split(x) {{ ~1: wall | {bays} | ~1: wall }}\n'
          'rule bay -> split(y) {{ 0.75: door | 0.15: lintel | 0.15: lintel | ~1: wall }}')


def test_stacked_lintels_share_a_pier():
    """Let lintels over lintels meet in the middle of a pier that is too narrow for both."""
    blueprint = build(rules=_DOORS.format(bays='0.9: bay | 0.25: wall | 0.9: bay'))
    low, high = extents(blueprint)
    lintel = np.flatnonzero(kinds(blueprint) == 'lintel')
    assert len(np.unique(low[lintel, 2].round(3))) == 2
    inner = high[lintel[low[lintel, 0] < 4.49 / 2 - 0.2], 0].max()
    assert inner == pytest.approx(4.49 / 2 - _JOINT / 2)
    assert deepest_overlap(blueprint) < 1e-6


@pytest.mark.parametrize('bays', ['0.9: bay | 0.9: bay', '0.7: bay | 0.7: bay | 0.7: bay'])
def test_lintels_without_a_pier_between_are_refused(bays):
    """Name the lintel that bears on nothing."""
    with pytest.raises(GrammarError, match='bears only 0 m on the wall at its right side'):
        build(rules=_DOORS.format(bays=bays))


def test_beams_in_a_wall_may_adjoin():
    """Lay three beams end to end on masonry."""
    course = 'split(x) { ~1: wall | 1: lintel | 1: lintel | 1: lintel | ~1: wall }'
    blueprint = build(rules=f'rule start -> split(y) {{ 0.6: wall | 0.15: {course} | ~1: wall }}')
    assert np.count_nonzero(kinds(blueprint) == 'beam') == 3
    assert deepest_overlap(blueprint) < 1e-6


@pytest.mark.parametrize('footprint', [
    '(0, 0) (3, 0) (3, 2) (0, 2)', '(0, 0) (4, 0) (4, 2) (2, 2) (2, 4) (0, 4)',
    '(0, 0) (4, 0) (2, 3)'])
def test_panels_may_begin_inside_of_a_corner(footprint):
    """Change the panel nearer to a corner than the wall is thick: the next wall keeps its room."""
    blueprint = build(footprint=footprint, height=0.6, rules=(
        'rule start -> split(x) { 0.03: wall | 0.5: twin | ~1: wall | 0.06: twin }'))
    assert deepest_overlap(blueprint) < 1e-6
    assert count_loose(blueprint) == 0
