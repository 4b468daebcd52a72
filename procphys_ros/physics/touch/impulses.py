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
Impulses: what contacts must exert so that nothing goes through anything, friction included.

Projected Gauss-Seidel on velocities (Catto 2005, Iterative Dynamics with Temporal Coherence): each
contact in turn corrects its normal velocity by an impulse that only pushes, and its sliding by one
inside the cone of friction. Trees answer with the response matrices that their kernel foresees,
rigid bodies with mass and inertia, all else not at all.
"""

from typing import NamedTuple

from numba import njit
import numpy as np

_ITERATIONS = 40
_CONVERGED = 1e-6  # largest change of velocity at a contact in one turn [m/s] that ends the turns
_TURN = 3e-3       # of the largest speed at the beginning, likewise


class Partners(NamedTuple):
    """
    What meets in each contact.

    :ivar end: point on a tree, row of the foresight, (C,).
    :ivar other: point on another tree, or -1, (C,).
    :ivar body: rigid body, row of the columns below, or -1, (C,).
    :ivar arm: from the centre of mass of this body [m], (C, 3), world.
    :ivar inverse_mass: of the bodies [1/kg], 0 for those that do not yield, (B,).
    :ivar inverse_inertia: likewise [1/(kg·m²)], world axes, (B, 3, 3).
    :ivar motion: velocities that they would have without contact, (B, 6); changed.
    """

    end: np.ndarray
    other: np.ndarray
    body: np.ndarray
    arm: np.ndarray
    inverse_mass: np.ndarray
    inverse_inertia: np.ndarray
    motion: np.ndarray


@njit(cache=True)
def resolve(normal, least, friction, partners, velocity, first, place, count, response):
    """
    Find the impulses of all contacts.

    :param normal: from the partner to the tree, (C, 3).
    :param least: normal velocity that each contact must have at the end [m/s], (C,).
    :param friction: Coulomb coefficient, (C,).
    :param velocity: of the points on trees without contact [m/s], (E, 3), the points of a tree
        one after the other; changed to that with.
    :param first, place, count, response: as in the foresight of the trees.
    :returns: impulses on the trees [N·s], (C, 3).
    """
    total = np.zeros_like(normal)
    yielding = np.empty(len(normal))
    sliding = np.empty(len(normal))
    fastest = 0.0
    for c in range(len(normal)):
        _prepare(c, normal[c], partners, first, place, count, response, yielding, sliding)
        fastest = max(fastest, least[c] - (normal[c] * _slip(c, partners, velocity)).sum())
    enough = max(_CONVERGED, _TURN * fastest)
    for _ in range(_ITERATIONS):
        worst = 0.0
        for c in range(len(normal)):
            n = normal[c]
            slip = _slip(c, partners, velocity)
            before = (total[c] * n).sum()
            push = max(0.0, before + (least[c] - (slip * n).sum()) / yielding[c])
            worst = max(worst, abs(push - before) * yielding[c])
            _exert(c, (push - before) * n, total, partners, velocity, first, place, count,
                   response)
            if push == 0.0 and before == 0.0:
                continue
            slip = _slip(c, partners, velocity)
            tangent = total[c] - push * n
            wanted = tangent - (slip - (slip * n).sum() * n) / sliding[c]
            size = np.sqrt((wanted ** 2).sum())
            if size > friction[c] * push:
                wanted = wanted * (friction[c] * push / size)
            worst = max(worst, np.sqrt(((wanted - tangent) ** 2).sum()) * sliding[c])
            _exert(c, wanted - tangent, total, partners, velocity, first, place, count, response)
        if worst < enough:
            break
    return total


@njit(cache=True)
def _slip(c, partners, velocity):
    """Give the velocity of the tree relative to its partner at contact c."""
    slip = velocity[partners.end[c]].copy()
    if partners.other[c] >= 0:
        slip -= velocity[partners.other[c]]
    if partners.body[c] >= 0:
        v, r = partners.motion[partners.body[c]], partners.arm[c]
        slip[0] -= v[0] + v[4] * r[2] - v[5] * r[1]
        slip[1] -= v[1] + v[5] * r[0] - v[3] * r[2]
        slip[2] -= v[2] + v[3] * r[1] - v[4] * r[0]
    return slip


@njit(cache=True)
def _exert(c, impulse, total, partners, velocity, first, place, count, response):
    """Let contact c push its partners apart."""
    total[c] += impulse
    _move(partners.end[c], impulse, velocity, first, place, count, response)
    if partners.other[c] >= 0:
        _move(partners.other[c], -impulse, velocity, first, place, count, response)
    b = partners.body[c]
    if b >= 0 and partners.inverse_mass[b] > 0.0:
        v, r = partners.motion[b], partners.arm[c]
        v[:3] -= partners.inverse_mass[b] * impulse
        turn = np.array([r[1] * impulse[2] - r[2] * impulse[1],
                         r[2] * impulse[0] - r[0] * impulse[2],
                         r[0] * impulse[1] - r[1] * impulse[0]])
        v[3:] -= partners.inverse_inertia[b] @ turn


@njit(cache=True)
def _move(end, impulse, velocity, first, place, count, response):
    """Let all points on the tree of an end answer to an impulse there."""
    start = end - place[end]
    x, y, z = impulse[0], impulse[1], impulse[2]
    for p in range(count[end]):
        w = response[first[end] + p * count[end] + place[end]]
        for i in range(3):
            velocity[start + p, i] += w[i, 0] * x + w[i, 1] * y + w[i, 2] * z


@njit(cache=True)
def _prepare(c, n, partners, first, place, count, response, yielding, sliding):
    """Work out how a contact yields along its normal, and at most across it [1/kg]."""
    full = np.zeros((3, 3))
    for end in (partners.end[c], partners.other[c]):
        if end >= 0:
            full += response[first[end] + place[end] * count[end] + place[end]]
    b = partners.body[c]
    if b >= 0 and partners.inverse_mass[b] > 0.0:
        r = partners.arm[c]
        cross = np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
        full += partners.inverse_mass[b] * np.eye(3) - cross @ partners.inverse_inertia[b] @ cross
    k = np.argmin(np.abs(n))
    t = -n[k] * n
    t[k] += 1.0
    t /= np.sqrt((t ** 2).sum())
    s = np.array([n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2],
                  n[0] * t[1] - n[1] * t[0]])
    yielding[c] = (n * (full @ n)).sum()
    tt, ss, ts = (t * (full @ t)).sum(), (s * (full @ s)).sum(), (t * (full @ s)).sum()
    sliding[c] = 0.5 * (tt + ss) + np.sqrt(0.25 * (tt - ss) ** 2 + ts ** 2)
