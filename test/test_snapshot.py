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


"""Snapshots and forks: what goes on from them is the same to the bit."""

import io
import pickle
import zlib

from grown_trees import bush
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.errors import SnapshotError
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation, snapshot
from procphys_ros.wallgrammar import WallGrammar

HOUSE = 'grammars/garden_wall.wall'


def busy(seconds=0.5):
    """Simulate a wall and two trees in a storm while a ball flies and a charge has gone off."""
    scene = Scene(Settings(seed=3))
    scene.add(wall(8, 10), (0.0, 0.0, 0.0), 0.0, 'wall')
    for i in range(2):
        scene.add(bush(40, seed=i, damping_ratio=0.1, strength=2e7), (3.0 + 2.0 * i, 1.0, 0.0),
                  0.0, f'tree_{i}')
    simulation = Simulation(scene)
    simulation.set_wind((18.0, 3.0, 0.0))
    simulation.launch(Projectile('sphere', 0.3, 40.0, (0.9, -3.0, 0.4), (0.0, 25.0, 0.0)))
    simulation.explode((0.5, -4.0, 0.5), 2.0)
    simulation.gust()
    simulation.apply_wrench('tree_1/3', (20.0, 0.0, 0.0))
    simulation.step(round(60 * seconds))
    return simulation


def assert_same(one, other):
    """Compare everything that can be seen of two simulations, to the bit."""
    assert one.time == other.time and one.bonds_broken == other.bonds_broken
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.velocities, other.velocities)
    np.testing.assert_array_equal(one.events, other.events)
    np.testing.assert_array_equal(one.leaf_poses(), other.leaf_poses())
    for mine, theirs in zip(one.dust, other.dust):
        np.testing.assert_array_equal(mine, theirs)


def test_going_on_from_a_snapshot_is_going_on():
    """Save in the middle of it all; go on, go back, and go on in another simulation."""
    simulation = busy()
    assert simulation.bonds_broken > 0 and simulation.awake_bodies > 0
    data = simulation.save()
    simulation.step(45)
    other = busy(0.0)
    other.restore(data)
    assert other.time == pytest.approx(0.5)
    other.step(45)
    assert_same(simulation, other)
    simulation.restore(data)
    simulation.step(45)
    assert_same(simulation, other)


def test_forks_go_the_same_way_until_they_are_told_otherwise():
    """Fork twice: one does as the original, the other, which is struck, does not."""
    simulation = busy()
    same, struck = simulation.fork(), simulation.fork()
    struck.apply_impulse('tree_0/5', (30.0, 0.0, 0.0))
    for run in (simulation, same, struck):
        run.step(30)
    assert_same(simulation, same)
    assert not np.array_equal(simulation.poses, struck.poses)


def test_constants_are_not_saved():
    """Keep a snapshot of a standing building small: it names the arrays of its model."""
    scene = Scene()
    scene.add(WallGrammar.load(HOUSE).build(seed=0), name='house')
    simulation = Simulation(scene)
    assert len(simulation.save()) < 1500 * len(simulation.poses)


@pytest.mark.parametrize(('spoil', 'word'), [
    (lambda data: b'', 'no snapshot'), (lambda data: b'PK\x03\x04' + data, 'no snapshot'),
    (lambda data: data[:-1], 'damaged'), (lambda data: data[:60], 'damaged'),
    (lambda data: data[:-9] + bytes(9), 'damaged'),
    (lambda data: data.replace(b'"version": "', b'"version": "9'), 'version 9'),
    (lambda data: data.replace(b'"scene": "', b'"scene": "f'), 'another scene')])
def test_what_is_no_snapshot_of_this_scene_is_refused(spoil, word):
    """Say in one line what is wrong, and stay in the present state."""
    simulation = busy(0.1)
    data, before = simulation.save(), simulation.poses.copy()
    simulation.step(3)
    now = simulation.poses.copy()
    with pytest.raises(SnapshotError, match=word) as told:
        simulation.restore(spoil(data))
    assert '\n' not in str(told.value)
    np.testing.assert_array_equal(simulation.poses, now)
    simulation.restore(data)
    np.testing.assert_array_equal(simulation.poses, before)


def test_a_snapshot_of_another_scene_is_refused():
    """Tell scenes apart by what they hold, by seed and by time step."""
    scene = Scene()
    scene.add(wall(3, 3), name='wall')
    data = Simulation(scene).save()
    other = Scene()
    other.add(wall(3, 4), name='wall')
    for foreign in (Simulation(other), Simulation(scene, seed=5), Simulation(scene, 1 / 30)):
        with pytest.raises(SnapshotError, match='another scene'):
            foreign.restore(data)


class _Evil:
    def __reduce__(self):
        return print, ('a snapshot must not run code',)


def test_a_snapshot_runs_no_code(capsys):
    """Refuse a file that would call something, its checksums being right."""
    scene = Scene()
    scene.add(wall(3, 3), name='wall')
    simulation = Simulation(scene)
    file = io.BytesIO()
    pickle.dump(_Evil(), file)
    content = zlib.compress(bytes(8) + file.getvalue())
    head = snapshot.describe(simulation.model, simulation.time, content)
    with pytest.raises(SnapshotError, match='no part of a state'):
        simulation.restore(head + content)
    assert 'code' not in capsys.readouterr().out
