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


"""Joint table: joints between the bodies of a world, a row per joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.rigid.joints import JointKind, JointRows, no_joints
from procphys_ros.physics.world.body_table import BodyState, BodyTable

Numbers = np.ndarray | float
_MOVABLE = (BodyState.FIXED, BodyState.RESTING, BodyState.AWAKE)
_MOST = np.inf
_GONE, _WELD = int(JointKind.GONE), int(JointKind.WELD)  # to look them up takes a microsecond
_GROUND = 0  # id of the ground, see `World.ground`


@dataclass(frozen=True)
class JointOptions:
    """
    Limits, springs, motors and strength of joints, along (slider, rope) or about (hinge) an axis.

    Each is one number for all joints, or (K,).

    :ivar low: least displacement [m, rad]; ropes have none.
    :ivar high: greatest displacement; the length of a rope [m, rad].
    :ivar stiffness: of a spring [N/m, N·m/rad].
    :ivar damping: [N·s/m, N·m·s/rad].
    :ivar rest: displacement at which the spring is slack [m, rad].
    :ivar speed: of a motor, of the first body relative to the second [m/s, rad/s].
    :ivar drive: greatest force or moment of the motor [N, N·m].
    :ivar force: break force of the joint [N].
    :ivar moment: break moment about the joint's point [N·m].
    :ivar collides: whether the two bodies collide.
    """

    low: Numbers = -_MOST
    high: Numbers = _MOST
    stiffness: Numbers = 0.0
    damping: Numbers = 0.0
    rest: Numbers = 0.0
    speed: Numbers = 0.0
    drive: Numbers = 0.0
    force: Numbers = _MOST
    moment: Numbers = _MOST
    collides: np.ndarray | bool = False

    def check(self) -> None:
        """
        Check the ranges of the options.

        :raises ValueError: when one is not a number, or not in its range; names it.
        """
        for name, value in vars(self).items():
            least = 0.0 if name in _NOT_NEGATIVE else -_MOST
            if not (np.asarray(value) >= least).all():
                raise ValueError(f'{name} of a joint is {value}, not a number of at least {least}')
            if name in _FINITE and not np.isfinite(value).all():
                raise ValueError(f'{name} of a joint is {value}, not a finite number')
        if not (np.asarray(self.low) <= self.high).all():
            raise ValueError(f'low of a joint is {self.low}, above its high, {self.high}')


_NOT_NEGATIVE = ('stiffness', 'damping', 'drive', 'force', 'moment')
_FINITE = ('stiffness', 'damping', 'rest', 'speed', 'drive')


class JointTable:
    """
    Columns of the joints of a world; rows of removed joints are reused.

    :ivar rows: the columns; an engine with joints writes displacements, forces and moments.
    """

    def __init__(self) -> None:
        self.rows = no_joints(0)

    def __len__(self) -> int:
        return len(self.rows.kind)

    @property
    def holding(self) -> np.ndarray:
        """Ids of the unbroken joints, ascending, (K,)."""
        return np.flatnonzero((self.rows.kind != _GONE) & ~self.rows.broken)

    @property
    def rooted(self) -> np.ndarray:
        """Ids of the bodies that are welded to the ground, and do not collide with it, (K,)."""
        rows, ids = self.rows, self.holding
        ids = ids[(rows.kind[ids] == _WELD) & ~rows.collides[ids]]
        ends = np.stack([rows.first[ids], rows.second[ids]])
        return ends.max(axis=0)[ends.min(axis=0) == _GROUND]

    def add(self, bodies: BodyTable, kind: np.ndarray, ends: np.ndarray, frames: np.ndarray,
            options: JointOptions) -> np.ndarray:
        """
        Add joints at the present poses of bodies; return their ids, (K,).

        :param bodies: table of the two bodies of each, `ends` (K, 2).
        :param kind: `JointKind`, (K,).
        :param frames: on the first and on the second body, world, (K, 2, 7).
        :raises ValueError: when there is no such body or kind, or neither of two bodies can move,
            or an option is out of its range.
        """
        options.check()
        self._check(bodies, kind, ends)
        ids = self._new_rows(len(ends))
        rows = self.rows
        rows.kind[ids], rows.first[ids], rows.second[ids] = kind, *ends.T
        for side, column in enumerate((rows.frame, rows.other_frame)):
            column[ids] = rotation.relative(bodies.poses[ends[:, side]], frames[:, side])
        for name, value in vars(options).items():
            if name not in ('force', 'moment'):
                getattr(rows, name)[ids] = value
        rows.strength[ids, 0], rows.strength[ids, 1] = options.force, options.moment
        rows.low[ids[kind == JointKind.ROPE]] = -_MOST
        return ids

    def _check(self, bodies: BodyTable, kind: np.ndarray, ends: np.ndarray) -> None:
        unknown = ~np.isin(kind, [one for one in JointKind if one])
        if unknown.any():
            names = ', '.join(one.name for one in JointKind if one)
            raise ValueError(f'there is no kind {kind[unknown][0]} of joints (known: {names})')
        there = (ends >= 0) & (ends < len(bodies.state))
        there[there] = bodies.state[ends[there]] != BodyState.GONE
        if not there.all():
            raise ValueError(f'there is no body {ends[~there][0]} to be joined')
        idle = ~np.isin(bodies.state[ends], _MOVABLE).any(axis=1) | (ends[:, 0] == ends[:, 1])
        if idle.any():
            raise ValueError('bodies {} and {} cannot move against each other'.format(
                *ends[idle][0]))

    def _new_rows(self, count: int) -> np.ndarray:
        free = np.flatnonzero(self.rows.kind == _GONE)[:count]
        used = len(self)
        more = count - len(free)
        ids = np.concatenate([free, np.arange(used, used + more)])
        if more:
            self.rows = JointRows(*(np.concatenate(columns) for columns
                                    in zip(self.rows, no_joints(more))))
        for column in self.rows:
            column[ids] = 0
        return ids

    def remove(self, ids: np.ndarray) -> None:
        """Remove joints, (K,) ids."""
        for column in self.rows:
            column[ids] = 0

    def of_bodies(self, bodies: np.ndarray) -> np.ndarray:
        """List the joints of some bodies, broken or not, (K,) ids."""
        there = self.rows.kind != _GONE
        return np.flatnonzero(there & (np.isin(self.rows.first, bodies)
                                       | np.isin(self.rows.second, bodies)))

    def led(self, bodies: BodyTable) -> np.ndarray:
        """List the sleeping bodies with joints to kinematic ones that are about to move, (M,)."""
        ids = self.holding
        ends = np.concatenate([self.rows.first[ids], self.rows.second[ids]])
        others = np.roll(ends, len(ids))
        ends, others = (column[(bodies.state[ends] == BodyState.RESTING)
                               & (bodies.state[others] == BodyState.KINEMATIC)]
                        for column in (ends, others))
        return ends[(bodies.poses[others] != bodies.target[others]).any(axis=1)]

    def set_out(self) -> None:
        """Clear the forces of the last step."""
        if len(self):
            self.rows.force[:] = self.rows.moment[:] = 0.0

    def apart(self) -> np.ndarray:
        """List the pairs of jointed bodies that do not collide, the lower id first, (K, 2)."""
        rows = self.rows
        ids = np.flatnonzero((rows.kind != _GONE) & ~rows.broken & ~rows.collides)
        return np.sort(np.column_stack([rows.first[ids], rows.second[ids]]), axis=1)

    def pulls(self, bodies: BodyTable) -> np.ndarray:
        """Return joint forces of the last step as contacts, see `Engine.contacts`, (K, 13)."""
        ids = self.holding
        first, force = self.rows.first[ids], self.rows.force[ids]
        size = norm(force, axis=1)
        out = np.zeros((len(size), 13))
        out[:, 0], out[:, 1] = first, self.rows.second[ids]
        out[:, 2:5] = bodies.poses[first, :3] + rotation.rotate(
            bodies.poses[first, 3:], self.rows.frame[ids, :3])
        out[:, 9:12] = force
        # Slack joints connect their bodies, too.
        out[:, 12] = np.maximum(size, np.finfo(float).tiny)
        return out

    def save(self) -> dict[str, np.ndarray]:
        """Return copies of the columns."""
        return {name: column.copy() for name, column in self.rows._asdict().items()}

    @classmethod
    def restore(cls, saved: Mapping[str, np.ndarray]) -> Self:
        """Build a table from the result of `save`."""
        table = cls()
        table.rows = JointRows(**{name: saved[name].copy() for name in JointRows._fields})
        return table
