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

from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.world import Contacts

_STILL = 1e-6  # [m/s] change of closing speed below which a contact only bears


class Blows(NamedTuple):
    """
    The contacts of a step, and what they did to the motion of the bodies.

    :ivar contacts: of the step.
    :ivar energy: that each takes from the motion [J], (C,).
    :ivar duration: how long each lasts [s], (C,).
    """

    contacts: Contacts
    energy: np.ndarray
    duration: np.ndarray


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
    impulse = contacts.impulse
    energy = np.zeros(len(impulse))
    for body, half in ((contacts.body_a, 0.5), (contacts.body_b, -0.5)):
        moved = change[body, :3] + np.cross(change[body, 3:], contacts.point - start[body, :3])
        energy += half * np.einsum('ki,ki->k', moved, impulse)
    size = np.sqrt(np.einsum('ki,ki->k', impulse, impulse))
    closing = 2.0 * energy / np.maximum(size, 1e-12)
    mass = np.where(closing > _STILL, size / np.maximum(closing, _STILL), np.inf)
    return Blows(contacts, energy, np.minimum(contact_time(mass), dt))
