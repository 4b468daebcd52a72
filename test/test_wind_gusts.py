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


"""Discrete gusts: their shape in time, and their way through the scene."""

import numpy as np
import pytest

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.physics.wind import Gust, Wind, WindSettings

SPEED = 8.0    # [m/s]
UPWIND = 40.0  # [m]


@pytest.fixture
def steady():
    """Set up a steady wind along y."""
    return Wind(WindSettings((0.0, SPEED, 0.0), turbulence_intensity=0.0, profile='uniform'))


def _history(wind, point, times):
    return np.array([wind.velocity(np.array([point]), t)[0] for t in times])


@pytest.mark.report('nature')
def test_extreme_operating_gust_has_the_shape_of_the_standard(steady, measured):
    """Compare with U - 0.37 V sin(3 pi t/T)(1 - cos(2 pi t/T)) at the origin."""
    steady.start_gust(Gust(5.0, 10.5, kind='eog', upwind=UPWIND), 2.0)
    t = np.linspace(0.0, 10.5, 211)
    found = _history(steady, (3.0, 0.0, 9.0), 2.0 + UPWIND / SPEED + t)
    shape = -0.37 * 5.0 * np.sin(3 * np.pi * t / 10.5) * (1 - np.cos(2 * np.pi * t / 10.5))
    np.testing.assert_allclose(found[:, 1], SPEED + shape, atol=1e-9)
    np.testing.assert_allclose(found[:, [0, 2]], 0.0, atol=1e-12)
    measured('peak of the extreme operating gust (IEC 61400-1)', found[:, 1].max(),
             SPEED + 0.74 * 5.0, 'm/s', rtol=1e-6)
    axes = ('time [s]', 'wind [m/s]')
    measured.curve('Extreme operating gust', 'wind', t, found[:, 1], axes)
    measured.curve('Extreme operating gust', 'IEC 61400-1, expected', t, SPEED + shape, axes)


def test_cosine_gust_rises_holds_and_falls(steady):
    """Compare with half a cosine up in 2 s, 3 s of full strength, and down again."""
    steady.start_gust(Gust(6.0, 7.0, rise=2.0, upwind=0.0), 0.0)
    found = _history(steady, (0.0, 0.0, 5.0), [0.0, 1.0, 2.0, 3.5, 5.0, 6.0, 7.0])[:, 1] - SPEED
    np.testing.assert_allclose(found, [0.0, 3.0, 6.0, 6.0, 6.0, 3.0, 0.0], atol=1e-9)


def test_gust_without_rise_is_one_minus_cosine(steady):
    """Compare with A/2 (1 - cos(2 pi t/T))."""
    steady.start_gust(Gust(6.0, 4.0, upwind=0.0), 0.0)
    t = np.linspace(0.0, 4.0, 81)
    found = _history(steady, (0.0, 0.0, 5.0), t)[:, 1] - SPEED
    np.testing.assert_allclose(found, 3.0 * (1.0 - np.cos(0.5 * np.pi * t)), atol=1e-9)


def _arrivals(wind, direction, distances, times):
    """Find when the wind along a direction peaks at distances from the origin along it."""
    direction = np.array(direction)
    places = distances[:, None] * direction + [0.0, 0.0, 3.0]
    return times[np.argmax([wind.velocity(places, t) @ direction for t in times], axis=0)]


@pytest.mark.parametrize(('kind', 'direction', 'speed'), [
    ('cosine', (0.0, 1.0, 0.0), SPEED + 30.0),          # into air that flees before it
    ('cosine', (1.0, 0.0, 0.0), 30.0),                  # across the mean wind
    ('cosine', (0.0, -1.0, 0.0), 30.0),                 # against it
    ('eog', (0.0, 1.0, 0.0), SPEED),
])
def test_front_travels_at_its_own_speed(steady, kind, direction, speed):
    """Start upwind; a front runs into the air ahead, an EOG is carried by the mean wind."""
    steady.start_gust(Gust(30.0, 4.0, direction=direction, kind=kind, upwind=UPWIND), 1.0)
    distances, times = np.array([-30.0, 0.0, 50.0, 120.0]), np.arange(0.0, 30.0, 0.01)
    found = _arrivals(steady, direction, distances, times)
    np.testing.assert_allclose(found, 1.0 + (distances + UPWIND) / speed + 2.0, atol=0.011)


def test_lull_travels_with_the_mean_wind(steady):
    """Find the calmest moment downwind when the mean wind has come there."""
    steady.start_gust(Gust(-6.0, 4.0, upwind=UPWIND), 1.0)
    times = np.arange(0.0, 30.0, 0.01)
    calmest = times[np.argmin(_history(steady, (0.0, 50.0, 3.0), times)[:, 1])]
    assert calmest == pytest.approx(1.0 + 90.0 / SPEED + 2.0, abs=0.011)


def test_leaves_keep_apart_in_a_strong_gust():
    """Carry what comes off along 20 m of trees with the air: it must not gather at the front."""
    wind = Wind(WindSettings((6.0, 0.0, 0.0), turbulence_intensity=0.0, profile='uniform'))
    wind.start_gust(Gust(64.0, 12.0, rise=2.0, upwind=25.0), 0.0)
    place = np.column_stack([np.linspace(0.0, 20.0, 81), np.zeros(81), np.full(81, 5.0)])
    loose = np.zeros(81, bool)
    for time in np.arange(0.0, 4.0, 0.01):
        air = wind.velocity(place, time)
        loose |= air[:, 0] > 17.0
        place[loose] += 0.01 * air[loose]
        if place[0, 0] > 40.0:
            break
    assert np.all(loose) and place[0, 0] > 40.0
    assert np.ptp(place[:, 0]) > 6.0


def test_gust_starts_smoothly_everywhere(steady):
    """Find no jump at the start, even upwind of where the front sets out."""
    steady.start_gust(Gust(6.0, 4.0, upwind=UPWIND), 1.0)
    for y in (-500.0, -UPWIND, 0.0):
        history = _history(steady, (0.0, y, 3.0), np.arange(0.0, 12.0, 0.01))[:, 1]
        assert np.abs(np.diff(history)).max() < 0.06
        assert history.max() == pytest.approx(SPEED + 6.0, abs=1e-3)


def test_gusts_add_and_show_at_the_reference(steady):
    """Let a gust across and a lull blow together."""
    steady.start_gust(Gust(4.0, 6.0, direction=(2.0, 0.0, 0.0), upwind=0.0), 0.0)
    steady.start_gust(Gust(-3.0, 6.0, upwind=0.0), 0.0)
    reference = steady.at_reference(3.0)
    np.testing.assert_allclose(reference.gust, [4.0, -3.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(reference.mean, [0.0, SPEED, 0.0])
    steady.reset()
    np.testing.assert_array_equal(steady.at_reference(3.0).gust, 0.0)


def test_gusts_long_gone_are_forgotten(steady):
    """Start many gusts over a long time and keep only those that may still be felt."""
    for start in range(0, 100000, 1000):
        steady.start_gust(Gust(4.0, 6.0), float(start))
    assert len(steady._gusts) == 1


def test_gust_in_still_air_needs_a_direction():
    """Refuse a gust without direction in still air; take one with."""
    wind = Wind(WindSettings())
    with pytest.raises(CommandError, match='gust.direction'):
        wind.start_gust(Gust(), 0.0)
    assert wind.is_still(0.0)
    wind.start_gust(Gust(5.0, 4.0, direction=(2.0, 0.0, 0.0), upwind=0.0), 0.0)
    assert not wind.is_still(0.0)
    np.testing.assert_allclose(wind.velocity([[0.0, 0.0, 10.0]], 2.0), [[5.0, 0.0, 0.0]])


def test_the_ground_slows_a_gust():
    """Keep the strength of a gust at trees, and let it die away with the mean wind below."""
    wind = Wind(WindSettings((4.0, 0.0, 0.0), turbulence_intensity=0.0, roughness_length=0.02))
    points = np.array([[0.0, 0.0, z] for z in (10.0, 2.0, 0.2, 0.02, 0.0)])
    calm = wind.velocity(points, 2.0)[:, 0]
    wind.start_gust(Gust(20.0, 4.0, upwind=0.0), 0.0)
    added = wind.velocity(points, 2.0)[:, 0] - calm
    np.testing.assert_allclose(added, [20.0, 20.0, 10.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(('values', 'words'), [
    ({'amplitude': float('nan')}, ['gust.amplitude', 'nan']),
    ({'duration': 0.0}, ['gust.duration', '0.05']),
    ({'duration': 4.0, 'rise': 3.0}, ['gust.rise', '3', '2']),
    ({'kind': 'squall'}, ['gust.kind', 'eog, cosine']),
    ({'direction': (0.0, 0.0, 0.0)}, ['gust.direction', 'length']),
    ({'direction': (float('inf'), 0.0, 0.0)}, ['gust.direction', 'inf']),
    ({'upwind': -1.0}, ['gust.upwind', '-1']),
])
def test_bad_gusts_are_refused(values, words):
    """Name the key, the value and what is allowed."""
    with pytest.raises(SceneError) as caught:
        Gust(**values)
    assert all(word in str(caught.value) for word in words), str(caught.value)
