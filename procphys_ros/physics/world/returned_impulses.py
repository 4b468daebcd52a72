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
Returned impulses: take back what bonds could not transmit, and let the other contacts bear it.

A rigid-body engine has solved all contacts as if every body were whole. Of the impulses on a body
that broke only a share was real. What whole bodies exchange is then solved again, at velocities
alone, with the impulses on broken bodies given: what still has support stays up. No impulse grows,
since bonds were judged by the first ones.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.physics.kinetic import kinetic_energy
from procphys_ros.physics.rigid.body_rows import (
    BODY,
    EASE,
    eased,
    inverse_inertia,
    LIGHT,
    lightened,
    push,
    slip_of,
    SPEED,
)
from procphys_ros.physics.rigid.islands import Islands
from procphys_ros.physics.rigid.vectors import (
    at,
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
from procphys_ros.physics.world import BodyState, Contacts, World

_CALM = 0.01  # [m/s] change of speed by a pass at which passes end
_PASSES = 64  # at most


class Begun(NamedTuple):
    """
    The motion of all bodies when contacts were found.

    :ivar poses: by id, (B, 7).
    :ivar velocities: by id, (B, 6).
    """

    poses: np.ndarray
    velocities: np.ndarray


def give_back(world: World, contacts: Contacts, before: Begun, duration: float,
              share: np.ndarray) -> np.ndarray:
    """
    Reduce the impulses on bodies that broke, and solve the other contacts again.

    No group of bodies that share contacts gains energy: where one would, less is changed for all
    of it, so that momentum is kept. Writes velocities of bodies.

    :param before: motion when the contacts were found.
    :param duration: since then, in which gravity acted [s].
    :param share: of the impulses on each body that its bonds transmitted, by id, (B,).
    :returns: impulses and their normal components [N·s], (C, 4).
    """
    bodies = world.bodies
    loose = bodies.state == BodyState.AWAKE
    pairs = np.stack([contacts.body_a, contacts.body_b])
    ids, row = np.unique(pairs, return_inverse=True)
    first, second = row.reshape(pairs.shape)
    free = loose[ids]
    moves = free | (bodies.state[ids] == BodyState.KINEMATIC)
    state = _states(np.where(free, bodies.mass[ids], np.inf), bodies.inertia[ids],
                    before.poses[ids], bodies.velocities[ids] * moves[:, None])
    impulse = np.column_stack([contacts.impulse, contacts.normal_impulse])
    kept = np.minimum(share[contacts.body_a], share[contacts.body_b])
    after = _solved(first, second, np.ascontiguousarray(contacts.point),
                    np.ascontiguousarray(contacts.normal), impulse, kept, before.poses[ids],
                    state)
    ids, given = ids[free], state[free, :6] - bodies.velocities[ids[free]]
    changed = (after != impulse).any(axis=1)
    group = group_bodies(pairs[0][changed], pairs[1][changed], loose)
    part = _possible(ids, group, given, world.gravity * duration, bodies.mass, bodies.inertia,
                     before.poses,
                     before.velocities, bodies.poses, bodies.velocities)
    given *= part[group[ids], None]
    one = np.where(loose[pairs[0]], pairs[0], pairs[1])
    moved = given.any(axis=1)
    world.add_velocities(ids[moved], given[moved])
    return impulse + part[group[one], None] * (after - impulse)


def group_bodies(first: np.ndarray, second: np.ndarray, loose: np.ndarray) -> np.ndarray:
    """
    Return the group number of each body: bodies joined by contacts, except through immovable ones.

    :param first, second: bodies of contacts, (C,).
    :param loose: whether each body moves freely, by id, (B,) bool.
    :returns: (B,).
    """
    count = len(loose)
    moves = np.flatnonzero(loose[first] | loose[second])
    ends = [np.where(loose[side], side, count)[moves] for side in (first, second)]
    none = np.zeros(0, np.intp)
    found = Islands.found((ends[0], ends[1]), (none, none), count)
    group = np.empty(count, np.intp)
    group[found.bodies] = np.repeat(np.arange(len(found.body_start) - 1),
                                    np.diff(found.body_start))
    return group


@kernel
def _states(mass, inertia, pose, velocity):
    """Build the rows of bodies, (K, BODY); those of infinite mass follow no impulse."""
    out = np.zeros((len(mass), BODY))
    for i in range(len(mass)):
        for w in range(6):
            out[i, w] = velocity[i, w]
        light = 1.0 / mass[i]
        if light == 0.0:
            continue
        put(out, i, LIGHT, (light, light, light))
        first, second = inverse_inertia(inertia, pose, i)
        put(out, i, EASE, first)
        put(out, i, EASE + 3, second)
    return out


@kernel
def _solved(first, second, point, normal, impulse, kept, poses, state):
    """
    Solve contacts for less than they exert; those on broken bodies keep a share.

    :param impulse: first and greatest ones [N·s], and their normal components, (C, 4).
    :param kept: share; 1 = solve for it, (C,).
    :param poses: of the bodies, (K, 7).
    :param state: rows of bodies; velocities are written.
    :returns: impulses and their normal components, (C, 4).
    """
    count, out = len(first), impulse.copy()
    arms, ease = np.empty((count, 6)), np.empty(count)
    for c in range(count):
        i, j, n = first[c], second[c], at(normal, c)
        put(arms, c, 0, less(at(point, c), at(poses, i)))
        put(arms, c, 3, less(at(point, c), at(poses, j)))
        ease[c] = _ease(c, i, j, arms, n, state)
        if kept[c] < 1.0:
            _press(c, i, j, arms, scaled(kept[c] - 1.0, at(impulse, c)), state, out)
            out[c, 3] = kept[c] * impulse[c, 3]
    for _ in range(_PASSES):
        most = 0.0
        for c in range(count):
            if kept[c] == 1.0 and impulse[c, 3] > 0.0:
                most = max(most, _solve(c, first[c], second[c], at(normal, c), impulse, arms,
                                        ease[c], state, out))
        if most < _CALM:
            break
    return out


@subroutine(**LEAN)
def _solve(c, i, j, n, impulse, arms, ease, state, out):
    """Solve one contact; return the change of speed [m/s]."""
    arm, other = three(arms, c, 0), three(arms, c, 3)
    before, most = out[c, 3], impulse[c, 3]
    change = -dot(n, slip_of(state, i, j, arm, other, SPEED)) / ease
    change = min(max(before + change, 0.0), most) - before
    out[c, 3] += change
    _press(c, i, j, arms, scaled(change, n), state, out)
    slip = slip_of(state, i, j, arm, other, SPEED)
    slip = plus(slip, -dot(n, slip), n)
    speed, rubs = length(slip), plus(at(out, c), -out[c, 3], n)
    wanted = rubs
    if speed > 0.0:
        t = scaled(1.0 / speed, slip)
        wanted = plus(rubs, -speed / _ease(c, i, j, arms, t, state), t)
    size = length(wanted)
    grip = out[c, 3] / most * length(plus(at(impulse, c), -most, n))
    if size > grip:
        wanted = scaled(grip / size, wanted)
    more = less(wanted, rubs)
    _press(c, i, j, arms, more, state, out)
    return max(abs(change), length(more)) * ease


@subroutine(**LEAN)
def _ease(c, i, j, arms, d, state):
    """Return the change of speed along a direction by a unit impulse along it [1/kg]."""
    one, two = cross(three(arms, c, 0), d), cross(three(arms, c, 3), d)
    return (dot(d, plus(lightened(state, i, d), 1.0, lightened(state, j, d)))
            + dot(one, eased(state, i, one)) + dot(two, eased(state, j, two)))


@subroutine(**LEAN)
def _press(c, i, j, arms, impulse, state, out):
    """Add to the impulse of a contact, on both bodies."""
    put(out, c, 0, plus(at(out, c), 1.0, impulse))
    push(state, i, j, three(arms, c, 0), three(arms, c, 3), impulse)


@kernel
def _possible(ids, group, given, gained, mass, inertia, start, before, poses, after):
    """
    Return the share of the changes that each group can have, by its number, (B,).

    The energy of a group must not exceed both that without and that with its contacts.

    :param given: changes of velocity, (K, 6).
    :param start, before: poses and velocities at the start of the step; `poses` and `after` now.
    :param gained: velocity that gravity gave free bodies [m/s], (3,).
    """
    free, now = np.zeros(len(mass)), np.zeros(len(mass))
    linear, square = np.zeros(len(mass)), np.zeros(len(mass))
    for k in range(len(ids)):
        i, g = ids[k], group[ids[k]]
        falling = before[i].copy()
        falling[:3] += gained
        free[g] += kinetic_energy(mass[i], inertia[i], start[i, 3:], falling)
        own = kinetic_energy(mass[i], inertia[i], poses[i, 3:], after[i])
        change = kinetic_energy(mass[i], inertia[i], poses[i, 3:], given[k])
        both = kinetic_energy(mass[i], inertia[i], poses[i, 3:], after[i] + given[k])
        now[g], square[g] = now[g] + own, square[g] + change
        linear[g] += both - own - change
    out = np.ones(len(mass))
    for g in range(len(mass)):
        room = max(free[g] - now[g], 0.0)
        if linear[g] + square[g] > room and square[g] > 0.0:
            root = np.sqrt(linear[g] ** 2 + 4.0 * square[g] * room)
            out[g] = max(root - linear[g], 0.0) / (2.0 * square[g])
    return out
