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

"""Returned impulses: take back, on both sides of a contact, what bonds could not transmit."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.rotation_kernels import matrix
from procphys_ros.physics.kinetic import kinetic_energy
from procphys_ros.physics.rigid.islands import Islands
from procphys_ros.physics.world import BodyState, Contacts, World

_CHAIN = 0.3  # [m/s] change of speed down to which impulses are followed along chains of contacts


class Begun(NamedTuple):
    """
    The motion of all bodies when contacts were found.

    :ivar poses: by id, (B, 7).
    :ivar velocities: by id, (B, 6).
    """

    poses: np.ndarray
    velocities: np.ndarray


def give_back(world: World, contacts: Contacts, before: Begun, fall: float, share: np.ndarray,
              jump: np.ndarray) -> np.ndarray:
    """
    Undo the part of each impulse that the bonds of a side could not transmit.

    A body without joints whose impulses all keep the same share keeps that share of its change of
    velocity. Else the parts are summed, with the arms at the start of the step, and joints answer
    to them as they did to the impulses. Bodies supported by a part that gives way now did not fall
    in this step, so gravity adds no speed to them. A body squeezed between a piece and the ground
    transmits a smaller impulse, too, or it would shoot out: the share of a piece holds for all
    contacts of the chain of bodies that it pressed on. No group of bodies gains energy: where
    bodies that share contacts would, less is returned to all of them, so that momentum is kept.

    Writes velocities of bodies.

    :param fall: speed gained by gravity since the free motion in `before` [m/s].
    :param share: of the impulses on each body that its bonds transmitted, by id, (B,), spread
        along chains in place.
    :param jump: change of velocity by contacts, by id, (B, 6).
    :returns: remaining share of each contact's impulse, (C,).
    """
    bodies = world.bodies
    impulse = np.ascontiguousarray(contacts.impulse)
    pairs = contacts.body_a, contacts.body_b
    loose = bodies.state == BodyState.AWAKE
    kept = _kept(*pairs, impulse, loose, bodies.mass, share)
    total, least, most = _sums(*pairs, np.ascontiguousarray(contacts.point), impulse, kept,
                               before.poses, len(share))
    ids = np.flatnonzero(((most > 0.0) | (least < 1.0)) & loose)
    keeps = np.where(least == most, least, np.nan)
    keeps[world.jointed] = np.nan  # joints have changed their velocities, too
    lift = (1.0 - share) * fall
    given = _given(ids, total, keeps, jump, lift, bodies.mass, bodies.inertia, bodies.poses)
    one = np.where(loose[pairs[0]], pairs[0], pairs[1])
    returned = 1.0 - kept
    for some in (returned > 0.0, np.ones(len(kept), bool)):
        group = group_bodies(pairs[0][some], pairs[1][some], loose)
        part = _possible(ids, group, given, lift, fall, bodies.mass, bodies.inertia, before.poses,
                         before.velocities, bodies.poses, bodies.velocities)
        given *= part[group[ids], None]
        returned *= part[group[one]]
    changed = least[ids] < 1.0
    world.add_velocities(ids[changed], given[changed])
    return 1.0 - returned


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
def _kept(first, second, impulse, loose, mass, share):
    """Return the share of each impulse that is kept, (C,), spread along chains of contacts."""
    count = len(first)
    kept = np.empty(count)
    changed = True
    while changed:
        changed = False
        for c in range(count):
            kept[c] = min(share[first[c]], share[second[c]])
        for c in range(count):
            push = (1.0 - kept[c]) * np.sqrt(impulse[c, 0] ** 2 + impulse[c, 1] ** 2
                                             + impulse[c, 2] ** 2)
            for body in (first[c], second[c]):
                if loose[body] and kept[c] < share[body] and push > _CHAIN * mass[body]:
                    share[body] = kept[c]
                    changed = True
    return kept


@kernel
def _sums(first, second, point, impulse, kept, start, count):
    """Sum the impulses removed from each body, (B, 6), and its extreme kept shares, (B,) each."""
    total, least, most = np.zeros((count, 6)), np.ones(count), np.zeros(count)
    for c in range(len(first)):
        for body in (first[c], second[c]):
            least[body] = min(least[body], kept[c])
            most[body] = max(most[body], kept[c])
        if not kept[c] < 1.0:
            continue
        for body, sign in ((first[c], kept[c] - 1.0), (second[c], 1.0 - kept[c])):
            x, y, z = sign * impulse[c, 0], sign * impulse[c, 1], sign * impulse[c, 2]
            u, v, w = point[c, 0], point[c, 1], point[c, 2]
            u, v, w = u - start[body, 0], v - start[body, 1], w - start[body, 2]
            row = total[body]
            row[0] += x
            row[1] += y
            row[2] += z
            row[3] += v * z - w * y
            row[4] += w * x - u * z
            row[5] += u * y - v * x
    return total, least, most


@kernel
def _given(ids, total, keeps, jump, lift, mass, inertia, poses):
    """
    Return the changes of velocity that undo the untransmitted impulses, (K, 6).

    :param total: removed impulse and moment, by id, (B, 6).
    :param keeps: share of its change of velocity that a body keeps, by id, (B,); NaN = see
        `total`.
    :param lift: downward velocity by gravity to be undone [m/s], by id, (B,).
    """
    out = np.empty((len(ids), 6))
    for k in range(len(ids)):
        i = ids[k]
        if np.isnan(keeps[i]):
            out[k] = _change(total[i], mass[i], inertia[i], poses[i])
        else:
            out[k] = (keeps[i] - 1.0) * jump[i]
        out[k, 2] += lift[i]
    return out


@kernel
def _possible(ids, group, given, lift, fall, mass, inertia, start, before, poses, after):
    """
    Return the share of the returned impulses that each group can have, by its number, (B,).

    The energy of a group must not exceed both that without and that with its contacts. A common
    share of all impulses lies in between, but shares that differ between contacts may not: a ball
    would keep its motion, and so would the body it threw aside.

    :param given: see `_given`, (K, 6).
    :param start, before: poses and velocities at the start of the step; `poses` and `after` now.
    :param fall: velocity gained by free bodies through gravity [m/s].
    """
    free, now = np.zeros(len(mass)), np.zeros(len(mass))
    linear, square = np.zeros(len(mass)), np.zeros(len(mass))
    for k in range(len(ids)):
        i, g = ids[k], group[ids[k]]
        falling = before[i].copy()
        falling[2] -= fall - lift[i]
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


@subroutine
def _change(impulse, mass, inertia, pose):
    """Return the change of velocity by an impulse and its moment, (6,)."""
    axes = matrix(pose[3:])
    out = np.zeros(6)
    for c in range(3):
        out[c] = impulse[c] / mass
        spin = 0.0
        for k in range(3):
            spin += axes[k, c] * impulse[3 + k]
        for k in range(3):
            out[3 + k] += axes[k, c] * spin / inertia[c]
    return out
