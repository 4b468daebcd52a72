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

"""The bodies of a world: put in, taken out, held, set free, pushed."""

from collections.abc import Sequence
from typing import Self

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import box_inertia, cylinder_inertia, Shape
from procphys_ros.physics.world import compound, settling
from procphys_ros.physics.world.bodies import Bodies, State
from procphys_ros.physics.world.driven import Courses, MASS
from procphys_ros.physics.world.engine import Engine
from procphys_ros.physics.world.merging import merge_boxes
from procphys_ros.physics.world.pieces import Pieces, single

GRAVITY = (0.0, 0.0, -9.81)  # [m/s²]
FRICTION = 0.7  # dry brick on brick, broken mortar; also wood on earth
# Who meets whom (collision groups and masks): two bodies meet when each one's mask has the
# other's group. What is fixed never meets what is fixed, a driven body goes through it.
#                 loose fixed proxy driven
#   loose (1)       x     x     x     x
#   fixed (2)       x     -     -     -      ground, held, resting
#   proxy (4)       x     -     -     x
#   driven (8)      x     -     x     -
_LOOSE, _FIXED, _PROXY, _DRIVEN = 1, 2, 4, 8
_FILTERS = {
    State.LOOSE: (_LOOSE, _LOOSE | _FIXED | _PROXY | _DRIVEN),
    State.GROUND: (_FIXED, _LOOSE),
    State.HELD: (_FIXED, _LOOSE),
    State.RESTING: (_FIXED, _LOOSE),
    State.PARKED: (_PROXY, 0),
    State.PROXY: (_PROXY, _LOOSE | _DRIVEN),
    State.DRIVEN: (_DRIVEN, _LOOSE | _PROXY),
}


class Population:
    """
    Rigid bodies over the ground plane z = 0.

    Bodies are named by small integers. Those at rest cost next to nothing: their poses are known
    without being read, and they do not meet each other.

    :param gravity: [m/s²], (3,).
    :param friction: of the ground (as between two bodies that have this value).
    """

    def __init__(self, gravity: Sequence[float] = GRAVITY, friction: float = FRICTION):
        self._gravity = np.array(gravity, float)
        self._engine = Engine(self._gravity)
        self._bodies = Bodies()
        self._pieces: dict[int, Pieces] = {}
        self._supports = settling.Supports()
        self._courses = Courses(self._engine, self._bodies, self._gravity)
        self._ground = self._engine.add_ground()
        self._bodies.enter(np.array([self._ground]), State.GROUND, np.inf, np.full(3, np.inf),
                           0.0, 0.0, np.array([0, 0, 0, 0, 0, 0, 1.0]))
        self._engine.set_surface(self._ground, friction, 1.0)
        self._engine.set_filter(self._ground, *_FILTERS[State.GROUND])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the memory of the world; nothing else may be called afterwards."""
        self._engine.close()

    @property
    def ground(self) -> int:
        """Id of the ground plane."""
        return self._ground

    @property
    def awake(self) -> np.ndarray:
        """Ids of the bodies that move freely, ascending, (K,)."""
        return np.flatnonzero(self._bodies.state == State.LOOSE)

    def bounds(self, ids: np.ndarray) -> np.ndarray:
        """Give axis-aligned bounds, three minima, three maxima [m], (K, 6); loose if turned."""
        return self._engine.bounds(np.atleast_1d(ids).tolist())

    @property
    def bodies(self) -> Bodies:
        """Columns of all bodies by id: poses, velocities, state; to be read, not written."""
        return self._bodies

    def poses(self, ids: np.ndarray) -> np.ndarray:
        """Give centres of mass and attitudes in the world, (K, 7)."""
        return self._bodies.poses[ids]

    def velocities(self, ids: np.ndarray) -> np.ndarray:
        """Give velocities of centres of mass and spins, world axes, (K, 6)."""
        return self._bodies.velocities[ids]

    def add_body(self, shape: int, size: np.ndarray, mass: float, pose: np.ndarray,
                 velocity: np.ndarray | None = None, inertia: np.ndarray | None = None,
                 friction: float = FRICTION, restitution: float = 0.0) -> int:
        """
        Add one loose box or capsule (a capsule no longer than wide is a sphere).

        :param size: as in `Blueprint.size` [m], (3,).
        :param mass: [kg].
        :param pose: of its centre of mass, (7,).
        :param velocity: world axes, (6,); None = at rest.
        :param inertia: principal moments in its axes [kg·m²], (3,); None = of a solid.
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind.
        """
        size, pose = np.asarray(size, float), np.asarray(pose, float)
        outline = (self._engine.box(size) if shape == Shape.BOX
                   else self._engine.capsule(float(size[0]), float(size[2])))
        body = self._engine.add_same(outline, pose[None, :3], pose[3:])[0]
        if inertia is None:
            inertia = solid_inertia(shape, size, mass)
        self._enter_loose(body, mass, inertia, single(shape, size), pose)
        self._bodies.least[body] = size.min()
        self._engine.set_surface(body, friction, restitution)
        self._start(body, velocity)
        return body

    def add_fragment(self, shapes: np.ndarray, sizes: np.ndarray, local_poses: np.ndarray,
                     mass: float, inertia: np.ndarray, pose: np.ndarray,
                     velocity: np.ndarray | None = None, friction: float = FRICTION,
                     restitution: float = 0.0, tolerance: float = 2e-3) -> int:
        """
        Add a loose rigid body made of boxes and capsules; `assembly.rigid_sum` gives the values.

        :param shapes: `Shape` of each part, (P,).
        :param sizes: as in `Blueprint.size` [m], (P, 3).
        :param local_poses: of the parts in the principal frame, (P, 7).
        :param mass: [kg].
        :param inertia: principal moments [kg·m²], (3,).
        :param pose: of centre of mass and principal axes in the world, (7,).
        :param velocity: world axes, (6,); None = at rest.
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind.
        :param tolerance: how far faces may be apart that become one in `merge_boxes` [m].
        """
        pieces = _merged(Pieces(np.asarray(shapes), np.asarray(sizes, float),
                                np.asarray(local_poses, float)), tolerance)
        body = self._engine.add_compound(compound.describe(mass, inertia, pieces), pose)
        self._enter_loose(body, mass, inertia, pieces, pose)
        self._engine.set_surface(body, friction, restitution)
        self._start(body, velocity)
        return body

    def add_bricks(self, poses: np.ndarray, sizes: np.ndarray, mass: np.ndarray,
                   friction: float = FRICTION, restitution: float = 0.0) -> np.ndarray:
        """
        Add boxes that stand still until they are thawed.

        :param poses: (K, 7).
        :param sizes: full extents [m], (K, 3).
        :param mass: [kg], (K,).
        :param friction: against a body of the same kind.
        :param restitution: against a body of the same kind.
        :returns: ids, (K,).
        """
        ids = np.empty(len(poses), np.intp)
        keys = np.round(np.column_stack([sizes, poses[:, 3:]]), 6)
        _, kind = np.unique(keys, axis=0, return_inverse=True)
        order = np.argsort(kind, kind='stable')
        for same in np.split(order, np.flatnonzero(np.diff(kind[order])) + 1):
            ids[same] = self._engine.add_same(self._engine.box(sizes[same[0]]),
                                              poses[same, :3], poses[same[0], 3:])
        self._bodies.enter(ids, State.LOOSE, mass, box_inertia(np.asarray(mass), sizes),
                           0.5 * np.linalg.norm(sizes, axis=1), sizes.min(axis=1), poses)
        for body, size in zip(ids.tolist(), sizes):
            self._pieces[body] = single(Shape.BOX, size)
            self._engine.set_surface(body, friction, restitution)
        self._hold(ids, State.HELD)
        return ids

    def add_projectile(self, shape: int, size: np.ndarray, mass: float, pose: np.ndarray,
                       velocity: np.ndarray, friction: float = FRICTION,
                       restitution: float = 0.3) -> int:
        """Add a loose body that flies without numerical drag; see `add_body`."""
        body = self.add_body(shape, size, mass, pose, velocity, friction=friction,
                             restitution=restitution)
        self._engine.set_free_of_drag(body)
        return body

    def add_driven(self, shape: int, size: np.ndarray, pose: np.ndarray,
                   friction: float = FRICTION) -> int:
        """
        Add a body that goes where `drive` says, whatever is in its way but the fixed.

        :param size: as in `Blueprint.size` [m], (3,).
        :param pose: (7,).
        :param friction: against a body of the same kind.
        """
        body = self.add_projectile(shape, size, MASS, pose, np.zeros(6), friction, 0.0)
        self._bodies.state[body] = State.DRIVEN
        self._engine.set_filter(body, *_FILTERS[State.DRIVEN])
        self._courses.enter(body, pose)
        return body

    def drive(self, body: int, pose: np.ndarray) -> None:
        """Say where a driven body is to be at the end of the next step, (7,)."""
        self._courses.enter(body, pose)

    def add_proxy(self, size: np.ndarray, pose: np.ndarray) -> int:
        """Add a capsule that stands in for a piece of a tree, see `proxies.Proxies`."""
        body = self.add_projectile(Shape.CAPSULE, size, 1.0, pose, np.zeros(6), FRICTION, 0.0)
        self.park(body)
        return body

    def set_proxy(self, body: int, pose: np.ndarray, velocity: np.ndarray, mass: float,
                  inertia: float, time_step: float) -> None:
        """
        Set what loose bodies meet in the next step.

        :param pose: (7,).
        :param velocity: that it would have after the step if nothing met it, world, (6,).
        :param mass: [kg].
        :param inertia: about any axis [kg·m²].
        :param time_step: of the next step [s].
        """
        bodies = self._bodies
        self._engine.set_mass(body, mass, np.full(3, inertia))
        if bodies.state[body] != State.PROXY:
            self._engine.set_filter(body, *_FILTERS[State.PROXY])
        bodies.state[body], bodies.mass[body] = State.PROXY, mass
        bodies.poses[body], bodies.velocities[body] = pose, velocity
        self._engine.place(body, bodies.poses[body])
        weightless = bodies.velocities[body].copy()
        weightless[:3] -= self._gravity * time_step
        self._engine.set_velocity(body, weightless)

    def park(self, body: int) -> None:
        """Take a proxy out of everything's way until it is set again."""
        self._bodies.state[body] = State.PARKED
        self._bodies.velocities[body] = 0.0
        self._engine.hold(body)
        self._engine.set_filter(body, *_FILTERS[State.PARKED])

    def remove(self, ids: np.ndarray) -> None:
        """Take bodies out; what rested on them is set free. Their ids may be given again."""
        ids = np.atleast_1d(ids)
        carried = self._supports.carried_by(ids)
        self._bodies.state[ids] = State.GONE
        self._supports.drop(self._bodies.state)
        for body in ids.tolist():
            self._engine.remove(body)
            self._pieces.pop(body, None)
            self._courses.leave(body)
        self.thaw(carried[self._bodies.state[carried] == State.RESTING])

    def thaw(self, ids: np.ndarray, velocities: np.ndarray | None = None) -> None:
        """
        Set bodies free.

        :param ids: (K,).
        :param velocities: world axes, (K, 6); None = from rest.
        """
        ids = np.atleast_1d(np.asarray(ids, np.intp))
        if not len(ids):
            return
        bodies = self._bodies
        bodies.state[ids] = State.LOOSE
        bodies.quiet[ids] = 0.0
        for body in ids.tolist():
            self._engine.set_mass(body, float(bodies.mass[body]), bodies.inertia[body])
            self._engine.set_filter(body, *_FILTERS[State.LOOSE])
        self._supports.drop(bodies.state)
        if velocities is not None:
            self.set_velocities(ids, velocities)

    def freeze(self, ids: np.ndarray) -> None:
        """Hold bodies where they are until they are thawed, (K,) ids."""
        self._hold(np.atleast_1d(np.asarray(ids, np.intp)), State.HELD)

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set the velocities of loose bodies, world axes, (K, 6)."""
        self._bodies.velocities[ids] = velocities
        for body in np.atleast_1d(ids).tolist():
            self._engine.set_velocity(body, self._bodies.velocities[body])

    def set_poses(self, ids: np.ndarray, poses: np.ndarray) -> None:
        """Put bodies somewhere else, (K, 7)."""
        self._bodies.poses[ids] = poses
        for body in np.atleast_1d(ids).tolist():
            self._engine.place(body, self._bodies.poses[body])

    def apply_impulse(self, body: int, impulse: np.ndarray, point: np.ndarray | None = None,
                      angular: np.ndarray | None = None) -> None:
        """
        Change the velocity of a body at once; one that rests is set free.

        :param impulse: [N·s], world, (3,).
        :param point: where it acts, world [m], (3,); None = at the centre of mass.
        :param angular: further angular impulse [N·m·s], world, (3,).
        """
        bodies = self._bodies
        if bodies.state[body] in (State.HELD, State.RESTING):
            self.thaw(np.array([body]))
        turn = np.zeros(3) if angular is None else np.array(angular, float)
        if point is not None:
            turn = turn + np.cross(np.asarray(point) - bodies.poses[body, :3], impulse)
        attitude = bodies.poses[body, 3:]
        spin = rotation.rotate(rotation.conjugate(attitude), turn) / bodies.inertia[body]
        change = np.concatenate([np.asarray(impulse) / bodies.mass[body],
                                 rotation.rotate(attitude, spin)])
        self.set_velocities(np.array([body]), bodies.velocities[[body]] + change)

    def _hold(self, ids: np.ndarray, state: State) -> None:
        if not len(ids):
            return
        bodies = self._bodies
        bodies.state[ids] = state
        bodies.velocities[ids] = 0.0
        for body in ids.tolist():
            self._engine.hold(body)
            self._engine.set_filter(body, *_FILTERS[state])
        bodies.bounds[ids] = self._engine.bounds(ids.tolist())

    def _enter_loose(self, body: int, mass: float, inertia: np.ndarray, pieces: Pieces,
                     pose: np.ndarray) -> None:
        self._pieces[body] = pieces
        self._bodies.enter(np.array([body]), State.LOOSE, mass, inertia, pieces.radius(), 0.0,
                           pose)
        self._engine.set_mass(body, float(mass), np.asarray(inertia, float))
        self._engine.set_filter(body, *_FILTERS[State.LOOSE])

    def _start(self, body: int, velocity: np.ndarray | None) -> None:
        if velocity is not None:
            self.set_velocities(np.array([body]), np.asarray(velocity, float)[None])


def solid_inertia(shape: int, size: np.ndarray, mass: float) -> np.ndarray:
    """
    Give the principal moments of a solid box, cylinder or sphere [kg·m²], (3,).

    :param size: as in `Blueprint.size` [m], (3,).
    :param mass: [kg].
    """
    if shape == Shape.BOX:
        return box_inertia(np.array([mass]), np.asarray(size)[None])[0]
    if size[2] <= size[0]:
        return np.full(3, 0.1 * mass * size[0] ** 2)
    return cylinder_inertia(np.array([mass]), np.array([size[0]]), np.array([size[2]]))[0]


def _merged(pieces: Pieces, tolerance: float) -> Pieces:
    """Join boxes where they lie end to end; capsules stay as they are."""
    box = pieces.shapes == Shape.BOX
    if np.count_nonzero(box) < 2:
        return pieces
    poses, sizes = merge_boxes(pieces.local_poses[box], pieces.sizes[box], tolerance)
    return Pieces(np.concatenate([np.full(len(poses), Shape.BOX), pieces.shapes[~box]]),
                  np.concatenate([sizes, pieces.sizes[~box]]),
                  np.concatenate([poses, pieces.local_poses[~box]]))
