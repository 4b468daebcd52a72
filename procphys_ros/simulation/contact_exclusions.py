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

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel
from procphys_ros.physics.touch import capsule_bounds, meet, overlaps, piece_bounds
from procphys_ros.simulation.model import Model
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import State

_HALF = 32  # bits of one of the two numbers that a key is made of


def update(model: Model, state: State) -> None:
    """Let pieces that are apart by now meet; writes `state.excluded` and tells the engine."""
    if not len(state.excluded):
        state.world.exclude_contacts(state.excluded)
        return
    here = (state.parts.owner[state.excluded] != Owner.GONE).all(axis=1)
    pairs = _distinct(colliders(state, state.excluded[here]))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    names, place = np.unique(pairs, return_inverse=True)
    members = [_members(state, name) for name in names.tolist()]
    parts = np.concatenate([np.zeros(0, np.intp), *members])
    start = np.cumsum([0, *(len(own) for own in members)])
    first, second = _between(place.reshape(-1, 2), start)
    inside = _which_overlap(state, parts, first, second)
    state.excluded = np.column_stack([parts[first[inside]], parts[second[inside]]])
    pairs = colliders(state, state.excluded)
    bodies = ~pairs[(pairs < 0).all(axis=1)]
    state.world.exclude_contacts(_distinct(np.sort(bodies, axis=1)))


def _distinct(pairs: np.ndarray) -> np.ndarray:
    """Give each pair once, in lexicographic order, (K, 2)."""
    keys = np.unique((pairs[:, 0] << _HALF) + (pairs[:, 1] + (1 << _HALF - 1)))
    return np.column_stack([keys >> _HALF, (keys & (1 << _HALF) - 1) - (1 << _HALF - 1)])


@kernel
def _between(pairs, start):
    """
    List all pairs of a member of one collider and one of another.

    :param pairs: of colliders, (K, 2).
    :param start: where the members of each begin, and the end of the last.
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


def add_branch(model: Model, state: State, row: int) -> None:
    """
    Exclude what a branch is inside of; call this before it comes off.

    :param row: of the forest, the first one of the branch.
    """
    forest, sizes = state.forest, model.trees.sizes
    rows = forest.subtree(row)
    bounds = capsule_bounds(rows, forest.poses, sizes, forest.velocities, 0.0, 0.0)
    room = sizes.max()
    others = _passed_near(rows, forest.parents, forest.active,
                          forest.is_free(np.arange(len(forest))), forest.poses,
                          bounds[:, :3].min(axis=0) - room, bounds[:, 3:].max(axis=0) + room)
    own, other = overlaps(bounds, capsule_bounds(others, forest.poses, sizes, forest.velocities,
                                                 0.0, 0.0))
    found = _overlapping(state, forest.parts[rows[own]], forest.parts[others[other]])
    state.excluded = np.concatenate([state.excluded, found])


@kernel
def _passed_near(branch, parents, active, free, poses, low, high):
    """
    List the segments between two corners that a branch has passed through up to now.

    These are the others of its tree and, if that stands, those of all trees that stand.

    :param branch: rows that come off, the first one first, (K,).
    :param parents: row that each row hangs on, -1 for roots; parents stand first, (S,).
    :param active: rows that are moved, (S,) bool.
    :param free: root rows of trees that came off, (S,) bool.
    :param poses: (S, 7).
    :param low, high: corners [m], (3,).
    """
    root = np.arange(len(parents))
    mine = branch[0]
    while parents[mine] >= 0:
        mine = parents[mine]
    meets = np.zeros(len(parents), np.bool_)
    for i in range(len(parents)):
        if parents[i] >= 0:
            root[i] = root[parents[i]]
        if active[i] and (root[i] == mine or not (free[mine] or free[root[i]])):
            meets[i] = (low[0] < poses[i, 0] < high[0] and low[1] < poses[i, 1] < high[1]
                        and low[2] < poses[i, 2] < high[2])
    meets[branch] = False
    return np.flatnonzero(meets)


def add_split(state: State, pieces: list[np.ndarray]) -> None:
    """
    Exclude the pieces of a rigid branch that are inside of each other; bricks are not.

    :param pieces: parts of each, (P,).
    """
    wood = [parts[state.parts.shape[parts] == Shape.CAPSULE] for parts in pieces]
    for i, own in enumerate(wood):
        others = np.concatenate([np.zeros(0, np.intp), *wood[i + 1:]])
        if not len(own) or not len(others):
            continue
        found = _overlapping(state, np.repeat(own, len(others)), np.tile(others, len(own)))
        state.excluded = np.concatenate([state.excluded, found])


def colliders(state: State, parts: np.ndarray) -> np.ndarray:
    """Name what parts of any shape collide as: themselves, or ~id of the body they belong to."""
    return np.where(state.parts.owner[parts] == Owner.BODY, ~state.parts.body[parts], parts)


def _members(state: State, collider: int) -> np.ndarray:
    return np.array([collider]) if collider >= 0 else state.bodies.parts_of(~collider)


def _overlapping(state: State, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Choose the pairs of parts that overlap, (K, 2)."""
    chosen, place = np.unique(np.concatenate([first, second]), return_inverse=True)
    inside = _which_overlap(state, chosen, place[:len(first)], place[len(first):])
    return np.column_stack([first[inside], second[inside]])


def _which_overlap(state: State, chosen: np.ndarray, one: np.ndarray,
                   other: np.ndarray) -> np.ndarray:
    """Give the places of the pairs of chosen parts that overlap, ascending, (K,)."""
    parts = state.parts
    poses, sizes, shapes = parts.poses[chosen], parts.solid_size[chosen], parts.shape[chosen]
    tree = np.flatnonzero(parts.owner[chosen] == Owner.TREE)
    poses[tree] = state.forest.poses[parts.row[chosen[tree]]]  # those shown may lie behind
    still = np.zeros((len(chosen), 6))
    near = _near(piece_bounds(shapes, poses, sizes, still, 0.0, 0.0), one, other)
    found = meet(one[near], poses, sizes, still, other[near], shapes, poses, sizes, still, 0.0)
    return near[np.unique(found.pair[found.gap < 0.0])]


@kernel
def _near(bounds, one, other):
    """List the pairs of boxes that overlap."""
    found = np.zeros(len(one), np.bool_)
    for n in range(len(one)):
        a, b = bounds[one[n]], bounds[other[n]]
        found[n] = (a[0] < b[3] and a[1] < b[4] and a[2] < b[5]
                    and b[0] < a[3] and b[1] < a[4] and b[2] < a[5])
    return np.flatnonzero(found)
