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


"""Erosion: no soil gained or lost, no slope too steep, streams that form a network."""

import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.errors import SceneError
from procphys_ros.physics import erosion
from procphys_ros.physics.erosion import (
    corner_shares,
    drain,
    drained,
    erode,
    Rain,
    Soil,
    SOILS,
    volume,
)
from procphys_ros.physics.world import World
from procphys_ros.scene import Scene
from procphys_ros.scene.terrain import make_terrain, TerrainSettings

HOUR, STORM = 3600.0, 50e-3 / 3600.0  # [s], [m/s]
TINY = 1e-9  # [-] rounding of slopes


def hills(seed, extent=64.0, **about):
    """Make hills up, worn or not."""
    about = {'noise': 8.0, 'wavelength': 40.0, **about}
    return make_terrain(TerrainSettings(seed=seed, extent=extent, **about), 0)


def drawn_ground(seed):
    """Draw the heights of a ground of some kind, and the edge of its cells [m]."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(2, 40, 2))
    x, y = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing='ij')
    grounds = [
        np.full(shape, -3.0),
        rng.uniform(0.0, rng.choice([0.1, 5.0, 40.0]), shape),
        np.where(rng.random(shape) < 0.02, 30.0, 0.0),
        np.where(rng.random(shape) < 0.02, -20.0, 0.0) + x,
        np.where(x > 0.1, 12.0, 100.0),
        8.0 * (x * x + y * y) + 4000.0,
        rng.uniform(-6.0, 6.0) * x + rng.uniform(-6.0, 6.0) * y,
        np.floor(4.0 * np.sin(5.0 * x) * np.cos(4.0 * y)),
    ]
    return grounds[seed % len(grounds)], float(rng.choice([0.1, 1.0, 30.0]))


def steepest(heights, edge):
    """Return the tangent of the steepest of all slopes between neighbours."""
    along = [heights[1:] - heights[:-1], heights[:, 1:] - heights[:, :-1]]
    across = [heights[1:, 1:] - heights[:-1, :-1], heights[1:, :-1] - heights[:-1, 1:]]
    return max(float(np.abs(drop).max(initial=0.0)) / length for drops, length in (
        (along, edge), (across, np.sqrt(2.0) * edge)) for drop in drops)


def streams(heights):
    """Find drainage down the steepest of eight ways."""
    return drain(heights, np.full(heights.shape, np.sqrt(2.0)))


def hack_exponent(heights):
    """
    Fit how lengths of longest streams grow with the areas that they drain.

    Means of classes that each double the area count, from 16 cells, where slopes end, to 1 % of
    the grid, whose edge cuts larger basins.
    """
    drainage = streams(heights)
    area, length = drained(drainage, corner_shares(heights.shape)), np.zeros(heights.size)
    for c in drainage.order[::-1]:
        r = drainage.receiver[c]
        length[r] = max(length[r], length[c] + drainage.way[c])
    within = (area >= 16.0) & (area <= 0.01 * heights.size)
    classes = np.floor(np.log2(area[within]))
    points = [[np.log(v[within][classes == k]).mean() for v in (area, length)]
              for k in np.unique(classes)]
    return float(np.polyfit(*np.transpose(points), 1)[0])


@pytest.mark.parametrize('seed', range(32))
def test_soil_is_conserved_and_no_slope_is_too_steep(seed):
    """Find on any ground what was there, less what streams took away; nothing gets steeper."""
    before, edge = drawn_ground(seed)
    name = sorted(SOILS)[seed % 3]
    rng = np.random.default_rng(seed)
    rain = Rain(STORM, HOUR * rng.choice([0.1, 30.0, 1e4]))
    eroded = erode(before, edge, rain, SOILS[name], rng)
    assert eroded.settled and np.isfinite(eroded.heights).all()
    moved = volume(np.abs(before - before.min()), edge)
    assert volume(eroded.heights - before, edge) == pytest.approx(
        -eroded.carried_off, abs=1e-9 * moved)
    assert eroded.carried_off >= 0.0
    assert steepest(eroded.heights, edge) <= np.tan(SOILS[name].repose) + TINY * np.ptp(before)
    assert before.min() - TINY <= eroded.heights.min()
    assert eroded.heights.max() <= before.max() + TINY


def test_volumes_are_those_below_the_triangles():
    """Hold the shares of corners to the surface that all else stands on."""
    terrain = hills(1, 12.0, cell=2.0)
    points, faces = terrain.mesh()
    corners = points[faces]
    across = corners[:, 1:, :2] - corners[:, :1, :2]
    areas = 0.5 * (across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0])
    assert volume(terrain.heights, 2.0) == pytest.approx(
        float((areas * corners[:, :, 2].mean(axis=1)).sum()))


def test_a_column_slides_into_a_cone():
    """End a slide of dry sand between the slopes at which it stops and starts; it is a cone."""
    ground, sand = np.zeros((61, 61)), SOILS['sand']
    ground[30, 30] = 3000.0
    slid = erode(ground, 1.0, Rain(0.0, 0.0), sand, np.random.default_rng(0))
    assert slid.carried_off == 0.0
    assert volume(slid.heights, 1.0) == pytest.approx(3000.0)
    tangent = np.tan(sand.repose - np.radians(1.0))
    assert slid.heights.max() == pytest.approx(
        np.cbrt(3.0 * 3000.0 * tangent * tangent / np.pi), rel=0.1)


def test_what_stands_less_steep_does_not_slide():
    """Leave a slope below the angle of repose as it is, when no rain falls."""
    ground = np.arange(20.0)[:, None] * np.tan(np.radians(32.0)) + np.zeros((20, 20))
    dry = erode(ground, 1.0, Rain(0.0, HOUR), SOILS['sand'], np.random.default_rng(0))
    np.testing.assert_array_equal(dry.heights, ground)


@pytest.mark.parametrize('settling', [0.0, 1.0])
def test_a_stream_wears_as_the_energy_that_it_spends(settling, monkeypatch):
    """Lower one corner over level ground as closed form says, halved where half falls back."""
    monkeypatch.setattr(erosion, '_PATCHES', 0.0)
    ground, edge, soil = np.zeros((3, 3)), 2.0, Soil(1e-6, settling, 1.0)
    ground[1, 1] = 1e-3
    rain = Rain(STORM, HOUR)
    eroded = erode(ground, edge, rain, soil, np.random.default_rng(0))
    discharge = STORM * edge * edge
    # Power per length over the width, 5 √Q: 9810 Q S / (5 √Q).
    rate = 1e-6 * 9810.0 * np.sqrt(discharge) / 5.0 / edge / (1.0 + settling)
    assert eroded.heights[1, 1] == pytest.approx(1e-3 * np.exp(-rate * HOUR), rel=1e-4)
    assert 1e-3 - eroded.heights[1, 1] > 1e-6


def test_water_fills_hollows_and_leaves_over_the_lowest_sill():
    """Drain a bowl over its gap; what is worn above settles in it, up to there at most."""
    ground = np.full((11, 11), 2.0)
    ground[2:9, 2:9] = 0.0
    ground[5, 9:] = 1.0
    drainage = streams(ground)
    surface = drainage.surface.reshape(11, 11)
    assert (surface[2:9, 2:9] == 1.0).all() and (surface[:2] == 2.0).all()
    area = drained(drainage, corner_shares(ground.shape)).reshape(11, 11)
    assert area[5, 10] > 49.0
    light = SOILS['loam']._replace(settling=0.0)  # falls out of still water only
    worn = erode(ground, 4.0, Rain(STORM, 20.0 * HOUR), light, np.random.default_rng(1)).heights
    rise = (worn - ground)[2:9, 2:9]
    assert rise.mean() > 0.1 and rise.min() >= 0.0 and worn[2:9, 2:9].max() <= 1.0 + TINY
    assert steepest(worn, 4.0) < np.tan(light.repose - np.radians(2.0))  # nothing slid


@pytest.mark.parametrize('seed', range(4))
def test_all_water_reaches_the_edge(seed):
    """Follow every corner's water to the edge; the areas that drain there are the whole grid."""
    worn = hills(seed, erosion=50.0).heights
    drainage = streams(worn)
    at = np.arange(worn.size)
    for _ in range(worn.size):
        then, at = at, drainage.receiver[at]
        if (then == at).all():
            break
    x, y = np.unravel_index(at, worn.shape)
    n = len(worn) - 1
    assert (np.isin(x, (0, n)) | np.isin(y, (0, n))).all()
    area = drained(drainage, corner_shares(worn.shape))
    assert area[np.unique(at)].sum() == pytest.approx(n * n)


@pytest.mark.report('nature')
@pytest.mark.parametrize('seed', range(4))
def test_streams_obey_hacks_law(seed, measured):
    """Grow networks whose streams lengthen with area as those of nature; hills are none."""
    about = {'noise': 8.0, 'wavelength': 70.0, 'extent': 256.0}
    measured.within("Hack's exponent of streams after 200 h of rain of 50 mm/h on loam "
                    '(Hack 1957; Rigon et al. 1996)',
                    hack_exponent(hills(seed, erosion=200.0, **about).heights), 0.5, 0.65)
    assert hack_exponent(hills(seed, **about).heights) < 0.4


def test_seeds_are_reproducible():
    """Wear a ground twice alike, and otherwise with another seed, be it from a file."""
    first, again = (hills(3, erosion=20.0).heights for _ in range(2))
    assert first.tobytes() == again.tobytes()
    ground = hills(3).heights
    worn = [erode(ground, 1.0, Rain(STORM, 20.0 * HOUR), SOILS['loam'],
                  np.random.default_rng(seed)).heights for seed in (1, 2)]
    assert np.abs(worn[0] - worn[1]).max() > 0.01


def test_more_hours_and_softer_soil_wear_more():
    """Order what is gone by hours, rain and soil."""
    ground = hills(2).heights

    def gone(rain=STORM, hours=10.0, soil='loam'):
        return erode(ground, 1.0, Rain(rain, hours * HOUR), SOILS[soil],
                     np.random.default_rng(1)).carried_off

    assert 0.0 < gone(hours=5.0) < gone() < gone(hours=20.0)
    assert gone(rain=0.5 * STORM) < gone()
    assert gone(soil='clay') < gone() < gone(soil='sand')


def test_ground_without_erosion_is_as_before(monkeypatch):
    """Compile and compute nothing where no rain fell."""
    monkeypatch.setattr('procphys_ros.scene.terrain.erode', None)
    assert hills(1).bounds() == (0.0, pytest.approx(8.0))


def test_the_edge_stays_and_the_lowest_point_is_zero():
    """Keep the level edge of made-up hills."""
    worn = hills(1, erosion=100.0).heights
    for side in (worn[0], worn[-1], worn[:, 0], worn[:, -1]):
        assert not side.any()
    assert worn.min() == 0.0 and worn.max() > 2.0


def test_heights_of_a_file_are_worn(tmp_path):
    """Wear a ridge from a file, from its lowest point on."""
    ridge = np.maximum(6.0 - np.abs(np.arange(-12.0, 13.0)), 0.0) + np.full((25, 25), 700.0)
    np.savez(tmp_path / 'a.npz', heights=ridge, cell=2.0)
    terrain = Scene.from_parameters(
        {'terrain': {'file': 'a.npz', 'erosion': 100.0, 'seed': 4}}, tmp_path).settings.terrain
    low, high = terrain.bounds()
    assert low == 0.0 and 3.0 < high <= 6.0


def test_a_box_comes_to_rest_in_a_gully():
    """Drop a box on worn ground: it ends on its surface."""
    terrain = hills(1, erosion=50.0)
    with World(engine='native', terrain=terrain) as world:
        ground = terrain.height(np.zeros((1, 2)))[0]
        box = world.add_body(Shape.BOX, np.full(3, 0.5), 50.0, np.array(
            [0.0, 0.0, ground + 0.6, 0.0, 0.0, 0.0, 1.0]))
        for _ in range(180):
            world.step(1.0 / 60.0)
        pose = world.poses([box])[0]
    over = pose[2] - terrain.height(pose[None])[0]
    assert 0.2 < over < 0.45


@pytest.mark.parametrize('about, said', [
    ({'erosion': 10.0}, 'terrain.file or terrain.noise'),
    ({'noise': 5.0, 'erosion': -1.0}, 'terrain.erosion is -1, it must be a number from 0 to 1'),
    ({'noise': 5.0, 'erosion': float('nan')}, 'terrain.erosion is nan'),
    ({'noise': 5.0, 'rain': 0.0}, 'terrain.rain is 0, it must be a number from 1 to 500 mm/h'),
    ({'noise': 5.0, 'soil': 'mud'}, 'it must be one of clay, loam, sand'),
    ({'noise': 500.0, 'wavelength': 150.0, 'extent': 160.0, 'erosion': 1.0},
     'loam stands at up to 38 degrees')])
def test_what_cannot_be_is_refused(about, said):
    """Name the key and what is allowed."""
    with pytest.raises(SceneError, match=said):
        Scene.from_parameters({'terrain': about})
