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
from procphys_ros.geometry.rotation_kernels import matrix_rows
from procphys_ros.physics.rigid.vectors import cross, dot, INLINE, less, plus, put, three

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


@subroutine(**INLINE)
def inverse_inertia(inertia, pose, i):
    """Compute the inverse inertia of a body in world axes: (xx, xy, xz) and (yy, yz, zz)."""
    x, y, z = matrix_rows(pose[i, 3:])
    a, b, c = 1.0 / inertia[i, 0], 1.0 / inertia[i, 1], 1.0 / inertia[i, 2]
    u, v, w = (a * x[0], b * x[1], c * x[2]), (a * y[0], b * y[1], c * y[2]), (
        a * z[0], b * z[1], c * z[2])
    return (dot(u, x), dot(u, y), dot(u, z)), (dot(v, y), dot(v, z), dot(w, z))


@subroutine(**INLINE)
def slip_of(state, i, j, arm, other, column):
    """Return the velocity of the first body's point relative to the second's."""
    one = plus(three(state, i, column), 1.0, cross(three(state, i, column + 3), arm))
    two = plus(three(state, j, column), 1.0, cross(three(state, j, column + 3), other))
    return less(one, two)


@subroutine(**INLINE)
def push(state, i, j, arm, other, impulse):
    """Apply an impulse to the first body, and its opposite to the second."""
    put(state, i, SPEED, plus(three(state, i, SPEED), 1.0, lightened(state, i, impulse)))
    put(state, i, SPIN, plus(three(state, i, SPIN), 1.0, eased(state, i, cross(arm, impulse))))
    if state[j, LIGHT] > 0.0:
        put(state, j, SPEED, plus(three(state, j, SPEED), -1.0, lightened(state, j, impulse)))
        put(state, j, SPIN,
            plus(three(state, j, SPIN), -1.0, eased(state, j, cross(other, impulse))))
