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

"""Blows: how long the contacts last that the engine makes in one step, and their energy."""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.world import Contacts
from procphys_ros.simulation.contact_forces import BodyContacts

_STILL = 1e-6  # [m/s] change of closing speed below which a contact only bears


class Blows(NamedTuple):
    """
    The contacts of a step, and what they did to the motion of the bodies.

    :ivar contacts: of the step.
    :ivar energy: of the change of motion of the first and the second body: half of the impulse on
        it times the change of its velocity there [J], (C, 2); their sum is taken from the motion.
    :ivar duration: how long each lasts [s], (C,).
    """

    contacts: Contacts
    energy: np.ndarray
    duration: np.ndarray


class Blow(NamedTuple):
    """
    A blow on a piece.

    :ivar body: id.
    :ivar parts: what it carries, (P,).
    :ivar contacts: of the body; None = not selected yet.
    :ivar energy: of the motion that these stop [J], see `energies`; inf = they last.
    :ivar rows: of all contacts, of which they are to be selected.
    """

    body: int
    parts: np.ndarray
    contacts: BodyContacts | None
    energy: float
    rows: np.ndarray


def measure(contacts: Contacts, change: np.ndarray, start: np.ndarray, dt: float) -> Blows:
    """
    Find energy and duration of contacts.

    The mass that a contact stops is its impulse over the change of the closing speed that all
    contacts together made where it is: the reduced mass of two free bodies, a share of a body
    that lands on several others, and all of what presses on a body that is squeezed and cannot
    yield. The engine ends every contact within its step, so none lasts longer.

    :param contacts: of the step.
    :param change: of velocity and spin by contacts, world axes, by id [m/s], [rad/s], (B, 6).
    :param start: poses of the bodies at the start of the step, by id, (B, 7).
    :param dt: length of the step [s].
    """
    energy, mass = _measure(contacts.body_a, contacts.body_b,
                            np.ascontiguousarray(contacts.point),
                            np.ascontiguousarray(contacts.impulse), change, start)
    return Blows(contacts, energy, np.minimum(contact_time(mass), dt))


@kernel
def energies(energy, other, ends):
    """
    Give the energy of the motion that the contacts of bodies stop [J], (K,).

    It is that of the change of the body's own motion: a piece that lands together with what lies
    below it is stopped by it, however little they move against each other. Bodies that it strikes,
    and that give way to it, add their shares, so that two free ones both get the energy of their
    reduced mass.

    :param energy: of these bodies and of the others in each contact [J], (R, 2).
    :param other: what touches, ids, (R,).
    :param ends: where the contacts of each body start, and the end, (K + 1,).
    """
    out, given = np.zeros(len(ends) - 1), np.zeros(other.max() + 1)
    for k in range(len(out)):
        for c in range(ends[k], ends[k + 1]):
            out[k] += energy[c, 0]
            given[other[c]] += energy[c, 1]
        out[k] = max(out[k], 0.0)
        for c in range(ends[k], ends[k + 1]):
            out[k] += max(given[other[c]], 0.0)
            given[other[c]] = 0.0
    return out


@kernel
def _measure(first, second, point, impulse, change, start):
    """Give the energy of both bodies in each contact, (C, 2), and the mass it stops, (C,)."""
    energy, mass = np.zeros((len(first), 2)), np.full(len(first), np.inf)
    for c in range(len(first)):
        for side, body, half in ((0, first[c], 0.5), (1, second[c], -0.5)):
            u, v, w = change[body, 3], change[body, 4], change[body, 5]
            x = point[c, 0] - start[body, 0]
            y = point[c, 1] - start[body, 1]
            z = point[c, 2] - start[body, 2]
            energy[c, side] = half * ((change[body, 0] + v * z - w * y) * impulse[c, 0]
                                      + (change[body, 1] + w * x - u * z) * impulse[c, 1]
                                      + (change[body, 2] + u * y - v * x) * impulse[c, 2])
        size = (impulse[c, 0] ** 2 + impulse[c, 1] ** 2 + impulse[c, 2] ** 2) ** 0.5
        closing = 2.0 * energy[c].sum() / max(size, 1e-12)
        if closing > _STILL:
            mass[c] = size / closing
    return energy, mass
