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


"""Body rows: the solver's state of moving bodies, a row each."""

import math

from procphys_ros.compilation import subroutine
from procphys_ros.physics.rigid.vectors import INLINE, three

# A row per body, for locality of memory access: linear and angular velocity, 1 / mass along
# three axes, inverse inertia in the world (xx, xy, xz, yy, yz, zz), velocities before the contacts
# of the present substep, displacement and rotation in this step, the matrix of the displacement of
# points by that rotation, to second order, and its true over its scaled inertia against vertical
# motion.
SPEED, SPIN, LIGHT, EASE, FREE, WAY, TURNED, BEND, OWN = 0, 3, 6, 9, 15, 21, 24, 27, 36
BODY = 37


@subroutine(**INLINE)
def eased(state, i, v):
    """Multiply a vector by the inverse inertia of a body."""
    a, b = three(state, i, EASE), three(state, i, EASE + 3)
    return (a[0] * v[0] + a[1] * v[1] + a[2] * v[2], a[1] * v[0] + b[0] * v[1] + b[1] * v[2],
            a[2] * v[0] + b[1] * v[1] + b[2] * v[2])


@subroutine(**INLINE)
def lightened(state, i, v):
    """Divide a vector by the mass of a body, which is scaled along the vertical."""
    return state[i, LIGHT] * v[0], state[i, LIGHT + 1] * v[1], state[i, LIGHT + 2] * v[2]


@subroutine(**INLINE)
def rotated(q, spin, duration):
    """Rotate an attitude by an angular velocity over a duration, to third order."""
    x, y, z = 0.5 * duration * spin[0], 0.5 * duration * spin[1], 0.5 * duration * spin[2]
    wider = 1.0 + (x * x + y * y + z * z) / 3.0
    x, y, z = wider * x, wider * y, wider * z
    a = q[0] + x * q[3] + y * q[2] - z * q[1]
    b = q[1] + y * q[3] + z * q[0] - x * q[2]
    c = q[2] + z * q[3] + x * q[1] - y * q[0]
    d = q[3] - x * q[0] - y * q[1] - z * q[2]
    size = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
    return a * size, b * size, c * size, d * size
