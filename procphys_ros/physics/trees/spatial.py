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
Spatial: articulated inertias and loads as tuples of floats, and elimination of joints.

In world axes, about a point: angular inertia J (xx xy xz yy yz zz), coupling B (angular rows,
linear columns), linear inertia M (as J), load (moment, force), motion (angular, linear), so that
moment = J·α + B·a and force = Bᵀ·α + M·a (Featherstone 2008, Rigid Body Dynamics Algorithms,
chapter 7, written out). All functions are inlined by LLVM: tuples become processor registers.
Inlining by numba would type and lower each copy again, and take 50 % longer to compile.
"""

from procphys_ros.compilation import subroutine

WIDTH = 27  # of a row of J, B, M and the load in this order
FACTOR_WIDTH = 8  # of a row of a slope, an inverse inertia and a drive
# No reference counting: inlined array arguments would cost an atomic increment per use
# and double the time of a step. Functions with these options cannot allocate. Strict arithmetic
# (no fused products) keeps balanced trees exactly balanced.
KERNEL = {'_nrt': False}
INLINE = {**KERNEL, 'forceinline': True}


@subroutine(**INLINE)
def symmetric(x, y, z, h, linear, cross, turn, spin):
    """
    Compute J, B, M of a symmetric body about a point on its axis (x, y, z).

    :param h: distance of the centre of mass from the point, along the axis [m].
    :param linear: mass across the axis, by `cross` larger than along it [kg].
    :param turn: moment of inertia across the axis about the centre of mass, `spin` along it.
    """
    shift = linear * h
    base = turn + shift * h
    slim = spin - base
    sx, sy, sz = shift * x, shift * y, shift * z
    j = (base + slim * x * x, slim * x * y, slim * x * z, base + slim * y * y, slim * y * z,
         base + slim * z * z)
    b = (0.0, -sz, sy, sz, 0.0, -sx, -sy, sx, 0.0)
    m = (linear - cross * x * x, -cross * x * y, -cross * x * z, linear - cross * y * y,
         -cross * y * z, linear - cross * z * z)
    return j, b, m


@subroutine(**INLINE)
def turn_slope(j, b, x, y, z):
    """Return inertia times a unit rotation about (x, y, z): 3 moments, 3 forces."""
    return (j[0] * x + j[1] * y + j[2] * z, j[1] * x + j[3] * y + j[4] * z,
            j[2] * x + j[4] * y + j[5] * z, b[0] * x + b[3] * y + b[6] * z,
            b[1] * x + b[4] * y + b[7] * z, b[2] * x + b[5] * y + b[8] * z)


@subroutine(**INLINE)
def slide_slope(b, m, x, y, z):
    """Return inertia times a unit translation along (x, y, z): 3 moments, 3 forces."""
    return (b[0] * x + b[1] * y + b[2] * z, b[3] * x + b[4] * y + b[5] * z,
            b[6] * x + b[7] * y + b[8] * z, m[0] * x + m[1] * y + m[2] * z,
            m[1] * x + m[3] * y + m[4] * z, m[2] * x + m[4] * y + m[5] * z)


@subroutine(**INLINE)
def eliminate(j, b, m, u, inverse):
    """Eliminate a degree of freedom of slope u from an inertia."""
    w0, w1, w2 = inverse * u[0], inverse * u[1], inverse * u[2]
    w3, w4, w5 = inverse * u[3], inverse * u[4], inverse * u[5]
    j = (j[0] - w0 * u[0], j[1] - w0 * u[1], j[2] - w0 * u[2], j[3] - w1 * u[1],
         j[4] - w1 * u[2], j[5] - w2 * u[2])
    b = (b[0] - w0 * u[3], b[1] - w0 * u[4], b[2] - w0 * u[5], b[3] - w1 * u[3],
         b[4] - w1 * u[4], b[5] - w1 * u[5], b[6] - w2 * u[3], b[7] - w2 * u[4],
         b[8] - w2 * u[5])
    m = (m[0] - w3 * u[3], m[1] - w3 * u[4], m[2] - w3 * u[5], m[3] - w4 * u[4],
         m[4] - w4 * u[5], m[5] - w5 * u[5])
    return j, b, m


@subroutine(**INLINE)
def relieve(p, u, push):
    """Eliminate a degree of freedom of slope u from a load."""
    return (p[0] - u[0] * push, p[1] - u[1] * push, p[2] - u[2] * push,
            p[3] - u[3] * push, p[4] - u[4] * push, p[5] - u[5] * push)


@subroutine(**INLINE)
def shift(j, b, m, x, y, z):
    """Shift an inertia to a reference point at (-x, -y, -z) from its own."""
    c = (b[0] + y * m[2] - z * m[1], b[1] + y * m[4] - z * m[3], b[2] + y * m[5] - z * m[4],
         b[3] + z * m[0] - x * m[2], b[4] + z * m[1] - x * m[4], b[5] + z * m[2] - x * m[5],
         b[6] + x * m[1] - y * m[0], b[7] + x * m[3] - y * m[1], b[8] + x * m[4] - y * m[2])
    # c = b + [r]·m; then j - b·[r] - (c·[r])ᵀ, upper triangle
    j = (j[0] - (b[1] + c[1]) * z + (b[2] + c[2]) * y,
         j[1] - b[2] * x + b[0] * z - c[4] * z + c[5] * y,
         j[2] - b[0] * y + b[1] * x - c[7] * z + c[8] * y,
         j[3] - (b[5] + c[5]) * x + (b[3] + c[3]) * z,
         j[4] - b[3] * y + b[4] * x - c[8] * x + c[6] * z,
         j[5] - (b[6] + c[6]) * y + (b[7] + c[7]) * x)
    return j, c, m


@subroutine(**INLINE)
def shift_load(p, x, y, z):
    """Shift a load to a reference point at (-x, -y, -z) from its own."""
    return (p[0] + y * p[5] - z * p[4], p[1] + z * p[3] - x * p[5], p[2] + x * p[4] - y * p[3],
            p[3], p[4], p[5])


@subroutine(**INLINE)
def shift_motion(v, x, y, z):
    """Shift a motion to a reference point at (x, y, z) from its own."""
    return (v[0], v[1], v[2], v[3] + v[1] * z - v[2] * y, v[4] + v[2] * x - v[0] * z,
            v[5] + v[0] * y - v[1] * x)


@subroutine(**INLINE)
def dot(a, b):
    """Return the dot product of a motion and a load."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@subroutine(**INLINE)
def read(a, k):
    """Read inertia and load from row k."""
    j = (a[k, 0], a[k, 1], a[k, 2], a[k, 3], a[k, 4], a[k, 5])
    b = (a[k, 6], a[k, 7], a[k, 8], a[k, 9], a[k, 10], a[k, 11], a[k, 12], a[k, 13], a[k, 14])
    m = (a[k, 15], a[k, 16], a[k, 17], a[k, 18], a[k, 19], a[k, 20])
    p = (a[k, 21], a[k, 22], a[k, 23], a[k, 24], a[k, 25], a[k, 26])
    return j, b, m, p


@subroutine(**INLINE)
def write(a, k, j, b, m, p):
    """Write inertia and load to row k."""
    a[k, 0], a[k, 1], a[k, 2], a[k, 3], a[k, 4], a[k, 5] = j
    (a[k, 6], a[k, 7], a[k, 8], a[k, 9], a[k, 10], a[k, 11], a[k, 12], a[k, 13],
     a[k, 14]) = b
    a[k, 15], a[k, 16], a[k, 17], a[k, 18], a[k, 19], a[k, 20] = m
    a[k, 21], a[k, 22], a[k, 23], a[k, 24], a[k, 25], a[k, 26] = p


@subroutine(**INLINE)
def add(a, k, j, b, m, p):
    """Add inertia and load to row k."""
    a[k, 0] += j[0]
    a[k, 1] += j[1]
    a[k, 2] += j[2]
    a[k, 3] += j[3]
    a[k, 4] += j[4]
    a[k, 5] += j[5]
    a[k, 6] += b[0]
    a[k, 7] += b[1]
    a[k, 8] += b[2]
    a[k, 9] += b[3]
    a[k, 10] += b[4]
    a[k, 11] += b[5]
    a[k, 12] += b[6]
    a[k, 13] += b[7]
    a[k, 14] += b[8]
    a[k, 15] += m[0]
    a[k, 16] += m[1]
    a[k, 17] += m[2]
    a[k, 18] += m[3]
    a[k, 19] += m[4]
    a[k, 20] += m[5]
    a[k, 21] += p[0]
    a[k, 22] += p[1]
    a[k, 23] += p[2]
    a[k, 24] += p[3]
    a[k, 25] += p[4]
    a[k, 26] += p[5]


@subroutine(**INLINE)
def read_load(a, k):
    """Read the load from row k."""
    return a[k, 21], a[k, 22], a[k, 23], a[k, 24], a[k, 25], a[k, 26]


@subroutine(**INLINE)
def write_load(a, k, p):
    """Write a load to row k; its inertia is unchanged."""
    a[k, 21], a[k, 22], a[k, 23], a[k, 24], a[k, 25], a[k, 26] = p


@subroutine(**INLINE)
def add_load(a, k, p):
    """Add a load to row k."""
    a[k, 21] += p[0]
    a[k, 22] += p[1]
    a[k, 23] += p[2]
    a[k, 24] += p[3]
    a[k, 25] += p[4]
    a[k, 26] += p[5]
