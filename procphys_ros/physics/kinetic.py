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

"""Kinetic energy of rigid bodies."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.rotation_kernels import matrix_rows


def motion_energy(mass: np.ndarray, inertia: np.ndarray, attitude: np.ndarray,
                  velocities: np.ndarray) -> np.ndarray:
    """
    Compute the kinetic energy of rigid bodies [J], (K,).

    :param mass: [kg], (K,).
    :param inertia: principal moments in the body's axes [kg·m²], (K, 3).
    :param attitude: of these axes, xyzw, (K, 4).
    :param velocities: linear and angular, world, (K, 6).
    """
    return _motion_energy(*(np.ascontiguousarray(column, float)
                            for column in (mass, inertia, attitude, velocities)))


@kernel
def _motion_energy(mass, inertia, attitude, velocities):
    out = np.empty(len(mass))
    for k in range(len(mass)):
        out[k] = kinetic_energy(mass[k], inertia[k], attitude[k], velocities[k])
    return out


@subroutine
def kinetic_energy(mass, inertia, attitude, velocity):
    """Compute the kinetic energy of one rigid body [J], see `motion_energy`."""
    x, y, z = matrix_rows(attitude)
    u, v, w = velocity[3], velocity[4], velocity[5]
    energy = mass * (velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2)
    for c in range(3):
        energy += inertia[c] * (x[c] * u + y[c] * v + z[c] * w) ** 2
    return 0.5 * energy


@kernel
def free_spins(inertia, before, after, spin):
    """
    Compute the spins of free bodies at other attitudes by conservation of angular momentum.

    :param inertia: principal moments in the body's axes [kg·m²], (K, 3).
    :param before, after: attitudes, xyzw, (K, 4).
    :param spin: before, world [rad/s], (K, 3).
    """
    out = np.zeros((len(inertia), 3))
    for k in range(len(inertia)):
        one, other = matrix_rows(before[k]), matrix_rows(after[k])
        momentum = np.zeros(3)
        for c in range(3):
            own = (one[0][c] * spin[k, 0] + one[1][c] * spin[k, 1] + one[2][c] * spin[k, 2])
            for w in range(3):
                momentum[w] += inertia[k, c] * own * one[w][c]
        for c in range(3):
            own = (other[0][c] * momentum[0] + other[1][c] * momentum[1]
                   + other[2][c] * momentum[2]) / inertia[k, c]
            for w in range(3):
                out[k, w] += own * other[w][c]
    return out
