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

"""Tests of films and series of pictures: cameras, files, and what is refused."""

import errno
import os
from pathlib import Path
import signal
import subprocess
import sys

import numpy as np
from PIL import Image
import pytest

from procphys_ros.errors import SceneError
from procphys_ros.lsystem import LSystem
from procphys_ros.render import draw
from procphys_ros.render.camera import frame, View
from procphys_ros.render.command import main
from procphys_ros.render.drawing import Moment
from procphys_ros.render.film import moment_of, Shot
from procphys_ros.render.motion import CameraMotion
from procphys_ros.render.picture import Renderer
from procphys_ros.scene import Scene
from procphys_ros.scene.scenery import CameraSettings, SkySettings, SunSettings
from procphys_ros.scene.settings import read_settings
from procphys_ros.scene.sources import load_grammar
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

_ROOT = Path(__file__).resolve().parents[1]
_SIZE = (96, 64)
_WORDS = ['--size', '96x64', '--fps', '10']
_POLE = 'name: pole\ntextures: bark_oak\naxiom: Width(0.2) F(1) F(1)\n'


@pytest.fixture(scope='module')
def scene(tmp_path_factory):
    """Write the file of a scene with two poles and a camera of its own."""
    folder = tmp_path_factory.mktemp('scene')
    (folder / 'pole.lsys').write_text(_POLE, encoding='utf-8')
    path = folder / 'poles.yaml'
    path.write_text("""
/**:
  ros__parameters:
    scene: {objects: [pole]}
    camera: {position: [0.0, -8.0, 2.0], target: [0.0, 0.0, 1.0]}
    pole: {grammar: pole.lsys, count: 2, layout: row, spacing: 2.0}
""", encoding='utf-8')
    return path


def _frames(path: Path) -> list[np.ndarray]:
    import av

    with av.open(str(path)) as container:
        return [frame.to_ndarray(format='rgb24').astype(int)
                for frame in container.decode(video=0)]


def test_film_has_its_length_and_size(scene, tmp_path, capsys):
    """Write a film of six pictures, and leave nothing beside it."""
    path = tmp_path / 'film.mp4'
    assert main([str(scene), '--out', str(path), '--from', '0.2', '--to', '0.8', *_WORDS]) == 0
    assert '6 pictures from 0.2 s to 0.8 s' in capsys.readouterr().out
    frames = _frames(path)
    assert len(frames) == 6 and frames[0].shape == (64, 96, 3)
    assert [p.name for p in tmp_path.iterdir()] == ['film.mp4']


@pytest.mark.parametrize('start', [0.0, 0.5])
@pytest.mark.parametrize('rate, most', [(120.0, 2), (240.0, 4), (40.0, 1), (24.0, 1)])
def test_pictures_are_evenly_apart(start, rate, most):
    """Draw each step as often as all others, and pass over as few as the rate asks for."""
    steps = Shot(start, 600, rate, _SIZE, CameraSettings()).steps(1.0 / 60.0)
    pace = np.diff(steps)
    assert steps[0] == 60 * start and pace.max() - pace.min() <= 1
    assert np.bincount(steps).max() == most
    if rate > 60.0:
        assert (np.bincount(steps)[steps[0] + 1:-1] == most).all()
    else:
        assert np.abs(steps - 60.0 * (start + np.arange(600) / rate)).max() <= 0.5 + 1e-6


def test_orbiting_camera_changes_the_pictures_of_a_series(scene, tmp_path):
    """Turn around the poles: the same picture after half a round would be mirrored."""
    path = tmp_path / 'frames' / '%04d.png'
    assert main([str(scene), '--out', str(path), '--to', '0.3', '--camera', 'orbit',
                 *_WORDS]) == 0
    files = sorted(path.parent.iterdir())
    assert [p.name for p in files] == ['0000.png', '0001.png', '0002.png']
    first, last = (np.asarray(Image.open(files[i]), int) for i in (0, 2))
    assert first.shape == (64, 96, 3) and np.abs(first - last).max() > 30


def test_loop_is_a_gif_that_goes_on(scene, tmp_path):
    """Write a gif with a pause of a tenth of a second between pictures."""
    path = tmp_path / 'loop.gif'
    view = ['--camera', 'orbit', '--view', '0', '-5', '1']
    assert main([str(scene), '--out', str(path), '--to', '0.4', *view, *_WORDS]) == 0
    with Image.open(path) as loop:
        assert loop.n_frames == 4 and loop.info['loop'] == 0 and loop.info['duration'] == 100


def test_camera_orbits_and_follows():
    """Come back after one round, and move by what the part has moved, a little later."""
    points = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 2.0]])
    orbit = CameraMotion(CameraSettings(motion='orbit', period=8.0), points, _SIZE)
    start, half, end = (orbit.view(t) for t in (0.0, 4.0, 8.0))
    assert end.eye == pytest.approx(start.eye)
    assert (half.eye - half.target)[:2] == pytest.approx(-(start.eye - start.target)[:2])
    place = np.array([1.0, 0.0, 1.0])
    follow = CameraMotion(CameraSettings(motion='follow', part='x/0'), points, _SIZE, place)
    first = follow.view(0.0, place)
    assert first.target == pytest.approx(place)
    moved = place + [3.0, 0.0, 0.0]
    assert 0.5 < follow.view(0.25, moved).target[0] - 1.0 < 2.5
    last = follow.view(9.0, moved)
    assert last.target == pytest.approx(moved, abs=1e-3)
    assert last.eye - first.eye == pytest.approx([3.0, 0.0, 0.0], abs=1e-3)
    assert follow.view(9.1, np.full(3, np.nan)).target == pytest.approx(last.target)


def test_projection_puts_points_where_the_camera_sees_them():
    """Project the target into the middle, and the edge of the view to the edge."""
    view = View(np.array([3.0, -4.0, 2.0]), np.array([0.0, 0.0, 2.0]), 40.0)
    edge = view.target + np.tan(np.radians(20.0)) * 5.0 * view.up
    spots = np.column_stack([np.stack([view.target, edge]), np.ones(2)]
                            ) @ view.projection(1.5, (0.1, 100.0)).T
    assert (spots[:, :2] / spots[:, 3:]) == pytest.approx(np.array([[0.0, 0.0], [0.0, 1.0]]))
    assert frame(np.zeros((1, 3)), _SIZE, 60.0).angle == 60.0


def test_kept_meshes_draw_what_new_ones_would(tmp_path):
    """Move, remove and crack parts of a drawing, and compare with a fresh one."""
    wall = load_grammar('garden_wall.wall', 'wall').build(seed=0)
    view = View(np.array([2.0, -5.0, 1.5]), np.array([2.0, 0.0, 0.5]))
    moved = wall.poses.copy()
    moved[200:, 1] += 0.2
    moved[5] = np.nan
    cracked = np.arange(0, len(wall.bonds), 3)
    renderer = Renderer(Moment(wall, wall.poses), _SIZE)
    before = renderer.draw(Moment(wall, wall.poses), view).astype(int)
    after = renderer.draw(Moment(wall, moved, cracked=cracked), view).astype(int)
    renderer.close()
    draw(wall, moved, tmp_path / 'fresh.png', size=_SIZE, cracked=cracked,
         camera=[*view.eye, *view.target])
    fresh = np.asarray(Image.open(tmp_path / 'fresh.png'), int)
    assert np.abs(after - before).max() > 40
    assert np.abs(after - fresh).mean() < 0.5


def test_parts_that_join_later_are_drawn():
    """Show parts that a later moment has behind those of the first."""
    pole = LSystem.parse(_POLE).build()
    both = LSystem.parse(_POLE.replace('F(1) F(1)', 'F(1) F(1) [Width(0.6) F(1)]')).build()
    view = View(np.array([0.0, -8.0, 1.5]), np.array([0.0, 0.0, 1.5]))
    renderer = Renderer(Moment(pole, pole.poses), _SIZE)
    few = renderer.draw(Moment(pole, pole.poses), view).astype(int)
    more = renderer.draw(Moment(both, both.poses), view).astype(int)
    renderer.close()
    change = np.abs(more - few).max(axis=(1, 2))
    assert change[:30].max() > 40  # the third metre
    assert change[31:45].max() < 20  # below it, above its shadow


def test_pictures_show_cracks_whose_events_were_taken():
    """Draw the joints dark that have cracked, after somebody has read the log as before."""
    scene = Scene()
    scene.add(load_grammar('garden_wall.wall', 'test').build(length=0.9, height=0.6), name='wall')
    simulation = Simulation(scene)
    simulation.launch(Projectile(size=0.2, mass=20.0, position=(0.4, -1.0, 0.3),
                                 velocity=(0.0, 20.0, 0.0)))
    simulation.step(8)
    cracked = moment_of(simulation).cracked
    assert len(cracked) and len(simulation.log.take())
    assert np.array_equal(moment_of(simulation).cracked, cracked)


def test_cracked_joints_are_dark():
    """Darken the mortar of the joints that have cracked, and nothing else."""
    wall = load_grammar('garden_wall.wall', 'wall').build(seed=0)
    view = View(np.array([2.0, -2.0, 0.6]), np.array([2.0, 0.0, 0.6]))
    renderer = Renderer(Moment(wall, wall.poses), (320, 200))
    whole = renderer.draw(Moment(wall, wall.poses), view).astype(int)
    cracked = renderer.draw(Moment(wall, wall.poses, cracked=np.arange(len(wall.bonds))),
                            view).astype(int)
    renderer.close()
    change = (whole - cracked).mean(axis=2)
    assert change.min() > -3 and 0.05 < (change > 40).mean() < 0.5


def test_sun_and_clouds_change_the_light():
    """Move the shadow of a pole to its other side with the sun, and dim it with clouds."""
    pole = LSystem.parse(_POLE).build()
    view = View(np.array([0.0, -10.0, 6.0]), np.array([0.0, 0.0, 0.5]))
    pictures = []
    for sun, sky in ((90.0, 0.0), (270.0, 0.0), (90.0, 1.0)):
        moment = Moment(pole, pole.poses)
        renderer = Renderer(moment, (160, 100), SunSettings(azimuth=sun),
                            SkySettings(clouds=sky))
        pictures.append(renderer.draw(moment, view).astype(float).mean(axis=2))
        renderer.close()
    east, west, covered = (p[45:70] for p in pictures)  # the ground beside the pole
    assert (east - west)[:, 40:76].mean() < -1.0 and (east - west)[:, 84:120].mean() > 1.0
    assert covered.std() < 0.8 * east.std()


def test_a_low_sun_throws_long_shadows():
    """Shade the ground as far from a pole as its tip throws shade, not in a ball around it."""
    pole = LSystem.parse(_POLE).build()
    tip = pole.poses[-1, 2] + 0.5 * pole.size[-1, 2]
    sun = SunSettings(azimuth=270.0, elevation=12.0)  # in the west
    far = 0.9 * tip / np.tan(np.radians(sun.elevation))
    assert far > 4.0 * tip
    view = View(np.array([far, -2.0, 1.5]), np.array([far, 0.0, 0.0]))
    bare, shaded = (_grey(pole, aside, view, sun) for aside in (5.0, 0.0))
    assert (bare - shaded)[49:51].min() > 5.0
    assert np.abs(bare - shaded)[:40].mean() < 1.0


def test_the_ground_at_the_feet_of_a_far_camera_is_drawn():
    """Leave no hole in the foreground when all else is far away."""
    pole = LSystem.parse(_POLE).build()
    view = View(np.array([0.0, -60.0, 2.0]), np.array([0.0, -57.0, 0.0]))
    picture = _grey(pole, 0.0, view, SunSettings())
    assert picture.max() < 200.0  # grass; what nothing covers has the pale colour of haze


def _grey(blueprint, aside, view, sun):
    """Draw a blueprint moved along y, in shades of grey."""
    moment = Moment(blueprint, blueprint.poses + [0.0, aside, 0.0, 0.0, 0.0, 0.0, 0.0])
    renderer = Renderer(moment, (160, 100), sun)
    picture = renderer.draw(moment, view).astype(float).mean(axis=2)
    renderer.close()
    return picture


@pytest.mark.parametrize('words, said', [
    (['film.mp4'], '--to'), (['film.mp4', '--to', '0'], '--to'),
    (['film.mp4', '--from', '3', '--to', '2'], '--to'),
    (['film.mp4', '--to', '1', '--size', '95x64'], 'even'),
    (['film.mp4', '--to', '1', '--camera', 'follow=pole_0/77'], 'pole_0'),
    (['film.mp4', '--to', '1', '--camera', 'follow=poll_0/1'], 'did you mean pole_0'),
    (['film.mp4', '--to', '1e6'], '100000'), (['film.avi', '--to', '1'], '.mp4'),
    (['loop.gif', '--to', '1', '--fps', '60'], '50'),
    (['a%d%d.png', '--to', '1'], '%04d'), (['a%s.png', '--to', '1'], '%04d'),
    (['a%099999999999d.png', '--to', '1'], '%04d'), (['a%5d%%%.png', '--to', '1'], '%04d'),
    (['%04d.mp4', '--to', '1'], 'series'),
    (['one.png', '--to', '1'], '%04d'), (['no/film.mp4', '--to', '1'], 'no folder'),
])
def test_films_are_refused_in_one_line(words, said, scene, tmp_path, capsys):
    """Return 1 before anything is simulated, and leave nothing."""
    name, *options = words
    assert main([str(scene), '--out', str(tmp_path / name), '--size', '96x64', *options]) == 1
    message = capsys.readouterr().err
    assert said in message and message.count('\n') == 1
    assert not list(tmp_path.iterdir())


def test_missing_encoder_says_what_to_install(scene, tmp_path, monkeypatch, capsys):
    """Name the pip command for films; pictures need no encoder."""
    monkeypatch.setitem(sys.modules, 'av', None)
    assert main([str(scene), '--out', str(tmp_path / 'film.mp4'), '--to', '1']) == 1
    assert 'pip install av' in capsys.readouterr().err
    assert main([str(scene), '--out', str(tmp_path / 'one.png'), '--size', '96x64']) == 0


@pytest.mark.parametrize('name', ['a.png', 'a.mp4', '%d.png'])
def test_a_disk_that_fills_up_is_told_with_the_file(name, scene, tmp_path, monkeypatch, capsys):
    """Name the file that cannot be put in its place, and leave nothing of it."""
    def fail(part, path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    folder = tmp_path / 'pictures'
    folder.mkdir()
    monkeypatch.setattr(os, 'replace', fail)
    words = [] if name == 'a.png' else ['--to', '0.1', '--fps', '20']
    assert main([str(scene), '--out', str(folder / name), '--size', '64x48', *words]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == f'render: --out: "{folder / name}" cannot be written: No space left on device'
    assert not list(folder.iterdir())


def test_interrupted_film_is_whole(scene, tmp_path):
    """Keep what has been drawn when somebody ends a film of an hour."""
    path = tmp_path / 'film.mp4'
    command = [sys.executable, '-m', 'procphys_ros', 'render', str(scene), '--out', str(path),
               '--to', '3600', *_WORDS]
    running = subprocess.Popen(command, cwd=_ROOT, stdout=subprocess.PIPE, text=True,
                               stderr=subprocess.PIPE, env={**os.environ, 'PYTHONUNBUFFERED': '1'})
    part = tmp_path / '.film.part.mp4'
    while running.poll() is None and not (part.exists() and part.stat().st_size > 0):
        with pytest.raises(subprocess.TimeoutExpired):
            running.wait(0.2)
    running.send_signal(signal.SIGTERM)
    said, complaint = running.communicate(timeout=600)
    assert running.returncode == 130, complaint
    assert 'interrupted' in said and complaint == ''
    assert len(_frames(path)) == int(said.split(': ')[1].split()[0]) > 0
    assert [p.name for p in tmp_path.iterdir()] == ['film.mp4']


@pytest.mark.parametrize('group, words', [
    ({'camera': {'postion': [1, 2, 3]}}, ['camera.postion', 'did you mean position']),
    ({'camera': {'motion': 'fly'}}, ['camera.motion', 'orbit']),
    ({'camera': {'motion': 'follow'}}, ['camera.part']),
    ({'camera': {'position': [1, 2, 3], 'target': [1, 2, 3]}}, ['camera.target']),
    ({'sun': {'elevation': -5.0}}, ['sun.elevation', '3 to 90']),
    ({'sun': {'hight': 5.0}}, ['sun.hight', 'known']),
    ({'sky': {'clouds': 2}}, ['sky.clouds', '0 to 1']),
])
def test_scenery_of_scene_files_is_checked(group, words):
    """Name the key, and what is allowed."""
    with pytest.raises(SceneError) as error:
        read_settings(group)
    for word in words:
        assert word in str(error.value)


def test_camera_of_the_scene_file_is_used(scene, tmp_path):
    """Draw from where the scene file says, unless the command says otherwise."""
    pictures = []
    for name, words in (('own', []), ('same', ['--camera', '0,-8,2,0,0,1']),
                        ('other', ['--view', '0', '-20', '2'])):
        path = tmp_path / f'{name}.png'
        assert main([str(scene), '--out', str(path), '--size', '96x64', *words]) == 0
        pictures.append(np.asarray(Image.open(path), int))
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])


def test_camera_sees_the_one_part_that_lies_far_from_all_others():
    """Keep a single far point in the picture, and accept points that lie all at one place."""
    points = np.random.default_rng(2).normal(size=(50_000, 3))
    points[12_345] = (60.0, 5.0, 0.0)
    view = frame(points, (160, 90))
    spots = np.column_stack([points, np.ones(len(points))]
                            ) @ view.projection(160 / 90, (0.1, 1000.0)).T
    assert (np.abs(spots[:, :2]) <= spots[:, 3:]).all()
    assert np.isfinite(frame(np.ones((200, 3)), _SIZE).eye).all()
