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
"""What pictures must show beside the right shapes, and wood where trees have come apart."""

from dataclasses import replace
from types import SimpleNamespace

from grown_trees import beam
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from procphys_ros import messages
from procphys_ros.appearance import joints, mesh, texture
from procphys_ros.appearance.closers import closers
from procphys_ros.appearance.palette import look
from procphys_ros.appearance.torn_wood import (
    BrokenWood,
    placed,
    root_plate,
    SOIL,
    splinters,
    TORN,
    TornEnds,
    WoodJoints,
)
from procphys_ros.blueprint import Blueprint, chain, GROUND
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.dust import Puffs
from procphys_ros.physics.foliage import FallingLeaves
from procphys_ros.recording.marker_state import find_markers
from procphys_ros.render.camera import View
from procphys_ros.render.drawing import Moment
from procphys_ros.render.picture import Renderer
from procphys_ros.scene.scenery import SunSettings
from procphys_ros.scene.sources import load_grammar
from procphys_ros.view.source import Frame, PageContent
from procphys_ros.view.torn_meshes import TornMeshes
from procphys_ros.wallgrammar import WallGrammar

_SIZE = (160, 100)


def _picture(moment: Moment, view: View, size: tuple[int, int] = _SIZE,
             sun: SunSettings | None = None) -> np.ndarray:
    renderer = Renderer(moment, size, sun)
    try:
        return renderer.draw(moment, view).astype(int)
    finally:
        renderer.close()


def test_many_thin_puffs_look_like_a_thick_one(count=3000):
    """Add up puffs fainter than a step of eight bits, without a change of hue or an edge."""
    view = View(np.array([0.0, -8.0, 2.0]), np.array([0.0, 0.0, 2.0]))
    depth, ones = 1.5, np.ones(count)

    def dusty(number: int) -> np.ndarray:
        opacity = np.full(number, -np.expm1(-depth / number))
        puffs = Puffs(np.tile([0.0, 0.0, 2.0], (number, 1)), 4.0 * ones[:number], opacity,
                      ones[:number])
        return _picture(Moment(Blueprint(), np.zeros((0, 7)), dust=puffs), view)

    assert np.abs(dusty(count) - dusty(1)).max() <= 2


def test_crowns_are_not_black_from_below(name='oak'):
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


@pytest.mark.parametrize('turns', [
    (120,) * 3, (20,) * 18, (40, 140) * 2, (60, 60, -60, 60, 60) * 2])
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


@pytest.mark.parametrize('angle', [3.0, 30.0])
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


_WIDTH = 0.1  # [m] of the beam


def _ends(tree: Blueprint, poses: np.ndarray) -> list:
    """List look, part and corners in the world of all torn ends."""
    wood = WoodJoints(tree)
    return [(look, part, corners if part == GROUND else placed(poses[part], corners))
            for bond in wood.apart(poses) for look, part, corners in wood.ends(int(bond))
            if part == GROUND or np.isfinite(poses[part]).all()]


def _moved(tree: Blueprint, parts: slice) -> np.ndarray:
    poses = tree.poses.copy()
    poses[parts, 0] += 3.0
    return poses


def test_whole_trees_cost_nothing():
    """Draw no ends on a tree that stands, nor on one that leans as one piece."""
    tree = beam(5)
    turn = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(0.3))
    leaning = rotation.compose(np.concatenate([np.zeros(3), turn]), tree.poses)
    assert not _ends(tree, tree.poses) and not _ends(tree, leaning)


def test_both_sides_of_a_break_are_jagged():
    """Cover stump and broken piece with splinters at the joint, away from their own wood."""
    tree = beam(5)
    (look, piece, below), (also, stump, above) = _ends(tree, _moved(tree, slice(2, 5)))
    assert (look, also, piece, stump) == (TORN, TORN, 2, 1)
    joint = tree.bond_frame[2, :3]
    below, above = below.reshape(-1, 3), above.reshape(-1, 3)
    assert np.hypot(above[:, 0], above[:, 1]).max() <= 0.54 * _WIDTH
    assert np.hypot(below[:, 0] - 3.0, below[:, 1]).max() <= 0.54 * _WIDTH
    assert joint[2] + 0.6 * _WIDTH < above[:, 2].max() < joint[2] + 1.6 * _WIDTH
    assert joint[2] - 1.6 * _WIDTH < below[:, 2].min() < joint[2] - 0.6 * _WIDTH
    assert np.unique(np.round(above[:, 2], 6)).size > 10  # no two splinters alike


def test_parts_that_are_gone_leave_a_stump():
    """Draw one end where the other side is no more."""
    tree = beam(5)
    poses = tree.poses.copy()
    poses[3:] = np.nan
    assert [(look, part) for look, part, _ in _ends(tree, poses)] == [(TORN, 2)]


@pytest.mark.parametrize('moment, looks', [(1.0, [SOIL, TORN, SOIL]), (1e9, [TORN])])
def test_roots_come_along_where_they_are_the_weakest(moment, looks):
    """Lift plate and roots out of a pit, or break off at the ground, by what bears less."""
    tree = beam(5)
    hinges = replace(tree.hinges, root_moment=np.full(5, moment), strength=np.full(5, 60e6))
    ends = _ends(replace(tree, hinges=hinges), _moved(tree, slice(0, 5)))
    assert [look for look, _, _ in ends] == looks
    if moment == 1.0:
        plate, pit = (ends[i][2].reshape(-1, 3) for i in (0, 2))
        assert plate[:, 2].min() < -0.5 * 4.0 * _WIDTH + 1e-9
        assert abs(plate[:, 0].mean() - 3.0) < 0.2 and abs(pit[:, 0].mean()) < 0.2
        assert np.allclose(pit[:, 2], 0.01)


def _uprooted(angle: float) -> tuple[WoodJoints, np.ndarray]:
    """Tilt a tree about its foot by an angle [rad], and lift it a little, as soon as it breaks."""
    tree = beam(5)
    hinges = replace(tree.hinges, root_moment=np.ones(5), strength=np.full(5, 60e6))
    turn = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(angle))
    poses = rotation.compose(np.concatenate([[0.0, 0.0, 0.051], turn]), tree.poses)
    return WoodJoints(replace(tree, hinges=hinges)), poses


def test_roots_leave_the_ground_by_and_by():
    """Let plate and pit grow from nothing to all while the tree turns over, without a jump."""
    sizes = []
    for angle in np.linspace(0.0, 1.5, 76):
        wood, poses = _uprooted(angle)
        (bond,) = wood.apart(poses)
        ends = list(wood.ends(bond, *wood.opened(np.array([bond]), poses)))
        sizes.append([np.ptp(corners.reshape(-1, 3), axis=0).max() for _, _, corners in ends])
    wide = np.array(sizes) / sizes[-1]
    assert (wide[0] < 0.02).all()
    assert (np.diff(wide, axis=0) > -1e-9).all() and np.diff(wide, axis=0).max() < 0.03


def test_markers_of_roots_grow():
    """Look at every step while roots leave the ground, and now and then when they are out."""
    torn, radius = TornEnds(), []
    for angle in np.linspace(0.0, 1.5, 40):
        wood, poses = _uprooted(angle)
        (ends,) = torn.update(wood, poses).values()
        radius.append(np.ptp(ends[2][2].reshape(-1, 3)[:, 0]))
    assert radius[0] < 0.1 * radius[-1]
    assert np.diff(radius).max() < 0.1 * radius[-1]


def test_an_end_keeps_its_shape():
    """Make the same splinters and plate for the same break, others for another."""
    assert np.array_equal(splinters(0.2, 7), splinters(0.2, 7))
    assert not np.array_equal(splinters(0.2, 7), splinters(0.2, 8))
    assert np.array_equal(root_plate(0.2, 7)[0], root_plate(0.2, 7)[0])


class _Owner:
    name, first, count = 'tree', 0, 5


def _markers(data: bytes | None) -> dict[str, int]:
    """Return the action of every marker of an end, by its namespace."""
    rows = find_markers(data) if data else np.zeros((0, 6), int)
    found = {data[row[2]:row[3]].decode(): int(row[5]) for row in rows}
    return {name: found[f'/{name}'] for name in (TORN, SOIL) if f'/{name}' in found}


def test_rviz_gets_the_ends_of_what_breaks():
    """Add a marker when a stem breaks, write it anew while the piece moves, and delete it."""
    tree = beam(5)
    scene = messages.SceneMarkers(tree, [_Owner()], 'world')
    assert not _markers(scene.whole(tree.poses, (1, 0)))
    told = [_markers(scene.changes(_moved(tree, slice(2, 5)), (1, 0))) for _ in range(12)]
    assert [bool(found) for found in told].count(True) == 1 and {TORN: 0} in told
    fallen = _moved(tree, slice(2, 5))
    fallen[2:, 2] -= 1.0
    assert _markers(scene.changes(fallen, (1, 0))) == {TORN: 0}
    told = [_markers(scene.changes(tree.poses, (1, 0))) for _ in range(12)]
    assert [found for found in told if found][-1] == {TORN: 2}


class _Page:
    """Takes meshes as a page does."""

    def __init__(self):
        self.meshes = {}

    def add_mesh_simple(self, name, vertices, faces, **style):
        handle = SimpleNamespace(name=name, vertices=vertices, visible=True, position=None,
                                 wxyz=None, remove=lambda: self.meshes.pop(name))
        self.meshes[name] = handle
        return handle


def test_the_page_gets_the_ends_of_what_breaks():
    """Draw two ends where a stem broke, move them along with the pieces, and take them off."""
    tree, page = beam(5), _Page()
    content = PageContent.of(tree, str, 0)
    ends = TornMeshes(page, 0.5)
    ends.update(Frame(content, tree.poses, np.zeros((0, 7))))
    assert not page.meshes
    for i in range(12):
        poses = _moved(tree, slice(2, 5))
        poses[2:, 2] += 0.1 * i
        ends.update(Frame(content, poses, np.zeros((0, 7))))
    below, above = page.meshes.values()
    np.testing.assert_allclose(below.position, 0.5 * poses[2, :3])
    np.testing.assert_allclose(above.position, 0.5 * poses[1, :3])
    for _ in range(12):
        ends.update(Frame(content, tree.poses, np.zeros((0, 7))))
    assert not page.meshes


def _told(tree: Blueprint, bond: int, uprooted: bool = False) -> BrokenWood:
    """Make the broken wood that a viewer of a running node knows of a broken bond."""
    return BrokenWood(tree.shape, tree.visual_size, tree.bonds[[bond]], np.array([uprooted]))


def test_viewers_of_a_node_see_the_same_ends():
    """Draw from the parts alone what is drawn from the joints themselves."""
    tree = beam(5)
    exact = {part: corners for _, part, corners in WoodJoints(tree).ends(2)}
    told = {part: corners for _, part, corners in _told(tree, 2).ends(2)}
    assert exact.keys() == told.keys() == {1, 2}
    for part, corners in exact.items():
        np.testing.assert_allclose(told[part], corners, atol=1e-9)


def test_viewers_of_a_node_see_roots_of_what_was_uprooted_only():
    """Lift roots with a tree that was uprooted; tear one off that broke at its foot."""
    tree = beam(5)
    assert [look for look, _, _ in _told(tree, 0, True).ends(0)] == [SOIL, TORN]
    assert [look for look, _, _ in _told(tree, 0).ends(0)] == [TORN]
    late = BrokenWood(tree.shape[:2], tree.visual_size[:2], tree.bonds[[2]],
                      np.array([False]))
    assert not len(late.apart(tree.poses))  # parts that the viewer does not know yet


def test_a_side_branch_leaves_no_stump_that_points_along_its_parent():
    """Cover the end of a thin branch alone, for where it pointed to is not told."""
    size = np.array([[0.2, 0.18, 1.0], [0.05, 0.04, 0.8]])
    wood = BrokenWood(np.zeros(2, np.uint8), size, np.array([[0, 1]]),
                      np.array([False]))
    assert [part for _, part, _ in wood.ends(1)] == [1]
