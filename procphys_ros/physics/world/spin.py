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


"""Spin: keep bodies that turn by more than a radian per step from gaining energy."""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.kinetic import kinetic_energy
from procphys_ros.physics.world.body_table import BodyTable

FAST = 1.0  # [rad] per step, from which an implicit gyroscopic term no longer converges


def limit_spin(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray, velocities: np.ndarray,
               time_step: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Slow down fast spinning bodies that gained energy of rotation in a step.

    :param ids: bodies that move, (K,).
    :param poses: theirs before the step, (K, 7).
    :param velocities: likewise, (K, 6).
    :param time_step: [s].
    :returns: bodies, and their velocities, (M, 6).
    """
    share = _shares(ids, poses, velocities, bodies.inertia, bodies.poses, bodies.velocities,
                    time_step)
    gained = np.flatnonzero(share < 1.0)
    slower = bodies.velocities[ids[gained]]
    slower[:, 3:] *= share[gained, None]
    return ids[gained], slower


@kernel
def _shares(ids, before, velocities, inertia, poses, now, time_step):
    """Give the share of its spin that each body keeps, (K,); columns by id from `inertia` on."""
    share = np.ones(len(ids))
    for k in range(len(ids)):
        body = ids[k]
        turn = time_step * np.sqrt(now[body, 3] ** 2 + now[body, 4] ** 2 + now[body, 5] ** 2)
        if turn > FAST:
            energy = kinetic_energy(0.0, inertia[body], poses[body, 3:], now[body])
            most = max(kinetic_energy(0.0, inertia[body], before[k, 3:], velocities[k]),
                       energy * (FAST / turn) ** 2)  # at a radian per step
            if energy > most:
                share[k] = np.sqrt(most / energy)
    return share
