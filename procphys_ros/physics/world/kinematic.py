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
