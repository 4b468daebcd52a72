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


"""Intruder: a body moved from outside that pushes branches, debris and walls, and feels them."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.errors import CommandError
from procphys_ros.physics.touch import overlap, overlaps
from procphys_ros.physics.world import State, World
from procphys_ros.scene.intruder import IntruderSettings
from procphys_ros.simulation.bounds import checked_vector
from procphys_ros.simulation.contact.contact import Contact
from procphys_ros.simulation.contact.course import Course
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.standing.blows import Blows
from procphys_ros.simulation.standing.standing_loads import StandingLoads

SMOOTHING = 0.1  # [s] time constant of the wrench that is given out; contacts of rigid bodies jump
_YIELD = 0.003   # [m] that a brick gives before its bonds exert all their strength
_STILL = 1e-3    # [m/s] slower, debris at rest is left so
_LAYER = 'intruder'


class Intruder:
    """
    Goes where it is told, whatever is in its way.

    Branches and loose bodies are pushed aside with their own masses. Bricks that stand press back
    the more the deeper it gets into them, up to the strength of their bonds, and then come out.

    :param settings: its shape and size.
    :param blows: on masonry.
    :param loads: on what stands.

    :ivar wrench: force and moment about its centre that everything it touches had on it in the
        last step [N], [N·m], world, (6,).
    :ivar smooth_wrench: the same through a first-order low pass of `SMOOTHING`.
    """

    def __init__(self, settings: IntruderSettings, blows: Blows, loads: StandingLoads):
        self._ball = settings.shape == 'sphere'
        self._shape = Shape.CAPSULE if self._ball else Shape.BOX
        self._size = settings.edges
        self._blows = blows
        self._loads = loads

    def begin(self, world: World, contact: Contact) -> None:
        """Start anew, without an intruder, in a world that has just been built."""
        self._world = world
        self._contact = contact
        self._course = Course()
        self._body = -1
        self._start = np.zeros(3)
        self.wrench, self.smooth_wrench = np.zeros(6), np.zeros(6)
        self._from_wall = np.zeros(6)

    @property
    def pose(self) -> np.ndarray | None:
        """Where it is, (7,), world; None before it was placed."""
        return self._course.pose if self._course.placed else None

    def place(self, pose: Sequence[float], time: float) -> None:
        """
        Say where it is to be; see `Course` for how it gets there.

        :param pose: x y z qx qy qz qw [m], (7,), world.
        :param time: of the simulation, at which the pose is valid [s].
        :raises CommandError: when a value is not finite or the quaternion has no length.
        """
        if len(pose) != 7:
            raise CommandError(f'intruder: {len(pose)} numbers, a pose has seven')
        place = checked_vector('intruder position', pose[:3])
        turn = np.append(checked_vector('intruder orientation', pose[3:6]), float(pose[6]))
        length = float(np.linalg.norm(turn))
        if not np.isfinite(length) or length < 1e-6:
            raise CommandError(f'intruder orientation: {turn.tolist()} is no rotation')
        if self._course.aim(np.concatenate([place, turn / length]), time):
            self._put()

    def advance(self, time: float, time_step: float) -> None:
        """Set its course for the next step, and press on the walls in its way."""
        self._from_wall = np.zeros(6)
        if self._body < 0:
            return
        velocity = self._course.advance(time, time_step)
        pose = self._course.pose
        self._start = self._world.bodies.poses[self._body, :3].copy()
        self._world.set_velocities(np.array([self._body]), velocity[None])
        self._world.drive(self._body, pose)
        if np.abs(velocity).max() > _STILL:
            self._wake(velocity, time_step)
        if len(self._contact.bricks):
            self._press(pose, velocity, time, time_step)

    def feel(self, time_step: float) -> None:
        """Sum up what acted on it in the step that has just been made."""
        if self._body < 0:
            return
        pose = self._course.pose
        self.wrench = self._from_wall.copy()
        bodies = self._world.bodies
        away = np.linalg.norm(bodies.poses[:, :3] - pose[:3], axis=1)
        near = away < bodies.radius + bodies.radius[self._body] + 0.1
        if (near & (bodies.state == State.LOOSE)).any():
            self.wrench += self._world.wrench(self._body)
        touches = self._contact.touches
        mine = touches.body == self._body
        force = -touches.impulse[mine] / time_step
        self.wrench[:3] += force.sum(axis=0)
        self.wrench[3:] += np.cross(touches.point[mine] - self._start, force).sum(axis=0)
        self.smooth_wrench += -np.expm1(-time_step / SMOOTHING) * (self.wrench
                                                                   - self.smooth_wrench)

    def _put(self) -> None:
        pose = self._course.pose
        if self._body < 0:
            self._body = self._world.add_driven(self._shape, self._size, pose)
        self._world.set_poses(np.array([self._body]), pose[None])
        self._world.drive(self._body, pose)

    def _bounds(self, velocity: np.ndarray, time_step: float) -> np.ndarray:
        """Give bounds of its ball, before and after a step, (1, 6)."""
        bodies = self._world.bodies
        place, room = bodies.poses[self._body, :3], bodies.radius[self._body]
        way = velocity[:3] * time_step
        return np.concatenate([place - room + np.minimum(way, 0.0),
                               place + room + np.maximum(way, 0.0)])[None]

    def _wake(self, velocity: np.ndarray, time_step: float) -> None:
        """Set debris at rest free that it comes to, however slowly."""
        bodies = self._world.bodies
        resting = np.flatnonzero(bodies.state == State.RESTING)
        _, hit = overlaps(self._bounds(velocity, time_step), bodies.bounds[resting])
        self._world.thaw(resting[hit])

    def _press(self, pose: np.ndarray, velocity: np.ndarray, time: float,
               time_step: float) -> None:
        near = self._contact.bricks.within(self._bounds(velocity, time_step))
        depth, normal, point = overlap(self._ball, pose, self._size, near.pose, near.size)
        hit = np.flatnonzero(depth > 0.0)
        parts, wrenches = [], []
        for i in hit.tolist():
            part, push = np.array([near.part[i]]), -normal[i]
            resistance = self._blows.resistance(part, push)
            force = resistance.momentum(1.0) * min(depth[i] / _YIELD, 1.0)
            arm = point[i] - pose[:3]
            if depth[i] > _YIELD:
                speed = max(0.0, float((velocity[:3] + np.cross(velocity[3:], arm)) @ push))
                leaving = np.zeros((1, 6))
                leaving[0, :3] = speed * push
                mass = self._world.bodies.mass[near.body[i]]
                force += mass * speed / time_step
                self._blows.tear_out(part, leaving, Cause.IMPACT, 1.0, time)
            else:
                parts.append(part[0])
                wrenches.append(np.concatenate([force * push, np.zeros(3)]))
            self._from_wall += np.concatenate([-force * push, np.cross(arm, -force * push)])
        self._loads.put(_LAYER, np.array(parts, np.intp),
                        np.array(wrenches).reshape(-1, 6))
