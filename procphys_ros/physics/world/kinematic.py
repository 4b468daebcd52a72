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

"""Kinematic bodies: follow prescribed poses, push bodies in the way, and measure the force."""

import numpy as np

from procphys_ros.elementary import atan2
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.engine import Engine

MASS = 1e7  # [kg], so heavy that no body in a scene deflects a kinematic body
_STALE = 0.5      # [s] without a pose, after which the next one starts a new motion
_FASTEST = 100.0  # [m/s] of a motion; a pose farther away is set at once


def set_out(table: BodyTable, time_step: float) -> None:
    """
    Set the velocities of kinematic bodies that lead to their targets in one step.

    :param time_step: [s].
    """
    for body in np.flatnonzero(table.state == BodyState.KINEMATIC):
        table.velocities[body] = velocity_between(table.poses[body], table.target[body],
                                                  time_step)


def arrive(engine: Engine, table: BodyTable) -> None:
    """Set kinematic bodies exactly to their targets."""
    ids = np.flatnonzero(table.state == BodyState.KINEMATIC)
    if len(ids):
        table.poses[ids] = table.target[ids]
        engine.set_poses(ids, table.target[ids])


def velocity_between(start: np.ndarray, end: np.ndarray, time_step: float) -> np.ndarray:
    """
    Compute the constant velocity that leads from one pose to another, world axes, (6,).

    :param start: (7,).
    :param end: (7,).
    :param time_step: [s].
    """
    turn = rotation.multiply(end[3:], rotation.conjugate(start[3:]))
    turn = turn if turn[3] >= 0.0 else -turn
    sine = float(norm(turn[:3]))
    scale = 2.0 * atan2(sine, turn[3]) / sine if sine > 1e-12 else 2.0
    return np.concatenate([end[:3] - start[:3], scale * turn[:3]]) / time_step


class PoseInterpolator:
    """
    Interpolate to each pose in the time since the one before: one interval late.

    Between two poses the velocity is constant; it passes every pose exactly, and stops at the
    last.

    :ivar pose: current one, (7,), world; zeros before the first pose.
    :ivar placed: whether it has had any pose yet.
    """

    def __init__(self) -> None:
        self.pose = np.zeros(7)
        self.placed = False
        self._target = np.zeros(7)
        self._arrival = 0.0
        self._last = -np.inf

    def set_target(self, pose: np.ndarray, time: float) -> bool:
        """
        Set a new target; one for the same time as the last replaces it.

        :param pose: (7,), world.
        :param time: at which it was valid [s].
        :returns: whether it was set at once, as too far away or the first.
        """
        if time != self._last:  # poses may arrive faster than steps are made
            self._arrival = time + float(np.clip(time - self._last, 0.0, _STALE))
        self._last, self._target = time, pose
        if not self.placed:
            self.pose, self.placed, self._arrival = pose, True, time
            return True
        if norm(pose[:3] - self.pose[:3]) > _FASTEST * (self._arrival - time):
            self.pose = pose
            return True
        return False

    def advance(self, time: float, time_step: float) -> np.ndarray:
        """
        Advance by one step.

        :param time: at its beginning [s].
        :param time_step: [s].
        :returns: velocity in this step, linear and angular, world, (6,).
        """
        start = self.pose
        left = max(self._arrival - time, time_step)
        velocity = velocity_between(start, self._target, left)
        if left <= time_step:
            self.pose = self._target
            return velocity
        spin = float(norm(velocity[3:]))
        turn = rotation.IDENTITY
        if spin > 0.0:
            turn = rotation.from_axis_angle(velocity[3:] / spin, np.asarray(spin * time_step))
        self.pose = np.concatenate([start[:3] + time_step * velocity[:3],
                                    rotation.multiply(turn, start[3:])])
        return velocity
