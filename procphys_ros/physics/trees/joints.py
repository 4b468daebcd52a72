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
Joints: how a segment's inertia and load reach its parent, and how motion comes back.

A joint with several degrees of freedom is a chain of single ones at the same point, so each is
eliminated on its own, outermost first, and solved for in the opposite order.
"""

import math

from numba import njit
import numpy as np

from procphys_ros.physics.trees.layout import (
    DAMPING,
    EXTRA_DAMPING,
    EXTRA_PRELOAD,
    EXTRA_STIFFNESS,
    EXTRA_STRIDE,
    EXTRA_THETA,
    LIMIT,
    PRELOAD_X,
    PRELOAD_Y,
    STIFFNESS,
    THETA,
)
from procphys_ros.physics.trees.spatial import eliminate, slide_slope, turn_slope

RADIAL, TANGENTIAL, TWIST, STRETCH = range(4)  # degrees of freedom, innermost first
# A bend at its limit is held by a damper this much stronger than the inertia it must stop, weight
# and springs included; it then creeps by less than 1e-6 of its free motion.
_HOLD = 1e6  # [-]
_TOUCH = 1e-12  # relative excess over the limit that is rounding


@njit(cache=True, fastmath={'contract'})
def resist(q, u, k, c, theta, preload, dt):
    """Give the part of a spring-damper's moment that does not depend on the new rate."""
    return preload - k * (q + theta * (1.0 - theta) * dt * u) - c * (1.0 - theta) * u


@njit(cache=True, fastmath={'contract'})
def give_swing(i, k, dt, gate, model, state, scratch):
    """Eliminate the two bends of row i, in the basis along and across a limit that holds it."""
    swing, frame, stop = model.swing, state.frame, state.stop
    a, f = scratch.inertia, scratch.factor
    stiffness, damping, theta = swing[i, STIFFNESS], swing[i, DAMPING], swing[i, THETA]
    own = theta * dt * (damping + theta * dt * stiffness)
    e1 = resist(state.bend[i, 0], state.rate[i, 0], stiffness, damping, theta,
                swing[i, PRELOAD_X], dt)
    e2 = resist(state.bend[i, 1], state.rate[i, 1], stiffness, damping, theta,
                swing[i, PRELOAD_Y], dt)
    n1, n2 = stop[i, 0], stop[i, 1]
    held = n1 != 0.0 or n2 != 0.0
    if not held:
        n1, n2 = 1.0, 0.0
    x, y, z = mix(frame, i, -n2, n1)
    size = turn_slope(a, k, x, y, z, f, TANGENTIAL) + own
    drive = x * a[k, 21] + y * a[k, 22] + z * a[k, 23] + (n1 * e2 - n2 * e1)
    eliminate(a, k, f, TANGENTIAL, 1.0 / size, drive, gate)
    x, y, z = mix(frame, i, n1, n2)
    size = turn_slope(a, k, x, y, z, f, RADIAL) + own
    drive = x * a[k, 21] + y * a[k, 22] + z * a[k, 23] + (n1 * e1 + n2 * e2)
    if held:
        scratch.bound[k] = bound(i, n1, n2, theta, dt, swing, state)
        drive += _HOLD * size * scratch.bound[k] / dt
        size += _HOLD * size
    eliminate(a, k, f, RADIAL, 1.0 / size, drive, gate)


@njit(cache=True, fastmath={'contract'})
def mix(frame, i, first, second):
    """Combine the two bending axes of row i."""
    return (first * frame[i, 3] + second * frame[i, 6], first * frame[i, 4] + second * frame[i, 7],
            first * frame[i, 5] + second * frame[i, 8])


@njit(cache=True, fastmath={'contract'})
def bound(i, n1, n2, theta, dt, swing, state):
    """Give the outward rate that takes the bend just to its limit, never an inward one."""
    room = swing[i, LIMIT] - (n1 * state.bend[i, 0] + n2 * state.bend[i, 1])
    outward = n1 * state.rate[i, 0] + n2 * state.rate[i, 1]
    return max(0.0, (room / dt - (1.0 - theta) * outward) / theta)


@njit(cache=True, fastmath={'contract'})
def give_extra(i, k, dt, gate, model, state, scratch):
    """Eliminate twist and stretch of row i where they are sprung."""
    a, f, extra = scratch.inertia, scratch.factor, model.extra
    x, y, z = state.frame[i, 9], state.frame[i, 10], state.frame[i, 11]
    for j in (STRETCH, TWIST):
        c = EXTRA_STRIDE * (j - TWIST)
        stiffness, theta = extra[i, c + EXTRA_STIFFNESS], extra[i, c + EXTRA_THETA]
        if math.isinf(stiffness):
            continue
        damping = extra[i, c + EXTRA_DAMPING]
        drive = resist(state.bend[i, j], state.rate[i, j], stiffness, damping, theta,
                       extra[i, c + EXTRA_PRELOAD], dt)
        if j == STRETCH:
            size = slide_slope(a, k, x, y, z, f, j)
            drive += x * a[k, 24] + y * a[k, 25] + z * a[k, 26]
        else:
            size = turn_slope(a, k, x, y, z, f, j)
            drive += x * a[k, 21] + y * a[k, 22] + z * a[k, 23]
        size += theta * dt * (damping + theta * dt * stiffness)
        eliminate(a, k, f, j, 1.0 / size, drive, gate)


@njit(cache=True, fastmath={'contract'})
def solve_rate(f, k, j, m):
    """Solve degree of freedom j of row k for its rate over dt, given the motion before it."""
    return f[k, j, 6] * (f[k, j, 7] - (
        f[k, j, 0] * m[k, 0] + f[k, j, 1] * m[k, 1] + f[k, j, 2] * m[k, 2]
        + f[k, j, 3] * m[k, 3] + f[k, j, 4] * m[k, 4] + f[k, j, 5] * m[k, 5]))


@njit(cache=True, fastmath={'contract'})
def take_swing(i, k, dt, state, scratch):
    """Add the bending of row i to the motion that its parent hands on; store the new rates."""
    m, f, frame = scratch.motion, scratch.factor, state.frame
    n1, n2 = state.stop[i, 0], state.stop[i, 1]
    if n1 == 0.0 and n2 == 0.0:
        n1 = 1.0
    radial = solve_rate(f, k, RADIAL, m)
    add_turn(m, k, mix(frame, i, n1, n2), radial)
    tangential = solve_rate(f, k, TANGENTIAL, m)
    add_turn(m, k, mix(frame, i, -n2, n1), tangential)
    scratch.rate[k, 0] = dt * (n1 * radial - n2 * tangential)
    scratch.rate[k, 1] = dt * (n2 * radial + n1 * tangential)


@njit(cache=True, fastmath={'contract'})
def add_turn(m, k, axis, rate):
    """Add a turn about an axis through the row's point."""
    m[k, 0] += rate * axis[0]
    m[k, 1] += rate * axis[1]
    m[k, 2] += rate * axis[2]


@njit(cache=True, fastmath={'contract'})
def take_extra(i, k, dt, model, state, scratch):
    """Add twist and stretch of row i to its motion where they are sprung."""
    m, frame, extra = scratch.motion, state.frame, model.extra
    if not math.isinf(extra[i, EXTRA_STIFFNESS]):
        rate = solve_rate(scratch.factor, k, TWIST, m)
        add_turn(m, k, (frame[i, 9], frame[i, 10], frame[i, 11]), rate)
        scratch.rate[k, TWIST] = dt * rate
    if not math.isinf(extra[i, EXTRA_STRIDE + EXTRA_STIFFNESS]):
        rate = solve_rate(scratch.factor, k, STRETCH, m)
        m[k, 3] += rate * frame[i, 9]
        m[k, 4] += rate * frame[i, 10]
        m[k, 5] += rate * frame[i, 11]
        scratch.rate[k, STRETCH] = dt * rate


@njit(cache=True, fastmath={'contract'})
def limit_changed(i, k, dt, model, state, scratch):
    """
    Check the new rates of row i against its limit; correct the held direction when they differ.

    :returns: True when the tree has to be solved again.
    """
    bend, rate, stop = state.bend, state.rate, state.stop
    theta, limit = model.swing[i, THETA], model.swing[i, LIMIT]
    first, second = scratch.rate[k, 0], scratch.rate[k, 1]
    if stop[i, 0] != 0.0 or stop[i, 1] != 0.0:
        if stop[i, 0] * first + stop[i, 1] * second >= scratch.bound[k] * (1.0 - _TOUCH):
            return False
        stop[i, 0] = 0.0  # the limit would have to pull
        stop[i, 1] = 0.0
        return True
    x = bend[i, 0] + dt * ((1.0 - theta) * rate[i, 0] + theta * first)
    y = bend[i, 1] + dt * ((1.0 - theta) * rate[i, 1] + theta * second)
    square = x * x + y * y
    if square <= limit * limit * (1.0 + _TOUCH):
        return False
    size = math.sqrt(square)
    stop[i, 0] = x / size
    stop[i, 1] = y / size
    return True


@njit(cache=True)
def solve_free(k, scratch):
    """Solve the free root at row k for its motion."""
    a = scratch.inertia
    full = np.empty((6, 6))
    place = 0
    for block in (0, 3):
        place = 0 if block == 0 else 15
        for r in range(3):
            for c in range(r, 3):
                full[block + r, block + c] = a[k, place]
                full[block + c, block + r] = a[k, place]
                place += 1
    for r in range(3):
        for c in range(3):
            full[r, 3 + c] = a[k, 6 + 3 * r + c]
            full[3 + c, r] = a[k, 6 + 3 * r + c]
    scratch.motion[k, :] = np.linalg.solve(full, a[k, 21:27].copy())


@njit(cache=True, fastmath={'contract'})
def advance_extra(i, k, dt, model, state, scratch):
    """Move twist and stretch of row i on to the end of the step."""
    for j in (TWIST, STRETCH):
        c = EXTRA_STRIDE * (j - TWIST)
        if math.isinf(model.extra[i, c + EXTRA_STIFFNESS]):
            continue
        theta = model.extra[i, c + EXTRA_THETA]
        new = scratch.rate[k, j]
        state.bend[i, j] += dt * ((1.0 - theta) * state.rate[i, j] + theta * new)
        state.rate[i, j] = new


@njit(cache=True)
def preload(i, k, model, scratch):
    """Oppose the loads that the held joint of row i carries."""
    model.swing[i, PRELOAD_X] = -scratch.factor[k, RADIAL, 7]
    model.swing[i, PRELOAD_Y] = -scratch.factor[k, TANGENTIAL, 7]
    model.extra[i, EXTRA_PRELOAD] = -scratch.factor[k, TWIST, 7]
    model.extra[i, EXTRA_STRIDE + EXTRA_PRELOAD] = -scratch.factor[k, STRETCH, 7]
