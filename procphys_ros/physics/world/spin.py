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


"""Spin: what turns by more than a radian per step must not gain energy from its own inertia."""

import numpy as np

from procphys_ros import rotation
from procphys_ros.physics.world.body_table import BodyTable

FAST = 1.0  # [rad] per step, from which an implicit gyroscopic term no longer converges


def rotational_energy(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray,
                      spin: np.ndarray) -> np.ndarray:
    """Give the energy with which bodies turn [J], (K,); poses (K, 7), spin [rad/s], (K, 3)."""
    inner = rotation.rotate(rotation.conjugate(poses[:, 3:]), spin)
    return 0.5 * (bodies.inertia[ids] * inner ** 2).sum(axis=1)


def limit_spin(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray, spin: np.ndarray,
               time_step: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Slow down what has got more energy of rotation by a step than it had, and turns very fast.

    :param ids: bodies that move, (K,).
    :param poses: theirs before the step, (K, 7).
    :param spin: likewise [rad/s], (K, 3).
    :param time_step: [s].
    :returns: bodies, and their velocities, (M, 6).
    """
    size = np.linalg.norm(bodies.velocities[ids, 3:], axis=1)
    fast = np.flatnonzero(size * time_step > FAST)
    chosen = ids[fast]
    velocities = bodies.velocities[chosen]
    if not len(chosen):
        return chosen, velocities
    now = rotational_energy(bodies, chosen, bodies.poses[chosen], velocities[:, 3:])
    slow = now * (FAST / (size[fast] * time_step)) ** 2  # at a radian per step
    most = np.maximum(rotational_energy(bodies, chosen, poses[fast], spin[fast]), slow)
    gained = now > most
    velocities[:, 3:] *= np.where(gained, np.sqrt(most / now), 1.0)[:, None]
    return chosen[gained], velocities[gained]
