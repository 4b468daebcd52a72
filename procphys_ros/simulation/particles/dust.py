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

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Blueprint, Law
from procphys_ros.physics.dust import DustCloud, fracture_energy, Mode
from procphys_ros.physics.skyline import OPEN
from procphys_ros.physics.wind import Wind
from procphys_ros.physics.world import World
from procphys_ros.simulation.events import Cause, EventLog
from procphys_ros.simulation.particles.hits import Hits
from procphys_ros.simulation.standing.buildings import Buildings
from procphys_ros.simulation.standing.roofs import Roofs
from procphys_ros.simulation.strikes.striking import Impact

_SEED = 104  # told apart from other random things by the scene's own seed
_MODES = np.full(len(Cause), Mode.OPENED)
_MODES[[Cause.SHEAR, Cause.IMPACT, Cause.BLAST, Cause.DEMOLITION]] = Mode.SHEARED  # torn out
_MODES[Cause.COMPRESSION] = Mode.CRUSHED


class Dust:
    """
    Watches what breaks and hits, and lets dust rise from it.

    :param blueprint: all parts and bonds of the scene.
    :param capacity: number of puffs that there can be.
    :param gravity: downward acceleration [m/s²].
    :param buildings: what dust settles on.
    :param seed: of everything random about dust.

    :ivar cloud: all puffs.
    """

    def __init__(self, blueprint: Blueprint, capacity: int, gravity: float, buildings: Buildings,
                 seed: int):
        self._blueprint = blueprint
        self._roofs, self._skyline = Roofs(blueprint, buildings), OPEN
        self._mortar = blueprint.bond_law == Law.MORTAR
        pairs = blueprint.bonds[~self._mortar]
        self._wooden = np.unique(pairs[pairs >= 0])
        self._stony = np.ones(len(blueprint), bool)
        self._stony[self._wooden] = False
        self.cloud = DustCloud(capacity, (_SEED << 64) + seed, gravity)
        self._hits = Hits(gravity)
        self._spared = np.zeros(1, bool)
        self._seen = self._struck = 0

    def reset(self, log: EventLog) -> None:
        """Clear the air; what the log holds already makes no dust any more."""
        self.cloud.clear()
        self._roofs.reset()
        self._skyline = OPEN
        self._hits.reset()
        self._seen, self._struck = log.total, 0

    def batter(self, world: World, carrier: np.ndarray, impacts: Sequence[Impact]) -> None:
        """
        Let dust rise where projectiles struck masonry that stood.

        :param world: before its step, the projectiles as fast as their last blow left them.
        :param carrier: body of the world that carries each part, -1 for none, (N,).
        :param impacts: every blow since the last reset, oldest first.
        """
        new, self._struck = impacts[self._struck:], len(impacts)
        velocity: dict[int, np.ndarray] = {}
        for blow in reversed(new):  # from what is left of the speed back to what there was
            body = carrier[blow.projectile]
            mass = world.bodies.mass[body]
            after = velocity.get(blow.projectile, world.bodies.velocities[body, :3])
            before = velocity[blow.projectile] = after + blow.lost / mass
            if self._stony[blow.parts].all():
                carried = blow.carried @ blow.carried / (
                    2.0 * self._blueprint.mass[blow.parts].sum())
                energy = 0.5 * mass * (before @ before - after @ after) - carried - blow.work
                self.cloud.raise_dust(blow.point[None], np.zeros(1),
                                      np.array([max(energy, 0.0)]))

    def watch(self, world: World, carrier: np.ndarray, time_step: float) -> None:
        """
        Note how everything loose moves just before it may hit something.

        :param world: about to be stepped.
        :param carrier: body of the world that carries each part, -1 for none, (N,).
        :param time_step: [s].
        """
        if self._hits.watch(world, time_step):
            self._spared = np.zeros(len(world.bodies.state) + 1, bool)
            self._spared[carrier[self._wooden]] = True  # the last row for what no body carries

    def rise(self, world: World, log: EventLog, time_step: float) -> None:
        """
        Let dust rise from what broke and hit in this step.

        :param world: stepped, and with everything that broke come apart.
        :param log: everything that broke.
        :param time_step: [s].
        """
        self._from_fractures(log)
        self.cloud.raise_dust(*self._hits.spent(world, self._spared, time_step))

    def drift(self, wind: Wind, time: float, time_step: float) -> None:
        """Move the dust on by one step."""
        if self.cloud.dusty:
            before, self._skyline = self._skyline, self._roofs.skyline()
            if self._skyline is not before:
                self.cloud.lift(self._skyline)
        self.cloud.step(time_step, lambda points: wind.velocity(points, time), self._skyline)

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
