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

"""Wind by place: boxes and maps, what all bodies feel in them, and the upward part of records."""

from math import pi

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
import pytest

from procphys_ros.errors import SceneError, SnapshotError
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.terrain import Terrain
from procphys_ros.physics.wind import Gust, Wind, WindSettings
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.scene.wind_map import read_wind_map
from procphys_ros.simulation import Simulation

STEADY = {'velocity': [20.0, 0.0, 0.0], 'turbulence_intensity': 0.0, 'profile': 'uniform'}
EVERYWHERE = 'size=1e5,1e5,1e5 speed=0.5'
# A tree, a wall, a flap on a post and a loose crate.
EVERYTHING = {
    'scene': {'objects': ['tree', 'wall', 'flap']}, 'engine': 'native',
    'tree': {'origin': [0.0, 9.0, 0.0], 'grammar_text': """
axiom: Width(0.05) Density(700) Modulus(8e9) F(1) F(1) [ /(90) &(40) F(0.5) Leaf(0.5) ] F(1)
"""},
    'wall': {'origin': [0.0, -9.0, 0.0], 'yaw': 1.5, 'grammar_text': """
building wall
  footprint: (0, 0) (2, 0)
  facades: brickwork
  storey_height: 1.5
layout running { unit: 0.215 0.1025 0.065  joint: 0.01  material: brick }
panel brickwork: running
material brick {}
"""},
    'flap': {'grammar_text': """
mechanism flap {
    box post { size: 0.1, 0.1, 2  at: 0, 0, 1  weld {} }
    plate flap { size: 0.01, 0.8, 0.6  at: 0, 0.5, 1.5
        hinge { to: post  at: 0, 0.05, 1.5  axis: 0, 0, 1 } }
    box crate { size: 0.3, 0.3, 0.3  mass: 1  at: 3, 0, 0.15 }
}
"""}}


def _wind(*zones, by_place=(), terrain=None, **changes):
    settings = WindSettings(**{**STEADY, 'zones': zones, **changes})
    return Wind(settings, 3, by_place=by_place, **({'terrain': terrain} if terrain else {}))


def _simulation(zones=(), **wind):
    return Simulation(Scene.from_parameters(
        {**EVERYTHING, 'wind': {**STEADY, 'zones': list(zones), **wind}}))


def _at(wind, *point, time=0.0):
    return wind.velocity(np.array([point]), time)[0]


def test_boxes_scale_and_turn():
    """Read the wind inside, outside, and beyond the sides of a turned box."""
    wind = _wind(f'position=10,0,5 size=20,2,10 yaw={pi / 6} speed=0.5 turn={pi / 2}')
    along, across = np.array([np.sqrt(0.75), 0.5]), np.array([-0.5, np.sqrt(0.75)])
    for u, v, inside in ((0.0, 0.0, True), (9.9, 0.9, True), (-9.9, -0.9, True),
                         (11.1, 0.0, False), (0.0, 2.1, False)):
        place = (10.0, 0.0) + u * along + v * across
        expected = (0.0, 10.0, 0.0) if inside else (20.0, 0.0, 0.0)
        assert_allclose(_at(wind, *place, 1.0), expected, atol=1e-9)
    assert_allclose(_at(wind, 10.0, 0.0, 11.2), (20.0, 0.0, 0.0))


def test_fades_are_continuous():
    """Walk through the edges of overlapping boxes; no step changes more than its share."""
    wind = _wind('size=10,10,10 speed=0.2 turn=1 fade=2', 'position=6,1,0 size=10,10,10 speed=1.5')
    path = np.linspace((-9.0, -9.0, 1.0), (19.0, 13.0, 9.0), 40_001)
    air = wind.velocity(path, 0.0)
    step = np.linalg.norm(path[1] - path[0])
    assert np.linalg.norm(np.diff(air, axis=0), axis=1).max() < 20.0 * (1.3 + 1.5) * step
    assert_array_equal(air[[0, -1]], [[20.0, 0.0, 0.0]] * 2)
    assert_allclose(_at(wind, -6.0, 0.0, 0.0),
                    20.0 * 0.6 * np.array([np.cos(0.5), np.sin(0.5), 0.0]))


def test_the_last_box_counts():
    """Let a box restore the free wind within another."""
    wind = _wind('size=40,40,40 speed=0.1 turbulence=0', 'size=4,4,4')
    assert_allclose(_at(wind, 0.0, 0.0, 1.0), (20.0, 0.0, 0.0))
    assert_allclose(_at(wind, 9.0, 0.0, 1.0), (2.0, 0.0, 0.0))


def test_eddies_and_gusts_have_their_factors():
    """Scale eddies by both factors, and gusts by that of the speed."""
    places = np.random.default_rng(5).uniform(-30.0, 30.0, (300, 3))
    gust = Gust(amplitude=8.0, duration=60.0, rise=1.0, upwind=0.0)
    winds = [_wind(*zones, turbulence_intensity=0.2)
             for zones in ((), ('size=200,200,200 speed=0.5 turbulence=3',))]
    for wind in winds:
        wind.start_gust(gust, 0.0)
    free, inside = (wind.velocity(places, 9.0) for wind in winds)
    mean = _wind()
    mean.start_gust(gust, 0.0)
    steady = mean.velocity(places, 9.0)
    assert (steady[:, 0] == 28.0).all() and np.ptp(free[:, 0]) > 5.0
    assert_allclose(inside, 0.5 * (steady + 3.0 * (free - steady)), atol=1e-9)
    assert_array_equal(winds[0].at_reference(9.0), winds[1].at_reference(9.0))
    assert_array_equal(inside[7:11], winds[1].velocity(places[7:11], 9.0))
    assert_array_equal(inside, winds[1].velocity(places, 9.0, threads=2))


def test_heights_count_from_the_ground():
    """Lift a box with a hill."""
    hill = Terrain(np.full((2, 2), 50.0), np.array([-90.0, -90.0]), 180.0)
    wind = _wind('position=0,0,5 size=10,10,10 speed=0.5', terrain=hill)
    assert _at(wind, 0.0, 0.0, 55.0)[0] == 10.0
    assert _at(wind, 0.0, 0.0, 5.0)[0] == 20.0


def test_everything_feels_half_the_wind_as_half_the_wind():
    """Compare a box that halves the wind everywhere with half of the wind, to the bit."""
    found = []
    for zones, speed in (((EVERYWHERE,), 20.0), ((), 10.0), ((), 20.0)):
        simulation = _simulation(zones, velocity=[speed, 0.0, 0.0])
        simulation.step(60)
        found.append((simulation.poses, simulation.state.wall_wind.applied))
    for inside, half, full in zip(*found):
        assert_array_equal(inside, half)
        assert not np.array_equal(inside, full)
    moved = np.abs(found[0][0] - found[2][0]).max(axis=1) > 1e-9
    kinds = [simulation.blueprint.kinds[k] for k in simulation.blueprint.kind[moved]]
    assert {'flap', 'crate'} <= set(kinds) and moved[:3].any()


@pytest.mark.parametrize('factor', [0.3, 1.7])
def test_drag_grows_with_the_square_of_the_factor(factor):
    """Throw two balls into the wind, one of them inside a box."""
    scene = Scene(Settings(gravity=0.0, time_step=1e-3, wind=WindSettings(
        **{**STEADY, 'zones': (f'position=0,0,9 size=9,9,9 speed={factor}',)})))
    simulation = Simulation(scene)
    for x in (0.0, 90.0):
        simulation.launch(Projectile('sphere', (0.2,), 5.0, (x, 0.0, 9.0), (0.0, 0.0, 0.0)))
    simulation.step(4)
    inside, outside = simulation.velocities[:, 0]
    assert outside > 1e-3
    assert inside / outside == pytest.approx(factor ** 2, rel=0.01)


def test_walls_take_the_pressure_of_their_place():
    """Press two equal walls, one of them inside a box."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['wall']}, 'wall': {
            'grammar_text': EVERYTHING['wall']['grammar_text'], 'count': 2, 'layout': 'row',
            'spacing': 60.0},
        'wind': {**STEADY, 'velocity': [0.0, 25.0, 0.0],
                 'zones': ['position=-30,0,0 size=20,20,20 speed=0.6']}})
    simulation = Simulation(scene)
    simulation.step(2)
    parts, wrenches = simulation.state.loads.layer('wind')
    first = parts < simulation.objects[1].first
    inside, outside = (wrenches[some, 1].sum() for some in (first, ~first))
    assert outside > 100.0
    assert inside / outside == pytest.approx(0.36, rel=1e-9)


def test_nothing_set_changes_nothing():
    """Return the wind of before, to the bit, without boxes and after they are gone."""
    places = np.random.default_rng(2).uniform(-50.0, 50.0, (200, 3))
    plain, changed = (_wind(turbulence_intensity=0.2) for _ in range(2))
    changed.change(WindSettings(**{**STEADY, 'turbulence_intensity': 0.2, 'zones': (EVERYWHERE,)}))
    assert not np.array_equal(plain.velocity(places, 3.0), changed.velocity(places, 3.0))
    changed.change(plain.settings)
    assert_array_equal(plain.velocity(places, 3.0), changed.velocity(places, 3.0))


def test_boxes_are_saved_and_restored():
    """Save boxes that were set while the simulation ran."""
    simulation = _simulation()
    simulation.wind.change(WindSettings(**{**STEADY, 'zones': (EVERYWHERE,)}))
    data = simulation.save()
    simulation.wind.change(WindSettings(**STEADY))
    simulation.restore(data)
    assert simulation.wind.settings.zones == (EVERYWHERE,)
    assert _at(simulation.wind, 0.0, 0.0, 3.0)[0] == 10.0
    simulation.step()


@pytest.mark.parametrize(('zones', 'words'), [
    (['speed=2'], ['wind.zones[0]', 'size', '0.01']),
    (['size=1,1,1', 'size=2,2,2 sped=1'], ['wind.zones[1]', 'sped', 'did you mean speed']),
    (['size=1,1,1 speed=-1'], ['speed is -1', '0 to 5']),
    (['size=1,1,1 speed=nan'], ['speed is nan', '0 to 5']),
    (['size=1,1,1 turbulence=9'], ['turbulence is 9', '0 to 5']),
    (['size=1,1,1 turn=7'], ['turn is 7', '-6.3 to 6.3']),
    (['size=1,1,1 fade=0'], ['fade is 0', '0.01']),
    (['size=1,1 speed=0'], ['size', 'list of 3 numbers']),
    (['size=1,1,1 position=1,x,1'], ['wind.zones[0]', 'numbers are expected']),
    (['size=1,1,1'] * 101, ['wind.zones has 101', '100 or fewer']),
    ('size=1,1,1', ['wind.zones', 'list of texts']),
    ([3.0], ['wind.zones', 'list of texts']),
])
def test_bad_boxes_are_named(zones, words):
    """Name the key, the box and what is allowed."""
    with pytest.raises(SceneError) as caught:
        Scene.from_parameters({'wind': {'zones': zones}})
    assert all(word in str(caught.value) for word in words), str(caught.value)


def _read(tmp_path, text):
    (tmp_path / 'valley.csv').write_text(text, 'utf-8')
    return read_wind_map('valley.csv', tmp_path)


def test_maps_are_interpolated(tmp_path):
    """Meet a map at its nodes, between them, and beyond its edges."""
    rows = _read(tmp_path, '# a map\ny, x, speed, turn\n' + '\n'.join(
        f'{y},{x},{1 + 0.1 * x + 0.2 * y - 0.05 * x * y},{0.1 * x}'
        for y in (3, 0) for x in (5, -1, 0)))
    wind = _wind(by_place=rows)
    rng = np.random.default_rng(8)
    for x, y in [(-1.0, 0.0), (0.0, 3.0), (5.0, 3.0), *rng.uniform((0, 0), (5, 3), (40, 2))]:
        speed = 20.0 * (1.0 + 0.1 * x + 0.2 * y - 0.05 * x * y)
        for z in (-7.0, 80.0):
            assert_allclose(_at(wind, x, y, z), speed * np.array(
                [np.cos(0.1 * x), np.sin(0.1 * x), 0.0]), rtol=1e-12, atol=1e-12)
    assert_array_equal(_at(wind, 900.0, -4.0, 0.0), _at(wind, 5.0, 0.0, 0.0))


def test_maps_have_heights_and_lie_below_boxes(tmp_path):
    """Interpolate over the height, and lay a box over a map."""
    rows = _read(tmp_path, 'x,y,z,turbulence,speed\n' + '\n'.join(
        f'{x},0,{z},1,{z / 10}' for z in (0, 10, 30) for x in (0, 1)))
    wind = _wind('position=0,0,20 size=2,2,2 speed=2', by_place=rows)
    for z, speed in ((0.0, 0.0), (4.0, 0.4), (20.0, 2.0), (28.0, 2.8), (99.0, 3.0)):
        assert_allclose(_at(wind, 0.5, 9.0, z)[0], 20.0 * speed, atol=1e-12)
    assert_allclose(_at(wind, 0.0, 0.0, 19.5)[0], 40.0)


def test_a_scene_has_the_map_of_its_file(tmp_path):
    """Read `wind.map` with the scene; the state can be saved, and another map is another scene."""
    read = {'wind': {**STEADY, 'map': 'valley.csv'}}
    saved = []
    for speed in (0.5, 0.25):
        _read(tmp_path, f'x,y,speed\n0,0,{speed}\n')
        simulation = Simulation(Scene.from_parameters(read, tmp_path))
        assert _at(simulation.wind, 7.0, 7.0, 7.0)[0] == 20.0 * speed
        saved.append(simulation.save())
        simulation.restore(saved[-1])
        simulation.step()
        assert _at(simulation.wind, 7.0, 7.0, 7.0)[0] == 20.0 * speed
    with pytest.raises(SnapshotError, match='another scene'):
        simulation.restore(saved[0])


@pytest.mark.parametrize(('text', 'words'), [
    ('', ['no rows']),
    ('x,y,speed\n', ['no rows']),
    ('0,0,1\n', ['line 1', 'must name the columns', 'x, y, z', 'speed, turn, turbulence']),
    ('x,y\n0,0\n', ['line 1', 'must name the columns']),
    ('x,y,speed,speed\n', ['line 1', 'each once']),
    ('x,y,speed\n0,0\n', ['line 2', '2 values', 'x, y, speed']),
    ('x,y,speed\n0,0,fast\n', ['line 2', 'speed must be a number']),
    ('x,y,speed\n0,nan,1\n', ['line 2', 'y is nan']),
    ('x,y,speed\n0,0,6\n', ['line 2', 'speed is 6', '0 to 5']),
    ('x,y,speed\n0,0,1\n0,1,1\n1,0,1\n', ['3 rows', '2, 2, 1', 'no grid']),
    ('x,y,speed\n0,0,1\n0,0,1\n', ['no grid']),
    ('x,y,speed\n0,0,1\n0,0,1\n1,0,1\n1,1,1\n', ['no grid']),
])
def test_bad_maps_are_named(tmp_path, text, words):
    """Name file, line and what is allowed."""
    with pytest.raises(SceneError) as caught:
        _read(tmp_path, text)
    assert all(word in str(caught.value) for word in ['wind.map', 'valley.csv', *words])


def test_large_maps_are_refused(tmp_path):
    """End at a bound of rows."""
    with pytest.raises(SceneError, match='wind.map.*line 100002: there are more than 100000'):
        _read(tmp_path, 'x,y,speed\n' + '0,0,1\n' * 100_001)


def test_records_may_rise(tmp_path):
    """Lift a ball by the upward part of a record, as its drag says."""
    (tmp_path / 'storm.csv').write_text('time,speed,direction,up\n0,3,270,8\n9,3,270,16\n')
    simulation = Simulation(Scene.from_parameters(
        {'gravity': 0.0, 'wind': {**STEADY, 'file': 'storm.csv'}}, tmp_path))
    assert simulation.wind.mean_velocity(0.0) == pytest.approx((3.0, 0.0, 8.0))
    assert simulation.wind.mean_velocity(9.0) == pytest.approx((3.0, 0.0, 16.0))
    simulation.launch(Projectile('sphere', (0.2,), 5.0, (0.0, 0.0, 9.0), (0.0, 0.0, 0.0)))
    simulation.step(1)
    before = simulation.velocities[0].copy()
    simulation.step(1)
    rate = (simulation.velocities[0] - before)[:3] / simulation.time_step
    slip = np.array([3.0, 0.0, 8.0]) - before[:3]
    area = simulation.state.bodies.drag_area[simulation.state.parts.body[0]]
    assert rate[2] == pytest.approx(
        0.5 * AIR_DENSITY * area * np.linalg.norm(slip) * slip[2] / 5.0, rel=0.02)
    assert rate[0] / rate[2] == pytest.approx(3.0 / 8.0, rel=0.01)


@pytest.mark.parametrize(('text', 'words'), [
    ('0,3,270,1,1\n', ['line 1', '5 values']),
    ('0,3,270\n1,3,270,1\n', ['line 2', '4 values', 'time, speed, direction']),
    ('time,speed,direction,up\n0,3,270,1\n1,3,270\n', ['line 3', '3 values', 'up']),
    ('0,3,270,-151\n', ['line 1', 'up is -151', '150']),
    ('0,140,270,140\n', ['line 1', 'up is 140']),
    ('0,3,270,nan\n', ['line 1', 'up is nan']),
])
def test_bad_rising_records_are_named(tmp_path, text, words):
    """Name file, line and what is allowed."""
    (tmp_path / 'storm.csv').write_text(text)
    with pytest.raises(SceneError) as caught:
        Scene.from_parameters({'wind': {'file': 'storm.csv'}}, tmp_path)
    assert all(word in str(caught.value) for word in ['wind.file', 'storm.csv', *words])
