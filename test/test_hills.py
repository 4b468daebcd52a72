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

"""Hills in the wind: potential flow over a ridge and a round hill, and what trees on them feel."""

from dataclasses import replace
import math

import numpy as np
import pytest

from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.wind import Wind, WindSettings
from procphys_ros.physics.wind.hills import Hills
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_HEIGHT, _LENGTH = 4.0, 40.0  # [m] of the hills, and to half of their height


def _ridge(height=_HEIGHT):
    """Make a ridge along y with the section of Agnesi's curve."""
    x = np.linspace(-400.0, 400.0, 201)
    section = height / (1.0 + np.square(x / _LENGTH))
    return Terrain(np.repeat(section[:, None], 101, axis=1), np.array([-400.0, -200.0]), 4.0)


def _dome(height=_HEIGHT):
    x = np.linspace(-200.0, 200.0, 101)
    square = np.square(x)[:, None] + np.square(x)
    return Terrain(height * np.exp(-math.log(2.0) * square / _LENGTH ** 2),
                   np.array([-200.0, -200.0]), 4.0)


def _air(hills, points, velocity):
    air = np.tile(np.asarray(velocity, float), (len(points), 1))
    hills.bend(np.asarray(points, float), air)
    return air


@pytest.mark.report('laws')
@pytest.mark.parametrize('x,z', [(0.0, 0.0), (0.0, 10.0), (0.0, 40.0), (40.0, 0.0), (-80.0, 7.0)])
def test_wind_over_a_ridge_is_potential_flow(x, z, measured):
    """Compare gain and rise over Agnesi's curve with H·L·(Z² − x²)/(Z² + x²)² and its partner."""
    deep = _LENGTH + z
    square = (deep * deep + x * x) ** 2
    along, _, up = _air(Hills.over(_ridge()), [[x, 0.0, z]], (10.0, 0.0, 0.0))[0]
    expected = 10.0 * _HEIGHT * _LENGTH * (deep * deep - x * x) / square
    measured('gain of 10 m/s over a ridge 4 m high, 40 m to half of it', along - 10.0, expected,
             'm/s', atol=0.02)
    assert up == pytest.approx(-20.0 * _HEIGHT * _LENGTH * x * deep / square, abs=0.02)


def test_a_round_hill_is_the_same_from_all_sides():
    """Turn wind and places about a dome: the gain turns with them, and is less than a ridge's."""
    hills, places = Hills.over(_dome()), np.array([[0.0, 0.0, 2.0], [30.0, 10.0, 2.0]])
    first = _air(hills, places, (10.0, 0.0, 0.0))
    for angle in (0.5, 2.0, 4.0):
        turn = np.array([[math.cos(angle), -math.sin(angle), 0.0],
                         [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]])
        other = _air(hills, places @ turn.T, turn @ [10.0, 0.0, 0.0])
        assert other == pytest.approx(first @ turn.T, abs=0.03)
    ridge = _air(Hills.over(_ridge()), [[0.0, 0.0, 2.0]], (10.0, 0.0, 0.0))
    assert 10.2 < first[0, 0] < ridge[0, 0]


def test_wind_along_a_ridge_and_over_level_ground_stays():
    """Blow along a ridge, over flat ground, and far from hills."""
    hills = Hills.over(_ridge())
    assert _air(hills, [[0.0, 0.0, 3.0]], (0.0, 10.0, 0.0))[0] == pytest.approx(
        [0.0, 10.0, 0.0], abs=0.02)
    assert _air(hills, [[5e3, 0.0, 3.0], [0.0, 0.0, 500.0]], (10.0, 0.0, 0.0)) == pytest.approx(
        np.tile([10.0, 0.0, 0.0], (2, 1)))
    level = _air(Hills.over(FLAT), [[0.0, 0.0, 3.0]], (10.0, 0.0, 0.0))
    assert level[0] == pytest.approx([10.0, 0.0, 0.0])


def test_steep_hills_gain_no_more_than_the_code_says():
    """Blow over a ridge as high as long: 1.6 times the wind at its crest, a rise of 0.3 of it."""
    air = _air(Hills.over(_ridge(40.0)), [[0.0, 0.0, 0.0], [-20.0, 0.0, 0.0]], (10.0, 0.0, 0.0))
    assert air[0, 0] == pytest.approx(16.0)
    assert air[1, 2] == pytest.approx(3.0)


def test_hills_are_off_until_they_are_switched_on():
    """Read the wind over a ridge with and without them, and switch them on while it blows."""
    points = np.array([[0.0, 0.0, 6.0], [90.0, 0.0, 2.0]])
    settings = {'velocity': (10.0, 0.0, 0.0), 'turbulence_intensity': 0.0}
    wind = Wind(WindSettings(**settings), terrain=_ridge())
    before = wind.velocity(points, 0.0)
    assert (before[:, 2] == 0.0).all()
    wind.change(WindSettings(**settings, hills=True))
    after = wind.velocity(points, 0.0)
    assert after[0, 0] > 1.05 * before[0, 0] and after[1, 0] < before[1, 0]
    wind.change(WindSettings(**settings))
    assert np.array_equal(wind.velocity(points, 0.0), before)


def test_trees_on_a_crest_lean_more():
    """Grow trees on ridges and in hollows: with hills those lean more, and these less."""
    leans = {}
    for hills in (False, True):
        simulation = Simulation(Scene.from_parameters({
            'scene': {'objects': ['high', 'low']}, 'engine': 'native',
            'wind': {'velocity': [14.0, 0.0, 0.0], 'turbulence_intensity': 0.0, 'hills': hills},
            'terrain': {'noise': 6.0, 'wavelength': 60.0, 'extent': 120.0, 'seed': 3},
            **{name: {'grammar_text': _POLE, 'origin': origin} for name, origin in (
                ('high', _extreme(max)), ('low', _extreme(min)))}}))
        for thing in simulation.objects:
            parts = simulation.poses[thing.first:thing.first + thing.count]
            leans[hills, thing.name] = parts[-1, 0] - parts[0, 0]
        data = simulation.save()
        simulation.step(5)
        poses = simulation.poses.copy()
        simulation.restore(data)
        simulation.step(5)
        assert np.array_equal(simulation.poses, poses)
        settings = simulation.scene.settings.wind
        simulation.wind.change(replace(settings, hills=True))  # after a restored state, too
        above = simulation.poses[[-1], :3]
        assert simulation.wind.velocity(above, simulation.time)[0, 2] != 0.0
    assert leans[True, 'high'] > 1.1 * leans[False, 'high']
    assert leans[True, 'low'] < 0.98 * leans[False, 'low']


_POLE = 'axiom: Modulus(5e9) Width(0.08) F(1) F(1) F(1) F(1)\n'


def _extreme(which):
    """Find the highest or lowest node well inside of the terrain of these trees."""
    terrain = Scene.from_parameters({
        'scene': {'objects': []}, 'terrain': {
            'noise': 6.0, 'wavelength': 60.0, 'extent': 120.0, 'seed': 3}}).settings.terrain
    inner = terrain.heights[8:-8, 8:-8]
    i, j = np.argwhere(inner == which(inner.ravel().tolist()))[0] + 8
    return [float(terrain.low[0] + i * terrain.edge), float(terrain.low[1] + j * terrain.edge),
            0.0]
