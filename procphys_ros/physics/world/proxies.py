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

"""Proxies: capsules that stand in for pieces of trees, whose dynamics live elsewhere."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.physics.world.bodies import State
from procphys_ros.physics.world.contacts import Contacts
from procphys_ros.physics.world.world import World

_STIFF_TURN = 1e6  # moment of inertia of a proxy over mass times length squared: it cannot turn,
#                    so that a contact anywhere on it feels its mass, which is the effective one


@dataclass(frozen=True)
class Hits:
    """
    What hit the proxies in one step, one row per contact.

    :ivar key: of the piece, (C,) int.
    :ivar other: id of the body that touches it, (C,) int.
    :ivar point: where, world [m], (C, 3).
    :ivar impulse: on the piece, world [N·s], (C, 3).
    """

    key: np.ndarray
    other: np.ndarray
    point: np.ndarray
    impulse: np.ndarray


class Proxies:
    """
    Capsules with the effective mass that a piece of a tree has at a contact.

    Each piece keeps its capsule once it had one; capsules that are not in use meet nothing and
    cost nothing.

    :param world: where loose bodies live.
    """

    def __init__(self, world: World):
        self._world = world
        self._body: dict[int, int] = {}
        self._key: dict[int, int] = {}
        self._active: set[int] = set()

    def place(self, keys: np.ndarray, poses: np.ndarray, velocities: np.ndarray,
              masses: np.ndarray, sizes: np.ndarray, time_step: float) -> None:
        """
        Set the capsules of the pieces near loose bodies for the next step; all others leave.

        :param keys: what names each piece, (K,) int.
        :param poses: of the pieces, (K, 7).
        :param velocities: that they would have after the step without contact, world, (K, 6).
        :param masses: effective mass at the expected contact [kg], (K,).
        :param sizes: capsules as in `Blueprint.size` [m], (K, 3); a key keeps its size.
        :param time_step: of the next step [s].
        """
        wanted = [int(key) for key in keys]
        for key in self._active.difference(wanted):
            self._world.park(self._body[key])
        for row, key in enumerate(wanted):
            if key not in self._body:
                body = self._world.add_proxy(sizes[row], poses[row])
                self._body[key], self._key[body] = body, key
            self._world.set_proxy(
                self._body[key], poses[row], velocities[row], float(masses[row]),
                _STIFF_TURN * float(masses[row]) * float(sizes[row, 2]) ** 2,
                time_step)
        self._active = set(wanted)

    def hits(self, contacts: Contacts) -> Hits:
        """Give what touched the proxies in the last step."""
        state = self._world.bodies.state
        both = contacts.both_ways()
        row = np.flatnonzero((state[both.body_a] == State.PROXY)
                             & (np.abs(both.impulse).max(axis=1, initial=0.0) > 0.0))
        keys = np.array([self._key[body] for body in both.body_a[row].tolist()], np.intp)
        return Hits(keys, both.body_b[row], both.point[row], both.impulse[row])
