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

"""The page in the browser, as far as it can be judged without a browser."""

from dataclasses import replace
from pathlib import Path
import socket
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from view_scene import DOWN, frame_of, free_port, NORTH, simulation_at_rest

from procphys_ros.blueprint import Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.wind import FASTEST, WindSettings
from procphys_ros.ros import view
from procphys_ros.scene.named import shipped_scenes, shown_name
from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.simulation.commands import Impulse, SetWind
from procphys_ros.view.batches import Batches
from procphys_ros.view.clicks import Tool
from procphys_ros.view.commands import (
    Inspect,
    LoadScene,
    SetPause,
)
from procphys_ros.view.cracks import seams
from procphys_ros.view.mortar import MortarBoxes
from procphys_ros.view.outlook import ALL, at_parts, from_side, SIDES
from procphys_ros.view.page import Page
from procphys_ros.view.player import Player
from procphys_ros.view.source import Status

pytest.importorskip('viser')
ViewClient = pytest.importorskip('view_client').ViewClient


@pytest.fixture
def simulation():
    """Fork the scene at rest for a test of its own."""
    return simulation_at_rest().fork()


@pytest.fixture(scope='module')
def frame():
    """Take a frame of the scene at rest."""
    return frame_of(simulation_at_rest())


class Drawing:
    """Stands for `ViserServer.scene`: keeps what is drawn."""

    def __init__(self):
        self.handles = {}

    def add_batched_glb(self, name, mesh, wxyzs, positions, *, batched_scales, lod):
        """Keep the copies of a mesh."""
        handle = SimpleNamespace(mesh=mesh, batched_wxyzs=wxyzs, batched_positions=positions,
                                 batched_scales=batched_scales,
                                 remove=lambda: self.handles.pop(name))
        self.handles[name] = handle
        return handle

    def positions_of(self, group):
        """List what is drawn of a group."""
        return [name for name in self.handles if name.startswith(f'/{group}/')]

    def positions(self, group):
        """Gather the positions of all copies of a group, (K, 3)."""
        return np.concatenate([handle.batched_positions for name, handle in self.handles.items()
                               if name.startswith(f'/{group}/')])


class Scripted:
    """A source that shows what it is given and keeps what it is told."""

    def __init__(self, frame):
        self.watched, self.shown, self.said = False, frame, []
        self.can_undo = True
        self.state = Status(True, 'fine', wind=(3.0, 4.0, 0.0), scene='mine')

    def frame(self):
        return self.shown

    def status(self):
        return self.state

    def say(self, command):
        self.said.append(command)

    def answer(self):
        return ''

    def close(self):
        pass


@pytest.fixture
def source(frame):
    """Make a source that shows the scene at rest."""
    return Scripted(frame)


@pytest.fixture
def page(source):
    """Serve a page on a free port."""
    made = Page(source, port=free_port(), scenes={'a': Path('a.yaml')})
    yield made
    made.close()


@pytest.fixture
def client(page):
    """Look at the page."""
    made = ViewClient(page.address)
    yield made
    made.close()


def test_every_part_and_leaf_is_drawn_once(frame):
    """Draw each part and leaf in one batch, at its place, in lengths of the page."""
    drawing = Drawing()
    Batches(drawing, 0.5).update(frame)
    for group, poses in (('parts', frame.poses), ('leaves', frame.leaf_poses)):
        drawn = drawing.positions(group)
        assert len(drawn) == len(poses)
        key = np.lexsort(drawn.round(6).T), np.lexsort((0.5 * poses[:, :3]).round(6).T)
        np.testing.assert_allclose(drawn[key[0]], 0.5 * poses[key[1], :3], atol=1e-6)


def test_only_batches_that_move_are_sent(frame):
    """Send nothing at rest, the batch of the one part that moved, and nothing again."""
    drawing = Drawing()
    batches = Batches(drawing, 1.0)
    batches.update(frame)
    batches.update(replace(frame, poses=frame.poses.copy()))
    assert batches.sent == 0
    poses = frame.poses.copy()
    poses[0, 0] += 0.25
    batches.update(replace(frame, poses=poses))
    assert batches.sent == 1
    assert np.any(np.isclose(drawing.positions('parts'), poses[0, :3]).all(axis=1))
    batches.update(replace(frame, poses=poses.copy()))
    assert batches.sent == 0


def test_slow_motion_is_not_lost(frame):
    """Send a part that creeps as soon as it is far enough from where it is shown."""
    batches = Batches(Drawing(), 1.0)
    batches.update(frame)
    poses, sent = frame.poses.copy(), []
    for _ in range(10):
        poses = poses.copy()
        poses[0, 2] += 1e-4
        batches.update(replace(frame, poses=poses))
        sent.append(batches.sent)
    assert 1 <= sum(sent) < 5


def test_leaves_are_single_where_they_are_near(simulation):
    """Draw a cluster leaf by leaf in its place for who is near, and as a cluster for others."""
    content = frame_of(simulation).content
    content = replace(content, textures=['leaf_oak' for _ in content.textures])
    frame = replace(frame_of(simulation), content=content)
    drawing, place = Drawing(), frame.leaf_poses[0, :3]
    batches = Batches(drawing, 0.5)
    for distance, single in ((100.0, False), (1.0, True), (100.0, False)):
        batches.update(frame, np.array([place + [0.0, distance, 0.0]]))
        shown = [np.isclose(drawing.positions(group), 0.5 * place).all(axis=1).sum()
                 for group in ('leaves', 'near_leaves') if drawing.positions_of(group)]
        assert shown[0] == (not single)
        assert shown[1:] in (([], [0]) if not single else ([1],))


def daylight(frame, drawing, unit):
    """Compute the share of random points in the face of the wall that nothing drawn covers."""
    wall = frame.poses[frame.content.shape == Shape.BOX, :3]
    low, high = wall.min(axis=0), wall.max(axis=0)
    points = np.random.default_rng(1).uniform(low, high, (2000, 3))
    covered = np.zeros(len(points), bool)
    for name, handle in drawing.handles.items():
        if not name.startswith(('/parts/', '/mortar/')):
            continue
        for place, turn, size in zip(handle.batched_positions, handle.batched_wxyzs,
                                     handle.batched_scales):
            away = rotation.rotate(rotation.conjugate(turn[[1, 2, 3, 0]]), points - place / unit)
            covered |= (np.abs(away) <= 0.5 * size / unit + 1e-3).all(axis=1)
    return 1.0 - covered.mean()


def test_no_daylight_shows_through_joints(frame):
    """Draw mortar in bed and head joints: a wall without it is open at every eighth point."""
    drawing, unit = Drawing(), 0.5
    Batches(drawing, unit).update(frame)
    assert daylight(frame, drawing, unit) > 0.1
    MortarBoxes(drawing, unit).update(frame)
    assert daylight(frame, drawing, unit) == 0.0


def test_mortar_follows_bricks_until_they_part(frame):
    """Send joints whose bricks move, and drop those that open; a brick has up to six."""
    drawing = Drawing()
    mortar = MortarBoxes(drawing, 1.0)
    mortar.update(frame)
    first = drawing.positions('mortar')
    bricks = np.flatnonzero(frame.content.shape == Shape.BOX)
    together = frame.poses.copy()
    together[bricks] += [0.3, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0]
    mortar.update(replace(frame, poses=together))
    np.testing.assert_allclose(drawing.positions('mortar'), first + [0.3, 0.0, 0.1], atol=1e-5)
    for missing in (together + 0.0, together + 0.0):
        missing[bricks[12]] = np.nan
        mortar.update(replace(frame, poses=missing))
        assert 3 <= np.count_nonzero(drawing.positions('mortar')[:, 2] < -100.0) <= 6
    mortar.update(frame)
    np.testing.assert_allclose(drawing.positions('mortar'), first, atol=1e-5)
    mortar.close()
    assert not drawing.handles


def test_what_is_gone_leaves_the_page(frame):
    """Put what was pulverised out of sight."""
    drawing = Drawing()
    batches = Batches(drawing, 1.0)
    batches.update(frame)
    poses = frame.poses.copy()
    poses[3] = np.nan
    batches.update(replace(frame, poses=poses))
    drawn = drawing.positions('parts')
    assert np.isfinite(drawn).all()
    assert np.count_nonzero(drawn[:, 2] < -100.0) == 1


def test_a_launched_ball_joins_the_page(simulation):
    """Draw parts that come later beside those that are there."""
    player = Player(simulation)
    drawing = Drawing()
    batches = Batches(drawing, 1.0)
    batches.update(player.frame())
    before = set(drawing.handles)
    player.say(Projectile(size=0.4, position=(0.0, -5.0, 2.0), velocity=(0.0, 1.0, 0.0)))
    player.turn(0.0)
    batches.update(player.frame())
    new, = set(drawing.handles) - before
    np.testing.assert_allclose(drawing.handles[new].batched_scales, [[0.4, 0.4, 0.4]])


def test_a_client_gets_the_scene_and_then_what_moves(page, source, client, frame):
    """Send the whole scene once, nothing while nothing moves, and then one batch."""
    page.update(0.0)
    client.wait_for(lambda m: m['type'] == 'BatchedGlbMessage')
    page.server.flush()
    poses = frame.poses.copy()
    poses[0, 0] += 0.5
    for now in (1.0, 2.0, 3.0):
        page.update(now)
    source.shown = replace(frame, poses=poses)
    page.update(4.0)
    client.wait_for(lambda m: 'batched_positions' in m.get('updates', {})
                    and m['name'].startswith('/parts/'))
    assert len(set(client.updates('batched_positions'))) == 1
    assert not client.updates('batched_scales')


def test_a_source_knows_whether_anybody_looks(page, source):
    """Want frames only while a client is there."""
    page.update(0.0)
    assert not source.watched
    client = ViewClient(page.address)
    client.wait_for(lambda m: m['type'] == 'BatchedGlbMessage')
    client.wait_until(lambda: page.update(1.0) or source.watched)
    client.close()


def test_sliders_and_clicks_of_a_client_become_commands(page, source, client):
    """Take wind, pause, scene and a click on the ground from a client."""
    page.update(0.0)
    client.change('speed [m/s]', 8.0)
    client.change('pause', True)
    client.change('scene', 'a')
    client.change('load', True)
    client.change('tool', str(Tool.CHARGE))
    client.click((0.0, -2.0 * page.unit, 1.0 * page.unit), (0.0, -1.0, -1.0))
    client.wait_until(lambda: len(source.said) >= 4)
    kinds = {type(command): command for command in source.said}
    np.testing.assert_allclose(kinds[SetWind].velocity, [4.8, 6.4, 0.0], atol=0.1)
    assert kinds[SetPause] == SetPause(True)
    assert kinds[LoadScene] == LoadScene(Path('a.yaml'))
    np.testing.assert_allclose(kinds[Explosion].position, [0.0, -3.0, 0.0], atol=1e-5)


BRANCH, BRICK = (np.array([0.0, -5.0, 0.5]), NORTH), (np.array([5.0, -5.0, 0.15]), NORTH)
NEAR, FAR = (np.array([0.0, -3.0, 1.0]), DOWN), (np.array([0.0, -900.0, 1.0]), DOWN)


@pytest.mark.parametrize('where', [BRANCH, BRICK, NEAR, FAR])
def test_the_first_click_changes_nothing(page, source, where):
    """Look only, wherever it is, until another tool is chosen."""
    page.update(0.0)
    page.click(*where)
    assert all(isinstance(command, Inspect) for command in source.said)


@pytest.mark.parametrize('tool', [tool for tool in Tool if tool is not Tool.LOOK])
def test_tools_do_not_reach_the_horizon(page, source, client, tool):
    """Refuse what is far from the scene, at the place itself."""
    page.update(0.0)
    page.controls.tool.value = str(tool)
    page.click(*FAR)
    assert not source.said
    page.update(1.0)
    client.wait_for(lambda m: 'too far away' in str(m.get('props', {}).get('text')))


def test_a_command_leaves_a_mark_that_fades(page, source, client):
    """Flash where a charge goes off, say what it is, and take both away."""
    page.update(0.0)
    page.controls.tool.value = str(Tool.CHARGE)
    page.click(*NEAR)
    page.update(1.0)
    flash = client.wait_for(lambda m: m.get('name') == '/marks/1/flash')
    np.testing.assert_allclose(flash['props'].get('position', [0.0, -3.0 * page.unit, 0.0]),
                               [0.0, -3.0 * page.unit, 0.0], atol=1e-6)
    client.wait_for(lambda m: m.get('props', {}).get('text') == '10 kg TNT')
    page.update(1.5)
    client.wait_for(lambda m: m.get('name') == flash['name'] and 'opacity' in m.get('updates', ''))
    page.update(60.0)
    client.wait_for(lambda m: m['type'] == 'RemoveSceneNodeMessage'
                    and m['name'].startswith('/marks/1'))


def test_only_the_sliders_of_the_tool_are_shown(page):
    """Show what a click will do, and the sliders that matter for it."""
    controls = page.controls
    for tool, sliders in ((Tool.LOOK, set()), (Tool.PULL, {'push [m/s]'}),
                          (Tool.BALL, {'ball [kg]', 'ball [m]', 'ball [m/s]'}),
                          (Tool.CHARGE, {'charge [kg]'})):
        controls.tool.value = str(tool)
        assert sliders == {slider.label for slider in (
            controls.push, controls.ball_mass, controls.ball_size, controls.ball_speed,
            controls.charge) if slider.visible}
    assert '10 kg TNT' in controls.effect.content
    controls.charge.value = 2.5
    assert '2.5 kg TNT' in controls.effect.content


def test_a_click_asks_what_the_part_carries(page, source, frame):
    """Pull the trunk, and ask for its load."""
    page.update(0.0)
    page.controls.tool.value = str(Tool.PULL)
    page.click(*BRANCH)
    pull, question = source.said
    assert isinstance(pull, Impulse)
    assert question == Inspect(pull.part)
    assert frame.content.name(pull.part) in page.controls.selected.content


def test_the_scene_box_says_what_runs(page, source, client):
    """Show the name of what runs, whatever may be loaded, also after another was loaded."""
    page.update(0.0)
    assert page.controls.scene.value == 'mine'
    client.change('load', True)  # which is none that may be loaded
    client.change('pause', True)
    client.wait_until(lambda: source.said)
    source.state = replace(source.state, scene='a')
    page.update(1.0)
    assert page.controls.scene.value == 'a' and page.controls.scene.options == ('a',)
    assert source.said == [SetPause(True)]


def test_a_shipped_scene_has_its_name_also_by_its_path(tmp_path):
    """Tell a shipped scene from one of the same name, and from grammars."""
    garden = shipped_scenes()['garden']
    own = tmp_path / 'garden.yaml'
    own.write_bytes(garden.read_bytes())
    assert [shown_name(word) for word in ('garden', str(garden), 'oak.lsys', str(own))] == [
        'garden', 'garden', 'oak.lsys', str(own)]


def test_sliders_reach_as_far_as_the_source(page, source, client):
    """Set the strongest wind that there may be, and show a pace beyond the usual."""
    source.state = replace(source.state, wind=(0.0, 100.0, 1.0), factor=9.0)
    page.update(0.0)
    assert page.controls.wind.value == 100.0 and page.controls.factor.value == 9.0
    client.change('speed [m/s]', page.controls.wind.max)
    for direction in range(1, 360, 7):
        client.change('to [°]', direction)
    client.wait_until(lambda: len(source.said) == 53)
    for command in source.said:
        assert WindSettings(velocity=command.velocity) and command.velocity[2] == 1.0
        np.testing.assert_allclose(np.linalg.norm(command.velocity), FASTEST, rtol=1e-4)


def test_the_wind_is_an_arrow_over_the_scene(page, source, client, frame):
    """Point to where the wind blows to, above everything, and vanish with the wind."""
    page.update(0.0)
    page.update(1.0)
    (tail, tip), = page.server.scene.get_handle_by_name('/wind/arrow').points
    np.testing.assert_allclose((tip - tail) / np.linalg.norm(tip - tail), [0.6, 0.8, 0.0],
                               atol=1e-5)
    assert tail[2] > page.unit * frame.poses[:, 2].max()
    source.state = replace(source.state, wind=(0.0, 0.0, 0.0))
    page.update(2.0)
    client.wait_for(lambda m: m['type'] == 'RemoveSceneNodeMessage' and m['name'] == '/wind/arrow')


def looks(client, page, eye, target):
    """Wait until a client is told to look from a place to another [m]."""
    def tells(message, field, place):
        return field in message and np.allclose(np.array(message[field]) / page.unit, place)
    client.wait_for(lambda m: m['type'] == 'SetCameraPositionMessage'
                    and tells(m, 'position', eye))
    client.wait_for(lambda m: tells(m, 'look_at', target))


@pytest.mark.parametrize('side', [ALL, *SIDES])
def test_the_eye_goes_where_the_button_says(page, client, frame, side):
    """Look at the scene from each side, all of it before the eye."""
    page.update(0.0)
    client.change('from', side)
    eye, target = from_side(frame, side)
    looks(client, page, eye, target)
    sight, away = target - eye, frame.poses[:, :3] - eye
    cosine = away @ sight / np.linalg.norm(away, axis=1) / np.linalg.norm(sight)
    assert cosine.min() > np.cos(np.radians(20.0)) and eye[2] > 0.5
    main = {'above': (2, 1), 'south': (1, -1), 'west': (0, -1), 'north': (1, 1), 'east': (0, 1)}
    if side in main:
        axis, sign = main[side]
        assert np.abs(sight).argmax() == axis and -sign * sight[axis] > 0.0


def test_objects_are_listed_and_looked_at(page, source, client, frame):
    """Name all objects, and look at the one that is chosen from where all of it is seen."""
    page.update(0.0)
    assert page.outlook.object.options[1:] == ('tree', 'wall')
    client.change('object', 'wall')
    bricks = np.flatnonzero(frame.content.shape == Shape.BOX)
    eye, target = at_parts(frame, bricks)
    looks(client, page, eye, target)
    wall = frame.poses[bricks, :3]
    assert (wall.min(axis=0) - 0.1 < target).all() and (target < wall.max(axis=0) + 0.1).all()


def test_objects_that_join_are_listed(page, simulation):
    """Name a ball that is thrown, and look at nothing where it is gone."""
    player = Player(simulation)
    page.draw(player.frame())
    player.say(Projectile(size=0.4, position=(0.0, -5.0, 2.0), velocity=(0.0, 1.0, 0.0)))
    player.turn(0.0)
    page.draw(player.frame())
    assert page.outlook.object.options[1:] == ('tree', 'wall', 'projectile_0')
    gone = replace(player.frame(), poses=np.full_like(player.frame().poses, np.nan))
    assert at_parts(gone, np.array([0])) is None


def test_what_others_change_moves_the_sliders(page, source):
    """Show the wind and the pause that somebody else has set, without saying them again."""
    page.update(0.0)
    np.testing.assert_allclose(page.controls.wind.value, 5.0)
    source.state = Status(True, 'fine', paused=True, wind=(0.0, -2.0, 0.0))
    page.update(1.0)
    assert page.controls.pause.value is True
    assert (page.controls.wind.value, page.controls.direction.value) == (2.0, 270)
    assert not source.said


def test_a_dead_source_is_shown_as_such(page, source, client):
    """Say on the page that nothing answers any more."""
    page.update(0.0)
    source.state = Status(False, '/sim does not answer')
    page.update(1.0)
    client.wait_for(lambda m: '/sim does not answer' in str(m))


def test_a_crack_fills_the_joint_between_two_bricks(frame):
    """Draw a seam as wide as the mortar across the face that two bricks share, and no other."""
    bricks = np.flatnonzero(frame.content.shape == Shape.BOX)
    first = bricks[0]
    above = bricks[frame.poses[bricks, 2] > frame.poses[first, 2] + 0.01]
    second = above[np.abs(frame.poses[above, :3] - frame.poses[first, :3]).sum(axis=1).argmin()]
    far = bricks[-1]
    pairs = np.array([(first, second), (first, far), (-1, first), (0, 1)])
    poses, size = seams(replace(frame, broken=pairs))
    assert len(poses) == 1  # the far one is far, the ground no brick, a branch no brick
    one, other = frame.poses[[first, second], :3]
    heights = 0.5 * frame.content.size[[first, second], 2]
    gap = other[2] - one[2] - heights.sum()
    np.testing.assert_allclose(poses[0, 2], one[2] + heights[0] + 0.5 * gap, atol=1e-9)
    np.testing.assert_allclose(size[0, 2], gap, atol=0.004)
    shared = 0.5 * frame.content.size[[first, second], 0].sum() - abs(other[0] - one[0])
    np.testing.assert_allclose(size[0, 0], shared, atol=0.007)
    np.testing.assert_allclose(size[0, 1], frame.content.size[first, 1], atol=0.007)


def test_dust_is_sent_while_there_is_some(page, source, client, frame):
    """Draw puffs, and take them away when they are gone."""
    page.update(0.0)
    puffs = Puffs(np.ones((3, 3)), np.ones(3), np.full(3, 0.5), np.ones(3))
    for now, dust in ((1.0, puffs), (2.0, Puffs.none())):
        source.shown = replace(frame, dust=dust)
        page.update(now)
        client.wait_for(lambda m: m.get('name') == '/dust')
    handle = page.server.scene.get_handle_by_name('/dust')
    assert not handle.batched_opacities.any()


def test_a_port_that_is_taken_is_named(frame):
    """Refuse to serve on another port than the one asked for."""
    with socket.socket() as taken:
        taken.bind(('localhost', 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(view.ProcPhysError, match=f'localhost:{port}.*in use'):
            Page(Scripted(frame), port=port)


@pytest.mark.parametrize('asked', [b'', b'HEAD / HTTP/1.1\r\n\r\n', b'\x16\x03'])
def test_who_asks_for_no_page_is_not_logged(page, caplog, asked):
    """Close the connections of browsers that change their mind, of scanners and health checks."""
    with socket.create_connection(('localhost', page.server.get_port())) as visitor:
        visitor.sendall(asked)
        visitor.shutdown(socket.SHUT_WR)
        assert visitor.recv(999) == b'' and not caplog.records


def test_without_viser_the_remedy_is_said(frame, monkeypatch):
    """Say what to install."""
    monkeypatch.setitem(sys.modules, 'viser', None)
    with pytest.raises(view.ProcPhysError, match=r'pip install procphys_ros\[view\]'):
        Page(Scripted(frame))
