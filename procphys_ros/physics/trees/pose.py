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


"""Pose: forward kinematics of segments from parents and joint coordinates."""

import math

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import functions
from procphys_ros.physics.trees.breaks import FLOOR, SIDE, WEAK_X, WEAK_Y
from procphys_ros.physics.trees.joints import shuts, unbent
from procphys_ros.physics.trees.layout import LIMIT, REACH, STIFFNESS
from procphys_ros.physics.trees.spatial import INLINE, KERNEL
from procphys_ros.physics.trees.state import SegmentJoint

_FREE = int(SegmentJoint.FREE)
_SPRUNG = int(SegmentJoint.SPRUNG)
_S3, _S5, _S7, _S9 = -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0
_C4, _C6, _C8, _C10 = 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3628800.0


@subroutine(**INLINE)
def multiply(a, b):
    """Multiply quaternions xyzw given as four floats each."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz)


@subroutine(**INLINE)
def rotate(q, x, y, z):
    """Rotate a vector by a quaternion."""
    qx, qy, qz, qw = q
    tx = 2.0 * (qy * z - qz * y)
    ty = 2.0 * (qz * x - qx * z)
    tz = 2.0 * (qx * y - qy * x)
    return (x + qw * tx + qy * tz - qz * ty, y + qw * ty + qz * tx - qx * tz,
            z + qw * tz + qx * ty - qy * tx)


@subroutine(**INLINE)
def sine_cosine(x):
    """Return sine and cosine of an angle, for small ones by series, exact to rounding."""
    s = x * x
    if s < 0.015625:
        sine = x + x * s * (_S3 + s * (_S5 + s * (_S7 + s * _S9)))
        cosine = 1.0 - s * (0.5 - s * (_C4 + s * (_C6 + s * (_C8 + s * _C10))))
    else:
        sine, cosine = functions.sin(x), functions.cos(x)
    return sine, cosine


@subroutine(**INLINE)
def place(k, rows, above, model, state):
    """
    Set frame and pose of entry k of a tree from its parent, or from the world.

    The joint rotates about x, then about the rotated y, then twists about the segment and slides
    along it.
    """
    i, mount = rows[k], model.mount
    bend, frame, poses = state.bend, state.frame, state.poses
    rest = (mount[i, 3], mount[i, 4], mount[i, 5], mount[i, 6])
    x, y, z = mount[i, 0], mount[i, 1], mount[i, 2]
    if above[k] >= 0:
        p = rows[above[k]]
        parent = (poses[p, 3], poses[p, 4], poses[p, 5], poses[p, 6])
        x, y, z = rotate(parent, x, y, z + bend[p, 3])
        x += frame[p, 0]
        y += frame[p, 1]
        z += frame[p, 2]
        rest = multiply(parent, rest)
    sx, cx = sine_cosine(0.5 * bend[i, 0])
    sy, cy = sine_cosine(0.5 * bend[i, 1])
    q = multiply(rest, (sx * cy, cx * sy, sx * sy, cx * cy))
    set_frame(i, x, y, z, q, 1.0 - 2.0 * sy * sy, 2.0 * sy * cy, frame, state.middle)
    if model.joint[i] == _SPRUNG:
        c, s = functions.cos_sin(0.5 * bend[i, 2])
        q = multiply(q, (0.0, 0.0, s, c))
    reach = model.body[i, REACH] + bend[i, 3]
    poses[i, 0] = x + reach * frame[i, 9]
    poses[i, 1] = y + reach * frame[i, 10]
    poses[i, 2] = z + reach * frame[i, 11]
    poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6] = q


@subroutine(**INLINE)
def set_frame(i, x, y, z, q, cosine, sine, frame, middle):
    """Write joint point and axes of row i; the first axis is that before the second rotation."""
    qx, qy, qz, qw = q
    ax = 2.0 * (qx * qz + qy * qw)
    ay = 2.0 * (qy * qz - qx * qw)
    az = 1.0 - 2.0 * (qx * qx + qy * qy)
    put(i, 0, x, frame, middle)
    put(i, 1, y, frame, middle)
    put(i, 2, z, frame, middle)
    put(i, 3, cosine * (1.0 - 2.0 * (qy * qy + qz * qz)) + sine * ax, frame, middle)
    put(i, 4, cosine * 2.0 * (qx * qy + qz * qw) + sine * ay, frame, middle)
    put(i, 5, cosine * 2.0 * (qx * qz - qy * qw) + sine * az, frame, middle)
    put(i, 6, 2.0 * (qx * qy - qz * qw), frame, middle)
    put(i, 7, 1.0 - 2.0 * (qx * qx + qz * qz), frame, middle)
    put(i, 8, 2.0 * (qy * qz + qx * qw), frame, middle)
    put(i, 9, ax, frame, middle)
    put(i, 10, ay, frame, middle)
    put(i, 11, az, frame, middle)
    normalise_axis(i, middle)


@subroutine(**INLINE)
def put(i, c, value, frame, middle):
    """Set a column of the frame; extrapolate it by half the change to the next step's middle."""
    middle[i, c] = value + 0.5 * (value - frame[i, c])
    frame[i, c] = value


@subroutine(**INLINE)
def normalise_axis(i, middle):
    """Normalise the extrapolated axis of row i; at rest the axis is kept to the last bit."""
    x, y, z = middle[i, 9], middle[i, 10], middle[i, 11]
    excess = x * x + y * y + z * z - 1.0
    if excess > 1e-12:
        if excess < 1e-3:
            scale = 1.0 - excess * (0.5 - excess * (0.375 - excess * 0.3125))
        else:
            scale = 1.0 / math.sqrt(1.0 + excess)
        middle[i, 9], middle[i, 10], middle[i, 11] = scale * x, scale * y, scale * z


@kernel(**KERNEL)
def place_all(plan, model, state):
    """Place every active row with a joint, and reset the frames at the middle of the step."""
    for t in range(len(plan.start) - 1):
        rows = plan.row[plan.start[t]:plan.start[t + 1]]
        above = plan.above[plan.start[t]:plan.start[t + 1]]
        for k in range(len(rows)):
            i = rows[k]
            if model.joint[i] != _FREE:
                place(k, rows, above, model, state)
            for c in range(12):
                state.middle[i, c] = state.frame[i, c]


@kernel(**KERNEL)
def shift(plan, trees, model, state, ahead):
    """
    Place some trees whose constants have changed, at their bends.

    What the frames at the middle of the next step are ahead of the present ones stays.

    :param trees: indices in the plan, without free roots, (K,).
    :param ahead: workspace, (12,).
    """
    for t in trees:
        rows = plan.row[plan.start[t]:plan.start[t + 1]]
        above = plan.above[plan.start[t]:plan.start[t + 1]]
        for k in range(len(rows)):
            i = rows[k]
            for c in range(12):
                ahead[c] = state.middle[i, c] - state.frame[i, c]
            place(k, rows, above, model, state)
            for c in range(12):
                state.middle[i, c] = state.frame[i, c] + ahead[c]
            normalise_axis(i, state.middle)


@subroutine(**INLINE)
def advance_bend(i, first, second, dt, model, state):
    """
    Advance the bend of row i to the end of the step and clamp it at its limit.

    :param first: mean rate about the first axis, `second` about the other [rad/s].
    :returns: elastic energy added by clamping, mostly negative [J].
    """
    bend, stop, won = state.bend, state.stop, 0.0
    x = bend[i, 0] + dt * first
    y = bend[i, 1] + dt * second
    limit, square = model.swing[i, LIMIT], x * x + y * y
    if model.swing[i, SIDE] > 0.0:
        short = model.swing[i, FLOOR] - x * model.swing[i, WEAK_X] - y * model.swing[i, WEAK_Y]
        if short > 0.0:
            x += short * model.swing[i, WEAK_X]
            y += short * model.swing[i, WEAK_Y]
            square = x * x + y * y
    if square > limit * limit:
        shrink = limit / math.sqrt(square)
        m1, m2 = unbent(i, model.swing, state.kept)
        won = (0.5 * model.swing[i, STIFFNESS] * (limit * limit - square)
               + (1.0 - shrink) * (m1 * x + m2 * y))
        x *= shrink
        y *= shrink
        square = limit * limit
    if (stop[i, 0] != 0.0 or stop[i, 1] != 0.0) and square > 0.0 and not shuts(
            i, stop[i, 0], stop[i, 1], model.swing):
        size = math.sqrt(square)
        stop[i, 0] = x / size
        stop[i, 1] = y / size
    bend[i, 0] = x
    bend[i, 1] = y
    return won


@subroutine(**KERNEL)
def advance_free(i, dt, v, model, state):
    """
    Advance a free root by its mean velocity over the step: exact in free fall.

    :param v: linear of the centre of mass and angular [m/s], [rad/s], 6 numbers.
    """
    poses, frame = state.poses, state.frame
    reach = model.body[i, REACH] + state.bend[i, 3]
    poses[i, 0] += dt * v[0]
    poses[i, 1] += dt * v[1]
    poses[i, 2] += dt * v[2]
    wx, wy, wz = v[3], v[4], v[5]
    speed = math.sqrt(wx * wx + wy * wy + wz * wz)
    angle = 0.5 * dt * speed
    share = functions.sin(angle) / speed if speed > 1e-12 else 0.5 * dt
    q = multiply((wx * share, wy * share, wz * share, functions.cos(angle)),
                 (poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6]))
    size = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    q = (q[0] * size, q[1] * size, q[2] * size, q[3] * size)
    poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6] = q
    x, y, z = rotate(q, 0.0, 0.0, reach)
    set_frame(i, poses[i, 0] - x, poses[i, 1] - y, poses[i, 2] - z, q, 1.0, 0.0, frame,
              state.middle)
