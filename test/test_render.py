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

"""Tests of drawing: meshes, light, palette, framing, pictures and the command `render`."""

import os
from pathlib import Path
import re
import subprocess
import sys

import numpy as np
from PIL import Image
import pytest

from procphys_ros.appearance import joints, mesh, texture
from procphys_ros.appearance.palette import look, LOOKS, rgba
from procphys_ros.appearance.unit_meshes import Kind, unit_mesh
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.render import backend, camera, draw, drawing, light, RenderUnavailableError
from procphys_ros.render.backend import open_context
from procphys_ros.render.command import main
from procphys_ros.scene.sources import load_grammar

_ROOT = Path(__file__).resolve().parents[1]
_BUSH = """
name: bush
textures: bark_oak, leaf_oak
axiom: Width(0.1) F(1) [ &(40) F(0.8) Leaf(0.6, 1) ] [ ^(40) F(0.8) Leaf(0.6, 1) ]
"""
_SIZE = (320, 200)


@pytest.fixture(scope='module')
def bush():
    """Three segments and two leaves."""
    return LSystem.parse(_BUSH).build(seed=0)


@pytest.fixture(scope='module')
def wall():
    """Build a low wall of bricks in running bond."""
    return load_grammar('garden_wall.wall', 'wall').build(seed=0)


def _pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path).convert('RGB')).astype(int)


def _leafy(path: Path) -> np.ndarray:
    """Mark the pixels of a picture that have the green of leaves."""
    red, green, blue = np.moveaxis(_pixels(path), -1, 0)
    return (green > red + 30) & (green > 2.2 * blue)  # grass is paler


def _poses(count: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    attitude = rng.normal(size=(count, 4))
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    return np.column_stack([rng.uniform(-5.0, 5.0, (count, 3)), attitude])


def _turns_outward(shape: mesh.Mesh) -> np.ndarray:
    """Return for each face with an area whether its winding agrees with its normals."""
    a, b, c = (shape.points[shape.triangles[:, i]] for i in range(3))
    facing = np.cross(b - a, c - a)
    normal = shape.normals[shape.triangles].mean(axis=1)
    return np.einsum('fi,fi->f', facing, normal)[np.linalg.norm(facing, axis=1) > 1e-9] > 0.0


def test_branches_taper_from_base_to_tip():
    """Put every vertex on the cone between the end diameters, or on the round ends."""
    poses, size = _poses(4), np.array([[0.4, 0.2, 2.0]] * 4)
    shape = mesh.branches(poses, size)
    own = poses[shape.piece]
    local = rotation.rotate(rotation.conjugate(own[:, 3:]), shape.points - own[:, :3])
    radius = np.hypot(local[:, 0], local[:, 1])
    assert local[:, 2].min() == pytest.approx(-1.2) and local[:, 2].max() == pytest.approx(1.1)
    assert radius[np.isclose(local[:, 2], -1.0)] == pytest.approx(0.2)
    assert radius[np.isclose(local[:, 2], 1.0)] == pytest.approx(0.1)
    assert _turns_outward(shape).all()


def test_boxes_have_their_size_and_face_outward():
    """Reach exactly half the extents along every axis, with outward faces."""
    poses = np.array([[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]])
    shape = mesh.boxes(poses, np.array([[0.2, 0.1, 0.06]]))
    assert np.ptp(shape.points, axis=0) == pytest.approx([0.2, 0.1, 0.06])
    assert shape.points.mean(axis=0) == pytest.approx([1.0, 2.0, 3.0])
    assert len(shape.triangles) == 12 and _turns_outward(shape).all()


def test_crossed_quads_grow_from_the_petiole():
    """Start a leaf at its pose, reach its size along z and cross two planes at right angles."""
    pose = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    shape = mesh.crossed_quads(pose, np.array([0.5]), aspect=0.4)
    assert np.ptp(shape.points, axis=0) == pytest.approx([0.2, 0.2, 0.5])
    assert shape.points[:, 2].min() == 0.0
    assert (np.abs(shape.points[:, :2]).min(axis=1) == 0.0).all()


def test_nothing_makes_an_empty_mesh():
    """Accept zero pieces of every kind."""
    none = np.zeros((0, 7))
    for shape in (mesh.branches(none, np.zeros((0, 3))), mesh.boxes(none, np.zeros((0, 3))),
                  mesh.crossed_quads(none, np.zeros(0), 1.0),
                  mesh.loose_triangles(none, np.zeros((0, 9)))):
        assert len(shape.points) == len(shape.triangles) == 0


def test_shade_follows_beer_lambert():
    """Weaken light by exp(-k LAI) under an even layer of leaves, and not at all above it."""
    rng = np.random.default_rng(2)
    leaves = np.column_stack([rng.uniform(0.0, 20.0, (40000, 2)), np.full(40000, 5.0)])
    spots = rng.uniform(4.0, 16.0, (500, 2))
    below, above = (np.column_stack([spots, np.full(500, height)]) for height in (1.0, 9.0))

    def optical_depth(area_index: float) -> float:
        shade = light.Shade(leaves, np.full(40000, area_index * 400.0 / 40000), light.ZENITH)
        assert shade.light(above) == pytest.approx(1.0)
        return float(-np.log(shade.light(below)).mean())

    thin = optical_depth(1.0)
    assert 0.15 < thin < 0.5
    assert optical_depth(3.0) == pytest.approx(3.0 * thin, rel=1e-6)
    assert thin == pytest.approx(light.EXTINCTION, rel=0.05)


def test_camera_sees_every_point():
    """Project all points of an uneven scene into the frame, close to its edges."""
    points = np.random.default_rng(1).uniform([-30, 0, 0], [10, 60, 12], (500, 3))
    view = camera.frame(points, (1280, 720))
    place, target = view.eye, view.target
    back = (place - target) / np.linalg.norm(place - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    depth = (place - points) @ back
    slope = np.tan(np.radians(camera.FIELD_OF_VIEW) / 2.0)
    across = np.abs((points - place) @ right) / depth / slope * 720 / 1280
    upward = np.abs((points - place) @ np.cross(back, right)) / depth / slope
    assert (depth > 0.0).all()
    assert 0.8 < max(across.max(), upward.max()) <= 1.0


@pytest.mark.parametrize('pattern', sorted({entry.pattern for entry in LOOKS.values()}))
def test_every_pattern_has_an_image(pattern):
    """Draw an image with structure for each pattern but the plain one; leaves have holes."""
    image = texture.image(pattern)
    if pattern == 'plain':
        assert image is None and texture.mean_light(pattern) == 1.0
        return
    opaque = image[..., 3] > 0
    assert np.ptp(image[..., 0][opaque]) > 30
    surfaces = ('furrows', 'plates', 'rings', 'lenticels', 'grain')
    assert opaque.all() if pattern in surfaces else 0.15 < opaque.mean() < 0.9


def test_palette_covers_every_texture_of_the_grammars():
    """Find in the palette what a shipped grammar names, and what the languages know themselves."""
    text = '\n'.join(path.read_text('utf-8') for path in (_ROOT / 'grammars').iterdir())
    named = {name for names in re.findall(r'\btextures?: *(\w+(?:, *\w+)*)', text)
             for name in re.split(', *', names)}
    plain = [load_grammar('garden_wall.wall', 'wall'), LSystem.parse('axiom: F(1) Leaf(1)')]
    assert len(named) > 20 and named.union(*(one.build().textures for one in plain)) <= set(LOOKS)


def test_unknown_textures_look_like_their_family():
    """Take the longest table name inside an unknown one, else a neutral grey."""
    assert rgba('leaf_maple') == rgba('leaf')
    assert look('old_brick_red_3') == look('brick_red')
    red, green, blue, alpha = rgba('xyz')
    assert max(red, green, blue) - min(red, green, blue) < 0.1 and alpha == 1.0


def test_picture_has_its_size_and_shows_the_bush(bush, tmp_path):
    """Write a picture of the right size with leaf green, bark and sky in it."""
    path = tmp_path / 'bush.png'
    draw(bush, bush.poses, path, size=_SIZE)
    pixels = _pixels(path)
    assert pixels.shape == (_SIZE[1], _SIZE[0], 3)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 1000
    red, green, blue = np.moveaxis(pixels, -1, 0)
    assert _leafy(path).sum() > 200
    assert ((red > green + 5) & (green > blue + 5) & (red < 140)).sum() > 50  # bark
    assert (blue > red + 40).sum() > 5000  # sky


@pytest.mark.parametrize('pattern', sorted(texture.CLUSTERS))
def test_a_spray_has_the_leaves_of_its_image(pattern):
    """Spread as many leaves, as long, around the twig of a cluster, all within its reach."""
    count, length = texture.CLUSTERS[pattern][0], texture.CLUSTERS[pattern][3]
    vertices, *_, faces = unit_mesh(Kind.SPRAY, pattern)
    leaves = vertices[:, :3].reshape(count, -1, 3)
    assert faces.max() == len(vertices) - 1
    reach = np.linalg.norm(leaves[:, -1] - leaves[:, 0], axis=1)
    assert reach.mean() == pytest.approx(length, rel=0.1)
    assert np.hypot(*vertices[:, :2].T).max() < 1.1 and np.abs(vertices[:, 2] - 0.5).max() < 0.9


def test_leaves_are_single_where_they_are_near(bush, tmp_path, monkeypatch):
    """Draw other leaves near than far, which cover about as much of the picture."""
    covered, same = [], []
    for camera_at in ((1.2, 1.2, 1.6, 0.0, 0.0, 1.5), (30.0, 30.0, 1.6, 0.0, 0.0, 1.5)):
        pictures = []
        for least in (drawing.SINGLE, np.inf):
            monkeypatch.setattr(drawing, 'SINGLE', least)
            path = tmp_path / 'leaves.png'
            draw(bush, bush.poses, path, size=_SIZE, camera=camera_at)
            pictures.append(_pixels(path))
            covered.append(int(_leafy(path).sum()))
            monkeypatch.undo()
        same.append(np.array_equal(*pictures))
    assert same == [False, True]
    assert 0.5 < covered[0] / covered[1] < 2.0


def test_parts_that_do_not_exist_are_not_drawn(bush, tmp_path):
    """Take segments with their leaves out of the picture."""
    place = (0.0, -6.0, 1.5, 0.0, 0.0, 1.0)
    only_stem = np.array([True, False, False])
    draw(bush, bush.poses, tmp_path / 'all.png', size=_SIZE, camera=place)
    draw(bush, bush.poses, tmp_path / 'stem.png', size=_SIZE, camera=place, exists=only_stem)
    assert _leafy(tmp_path / 'stem.png').sum() == 0
    assert _leafy(tmp_path / 'all.png').sum() > 200


def test_poses_move_what_is_drawn(bush, tmp_path):
    """Draw the poses given, not those at rest."""
    place = (0.0, -6.0, 1.5, 0.0, 0.0, 1.0)
    moved = bush.poses.copy()
    moved[:, 0] += 1.0
    draw(bush, bush.poses, tmp_path / 'rest.png', size=_SIZE, camera=place)
    draw(bush, moved, tmp_path / 'moved.png', size=_SIZE, camera=place)
    rest, right = (np.nonzero(_leafy(tmp_path / name))[1].mean()
                   for name in ('rest.png', 'moved.png'))
    # 1 m at 6 m, on 200 pixels per 32 degrees
    assert right - rest == pytest.approx(200 / (2 * 6.0 * np.tan(np.radians(16.0))), rel=0.15)


def _inside(points: np.ndarray, poses: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Mark the points that lie in any of the boxes, (P,) bool."""
    inside = np.zeros(len(points), bool)
    for pose, extents in zip(poses, size):
        local = rotation.rotate(rotation.conjugate(pose[3:]), points - pose[:3])
        inside |= (np.abs(local) <= 0.5 * extents + 1e-9).all(axis=1)
    return inside


def test_mortar_leaves_no_hole_in_a_wall(wall):
    """Find every point of the wall's middle plane in a brick or in the mortar between them."""
    everything = np.ones(len(wall), bool)
    corners = np.concatenate([wall.poses[:, :3] - 0.5 * wall.size,
                              wall.poses[:, :3] + 0.5 * wall.size])
    low, high = corners.min(axis=0), corners.max(axis=0)
    spots = np.random.default_rng(5).uniform(low, high, (4000, 3))
    spots[:, 1] = 0.5 * (low[1] + high[1])
    in_bricks = _inside(spots, wall.poses, wall.size)
    poses, size = joints.standing(wall, wall.poses, everything)
    assert 0.1 < np.mean(~in_bricks) < 0.3
    assert _inside(spots[~in_bricks], poses, size).all()
    lowest, highest = ((poses[:, :3] + side * 0.5 * np.abs(rotation.rotate(poses[:, 3:], size)))
                       for side in (-1.0, 1.0))
    assert (lowest > low - 1e-9).all() and (highest < high + 1e-9).all()


def test_broken_joints_lose_their_mortar(wall):
    """Drop the mortar around a brick that was pushed out, and of one that is gone, only theirs."""
    everything = np.ones(len(wall), bool)
    brick = int(np.argmin(np.linalg.norm(wall.poses[:, :3] - wall.poses[:, :3].mean(0), axis=1)))
    its_own = (wall.bonds == brick).any(axis=1).sum()
    whole = len(joints.standing(wall, wall.poses, everything)[0])
    pushed = wall.poses.copy()
    pushed[brick, 1] += 0.02
    gone = np.arange(len(wall)) != brick
    assert its_own == 6
    assert len(joints.standing(wall, pushed, everything)[0]) == whole - its_own
    assert len(joints.standing(wall, wall.poses, gone)[0]) == whole - its_own


def test_mortar_moves_with_the_wall(wall):
    """Keep all the mortar, in its place, when the wall is carried off as a whole."""
    everything = np.ones(len(wall), bool)
    turned = wall.placed((3.0, -2.0, 1.0), 0.7)
    carried, size = joints.standing(wall, turned.poses, everything)
    placed, same = joints.standing(turned, turned.poses, everything)
    assert len(carried) > len(wall)
    assert carried[:, :3] == pytest.approx(placed[:, :3])
    assert size == pytest.approx(same)


def test_command_draws_without_a_display(tmp_path):
    """Run the command in a process without DISPLAY and find the picture."""
    environment = {key: value for key, value in os.environ.items()
                   if key not in ('DISPLAY', 'WAYLAND_DISPLAY')}
    path = tmp_path / 'shrub.png'
    done = subprocess.run(
        [sys.executable, '-m', 'procphys_ros', 'render', 'shrub.lsys', '--out', str(path),
         '--size', '200x120', '--seed', '3'],
        cwd=_ROOT, env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    assert 'parts at 0 s' in done.stdout and done.stderr == ''
    assert _pixels(path).shape == (120, 200, 3)


def test_joints_between_voussoirs_let_no_sun_through(tmp_path):
    """Keep the shadow of a bridge beside the rim of its arch as dark as elsewhere."""
    path = tmp_path / 'bridge.png'
    assert not main([str(_ROOT / 'grammars' / 'bridge.wall'), '--out', str(path), '--size',
                     '900x500', '--view', '12', '6', '4'])
    shadow = np.concatenate([_pixels(path)[rows, columns].mean(axis=2).ravel() for rows, columns in
                             ((slice(355, 400), slice(642, 700)),
                              (slice(400, 440), slice(600, 650)))])
    assert shadow.max() < 1.4 * np.median(shadow)  # a slit of sun is 1.7 times as bright


def test_command_simulates_before_it_draws(tmp_path, capsys):
    """Show a shrub of a scene file bent by a gale after half a second."""
    scene = tmp_path / 'gale.yaml'
    scene.write_text("""
/**:
  ros__parameters:
    scene: {objects: [shrub]}
    wind: {velocity: [20.0, 0.0, 0.0]}
    shrub: {grammar: shrub.lsys}
""", encoding='utf-8')
    still, bent = tmp_path / 'still.png', tmp_path / 'bent.png'
    view = ['--size', '320x200', '--camera=0,-6,1,0,0,1']
    assert main([str(scene), '--out', str(still), *view]) == 0
    assert main([str(scene), '--out', str(bent), '--time', '0.5', *view]) == 0
    assert 'at 0.5 s' in capsys.readouterr().out
    upper = slice(0, 100)  # where the shrub moves most, without its shadow
    columns = [np.nonzero(_leafy(path)[upper])[1].mean() for path in (still, bent)]
    assert columns[1] > columns[0] + 0.5


@pytest.mark.parametrize('words, said', [
    (['nosuch.lsys'], 'no grammar "nosuch.lsys"'),
    (['nosuch.yaml'], 'nosuch.yaml'),
    (['oak.txt'], 'neither a scene'),
    (['oak.lsys', '--define', 'hight=9'], 'did you mean height?'),
    (['config/demo.yaml', '--define', 'height=9'], '--define: is for a grammar'),
    (['config/demo.yaml', '--seed', '2'], '--seed: is for a grammar'),
    (['shrub.lsys', '--from', '1'], '--from: '), (['shrub.lsys', '--to', '1'], 'one picture'),
])
def test_command_refuses_bad_input_in_one_line(words, said, tmp_path, capsys):
    """Return 1 and say what is wrong, without a traceback or a picture."""
    path = tmp_path / 'out.png'
    assert main([*words, '--out', str(path)]) == 1
    message = capsys.readouterr().err
    assert said in message and message.count('\n') == 1
    assert not path.exists()


@pytest.mark.parametrize('words, said', [
    (['--size', '12'], '1280x720'), (['--size', '0x5'], 'pixels'), (['--time', '-1'], 'start'),
    (['--camera', '1,2,3'], '20,-30,10'), (['--camera', 'orbits'], 'follow=PART'),
    (['--camera', '1,1,1,1,1,1'], 'looks'),
    (['--define', 'height'], '"height" is not like height=15'),
    (['--define', 'seed=3'], 'a grammar has no value "seed"; say --seed'),
    (['--size', 'nanxnan'], '1280x720'),
    (['--fps', '0'], 'per second'), (['--seed', '-1'], 'whole number'),
    (['--to', 'x'], '3.0'), (['--view', '1', '2', 'z'], '20'),
])
def test_command_refuses_bad_options_in_one_line(words, said, tmp_path, capsys):
    """Exit with 2 and an example of what the option takes."""
    with pytest.raises(SystemExit) as stop:
        main(['oak.lsys', '--out', str(tmp_path / 'out.png'), *words])
    message = capsys.readouterr().err
    assert stop.value.code == 2 and said in message and message.count('\n') == 1


@pytest.mark.parametrize('name, said', [('out.gifx', '.png'), ('no/out.png', 'no folder')])
def test_command_checks_the_picture_first(name, said, tmp_path, capsys):
    """Refuse a picture that cannot be written before doing any work."""
    assert main(['oak.lsys', '--out', str(tmp_path / name)]) == 1
    assert said in capsys.readouterr().err


def test_command_interrupted_while_it_loads_says_so(monkeypatch, tmp_path, capsys):
    """End with the code of SIGINT and one line when Ctrl-C comes before the first picture."""
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(LSystem, 'build', interrupted)
    assert main(['shrub.lsys', '--out', str(tmp_path / 'out.png')]) == 130
    assert capsys.readouterr().err == 'render: interrupted\n'


@pytest.mark.parametrize(('given', 'said'), [
    ({'poses': np.zeros((2, 7))}, r'poses: the shape is \(2, 7\), this blueprint takes \(3, 7\)'),
    ({'leaf_poses': np.zeros((3, 7))}, 'leaf_poses: the shape is'),
    ({'exists': [True]}, 'exists: the shape is'),
    ({'camera': (1.0, 2.0, 3.0)}, 'camera is .* it must be six numbers'),
    ({'camera': (1.0, 2.0, np.nan, 0.0, 0.0, 0.0)}, 'camera is .* it must be six numbers'),
    ({'camera': (1, 2, 3, 1, 2, 3)}, 'it stands where it looks'),
    ({'size': (0, 200)}, 'size is'), ({'size': (320,)}, 'size is'),
    ({'size': (3.5, 2)}, 'size is'),
    ({'path': 'picture'}, 'the suffix "" names no format'),
    ({'path': 'no/picture.png'}, 'there is no folder'),
])
def test_what_cannot_be_drawn_is_refused_in_one_line(bush, tmp_path, monkeypatch, given, said):
    """Say which argument of `draw` is wrong, before anything is drawn."""
    monkeypatch.chdir(tmp_path)
    arguments = {'poses': bush.poses, 'path': 'picture.png', 'size': _SIZE, **given}
    with pytest.raises(SceneError, match=said):
        draw(bush, **arguments)
    assert not list(tmp_path.iterdir())


def test_missing_moderngl_says_how_to_install_it(bush, monkeypatch, tmp_path, capsys):
    """Name the pip command, from the library and from the command."""
    monkeypatch.setitem(sys.modules, 'moderngl', None)
    with pytest.raises(RenderUnavailableError, match=r'pip install moderngl'):
        draw(bush, bush.poses, tmp_path / 'out.png')
    assert main(['shrub.lsys', '--out', str(tmp_path / 'out.png')]) == 1
    assert 'pip install moderngl' in capsys.readouterr().err


def test_missing_opengl_names_the_system_packages(monkeypatch):
    """Say what to install when no context can be opened."""
    monkeypatch.setattr(backend, '_LIBRARIES', {**backend._LIBRARIES, 'libegl': 'libNone.so.1'})
    with pytest.raises(RenderUnavailableError, match='apt-get install libegl1'):
        open_context()
