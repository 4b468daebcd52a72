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

"""World: rigid bodies that collide, fall and come to rest."""

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from procphys_ros.blueprint import Hexahedra
from procphys_ros.errors import SceneError
from procphys_ros.physics.gravity import GRAVITY
from procphys_ros.physics.rigid.joints import JointRows
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world import admission, extents, kinematic, sleeping
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.contacts import Contacts, total_impulse
from procphys_ros.physics.world.engine import DEFAULT_ENGINE, Looked, make_engine, SavableEngine
from procphys_ros.physics.world.joint_table import JointOptions, JointTable
from procphys_ros.physics.world.loose_bodies import fragment, FRICTION, LooseBody, plain
from procphys_ros.physics.world.merging import LEVEL
from procphys_ros.physics.world.pieces import Pieces
from procphys_ros.physics.world.saved import check_saved

DOWNWARDS = (0.0, 0.0, -GRAVITY)  # [m/s²]


class World:
    """
    Rigid bodies over the ground, identified by integer ids.

    Bodies at rest sleep and cost almost no time, see `sleeping`. The state is a `BodyTable` and
    a few arrays beside it, see `save_state`; the engine can be rebuilt from them.
    Several worlds may coexist.

    :param gravity: [m/s²], (3,).
    :param friction: of the ground (as between two bodies that have this value).
    :param engine: name of an engine, see `make_engine`.
    :param terrain: the surface of the ground.
    :ivar ground: id of the ground.
    """

    ground = 0

    def __init__(self, gravity: Sequence[float] = DOWNWARDS, friction: float = FRICTION,
                 engine: str = DEFAULT_ENGINE, terrain: Terrain = FLAT):
        self._gravity = np.array(gravity, float)
        self._terrain = terrain
        self._engine = make_engine(engine, self._gravity, terrain)
        self._bodies, self._joints = BodyTable(), JointTable()
        self._queue = admission.Queue(self._engine, self._bodies)
        # Rows of `Engine.contacts`; `_slept` are those of bodies that slept through the last step.
        self._table = self._asleep = self._slept = np.zeros((0, 13))
        self._places, self._excluded = np.zeros((0, 3)), np.zeros((0, 2), np.intp)
        self._time_step = 1.0 / 60.0
        self._engine.add(self._bodies, self._bodies.add_ground(friction))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __getstate__(self) -> dict:
        raise TypeError('an engine of rigid bodies cannot be copied or pickled; fork, save, copy '
                        'or pickle the Simulation that it belongs to')

    def close(self) -> None:
        """Free the memory of the engine; the world cannot be used afterwards."""
        self._engine.close()

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self._engine.name

    @property
    def has_joints(self) -> bool:
        """Whether the engine supports joints."""
        return self._engine.has_joints

    @property
    def awake(self) -> np.ndarray:
        """Ids of the bodies that move freely, ascending, (K,)."""
        return self._bodies.awake

    @property
    def gravity(self) -> np.ndarray:
        """Acceleration of free bodies [m/s²], (3,)."""
        return self._gravity

    @property
    def bodies(self) -> BodyTable:
        """Columns of all bodies by id: poses, velocities, state; read-only."""
        return self._bodies

    @property
    def joints(self) -> JointRows:
        """Columns of all joints by id, with their forces; read-only."""
        return self._joints.rows

    @property
    def jointed(self) -> np.ndarray:
        """Ids of the bodies with joints that hold, ascending, (K,)."""
        rows, ids = self.joints, self._joints.holding
        return np.union1d(rows.first[ids], rows.second[ids])

    @property
    def asleep(self) -> Contacts:
        """Contacts with which bodies fell asleep; their impulses are those of one second."""
        return Contacts.of(self._asleep, 1.0)

    @property
    def slept(self) -> Contacts:
        """Likewise, of those that slept through the last step: they are not in `contacts`."""
        return Contacts.of(self._slept, 1.0)

    def bounds(self, ids: np.ndarray) -> np.ndarray:
        """Compute axis-aligned bounds, three minima, three maxima [m], (K, 6), see `extents`."""
        return extents.bounds(self._bodies, np.atleast_1d(ids))

    def pieces(self, body: int) -> Pieces:
        """Return the collision shapes of a body."""
        return self._bodies.pieces(body)

    def poses(self, ids: np.ndarray) -> np.ndarray:
        """Return centres of mass and principal axes in the world, (K, 7)."""
        return self._bodies.poses[ids]

    def velocities(self, ids: np.ndarray) -> np.ndarray:
        """Return velocities of centres of mass and angular velocities, world axes, (K, 6)."""
        return self._bodies.velocities[ids]

    def add_body(self, shape: int, size: np.ndarray, mass: float, pose: np.ndarray,
                 velocity: np.ndarray | None = None, inertia: np.ndarray | None = None,
                 friction: float = FRICTION, restitution: float = 0.0,
                 hexahedra: Hexahedra | None = None) -> int:
        """Add one loose box or capsule; see `loose_bodies.plain`."""
        return int(self.add_loose([plain(shape, size, mass, pose, velocity, inertia, friction,
                                         restitution, hexahedra)])[0])

    def add_projectile(self, shape: int, size: np.ndarray, mass: float, pose: np.ndarray,
                       velocity: np.ndarray, friction: float = FRICTION,
                       restitution: float = 0.3) -> int:
        """Add a loose body that bounces; see `add_body`."""
        return self.add_body(shape, size, mass, pose, velocity, None, friction, restitution)

    def add_fragment(self, shapes: np.ndarray, sizes: np.ndarray, local_poses: np.ndarray,
                     mass: float, inertia: np.ndarray, pose: np.ndarray,
                     velocity: np.ndarray | None = None, friction: float = FRICTION,
                     restitution: float = 0.0, tolerance: float = LEVEL,
                     hexahedra: Hexahedra | None = None) -> int:
        """Add a loose rigid body made of boxes and capsules; see `loose_bodies.fragment`."""
        return int(self.add_loose([fragment(shapes, sizes, local_poses, mass, inertia, pose,
                                            velocity, friction, restitution, tolerance,
                                            hexahedra)])[0])

    def add_loose(self, bodies: Sequence[LooseBody]) -> np.ndarray:
        """Add bodies that move freely; return their ids, (K,)."""
        ids = self._bodies.add_bodies(BodyState.AWAKE, bodies)
        self._engine.add(self._bodies, ids)
        return ids

    def add_driven(self, pieces: Pieces, pose: np.ndarray, friction: float = FRICTION) -> int:
        """
        Add a kinematic body, which follows `drive` and passes through immovable bodies.

        :param pieces: its collision shapes.
        :param pose: (7,).
        :param friction: against a body of the same kind.
        """
        # So heavy that no contact turns it.
        inertia = np.full(3, 0.4 * kinematic.MASS * np.square(pieces.radius()))
        is_plain = len(pieces.shapes) == 1 and np.array_equal(
            pieces.local_poses[0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        least = float(pieces.sizes[0].min()) if is_plain else 0.0
        ids = self._bodies.add_bodies(BodyState.KINEMATIC, [LooseBody(
            pieces, kinematic.MASS, inertia, pose, None, friction, 0.0, least)])
        self._engine.add(self._bodies, ids)
        return int(ids[0])

    def add_bricks(self, poses: np.ndarray, sizes: np.ndarray, mass: np.ndarray,
                   friction: float = FRICTION, restitution: float = 0.0,
                   hexahedra: Hexahedra | None = None,
                   inertia: np.ndarray | None = None) -> np.ndarray:
        """
        Add boxes that are fixed until they are thawed; the engine gets them on demand.

        :param poses: (K, 7).
        :param sizes: full extents [m], (K, 3).
        :param mass: [kg], (K,).
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind.
        :param hexahedra: corners of the boxes that are not rectangular.
        :param inertia: principal moments [kg·m²], (K, 3); None = of solid rectangular boxes.
        :returns: ids, (K,).
        """
        ids = self._bodies.add_boxes(BodyState.FIXED, poses, sizes, mass, friction, restitution,
                                     hexahedra or Hexahedra(), inertia)
        self._queue.append(ids)
        return ids

    def join(self, kind: np.ndarray | int, first: np.ndarray, second: np.ndarray,
             frames: np.ndarray, options: JointOptions | None = None,
             other_frames: np.ndarray | None = None) -> np.ndarray:
        """
        Connect bodies by joints at their present poses; see `JointKind`.

        :param kind: one for all, or (K,).
        :param first, second: ids of bodies, or of the ground, (K,).
        :param frames: of the joints, world, with the x axis along the joint's axis, (K, 7).
        :param options: limits, springs, motors and strengths; None = none of them.
        :param other_frames: on the second bodies, (K, 7); None = the same ones.
        :returns: ids of the joints, (K,); they are removed with their bodies.
        :raises SceneError: when the engine does not support joints.
        :raises ValueError: when there is no such body, or an option is out of its range.
        """
        ends = np.column_stack([np.atleast_1d(first), np.atleast_1d(second)])
        frames = np.atleast_2d(frames)
        others = frames if other_frames is None else np.atleast_2d(other_frames)
        self._hand_joints()
        ids = self._joints.add(self._bodies, np.broadcast_to(kind, len(ends)), ends,
                               np.stack(np.broadcast_arrays(frames, others), axis=1),
                               options or JointOptions())
        self.wake(ends)
        return ids

    def _hand_joints(self) -> None:
        if not self.has_joints:
            raise SceneError(f'engine is "{self.engine}", which has no joints: take "native"')
        self._engine.set_joints(self._joints)

    def set_motors(self, ids: np.ndarray, speed: np.ndarray, drive: np.ndarray) -> None:
        """
        Set speeds and greatest forces of the motors of joints, see `JointOptions`, (K,) each.

        Sleeping bodies go on sleeping; `wake` wakes them.
        """
        self._joints.rows.speed[ids], self._joints.rows.drive[ids] = speed, drive

    def part(self, ids: np.ndarray) -> None:
        """Remove joints, (K,) ids, which may be reused, and wake their bodies."""
        rows = self.joints.of(np.atleast_1d(ids))
        self._joints.remove(ids)
        self.wake(np.stack([rows.first, rows.second]))

    def wake(self, ids: np.ndarray) -> None:
        """Wake those of some bodies that sleep, and reset the clocks of all, (K,) ids."""
        ids = np.unique(ids)
        self._bodies.quiet[ids] = 0.0
        self.thaw(ids[self._bodies.state[ids] == BodyState.RESTING])

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies, and thaw those that rested on them; ids may be reused."""
        ids = np.atleast_1d(ids)
        if not len(ids):
            return
        carried = sleeping.sleepers_on(self._asleep, ids, self._bodies)
        self._joints.remove(self._joints.of_bodies(ids))
        if len(self._excluded):
            self.exclude_contacts(self._excluded[~np.isin(self._excluded, ids).any(axis=1)])
        self._bodies.remove(ids)
        self._engine.remove(self._queue.drop(ids))
        self._asleep = self._asleep[~np.isin(self._asleep[:, :2], ids).any(axis=1)]
        self.thaw(carried[self._bodies.state[carried] == BodyState.RESTING])

    def replace(self, former: np.ndarray, heirs: np.ndarray) -> None:
        """
        Remove bodies in whose place others are; contacts of this step go to the nearest of these.

        :param former, heirs: pairs of ids, (K,); a body may have several heirs.
        """
        pairs = np.unique(np.column_stack([former, heirs]), axis=0)
        self._engine.hand_on(pairs[:, 0], pairs[:, 1], self.bounds(pairs[:, 1]))
        self.remove(np.array(list(dict.fromkeys(former.tolist())), np.intp))

    def drive(self, body: int, pose: np.ndarray) -> None:
        """Set the pose of a kinematic body at the end of the next step, (7,)."""
        self._bodies.target[body] = pose

    def thaw(self, ids: np.ndarray, velocities: np.ndarray | None = None) -> None:
        """
        Make bodies free to move; sleeping bodies wake with their islands.

        :param ids: (K,).
        :param velocities: world axes, (K, 6); None = from rest.
        """
        ids = np.atleast_1d(np.asarray(ids, np.intp))
        if not len(ids):
            return
        woken = sleeping.with_islands(self._asleep, ids, self._bodies)
        self._bodies.set_state(woken, BodyState.AWAKE)
        self._bodies.quiet[woken], self._bodies.mark[woken] = 0.0, self._bodies.poses[woken]
        self._engine.thaw(self._bodies, self._queue.admit_among(woken))
        self._asleep = sleeping.without_sleepers(self._asleep, self._bodies)
        if velocities is not None:
            self.set_velocities(ids, velocities)

    def freeze(self, ids: np.ndarray) -> None:
        """Fix bodies at their present poses until they are thawed, (K,) ids."""
        self._hold(np.atleast_1d(np.asarray(ids, np.intp)), BodyState.FIXED)

    def _hold(self, ids: np.ndarray, state: BodyState) -> None:
        if not len(ids):
            return
        self._queue.admit_among(ids)
        self._bodies.set_state(ids, state)
        self._bodies.velocities[ids] = 0.0
        self._engine.freeze(ids)
        self._bodies.bounds[ids] = self.bounds(ids)

    def set_gravity(self, gravity: np.ndarray) -> None:
        """
        Set the acceleration of bodies [m/s²], (3,); if it changes, none is at rest.

        Without contacts that move, what sleeps would never feel it.
        """
        if np.array_equal(gravity, self._gravity):
            return
        self._gravity = np.array(gravity, float)
        self.wake(self._bodies.ids)
        self._engine.set_gravity(self._gravity)

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """
        Set the velocities of loose bodies, world axes, (K, 6).

        This resets the sleep clocks: bodies under external loads are not at rest, at any speed.
        """
        ids = np.atleast_1d(ids)
        if len(ids):
            self._bodies.quiet[ids] = 0.0
            self._write_velocities(ids, velocities)

    def _write_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        self._bodies.velocities[ids] = velocities
        self._engine.set_velocities(ids, self._bodies.velocities[ids])

    def set_poses(self, ids: np.ndarray, poses: np.ndarray) -> None:
        """Set the poses of bodies, (K, 7)."""
        ids = np.atleast_1d(ids)
        self._queue.admit_among(ids)
        self._bodies.poses[ids] = poses
        self._engine.set_poses(ids, self._bodies.poses[ids])

    def apply_impulse(self, body: int, impulse: np.ndarray, point: np.ndarray | None = None,
                      angular: np.ndarray | None = None) -> None:
        """
        Apply an impulse to a body; fixed and sleeping bodies are thawed.

        :param impulse: [N·s], world, (3,).
        :param point: point of application, world [m], (3,); None = at the centre of mass.
        :param angular: further angular impulse [N·m·s], world, (3,).
        """
        if self._bodies.state[body] in (BodyState.FIXED, BodyState.RESTING):
            self.thaw(np.array([body]))
        change = self._bodies.velocity_change(body, impulse, point, angular)
        self.set_velocities(np.array([body]), self._bodies.velocities[[body]] + change)

    def add_velocities(self, ids: np.ndarray, change: np.ndarray) -> None:
        """
        Add to the velocities of loose bodies, world axes, (K, 6), with what their joints add.

        Like `set_velocities`, this resets sleep clocks.
        """
        if np.isin(ids, self.jointed).any():
            whole = np.zeros((len(self._bodies.velocities), 6))
            whole[ids] = change
            whole = self._engine.respond(whole)
            ids = np.flatnonzero(whole.any(axis=1))
            change = whole[ids]
        self.set_velocities(ids, self._bodies.velocities[ids] + change)

    def push(self, ids: np.ndarray, change: np.ndarray, stirs: np.ndarray) -> None:
        """
        Add to the velocities of free bodies, world axes, (K, 6).

        :param stirs: whether this resets their sleep clocks, (K,) bool.
        """
        self._bodies.quiet[ids[stirs]] = 0.0
        self._write_velocities(ids, self._bodies.velocities[ids] + change)

    def exclude_contacts(self, pairs: np.ndarray) -> None:
        """
        Set the pairs of bodies that do not collide; all others do.

        :param pairs: two ids each, the lower one first, in lexicographic order, (K, 2).
        """
        if np.array_equal(pairs, self._excluded):
            return
        known = {tuple(pair) for pair in self._excluded.tolist()}
        wanted = {tuple(pair) for pair in pairs.tolist()}
        for some, excluded in ((known - wanted, False), (wanted - known, True)):
            if some:
                self._queue.admit_among(np.array(sorted(some)))
                self._engine.set_excluded(np.array(sorted(some)), excluded)
        self._excluded = np.array(pairs, np.intp).reshape(-1, 2)

    def contacts(self) -> Contacts:
        """Return the contacts of the last step; there are none between sleeping bodies."""
        return Contacts.of(self._table, self._time_step)

    def wrench(self, body: int) -> np.ndarray:
        """
        Compute the mean force and moment of contacts on a body in the last step.

        The engine finds contacts before it moves bodies, so lever arms are those of that time.
        Sleeping bodies press as they did when they fell asleep.

        :returns: force [N], moment about its centre of mass [N·m], world axes, (6,).
        """
        if body >= len(self._places):  # added since
            return np.zeros(6)
        slept = self._slept[self._slept[:, 5:8].any(axis=1)]  # joints have no normal
        table = Contacts.of(np.concatenate([self._table, slept]), 1.0)
        return total_impulse(body, self._places[body], table)

    def step(self, time_step: float, threads: int = 1, looked: Looked | None = None) -> None:
        """
        Advance time: wake bodies about to be hit, move and collide, put bodies at rest to sleep.

        :param time_step: [s].
        :param threads: largest number of threads; results do not depend on it, to the last bit.
        :param looked: see `Engine.step`.
        """
        bodies, self._time_step = self._bodies, time_step
        self._table = self._table[:0]
        if (bodies.state >= BodyState.AWAKE).any():
            self.thaw(sleeping.struck(bodies, self._asleep, time_step))
            self.thaw(self._joints.led(bodies))
            self._queue.advance(self.awake, time_step)
        self._places, self._slept = bodies.copied('poses', self._places), self._asleep
        if not (bodies.state >= BodyState.AWAKE).any():
            return
        kinematic.set_out(bodies, time_step)
        self._engine.threads = threads
        self._engine.step(time_step, looked)
        self._table = self._engine.contacts()
        kinematic.arrive(self._engine, bodies)
        self._settle(time_step)

    def _settle(self, time_step: float) -> None:
        """Put islands at rest to sleep, and wake sleeping bodies whose load has changed."""
        bodies, table = self._bodies, self._table
        if len(self._joints):
            table = np.concatenate([table, self._joints.pulls(bodies)])
        woken = sleeping.disturbed(bodies, self._asleep, table, self._gravity)
        falls = sleeping.quiet_islands(bodies, self.awake, table, time_step)
        if len(falls):
            self._asleep = sleeping.join(self._asleep, table, falls, bodies)
            self._hold(falls, BodyState.RESTING)
        self.thaw(woken)

    def save_state(self) -> dict[str, np.ndarray]:
        """
        Return copies of the state as arrays.

        With an engine whose caches cannot be saved, a world continues like one restored from
        these arrays only after `rebuild`.
        """
        arrays = {f'bodies.{name}': column for name, column in self._bodies.save().items()}
        used = len(arrays['bodies.state'])
        if len(self._joints):
            arrays |= {f'joints.{name}': column for name, column in self._joints.save().items()}
        if isinstance(self._engine, SavableEngine):
            arrays |= {f'engine.{name}': column for name, column in self._engine.save().items()}
        return arrays | {
            **{f'terrain.{name}': np.array(column)
               for name, column in self._terrain._asdict().items()},
            'gravity': self._gravity.copy(), 'contacts': self._table.copy(),
            'asleep': self._asleep.copy(), 'places': self._places[:used].copy(),
            'excluded': self._excluded.copy(), 'time_step': np.array(self._time_step)}

    @classmethod
    def restore(cls, arrays: Mapping[str, np.ndarray], engine: str = DEFAULT_ENGINE) -> Self:
        """
        Build a world from the arrays of `save_state`, with any engine.

        :param arrays: as saved; they are copied.
        :param engine: name of an engine, see `make_engine`.
        :raises ValueError: when their layout differs from that of `save_state`, or they refer to
            bodies that do not exist.
        """
        check_saved(arrays)
        ground = _group(arrays, 'terrain.')
        terrain = Terrain(ground['heights'], ground['low'], float(ground['edge']))
        world = cls(arrays['gravity'].tolist(), engine=engine, terrain=terrain)
        world._bodies = BodyTable.restore(_group(arrays, 'bodies.'))
        if 'joints.kind' in arrays:
            world._joints = JointTable.restore(_group(arrays, 'joints.'))
        world._table, world._asleep = arrays['contacts'].copy(), arrays['asleep'].copy()
        world._slept = world._asleep
        world._places, world._excluded = arrays['places'].copy(), arrays['excluded'].copy()
        world._time_step = float(arrays['time_step'])
        world._build(_group(arrays, 'engine.'))
        return world

    def rebuild(self) -> None:
        """Rebuild an engine that cannot be saved; it then continues as in a restored world."""
        if not isinstance(self._engine, SavableEngine):
            self._build({})

    def _build(self, saved: Mapping[str, np.ndarray]) -> None:
        """Build the engine from the table, and from the saved caches of one of its kind."""
        self._engine.clear()
        ids = self._bodies.ids
        waits = (self._bodies.state[ids] == BodyState.FIXED) & (self._bodies.least[ids] > 0.0)
        if saved and isinstance(self._engine, SavableEngine):
            waits &= ~np.isin(ids, saved['order'])
            self._engine.restore(self._bodies, saved)
        else:
            self._engine.add(self._bodies, ids[~waits])
        self._queue = admission.Queue(self._engine, self._bodies)
        self._queue.append(ids[waits])
        self._queue.admit_among(self._excluded)
        self._engine.set_excluded(self._excluded, True)
        if len(self._joints):
            self._hand_joints()


def _group(arrays: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """Return copies of the arrays with a prefix, keyed by their names without it."""
    return {name.removeprefix(prefix): column.copy() for name, column in arrays.items()
            if name.startswith(prefix)}
