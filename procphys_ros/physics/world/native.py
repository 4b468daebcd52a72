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


"""Native engine: the contact solver of `rigid`, on the columns of the body table."""

from collections.abc import Mapping

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation.threads import even_ranges, run
from procphys_ros.geometry import rotation
from procphys_ros.physics.rigid.contacts import (
    ContactRows,
    find,
    join_key,
    no_contacts,
    POINT,
    split_key,
)
from procphys_ros.physics.rigid.islands import Islands, upwards
from procphys_ros.physics.rigid.joint_response import respond
from procphys_ros.physics.rigid.joints import along_chains, JointRows, no_joints
from procphys_ros.physics.rigid.pieces import BOX, HEXAHEDRON, no_pieces, PieceRows, place, ROUND
from procphys_ros.physics.rigid.reduction import spanning
from procphys_ros.physics.rigid.solver import efforts, follow, MovingBodies, solve
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.contacts import hand_on
from procphys_ros.physics.world.engine import Looked
from procphys_ros.physics.world.joint_table import JointTable
from procphys_ros.physics.world.pairs import PairList
from procphys_ros.physics.world.sleeping import rim_speed

_LOOKS = 240.0  # [1/s] largest rate of contact detection
_WORTH = 20_000.0  # contacts solved per thread at least, which take some ms
_WAY = 0.01  # [m] of motion between two contact detections, where `_LOOKS` permits
_NUMBERED = 1024  # ground contact points per body with a name of their own
_NOWHERE = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
_NO_JOINTS = no_joints(0)


class NativeEngine:
    """
    Engine that works on the columns of the body table in place, without copies.

    It caches world poses of pieces and contact impulses of the last step.

    :param gravity: acceleration of awake bodies [m/s²], (3,).
    :param terrain: the surface of the ground.
    """

    name, has_joints, threads = 'native', True, 1

    def __init__(self, gravity: np.ndarray, terrain: Terrain = FLAT):
        self._gravity, self._terrain = np.array(gravity, float), terrain
        self.clear()

    def clear(self) -> None:
        """Remove all bodies."""
        self._table = BodyTable()
        self._pieces, self._used = no_pieces(0), 0
        self._first, self._count = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self._excluded = np.zeros(0, np.int64)  # keys of pairs of bodies, ascending
        self._near = PairList()
        self._contacts = self._resting = no_contacts(0)
        self._still = np.zeros(0, bool)  # bodies that sleep, or never move
        self._held = np.zeros(0, bool)  # bodies that never move
        self._which = np.zeros(0, np.intp)  # contacts reported by the last detection, -1 if gone
        self._joints = JointTable()
        self._told: list[np.ndarray] = []  # contacts of each detection in the step
        self._set_out = np.zeros((0, 3))  # positions of bodies when they began or joined the step
        self._begun = np.zeros((0, 7)), np.zeros((0, 6))

    def close(self) -> None:
        """Free the memory."""

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Set the acceleration of awake bodies [m/s²], (3,)."""
        self._gravity = np.array(gravity, float)

    def save(self) -> dict[str, np.ndarray]:
        """Copy contacts, which steps start from, and bodies in the order of their pieces."""
        self._drop_removed()
        body = self._pieces.body[:self._used]
        saved = {'order': body[np.diff(body, prepend=-1) != 0], 'still': self._still.copy(),
                 'held': self._held.copy()}
        for name, rows in (('contacts', self._contacts), ('resting', self._resting)):
            saved |= {f'{name}.{column}': values.copy()
                      for column, values in rows._asdict().items()}
        return saved

    def restore(self, table: BodyTable, saved: Mapping[str, np.ndarray]) -> None:
        """Add the bodies of `save`, and start from its contacts."""
        self.add(table, saved['order'])
        self._still, self._held = saved['still'].copy(), saved['held'].copy()
        self._contacts, self._resting = (
            ContactRows(*(saved[f'{name}.{column}'].copy() for column in ContactRows._fields))
            for name in ('contacts', 'resting'))

    def add(self, table: BodyTable, ids: np.ndarray) -> None:
        """Add bodies, (K,) ids; see `Engine.add`."""
        self._table = table
        self._near.forget()
        ids = ids[table.piece_count[ids] > 0]
        count = table.piece_count[ids]
        source = np.repeat(table.first_piece[ids] - np.cumsum(count) + count, count)
        source += np.arange(count.sum())
        rows = self._new_rows(ids, count)
        pieces, shape = self._pieces, table.piece_shape[source]
        pieces.body[rows] = np.repeat(ids, count)
        pieces.size[rows], pieces.local[rows] = table.piece_size[source], table.piece_pose[source]
        pieces.kind[rows] = np.where(shape == Shape.BOX, BOX, ROUND)
        cut = ids[table.hexahedron_count[ids] > 0]
        for body in cut.tolist():
            first = table.first_hexahedron[body]
            own = slice(first, first + table.hexahedron_count[body])
            where = self._first[body] + table.hexahedron_piece[own]
            pieces.kind[where], pieces.cut[where] = HEXAHEDRON, table.hexahedron_corners[own]
        self._place(ids)
        self._join_step(ids)

    def _new_rows(self, ids: np.ndarray, count: np.ndarray) -> np.ndarray:
        """Allocate consecutive rows for the pieces of bodies."""
        if self._used + int(count.sum()) > len(self._pieces.body):
            self._drop_removed()
        need = self._used + int(count.sum())
        if need > len(self._pieces.body):
            room = no_pieces(need)
            self._pieces = PieceRows(*(np.concatenate([column[:self._used], more]) for column, more
                                       in zip(self._pieces, room)))
        if len(self._first) < len(self._table.state):
            more = np.zeros(len(self._table.state) - len(self._first), np.int64)
            self._first = np.concatenate([self._first, more])
            self._count = np.concatenate([self._count, more])
        self._first[ids] = self._used + np.cumsum(count) - count
        self._count[ids] = count
        rows = np.arange(self._used, need)
        self._used = need
        return rows

    def _drop_removed(self) -> None:
        """Compact the rows of pieces after removals; contacts keep their forces."""
        alive = self._pieces.body[:self._used] >= 0
        if alive.all():
            return
        kept, place = np.flatnonzero(alive), np.cumsum(alive) - 1
        for column in self._pieces:
            column[:len(kept)] = column[kept]
        body = self._pieces.body[:len(kept)]
        first = np.flatnonzero(np.diff(body, prepend=-1))
        self._first[body[first]] = first
        self._contacts, there = self._renumbered(self._contacts, alive, place)
        self._which = np.append(np.where(there, np.cumsum(there) - 1, -1), -1)[self._which]
        self._resting, _ = self._renumbered(self._resting, alive, place)
        self._used = len(kept)

    def _renumbered(self, contacts: ContactRows, alive: np.ndarray,
                    place: np.ndarray) -> tuple[ContactRows, np.ndarray]:
        """Return the contacts of remaining pieces with new row numbers, and their mask."""
        ends = np.stack(split_key(contacts.key))
        is_piece = (ends < self._used) & (ends[0] != POINT)
        row = np.where(is_piece, ends, 0)
        there = (alive[row] | ~is_piece).all(axis=0)
        out = contacts.of(there)
        out.key[:] = join_key(*np.where(is_piece, place[row], ends)[:, there])
        return out, there

    def _rows(self, ids: np.ndarray) -> np.ndarray:
        """List the rows of the pieces of bodies, ascending."""
        ids = ids[ids < len(self._count)]
        count = self._count[ids]
        rows = np.repeat(self._first[ids] - np.cumsum(count) + count, count)
        return np.sort(rows + np.arange(count.sum()))

    def _place(self, ids: np.ndarray, time_step: float = 0.0) -> np.ndarray:
        rows = self._rows(ids)
        place(rows, self._pieces, self._table.poses, self._table.velocities, time_step)
        return rows

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies, (K,) ids."""
        rows = self._rows(ids)
        self._pieces.body[rows] = -1
        self._pieces.bounds[rows] = [np.inf] * 3 + [-np.inf] * 3
        self._count[ids] = 0
        self._near.forget()
        for k, rows in enumerate(self._told):
            gone = np.isin(rows[:, :2], ids).any(axis=1)
            if gone.any():
                self._told[k] = rows[~gone]

    def hand_on(self, former: np.ndarray, heirs: np.ndarray, bounds: np.ndarray) -> None:
        """Hand contacts of the last step on to bodies in the place of others; see `hand_on`."""
        for rows in self._told:
            hand_on(rows, former, heirs, bounds)

    def freeze(self, ids: np.ndarray) -> None:
        """Make bodies immovable, (K,) ids."""
        self._place(ids)

    def thaw(self, table: BodyTable, ids: np.ndarray) -> None:
        """Make immovable bodies movable; their state is read from the table."""

    def set_poses(self, ids: np.ndarray, poses: np.ndarray) -> None:
        """Update the pieces of bodies to the poses of the table, (K, 7)."""
        self._place(ids)
        self._near.forget()

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set velocities, (K, 6); they are read from the table."""

    def set_excluded(self, pairs: np.ndarray, excluded: bool) -> None:
        """Exclude pairs of bodies from collision, or include them again, (K, 2) ids."""
        keys = join_key(*np.asarray(pairs, np.int64).reshape(-1, 2).T)
        change = np.union1d if excluded else np.setdiff1d
        self._excluded = change(self._excluded, keys)

    def set_joints(self, joints: JointTable) -> None:
        """Set the joints between bodies; displacements, forces and moments are written there."""
        self._joints = joints

    def respond(self, change: np.ndarray) -> np.ndarray:
        """
        Return changes of velocity with what joints add to them.

        :param change: of all bodies, by id, world axes, (B, 6); only those of awake ones count.
        """
        table = self._table
        free = table.awake
        place_of = np.full(len(table.state), len(free))
        place_of[free] = np.arange(len(free))
        bodies = MovingBodies(
            np.append(table.mass[free], np.inf),
            np.concatenate([table.inertia[free], np.full((1, 3), np.inf)]),
            np.concatenate([table.poses[free], _NOWHERE]),
            np.concatenate([change[free], np.zeros((1, 6))]))
        respond(bodies, len(free), self._pulling(place_of, len(free))[1])
        out = change.copy()
        out[free] = bodies.velocity[:-1]
        return out

    def step(self, time_step: float, looked: Looked | None = None) -> None:
        """Advance time [s]; see `Engine.step`."""
        self._step = time_step
        table, looks, self._told = self._table, self._looks(time_step), []
        self._joints.set_out()
        self._set_out = table.copied('poses', self._set_out)
        for k in range(looks):
            poses, velocities = self._begun
            poses, velocities = self._begun = (table.copied('poses', poses),
                                               table.copied('velocities', velocities))
            rows = self._move(time_step / looks, 1.0 / looks)
            self._told.append(rows)
            carried = self._carried(rows, poses)
            if looked is not None:
                self._let_look(looked, rows, poses, velocities, time_step / looks)
            rows[:, 2:5] -= carried
            if k < looks - 1:
                self._told[-1] = self._told[-1][self._told[-1][:, 12] > 0.0]
        self._told = [np.concatenate(self._told)]
        self._told[0][:, 9:] /= looks

    def _let_look(self, looked: Looked, rows: np.ndarray, poses: np.ndarray,
                  velocities: np.ndarray, duration: float) -> None:
        """Call `looked`; scale the warm-start impulses of contacts that it has reduced."""
        pressed = rows[:, 12].copy()
        looked(rows, poses, velocities, duration)
        less = np.flatnonzero((rows[:, 12] < pressed) & (self._which >= 0))
        self._contacts.force[self._which[less]] *= (rows[less, 12] / pressed[less])[:, None]

    def _join_step(self, ids: np.ndarray) -> None:
        """Record the positions of bodies that join during a step as their start of the step."""
        more = self._table.poses[len(self._set_out):, :3]
        self._set_out = np.concatenate([self._set_out, more])
        self._set_out[ids] = self._table.poses[ids, :3]

    def _carried(self, contacts: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """
        Compute the displacements of contacts with their bodies in this step [m], (C, 3).

        Contact points are reported relative to the start of the step, so that bodies that move
        together keep their lever arms. The displacement is the mass-weighted mean of both bodies.

        :param contacts: rows of a contact detection, (C, 13).
        :param poses: of all bodies at this contact detection, (B, 7).
        """
        way = poses[:, :3] - self._set_out[:len(poses)]
        first, second = contacts[:, :2].astype(np.intp).T
        second = np.where(second == 0, first, second)  # ground contacts follow the body
        one, two = self._table.mass[first], self._table.mass[second]
        share = (one / (one + two))[:, None]
        return share * way[first] + (1.0 - share) * way[second]

    def _looks(self, time_step: float) -> int:
        """
        Choose the number of contact detections in a step.

        A body that turns about its first contact point may hit others that were not detected.
        """
        speed = rim_speed(self._table, np.flatnonzero(self._table.state >= BodyState.AWAKE))
        wanted = np.ceil(speed.max(initial=0.0) * time_step / _WAY)
        return int(max(min(wanted, np.ceil(time_step * _LOOKS - 1e-6)), 1.0))

    def _move(self, time_step: float, share: float) -> np.ndarray:
        """Advance time [s], a share of the step; return the contacts, detected once, (C, 13)."""
        table = self._table
        free = table.awake
        driven = np.flatnonzero(table.state == BodyState.KINEMATIC)
        moving = np.concatenate([free, driven])
        rows = self._place(moving, time_step)
        self._lay_aside()
        contacts = self._find(rows, time_step)
        bodies = MovingBodies(
            np.concatenate([table.mass[free], np.full(len(driven) + 1, np.inf)]),
            np.concatenate([table.inertia[free], np.full((len(driven) + 1, 3), np.inf)]),
            np.concatenate([table.poses[moving], _NOWHERE]),
            np.concatenate([table.velocities[moving], np.zeros((1, 6))]))
        place_of = np.full(len(table.state), len(moving))
        place_of[moving] = np.arange(len(moving))
        first, second = place_of[contacts.first], place_of[contacts.second]
        up = upwards(contacts, spanning(first, second, contacts), self._gravity)
        pulling, joints = self._pulling(place_of, len(free))
        islands = Islands.found((first[up], second[up]), (joints.first, joints.second), len(free))
        effort = efforts(np.diff(islands.contact_start), time_step)
        hardest = np.argsort(-effort, kind='stable')
        islands = islands._replace(contacts=up[islands.contacts])
        if len(hardest) > 1:
            islands = islands.taken(hardest)
        ranges = _shares(effort[hardest], self.threads)
        joints = joints.of(islands.joints) if len(islands.joints) else joints
        told = self._solve(bodies, len(free), first, second, contacts, joints, islands, ranges,
                           time_step)
        table.poses[moving], table.velocities[free] = bodies.pose[:-1], bodies.velocity[:len(free)]
        left_out = np.ones(len(first), bool)
        left_out[islands.contacts] = False
        contacts.force[left_out] = 0.0
        self._contacts = contacts
        if len(islands.joints):
            self._keep(pulling[islands.joints], joints, share)
        order = np.argsort(islands.contacts, kind='stable')
        self._which = islands.contacts[order]
        return told[order]

    def _solve(self, bodies: MovingBodies, free: int, first: np.ndarray, second: np.ndarray,
               contacts: ContactRows, joints: JointRows, islands: Islands, ranges: np.ndarray,
               time_step: float) -> np.ndarray:
        """Solve each range of islands on a thread; return their contacts, (K, 13)."""
        table, told = self._table, {}

        def some(place: int, low: int, high: int) -> None:
            held = slice(islands.joint_start[low], islands.joint_start[high])
            whole = len(ranges) == 2
            told[place] = solve(bodies, free, first, second, contacts, table.friction,
                                table.restitution, joints if whole else joints.of(held),
                                islands if whole else islands.between(low, high),
                                self._gravity, time_step)
        run(some, ranges)
        follow(bodies, free, time_step)
        return np.concatenate([told[place] for place in sorted(told)])

    def _pulling(self, place_of: np.ndarray, free: int) -> tuple[np.ndarray, JointRows]:
        """
        Return the ids of the joints of awake bodies, and these joints between solver rows.

        :param place_of: solver row of each body; immovable bodies share one row, and their joint
            frames become world frames.
        """
        ids = self._joints.holding
        if not len(ids):
            return ids, _NO_JOINTS
        rows = self._joints.rows
        one, other = place_of[rows.first[ids]], place_of[rows.second[ids]]
        moves = np.minimum(one, other) < free
        ids, one, other = ids[moves], one[moves], other[moves]
        order = along_chains(one, other, free)
        ids, one, other = ids[order], one[order], other[order]
        out = rows.of(ids)._replace(first=one, second=other)
        for row, body, frame in ((one, rows.first[ids], out.frame),
                                 (other, rows.second[ids], out.other_frame)):
            still = np.flatnonzero(row == place_of[0])
            if len(still):
                frame[still] = rotation.compose(self._table.poses[body[still]], frame[still])
        return ids, out

    def _keep(self, ids: np.ndarray, joints: JointRows, share: float) -> None:
        """Store the state of joints, and their forces weighted by this share of the step."""
        rows = self._joints.rows
        rows.way[ids], rows.strain[ids] = joints.way, joints.strain
        rows.broken[ids] = joints.broken
        rows.force[ids] += share * joints.force
        rows.moment[ids] += share * joints.moment

    def _lay_aside(self) -> None:
        """
        Set aside the contacts between sleeping bodies, for warm starting after they wake.

        Contacts of bodies freed in this step start from zero: fixed bodies carry any load.
        """
        state = self._table.state
        held = state == BodyState.FIXED
        freed = self._held & ~held[:len(self._held)]
        self._held = held
        if freed.any():
            freed = np.append(freed, np.zeros(len(state) - len(freed), bool))
            self._contacts.force[freed[self._contacts.first] | freed[self._contacts.second]] = 0.0
        still = (state == BodyState.RESTING) | held
        still[0] = True
        if np.array_equal(still, self._still):
            return
        every = ContactRows(*(np.concatenate(columns) for columns
                              in zip(self._contacts, self._resting)))
        every = every.of(np.argsort(every.key, kind='stable'))
        asleep = still[every.first] & still[every.second]
        self._still, self._resting = still, every.of(asleep)
        self._contacts = every.of(~asleep)

    def _find(self, rows: np.ndarray, time_step: float) -> ContactRows:
        table, pieces = self._table, self._pieces
        live = PieceRows(*(column[:self._used] for column in pieces))
        pairs = self._pairs(rows, live)
        lands = ((table.state[live.body[rows]] == BodyState.AWAKE)
                 & (table.state[0] == BodyState.GROUND))  # the ground can be removed
        if len(self._joints):
            lands &= ~np.isin(live.body[rows], self._joints.rooted)
        extra, found = self._extra_points(), {}
        bounds = even_ranges(len(pairs), self.threads)

        def some(place: int, low: int, high: int) -> None:
            last = place == len(bounds) - 2  # the last range finds ground contacts, too
            contacts, count = find(rows if last else rows[:0], lands, pairs[low:high], live,
                                   table.poses, table.velocities,
                                   extra if last else tuple(column[:0] for column in extra),
                                   self._terrain, time_step, self._contacts)
            found[place] = contacts.head(count)
        run(some, bounds)
        parts = [found[place] for place in sorted(found)]
        return parts[0] if len(parts) == 1 else ContactRows(*map(np.concatenate, zip(*parts)))

    def _pairs(self, rows: np.ndarray, pieces: PieceRows) -> np.ndarray:
        """List the pairs of pieces that may collide as keys, ascending, (K,)."""
        table = self._table
        moves = np.where(table.state == BodyState.AWAKE, 2, table.state == BodyState.KINEMATIC)
        excluded = self._excluded
        if len(self._joints):
            excluded = np.union1d(excluded, join_key(*self._joints.apart().T))
        way = self._step * rim_speed(table, pieces.body[rows])
        return self._near.near(rows, way, pieces, moves, excluded)

    def _extra_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """List the ground contact points: bodies, positions in their frames, and names."""
        table = self._table
        ids = table.awake
        count = table.point_count[ids]
        body = np.repeat(ids, count)
        number = np.arange(len(body)) - np.repeat(np.cumsum(count) - count, count)
        name = body * _NUMBERED + np.minimum(number, _NUMBERED - 1)
        return body, table.ground_point[table.first_point[body] + number], name

    def contacts(self) -> np.ndarray:
        """Return the contact points of the last step, (C, 13); see `Engine.contacts`."""
        return np.concatenate([np.zeros((0, 13)), *self._told])


def _shares(effort: np.ndarray, threads: int) -> np.ndarray:
    """
    Distribute islands, sorted by descending effort, over threads.

    :param effort: of each island, see `efforts`, (I,).
    :returns: first island of each range, and one past the last, (ranges + 1,).
    """
    done = np.cumsum(effort)
    count = int(min(threads, max(done[-1] // _WORTH, 1.0))) if len(done) else 1
    inner = np.searchsorted(done, done[-1] * np.arange(1, count) / count) if count > 1 else []
    return np.concatenate([[0], inner, [len(effort)]]).astype(np.intp)
