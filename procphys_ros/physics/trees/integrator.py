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
Integrator: the implicit midpoint rule for articulated bodies in carry form.

A step solves for the mean velocities w over it, at the pose predicted for its middle, as a fully
implicit step of half the length would; then bends advance by dt·w and velocities to 2·w - v. With
E the kinetic energy of the carried velocities and the energy of the springs, E changes only by the
work of loads and dampers, at any pose and stiffness: there is no numerical damping, and the
integration is unconditionally stable. Three things are added (docs/decisions/0008):

* Carried velocities drift from the constraints of the joints with every rotation of a branch;
  every `_PERIOD` steps they are projected back.
* The work of weight and anchors is computed along straight lines, but segments move on arcs. The
  difference is known after the step and subtracted from the kinetic energy of the tree.
* Bend limits are inelastic: a step that reaches one is fully implicit.
"""

import math

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.trees import anchors, joints, passes, pose
from procphys_ros.physics.trees.layout import ACROSS, ALONG, MASS, REACH
from procphys_ros.physics.trees.spatial import INLINE, KERNEL
from procphys_ros.physics.trees.state import SegmentJoint

_SPRUNG = int(SegmentJoint.SPRUNG)
_FREE = int(SegmentJoint.FREE)
_ATTEMPTS = 4  # solutions per step while limits engage or release; clamping handles the rest
_PERIOD = 16  # [steps] between projections, staggered over trees
_GRAMS = 1000.0  # [1/kg]
_MIDPOINT, _IMPLICIT = 0.5, 1.0  # implicitness θ of a step


@kernel(**KERNEL, nogil=True)
def step(plan, trees, spans, model, state, scratch, wind, gravity):
    """
    Advance some trees, each by its own time step.

    :param trees: indices in the plan, (K,).
    :param spans: time step of each [s], (K,).
    :param wind: air velocity at the centres of mass [m/s], (S, 3).
    :param gravity: [m/s²], (3,).
    """
    for n in range(len(trees)):
        first, last = plan.start[trees[n]], plan.start[trees[n] + 1]
        rows, above = plan.row[first:last], plan.above[first:last]
        advance(rows, above, model, state, scratch, wind, gravity, spans[n])


@subroutine(**KERNEL)
def advance(rows, above, model, state, scratch, wind, gravity, dt):
    """Advance one tree by a time step; arguments as of `step`."""
    theta = solve(rows, above, model, state, scratch, wind, gravity, dt)
    move(rows, above, model, state, scratch, gravity, dt, theta)


@subroutine(**KERNEL)
def take_up(rows, body, state):
    """Convert velocity changes of one tree since the last step to impulses."""
    v, old, frame, push = state.velocities, state.carried, state.frame, state.push
    for i in rows:
        if (v[i, 0] == old[i, 0] and v[i, 1] == old[i, 1] and v[i, 2] == old[i, 2]
                and v[i, 3] == old[i, 3] and v[i, 4] == old[i, 4] and v[i, 5] == old[i, 5]):
            continue
        x, y, z = frame[i, 9], frame[i, 10], frame[i, 11]
        wx, wy, wz = v[i, 3] - old[i, 3], v[i, 4] - old[i, 4], v[i, 5] - old[i, 5]
        spin = (body[i, ALONG] - body[i, ACROSS]) * (wx * x + wy * y + wz * z)
        for c in range(3):
            push[i, c] += body[i, MASS] * (v[i, c] - old[i, c])
        push[i, 3] += body[i, ACROSS] * wx + spin * x
        push[i, 4] += body[i, ACROSS] * wy + spin * y
        push[i, 5] += body[i, ACROSS] * wz + spin * z
        for c in range(6):
            v[i, c] = old[i, c]
        state.struck[rows[0], 0] = 1.0


@subroutine(**KERNEL)
def project(rows, above, model, state, scratch, wind, gravity):
    """Project the carried velocities of one tree on the constraints of its joints."""
    frame, m = state.frame, scratch.motion
    passes.factor(rows, above, model, state, scratch, frame, wind, gravity, 0.0, 1.0, 1.0,
                  0.0)
    passes.take(rows, above, model, state, scratch, frame, 0.0)
    for k in range(len(rows)):
        i = rows[k]
        h = model.body[i, REACH] + state.bend[i, 3]
        x, y, z = h * frame[i, 9], h * frame[i, 10], h * frame[i, 11]
        settle(i, m[k, 3] + m[k, 1] * z - m[k, 2] * y, m[k, 4] + m[k, 2] * x - m[k, 0] * z,
               m[k, 5] + m[k, 0] * y - m[k, 1] * x, m[k, 0], m[k, 1], m[k, 2], state)


@subroutine(**INLINE)
def settle(i, vx, vy, vz, wx, wy, wz, state):
    """Replace the carried velocities of row i; changes since the last step are kept."""
    value, v, old = (vx, vy, vz, wx, wy, wz), state.velocities, state.carried
    for c in range(6):
        v[i, c] = value[c] if v[i, c] == old[i, c] else v[i, c] + (value[c] - old[i, c])
        old[i, c] = value[c]


@subroutine(**KERNEL)
def solve(rows, above, model, state, scratch, wind, gravity, dt):
    """
    Solve for the mean motion of one tree over a step.

    :returns: implicitness θ: motions are velocities over θ·dt, those at the end of the step
        (w - (1-θ)·v)/θ; at θ = 1/2 the effect of impulses is in `Scratch.kick`, not in motions.
    """
    frame, h = state.middle, _MIDPOINT * dt
    root = rows[0]
    # Stagger trees by weight: the motion of a tree depends neither on its place nor on others.
    turn = int(_GRAMS * model.body[root, MASS])
    if (int(state.age[root, 0]) + turn) % _PERIOD == 0:
        project(rows, above, model, state, scratch, wind, gravity)
    changed = passes.factor(rows, above, model, state, scratch, frame, wind, gravity, h, dt, 1.0,
                            0.0)
    if changed:
        take_up(rows, model.body, state)
    passes.take(rows, above, model, state, scratch, frame, h)
    struck = state.struck[rows[0], 0]
    if struck != 0.0:
        passes.kick(rows, above, model, state, scratch, frame, dt)
    if not limits_changed(rows, model, state, scratch, dt):
        return _MIDPOINT
    for _ in range(_ATTEMPTS - 1):
        passes.factor(rows, above, model, state, scratch, frame, wind, gravity, dt, dt, 1.0,
                      struck)
        passes.take(rows, above, model, state, scratch, frame, dt)
        if not limits_changed(rows, model, state, scratch, dt):
            break
    return _IMPLICIT


@subroutine(**KERNEL)
def limits_changed(rows, model, state, scratch, dt):
    """Check all bends of one tree against their limits; return whether to solve it again."""
    changed = False
    for k in range(len(rows)):
        if model.joint[rows[k]] != _FREE and joints.limit_changed(
                rows[k], k, dt, model.swing, state.bend, state.stop, scratch.rate, scratch.bound):
            changed = True
    return changed


@subroutine(**KERNEL)
def move(rows, above, model, state, scratch, gravity, dt, theta):
    """Advance joints, poses and velocities to the end of the step."""
    struck = state.struck[rows[0], 0] != 0.0
    kicked = struck and theta == _MIDPOINT
    gain, kinetic, scale = 0.0, 0.0, 1.0
    held, holds = state.struck[rows[0], 1] != 0.0, model.joint[rows[0]] != _FREE
    on, off = 1.0 / theta, 1.0 / theta - 1.0
    for k in range(len(rows)):
        lost, energy = move_segment(k, rows, above, model, state, scratch, gravity, dt,
                                    theta * dt, on, off, kicked, held)
        gain += lost
        kinetic += energy
        if held and state.anchor[rows[k], anchors.STIFFNESS] > 0.0:
            holds = True
    state.age[rows[0], 0] = state.age[rows[0], 0] + 1.0 if kinetic > 0.0 else 0.0
    if holds and gain != 0.0:
        if gain < kinetic:
            scale = math.sqrt(1.0 - gain / kinetic)
        else:
            scale = 0.0
            undo(rows, above, model, state, scratch)
    for i in rows:
        for c in range(6):
            state.carried[i, c] *= scale
            state.velocities[i, c] = state.carried[i, c]
    if struck:
        state.struck[rows[0], 0] = 0.0
        for i in rows:
            for c in range(6):
                state.push[i, c] = 0.0


@subroutine(**KERNEL)
def undo(rows, above, model, state, scratch):
    """Undo the step of one tree whose excess work of weight exceeds its kinetic energy."""
    for k in range(len(rows)):
        i = rows[k]
        for c in range(4):
            state.bend[i, c] = scratch.before[k, c]
        pose.place(k, rows, above, model, state)
        for c in range(12):
            state.middle[i, c] = state.frame[i, c]


@subroutine(**INLINE)
def move_segment(k, rows, above, model, state, scratch, gravity, dt, per, on, off, kicked,
                 held):
    """
    Advance one segment to the end of the step.

    :param per: factor from motions to velocities [s].
    :param on: weight of the mean velocity in the new one; `off` of the old one, subtracted.

    :returns: energy added by moving on an arc and by a limit [J], and kinetic energy [J].
    """
    i, body = rows[k], model.body
    frame, middle, poses, v, m = (state.frame, state.middle, state.poses, state.carried,
                                  scratch.motion)
    x, y, z = middle[i, 9], middle[i, 10], middle[i, 11]
    h = body[i, REACH] + state.bend[i, 3]
    mean = at_centre(m, k, per, h * x, h * y, h * z)
    px, py, pz = poses[i, 0], poses[i, 1], poses[i, 2]
    vx, vy, vz = on * mean[0] - off * v[i, 0], on * mean[1] - off * v[i, 1], (
        on * mean[2] - off * v[i, 2])
    wx, wy, wz = (on * mean[3] - off * scratch.spin[k, 0], on * mean[4] - off * scratch.spin[k, 1],
                  on * mean[5] - off * scratch.spin[k, 2])
    if kicked:
        more = at_centre(scratch.kick, k, 1.0, h * x, h * y, h * z)
        mean = (mean[0] + 0.5 * more[0], mean[1] + 0.5 * more[1], mean[2] + 0.5 * more[2],
                mean[3] + 0.5 * more[3], mean[4] + 0.5 * more[4], mean[5] + 0.5 * more[5])
        vx, vy, vz = vx + more[0], vy + more[1], vz + more[2]
        wx, wy, wz = wx + more[3], wy + more[4], wz + more[5]
    lost = 0.0
    for c in range(4):
        scratch.before[k, c] = state.bend[i, c]
    if model.joint[i] == _FREE:
        pose.advance_free(i, dt, mean, model, state)
    else:
        lost = pose.advance_bend(i, scratch.rate[k, 0], scratch.rate[k, 1], dt, model,
                                 state)
        joints.flow(i, model.swing, state.bend, state.kept)
        if model.joint[i] == _SPRUNG:
            joints.advance_extra(i, k, dt, model, state, scratch)
        pose.place(k, rows, above, model, state)
    a, b, c = frame[i, 9], frame[i, 10], frame[i, 11]
    wx, wy, wz = passes.turn_along(x, y, z, a, b, c, wx, wy, wz)
    v[i, 0], v[i, 1], v[i, 2], v[i, 3], v[i, 4], v[i, 5] = vx, vy, vz, wx, wy, wz
    spin = wx * a + wy * b + wz * c
    energy = 0.5 * (body[i, MASS] * (vx * vx + vy * vy + vz * vz)
                    + body[i, ACROSS] * (wx * wx + wy * wy + wz * wz)
                    + (body[i, ALONG] - body[i, ACROSS]) * spin * spin)
    px, py, pz = px + dt * mean[0], py + dt * mean[1], pz + dt * mean[2]
    lost += body[i, MASS] * (gravity[0] * (px - poses[i, 0]) + gravity[1] * (py - poses[i, 1])
                             + gravity[2] * (pz - poses[i, 2]))
    if held:
        lost += anchors.energy_between(i, state.anchor, px, py, pz, poses)
    return lost, energy


@subroutine(**INLINE)
def at_centre(m, k, per, x, y, z):
    """Compute linear and angular velocity at an arm (x, y, z) from the joint point of entry k."""
    wx, wy, wz = per * m[k, 0], per * m[k, 1], per * m[k, 2]
    return (per * m[k, 3] + wy * z - wz * y, per * m[k, 4] + wz * x - wx * z,
            per * m[k, 5] + wx * y - wy * x, wx, wy, wz)
