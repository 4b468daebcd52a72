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

"""The turtle: movement, the physics of segments, leaves, ornaments and what it refuses."""

import re

import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.lsystem.symbols import ATTRIBUTES


def _draw(axiom, more='', **arguments):
    return LSystem.parse(f'{more}\naxiom: {axiom}', 'tree.lsys').draw(**arguments)


def _directions(axiom, more=''):
    """Return the directions of the segments, (S, 3)."""
    return rotation.rotate(_draw(axiom, more).branches.attitude, [0.0, 0.0, 1.0])


def test_paper_example():
    """Expect the densities of the paper's example exactly."""
    branches = _draw('Density(5) DensityRate(0.5) F(10) F(10) F(10)').branches
    assert branches.density.tolist() == [5, 2.5, 1.25] and branches.length.tolist() == [10] * 3
    blueprint = LSystem.parse('axiom: Density(5) DensityRate(0.5) F(10) F(10) F(10)').build()
    assert blueprint.density.tolist() == [5, 2.5, 1.25] and len(blueprint) == 3
    assert blueprint.bonds.tolist() == [[-1, 0], [0, 1], [1, 2]]


@pytest.mark.parametrize('turn, direction', [
    ('', [0, 0, 1]), ('+(90)', [1, 0, 0]), ('-(90)', [-1, 0, 0]), ('&(90)', [0, -1, 0]),
    ('^(90)', [0, 1, 0]), ('/(30)', [0, 0, 1]), ('\\(90)+(90)', [0, 1, 0]),
    ('/(90)+(90)', [0, -1, 0]), ('|', [0, 0, -1]), ('+(30)|', [-0.5, 0, -np.sqrt(0.75)]),
    ('@R(0,3,0)', [0, 1, 0]), ('@R(0,0,-2)', [0, 0, -1]), ('@R(1,0,0,0,0,1)&(90)', [0, 0, -1]),
    ('@R(1,0,0,0,0,1)+(90)', [0, 1, 0]), ('+(90)/(40)$&(90)', [0, 0, -1]),
    ('+(90)\\(170)@v^(90)', [0, 0, 1]),
])
def test_turns(turn, direction):
    """Turn about up, left and heading, starting upright with left along x and up along y."""
    assert _directions(turn + 'F') == pytest.approx(np.array([direction]), abs=1e-12)


def test_unit_of_length():
    """Draw in centimetres what is drawn in metres: segments, widths, leaves, polygons, moves."""
    axiom = 'axiom: !({0}) F({1}) [ &(30) ~({2}) G({1}) ] {{ . f({0}) +(90) f({2}) }} F({1})'
    metres = LSystem.parse(axiom.format(0.1, 1, 0.4)).build()
    found = LSystem.parse('unit: 0.01\n' + axiom.format(10, 100, 40)).build()
    for name in ('poses', 'bond_frame', 'bond_extent', 'mass', 'leaf_area'):
        np.testing.assert_allclose(getattr(found, name), getattr(metres, name), atol=1e-12)
    np.testing.assert_allclose(found.leaves.size, metres.leaves.size)
    np.testing.assert_allclose(found.leaves.pose, metres.leaves.pose, atol=1e-12)
    assert len(found.ornaments.texture) > 1 and found.leaf_area[0] > metres.leaves.size[0] ** 2
    np.testing.assert_allclose(found.ornaments.triangle, metres.ornaments.triangle, atol=1e-12)


@pytest.mark.parametrize('unit, words', [
    ('0', 'the unit is 0, it must be from 1e-06 to 1e+06 m'),
    ('0.00001', 'F is 1e-05 m long'), ('2000', 'F is 2000 m long')])
def test_units_that_cannot_be(unit, words):
    """Refuse units that leave no length within its range, also where no length is written."""
    with pytest.raises(GrammarError, match=re.escape(words)):
        LSystem.parse(f'unit: {unit}\naxiom: F').build()


def test_default_angle():
    """Turn by the grammar's angle when a turn has none of its own."""
    assert _directions('+F', 'angle: 90') == pytest.approx(np.array([[1, 0, 0]]), abs=1e-12)
    twice = _directions('^F', 'define: a = 45\nangle: a * 2')
    assert twice == pytest.approx(np.array([[0, 1, 0]]), abs=1e-12)
    with pytest.raises(GrammarError, match=r'tree.lsys:2:10: \+ has no angle'):
        _draw('F + F')


def test_level():
    """Roll until left is horizontal, and leave a vertical heading alone."""
    branches = _draw('&(50)/(33)$F').branches
    assert rotation.rotate(branches.attitude, [1.0, 0, 0])[0, 2] == pytest.approx(0, abs=1e-12)
    assert rotation.rotate(branches.attitude, [0, 1.0, 0])[0, 2] > 0
    assert _draw('$F').branches.attitude == pytest.approx(np.array([[0, 0, 0, 1.0]]))


def test_axes():
    """Follow parents, side branches and gaps through brackets."""
    branches = _draw('F(2)[+(90)F(1)F(1)]f(3)F(4)[F(1)[F(1)]]').branches
    assert branches.parent.tolist() == [-1, 0, 1, 0, 3, 4]
    assert branches.lateral.tolist() == [False, True, False, False, True, True]
    assert branches.base == pytest.approx(np.array(
        [[0, 0, 0], [0, 0, 2], [1, 0, 2], [0, 0, 5], [0, 0, 9], [0, 0, 10.0]]))
    forest = _draw('[F][f(2)F]').branches
    assert forest.parent.tolist() == [-1, -1] and not forest.lateral.any()
    assert _draw('F').branches.length.tolist() == [1.0]


def test_widths():
    """Taper towards the next segment of the same axis; the last keeps its rate."""
    branches = _draw('Width(0.4)F[!(0.1)F]!(0.3)F WidthRate(0.5) F F').branches
    assert branches.width == pytest.approx([0.4, 0.1, 0.3, 0.3, 0.15])
    assert branches.tip_width == pytest.approx([0.3, 0.1, 0.3, 0.15, 0.075])
    assert _draw('!(0.2)F!F').branches.width == pytest.approx([0.2, 0.2 * np.sqrt(0.5)])


_COLUMNS = {
    'Width': 'width', 'Density': 'density', 'Modulus': 'modulus', 'Strength': 'strength',
    'DampingRatio': 'damping_ratio', 'SwingForce': 'swing_stiffness',
    'SwingDamper': 'swing_damping', 'TwistForce': 'twist_stiffness',
    'TwistDamper': 'twist_damping', 'StretchForce': 'stretch_stiffness',
    'StretchDamper': 'stretch_damping', 'BreakForce': 'break_force',
    'BreakTorque': 'break_torque',
}


@pytest.mark.parametrize('name', _COLUMNS)
def test_physics(name):
    """Set each quantity where its symbol stands, keep it on the stack, apply its rate."""
    unit = 1e6 if name == 'Modulus' else 1.0
    text = f'F {name}({8 * unit}) F [ {name}({4 * unit}) {name}Rate(0.5) F F F ] F'
    values = getattr(_draw(text).branches, _COLUMNS[name])
    default = {a.name: a.default for a in ATTRIBUTES}[name]
    assert values == pytest.approx(
        [default, *(unit * np.array([8, 4, 2, 1, 8]))], nan_ok=True)


def test_physics_with_other_units():
    """Turn degrees into radians, and keep ratios and texture numbers in their range."""
    branches = _draw('SwingLimit(90) BoneRatio(0.8) Texture(1) F SwingLimitRate(0.5) F F '
                     "BoneRatioRate(1.1) ' F BoneRatioRate(1) F TextureRate(2) F F").branches
    assert np.degrees(branches.swing_limit[:3]) == pytest.approx([90, 90, 45])
    assert branches.bone_ratio[:5] == pytest.approx([0.8] * 4 + [0.88])
    assert branches.texture.tolist() == [1, 1, 1, 2, 2, 2, 4]


def test_defaults():
    """Expect for geometry alone the wood of a green birch, which does not break."""
    branches = _draw('F').branches
    assert branches.density[0] == 900 and branches.modulus[0] == 9.9e9
    assert branches.damping_ratio[0] == 0.05 and np.isinf(branches.break_force[0])
    assert np.isnan(branches.swing_stiffness[0]) and np.isnan(branches.twist_stiffness[0])


def test_cut():
    """Leave out the rest of a branch, with its side branches, but not what follows it."""
    branches = _draw('F[F%F[F]F(9)]F').branches
    assert branches.parent.tolist() == [-1, 0, 0] and branches.length.max() == 1
    assert len(_draw('F%[F]F').branches) == 1


def test_tropism():
    """Turn by e·|H×T| rad after each segment, towards T and never past it."""
    directions = _directions('&(90) Tropism(0,0,-1,0.2) F F F')
    assert directions[0] == pytest.approx([0, -1, 0])
    assert directions[1] == pytest.approx([0, -np.cos(0.2), -np.sin(0.2)])
    third = 0.2 + 0.2 * np.cos(0.2)
    assert directions[2] == pytest.approx([0, -np.cos(third), -np.sin(third)])
    assert _directions('&(90)Tropism(0,0,-1,50)FF')[1] == pytest.approx([0, 0, -1], abs=1e-9)
    assert _directions('&(90)Tropism(0,0,-1,-50)FF')[1] == pytest.approx([0, 0, 1], abs=1e-9)
    scaled = _directions('&(90)Tropism(0,0,-2,0.2)FF')[1]
    assert scaled == pytest.approx([0, -np.cos(0.4), -np.sin(0.4)])
    assert _directions('Tropism(0,0,-1,0.5)FF')[1] == pytest.approx([0, 0, 1])
    inside = _directions('&(90)F[Tropism(0,0,-1,0.2)FF]FF')
    assert inside[3] == pytest.approx([0, -1, 0]) and inside[4] == pytest.approx([0, -1, 0])


def _world_corners(drawing):
    """Return the triangles of the ornaments in world axes, (T, 3, 3)."""
    branches, ornaments = drawing.branches, drawing.ornaments
    middle = branches.base + 0.5 * branches.length[:, None] * rotation.rotate(
        branches.attitude, [0.0, 0.0, 1.0])
    local = ornaments.triangle.reshape(-1, 3, 3)
    return middle[ornaments.part][:, None] + rotation.rotate(
        branches.attitude[ornaments.part][:, None], local)


def test_polygon():
    """Fill polygons as a fan, carried by the segment that they grow from."""
    drawing = _draw('F(2)[+(90){.f(1).-(90)f(1).-(90)f(1).}]F', 'textures: bark, leaf')
    assert drawing.ornaments.part.tolist() == [0] * 2  # corners given twice count once
    corners = _world_corners(drawing)
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0],
                                         corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert area == pytest.approx(1.0)
    assert corners[..., 2].min() == pytest.approx(2) and corners[..., 2].max() == pytest.approx(3)
    assert drawing.textures == ('bark', 'leaf')


def test_polygon_edges():
    """Take the ends of movements as corners, and draw no segment inside a polygon."""
    drawing = _draw('F{f+f+f+F}', 'angle: 90')
    assert len(drawing.ornaments) == 2 and len(drawing.branches) == 1
    assert len(_draw('F{.G(1).+(90)f(1)}').ornaments) == 1


def test_nested_polygons():
    """Fill a polygon inside another one."""
    text = 'F{.f(1)+(90){.f(1)-(90)f(1)-(90)f(1)}f(1)}'
    assert len(_draw(text).ornaments) == 2 + 1


def test_boneless_segment():
    """Cover boneless segments with a tube on the segment before them, without a part."""
    drawing = _draw('Width(0.2)F(2)[&(90)WidthRate(0.5)G(3)]F')
    assert len(drawing.branches) == 2 and set(drawing.ornaments.part) == {0}
    corners = _world_corners(drawing).reshape(-1, 3)
    assert corners[:, 1].min() == pytest.approx(-3) and corners[:, 1].max() == pytest.approx(0)
    far = corners[corners[:, 1] < -1.5] - [0, -3, 2]
    assert np.linalg.norm(far, axis=1) == pytest.approx(0.05)
    near = corners[corners[:, 1] > -1.5] - [0, 0, 2]
    assert np.linalg.norm(near, axis=1) == pytest.approx(0.1)


def test_leaves():
    """Put leaves in the frame of their segment, heading where the turtle heads."""
    drawing = _draw('F(2)&(90)F(4)[^(90)~(0.3)]Leaf(0.2, 3) LeafRate(0.5)F(1)~(0.4)')
    leaves = drawing.leaves
    assert leaves.part.tolist() == [1, 1, 2] and leaves.size == pytest.approx([0.3, 0.2, 0.2])
    assert leaves.pose[0, :3] == pytest.approx([0, 0, 2])
    direction = rotation.rotate(leaves.pose[:, 3:], [0.0, 0.0, 1.0])
    assert direction == pytest.approx(np.array([[0, 1, 0], [0, 0, 1], [0, 0, 1.0]]), abs=1e-12)
    assert leaves.texture.tolist() == [1, 3, 1]
    assert drawing.textures == ('bark', 'leaf', 'texture_2', 'texture_3')


def test_leaf_before_the_first_segment():
    """Let the segment that follows carry what stands before any segment."""
    drawing = _draw('~(1)[F]f(3)~(1)[F]')
    assert drawing.leaves.part.tolist() == [0, 1]


@pytest.mark.parametrize('axiom, column, words', [
    ('Width(-0.1) F', 8, 'Width is -0.1, it must be from 0.0001 to 30 m'),
    ('F !(0) F', 10, '! is 0'), ('F(-1)', 8, 'F is -1'), ('F(0)', 8, 'F is 0'),
    ('Density(0)F', 8, 'Density is 0'), ('SwingDamper(-1)F', 8, 'from 0 to'),
    ('WidthRate(-1)F', 8, 'WidthRate is -1'), ('WidthRate(0)F F', 22, 'would get a Width of 0'),
    ('BoneRatio(0.5)F', 8, 'from 0.8 to 0.95'),
    ('SwingLimit(200)F', 8, 'from 0.001 to 180 degrees'),
    ('Texture(1.5)F', 8, 'texture number'), ('Texture(-1)F', 8, 'from 0 to'),
    ('F~(0)', 9, '~ is 0'), ('F Leaf(1, 0.5)', 10, 'texture number'),
    ('F } F', 10, 'outside a polygon'), ('F . F', 10, 'outside a polygon'),
    ('F { f', 12, 'still open'), ('@R(0,0,0) F', 8, 'no direction'),
    ('@R(0,0,1,0,0,2) F', 8, 'no direction'), ('A', 0, 'draws no segment'),
    ('[' * 10001 + 'F' + ']' * 10001, 0, 'nested 10001 deep'),
    ('Density(1e300)F', 8, 'Density is 1e+300, it must be from 0.1 to 25000 kg/m³'),
    ('Density(1e-300)F', 8, 'from 0.1 to 25000 kg/m³'),
    ('Modulus(1e300)F', 8, 'Modulus is 1e+300, it must be from 1000 to 2e+12 Pa'),
    ('Modulus(1e-3)F', 8, 'from 1000 to 2e+12 Pa'), ('Strength(1e300)F', 8, '1 to 1e+12 Pa'),
    ('F(1e300)', 8, 'F is 1e+300, it must be from 0.0001 to 1000 m'),
    ('F(1e-300)', 8, 'F is 1e-300, it must be from 0.0001 to 1000 m'),
    ('!(1e-12)F', 8, '! is 1e-12, it must be from 0.0001 to 30 m'),
    ('!(1e-200)F', 8, 'from 0.0001 to 30 m'), ('!(1e-9)F', 8, 'from 0.0001 to 30 m'),
    ('f(1e300)F', 8, 'f is 1e+300, it must be from -1000 to 1000 m'),
    ('+(1e300)F', 8, 'from -1e+09 to 1e+09 degrees'), ('F~(1e300)', 9, '0.0001 to 100 m'),
    ('Tropism(0, 0, 1e300, 1)F', 8, 'Tropism is 1e+300, it must be'),
    ('DensityRate(1e300) F F', 8, 'DensityRate is 1e+300, it must be from 0 to 1000'),
    ('DensityRate(900) F F', 27, 'Density of 810000, it must be from 0.1 to 25000 kg/m³'),
    ('SwingForce(1e300)F', 8, 'N·m/rad'), ('BreakForce(0)F', 8, 'from 1e-09 to 1e+15 N'),
    ('LeafRate(0.001) F F F ~(1)', 30, 'size of 1e-09, it must be from 0.0001 to 100 m'),
    ('F(999)' * 12, 74, 'coordinates must be from -10000 to 10000 m'),
])
def test_refused(axiom, column, words):
    """Refuse what no segment can have, naming the symbol and its place."""
    with pytest.raises(GrammarError) as caught:
        LSystem.parse(f'axiom: {axiom}', 'tree.lsys').build()
    assert words in str(caught.value) and caught.value.column == column
    assert caught.value.line == (1 if column else 0)


def test_place_in_a_rule():
    """Name the rule that wrote a bad module, many steps later."""
    text = 'axiom: A(3)\nproduction:\n  A(w) -> !(w - 1) F A(w - 1)'
    with pytest.raises(GrammarError, match='tree.lsys:3:11: ! is 0') as caught:
        LSystem.parse(text, 'tree.lsys').draw(4)
    assert caught.value.line == 3


def test_declared_textures():
    """Refuse texture numbers beyond the names that the grammar gives."""
    with pytest.raises(GrammarError, match='texture number from 0 to 0'):
        _draw('Texture(1) F', 'textures: bark')
    with pytest.raises(GrammarError, match='asks for texture 2; textures are 0 to 1'):
        _draw("F''F", 'textures: bark, leaf')


@pytest.mark.parametrize('figure', ['2_6', '2_7', '2_8'])
def test_figures_stand(figure):
    """Grow the trees of the book upright, to the number of segments of the book."""
    drawing = LSystem.load(shared_folder() / 'grammars' / f'abop_{figure}.lsys').draw()
    branches = drawing.branches
    tops = branches.base + branches.length[:, None] * rotation.rotate(
        branches.attitude, [0.0, 0.0, 1.0])
    assert len(branches) == {'2_6': 1023, '2_7': 1023, '2_8': 1457}[figure]
    assert 3 < tops[:, 2].max() < 12 and tops[:, 2].min() > 0
    assert np.linalg.norm(branches.attitude, axis=1) == pytest.approx(1)
    ends = tops[branches.parent[branches.parent >= 0]]
    assert branches.base[branches.parent >= 0] == pytest.approx(ends)
