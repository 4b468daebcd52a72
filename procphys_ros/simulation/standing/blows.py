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


"""Blows on standing masonry: what they tear out, and what they load when nothing gives."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.masonry import Resistance
from procphys_ros.physics.masonry.capacity import bond_resistance
from procphys_ros.physics.masonry.links import pulls
from procphys_ros.physics.world import World
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import Cause, EventLog
from procphys_ros.simulation.standing.buildings import Buildings, Collapse
from procphys_ros.simulation.standing.standing_loads import StandingLoads

CONTACT = 2e-3     # [s] contact of hard bodies on masonry: Hertz gives less, crushing more
WALL_RATE = 100.0  # [1/s] angular frequency 2π/T of a storey-high half-brick wall, T about 60 ms:
#                    a blow much shorter than T stresses a wall as the steady force rate·impulse


@dataclass(frozen=True)
class Push:
    """
    How torn-out parts leave a wall.

    :ivar speed: along the blow [m/s].
    :ivar wall: momentum that the breaking bonds pass on to what stands [N·s].
    """

    speed: float
    wall: float


class Blows:
    """
    Compares blows with what bonds withstand, and carries out the result.

    :param blueprint: all parts and bonds of the scene.
    :param buildings: what stands.
    :param loads: on what stands.
    :param log: where broken bonds are recorded.

    :ivar buildings, log: the same.
    """

    def __init__(self, blueprint: Blueprint, buildings: Buildings, loads: StandingLoads,
                 log: EventLog):
        self._blueprint = blueprint
        self.buildings = buildings
        self._loads = loads
        self.log = log

    def begin(self, world: World, debris: Debris) -> None:
        """Start anew in a world that has just been built."""
        self._world = world
        self._debris = debris

    def resistance(self, parts: np.ndarray, direction: np.ndarray) -> Resistance:
        """
        Give what standing parts withstand together before they come out; see `tear_out`.

        :param parts: (K,) indices.
        :param direction: unit vector of the blow, world, (3,).
        """
        graph, solver = self.buildings.graph, self.buildings.solver
        bonds = graph.boundary(parts)
        wrench = np.empty((len(bonds), 6))
        pulls(bonds, graph.links, graph.axes, graph.first, graph.second, solver.displacement,
              wrench)
        inside = np.isin(graph.first[bonds], parts)
        force, work = bond_resistance(graph, bonds, inside, direction, wrench)
        return Resistance(bonds, float(force.sum()), float(work.sum()))

    def gives_way(self, resistance: Resistance, momentum: float, mass: float,
                  speed: float) -> Push | None:
        """
        Say how parts come out under a blow; None when they hold.

        The force of the blow must exceed that of the bonds, and the energy of what moves on
        together must exceed their work of fracture, which it loses.

        :param resistance: of the bonds around the parts.
        :param momentum: of the blow if the parts hold [N·s].
        :param mass: of what moves on together [kg].
        :param speed: of it, were there no bonds [m/s].
        """
        left = speed ** 2 - 2.0 * resistance.energy / mass
        if momentum <= resistance.momentum(CONTACT) or left <= 0.0:
            return None
        return Push(float(np.sqrt(left)), mass * (speed - float(np.sqrt(left))))

    def tear_out(self, parts: np.ndarray, velocities: np.ndarray, cause: Cause,
                 load: float, time: float) -> None:
        """
        Break all bonds of standing parts and let them fly, each on its own.

        :param parts: (K,) indices.
        :param velocities: world axes, (K, 6).
        :param cause: of the breaks.
        :param load: of the blow over what the bonds withstood.
        :param time: of the simulation [s].
        """
        self.cut_out(parts, cause, load, time)
        bodies = self.buildings.body[parts]
        self._world.thaw(bodies, velocities)
        self._debris.adopt(parts, bodies)

    def cut_out(self, parts: np.ndarray, cause: Cause, load: float, time: float) -> None:
        """Break all bonds of standing parts, which do not stand from then on; see `tear_out`."""
        graph = self.buildings.graph
        bonds = self.buildings.solver.remove_parts(parts)
        self.buildings.standing[parts] = False
        rows = graph.rows[bonds]
        self.log.record(time, self._blueprint.bond_frame[rows, :3], rows,
                        self._blueprint.bonds[rows], cause, np.full(len(rows), load))

    def remove(self, parts: np.ndarray) -> None:
        """Take the bodies of parts that were cut out from the world, (K,) indices."""
        self._world.remove(self.buildings.body[parts])

    def press(self, parts: np.ndarray, impulses: np.ndarray, rate: float = WALL_RATE) -> None:
        """
        Let what stands feel impulses, until its stresses have been judged.

        :param parts: (K,) indices.
        :param impulses: at their centres of mass [N·s], world, (K, 3).
        :param rate: steady force of the same effect over impulse [1/s].
        """
        wrenches = np.zeros((len(parts), 6))
        wrenches[:, :3] = rate * impulses
        self._loads.strike(parts, wrenches)

    def press_around(self, bonds: np.ndarray, parts: np.ndarray, impulse: np.ndarray) -> None:
        """
        Let what stands around torn-out parts feel what breaking their bonds gave to it.

        :param bonds: around the parts, rows of the graph, (B,).
        :param parts: that leave, (K,).
        :param impulse: on all neighbours together [N·s], world, (3,).
        """
        graph = self.buildings.graph
        near = np.concatenate([graph.first[bonds], graph.second[bonds]])
        near = np.setdiff1d(near[near < graph.count], parts)
        if len(near):
            self.press(near, np.tile(impulse / len(near), (len(near), 1)))

    def judged(self, collapse: Collapse) -> None:
        """End all blows once the stresses that they caused are known, and what they broke."""
        if len(collapse.bond) or self.buildings.stable:
            self._loads.judged()

    def strike(self, part: int, linear: np.ndarray, angular: np.ndarray, time: float) -> bool:
        """
        Give a standing part an impulse.

        :param part: index.
        :param linear: impulse at its centre of mass [N·s], (3,), world.
        :param angular: [N·m·s], (3,), world.
        :returns: whether it came out of its wall.
        """
        size = float(np.linalg.norm(linear))
        chosen = np.array([part])
        mass = float(self._blueprint.mass[part])
        if size > 0.0:
            direction = linear / size
            resistance = self.resistance(chosen, direction)
            push = self.gives_way(resistance, size, mass, size / mass)
            if push is not None:
                velocity = np.zeros((1, 6))
                velocity[0, :3] = push.speed * direction
                load = size / max(resistance.momentum(CONTACT), 1e-9)
                self.tear_out(chosen, velocity, Cause.IMPACT, load, time)
                self._world.apply_impulse(int(self.buildings.body[part]), np.zeros(3),
                                          angular=angular)
                return True
        self.press(chosen, linear[None])
        return False
