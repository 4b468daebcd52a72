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


"""Progressive failure: solve, crack or break the worst bonds, solve again, until none fails."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import mechanisms, strength, ties
from procphys_ros.physics.masonry.joints import BRIEF, PLAY
from procphys_ros.physics.masonry.solver import DRIFT, StressSolver, SWAY

_BAND = 0.7  # of the worst utilisation
_ROUGH = 10.0  # tolerances of the solver, at which utilisations are right to 0.1 or so (test), ...
_CLEARLY = 2.0  # ... and from which utilisation on bonds may break so early
_HOPELESS = 3.0  # utilisation under a blow that others do not relieve before it is over


@dataclass(frozen=True)
class Failures:
    """
    Bonds that failed in one round, one row each.

    :ivar bond: row of the graph, (K,).
    :ivar cause: `causes.Cause`, (K,) uint8.
    :ivar utilisation: demand over capacity at failure, (K,).
    :ivar broken: True where the bond is gone, False where it only cracked, (K,) bool.
    :ivar had_cracked: True where it had cracked in an earlier round, and now is gone or, if it is
        reinforced, yields, (K,) bool.
    """

    bond: np.ndarray
    cause: np.ndarray
    utilisation: np.ndarray
    broken: np.ndarray
    had_cracked: np.ndarray


class Fracture:
    """
    Judge bonds when the stresses have converged, or fail what clearly fails shortly before.

    A bond pulled or sheared beyond its strength cracks where it is still pressed over a part of
    its patch (`strength.opening`): from then on it presses and rubs, opens and closes (`joints`).
    One that is pulled apart or crushed is gone. Bonds without any strength always crack, and all
    at once: they lose nothing by it. Reinforced ones hang on by their steel (`ties`). What no
    equilibrium holds is parted at the joints that open or slide in its motion, and falls if that
    leaves it loose; what drifts elastically comes off as a lump (`mechanisms`).

    The last stretch to equilibrium takes nearly half of the iterations, and matters to bonds near
    their limit alone. So each problem is glanced at once on the way: if its worst bond carries
    twice its strength, it fails then. Nothing counts as sound before convergence.

    :param solver: loads are set there; bonds crack and break there.
    :param dynamic_factor: of bonds that break by overload, see `StressSolver.cut`.
    :param band: see `strength.worst_first`.
    """

    def __init__(self, solver: StressSolver, dynamic_factor: float = 1.0,
                 band: float = _BAND):
        self.solver = solver
        self.dynamic_factor = dynamic_factor
        self.band = band
        self._judged: int | None = None
        self._glanced: int | None = None
        mortar = solver.graph.mortar
        self._dry = (mortar.tension == 0.0) & (mortar.cohesion == 0.0)

    @property
    def stable(self) -> bool:
        """Whether the present loads are carried and the last judgement broke nothing."""
        return self.solver.converged and not self.solver.equilibrium.sudden and self._is_judged()

    def advance(self, iterations: int, relieve: Callable[[np.ndarray], bool] | None = None,
                most: int | None = None) -> list[Failures]:
        """
        Spend some iterations; fail what is overloaded each time that equilibrium is reached.

        :param iterations: largest number, over all rounds.
        :param relieve: given while loads act that are soon over, such as blows: what they pull
            apart closes again, and is not gone. Asked before what no equilibrium holds is let go,
            with these parts; takes the loads away if they do not throw it over, and says whether
            it has.
        :param most: rounds in which something cracks or breaks; None = as many as there are.
        :returns: one entry per round in which something cracked or broke.
        """
        solver, graph = self.solver, self.solver.graph
        rounds: list[Failures] = []
        least = PLAY if relieve is None else BRIEF
        while iterations > 0 and not self.stable and len(rounds) != most:
            before = solver.spent
            solver.iterate(iterations, _ROUGH if self._glances() else 1.0, least)
            iterations -= max(solver.spent - before, 1)
            if relieve is not None and len(moved := solver.in_motion(least)):
                relieved, relieve = relieve(moved), None
                if relieved:
                    least = PLAY
                    solver.rewind()
                    continue
            if not solver.converged and len(solver.part_hinges(least)):
                continue
            furthest = SWAY if self._judged is None or relieve is not None else DRIFT
            adrift = solver.mechanisms(furthest)
            settled = solver.converged or len(adrift) > 0
            if not settled and not self._may_glance():
                break
            self._glanced = solver.problem
            if not settled and len(solver.adrift(furthest)):
                continue  # what is adrift is solved to the end
            if not solver.converged and self._straighten(adrift):
                continue
            failures = self._judge(adrift, 1.0 if settled else _CLEARLY, relieve is not None)
            if len(failures.bond):
                rounds.append(failures)
            elif not settled:
                continue
            elif solver.equilibrium.sudden:
                solver.forget_sudden()  # the peak has been survived
            elif solver.converged:
                solver.equilibrium.settle()
                solver.hold()
                self._judged = solver.state
            else:  # out of patience without a weak bond to blame: what has no balance falls
                solver.cut(graph.boundary(solver.unbalanced()))
        return rounds

    def _is_judged(self) -> bool:
        return self._judged == self.solver.state

    def _may_glance(self) -> bool:
        """Say whether the problem is nearly solved, not glanced at yet, and no mechanism."""
        solver = self.solver
        near = solver.known and solver.residual <= _ROUGH * solver.goal
        return near and self._glances()

    def _glances(self) -> bool:
        """Say whether the problem is to be glanced at."""
        return self._glanced != self.solver.problem

    def _judge(self, adrift: np.ndarray, least: float, brief: bool) -> Failures:
        """
        Fail what fails, if anything does; the worst bond must carry `least` its strength.

        :param brief: whether the loads are soon over.
        """
        solver = self.solver
        graph = solver.graph
        wrench = solver.wrenches()
        share, cause = strength.utilisation(graph, wrench)
        chosen = np.zeros(len(graph), bool)
        if (solver.converged or not len(adrift)) and share.max(initial=0.0) > least:
            hopeless = _HOPELESS if brief else np.inf
            chosen[strength.worst_first(graph, share, self.band, hopeless)] = True
            chosen |= (share > 1.0) & self._dry
        moving = self._lets_go(adrift, share)
        cause[moving] = Cause.TENSION  # nothing to redistribute to: they go at once
        bonds = np.flatnonzero(chosen | moving)
        gone = ~(strength.opening(graph, bonds, wrench[bonds])[0] | self._dry[bonds] | brief)
        gone |= (cause[bonds] == Cause.COMPRESSION) | graph.narrowed(bonds)
        tied = (graph.mortar.reinforcement[bonds] > 0.0) & (cause[bonds] == Cause.TENSION)
        keeps, torn = ties.give_way(graph, bonds, wrench[bonds])
        gone = np.where(tied, torn, gone | moving[bonds])
        had_cracked = graph.has_cracked(bonds)
        solver.crack(bonds[~gone & ~tied])
        solver.weaken(bonds[~gone & tied], keeps[~gone & tied])
        solver.cut(bonds[gone], self.dynamic_factor)
        return Failures(bonds, cause[bonds], share[bonds], gone, had_cracked)

    def _lets_go(self, adrift: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Mark the overloaded bonds that break because what they hold has no balance, (M,)."""
        solver, graph = self.solver, self.solver.graph
        moving = np.zeros(len(graph), bool)
        if len(adrift):
            moving = mechanisms.loosening(graph, share, adrift, solver.labels, solver.drift)
            if not solver.converged and not moving.any():
                moving[graph.neighbours(adrift)] = True  # displacements that tell nothing
        return moving & (share > 1.0)

    def _straighten(self, parts: np.ndarray) -> bool:
        """
        Let the cracked joints of parts that find no balance be linear again; say if any was not.

        They become bonds as narrow as they are pressed, or are gone if they are not.
        """
        solver, graph = self.solver, self.solver.graph
        rows = graph.neighbours(parts)
        rows = rows[graph.cracked[rows]]
        if not len(rows):
            return False
        stays, low, high = strength.opening(graph, rows, solver.wrenches(rows))
        solver.narrow(rows[stays], low[stays], high[stays])
        solver.cut(rows[~stays])
        return True
