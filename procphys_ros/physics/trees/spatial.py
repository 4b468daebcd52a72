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


"""
Spatial: articulated inertias as 27 numbers in a row of an array, and what joints do to them.

Columns 0-5 angular inertia J (xx xy xz yy yz zz), 6-14 coupling B (angular rows, linear columns),
15-20 linear inertia M (as J), 21-23 moment and 24-26 force. All in world axes, about a point, so
that moment = J·α + B·a and force = Bᵀ·α + M·a (Featherstone 2008, Rigid Body Dynamics
Algorithms, chapter 7, written out).
"""

from numba import njit

WIDTH = 27
MOMENT, FORCE = 21, 24
# Columns of a factor row: inertia times joint axis, inverse joint inertia, driving force.
SLOPE, INVERSE, DRIVE, FACTOR_WIDTH = 0, 6, 7, 8


@njit(cache=True, fastmath={'contract'})
def set_body(a, k, axis, h, linear, cross, turn, spin):
    """
    Write the inertia of one symmetric body about a point on its axis into row k.

    :param axis: unit vector of the symmetry axis, 3 floats.
    :param h: distance of the centre of mass from the point, along the axis [m].
    :param linear: mass across the axis, `cross` more than along it [kg].
    :param turn: moment of inertia across the axis about the centre of mass, `spin` along it.
    """
    x, y, z = axis
    shift = linear * h
    base = turn + shift * h
    slim = spin - base
    a[k, 0] = base + slim * x * x
    a[k, 1] = slim * x * y
    a[k, 2] = slim * x * z
    a[k, 3] = base + slim * y * y
    a[k, 4] = slim * y * z
    a[k, 5] = base + slim * z * z
    a[k, 6] = 0.0
    a[k, 7] = -shift * z
    a[k, 8] = shift * y
    a[k, 9] = shift * z
    a[k, 10] = 0.0
    a[k, 11] = -shift * x
    a[k, 12] = -shift * y
    a[k, 13] = shift * x
    a[k, 14] = 0.0
    a[k, 15] = linear - cross * x * x
    a[k, 16] = -cross * x * y
    a[k, 17] = -cross * x * z
    a[k, 18] = linear - cross * y * y
    a[k, 19] = -cross * y * z
    a[k, 20] = linear - cross * z * z


@njit(cache=True, fastmath={'contract'})
def turn_slope(a, k, x, y, z, f, j):
    """Store inertia times a unit turn about (x, y, z) as factor j of row k; return its size."""
    u0 = a[k, 0] * x + a[k, 1] * y + a[k, 2] * z
    u1 = a[k, 1] * x + a[k, 3] * y + a[k, 4] * z
    u2 = a[k, 2] * x + a[k, 4] * y + a[k, 5] * z
    f[k, j, 0] = u0
    f[k, j, 1] = u1
    f[k, j, 2] = u2
    f[k, j, 3] = a[k, 6] * x + a[k, 9] * y + a[k, 12] * z
    f[k, j, 4] = a[k, 7] * x + a[k, 10] * y + a[k, 13] * z
    f[k, j, 5] = a[k, 8] * x + a[k, 11] * y + a[k, 14] * z
    return u0 * x + u1 * y + u2 * z


@njit(cache=True, fastmath={'contract'})
def slide_slope(a, k, x, y, z, f, j):
    """Store inertia times a unit slide along (x, y, z) as factor j of row k; return its size."""
    u3 = a[k, 15] * x + a[k, 16] * y + a[k, 17] * z
    u4 = a[k, 16] * x + a[k, 18] * y + a[k, 19] * z
    u5 = a[k, 17] * x + a[k, 19] * y + a[k, 20] * z
    f[k, j, 0] = a[k, 6] * x + a[k, 7] * y + a[k, 8] * z
    f[k, j, 1] = a[k, 9] * x + a[k, 10] * y + a[k, 11] * z
    f[k, j, 2] = a[k, 12] * x + a[k, 13] * y + a[k, 14] * z
    f[k, j, 3] = u3
    f[k, j, 4] = u4
    f[k, j, 5] = u5
    return u3 * x + u4 * y + u5 * z


@njit(cache=True, fastmath={'contract'})
def eliminate(a, k, f, j, inverse, drive, gate):
    """
    Let degree of freedom j of row k give way: take out what it does not pass on to the parent.

    :param inverse: one over the joint-space inertia, springs and dampers included.
    :param drive: generalised force that acts on it.
    :param gate: 1, or 0 to hold the joint (then wrenches pass undiminished).
    """
    f[k, j, 6] = inverse
    f[k, j, 7] = drive
    u0, u1, u2 = f[k, j, 0], f[k, j, 1], f[k, j, 2]
    u3, u4, u5 = f[k, j, 3], f[k, j, 4], f[k, j, 5]
    w0, w1, w2 = inverse * u0, inverse * u1, inverse * u2
    w3, w4, w5 = inverse * u3, inverse * u4, inverse * u5
    a[k, 0] -= w0 * u0
    a[k, 1] -= w0 * u1
    a[k, 2] -= w0 * u2
    a[k, 3] -= w1 * u1
    a[k, 4] -= w1 * u2
    a[k, 5] -= w2 * u2
    a[k, 6] -= w0 * u3
    a[k, 7] -= w0 * u4
    a[k, 8] -= w0 * u5
    a[k, 9] -= w1 * u3
    a[k, 10] -= w1 * u4
    a[k, 11] -= w1 * u5
    a[k, 12] -= w2 * u3
    a[k, 13] -= w2 * u4
    a[k, 14] -= w2 * u5
    a[k, 15] -= w3 * u3
    a[k, 16] -= w3 * u4
    a[k, 17] -= w3 * u5
    a[k, 18] -= w4 * u4
    a[k, 19] -= w4 * u5
    a[k, 20] -= w5 * u5
    push = gate * drive
    a[k, 21] -= w0 * push
    a[k, 22] -= w1 * push
    a[k, 23] -= w2 * push
    a[k, 24] -= w3 * push
    a[k, 25] -= w4 * push
    a[k, 26] -= w5 * push


@njit(cache=True, fastmath={'contract'})
def shift_add(a, k, p, x, y, z):
    """Add row k to row p, whose point lies at (-x, -y, -z) from that of row k."""
    xx, xy, xz = a[k, 15], a[k, 16], a[k, 17]
    yy, yz, zz = a[k, 18], a[k, 19], a[k, 20]
    b0 = a[k, 6] + y * xz - z * xy  # B' = B + [r]M
    b1 = a[k, 7] + y * yz - z * yy
    b2 = a[k, 8] + y * zz - z * yz
    b3 = a[k, 9] + z * xx - x * xz
    b4 = a[k, 10] + z * xy - x * yz
    b5 = a[k, 11] + z * xz - x * zz
    b6 = a[k, 12] + x * xy - y * xx
    b7 = a[k, 13] + x * yy - y * xy
    b8 = a[k, 14] + x * yz - y * xz
    # J' = J - B[r] - (B'[r])ᵀ, upper triangle
    c0, c1, c2 = a[k, 6], a[k, 7], a[k, 8]
    c3, c4, c5 = a[k, 9], a[k, 10], a[k, 11]
    c7, c6 = a[k, 13], a[k, 12]
    a[p, 0] += a[k, 0] - (c1 * z - c2 * y) - (b1 * z - b2 * y)
    a[p, 1] += a[k, 1] - (c2 * x - c0 * z) - (b4 * z - b5 * y)
    a[p, 2] += a[k, 2] - (c0 * y - c1 * x) - (b7 * z - b8 * y)
    a[p, 3] += a[k, 3] - (c5 * x - c3 * z) - (b5 * x - b3 * z)
    a[p, 4] += a[k, 4] - (c3 * y - c4 * x) - (b8 * x - b6 * z)
    a[p, 5] += a[k, 5] - (c6 * y - c7 * x) - (b6 * y - b7 * x)
    a[p, 6] += b0
    a[p, 7] += b1
    a[p, 8] += b2
    a[p, 9] += b3
    a[p, 10] += b4
    a[p, 11] += b5
    a[p, 12] += b6
    a[p, 13] += b7
    a[p, 14] += b8
    a[p, 15] += xx
    a[p, 16] += xy
    a[p, 17] += xz
    a[p, 18] += yy
    a[p, 19] += yz
    a[p, 20] += zz
    fx, fy, fz = a[k, 24], a[k, 25], a[k, 26]
    a[p, 21] += a[k, 21] + y * fz - z * fy
    a[p, 22] += a[k, 22] + z * fx - x * fz
    a[p, 23] += a[k, 23] + x * fy - y * fx
    a[p, 24] += fx
    a[p, 25] += fy
    a[p, 26] += fz
