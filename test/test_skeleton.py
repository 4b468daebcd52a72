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

"""Skeletons: bones, joints and stiffness from explicit branches, and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from procphys_ros.blueprint import Leaves, skeleton
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation


def _fork() -> dict:
    """Describe a trunk of two segments with a side branch that leaves at the middle node."""
    return {'nodes': [[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 1]], 'parents': [-1, 0, 1, 1],
            'radii': [0.1, 0.09, 0.08, 0.04]}


def _branches(count: int = 3, **changes: np.ndarray) -> skeleton.Branches:
    """Build a straight vertical axis of equal segments."""
    ones = np.ones(count)
    base = np.zeros((count, 3))
    base[:, 2] = 0.5 * np.arange(count)
    columns = {
        'parent': np.arange(count) - 1, 'lateral': np.zeros(count, bool), 'base': base,
        'attitude': np.tile(rotation.IDENTITY, (count, 1)), 'length': 0.5 * ones,
        'width': 0.1 * ones, 'tip_width': 0.1 * ones, 'density': 800.0 * ones,
        'modulus': 8e9 * ones, 'strength': 60e6 * ones, 'bone_ratio': 0.9 * ones,
        'swing_limit': ones, 'swing_stiffness': np.nan * ones, 'swing_damping': np.nan * ones,
        'damping_ratio': 0.05 * ones, 'twist_stiffness': np.nan * ones,
        'twist_damping': np.nan * ones, 'stretch_stiffness': np.nan * ones,
        'stretch_damping': np.nan * ones, 'break_force': np.inf * ones,
        'break_torque': np.inf * ones, 'root_stiffness': np.nan * ones,
        'root_moment': np.inf * ones, 'preload': ones, 'texture': np.zeros(count, np.int16),
        'cling': 0.0 * ones}
    return skeleton.Branches(**{**columns, **changes})


def test_joint_stiffness_follows_beam_theory():
    """Expect E·I/L between equal segments and 2·E·I/L where a beam is clamped."""
    beam = 8e9 * np.pi * 0.1 ** 4 / 64 / 0.5
    stiffness = skeleton.build(_branches()).hinges.swing_stiffness
    assert np.allclose(stiffness, [2 * beam, beam, beam], rtol=1e-12)


def test_tapered_halves_are_integrated():
    """Compare with a numerical integral of 1/(E·I) over the half segments beside a joint."""
    width, tip = np.array([0.1, 0.06]), np.array([0.06, 0.02])
    stiffness = skeleton.build(_branches(2, width=width, tip_width=tip)).hinges.swing_stiffness
    along = (np.arange(20000) + 0.5) / 20000
    bend = [(64.0 / (8e9 * np.pi * (a + (b - a) * along) ** 4) * 0.5 / 20000)
            for a, b in zip(width, tip)]
    assert stiffness[0] == pytest.approx(1.0 / bend[0][:10000].sum(), rel=1e-6)
    assert stiffness[1] == pytest.approx(
        1.0 / (bend[0][10000:].sum() + bend[1][:10000].sum()), rel=1e-6)


def test_a_tip_that_ends_in_a_point_bends_like_one_that_nearly_does():
    """Taper the last segment to nothing: its joint is not as stiff as that of a cylinder."""
    sharp, blunt = (skeleton.build(_branches(2, width=np.full(2, 0.1), tip_width=np.array(
        [0.1, tip]))).hinges.swing_stiffness for tip in (0.0, 1e-9))
    assert sharp == pytest.approx(blunt, rel=1e-6)


def test_a_cone_keeps_mass_and_centre_of_mass():
    """Cut a cone into segments: total mass and its moment about the ground are the cone's."""
    ends = np.linspace(0.3, 0.0, 6)
    tree = skeleton.build(_branches(5, width=ends[:-1], tip_width=ends[1:]))
    cone = 800.0 * np.pi / 12.0 * 0.3 ** 2 * 2.5
    assert tree.mass.sum() == pytest.approx(cone)
    first = 800.0 * np.pi / 4.0 * 0.5 * (ends[0] ** 2 + ends[0] * ends[1] + ends[1] ** 2) / 3.0
    off = 0.5 * (0.5 - (ends[0] ** 2 + 2.0 * ends[0] * ends[1] + 3.0 * ends[1] ** 2) / (
        4.0 * (ends[0] ** 2 + ends[0] * ends[1] + ends[1] ** 2)))  # nothing below takes this over
    moment = tree.mass @ tree.poses[:, 2] - first * off
    assert moment == pytest.approx(cone * 2.5 / 4.0)


@pytest.mark.parametrize('factor', [0.3, 1.3, 2.0, 3.0, 20.0])
def test_what_widens_leaves_mass_below(factor):
    """Let segments grow thicker upwards: none loses all its mass, and the whole keeps it."""
    ends = 0.1 * factor ** np.arange(5)
    tree = skeleton.build(_branches(4, width=ends[:-1], tip_width=ends[1:]))
    own = 800.0 * np.pi / 12.0 * 0.5 * (
        ends[:-1] ** 2 + ends[:-1] * ends[1:] + ends[1:] ** 2)
    assert tree.mass.sum() == pytest.approx(own.sum())
    assert (tree.mass > 0.2 * own).all()
    assert (tree.inertia > 0.0).all()


def test_a_root_plate_gives_way_in_series():
    """Add the flexibility of the ground to that of the lowest half segment."""
    rigid, soft = (skeleton.build(_branches(2, root_stiffness=np.full(2, k))).hinges
                   for k in (np.nan, 3e4))
    assert soft.swing_stiffness[0] == pytest.approx(1.0 / (1.0 / 3e4
                                                           + 1.0 / rigid.swing_stiffness[0]))
    assert soft.swing_stiffness[1] == rigid.swing_stiffness[1]
    given = skeleton.build(_branches(2, root_stiffness=np.full(2, 3e4),
                                     swing_stiffness=np.full(2, 6e4))).hinges.swing_stiffness
    assert given == pytest.approx([2e4, 6e4])


def test_side_branch_is_clamped_on_its_parent():
    """Expect a lateral start to bend over its own half only, twist and stretch locked."""
    hinges = skeleton.build(_branches(lateral=np.array([False, False, True]))).hinges
    assert np.isclose(hinges.swing_stiffness[2], hinges.swing_stiffness[0])
    assert np.isinf(hinges.twist_stiffness).all() and np.isinf(hinges.stretch_stiffness).all()


def test_given_stiffness_is_kept():
    """Expect numbers of the grammar to win over beam theory."""
    given = np.array([5.0, np.nan, 7.0])
    hinges = skeleton.build(_branches(swing_stiffness=given, twist_stiffness=given)).hinges
    assert hinges.swing_stiffness[0] == 5.0 and hinges.swing_stiffness[2] == 7.0
    assert list(hinges.twist_stiffness) == [5.0, np.inf, 7.0]


def test_parts_weigh_as_cylinders_with_leaves():
    """Expect mass from density, width, full length and leaf area."""
    leaves = Leaves(part=np.array([2, 2]), pose=np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1)),
                    size=np.array([0.2, 0.1]), texture=np.zeros(2, np.int16))
    blueprint = skeleton.build(_branches(), leaves)
    wood = 800.0 * np.pi / 4 * 0.1 ** 2 * 0.5
    assert np.allclose(blueprint.leaf_area, [0, 0, 0.05])
    assert np.allclose(blueprint.mass,
                       wood + skeleton.LEAF_AREAL_DENSITY * np.array([0, 0, 0.05]))
    assert np.allclose(blueprint.size, [0.1, 0.1, 0.45])
    assert np.allclose(blueprint.poses[:, 2], [0.25, 0.75, 1.25])


def test_stout_bone_keeps_its_length():
    """Expect a segment thicker than long to get a ball no longer than its bone."""
    size = skeleton.build(_branches(width=np.full(3, 0.7), tip_width=np.full(3, 0.7))).size
    assert np.allclose(size, 0.45)


def test_nodes_become_segments():
    """Expect bonds, side branches, widths and attitudes from nodes and parents."""
    blueprint = skeleton.from_nodes(**_fork())
    assert blueprint.bonds.tolist() == [[-1, 0], [0, 1], [0, 2]]
    assert np.allclose(blueprint.visual_size[:, 0], [0.2, 0.18, 0.08])
    assert np.allclose(blueprint.visual_size[:, 1], [0.18, 0.16, 0.08])
    axis = rotation.rotate(blueprint.poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    assert np.allclose(axis, [[0, 0, 1], [0, 0, 1], [1, 0, 0]])
    assert np.allclose(blueprint.bond_frame[:, :3], [[0, 0, 0], [0, 0, 1], [0, 0, 1]])


def test_segment_may_hang_straight_down():
    """Expect a finite attitude for the direction opposite to z."""
    poses = skeleton.from_nodes([[0, 0, 2], [0, 0, 1]], [-1, 0], [0.1, 0.1]).poses
    assert np.allclose(rotation.rotate(poses[:, 3:], np.array([0.0, 0.0, 1.0])), [0, 0, -1])


def test_several_roots_stand_side_by_side():
    """Expect one clamped tree per node without a parent."""
    blueprint = skeleton.from_nodes([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]], [-1, -1, 0, 1],
                                    [0.1] * 4)
    assert blueprint.bonds.tolist() == [[-1, 0], [-1, 1]]


def _grown(rng: np.random.Generator, count: int) -> dict:
    """Grow a random tree of `count` nodes, with its own wood in every segment, and leaves."""
    parents = np.array([-1, *(rng.integers(0, node) for node in range(1, count))])
    nodes = np.zeros((count, 3))
    for node in range(1, count):
        nodes[node] = nodes[parents[node]] + rng.uniform(0.1, 1.0, 3)
    part = rng.integers(1, count, 5)
    return {'nodes': nodes, 'parents': parents, 'radii': rng.uniform(0.01, 0.1, count),
            'density': rng.uniform(500, 1000, count), 'modulus': rng.uniform(5e9, 9e9, count),
            'strength': rng.uniform(3e7, 6e7, count), 'root_stiffness': np.full(count, 5e4),
            'root_moment': 900.0, 'leaves': Leaves(
                part=part, pose=np.tile([0, 0, 0.1, 0, 0, 0, 1.0], (5, 1)),
                size=rng.uniform(0.1, 0.3, 5), texture=np.ones(5, np.int16))}


@pytest.mark.parametrize('seed', range(8))
def test_nodes_may_have_any_order(seed: int):
    """Shuffle the nodes of a random tree: every part, its wood, joint and leaves are the same."""
    rng = np.random.default_rng(seed)
    given = _grown(rng, 12)
    place = rng.permutation(12)  # of each node in the shuffled order
    back = np.argsort(place)
    parents = np.where(given['parents'][back] < 0, -1, place[given['parents'][back]])
    shuffled = {name: value[back] if isinstance(value, np.ndarray) else value
                for name, value in given.items()} | {'parents': parents, 'leaves': replace(
                    given['leaves'], part=place[given['leaves'].part])}
    one, other = skeleton.from_nodes(**given), skeleton.from_nodes(**shuffled)
    mine = skeleton.segments_of(given['parents'])
    theirs = skeleton.segments_of(parents)[place]
    assert mine.tolist() == [-1, *range(11)] and sorted(theirs) == sorted(mine)
    mine, theirs = mine[1:], theirs[1:]
    assert (other.bonds[:, 0] < other.bonds[:, 1]).all()
    for name in ('poses', 'size', 'visual_size', 'density', 'mass', 'inertia', 'leaf_area',
                 'bond_frame', 'bond_area'):
        np.testing.assert_allclose(getattr(other, name)[theirs], getattr(one, name)[mine],
                                   rtol=1e-12, err_msg=name)
    for name, column in vars(one.hinges).items():
        np.testing.assert_allclose(getattr(other.hinges, name)[theirs], column[mine], rtol=1e-12,
                                   err_msg=name)
    assert np.array_equal(theirs[one.leaves.part], other.leaves.part)


def test_wood_may_differ_from_node_to_node():
    """Set the wood of every node: a segment has that of its end, the first the root plate too."""
    given = {**_fork(), 'density': np.array([1.0, 700, 800, 900]), 'root_stiffness': 3e4,
             'modulus': np.array([1.0, 6e9, 7e9, 8e9]), 'strength': [9.0, 3e7, 4e7, 5e7],
             'root_moment': 400.0}
    grown = skeleton.from_nodes(**given)
    assert grown.density.tolist() == [700, 800, 900]
    assert grown.hinges.strength.tolist() == [3e7, 4e7, 5e7]
    assert grown.hinges.root_moment.tolist() == [400.0, np.inf, np.inf]
    rigid = skeleton.from_nodes(**{**given, 'root_stiffness': np.nan})
    assert grown.hinges.swing_stiffness[0] == pytest.approx(
        1 / (1 / 3e4 + 1 / rigid.hinges.swing_stiffness[0]))


@pytest.mark.parametrize('column, value, words', [
    ('width', -0.1, 'segment 1: width is -0.1'), ('length', 0.0, 'segment 1: length is 0.0'),
    ('density', np.nan, 'segment 1: density is nan'), ('modulus', np.inf, 'modulus is inf'),
    ('bone_ratio', 1.5, 'bone ratio'), ('swing_stiffness', 0.0, 'swing stiffness'),
    ('twist_stiffness', -1.0, 'twist stiffness'), ('swing_damping', -1.0, 'swing damping'),
    ('damping_ratio', np.nan, 'damping ratio'), ('strength', 0.0, 'strength'),
    ('tip_width', -1.0, 'tip width'), ('parent', 1, 'segment 1: parent is 1'),
    ('attitude', np.nan, 'attitude'), ('preload', 1.5, 'preload'),
    ('cling', -1.0, 'cling'),
    ('root_stiffness', 0.0, 'root stiffness'), ('root_moment', 0.0, 'root moment'),
])
def test_impossible_segments_are_refused(column: str, value: float, words: str):
    """Expect the first bad segment, its value and the remedy in the message."""
    branches = _branches()
    bad = getattr(branches, column).copy()
    bad[1] = value
    with pytest.raises(SceneError, match=words):
        skeleton.build(replace(branches, **{column: bad}))


@pytest.mark.parametrize('changes, words', [
    ({'radii': [0.1, 0.0, 0.1, 0.1]}, 'node 1: radius'),
    ({'parents': [-1, 2, 1, 1]}, 'node 1: parent is 2'),
    ({'nodes': [[0, 0, 0], [0, 0, 0], [0, 0, 2], [1, 0, 1]]}, 'node 1: distance'),
    ({'radii': 0.1}, 'do not fit'), ({'radii': np.ones((4, 1))}, 'do not fit'),
    ({'leaves': Leaves(np.ones(1, int), np.zeros((1, 7)), np.full(1, np.nan), np.ones(1, int))},
     'leaf 0: size is nan'),
    ({'leaves': Leaves(np.ones(1, int), np.full((1, 7), np.nan), np.ones(1), np.ones(1, int))},
     'leaf 0: pose'),
    ({'radii': [0.1]}, 'do not fit'), ({'parents': [-1, 0, 4, 1]}, 'node 2: parent is 4'),
    ({'parents': [-1.0, 0, 1, 1]}, 'float64'), ({'parents': [-1, 0, 2, 1]}, 'node 2: distance'),
    ({'density': [900.0] * 3}, r'density has the shape \(3,\)'),
    ({'density': [1.0, 900, -5, 900]}, 'segment 1: density is -5'),
    ({'leaves': Leaves(np.zeros(1, int), np.zeros((1, 7)), np.ones(1), np.ones(1, int))},
     'leaf 0: node is 0'),
    ({'leaves': Leaves(np.full(1, 7), np.zeros((1, 7)), np.ones(1), np.ones(1, int))},
     'leaf 0: node is 7'),
])
def test_impossible_nodes_are_refused(changes: dict, words: str):
    """Expect the first bad node in the message."""
    with pytest.raises(SceneError, match=words):
        skeleton.from_nodes(**{**_fork(), **changes})


def test_leaf_on_a_missing_segment_is_refused():
    """Expect the leaf and the allowed range in the message."""
    leaf = Leaves(part=np.array([3]), pose=np.zeros((1, 7)), size=np.ones(1),
                  texture=np.zeros(1, np.int16))
    with pytest.raises(SceneError, match='leaf 0: part is 3, but must be a segment, 0 to 2'):
        skeleton.build(_branches(), leaf)
