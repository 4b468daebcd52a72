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


"""Roofs: closed against rain, from the eaves to ridge and apex, and free of overlaps."""

from building_checks import count_loose, deepest_overlap, OVERLAP
import numpy as np
import pytest

from procphys_ros.geometry import rotation
from procphys_ros.wallgrammar import WallGrammar

_TEXT = """
building b(width = 8, depth = 5)
  footprint: (0, 0) (width, 0) (width, depth) (0, depth)
  facades: wall
  storey_height: 0.6
  roof: {roof}
layout running {{ unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }}
panel wall: running
"""


def build(roof, **defines):
    """Build low walls with a roof."""
    return WallGrammar.parse(_TEXT.format(roof=roof)).build(**defines)


def rows_of(blueprint, kind):
    """Return the parts of a kind."""
    return np.flatnonzero(blueprint.kind == blueprint.kinds.index(kind))


def open_share(blueprint, size=(8.0, 5.0), drops=8000):
    """Drop rain on the plan: return the share that no tile stops."""
    points = np.random.default_rng(0).uniform((0.0, 0.0), size, (drops, 2))
    stopped = np.zeros(drops, bool)
    for row in rows_of(blueprint, 'tile'):
        pose, half = blueprint.poses[row], 0.5 * blueprint.size[row]
        near = np.flatnonzero(~stopped & (np.abs(points - pose[:2]) < 0.6).all(axis=1))
        if not len(near):
            continue
        back = rotation.conjugate(pose[3:])
        start = rotation.rotate(back, np.column_stack([points[near] - pose[:2],
                                                       np.zeros(len(near))]))
        fall = rotation.rotate(back, np.array([0.0, 0.0, 1.0])) + 1e-12
        ends = np.sort([(-half - start) / fall, (half - start) / fall], axis=0)
        stopped[near[ends[0].max(axis=1) < ends[1].min(axis=1)]] = True
    return 1.0 - stopped.mean()


@pytest.mark.parametrize('roof', ['gable(15)', 'hip(15)', 'hip(55)'])
def test_roof_is_closed(roof):
    """Stop the rain everywhere but in the joints of 2 mm between tiles."""
    blueprint = build(roof)
    joints = 0.002 * (1.0 / 0.40 + 1.0 / 0.32)
    assert open_share(blueprint) < joints


@pytest.mark.parametrize('part', ['tile', 'post'])
def test_check_of_closed_roofs_can_fail(part):
    """Let rain in where the topmost tiles, or the blocks on the apexes, are missing."""
    blueprint = build('hip(35)')
    tiles = rows_of(blueprint, 'tile')
    level = blueprint.poses[rows_of(blueprint, part), 2].max() - 0.1
    gone = tiles[blueprint.poses[tiles, 2] > level]
    poses = blueprint.poses.copy()
    poses[gone, 0] += 100.0
    assert open_share(type(blueprint)(**{**vars(blueprint), 'poses': poses})) > 0.013


@pytest.mark.parametrize('roof, width, depth', [
    ('gable(10)', 8.0, 5.0), ('gable(70)', 5.0, 8.0), ('hip(10)', 5.0, 8.0), ('hip(22)', 8.0, 5.0),
    ('hip(70)', 5.0, 3.0), ('hip(70)', 5.0, 8.0)])
def test_roofs_of_all_pitches_are_sound(roof, width, depth):
    """Bond every part and let none overlap, from the flattest to the steepest, either way."""
    blueprint = build(roof, width=width, depth=depth)
    assert count_loose(blueprint) == 0
    assert deepest_overlap(blueprint) < OVERLAP


def test_boards_cover_the_steps_of_gables():
    """Put the outer end of every course of a gable behind the boards along the verge."""
    blueprint = build('gable(40)')
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


@pytest.mark.parametrize('roof, yaw', [
    ('gable(40)', 0.5), ('hip(40)', 0.0), ('hip(40)', 0.5 * np.pi)])
def test_seats_lie_across_what_they_bear(roof, yaw):
    """Let seats on plates be as wide as rafters and hips, and as long as plates, on all sides."""
    c, s = np.cos(yaw), np.sin(yaw)
    corners = ' '.join(f'({c * x - s * y:.9f}, {s * x + c * y:.9f})'
                       for x, y in ((0, 0), (8, 0), (8, 5), (0, 5)))
    text = _TEXT.replace('(0, 0) (width, 0) (width, depth) (0, depth)', corners)
    built = WallGrammar.parse(text.format(roof=roof)).build()
    kinds = np.array(built.kinds)[built.kind][built.bonds]
    seats = np.flatnonzero((kinds[:, 0] == 'plate') & np.isin(kinds[:, 1], ('rafter', 'hip')))
    assert len(seats) >= 2 * 14
    across = rotation.rotate(built.bond_frame[seats, 3:], np.array([1.0, 0.0, 0.0]))
    length = rotation.rotate(built.poses[built.bonds[seats, 1], 3:], np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose((across * length).sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(built.bond_extent[seats, 0], 0.05)


def test_struts_of_hips_are_as_far_from_either_wall():
    """Set the struts between the ties of a hip roof about the middle of the plan."""
    built = build('hip(40)')
    places = built.poses[rows_of(built, 'tie'), :2]
    left, right = (np.unique(y.round(5)) for y in (places[:, 1], 5.0 - places[:, 1]))
    np.testing.assert_allclose(left, right, atol=1e-5)
