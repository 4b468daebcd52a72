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


"""
Contact exclusions: pieces of trees that overlapped when they came off, until they are apart.

Branches of one tree pass through each other, and so do the crowns of different standing trees.
What comes off meets both from then on; where it is inside of them then, contact would throw it
out, with energy from nothing.

Segments and rigid bodies are excluded in pairs, see `colliders`: a body takes part with all its
parts, since engines exclude whole bodies, and a pair is kept as long as any of them overlap.
"""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.touch import capsule_bounds, meet, overlaps, piece_bounds
from procphys_ros.physics.trees.state import SegmentJoint
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_TREE, _FREE = int(Owner.TREE), int(SegmentJoint.FREE)  # numba does not read enums
_HALF = 32  # bits of one of the two numbers of a key


def update(model: Model, state: State) -> None:
    """End the exclusion of pieces that are apart; writes `state.excluded`, updates the engine."""
    if not len(state.excluded):
        state.world.exclude_contacts(state.excluded)
        return
    here = (state.parts.owner[state.excluded] != Owner.GONE).all(axis=1)
    pairs = _distinct(colliders(state, state.excluded[here]))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    names, place = np.unique(pairs, return_inverse=True)
    carried = [state.bodies.parts_of(~name) for name in names[names < 0].tolist()]
    parts = np.concatenate([*carried, names[names >= 0]])
    start = np.zeros(len(names) + 1, np.intp)
    start[1:] = np.cumsum([*map(len, carried), *np.ones(len(names) - len(carried), np.intp)])
    first, second = _between(place.reshape(-1, 2), start)
    inside = _which_overlap(state, parts, first, second)
    state.excluded = np.column_stack([parts[first[inside]], parts[second[inside]]])
    pairs = colliders(state, state.excluded)
    bodies = ~pairs[(pairs < 0).all(axis=1)]
    state.world.exclude_contacts(_distinct(np.sort(bodies, axis=1)))


def _distinct(pairs: np.ndarray) -> np.ndarray:
    """Return the distinct pairs, in lexicographic order, (K, 2)."""
    keys = np.unique((pairs[:, 0] << _HALF) + (pairs[:, 1] + (1 << _HALF - 1)))
    return np.column_stack([keys >> _HALF, (keys & (1 << _HALF) - 1) - (1 << _HALF - 1)])


@kernel
def _between(pairs, start):
    """
    List all pairs of a member of one collider and a member of another.

    :param pairs: of colliders, (K, 2).
    :param start: first place of the members of each, and the end of the last.
    :returns: places of the members, (P,) each.
    """
    total = 0
    for a, b in pairs:
        total += (start[a + 1] - start[a]) * (start[b + 1] - start[b])
    first, second = np.empty(total, np.int64), np.empty(total, np.int64)
    count = 0
    for a, b in pairs:
        for i in range(start[a], start[a + 1]):
            for j in range(start[b], start[b + 1]):
                first[count], second[count] = i, j
                count += 1
    return first, second


def add_branch(state: State, row: int, sizes: np.ndarray) -> None:
    """
    Exclude the overlaps of a branch from contact; call this before it comes off.

    :param row: of the forest, the first one of the branch.
    :param sizes: of the segments [m], (S, 3).
    """
    forest = state.forest
    rows = forest.subtree(row)
    others, bounds, around = _passed_near(rows, forest.parents, forest.active, forest.model.joint,
                                          forest.poses, forest.velocities, sizes)
    own, other = overlaps(bounds, around)
    found = _overlapping(state, forest.parts[rows[own]], forest.parts[others[other]])
    state.excluded = np.concatenate([state.excluded, found])


@kernel
def _passed_near(branch, parents, active, joint, poses, velocities, sizes):
    """
    List the segments near a branch that it has passed through up to now.

    These are the others of its tree and, if it stands, those of all standing trees.

    :param branch: rows that come off, the first one first, (K,).
    :param parents: parent of each row, -1 for roots; parents come first, (S,).
    :param active: simulated rows, (S,) bool.
    :param joint: `SegmentJoint` of each row, (S,).
    :param poses: (S, 7); `velocities` (S, 6) and `sizes` (S, 3) likewise.
    :returns: their rows, (P,), and the bounds of the branch, (K, 6), and of these, (P, 6).
    """
    bounds = capsule_bounds(branch, poses, sizes, velocities, 0.0, 0.0)
    low, high = bounds[0, :3].copy(), bounds[0, 3:].copy()
    for k in range(len(branch)):
        low, high = np.minimum(low, bounds[k, :3]), np.maximum(high, bounds[k, 3:])
    room = sizes.max()
    low, high = low - room, high + room
    mine = _root(branch[0], parents)
    meets = np.zeros(len(parents), np.bool_)
    for i in range(len(parents)):
        if (active[i] and low[0] < poses[i, 0] < high[0] and low[1] < poses[i, 1] < high[1]
                and low[2] < poses[i, 2] < high[2]):
            root = _root(i, parents)
            meets[i] = root == mine or not (joint[mine] == _FREE or joint[root] == _FREE)
    meets[branch] = False
    others = np.flatnonzero(meets)
    return others, bounds, capsule_bounds(others, poses, sizes, velocities, 0.0, 0.0)


@subroutine
def _root(row, parents):
    """Return the first row of the tree of a row."""
    while parents[row] >= 0:
        row = parents[row]
    return row


def add_split(state: State, pieces: list[np.ndarray]) -> None:
    """
    Exclude overlapping pieces of a rigid branch from contact; bricks are not excluded.

    :param pieces: parts of each, (P,).
    """
    wood = [parts[state.parts.shape[parts] == Shape.CAPSULE] for parts in pieces]
    for i, own in enumerate(wood):
        others = np.concatenate([np.zeros(0, np.intp), *wood[i + 1:]])
        if not len(own) or not len(others):
            continue
        found = _overlapping(state, np.repeat(own, len(others)), np.tile(others, len(own)))
        state.excluded = np.concatenate([state.excluded, found])


def add_mechanisms(state: State, groups: Sequence[np.ndarray]) -> None:
    """
    Exclude the overlaps of loose parts of the same group from contact.

    :param groups: parts of each, ascending, (P,).
    """
    own = state.parts
    for parts in groups:
        bounds = piece_bounds(own.shape[parts], own.poses[parts], own.solid_size[parts],
                              np.zeros((len(parts), 6)), 0.0, 0.0)
        one, other = overlaps(bounds, bounds)
        once = one < other
        add_parted(state, np.column_stack([parts[one[once]], parts[other[once]]]))


def add_parted(state: State, pairs: np.ndarray) -> None:
    """Exclude pairs of parts from contact that overlap, (K, 2)."""
    found = _overlapping(state, pairs[:, 0].astype(np.intp), pairs[:, 1].astype(np.intp))
    state.excluded = np.concatenate([state.excluded, found])


def colliders(state: State, parts: np.ndarray) -> np.ndarray:
    """Return the colliders of parts of any shape: themselves, or ~id of their body."""
    return np.where(state.parts.owner[parts] == Owner.BODY, ~state.parts.body[parts], parts)


def _overlapping(state: State, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Select the pairs of parts that overlap, (K, 2)."""
    place = np.arange(2 * len(first))
    inside = _which_overlap(state, np.concatenate([first, second], dtype=np.intp),
                            place[:len(first)], place[len(first):])
    return np.column_stack([first[inside], second[inside]])


def _which_overlap(state: State, chosen: np.ndarray, one: np.ndarray,
                   other: np.ndarray) -> np.ndarray:
    """Return the places of the overlapping pairs of chosen parts, ascending, (K,)."""
    parts = state.parts
    poses, sizes, shapes, near = _near(
        chosen, one, other, parts.owner, parts.row, parts.poses, state.forest.poses,
        parts.solid_size, parts.shape)
    still = np.zeros((len(chosen), 6))
    found = meet(one[near], poses, sizes, still, other[near], shapes, poses, sizes, still, 0.0)
    inside = np.zeros(len(near), bool)
    inside[found.pair[found.gap < 0.0]] = True
    return near[inside]


@kernel
def _near(chosen, one, other, owner, row, poses, forest_poses, sizes, shapes):
    """
    Return the present poses of some parts, and the pairs of overlapping bounds.

    :param chosen: parts, (K,); one, other: pairs of these, (P,) each.
    :param owner: `Owner` of all parts, (N,); `row` (N,), `poses` (N, 7), `sizes` (N, 3) and
        `shapes` (N,) likewise.
    :param forest_poses: of the rows of the forest, (S, 7); `poses` may be older.
    :returns: poses (K, 7), sizes (K, 3) and shapes (K,) of the chosen, and places of the pairs.
    """
    place = poses[chosen]
    for k in range(len(chosen)):
        if owner[chosen[k]] == _TREE:
            place[k] = forest_poses[row[chosen[k]]]
    size, shape = sizes[chosen], shapes[chosen]
    bounds = piece_bounds(shape, place, size, np.zeros((len(chosen), 6)), 0.0, 0.0)
    found = np.zeros(len(one), np.bool_)
    for n in range(len(one)):
        a, b = bounds[one[n]], bounds[other[n]]
        found[n] = (a[0] < b[3] and a[1] < b[4] and a[2] < b[5]
                    and b[0] < a[3] and b[1] < a[4] and b[2] < a[5])
    return place, size, shape, np.flatnonzero(found)
