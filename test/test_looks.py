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

"""Tests of looks: what a picture must show beside the right shapes."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from procphys_ros.appearance import joints, mesh, texture
from procphys_ros.appearance.closers import closers
from procphys_ros.appearance.palette import look
from procphys_ros.blueprint import Blueprint, chain
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.foliage import FallingLeaves
from procphys_ros.render.camera import View
from procphys_ros.render.drawing import Moment
from procphys_ros.render.picture import Renderer
from procphys_ros.scene.scenery import SunSettings
from procphys_ros.scene.sources import load_grammar
from procphys_ros.wallgrammar import WallGrammar

_SIZE = (160, 100)


def _picture(moment: Moment, view: View, size: tuple[int, int] = _SIZE,
             sun: SunSettings | None = None) -> np.ndarray:
    renderer = Renderer(moment, size, sun)
    try:
        return renderer.draw(moment, view).astype(int)
    finally:
        renderer.close()


@pytest.mark.parametrize('count', [50, 3000])
def test_many_thin_puffs_look_like_a_thick_one(count):
    """Add up puffs fainter than a step of eight bits, without a change of hue or an edge."""
    view = View(np.array([0.0, -8.0, 2.0]), np.array([0.0, 0.0, 2.0]))
    depth, ones = 1.5, np.ones(count)

    def dusty(number: int) -> np.ndarray:
        opacity = np.full(number, -np.expm1(-depth / number))
        puffs = Puffs(np.tile([0.0, 0.0, 2.0], (number, 1)), 4.0 * ones[:number], opacity,
                      ones[:number])
        return _picture(Moment(Blueprint(), np.zeros((0, 7)), dust=puffs), view)

    assert np.abs(dusty(count) - dusty(1)).max() <= 2


@pytest.mark.parametrize('name', ['oak', 'pine'])
def test_crowns_are_not_black_from_below(name):
    """Show the underside of a crown by at least three tenths of the colour of its leaves."""
    tree = load_grammar(f'{name}.lsys', 'tree').build(seed=1)
    view = View(np.array([0.4, 1.0, 0.05]), np.array([0.0, 0.0, 0.7 * tree.poses[:, 2].max()]))
    red, green, blue = np.moveaxis(_picture(Moment(tree, tree.poses), view), -1, 0)
    leafy = green[(green > red) & (green > 1.3 * blue)]  # before the sky
    own = 255.0 * look(tree.textures[tree.leaves.texture[0]]).rgba[1]
    assert len(leafy) > 5000
    assert np.percentile(leafy, 10) > 0.3 * own


def test_stems_have_no_bands_at_the_borders_of_their_segments():
    """Let the shade of a crown change along a stem without a step."""
    whorl = 4 * '[ &(80) Width(0.02) F(0.05) Leaf(0.5, 1) ] /(90) '
    pole = LSystem.parse(f"""
name: pole
textures: steel, leaf_oak
axiom: Width(0.3) {f'F(0.5) {whorl} ' * 6}
""").build(seed=0)
    view = View(np.array([0.0, -6.0, 1.25]), np.array([0.0, 0.0, 1.25]), 24.0)
    renderer = Renderer(Moment(pole, pole.poses), _SIZE, SunSettings(azimuth=0.0))
    gone = np.full((len(pole.leaves), 7), np.nan)  # from sight; their shade stays
    bare = renderer.draw(Moment(pole, pole.poses, gone), view)
    renderer.close()
    tone = bare[10:90, _SIZE[0] // 2 - 4:_SIZE[0] // 2 + 5].mean(axis=(1, 2))
    assert np.ptp(tone) > 1.0
    assert np.abs(np.diff(tone)).max() < 1.0


def _plan(turns: tuple[int, ...], edge: float) -> np.ndarray:
    """Compute the corners of a footprint by the angles it turns by [degrees], (n, 2)."""
    heading = np.radians(np.cumsum([0, *turns[:-1]]))
    ways = edge * np.column_stack([np.cos(heading), np.sin(heading)])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(ways, axis=0)[:-1]])


@pytest.mark.parametrize('turns', [(120,) * 3, (72,) * 5, (20,) * 18, (40, 140) * 2,
                                   (60, 60, -60, 60, 60) * 2])
def test_corners_of_any_angle_are_closed(turns):
    """Find brick or mortar everywhere behind the outer faces, up to the corners."""
    plan = _plan(turns, 1.4)
    text = 'building tower()\n  footprint: ' + ' '.join(f'({x}, {y})' for x, y in plan) + """
  facades: wall
  storey_height: 0.6
layout english { unit: 0.215 0.1025 0.065  joint: 0.010  material: brick }
panel wall: english
material brick { density: 1900  tension: 0.2e6  cohesion: 0.25e6  friction: 0.7  compression: 10e6
                 modulus: 10e9  texture: brick_red }
"""
    tower = WallGrammar.parse(text).build()
    everything = np.ones(len(tower), bool)
    rng = np.random.default_rng(2)
    start, along = plan[:, None], (np.roll(plan, -1, axis=0) - plan)[:, None] / 1.4
    inwards = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    spots = (start + rng.uniform(0.008, 1.392, (len(plan), 400, 1)) * along + 0.004 * inwards)
    spots = np.concatenate([spots.reshape(-1, 2), rng.uniform(0.011, 0.58, (len(plan) * 400, 1))],
                           axis=1)
    places, size = joints.standing(tower, tower.poses, everything)
    boxes = [(tower.poses, tower.size), (places, size)]
    covered = np.zeros(len(spots), bool)
    near = cKDTree(spots).query_ball_point
    for poses, extents in boxes:
        reach = 0.5 * np.linalg.norm(extents, axis=1) + 1e-3
        for pose, extent, some in zip(poses, extents, near(poses[:, :3], reach)):
            local = rotation.rotate(rotation.conjugate(pose[3:]), spots[some] - pose[:3])
            covered[some] |= (np.abs(local) <= 0.5 * extent + 1e-4).all(axis=1)
    assert 0.01 < np.mean(~covered) < 0.5  # corners need more than bricks and their joints
    fill = closers(tower, joints.seats(tower))
    corners = mesh.hexahedra(fill.poses(tower.poses, everything), fill.corners)
    solid = corners.points.reshape(-1, 24, 3)
    spots, covered = spots[~covered], covered[~covered]
    for points, normals in zip(solid, corners.normals.reshape(-1, 24, 3)):
        real = np.linalg.norm(normals, axis=1) > 0.5
        far = (normals[real] * points[real]).sum(axis=1)
        covered |= (spots @ normals[real].T <= far + 1e-4).all(axis=1)
    assert covered.all()


def test_closers_crumble_with_their_joint():
    """Lose what fills a corner where a brick has gone from it, and nothing else."""
    tower = load_grammar('tower.wall', 'tower').build(seed=0)
    fill = closers(tower, joints.seats(tower))
    gone = np.arange(len(tower)) != fill.first[0]
    there = np.isfinite(fill.poses(tower.poses, gone)[:, 0])
    assert np.array_equal(there, (fill.first != fill.first[0]) & (fill.second != fill.first[0]))
    assert set(dict(fill.by_texture(tower))) == {'brick_red', joints.mortar_of(tower)}


def test_stone_has_grain_of_all_sizes():
    """Share the contrast of the image among five octaves, so that it does not look woven."""
    grain = texture.image('grain')[..., 0].astype(float)
    power = np.abs(np.fft.fft2(grain - grain.mean())) ** 2
    wave = np.fft.fftfreq(len(grain)) * len(grain)
    size = np.hypot(*np.meshgrid(wave, wave))
    octaves = [power[(size >= low) & (size < 2 * low)].sum() for low in (2, 4, 8, 16, 32)]
    assert max(octaves) < 4.0 * min(octaves)


def _slab(texture_name: str) -> Blueprint:
    """Build an upright slab, 6 by 3 m."""
    return WallGrammar.parse(f"""
building slab(width = 6)
  footprint: (0, 0) (width, 0)
  facades: side
  storey_height: 3.01
rule side -> slabs
layout slabs {{ bond: stack  unit: 6.0 0.3 3.0  joint: 0.010  material: some }}
panel slabs: slabs
material some {{ density: 2400  tension: 2.9e6  cohesion: 0.9e6  friction: 0.7
                 compression: 30e6  modulus: 33e9  texture: {texture_name} }}
""").build()


@pytest.mark.parametrize('angle', [3.0, 10.0, 30.0])
def test_surfaces_do_not_shade_themselves(angle):
    """Light a plain slab at a small angle evenly, beside another one that widens the shadows."""
    slab = _slab('steel')
    both = chain([slab, slab.placed((90.0, 40.0, 0.0))])
    middle = slab.poses[0, :3]
    view = View(middle - [0.0, 4.0, 0.0], middle, 30.0)
    picture = _picture(Moment(both, both.poses), view,
                       sun=SunSettings(azimuth=90.0 + angle, elevation=25.0))
    tone = picture[20:80, 30:130].mean(axis=2)
    assert np.abs(tone - ndimage.gaussian_filter(tone, 4.0)).max() < 1.0


def test_stone_does_not_repeat_along_a_wall():
    """Compare a slab of concrete with itself one tile further, and between tiles."""
    slab = _slab('concrete')
    middle = slab.poses[:, :3].mean(axis=0)
    angle = 20.0
    per_metre = 200 / (2.0 * 9.0 * np.tan(np.radians(angle / 2.0)))  # [px/m]
    picture = _picture(Moment(slab, slab.poses), View(middle - [0.0, 9.15, 0.0], middle, angle),
                       (320, 200))[30:170, 20:300].mean(axis=2)
    picture = picture - ndimage.gaussian_filter(picture, 8.0)
    tile = round(0.6 * per_metre)

    def likeness(shift: int) -> float:
        return float(np.corrcoef(picture[:, shift:].ravel(), picture[:, :-shift].ravel())[0, 1])

    assert likeness(1) > 0.2  # grain that can be seen
    assert max(likeness(tile + i) for i in (-1, 0, 1)) < 0.45


@pytest.mark.parametrize('texture_name', ['leaf_oak', 'needle_pine'])
def test_fallen_clusters_lie_flat(texture_name):
    """See nothing stand up from the ground where clusters of leaves lie, far away and near."""
    twig = LSystem.parse(f"""
name: twig
textures: bark_oak, {texture_name}
axiom: Width(0.01) F(0.01) Leaf(0.5, 1)
""").build(seed=0)
    petiole = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(0.5 * np.pi))
    fallen = FallingLeaves(9.81, 0)
    fallen.let_go(np.zeros(1, int), np.concatenate([[[0.0, 0.0, 0.012]], petiole[None]], axis=1),
                  np.zeros((1, 3)), np.array([0.5]))
    while fallen.flying.any():
        fallen.step(np.zeros(1, int), np.zeros((1, 3)), 1.0 / 60.0)

    def standing(away: float) -> int:
        """Count pixels that a leaf changes higher than 0.1 m [px]."""
        view = View(np.array([0.25, -away, 0.1]), np.array([0.25, 0.0, 0.1]), 1.6 / away * 40.0)
        pictures = [_picture(Moment(twig, twig.poses, leaf, lying=np.ones(1, bool)), view)
                    for leaf in (fallen.poses, np.full((1, 7), np.nan))]
        return int((np.abs(pictures[0] - pictures[1])[:_SIZE[1] // 2 - 2] > 8).any(axis=2).sum())

    assert standing(20.0) == standing(1.6) == 0
