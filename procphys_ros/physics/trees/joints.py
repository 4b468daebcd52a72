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
Joints: propagation of inertia and load from a segment to its parent, and of motion back.

A joint with several degrees of freedom is a chain of single ones at the same point, so each is
eliminated separately, outermost first, and solved for in the opposite order.
"""

import math

from procphys_ros.compilation import subroutine
from procphys_ros.physics.trees.breaks import FLOOR, SIDE, WEAK_X, WEAK_Y
from procphys_ros.physics.trees.layout import (
    DAMPING,
    EXTRA_DAMPING,
    EXTRA_PRELOAD,
    EXTRA_STIFFNESS,
    EXTRA_STRIDE,
    HARDENING,
    LIMIT,
    PRELOAD_X,
    PRELOAD_Y,
    STIFFNESS,
    YIELD,
)
from procphys_ros.physics.trees.spatial import (
    dot,
    eliminate,
    INLINE,
    KERNEL,
    read,
    relieve,
    slide_slope,
    turn_slope,
    write,
)

RADIAL, TANGENTIAL, TWIST, STRETCH = range(4)  # degrees of freedom, innermost first
# Damper of a bend at its limit over the inertia that it stops, weight and springs included; the
# bend then creeps by less than 1e-6 of its free motion.
_HOLD = 1e6  # [-]
_TOUCH = 1e-12  # relative excess over the limit that is rounding


@subroutine(**INLINE)
def mix(frame, i, first, second):
    """Combine the two bending axes of row i."""
    return (first * frame[i, 3] + second * frame[i, 6], first * frame[i, 4] + second * frame[i, 7],
            first * frame[i, 5] + second * frame[i, 8])


@subroutine(**INLINE)
def basis(swing, stop, i):
    """Return the direction of a held bend, else the weakest or first one, and if it is held."""
    n1, n2 = stop[i, 0], stop[i, 1]
    if n1 != 0.0 or n2 != 0.0:
        return n1, n2, True
    if swing[i, SIDE] > 0.0:
        return swing[i, WEAK_X], swing[i, WEAK_Y], False
    return 1.0, 0.0, False


@subroutine(**INLINE)
def keep(f, k, d, u, inverse, drive):
    """Store the factor of degree of freedom d of row k."""
    f[k, d, 0], f[k, d, 1], f[k, d, 2], f[k, d, 3], f[k, d, 4], f[k, d, 5] = u
    f[k, d, 6] = inverse
    f[k, d, 7] = drive


@subroutine(**INLINE)
def give_swing(i, k, h, dt, gate, swing, bend, kept, stop, frame, a, f, limits):
    """Eliminate the two bends of row i, in the basis along and across a limit that holds it."""
    stiffness, acts = swing[i, STIFFNESS], 1.0 if h > 0.0 else 0.0
    own = h * (swing[i, DAMPING] + h * stiffness)
    m1, m2 = sprung(i, swing, bend, kept)
    e1, e2 = acts * m1, acts * m2
    n1, n2, held = basis(swing, stop, i)
    j, b, m, p = read(a, k)
    x, y, z = mix(frame, i, -n2, n1)
    u = turn_slope(j, b, x, y, z)
    size = x * u[0] + y * u[1] + z * u[2] + own
    drive = x * p[0] + y * p[1] + z * p[2] + (n1 * e2 - n2 * e1)
    if swing[i, SIDE] > 0.0:
        side = swing[i, SIDE] * stiffness
        size += h * h * side
        drive -= acts * side * (n1 * bend[i, 1] - n2 * bend[i, 0])
    inverse = 1.0 / size
    keep(f, k, TANGENTIAL, u, inverse, drive)
    j, b, m = eliminate(j, b, m, u, inverse)
    p = relieve(p, u, gate * inverse * drive)
    x, y, z = mix(frame, i, n1, n2)
    u = turn_slope(j, b, x, y, z)
    size = x * u[0] + y * u[1] + z * u[2] + own
    drive = x * p[0] + y * p[1] + z * p[2] + (n1 * e1 + n2 * e2)
    if held and h > 0.0:
        limits[k] = bound(i, n1, n2, dt, swing, bend)
        drive += _HOLD * size * limits[k] / h
        size += _HOLD * size
    inverse = 1.0 / size
    keep(f, k, RADIAL, u, inverse, drive)
    j, b, m = eliminate(j, b, m, u, inverse)
    p = relieve(p, u, gate * inverse * drive)
    write(a, k, j, b, m, p)
    return j, b, m, p


@subroutine(**INLINE)
def unbent(i, swing, kept):
    """Compute the moments of the springs of row i where it is not bent [N·m]."""
    return (swing[i, PRELOAD_X] + swing[i, STIFFNESS] * kept[i, 0],
            swing[i, PRELOAD_Y] + swing[i, STIFFNESS] * kept[i, 1])


@subroutine(**INLINE)
def sprung(i, swing, bend, kept):
    """Compute the moments of the springs of row i [N·m]."""
    m1, m2 = unbent(i, swing, kept)
    return (m1 - swing[i, STIFFNESS] * bend[i, 0], m2 - swing[i, STIFFNESS] * bend[i, 1])


@subroutine(**INLINE)
def excess(i, swing, bend, kept):
    """Compute the moment of the springs of row i, and what it is beyond yielding [N·m]."""
    limit = swing[i, YIELD] + kept[i, 2]
    if limit == math.inf:
        return 0.0, 0.0
    m1, m2 = sprung(i, swing, bend, kept)
    size = math.sqrt(m1 * m1 + m2 * m2)
    return size, max(0.0, size - limit)


@subroutine(**INLINE)
def flow(i, swing, bend, kept):
    """Let row i keep what bends it beyond its yield moment: radial return, linear hardening."""
    size, over = excess(i, swing, bend, kept)
    if over > 0.0:
        m1, m2 = sprung(i, swing, bend, kept)
        more = over / (swing[i, STIFFNESS] + swing[i, HARDENING])
        kept[i, 0] -= more * m1 / size
        kept[i, 1] -= more * m2 / size
        kept[i, 2] += swing[i, HARDENING] * more


@subroutine(**INLINE)
def secant(i, swing, bend, kept):
    """Compute the moment that row i has after `flow`, over that of its springs before it."""
    size, over = excess(i, swing, bend, kept)
    if over > 0.0:
        stiffness = swing[i, STIFFNESS]
        return 1.0 - over / size * stiffness / (stiffness + swing[i, HARDENING])
    return 1.0


@subroutine(**INLINE)
def shuts(i, n1, n2, swing):
    """Return whether a direction shuts the cut in row i."""
    return swing[i, SIDE] > 0.0 and n1 * swing[i, WEAK_X] + n2 * swing[i, WEAK_Y] < 0.0


@subroutine(**INLINE)
def bound(i, n1, n2, dt, swing, bend):
    """
    Compute the mean outward rate that takes the bend just to its limit, at least zero.

    Wedges drive a cut open: then it may be negative.
    """
    if shuts(i, n1, n2, swing):
        return -(swing[i, FLOOR] + n1 * bend[i, 0] + n2 * bend[i, 1]) / dt
    return max(0.0, (swing[i, LIMIT] - (n1 * bend[i, 0] + n2 * bend[i, 1])) / dt)


@subroutine(**KERNEL)
def give_extra(i, k, h, gate, model, bend, frame, scratch):
    """Eliminate twist and stretch of row i where they are sprung."""
    x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
    extra, acts = model.extra, 1.0 if h > 0.0 else 0.0
    j, b, m, p = read(scratch.inertia, k)
    for d in (STRETCH, TWIST):
        c = EXTRA_STRIDE * (d - TWIST)
        stiffness = extra[i, c + EXTRA_STIFFNESS]
        if math.isinf(stiffness):
            continue
        drive = acts * (extra[i, c + EXTRA_PRELOAD] - stiffness * bend[i, d])
        if d == STRETCH:
            u = slide_slope(b, m, x, y, z)
            size = x * u[3] + y * u[4] + z * u[5]
            drive += x * p[3] + y * p[4] + z * p[5]
        else:
            u = turn_slope(j, b, x, y, z)
            size = x * u[0] + y * u[1] + z * u[2]
            drive += x * p[0] + y * p[1] + z * p[2]
        inverse = 1.0 / (size + h * (extra[i, c + EXTRA_DAMPING] + h * stiffness))
        keep(scratch.factor, k, d, u, inverse, drive)
        j, b, m = eliminate(j, b, m, u, inverse)
        p = relieve(p, u, gate * inverse * drive)
    write(scratch.inertia, k, j, b, m, p)


@subroutine(**INLINE)
def solve_rate(f, k, d, v):
    """Solve degree of freedom d of row k for its rate, given the motion on its inner side."""
    u = (f[k, d, 0], f[k, d, 1], f[k, d, 2], f[k, d, 3], f[k, d, 4], f[k, d, 5])
    return f[k, d, 6] * (f[k, d, 7] - dot(u, v))


@subroutine(**INLINE)
def add_turn(v, axis, rate):
    """Add a rotation about an axis through the motion's reference point."""
    return (v[0] + rate * axis[0], v[1] + rate * axis[1], v[2] + rate * axis[2], v[3], v[4], v[5])


@subroutine(**INLINE)
def take_swing(i, k, h, v, swing, stop, frame, f, new):
    """Add the bending of row i to the motion v of its parent; store h times rates."""
    n1, n2, _ = basis(swing, stop, i)
    radial = solve_rate(f, k, RADIAL, v)
    v = add_turn(v, mix(frame, i, n1, n2), radial)
    tangential = solve_rate(f, k, TANGENTIAL, v)
    new[k, 0] = h * (n1 * radial - n2 * tangential)
    new[k, 1] = h * (n2 * radial + n1 * tangential)
    return add_turn(v, mix(frame, i, -n2, n1), tangential)


@subroutine(**KERNEL)
def take_extra(i, k, h, v, extra, frame, f, new):
    """Add twist and stretch of row i to its motion v where they are sprung."""
    x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
    if not math.isinf(extra[i, EXTRA_STIFFNESS]):
        rate = solve_rate(f, k, TWIST, v)
        v = add_turn(v, (x, y, z), rate)
        new[k, TWIST] = h * rate
    if not math.isinf(extra[i, EXTRA_STRIDE + EXTRA_STIFFNESS]):
        rate = solve_rate(f, k, STRETCH, v)
        v = (v[0], v[1], v[2], v[3] + rate * x, v[4] + rate * y, v[5] + rate * z)
        new[k, STRETCH] = h * rate
    return v


@subroutine(**INLINE)
def limit_changed(i, k, dt, swing, bend, stop, new, limits):
    """
    Check the rates of row i against its limit; correct the held direction when they differ.

    :returns: True when the tree has to be solved again.
    """
    limit = swing[i, LIMIT]
    first, second = new[k, 0], new[k, 1]
    if stop[i, 0] != 0.0 or stop[i, 1] != 0.0:
        touch = -_TOUCH if limits[k] >= 0.0 else _TOUCH
        if stop[i, 0] * first + stop[i, 1] * second >= limits[k] * (1.0 + touch):
            return False
        stop[i, 0] = 0.0  # a limit cannot pull
        stop[i, 1] = 0.0
        return True
    x = bend[i, 0] + dt * first
    y = bend[i, 1] + dt * second
    if swing[i, SIDE] > 0.0 and (x * swing[i, WEAK_X] + y * swing[i, WEAK_Y]
                                 < swing[i, FLOOR] - _TOUCH):
        stop[i, 0] = -swing[i, WEAK_X]
        stop[i, 1] = -swing[i, WEAK_Y]
        return True
    square = x * x + y * y
    if square <= limit * limit * (1.0 + _TOUCH):
        return False
    size = math.sqrt(square)
    stop[i, 0] = x / size
    stop[i, 1] = y / size
    return True


@subroutine(**KERNEL)
def solve_free(k, a, full, motion):
    """
    Solve the free root at row k for its motion by Gaussian elimination.

    :param full: workspace, (6, 7).
    :param motion: receives the solution in row k, (n, 6).
    """
    place = 0
    for r in range(3):
        for c in range(r, 3):
            full[r, c] = a[k, place]
            full[c, r] = a[k, place]
            full[3 + r, 3 + c] = a[k, 15 + place]
            full[3 + c, 3 + r] = a[k, 15 + place]
            place += 1
        for c in range(3):
            full[r, 3 + c] = a[k, 6 + 3 * r + c]
            full[3 + c, r] = a[k, 6 + 3 * r + c]
    for r in range(6):
        full[r, 6] = a[k, 21 + r]
    for r in range(6):  # an inertia is positive definite: no pivoting
        for below in range(r + 1, 6):
            share = full[below, r] / full[r, r]
            for c in range(r, 7):
                full[below, c] -= share * full[r, c]
    for r in range(5, -1, -1):
        rest = full[r, 6]
        for c in range(r + 1, 6):
            rest -= full[r, c] * motion[k, c]
        motion[k, r] = rest / full[r, r]


@subroutine(**KERNEL)
def advance_extra(i, k, dt, model, state, scratch):
    """Advance twist and stretch of row i to the end of the step."""
    for j in (TWIST, STRETCH):
        c = EXTRA_STRIDE * (j - TWIST)
        if math.isinf(model.extra[i, c + EXTRA_STIFFNESS]):
            continue
        state.bend[i, j] += dt * scratch.rate[k, j]


@subroutine
def preload(i, k, model, scratch):
    """Set the preload of the joint of row i against the loads that it carries when locked."""
    model.swing[i, PRELOAD_X] = -scratch.factor[k, RADIAL, 7]
    model.swing[i, PRELOAD_Y] = -scratch.factor[k, TANGENTIAL, 7]
    model.extra[i, EXTRA_PRELOAD] = -scratch.factor[k, TWIST, 7]
    model.extra[i, EXTRA_STRIDE + EXTRA_PRELOAD] = -scratch.factor[k, STRETCH, 7]
