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

"""Tests of torn wood: what is drawn where trees have come apart."""

from dataclasses import replace
from types import SimpleNamespace

from grown_trees import beam
import numpy as np
import pytest

from procphys_ros import messages
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
from procphys_ros.blueprint import Blueprint, GROUND
from procphys_ros.geometry import rotation
from procphys_ros.recording.marker_state import find_markers
from procphys_ros.view.source import Frame, PageContent
from procphys_ros.view.torn_meshes import TornMeshes

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
