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

"""Dust of a scene: it rises where mortar bursts and where masonry and missiles hit hard."""

import numpy as np

from procphys_ros.blueprint import Blueprint, Law
from procphys_ros.physics.dust import (
    DustCloud,
    fracture_energy,
    lost_energy,
    Mode,
    motion_energy,
)
from procphys_ros.physics.wind import Wind
from procphys_ros.physics.world import State, World
from procphys_ros.simulation.events import Cause, EventLog

_HARD = 1.0  # [m/s] slower things make no dust when they touch; what rests shall not smoke
_FREE_LOSS = 0.02  # of the energy that a body may lose in a step without having hit anything
_HIT_SPREAD = 0.3  # of a body's radius, around the place where it hit
_SEED = 104  # told apart from other random things by the scene's own seed
_MODES = np.full(len(Cause), Mode.OPENED)
_MODES[[Cause.SHEAR, Cause.IMPACT, Cause.BLAST]] = Mode.SHEARED
_MODES[[Cause.COMPRESSION, Cause.DEMOLITION]] = Mode.CRUSHED


class Dust:
    """
    Watches what breaks and hits, and lets dust rise from it.

    :param blueprint: all parts and bonds of the scene.
    :param capacity: number of puffs that there can be.
    :param gravity: downward acceleration [m/s²].
    :param seed: of everything random about dust.

    :ivar cloud: all puffs.
    """

    def __init__(self, blueprint: Blueprint, capacity: int, gravity: float, seed: int):
        self._blueprint = blueprint
        self._gravity = gravity
        self._mortar = blueprint.bond_law == Law.MORTAR
        pairs = blueprint.bonds[~self._mortar]
        self._wooden = np.unique(pairs[pairs >= 0])
        self.cloud = DustCloud(capacity, (_SEED << 64) + seed, gravity)
        self._seen = 0
        self._watched = np.zeros(0, np.intp)
        self._velocities = np.zeros((0, 6))
        self._height = np.zeros(0)

    def reset(self, log: EventLog) -> None:
        """Clear the air; what the log holds already makes no dust any more."""
        self.cloud.clear()
        self._seen = log.total

    def watch(self, world: World) -> None:
        """Note how everything loose moves just before it may hit something."""
        self._watched = world.awake
        self._velocities = world.bodies.velocities[self._watched].copy()
        self._height = world.bodies.poses[self._watched, 2].copy()

    def rise(self, world: World, carrier: np.ndarray, log: EventLog, time_step: float) -> None:
        """
        Let dust rise from what broke and hit in this step.

        :param world: just stepped.
        :param carrier: body of the world that carries each part, -1 for none, (N,).
        :param log: everything that broke.
        :param time_step: [s].
        """
        self._from_fractures(log)
        if len(self._watched):
            self._from_impacts(world, carrier, time_step)

    def drift(self, wind: Wind, time: float, time_step: float) -> None:
        """Move the dust on by one step."""
        self.cloud.step(time_step, lambda points: wind.velocity(points, time))

    def _from_fractures(self, log: EventLog) -> None:
        new, self._seen = log.total - self._seen, log.total
        if new <= 0:
            return
        events = log.rows[-new:]
        events = events[self._mortar[events['bond']]]
        bond = events['bond']
        energy = fracture_energy(_MODES[events['cause']], self._blueprint.bond_area[bond])
        spread = 0.3 * self._blueprint.bond_extent[bond].max(axis=1, initial=0.0)
        self.cloud.raise_dust(events['position'], spread, energy)

    def _from_impacts(self, world: World, carrier: np.ndarray, time_step: float) -> None:
        bodies, watched = world.bodies, self._watched
        free = self._velocities  # turned into what they would be if nothing had been in the way
        free[:, 2] -= self._gravity * time_step
        fast = (free[:, :3] ** 2).sum(axis=1) > _HARD ** 2
        if not fast.any():
            return
        after = bodies.velocities[watched]
        was, now = (motion_energy(bodies.mass[watched], bodies.inertia[watched],
                                  bodies.poses[watched, 3:], v) for v in (free, after))
        lift = bodies.poses[watched, 2] - self._height - free[:, 2] * time_step
        now += bodies.mass[watched] * self._gravity * lift
        hit = fast & (was - now > _FREE_LOSS * was) & (bodies.state[watched] < State.DRIVEN)
        of_wood = np.zeros(len(bodies.state) + 1, bool)
        of_wood[carrier[self._wooden]] = True  # the last row for those that no body carries
        hit &= ~of_wood[watched]
        if not hit.any():
            return
        started = np.setdiff1d(world.awake, watched)
        gained = motion_energy(bodies.mass[started], bodies.inertia[started],
                               bodies.poses[started, 3:], bodies.velocities[started]).sum()
        energy = lost_energy(was, now, gained)[hit]
        kick = (after - free)[hit, :3]  # away from what it hit
        kick /= np.maximum(np.linalg.norm(kick, axis=1, keepdims=True), 1e-9)
        radius = bodies.radius[watched[hit]]
        place = bodies.poses[watched[hit], :3] - radius[:, None] * kick
        place[:, 2] = np.maximum(place[:, 2], 0.0)
        self.cloud.raise_dust(place, _HIT_SPREAD * radius, energy)
