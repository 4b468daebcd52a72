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

"""Driven bodies: they follow a prescribed course, push what is in the way, and feel it."""

import numpy as np

from procphys_ros import rotation
from procphys_ros.physics.world.bodies import Bodies
from procphys_ros.physics.world.engine import Engine

MASS = 1e7  # [kg], so heavy that nothing in a scene turns a driven body off its course


class Courses:
    """
    Where driven bodies go in the next step.

    :param engine: the world's engine.
    :param bodies: the world's bodies.
    :param gravity: [m/s²], (3,); what the engine adds to the velocity of a body in a step.
    """

    def __init__(self, engine: Engine, bodies: Bodies, gravity: np.ndarray):
        self._engine = engine
        self._bodies = bodies
        self._gravity = gravity
        self._targets: dict[int, np.ndarray] = {}

    def enter(self, body: int, pose: np.ndarray) -> None:
        """Take a body under control; it stands until it is given another pose, (7,)."""
        self._targets[body] = np.array(pose, float)

    def leave(self, body: int) -> None:
        """Let go of a body, if it was driven."""
        self._targets.pop(body, None)

    def start(self, time_step: float) -> None:
        """Give the driven bodies the velocities that lead to their targets in one step [s]."""
        for body, target in self._targets.items():
            velocity = velocity_between(self._bodies.poses[body], target, time_step)
            self._bodies.velocities[body] = velocity
            velocity = velocity.copy()
            velocity[:3] -= self._gravity * time_step
            self._engine.set_velocities([body], velocity[None])

    def finish(self) -> None:
        """Put the driven bodies exactly where they were to go."""
        for body, target in self._targets.items():
            self._bodies.poses[body] = target
            self._engine.place(body, target)


def velocity_between(start: np.ndarray, end: np.ndarray, time_step: float) -> np.ndarray:
    """
    Give the constant velocity that leads from one pose to another, world axes, (6,).

    :param start: (7,).
    :param end: (7,).
    :param time_step: [s].
    """
    turn = rotation.multiply(end[3:], rotation.conjugate(start[3:]))
    turn = turn if turn[3] >= 0.0 else -turn
    sine = float(np.linalg.norm(turn[:3]))
    scale = 2.0 * np.arctan2(sine, turn[3]) / sine if sine > 1e-12 else 2.0
    return np.concatenate([end[:3] - start[:3], scale * turn[:3]]) / time_step
