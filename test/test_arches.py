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

"""Test arches of wall grammars: how they are divided, what they carry, and what is refused."""

from building_checks import are_convex
import numpy as np
import pytest
from scipy import ndimage

from procphys_ros.errors import GrammarError
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.wallgrammar import WallGrammar
from procphys_ros.wallgrammar.arches import Curve, voussoirs
from procphys_ros.wallgrammar.cutting import rectangles
from procphys_ros.wallgrammar.polygons import clip, moments

WALL = """
building wall
  footprint: (0, 0) (3.5, 0)
  facades: front
  storey_height: 2.4
rule front -> split(x) {{ ~1: wall | 1.5: bay | ~1: wall }}
rule bay -> split(y) {{ 0.6: {below} | {height}: arch | ~1: wall }}
layout running {{ unit: 0.215 0.1025 0.065  material: brick }}
panel wall: running
panel opening: none
panel arch: arch({arch})
"""
FREE = """
building ring
  footprint: (0, 0) ({length}, 0)
  facades: front
  storey_height: 1.5
rule front -> split(x) {{ 1: wall | ~1: gap | {span}: bay | ~1: gap }}
rule bay -> split(y) {{ 1.3: arch | ~1: gap }}
material brick {{ tension: 0  cohesion: 0  friction: 0.7  compression: 1e9 }}
layout stack {{ unit: {thickness} 0.2 {pitch}  joint: 0  material: brick }}
panel wall: stack
panel gap: none
panel arch: arch(round, 1)
"""


def built(arch='round, 1', height=1.1, below='opening'):
    """Build a wall with an arch in it."""
    return WallGrammar.parse(WALL.format(arch=arch, height=height, below=below)).build()


def extents(blueprint):
    """Return the ends of the boxes of all parts [m], two of (N, 3)."""
    turned = rotation.rotate(blueprint.poses[:, None, 3:], box_corners(
        -0.5 * blueprint.size, 0.5 * blueprint.size))
    return (blueprint.poses[:, :3] + turned.min(axis=1),
            blueprint.poses[:, :3] + turned.max(axis=1))


def outlines(blueprint):
    """Return the outlines of all parts in the plane of the wall, counter-clockwise, (N, 4, 2)."""
    low, high = extents(blueprint)
    flat = rectangles(low[:, [0, 2]], high[:, [0, 2]])
    solids = blueprint.hexahedra
    for part, points in zip(solids.part, solids.points(blueprint.poses)[..., [0, 2]]):
        middle = points.mean(axis=0)
        near = points[np.argsort(np.arctan2(*(points - middle).T[::-1]))]
        flat[part] = near[::2]  # each twice: in front and behind
    return flat


def test_voussoirs_fill_their_ring():
    """Add up the stones of a ring without joints: a polygon with as many sides."""
    ring = Curve.of('round', 2.0, ()).ring(0.0, 0.2, 0.1)
    stones = voussoirs(ring, 0.0)
    count = len(stones)
    assert count % 2 == 1 and np.pi * 1.2 / 0.1 <= count < np.pi * 1.2 / 0.1 + 2.0
    area = sum(abs(moments(stone[::-1])[0] or moments(stone)[0]) for stone in stones)
    assert area == pytest.approx(0.5 * count * np.sin(np.pi / count) * (1.2 ** 2 - 1.0))


@pytest.mark.parametrize(('arch', 'height'), [
    ('round, 1', 1.1), ('segmental(0.3), 2', 0.8), ('pointed, 1', 1.6), ('flat, 1', 0.3)])
def test_bricks_make_room_for_arches(arch, height):
    """Cut bricks so that no part lies in another, and each stone is bonded to the next."""
    wall = built(arch, height)
    assert are_convex(wall.hexahedra.corners.reshape(-1, 8, 3)).all()
    stone = np.array(wall.kinds)[wall.kind] == 'voussoir'
    assert stone.sum() >= 15 and np.isin(np.flatnonzero(stone), wall.hexahedra.part).all()
    flat = outlines(wall)
    low, high = flat.min(axis=1), flat.max(axis=1)
    area = np.array([moments(row)[0] for row in flat])
    np.testing.assert_allclose(wall.mass / (1900.0 * 0.1025), area, rtol=1e-6)
    for part in wall.hexahedra.part.tolist():
        near = np.flatnonzero(((low < high[part]) & (high > low[part])).all(axis=1))
        for other in near[near != part].tolist():
            shared = clip(flat[part], flat[other])
            assert len(shared) < 3 or moments(shared)[0] < 1e-7
    between = stone[wall.bonds].all(axis=1) & (wall.bonds >= 0).all(axis=1)
    rings = int(arch[-1])
    assert between.sum() >= stone.sum() - rings
    assert wall.bond_extent[between].max() <= 0.2151 or not arch.startswith('round')


@pytest.mark.parametrize('shape', ['round', 'pointed', 'segmental(0.2)'])
def test_rings_of_wide_stones_without_joints_do_not_reach_into_each_other(shape):
    """Set two rings of few stones dry over each other: clip each with all others."""
    numbers = (0.2,) if '(' in shape else ()
    rings = Curve.of(shape.split('(')[0], 1.0, numbers).rings(2, 0.2, 0.0, 0.3)
    stones = [stone[::-1] if moments(stone)[0] == 0.0 else stone
              for ring in rings for stone in voussoirs(ring, 0.0)]
    for k, stone in enumerate(stones):
        for other in stones[:k]:
            shared = clip(stone, other)
            assert len(shared) < 3 or moments(shared)[0] < 1e-9


def rooms(wall, grain=0.003):
    """
    Measure between the parts, seen from the front, in squares of a grain.

    :returns: diameters of the largest circles in holes, where openings count as none, and the
        share of the wall that lies in holes: further than 0.85 joints of 1 cm from all parts.
    """
    flat = outlines(wall)
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    x, z = (np.arange(a, b, grain) + 0.5 * grain for a, b in zip(low, high))
    full = np.zeros((len(z), len(x)), bool)
    for outline in flat:
        near = [slice(*np.searchsorted(line, [outline[:, k].min(), outline[:, k].max()]))
                for k, line in ((1, z), (0, x))]
        side = np.ones((near[0].stop - near[0].start, near[1].stop - near[1].start), bool)
        for a, b in zip(outline, np.roll(outline, -1, axis=0)):
            side &= ((b - a)[0] * (z[near[0], None] - a[1])
                     - (b - a)[1] * (x[None, near[1]] - a[0])) >= 0.0
        full[tuple(near)] |= side
    room = grain * (2.0 * ndimage.distance_transform_edt(~full) - 1.0)
    label, count = ndimage.label(room > 0.017)
    index = np.arange(1, count + 1)
    widest = np.atleast_1d(ndimage.maximum(room, label, index))
    squares = np.bincount(label.ravel(), minlength=count + 1)[1:]
    return widest[widest < 0.4], float(squares[widest < 0.4].sum()) / full.size


RANDOM = """
building wall
  footprint: (0, 0) ({length}, 0)
  facades: front
  storey_height: {top}
rule front -> split(x) {{ ~1: wall | {span}: bay | ~1: wall }}
rule bay -> split(y) {{ {spring}: {below} | {height}: arch | ~1: wall }}
layout brick {{ bond: {bond}  unit: {unit}  material: brick }}
panel wall: brick
panel opening: none
panel arch: arch({shape}, {rings})
"""
LAYOUTS = [('running', '0.215 0.1025 0.065', 0.215), ('english', '0.215 0.1025 0.065', 0.215),
           ('flemish', '0.215 0.1025 0.065', 0.215), ('running', '0.40 0.30 0.20', 0.4)]


def drawn(shape, seed):
    """Build a wall with an arch whose sizes, rings, bond and filling are drawn."""
    draw = np.random.default_rng(seed)
    span, rings = float(np.exp(draw.uniform(np.log(0.8), np.log(6.0)))), int(draw.integers(1, 4))
    bond, unit, depth = LAYOUTS[int(draw.integers(len(LAYOUTS)))]
    rise = {'round': 0.5 * span, 'pointed': 0.866 * span, 'flat': 0.0}.get(
        shape, span * float(draw.uniform(0.06, 0.45)))
    height = rise + rings * (depth + 0.012) * (1.5 if shape == 'pointed' else 1.05) + 0.1
    spring = float(draw.uniform(0.3, 0.8))
    return WallGrammar.parse(RANDOM.format(
        length=span + 2.0 * rings * (depth + 0.02) + 1.0, top=spring + height + 0.4, span=span,
        spring=spring, below=draw.choice(['opening', 'wall']), height=height, bond=bond,
        unit=unit, rings=rings,
        shape=f'segmental({rise})' if shape == 'segmental' else shape)).build()


@pytest.mark.parametrize(('shape', 'seed'), [
    ('round', 1), ('segmental', 0), ('pointed', 1), ('flat', 0)])
def test_masonry_closes_up_to_arches(shape, seed):
    """Find no room for two joints between any bricks, and nothing thin, beside drawn arches."""
    wall = drawn(shape, seed)
    widest, share = rooms(wall)
    assert widest.max(initial=0.0) < 0.021 and share < 0.002
    assert are_convex(wall.hexahedra.corners.reshape(-1, 8, 3)).all()
    flat = outlines(wall)[wall.hexahedra.part]
    across = np.roll(flat, -1, axis=1) - flat
    length = np.hypot(*np.moveaxis(across, 2, 0))
    normal = np.stack([-across[..., 1], across[..., 0]], axis=2) / np.maximum(
        length, 1e-9)[..., None]
    width = np.ptp(np.einsum('nik,njk->nij', normal, flat), axis=2)
    assert np.where(length > 1e-6, width, 1.0).min() > 0.0049
    joined = np.zeros(len(wall), bool)
    joined[wall.bonds[wall.bonds >= 0]] = True
    assert joined.all()


def test_arches_over_walls_are_filled():
    """Set an arch over an opening, and over masonry: this one relieves what is under it."""
    openly, filled = built('round, 1', 1.1), built('round, 1', 1.1, below='wall')
    under = 0.5 * np.pi * 0.75 ** 2 + 1.5 * 0.6  # tympanum and opening [m²]
    more = (filled.mass.sum() - openly.mass.sum()) / (1900.0 * 0.1025)
    assert 0.75 * under < more < under  # less mortar


def fracture(blueprint):
    """Find what cracks and falls under its own weight."""
    found = Fracture(StressSolver(BondGraph(blueprint)))
    found.advance(20_000)
    assert found.stable
    return found


@pytest.mark.parametrize('count', [25, 47])
def test_dry_rings_stand_down_to_limit_analysis(count):
    """Build semicircles of mean radius 1 m: they stand 3 % above the least t/R, and not below."""
    for ratio, holds in ((1.03 * 0.1075, True), (0.97 * 0.1065, False)):
        span = 2.0 - ratio
        pitch = np.pi * (1.0 + 0.5 * ratio) / (count - 0.5)
        ring = WallGrammar.parse(FREE.format(length=span + 2.6, span=span, thickness=ratio,
                                             pitch=pitch)).build()
        stone = np.array(ring.kinds)[ring.kind] == 'voussoir'
        assert stone.sum() == count
        assert fracture(ring).solver.supported[stone].all() == holds


@pytest.mark.parametrize(('change', 'message'), [
    (('round, 1', 'gothic, 1'), 'unknown shape "gothic" of an arch (shapes: round, '
                                'segmental(rise), pointed, flat)'),
    (('round, 1', 'round, 1, glass'), 'arches are built of stones, not of "glass" (materials: '
                                      'brick, concrete, tile)'),
    (('round, 1', 'segmental, 1'), '"segmental" takes one number, its rise, found 0'),
    (('round, 1', 'round(2), 1'), '"round" takes no number, found 1'),
    (('round, 1', 'segmental(2), 1'), 'must be from 0.03 to 0.75 m, found 2 m'),
    (('round, 1', 'round'), 'arch(shape, rings) or arch(shape, rings, material), found 1'),
    (('round, 1', 'round, 0'), 'a whole number of rings from 1 to 10, found 0'),
    (('round, 1', 'round, 1, cheese'), 'unknown material "cheese"'),
    (('1.1: arch', '0.5: arch'), 'm high with its rings, the panel has only'),
    (('~1: wall | 1.5', '0.1: wall | 1.5'), 'and there is the corner: leave more wall around it'),
])
def test_arches_that_cannot_be_built_are_refused(change, message):
    """Name the place, what was found, and what is allowed."""
    text = WALL.format(arch='round, 1', height=1.1, below='opening').replace(*change)
    with pytest.raises(GrammarError, match=r'^<text>:\d+:\d+: ') as refused:
        WallGrammar.parse(text).build()
    assert message in str(refused.value)
