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


"""Climbing plants hold on to the wall or tree that they grow on, until they are pulled off."""

from grown_trees import bush
import numpy as np
import pytest

from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.anchors import Anchors
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

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
