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

from collections.abc import Callable, Mapping, Sequence
from typing import Self

import numpy as np

from procphys_ros.blueprint import Hexahedra
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.world import admission, extents, kinematic, settling
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.contacts import Contacts, total_impulse
from procphys_ros.physics.world.engine import DEFAULT_ENGINE, make_engine
from procphys_ros.physics.world.gain import limit_gain, pairs_around
from procphys_ros.physics.world.ground import (
    Correction,
    lift_fallen,
    lift_settled,
    touch_with_points,
)
from procphys_ros.physics.world.loose_bodies import fragment, FRICTION, LooseBody, plain
from procphys_ros.physics.world.merging import LEVEL
from procphys_ros.physics.world.pieces import Pieces
from procphys_ros.physics.world.rolling import resist_rolling
from procphys_ros.physics.world.saved import check_saved
from procphys_ros.physics.world.spin import limit_spin
from procphys_ros.physics.world.substeps import move
from procphys_ros.physics.world.waking import about_to_be_hit, sweep_fast

GRAVITY = (0.0, 0.0, -9.81)  # [m/s²]


class World:
    """
    Rigid bodies over the ground, named by small integers.

    Bodies at rest cost next to nothing: their poses are known without being read, and they do not
    meet each other. All that changes is in a `BodyTable` and a few arrays beside it, see
    `save_state`; the engine can be rebuilt from them. Several worlds may live side by side.

    :param gravity: [m/s²], (3,).
    :param friction: of the ground (as between two bodies that have this value).
    :param engine: name of an engine, see `make_engine`.
    :param terrain: the surface of the ground.
    :ivar ground: id of the ground.
    """

    ground = 0

    def __init__(self, gravity: Sequence[float] = GRAVITY, friction: float = FRICTION,
                 engine: str = DEFAULT_ENGINE, terrain: Terrain = FLAT):
        self._gravity = np.array(gravity, float)
        self._terrain = terrain
        self._engine = make_engine(engine, self._gravity, terrain)
        self._bodies = BodyTable()
        self._queue = admission.Queue(self._engine, self._bodies)
        self._supports = settling.Supports()
        self._contacts: Contacts | None = None
        self._lifts = self._point_contacts = self._early_contacts = np.zeros((0, 13))
        self._places, self._excluded = np.zeros((0, 3)), np.zeros((0, 2), np.intp)
        self._late_contacts: Callable[[], np.ndarray] = _nothing
        self._time_step, self._since_check = 1.0 / 60.0, 0.0
        self._asked, self._steps_asked = False, 0  # see `_touching`
        self._engine.add(self._bodies, self._bodies.add_ground(friction))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __getstate__(self) -> dict:
        raise TypeError('an engine of rigid bodies cannot be copied or pickled; fork, save, copy '
                        'or pickle the Simulation that it belongs to')

    def close(self) -> None:
        """Free the memory of the engine; nothing else may be called afterwards."""
        self._engine.close()

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return self._engine.name

    @property
    def awake(self) -> np.ndarray:
        """Ids of the bodies that move freely, ascending, (K,)."""
        return self._bodies.awake

    @property
    def bodies(self) -> BodyTable:
        """Columns of all bodies by id: poses, velocities, state; to be read, not written."""
        return self._bodies

    @property
    def supports(self) -> settling.Supports:
        """Who rests on whom; to be read, not written."""
        return self._supports

    def bounds(self, ids: np.ndarray) -> np.ndarray:
        """Give axis-aligned bounds, three minima, three maxima [m], (K, 6); hexahedra as boxes."""
        return extents.bounds(self._bodies, np.atleast_1d(ids))

    def pieces(self, body: int) -> Pieces:
        """Give the collision shapes of a body."""
        return self._bodies.pieces(body)

    def poses(self, ids: np.ndarray) -> np.ndarray:
        """Give centres of mass and principal axes in the world, (K, 7)."""
        return self._bodies.poses[ids]

    def velocities(self, ids: np.ndarray) -> np.ndarray:
        """Give velocities of centres of mass and spins, world axes, (K, 6)."""
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
        """Add bodies that move freely, and give their ids, (K,)."""
        ids = self._bodies.add_bodies(BodyState.AWAKE, bodies)
        self._engine.add(self._bodies, ids)
        return ids

    def add_driven(self, pieces: Pieces, pose: np.ndarray, friction: float = FRICTION) -> int:
        """
        Add a kinematic body: it goes where `drive` says, whatever is in its way but the fixed.

        :param pieces: its collision shapes.
        :param pose: (7,).
        :param friction: against a body of the same kind.
        """
        # Nothing can turn it.
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
        Add boxes that stand still until they are thawed; the engine gets them when it needs them.

        :param poses: (K, 7).
        :param sizes: full extents [m], (K, 3).
        :param mass: [kg], (K,).
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind.
        :param hexahedra: those of the boxes that are no rectangular ones.
        :param inertia: principal moments [kg·m²], (K, 3); None = of solid rectangular boxes.
        :returns: ids, (K,).
        """
        ids = self._bodies.add_boxes(BodyState.FIXED, poses, sizes, mass, friction, restitution,
                                     hexahedra or Hexahedra(), inertia)
        self._queue.append(ids)
        return ids

    def remove(self, ids: np.ndarray) -> None:
        """Remove bodies; those that rested on them are set free. Ids may be given again."""
        ids = np.atleast_1d(ids)
        if not len(ids):
            return
        carried = self._supports.carried_by(ids)
        if len(self._excluded):
            self.exclude_contacts(self._excluded[~np.isin(self._excluded, ids).any(axis=1)])
        self._bodies.remove(ids)
        self._supports.drop(self._bodies.state)
        self._engine.remove(self._queue.drop(ids))
        self.thaw(carried[self._bodies.state[carried] == BodyState.RESTING])

    def drive(self, body: int, pose: np.ndarray) -> None:
        """Set the pose of a kinematic body at the end of the next step, (7,)."""
        self._bodies.target[body] = pose

    def thaw(self, ids: np.ndarray, velocities: np.ndarray | None = None) -> None:
        """
        Set bodies free.

        :param ids: (K,).
        :param velocities: world axes, (K, 6); None = from rest.
        """
        ids = np.atleast_1d(np.asarray(ids, np.intp))
        if not len(ids):
            return
        self._bodies.set_state(ids, BodyState.AWAKE)
        self._bodies.restart_clocks(ids, settling.TREMBLE_TIME)
        self._engine.thaw(self._bodies, self._queue.admit_among(ids))
        self._supports.drop(self._bodies.state)
        if velocities is not None:
            self.set_velocities(ids, velocities)
            self._bodies.pushed[ids] = False

    def freeze(self, ids: np.ndarray) -> None:
        """Hold bodies where they are until they are thawed, (K,) ids."""
        self._hold(np.atleast_1d(np.asarray(ids, np.intp)), BodyState.FIXED)

    def _hold(self, ids: np.ndarray, state: BodyState) -> None:
        if not len(ids):
            return
        self._queue.admit_among(ids)
        self._bodies.set_state(ids, state)
        self._bodies.velocities[ids] = 0.0
        self._engine.freeze(ids)
        self._bodies.bounds[ids] = self.bounds(ids)

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set the velocities of loose bodies, world axes, (K, 6)."""
        ids = np.atleast_1d(ids)
        if not len(ids):
            return
        change = np.abs(self._bodies.velocities[ids] - velocities)[:, :3].max(axis=1, initial=0.0)
        self._bodies.pushed[ids] |= change > 0.5 * np.abs(self._gravity).max() * self._time_step
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
        Change the velocity of a body at once; one that rests is set free.

        :param impulse: [N·s], world, (3,).
        :param point: where it acts, world [m], (3,); None = at the centre of mass.
        :param angular: further angular impulse [N·m·s], world, (3,).
        """
        if self._bodies.state[body] in (BodyState.FIXED, BodyState.RESTING):
            self.thaw(np.array([body]))
        change = self._bodies.velocity_change(body, impulse, point, angular)
        self.set_velocities(np.array([body]), self._bodies.velocities[[body]] + change)

    def exclude_contacts(self, pairs: np.ndarray) -> None:
        """
        Choose the bodies that pass through each other; all others meet.

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
        """Give the contacts of the last step; ask before bodies are changed."""
        self._asked = True
        return self._read_contacts()

    def _read_contacts(self) -> Contacts:
        if self._contacts is None:
            tables = [self._early_contacts, self._point_contacts]
            if (self._bodies.state >= BodyState.AWAKE).any():
                tables.insert(1, self._late_contacts())
            self._contacts = Contacts.of(np.concatenate(tables), self._time_step)
        return self._contacts

    def _touching(self, ids: np.ndarray) -> np.ndarray:
        """
        Give pairs of bodies that touched in the step, of all islands that some are in, (C, 2).

        Where all contacts were wanted twice in a row, they will probably be read anyway.
        """
        early, pairs = self._early_contacts, None
        if self._steps_asked < 2 and not len(early):
            pairs = pairs_around(self._engine, self._bodies, ids)
        return np.vstack([early, self._late_contacts()])[:, :2] if pairs is None else pairs

    def lifts(self) -> Contacts:
        """Give what the ground did in the last step to bodies that were put back onto it."""
        return Contacts.of(self._lifts, self._time_step)

    def wrench(self, body: int) -> np.ndarray:
        """
        Give the mean force and moment that contacts had on a body in the last step.

        The engine finds contacts before it moves bodies, so their arms reach from there.

        :returns: force [N], moment about its centre of mass [N·m], world axes, (6,).
        """
        if body >= len(self._places):  # it has joined since
            return np.zeros(6)
        return total_impulse(body, self._places[body], self.contacts(),
                             self.lifts()) / self._time_step

    def step(self, time_step: float, threads: int = 1) -> None:
        """
        Advance time: wake what is about to be hit, move and collide, put to rest.

        :param time_step: [s].
        :param threads: of the engine at most; results are the same to the bit for any number.
        """
        self._engine.use_threads(threads)
        bodies = self._bodies
        self._time_step = time_step
        self._contacts = None
        self._steps_asked = self._steps_asked + 1 if self._asked else 0
        self._asked = False
        if not (bodies.state >= BodyState.AWAKE).any():
            self._pass_time(time_step)
            return
        self.thaw(about_to_be_hit(bodies, time_step))
        sweep_fast(self._engine, bodies, self.awake, time_step)
        self._queue.advance(self.awake, time_step)
        self._places = bodies.copied('poses', self._places)
        kinematic.set_out(bodies, time_step)
        awake = self.awake
        poses, before = bodies.poses[awake], bodies.velocities[awake]
        self._early_contacts, self._late_contacts = move(
            self._engine, bodies, awake, self._gravity, time_step)
        kinematic.arrive(self._engine, bodies)
        if len(awake):
            self.set_velocities(*resist_rolling(bodies, awake, before, self._gravity, time_step))
            self.set_velocities(*limit_spin(bodies, awake, poses, before, time_step))
            self.set_velocities(*limit_gain(
                bodies, awake, poses, before, time_step, np.asarray(self._gravity),
                self._touching))
        self._lifts = self._correct(lift_fallen(
            bodies, awake, self._places[awake], self._gravity, time_step, self._terrain))
        self._point_contacts = self._correct(touch_with_points(
            bodies, awake, time_step, self._terrain))
        self._settle(time_step)

    def _pass_time(self, time_step: float) -> None:
        """Advance time while nothing moves, without the engine: it visits even what sleeps."""
        self._places = self._bodies.copied('poses', self._places)
        self._lifts = self._point_contacts = self._early_contacts = np.zeros((0, 13))
        self._late_contacts = _nothing
        self._since_check += time_step
        if self._since_check > settling.CHECK_INTERVAL - 1e-9:
            self._since_check = 0.0

    def _correct(self, correction: Correction) -> np.ndarray:
        """Move bodies as the ground does, and give its contacts with them."""
        if len(correction.ids):
            self.set_poses(correction.ids, correction.poses)
            self.set_velocities(correction.ids, correction.velocities)
        return correction.contacts

    def _settle(self, time_step: float) -> None:
        bodies = self._bodies
        candidates = settling.count_quiet(bodies, self.awake, time_step)
        self._since_check += time_step
        if self._since_check > settling.CHECK_INTERVAL - 1e-9:
            self._since_check = 0.0
            if len(candidates):
                contacts = self._read_contacts().both_ways()
                rests, jammed = settling.at_rest(bodies, candidates, contacts)
                self._take_out(rests)
                self._supports.add(bodies, contacts, rests)
                self._hold(rests, BodyState.RESTING)
                self.thaw(jammed)
        lost = self._supports.lost(bodies)
        if len(lost):
            self._late_contacts()  # Bullet forgets those of bodies that are set free
        self.thaw(lost)

    def _take_out(self, rests: np.ndarray) -> None:
        """Lift bodies that come to rest out of the ground; what lies on them settles anew."""
        ids, poses = lift_settled(self._bodies, rests, self._terrain)
        self.set_poses(ids, poses)
        self.thaw(self._supports.carried_by(ids))

    def save_state(self) -> dict[str, np.ndarray]:
        """
        Copy all that changes, as arrays.

        An engine holds caches that cannot be read, so a world goes on from here like one that was
        restored only after `rebuild`.
        """
        contacts = self.contacts()
        arrays = {f'bodies.{name}': column for name, column in self._bodies.save().items()}
        arrays |= {f'supports.{name}': column.copy()
                   for name, column in vars(self._supports).items()}
        arrays |= {f'contacts.{name}': column.copy() for name, column in vars(contacts).items()}
        used = len(arrays['bodies.state'])
        return arrays | {
            **{f'terrain.{name}': np.array(column)
               for name, column in self._terrain._asdict().items()},
            'gravity': self._gravity.copy(), 'lifts': self._lifts.copy(),
            'point_contacts': self._point_contacts.copy(), 'places': self._places[:used].copy(),
            'excluded': self._excluded.copy(),
            'clocks': np.array([self._time_step, self._since_check])}

    @classmethod
    def restore(cls, arrays: Mapping[str, np.ndarray], engine: str = DEFAULT_ENGINE) -> Self:
        """
        Build a world from what `save_state` gave, with any engine.

        :param arrays: as saved; they are copied.
        :param engine: name of an engine, see `make_engine`.
        :raises ValueError: when they are not laid out as `save_state` does, or name bodies that
            there are not.
        """
        check_saved(arrays)
        ground = _group(arrays, 'terrain.')
        terrain = Terrain(ground['heights'], ground['low'], float(ground['edge']))
        world = cls(arrays['gravity'].tolist(), engine=engine, terrain=terrain)
        world._bodies = BodyTable.restore(_group(arrays, 'bodies.'))
        vars(world._supports).update(_group(arrays, 'supports.'))
        world._contacts = Contacts(**_group(arrays, 'contacts.'))
        world._lifts, world._places = arrays['lifts'].copy(), arrays['places'].copy()
        world._point_contacts = arrays['point_contacts'].copy()
        world._excluded = arrays['excluded'].copy()
        world._time_step, world._since_check = arrays['clocks'].tolist()
        world.rebuild()
        return world

    def rebuild(self) -> None:
        """Rebuild the engine from the table: it then goes on as in any world restored from it."""
        self.contacts()  # the engine forgets those of the last step
        self._engine.clear()
        ids = self._bodies.ids
        waits = (self._bodies.state[ids] == BodyState.FIXED) & (self._bodies.least[ids] > 0.0)
        self._engine.add(self._bodies, ids[~waits])
        self._queue = admission.Queue(self._engine, self._bodies)
        self._queue.append(ids[waits])
        self._queue.admit_among(self._excluded)
        self._engine.set_excluded(self._excluded, True)


def _group(arrays: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    """Copy the arrays whose names begin so, under the rest of their names."""
    return {name.removeprefix(prefix): column.copy() for name, column in arrays.items()
            if name.startswith(prefix)}


def _nothing() -> np.ndarray:
    """Give the contacts of a step in which nothing moves, (0, 13)."""
    return np.zeros((0, 13))
