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

"""Bearing: what debris does to masonry that stands, by lying on it and by hitting it."""

from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.touch import overlaps
from procphys_ros.physics.world import Contacts, State, World
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.standing.blows import Blows, CONTACT
from procphys_ros.simulation.standing.obstacles import sorted_into_cells
from procphys_ros.simulation.standing.standing_loads import StandingLoads

_SMOOTHING = 0.1  # [s] over which impulses of moving bodies count as a steady load: about two
#                   periods of a storey-high wall, which feels shorter ones as their mean
_INTERVAL = 0.1   # [s] between looks at what lies on what
_CHANGE = 0.05    # of the largest load: smaller changes are not worth new stresses, ...
_LEAST = 100.0    # [N] ... nor are those far below the strength of a brick's joints, some kN
_KNOCKS = 20      # bricks knocked out in one step at most, the hardest hit first
_GRAIN = 1e-9     # [N·s] keeps directions finite
_DEEPEST = 30     # bodies on top of each other through which weight is followed
_ROOM = 0.1       # [m] around bodies, more than they move in a contact
_LAYER = 'debris'


class Knock(NamedTuple):
    """
    A standing part that a hit drives out.

    :ivar part: index.
    :ivar share: of the impulse that its bonds passed on before they broke, 0 to 1.
    """

    part: int
    share: float


class Bearing:
    """
    Loads standing masonry with debris, and knocks parts out of it.

    :param blueprint: all parts of the scene.
    :param blows: on masonry.
    :param loads: on what stands.
    :param gravity: downward acceleration [m/s²].
    """

    def __init__(self, blueprint: Blueprint, blows: Blows, loads: StandingLoads, gravity: float):
        self._blueprint = blueprint
        self._blows = blows
        self._loads = loads
        self._gravity = gravity

    def begin(self, world: World, debris: Debris) -> None:
        """Start anew in a world that has just been built."""
        self._world = world
        self._debris = debris
        self._moving = np.zeros((len(self._blueprint), 6))
        self._given = np.zeros((len(self._blueprint), 6))
        self._since = 0.0
        standing = np.flatnonzero(self._blows.buildings.body >= 0)
        self._part = np.full(len(world.bodies.state), -1, np.intp)
        self._part[self._blows.buildings.body[standing]] = standing
        place = self._blueprint.poses[standing, :3]
        room = 0.5 * np.linalg.norm(self._blueprint.size[standing], axis=1)[:, None]
        self._cells = sorted_into_cells(np.hstack([place - room, place + room]))[1]

    @property
    def any_stands(self) -> bool:
        """Say whether any masonry still stands."""
        return bool(self._blows.buildings.standing.any())

    def body(self, part: int) -> int:
        """Give the id of the body of a standing part."""
        return int(self._blows.buildings.body[part])

    def standing_parts(self, bodies: np.ndarray) -> np.ndarray:
        """Give the standing part of each body, -1 for those that are none, (K,)."""
        known = bodies < len(self._part)
        part = np.where(known, self._part[np.where(known, bodies, 0)], -1)
        held = self._world.bodies.state[bodies] == State.HELD
        return np.where(held & self._blows.buildings.standing[part], part, -1)

    def press(self, time_step: float) -> None:
        """
        Note in every step what moving debris presses on, and renew its loads from time to time.

        :param time_step: [s].
        """
        if not (self._debris.body_count or self._given.any()) or not self.any_stands:
            return
        self._moving *= np.exp(-time_step / _SMOOTHING)
        if self.any_near:
            share = -np.expm1(-time_step / _SMOOTHING) / time_step
            self._add_contacts(self._world.contacts(), share)
        self._since += time_step
        if self._since < _INTERVAL - 1e-9:
            return
        self._since = 0.0
        total = self._moving + self._resting()
        largest = np.abs(total[:, :3]).max(initial=0.0)
        change = np.abs(total[:, :3] - self._given[:, :3]).max(initial=0.0)
        quiet = not len(self._world.awake) and np.abs(self._moving).max() < 1.0
        if change > (1.0 if quiet else max(_CHANGE * largest, _LEAST)):
            self._given = total
            parts = np.flatnonzero(total.any(axis=1))
            self._loads.put(_LAYER, parts, total[parts])

    @property
    def any_near(self) -> bool:
        """Say whether anything that moves may touch masonry; reading contacts is dear."""
        bodies, awake = self._world.bodies, self._world.awake
        place, room = bodies.poses[awake, :3], bodies.radius[awake, None] + _ROOM
        return len(overlaps(np.hstack([place - room, place + room]), self._cells)[0]) > 0

    def knocks(self, contacts: Contacts, struck: np.ndarray) -> list[Knock]:
        """
        List the standing parts that the hits of the last step drive out.

        :param contacts: of the last step.
        :param struck: bodies that contacts stopped or pushed, by id, (B,) bool.
        """
        part = self._touched(contacts)
        rows = np.flatnonzero((part >= 0) & (struck[contacts.body_a] | struck[contacts.body_b]))
        if not len(rows):
            return []
        sign = np.where(self.standing_parts(contacts.body_a[rows]) >= 0, 1.0, -1.0)
        hit, place = np.unique(part[rows], return_inverse=True)
        total = np.zeros((len(hit), 3))
        np.add.at(total, place, sign[:, None] * contacts.impulse[rows])
        size = np.linalg.norm(total, axis=1)
        out = []
        for n in np.argsort(-size, kind='stable')[:_KNOCKS].tolist():
            if size[n] < _GRAIN:
                break
            chosen = hit[[n]]
            resistance = self._blows.resistance(chosen, total[n] / size[n])
            mass = float(self._blueprint.mass[hit[n]])
            if self._blows.gives_way(resistance, size[n], mass, size[n] / mass) is not None:
                out.append(Knock(int(hit[n]), min(resistance.momentum(CONTACT) / size[n], 1.0)))
        return out

    def knock_out(self, knocks: list[Knock], time: float) -> None:
        """
        Set parts free, at rest: what hit them goes on and meets them in the next step.

        :param knocks: from `knocks`, after their impulses were taken back.
        :param time: of the simulation [s].
        """
        for knock in knocks:
            self._blows.tear_out(np.array([knock.part]), np.zeros((1, 6)), Cause.IMPACT,
                                 1.0 / max(knock.share, 1e-3), time)

    def _touched(self, contacts: Contacts) -> np.ndarray:
        return np.maximum(self.standing_parts(contacts.body_a),
                          self.standing_parts(contacts.body_b))

    def _add_contacts(self, contacts: Contacts, rate: float) -> None:
        """Add impulses times a rate to what moving bodies press with."""
        part = self._touched(contacts)
        rows = np.flatnonzero(part >= 0)
        sign = np.where(self.standing_parts(contacts.body_a[rows]) >= 0, rate, -rate)
        force = sign[:, None] * contacts.impulse[rows]
        arm = contacts.point[rows] - self._blueprint.poses[part[rows], :3]
        np.add.at(self._moving, part[rows], np.hstack([force, np.cross(arm, force)]))

    def _resting(self) -> np.ndarray:
        """
        Give what lies on standing parts, (N, 6).

        Weight goes from body to body along the contacts on which they came to rest, in the shares
        that these had then.
        """
        out = np.zeros((len(self._blueprint), 6))
        supports, bodies = self._world.supports, self._world.bodies
        part = self.standing_parts(supports.support)
        rows = np.flatnonzero(part >= 0)
        if not len(rows):
            return out
        weight = np.where(bodies.state == State.RESTING, bodies.mass * self._gravity, 0.0)
        load = weight.copy()
        for _ in range(_DEEPEST):
            arriving = np.bincount(supports.support, supports.share * load[supports.resting],
                                   len(weight))
            passed = np.where(bodies.state == State.RESTING, weight + arriving, 0.0)
            if np.allclose(passed, load, rtol=1e-3, atol=1.0):
                break
            load = passed
        down = -supports.share[rows] * load[supports.resting[rows]]
        force = np.zeros((len(rows), 3))
        force[:, 2] = down
        arm = supports.point[rows] - self._blueprint.poses[part[rows], :3]
        np.add.at(out, part[rows], np.hstack([force, np.cross(arm, force)]))
        return out
