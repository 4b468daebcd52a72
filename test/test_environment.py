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

"""Answers of the environment to growing plants, and climbers that hold on to it."""

from dataclasses import replace

from grown_trees import bush
import numpy as np
import pytest
from scipy.special import exp1

from procphys_ros.blueprint import Blueprint, Shape, skeleton
from procphys_ros.environment import Plant, Question
from procphys_ros.environment.habitat import Habitat
from procphys_ros.environment.sky import Cells, DIRECTIONS, sky_directions
from procphys_ros.geometry import rotation
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.terrain import Terrain
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.anchors import Anchors
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def boxes(*given: tuple) -> Blueprint:
    """Make boxes, each of a centre, a size and a turn about the vertical."""
    centres, sizes, turns = zip(*given)
    count = len(given)
    whole = np.zeros(count, np.int16)
    poses = np.array([[*centre, *rotation.from_yaw(turn)]
                      for centre, turn in zip(centres, turns)])
    return Blueprint(
        shape=np.full(count, Shape.BOX, np.uint8), size=np.array(sizes, float),
        visual_size=np.array(sizes, float), density=np.ones(count), mass=np.ones(count),
        inertia=np.ones((count, 3)), poses=poses, kind=whole, material=whole, texture=whole,
        leaf_area=np.zeros(count), kinds=('box',), materials=('',), textures=('',))


def ask(kind: str, points: list, habitat: Habitat, root: np.ndarray = ORIGIN,
        built: Blueprint | None = None, segments: list | None = None) -> np.ndarray:
    """Return the answers to one plant."""
    where = np.zeros(len(points), int) if segments is None else np.array(segments)
    question = Question(kind, np.array(points, float), where)
    return habitat.answer([Plant(built, root, [question])])[0][kind]


@pytest.mark.parametrize(('distance', 'height'), [(1.0, 10.0), (5.0, 5.0), (10.0, 4.0)])
@pytest.mark.parametrize('turn', [0.0, 0.7])
def test_a_long_wall_hides_its_share_of_the_sky(distance, height, turn):
    """See all but arctan(height/distance)/π, away from the wall."""
    c, s = np.cos(turn), np.sin(turn)
    wall = boxes(((-(distance + 0.25) * s, (distance + 0.25) * c, 0.5 * height),
                  (300.0, 0.5, height), turn))
    share, *light = ask('light', [[0.0, 0.0, 0.1]], Habitat(wall))[0]
    assert share == pytest.approx(1.0 - np.arctan(height / distance) / np.pi, abs=0.04)
    assert np.dot(light, [s, -c, 0.0]) > 0.1
    assert np.linalg.norm(light) == pytest.approx(1.0)


def test_all_is_seen_in_the_open():
    """See the whole sky, the light coming from above."""
    share, *light = ask('light', [[0.0, 0.0, 1.0]], Habitat())[0]
    assert share == 1.0
    assert light == pytest.approx([0.0, 0.0, 1.0], abs=0.02)


@pytest.mark.parametrize('index', [0.5, 2.0, 6.0])
def test_a_canopy_lets_through_what_beer_and_lambert_say(index):
    """Let E₂(k·LAI) through, of light from all of the sky, with k = 1/2."""
    cells = Cells.around(np.array([[-100.0, -100.0, -1.0], [100.0, 100.0, 2.0]]), np.zeros((0, 7)),
                         np.zeros((0, 3)))
    top = int((1.5 - cells.low[2]) // cells.edge)
    thick = 2  # cells
    cells.area[:, :, top - thick:top] = index / (thick * cells.edge)
    ways = sky_directions()
    seen = cells.seen(np.zeros((1, 3)), ways, np.ones((1, DIRECTIONS), bool)).mean()
    depth = 0.5 * index
    expected = np.exp(-depth) - depth * exp1(depth)
    assert seen == pytest.approx(expected, abs=0.02)


def test_a_hill_hides_the_sky_behind_it():
    """Hide what is below the slope of a valley's sides."""
    x = np.abs(np.linspace(-200.0, 200.0, 81))
    valley = Terrain(np.tile(x[:, None], (1, 81)), np.array([-200.0, -200.0]), 5.0)
    share = ask('light', [[0.0, 0.0, 0.5]], Habitat(terrain=valley))[0, 0]
    assert share == pytest.approx(0.5, abs=0.05)  # two sides of 45 degrees


def test_own_leaves_shade_what_is_below_them():
    """See less of the sky below a crown than on top of it, by its leaf area."""
    turn = np.arange(8) * np.pi / 4.0
    tips = np.column_stack([2.0 * np.cos(turn), 2.0 * np.sin(turn), np.full(8, 3.0)])
    nodes = np.vstack([[[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]], tips])
    bare = skeleton.from_nodes(nodes, np.array([-1, 0] + [1] * 8), np.full(10, 0.01))
    leafy = replace(bare, leaf_area=np.array([0.0] + [3.0] * 8))
    points = [[0.3, 0.0, 1.5], [0.0, 0.0, 3.6]]
    below, above = ask('light', points, Habitat(), built=leafy)[:, 0]
    assert above > 0.99
    assert below < ask('light', points, Habitat(), built=bare)[0, 0] - 0.04


@pytest.mark.parametrize('turn', [0.0, 0.6])
def test_distance_to_what_stands_near_is_exact(turn):
    """Measure distances to faces, edges and corners of boxes, in the frame of the plant."""
    rng = np.random.default_rng(1)
    box = boxes(((3.0, 1.0, 1.0), (2.0, 1.0, 0.5), turn), ((40.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0))
    root = np.array([0.5, -0.5, 0.2, *rotation.from_yaw(0.9)])
    points = rng.uniform(-4.0, 4.0, (50, 3))
    found = ask('space', points, Habitat(box), root)
    world = root[:3] + rotation.rotate(root[3:], points)
    local = rotation.rotate(rotation.conjugate(box.poses[0, 3:]), world - box.poses[0, :3])
    over = local - np.clip(local, -0.5 * box.size[0], 0.5 * box.size[0])
    assert found[:, 0] == pytest.approx(np.linalg.norm(over, axis=1))
    outside = found[:, 0] > 0.01
    towards = rotation.rotate(root[3:], found[outside, 1:])
    touching = world[outside] + found[outside, :1] * towards
    assert touching == pytest.approx(world[outside] - rotation.rotate(
        box.poses[0, 3:], over[outside]))
    assert ask('space', [[0.0, 0.0, 0.0]], Habitat())[0, 0] == 1e4


def test_neighbours_are_those_of_all_plants():
    """Find the nearest other query of the kind, of the plant itself or of another."""
    points = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 4.0]])
    roots = [ORIGIN, np.array([2.0, 0.0, 0.0, *rotation.from_yaw(1.0)])]
    plants = [Plant(None, root, [Question('neighbour', points[:n], np.zeros(n, int))])
              for root, n in zip(roots, (2, 1))]
    first, second = (answer['neighbour'] for answer in Habitat().answer(plants))
    assert first[:, 0] == pytest.approx([2.0, 3.0])
    assert first[0, 1:] == pytest.approx([1.0, 0.0, 0.0])
    assert rotation.rotate(roots[1][3:], second[0, 1:]) == pytest.approx([-1.0, 0.0, 0.0])


def test_a_pole_bears_what_statics_say():
    """Bear the moment of the weight of a level pole, and sag by w·l⁴/(8·E·I)."""
    count, length, width = 20, 4.0, 0.1
    nodes = np.column_stack([np.linspace(0.0, length, count + 1), np.zeros(count + 1),
                             np.ones(count + 1)])
    pole = skeleton.from_nodes(nodes, np.arange(count + 1) - 1,
                               np.full(count + 1, 0.5 * width),
                               density=800.0, modulus=10e9, strength=50e6)
    pole = replace(pole, hinges=replace(pole.hinges, preload=np.zeros(count)))
    segments = list(range(count))
    load = ask('load', nodes[1:], Habitat(storm=0.0), built=pole, segments=segments)
    sag = ask('sag', nodes[1:], Habitat(), built=pole, segments=segments)
    weight = 800.0 * np.pi / 4.0 * width**2 * 9.81
    left = length - nodes[:-1, 0]
    assert load[:, 1] == pytest.approx(0.5 * weight * left**2, rel=0.02)
    assert load[0, 0] == pytest.approx(load[0, 1] * 32.0 / (np.pi * width**3) / 50e6)
    assert sag[-1, 2] == pytest.approx(-weight * length**4 / 8.0 / 10e9 / (
        np.pi / 64.0 * width**4), rel=0.02)


def test_wind_bends_a_plant_downwind():
    """Lean as the wind blows in the world, told in the frame of the plant."""
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.5], [0.0, 0.0, 3.0]])
    stem = skeleton.from_nodes(nodes, np.array([-1, 0, 1]), np.full(3, 0.02))
    root = np.array([0.0, 0.0, 0.0, *rotation.from_yaw(0.8)])
    windy = Habitat(wind=np.array([12.0, 0.0, 0.0]))
    sag = ask('sag', nodes[2:], windy, root, stem, [1])
    moved = rotation.rotate(root[3:], sag)[0]
    assert moved[0] > 0.05
    assert abs(moved[1]) < 1e-6


_GRAVITY = 9.81
_WALL = """
building wall
  footprint: (0, 0) (1.2, 0)
  facades: brickwork
  storey_height: 1.2
layout running { unit: 0.3 0.1 0.1  joint: 0.01  material: brick }
panel brickwork: running
material brick { density: 1900 }
"""
# Ten lengths of a stem that would not stand by itself, and a shoot.
_VINE = """
axiom: Width(0.006) Density(900) Modulus(1e9) DampingRatio(0.1) Cling({hold}) @R(0, 0, 1, 0, 1, 0)
    F(0.1) F(0.1) Leaf(0.2, 1) F(0.1) Leaf(0.2, 1) F(0.1) Leaf(0.2, 1) [ +(40) F(0.1) F(0.1) ]
    F(0.1) F(0.1) Leaf(0.2, 1) F(0.1) F(0.1) Leaf(0.2, 1) F(0.1) F(0.1) Leaf(0.2, 1)
"""
_POLE = """
axiom: Width(0.12) Density(700) Modulus(4e9) DampingRatio(0.03) F(0.5) F(0.5) F(0.5) F(0.5)
"""


def _scene(hold: float = 60.0, host: str | None = _WALL, **keys: dict) -> Simulation:
    objects = {'vine': {'grammar_text': _VINE.format(hold=hold), 'origin': [0.6, -0.03, 0.0]}}
    if host is not None:
        place = [0.0, 0.0, 0.0] if host is _WALL else [0.6, 0.06, 0.0]
        objects['host'] = {'grammar_text': host, 'origin': place}
    return Simulation(Scene.from_parameters({
        'scene': {'objects': list(objects)}, **objects, **keys}))


def _parts(simulation: Simulation, name: str) -> np.ndarray:
    thing = next(thing for thing in simulation.objects if thing.name == name)
    return np.arange(thing.first, thing.first + thing.count)


def test_a_vine_rests_on_its_wall():
    """Expect every segment to be held where it grew, and its weight on the bricks behind it."""
    simulation = _scene()
    vine, before = _parts(simulation, 'vine'), simulation.poses.copy()
    simulation.step(60)
    np.testing.assert_array_equal(simulation.poses, before)
    bricks, wrenches = simulation.state.loads.layer('climbers')
    weight = _GRAVITY * simulation.blueprint.mass[vine].sum()
    np.testing.assert_allclose(wrenches[:, :3].sum(axis=0), [0.0, 0.0, -weight], atol=1e-9)
    assert len(bricks) == len(vine)
    assert (np.abs(before[bricks, :3] - before[vine, :3]).max(axis=0) < [0.2, 0.1, 0.1]).all()
    assert not len(simulation.events)


def test_the_wind_moves_what_clings_by_millimetres():
    """Blow with 20 m/s along the wall: the vine holds on; without the wall it lies down."""
    wind = {'velocity': [20.0, 0.0, 0.0], 'turbulence_intensity': 0.2}
    moved = []
    for host in (_WALL, None):
        simulation = _scene(host=host, wind=wind)
        vine, before = _parts(simulation, 'vine'), simulation.blueprint.poses
        farthest = 0.0
        for _ in range(120):
            simulation.step()
            farthest = max(farthest, np.abs(simulation.poses[vine] - before[vine])[:, :3].max())
        moved.append(farthest)
        assert not len(simulation.events)
        told = any('clings to nothing' in line for line in simulation.warnings)
        assert told == (host is None)
    assert moved[0] < 0.005 < 0.3 < moved[1]


@pytest.mark.parametrize('share', [0.85, 1.15])
def test_it_lets_go_at_its_strength(share: float):
    """Pull one hold of a plant of one segment: it lets go beyond its strength and says so."""
    text = ('axiom: Width(0.006) Density(900) Modulus(1e6) DampingRatio(0.5) F(0.3) '
            'Cling(100) F(0.2)\n')
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['host', 'vine']}, 'host': {'grammar_text': _WALL},
        'vine': {'grammar_text': text, 'origin': [0.6, -0.03, 0.0]}}))
    tip = _parts(simulation, 'vine')[1]
    for force in np.linspace(0.0, 20.0 * share, 20):
        simulation.clear_wrenches()
        simulation.apply_wrench(int(tip), (0.0, -force, 0.0))
        simulation.step(5)
    holds = share < 1.0
    assert simulation.state.climbers.holds.tolist() == [holds]
    assert simulation.events['cause'].tolist() == [] if holds else [Cause.PULLED_OFF]
    if not holds:
        event = simulation.events[0]
        assert event['bond'] == -1 and event['part_b'] == tip and event['load'] > 1.0
        assert event['part_a'] in _parts(simulation, 'host')


def test_it_falls_when_its_wall_is_gone():
    """Take the wall away: all holds let go, and the stem lies down."""
    simulation = _scene()
    vine = _parts(simulation, 'vine')
    simulation.remove('host')
    simulation.step(1)
    told = simulation.events
    assert (told['cause'] == Cause.PULLED_OFF).all()
    assert sorted(told['part_b'].tolist()) == vine.tolist()
    top = simulation.poses[vine, 2].max()
    simulation.step(120)
    assert simulation.poses[vine, 2].max() < 0.75 * top


def test_it_follows_the_tree_that_it_grows_on():
    """Push a pole with a vine: the vine goes along, and their motion dies out."""
    simulation = _scene(hold=200.0, host=_POLE)
    vine, pole = _parts(simulation, 'vine'), _parts(simulation, 'host')
    before = simulation.poses.copy()
    simulation.step(30)
    np.testing.assert_allclose(simulation.poses, before, atol=1e-12)
    simulation.apply_impulse(int(pole[1]), (20.0, 0.0, 0.0))
    apart, speed = 0.0, []
    near = pole[np.abs(before[vine, None, 2] - before[pole, 2]).argmin(axis=1)]
    for _ in range(240):
        simulation.step()
        way = (simulation.poses - before)[:, :3]
        apart = max(apart, np.abs(way[vine[9:]] - way[near[9:]]).max())
        speed.append(np.abs(simulation.velocities[vine, :3]).max())
    assert simulation.state.climbers.holds.all() and not len(simulation.events)
    assert max(speed[:60]) > 0.2 and apart < 0.03
    assert max(speed[180:]) < 0.7 * max(speed[60:120]) < 0.7 * max(speed[:60])


def test_it_begins_bent_with_the_tree_that_it_grows_on():
    """Blow evenly at a slim pole with a vine: both begin where they stay, held where they grew."""
    simulation = _scene(hold=300.0, host=_POLE.replace('0.12', '0.015'),
                        wind={'velocity': [15.0, 0.0, 0.0], 'turbulence_intensity': 0.0})
    before = simulation.poses.copy()
    bent = (before - simulation.blueprint.poses)[:, 0].max()
    simulation.step(120)
    assert np.abs(simulation.poses - before)[:, :3].max() < 0.01 * bent and bent > 0.2
    assert simulation.state.climbers.holds.all()


def test_holds_outlive_a_snapshot():
    """Restore a saved state: what held holds, what had let go does not."""
    simulation = _scene()
    simulation.remove('host')
    simulation.step(1)
    data = simulation.save()
    simulation.reset()
    simulation.revert()
    assert simulation.state.climbers.holds.all()
    simulation.restore(data)
    assert not simulation.state.climbers.holds.any()


@pytest.mark.parametrize('ratio', [0.0, 0.05])
def test_anchors_add_no_energy(ratio: float):
    """Shove a bush of which every third segment is anchored: no step adds energy."""
    tree = bush(damping_ratio=ratio)
    part = np.arange(2, len(tree), 3)
    forest = Forest(tree, air_density=0.0, climbers=Anchors(
        part, np.full(len(part), len(tree)), np.full(len(part), 300.0)))
    rest = forest.poses.copy()
    for _ in range(60):
        forest.step(1.0 / 60.0)
    np.testing.assert_array_equal(forest.poses, rest)
    assert forest.energy() == 0.0
    rng = np.random.default_rng(1)
    forest.velocities[:] = rng.normal(size=forest.velocities.shape)
    forest.step(1.0 / 60.0)
    energy = [forest.energy()]
    for _ in range(300):
        forest.step(1.0 / 60.0)
        energy.append(forest.energy())
    assert np.diff(energy).max() <= 1e-9 * energy[0]
    assert energy[-1] < 0.2 * energy[0]
