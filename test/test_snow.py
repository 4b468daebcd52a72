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

"""Snow and ice: what crowns and roofs catch, and what it does to them, against closed forms."""

import math

from grown_trees import beam, BENDING, bush, DENSITY, LENGTH, MODULUS, RADIUS
from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.blueprint import skeleton
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.physics.loads import snow
from procphys_ros.scene import Scene
from procphys_ros.scene.snow import SnowLoad
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import Owner

_G = 9.81
_NONE = snow.Tops.over(np.zeros((0, 7)), np.zeros((0, 3)))


def _simulation(*plans, cues=(), **load):
    scene = Scene.from_parameters({'scene': {'objects': [], 'cues': list(cues)}, 'load': load,
                                   'engine': 'native'})
    for number, plan in enumerate(plans):
        scene.add(plan, name=f'thing{number}')
    return Simulation(scene)


def _branch(segments=20):
    """Clamp a level beam, whose weight does not bend it."""
    nodes = np.zeros((segments + 1, 3))
    nodes[:, 0], nodes[:, 2] = np.linspace(0.0, LENGTH, segments + 1), 3.0
    return skeleton.from_nodes(nodes, np.arange(segments + 1) - 1, np.full(segments + 1, RADIUS),
                               density=DENSITY, modulus=MODULUS)


def _slab(width=4.0, thickness=0.2, height=2.0):
    """Lay a slab on two walls of one block each."""
    side = 0.5 * (width - 0.3)
    return bonded([[-side, 0, height / 2], [side, 0, height / 2], [0, 0, height + thickness / 2]],
                  [[0.3, 2, height], [0.3, 2, height], [width, 2, thickness]],
                  tension=2e6, cohesion=2e6, gap=1e-6)


@pytest.mark.parametrize('index', [0.5, 2.0, 5.0])
def test_a_crown_catches_by_the_law_of_beer_and_lambert(index):
    """Let snow fall through a wide crown of a leaf area index: it holds 1 − exp(−L/2) of it."""
    rng = np.random.default_rng(1)
    points = rng.uniform([0.0, 0.0, 2.0], [6.0, 6.0, 5.0], (4000, 3))
    plan = np.full(4000, snow.LEAF_PLAN * index * 36.0 / 4000)
    held = snow.caught(points, plan, _NONE)
    inner = ((points[:, :2] > 1.0) & (points[:, :2] < 5.0)).all(axis=1)
    below = np.column_stack([rng.uniform(1.0, 5.0, (500, 2)), np.zeros(500)])
    assert held[inner].sum() / 16.0 == pytest.approx(1.0 - math.exp(-0.5 * index), rel=0.02)
    assert snow.passed(below, points, plan).mean() == pytest.approx(
        math.exp(-0.5 * index), abs=0.02)
    moved = np.array([1e3 + 0.013, -7.7, 0.4])
    assert snow.caught(points + moved, plan, _NONE) == pytest.approx(held, rel=1e-6)


@pytest.mark.report('nature')
@pytest.mark.parametrize('slope,share', [(0, 0.8), (30, 0.8), (45, 0.4), (60, 0.0), (80, 0.0)])
def test_snow_stays_on_a_roof_as_in_en_1991_1_3(slope, share, measured):
    """Tilt a board, and compare the area that keeps its snow with its plan."""
    half = math.radians(slope) / 2.0
    turned = np.array([[3.0, 1.0, 5.0, 0.0, math.sin(half), 0.0, math.cos(half)]])
    tops = snow.Tops.over(turned, np.array([[4.0, 3.0, 0.001]]))
    plan = 3.0 * 4.0 * math.cos(2.0 * half)
    measured('share of the snow that stays on a roof of 0° to 80° (EN 1991-1-3)',
             tops.areas().sum() / plan, share, '', atol=0.05)
    assert tops.cover(np.array([[3.0, 1.0, 2.0], [3.0, 1.0, 9.0], [9.0, 1.0, 2.0]])).tolist() == [
        True, False, False]


@pytest.mark.report('laws')
def test_a_branch_bends_under_snow_as_a_beam(measured):
    """Lay snow on a level branch: its tip sinks as that of a cantilever with an even load."""
    simulation = _simulation(_branch(60), snow=20.0)
    mass, place = simulation.snow, LENGTH / 60 * (np.arange(60) + 0.5)
    assert mass.sum() == pytest.approx(20.0 * 2.0 * RADIUS * LENGTH, rel=0.12)  # it shades itself
    sinks = mass * _G * place * place * (3.0 * place[-1] - place) / (6.0 * BENDING)
    measured('level branch under 20 kg/m² of snow, sinking of its tip as of a beam',
             3.0 - simulation.poses[-1, 2], sinks.sum(), 'm', rtol=0.02)
    before = simulation.poses.copy()
    simulation.step(30)
    assert np.abs(simulation.poses - before).max() < 1e-3


def test_a_branch_with_snow_swings_slower():
    """Strike a branch with and without ice: its period grows by the root of its mass."""
    periods = []
    for thickness in (0.0, 0.03):
        simulation = _simulation(_branch(), ice=thickness)
        own = simulation.state.parts.mass
        heavier = 1.0 + simulation.snow.sum() / own.sum()
        simulation.apply_impulse(len(own) - 1, (0.0, 5.0, 0.0))
        way = simulation.series(240, [len(own) - 1]).poses[:, 0, 1]
        rises = np.flatnonzero((way[:-1] < 0.0) & (way[1:] >= 0.0))
        periods.append(np.diff(rises).mean())
    ice = 900.0 * math.pi * 0.03 * (2.0 * RADIUS + 0.03) * LENGTH
    assert heavier == pytest.approx(1.0 + ice / own.sum())
    assert periods[1] / periods[0] == pytest.approx(math.sqrt(heavier), rel=0.03)


def test_snow_that_falls_slowly_ends_as_snow_that_lies():
    """Let snow fall on a bush in two seconds: it comes to rest as if it had begun with it."""
    plan = bush()
    lies = _simulation(plan, snow=30.0)
    falls = _simulation(plan, cues=['0 load snow=30 ramp=2'])
    falls.step(60)
    half = falls.snow.sum()
    falls.step(600)
    assert falls.snow_load == SnowLoad(30.0, 0.0, 2.0)
    assert half == pytest.approx(0.5 * falls.snow.sum(), rel=1e-6)
    bare = _simulation(plan)
    sank = (bare.poses[:, 2] - lies.poses[:, 2]).max()
    assert sank > 0.02
    assert falls.poses == pytest.approx(lies.poses, abs=0.1 * sank)  # it lay on the bare bush
    falls.set_snow(0.0)
    falls.step(600)
    assert not falls.snow.any()
    assert falls.poses == pytest.approx(bare.poses, abs=1e-3)


def test_a_slab_bears_its_snow():
    """Lay snow on a slab: its supports carry it; under a wide crown less, under a lid none."""
    load, area = 100.0, 8.0
    simulation = _simulation(_slab(), snow=load)
    assert simulation.snow[2] == pytest.approx(0.8 * load * area, rel=0.03)
    assert not simulation.snow[:2].any()
    force = -simulation.state.loads.layer('snow')[1][:, 2].sum()
    assert force == pytest.approx(_G * simulation.snow.sum())
    covered = _simulation(bonded(
        [[0, 0, 1.0], [0, 0, 2.1]], [[1, 1, 2.0], [3, 3, 0.2]], gap=1e-6), snow=load)
    assert covered.snow[0] == 0.0
    assert covered.snow[1] == pytest.approx(0.8 * load * 9.0, rel=0.03)


def test_the_more_snow_the_more_breaks():
    """Load a thin slab without steel more and more: once it breaks, it breaks with more."""
    broken = []
    for load in (0.0, 100.0, 400.0, 1600.0):
        halves = bonded([[-1.85, 0, 1], [1.85, 0, 1], [-1, 0, 2.05], [1, 0, 2.05]],
                        [[0.3, 2, 2], [0.3, 2, 2], [2, 2, 0.1], [2, 2, 0.1]],
                        tension=5e5, cohesion=5e5, gap=1e-6, density=2400.0)
        simulation = _simulation(halves, snow=load)
        simulation.step(30)
        broken.append(int((simulation.state.parts.owner != Owner.STANDING).sum()))
    assert broken[0] == 0 < broken[-1]
    assert broken == sorted(broken)


def test_what_comes_off_sheds_its_snow():
    """Saw a loaded branch off: it falls without its snow; what held it springs back."""
    simulation = _simulation(bush(), snow=40.0)
    before = simulation.snow.copy()
    forest = simulation.state.forest
    size = forest.ends - np.arange(len(before))
    row = int(np.flatnonzero((size > 8) & (size < 30))[0])
    falls = forest.parts[row:forest.ends[row]]
    assert before[falls].min() > 0.0
    simulation.cut(int(falls[0]))
    before[falls] = 0.0
    assert np.array_equal(simulation.snow, before)
    simulation.step(60)
    assert np.isfinite(simulation.poses).all()


def test_a_saved_and_a_forked_snowfall_go_on_to_the_bit():
    """Save and fork while snow falls on a bush and a slab; add a bush, which has its share."""
    simulation = _simulation(bush(), _slab(), cues=['0 load snow=60 ice=0.005 ramp=1'])
    simulation.step(30)
    data, other = simulation.save(), simulation.fork()
    for run in (simulation, other):
        run.step(45)
    assert np.array_equal(simulation.poses, other.poses)
    poses = simulation.poses.copy()
    simulation.restore(data)
    simulation.step(45)
    assert np.array_equal(simulation.poses, poses)
    alone = _simulation(bush(seed=1), snow=60.0, ice=0.005)
    simulation.add(bush(seed=1), (30.0, 0.0, 0.0), name='late')
    late = simulation.objects[-1]
    own = slice(late.first, late.first + late.count)
    assert simulation.snow[own] == pytest.approx(alone.snow, rel=1e-6)
    simulation.reset()  # before the cue
    assert not simulation.snow.any()
    simulation.set_snow(60.0, 0.005)
    simulation.reset()
    assert simulation.snow_load == SnowLoad(60.0, 0.005, 0.0)
    assert simulation.snow[own] == pytest.approx(alone.snow, rel=1e-6)


def test_plants_grow_on_under_snow():
    """Let a tree with snow grow: its snow stays on it, what it weighs changes by its wood."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['tree']}, 'load': {'snow': 5.0},
        'tree': {'grammar': 'garden_tree.lsys', 'steps': 4}})
    simulation = Simulation(scene)
    before = simulation.snow.sum()
    simulation.grow('tree', rate=1.0, years=1)
    simulation.step(90)
    assert before > 0.0
    assert simulation.snow.sum() == pytest.approx(before)
    forest = simulation.state.forest
    assert forest.model.body[:, 0] == pytest.approx(
        simulation.state.parts.mass[forest.parts] + forest.snow)


@pytest.mark.parametrize('values,told', [
    ({'snow': -1.0}, 'load.snow'), ({'snow': 1e5}, 'load.snow'), ({'ice': math.nan}, 'load.ice'),
    ({'ice': 1.0}, 'load.ice'), ({'ramp': -1.0}, 'load.ramp')])
def test_snow_that_cannot_be_is_refused(values, told):
    """Ask for loads out of range: the message names the key."""
    with pytest.raises((CommandError, SceneError), match=told):
        SnowLoad(**values)


def test_an_upright_beam_in_ice_is_heavier_and_stands():
    """Coat a mast in ice: its foot carries both weights."""
    simulation = _simulation(beam(), ice=0.02)
    simulation.step(10)
    weight = _G * (simulation.state.parts.mass.sum() + simulation.snow.sum())
    assert simulation.state.forest.joint_wrenches[0, 2] == pytest.approx(weight, rel=1e-6)
