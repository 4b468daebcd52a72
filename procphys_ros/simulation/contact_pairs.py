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


"""Contact pairs of trees: where segments may touch the ground, bodies, bricks and each other."""

from dataclasses import dataclass, field

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.terrain import Terrain
from procphys_ros.physics.touch import capsule_bounds, meet, meet_ground, overlaps
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.state import SegmentJoint, TraversalPlan
from procphys_ros.physics.world import World
from procphys_ros.simulation.obstacles import (
    Bricks,
    meets_trees,
    Obstacles,
    of_bodies,
    of_branches,
)

_FREE = int(SegmentJoint.FREE)  # numba does not read enums
_AHEAD = 1.5  # steps that bounds are swept over, as in the narrow phase
_ROOM = 0.004  # [m] around bounds, likewise
_MOST = 96  # contacts per tree, the nearest; with 48 crowns sink in where they hit hard


@dataclass(frozen=True)
class Pairs:
    """Possible contacts in the next step, one row each; see `TreeContacts`."""

    row: np.ndarray
    other: np.ndarray
    body: np.ndarray
    part: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    gap: np.ndarray

    def and_more(self, others: 'Pairs') -> 'Pairs':
        """Append others."""
        return Pairs(*(np.concatenate(columns)
                       for columns in zip(vars(self).values(), vars(others).values())))

    def take(self, rows: np.ndarray) -> 'Pairs':
        """Select contacts, (K,) rows."""
        return Pairs(*(column[rows] for column in vars(self).values()))


@dataclass
class TreeContacts:
    """
    Every contact of trees in one step.

    :ivar row: of the forest, (C,).
    :ivar other: row of the forest that it touched, -1 for none, (C,).
    :ivar body: id of the body that it touched, -1 for none, (C,).
    :ivar part: standing brick that it touched, -1 for none, (C,).
    :ivar point: world [m], (C, 3).
    :ivar impulse: on the row; the other side gets the opposite [N·s], (C, 3).
    :ivar change: of the closing speed [m/s], (C,).
    :ivar speed: stopped part of the closing speed before [m/s], (C,).
    :ivar rope: joint of a mechanism that pulls there, -1 = nothing does, they touch, (C,).
    """

    row: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    other: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    body: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    part: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))
    point: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    impulse: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    change: np.ndarray = field(default_factory=lambda: np.zeros(0))
    speed: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rope: np.ndarray = field(default_factory=lambda: np.zeros(0, np.intp))

    def __len__(self) -> int:
        return len(self.row)


@dataclass
class TreeBounds:
    """
    Bounds of segments and trees; those of trees at rest are kept from step to step.

    :ivar plan: of the forest that they are valid for.
    :ivar segments: three minima, three maxima [m], by entry of the plan, (A, 6).
    :ivar trees: the same of whole trees, (T, 6).
    """

    plan: TraversalPlan | None = None
    segments: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    trees: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))

    def update(self, forest: Forest, sizes: np.ndarray, movers: np.ndarray,
               entries: np.ndarray | slice, reach: float) -> None:
        """
        Update the bounds of moving trees.

        :param sizes: of the segments [m], (S, 3).
        :param movers: trees that are not at rest, places in the plan.
        :param entries: of these.
        :param reach: time that bounds are swept over [s].
        """
        plan = forest.plan
        if self.plan is not plan:
            self.plan, movers, entries = plan, np.arange(len(plan.start) - 1), slice(None)
            self.segments = np.empty((len(plan.row), 6))
            self.trees = np.empty((len(movers), 6))
        now = capsule_bounds(plan.row[entries], forest.poses, sizes, forest.velocities, reach,
                             _ROOM)
        self.segments[entries] = now
        self.trees[movers] = _hulls(now, np.diff(plan.start)[movers])


@dataclass(frozen=True)
class Surroundings:
    """
    Obstacles that trees may touch.

    :ivar world: rigid bodies.
    :ivar bricks: masonry as built.
    :ivar standing: parts that still stand there, (N,) bool.
    :ivar body: id of each part's body, (N,).
    :ivar beside, slack, crowns: see `TreeModel`.
    :ivar excluded: pairs without contact, `pair_keys` of `contact_exclusions`, (K,).
    :ivar terrain: the surface of the ground.
    """

    world: World
    bricks: Bricks
    standing: np.ndarray
    body: np.ndarray
    beside: np.ndarray
    slack: np.ndarray
    excluded: np.ndarray
    terrain: Terrain
    crowns: np.ndarray | None = None


@kernel
def pair_keys(pairs):
    """Return a key for each pair of colliders (parts, or ~ids of bodies) in either order, (K,)."""
    keys = np.empty(len(pairs), np.int64)
    for n in range(len(pairs)):
        keys[n] = _pair_key(pairs[n, 0], pairs[n, 1])
    return keys


def find(forest: Forest, sizes: np.ndarray, around: Surroundings, bounds: TreeBounds,
         movers: np.ndarray, time_step: float) -> Pairs:
    """
    List the possible contacts of the next step, the nearest few of each tree.

    :param forest: all trees.
    :param sizes: of the segments [m], (S, 3).
    :param around: obstacles.
    :param bounds: kept from step to step.
    :param movers: trees that are not at rest, places in the plan.
    :param time_step: [s].
    """
    reach, plan = _AHEAD * time_step, forest.plan
    roots = plan.row[plan.start[:-1]]
    free, beside = forest.is_free(roots), around.beside[roots]
    loose = meets_trees(around.world)
    entries = slice(None) if len(movers) == len(roots) else _entries(plan.start, movers)
    found = [_on_ground(forest, plan.row[entries], sizes, forest.velocities, around.slack,
                        time_step, around.terrain)]
    crowns = around.crowns
    if len(loose) or free.any() or beside.any() or crowns is not None:
        bounds.update(forest, sizes, movers, entries, reach)
        tables = [_loose_near(forest, around.world, bounds, loose, reach),
                  _branches_near(forest, sizes, bounds.trees,
                                 free if crowns is None else np.ones_like(free))]
        if len(around.bricks):
            chosen = np.flatnonzero(free | beside)
            tables.append((_entries(plan.start, chosen), around.bricks.within(
                bounds.trees[chosen], around.standing, around.body)))
        found += [_meet(forest, sizes, near, table, bounds.segments, around.slack, time_step,
                        around.excluded, crowns)
                  for near, table in tables if len(near) and len(table.row)]
    joined = Pairs(*(np.concatenate(columns) for columns in
                     zip(*(vars(pairs).values() for pairs in found))))
    return _nearest(forest, joined)


def survey(forest: Forest, sizes: np.ndarray, bricks: Bricks,
           terrain: Terrain) -> tuple[np.ndarray, np.ndarray]:
    """
    Find the trees that can reach a wall, and the overlaps of branches as authored.

    :param forest: at rest.
    :param sizes: of the segments [m], (S, 3).
    :param bricks: all masonry.
    :param terrain: the surface of the ground.
    :returns: whether the tree of each row may reach a wall, (S,), and overlaps [m], (S,).
    """
    beside, slack = np.zeros(len(forest), bool), np.zeros(len(forest))
    if not len(forest):
        return beside, slack
    plan, still = forest.plan, np.zeros_like(forest.velocities)
    touching = [_on_ground(forest, plan.row, sizes, still, slack, 0.0, terrain)]
    if len(bricks):
        length = 0.5 * sizes[:, 2].max(initial=0.0)
        for first, last in zip(plan.start[:-1], plan.start[1:]):
            rows = plan.row[first:last]
            arm = norm(forest.poses[rows, :3] - forest.poses[rows[0], :3], axis=1)
            room = np.full(3, arm.max() + 3.0 * length)
            base = forest.poses[rows[0], :3]
            reached, _ = overlaps(np.concatenate([base - room, base + room])[None], bricks.cells)
            beside[rows] = len(reached) > 0
        bounds = capsule_bounds(plan.row, forest.poses, sizes, still, 0.0, _ROOM)
        trees = np.flatnonzero(beside[plan.row[plan.start[:-1]]])
        if len(trees):
            entries = _entries(plan.start, trees)
            touching.append(_meet(forest, sizes, entries, bricks.within(bounds[entries]), bounds,
                                  slack, 0.0, np.zeros(0, np.int64)))
    for pairs in touching:
        np.minimum.at(slack, pairs.row, pairs.gap)
    return beside, slack


def survey_crowns(forest: Forest, sizes: np.ndarray) -> np.ndarray:
    """
    Find the depth of authored overlaps between the branches of different trees.

    :param forest: at rest.
    :param sizes: of the segments [m], (S, 3).
    :returns: overlap, 0 or less [m], (S,).
    """
    depth, bounds, plan = np.zeros(len(forest)), TreeBounds(), forest.plan
    if not len(forest):
        return depth
    every = np.ones(len(plan.start) - 1, bool)
    bounds.update(forest, sizes, np.flatnonzero(every), slice(None), 0.0)
    near, table = _branches_near(forest, sizes, bounds.trees, every)
    if len(near):
        pairs = _meet(forest, sizes, near, table, bounds.segments, depth, 0.0,
                      np.zeros(0, np.int64), depth.copy())
        np.minimum.at(depth, pairs.row, pairs.gap)
        np.minimum.at(depth, pairs.other, pairs.gap)
    return depth


def _loose_near(forest: Forest, world: World, bounds: TreeBounds, ids: np.ndarray,
                reach: float) -> tuple[np.ndarray, Obstacles]:
    """Select the entries of trees with bodies nearby, and those bodies."""
    bodies = world.bodies
    way = bodies.velocities[ids, :3] * reach
    room = bodies.radius[ids, None] + _ROOM
    place = bodies.poses[ids, :3]
    balls = np.hstack([place - room + np.minimum(way, 0.0),
                       place + room + np.maximum(way, 0.0)])
    chosen, near = (_distinct(rows) for rows in overlaps(bounds.trees, balls))
    return _entries(forest.plan.start, chosen), of_bodies(world, ids[near])


def _branches_near(forest: Forest, sizes: np.ndarray, trees: np.ndarray,
                   free: np.ndarray) -> tuple[np.ndarray, Obstacles]:
    """Select the entries of falling trees near others, and the entries of those others."""
    falling = np.flatnonzero(free)
    a, b = overlaps(trees[falling], trees)
    a, b = falling[a][falling[a] != b], b[falling[a] != b]
    plan = forest.plan
    rows = plan.row[_entries(plan.start, _distinct(b))]
    return (_entries(plan.start, _distinct(a)),
            of_branches(rows, forest.poses, sizes, forest.velocities))


def _meet(forest: Forest, sizes: np.ndarray, entries: np.ndarray, table: Obstacles,
          bounds: np.ndarray, slack: np.ndarray, time_step: float,
          excluded: np.ndarray, crowns: np.ndarray | None = None) -> Pairs:
    """Find possible contacts of segments, entries of the plan, with obstacles near them."""
    plan = forest.plan
    a, piece = overlaps(bounds[entries], table.bounds(_AHEAD * time_step, _ROOM))
    row = plan.row[entries[a]]
    kept = _which_meet(row, piece, table.row, table.body, plan.root, forest.model.joint,
                       forest.parts, excluded, crowns is not None)
    row, piece = row[kept], piece[kept]
    found = meet(row, forest.poses, sizes, forest.velocities, piece, table.shape, table.pose,
                 table.size, table.velocity, time_step)
    row, piece = row[found.pair], piece[found.pair]
    rooted, met = _rooted(forest, row), table.row[piece]
    depth = np.where((table.part[piece] >= 0) & rooted, slack[row], 0.0)
    if crowns is not None and len(row):
        both = rooted & (met >= 0)
        both[both] = _rooted(forest, met[both])
        depth[both] = np.minimum(crowns[row[both]], crowns[met[both]])
    return Pairs(row, met, table.body[piece], table.part[piece], found.point,
                 found.normal, found.gap - depth)


@kernel
def _which_meet(row, piece, other_row, other_body, root, joint, parts, excluded, crowns):
    """
    List the pairs of a segment and a piece that may touch.

    Two trees that both search for others give one contact, and none touches itself.

    :param row: of the forest, and piece of each pair, (P,) each.
    :param other_row, other_body: columns of the pieces.
    :param root, joint, parts: of the rows of the forest.
    :param excluded: see `Surroundings`.
    :param crowns: whether standing trees search for others.
    """
    kept = np.empty(len(row), np.int64)
    count = 0
    for n in range(len(row)):
        other, number = other_row[piece[n]], ~other_body[piece[n]]
        if other >= 0:
            number = parts[other]
            first, second = root[row[n]], root[other]
            looks = crowns or joint[second] == _FREE
            if first == second or (looks and first > second):
                continue
        if len(excluded) and (excluded == _pair_key(parts[row[n]], number)).any():
            continue
        kept[count] = n
        count += 1
    return kept[:count]


@subroutine
def _pair_key(first, second):
    one = 2 * first if first >= 0 else -2 * first - 1
    other = 2 * second if second >= 0 else -2 * second - 1
    return (min(one, other) << 32) + max(one, other)


@kernel
def _hulls(bounds, count):
    """Return the bounds of consecutive groups of `count` boxes, (G, 6)."""
    out = np.empty((len(count), 6))
    first = 0
    for g in range(len(count)):
        out[g] = bounds[first]
        for k in range(first + 1, first + count[g]):
            for c in range(3):
                out[g, c] = min(out[g, c], bounds[k, c])
                out[g, 3 + c] = max(out[g, 3 + c], bounds[k, 3 + c])
        first += count[g]
    return out


def _on_ground(forest: Forest, rows: np.ndarray, sizes: np.ndarray, velocities: np.ndarray,
               slack: np.ndarray, time_step: float, terrain: Terrain) -> Pairs:
    found = meet_ground(rows, forest.is_free(rows), forest.poses, sizes, velocities, time_step,
                        terrain)
    row = rows[found.pair]
    nothing = np.full(len(row), -1, np.intp)
    return Pairs(row, nothing, nothing, nothing, found.point, found.normal,
                 found.gap - np.where(_rooted(forest, row), slack[row], 0.0))


def _rooted(forest: Forest, rows: np.ndarray) -> np.ndarray:
    return ~forest.is_free(forest.roots(rows))


def _nearest(forest: Forest, pairs: Pairs) -> Pairs:
    """Keep the nearest few contacts of each tree."""
    if len(pairs.row) <= _MOST:
        return pairs
    root = forest.roots(pairs.row)
    order = np.lexsort((pairs.gap, root))
    first = np.searchsorted(root[order], root[order])
    return pairs.take(np.sort(order[np.arange(len(order)) - first < _MOST]))


def _entries(start: np.ndarray, trees: np.ndarray) -> np.ndarray:
    """List the entries of some trees of a plan."""
    count = start[trees + 1] - start[trees]
    before = np.cumsum(count) - count
    return np.arange(count.sum()) + np.repeat(start[trees] - before, count)


def _distinct(rows: np.ndarray) -> np.ndarray:
    """Return the distinct rows, ascending."""
    found = np.zeros(np.max(rows, initial=-1) + 1, bool)
    found[rows] = True
    return np.flatnonzero(found)
