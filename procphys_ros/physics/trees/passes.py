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
Passes of one step over one tree: load, give (tip to root), take (root to tip), integrate.

Articulated bodies at velocity level in carry form: every segment keeps its own velocities from
the last step, the passes project that momentum on the joints of the present pose and add what
springs, dampers, weight and air do over the step, all of them implicit. A projection cannot add
kinetic energy, so no velocity-product terms are needed and none can blow up. All motions are
velocities over dt and all loads forces, so that a balanced tree stays exactly at rest.
"""

import math

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.air import CALM, STORM
from procphys_ros.physics.trees import joints, pose
from procphys_ros.physics.trees.layout import (
    ACROSS,
    ALONG,
    CROSS_FLOW,
    LEAF_FLOW,
    LENGTH,
    MASS,
    REACH,
)
from procphys_ros.physics.trees.spatial import (
    add,
    INLINE,
    KERNEL,
    read,
    shift,
    shift_load,
    shift_motion,
    slide_slope,
    symmetric,
    turn_slope,
    write,
)
from procphys_ros.physics.trees.state import Joint

_SPRUNG = int(Joint.SPRUNG)
_FREE = int(Joint.FREE)
ATTEMPTS = 4  # solutions per step while limits take hold or let go; the clamp takes the rest


@kernel(**KERNEL)
def step(plan, model, state, scratch, wind, gravity, dt):
    """
    Advance every tree by one time step.

    :param wind: air velocity at the centres of mass [m/s], (S, 3).
    :param gravity: [m/s²], (3,).
    :param dt: [s].
    """
    for t in range(len(plan.start) - 1):
        rows = plan.row[plan.start[t]:plan.start[t + 1]]
        above = plan.above[plan.start[t]:plan.start[t + 1]]
        for _ in range(ATTEMPTS):
            factor(rows, above, model, state, scratch, wind, gravity, dt, 1.0)
            if not take(rows, above, model, state, scratch, dt):
                break
        integrate(rows, above, model, state, scratch, dt)


@kernel(**KERNEL)
def factor(rows, above, model, state, scratch, wind, gravity, dt, gate):
    """
    Load one tree and eliminate its joints from the tips to the root.

    :param gate: 1, or 0 to hold the joints (then loads pass undiminished).
    """
    frame, a = state.frame, scratch.inertia
    for k in range(len(rows)):
        load(rows[k], k, model.body, state.bend, state.velocities, frame, a, wind, gravity, dt)
    if state.struck[rows[0], 0] != 0.0:
        take_up(rows, model.body, state, a, dt)
    for k in range(len(rows) - 1, -1, -1):
        i, up = rows[k], above[k]
        if model.joint[i] == _FREE:
            continue
        if model.joint[i] == _SPRUNG:
            joints.give_extra(i, k, dt, gate, model, state, scratch)
        j, b, m, p = joints.give_swing(i, k, dt, gate, model.swing, state.bend, state.rate,
                                       state.stop, frame, a, scratch.factor, scratch.bound)
        if up >= 0:
            x, y, z = apart(frame, i, rows[up])
            j, b, m = shift(j, b, m, x, y, z)
            add(a, up, j, b, m, shift_load(p, x, y, z))


@kernel(**INLINE)
def apart(frame, i, up):
    """Give the way from the joint point of row `up` to that of row i."""
    return frame[i, 0] - frame[up, 0], frame[i, 1] - frame[up, 1], frame[i, 2] - frame[up, 2]


@kernel(**INLINE)
def load(i, k, body, bend, v, frame, a, wind, gravity, dt):
    """Write inertia and load of segment i, with the drag of the air implicit, into row k."""
    x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
    cross, foliage, turning = drag(i, x, y, z, body, v, wind)
    mass, h, per = body[i, MASS], body[i, REACH] + bend[i, 3], 1.0 / dt
    air = cross + foliage
    along = cross * (wind[i, 0] * x + wind[i, 1] * y + wind[i, 2] * z)
    fx = mass * (v[i, 0] * per + gravity[0]) + air * wind[i, 0] - along * x
    fy = mass * (v[i, 1] * per + gravity[1]) + air * wind[i, 1] - along * y
    fz = mass * (v[i, 2] * per + gravity[2]) + air * wind[i, 2] - along * z
    across = body[i, ACROSS] * per
    spin = (body[i, ALONG] * per - across) * (v[i, 3] * x + v[i, 4] * y + v[i, 5] * z)
    j, b, m = symmetric(x, y, z, h, mass + dt * air, dt * cross,
                        body[i, ACROSS] + dt * turning, body[i, ALONG])
    p = (across * v[i, 3] + spin * x + h * (y * fz - z * fy),
         across * v[i, 4] + spin * y + h * (z * fx - x * fz),
         across * v[i, 5] + spin * z + h * (x * fy - y * fx), fx, fy, fz)
    write(a, k, j, b, m, p)


@kernel(**KERNEL)
def take_up(rows, body, state, a, dt):
    """Add the impulses that wait for a tree to its loads, as forces over the step."""
    for k in range(len(rows)):
        i = rows[k]
        h = (body[i, REACH] + state.bend[i, 3]) / dt
        x, y, z = h * state.frame[i, 9], h * state.frame[i, 10], h * state.frame[i, 11]
        px, py, pz = state.push[i, 0], state.push[i, 1], state.push[i, 2]
        a[k, 21] += state.push[i, 3] / dt + y * pz - z * py
        a[k, 22] += state.push[i, 4] / dt + z * px - x * pz
        a[k, 23] += state.push[i, 5] / dt + x * py - y * px
        a[k, 24] += px / dt
        a[k, 25] += py / dt
        a[k, 26] += pz / dt


@kernel(**INLINE)
def drag(i, x, y, z, body, v, wind):
    """
    Give the drag of segment i per speed: wood across its axis, foliage, and turning.

    Wood follows the cross-flow principle (Hoerner 1965): only the flow normal to the axis counts.
    Turning integrates the same law along the segment, over the translation and over the spin.
    """
    ux, uy, uz = v[i, 0] - wind[i, 0], v[i, 1] - wind[i, 1], v[i, 2] - wind[i, 2]
    square = ux * ux + uy * uy + uz * uz
    along = ux * x + uy * y + uz * z
    cross = body[i, CROSS_FLOW] * math.sqrt(max(0.0, square - along * along))
    foliage = body[i, LEAF_FLOW]
    if foliage > 0.0:
        speed = math.sqrt(square)
        foliage *= speed
        if speed > CALM:
            foliage *= CALM / min(speed, STORM)
    spin = v[i, 3] * x + v[i, 4] * y + v[i, 5] * z
    turn = math.sqrt(max(0.0, v[i, 3] * v[i, 3] + v[i, 4] * v[i, 4] + v[i, 5] * v[i, 5]
                         - spin * spin))
    length = body[i, LENGTH]
    turning = length * length * ((cross + foliage) / 12.0
                                 + body[i, CROSS_FLOW] * turn * length / 32.0)
    return cross, foliage, turning


@kernel(**KERNEL)
def take(rows, above, model, state, scratch, dt):
    """
    Hand motion from the root to the tips and read the wrenches that the joints transmit.

    :returns: True when a limit took hold or let go, so that the tree has to be solved again.
    """
    changed = False
    motion, frame = scratch.motion, state.frame
    for k in range(len(rows)):
        i = rows[k]
        if model.joint[i] == _FREE:
            joints.solve_free(k, scratch.inertia, scratch.root, motion)
            for c in range(6):
                state.wrenches[i, c] = 0.0
            continue
        v = handed_on(k, above[k], rows, frame, motion)
        transmit(k, i, scratch.inertia, v, state.wrenches)
        v = joints.take_swing(i, k, dt, v, state.stop, frame, scratch.factor, scratch.rate)
        if model.joint[i] == _SPRUNG:
            v = joints.take_extra(i, k, dt, v, model.extra, frame, scratch.factor, scratch.rate)
        (motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3], motion[k, 4],
         motion[k, 5]) = v
        if joints.limit_changed(i, k, dt, model.swing, state.bend, state.rate, state.stop,
                                scratch.rate, scratch.bound):
            changed = True
    return changed


@kernel(**INLINE)
def handed_on(k, up, rows, frame, motion):
    """Give the parent's motion at the joint point of entry k; the ground does not move."""
    v = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if up >= 0:
        x, y, z = apart(frame, rows[k], rows[up])
        v = shift_motion((motion[up, 0], motion[up, 1], motion[up, 2], motion[up, 3],
                          motion[up, 4], motion[up, 5]), x, y, z)
    return v


@kernel(**INLINE)
def transmit(k, i, a, v, wrenches):
    """Read what the parent must exert on row i to move it so: force, then moment."""
    j, b, m, p = read(a, k)
    moment = turn_slope(j, b, v[0], v[1], v[2])
    force = slide_slope(b, m, v[3], v[4], v[5])
    for c in range(3):
        wrenches[i, c] = moment[3 + c] + force[3 + c] - p[3 + c]
        wrenches[i, 3 + c] = moment[c] + force[c] - p[c]


@kernel(**KERNEL)
def integrate(rows, above, model, state, scratch, dt):
    """Move joints and poses to the end of the step and carry the velocities along."""
    frame, m = state.frame, scratch.motion
    for k in range(len(rows)):
        i = rows[k]
        x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
        h = model.body[i, REACH] + state.bend[i, 3]
        if model.joint[i] == _FREE:
            pose.advance_free(i, dt, m[k], model, state)
        else:
            pose.advance_bend(i, scratch.rate[k, 0], scratch.rate[k, 1], dt, model, state)
            if model.joint[i] == _SPRUNG:
                joints.advance_extra(i, k, dt, model, state, scratch)
            pose.place(k, rows, above, model, state)
        carry(i, k, x, y, z, h, dt, frame, m, state.velocities)
    if state.struck[rows[0], 0] != 0.0:
        state.struck[rows[0], 0] = 0.0
        for i in rows:
            for c in range(6):
                state.push[i, c] = 0.0


@kernel(**INLINE)
def carry(i, k, x, y, z, h, dt, frame, m, v):
    """
    Store the velocities of segment i, its spin turned as the axis turned (from x, y, z).

    Turning with the axis, not with the body, keeps the kinetic energy of a symmetric segment
    just as well and follows its precession better.
    """
    wx, wy, wz = dt * m[k, 0], dt * m[k, 1], dt * m[k, 2]
    v[i, 0] = dt * m[k, 3] + h * (wy * z - wz * y)
    v[i, 1] = dt * m[k, 4] + h * (wz * x - wx * z)
    v[i, 2] = dt * m[k, 5] + h * (wx * y - wy * x)
    a, b, c = frame[i, 9], frame[i, 10], frame[i, 11]
    sx, sy, sz = y * c - z * b, z * a - x * c, x * b - y * a
    share = 1.0 / max(1e-12, 1.0 + x * a + y * b + z * c)
    share *= sx * wx + sy * wy + sz * wz
    cosine = x * a + y * b + z * c
    v[i, 3] = cosine * wx + sy * wz - sz * wy + share * sx
    v[i, 4] = cosine * wy + sz * wx - sx * wz + share * sy
    v[i, 5] = cosine * wz + sx * wy - sy * wx + share * sz


@kernel
def balance(plan, model, state, scratch, gravity, dt):
    """Preload every joint with what the weight of the rest pose asks of it."""
    still = np.zeros((len(state.poses), 3))
    for t in range(len(plan.start) - 1):
        rows = plan.row[plan.start[t]:plan.start[t + 1]]
        above = plan.above[plan.start[t]:plan.start[t + 1]]
        factor(rows, above, model, state, scratch, still, gravity, dt, 0.0)
        for k in range(len(rows)):
            joints.preload(rows[k], k, model, scratch)
