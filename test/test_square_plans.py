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

"""Plans that are nearly right-angled, as surveys give them: squared up for floors and roofs."""

from building_checks import count_loose, deepest_overlap, OVERLAP
import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.wallgrammar import WallGrammar
from procphys_ros.wallgrammar.footprint import square_up

_PLANS = {
    'box': [(0, 0), (5, 0), (5, 3.5), (0, 3.5)],
    'L': [(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)],
    'T': [(0, 0), (7, 0), (7, 3), (5, 3), (5, 6), (2, 6), (2, 3), (0, 3)],
    'U': [(0, 0), (8, 0), (8, 5), (5.5, 5), (5.5, 2.5), (2.5, 2.5), (2.5, 5), (0, 5)],
    'line': [(0, 0), (3, 0), (6, 0), (6, 3), (0, 3)],
}
_TEXT = """
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
    return WallGrammar.parse(_TEXT.format(points=corners, extra=extra), 'house.wall').build()


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
    ('box', 1e-4, 'floors: timber roof: hip(40)'), ('box', 1.0, 'roof: gable(40)'),
    ('L', 1.0, 'floors: slab(0.2)'), ('T', 1e-4, 'roof: gable(40)'), ('T', 1.0, 'floors: timber'),
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
