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

"""Scanned trees: files of cylinders, plants and skeletons that sway like the trees they are of."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from procphys_ros.batch.sweep import Sweep
from procphys_ros.blueprint import Blueprint, skeleton
from procphys_ros.errors import GrammarError, GrammarWarning, SceneError
from procphys_ros.files.file_bounds import FileBounds, within
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.trees import Forest
from procphys_ros.render.command import main as render
from procphys_ros.scans import scan_file, ScannedTree
from procphys_ros.scene import Scene
from procphys_ros.scene.named import open_scene
from procphys_ros.scene.sources import load_grammar
from procphys_ros.scene.spawn import Spawn
from procphys_ros.simulation import Simulation

_STEP = 1.0 / 60.0  # [s]
_HEAD = 'ID,parentID,startX,startY,startZ,endX,endY,endZ,radius\n'
_POLE = _HEAD + '1,-1,0,0,0,0,0,1,0.1\n2,1,0,0,1,0,0,2,0.09\n3,2,0,0,2,0,0,3,0.08\n'
_FAR = np.array([4.1e5, 5.2e6, 312.0])


class _Oak:
    """A grown oak with the wood of a scan, as cylinders and as points in a shuffled order."""

    def __init__(self) -> None:
        drawn = LSystem.load('oak.lsys').draw(seed=3).branches
        count = len(drawn)
        self.rng = np.random.default_rng(7)
        axis = rotation.rotate(drawn.attitude, np.array([0.0, 0.0, 1.0]))
        self.parent, self.start = drawn.parent.copy(), drawn.base
        self.end = drawn.base + drawn.length[:, None] * axis
        first, last = drawn.width, drawn.tip_width
        self.radius = (np.sqrt((first * first + first * last + last * last) / 12.0)
                       * (1.0 - 1e-4 * np.arange(count)))  # no two alike
        self.count = count
        self.order = self.rng.permutation(count)

    def noisy(self, points: np.ndarray) -> np.ndarray:
        """Move points by a millimetre or so, and to where surveyors count from."""
        return points + _FAR + self.rng.normal(0.0, 5e-4, points.shape)

    def as_cylinders(self) -> Blueprint:
        """Build the tree without a file."""
        count = self.count
        drawn = LSystem.load('oak.lsys').draw(seed=3).branches
        wood = {'density': 900.0, 'modulus': 8e9, 'strength': 60e6, 'damping_ratio': 0.05,
                'bone_ratio': 0.9, 'swing_limit': np.pi / 3.0, 'root_moment': np.inf,
                'root_stiffness': np.nan, 'preload': 1.0}
        return skeleton.build(replace(
            drawn, width=2.0 * self.radius, tip_width=2.0 * self.radius,
            texture=np.zeros(count, np.int16),
            **{name: np.full(count, value) for name, value in wood.items()}))

    def nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return points, parents and radii; node 0 is the foot."""
        return (np.concatenate([self.start[:1], self.end]), np.append(-1, self.parent + 1),
                np.append(self.radius[0], self.radius))


def _merged_row(number: int, spot: np.ndarray, radius: float, parent: int) -> str:
    place = ' '.join(f'{x:.5f}' for x in spot)
    return f'{number} {parent} {place} {place} {radius:.6f}'


def _simple_forest(oak: _Oak) -> str:
    """Write IDs and names in a random order, with a cylinder without a length under the root."""
    start, end = oak.noisy(oak.start), oak.noisy(oak.end)
    rows = [_merged_row(900, start[0], oak.radius[0], -1)]
    for i in oak.order:
        parent = oak.parent[i] + 100 if oak.parent[i] >= 0 else 900
        numbers = ' '.join(f'{x:.5f}' for x in (*start[i], *end[i]))
        rows.append(f'{i + 100} {parent} {numbers} {oak.radius[i]:.6f}')
    return 'cyl_ID parent_ID X_start y_start startZ endX endY endZ Radius\n' + '\n'.join(rows)


def _tree_qsm(oak: _Oak) -> str:
    """Write rows as TreeQSM does: vectors under one name, parents by row, rows in any order."""
    start, end = oak.noisy(oak.start), oak.noisy(oak.end)
    row = np.empty(oak.count, int)
    row[oak.order] = np.arange(1, oak.count + 1)
    length = np.linalg.norm(end - start, axis=1)
    lines = ['radius (m)\tlength (m)\tstart_point\t\t\taxis_direction\t\t\tparent\textension']
    for i in oak.order:
        numbers = (oak.radius[i], length[i], *start[i], *(end[i] - start[i]) / length[i],
                   row[oak.parent[i]] if oak.parent[i] >= 0 else 0, 0)
        lines.append('\t'.join(f'{x:.7f}' for x in numbers))
    return '\r\n'.join(lines) + '\r\n'


def _without_parents(oak: _Oak) -> str:
    start, end = oak.noisy(oak.start), oak.noisy(oak.end)
    return 'x1;y1;z1;x2;y2;z2;name;diameter [m]\n' + ''.join(
        ';'.join(f'{x:.5f}' for x in (*start[i], *end[i])) + f';"a;b";{2 * oak.radius[i]:.6f}\n'
        for i in oak.order)


def _mtg(oak: _Oak) -> str:
    """Write a plant of axes of internodes, diameters in mm."""
    points, parents, radii = oak.nodes()
    points = oak.noisy(points)
    lines = ['CODE:\tFORM-A', '', 'CLASSES:',
             'SYMBOL\tSCALE\tDECOMPOSITION\tINDEXATION\tDEFINITION',
             '$\t0\tFREE\tFREE\tIMPLICIT', 'P\t1\tFREE\tFREE\tEXPLICIT',
             'A\t2\tFREE\tFREE\tEXPLICIT', 'N\t3\tFREE\tFREE\tEXPLICIT', '', 'DESCRIPTION:',
             'LEFT\tRIGHT\tRELTYPE\tMAX', 'N\tN\t<\t1', 'N\tN\t+\t?', '', 'FEATURES:',
             'NAME\tTYPE', 'XX\tREAL', 'YY\tREAL', 'ZZ\tREAL', 'TopDia\tREAL', '', 'MTG:']
    depth = np.zeros(len(points), int)
    children: list[list[int]] = [[] for _ in points]
    for k in range(1, len(points)):
        children[parents[k]].append(k)
    body: list[tuple[int, str, int]] = []

    def write(k: int, column: int, code: str) -> None:
        depth[k] = column
        body.append((column, code, k))
        for side in children[k][1:]:
            write(side, column + 1, f'+A{side}/N{side}')
        if children[k]:
            write(children[k][0], column, f'^<N{children[k][0]}')
    write(0, 0, '/P1/A1/N0')
    wide = max(column for column, _, _ in body) + 1
    lines.append('ENTITY-CODE' + '\t' * wide + 'XX\tYY\tZZ\tTopDia')
    for column, code, k in body:
        numbers = '\t'.join(f'{x:.5f}' for x in (*points[k], 2000.0 * radii[k]))
        lines.append('\t' * column + code + '\t' * (wide - column) + numbers)
    return '\n'.join(lines) + '\n'


def _graph(oak: _Oak) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shuffle points and edges, with a vertex twice; return points, radii and edges."""
    points, parents, radii = oak.nodes()
    edges = np.column_stack([np.arange(1, len(points)), parents[1:]])
    extra = len(points)
    edges[-1, 0] = extra  # the last twig ends at a copy of its tip
    points = oak.noisy(np.concatenate([points, points[-1:]]))
    points[-1] = points[-2]
    radii = np.append(radii, radii[-1])
    edges = np.concatenate([edges, [[extra, extra - 1]]])
    order = oak.rng.permutation(len(points))
    place = np.empty(len(points), int)
    place[order] = np.arange(len(points))
    edges = place[oak.rng.permuted(edges, axis=1)]
    return points[order], radii[order], edges[oak.rng.permutation(len(edges))]


def _ply(oak: _Oak, kind: str) -> bytes:
    points, radii, edges = _graph(oak)
    listed = ('list uchar int vertex_indices' if kind == 'list'
              else 'int vertex1\nproperty int vertex2')
    coding = 'ascii' if kind == 'ascii' else 'binary_little_endian'
    head = (f'ply\nformat {coding} 1.0\ncomment a skeleton\nelement vertex {len(points)}\n'
            'property double x\nproperty double y\nproperty double z\nproperty float radius\n'
            f'element edge {len(edges)}\nproperty {listed}\nend_header\n').encode()
    if kind == 'ascii':
        rows = [' '.join(f'{x:.6f}' for x in (*p, r)) for p, r in zip(points, radii)]
        return head + '\n'.join([*rows, *(f'{a} {b}' for a, b in edges)]).encode() + b'\n'
    table = np.zeros(len(points), '<f8,<f8,<f8,<f4')
    for k, column in enumerate((*points.T, radii)):
        table[f'f{k}'] = column
    pairs = np.zeros(len(edges), [('n', 'u1'), ('v', '<i4', 2)])
    pairs['n'], pairs['v'] = 2, edges
    return head + table.tobytes() + (pairs if kind == 'list' else pairs['v'].copy()).tobytes()


_FORMATS = {
    'SimpleForest.csv': lambda oak: _simple_forest(oak).encode(),
    'TreeQSM.csv': lambda oak: _tree_qsm(oak).encode('utf-8-sig'),
    'ends.csv': lambda oak: _without_parents(oak).encode(),
    'plant.mtg': lambda oak: _mtg(oak).encode(),
    'ascii.ply': lambda oak: _ply(oak, 'ascii'), 'binary.ply': lambda oak: _ply(oak, 'binary'),
    'list.ply': lambda oak: _ply(oak, 'list')}


def _sway(tree: Blueprint) -> tuple[float, float]:
    """Return the lean in a steady wind of 6 m/s [m], and the frequency once it stops [Hz]."""
    forest, share, way = Forest(tree), tree.mass / tree.mass.sum(), []
    rest = share[forest.parts] @ forest.poses[:, 0]
    forest.lean(np.zeros(1, np.int64), np.tile([6.0, 0.0, 0.0], (len(tree), 1)))
    for _ in range(400):
        way.append(share[forest.parts] @ forest.poses[:, 0] - rest)
        forest.step(_STEP)
    free = np.array(way)
    crossings = np.flatnonzero(free[1:] * free[:-1] < 0.0)
    times = crossings + free[crossings] / (free[crossings] - free[crossings + 1])
    return way[0], (len(times) - 1) / (2.0 * _STEP * float(times[-1] - times[0]))


def _load(path, text: str | bytes, **defines: float) -> Blueprint:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ScannedTree.load(path).build(**defines)


@pytest.mark.parametrize('name', _FORMATS)
def test_a_tree_that_was_written_sways_as_before(name, tmp_path):
    """Read an oak back from a shuffled, noisy file far away: the same mass, lean and frequency."""
    oak = _Oak()
    cylinders = name.endswith('.csv')
    before = (oak.as_cylinders() if cylinders else
              skeleton.from_nodes(*oak.nodes(), damping_ratio=0.05))
    defines = {'diameter_unit': 0.001} if name.endswith('.mtg') else {}
    with pytest.warns(GrammarWarning) as told:
        after = _load(tmp_path / name, _FORMATS[name](oak), **defines)
    said = '\n'.join(str(one.message) for one in told)
    assert 'moved by (-410000.00, -5200000.00, -312.00) m' in said and said.count('\n') == 0
    assert ('merged' in said) == (name not in ('TreeQSM.csv', 'ends.csv', 'plant.mtg'))
    assert len(after) == len(before) == oak.count
    assert np.abs(after.bond_frame[0, :3]).max() < 0.02
    assert after.mass.sum() == pytest.approx(before.mass.sum(), rel=0.01)
    assert _sway(after) == pytest.approx(_sway(before), rel=0.02)


@pytest.mark.parametrize('name', ['pole.csv', 'pole.ply'])
def test_a_pole_bends_under_a_side_load_as_a_beam(name, tmp_path):
    """Expect the deflection of Euler and Bernoulli at the tip, of a stem even and tapered."""
    height, wide, thin, force, parts = 6.0, 0.06, 0.02, 30.0, 12
    level = np.linspace(0.0, height, parts + 1)
    if name == 'pole.csv':
        thin = wide
        rows = [f'{k},{k - 1},0,0,{level[k]},0,0,{level[k + 1]},{wide}' for k in range(parts)]
        text = _HEAD + '\n'.join(rows).replace('0,-1,', '0,,', 1)
    else:
        radius = np.linspace(wide, thin, parts + 1)
        text = (f'ply\nformat ascii 1.0\nelement vertex {parts + 1}\nproperty float x\n'
                'property float y\nproperty float z\nproperty float radius\n'
                f'element edge {parts}\nproperty int vertex1\nproperty int vertex2\nend_header\n'
                + ''.join(f'0 0 {z} {r}\n' for z, r in zip(level, radius))
                + ''.join(f'{k + 1} {k}\n' for k in range(parts)))
    forest = Forest(_load(tmp_path / name, text, modulus=9e9, damping=0.9), (0.0, 0.0, 0.0), 0.0)
    for _ in range(900):
        axis = rotation.rotate(forest.poses[-1, 3:], np.array([0.0, 0.0, 1.0]))
        tip = forest.poses[-1, :3] + 0.5 * height / parts * axis
        forest.apply_impulse(parts - 1, tip, (_STEP * force, 0.0, 0.0))
        forest.step(_STEP)
    along = (np.arange(20000) + 0.5) / 20000 * height
    inertia = 0.25 * np.pi * (wide + (thin - wide) * along / height) ** 4
    bent = force / 9e9 * np.mean((height - along) ** 2 / inertia) * height
    assert 0.02 < tip[0] < 0.3 and tip[0] == pytest.approx(bent, rel=0.02)


@pytest.mark.parametrize('change, words', [
    (('0,0,1,0.1', '0,0,1,x'), ':2:18: radius is "x", it must be a number'),
    (('0,0,1,0.1', '0,0,1,nan'), ':2:18: radius is nan, it must be from 0 to 1e+09'),
    (('0,0,1,0.1', '0,0,1,-0.1'), ':2:18: radius is -0.1'),
    (('1,-1,0,', '1,-1,inf,'), ':2:6: start x is inf'),
    (('1,-1,0,', '1,-1,1e99,'), ':2:6: start x is 1e+99'),
    (('1,-1,', '1,3,'), ':2:3: the parent is 3, from which the cylinder comes to itself'),
    (('2,1,', '2,2,'), ':3:3: the parent is 2, from which'),
    (('3,2,', '3,7,'), ':4:3: there is no cylinder 7 to be the parent'),
    (('3,2,', '2,1,'), ':4:1: ID 2 stands there twice'),
    (('3,2,', '3.5,2,'), ':4:1: ID is 3.5, it must be a whole number'),
    ((',0.08', ''), ':4:16: there are 8 columns, the names are 9'),
    (('radius', 'thickness'), ':1: the columns are ID, parentID, startX, startY, startZ, endX, '
     'endY, endZ, thickness; cylinders need start x, y and z; end x'),
    (('endZ', 'endW'), ':1: the columns are'), ((_POLE, ''), ': the file is empty'),
    ((_POLE, _HEAD), ': there are no cylinders'), ((_POLE, '\n# \n'), ':2: none of the columns'),
    ((_POLE, '1,2,3\n4,5,6\n'), ':1: none of the columns are coordinates; cylinders need')])
def test_mistakes_in_tables_are_told_with_their_place(change, words, tmp_path):
    """Name file, line and column, and what is needed."""
    with pytest.raises(GrammarError) as caught:
        _load(tmp_path / 'tree.csv', _POLE.replace(*change, 1))
    said = str(caught.value)
    assert said.startswith(f'{tmp_path}/tree.csv:') and words in said and '\n' not in said


_PLANT = ('CODE:\tFORM-A\nCLASSES:\nSYMBOL\tSCALE\tDECOMPOSITION\tINDEXATION\tDEFINITION\n'
          '$\t0\tFREE\tFREE\tIMPLICIT\nP\t1\tFREE\tFREE\tEXPLICIT\n'
          'A\t2\tFREE\tFREE\tEXPLICIT\nN\t3\tFREE\tFREE\tEXPLICIT\n'
          'FEATURES:\nNAME\tTYPE\nXX\tREAL\nMTG:\n'
          'ENTITY-CODE\t\tXX\tYY\tZZ\tTopDia\n'
          '/P1/A1/N1\t\t0\t0\t0\t0.2\n^<N2\t\t0\t0\t1\t\n\t+A2/N1\t1\t0\t1\t0.1\n'
          '^<N3<N4\t\t0\t0\t3\t0.14  # N3 has no place\n')


def test_an_mtg_takes_the_finest_scale_with_coordinates(tmp_path):
    """Follow axes and their parts, skip points without a place, fill diameters, and tell."""
    with pytest.warns(GrammarWarning, match='1 vertices without coordinates left out, 1 points '
                                            'without a diameter'):
        tree = _load(tmp_path / 'plant.mtg', _PLANT)
    assert len(tree) == 3 and sorted(tree.bonds[:, 0]) == [-1, 0, 0]
    np.testing.assert_allclose(np.sort(tree.visual_size[:, 1]), [0.1, 0.14, 0.2])
    coarse = _PLANT.replace('/N1\t\t0\t0\t0', '\t\t0\t0\t0').replace('^<N2', '^<A3')
    coarse = coarse.replace('+A2/N1', '+A2').replace('^<N3<N4', '^<A4')
    with pytest.warns(GrammarWarning, match='1 points without a diameter'):
        assert len(_load(tmp_path / 'plant.mtg', coarse)) == 3


def test_axes_of_an_mtg_follow_the_last_part_of_what_they_grow_from(tmp_path):
    """Link the first part of an axis that a new line begins under another axis."""
    text = _PLANT.replace('/P1/A1/N1\t', '/P1/A1\n\t/N1').replace('^<N2\t\t', '\t^<N2\t')
    text = text.replace('\t+A2/N1', '^+A2/N1\t').replace('^<N3<N4', '^<N4')
    with pytest.warns(GrammarWarning):
        tree = _load(tmp_path / 'plant.mtg', text)
    assert len(tree) == 3 and (tree.bonds[:, 0] < 0).sum() == 1


def _refused(path: Path, text: str, words: str) -> None:
    """Check that a file is refused in a line that names it."""
    with pytest.raises(GrammarError) as caught:
        _load(path, text)
    said = str(caught.value)
    assert said.startswith(f'{path}:') and words in said and '\n' not in said


@pytest.mark.parametrize('change, words', [
    (('FORM-A', 'FORM-B'), ':1: the code is "FORM-B"; only FORM-A'),
    (('^<N2', '^<<N2'), ':14:1: "^<<N2" is not understood; vertices are written'),
    (('^<N2', '^<M2'), ':14:1: there is no class M (classes: $, P, A, N)'),
    (('/P1/A1/N1', '<N1'), ':13:1: <N has nothing to follow'),
    (('\t0\t0\t1\t\n', '\t0\tone\t1\t\n'), ':14: y is "one", it must be a number'),
    (('\t0\t0\t1\t\n', '\t0\t0\tnan\t\n'), ':14: z is "nan"'),
    (('\t0\t0\t1\t\n', '\t0\t\t1\t\n'), ':14: one of XX, YY and ZZ is missing'),
    (('0.14', '-0.14'), ':16: diameter is -0.14'),
    (('ZZ\tTop', 'WW\tTop'), ':12: the columns are ENTITY-CODE, XX, YY, WW, TopDia; XX, YY and'),
    (('\t+A2/N1', '<A2\t+A2/N1'), ':15: 2 of the 2 columns before'),
    (('A\t2\tFREE', 'A\ttwo\tFREE'), ':6: "A\\ttwo'),
    (('MTG:\n', ''), ': there is no section MTG'),
    (('CODE:', 'COD'), ':1: this stands before the first section')])
def test_mistakes_in_plants_are_told_with_their_place(change, words, tmp_path):
    """Say in a line what is not understood."""
    _refused(tmp_path / 'tree.mtg', _PLANT.replace(*change, 1), words)


_GRAPH = ('ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n'
          'property float z\nproperty float radius\nelement edge 4\nproperty int vertex1\n'
          'property int vertex2\nend_header\n0 0 2 0.08\n0 0 1 0.09\n0 0 0 0.1\n1 0 2 0.05\n'
          '0 1\n2 1\n3 1\n0 3\n')


def test_loops_of_a_skeleton_are_cut(tmp_path):
    """Span the graph from its lowest vertex; tell of the edge that is not needed."""
    with pytest.warns(GrammarWarning, match='put right: 1 edges that close loops left out$'):
        tree = _load(tmp_path / 'tree.ply', _GRAPH)
    assert tree.bonds[:, 0].tolist() == [-1, 0, 0]


def test_a_skeleton_without_radii_is_a_pipe_model(tmp_path):
    """Keep the sum of squared diameters at forks, or ask for the diameter of the foot."""
    bare = _GRAPH.replace('property float radius\n', '').replace('0 3\n', '').replace(
        'edge 4', 'edge 3')
    for word in (' 0.08', ' 0.09', ' 0.1', ' 0.05'):
        bare = bare.replace(word, '')
    with pytest.raises(GrammarError, match='no radii; give the diameter of the foot'):
        _load(tmp_path / 'tree.ply', bare)
    tips = _load(tmp_path / 'tree.ply', bare, foot_diameter=0.3).visual_size[:, 1]
    np.testing.assert_allclose(tips, [0.3, 0.3 / np.sqrt(2.0), 0.3 / np.sqrt(2.0)])


def test_edges_of_a_skeleton_may_have_the_radii(tmp_path):
    """Take radii of edges where vertices have none."""
    text = _GRAPH.replace('property float radius\n', '', 1).replace(
        'vertex2\n', 'vertex2\nproperty float radius\n')
    for before, after in ((' 0.08', ''), (' 0.09', ''), (' 0.1', ''), (' 0.05', ''),
                          ('0 1\n2 1\n3 1\n0 3\n', '0 1 .08\n2 1 .1\n3 1 .05\n0 3 .01\n')):
        text = text.replace(before, after)
    with pytest.warns(GrammarWarning):
        tree = _load(tmp_path / 'tree.ply', text)
    np.testing.assert_allclose(tree.visual_size[:, 1], [0.2, 0.16, 0.1])


@pytest.mark.parametrize('change, words', [
    (('ascii', 'binary_big_endian'), ':2: the format is "binary_big_endian 1.0"'),
    (('ply\n', 'obj\n'), ': this is no PLY file'),
    (('end_header', 'end'), ': this is no PLY file'),
    (('element edge', 'element face'), ': the elements are vertex, face; a format, vertex '
     'and edge'),
    (('element vertex 4', 'element vertex'), ':3: an element has a name and a number'),
    (('vertex 4', 'vertex 3000000'), ': there are 3000000 rows of vertex, at most 2000000'),
    (('float x', 'quad x'), ':4: a property has a type'),
    (('float z', 'float w'), ': vertices have x, y, w, radius; x, y and z are needed'),
    (('int vertex2', 'int weight'), ': edges have vertex1, weight; vertex1 and vertex2'),
    (('0 0 1 0.09', '0 0 one 0.09'), ':13:5: z is "one", it must be a number'),
    (('0 0 1 0.09', '0 0 1'), ':13: there are 3 numbers, vertex has 4'),
    (('0 0 1 0.09', '0 0 nan 0.09'), ': vertex 1: z is nan'),
    (('0 0 1 0.09', '0 0 1 -0.09'), ': vertex 1: radius is -0.09'),
    (('3 1\n', '3 9\n'), ': edge 2 joins 3 and 9, vertices are 0 to 3'),
    (('3 1\n0 3\n', ''), ':18: the file ends within edge')])
def test_mistakes_in_skeletons_are_told_with_their_place(change, words, tmp_path):
    """Name the line, or the number of the vertex or edge."""
    _refused(tmp_path / 'tree.ply', _GRAPH.replace(*change, 1), words)


@pytest.mark.parametrize('cut', [1, 9])
def test_a_binary_skeleton_that_is_cut_short_is_refused(cut, tmp_path):
    """Read nothing beyond the end of a file."""
    with pytest.raises(GrammarError, match='the file ends within edge'):
        _load(tmp_path / 'tree.ply', _ply(_Oak(), 'binary')[:-cut])


def test_edges_with_three_vertices_are_refused(tmp_path):
    """Tell lists of two from those of faces."""
    whole = _ply(_Oak(), 'list')
    with pytest.raises(GrammarError, match='edge 55 has 3 vertices, it must have two'):
        _load(tmp_path / 'tree.ply', whole[:-9] + b'\3' + whole[-8:])


def _told(path, text: str, **defines: float) -> tuple[Blueprint, str]:
    with pytest.warns(GrammarWarning) as told:
        tree = _load(path, text, **defines)
    assert len(told) == 1 and str(told[0].message).startswith(f'{path}: put right: ')
    return tree, str(told[0].message)


@pytest.mark.parametrize('change, words, count', [
    (('2,1,0,0,1,', '2,1,0.5,0,1,'), '1 gaps bridged (up to 0.5 m)', 3),
    (('2,1,0,0,1,0,0,2', '2,1,0,0,1,0,0,1'), '1 gaps bridged (up to 1 m), 1 cylinders without a '
     'length merged', 2),
    (('0,0,1,0.1', '0,0,1,0.02'), '2 radii capped to those of parents (91.9% of the wood)', 3),
    (('0,0,3,0.08', '0,0,3,0'), '1 radii of about 0 taken as 0.09 m', 3),
    (('2,1,', '2,-1,'), '1 loose pieces left out (40.8% of the wood), moved by '
     '(0.00, 0.00, -1.00) m', 2),
    (('3,2,0,0,2,0,0,3,', '3,-1,1,0,0.01,1,0,1,'), '2 stems stand on the ground', 3)])
def test_defects_are_put_right_and_counted(change, words, count, tmp_path):
    """Tell what was done to each file in one line."""
    tree, said = _told(tmp_path / 'tree.csv', _POLE.replace(*change, 1))
    assert said.endswith(f': put right: {words}')
    assert len(tree) == count and np.isfinite(tree.mass).all() and np.all(tree.mass > 0.0)


def test_a_bridged_cylinder_starts_on_its_parent(tmp_path):
    """Lengthen what starts beside its parent to the axis, and leave what starts on its bark."""
    text = _HEAD + '1,-1,0,0,0,0,0,2,0.1\n2,1,0.09,0,1,1,0,1,0.05\n3,1,0.4,0,1.5,1,0,1.5,0.05\n'
    tree, _ = _told(tmp_path / 'tree.csv', text)
    np.testing.assert_allclose(tree.bond_frame[:, :3], [[0, 0, 0], [0.09, 0, 1], [0, 0, 1.5]],
                               atol=1e-12)
    np.testing.assert_allclose(tree.visual_size[:, 2], [2.0, 0.91, 1.0])


def test_rows_may_be_counted_from_zero(tmp_path):
    """Take the count that fits, where -1 stands for no parent."""
    head = 'parent,startX,startY,startZ,endX,endY,endZ,radius\n'
    rows = ['1,0,0,1,0,0,2,0.09', '-1,0,0,0,0,0,1,0.1', '0,0,0,2,0,0,3,0.08']
    tree, said = _told(tmp_path / 'tree.csv', head + '\n'.join(rows))
    assert said.endswith('put right: 1 cylinders put after their parents')
    np.testing.assert_allclose(tree.visual_size[:, 0], [0.2, 0.18, 0.16])
    rows = [row.replace(row.split(',')[0], str(int(row.split(',')[0]) + 1), 1) for row in rows]
    again, _ = _told(tmp_path / 'tree.csv', head + '\n'.join(rows))
    np.testing.assert_array_equal(again.poses, tree.poses)


def test_units_scale_lengths_and_diameters(tmp_path):
    """Read millimetres, and diameters in another unit than lengths."""
    path = tmp_path / 'tree.csv'
    whole = _load(path, _POLE)
    large = _POLE.replace('0,0,1,0.1', '0,0,1000,100')
    large = large.replace('0,0,1,0,0,2,0.09', '0,0,1000,0,0,2000,90')
    large = large.replace('0,0,2,0,0,3,0.08', '0,0,2000,0,0,3000,80')
    np.testing.assert_allclose(_load(path, large, unit=1e-3).mass, whole.mass)
    np.testing.assert_allclose(_load(path, _POLE, diameter_unit=2.0).mass, 4.0 * whole.mass)


def test_leaves_have_the_area_that_is_asked_for(tmp_path):
    """Spread leaves by length on thin twigs, the same for a seed, carried by what is left."""
    path = tmp_path / 'oak.csv'
    path.write_text(_simple_forest(_Oak()))
    scan = ScannedTree.load(path)
    with pytest.warns(GrammarWarning) as told:
        tree = scan.build(seed=5, leaf_area=40.0, leaf_below=0.06)
        again = scan.build(seed=5, leaf_area=40.0, leaf_below=0.06, twig=0.06)
    assert len(told) == 1  # of the file, not of each tree
    leaves = tree.leaves
    assert len(leaves.part) == 4000 and tree.leaf_area.sum() == pytest.approx(40.0)
    assert np.all(tree.visual_size[leaves.part, 0] < 0.06)
    np.testing.assert_array_equal(leaves.pose, scan.build(
        seed=5, leaf_area=40.0, leaf_below=0.06).leaves.pose)
    assert not np.array_equal(leaves.pose, scan.build(
        seed=6, leaf_area=40.0, leaf_below=0.06).leaves.pose)
    thin = tree.visual_size[:, 0] < 0.06
    per_length = np.bincount(leaves.part, minlength=len(tree))[thin] / tree.visual_size[thin, 2]
    assert np.ptp(per_length) < 0.2 * per_length.mean()
    assert np.all(np.abs(leaves.pose[:, 2]) <= 0.5 * tree.visual_size[leaves.part, 2] + 1e-9)
    assert len(again) == np.count_nonzero(~thin) < len(tree)
    places = [rotation.compose(one.poses[one.leaves.part], one.leaves.pose)[:, :3]
              for one in (tree, again)]
    np.testing.assert_allclose(*places, atol=1e-9)


@pytest.mark.parametrize('defines, words', [
    ({'densty': 3.0}, r'unknown define "densty"; did you mean density\? \(defines: unit, '),
    ({'density': 0.0}, 'define "density" is 0, it must be above 0'),
    ({'damping': -1.0}, 'define "damping" is -1, it must be not below 0'),
    ({'preload': 2.0}, 'define "preload" is 2, it must be not below 0 and at most 1'),
    ({'unit': float('nan')}, 'define "unit" must be a finite number'),
    ({'twig': 0.5}, 'define "twig" is 0.5, but the foot is 0.2 m thick'),
    ({'leaf_area': 9.0}, 'define "leaf_below" is 0.02, but no twig is thinner than 0.16 m'),
    ({'leaf_area': 9e9, 'leaf_below': 1.0}, 'these are 900000000000 leaves of leaf_size'),
    ({'unit': 1e-6}, 'no cylinder is longer than 0.0001 m; is the unit right')])
def test_defines_are_checked(defines, words, tmp_path):
    """Refuse what is unknown or impossible, with near names."""
    with pytest.raises(GrammarError, match=words):
        _load(tmp_path / 'tree.csv', _POLE, **defines)


def test_wood_and_roots_are_those_of_the_defines(tmp_path):
    """Hand values on to the joints."""
    tree = _load(tmp_path / 'tree.csv', _POLE, density=500.0, modulus=1e9, strength=3e7,
                 damping=0.1, preload=0.5, root_stiffness=1e5, root_moment=2e4)
    plain = _load(tmp_path / 'tree.csv', _POLE)
    np.testing.assert_allclose(tree.mass, plain.mass * 500.0 / 900.0)
    np.testing.assert_allclose(tree.hinges.swing_stiffness[1:],
                               plain.hinges.swing_stiffness[1:] / 8.0)
    assert tree.hinges.swing_stiffness[0] < 1e5 < plain.hinges.swing_stiffness[0]
    assert tree.hinges.root_moment.tolist() == [2e4, np.inf, np.inf]
    assert set(tree.hinges.strength) == {3e7} and set(tree.hinges.preload) == {0.5}


def test_large_files_are_bounded(tmp_path, monkeypatch):
    """Read 10,000 cylinders; refuse more rows or bytes than allowed."""
    count, rng = 10_000, np.random.default_rng(1)
    parent = np.maximum(np.arange(count) - rng.integers(1, 40, count), -1)
    parent[1:] = np.maximum(parent[1:], 0)
    start, end = np.zeros((count, 3)), np.zeros((count, 3))
    step = rng.normal([0.0, 0.0, 0.05], 0.05, (count, 3))
    for i, above in enumerate(parent.tolist()):
        start[i] = end[above] if above >= 0 else 0.0
        end[i] = start[i] + step[i]
    path = tmp_path / 'large.csv'
    rows = (f'{i},{above},{a},{b},{c},{d},{e},{f},0.01' for i, above, (a, b, c), (d, e, f) in
            zip(range(count), parent.tolist(), start.tolist(), end.tolist()))
    path.write_text(_HEAD + '\n'.join(rows))
    assert len(ScannedTree.load(path).build()) == count
    monkeypatch.setattr(scan_file, 'MAX_CYLINDERS', 9_999)
    with pytest.raises(GrammarError, match='there are 10000 cylinders, at most 9999 are read'):
        ScannedTree.load(path)
    monkeypatch.setattr(scan_file, '_LARGEST_FILE', 100_000)
    with pytest.raises(GrammarError, match='the file has more than 100000 bytes'):
        ScannedTree.load(path)


def test_what_is_no_text_is_refused(tmp_path):
    """Name the line, or what the system says."""
    with pytest.raises(GrammarError, match='tree.csv:2: cannot read the tree: this is no UTF-8'):
        _load(tmp_path / 'tree.csv', b'radius\n\xff')
    with pytest.raises(GrammarError, match='cannot read the tree: No such file'):
        ScannedTree.load(tmp_path / 'gone.csv')
    with pytest.raises(GrammarError, match='the seed is -1'):
        _load(tmp_path / 'tree.csv', _POLE, seed=-1)


def test_a_scene_takes_a_scan_wherever_a_grammar_is_named(tmp_path, monkeypatch):
    """Plant, spawn, sweep, and line streets with scans as with grammars, within file bounds."""
    (tmp_path / 'my.csv').write_text(_POLE)
    whole = _PLANT.replace('^<N3<N4', '^<N4').replace('\t1\t\n', '\t1\t0.15\n')
    (tmp_path / 'my.mtg').write_text(whole)
    (tmp_path / 'my.plan').write_text(
        'streets:\n  high: {from: [0, 0], to: [60, 0], width: 6}\ntrees:\n'
        '  - {street: high, side: left, grammars: [my.csv, my.mtg], spacing: 20, offset: 2}\n')
    (tmp_path / 'my.yaml').write_text(
        '/**: {ros__parameters: {scene: {objects: [a, b]}, a: {grammar: my.csv, count: 4, '
        'variants: 2, defines: [density=500]}, b: {grammar: my.plan, origin: [0, 50, 0]}}}\n')
    scene = Scene.from_yaml(tmp_path / 'my.yaml')
    assert [one.count for one in scene.objects[:4]] == [3] * 4 and len(scene.objects) > 6
    simulation = Simulation(scene)
    simulation.step(5)
    assert np.isfinite(simulation.poses).all()
    monkeypatch.chdir(tmp_path)
    assert len(Spawn(grammar='my.csv', defines=('strength=1e7',)).build()) == 3
    assert len(open_scene('my.mtg', 3, {'density': 700.0}).blueprint) == 3
    before = Sweep.read(tmp_path / 'my.yaml', [], 1, 1.0).digest
    (tmp_path / 'my.mtg').write_text(_PLANT)  # named by the plan only
    assert Sweep.read(tmp_path / 'my.yaml', [], 1, 1.0).digest != before
    (tmp_path / 'other').mkdir()
    with (within(FileBounds((tmp_path / 'other',), {})),
          pytest.raises(SceneError, match='outside of the folders that files.root allows')):
        load_grammar(str(tmp_path / 'my.csv'), 'tree.grammar')


def test_a_scan_is_drawn(tmp_path):
    """Draw a file with the command, defines included."""
    (tmp_path / 'my.csv').write_text(_POLE)
    out = tmp_path / 'my.png'
    assert render([str(tmp_path / 'my.csv'), '--out', str(out), '--size', '64x48',
                   '--define', 'leaf_area=1', '--define', 'leaf_below=1']) == 0
    assert out.stat().st_size > 500
