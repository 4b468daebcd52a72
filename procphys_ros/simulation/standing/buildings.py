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

"""Buildings: masonry that stands frozen until its stresses say otherwise."""

from dataclasses import dataclass
import math

import numpy as np

from procphys_ros.blueprint import Blueprint, GROUND, Law
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.physics.masonry import Cause as MasonryCause
from procphys_ros.physics.masonry.components import groups
from procphys_ros.physics.world import World
from procphys_ros.simulation.events import Cause

_ITERATIONS = 8  # of the stress solver per time step while something changed, ...
_FEWEST = 3      # ... fewer on large buildings, lest they fall behind real time: ...
_WORK = 45_000   # ... parts times iterations that take about a third of a step of 1/60 s
_PEAK = 0.5      # [s] time constant of the dynamic part of released forces: damped, and a few
#                  periods of walls and floors long
_SETTLING = 20_000  # iterations to find the stresses of a scene before its first step
_CAUSES = np.array([Cause.TENSION, Cause.TENSION, Cause.SHEAR, Cause.COMPRESSION,
                    Cause.TENSION], np.uint8)
assert len(_CAUSES) == len(MasonryCause)


@dataclass(frozen=True)
class Collapse:
    """
    What happened to the buildings in one step.

    :ivar bond: broken bonds, rows of the blueprint, (B,).
    :ivar cause: `events.Cause`, (B,) uint8.
    :ivar load: load over strength, (B,).
    :ivar pieces: part indices of each piece that lost the ground.
    """

    bond: np.ndarray
    cause: np.ndarray
    load: np.ndarray
    pieces: list[np.ndarray]


class Buildings:
    """
    All parts that mortar ties together.

    :param blueprint: all parts of the scene; those with mortar bonds belong to the buildings.
    :param gravity: downward acceleration [m/s²].

    :ivar standing: parts that stand frozen where they were built, (N,) bool.
    :ivar body: id of the world's body of each standing part, -1 elsewhere, (N,).
    """

    def __init__(self, blueprint: Blueprint, gravity: float):
        self._blueprint = blueprint
        self._members = np.zeros(len(blueprint), bool)
        pairs = blueprint.bonds[blueprint.bond_law == Law.MORTAR]
        self._members[pairs[pairs != GROUND]] = True
        self.graph = BondGraph(blueprint)
        self.solver = StressSolver(self.graph, (0.0, 0.0, -gravity))
        self.reset()

    def reset(self) -> None:
        """Make everything whole again and find its stresses; `build` puts it into a world."""
        self.solver.reset()
        self._fracture = Fracture(self.solver)
        self.standing = self._members.copy()
        self.body = np.full(len(self._blueprint), -1, np.intp)
        self._since = 0.0

    def __len__(self) -> int:
        return int(self._members.sum())

    def build(self, world: World) -> None:
        """Put every part that belongs to a building into the world, frozen."""
        parts = np.flatnonzero(self._members)
        if len(parts):
            self.body[parts] = world.add_bricks(
                self._blueprint.poses[parts], self._blueprint.size[parts],
                self._blueprint.mass[parts])

    def settle(self) -> Collapse:
        """Find the stresses under weight alone, as they are when the mortar has set."""
        return self._advance(_SETTLING)

    def stand(self, time_step: float) -> Collapse:
        """
        Spend one step's share of work on the stresses; nothing when nothing changed.

        :param time_step: [s]; the dynamic part of forces that breaks released dies away while
            they are worked out, or a building that crumbles on would feel them for ever.
        """
        self._since += time_step
        most = _WORK // max(self.solver.working, 1)
        collapse = self._advance(min(max(most, _FEWEST), _ITERATIONS))
        if len(collapse.bond):
            self.solver.forget_sudden(-math.expm1(-self._since / _PEAK))
        if len(collapse.bond) or self.stable:
            self._since = 0.0
        return collapse

    def holds(self, part: int) -> bool:
        """Say whether a part still stands where it was built."""
        return part < len(self.standing) and bool(self.standing[part])

    @property
    def stable(self) -> bool:
        """Say whether the stresses are known and nothing more breaks under them."""
        return not len(self.graph) or self._fracture.stable

    def _advance(self, iterations: int) -> Collapse:
        if not len(self.graph) or self._fracture.stable:
            return _NOTHING
        rounds = self._fracture.advance(iterations)
        loose = self.standing & ~self.solver.supported
        pieces = groups(self.solver.labels, loose) if loose.any() else []
        self.standing[loose] = False
        if not rounds:
            return Collapse(_NOTHING.bond, _NOTHING.cause, _NOTHING.load, pieces)
        bond, cause, load = (np.concatenate([getattr(r, name)[r.broken] for r in rounds])
                             for name in ('bond', 'cause', 'utilisation'))
        return Collapse(self.graph.rows[bond], _CAUSES[cause], load, pieces)


_NOTHING = Collapse(np.zeros(0, np.intp), np.zeros(0, np.uint8), np.zeros(0), [])
