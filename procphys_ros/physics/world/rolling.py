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

"""Rolling: the ground and bark give way under what rolls, which slows it down."""

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Shape
from procphys_ros.physics.world.body_table import BodyTable

ROLLING = 0.008  # [m] lever arm of the contact force of what rolls: hard balls on firm soil ...
_MOST = 0.1  # ... and at most this share of the radius, or pebbles would slide


def resist_rolling(bodies: BodyTable, ids: np.ndarray, before: np.ndarray, gravity: np.ndarray,
                   time_step: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Slow down the spin of balls and rods by what contacts pressed on them in a step.

    The torque is that of the contact force at a lever arm; a ball of radius r on the ground
    decelerates by 5/7 · g · lever / r. Boxes roll on edges, where there is none.

    :param ids: bodies that moved, (K,).
    :param before: their velocities before the step, (K, 6).
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :returns: bodies, (M,), and their velocities, (M, 6).
    """
    is_round = bodies.piece_shape[bodies.first_piece[ids]] != Shape.BOX
    ids, before = ids[is_round], before[is_round]
    if not len(ids):
        return ids, before
    spin = np.linalg.norm(bodies.velocities[ids, 3:], axis=1)
    rolls = spin > 0.0
    ids, before, spin = ids[rolls], before[rolls], spin[rolls]
    velocities = bodies.velocities[ids]
    pressed = np.linalg.norm(velocities[:, :3] - before[:, :3] - gravity * time_step, axis=1)
    axis = rotation.rotate(rotation.conjugate(bodies.poses[ids, 3:]),
                           velocities[:, 3:] / spin[:, None])
    inertia = (bodies.inertia[ids] * axis ** 2).sum(axis=1)
    lever = np.minimum(ROLLING, _MOST * 0.5 * bodies.piece_size[bodies.first_piece[ids], 0])
    lost = lever * bodies.mass[ids] * pressed / inertia
    velocities[:, 3:] *= np.maximum(1.0 - lost / spin, 0.0)[:, None]
    felt = lost > 1e-3 * spin
    return ids[felt], velocities[felt]
