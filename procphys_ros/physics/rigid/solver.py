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

Each substep applies gravity, starts from the impulses of the one before, solves with soft contacts,
which take overlaps back, moves, and solves again without, so that nothing of that stays as speed
(Catto 2024, "Solver2D": soft step with relaxation; Macklin et al. 2019, "Small steps in physics
simulation"). Friction is a cone.
"""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.rigid.vectors import at, cross, dot, tangent
from procphys_ros.rotation_kernels import matrix_rows

_DAMPING = 10.0  # ratio of soft contacts: overdamped, so that nothing is thrown (box2d's value)
_PUSH = 3.0  # [m/s] at most at which overlaps are taken back (box2d's value)
_BOUNCE = 0.05  # [m/s] of approach below which nothing bounces: 0.1 mm of height
_WORK = 100_000  # contacts solved per island and step: what a stiff stack needs, a heap cannot have
_FINEST, _COARSEST = 32, 8  # substeps of an island; 8 at 60 Hz leave 0.2 mm of overlap in a heap
_TURN = 0.1  # [rad] in a substep at most, so that spins keep their energy
_ROW = 48  # numbers per contact, see `_prepare`


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


@kernel
def solve(bodies, first, second, point, normal, gap, friction, restitution, force, groups,
          gravity, time_step):
    """
    Move bodies by a step under gravity and contacts; writes poses, velocities and forces.

    :param first, second: rows of bodies; -1 = what stands still, (C,).
    :param point, normal, gap: as in `ContactRows`.
    :param friction, restitution: of each contact, (C,).
    :param force: of the step before, along the normal and across it, (C, 4); becomes that at the
        end of this one.
    :param groups: from `islands`.
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :returns: impulses on the first bodies over the step, world, and along the normal, (C, 4).
    """
    members, member_start, rows, start = groups
    total = np.zeros((len(first), 4))
    moved = np.zeros((len(bodies.mass), 6))
    work = np.empty((len(first), _ROW))
    impulse = np.zeros((len(first), 4))  # along the normal, along two tangents, approach
    for g in range(len(start) - 1):
        own, contacts = members[member_start[g]:member_start[g + 1]], rows[start[g]:start[g + 1]]
        substeps, relaxing = _pace(own, len(contacts), bodies, time_step)
        h = time_step / substeps
        for c in contacts:
            _prepare(c, bodies, first, second, point, normal, force, h, work, impulse)
        for substep in range(substeps):
            _carry(len(members), bodies, substep * h, moved)
            _substep(own, contacts, bodies, first, second, gap, friction, restitution, gravity, h,
                     relaxing, moved, work, impulse)
            _add_up(contacts, work, impulse, total)
        _keep_forces(contacts, work, impulse, h, force)
    return total


@subroutine
def _pace(own, contacts, bodies, time_step):
    """Choose substeps and relaxing passes of an island."""
    if contacts == 0:
        spin = 0.0
        for i in own:
            spin = max(spin, math.sqrt(dot(at(bodies.velocity[:, 3:], i),
                                           at(bodies.velocity[:, 3:], i))))
        return min(int(spin * time_step / _TURN) + 1, _FINEST), 0
    substeps = _FINEST
    while substeps > _COARSEST and contacts * substeps * (1 + substeps // 4) > _WORK:
        substeps //= 2
    return substeps, max(substeps // 4, 1)


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
def _prepare(c, bodies, first, second, point, normal, force, h, work, impulse):
    """
    Write what a contact needs in every pass.

    Three directions, for each body their moments about its centre and the spins these give, and
    the masses that the contact feels along them.
    """
    n = at(normal, c)
    t = tangent(n)
    axes = (n, t, cross(n, t))
    pressed = (force[c, 1], force[c, 2], force[c, 3])
    impulse[c, 0] = force[c, 0] * h
    for k in range(3):
        d = axes[k]
        yields = 0.0
        for side in range(2):
            i = first[c] if side == 0 else second[c]
            base = 9 + 9 * side + 3 * k
            if i < 0:
                continue
            arm = cross((point[c, 0] - bodies.pose[i, 0], point[c, 1] - bodies.pose[i, 1],
                         point[c, 2] - bodies.pose[i, 2]), d)
            spin = _turned(bodies, i, arm)
            for w in range(3):
                work[c, base + w], work[c, base + 18 + w] = arm[w], spin[w]
            yields += 1.0 / bodies.mass[i] + dot(arm, spin)
        for w in range(3):
            work[c, 3 * k + w] = d[w]
        work[c, 45 + k] = 1.0 / yields
        if k > 0:
            impulse[c, k] = dot(pressed, d) * h


@subroutine
def _speed(c, k, i, side, velocity, work):
    """Give the speed of a body's point along a direction of a contact."""
    d, a = 3 * k, 9 + 9 * side + 3 * k
    return (work[c, d] * velocity[i, 0] + work[c, d + 1] * velocity[i, 1]
            + work[c, d + 2] * velocity[i, 2] + work[c, a] * velocity[i, 3]
            + work[c, a + 1] * velocity[i, 4] + work[c, a + 2] * velocity[i, 5])


@subroutine
def _between(c, k, a, b, velocity, work):
    """Give the speed of the first body's point against the second's."""
    speed = 0.0
    if a >= 0:
        speed += _speed(c, k, a, 0, velocity, work)
    if b >= 0:
        speed -= _speed(c, k, b, 1, velocity, work)
    return speed


@subroutine
def _push(c, k, i, side, size, bodies, work):
    """Give a body an impulse along a direction of a contact."""
    d, s = 3 * k, 27 + 9 * side + 3 * k
    share = size / bodies.mass[i]
    for w in range(3):
        bodies.velocity[i, w] += share * work[c, d + w]
        bodies.velocity[i, 3 + w] += size * work[c, s + w]


@subroutine
def _push_both(c, k, a, b, size, bodies, work):
    if a >= 0:
        _push(c, k, a, 0, size, bodies, work)
    if b >= 0:
        _push(c, k, b, 1, -size, bodies, work)


@subroutine
def _substep(own, contacts, bodies, first, second, gap, friction, restitution, gravity, h, relaxing,
             moved, work, impulse):
    for i in own:
        for w in range(3):
            bodies.velocity[i, w] += gravity[w] * h
    for c in contacts:
        a, b = first[c], second[c]
        impulse[c, 3] = _between(c, 0, a, b, bodies.velocity, work)
    for c in contacts:
        a, b = first[c], second[c]
        for k in range(3):
            if impulse[c, k] != 0.0:
                _push_both(c, k, a, b, impulse[c, k], bodies, work)
    soft = _softness(h)
    _pass(contacts, bodies, first, second, gap, friction, h, soft, moved, work, impulse)
    still = len(contacts) == 0
    for i in own:
        _advance(i, bodies, gravity, h, still, moved)
    rigid = (0.0, 1.0, 0.0)
    for _ in range(relaxing):
        _pass(contacts, bodies, first, second, gap, friction, h, rigid, moved, work, impulse)
    for c in contacts:
        if restitution[c] > 0.0 and impulse[c, 0] > 0.0 and impulse[c, 3] < -_BOUNCE:
            a, b = first[c], second[c]
            now = _between(c, 0, a, b, bodies.velocity, work)
            size = -work[c, 45] * (now + restitution[c] * impulse[c, 3])
            size = max(impulse[c, 0] + size, 0.0) - impulse[c, 0]
            impulse[c, 0] += size
            _push_both(c, 0, a, b, size, bodies, work)


@subroutine
def _softness(h):
    """Give rate of overlaps taken back [1/s], share of mass and of impulse (Catto 2011)."""
    omega = math.pi / h  # the highest frequency that the substep resolves
    a = 2.0 * _DAMPING + h * omega
    b = h * omega * a
    return omega / a, b / (1.0 + b), 1.0 / (1.0 + b)


@subroutine
def _pass(contacts, bodies, first, second, gap, friction, h, soft, moved, work, impulse):
    """Solve all contacts of an island once, in turn."""
    rate, mass_share, impulse_share = soft
    moving = bodies.velocity
    for c in contacts:
        a, b = first[c], second[c]
        now = gap[c] + _between(c, 0, a, b, moved, work)
        bias, share, kept = 0.0, 1.0, 0.0
        if now > 0.0:
            bias = now / h
        elif rate > 0.0:
            bias, share, kept = max(rate * now, -_PUSH), mass_share, impulse_share
        speed = _between(c, 0, a, b, moving, work)
        size = -work[c, 45] * share * (speed + bias) - kept * impulse[c, 0]
        size = max(impulse[c, 0] + size, 0.0) - impulse[c, 0]
        impulse[c, 0] += size
        if size != 0.0:
            _push_both(c, 0, a, b, size, bodies, work)
        one = impulse[c, 1] - work[c, 46] * _between(c, 1, a, b, moving, work)
        two = impulse[c, 2] - work[c, 47] * _between(c, 2, a, b, moving, work)
        most, grip = friction[c] * impulse[c, 0], math.sqrt(one * one + two * two)
        if grip > most:
            one, two = one * most / grip, two * most / grip
        one, two = one - impulse[c, 1], two - impulse[c, 2]
        if one != 0.0 or two != 0.0:
            impulse[c, 1] += one
            impulse[c, 2] += two
            _push_both(c, 1, a, b, one, bodies, work)
            _push_both(c, 2, a, b, two, bodies, work)


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
def _add_up(contacts, work, impulse, total):
    """Add the impulses of a substep, world axes, and along the normal."""
    for c in contacts:
        for w in range(3):
            total[c, w] += (impulse[c, 0] * work[c, w] + impulse[c, 1] * work[c, 3 + w]
                            + impulse[c, 2] * work[c, 6 + w])
        total[c, 3] += impulse[c, 0]


@subroutine
def _keep_forces(contacts, work, impulse, h, force):
    """Write what the next step starts from: bounces last no longer than they do."""
    for c in contacts:
        force[c, 0] = impulse[c, 0] / h
        for w in range(3):
            force[c, 1 + w] = (impulse[c, 1] * work[c, 3 + w]
                               + impulse[c, 2] * work[c, 6 + w]) / h
