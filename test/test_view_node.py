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

"""The page of a running node: its topics in, commands out, and its death shown."""

import json
import signal
import threading
from types import SimpleNamespace

from node_process import NodeProcess, SAPLING, wait_until
import numpy as np
import pytest
import rclpy

from procphys_ros.appearance.joints import seats
from procphys_ros.blueprint import Leaves
from procphys_ros.messages import pose_array, SceneDescription
from procphys_ros.messages.leaves import leaf_rows, leaves_of
from procphys_ros.messages.poses import read_pose_array
from procphys_ros.ros import page_commands
from procphys_ros.ros.followed_node import content_of, FollowedNode
from procphys_ros.ros.page_commands import carry_out, PageCommands, scene_of
from procphys_ros.scene.named import open_scene, shipped_scenes
from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.simulation.commands import Impulse, SetWind
from procphys_ros.view.commands import (
    Inspect,
    LoadScene,
    Reset,
    SetPause,
    SetSpeed,
    StartGust,
    Step,
)
from procphys_ros.view.source import shortened

LEAFY = SAPLING.strip() + ' Leaf(0.3) Leaf(0.2)'
SCENE = {'scene': {'objects': ['sapling']}, 'sapling': {'grammar_text': LEAFY, 'count': 3,
                                                        'layout': 'row', 'spacing': 4.0},
         'wind': {'velocity': [6.0, 2.0, 0.0]}}


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Make a folder for parameter files."""
    return tmp_path_factory.mktemp('node')


@pytest.fixture(scope='module')
def followed():
    """Follow a node that does not run yet."""
    rclpy.init()
    made = FollowedNode('sim', patience=20.0)
    made.start()
    yield made
    made.close()
    rclpy.try_shutdown()


@pytest.fixture(scope='module')
def node(folder, followed):
    """Run the node."""
    process = NodeProcess(folder, SCENE)
    process.wait_for_banner()
    wait_until(lambda: followed.status().alive and followed.frame() is not None, 'the node')
    wait_until(lambda: len(followed.frame().content.leaves) == 6, 'its leaves')
    yield process
    process.kill()


def says(followed, command):
    """Send a command and return the answer."""
    followed.say(SetSpeed(1.0))  # has no answer, so that the next one can be told from the last
    wait_until(lambda: followed.answer() == '', 'no answer')
    followed.say(command)
    wait_until(followed.answer, f'the answer to {command}')
    return followed.answer()


def test_pose_arrays_are_read_back():
    """Read what was written, also behind frame names of any length."""
    poses = np.random.default_rng(0).random((5, 7))
    for name in ('', 'a', 'map', 'world', 'a_longer_name'):
        np.testing.assert_array_equal(read_pose_array(pose_array(poses, (1, 2), name)), poses)
        assert len(read_pose_array(pose_array(poses[:0], (1, 2), name))) == 0


def test_a_node_that_does_not_run_is_said_to(followed):
    """Wait for the node, and say so."""
    if not followed.status().alive:
        assert followed.status().text == '/sim does not answer'


def test_a_page_that_still_looks_for_its_node_ends(followed):
    """Leave no thread inside ROS, which would abort the process at its end."""
    page = FollowedNode('nobody')
    before = set(threading.enumerate())
    page.start()
    page.close()
    assert set(threading.enumerate()) <= before


def test_the_scene_arrives_as_the_library_builds_it(node, followed):
    """Get parts, leaves and textures from the topics."""
    frame = followed.frame()
    content = frame.content
    assert [content.name(0), content.name(len(content) - 1)] == [
        'sapling_0/segment_0', 'sapling_2/segment_3']
    assert len(frame.poses) == len(content) == 12
    assert frame.leaf_poses.shape == (6, 7)
    np.testing.assert_allclose(sorted(content.leaves.size), [0.2] * 3 + [0.3] * 3, rtol=1e-6)
    assert content.material(0)
    assert (content.mass > 0.0).all()


def test_trees_and_leaves_move_in_the_wind(node, followed):
    """Get new frames while the wind blows; leaves flutter beside their branches."""
    followed.watched = True
    first = followed.frame()
    wait_until(lambda: np.abs(followed.frame().poses - first.poses).max() > 1e-4, 'motion')
    wait_until(lambda: np.abs(followed.frame().leaf_poses - first.leaf_poses).max() > 1e-3,
               'fluttering leaves')


def test_commands_reach_the_node(node, followed):
    """Pause, step, throw, pull, blast, blow and reset, and get the node's own answers."""
    assert says(followed, SetPause(True)).startswith('paused')
    wait_until(lambda: followed.status().paused, 'the pause')
    assert says(followed, Step()).startswith('stepped to')
    ball = Projectile('sphere', 0.2, 1.0, (0.0, -9.0, 3.0), (0.0, 1.0, 0.0))
    assert 'projectile' in says(followed, ball)
    wait_until(lambda: followed.frame().content.ball.any(), 'the ball')
    assert says(followed, Explosion((50.0, 0.0, 0.0), 0.5)).startswith('0.5 kg TNT')
    assert '9 m/s' in says(followed, StartGust(9.0))
    followed.say(SetWind((0.0, 4.0, 0.0)))
    wait_until(lambda: followed.status().wind == (0.0, 4.0, 0.0), 'the wind')
    followed.say(Impulse(0, (5.0, 0.0, 0.0)))
    assert says(followed, Inspect(0)).startswith('sapling_0/segment_0 carries ')
    assert says(followed, Reset()) == 'back at 0 s'
    wait_until(lambda: not followed.frame().content.ball.any(), 'the ball to be gone')
    assert says(followed, SetPause(False)).startswith('running')


def test_a_refusal_is_shown(node, followed):
    """Say what the node says when it refuses."""
    assert 'pause it first' in says(followed, Step())


def test_what_waits_behind_a_refusal_is_carried_out(node, followed):
    """Pause, though a step before that was refused while both waited."""
    wait_until(lambda: not followed.status().paused, 'time to pass')
    followed.say(SetSpeed(1.0))  # takes the node a moment, in which the others gather
    followed.say(Step())
    followed.say(SetPause(True))
    wait_until(lambda: followed.status().paused, 'the pause')
    assert says(followed, SetPause(False)).startswith('running')


def test_another_scene_is_loaded_into_the_node(node, followed, tmp_path):
    """Send the node a scene file's parameters; those that it omits go to their defaults."""
    path = tmp_path / 'post.yaml'
    path.write_text(json.dumps({'/**': {'ros__parameters': {
        'scene': {'objects': ['post']}, 'post': {'grammar_text': SAPLING}}}}), 'utf-8')
    assert says(followed, SetPause(True)).startswith('paused')
    before = followed.frame().content.scene
    assert '1 objects, 4 parts' in says(followed, LoadScene(path))
    wait_until(lambda: len(followed.frame().content) == 4, 'the other scene')
    assert followed.frame().content.scene > before
    wait_until(lambda: followed.status().scene == 'post', 'its name')
    assert np.isfinite(followed.frame().poses).all()
    assert says(followed, SetPause(False)).startswith('running')
    wait_until(lambda: followed.status().wind == (0.0, 0.0, 0.0), 'the wind to die down')


def test_a_scene_brings_what_its_cues_take(tmp_path):
    """Send a node the group of the cue "launch", though a reload does not read it."""
    path, given = tmp_path / 'ball.yaml', {}
    path.write_text(json.dumps({'/**': {'ros__parameters': {
        'scene': {'objects': ['post'], 'cues': ['1.0 launch', '2.0 explode', '3.0 impulse']},
        'projectile': {'mass': 77.0}, 'explosion': {'charge': 5.0}, 'camera': {'part': 'x'},
        'impulse': {'target': 'post/1'}, 'post': {'grammar_text': SAPLING}}}}), 'utf-8')
    carry_out(SimpleNamespace(change=given.update, trigger=lambda _: 'done'), LoadScene(path))
    assert given['projectile.mass'] == 77.0 and given['explosion.charge'] == 5.0
    assert given['impulse.target'] == 'post/1' and 'camera.part' not in given


@pytest.mark.parametrize('word', ['garden', 'church', 'oak.lsys'])
def test_a_node_tells_where_mortar_is(word):
    """Read the joints of walls from the description, as the library finds them."""
    scene = open_scene(word)
    whole = scene.blueprint
    described = json.loads(SceneDescription('world', seats=seats).write(whole, scene.objects))
    shown, own = content_of(described, Leaves(), 0).mortar, seats(whole)
    for field in ('bond', 'first', 'second'):
        np.testing.assert_array_equal(getattr(shown, field), getattr(own, field))
    every = np.arange(len(own.bond))
    exists = np.ones(len(whole), bool)
    np.testing.assert_allclose(shown.boxes(whole.poses, exists, every),
                               own.boxes(whole.poses, exists, every), atol=1e-3)
    np.testing.assert_allclose(shown.size, own.size, atol=1e-4)


@pytest.mark.parametrize('name, path', sorted(shipped_scenes().items()))
def test_a_shipped_scene_of_a_node_is_known_by_its_parameters(name, path):
    """Name what a node runs from all that it has, and no scene when one thing differs."""
    node = SimpleNamespace(**{name: {}})
    remote = SimpleNamespace(change=node.__dict__.update, trigger=lambda _: 'done',
                             values=lambda names: [node.__dict__[key] for key in names])
    carry_out(remote, LoadScene(path))
    objects = node.__dict__['scene.objects']
    assert scene_of(remote, objects) == name
    key = next(key for key in node.__dict__ if key.startswith(f'{objects[-1]}.grammar'))
    node.__dict__.update({f'{owner}.{key.partition(".")[2]}': 'mine' for owner in objects})
    assert scene_of(remote, objects) == shortened(objects)


def test_clicks_while_a_node_loads_are_not_for_its_scene(tmp_path, monkeypatch):
    """Set off no charge in a scene that nobody has seen yet; a pause holds for it, too."""
    path, said = tmp_path / 'post.yaml', []
    path.write_text(json.dumps({'/**': {'ros__parameters': {'scene': {'objects': []}}}}), 'utf-8')
    page = PageCommands('sim', 1.0)

    def trigger(name):
        said.append(name)
        if name == 'reload_scene':
            page.put(Explosion((9.0, 0.0, 0.0), 0.5))
            page.put(Reset())
    remote = SimpleNamespace(trigger=trigger, switch=lambda name, on: said.append(name),
                             change=lambda values: None, push=lambda *values: said.append(values),
                             values=lambda names: [(0.0, 0.0, 0.0), []], close=lambda: None)
    monkeypatch.setattr(page_commands, 'Remote', lambda *_: remote)
    for command in (LoadScene(path), Impulse(0, (5.0, 0.0, 0.0)), SetPause(True)):
        page.put(command)
    page.start()
    wait_until(lambda: 'reset_simulation' in said, 'the reset')
    page.close()
    assert said == ['reload_scene', 'set_pause', 'reset_simulation']


def test_nothing_is_asked_for_while_nobody_looks(node, followed):
    """Unsubscribe from all that moves, and come back to it."""
    watcher = rclpy.create_node('watcher')

    def listeners():
        return {topic: watcher.count_subscribers(f'/sim/{topic}')
                for topic in ('poses', 'leaf_poses', 'dust')}
    wait_until(lambda: all(listeners().values()), 'subscriptions')
    followed.watched = False
    wait_until(lambda: not any(listeners().values()), 'their end')
    followed.watched = True
    wait_until(lambda: all(listeners().values()), 'subscriptions again')
    watcher.destroy_node()


def test_a_node_that_dies_is_shown_and_found_again(node, followed, folder):
    """Say that a killed node does not answer, and go on with the one that takes its place."""
    node.finish(signal.SIGKILL)
    wait_until(lambda: not followed.status().alive, 'the death')
    assert '/sim does not answer for' in followed.status().text
    again = NodeProcess(folder, SCENE)
    try:
        again.wait_for_banner()
        wait_until(lambda: followed.status().alive, 'the new node')
        wait_until(lambda: len(followed.frame().content) == 12, 'its scene')
        first = followed.frame()
        wait_until(lambda: np.abs(followed.frame().poses - first.poses).max() > 1e-5, 'motion')
        assert says(followed, SetPause(True)).startswith('paused')
    finally:
        again.kill()


def test_leaves_are_read_back():
    """Read leaves as they were written."""
    from procphys_ros.lsystem import LSystem
    leaves = LSystem.parse(LEAFY).build().leaves
    back = leaves_of(leaf_rows(leaves))
    np.testing.assert_allclose(back.pose, leaves.pose, atol=1e-6)
    np.testing.assert_array_equal(back.part, leaves.part)
    np.testing.assert_array_equal(back.texture, leaves.texture)
