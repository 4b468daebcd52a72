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
Contact reduction: keep only the outermost points of contacts of two bodies in one plane.

Bodies of many pieces touch at dozens of points. The resultant on a rigid face acts within the
outline of these, and an iterative solver converges more slowly the more points share one force.
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.rigid.vectors import at, cross, dot, LEAN, less, tangent

_FEW = 4  # largest number of points of a plane without reduction, as of two pieces
_FACING = 0.9998  # least cosine between normals of one plane: 1.1°
_EVEN = 5e-4  # [m] tolerance of gaps of points in a plane: a tenth of the least gap detected
_WAYS = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [-0.5, 0.5]])  # and opposites:
#                  directions of the deepest and outermost points; 90 % of the outline's area or
#                  more remain
_DEEP = 10.0  # weight of depth against distance along these directions


@kernel
def spanning(first, second, contacts):
    """
    Choose the contact points that span the contacts of bodies.

    Points in the interior of a plane, whose gap is that of the plane through the points around
    them, are left out: they cannot press before those do. Points with a force in the previous step
    stay, for warm starting.

    :param first, second: rows of bodies, (C,).
    :param contacts: `ContactRows`.
    :returns: rows of the chosen points, (K,).
    """
    count = len(first)
    kept = np.ones(count, np.bool_)
    order = np.argsort((first << 32) | second, kind='mergesort')
    plane, flat = np.zeros(count, np.int64), np.empty((count, 4))
    begin = 0
    for k in range(1, count + 1):
        if k < count and (first[order[k]] == first[order[begin]]
                          and second[order[k]] == second[order[begin]]):
            continue
        if k - begin > _FEW:
            _reduce(order, begin, k, contacts, plane, flat, kept)
        begin = k
    return np.flatnonzero(kept)


@subroutine(**LEAN)
def _reduce(order, begin, end, contacts, plane, flat, kept):
    """Leave out points of two bodies, plane by plane; `plane` and `flat` are scratch."""
    for k in range(begin, end):
        seed = order[k]
        if plane[seed]:
            continue
        n, start = at(contacts.normal, seed), at(contacts.point, seed)
        t, size = tangent(n), 0
        b = cross(n, t)
        for m in range(k, end):
            c = order[m]
            if not plane[c] and dot(at(contacts.normal, c), n) > _FACING:
                way = less(at(contacts.point, c), start)
                flat[c, 0], flat[c, 1], flat[c, 2] = dot(way, t), dot(way, b), contacts.gap[c]
                flat[c, 3] = contacts.force[c, 0]
                plane[c] = seed + 1
                size += 1
        if size > _FEW:
            _leave_out(order, k, end, seed + 1, plane, flat, kept)


@subroutine(**LEAN)
def _leave_out(order, begin, end, number, plane, flat, kept):
    """Leave out points without force that are neither outermost in a plane nor off it."""
    level, x_rise, y_rise = _fit(order, begin, end, number, plane, flat)
    for m in range(begin, end):
        c = order[m]
        if plane[c] == number:
            gap = level + x_rise * flat[c, 0] + y_rise * flat[c, 1]
            is_off = abs(flat[c, 2] - gap) > _EVEN
            kept[c] = is_off or flat[c, 3] > 0.0
            plane[c] = -1 if is_off else number
    for way in range(2 * len(_WAYS)):
        sign = 1.0 if way < len(_WAYS) else -1.0
        x, y = sign * _WAYS[way % len(_WAYS), 0], sign * _WAYS[way % len(_WAYS), 1]
        farthest, best = -np.inf, -1
        for m in range(begin, end):
            c = order[m]
            if plane[c] == number:
                far = x * flat[c, 0] + y * flat[c, 1] - _DEEP * flat[c, 2]
                if far > farthest:
                    farthest, best = far, c
        if best >= 0:
            kept[best] = True


@subroutine(**LEAN)
def _fit(order, begin, end, number, plane, flat):
    """Fit a plane to gaps by least squares: its level, and its slopes along two axes."""
    n = x = y = g = xx = xy = yy = xg = yg = 0.0
    for m in range(begin, end):
        c = order[m]
        if plane[c] == number:
            n, x, y, g = n + 1.0, x + flat[c, 0], y + flat[c, 1], g + flat[c, 2]
    x, y, g = x / n, y / n, g / n
    for m in range(begin, end):
        c = order[m]
        if plane[c] == number:
            u, v, w = flat[c, 0] - x, flat[c, 1] - y, flat[c, 2] - g
            xx, xy, yy, xg, yg = xx + u * u, xy + u * v, yy + v * v, xg + u * w, yg + v * w
    least = 1e-6 * (xx + yy) + 1e-12  # collinear points leave the slope across them undetermined
    xx, yy = xx + least, yy + least
    a, b = (xg * yy - yg * xy) / (xx * yy - xy * xy), (yg * xx - xg * xy) / (xx * yy - xy * xy)
    return g - a * x - b * y, a, b
