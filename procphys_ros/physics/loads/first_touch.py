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
First touch of a moving body and single targets; the body translates without rotation.

Every function returns time of impact as a share of the path (inf = no touch), point on the target
and normal out of it, one row per target. Bodies that overlap from the start touch at 0.
"""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear_kernels import transformed

_EXACT = 1e-9    # [m] distance at which a body counts as touching
_ROUNDS = 50     # of Newton's method, which needs less than ten
_TINY = 1e-12


@kernel(error_model='numpy')
def sphere_on_boxes(start, along, radius, centres, axes, halves):
    """
    Compute the first touch of a moving sphere with boxes.

    In a box's frame the squared distance of the centre is a convex, piecewise quadratic function
    of the path parameter, whose pieces end where a coordinate crosses a face: it is solved
    piece by piece.
    """
    n = len(centres)
    fraction, point, normal = np.full(n, np.inf), np.zeros((n, 3)), np.zeros((n, 3))
    p, v = np.empty(3), np.empty(3)
    for i in range(n):
        _into(axes[i], start - centres[i], p)
        _into(axes[i], along, v)
        fraction[i] = _sphere_on_box(p, v, radius, halves[i])
        if fraction[i] <= 1.0:
            _touch_box(p + fraction[i] * v, halves[i], centres[i], axes[i], point[i], normal[i])
    return fraction, point, normal


@subroutine(error_model='numpy')
def _sphere_on_box(p, v, radius, half):
    """Return the path parameter at which a sphere touches a box, in the box's frame."""
    cuts = np.empty(7)
    cuts[6] = 1.0
    for k in range(3):
        for side in range(2):
            face = half[k] if side else -half[k]
            cut = (face - p[k]) / v[k] if abs(v[k]) > _TINY else 1.0
            cuts[2 * k + side] = min(max(cut, 0.0), 1.0)
    cuts.sort()
    low = 0.0
    for cut in cuts:
        # On this piece each coordinate is inside, below or above the box throughout.
        middle = 0.5 * (low + cut)
        a, b, c = 0.0, 0.0, -radius * radius
        for k in range(3):
            at = p[k] + middle * v[k]
            if abs(at) > half[k]:
                gap = p[k] - half[k] if at > 0.0 else p[k] + half[k]
                a, b, c = a + v[k] * v[k], b + gap * v[k], c + gap * gap
        if (a * low + 2.0 * b) * low + c <= 0.0:
            return low
        root = b * b - a * c
        if b < 0.0 and root >= 0.0 and a > 0.0:
            t = (-b - np.sqrt(root)) / a
            if low <= t <= cut:
                return t
        low = cut
    return np.inf


@kernel(error_model='numpy')
def sphere_on_capsules(start, along, radius, centres, arms, radii):
    """
    Compute the first touch of a moving sphere with capsules, by a ray against thicker capsules.

    :param arms: vectors from the centre to the end of the axis, (N, 3) [m], world.
    :param radii: (N,) [m].
    """
    n = len(centres)
    fraction, point, normal = np.full(n, np.inf), np.zeros((n, 3)), np.zeros((n, 3))
    for i in range(n):
        offset = start - centres[i]
        t = _point_on_capsule(offset, along, arms[i], radius + radii[i])
        fraction[i] = t
        if t <= 1.0:
            place = offset + t * along
            foot = arms[i] * _foot(place, arms[i])
            _point_out(place - foot, -along, normal[i])
            point[i] = centres[i] + foot + radii[i] * normal[i]
    return fraction, point, normal


@subroutine(error_model='numpy')
def _point_on_capsule(p, v, arm, radius):
    """Return the path parameter at which a point touches a capsule about the origin."""
    foot = p - arm * _foot(p, arm)
    if _dot(foot, foot) <= radius * radius:
        return 0.0
    best = np.inf
    square = _dot(arm, arm)
    if square > 0.0:
        # Against the cylinder, in the plane normal to its axis.
        pa, va = _dot(p, arm) / square, _dot(v, arm) / square
        across, drift = p - pa * arm, v - va * arm
        t = _root(_dot(drift, drift), _dot(across, drift),
                  _dot(across, across) - radius * radius)
        if abs(pa + t * va) <= 1.0:
            best = t
    for side in (-1.0, 1.0):
        offset = p - side * arm
        best = min(best, _root(_dot(v, v), _dot(offset, v),
                               _dot(offset, offset) - radius * radius))
    return best if best <= 1.0 else np.inf


@subroutine(error_model='numpy')
def _root(a, b, c):
    """Return the root of a t² + 2 b t + c at t >= 0 with negative slope, or inf."""
    root = b * b - a * c
    if b >= 0.0 or root < 0.0 or c < 0.0:
        return np.inf
    return (-b - np.sqrt(root)) / a


@kernel(error_model='numpy')
def box_on_boxes(start, along, own_axes, own_half, centres, axes, halves):
    """Compute the first touch of a moving box with boxes: 15 axes (Gottschalk et al. 1996)."""
    n = len(centres)
    fraction, point, normal = np.full(n, np.inf), np.zeros((n, 3)), np.zeros((n, 3))
    best = np.empty(3)
    for i in range(n):
        t = _box_on_box(centres[i] - start, along, own_axes, own_half, axes[i], halves[i], best)
        fraction[i] = t
        if t <= 1.0:
            normal[i] = best
            local = np.empty(3)
            _into(axes[i], start + t * along - centres[i], local)
            for k in range(3):
                local[k] = min(max(local[k], -halves[i, k]), halves[i, k])
            point[i] = centres[i] + transformed(axes[i], local)
    return fraction, point, normal


@subroutine(error_model='numpy')
def _box_on_box(offset, along, a, a_half, b, b_half, best):
    """Return the path parameter at which two boxes touch; write the last separating axis."""
    enter, leave, least = 0.0, 1.0, np.inf
    axis = np.empty(3)
    for number in range(15):
        if number < 3:
            axis[:] = a[:, number]
        elif number < 6:
            axis[:] = b[:, number - 3]
        else:
            axis[:] = np.cross(a[:, (number - 6) // 3], b[:, (number - 6) % 3])
        length = np.sqrt(_dot(axis, axis))
        if length < 1e-6:
            continue
        axis /= length
        reach = 0.0
        for k in range(3):
            reach += abs(_dot(a[:, k], axis)) * a_half[k]
            reach += abs(_dot(b[:, k], axis)) * b_half[k]
        gap, speed = _dot(offset, axis), _dot(along, axis)
        if abs(speed) < _TINY:
            if abs(gap) > reach:
                return np.inf
            t0, t1 = -np.inf, np.inf
        else:
            t0, t1 = (gap - reach) / speed, (gap + reach) / speed
            t0, t1 = min(t0, t1), max(t0, t1)
        if t0 > enter or (enter == 0.0 and reach - abs(gap) < least):
            # Bodies that overlap from the start separate along the axis of least overlap.
            least = reach - abs(gap)
            best[:] = axis if gap < 0.0 else -axis
        enter, leave = max(enter, t0), min(leave, t1)
        if enter > leave:
            return np.inf
    return enter


@kernel(error_model='numpy')
def box_on_capsules(start, along, own_axes, own_half, centres, arms, radii):
    """
    Compute the first touch of a moving box with capsules by Newton's method on their distance.

    The distance of convex bodies is a convex function of the path parameter: tangents lie below
    it, so no step overshoots the touch.
    """
    n = len(centres)
    fraction, point, normal = np.full(n, np.inf), np.zeros((n, 3)), np.zeros((n, 3))
    p, v, arm, gap = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _into(own_axes, -along, v)
    speed = np.sqrt(_dot(v, v))
    for i in range(n):
        _into(own_axes, centres[i] - start, p)
        _into(own_axes, arms[i], arm)
        t = 0.0
        for _ in range(_ROUNDS):
            foot = _segment_to_box(p + t * v, arm, own_half, gap)
            distance = np.sqrt(_dot(gap, gap)) - radii[i]
            if distance <= _EXACT:
                fraction[i] = t
                out = np.empty(3)
                _point_out(-transformed(own_axes, gap), -along, out)
                normal[i] = out
                point[i] = centres[i] + foot * arms[i] + radii[i] * out
                break
            # Only the velocity component along the gap closes it.
            closing = -_dot(v, gap) / (distance + radii[i])
            if closing <= _TINY * speed:
                break
            t += distance / closing
            if t > 1.0:
                break
    return fraction, point, normal


@subroutine(error_model='numpy')
def _segment_to_box(centre, arm, half, gap):
    """
    Find the parameter s in [-1, 1] of the point of a segment nearest to a box about the origin.

    The derivative of the squared distance is monotone in s: its zero is found by bisection.

    :param gap: written: vector from the box to the segment there, (3,).
    """
    low, high = -1.0, 1.0
    for _ in range(60):
        s = 0.5 * (low + high)
        slope = 0.0
        for k in range(3):
            at = centre[k] + s * arm[k]
            slope += (at - min(max(at, -half[k]), half[k])) * arm[k]
        if slope > 0.0:
            high = s
        else:
            low = s
    s = 0.5 * (low + high)
    for k in range(3):
        at = centre[k] + s * arm[k]
        gap[k] = at - min(max(at, -half[k]), half[k])
    return s


@subroutine(error_model='numpy')
def _dot(a, b):
    """Return the dot product of two vectors (3,), contiguous or not."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@subroutine(error_model='numpy')
def _into(axes, vector, out):
    """Rotate a world vector into the frame whose axes are the columns of a matrix."""
    for k in range(3):
        out[k] = axes[0, k] * vector[0] + axes[1, k] * vector[1] + axes[2, k] * vector[2]


@subroutine(error_model='numpy')
def _foot(place, arm):
    """Return the parameter in [-1, 1] of a segment about the origin nearest to a point."""
    square = _dot(arm, arm)
    return min(max(_dot(place, arm) / square, -1.0), 1.0) if square > 0.0 else 0.0


@subroutine(error_model='numpy')
def _point_out(away, instead, out):
    """Write the unit vector of `away`, or of `instead` where `away` has zero length."""
    length = np.sqrt(_dot(away, away))
    if length < _TINY:
        away, length = instead, max(np.sqrt(_dot(instead, instead)), _TINY)
    for k in range(3):
        out[k] = away[k] / length


@subroutine(error_model='numpy')
def _touch_box(local, half, centre, axes, point, normal):
    """Write nearest point and normal of a box for a point in its frame; inside: nearest face."""
    foot, out = np.empty(3), np.zeros(3)
    nearest, depth = 0, np.inf
    for k in range(3):
        foot[k] = min(max(local[k], -half[k]), half[k])
        out[k] = local[k] - foot[k]
        if half[k] - abs(local[k]) < depth:
            nearest, depth = k, half[k] - abs(local[k])
    length = np.sqrt(_dot(out, out))
    if length < _TINY:
        side = 1.0 if local[nearest] >= 0.0 else -1.0
        foot[nearest], out[nearest], length = side * half[nearest], side, 1.0
    for j in range(3):
        point[j], normal[j] = centre[j], 0.0
        for k in range(3):
            point[j] += axes[j, k] * foot[k]
            normal[j] += axes[j, k] * out[k] / length
