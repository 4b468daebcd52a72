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
Impulses: contact impulses with friction that prevent penetration.

Projected Gauss-Seidel on velocities (Catto 2005, Iterative Dynamics with Temporal Coherence): each
contact in turn corrects its normal velocity by a non-negative impulse, and its slip by one inside
the friction cone. Trees respond by the response matrices that their kernel predicts, rigid bodies
by mass and inertia, other partners are immovable.
"""

import math
from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.geometry.linear_kernels import dot, product, transformed

_ITERATIONS = 40
_CONVERGED = 1e-6  # [m/s] largest change of velocity at a contact in a converged iteration
_TURN = 3e-3       # of the largest initial speed, likewise
_RIGID = 1e-9      # share of the largest response of a contact, below which it is rounding
_IMMOVABLE = 1e-15  # [1/kg] largest response of contacts immovable in every direction


class Partners(NamedTuple):
    """
    Bodies of each contact: a tree and its partner.

    :ivar end: point on a tree, row of the `ContactResponse`, (C,).
    :ivar other: point on another tree, or -1, (C,).
    :ivar body: rigid body, row of the columns below, or -1, (C,).
    :ivar arm: from the centre of mass of this body [m], (C, 3), world.
    :ivar inverse_mass: of the bodies [1/kg], 0 for immovable ones, (B,).
    :ivar inverse_inertia: likewise [1/(kg·m²)], world axes, (B, 3, 3).
    :ivar motion: velocities of the bodies without contact, (B, 6); updated.
    """

    end: np.ndarray
    other: np.ndarray
    body: np.ndarray
    arm: np.ndarray
    inverse_mass: np.ndarray
    inverse_inertia: np.ndarray
    motion: np.ndarray


@kernel
def resolve(normal, least, mass, friction, partners, velocity, first, place, count, response,
            total):
    """
    Solve for the impulses of all contacts.

    :param normal: from the partner to the tree, (C, 3).
    :param least: least normal velocity of each contact at the end [m/s], (C,).
    :param mass: largest effective mass of a contact [kg], (C,). That of a tree grows without
        bound close to a joint; the bound admits slow penetration there instead of huge impulses.
    :param friction: Coulomb coefficient, (C,).
    :param velocity: of the points on trees [m/s], (E, 3), sorted by tree; updated.
    :param first, place, count, response: as in the `ContactResponse` of the trees.
    :param total: impulses on the trees [N·s], (C, 3), that velocities already include; updated.
    """
    soft = np.empty(len(normal))
    friction = friction.copy()
    yielding = np.empty(len(normal))
    sliding = np.empty(len(normal))
    for c in range(len(normal)):
        _prepare(c, normal[c], partners, first, place, count, response, 1.0 / mass[c],
                 yielding, sliding, soft, friction)
    island = islands(partners, place, len(velocity))
    order = np.argsort(island, kind='mergesort')
    begin = 0
    for n in range(1, len(order) + 1):
        if n == len(order) or island[order[n]] != island[order[begin]]:
            _resolve_island(order[begin:n], normal, least, friction, partners, velocity, first,
                            place, count, response, yielding, sliding, soft, total)
            begin = n


@kernel
def slips(partners, velocity):
    """
    Compute the velocity of the tree relative to its partner at each contact [m/s], (C, 3).

    :param velocity: of the points on trees [m/s], (E, 3).
    """
    out = np.empty((len(partners.end), 3))
    for c in range(len(out)):
        out[c, 0], out[c, 1], out[c, 2] = _slip(c, partners, velocity)
    return out


@kernel
def islands(partners, place, ends):
    """
    Label the islands of contacts, connected by trees or movable bodies, (C,).

    :param place: index of each point among those on its tree, (E,), see `ContactResponse`.
    :param ends: number of points, E.
    """
    island = np.arange(len(partners.end))
    last = np.full(ends + len(partners.inverse_mass), -1, np.int64)
    for c in range(len(island)):
        end, other, b = partners.end[c], partners.other[c], partners.body[c]
        if b >= 0 and partners.inverse_mass[b] == 0.0:
            b = -1
        for key in (end - place[end], other - place[other] if other >= 0 else -1,
                    ends + b if b >= 0 else -1):
            if key < 0:
                continue
            if last[key] >= 0:
                one, two = _first_of(last[key], island), _first_of(c, island)
                island[max(one, two)] = min(one, two)
            last[key] = c
    for c in range(len(island)):
        island[c] = _first_of(c, island)
    return island


@subroutine
def _first_of(c, island):
    while island[c] != c:
        c = island[c]
    return c


@subroutine
def _resolve_island(chosen, normal, least, friction, partners, velocity, first, place, count,
                    response, yielding, sliding, soft, total):
    """Iterate over the contacts of an island until their velocities converge."""
    fastest = 0.0
    for c in chosen:
        fastest = max(fastest, least[c] - _along(normal, c, _slip(c, partners, velocity)))
    enough = max(_CONVERGED, _TURN * fastest)
    for _ in range(_ITERATIONS):
        worst = 0.0
        for c in chosen:
            x, y, z = _correct(c, normal, least[c], friction[c], yielding[c], sliding[c], soft[c],
                               total, _slip(c, partners, velocity))
            if x == 0.0 and y == 0.0 and z == 0.0:
                continue
            softest = max(yielding[c], sliding[c] if sliding[c] < np.inf else 0.0)
            worst = max(worst, math.sqrt(x * x + y * y + z * z) * softest)
            total[c, 0] += x
            total[c, 1] += y
            total[c, 2] += z
            _exert(c, x, y, z, partners, velocity, first, place, count, response)
        if worst < enough:
            break


@subroutine
def _correct(c, normal, least, friction, yielding, sliding, soft, total, slip):
    """Compute the change of impulse that corrects a contact, within the friction cone."""
    nx, ny, nz = normal[c, 0], normal[c, 1], normal[c, 2]
    before = _along(normal, c, (total[c, 0], total[c, 1], total[c, 2]))
    closing = _along(normal, c, slip)
    push = max(0.0, before + (least - closing - soft * before) / yielding)
    if push == 0.0:
        return -total[c, 0], -total[c, 1], -total[c, 2]
    x = total[c, 0] - before * nx - (slip[0] - closing * nx) / sliding
    y = total[c, 1] - before * ny - (slip[1] - closing * ny) / sliding
    z = total[c, 2] - before * nz - (slip[2] - closing * nz) / sliding
    size = math.sqrt(x * x + y * y + z * z)
    share = friction * push / size if size > friction * push else 1.0
    return (share * x + push * nx - total[c, 0], share * y + push * ny - total[c, 1],
            share * z + push * nz - total[c, 2])


@subroutine
def _along(normal, c, v):
    return normal[c, 0] * v[0] + normal[c, 1] * v[1] + normal[c, 2] * v[2]


@subroutine
def _slip(c, partners, velocity):
    """Return the velocity of the tree relative to its partner at contact c."""
    end, other, b = partners.end[c], partners.other[c], partners.body[c]
    x, y, z = velocity[end, 0], velocity[end, 1], velocity[end, 2]
    if other >= 0:
        x -= velocity[other, 0]
        y -= velocity[other, 1]
        z -= velocity[other, 2]
    if b >= 0:
        v, arm = partners.motion, partners.arm
        x -= v[b, 0] + v[b, 4] * arm[c, 2] - v[b, 5] * arm[c, 1]
        y -= v[b, 1] + v[b, 5] * arm[c, 0] - v[b, 3] * arm[c, 2]
        z -= v[b, 2] + v[b, 3] * arm[c, 1] - v[b, 4] * arm[c, 0]
    return x, y, z


@subroutine
def _exert(c, x, y, z, partners, velocity, first, place, count, response):
    """Apply an impulse at contact c to the tree, and its opposite to the partner."""
    other, b = partners.other[c], partners.body[c]
    _move(partners.end[c], x, y, z, velocity, first, place, count, response)
    if other >= 0:
        _move(other, -x, -y, -z, velocity, first, place, count, response)
    if b >= 0 and partners.inverse_mass[b] > 0.0:
        v, arm, spin = partners.motion, partners.arm, partners.inverse_inertia
        v[b, 0] -= partners.inverse_mass[b] * x
        v[b, 1] -= partners.inverse_mass[b] * y
        v[b, 2] -= partners.inverse_mass[b] * z
        tx = arm[c, 1] * z - arm[c, 2] * y
        ty = arm[c, 2] * x - arm[c, 0] * z
        tz = arm[c, 0] * y - arm[c, 1] * x
        for i in range(3):
            v[b, 3 + i] -= spin[b, i, 0] * tx + spin[b, i, 1] * ty + spin[b, i, 2] * tz


@subroutine
def _move(end, x, y, z, velocity, first, place, count, response):
    """Update the velocities of all points on the tree of an end for an impulse there."""
    start, n = end - place[end], count[end]
    row = first[end] + place[end]
    for p in range(n):
        k = row + p * n
        for i in range(3):
            velocity[start + p, i] += (response[k, i, 0] * x + response[k, i, 1] * y
                                       + response[k, i, 2] * z)


@subroutine
def _prepare(c, n, partners, first, place, count, response, floor, yielding, sliding, soft,
             friction):
    """
    Compute the inverse effective masses of a contact, normal and largest tangential [1/kg].

    Both are set to infinity where the contact is immovable, so that no impulse acts: a straight
    pole pushed along its axis, for example. Responses below the floor count as the floor; the
    difference makes the contact soft. Friction that would close the contact faster than its
    normal impulse opens it has no solution (Painlevé's paradox), and is limited to half of that.
    """
    full = np.zeros((3, 3))
    for end in (partners.end[c], partners.other[c]):
        if end >= 0:
            full += response[first[end] + place[end] * count[end] + place[end]]
    b = partners.body[c]
    if b >= 0 and partners.inverse_mass[b] > 0.0:
        r = partners.arm[c]
        cross = np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
        full += partners.inverse_mass[b] * np.eye(3)
        full -= product(product(cross, partners.inverse_inertia[b]), cross)
    k = np.argmin(np.abs(n))
    t = -n[k] * n
    t[k] += 1.0
    t /= np.sqrt((t ** 2).sum())
    s = np.array([n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2],
                  n[0] * t[1] - n[1] * t[0]])
    of_n, of_t, of_s = transformed(full, n), transformed(full, t), transformed(full, s)
    yielding[c] = dot(n, of_n)
    tt, ss, ts = dot(t, of_t), dot(s, of_s), dot(t, of_s)
    sliding[c] = 0.5 * (tt + ss) + np.sqrt(0.25 * (tt - ss) ** 2 + ts ** 2)
    least = max(_IMMOVABLE, _RIGID * max(yielding[c], sliding[c]))
    if not yielding[c] > least:
        yielding[c] = np.inf
    if not sliding[c] > least:
        sliding[c] = np.inf
    jam = np.sqrt(dot(t, of_n) ** 2 + dot(s, of_n) ** 2)
    friction[c] = min(friction[c], 0.5 * yielding[c] / max(jam, 1e-300))
    soft[c] = max(floor - yielding[c], 0.0)
    yielding[c] = max(yielding[c], floor)
    sliding[c] = max(sliding[c], floor)
