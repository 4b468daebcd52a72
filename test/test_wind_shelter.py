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

"""Tests of shelter: stands of trees and buildings in the way of the wind."""

import math

from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.physics.wind import Shelter, Wind, WindSettings
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_TOP, _CROWN, _AREA, _APART = 10.0, 2.0, 100.0, 5.0  # [m], [m], [m²], [m]: leaf area index 4


def _stand(columns: int = 60, rows: int = 41) -> Shelter:
    """Plant trees in squares from x = 0 downwind, the middle row on y = 0."""
    x, y = np.meshgrid(_APART * np.arange(columns), _APART * (np.arange(rows) - rows // 2))
    same = np.ones(x.size)
    return Shelter(np.column_stack([x.ravel(), y.ravel(), _TOP * same, _CROWN * same,
                                    _AREA * same]))


def _wind(lee: Shelter, **changes: object) -> Wind:
    given = {'velocity': (10.0, 0.0, 0.0), 'turbulence_intensity': 0.0, 'profile': 'uniform',
             'shelter': True, **changes}
    wind = Wind(WindSettings(**given))
    wind.shelter = lee
    return wind


def _speeds(wind: Wind, points: list) -> np.ndarray:
    return wind.velocity(np.array(points, float), 0.0)[:, 0]


def test_wind_decays_exponentially_inside_a_stand():
    """Follow u(h)·exp(-a·(1 - z/h)), with the a of Goudriaan 1977 for a leaf area index of 4."""
    heights = np.array([1.0, 3.0, 5.0, 7.0, 9.0])
    middle = 0.5 * _APART  # between the trees, not in a crown
    found = _speeds(_wind(_stand()), [[200.0 + middle, middle, z] for z in heights])
    decay = 0.28 * 4.0 ** (2.0 / 3.0) * (_TOP / 0.1) ** (1.0 / 3.0)
    assert found == pytest.approx(10.0 * np.exp(-decay * (1.0 - heights / _TOP)), rel=0.15)
    slope = np.polyfit(1.0 - heights / _TOP, -np.log(found), 1)[0]
    assert slope == pytest.approx(decay, rel=0.05)


def test_wind_is_free_above_a_stand_and_at_its_edge():
    """Shelter neither what stands higher nor the windward row, and the more the further in."""
    wind = _wind(_stand())
    assert _speeds(wind, [[202.5, 2.5, 10.5], [-1.0, 0.0, 3.0], [0.0, 0.0, 3.0]]) == pytest.approx(
        10.0)
    inwards = _speeds(wind, [[x + 2.5, 2.5, 5.0] for x in (0.0, 10.0, 20.0, 40.0)])
    assert (np.diff(inwards) < 0.0).all() and inwards[-1] < 0.4 * inwards[0]


def test_a_lone_crown_does_not_shelter_itself():
    """Leave the wind on a tree alone, whose drag has its own shelter, whatever blows where."""
    wind = _wind(Shelter(np.array([[0.0, 0.0, _TOP, _CROWN, _AREA]])))
    assert _speeds(wind, [[1.5, 0.5, 6.0], [-1.0, 0.0, 4.0]]) == pytest.approx(10.0)
    assert 7.0 < _speeds(wind, [[6.0, 0.0, 6.0]])[0] < 10.0


def test_wakes_are_those_of_perera():
    """Find the deficit of the formula behind a wide building, from five heights on."""
    height, roughness = 8.0, 0.03
    wind = _wind(Shelter(buildings=np.array([[-10.0, -500.0, 0.0, 500.0, height]])),
                 profile='log', roughness_length=roughness)
    free = _wind(Shelter(), profile='log', roughness_length=roughness)
    points = [[height * d, 0.0, height * z] for d in (5.0, 10.0, 20.0, 30.0) for z in (0.5, 1, 2)]
    top = _speeds(free, [[0.0, 0.0, height]])[0]
    for point, before, behind in zip(points, _speeds(free, points), _speeds(wind, points)):
        way, z = point[0] / height, point[2] / height
        eta = z * (0.32 / math.log(height / roughness) * way) ** -0.47
        deficit = top * 9.75 / way * eta * math.exp(-0.67 * eta ** 1.5)
        assert behind == pytest.approx(max(before - deficit, 0.2 * before), rel=1e-6)


def test_wakes_lie_downwind_and_behind_the_building():
    """Leave the windward side, the sides and the far lee alone, whichever way the wind blows."""
    house = Shelter(buildings=np.array([[-5.0, -5.0, 5.0, 5.0, 8.0]]))
    wind = _wind(house)
    assert _speeds(wind, [[-6.0, 0.0, 3.0], [0.0, 30.0, 3.0], [2.0, 0.0, 5.0]]) == pytest.approx(
        10.0)
    near, far = _speeds(wind, [[20.0, 0.0, 3.0], [400.0, 0.0, 3.0]])
    assert near < 4.0 and far > 9.0
    turned = _wind(house, velocity=(0.0, -10.0, 0.0))
    found = turned.velocity(np.array([[0.0, -20.0, 3.0], [20.0, 0.0, 3.0]]), 0.0)
    assert found[:, 1] == pytest.approx([-near, -10.0])


def test_shelter_is_off_unless_asked_for():
    """Expect the same wind to the bit, with turbulence, unless `wind.shelter` is on."""
    points = np.random.default_rng(1).uniform(0.0, 9.0, (200, 3)) + [200.0, 0.0, 0.0]
    plain, off, on = (_wind(stand, shelter=asked, turbulence_intensity=0.2).velocity(points, 3.0)
                      for stand, asked in ((Shelter(), False), (_stand(), False),
                                           (_stand(), True)))
    assert np.array_equal(plain, off)
    share = np.linalg.norm(on, axis=1) / np.linalg.norm(off, axis=1)
    assert (share <= 1.0 + 1e-12).all() and share.min() < 0.2


def test_a_scene_knows_what_shelters_it():
    """Bend a tree in the lee of a wall less than one in front of it."""
    tree = {'grammar_text': 'axiom: !(0.05) F(1) Leaf(0.5) F(0.5) Leaf(0.5)'}
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['before', 'behind', 'wall']},
        'wind': {'velocity': [14.0, 0.0, 0.0], 'turbulence_intensity': 0.0, 'shelter': True},
        'before': {**tree, 'origin': [-30.0, 0.0, 0.0]},
        'behind': {**tree, 'origin': [10.0, 0.0, 0.0]},
        'wall': {'grammar': 'garden_wall.wall', 'origin': [0.0, -2.2, 0.0],
                 'yaw': 0.5 * math.pi}}))
    simulation.step(120)
    before, behind = (np.abs(simulation.poses[o.first + 1, :3]
                             - simulation.blueprint.poses[o.first + 1, :3]).max()
                      for o in simulation.objects[:2])
    assert 0.0 < behind < 0.6 * before


def test_what_was_taken_out_shelters_nothing():
    """Take a house away, and put another one elsewhere: only that one shelters, saved as well."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['house']}, 'house': {
            'grammar': 'cottage.wall', 'defines': ['storeys=1', 'width=5.0525', 'depth=3.2525']},
        'wind': {'velocity': [14.0, 0.0, 0.0], 'shelter': True}})
    simulation = Simulation(scene)
    assert len(simulation.state.wind.shelter.buildings) == 1
    simulation.remove('house')
    assert not len(simulation.state.wind.shelter.buildings)
    simulation.add(wall(6, 8), (40.0, 0.0, 0.0), name='later')
    data, other = simulation.save(), Simulation(scene)
    other.restore(data)
    for run in (simulation, other):
        left, = run.state.wind.shelter.buildings
        assert left[0] > 30.0
