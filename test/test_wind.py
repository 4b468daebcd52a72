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

"""The wind: its statistics, profile, history, gusts and shelter."""

import itertools
import math
from pathlib import Path
import pickle

from masonry_walls import wall
import numpy as np
import pytest
from scipy import ndimage

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.physics.wind import eddies, Gust, Shelter, spectra, Wind, WindSettings
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

SPEED = 10.0      # [m/s] mean wind of most tests
INTENSITY = 0.2
SEED = 3          # of the eddies
RATIOS = {'kaimal': (1.0, 0.8, 0.5), 'von_karman': (1.0, 1.0, 1.0)}


def _settings(**changes):
    return WindSettings(**{'velocity': (SPEED, 0.0, 0.0), 'turbulence_intensity': INTENSITY,
                           'profile': 'uniform', **changes})


@pytest.fixture(scope='module', params=['kaimal', 'von_karman'])
def either(request):
    """Set up a wind along x with each spectrum."""
    return Wind(_settings(spectrum=request.param), SEED)


@pytest.fixture(scope='module')
def wind():
    """Set up a wind along x."""
    return Wind(_settings(), SEED)


@pytest.fixture
def steered():
    """Set up a wind that a test may command."""
    return Wind(_settings(), SEED)


def _records(wind, points, times):
    """Return fluctuations (times, points, 3)."""
    return np.array([wind.velocity(points, t) for t in times]) - [SPEED, 0.0, 0.0]


def _scattered(count, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform((-100.0, -128.0, 0.0), (100.0, 128.0, 64.0), (count, 3))


@pytest.mark.report('nature')
def test_variance_is_that_of_the_settings(either, measured):
    """Compare the standard deviations with TI·U times the IEC ratios."""
    wind = either
    found = _records(wind, _scattered(4000), np.arange(0.0, 400.0, 7.3)).std(axis=(0, 1))
    wanted = INTENSITY * SPEED * np.array(RATIOS[wind.settings.spectrum])
    for axis, got, expected in zip(('along', 'across', 'up'), found, wanted):
        measured(f'standard deviation of the wind, {axis} ({wind.settings.spectrum}, IEC 61400-1)',
                 got, expected, 'm/s', rtol=0.03)


def test_variance_does_not_depend_on_the_place_in_a_cell(wind):
    """Compare nodes of both grids with the middles of their cells, where most is averaged."""
    rng = np.random.default_rng(1)
    nodes = rng.integers(-500, 500, (6000, 3)) * [4.0, 2.0, 2.0]
    middles = nodes + [2.25, 1.5, 1.5]
    deviations = []
    for points in (nodes, middles):
        deviations.append(_records(wind, points, np.arange(0.0, 200.0, 8.0)).std(axis=(0, 1)))
    np.testing.assert_allclose(deviations[0], deviations[1], rtol=0.04)


@pytest.mark.report('nature')
def test_spectrum_at_a_point_is_the_target(either, measured):
    """Compare spectra of time series, averaged over places, with the target band by band."""
    from scipy import signal  # takes a second, in every process that collects tests
    # Bands reach from 0.02 Hz to 8 Hz, wavelengths of 500 m to 1.25 m at 10 m/s; the finest waves
    # of the grid are 1 m long, and what is finer still is shared out over those below 31 m (0.32
    # Hz).
    wind, rate = either, 20.0
    records = _records(wind, _scattered(150), np.arange(0.0, 400.0, 1.0 / rate))
    frequency, found = signal.welch(records, rate, nperseg=4000, axis=0)
    target = spectra.make(wind.settings.spectrum, 10.0)
    for component in range(3):
        sigma = INTENSITY * SPEED * target.ratios[component]
        wanted = sigma ** 2 * target.density(component, frequency / SPEED) / SPEED
        name, title = ('u', 'v', 'w')[component], f'Spectrum of the wind: {wind.settings.spectrum}'
        got, expected = [], []
        bands = np.array([0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 4.0, 8.0])
        for low, high in itertools.pairwise(bands):
            band = (frequency >= low) & (frequency < high)
            got.append(found[band, :, component].mean())
            expected.append(wanted[band].mean())
            measured(f'power of the wind in a band over the target, {name} '
                     f'({wind.settings.spectrum})', got[-1] / expected[-1], 1.07, atol=0.24)
        middle, axes = np.sqrt(bands[:-1] * bands[1:]), ('frequency [Hz]', 'power [m²/s]')
        logs = 'log', 'log'
        measured.curve(title, name, middle, got, axes, logs)
        measured.curve(title, f'{name}, expected', middle, expected, axes, logs)


def _assert_coherence(wind, near, axis, distance, tolerance, slant=(0.0, 0.0)):
    """
    Compare the coherence of pairs of places with the standard, in bands of an octave.

    :param slant: how far the places move across the wind and up per way of the wind.
    """
    from scipy import signal  # takes a second, in every process that collects tests
    rate = 5.0
    both = np.concatenate([near, near + distance * np.eye(3)[axis]])
    times = np.arange(0.0, 400.0, 1.0 / rate)
    a, b = np.split(np.array([wind.velocity(both + SPEED * t * np.array([0.0, *slant]), t)[:, 0]
                              for t in times]) - SPEED, 2, axis=1)
    frequency, cross = signal.csd(a, b, rate, nperseg=250, axis=0)
    power = [signal.welch(x, rate, nperseg=250, axis=0)[1].mean(axis=1) for x in (a, b)]
    found = cross.mean(axis=1).real / np.sqrt(power[0] * power[1])
    length = spectra.make(wind.settings.spectrum, 10.0).lengths[0]
    wanted = np.exp(-12.0 * np.hypot(frequency * distance / SPEED, 0.12 * distance / length))
    for low, high in itertools.pairwise([0.03, 0.07, 0.15, 0.3, 0.6, 1.2, 2.4]):
        band = (frequency >= low) & (frequency < high)
        assert found[band].mean() == pytest.approx(wanted[band].mean(), abs=tolerance)


@pytest.mark.parametrize(('axis', 'distance', 'tolerance'), [
    (1, 2.0, 0.16), (2, 16.0, 0.07)])
def test_coherence_anywhere_is_near_that_of_the_standard(wind, axis, distance, tolerance):
    """Allow for interpolation, which makes places within a cell somewhat too much alike."""
    _assert_coherence(wind, _scattered(200), axis, distance, tolerance)


@pytest.mark.parametrize('distance', [2.0, 16.0])
def test_coherence_at_nodes_is_that_of_the_standard(wind, distance):
    """Compare exp(-12 hypot(f d/U, 0.12 d/L)) for places above each other on the moving grid."""
    nodes = np.round(_scattered(200) / 4.0) * 4.0
    _assert_coherence(wind, nodes, 2, distance, 0.07, eddies.DRIFT)


def test_kernel_interpolates_as_scipy_does(wind):
    """Compare with tri-linear map_coordinates on the periodic boxes, variance restored."""
    rng = np.random.default_rng(SEED)
    spectrum = spectra.make(wind.settings.spectrum, 10.0)
    points = np.random.default_rng(9).uniform(-3000.0, 3000.0, (500, 3))
    wanted = np.zeros((500, 3))
    for box in eddies.make_boxes(spectrum, rng):
        place = (points / box.spacing).T
        fraction = place - np.floor(place)
        for c in range(3):
            mean = ndimage.map_coordinates(box.field[..., c].astype(float), place, order=1,
                                           mode='grid-wrap')
            kept = ndimage.map_coordinates(box.lags[c], 2 * fraction * (1 - fraction), order=1)
            wanted[:, c] += mean / np.sqrt(kept)
    found = wind.velocity(points, 0.0) - [SPEED, 0.0, 0.0]
    np.testing.assert_allclose(found, INTENSITY * SPEED * wanted, atol=1e-5)


def test_eddies_travel_with_the_mean_wind(wind):
    """Find a front again 40 m downwind, 4 s later, by cross-correlation."""
    rate = 20.0
    points = np.repeat(_scattered(40), 2, axis=0)
    points[1::2, 0] = points[::2, 0] + 40.0
    records = _records(wind, points, np.arange(0.0, 200.0, 1.0 / rate))[..., 0]
    lags = np.arange(0, 161)
    count = len(records) - lags[-1]
    rise = [(records[:count, ::2] * records[lag:lag + count, 1::2]).mean() for lag in lags]
    assert lags[np.argmax(rise)] / rate == pytest.approx(4.0, abs=0.06)
    assert max(rise) > 0.9 * (records ** 2).mean()


def test_slow_turbulence_is_there(wind):
    """Compare the spectrum from 1/1000 Hz to 0.05 Hz with the target, band by band."""
    from scipy import signal  # takes a second, in every process that collects tests
    # Places 48 m apart hardly share their long waves, so that many records stand for a long one.
    # With 14 seeds the ratios have a standard deviation of at most 0.21 in the lowest band and 0.1
    # in the others; four and three of them are allowed.
    rate = 2.0
    grid = np.meshgrid(np.arange(4) * -60e3, np.arange(5) * 48.0, [8.0, 40.0])
    points = np.column_stack([axis.ravel() for axis in grid])
    records = _records(wind, points, np.arange(0.0, 4096.0, 1.0 / rate))
    target = spectra.make(wind.settings.spectrum, 10.0)
    frequency, found = signal.periodogram(records, rate, 'hann', detrend=False, axis=0)
    for component in range(2):
        sigma = INTENSITY * SPEED * target.ratios[component]
        wanted = sigma ** 2 * target.density(component, frequency / SPEED) / SPEED
        for low, high in itertools.pairwise([0.0008, 0.0025, 0.005, 0.01, 0.02, 0.05]):
            band = (frequency >= low) & (frequency < high)
            ratio = found[band, :, component].mean() / wanted[band].mean()
            most = 0.84 if low < 0.0025 else 0.35
            assert ratio == pytest.approx(1.0, abs=most), (component, low, high)


def test_no_wind_comes_back_within_a_day(wind):
    """Hold every box away from where it was, for 24 h at every speed allowed (closed form)."""
    # A box is back along the wind after whole periods; slants have moved it aside by then.
    rng = np.random.default_rng(SEED)
    boxes = eddies.make_boxes(spectra.make(wind.settings.spectrum, 10.0), rng)
    for box in boxes:
        laps = np.arange(1, int(24 * 3600 * 150.0 / box.period[0]) + 1)
        aside = np.outer(laps * box.period[0], eddies.DRIFT)
        aside -= box.period[1:] * np.round(aside / box.period[1:])
        distance = np.hypot(*aside.T)
        within = laps * box.period[0] < 24 * 3600 * SPEED
        assert distance.min() > 0.1
        assert distance[within].min() > 0.5


@pytest.mark.parametrize(('profile', 'wanted'), [
    ('log', lambda z: np.log(np.maximum(z, 0.1) / 0.1) / np.log(12.0 / 0.1)),
    ('power', lambda z: (z / 12.0) ** 0.14),
    ('uniform', np.ones_like),
])
def test_mean_profile_is_exact(profile, wanted):
    """Compare the mean wind at several heights with the formulas."""
    velocity = np.array([3.0, -4.0, 0.5])
    wind = Wind(WindSettings(velocity, turbulence_intensity=0.0, profile=profile, exponent=0.14,
                             roughness_length=0.1, reference_height=12.0))
    heights = np.array([0.0, 0.05, 0.1, 1.0, 6.0, 12.0, 40.0])
    points = np.column_stack([heights, heights, heights])
    expected = wanted(heights)[:, None] * velocity
    np.testing.assert_allclose(wind.velocity(points, 7.0), expected, rtol=1e-12, atol=1e-12)


def test_the_ground_slows_eddies_as_it_does_gusts():
    """Compare eddies over rough ground with those of a wind that knows no ground."""
    points = np.array([[3.0, 5.0, z] for z in (10.0, 2.0, 0.2, 0.02, 0.0)])
    free = _records(Wind(_settings(), SEED), points, [1.0])[0]
    rough = Wind(_settings(profile='log', roughness_length=0.02), SEED)
    still = Wind(_settings(profile='log', roughness_length=0.02, turbulence_intensity=0.0), SEED)
    eddies_there = rough.velocity(points, 1.0) - still.velocity(points, 1.0)
    share = np.array([[1.0], [1.0], [0.5], [0.0], [0.0]])
    np.testing.assert_allclose(eddies_there, share * free, atol=1e-9)


def test_wind_from_any_direction_has_the_same_eddies():
    """Turn the wind and the points together: the velocities turn along."""
    points = _scattered(300)
    turned = points[:, [1, 0, 2]] * [-1.0, 1.0, 1.0]
    along_x = Wind(_settings(), SEED).velocity(points, 3.0)
    along_y = Wind(_settings(velocity=(0.0, SPEED, 0.0)), SEED).velocity(turned, 3.0)
    np.testing.assert_allclose(along_y, along_x[:, [1, 0, 2]] * [-1.0, 1.0, 1.0], atol=1e-9)


def test_seed_decides():
    """Get the same wind from the same seed and another from another."""
    points = _scattered(50)
    one, same, other = (Wind(_settings(), seed).velocity(points, 1.0) for seed in (SEED, SEED, 2))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 1.0


def test_speed_change_keeps_the_phase(steered):
    """Double the speed: the eddies stay where they are, then travel twice as fast."""
    points = _scattered(50)
    before = steered.velocity(points, 10.0) - [SPEED, 0.0, 0.0]
    steered.set_velocity((2.0 * SPEED, 0.0, 0.0), 10.0)
    after = steered.velocity(points, 10.0) - [2.0 * SPEED, 0.0, 0.0]
    np.testing.assert_allclose(after, 2.0 * before, rtol=1e-9, atol=1e-9)
    later = steered.velocity(points, 15.0) - [2.0 * SPEED, 0.0, 0.0]
    unchanged = Wind(_settings(), SEED).velocity(points, 20.0) - [SPEED, 0.0, 0.0]
    np.testing.assert_allclose(later, 2.0 * unchanged, rtol=1e-7, atol=1e-7)


def test_going_back_in_time_gives_the_same_wind(steered):
    """Ask for earlier times after commands and later times, and after a reset."""
    points = _scattered(50)
    early = steered.velocity(points, 2.0)
    steered.set_velocity((3.0, 4.0, 0.0), 5.0)
    late = steered.velocity(points, 8.0)
    np.testing.assert_array_equal(steered.velocity(points, 2.0), early)
    np.testing.assert_array_equal(steered.velocity(points, 8.0), late)
    steered.reset()
    np.testing.assert_array_equal(steered.velocity(points, 2.0), early)
    assert np.abs(steered.velocity(points, 8.0) - late).max() > 1.0


def test_still_air_has_no_turbulence(steered):
    """Set the mean wind to zero and find every velocity zero, and the wind back afterwards."""
    points = _scattered(20)
    steered.set_velocity((0.0, 0.0, 0.0), 4.0)
    np.testing.assert_array_equal(steered.velocity(points, 6.0), 0.0)
    steered.set_velocity((SPEED, 0.0, 0.0), 9.0)
    resumed = Wind(_settings(), SEED).velocity(points, 5.0)
    np.testing.assert_allclose(steered.velocity(points, 10.0), resumed, atol=1e-9)


def test_wind_can_be_switched_off(steered):
    """Disable the wind: still air; enable it: as if nothing had been."""
    points = _scattered(20)
    blowing = steered.velocity(points, 4.0)
    steered.enabled = False
    out = np.full((20, 3), 7.0)
    assert steered.velocity(points, 4.0, out) is out
    np.testing.assert_array_equal(out, 0.0)
    assert not np.any(steered.at_reference(4.0))
    steered.enabled = True
    np.testing.assert_array_equal(steered.velocity(points, 4.0), blowing)


def test_reference_is_the_wind_at_its_height(steered):
    """Add mean, turbulence and gust up to the velocity at the point."""
    reference = steered.at_reference(3.0)
    np.testing.assert_allclose(reference.mean, [SPEED, 0.0, 0.0])
    np.testing.assert_array_equal(reference.gust, 0.0)
    at_point = steered.velocity(np.array([[0.0, 0.0, 10.0]]), 3.0)[0]
    np.testing.assert_allclose(sum(reference), at_point, atol=1e-12)


def test_settings_change_while_it_blows(steered):
    """Go over to other settings: new strength at once, new eddies only when they must be."""
    points = _scattered(50)
    before = steered.velocity(points, 4.0) - [SPEED, 0.0, 0.0]
    steered.change(_settings(turbulence_intensity=0.1))
    after = steered.velocity(points, 4.0) - [SPEED, 0.0, 0.0]
    np.testing.assert_allclose(after, 0.5 * before, atol=1e-9)
    steered.change(_settings(spectrum='von_karman'))
    other = steered.velocity(points, 4.0) - [SPEED, 0.0, 0.0]
    assert np.abs(other - before).max() > 1.0


@pytest.mark.parametrize(('changes', 'words'), [
    ({'velocity': (1.0, float('nan'), 0.0)}, ['wind.velocity', 'nan']),
    ({'velocity': (1.0, 2.0)}, ['wind.velocity', '3 numbers']),
    ({'velocity': (1e4, 0.0, 0.0)}, ['wind.velocity', '150']),
    ({'velocity': 'west'}, ['wind.velocity', 'west']),
    ({'profile': 'logg'}, ['wind.profile', 'logg', 'log, power, uniform']),
    ({'profile': 'log', 'roughness_length': 3.0, 'reference_height': 2.0},
     ['wind.roughness_length', 'wind.reference_height']),
])
def test_bad_settings_are_refused(changes, words):
    """Name the key, the value and what is allowed."""
    with pytest.raises(SceneError) as caught:
        _settings(**changes)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_bad_velocity_leaves_the_wind_as_it_was(steered):
    """Refuse NaN and keep blowing."""
    points = _scattered(5)
    before = steered.velocity(points, 4.0)
    with pytest.raises(SceneError):
        steered.set_velocity((np.nan, 0.0, 0.0), 3.0)
    np.testing.assert_array_equal(steered.velocity(points, 4.0), before)


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


_CALM = {'turbulence_intensity': 0.0, 'profile': 'uniform'}
_STORM = """# a front goes through
time, speed, direction
0, 10, 270
100, 20, 270   # twice as strong
200, 20, 300
"""


def _even_wind(**changes):
    return Wind(WindSettings(**{'velocity': (10.0, 0.0, 0.0), **_CALM, **changes}))


def _scene(folder: Path, text: str) -> Scene:
    (folder / 'storm.csv').write_text(text, encoding='utf-8')
    return Scene.from_parameters({'wind': {**_CALM, 'file': 'storm.csv'}}, folder)


@pytest.mark.parametrize('before, target, ramp, found', [
    ((10.0, 0.0), (20.0, 0.0), 20.0, {0.0: (10.0, 0.0), 10.0: (15.0, 0.0), 900.0: (20.0, 0.0)}),
    ((8.0 * math.cos(0.2), 8.0 * math.sin(0.2)), (8.0 * math.cos(0.2), -8.0 * math.sin(0.2)), 10.0,
     {5.0: (8.0, 0.0), 10.0: (8.0 * math.cos(0.2), -8.0 * math.sin(0.2))}),  # never slower
    ((0.0, 0.0), (0.0, 30.0), 60.0, {6.0: (0.0, 3.0)})])
def test_a_ramp_goes_evenly_on_the_shorter_way_and_stays(before, target, ramp, found):
    """Ramp the speed, the direction, and the wind from still air."""
    wind = _even_wind(velocity=(*before, 0.0))
    wind.set_velocity((*target, 0.0), 0.0, ramp=ramp)
    for time, velocity in found.items():
        assert wind.mean_velocity(time) == pytest.approx((*velocity, 0.0), abs=1e-12)


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
    wind = _even_wind()
    wind.set_velocity((20.0, 0.0, 0.0), 0.0, ramp=20.0)
    wind.set_velocity((5.0, 0.0, 0.0), 10.0)
    assert wind.mean_velocity(5.0) == pytest.approx((12.5, 0.0, 0.0))
    assert wind.mean_velocity(15.0) == (5.0, 0.0, 0.0)


def test_winds_that_are_set_without_end_take_no_memory():
    """Set the wind a thousand times: no more is kept than after a hundred; eddies travel on."""
    wind = _even_wind()
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


BLOWING = 8.0    # [m/s]
UPWIND = 40.0  # [m]


@pytest.fixture
def steady():
    """Set up a steady wind along y."""
    return Wind(WindSettings((0.0, BLOWING, 0.0), turbulence_intensity=0.0, profile='uniform'))


def _history(wind, point, times):
    return np.array([wind.velocity(np.array([point]), t)[0] for t in times])


@pytest.mark.report('nature')
def test_extreme_operating_gust_has_the_shape_of_the_standard(steady, measured):
    """Compare with U - 0.37 V sin(3 pi t/T)(1 - cos(2 pi t/T)) at the origin."""
    steady.start_gust(Gust(5.0, 10.5, kind='eog', upwind=UPWIND), 2.0)
    t = np.linspace(0.0, 10.5, 211)
    found = _history(steady, (3.0, 0.0, 9.0), 2.0 + UPWIND / BLOWING + t)
    shape = -0.37 * 5.0 * np.sin(3 * np.pi * t / 10.5) * (1 - np.cos(2 * np.pi * t / 10.5))
    np.testing.assert_allclose(found[:, 1], BLOWING + shape, atol=1e-9)
    np.testing.assert_allclose(found[:, [0, 2]], 0.0, atol=1e-12)
    measured('peak of the extreme operating gust (IEC 61400-1)', found[:, 1].max(),
             BLOWING + 0.74 * 5.0, 'm/s', rtol=1e-6)
    axes = ('time [s]', 'wind [m/s]')
    measured.curve('Extreme operating gust', 'wind', t, found[:, 1], axes)
    measured.curve('Extreme operating gust', 'IEC 61400-1, expected', t, BLOWING + shape, axes)


def test_cosine_gust_rises_holds_and_falls(steady):
    """Compare with half a cosine up in 2 s, 3 s of full strength, and down again."""
    steady.start_gust(Gust(6.0, 7.0, rise=2.0, upwind=0.0), 0.0)
    found = _history(steady, (0.0, 0.0, 5.0), [0.0, 1.0, 2.0, 3.5, 5.0, 6.0, 7.0])[:, 1] - BLOWING
    np.testing.assert_allclose(found, [0.0, 3.0, 6.0, 6.0, 6.0, 3.0, 0.0], atol=1e-9)


def test_gust_without_rise_is_one_minus_cosine(steady):
    """Compare with A/2 (1 - cos(2 pi t/T))."""
    steady.start_gust(Gust(6.0, 4.0, upwind=0.0), 0.0)
    t = np.linspace(0.0, 4.0, 81)
    found = _history(steady, (0.0, 0.0, 5.0), t)[:, 1] - BLOWING
    np.testing.assert_allclose(found, 3.0 * (1.0 - np.cos(0.5 * np.pi * t)), atol=1e-9)


def _arrivals(wind, direction, distances, times):
    """Find when the wind along a direction peaks at distances from the origin along it."""
    direction = np.array(direction)
    places = distances[:, None] * direction + [0.0, 0.0, 3.0]
    return times[np.argmax([wind.velocity(places, t) @ direction for t in times], axis=0)]


@pytest.mark.parametrize(('kind', 'direction', 'speed'), [
    ('cosine', (0.0, 1.0, 0.0), BLOWING + 30.0),          # into air that flees before it
    ('cosine', (1.0, 0.0, 0.0), 30.0),                  # across the mean wind
    ('cosine', (0.0, -1.0, 0.0), 30.0),                 # against it
    ('eog', (0.0, 1.0, 0.0), BLOWING),
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
    assert calmest == pytest.approx(1.0 + 90.0 / BLOWING + 2.0, abs=0.011)


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
        assert history.max() == pytest.approx(BLOWING + 6.0, abs=1e-3)


def test_gusts_add_and_show_at_the_reference(steady):
    """Let a gust across and a lull blow together."""
    steady.start_gust(Gust(4.0, 6.0, direction=(2.0, 0.0, 0.0), upwind=0.0), 0.0)
    steady.start_gust(Gust(-3.0, 6.0, upwind=0.0), 0.0)
    reference = steady.at_reference(3.0)
    np.testing.assert_allclose(reference.gust, [4.0, -3.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(reference.mean, [0.0, BLOWING, 0.0])
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
