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
from procphys_ros.physics.impact import contact_time, FACES
from procphys_ros.physics.kinetic import free_spins
from procphys_ros.physics.world import Contacts, World

LEAST_JUMP = 0.5  # [m/s] change of speed by contacts that is not a blow: three times that of
#                   gravity in a step, so that resting or pushed bodies are never judged
_SQUARE = np.sqrt(2.0 / np.pi)  # radius of a circle over half the diagonal of a square of equal
#                               area
STILL = 1e-6  # [m/s] change of closing speed below which a contact only transmits force
_LONGEST = 1.0 / 60.0  # [s] limit of a blow: engines end contacts of tonnes sooner than Hertz
_TURNS = 40  # iterations at most in which forces are transmitted through contacts ...
_SAME = 0.01  # ... until no force changes by more than this share of that of the longest contact


class Blows(NamedTuple):
    """
    The contacts of a step, and the change of motion they caused.

    :ivar contacts: of the step.
    :ivar energy: of the change of motion of the first and the second body: half of the impulse on
        it times its change of velocity there [J], (C, 2); their sum is lost by the motion.
    :ivar duration: how long each lasts [s], (C,).
    """

    contacts: Contacts
    energy: np.ndarray
    duration: np.ndarray


def change_by_contacts(world: World, poses: np.ndarray, velocities: np.ndarray,
                       duration: float) -> np.ndarray:
    """
    Compute the change of velocity by contacts, by id, 0 for immovable bodies, (B, 6).

    :param poses, velocities: of all bodies at the start, (B, 7) and (B, 6).
    :param duration: since then, in which gravity acted [s].
    """
    bodies, awake = world.bodies, world.awake
    out = np.zeros((len(bodies.state), 6))
    free = velocities[awake]
    free[:, 3:] = free_spins(bodies.inertia[awake], poses[awake, 3:], bodies.poses[awake, 3:],
                             np.ascontiguousarray(free[:, 3:]))
    free[:, :3] += world.gravity * duration
    out[awake] = bodies.velocities[awake] - free
    return out


def struck_bodies(world: World, change: np.ndarray) -> np.ndarray:
    """Mark the bodies whose motion contacts changed abruptly, (B,) bool."""
    out, own = np.zeros(len(change), bool), change[world.awake]
    felt = (np.sqrt((own[:, :3] * own[:, :3]).sum(axis=1))
            + np.sqrt((own[:, 3:] * own[:, 3:]).sum(axis=1)) * world.bodies.radius[world.awake])
    out[world.awake] = felt > LEAST_JUMP
    return out


def measure(contacts: Contacts, change: np.ndarray, start: np.ndarray, loose: np.ndarray,
            fall: float, dt: float, uneven: float = FACES) -> Blows:
    """
    Compute energy and duration of contacts.

    The mass stopped by a contact is its impulse over the change of closing speed at its point by
    all contacts together: the reduced mass of two free bodies, a share of a body that lands on
    several others, and the whole load on a body that is squeezed and cannot yield. No contact
    lasts longer than `_LONGEST`, whatever the step.

    A contact that does not close only transmits the forces on its bodies, and takes as long as
    they do: under a body that is squeezed, and between bodies that land together. Contacts that
    carry weights last.

    :param contacts: of the step.
    :param change: of velocity and spin by contacts, world axes, by id [m/s], [rad/s], (B, 6).
    :param start: poses of the bodies at the start of the step, by id, (B, 7).
    :param loose: masses of the freely moving bodies, by id, 0 for all others [kg], (B,).
    :param fall: speed that gravity gives them in the step [m/s].
    :param dt: length of the step [s].
    :param uneven: see `contact_time` [m].
    """
    pairs, impulse = (contacts.body_a, contacts.body_b), np.ascontiguousarray(contacts.impulse)
    energy, lasting, size = _measure(*pairs, np.ascontiguousarray(contacts.point), impulse, change,
                                     start, np.where(loose > 0.0, fall, 0.0))
    mass, share = _closing(energy - lasting, size)
    patch = _patches(*pairs, np.ascontiguousarray(contacts.point), size, mass)
    rate = 1.0 / np.minimum(contact_time(mass, patch, size / mass, uneven),
                            _LONGEST)
    _pass_on(*pairs, size, share, loose, loose * fall, dt, rate)
    return Blows(contacts, energy, 1.0 / rate)


@kernel
def energies(energy, other, ends):
    """
    Return the energy of the motion that is stopped by the contacts of bodies [J], (K,).

    It is that of the change of the body's own motion: a piece that lands together with the one
    below is stopped by it, however little they move relative to each other. Struck bodies that
    yield add their shares, so that two free ones both get the energy of their reduced mass.

    :param energy: of these bodies and of the others in each contact [J], (R, 2).
    :param other: ids of the other bodies, (R,).
    :param ends: start of the contacts of each body, and their end, (K + 1,).
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
def _measure(first, second, point, impulse, change, start, fall):
    """
    Compute the energies of both bodies in each contact, (C, 2), those by support, and impulses.

    :param fall: downward speed that contacts prevented, by body id [m/s], (B,).
    :returns: both energies [J], and impulses [N·s], (C,).
    """
    energy, held = np.zeros((len(first), 2)), np.zeros((len(first), 2))
    size = np.zeros(len(first))
    for c in range(len(first)):
        for side, body, half in ((0, first[c], 0.5), (1, second[c], -0.5)):
            u, v, w = change[body, 3], change[body, 4], change[body, 5]
            x = point[c, 0] - start[body, 0]
            y = point[c, 1] - start[body, 1]
            z = point[c, 2] - start[body, 2]
            energy[c, side] = half * ((change[body, 0] + v * z - w * y) * impulse[c, 0]
                                      + (change[body, 1] + w * x - u * z) * impulse[c, 1]
                                      + (change[body, 2] + u * y - v * x) * impulse[c, 2])
            held[c, side] = half * fall[body] * impulse[c, 2]
        size[c] = np.sqrt(impulse[c, 0] ** 2 + impulse[c, 1] ** 2 + impulse[c, 2] ** 2)
    return energy, held, size


@kernel
def _closing(energy, size):
    """
    Compute how much the closing speed of contacts changes.

    :param energy: of both bodies in each contact [J], (C, 2).
    :param size: impulses [N·s], (C,).
    :returns: the mass that each stops [kg], and the share of its energy that it absorbs itself;
        it transmits the rest; (C,) each.
    """
    mass, share = np.full(len(size), np.inf), np.zeros(len(size))
    for c in range(len(size)):
        taken = energy[c, 0] + energy[c, 1]
        closing = 2.0 * taken / max(size[c], 1e-12)
        if closing > STILL:
            mass[c] = size[c] / closing
            share[c] = taken / (abs(energy[c, 0]) + abs(energy[c, 1]))
    return mass, share


@kernel
def _patches(first, second, point, size, mass):
    """
    Return the radii of patches of face contact over their share of the mass, (C,) [m].

    Consecutive points of the same bodies are one patch. Its radius is that of the circle with the
    area of a square whose corners are the points; a single point has none. Each point stops a
    share of the mass, with an equal share of the stiffness.

    :param size: impulses [N·s], (C,).
    :param mass: that each stops [kg], inf where it does not close, (C,).
    """
    out = np.zeros(len(first))
    low = 0
    while low < len(first):
        high, total, stopped = low, 0.0, 0.0
        x, y, z, square = 0.0, 0.0, 0.0, 0.0
        while high < len(first) and first[high] == first[low] and second[high] == second[low]:
            if mass[high] < np.inf:
                u, v, w = point[high, 0], point[high, 1], point[high, 2]
                u, v, w = u - point[low, 0], v - point[low, 1], w - point[low, 2]
                total, stopped = total + size[high], stopped + mass[high]
                x, y, z = x + size[high] * u, y + size[high] * v, z + size[high] * w
                square += size[high] * (u * u + v * v + w * w)
            high += 1
        if total > 0.0:
            spread = square / total - (x * x + y * y + z * z) / (total * total)
            radius = _SQUARE * np.sqrt(max(spread, 0.0))
            for c in range(low, high):
                if mass[c] < np.inf:
                    out[c] = radius * mass[c] / stopped
        low = high
    return out


@kernel
def _pass_on(first, second, size, share, loose, weight, dt, rate):
    """
    Set the rates of contacts that do not close to those of the loads on their bodies, in place.

    :param size: impulses [N·s], (C,).
    :param share: of the energy that each absorbs itself, see `_closing`, (C,).
    :param loose, weight: masses, 0 if immovable, and impulses of gravity in the step, by id, (B,).
    :param rate: force over impulse of each contact by itself [1/s], (C,).
    """
    pressed = weight.copy()
    force = weight / dt
    for c in range(len(first)):
        for body in (first[c], second[c]):
            pressed[body] += size[c]
            force[body] += size[c] * rate[c]
    own, passes = rate.copy(), np.flatnonzero((share < 1.0) & (size > 0.0))
    for turn in range(_TURNS):
        most = 0.0
        for n in range(len(passes)):
            c = passes[n if turn % 2 else len(passes) - 1 - n]
            total, count = 0.0, 0
            for body in (first[c], second[c]):
                if loose[body] > 0.0:
                    total += force[body] / pressed[body]
                    count += 1
            if not count:
                continue
            now = share[c] * own[c] + (1.0 - share[c]) * total / count
            change = now - rate[c]
            most = max(most, abs(change) * _LONGEST)
            rate[c] = now
            force[first[c]] += size[c] * change
            force[second[c]] += size[c] * change
        if most < _SAME:
            break
