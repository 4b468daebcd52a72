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
Solver: impulses at contacts, island by island, in substeps.

Each substep applies gravity, starts from the impulses of the one before, solves with soft
contacts, which take overlaps back, moves, and solves again without, so that nothing of that stays
as speed (Catto 2024, "Solver2D": soft step with relaxation; Macklin et al. 2019, "Small steps in
physics simulation"). Friction is a cone.
"""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.rigid.vectors import at, cross, dot, length, less, plus, scaled, tangent
from procphys_ros.rotation_kernels import matrix_rows

_DAMPING = 10.0  # ratio of soft contacts: overdamped, so that nothing is thrown (box2d's value)
_PUSH = 3.0  # [m/s] at most at which overlaps are taken back (box2d's value)
_BOUNCE = 0.05  # [m/s] of approach below which nothing bounces: 0.1 mm of height
_WORK = 200_000  # contacts solved per island and step: what a stack needs, a heap cannot have
_FINEST, _COARSEST = 32, 8  # substeps of an island; 8 at 60 Hz leave 0.5 mm of overlap in a heap
_PASSES = 16  # at most: one that lands flat on many corners needs them, what rests takes one
_CALM = 1e-4  # [m/s] of change by a pass, at which it is the last
_RIGID = (0.0, 1.0, 0.0)  # see `_softness`
_TURN = 0.1  # [rad] in a substep at most, so that spins keep their energy


class MovingBodies(NamedTuple):
    """
    Columns of what moves: first bodies that move freely, then kinematic ones.

    :ivar mass: [kg]; inf = kinematic, (N,).
    :ivar inertia: principal moments [kg·m²], (N, 3).
    :ivar pose: (N, 7).
    :ivar velocity: world axes, (N, 6).
    """

    mass: np.ndarray
    inertia: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray


class Rows(NamedTuple):
    """
    What the passes need of contacts: along the normal and two tangents.

    :ivar axis: for each of the three the direction, the moments of a unit impulse along it about
        both centres, and the spins that these give, (C, 3, 15).
    :ivar mass: that the contact feels [kg], (C, 3).
    :ivar impulse: along the three, of the present substep [N·s], (C, 3).
    :ivar approach: speed along the normal before the substep [m/s], (C,).
    :ivar gap: as the bodies have moved so far [m], (C,).
    :ivar place: of the point from the first and from the second body's centre [m]: for each what
        turns with the body, and what does not, (C, 12).
    :ivar spot: where it acts at present, from the first body's centre [m], (C, 3).
    """

    axis: np.ndarray
    mass: np.ndarray
    impulse: np.ndarray
    approach: np.ndarray
    gap: np.ndarray
    place: np.ndarray
    spot: np.ndarray


@kernel
def solve(bodies, first, second, point, normal, gap, radius, friction, restitution, force, groups,
          gravity, time_step):
    """
    Move bodies by a step under gravity and contacts; writes poses, velocities and forces.

    :param bodies: the last row stands for all that is immovable.
    :param first, second: rows of bodies, (C,).
    :param point, normal, gap, radius: as in `ContactRows`.
    :param friction, restitution: of each contact, (C,).
    :param force: of the step before, along the normal and across it, (C, 4); becomes that at the
        end of this one.
    :param groups: from `islands`: bodies in turn, where those of each island begin, and where
        contacts do, which are sorted so.
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :returns: impulses on the first bodies over the step, world, and along the normal [N·s], and
        where they acted in the mean, seen from the first body's centre [m], (C, 7).
    """
    members, member_start, start = groups
    count = len(first)
    total, moved = np.zeros((count, 7)), np.zeros((len(bodies.mass), 6))
    rows = Rows(np.empty((count, 3, 15)), np.empty((count, 3)), np.empty((count, 3)),
                np.empty(count), gap.copy(), np.empty((count, 12)), np.empty((count, 3)))
    light = 1.0 / bodies.mass
    for g in range(len(start) - 1):
        own = members[member_start[g]:member_start[g + 1]]
        contacts = range(start[g], start[g + 1])
        for c in contacts:
            _place(c, bodies, first[c], second[c], at(point, c), at(normal, c), radius, rows)
            _aim(c, bodies, first[c], second[c], moved, at(normal, c), time_step, rows)
        _solve_island(own, contacts, len(members), bodies, first, second, normal, gap, friction,
                      restitution, force, gravity, time_step, light, moved, rows, total)
    for c in range(count):
        for w in range(4, 7):
            total[c, w] = total[c, w] / total[c, 3] if total[c, 3] > 0.0 else rows.spot[c, w - 4]
    return total


@subroutine
def _solve_island(own, contacts, free, bodies, first, second, normal, gap, friction, restitution,
                  force, gravity, time_step, light, moved, rows, total):
    """Move the bodies of an island by a step; `total` gets the impulses."""
    substeps, passes = _pace(own, len(contacts), bodies, time_step)
    h = time_step / substeps
    velocity = bodies.velocity
    for c in contacts:
        _start(c, force[c], h, rows)
    for substep in range(substeps):
        if substeps == _FINEST and substep > 0:
            for c in contacts:
                _aim(c, bodies, first[c], second[c], moved, at(normal, c), h, rows)
        for i in own:
            for w in range(3):
                velocity[i, w] += gravity[w] * h
        _begin(contacts, first, second, velocity, light, rows)
        _passes(passes, contacts, first, second, velocity, light, rows, friction, h, _softness(h))
        for i in own:
            _advance(i, bodies, gravity, h, len(contacts) == 0, moved)
        _carry(free, bodies, (substep + 1) * h, moved)
        _measure(contacts, first, second, moved, gap, rows)
        _passes(2 * passes, contacts, first, second, velocity, light, rows, friction, h, _RIGID)
        _bounce(contacts, first, second, velocity, light, rows, restitution)
        _add_up(contacts, rows, total)
    _keep_forces(contacts, rows, h, force)


@subroutine
def _pace(own, contacts, bodies, time_step):
    """Choose substeps of an island, and passes at most; twice as many relax."""
    if contacts == 0:
        spin = 0.0
        for i in own:
            spin = max(spin, length((bodies.velocity[i, 3], bodies.velocity[i, 4],
                                     bodies.velocity[i, 5])))
        return min(int(spin * time_step / _TURN) + 1, _FINEST), 0
    substeps = _FINEST
    while substeps > _COARSEST and contacts * substeps * 3 * (substeps // 8) > _WORK:
        substeps //= 2
    return substeps, min(max(_WORK // (3 * contacts * substeps), 1), _PASSES)


@subroutine
def _carry(count, bodies, time, moved):
    """Write how far kinematic bodies have come."""
    for i in range(count, len(moved)):
        for w in range(6):
            moved[i, w] = time * bodies.velocity[i, w]


@subroutine
def _turned(bodies, i, v):
    """Multiply the inverse of a body's inertia in the world with a vector."""
    x, y, z = matrix_rows(bodies.pose[i, 3:])
    a = (x[0] * v[0] + y[0] * v[1] + z[0] * v[2]) / bodies.inertia[i, 0]
    b = (x[1] * v[0] + y[1] * v[1] + z[1] * v[2]) / bodies.inertia[i, 1]
    c = (x[2] * v[0] + y[2] * v[1] + z[2] * v[2]) / bodies.inertia[i, 2]
    return (x[0] * a + x[1] * b + x[2] * c, y[0] * a + y[1] * b + y[2] * c,
            z[0] * a + z[1] * b + z[2] * c)


@subroutine
def _place(c, bodies, first, second, point, n, radius, rows):
    """Write where a contact is, seen from the centres of both bodies; balls roll under it."""
    for side in range(2):
        i, sign = (first, -1.0) if side == 0 else (second, 1.0)
        rolls = scaled(sign * radius[c, side], n)
        turns = less(less(point, at(bodies.pose, i)), rolls)
        for w in range(3):
            rows.place[c, 6 * side + w], rows.place[c, 6 * side + 3 + w] = turns[w], rolls[w]


@subroutine
def _aim(c, bodies, first, second, moved, n, duration, rows):
    """
    Write directions of a contact, arms, and what impulses give.

    Arms are those of the middle of a time to come: a block that rocks would lose energy with those
    of its beginning.
    """
    t = tangent(n)
    axes = (n, t, cross(n, t))
    for k in range(3):
        rows.mass[c, k] = 0.0
    for side in range(2):
        i, sign = (first, 1.0) if side == 0 else (second, -1.0)
        place = (rows.place[c, 6 * side], rows.place[c, 6 * side + 1],
                 rows.place[c, 6 * side + 2])
        place = plus(place, 1.0, _bent(place, moved, i))
        place = _turned_on(place, bodies.velocity, i, 0.5 * duration)
        place = plus(place, 1.0, (rows.place[c, 6 * side + 3], rows.place[c, 6 * side + 4],
                                  rows.place[c, 6 * side + 5]))
        if side == 0:
            rows.spot[c, 0], rows.spot[c, 1], rows.spot[c, 2] = place
        for k in range(3):
            d = axes[k]
            arm = scaled(sign, cross(place, d))
            spin = _turned(bodies, i, arm)
            for w in range(3):
                rows.axis[c, k, w] = d[w]
                rows.axis[c, k, 3 + 3 * side + w] = arm[w]
                rows.axis[c, k, 9 + 3 * side + w] = spin[w]
            rows.mass[c, k] += 1.0 / bodies.mass[i] + dot(arm, spin)
    for k in range(3):
        rows.mass[c, k] = 1.0 / rows.mass[c, k]


@subroutine
def _start(c, force, h, rows):
    """Write the impulses that the first substep starts from."""
    pressed = (force[1], force[2], force[3])
    rows.impulse[c, 0] = h * force[0]
    for k in range(1, 3):
        d = _part(rows.axis, c, k, 0)
        rows.impulse[c, k] = h * dot(pressed, d)


@subroutine
def _bent(place, moved, i):
    """Give how far a point turns about a body's centre, right to the second power."""
    turn = (moved[i, 3], moved[i, 4], moved[i, 5])
    way = cross(turn, place)
    return plus(way, 0.5, cross(turn, way))


@subroutine
def _turned_on(place, velocity, i, duration):
    """Turn a place about a body's centre by its spin, for a while; it stays as far away."""
    far = length(place)
    if far < 1e-9:
        return place
    way = cross((velocity[i, 3], velocity[i, 4], velocity[i, 5]), place)
    turned = plus(place, duration, way)
    return scaled(far / length(turned), turned)


@subroutine
def _part(axis, c, k, first):
    """Read three numbers of an axis."""
    return axis[c, k, first], axis[c, k, first + 1], axis[c, k, first + 2]


@subroutine
def _motion(velocity, i):
    """Read velocity and spin of a body."""
    return ((velocity[i, 0], velocity[i, 1], velocity[i, 2]),
            (velocity[i, 3], velocity[i, 4], velocity[i, 5]))


@subroutine
def _write_motion(velocity, i, motion):
    for w in range(3):
        velocity[i, w], velocity[i, 3 + w] = motion[0][w], motion[1][w]


@subroutine
def _speed(axis, c, k, one, two):
    """Give the speed along an axis of the first body's point against the second's."""
    return (dot(_part(axis, c, k, 0), less(one[0], two[0])) + dot(_part(axis, c, k, 3), one[1])
            + dot(_part(axis, c, k, 6), two[1]))


@subroutine
def _pushed(axis, c, k, size, light, one, two):
    """Give both motions after an impulse along an axis."""
    d = _part(axis, c, k, 0)
    return ((plus(one[0], size * light[0], d), plus(one[1], size, _part(axis, c, k, 9))),
            (plus(two[0], -size * light[1], d), plus(two[1], size, _part(axis, c, k, 12))))


@subroutine
def _begin(contacts, first, second, velocity, light, rows):
    """Note how fast bodies approach, and start from the impulses before."""
    for c in contacts:
        one, two = _motion(velocity, first[c]), _motion(velocity, second[c])
        rows.approach[c] = _speed(rows.axis, c, 0, one, two)
    for c in contacts:
        a, b = first[c], second[c]
        one, two = _motion(velocity, a), _motion(velocity, b)
        for k in range(3):
            one, two = _pushed(rows.axis, c, k, rows.impulse[c, k], (light[a], light[b]), one,
                               two)
        _write_motion(velocity, a, one)
        _write_motion(velocity, b, two)


@subroutine
def _measure(contacts, first, second, moved, gap, rows):
    """Work out the gaps after bodies have moved, right to the second power of what they turned."""
    for c in contacts:
        n = _part(rows.axis, c, 0, 0)
        rows.gap[c] = (gap[c] + _shift(rows.place[c, :3], moved, first[c], n)
                       - _shift(rows.place[c, 6:9], moved, second[c], n))


@subroutine
def _shift(place, moved, i, n):
    """Give how far a point of a body has moved along a direction."""
    return dot(n, plus(at(moved, i), 1.0, _bent(place, moved, i)))


@subroutine
def _bounce(contacts, first, second, velocity, light, rows, restitution):
    """Throw back what has struck."""
    for c in contacts:
        before = rows.impulse[c, 0]
        if restitution[c] == 0.0 or before == 0.0 or rows.approach[c] > -_BOUNCE:
            continue
        a, b = first[c], second[c]
        one, two = _motion(velocity, a), _motion(velocity, b)
        lacks = _speed(rows.axis, c, 0, one, two) + restitution[c] * rows.approach[c]
        rows.impulse[c, 0] = max(before - rows.mass[c, 0] * lacks, 0.0)
        one, two = _pushed(rows.axis, c, 0, rows.impulse[c, 0] - before, (light[a], light[b]),
                           one, two)
        _write_motion(velocity, a, one)
        _write_motion(velocity, b, two)


@subroutine
def _softness(h):
    """Give rate of overlaps taken back [1/s], share of mass and of impulse (Catto 2011)."""
    omega = math.pi / h  # the highest frequency that the substep resolves
    a = 2.0 * _DAMPING + h * omega
    b = h * omega * a
    return omega / a, b / (1.0 + b), 1.0 / (1.0 + b)


@subroutine
def _passes(most, contacts, first, second, velocity, light, rows, friction, h, soft):
    """Solve an island until nothing changes any more, or as often as it may be."""
    for _ in range(most):
        if _pass(contacts, first, second, velocity, light, rows, friction, h, soft) < _CALM:
            break


@subroutine
def _pass(contacts, first, second, velocity, light, rows, friction, h, soft):
    """Solve all contacts of an island once, in turn; give the largest change of speed [m/s]."""
    most_changed = 0.0
    rate, mass_share, impulse_share = soft
    axis, mass, impulse = rows.axis, rows.mass, rows.impulse
    for c in contacts:
        now, before = rows.gap[c], impulse[c, 0]
        if rate == 0.0 and now > 0.0 and before == 0.0:
            continue  # what has not struck yet is stopped in the substep in which it does
        a, b = first[c], second[c]
        one, two, lights = _motion(velocity, a), _motion(velocity, b), (light[a], light[b])
        bias, share, kept = 0.0, 1.0, 0.0
        if now > 0.0:
            bias = now / h
        elif rate > 0.0:
            bias, share, kept = max(rate * now, -_PUSH), mass_share, impulse_share
        lacks = _speed(axis, c, 0, one, two) + bias
        pressed = max(before - mass[c, 0] * share * lacks - kept * before, 0.0)
        if pressed == 0.0 and before == 0.0:
            continue
        one, two = _pushed(axis, c, 0, pressed - before, lights, one, two)
        u = impulse[c, 1] - mass[c, 1] * _speed(axis, c, 1, one, two)
        v = impulse[c, 2] - mass[c, 2] * _speed(axis, c, 2, one, two)
        grip, most = math.sqrt(u * u + v * v), friction[c] * pressed
        if grip > most:
            u, v = u * most / grip, v * most / grip
        one, two = _pushed(axis, c, 1, u - impulse[c, 1], lights, one, two)
        one, two = _pushed(axis, c, 2, v - impulse[c, 2], lights, one, two)
        most_changed = max(most_changed, abs(pressed - before) / mass[c, 0],
                           abs(u - impulse[c, 1]) / mass[c, 1],
                           abs(v - impulse[c, 2]) / mass[c, 2])
        impulse[c, 0], impulse[c, 1], impulse[c, 2] = pressed, u, v
        _write_motion(velocity, a, one)
        _write_motion(velocity, b, two)
    return most_changed


@subroutine
def _advance(i, bodies, gravity, h, flies, moved):
    """
    Move a body, and turn it so that its angular momentum stays.

    The spin of the middle of the substep turns it; what touches nothing keeps to its parabola.
    """
    for w in range(3):
        way = h * bodies.velocity[i, w] - (0.5 * h * h * gravity[w] if flies else 0.0)
        bodies.pose[i, w] += way
        moved[i, w] += way
    spin = at(bodies.velocity[:, 3:], i)
    if spin[0] == 0.0 and spin[1] == 0.0 and spin[2] == 0.0:
        return
    momentum = _momentum(bodies, i, spin)
    q = (bodies.pose[i, 3], bodies.pose[i, 4], bodies.pose[i, 5], bodies.pose[i, 6])
    _rotate(bodies, i, q, spin, 0.5 * h)
    spin = _turned(bodies, i, momentum)
    _rotate(bodies, i, q, spin, h)
    after = _turned(bodies, i, momentum)
    for w in range(3):
        moved[i, 3 + w] += h * spin[w]
        bodies.velocity[i, 3 + w] = after[w]


@subroutine
def _momentum(bodies, i, spin):
    """Give the angular momentum of a body about its centre, world axes."""
    x, y, z = matrix_rows(bodies.pose[i, 3:])
    a = (x[0] * spin[0] + y[0] * spin[1] + z[0] * spin[2]) * bodies.inertia[i, 0]
    b = (x[1] * spin[0] + y[1] * spin[1] + z[1] * spin[2]) * bodies.inertia[i, 1]
    c = (x[2] * spin[0] + y[2] * spin[1] + z[2] * spin[2]) * bodies.inertia[i, 2]
    return (x[0] * a + x[1] * b + x[2] * c, y[0] * a + y[1] * b + y[2] * c,
            z[0] * a + z[1] * b + z[2] * c)


@subroutine
def _rotate(bodies, i, q, spin, duration):
    """Write an attitude turned by a spin for a while; the tangent is right to its third power."""
    x, y, z = 0.5 * duration * spin[0], 0.5 * duration * spin[1], 0.5 * duration * spin[2]
    wider = 1.0 + (x * x + y * y + z * z) / 3.0
    x, y, z = wider * x, wider * y, wider * z
    a = q[0] + x * q[3] + y * q[2] - z * q[1]
    b = q[1] + y * q[3] + z * q[0] - x * q[2]
    c = q[2] + z * q[3] + x * q[1] - y * q[0]
    d = q[3] - x * q[0] - y * q[1] - z * q[2]
    size = 1.0 / math.sqrt(a * a + b * b + c * c + d * d)
    bodies.pose[i, 3], bodies.pose[i, 4] = a * size, b * size
    bodies.pose[i, 5], bodies.pose[i, 6] = c * size, d * size


@subroutine
def _add_up(contacts, rows, total):
    """Add the impulses of a substep, world axes, and along the normal."""
    for c in contacts:
        for k in range(3):
            for w in range(3):
                total[c, w] += rows.impulse[c, k] * rows.axis[c, k, w]
        total[c, 3] += rows.impulse[c, 0]
        for w in range(3):
            total[c, 4 + w] += rows.impulse[c, 0] * rows.spot[c, w]


@subroutine
def _keep_forces(contacts, rows, h, force):
    """Write what the next step starts from."""
    for c in contacts:
        force[c, 0] = rows.impulse[c, 0] / h
        for w in range(3):
            force[c, 1 + w] = (rows.impulse[c, 1] * rows.axis[c, 1, w]
                               + rows.impulse[c, 2] * rows.axis[c, 2, w]) / h
