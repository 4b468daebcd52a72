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

"""The player of a page: pace, commands, resets, other scenes, what is clicked meanwhile."""

from pathlib import Path
import threading

import numpy as np
import pytest
from view_scene import free_port, simulation_at_rest, TREE

from procphys_ros.blueprint import Shape
from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.simulation.commands import Impulse, SetWind
from procphys_ros.view import show
from procphys_ros.view.commands import (
    Inspect,
    LoadScene,
    Reset,
    SetPause,
    SetSpeed,
    StartGust,
    Step,
    Undo,
)
from procphys_ros.view.player import Player


@pytest.fixture
def simulation():
    """Fork the scene at rest for a test of its own."""
    return simulation_at_rest().fork()


def test_time_passes_at_the_pace_asked_for(simulation):
    """Simulate half a second in a second at half speed, and nothing while paused."""
    player = Player(simulation)
    player.say(SetSpeed(0.5))
    for now in np.arange(0.0, 1.0 + 1e-9, 1.0 / 64.0):
        player.turn(now)
    np.testing.assert_allclose(simulation.time, 0.5, atol=1.1 * simulation.time_step)
    player.say(SetPause(True))
    before = simulation.time
    player.turn(2.0)
    assert simulation.time == before
    assert player.status().paused
    player.say(Step())
    player.turn(3.0)
    np.testing.assert_allclose(simulation.time, before + simulation.time_step)


def test_wind_gust_and_reset_reach_the_simulation(simulation):
    """Change the wind, start a gust, and go back to the start."""
    player = Player(simulation)
    player.say(SetWind((6.0, 0.0, 0.0)))
    player.say(StartGust(9.0))
    for now in (0.0, 0.05, 0.1):
        player.turn(now)
    np.testing.assert_allclose(player.status().wind, [6.0, 0.0, 0.0])
    assert simulation.time > 0.0
    assert not player.answer()
    simulation.set_wind_enabled(False)
    player.say(StartGust(9.0))
    player.turn(0.15)
    assert 'the wind is off' in player.answer()
    player.say(SetPause(True))
    player.say(Reset())
    player.turn(0.2)
    assert simulation.time == 0.0


def test_a_reset_takes_the_cracks_off_the_page(simulation, monkeypatch):
    """Show what has broken since, also when it is as much as before, between two frames."""
    def crack(part):
        simulation.log.record(0.0, np.zeros((2, 3)), np.arange(2), np.full((2, 2), part), 0,
                              np.ones(2))
    player, reset = Player(simulation), simulation.reset
    monkeypatch.setattr(simulation, 'reset', lambda: (reset(), crack(1)))
    crack(0)
    player.say(SetPause(True))
    player.turn(0.0)
    assert player.frame().broken.tolist() == [[0, 0], [0, 0]]
    player.say(Reset())
    player.turn(1.0)
    assert player.frame().broken.tolist() == [[1, 1], [1, 1]]


def test_a_refused_command_is_answered_and_changes_nothing(simulation):
    """Say why a command cannot be carried out, and go on."""
    player = Player(simulation)
    player.say(Impulse('oak', (1.0, 0.0, 0.0)))
    player.turn(0.0)
    assert 'there is no part "oak"' in player.answer()
    player.say(LoadScene(Path('nowhere.yaml')))
    player.turn(0.1)
    assert 'nowhere.yaml' in player.answer()
    assert player.simulation is simulation
    player.say(Step())
    player.turn(0.2)
    assert 'pause' in player.answer()
    player.say(Inspect(0))
    player.turn(0.3)
    assert player.answer().startswith('tree/segment_0 carries ')


def test_another_scene_takes_the_place_of_the_first(simulation, tmp_path):
    """Load a scene file, and give its frames another number."""
    path = tmp_path / 'one.yaml'
    path.write_text(f'/**: {{ros__parameters: {{scene: {{objects: [twig]}}, '
                    f'twig: {{grammar_text: "{TREE.strip()}"}}}}}}', 'utf-8')
    player = Player(simulation)
    first = player.frame()
    player.say(SetPause(True))
    player.say(LoadScene(path))
    player.turn(0.0)
    assert player.answer() == ''
    frame = player.frame()
    assert frame.content.scene != first.content.scene
    assert len(frame.poses) == np.count_nonzero(first.content.shape == Shape.CAPSULE)


def test_nothing_is_made_for_nobody(simulation):
    """Take no frames while nobody looks."""
    player = Player(simulation)
    player.watched = False
    before = player.frame()
    for now in (0.0, 0.1, 0.2):
        player.turn(now)
    assert simulation.time > 0.0
    assert player.frame() is before


def test_a_player_remembers_what_broke(simulation):
    """Return the pairs of parts of all broken bonds, and discard them after a reset."""
    player = Player(simulation)
    wall = np.flatnonzero(player.frame().content.shape == Shape.BOX)
    place = player.frame().poses[wall[-1], :3]
    player.say(Projectile(size=0.3, mass=20.0, position=tuple(place - [0.0, 0.6, 0.0]),
                          velocity=(0.0, 30.0, 0.0)))
    for now in np.arange(0.0, 1.0, 0.06):
        player.turn(now)
    broken = player.frame().broken
    assert 0 < len(broken) == simulation.bonds_broken
    assert np.isin(broken[broken != -1], wall).all()
    player.say(Reset())
    player.say(SetPause(True))
    player.turn(1.1)
    assert len(player.frame().broken) == 0


def test_clicks_while_a_scene_is_loaded_are_not_for_it(simulation, tmp_path):
    """Set off no charge in a scene that nobody has seen yet; a pause holds for it, too."""
    path = tmp_path / 'one.yaml'
    path.write_text(f'/**: {{ros__parameters: {{scene: {{objects: [twig]}}, '
                    f'twig: {{grammar_text: "{TREE.strip()}"}}}}}}', 'utf-8')
    player = Player(simulation)
    for command in (LoadScene(path), Inspect(30), Impulse(0, (1e3, 0.0, 0.0)), SetPause(True),
                    Explosion((1.0, 0.0, 0.0), 10.0)):
        player.say(command)
    player.turn(0.0)
    assert player.answer() == '' and player.status().paused
    assert player.simulation is not simulation and player.simulation.time == 0.0
    assert not player.simulation.state.parts.velocities.any()


def test_a_part_that_is_no_more_has_no_load(simulation):
    """Answer a click on what went with a reset, and go on."""
    player = Player(simulation)
    ball = len(simulation.blueprint)
    player.say(Projectile(size=0.4, position=(0.0, -5.0, 2.0), velocity=(0.0, 1.0, 0.0)))
    player.say(Reset())
    player.say(Inspect(ball))
    player.turn(0.0)
    assert f'there is no part "{ball}"' in player.answer()


def test_what_is_thrown_after_a_reset_is_drawn_anew(simulation):
    """Show a block that was thrown before the page saw that the ball of before is gone."""
    player = Player(simulation)
    place = {'position': (0.0, -5.0, 2.0), 'velocity': (0.0, 1.0, 0.0)}
    player.say(Projectile(size=0.4, **place))
    player.turn(0.0)
    first = player.frame().content
    player.say(Reset())
    player.say(Projectile('box', (0.9, 0.5, 0.3), **place))
    player.turn(1.0)
    shown = player.frame().content
    np.testing.assert_allclose(shown.size[-1], [0.9, 0.5, 0.3])
    assert not shown.ball[-1] and shown.scene != first.scene


@pytest.mark.parametrize('click', [
    Projectile(size=0.3, mass=20.0, position=(5.5, -0.6, 0.2), velocity=(0.0, 30.0, 0.0)),
    Explosion((5.5, -1.0, 0.0), 2.0), Impulse(0, (900.0, 0.0, 0.0)), StartGust(30.0), Reset()])
def test_a_click_can_be_undone(simulation, click):
    """Go back to the bit to the moment before it, in the same simulation, and once."""
    player = Player(simulation)
    simulation.set_wind((3.0, 0.0, 0.0))
    for now in (0.0, 0.1):
        player.turn(now)
    time, poses = simulation.time, simulation.poses.copy()
    shown = len(player.frame().content)
    player.say(click)
    for now in np.arange(0.2, 0.8, 0.06):
        player.turn(now)
    for command in (SetPause(True), Undo()):
        player.say(command)
    player.turn(0.9)
    assert player.answer() == f'back at {time:.1f} s' and simulation.time == time
    np.testing.assert_array_equal(simulation.poses, poses)
    assert len(player.frame().content) == len(player.frame().poses) == shown
    assert not len(player.frame().broken)
    player.say(Undo())
    player.turn(1.0)
    assert player.answer() == 'nothing to undo'


def test_a_refused_click_leaves_the_undo_of_the_last(simulation):
    """Undo the click before one that had no effect."""
    player = Player(simulation)
    player.say(SetPause(True))
    player.say(Projectile(size=0.4, position=(0.0, -5.0, 2.0), velocity=(0.0, 1.0, 0.0)))
    player.say(Impulse('oak', (1.0, 0.0, 0.0)))
    player.turn(0.0)
    count = len(simulation.poses)
    player.say(Undo())
    player.turn(1.0)
    assert len(simulation.poses) == count - 1


def test_what_runs_is_named(simulation, tmp_path):
    """Call a scene as it was given, or by its objects, and by its file after a load."""
    assert Player(simulation).status().scene == 'tree, wall'
    player = Player(simulation, 'mine')
    assert player.status().scene == 'mine'
    path = tmp_path / 'one.yaml'
    path.write_text('/**: {ros__parameters: {scene: {objects: []}}}', 'utf-8')
    player.say(LoadScene(path))
    player.turn(0.0)
    assert player.status().scene == 'one'


def test_a_page_that_is_closed_ends_what_plays(simulation):
    """Leave no thread behind that steps a simulation which its owner takes back."""
    pytest.importorskip('viser')
    before = set(threading.enumerate())
    page = show(simulation, port=free_port())
    assert any(thread.name == 'player' for thread in threading.enumerate())
    page.close()
    left = {thread.name for thread in set(threading.enumerate()) - before}
    assert not left & {'player', 'page'}
    time = simulation.time
    simulation.step()
    assert simulation.time == pytest.approx(time + simulation.time_step)
