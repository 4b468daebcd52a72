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


"""Contact: trees run into walls, debris, the ground and each other, and push what they meet."""

from dataclasses import dataclass

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.touch import (
    capsule_bounds,
    meet,
    meet_ground,
    overlaps,
    Partners,
    resolve,
)
from procphys_ros.physics.trees import Foresight
from procphys_ros.physics.world import State, World
from procphys_ros.simulation.contact.leaning import Leaning
from procphys_ros.simulation.standing.buildings import Buildings
from procphys_ros.simulation.standing.obstacles import (
    Bricks,
    meets_trees,
    Obstacles,
    of_branches,
    Outlines,
)
from procphys_ros.simulation.trees.grove import Grove
from procphys_ros.simulation.trees.touches import Touches

_AHEAD = 1.5     # steps that bounds are swept over, as far as the narrow phase looks
_ROOM = 0.004    # [m] around bounds, likewise
_FRICTION = 0.6  # bark on soil, brick or bark
_MOST = 48       # contacts per tree, the nearest; with 24 crowns sink in where they hit hard
_SLOP = 0.002    # [m] overlap that is left alone, so that what rests keeps touching
_RECOVERY = 0.2  # share of a deeper overlap that is undone per step
_PUSH_OUT = 0.5  # [m/s] speed at most that this gives
_WAKE = 0.3      # [m/s] change of speed that sets a resting body free, as in the world's settling
_ROUNDS = 3      # of solving, while what is hit gives way


@dataclass(frozen=True)
class _Close:
    """What may touch in the next step, one row per contact; see `Touches`."""

    row: np.ndarray
    other: np.ndarray
    body: np.ndarray
    part: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    gap: np.ndarray

    def take(self, rows: np.ndarray) -> '_Close':
        return _Close(*(column[rows] for column in vars(self).values()))


class Contact:
    """
    Solves all contacts of trees before their step, with the masses that trees really show there.

    Trees and bodies of the world get equal and opposite impulses, so momentum is kept exactly.
    Branches of one tree pass through each other, and so do those of different standing trees.

    :param blueprint: all parts of the scene.
    :param grove: its trees.
    :param buildings: its masonry.

    :ivar touches: of the last step.
    :ivar bricks: what stands.
    """

    def __init__(self, blueprint: Blueprint, grove: Grove, buildings: Buildings):
        self._blueprint = blueprint
        self._grove = grove
        self._forest = grove.forest
        self._buildings = buildings
        self._sizes = blueprint.solid_size(self._forest.parts)

    def begin(self, world: World, leaning: Leaning, gravity: float) -> None:
        """Start anew in a world that has just been built."""
        self._world = world
        self._leaning = leaning
        self._weight = np.array([0.0, 0.0, -gravity])
        self._outlines = Outlines(world)
        self.bricks = Bricks(self._blueprint, self._buildings)
        self.touches = _nothing()
        self._beside = np.zeros(len(self._forest), bool)
        self._slack = np.zeros(len(self._forest))
        self._bounded: object = None
        if len(self._forest):
            self._survey()

    def act(self, time: float, time_step: float) -> None:
        """
        Let everything that would run into each other in the next step push each other instead.

        :param time: [s].
        :param time_step: [s].
        """
        self.touches = self._meet_all(time, time_step)
        self._leaning.press(self.touches.part, self.touches.impulse, time_step)

    def _meet_all(self, time: float, time_step: float) -> Touches:
        """Solve for the impulses, and exert them."""
        if not self._forest.active.any():
            return _nothing()
        for _ in range(_ROUNDS):
            close = self._close(time_step)
            if not len(close.row):
                return _nothing()
            touches, change, bodies = self._solve(close, time_step)
            if not self._give_way(touches, time, time_step):
                break
        pushed = touches.impulse.any(axis=1)
        touches = Touches(*(column[pushed] for column in vars(touches).values()))
        self._apply(touches, change, bodies)
        return touches

    def _apply(self, touches: Touches, change: np.ndarray, bodies: np.ndarray) -> None:
        forest, world = self._forest, self._world
        forest.push(touches.row, touches.point, touches.impulse)
        both = touches.other >= 0
        forest.push(touches.other[both], touches.point[both], -touches.impulse[both])
        moved = change.any(axis=1) & (world.bodies.state[bodies] == State.LOOSE)
        if moved.any():
            world.set_velocities(bodies[moved],
                                 world.bodies.velocities[bodies[moved]] + change[moved])

    def _give_way(self, touches: Touches, time: float, time_step: float) -> bool:
        """Set free what the contacts would push away; say whether anything was."""
        bodies = self._world.bodies
        hit = touches.body >= 0
        ids, place = np.unique(touches.body[hit], return_inverse=True)
        total = np.zeros((len(ids), 3))
        np.add.at(total, place, touches.impulse[hit])
        woken = ids[(bodies.state[ids] == State.RESTING)
                    & ((total ** 2).sum(axis=1) > (_WAKE * bodies.mass[ids]) ** 2)]
        self._world.thaw(woken)
        torn = self._leaning.tear_out(touches.row, touches.part, touches.point, touches.impulse,
                                      time, time_step)
        return torn or len(woken) > 0

    def _close(self, time_step: float) -> _Close:
        """List what may touch in the next step."""
        forest, reach = self._forest, _AHEAD * time_step
        plan = forest.plan
        roots = plan.row[plan.start[:-1]]
        free, beside = forest.is_free(roots), self._beside[roots]
        loose = meets_trees(self._world)
        movers = self._grove.movers()
        entries = (slice(None) if len(movers) == len(roots)
                   else _entries(plan.start, movers))
        found = [self._on_ground(plan.row[entries], forest.velocities, time_step)]
        if len(loose) or free.any() or beside.any():
            bounds, trees = self._bound(movers, entries, reach)
            tables = [self._loose_near(bounds, trees, loose, reach),
                      self._branches_near(trees, free)]
            if len(self.bricks):
                chosen = np.flatnonzero(free | beside)
                tables.append((_entries(plan.start, chosen),
                               self.bricks.within(trees[chosen])))
            found += [self._meet(entries, table, bounds, time_step) for entries, table in tables
                      if len(entries) and len(table.row)]
        return self._nearest(_Close(*(np.concatenate(columns) for columns in
                                      zip(*(vars(f).values() for f in found)))))

    def _bound(self, movers: np.ndarray, entries: np.ndarray | slice, reach: float
               ) -> tuple[np.ndarray, np.ndarray]:
        """
        Give the bounds of all segments and of all trees; of trees that stand still, the last.

        :param movers: trees that do not, places in the plan.
        :param entries: of these.
        :param reach: time that bounds are swept over [s].
        """
        forest, plan = self._forest, self._forest.plan
        if self._bounded is not plan:
            self._bounded, movers, entries = plan, np.arange(len(plan.start) - 1), slice(None)
            self._bounds = np.empty((len(plan.row), 6))
            self._trees = np.empty((len(movers), 6))
        now = capsule_bounds(plan.row[entries], forest.poses, self._sizes, forest.velocities,
                             reach, _ROOM)
        self._bounds[entries] = now
        if len(movers):
            count = np.diff(plan.start)[movers]
            first = np.cumsum(count) - count
            self._trees[movers, :3] = np.minimum.reduceat(now[:, :3], first)
            self._trees[movers, 3:] = np.maximum.reduceat(now[:, 3:], first)
        return self._bounds, self._trees

    def _loose_near(self, bounds: np.ndarray, trees: np.ndarray, ids: np.ndarray, reach: float
                    ) -> tuple[np.ndarray, Obstacles]:
        """Choose the entries of the plan that bodies come near, and those bodies."""
        bodies = self._world.bodies
        way = bodies.velocities[ids, :3] * reach
        room = bodies.radius[ids, None] + _ROOM
        place = bodies.poses[ids, :3]
        balls = np.hstack([place - room + np.minimum(way, 0.0),
                           place + room + np.maximum(way, 0.0)])
        chosen, near = (_distinct(rows) for rows in overlaps(trees, balls))
        entries = _entries(self._forest.plan.start, chosen)
        close, nearer = overlaps(bounds[entries], balls[near])
        return entries[_distinct(close)], self._outlines.of(ids[near[_distinct(nearer)]])

    def _branches_near(self, trees: np.ndarray, free: np.ndarray
                       ) -> tuple[np.ndarray, Obstacles]:
        """Choose the entries of falling trees that others are near, and those others."""
        falling = np.flatnonzero(free)
        a, b = overlaps(trees[falling], trees)
        a, b = falling[a][falling[a] != b], b[falling[a] != b]
        plan, forest = self._forest.plan, self._forest
        rows = plan.row[_entries(plan.start, _distinct(b))]
        return (_entries(plan.start, _distinct(a)),
                of_branches(rows, forest.poses, self._sizes, forest.velocities))

    def _meet(self, entries: np.ndarray, table: Obstacles, bounds: np.ndarray,
              time_step: float) -> _Close:
        """Look where segments, entries of the plan, may touch what is near them."""
        forest, plan = self._forest, self._forest.plan
        a, piece = overlaps(bounds[entries], table.bounds(_AHEAD * time_step, _ROOM))
        row = plan.row[entries[a]]
        other = table.row[piece]
        branch = np.flatnonzero(other >= 0)
        if len(branch):  # two falling trees meet once, and none meets itself
            first, second = forest.roots(row[branch]), forest.roots(other[branch])
            keep = np.ones(len(row), bool)
            keep[branch] = (first != second) & ((first < second) | ~forest.is_free(second))
            row, piece = row[keep], piece[keep]
        found = meet(row, forest.poses, self._sizes, forest.velocities, piece, table.shape,
                     table.pose, table.size, table.velocity, time_step)
        row, piece = row[found.pair], piece[found.pair]
        slack = np.where(table.part[piece] >= 0, self._slack[row], 0.0)
        return _Close(row, table.row[piece], table.body[piece], table.part[piece], found.point,
                      found.normal, found.gap - np.where(self._rooted(row), slack, 0.0))

    def _on_ground(self, rows: np.ndarray, velocities: np.ndarray, time_step: float) -> _Close:
        forest = self._forest
        found = meet_ground(rows, forest.is_free(rows), forest.poses, self._sizes, velocities,
                            time_step)
        row = rows[found.pair]
        nothing = np.full(len(row), -1, np.intp)
        return _Close(row, nothing, nothing, nothing, found.point, found.normal,
                      found.gap - np.where(self._rooted(row), self._slack[row], 0.0))

    def _rooted(self, rows: np.ndarray) -> np.ndarray:
        return ~self._forest.is_free(self._forest.roots(rows))

    def _nearest(self, close: _Close) -> _Close:
        """Keep the nearest few contacts of each tree."""
        if len(close.row) <= _MOST:
            return close
        root = self._forest.roots(close.row)
        order = np.lexsort((close.gap, root))
        first = np.searchsorted(root[order], root[order])
        return close.take(np.sort(order[np.arange(len(order)) - first < _MOST]))

    def _solve(self, close: _Close, time_step: float
               ) -> tuple[Touches, np.ndarray, np.ndarray]:
        """
        Find the impulses of all contacts.

        :returns: touches, changes of the velocities of bodies (B, 6), and their ids.
        """
        forest, both = self._forest, np.flatnonzero(close.other >= 0)
        rows = np.concatenate([close.row, close.other[both]])
        points = np.concatenate([close.point, close.point[both]])
        order = np.argsort(forest.roots(rows), kind='stable')
        place = np.empty(len(rows), np.intp)
        place[order] = np.arange(len(rows))
        look = self._grove.foresee(rows[order], points[order], time_step)
        end, other = place[:len(close.row)], np.full(len(close.row), -1, np.intp)
        other[both] = place[len(close.row):]
        partners, bodies = self._partners(close, end, other, time_step)
        free = partners.motion.copy()
        impulse = resolve(close.normal, _least(close, look, end, other, time_step),
                          np.full(len(end), _FRICTION), partners, look.velocity, look.first,
                          look.place, look.count, look.response)
        return (Touches(close.row, close.other, close.body, close.part, close.point, impulse),
                partners.motion - free, bodies)

    def _partners(self, close: _Close, end: np.ndarray, other: np.ndarray, time_step: float
                  ) -> tuple[Partners, np.ndarray]:
        bodies = self._world.bodies
        ids = np.unique(close.body[(close.body >= 0) & (close.part < 0)])
        index = np.full(len(bodies.state) + 1, -1)
        index[ids] = np.arange(len(ids))
        loose = bodies.state[ids] == State.LOOSE
        axes = rotation.to_matrix(bodies.poses[ids, 3:])
        spin = np.where(loose[:, None], 1.0 / bodies.inertia[ids], 0.0)
        motion = bodies.velocities[ids].copy()
        motion[loose, :3] += self._weight * time_step
        body = np.where(close.part < 0, index[close.body], -1)
        arm = close.point - bodies.poses[np.maximum(close.body, 0), :3]
        return Partners(end, other, body, arm, np.where(loose, 1.0 / bodies.mass[ids], 0.0),
                        np.einsum('bij,bj,bkj->bik', axes, spin, axes), motion), ids

    def _survey(self) -> None:
        """Find the trees that can reach a wall, and how deep branches were authored into it."""
        forest, plan = self._forest, self._forest.plan
        still = np.zeros_like(forest.velocities)
        touching = [self._on_ground(plan.row, still, 0.0)]
        if len(self.bricks):
            length = 0.5 * self._sizes[:, 2].max(initial=0.0)
            for first, last in zip(plan.start[:-1], plan.start[1:]):
                rows = plan.row[first:last]
                arm = np.linalg.norm(forest.poses[rows, :3] - forest.poses[rows[0], :3], axis=1)
                room = np.full(3, arm.max() + 3.0 * length)
                base = forest.poses[rows[0], :3]
                reached, _ = overlaps(np.concatenate([base - room, base + room])[None],
                                      self.bricks.cells)
                self._beside[rows] = len(reached) > 0
            bounds = capsule_bounds(plan.row, forest.poses, self._sizes, still, 0.0, _ROOM)
            trees = np.flatnonzero(self._beside[plan.row[plan.start[:-1]]])
            if len(trees):
                entries = _entries(plan.start, trees)
                table = self.bricks.within(bounds[entries])
                touching.append(self._meet(entries, table, bounds, 0.0))
        for close in touching:
            np.minimum.at(self._slack, close.row, close.gap)


def _least(close: _Close, look: Foresight, end: np.ndarray, other: np.ndarray,
           time_step: float) -> np.ndarray:
    """
    Give the normal velocity that each contact must have at the end of the step [m/s], (C,).

    A gap may close, but not more; joints that lag behind take part of it. Deep overlaps open.
    """
    lag = look.lag[end] - np.where(other[:, None] >= 0, look.lag[other], 0.0)
    closing = np.minimum((lag * close.normal).sum(axis=1), 0.0)
    room = close.gap + time_step * closing
    out = np.clip(_RECOVERY * (-room - _SLOP) / time_step, 0.0, _PUSH_OUT)
    return np.where(room > 0.0, -room / time_step, out)


def _entries(start: np.ndarray, trees: np.ndarray) -> np.ndarray:
    """List the entries of some trees of a plan."""
    count = start[trees + 1] - start[trees]
    before = np.cumsum(count) - count
    return np.arange(count.sum()) + np.repeat(start[trees] - before, count)


def _distinct(rows: np.ndarray) -> np.ndarray:
    """Give each row once, ascending."""
    found = np.zeros(np.max(rows, initial=-1) + 1, bool)
    found[rows] = True
    return np.flatnonzero(found)


def _nothing() -> Touches:
    none = np.zeros(0, np.intp)
    return Touches(none, none, none, none, np.zeros((0, 3)), np.zeros((0, 3)))
