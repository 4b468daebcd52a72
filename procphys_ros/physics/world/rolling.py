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

"""Rolling resistance of the ground and of bark, for engines without their own."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel
from procphys_ros.geometry.rotation_kernels import matrix_rows
from procphys_ros.physics.rigid.solver import MOST_ROLLING, ROLLING
from procphys_ros.physics.world.body_table import BodyTable

_BOX = int(Shape.BOX)  # numba does not support enums


def resist_rolling(bodies: BodyTable, ids: np.ndarray, before: np.ndarray, gravity: np.ndarray,
                   time_step: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Slow down the spin of balls and rods by the contact forces on them in a step.

    The torque is that of the contact force at a lever arm; a ball of radius r on the ground
    decelerates by 5/7 · g · lever / r. Boxes tumble on edges, without rolling resistance.

    :param ids: bodies that moved, (K,).
    :param before: their velocities before the step, (K, 6).
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :returns: bodies, (M,), and their velocities, (M, 6).
    """
    velocities, felt = _slowed(
        ids, before, gravity, time_step, bodies.velocities, bodies.poses, bodies.mass,
        bodies.inertia, bodies.first_piece, bodies.piece_shape, bodies.piece_size)
    return ids[felt], velocities[felt]


@kernel
def _slowed(ids, before, gravity, time_step, velocities, poses, mass, inertia, first_piece, shapes,
            sizes):
    """Compute the velocities of all bodies, (K, 6), and the mask of changed ones, (K,) bool."""
    out, felt = velocities[ids], np.zeros(len(ids), np.bool_)
    for k in range(len(ids)):
        body, piece = ids[k], first_piece[ids[k]]
        now = velocities[body]
        spin = np.sqrt(now[3] ** 2 + now[4] ** 2 + now[5] ** 2)
        if shapes[piece] == _BOX or spin == 0.0:
            continue
        x, y, z = matrix_rows(poses[body, 3:])
        pressed = about = 0.0
        for c in range(3):
            pressed += (now[c] - before[k, c] - gravity[c] * time_step) ** 2
            axis = (x[c] * now[3] + y[c] * now[4] + z[c] * now[5]) / spin
            about += inertia[body, c] * axis ** 2
        lever = min(ROLLING, MOST_ROLLING * 0.5 * sizes[piece, 0])
        lost = lever * mass[body] * np.sqrt(pressed) / about
        out[k, 3:] *= max(1.0 - lost / spin, 0.0)
        felt[k] = lost > 1e-3 * spin
    return out, felt
