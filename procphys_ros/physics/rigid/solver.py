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
Solver: contact impulses, island by island, in substeps.

Each substep applies gravity, warm starts from the impulses of the previous one, solves soft
contacts that correct overlaps, alternately upwards and downwards, moves bodies, and relaxes
upwards without softness or correction, which removes the speed of the correction (Catto 2024,
"Solver2D": soft step with relaxation; Macklin et al. 2019, "Small steps in physics simulation").
Friction is a cone, with tangential springs to the point of sticking as in granular mechanics
(Cundall and Strack 1979).
"""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.rotation_kernels import matrix_rows
from procphys_ros.physics.rigid import joints as jointed
from procphys_ros.physics.rigid.body_rows import (
    BEND,
    BODY,
    EASE,
    eased,
    FREE,
    inverse_inertia,
    LIGHT,
    lightened,
    OWN,
    push,
    rotated,
    slip_of,
    SPEED,
    SPIN,
    TURNED,
    WAY,
)
from procphys_ros.physics.rigid.vectors import (
    at,
    cross,
    dot,
    INLINE,
    LEAN,
    length,
    less,
    plus,
    put,
    scaled,
    tangent,
    three,
)

_PUSH = 0.3  # [m/s] largest speed of overlap correction, so that wedged bodies are not thrown out
_RECOVERY = 30.0  # [1/s] correction rate of overlap and tangential creep: at four times this large
#                   heaps jitter permanently
_GIVES = 0.006  # softness: relative decay of the contact force, so that wedged bodies lose their
#                 stresses (box2d's soft contacts); at most as fast as overlap is corrected or a
#                 body falls in a substep, as light bodies would sink in under heavy ones
ROLLING = 0.008  # [m] lever arm of rolling resistance: hard balls on firm soil ...
MOST_ROLLING = 0.1  # ... and its largest share of the radius, as pebbles would slide beyond
_CRUSHES = 1e7  # [Pa] compressive strength of brickwork, by which a point becomes a patch
_BOUNCE = 0.05  # [m/s] least approach speed of a bounce: 0.1 mm of height
_WORK = 12_000_000  # [1/s] budget of contacts solved per island: enough for a stack, not a heap
_LEAST_PASSES = 2  # pairs, without which large heaps jitter and never sleep
_COARSE = 480.0  # [1/s] least rate of substeps; it leaves 0.5 mm of overlap in a heap
_FINER = 4  # largest multiple of that rate
_MOST_PASSES = 16  # pairs: landing flat on many corners needs them, rest takes one pass
_CALM = 1e-4  # [m/s] change of speed by a pass at which passes end
SLEEP_SPEED = 0.02  # [m/s] speed that bodies at rest do not reach: a slide at one percent above
#                     the friction limit is faster
_MOST_TURNS = 64  # largest number of rotations in a substep
_LITTLE = 1e-3  # [rad] largest rotation taken to second order, exact to one in 1e9
_NOTICED = 0.01  # [rad] least rotation in a substep that requires an update of arms and inertia
_TURN = 0.05  # [rad] largest single rotation, so that the rotational energy is conserved
_HALVINGS = 60  # of the range of energies: to the last bit
_RATIO = 3.0  # largest ratio of the load on a body to its inertia: for few passes to suffice

# A row per contact: normal, a tangent, arms of both bodies, effective masses along normal, tangent
# and bitangent, speed along the last two by a unit impulse along the normal, impulses of the
# present substep, present gap, friction, sums of impulses over the step, the point that rotates
# with each body at the start of the step, the gap then, the normal impulse of the previous
# substep, shift and anchor of friction, lever arm and angular impulse of rolling resistance, and
# the separation speed after an impact.
_NORMAL, _TANGENT, _ARM, _OTHER, _MASS, _ASIDE, _PUSHED = 0, 3, 6, 9, 12, 15, 17
_GAP, _GRIP, _SUM, _PLACE, _OTHER_PLACE, _START, _LAST = 20, 21, 22, 25, 28, 31, 32
_SHIFT, _ANCHOR, _LEVER, _ROLLED, _THROWN = 33, 35, 37, 38, 41
_CONTACT = 42


class MovingBodies(NamedTuple):
    """
    Columns of moving bodies: first those that move freely, then kinematic ones.

    :ivar mass: [kg]; inf = kinematic, (N,).
    :ivar inertia: principal moments [kg·m²], (N, 3).
    :ivar pose: (N, 7).
    :ivar velocity: world axes, (N, 6).
    """

    mass: np.ndarray
    inertia: np.ndarray
    pose: np.ndarray
    velocity: np.ndarray


@kernel(nogil=True)
def solve(bodies, free, first, second, contacts, friction, restitution, joints, islands, gravity,
          time_step):
    """
    Move the bodies of islands by a step under gravity and contacts.

    Write poses, velocities, and the forces of contacts.

    :param bodies: the last row stands for all immovable bodies.
    :param free: number of bodies that move freely.
    :param first, second: rows of bodies, (C,).
    :param contacts: their forces of the previous step become those at the end of this one.
    :param friction, restitution: of bodies by id, combined by the geometric mean, (B,).
    :param joints: of these islands, between rows of bodies; displacements, forces and moments are
        written.
    :param islands: `Islands`; others are ignored.
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :returns: contacts of the islands as of `Engine.contacts`, (C, 13).
    """
    own, order, start = islands.bodies, islands.contacts, islands.contact_start
    state, rows = _states(bodies, own, free), np.empty((len(order), _CONTACT))
    ends, spots = np.empty((len(order), 2), np.int64), np.zeros((len(order), 3))
    elastic, told = np.empty((len(order), 2)), np.empty((len(order), 13))
    for r in range(len(order)):
        c = order[r]
        ends[r, 0], ends[r, 1] = first[c], second[c]
        a, b = contacts.first[c], contacts.second[c]
        rows[r, _GRIP] = math.sqrt(friction[a] * friction[b])
        elastic[r, 0] = math.sqrt(restitution[a] * restitution[b])
        _place(r, c, bodies, ends, contacts, rows)
        _tell(r, c, bodies.pose, first[c], contacts, told)
    gained = time_step * math.sqrt(
        gravity[0] * gravity[0] + gravity[1] * gravity[1] + gravity[2] * gravity[2])
    _brace(own, free, bodies, gained, ends, state, rows)
    for i in own:
        state[i, LIGHT + 2] *= state[i, OWN]
        _ease(i, bodies, state)
    for r in range(len(order)):
        _aim(r, ends, contacts.radius, order, state, time_step, rows)
    system = jointed.lay_out(joints, free)
    jointed.aim(range(len(joints.kind)), joints, system, bodies, free, 0.0, state)
    for g in range(len(start) - 1):
        members = own[islands.body_start[g]:islands.body_start[g + 1]]
        held = range(islands.joint_start[g], islands.joint_start[g + 1])
        _solve_island(members, start[g], start[g + 1], free, bodies, ends, elastic,
                      contacts.radius, order, contacts.force, contacts.shift, joints, held,
                      system, gravity, time_step, state, rows, spots)
    jointed.tell(joints, system, time_step)
    for i in own:
        for w in range(6):
            bodies.velocity[i, w] = state[i, w]
    _tell_impulses(rows, spots, time_step, told)
    return told


@kernel
def follow(bodies, free, time_step):
    """Move kinematic bodies by a step [s]; their rows follow those that move freely."""
    for i in range(free, len(bodies.mass)):
        _follow(i, bodies, time_step)


@kernel
def efforts(contacts, time_step):
    """
    Estimate the number of contact solves of islands in a step, unless they are calm, (I,).

    :param contacts: number of contacts of each island, (I,).
    :param time_step: [s].
    """
    out = np.empty(len(contacts))
    for g in range(len(contacts)):
        substeps, passes, _ = _pace(contacts[g], time_step)
        out[g] = 2 * contacts[g] * substeps * passes
    return out


@subroutine
def _states(bodies, own, free):
    """Build the rows of moving bodies; rows of other islands stay empty."""
    state = np.zeros((len(bodies.mass), BODY))
    for n in range(len(own) + len(state) - free):
        i = own[n] if n < len(own) else free + n - len(own)
        for w in range(6):
            state[i, w] = bodies.velocity[i, w]
        light = 1.0 / bodies.mass[i]
        put(state, i, LIGHT, (light, light, light))
        state[i, OWN] = 1.0
    return state


@subroutine
def _brace(own, free, bodies, gained, ends, state, rows):
    """
    Raise the inertia against vertical motion of bodies under far more mass; weights stay.

    A pass transfers momentum from a load to a light body under it only as far as the light body
    can take it up. As that body is held from below, its own inertia matters little ("mass scaling"
    of stacks in Macklin et al. 2014, "Unified particle physics for real-time applications").
    The momentum that moving bodies gain by this is at most the impulse of the weight on them.

    :param gained: speed gained by gravity in the step [m/s].
    """
    load = _loads(free, bodies.pose, ends, state, rows)
    for i in own:
        mass, spin = bodies.mass[i], three(state, i, SPIN)
        arm = math.sqrt(max(bodies.inertia[i, 0], bodies.inertia[i, 1]) / mass)  # within 1.4
        speed = abs(state[i, 2]) + arm * length(spin)
        more = max(load[i] / _RATIO - mass, 0.0)
        if speed * more > gained * load[i]:
            more = gained * load[i] / speed
        state[i, OWN] = mass / (mass + more)


@subroutine
def _loads(free, pose, ends, state, rows):
    """Compute the mass that rests on bodies that are supported themselves [kg], (N,)."""
    firm, steepness, load = np.zeros(len(state), np.bool_), np.zeros(free), np.zeros(free)
    firm[free:] = True
    for r in range(len(ends)):
        steep = rows[r, _NORMAL + 2]
        upper, lower = ends[r, 0 if steep > 0.0 else 1], ends[r, 1 if steep > 0.0 else 0]
        if upper < free:
            firm[upper] = firm[upper] or firm[lower]
            steepness[upper] += abs(steep)
    for r in range(len(ends) - 1, -1, -1):
        steep = rows[r, _NORMAL + 2]
        upper, lower = ends[r, 0 if steep > 0.0 else 1], ends[r, 1 if steep > 0.0 else 0]
        if max(upper, lower) >= free or steep == 0.0 or not firm[lower]:
            continue
        if pose[upper, 2] > pose[lower, 2]:  # interlocking bodies are not a pile
            above = 1.0 / state[upper, LIGHT] + load[upper]
            load[lower] += steep * steep / steepness[upper] * above
    return load


@subroutine(**LEAN)
def _follow(i, bodies, time_step):
    """Move a kinematic body by a step."""
    q = (bodies.pose[i, 3], bodies.pose[i, 4], bodies.pose[i, 5], bodies.pose[i, 6])
    q = rotated(q, three(bodies.velocity, i, 3), time_step)
    for w in range(3):
        bodies.pose[i, w] += time_step * bodies.velocity[i, w]
    for w in range(4):
        bodies.pose[i, 3 + w] = q[w]


@subroutine(**LEAN)
def _ease(i, bodies, state):
    """Write the inverse inertia of a body in world axes."""
    first, second = inverse_inertia(bodies.inertia, bodies.pose, i)
    own = state[i, OWN]
    half = math.sqrt(own)
    put(state, i, EASE, (own * first[0], own * first[1], half * first[2]))
    put(state, i, EASE + 3, (own * second[0], half * second[1], second[2]))


@subroutine
def _solve_island(own, begin, end, free, bodies, ends, elastic, radius, order, force, shift,
                  joints, held, system, gravity, time_step, state, rows, spots):
    """Move the bodies of an island by a step."""
    contacts, hangs = range(begin, end), len(held) > 0
    substeps, passes, fine = _pace(end - begin + jointed.work(held, system), time_step)
    if _energy(own, bodies, state) < _energy_at(SLEEP_SPEED, own, bodies):
        passes = 2 * _MOST_PASSES  # the rest of few passes would keep it from sleep
    h = time_step / substeps
    fall = h * length((gravity[0], gravity[1], gravity[2]))
    # Nothing wins energy where nothing is touched: what is left there is rounding.
    bounces, driven, span = False, hangs or begin == end, h
    for r in contacts:
        for side in range(2):
            i = ends[r, side]
            driven = driven or i >= free and (length(three(state, i, SPEED)) > 0.0
                                              or length(three(state, i, SPIN)) > 0.0)
        _start(r, order[r], force, h, rows)
        bounces = bounces or elastic[r, 0] > 0.0
    for substep in range(substeps):
        for i in own:
            _drive(i, gravity, h, state)
        most = math.inf if driven else _energy(own, bodies, state) + _energy_at(_PUSH, own, bodies)
        if bounces:
            _note_approach(contacts, ends, state, rows, elastic)
        _begin(contacts, ends, state, rows, fall)
        if hangs:
            span = jointed.span(held, substep, substeps, time_step, system)
            jointed.begin(held, joints, system, h, state)
        _passes(passes, contacts, ends, state, rows, held, joints, system, span,
                (h, fall, _RECOVERY), False)
        for i in own:
            _advance(i, bodies, gravity, h, begin == end and not hangs, state)
        _carry(free, (substep + 1) * h, state)
        _aim_anew(own, contacts, fine or hangs, bodies, ends, radius, order, h, state, rows)
        if hangs:
            jointed.aim(held, joints, system, bodies, free, (substep + 1) * h, state)
        _passes(passes, contacts, ends, state, rows, held, joints, system, span,
                (h, 0.0, 0.0), True)
        if bounces and _strikes(contacts, rows, elastic):
            _passes(passes, contacts, ends, state, rows, held, joints, system, span,
                    (h, 0.0, 0.0), False)
        _resist_spin(contacts, ends, h, state, rows)
        _add_up(contacts, rows, spots)
        if hangs:
            jointed.add_up(held, joints, system, h)
        _restrain(own, most, bodies, state)
    _keep_forces(contacts, order, rows, h, fall, force, shift)


@subroutine(**LEAN)
def _motion(i, bodies, state):
    """Compute the kinetic energy of a body [J]."""
    along, spin = length(three(state, i, SPEED)), three(state, i, SPIN)
    q = (bodies.pose[i, 3], bodies.pose[i, 4], bodies.pose[i, 5], bodies.pose[i, 6])
    turning = dot(spin, _stretched(q, at(bodies.inertia, i), spin))
    return 0.5 * (bodies.mass[i] * along * along + turning)


@subroutine(**LEAN)
def _energy(own, bodies, state):
    """Compute the kinetic energy of an island [J]."""
    total = 0.0
    for i in own:
        total += _motion(i, bodies, state)
    return total


@subroutine(**LEAN)
def _energy_at(speed, own, bodies):
    """Compute the kinetic energy of an island at a uniform speed [J]."""
    total = 0.0
    for i in own:
        total += 0.5 * bodies.mass[i] * speed * speed
    return total


@subroutine(**LEAN)
def _restrain(own, most, bodies, state):
    """
    Slow down the fastest bodies of an island until its kinetic energy is at most the limit.

    The residual of few passes between a gram and tonnes is small for tonnes, but large for a gram:
    17 kJ where a ball ran over a twig with 1 kJ.
    """
    if _energy(own, bodies, state) <= most:
        return
    low, high = 0.0, 0.0  # energy over mass
    for i in own:
        high = max(high, _motion(i, bodies, state) / bodies.mass[i])
    for _ in range(_HALVINGS):
        limit, total = 0.5 * (low + high), 0.0
        for i in own:
            total += min(_motion(i, bodies, state), limit * bodies.mass[i])
        low, high = (limit, high) if total <= most else (low, limit)
    for i in own:
        has = _motion(i, bodies, state) / bodies.mass[i]
        if has > low:
            share = math.sqrt(low / has)
            for w in range(6):
                state[i, w] *= share


@subroutine(**LEAN)
def _aim_anew(own, contacts, fine, bodies, ends, radius, order, h, state, rows):
    """Update inertia and arms of bodies that rotate noticeably in a substep, or of all."""
    least = 0.0 if fine else _NOTICED / h
    for i in own:
        spin = three(state, i, SPIN)
        if dot(spin, spin) >= least * least:
            _ease(i, bodies, state)
    for r in contacts:
        one, two = three(state, ends[r, 0], SPIN), three(state, ends[r, 1], SPIN)
        if max(dot(one, one), dot(two, two)) >= least * least:
            _aim(r, ends, radius, order, state, h, rows)


@subroutine(**LEAN)
def _pace(contacts, time_step):
    """Choose substeps and largest number of passes, before and after bodies move, of an island."""
    if contacts == 0:
        return 1, 0, False
    coarse = max(int(time_step * _COARSE + 0.5), 1)
    work, substeps = int(_WORK * time_step), _FINER * coarse
    while substeps > coarse and 4 * contacts * substeps * (substeps // coarse) > work:
        substeps //= 2
    passes = min(max(work // (4 * contacts * substeps), _LEAST_PASSES), _MOST_PASSES)
    return substeps, 2 * passes, substeps == _FINER * coarse


@subroutine(**LEAN)
def _drive(i, gravity, h, state):
    """Apply gravity to a body for a substep."""
    for w in range(6):
        if w < 3:
            state[i, w] += gravity[w] * h * (state[i, OWN] if w == 2 else 1.0)
        state[i, FREE + w] = state[i, w]


@subroutine(**LEAN)
def _carry(count, time, state):
    """Write the displacements of kinematic bodies since the start of the step."""
    for i in range(count, len(state)):
        for w in range(6):
            state[i, WAY + w] = time * state[i, w]
        _bend(i, state)


@subroutine(**LEAN)
def _place(r, c, bodies, ends, contacts, rows):
    """
    Write the arms of a contact from both bodies; round pieces roll under it.

    Rolling contacts have no point of sticking, as their creep by friction is not tracked.
    """
    n, point = at(contacts.normal, c), at(contacts.point, c)
    put(rows, r, _NORMAL, n)
    put(rows, r, _TANGENT, tangent(n))
    for side in range(2):
        rolls = scaled((2.0 * side - 1.0) * contacts.radius[c, side], n)
        turns = less(less(point, at(bodies.pose, ends[r, side])), rolls)
        put(rows, r, _PLACE + 3 * side, turns)
    rows[r, _START] = rows[r, _GAP] = contacts.gap[c]
    shift, t = at(contacts.shift, c), three(rows, r, _TANGENT)
    rows[r, _SHIFT] = rows[r, _ANCHOR] = dot(shift, t)
    rows[r, _SHIFT + 1] = rows[r, _ANCHOR + 1] = dot(shift, cross(n, t))
    radius = max(contacts.radius[c, 0], contacts.radius[c, 1])
    rows[r, _LEVER] = min(ROLLING, MOST_ROLLING * radius)
    put(rows, r, _ROLLED, (0.0, 0.0, 0.0))
    for k in range(3):
        rows[r, _SUM + k] = 0.0


@subroutine(**LEAN)
def _aim(r, ends, radius, order, state, duration, rows):
    """
    Write arms and effective masses of a contact.

    Arms are those at the middle of the coming interval: with those at its start a rocking block
    would lose energy.
    """
    n, t = three(rows, r, _NORMAL), three(rows, r, _TANGENT)
    b = cross(n, t)
    mass, aside = (0.0, 0.0, 0.0), (0.0, 0.0)
    for side in range(2):
        i = ends[r, side]
        place = three(rows, r, _PLACE + 3 * side)
        place = plus(place, 1.0, _bent(place, state, i))
        place = _turned_on(place, state, i, 0.5 * duration)
        place = plus(place, (2.0 * side - 1.0) * radius[order[r], side], n)
        put(rows, r, _ARM + 3 * side, place)
        one, two, other = cross(place, n), cross(place, t), cross(place, b)
        spin, moved = eased(state, i, one), lightened(state, i, n)
        mass = (mass[0] + dot(n, moved) + dot(one, spin),
                mass[1] + dot(t, lightened(state, i, t)) + dot(two, eased(state, i, two)),
                mass[2] + dot(b, lightened(state, i, b)) + dot(other, eased(state, i, other)))
        aside = (aside[0] + dot(t, moved) + dot(two, spin),
                 aside[1] + dot(b, moved) + dot(other, spin))
    put(rows, r, _MASS, (1.0 / mass[0], 1.0 / mass[1], 1.0 / mass[2]))
    rows[r, _ASIDE], rows[r, _ASIDE + 1] = aside


@subroutine(**INLINE)
def _start(r, c, force, h, rows):
    """Write the warm-start impulses of the first substep."""
    n, t, pressed = three(rows, r, _NORMAL), three(rows, r, _TANGENT), three(force, c, 1)
    put(rows, r, _PUSHED, (h * force[c, 0], h * dot(pressed, t), h * dot(pressed, cross(n, t))))
    rows[r, _LAST] = rows[r, _PUSHED]


@subroutine(**LEAN)
def _bend(i, state):
    """
    Write the matrix of the displacement of points by the rotation of a body.

    Large rotations are exact, as the second-order formula would stretch the arms.
    """
    x, y, z = three(state, i, TURNED)
    if x * x + y * y + z * z > _NOTICED * _NOTICED:
        one, two, other = matrix_rows(rotated((0.0, 0.0, 0.0, 1.0), (x, y, z), 1.0))
        put(state, i, BEND, (one[0] - 1.0, one[1], one[2]))
        put(state, i, BEND + 3, (two[0], two[1] - 1.0, two[2]))
        put(state, i, BEND + 6, (other[0], other[1], other[2] - 1.0))
        return
    put(state, i, BEND, (-0.5 * (y * y + z * z), 0.5 * x * y - z, 0.5 * x * z + y))
    put(state, i, BEND + 3, (0.5 * x * y + z, -0.5 * (x * x + z * z), 0.5 * y * z - x))
    put(state, i, BEND + 6, (0.5 * x * z - y, 0.5 * y * z + x, -0.5 * (x * x + y * y)))


@subroutine(**INLINE)
def _bent(place, state, i):
    """Compute the displacement of a point by the rotation about the body's centre."""
    return (dot(three(state, i, BEND), place), dot(three(state, i, BEND + 3), place),
            dot(three(state, i, BEND + 6), place))


@subroutine(**INLINE)
def _turned_on(place, state, i, duration):
    """Rotate an arm by a body's angular velocity over a duration, keeping its length."""
    turn = scaled(duration, three(state, i, SPIN))
    way = cross(turn, place)
    if dot(turn, turn) < _LITTLE * _LITTLE:
        return plus(plus(place, 1.0, way), 0.5, cross(turn, way))
    far, turned = length(place), plus(place, 1.0, way)
    return scaled(far / length(turned), turned) if far > 1e-9 else place


@subroutine(**INLINE)
def _along(rows, r, pushed):
    """Convert an impulse along normal and tangents to world axes."""
    n, t = three(rows, r, _NORMAL), three(rows, r, _TANGENT)
    return plus(plus(scaled(pushed[0], n), pushed[1], t), pushed[2], cross(n, t))


@subroutine(**LEAN)
def _note_approach(contacts, ends, state, rows, elastic):
    """Record the approach speeds of contacts before their impulses."""
    for r in contacts:
        slip = slip_of(state, ends[r, 0], ends[r, 1], three(rows, r, _ARM), three(rows, r, _OTHER),
                       FREE)
        elastic[r, 1] = dot(slip, three(rows, r, _NORMAL))


@subroutine(**LEAN)
def _begin(contacts, ends, state, rows, fall):
    """
    Warm start from the previous impulses, without those of impacts.

    Resting forces grow in a substep by at most the weight of the bodies; impulses of impacts
    exceed this, and would throw bodies if they were applied again.

    :param fall: speed gained by gravity in a substep [m/s].
    """
    for r in contacts:
        lasting = _lasting(r, rows, fall)
        share = lasting / rows[r, _PUSHED] if lasting > 0.0 else 0.0
        rows[r, _LAST], rows[r, _THROWN] = rows[r, _PUSHED], 0.0
        pushed = scaled(share, three(rows, r, _PUSHED))
        rolled = scaled(share, three(rows, r, _ROLLED))
        put(rows, r, _PUSHED, pushed)
        put(rows, r, _ROLLED, rolled)
        if share == 0.0:
            continue
        if rows[r, _LEVER] > 0.0:
            _turn_by(ends[r, 0], ends[r, 1], rolled, state)
        push(state, ends[r, 0], ends[r, 1], three(rows, r, _ARM), three(rows, r, _OTHER),
             _along(rows, r, pushed))


@subroutine(**INLINE)
def _lasting(r, rows, fall):
    """Return the normal impulse of a contact in the last substep, without impacts."""
    return min(rows[r, _PUSHED], rows[r, _LAST] + rows[r, _MASS] * fall)


@subroutine(**INLINE)
def _follow_point(r, i, j, state, rows):
    """Write gap and shift after bodies have moved, to second order of their rotations."""
    one, two = three(rows, r, _PLACE), three(rows, r, _OTHER_PLACE)
    one = plus(three(state, i, WAY), 1.0, _bent(one, state, i))
    two = plus(three(state, j, WAY), 1.0, _bent(two, state, j))
    way, n, t = less(one, two), three(rows, r, _NORMAL), three(rows, r, _TANGENT)
    rows[r, _GAP] = rows[r, _START] + dot(n, way)
    if rows[r, _LEVER] == 0.0:
        rows[r, _SHIFT] = rows[r, _ANCHOR] + dot(t, way)
        rows[r, _SHIFT + 1] = rows[r, _ANCHOR + 1] + dot(cross(n, t), way)


@subroutine(**INLINE)
def _let_go(r, rows):
    """Move the anchor of a sliding or open contact to its present position."""
    for k in range(2):
        rows[r, _ANCHOR + k] -= rows[r, _SHIFT + k]
        rows[r, _SHIFT + k] = 0.0


@subroutine(**LEAN)
def _strikes(contacts, rows, elastic):
    """
    Write the separation speeds of impacts; return whether there are any.

    Their impulses are solved for like all others: a body that lands on several points must not
    begin to spin, friction grows with the normal impulse, and the bodies below bear it.
    """
    found = False
    for r in contacts:
        struck = elastic[r, 0] > 0.0 and rows[r, _PUSHED] > 0.0 and elastic[r, 1] <= -_BOUNCE
        rows[r, _THROWN] = -elastic[r, 0] * elastic[r, 1] if struck else 0.0
        found = found or struck
    return found


@subroutine(**LEAN)
def _passes(most, contacts, ends, state, rows, held, joints, system, span, pace, moved):
    """
    Solve an island in passes until velocities converge, or the limit is reached.

    :param most: largest number of passes.
    :param pace: length of a substep [s], largest yielding speed of soft contacts [m/s], and
        correction rate of overlaps; 0 = relaxation after bodies have moved [1/s].
    """
    h, _, rate = pace
    for k in range(most):
        turn = contacts
        if not moved and k % 2 == 1:
            turn = range(contacts.stop - 1, contacts.start - 1, -1)
        pulls = len(held) > 0 and jointed.solve(held, joints, system, state, h, span,
                                                rate, k == 0)
        if not _pass(turn, ends, state, rows, pace, moved and k == 0) and not pulls:
            break


@subroutine(**LEAN)
def _pass(contacts, ends, state, rows, pace, moved):
    """Solve all contacts of an island once, in turn; return whether any speed has changed."""
    h, fall, rate = pace
    often, changed = 1.0 / h, False
    for r in contacts:
        i, j = ends[r, 0], ends[r, 1]
        if moved:
            _follow_point(r, i, j, state, rows)
        gap, before = rows[r, _GAP], rows[r, _PUSHED]
        if rate == 0.0 and gap > 0.0 and before == 0.0:
            continue  # open contacts are stopped in the substep in which they close
        bias = often * gap if gap > 0.0 else max(rate * gap, -_PUSH)
        gives = min(_GIVES * before, rows[r, _MASS] * max(fall, -bias))
        if rows[r, _THROWN] > 0.0:
            bias = -rows[r, _THROWN]
        arm, other = three(rows, r, _ARM), three(rows, r, _OTHER)
        slip = slip_of(state, i, j, arm, other, SPEED)
        lacks = dot(slip, three(rows, r, _NORMAL)) + bias
        pressed = max(before - rows[r, _MASS] * lacks - gives, 0.0)
        if pressed == 0.0 and before == 0.0:
            _let_go(r, rows)
            continue
        u, v = _rub(rows, r, slip, pressed, pressed - before, rate)
        change = (pressed - before, u, v)
        push(state, i, j, arm, other, _along(rows, r, change))
        for k in range(3):
            rows[r, _PUSHED + k] += change[k]
            changed = changed or abs(change[k]) > _CALM * rows[r, _MASS + k]
        if rows[r, _LEVER] > 0.0:
            _resist_rolling(r, i, j, pressed, state, rows)
    return changed


@subroutine(**LEAN)
def _resist_rolling(r, i, j, pressed, state, rows):
    """Slow down rolling and spinning, by at most the moment of the normal force at a lever arm."""
    before = three(rows, r, _ROLLED)
    spin = less(three(state, i, SPIN), three(state, j, SPIN))
    now, size, most = before, length(spin), rows[r, _LEVER] * pressed
    if size > 0.0:
        axis = scaled(1.0 / size, spin)
        ease = dot(axis, plus(eased(state, i, axis), 1.0, eased(state, j, axis)))
        now = plus(before, -size / ease, axis)
    far = length(now)
    if far > most:
        now = scaled(most / far, now)
    _turn_by(i, j, less(now, before), state)
    put(rows, r, _ROLLED, now)


@subroutine(**LEAN)
def _resist_spin(contacts, ends, h, state, rows):
    """
    Slow down spins about contact normals by friction within each point of contact.

    A point is a disc that the strength of the pieces bears its force on; uniform pressure on it
    resists by 2/3·μ·N·r. Else what is clamped between two corners would swing for ever. Rolling
    resistance has stopped the spin of round pieces.
    """
    for r in contacts:
        pressed, n = rows[r, _PUSHED], three(rows, r, _NORMAL)
        i, j = ends[r, 0], ends[r, 1]
        spin = dot(n, less(three(state, i, SPIN), three(state, j, SPIN)))
        if pressed == 0.0 or spin == 0.0 or rows[r, _LEVER] > 0.0:
            continue
        radius = math.sqrt(pressed / (h * math.pi * _CRUSHES))
        most = 2.0 / 3.0 * rows[r, _GRIP] * pressed * radius
        stops = abs(spin) / dot(n, plus(eased(state, i, n), 1.0, eased(state, j, n)))
        _turn_by(i, j, scaled(math.copysign(min(stops, most), -spin), n), state)


@subroutine(**INLINE)
def _turn_by(i, j, moment, state):
    """Apply an angular impulse to the first body, and its opposite to the second."""
    put(state, i, SPIN, plus(three(state, i, SPIN), 1.0, eased(state, i, moment)))
    if state[j, LIGHT] > 0.0:
        put(state, j, SPIN, plus(three(state, j, SPIN), -1.0, eased(state, j, moment)))


@subroutine(**INLINE)
def _rub(rows, r, slip, pressed, change, rate):
    """Compute the change of the friction impulse after one of the normal impulse."""
    t = three(rows, r, _TANGENT)
    b = cross(three(rows, r, _NORMAL), t)
    one, two = rows[r, _PUSHED + 1], rows[r, _PUSHED + 2]
    u = one - rows[r, _MASS + 1] * (dot(slip, t) + rows[r, _ASIDE] * change
                                    + rate * rows[r, _SHIFT])
    v = two - rows[r, _MASS + 2] * (dot(slip, b) + rows[r, _ASIDE + 1] * change
                                    + rate * rows[r, _SHIFT + 1])
    grip, most = u * u + v * v, rows[r, _GRIP] * pressed
    if grip > most * most:
        share = most / math.sqrt(grip)
        u, v = share * u, share * v
        _let_go(r, rows)
    return u - one, v - two


@subroutine(**LEAN)
def _advance(i, bodies, gravity, h, flies, state):
    """
    Move a body, and rotate it so that its angular momentum is conserved.

    Bodies without contact follow their parabola exactly.
    """
    for w in range(3):
        way = h * state[i, w] - (0.5 * h * h * gravity[w] if flies else 0.0)
        bodies.pose[i, w] += way
        state[i, WAY + w] += way
    spin = three(state, i, SPIN)
    if spin[0] == 0.0 and spin[1] == 0.0 and spin[2] == 0.0:
        return
    q = (bodies.pose[i, 3], bodies.pose[i, 4], bodies.pose[i, 5], bodies.pose[i, 6])
    inertia = at(bodies.inertia, i)
    momentum = _stretched(q, inertia, spin)
    turns = min(int(length(spin) * h / _TURN) + 1, _MOST_TURNS)
    turned = (0.0, 0.0, 0.0)
    for _ in range(turns):
        q, part = _turned_freely(q, inertia, momentum, h / turns)
        turned = plus(turned, 1.0, part)
    after = _stretched(q, (1.0 / inertia[0], 1.0 / inertia[1], 1.0 / inertia[2]), momentum)
    for w in range(4):
        bodies.pose[i, 3 + w] = q[w]
    put(state, i, TURNED, plus(three(state, i, TURNED), 1.0, turned))
    _bend(i, state)
    put(state, i, SPIN, after)
    put(state, i, FREE + 3, plus(three(state, i, FREE + 3), 1.0, less(after, spin)))


@subroutine(**LEAN)
def _turned_freely(q, inertia, momentum, h):
    """
    Rotate an attitude as a torque-free body does; return it and the rotation [rad].

    The energy is split into that of a ball with the middle moment of inertia and the differences
    of the two other axes: each part alone rotates the body at a constant rate, about its angular
    momentum or a principal axis. The midpoint rule, stiff for thin rods, would diverge.
    """
    middle = _middle(inertia)
    ease = 1.0 / inertia[middle]
    one, two = (middle + 1) % 3, (middle + 2) % 3
    about = scaled(ease, momentum)
    q = rotated(q, about, 0.5 * h)
    turned = scaled(h, about)
    for k, duration in ((one, 0.5 * h), (two, h), (one, 0.5 * h)):
        x, y, z = matrix_rows(q)
        axis = (x[k], y[k], z[k])
        about = scaled(dot(axis, momentum) * (1.0 / inertia[k] - ease), axis)
        q = rotated(q, about, duration)
        turned = plus(turned, duration, about)
    return rotated(q, scaled(ease, momentum), 0.5 * h), turned


@subroutine(**INLINE)
def _middle(values):
    """Return the index of the middle one of three values."""
    a, b, c = values[0], values[1], values[2]  # two of them may be equal
    if min(a, b) <= c <= max(a, b):
        return 2
    return 1 if min(a, c) <= b <= max(a, c) else 0


@subroutine(**INLINE)
def _stretched(q, factors, v):
    """Scale a vector along each axis of an attitude by a factor."""
    x, y, z = matrix_rows(q)
    a = (x[0] * v[0] + y[0] * v[1] + z[0] * v[2]) * factors[0]
    b = (x[1] * v[0] + y[1] * v[1] + z[1] * v[2]) * factors[1]
    c = (x[2] * v[0] + y[2] * v[1] + z[2] * v[2]) * factors[2]
    return (x[0] * a + x[1] * b + x[2] * c, y[0] * a + y[1] * b + y[2] * c,
            z[0] * a + z[1] * b + z[2] * c)


@subroutine(**LEAN)
def _add_up(contacts, rows, spots):
    """Add the impulses of a substep, and their points weighted by normal impulse."""
    for r in contacts:
        if rows[r, _PUSHED] > 0.0:
            for k in range(3):
                rows[r, _SUM + k] += rows[r, _PUSHED + k]
                spots[r, k] += rows[r, _PUSHED] * rows[r, _ARM + k]


@subroutine(**LEAN)
def _keep_forces(contacts, order, rows, h, fall, force, shift):
    """Write forces and shifts for the warm start of the next step."""
    for r in contacts:
        c, pushed = order[r], three(rows, r, _PUSHED)
        if pushed[0] > 0.0:
            pushed = scaled(_lasting(r, rows, fall) / pushed[0], pushed)
        across = _along(rows, r, (0.0, pushed[1], pushed[2]))
        force[c, 0] = pushed[0] / h
        for w in range(3):
            force[c, 1 + w] = across[w] / h
        t = three(rows, r, _TANGENT)
        put(shift, c, 0, plus(scaled(rows[r, _SHIFT], t), rows[r, _SHIFT + 1],
                              cross(three(rows, r, _NORMAL), t)))


@subroutine(**LEAN)
def _tell(r, c, pose, first, contacts, told):
    """Write bodies, centre of the first one, normal and gap of a contact."""
    told[r, 0], told[r, 1], told[r, 8] = contacts.first[c], contacts.second[c], contacts.gap[c]
    put(told, r, 2, at(pose, first))
    put(told, r, 5, at(contacts.normal, c))


@subroutine(**LEAN)
def _tell_impulses(rows, spots, time_step, told):
    """Write mean points of contacts, and their forces, world and along the normal."""
    for r in range(len(rows)):
        pressed, spot = rows[r, _SUM], three(rows, r, _ARM)
        if pressed > 0.0:
            spot = scaled(1.0 / pressed, at(spots, r))
        put(told, r, 2, plus(three(told, r, 2), 1.0, spot))
        put(told, r, 9, scaled(1.0 / time_step, _along(rows, r, three(rows, r, _SUM))))
        told[r, 12] = pressed / time_step
