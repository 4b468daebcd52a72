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


"""Vectors of three numbers inside kernels, as tuples without allocation."""

import math

from procphys_ros.compilation import subroutine

# No reference counting, which costs an atomic instruction per array and call, more time than the
# computation. Functions with these options cannot allocate.
LEAN = {'_nrt': False}
INLINE = {**LEAN, 'forceinline': True}


@subroutine(**INLINE)
def at(rows, i):
    """Read a row of an array."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@subroutine(**INLINE)
def three(rows, i, first):
    """Read three numbers of a row, starting at a column."""
    return rows[i, first], rows[i, first + 1], rows[i, first + 2]


@subroutine(**INLINE)
def put(rows, i, first, v):
    """Write three numbers into a row, starting at a column."""
    rows[i, first], rows[i, first + 1], rows[i, first + 2] = v


@subroutine(**INLINE)
def dot(a, b):
    """Return the dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@subroutine(**INLINE)
def cross(a, b):
    """Return the cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@subroutine(**INLINE)
def less(a, b):
    """Subtract the second vector from the first."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@subroutine(**INLINE)
def plus(a, share, b):
    """Add a multiple of the second vector to the first."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@subroutine(**INLINE)
def scaled(share, a):
    """Multiply a vector by a number."""
    return share * a[0], share * a[1], share * a[2]


@subroutine(**INLINE)
def length(a):
    """Return the length of a vector."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@subroutine(**INLINE)
def tangent(n):
    """Return a unit vector normal to a unit vector."""
    if abs(n[0]) < 0.6:
        t = (0.0, n[2], -n[1])
    else:
        t = (-n[2], 0.0, n[0])
    return scaled(1.0 / length(t), t)
