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

"""Arching: what falls when walls lose their foot, and what carries itself over the gap."""

from functools import cache

from building_checks import standing, take_out
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.wallgrammar import WallGrammar

_LENGTH = 5.4   # [m] of the wall
_OPENING = 0.6  # [m] height of what is cut out
_MOVED = 0.1    # [m] from which a brick has left its place
_LIME = {'tension': 1e4, 'cohesion': 1.25e4}  # [Pa] old lime mortar, of hardly any strength

_HOUSE = """
building house
  footprint: (0, 0) (4, 0) (4, 2.2) (0, 2.2)
  facades: wall
  storey_height: 1.2
  storeys: 2
  floors: {floors}
layout running {{ unit: 0.215 0.1025 {high} joint: 0.01 material: brick }}
panel wall: running
material brick {{ tension: 0.05e6  cohesion: 0.06e6 }}
"""


@cache
def cut(middle, width, seconds=1.5, **strengths):
    """Cut an opening into the foot of a wall; return x, z of its other bricks, and which stand."""
    # The last of them falls within a second. Nobody changes what several tests look at.
    blueprint = wall(24, 24, **strengths)
    simulation = standing(blueprint)
    x, z = blueprint.poses[:, 0], blueprint.poses[:, 2]
    hole = (np.abs(x - middle) < 0.5 * width) & (z < _OPENING)
    take_out(simulation, np.flatnonzero(hole))
    simulation.step(round(seconds / simulation.time_step))
    return x[~hole], z[~hole], simulation.state.standing[~hole]


def test_lime_mortar_arches_over_a_door():
    """Let fall no more than the triangle of 60 degrees over an opening in the middle."""
    width, middle = 1.2, 0.5 * _LENGTH
    x, z, stands = cut(middle, width, **_LIME)
    aside = np.abs(x - middle) - 0.5 * width - 0.225  # bricks hang over the edge by up to one
    inside = aside < -(z - _OPENING) / np.tan(np.radians(60.0))
    assert 0 < (~stands).sum() < 40
    assert (~stands[~inside]).sum() <= 3


def test_lime_mortar_falls_over_a_gate():
    """Let nearly all of the wall fall when piers of half a metre are all that is left below."""
    _, _, stands = cut(0.5 * _LENGTH, 4.5, 1.0, **_LIME)
    assert stands.mean() < 0.1


def test_lime_mortar_falls_at_an_end():
    """Let fall over an opening at the end what an opening inside the wall would carry."""
    width = 1.2
    x, z, stands = cut(_LENGTH, 2.0 * width, **_LIME)
    edge = _LENGTH - width
    assert stands[x < edge - 1.2].mean() > 0.9  # later on, what has fallen strikes the rest
    assert not stands[(x > edge + 0.3) & (z > _OPENING)].any()
    assert x[~stands].min() < edge - 0.2  # it tears off behind the edge of the opening
    _, _, arch = cut(0.5 * _LENGTH, width, **_LIME)
    assert (~stands).sum() > 3 * (~arch).sum()


def test_cement_mortar_carries_what_lime_does_not():
    """Span the wide gap, and the missing end, in mortar that takes the bending."""
    for middle, width in ((0.5 * _LENGTH, 2.7), (_LENGTH, 2.4)):
        assert cut(middle, width, 2.0, tension=0.4e6, cohesion=0.5e6)[2].all()


def house_without(floors, gone, steps=400, high=0.065):
    """Take bricks of the ground floor out of a house; return x of the upper ones, which stay."""
    blueprint = WallGrammar.parse(_HOUSE.format(floors=floors, high=high)).build()
    simulation = standing(blueprint)
    places = blueprint.poses
    bricks = blueprint.kind == blueprint.kinds.index('brick')
    take_out(simulation, np.flatnonzero(bricks & (places[:, 2] < 1.0) & gone(places)))
    simulation.step(steps)
    upper = bricks & (places[:, 2] > 1.2)
    way = np.linalg.norm(simulation.poses[upper, :3] - places[upper, :3], axis=1)
    return places[upper, 0], way < _MOVED


@pytest.mark.parametrize('floors', ['timber', 'slab(0.15)'])
def test_a_house_bridges_a_hole_in_its_ground_floor(floors):
    """Cut a door of a metre into the front: no brick of the storey above falls."""
    _, stays = house_without(floors, lambda p: (p[:, 1] < 0.11) & (np.abs(p[:, 0] - 2.0) < 0.5),
                             200)
    assert stays.all()


def test_collapse_runs_through_a_house_with_slabs():
    """Take half of the ground floor: the slab tips and brings down what stood on whole walls."""
    x, stays = house_without('slab(0.15)', lambda p: p[:, 0] > 2.0, 80)
    assert stays[x > 2.0].mean() < 0.1 and stays[x < 2.0].mean() < 0.5


def test_collapse_stops_where_floors_do_not_tie():
    """Take half of the ground floor: what stood on it falls, the rest stays up."""
    # It falls piece by piece within 2.5 s: cracked joints hold some of it up for a while. Bricks
    # are twice as high as elsewhere, and half as many.
    x, stays = house_without('timber', lambda p: p[:, 0] > 2.0, 150, 0.14)
    assert stays[x > 2.0].mean() < 0.1  # 0.00 in seven nudged runs
    assert stays[x < 2.0].mean() > 0.7  # 0.79 to 0.85
    assert stays[x < 0.5].mean() > 0.9  # 0.95 to 0.99
