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
Passes over one tree: load, eliminate (tip to root), solve (root to tip), and again for impulses.

Articulated bodies at velocity level in carry form: every segment keeps its own velocities from
the last step; the passes project that momentum on the joints of one pose and add the effects of
springs, dampers, weight and air over a time h, all of them implicit. All motions are velocities
over h and all loads are forces, so that a balanced tree stays exactly at rest.
"""

import math

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import functions
from procphys_ros.physics.air import CALM, STORM
from procphys_ros.physics.trees import anchors, joints
from procphys_ros.physics.trees.layout import (
    ACROSS,
    ALONG,
    CROSS_FLOW,
    EXTRA_STIFFNESS,
    EXTRA_STRIDE,
    LEAF_FLOW,
    LENGTH,
    MASS,
    REACH,
    VOGEL,
)
from procphys_ros.physics.trees.spatial import (
    add,
    add_load,
    INLINE,
    KERNEL,
    read,
    read_load,
    relieve,
    shift,
    shift_load,
    shift_motion,
    slide_slope,
    symmetric,
    turn_slope,
    write,
    write_load,
)
from procphys_ros.physics.trees.state import SegmentJoint

_SPRUNG = int(SegmentJoint.SPRUNG)
_FREE = int(SegmentJoint.FREE)


@subroutine(**KERNEL)
def factor(rows, above, model, state, scratch, frame, wind, gravity, h, dt, gate,
           pressed):
    """
    Load one tree and eliminate its joints from the tips to the root.

    :param frame: pose to linearise about, `ForestState.frame` or `ForestState.middle`.
    :param wind: air velocity at the centres of mass [m/s], (S, 3).
    :param gravity: [m/s²], (3,).
    :param h: implicit time [s]; with 0 only momentum counts, and motions are velocities.
    :param dt: time for a bend to reach its limit [s].
    :param gate: 1, or 0 to lock the joints (loads then pass unchanged).
    :param pressed: 1 to apply pending impulses as loads, forces over h, else 0; a number, since
        numba would compile a second version for a literal False.
    :returns: whether velocities were changed since the last step.
    """
    changed = load_all(rows, model, state, scratch, frame, wind, gravity, h)
    if pressed != 0.0:
        press(rows, model, state, scratch, frame, h)
    eliminate_joints(rows, above, model, state, scratch, frame, h, dt, gate)
    return changed


@subroutine(**INLINE)
def load_all(rows, model, state, scratch, frame, wind, gravity, h):
    """Write inertias and loads of one tree, see `factor`; return whether velocities changed."""
    a, changed, held = scratch.inertia, False, state.struck[rows[0], 1] != 0.0
    for k in range(len(rows)):
        changed |= was_changed(rows[k], state)
        load(rows[k], k, model.body, state, frame, a, scratch.spin, wind, gravity, h, held)
    return changed


@subroutine(**INLINE)
def eliminate_joints(rows, above, model, state, scratch, frame, h, dt, gate):
    """Eliminate the joints of one tree, see `factor`."""
    a = scratch.inertia
    for k in range(len(rows) - 1, -1, -1):
        i, up = rows[k], above[k]
        if model.joint[i] == _FREE:
            continue
        if model.joint[i] == _SPRUNG:
            joints.give_extra(i, k, h, gate, model, state.bend, frame, scratch)
        j, b, m, p = joints.give_swing(i, k, h, dt, gate, model.swing, state.bend, state.kept,
                                       state.stop, frame, a, scratch.factor, scratch.bound)
        if up >= 0:
            x, y, z = apart(frame, i, rows[up])
            j, b, m = shift(j, b, m, x, y, z)
            add(a, up, j, b, m, shift_load(p, x, y, z))


@subroutine(**INLINE)
def was_changed(i, state):
    """Return whether the velocities of row i were changed since the last step."""
    new, old = state.velocities, state.carried
    return (new[i, 0] != old[i, 0] or new[i, 1] != old[i, 1] or new[i, 2] != old[i, 2]
            or new[i, 3] != old[i, 3] or new[i, 4] != old[i, 4] or new[i, 5] != old[i, 5])


@subroutine(**INLINE)
def apart(frame, i, up):
    """Return the vector from the joint point of row `up` to that of row i."""
    return frame[i, 0] - frame[up, 0], frame[i, 1] - frame[up, 1], frame[i, 2] - frame[up, 2]


@subroutine(**INLINE)
def turn_along(x, y, z, a, b, c, wx, wy, wz):
    """
    Rotate an angular velocity with an axis, from (x, y, z) to (a, b, c) by the smallest rotation.

    Rotation with the axis, not with the body, conserves the kinetic energy of a symmetric segment
    as well, and follows its precession better.
    """
    sx, sy, sz = y * c - z * b, z * a - x * c, x * b - y * a
    cosine = x * a + y * b + z * c
    share = (sx * wx + sy * wy + sz * wz) / max(1e-12, 1.0 + cosine)
    return (cosine * wx + sy * wz - sz * wy + share * sx,
            cosine * wy + sz * wx - sx * wz + share * sy,
            cosine * wz + sx * wy - sy * wx + share * sz)


@subroutine(**INLINE)
def load(i, k, body, state, frame, a, turned, wind, gravity, h, held):
    """Write inertia and load of segment i, with implicit drag, into row k."""
    v, end = state.carried, state.frame
    x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
    wx, wy, wz = turn_along(end[i, 9], end[i, 10], end[i, 11], x, y, z, v[i, 3], v[i, 4], v[i, 5])
    turned[k, 0], turned[k, 1], turned[k, 2] = wx, wy, wz
    cross, foliage, turning = drag(i, x, y, z, wx, wy, wz, body, v, wind)
    per, acts = (1.0 / h, 1.0) if h > 0.0 else (1.0, 0.0)
    mass, reach = body[i, MASS], body[i, REACH] + state.bend[i, 3]
    air = cross + foliage
    along = cross * (wind[i, 0] * x + wind[i, 1] * y + wind[i, 2] * z)
    pull, grip = (0.0, 0.0, 0.0), 0.0
    if held:
        pull, grip = anchors.pull(i, state.anchor, state.poses, h)
    fx = mass * v[i, 0] * per + acts * (mass * gravity[0] + air * wind[i, 0] - along * x + pull[0])
    fy = mass * v[i, 1] * per + acts * (mass * gravity[1] + air * wind[i, 1] - along * y + pull[1])
    fz = mass * v[i, 2] * per + acts * (mass * gravity[2] + air * wind[i, 2] - along * z + pull[2])
    across = body[i, ACROSS] * per
    spin = (body[i, ALONG] * per - across) * (wx * x + wy * y + wz * z)
    j, b, m = symmetric(x, y, z, reach, mass + h * (air + grip), h * cross,
                        body[i, ACROSS] + h * turning, body[i, ALONG])
    p = (across * wx + spin * x + reach * (y * fz - z * fy),
         across * wy + spin * y + reach * (z * fx - x * fz),
         across * wz + spin * z + reach * (x * fy - y * fx), fx, fy, fz)
    write(a, k, j, b, m, p)


@subroutine(**INLINE)
def pushed(i, body, state, frame):
    """Return the pending impulses of row i at its joint point: 3 angular, 3 linear."""
    reach, push = body[i, REACH] + state.bend[i, 3], state.push
    x, y, z = reach * frame[i, 9], reach * frame[i, 10], reach * frame[i, 11]
    px, py, pz = push[i, 0], push[i, 1], push[i, 2]
    return (push[i, 3] + y * pz - z * py, push[i, 4] + z * px - x * pz,
            push[i, 5] + x * py - y * px, px, py, pz)


@subroutine(**INLINE)
def drag(i, x, y, z, wx, wy, wz, body, v, wind):
    """
    Compute the drag of segment i per speed: wood across its axis, foliage, and rotation.

    Wood follows the cross-flow principle (Hoerner 1965): only the flow normal to the axis counts.
    Rotational drag integrates the same law along the segment, over translation and rotation.
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
            foliage *= functions.power(min(speed, STORM) / CALM, body[i, VOGEL])
    spin = wx * x + wy * y + wz * z
    turn = math.sqrt(max(0.0, wx * wx + wy * wy + wz * wz - spin * spin))
    length = body[i, LENGTH]
    turning = length * length * ((cross + foliage) / 12.0
                                 + body[i, CROSS_FLOW] * turn * length / 32.0)
    return cross, foliage, turning


@subroutine(**KERNEL)
def take(rows, above, model, state, scratch, frame, h):
    """Propagate motion from root to tips, and write the wrenches that the joints transmit."""
    motion = scratch.motion
    for k in range(len(rows)):
        i = rows[k]
        if model.joint[i] == _FREE:
            joints.solve_free(k, scratch.inertia, scratch.root, motion)
            for c in range(6):
                state.wrenches[i, c] = 0.0
            continue
        v = handed_on(k, above[k], rows, frame, motion)
        transmit(k, i, scratch.inertia, v, state.wrenches)
        v = joints.take_swing(i, k, h, v, model.swing, state.stop, frame, scratch.factor,
                              scratch.rate)
        if model.joint[i] == _SPRUNG:
            v = joints.take_extra(i, k, h, v, model.extra, frame, scratch.factor, scratch.rate)
        (motion[k, 0], motion[k, 1], motion[k, 2], motion[k, 3], motion[k, 4],
         motion[k, 5]) = v


@subroutine(**INLINE)
def handed_on(k, up, rows, frame, motion):
    """Return the parent's motion at the joint point of entry k; zero for the ground."""
    v = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if up >= 0:
        x, y, z = apart(frame, rows[k], rows[up])
        v = shift_motion((motion[up, 0], motion[up, 1], motion[up, 2], motion[up, 3],
                          motion[up, 4], motion[up, 5]), x, y, z)
    return v


@subroutine(**INLINE)
def transmit(k, i, a, v, wrenches):
    """Write the wrench of the parent on row i for a motion v: force, then moment."""
    j, b, m, p = read(a, k)
    moment = turn_slope(j, b, v[0], v[1], v[2])
    force = slide_slope(b, m, v[3], v[4], v[5])
    for c in range(3):
        wrenches[i, c] = moment[3 + c] + force[3 + c] - p[3 + c]
        wrenches[i, 3 + c] = moment[c] + force[c] - p[c]


@subroutine(**KERNEL)
def press(rows, model, state, scratch, frame, h):
    """Add the pending impulses of one tree to its loads, as forces over the time h."""
    for k in range(len(rows)):
        p = pushed(rows[k], model.body, state, frame)
        for c in range(6):
            scratch.inertia[k, 21 + c] += p[c] / h


@subroutine(**KERNEL)
def kick(rows, above, model, state, scratch, frame, dt):
    """
    Solve for the motion caused by pending impulses alone, with the present factors.

    Impulses act evenly over the step. Velocity changes go to `Scratch.kick`; half of them is
    added to the mean rates of the step, and wrenches to those of the step.
    """
    a = scratch.inertia
    for k in range(len(rows)):
        write_load(a, k, pushed(rows[k], model.body, state, frame))
    for k in range(len(rows) - 1, -1, -1):
        i, up = rows[k], above[k]
        if model.joint[i] == _FREE:
            continue
        p = pass_on(i, k, model, state.stop, frame, scratch.factor, read_load(a, k))
        write_load(a, k, p)
        if up >= 0:
            x, y, z = apart(frame, i, rows[up])
            add_load(a, up, shift_load(p, x, y, z))
    for k in range(len(rows)):
        i = rows[k]
        if model.joint[i] == _FREE:
            joints.solve_free(k, a, scratch.root, scratch.kick)
            continue
        v = handed_on(k, above[k], rows, frame, scratch.kick)
        transmit(k, k, a, v, scratch.blow)
        for c in range(6):
            state.wrenches[i, c] += scratch.blow[k, c] / dt
        v = joints.take_swing(i, k, 1.0, v, model.swing, state.stop, frame, scratch.factor,
                              scratch.jump)
        if model.joint[i] == _SPRUNG:
            v = joints.take_extra(i, k, 1.0, v, model.extra, frame, scratch.factor, scratch.jump)
        for c in range(6):
            scratch.kick[k, c] = v[c]
        for c in range(4):
            scratch.rate[k, c] += 0.5 * scratch.jump[k, c]


@subroutine(**KERNEL)
def pass_on(i, k, model, stop, frame, f, p):
    """Eliminate the joint of row i from a load; return the remaining load."""
    n1, n2, _ = joints.basis(model.swing, stop, i)
    along = (frame[i, 9], frame[i, 10], frame[i, 11])
    if model.joint[i] == _SPRUNG:
        if not math.isinf(model.extra[i, EXTRA_STRIDE + EXTRA_STIFFNESS]):
            p = give(k, joints.STRETCH, p[3], p[4], p[5], along, f, p)
        if not math.isinf(model.extra[i, EXTRA_STIFFNESS]):
            p = give(k, joints.TWIST, p[0], p[1], p[2], along, f, p)
    p = give(k, joints.TANGENTIAL, p[0], p[1], p[2], joints.mix(frame, i, -n2, n1), f, p)
    return give(k, joints.RADIAL, p[0], p[1], p[2], joints.mix(frame, i, n1, n2), f, p)


@subroutine(**INLINE)
def give(k, d, x, y, z, axis, f, p):
    """Eliminate one degree of freedom from its share (x, y, z) of a load."""
    drive = x * axis[0] + y * axis[1] + z * axis[2]
    f[k, d, 7] = drive
    return relieve(p, (f[k, d, 0], f[k, d, 1], f[k, d, 2], f[k, d, 3], f[k, d, 4], f[k, d, 5]),
                   f[k, d, 6] * drive)


@kernel
def balance(plan, model, state, scratch, gravity, dt):
    """Preload every joint against the weight in the rest pose."""
    still = np.zeros((len(state.poses), 3))
    for t in range(len(plan.start) - 1):
        rows = plan.row[plan.start[t]:plan.start[t + 1]]
        above = plan.above[plan.start[t]:plan.start[t + 1]]
        factor(rows, above, model, state, scratch, state.middle, still, gravity, dt, dt, 0.0,
               0.0)
        for k in range(len(rows)):
            joints.preload(rows[k], k, model, scratch)
