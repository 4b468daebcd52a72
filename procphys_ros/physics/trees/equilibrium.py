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
Equilibrium: static equilibrium of trees, with springs balancing weight, anchors and drag.

Newton's method, solved by the passes of an implicit step: one of length h from rest moves joints
by dq with (M/h² + D/h + K)·dq = unbalanced loads, D being the dampers and the air, K the springs
and the tension stiffening of hanging or streaming segments. From iteration to iteration h grows,
from a slow motion that does not overshoot to Newton's steps. The softening of standing segments by
their weight is left out, so that K is always positive: standing trees then converge by a factor of
5 to 20 per iteration. Joints beyond their yield moments have the secants of their springs, and
keep what bends them once the equilibrium is found.
"""

import math

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.trees import integrator, joints, passes, pose
from procphys_ros.physics.trees.layout import PRELOAD_X, PRELOAD_Y, REACH, STIFFNESS
from procphys_ros.physics.trees.spatial import INLINE, KERNEL
from procphys_ros.physics.trees.state import SegmentJoint

_SPRUNG = int(SegmentJoint.SPRUNG)
_FIRST, _GROWTH, _LAST = 0.1, 3.0, 30.0  # [s], [-], [s] first h, its growth factor, last h
_NEAR = 0.01  # [rad], [m] change in an iteration after which Newton's steps are safe
_TURNS = 100  # iterations at most, for trees loaded far beyond their strength; others take 8 to 40


@kernel(**KERNEL, nogil=True)
def lean(plan, trees, model, state, scratch, wind, gravity, goal):
    """
    Solve for the static equilibrium of trees in a steady wind, at any load of their joints.

    :param trees: indices in the plan, (K,).
    :param wind: air velocity at the centres of mass [m/s], (S, 3).
    :param gravity: [m/s²], (3,).
    :param goal: largest change of a joint in the last iteration [rad] or [m].
    """
    for t in trees:
        rows = plan.row[plan.start[t]:plan.start[t + 1]]
        above = plan.above[plan.start[t]:plan.start[t + 1]]
        h = _FIRST
        for _ in range(_TURNS):
            passes.load_all(rows, model, state, scratch, state.frame, wind, gravity, h)
            tighten(rows, above, model, state, scratch, h)
            soften(rows, model.swing, state, scratch.jump)
            passes.eliminate_joints(rows, above, model, state, scratch, state.frame, h, h, 1.0)
            passes.take(rows, above, model, state, scratch, state.frame, h)
            changed = integrator.limits_changed(rows, model, state, scratch, h)
            moved = bend(rows, above, model, state, scratch, h)
            stiffen(rows, model.swing, scratch.jump)
            if h == _LAST and moved < goal and not changed:
                break
            h = _LAST if moved < _NEAR else min(_GROWTH * h, _LAST)
        for i in rows:
            joints.flow(i, model.swing, state.bend, state.kept)
            for c in range(12):
                state.middle[i, c] = state.frame[i, c]
            for c in range(6):
                state.wrenches[i, c] = math.nan


@subroutine(**INLINE)
def tighten(rows, above, model, state, scratch, h):
    """Add the stiffness by tension against rotation of segments under pull."""
    a, f, frame = scratch.inertia, scratch.blow, state.frame
    for k in range(len(rows)):
        i = rows[k]
        reach = model.body[i, REACH] + state.bend[i, 3]
        f[k, 0], f[k, 1], f[k, 2] = a[k, 24], a[k, 25], a[k, 26]
        f[k, 3] = reach * (frame[i, 9] * f[k, 0] + frame[i, 10] * f[k, 1] + frame[i, 11] * f[k, 2])
    for k in range(len(rows) - 1, -1, -1):
        i, up = rows[k], above[k]
        if up >= 0:
            x, y, z = passes.apart(frame, i, rows[up])
            f[up, 3] += x * f[k, 0] + y * f[k, 1] + z * f[k, 2]
            for c in range(3):
                f[up, c] += f[k, c]
        x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
        s = h * h * max(0.0, f[k, 3])
        a[k, 0] += s * (1.0 - x * x)
        a[k, 1] -= s * x * y
        a[k, 2] -= s * x * z
        a[k, 3] += s * (1.0 - y * y)
        a[k, 4] -= s * y * z
        a[k, 5] += s * (1.0 - z * z)


@subroutine(**INLINE)
def soften(rows, swing, state, own):
    """
    Scale the springs of joints beyond their yield moments to their secants.

    :param own: receives what the springs were, (n, 4).
    """
    for k in range(len(rows)):
        i = rows[k]
        own[k, 0] = swing[i, STIFFNESS]
        own[k, 1], own[k, 2] = swing[i, PRELOAD_X], swing[i, PRELOAD_Y]
        share = joints.secant(i, swing, state.bend, state.kept)
        if share < 1.0:
            swing[i, STIFFNESS] *= share
            swing[i, PRELOAD_X] *= share
            swing[i, PRELOAD_Y] *= share


@subroutine(**INLINE)
def stiffen(rows, swing, own):
    """Restore springs to what they were before `soften`."""
    for k in range(len(rows)):
        i = rows[k]
        swing[i, STIFFNESS], swing[i, PRELOAD_X] = own[k, 0], own[k, 1]
        swing[i, PRELOAD_Y] = own[k, 2]


@subroutine(**INLINE)
def bend(rows, above, model, state, scratch, h):
    """Advance the joints of one tree by a step; return the largest change [rad] or [m]."""
    moved = 0.0
    for k in range(len(rows)):
        i = rows[k]
        for c in range(4):
            scratch.before[k, c] = state.bend[i, c]
        pose.advance_bend(i, scratch.rate[k, 0], scratch.rate[k, 1], h, model, state)
        if model.joint[i] == _SPRUNG:
            joints.advance_extra(i, k, h, model, state, scratch)
        pose.place(k, rows, above, model, state)
        for c in range(4):
            moved = max(moved, abs(state.bend[i, c] - scratch.before[k, c]))
    return moved
