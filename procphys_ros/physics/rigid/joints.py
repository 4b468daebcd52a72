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
Joints: constraints between bodies, a row per direction, solved directly for each island.

The rows of an island form one symmetric system, which is factored along its envelope: a chain
costs as much per link as a single joint, and a heavy end stretches no link. Rows with bounds
(limits, motors) are active while they are within them. A substep uses the rows at its start;
positions satisfy the constraints at its end, to second order of the rotations, and the relaxation
passes make velocities consistent there: energy is conserved (RATTLE; Andersen 1983, J. Comput.
Phys. 52, 24-34).
"""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.elementary.functions import atan2
from procphys_ros.geometry.rotation_kernels import matrix_rows
from procphys_ros.physics.rigid.body_rows import EASE, eased, lightened, rotated, SPEED, SPIN, WAY
from procphys_ros.physics.rigid.vectors import (
    cross,
    dot,
    LEAN,
    length,
    less,
    plus,
    put,
    scaled,
    three,
)


class JointKind(ArrayEnum):
    """Degrees of freedom that a joint fixes; axes are those of its frame in the second body."""

    GONE = 0    # unused row
    WELD = 1    # all
    HINGE = 2   # all but rotation about x
    SLIDER = 3  # all but translation along x
    BALL = 4    # translation
    ROPE = 5    # none by itself; its axis leads from the second point to the first


_GONE, _WELD, _HINGE, _SLIDER, _BALL, _ROPE = (int(kind) for kind in JointKind)
# Number of equality rows by kind. The rows of the axis follow: spring, motor, limit.
_FIRM = (0, 6, 5, 5, 3, 0)
_ROWS = (0, 6, 8, 8, 3, 3)
_HOLDS, _SPRING, _MOTOR, _LIMIT = 0, 1, 2, 3

# A row per direction: its linear and its angular directions on the first and the second body, the
# changes of linear and angular velocity by a unit impulse, first and second, the constraint error,
# the bias velocity, its compliance, bounds of its impulse, the impulse of the present substep, and
# the pending change of that.
_ALONG, _ABOUT, _OTHER_ABOUT, _PULL, _TURN, _OTHER_PULL, _OTHER_TURN = 0, 3, 6, 9, 12, 15, 18
_GAP, _AIM, _SOFT, _LOW, _HIGH, _IMPULSE, _CHANGE = 21, 22, 23, 24, 25, 26, 27
_LINE = 28
# A row per joint: vector from the second point to the first, arms to them, axes of both frames.
_WAY, _ARM, _OTHER_ARM, _AXES, _OTHER_AXES, _PLACE = 0, 3, 6, 9, 18, 27

_CALM = 1e-4  # [m/s, rad/s] change of speed by a pass at which passes end
_SOLVES = 8.0  # of factored systems in a substep: two halves of four passes
_PER_CONTACT = 160.0  # products that take as long as a contact in four passes
_SPAN = 1.0 / 240.0  # [s] longest time of the mean forces that break joints
_RIDGE = 1e-5  # relative regularisation of the diagonal: redundant rows, which differ in the last
#                digits, would press against each other without bounds; passes make up for it


class JointRows(NamedTuple):
    """
    Columns of joints, a row each; displacements are along the axis [m], or about a hinge [rad].

    :ivar kind: `JointKind`, (J,).
    :ivar first, second: bodies, (J,).
    :ivar frame, other_frame: of the joint in the first and in the second body, (J, 7).
    :ivar low, high: least and greatest displacement, (J,).
    :ivar stiffness: of its spring [N/m, N·m/rad], (J,).
    :ivar damping: [N·s/m, N·m·s/rad], (J,).
    :ivar rest: displacement at which the spring is slack, (J,).
    :ivar speed: of its motor [m/s, rad/s], (J,).
    :ivar drive: greatest force or moment of the motor [N, N·m], (J,).
    :ivar strength: greatest mean force [N] and moment [N·m] over `_SPAN`, (J, 2).
    :ivar collides: whether the two bodies collide, (J,) bool.
    :ivar broken: (J,) bool.
    :ivar way: displacement of the first body against the second, full turns counted, (J,).
    :ivar force: on the first body in the last step, world axes [N], (J, 3).
    :ivar moment: likewise, about the joint's point on the first body [N·m], (J, 3).
    :ivar strain: least inertia of both bodies for stability under the joint's force [kg·m²],
        (J, 2).
    """

    kind: np.ndarray
    first: np.ndarray
    second: np.ndarray
    frame: np.ndarray
    other_frame: np.ndarray
    low: np.ndarray
    high: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    rest: np.ndarray
    speed: np.ndarray
    drive: np.ndarray
    strength: np.ndarray
    collides: np.ndarray
    broken: np.ndarray
    way: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    strain: np.ndarray

    def of(self, rows: np.ndarray | slice) -> 'JointRows':
        """Return some rows of the columns."""
        return JointRows(*(column[rows] for column in self))


def no_joints(count: int) -> JointRows:
    """Allocate columns for joints."""
    numbers = {name: np.zeros(count) for name in JointRows._fields}
    return JointRows(**numbers | {
        **{name: np.zeros(count, np.int64) for name in ('kind', 'first', 'second')},
        **{name: np.zeros((count, 7)) for name in ('frame', 'other_frame')},
        **{name: np.zeros((count, 3)) for name in ('force', 'moment')},
        **{name: np.zeros(count, bool) for name in ('collides', 'broken')},
        **{name: np.zeros((count, 2)) for name in ('strength', 'strain')}})


class System(NamedTuple):
    """
    Linear system of the joints of a step.

    :ivar begin: row of each joint's first direction, and their number, (J + 1,).
    :ivar ends: bodies of each direction, (R, 2).
    :ivar part: type of each row: `_HOLDS`, `_SPRING`, `_MOTOR` or `_LIMIT`, (R,).
    :ivar lines: (R, `_LINE`).
    :ivar takes_part: whether the row is active: its impulse is within its bounds, (R,) bool.
    :ivar left: first column of each row of the envelope, (R,).
    :ivar offset: its index in `matrix` and `factor`, (R + 1,).
    :ivar matrix: speed along a direction by unit impulses along others, by envelope, (E,).
    :ivar factor: L of its L·D·Lᵀ, (E,); `inverse`, of D, (R,).
    :ivar places: (J, `_PLACE`); `ahead`, likewise at the end of the substep.
    :ivar sums: linear and angular impulse over the step, (J, 6).
    :ivar lately: likewise, over the span of substeps in which strengths are judged, (J, 6).
    """

    begin: np.ndarray
    ends: np.ndarray
    part: np.ndarray
    lines: np.ndarray
    takes_part: np.ndarray
    left: np.ndarray
    offset: np.ndarray
    matrix: np.ndarray
    factor: np.ndarray
    inverse: np.ndarray
    places: np.ndarray
    ahead: np.ndarray
    sums: np.ndarray
    lately: np.ndarray


@kernel
def along_chains(first, second, count):
    """
    Sort joints so that those with common bodies are close together (Cuthill & McKee 1969).

    :param first, second: bodies of each; those from `count` on are immovable, (J,).
    :param count: number of movable bodies.
    :returns: rows, (J,).
    """
    start, own = _joints_of(first, second, count)
    order, seen = np.empty(len(first), np.int64), np.zeros(len(first), np.bool_)
    done = 0
    for j in range(len(first)):
        if seen[j]:
            continue
        # Start from the farthest joint, an end of a chain.
        end = _spread(j, first, second, count, start, own, order, done, seen)
        for k in range(done, end):
            seen[order[k]] = False
        done = _spread(order[end - 1], first, second, count, start, own, order, done, seen)
    return order


@subroutine
def _joints_of(first, second, count):
    """List the joints of each body; return their starts and the list."""
    start = np.zeros(count + 1, np.int64)
    for j in range(len(first)):
        for body in (first[j], second[j]):
            if body < count:
                start[body + 1] += 1
    for i in range(count):
        start[i + 1] += start[i]
    own, fill = np.empty(start[count], np.int64), start[:-1].copy()
    for j in range(len(first)):
        for body in (first[j], second[j]):
            if body < count:
                own[fill[body]] = j
                fill[body] += 1
    return start, own


@subroutine(**LEAN)
def _spread(origin, first, second, count, start, own, order, done, seen):
    """List the joints connected with a joint, breadth-first; return the end of the list."""
    order[done], seen[origin] = origin, True
    end = done + 1
    while done < end:
        j = order[done]
        done += 1
        for side in range(2):
            body = first[j] if side == 0 else second[j]
            if body < count:
                for k in range(start[body], start[body + 1]):
                    if not seen[own[k]]:
                        order[end], seen[own[k]] = own[k], True
                        end += 1
    return end


@subroutine
def lay_out(joints, count):
    """
    Allocate the system of joints, which are sorted by island.

    :param joints: their bodies are rows of `MovingBodies`.
    :param count: number of bodies that move freely.
    """
    begin = np.zeros(len(joints.kind) + 1, np.int64)
    for t in range(len(joints.kind)):
        begin[t + 1] = begin[t] + _ROWS[joints.kind[t]]
    rows = begin[-1]
    ends, part = np.empty((rows, 2), np.int64), np.zeros(rows, np.int64)
    left, offset = np.empty(rows, np.int64), np.zeros(rows + 1, np.int64)
    lowest = np.full(count, rows)
    for t in range(len(joints.kind)):
        bodies, reach = (joints.first[t], joints.second[t]), begin[t]
        for body in bodies:
            if body < count:
                lowest[body] = min(lowest[body], begin[t])
                reach = min(reach, lowest[body])
        for r in range(begin[t], begin[t + 1]):
            ends[r, 0], ends[r, 1] = bodies
            part[r] = max(r - begin[t] - _FIRM[joints.kind[t]] + 1, 0)
            left[r] = reach
            offset[r + 1] = offset[r] + r - reach + 1
    size, number = offset[-1], len(joints.kind)
    return System(begin, ends, part, np.zeros((rows, _LINE)), np.zeros(rows, np.bool_), left,
                  offset, np.zeros(size), np.zeros(size), np.zeros(rows),
                  np.zeros((number, _PLACE)), np.zeros((number, _PLACE)), np.zeros((number, 6)),
                  np.zeros((number, 6)))


@subroutine(**LEAN)
def work(own, system):
    """Estimate the cost of the joints of an island in a substep, in contacts."""
    total = 0.0
    for r in range(system.begin[own.start], system.begin[own.stop]):
        width = system.offset[r + 1] - system.offset[r]
        total += width * (width + _SOLVES)  # factored twice; solved forwards and back in each pass
    return len(own) + int(total / _PER_CONTACT)


@subroutine(**LEAN)
def aim(own, joints, system, bodies, free, time, state):
    """
    Update the constraint rows of joints to the present poses of their bodies.

    :param own: joints.
    :param free: number of bodies that move freely; kinematic ones have moved for `time` [s].
    """
    for t in own:
        _place(t, joints, system.places, bodies, free, time, state)
        _steady(joints.first[t], three(system.places, t, _ARM), joints.strain[t, 0], state)
        _steady(joints.second[t], three(system.places, t, _OTHER_ARM), joints.strain[t, 1], state)
    for t in own:
        if joints.kind[t] in (_HINGE, _SLIDER, _ROPE):
            joints.way[t] = _way(joints.kind[t], joints.way[t], system.places, t)
        for r in range(system.begin[t], system.begin[t + 1]):
            _direct(r, r - system.begin[t], joints.kind[t], system.places, t, system, state)
            if system.part[r] == _LIMIT and not joints.broken[t]:
                _bound(r, joints.way[t], joints.low[t], joints.high[t], system.lines)
    for t in own:
        for r in range(system.begin[t], system.begin[t + 1]):
            for c in range(system.left[r], r + 1):
                system.matrix[system.offset[r] + c - system.left[r]] = _coupling(r, c, system)


@subroutine(**LEAN)
def _place(t, joints, places, bodies, free, time, state):
    """Write the world frames of a joint."""
    way = (0.0, 0.0, 0.0)
    for side in range(2):
        i = joints.first[t] if side == 0 else joints.second[t]
        frame = joints.frame[t] if side == 0 else joints.other_frame[t]
        q = (bodies.pose[i, 3], bodies.pose[i, 4], bodies.pose[i, 5], bodies.pose[i, 6])
        centre = three(bodies.pose, i, 0)
        if i >= free:
            q = rotated(q, three(state, i, SPIN), time)
            centre = plus(centre, 1.0, three(state, i, WAY))
        x, y, z = matrix_rows(q)
        arm = (frame[0], frame[1], frame[2])
        arm = (dot(x, arm), dot(y, arm), dot(z, arm))
        put(places, t, _ARM + 3 * side, arm)
        way = plus(way, 1.0 - 2.0 * side, centre)
        u, v, w = matrix_rows((frame[3], frame[4], frame[5], frame[6]))
        for k in range(3):
            axis = (u[k], v[k], w[k])
            put(places, t, _AXES + 9 * side + 3 * k, (dot(x, axis), dot(y, axis), dot(z, axis)))
    way = plus(way, 1.0, less(three(places, t, _ARM), three(places, t, _OTHER_ARM)))
    put(places, t, _WAY, way)


@subroutine(**LEAN)
def _steady(i, arm, strain, state):
    """
    Raise the inertia of a body that would oscillate within a substep under the pull of a joint.

    The rotating arm of the force acts as a spring, geometric stiffness that the substep does not
    resolve (Tournier et al. 2015, "Stable constrained dynamics", ACM Trans. Graph. 34).
    """
    far = dot(arm, arm)
    if strain == 0.0 or far == 0.0:
        return
    own = dot(arm, eased(state, i, arm)) / far
    ease = strain * (state[i, EASE] + state[i, EASE + 3] + state[i, EASE + 5] - own)
    if ease > 1.0:
        for k in range(6):
            state[i, EASE + k] /= ease


@subroutine(**LEAN)
def _axis(places, t, side, k):
    return three(places, t, _AXES + 9 * side + 3 * k)


@subroutine(**LEAN)
def _across(places, t, k):
    """Return the vector that a hinge's axis is normal to without rotation about axis k."""
    return cross(_axis(places, t, 1, k), _axis(places, t, 1, 0))


@subroutine(**LEAN)
def _way(kind, before, places, t):
    """Compute the displacement of a joint along or about its axis; hinges count full turns."""
    if kind == _ROPE:
        return length(three(places, t, _WAY))
    if kind == _SLIDER:
        return dot(_axis(places, t, 1, 0), three(places, t, _WAY))
    y = _axis(places, t, 0, 1)
    angle = atan2(dot(y, _axis(places, t, 1, 2)), dot(y, _axis(places, t, 1, 1)))
    return angle + 2.0 * math.pi * math.floor((before - angle) / (2.0 * math.pi) + 0.5)


@subroutine(**LEAN)
def _role(kind, k):
    """
    Return type and axis of a direction of a joint.

    :returns: whether it is angular, and its axis: 0 to 2; 3 = the axis of the joint.
    """
    if k >= _FIRM[kind]:
        return kind == _HINGE, 3
    if kind == _SLIDER:
        return k >= 2, k + 1 if k < 2 else k - 2
    return k >= 3, k - 2 if kind == _HINGE and k >= 3 else k % 3


@subroutine(**LEAN)
def _direct(r, k, kind, places, t, system, state):
    """Write a direction of a joint, and the velocity changes by unit impulses along it."""
    turns, number = _role(kind, k)
    lines, nothing = system.lines, (0.0, 0.0, 0.0)
    unit = (1.0 if number == 0 else 0.0, 1.0 if number == 1 else 0.0, 1.0 if number == 2 else 0.0)
    if turns:
        if kind == _HINGE:
            unit = _axis(places, t, 1, 0)
            if number < 3:
                unit = cross(_axis(places, t, 0, 0), _across(places, t, number))
        along, about, other = nothing, unit, unit
    else:
        if kind == _SLIDER:
            unit = _axis(places, t, 1, number % 3)
        elif kind == _ROPE:
            way = three(places, t, _WAY)
            far = length(way)
            unit = scaled(1.0 / far, way) if far > 0.0 else _axis(places, t, 1, 0)
        along, arm = unit, three(places, t, _ARM)
        about = cross(arm, unit)
        # From the second body to the point on the first, so that both get the same moment.
        arm = plus(three(places, t, _OTHER_ARM), 1.0, three(places, t, _WAY))
        other = cross(arm, unit)
    put(lines, r, _ALONG, along)
    put(lines, r, _ABOUT, about)
    put(lines, r, _OTHER_ABOUT, other)
    for side in range(2):
        i = system.ends[r, side]
        put(lines, r, _PULL + 6 * side, lightened(state, i, along))
        put(lines, r, _TURN + 6 * side, eased(state, i, three(lines, r, _ABOUT + 3 * side)))
    lines[r, _GAP] = _gap(k, kind, places, t)


@subroutine(**LEAN)
def _gap(k, kind, places, t):
    """Compute the constraint error along a direction [m, rad]."""
    turns, number = _role(kind, k)
    if number == 3:
        return 0.0 if turns else _way(kind, 0.0, places, t)
    if not turns:
        way = three(places, t, _WAY)
        return dot(_axis(places, t, 1, number), way) if kind == _SLIDER else way[number]
    if kind == _HINGE:
        return dot(_axis(places, t, 0, 0), _across(places, t, number))
    total = (0.0, 0.0, 0.0)
    for axis in range(3):
        total = plus(total, 0.5, cross(_axis(places, t, 1, axis), _axis(places, t, 0, axis)))
    return total[number]


@subroutine(**LEAN)
def _bound(r, way, low, high, lines):
    """Write the distance of a joint from its nearer limit, and the bounds of its impulse."""
    lower = way - low < high - way
    lines[r, _GAP] = way - low if lower else way - high
    lines[r, _LOW], lines[r, _HIGH] = (0.0, math.inf) if lower else (-math.inf, 0.0)
    if low == high:
        lines[r, _LOW], lines[r, _HIGH] = -math.inf, math.inf
    if math.isinf(lines[r, _GAP]):
        lines[r, _HIGH] = lines[r, _LOW] = 0.0


@subroutine(**LEAN)
def _coupling(r, c, system):
    """Compute the speed along a direction by a unit impulse along another one."""
    lines, ends, total = system.lines, system.ends, 0.0
    along = three(lines, r, _ALONG)
    for side in range(2):
        about = three(lines, r, _ABOUT + 3 * side)
        for other in range(2):
            if ends[r, side] == ends[c, other]:
                speed = (dot(along, three(lines, c, _PULL + 6 * other))
                         + dot(about, three(lines, c, _TURN + 6 * other)))
                total += speed if side == other else -speed
    return total


@subroutine(**LEAN)
def span(own, substep, substeps, time_step, system):
    """
    Return the time over which forces are judged in a substep [s]; begin its sums with its first.

    It does not depend on the step, nor on how often contacts are looked for in it.
    """
    spans = max(int(math.ceil(time_step / _SPAN - 1e-6)), 1)
    now = substep * spans // substeps
    start, end = -(-now * substeps // spans), -(-(now + 1) * substeps // spans)
    if substep == start:
        for t in own:
            for w in range(6):
                system.lately[t, w] = 0.0
    return (end - start) * time_step / substeps


@subroutine(**LEAN)
def begin(own, joints, system, h, state):
    """Begin a substep: set bias velocities and impulse bounds of the rows of joints."""
    lines = system.lines
    for t in own:
        _foresee(t, joints.first[t], joints.second[t], system, h, state)
        for r in range(system.begin[t], system.begin[t + 1]):
            part, k = system.part[r], r - system.begin[t]
            lines[r, _IMPULSE] = lines[r, _SOFT] = lines[r, _AIM] = 0.0
            system.takes_part[r] = part != _LIMIT or joints.low[t] == joints.high[t]
            if part == _SPRING:
                _relax(r, joints.way[t] - joints.rest[t], joints.stiffness[t], joints.damping[t],
                       h, system)
            elif part == _MOTOR:
                lines[r, _AIM] = -joints.speed[t]
                lines[r, _HIGH] = h * joints.drive[t]
                lines[r, _LOW] = -lines[r, _HIGH]
                system.takes_part[r] = joints.drive[t] > 0.0
            elif part == _HOLDS or joints.kind[t] != _HINGE:
                now = lines[r, _GAP] if part == _HOLDS else joints.way[t]
                there = _gap(k, joints.kind[t], system.ahead, t)
                lines[r, _AIM] = (there - now) / h - _speed(r, system, state)
            if part == _HOLDS:
                lines[r, _LOW], lines[r, _HIGH] = -math.inf, math.inf
            if joints.broken[t]:
                system.takes_part[r] = False
                lines[r, _LOW] = lines[r, _HIGH] = 0.0


@subroutine(**LEAN)
def _foresee(t, first, second, system, h, state):
    """Write the frames of a joint at the end of the substep, predicted by velocities."""
    places, ahead = system.places, system.ahead
    way = three(places, t, _WAY)
    for side in range(2):
        i, sign = (first, 1.0) if side == 0 else (second, -1.0)
        turn = scaled(h, three(state, i, SPIN))
        way = plus(way, sign * h, three(state, i, SPEED))
        arm = three(places, t, _ARM + 3 * side)
        way = plus(way, sign, _turn(turn, arm))
        for k in range(3):
            axis = _axis(places, t, side, k)
            put(ahead, t, _AXES + 9 * side + 3 * k, plus(axis, 1.0, _turn(turn, axis)))
    put(ahead, t, _WAY, way)


@subroutine(**LEAN)
def _turn(turn, arm):
    """Compute the displacement of a point by a rotation, to second order, keeping its distance."""
    way = cross(turn, arm)
    way = plus(way, 0.5, cross(turn, way))
    there = plus(arm, 1.0, way)
    far = length(there)
    return less(scaled(length(arm) / far, there), arm) if far > 0.0 else way


@subroutine(**LEAN)
def _relax(r, stretch, stiffness, damping, h, system):
    """
    Set the row of a spring: a share of its force is implicit, at the end of the substep.

    The share grows with stiffness · h² / mass: soft springs oscillate without loss, and stiff
    ones are stable. The loss is of second order in stiffness · h² / mass.
    """
    lines, light = system.lines, system.matrix[system.offset[r + 1] - 1]
    stiff = h * h * stiffness * light
    give = h * (damping + stiff / (1.0 + stiff) * h * stiffness)
    system.takes_part[r] = give > 0.0
    lines[r, _LOW] = lines[r, _HIGH] = 0.0
    if give > 0.0:
        lines[r, _SOFT], lines[r, _AIM] = 1.0 / give, h * stiffness * stretch / give
        lines[r, _LOW], lines[r, _HIGH] = -math.inf, math.inf


@subroutine(**LEAN)
def _speed(r, system, state):
    """Return the speed of the first body relative to the second along a direction."""
    lines, i, j = system.lines, system.ends[r, 0], system.ends[r, 1]
    way = less(three(state, i, SPEED), three(state, j, SPEED))
    return (dot(three(lines, r, _ALONG), way)
            + dot(three(lines, r, _ABOUT), three(state, i, SPIN))
            - dot(three(lines, r, _OTHER_ABOUT), three(state, j, SPIN)))


@subroutine(**LEAN)
def _push(r, impulse, system, state):
    """Apply an impulse along a direction."""
    lines = system.lines
    for side in range(2):
        i, share = system.ends[r, side], impulse if side == 0 else -impulse
        pull, turn = three(lines, r, _PULL + 6 * side), three(lines, r, _TURN + 6 * side)
        put(state, i, SPEED, plus(three(state, i, SPEED), share, pull))
        put(state, i, SPIN, plus(three(state, i, SPIN), share, turn))
    lines[r, _IMPULSE] += impulse


@subroutine(**LEAN)
def solve(own, joints, system, state, h, duration, rate, first):
    """
    Solve the joints of an island; return whether any speed has changed noticeably.

    :param own: joints.
    :param duration: see `span` [s].
    :param rate: correction rate of errors [1/s]; 0 = relaxation after bodies have moved.
    :param first: whether bodies have moved since the last solve.
    """
    lines, left, right = system.lines, system.begin[own.start], system.begin[own.stop]
    stale, changed = first, False
    for turn in range(right - left + len(own) + 1):
        for r in range(left, right):
            lacks = _lacks(r, system, state, h, rate)
            lines[r, _CHANGE] = -lacks
            if turn == 0 and not system.takes_part[r] and _comes_in(r, lacks, lines):
                system.takes_part[r] = stale = True
        if stale:
            _factor(left, right, system)
        _resolve(left, right, system)
        stale = _keep_bounds(left, right, system, state)
        if not stale:
            for t in own:
                stale = _tear(t, joints, system, duration, state) or stale
        changed = changed or stale
        if not stale:
            break
    for r in range(left, right):
        if system.takes_part[r]:
            change = lines[r, _CHANGE]
            _push(r, change, system, state)
            changed = changed or abs(change) * system.matrix[system.offset[r + 1] - 1] > _CALM
    return changed


@subroutine(**LEAN)
def _lacks(r, system, state, h, rate):
    """Compute the velocity error along a direction [m/s, rad/s]."""
    lines, part = system.lines, system.part[r]
    gap, speed = lines[r, _GAP], _speed(r, system, state) + lines[r, _SOFT] * lines[r, _IMPULSE]
    if part in (_SPRING, _MOTOR):
        return speed + lines[r, _AIM]
    free = lines[r, _HIGH] == 0.0 and gap < 0.0 or lines[r, _LOW] == 0.0 and gap > 0.0
    if free:
        return speed + gap / h + (lines[r, _AIM] if rate > 0.0 else 0.0)
    return speed + rate * gap + lines[r, _AIM] if rate > 0.0 else speed


@subroutine(**LEAN)
def _comes_in(r, lacks, lines):
    """Return whether the impulse of a row at one of its bounds should leave it."""
    low, high, impulse = lines[r, _LOW], lines[r, _HIGH], lines[r, _IMPULSE]
    return low < high and (lacks < 0.0 and impulse <= low or lacks > 0.0 and impulse >= high)


@subroutine(**LEAN)
def _factor(left, right, system):
    """Factor the active rows: L·D·Lᵀ, within the envelope."""
    factor, inverse, matrix = system.factor, system.inverse, system.matrix
    for r in range(left, right):
        low, base = system.left[r], system.offset[r] - system.left[r]
        for c in range(low, r):
            value, other = 0.0, system.offset[c] - system.left[c]
            if system.takes_part[r] and system.takes_part[c]:
                value = matrix[base + c]
                for k in range(max(low, system.left[c]), c):
                    value -= factor[base + k] * factor[other + k]
            factor[base + c] = value
        whole = matrix[base + r]
        pivot = whole * (1.0 + _RIDGE) + system.lines[r, _SOFT]
        for c in range(low, r):
            value = factor[base + c]
            factor[base + c] = value * inverse[c]
            pivot -= value * factor[base + c]
        inverse[r] = 1.0 / pivot if system.takes_part[r] and pivot > 0.0 else 0.0


@subroutine(**LEAN)
def _resolve(left, right, system):
    """Solve for the changes of impulses, from velocity errors, in place."""
    lines, factor = system.lines, system.factor
    for r in range(left, right):
        base, total = system.offset[r] - system.left[r], lines[r, _CHANGE]
        if not system.takes_part[r]:
            total = 0.0
        for c in range(system.left[r], r):
            total -= factor[base + c] * lines[c, _CHANGE]
        lines[r, _CHANGE] = total
    for r in range(left, right):
        lines[r, _CHANGE] *= system.inverse[r]
    for r in range(right - 1, left - 1, -1):
        base = system.offset[r] - system.left[r]
        for c in range(system.left[r], r):
            lines[c, _CHANGE] -= factor[base + c] * lines[r, _CHANGE]


@subroutine(**LEAN)
def _keep_bounds(left, right, system, state):
    """Clamp impulses that would leave their bounds; return whether there were any."""
    lines, found = system.lines, False
    for r in range(left, right):
        if system.takes_part[r]:
            impulse = lines[r, _IMPULSE] + lines[r, _CHANGE]
            if not lines[r, _LOW] <= impulse <= lines[r, _HIGH]:
                bound = lines[r, _LOW] if impulse < lines[r, _LOW] else lines[r, _HIGH]
                _push(r, bound - lines[r, _IMPULSE], system, state)
                lines[r, _IMPULSE] = bound
                system.takes_part[r], found = False, True
    return found


@subroutine(**LEAN)
def _tear(t, joints, system, duration, state):
    """Break a joint beyond its strength; its impulse of the span is limited to the strength."""
    if joints.broken[t]:
        return False
    lines, kept = system.lines, 1.0
    for k, now in enumerate(_impulses(t, system)):
        before = three(system.lately, t, 3 * k)
        most = joints.strength[t, k] * duration
        if length(plus(before, 1.0, now)) > most:
            kept = min(kept, max(most - length(before), 0.0) / length(now))
    if kept == 1.0:
        return False
    joints.broken[t] = True
    for r in range(system.begin[t], system.begin[t + 1]):
        change = lines[r, _CHANGE] if system.takes_part[r] else 0.0
        _push(r, kept * (lines[r, _IMPULSE] + change) - lines[r, _IMPULSE], system, state)
        system.takes_part[r], lines[r, _LOW], lines[r, _HIGH] = False, 0.0, 0.0
    return True


@subroutine(**LEAN)
def _impulses(t, system):
    """Compute linear and angular impulse of a joint in a substep, pending changes included."""
    lines, pushed, turned = system.lines, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for r in range(system.begin[t], system.begin[t + 1]):
        along, impulse = three(lines, r, _ALONG), lines[r, _IMPULSE]
        if system.takes_part[r]:
            impulse += lines[r, _CHANGE]
        pushed = plus(pushed, impulse, along)
        if along[0] == 0.0 and along[1] == 0.0 and along[2] == 0.0:
            turned = plus(turned, impulse, three(lines, r, _ABOUT))
    return pushed, turned


@subroutine(**LEAN)
def add_up(own, joints, system, h):
    """Add the impulses of a substep to the sums of step and span."""
    for t in own:
        for r in range(system.begin[t], system.begin[t + 1]):
            system.lines[r, _CHANGE] = 0.0
        pushed, turned = _impulses(t, system)
        for sums in (system.sums, system.lately):
            put(sums, t, 0, plus(three(sums, t, 0), 1.0, pushed))
            put(sums, t, 3, plus(three(sums, t, 3), 1.0, turned))
        for side in range(2):
            arm = three(system.places, t, _ARM + 3 * side)
            joints.strain[t, side] = h * length(pushed) * length(arm)


@subroutine(**LEAN)
def tell(joints, system, time_step):
    """Write the mean forces and moments of a step."""
    for t in range(len(joints.kind)):
        put(joints.force, t, 0, scaled(1.0 / time_step, three(system.sums, t, 0)))
        put(joints.moment, t, 0, scaled(1.0 / time_step, three(system.sums, t, 3)))
