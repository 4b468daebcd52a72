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


"""The mean wind over time: ramps, records from files, cues."""

from pathlib import Path
import pickle

import numpy as np
import pytest

from procphys_ros.errors import SceneError
from procphys_ros.physics.wind import Wind, WindSettings
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_CALM = {'turbulence_intensity': 0.0, 'profile': 'uniform'}
_STORM = """# a front goes through
time, speed, direction
0, 10, 270
100, 20, 270   # twice as strong
200, 20, 300
"""


def _wind(**changes):
    return Wind(WindSettings(**{'velocity': (10.0, 0.0, 0.0), **_CALM, **changes}))


def _scene(folder: Path, text: str) -> Scene:
    (folder / 'storm.csv').write_text(text, encoding='utf-8')
    return Scene.from_parameters({'wind': {**_CALM, 'file': 'storm.csv'}}, folder)


def test_a_ramp_goes_evenly_and_stays():
    """Double the speed within 20 s: 15 m/s half way, 20 m/s from then on."""
    wind = _wind()
    wind.set_velocity((20.0, 0.0, 0.0), 5.0, ramp=20.0)
    speeds = [wind.mean_velocity(t)[0] for t in (0.0, 5.0, 15.0, 25.0, 1000.0)]
    assert speeds == pytest.approx([10.0, 10.0, 15.0, 20.0, 20.0])


def test_a_ramp_turns_on_the_shorter_way():
    """Turn the wind from 10 degrees to 350 degrees over x, never slower on the way."""
    first, last = (np.array([np.cos(a), np.sin(a), 0.0]) * 8.0 for a in np.radians([10.0, -10.0]))
    wind = _wind(velocity=tuple(first))
    wind.set_velocity(tuple(last), 0.0, ramp=10.0)
    assert wind.mean_velocity(5.0) == pytest.approx((8.0, 0.0, 0.0), abs=1e-12)
    assert wind.mean_velocity(10.0) == pytest.approx(last)


def test_a_storm_rises_from_still_air_in_its_own_direction():
    """Ramp from nothing: the direction is the target's from the start."""
    wind = _wind(velocity=(0.0, 0.0, 0.0))
    wind.set_velocity((0.0, 30.0, 0.0), 0.0, ramp=60.0)
    assert wind.mean_velocity(6.0) == pytest.approx((0.0, 3.0, 0.0), abs=1e-12)


def test_eddies_travel_by_the_integral_of_the_speed():
    """Find the same eddies after a ramp as a steady wind brings when it has come as far."""
    ramped, steady = (Wind(WindSettings((10.0, 0.0, 0.0), profile='uniform'), seed=2)
                      for _ in range(2))
    ramped.set_velocity((20.0, 0.0, 0.0), 4.0, ramp=10.0)
    points = np.random.default_rng(0).uniform(-50.0, 50.0, (40, 3))
    way = 40.0 + 150.0 + 20.0 * 6.0
    found = ramped.velocity(points, 20.0) - [20.0, 0.0, 0.0]
    wanted = steady.velocity(points, way / 10.0) - [10.0, 0.0, 0.0]
    np.testing.assert_allclose(found, 2.0 * wanted, atol=1e-4)


def test_a_command_ends_a_ramp():
    """Set another wind amid a ramp: it blows at once, and nothing of the ramp comes back."""
    wind = _wind()
    wind.set_velocity((20.0, 0.0, 0.0), 0.0, ramp=20.0)
    wind.set_velocity((5.0, 0.0, 0.0), 10.0)
    assert wind.mean_velocity(5.0) == pytest.approx((12.5, 0.0, 0.0))
    assert wind.mean_velocity(15.0) == (5.0, 0.0, 0.0)


def test_winds_that_are_set_without_end_take_no_memory():
    """Set the wind a thousand times: no more is kept than after a hundred; eddies travel on."""
    wind = _wind()
    sizes = []
    for i in range(1000):
        wind.set_velocity((10.0 + i % 2, 0.0, 0.0), 0.01 * i)
        if i in (99, 999):
            sizes.append(len(pickle.dumps(wind._history)))
    assert sizes[1] < 1.1 * sizes[0]
    assert wind._history.travelled(10.0) == pytest.approx(105.0, abs=0.2)


def test_a_record_is_followed(tmp_path):
    """Blow as the file says, between its rows too, and on from its last row; again after reset."""
    simulation = Simulation(_scene(tmp_path, _STORM))
    for _ in range(2):
        wind = simulation.wind
        assert wind.mean_velocity(50.0) == pytest.approx((15.0, 0.0, 0.0))
        bearing = np.radians(285.0)
        assert wind.mean_velocity(150.0) == pytest.approx(
            (-20.0 * np.sin(bearing), -20.0 * np.cos(bearing), 0.0))
        assert wind.mean_velocity(1e5) == wind.mean_velocity(200.0)
        wind.set_velocity((1.0, 0.0, 0.0), 0.0)
        simulation.reset()


@pytest.mark.parametrize(('text', 'words'), [
    ('0, 10\n', ['line 1', '2 values', 'time, speed, direction']),
    ('0, 10, 90\n0, 12, 90\n', ['line 2', 'later']),
    ('0, ten, 90\n', ['line 1', 'speed must be a number']),
    ('0, 10, 361\n', ['direction', '361', '0 to 360']),
    ('0, -1, 90\n', ['speed', '-1', '0 to 150']),
    ('time,speed,direction\n', ['no rows']),
])
def test_bad_records_are_named(tmp_path, text, words):
    """Name file, line and what is allowed."""
    with pytest.raises(SceneError) as caught:
        _scene(tmp_path, text)
    assert all(word in str(caught.value) for word in ['wind.file', 'storm.csv', *words])


def test_a_missing_record_is_named():
    """Say where the file was looked for."""
    with pytest.raises(SceneError, match='wind.file: there is no file "gone.csv"'):
        Scene.from_parameters({'wind': {'file': 'gone.csv'}})


def test_a_cue_ramps_the_wind():
    """Raise a storm by a cue."""
    scene = Scene.from_parameters({
        'scene': {'cues': ['0.5 wind velocity=0,20,0 ramp=1']},
        'wind': {**_CALM, 'velocity': [0.0, 10.0, 0.0]}})
    simulation = Simulation(scene)
    simulation.step(60)
    assert simulation.wind.mean_velocity(1.0) == pytest.approx((0.0, 15.0, 0.0), abs=0.2)
    assert simulation.wind.mean_velocity(9.0) == (0.0, 20.0, 0.0)


def test_a_bad_cue_is_named():
    """Refuse a wind that is too fast, naming the cue."""
    with pytest.raises(SceneError, match='scene.cues.*150'):
        Scene.from_parameters({'scene': {'cues': ['0 wind velocity=900,0,0']}})
