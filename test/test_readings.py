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


"""What is read of a simulation: values that stay, series, loads, copies and pickles."""

from copy import copy, deepcopy
from dataclasses import fields
from inspect import getmembers
import pickle

from grown_trees import beam
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.errors import CommandError
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

GRAVITY = 9.81


@pytest.fixture
def simulation():
    """Grow a tree in the wind beside a wall that a ball flies at, with an intruder on its way."""
    scene = Scene()
    scene.add(beam(strength=40e6), name='beam')
    scene.add(wall(3, 6), (9.0, 0.0, 0.0), name='pier')
    made = Simulation(scene)
    made.set_wind((0.0, 12.0, 0.0))
    made.launch(Projectile(size=0.2, mass=20.0, position=(9.3, -2.0, 0.4), velocity=(0, 25, 0)))
    made.place_intruder((0.0, 3.0, 2.0, 0.0, 0.0, 0.0, 1.0))
    made.place_intruder((0.0, -1.0, 2.0, 0.0, 0.0, 0.0, 1.0), 0.3)
    made.step()
    return made


def arrays(simulation) -> dict[str, np.ndarray]:
    """Read all arrays that are properties, and those of the intruder."""
    found = {name: getattr(simulation, name) for name, member in getmembers(type(simulation))
             if isinstance(member, property)}
    found |= {'pose': simulation.pose_of_intruder('intruder'), 'loads': simulation.loads(),
              'wrench': simulation.wrench_on_intruder('intruder'),
              'leaf_poses': simulation.leaf_poses(), 'objects': np.array(simulation.objects)}
    found |= {f'dust.{name}': column for name, column in simulation.dust._asdict().items()}
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


def test_what_was_read_stays_as_it_was(simulation):
    """Keep all that can be read while a ball breaks a wall: it is that of its own moment."""
    kept, copies = [], []
    for _ in range(12):
        kept.append(arrays(simulation))
        copies.append({name: value.copy() for name, value in kept[-1].items()})
        simulation.step(2)
    assert {'poses', 'velocities', 'exists', 'events', 'intruder_pose'} <= set(kept[0])
    for before, after in zip(kept, copies):
        for name in before:
            np.testing.assert_array_equal(before[name], after[name], name)
    changing = {name for name in kept[0] if not np.array_equal(kept[0][name], kept[-1][name])}
    assert {'poses', 'velocities', 'events', 'intruder_pose', 'intruder_wrench'} <= changing


def test_what_was_read_cannot_be_written(simulation):
    """Write to what shows the state: there is an error, and nothing moves."""
    simulation.step(15)
    before = simulation.fork()
    for name in ('poses', 'velocities', 'events', 'intruder_pose', 'intruder_wrench'):
        with pytest.raises(ValueError, match='read-only'):
            getattr(simulation, name)[0] = 1
    simulation.objects.clear()
    assert len(simulation.objects) == 3
    simulation.step(5)
    before.step(5)
    np.testing.assert_array_equal(simulation.poses, before.poses)


def test_a_series_is_what_was_read_step_by_step(simulation):
    """Record a ball, a course of bricks and the tree: each row is what the step showed."""
    other = simulation.fork()
    parts = ['pier/0', 'beam', len(simulation.poses) - 1]
    series = simulation.series(20, parts, every=3)
    assert series.names == ('pier/brick_0', *(f'beam/segment_{i}' for i in range(10)),
                            'projectile_0/projectile_0')
    assert simulation.time == pytest.approx(21 * simulation.time_step)
    for row in range(6):
        other.step(3)
        assert series.times[row] == other.time
        np.testing.assert_array_equal(series.poses[row], other.poses[series.parts])
        np.testing.assert_array_equal(series.velocities[row], other.velocities[series.parts])
        np.testing.assert_array_equal(series.loads[row], other.loads(parts))
    assert (np.diff(series.poses[:3, -1, 1]) > 0.5).all()  # the ball flies
    assert len(series.times) == 6 and np.ptp(series.poses[:, 5], axis=0).any()
    assert {f.name: len(getattr(series, f.name)) for f in fields(series)} == {
        'parts': 12, 'names': 12, 'times': 6, 'poses': 6, 'velocities': 6, 'loads': 6}
    assert simulation.series(0).poses.shape == (0, len(simulation.poses), 7)


def test_loads_are_those_of_statics(simulation):
    """Find the weight above every segment, and that of the pier in its lowest course."""
    scene = simulation.scene
    calm = Simulation(scene)
    assert np.isnan(calm.load('beam/0').force) and calm.load('pier/0').force > 0.0
    calm.step()
    weight = GRAVITY * calm.blueprint.mass
    loads = calm.loads()
    np.testing.assert_allclose(loads[:10, 0], np.cumsum(weight[9::-1])[::-1], rtol=1e-3)
    ends = calm.blueprint.bonds[(calm.blueprint.bonds == GROUND).any(axis=1)].max(axis=1)
    foot = ends[ends >= 10]
    np.testing.assert_allclose(loads[foot, 0].sum(), weight[10:].sum(), rtol=0.02)
    for part in (0, 4, 11):
        one = calm.load(part)
        assert [one.force, one.moment, one.share] == loads[part].tolist()
    ball = len(simulation.poses) - 1
    assert simulation.load(ball).force == 0.0 and not simulation.loads([ball]).any()


@pytest.mark.parametrize('arguments, words', [
    ((3, ['bem']), 'did you mean beam'), ((3, ['beam/99']), 'indices go from 0 to 9'),
    ((-1,), 'number of steps is -1'), ((3, None, 0), 'every is 0'), ((3, [2.5]), 'neither'),
    ((3, 2.5), 'neither'), ((10 ** 9,), 'GiB of memory')], ids=str)
def test_series_that_cannot_be_are_refused(simulation, arguments, words):
    """Say what is wrong before any step."""
    with pytest.raises(CommandError, match=words):
        simulation.series(*arguments)
    assert simulation.time == simulation.time_step


@pytest.mark.parametrize('way', [copy, deepcopy, lambda s: pickle.loads(pickle.dumps(s)),
                                 lambda s: deepcopy({'in': [s]})['in'][0]])
def test_copies_and_pickles_go_on_alike(simulation, way):
    """Copy a run in Python's own ways, with what was added: it goes on as a fork does."""
    simulation.add(wall(1, 2), (0.0, 30.0, 0.0), name='late')
    simulation.step(8)
    twin = way(simulation)
    assert twin.state is not simulation.state and twin.added == ('late',)
    simulation.step(6)
    assert twin.time < simulation.time
    twin.step(6)
    np.testing.assert_array_equal(twin.poses, simulation.poses)
    np.testing.assert_array_equal(twin.events, simulation.events)
    twin.reset()
    assert twin.time == 0.0


@pytest.mark.parametrize('way', [deepcopy, pickle.dumps])
@pytest.mark.parametrize('inner', [lambda s: s.state, lambda s: s.state.world])
def test_what_lives_in_an_engine_says_how_it_is_copied(simulation, way, inner):
    """Copy only the state: the error names what to copy instead."""
    with pytest.raises(TypeError, match='fork, save, copy or pickle the Simulation'):
        way(inner(simulation))
