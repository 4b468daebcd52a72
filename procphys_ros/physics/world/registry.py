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

"""The bodies of a world: known, held, set free, moved, pushed, taken out."""

from collections.abc import Sequence
from typing import Self

import numpy as np

from procphys_ros import rotation
from procphys_ros.physics.world import settling
from procphys_ros.physics.world.bodies import Bodies, State
from procphys_ros.physics.world.driven import Courses
from procphys_ros.physics.world.engine import Engine
from procphys_ros.physics.world.pieces import Pieces

GRAVITY = (0.0, 0.0, -9.81)  # [m/s²]
FRICTION = 0.7  # dry brick on brick, broken mortar; also wood on earth

# Who meets whom (collision groups and masks): two bodies meet when each one's mask has the
# other's group. What is fixed never meets what is fixed, a driven body goes through it.
#                 loose fixed driven
#   loose (1)       x     x     x
#   fixed (2)       x     -     -      ground, held, resting
#   driven (4)      x     -     -
_LOOSE, _FIXED, _DRIVEN = 1, 2, 4
FILTERS = {
    State.LOOSE: (_LOOSE, _LOOSE | _FIXED | _DRIVEN),
    State.GROUND: (_FIXED, _LOOSE),
    State.HELD: (_FIXED, _LOOSE),
    State.RESTING: (_FIXED, _LOOSE),
    State.DRIVEN: (_DRIVEN, _LOOSE),
}


class Registry:
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
        self._engine.set_filter(self._ground, *FILTERS[State.GROUND])

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

    def pieces(self, body: int) -> Pieces:
        """Give the collision shapes of a body."""
        return self._pieces[body]

    @property
    def supports(self) -> settling.Supports:
        """Who rests on whom; to be read, not written."""
        return self._supports

    def poses(self, ids: np.ndarray) -> np.ndarray:
        """Give centres of mass and attitudes in the world, (K, 7)."""
        return self._bodies.poses[ids]

    def velocities(self, ids: np.ndarray) -> np.ndarray:
        """Give velocities of centres of mass and spins, world axes, (K, 6)."""
        return self._bodies.velocities[ids]

    def drive(self, body: int, pose: np.ndarray) -> None:
        """Say where a driven body is to be at the end of the next step, (7,)."""
        self._courses.enter(body, pose)

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
        bodies.restart(ids, settling.TREMBLE_TIME)
        for body in ids.tolist():
            self._engine.set_mass(body, float(bodies.mass[body]), bodies.inertia[body])
            self._engine.set_filter(body, *FILTERS[State.LOOSE])
        self._supports.drop(bodies.state)
        if velocities is not None:
            self.set_velocities(ids, velocities)

    def freeze(self, ids: np.ndarray) -> None:
        """Hold bodies where they are until they are thawed, (K,) ids."""
        self._hold(np.atleast_1d(np.asarray(ids, np.intp)), State.HELD)

    def set_velocities(self, ids: np.ndarray, velocities: np.ndarray) -> None:
        """Set the velocities of loose bodies, world axes, (K, 6)."""
        ids = np.atleast_1d(ids)
        self._bodies.velocities[ids] = velocities
        self._engine.set_velocities(ids.tolist(), self._bodies.velocities[ids])

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
            self._engine.set_filter(body, *FILTERS[state])
        bodies.bounds[ids] = self._engine.bounds(ids.tolist())

    def _enter_loose(self, body: int, mass: float, inertia: np.ndarray, pieces: Pieces,
                     pose: np.ndarray) -> None:
        self._pieces[body] = pieces
        self._bodies.enter(np.array([body]), State.LOOSE, mass, inertia, pieces.radius(), 0.0,
                           pose)
        self._bodies.toothed[body] = len(pieces.teeth) > 0
        self._engine.set_mass(body, float(mass), np.asarray(inertia, float))
        self._engine.set_filter(body, *FILTERS[State.LOOSE])

    def _start(self, body: int, velocity: np.ndarray | None) -> None:
        if velocity is not None:
            self.set_velocities(np.array([body]), np.asarray(velocity, float)[None])
