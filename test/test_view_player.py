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
"""The player of a page: pace, commands and resets, and clicks on what is seen."""

from dataclasses import replace
from pathlib import Path
import threading

from masonry_walls import wall
import numpy as np
import pytest
from view_scene import DOWN, frame_of, free_port, NORTH, simulation_at_rest, TREE

from procphys_ros.blueprint import Shape
from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Cut, Explosion, Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.commands import Impulse, SetWind
from procphys_ros.view import show
from procphys_ros.view.clicks import command_of, describe, Strength, Tool
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
from procphys_ros.view.picking import GROUND, Hit, pick
from procphys_ros.view.player import Player
from procphys_ros.view.surroundings import Vicinity


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


@pytest.fixture(scope='module')
def frame():
    """Take a frame of the scene at rest."""
    return frame_of(simulation_at_rest())


def used(tool, hit, frame, direction, **strength):
    """Return the command of a tool."""
    return command_of(tool, hit, frame.content, direction, Strength(**strength),
                      Vicinity.of(frame))


def middle_of_wall(frame):
    """Return a brick in the middle of the wall."""
    boxes = np.flatnonzero(frame.content.shape == Shape.BOX)
    return int(boxes[len(boxes) // 2])


@pytest.mark.parametrize('away', [5.0, 20.0, 40.0])
@pytest.mark.parametrize('aside', [0.0, 1.0])
def test_the_brick_under_the_pointer_is_met(frame, away, aside):
    """Point at each brick from near and far, straight and askew: meet its face, not next to it."""
    bricks = np.flatnonzero(frame.content.shape == Shape.BOX)
    eye = np.array([5.0 + away * np.sin(aside), -away * np.cos(aside), 1.0 + 0.1 * away])
    for brick in bricks:
        face = frame.poses[brick, :3] - [0.0, 0.5 * frame.content.size[brick, 1], 0.0]
        hit = pick(frame, eye, face - eye)
        assert hit.part == brick
        np.testing.assert_allclose(hit.point, face, atol=1e-9)


def test_a_twig_is_met_next_to_it(frame):
    """Miss a thin branch by a centimetre at 8 m, before the sky, a wall and the ground."""
    content = frame.content
    twig = int(np.flatnonzero(content.shape != Shape.BOX)[-1])
    thin = replace(content, size=np.where(np.arange(len(content.size))[:, None] == twig,
                                          [0.01, 0.01, 1.0], content.size))
    poses = frame.poses.copy()
    poses[twig] = [5.5, -1.0, 0.4, *rotation.IDENTITY]
    shown = replace(frame, content=thin, poses=poses)
    for direction in (NORTH, [0.0, 1.0, 0.2], [0.0, 1.0, -0.1]):
        aim = np.array([5.515, -1.005, 0.4])
        hit = pick(shown, aim - 8.0 * np.array(direction), np.array(direction))
        assert hit.part == twig and np.linalg.norm(hit.point - aim) < 0.05


def test_a_turned_part_is_met_where_it_is_now(frame):
    """Hit a brick that lies elsewhere, turned, and no longer where it stood."""
    brick = middle_of_wall(frame)
    old = frame.poses[brick, :3].copy()
    poses = frame.poses.copy()
    poses[brick] = [0.0, 40.0, 1.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
    moved = replace(frame, poses=poses)
    assert pick(moved, np.array([0.0, 37.0, 1.0]), NORTH).part == brick
    assert pick(moved, old - 3.0 * NORTH, NORTH) is None or pick(
        moved, old - 3.0 * NORTH, NORTH).part != brick


def test_a_ray_down_meets_the_ground_where_nothing_is(frame):
    """Pick the point on the ground, and nothing in the sky."""
    sloping = np.array([1.0, 0.0, -1.0])
    hit = pick(frame, np.array([-30.0, 7.0, 2.0]), sloping)
    assert hit.part == GROUND
    np.testing.assert_allclose(hit.point, [-28.0, 7.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(hit.distance, np.sqrt(8.0))
    assert pick(frame, np.array([-30.0, 7.0, 2.0]), -DOWN) is None


def test_clicks_on_a_hillside_meet_its_surface():
    """Set a charge off on the slope, and start a ball above it."""
    scene = Scene.from_parameters({'terrain': {'noise': 8.0, 'wavelength': 30.0, 'extent': 60.0}})
    scene.add(wall(4, 10), (5.0, 0.0, 0.0), name='wall')
    simulation = Simulation(scene)
    frame = frame_of(simulation)
    terrain = simulation.model.terrain
    hit = pick(frame, np.array([-1.0, 3.0, 30.0]), DOWN)
    height = terrain.height(np.array([[-1.0, 3.0]]))[0]
    assert hit.part == GROUND and hit.point[2] == pytest.approx(height) and height > 0.5
    charge = used(Tool.CHARGE, hit, frame, DOWN)
    np.testing.assert_allclose(charge.position, [-1.0, 3.0, height])
    simulation.apply(charge)
    brick = middle_of_wall(frame)
    up = np.array([0.0, 0.6, 0.8])
    hit = pick(frame, frame.poses[brick, :3] - 2.0 * up, up)
    ball = used(Tool.BALL, hit, frame, up)
    over = ball.position[2] - terrain.height(np.array([ball.position]))[0]
    assert over >= 0.5 * Strength().ball_size


def test_a_leaf_counts_as_the_branch_that_carries_it(frame):
    """Pick the branch whose leaf is before the eye."""
    leaf = frame.leaf_poses[0]
    middle = leaf[:3] + rotation.rotate(leaf[3:], np.array([0.0, 0.0, 0.15]))
    eye = middle + np.array([0.3, -3.0, 0.1])
    hit = pick(frame, eye, middle - eye)
    assert hit.part == frame.content.leaves.part[0]


def test_what_is_gone_is_not_met(frame):
    """Look through a brick that was pulverised."""
    brick = middle_of_wall(frame)
    poses = frame.poses.copy()
    place = poses[brick, :3].copy()
    poses[brick] = np.nan
    hit = pick(replace(frame, poses=poses), place - 3.0 * NORTH, NORTH)
    assert hit is None or hit.part != brick


def test_a_click_on_a_branch_pulls_it_towards_the_eye(frame):
    """Set the branch to the speed of the slider, against the line of sight."""
    hit = pick(frame, np.array([0.0, -5.0, 0.5]), NORTH)
    command = used(Tool.PULL, hit, frame, NORTH, push=4.0)
    assert isinstance(command, Impulse)
    assert frame.content.shape[command.part] == Shape.CAPSULE
    np.testing.assert_allclose(command.linear,
                               -4.0 * frame.content.mass[command.part] * NORTH)


def test_a_click_on_a_wall_throws_a_ball_that_hits_it(frame):
    """Let the ball fly at the point that was clicked, from above the ground."""
    place = frame.poses[middle_of_wall(frame), :3]
    eye = place + np.array([0.0, -20.0, 8.0])
    sight = (place - eye) / np.linalg.norm(place - eye)
    hit = pick(frame, eye, sight)
    ball = used(Tool.BALL, hit, frame, sight, ball_speed=30.0, ball_size=0.4)
    assert isinstance(ball, Projectile)
    velocity, start = np.array(ball.velocity), np.array(ball.position)
    np.testing.assert_allclose(np.linalg.norm(velocity), 30.0)
    reach = np.linalg.norm(hit.point - start)
    np.testing.assert_allclose(start + reach * velocity / 30.0, hit.point, atol=1e-9)
    assert start[2] > 0.2


def test_a_click_on_the_ground_sets_off_a_charge(frame):
    """Set the charge of the slider off where the ground was clicked."""
    hit = pick(frame, np.array([-2.0, 3.0, 5.0]), DOWN)
    assert used(Tool.LOOK, hit, frame, DOWN) is None
    assert used(Tool.CHARGE, hit, frame, DOWN, charge=2.5) == Explosion([-2.0, 3.0, 0.0], 2.5)


def test_pushes_are_pulls_the_other_way(frame):
    """Push bricks as branches, and leave the ground where it is."""
    hit = pick(frame, frame.poses[middle_of_wall(frame), :3] - 3.0 * NORTH, NORTH)
    push, pull = (used(tool, hit, frame, NORTH) for tool in (Tool.PUSH, Tool.PULL))
    assert push.part == pull.part == hit.part and push.linear[1] > 0.0
    np.testing.assert_allclose(push.linear, np.negative(pull.linear))
    with pytest.raises(CommandError, match='the ground'):
        used(Tool.PUSH, pick(frame, np.array([-2.0, 3.0, 5.0]), DOWN), frame, DOWN)


def test_a_saw_cuts_the_part_that_was_clicked(frame):
    """Saw through what holds it, and leave the ground whole."""
    hit = pick(frame, frame.poses[middle_of_wall(frame), :3] - 3.0 * NORTH, NORTH)
    assert used(Tool.SAW, hit, frame, NORTH) == Cut(str(hit.part))
    with pytest.raises(CommandError, match='the ground'):
        used(Tool.SAW, pick(frame, np.array([-2.0, 3.0, 5.0]), DOWN), frame, DOWN)


@pytest.mark.parametrize('away', [1.05, 3.0, 1e4])
def test_tools_act_around_the_scene_only(frame, away):
    """Refuse the ground that is further from the scene than the scene is large."""
    vicinity = Vicinity.of(frame)
    for side in (-1.0, 1.0):
        edge = np.where(side < 0.0, vicinity.low, vicinity.high)
        for axis in range(2):
            inner, outer = vicinity.middle, vicinity.middle
            inner[axis] = edge[axis] + 0.95 * side * vicinity.margin
            outer[axis] = edge[axis] + away * side * vicinity.margin
            assert used(Tool.CHARGE, Hit(GROUND, inner, 9.0), frame, DOWN)
            with pytest.raises(CommandError, match='too far away'):
                used(Tool.CHARGE, Hit(GROUND, outer, 9.0), frame, DOWN)


def test_what_was_clicked_is_named(frame):
    """Say name, material and mass."""
    brick = middle_of_wall(frame)
    hit = pick(frame, frame.poses[brick, :3] - 3.0 * NORTH, NORTH)
    text = describe(hit, frame.content)
    assert frame.content.name(brick) in text
    assert f'{frame.content.mass[brick]:.3g} kg' in text
