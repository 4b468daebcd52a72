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
import math

import numpy as np

from procphys_ros.geometry.linear import product
from procphys_ros.physics import fracture_energy
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import mechanisms, strength, ties
from procphys_ros.physics.masonry.joints import BRIEF, PLAY
from procphys_ros.physics.masonry.solver import DRIFT, StressSolver, SWAY

_BAND = 0.7  # of the worst utilisation
_ROUGH = 10.0  # tolerances of the solver, at which utilisations are right to 0.1 or so (test), ...
_CLEARLY = 2.0  # ... and the least utilisation at which bonds break that early
_HOPELESS = 3.0  # utilisation under a blow that no redistribution relieves before it ends
_RUNNING = 3.0  # utilisation beyond which a crack runs on before the remaining bonds respond
_FAINT = 0.01  # of a blow, on the part that it hits hardest: tolerated unbalanced load

Relief = Callable[[list[np.ndarray]], np.ndarray]  # see `Fracture.withstand`


@dataclass(frozen=True)
class Failures:
    """
    Bonds that failed in one round, one row each.

    :ivar bond: row of the graph, (K,).
    :ivar cause: `causes.Cause`, (K,) uint8.
    :ivar utilisation: demand over capacity at failure, (K,).
    :ivar broken: True where the bond is gone, False where it only cracked, (K,) bool.
    :ivar had_cracked: True where it had cracked in an earlier round, and now is gone or, if
        reinforced, yields, (K,) bool.
    """

    bond: np.ndarray
    cause: np.ndarray
    utilisation: np.ndarray
    broken: np.ndarray
    had_cracked: np.ndarray

    @property
    def runs_on(self) -> bool:
        """Whether the next round follows at once: cracks run at hundreds of metres per second."""
        return bool(self.utilisation.max() > _RUNNING)


class Fracture:
    """
    Fail bonds at convergence of the stresses, and clearly overloaded ones shortly before.

    A bond beyond its tensile or shear strength, but in compression on the whole, cracks: from
    then on it carries pressure and friction, opens and closes (`joints`), wherever its resultant
    lies. A bond that is pulled apart or crushed is gone. Bonds without any strength always crack,
    all at once: they have none to lose. Reinforced bonds hold by their steel (`ties`). Parts
    without equilibrium are cut at the joints that open or slide in their motion, and fall if that
    leaves them loose; parts that drift elastically come off as a lump (`mechanisms`).

    The last stretch to equilibrium takes nearly half of the iterations, and matters only to bonds
    near their limit. So each problem is checked once on the way: if its worst bond carries
    twice its strength, it fails then. No state counts as sound before convergence.

    :param solver: loads are set there; bonds crack and break there.
    :param dynamic_factor: of bonds that break by overload, see `StressSolver.cut`.
    :param band: see `strength.worst_first`.
    """

    solver: StressSolver
    _judged: int | None
    _glanced: int | None
    _released: tuple[int | None, float]  # problem, and its first residual [N]

    def __init__(self, solver: StressSolver, dynamic_factor: float = 1.0,
                 band: float = _BAND):
        self.solver = solver
        self.dynamic_factor = dynamic_factor
        self.band = band
        self._judged = None
        self._glanced = None
        self._thrown = False  # whether a blow overturns a mechanism in the present round
        self._hanging = np.zeros(0, np.intp)  # parts that a blow has overturned
        self._released = None, 0.0
        mortar = solver.graph.mortar
        self._dry = (mortar.tension == 0.0) & (mortar.cohesion == 0.0)

    def adopt(self, before: 'Fracture') -> None:
        """Continue the blow of another fracture whose parts are the first ones here."""
        self._thrown, self._hanging = before._thrown, before._hanging

    @property
    def stable(self) -> bool:
        """Whether the present loads are balanced and the last check broke no bond."""
        return self.solver.converged and not self.solver.equilibrium.sudden and self._is_judged()

    def advance(self, iterations: int, most: int | None = None,
                relieve: Relief | None = None) -> list[Failures]:
        """
        Iterate; fail overloaded bonds each time that equilibrium is reached.

        :param iterations: largest number, over all rounds.
        :param most: largest number of rounds with failures, not counting those that run on; None =
            unlimited.
        :param relieve: of loads that pass, see `withstand`; None = there are none.
        :returns: one entry per round with failures.
        """
        solver, graph = self.solver, self.solver.graph
        rounds: list[Failures] = []
        while iterations > 0 and not self.stable and most != 0:
            before = solver.spent
            self.prepare(iterations)
            iterations -= max(solver.spent - before, 1)
            furthest = SWAY if self._judged is None else DRIFT
            if relieve is not None:
                moved = solver.in_motion(PLAY, solver.converged, furthest)
                if len(relieve(moved)) < sum(map(len, moved)):
                    solver.forget_sudden()
                    solver.rewind()
                    continue
            if not solver.converged and len(solver.part_hinges()):
                continue
            adrift = solver.mechanisms(furthest)
            settled = solver.converged or len(adrift) > 0
            if not settled and not self._may_glance():
                break
            self._glanced = solver.problem
            if not settled and len(solver.adrift(furthest)):
                continue  # parts adrift are solved to convergence
            if not solver.converged and self._straighten(adrift):
                continue
            overshoot = solver.equilibrium.overshoot(solver.sound)
            failures = self._judge(adrift, 1.0 if settled else _CLEARLY, solver.converged)
            if len(failures.bond):
                rounds.append(failures)
                self._swing_less(overshoot, failures)
                if most is not None and not failures.runs_on:
                    most -= 1
            elif not settled:
                continue
            elif solver.equilibrium.sudden:
                solver.forget_sudden()  # the bonds have withstood the dynamic peak
            elif solver.converged:
                self._accept()
            else:  # iteration limit reached without an overloaded bond: unbalanced parts fall
                solver.cut(graph.boundary(solver.unbalanced()))
        return rounds

    def _accept(self) -> None:
        """Commit the present state as an equilibrium."""
        self.solver.equilibrium.settle()
        self.solver.hold()
        self._judged = self.solver.state

    def prepare(self, iterations: int) -> None:
        """Iterate towards the next check of the bonds, without checking them."""
        self.solver.iterate(iterations, _ROUGH if self._glances() else 1.0)

    def prepare_blow(self, iterations: int, blow: float) -> None:
        """
        Iterate towards the next check in `withstand`, without checking the bonds.

        :param blow: see `withstand`.
        """
        self.solver.iterate(iterations, self._enough(blow) / self.solver.goal, BRIEF)

    def _swing_less(self, energy: float, failures: Failures) -> None:
        """
        Subtract the work of fracture of a round from the energy of sudden releases.

        :param energy: of the overshoot before the round [J].
        """
        if energy > 0.0:
            fresh = ~failures.had_cracked
            work = product(self.solver.graph.area[failures.bond[fresh]],
                           fracture_energy.BY_CAUSE[failures.cause[fresh]])
            self.solver.forget_sudden(1.0 - math.sqrt(max(1.0 - work / energy, 0.0)))

    def withstand(self, iterations: int, blow: float, relieve: Relief,
                  last: bool = False) -> tuple[list[Failures], bool]:
        """
        Iterate on one round under loads that end soon, such as blows.

        Joints that these loads open close again, and are not gone. The loads need not be balanced
        to convergence: clearly overloaded bonds are found at larger residuals.

        :param iterations: largest number; the next call continues from there.
        :param blow: largest force of these loads on one part [N].
        :param relieve: called with the mechanisms before they are released; removes the loads
            from those that these do not overturn, and returns the parts of the others.
        :param last: whether cracks have run by now, so that only mechanisms are looked for.
        :returns: the round with failures, if there was one, and whether the loads are over.
        """
        rounds, over = self._round(iterations, blow, relieve, last)
        if rounds or over:
            self._thrown = False
        if over:
            self._hanging = np.zeros(0, np.intp)
        return rounds, over

    def _round(self, iterations: int, blow: float, relieve: Relief,
               last: bool) -> tuple[list[Failures], bool]:
        """Continue a round, see `withstand`."""
        solver = self.solver
        while iterations > 0:
            before = solver.spent
            self.prepare_blow(iterations, blow)
            iterations -= max(solver.spent - before, 1)
            near = solver.known and solver.residual <= self._enough(blow)
            settled = near and solver.residual <= self._left(blow)
            if not self._thrown and (moved := solver.in_motion(BRIEF, near)):
                self._hanging = relieve(moved)
                self._thrown = len(self._hanging) > 0
                if len(self._hanging) < sum(map(len, moved)):
                    solver.rewind()
                    if not self._thrown:
                        return [], True
                    continue
            if not near and len(solver.part_hinges(BRIEF)):
                continue
            furthest = DRIFT if self._thrown else SWAY
            adrift = solver.adrift(furthest) if near else solver.mechanisms(furthest)
            if not near and not len(adrift):
                break
            self._glanced = solver.problem
            if not near and self._straighten(adrift):
                continue
            least = np.inf if last else 1.0 if settled or not near else _CLEARLY
            failures = self._judge(adrift, least, near, not self._thrown)
            if len(failures.bond):
                return [failures], False
            if settled and last:
                rounds = self._part_thrown()
                return rounds, not rounds
            if settled:
                return [], True
            if not near:
                solver.cut(solver.graph.boundary(solver.unbalanced()))
        return [], False

    def _part_thrown(self) -> list[Failures]:
        """Release the parts that a blow has overturned and that still hang on at its end."""
        solver, graph = self.solver, self.solver.graph
        parts = self._hanging[solver.supported[self._hanging]]
        self._hanging = np.zeros(0, np.intp)
        if not len(parts):
            return []
        share, cause = strength.utilisation(graph, solver.wrenches())
        rows = mechanisms.parting(graph, share, parts, solver.labels, solver.drift)
        had_cracked = graph.has_cracked(rows)
        cause[rows] = Cause.TENSION
        solver.cut(rows)
        return [Failures(rows, cause[rows], share[rows], np.ones(len(rows), bool), had_cracked)]

    def _left(self, blow: float) -> float:
        """Return the residual at which a blow counts as balanced [N]."""
        return max(self.solver.goal, _FAINT * blow)

    def _enough(self, blow: float) -> float:
        """Return the residual at which bonds are checked next under a blow [N]."""
        solver = self.solver
        if not solver.converged and self._released[0] != solver.problem:
            self._released = solver.problem, solver.residual
        left = self._left(blow)
        return max(left, _FAINT * self._released[1]) if self._glances() else left

    def _is_judged(self) -> bool:
        return self._judged == self.solver.state

    def _may_glance(self) -> bool:
        """Return whether to check bonds early: nearly solved, not yet checked early."""
        solver = self.solver
        near = solver.known and solver.residual <= _ROUGH * solver.goal
        return near and self._glances()

    def _glances(self) -> bool:
        """Return whether the next check of the bonds is an early one."""
        return self._glanced != self.solver.problem

    def _judge(self, adrift: np.ndarray, least: float, balanced: bool,
               brief: bool = False) -> Failures:
        """
        Fail the overloaded bonds, if the worst one carries `least` times its strength.

        :param balanced: whether the residual is too small to matter to any bond.
        :param brief: whether the loads end soon.
        """
        solver = self.solver
        graph = solver.graph
        wrench = solver.wrenches()
        share, cause = strength.utilisation(graph, wrench)
        chosen = np.zeros(len(graph), bool)
        if (balanced or not len(adrift)) and share.max(initial=0.0) > least:
            hopeless = _HOPELESS if brief else np.inf
            chosen[strength.worst_first(graph, share, self.band, hopeless)] = True
            chosen |= (share > 1.0) & self._dry
        moving = self._lets_go(adrift, share, balanced)
        cause[moving] = Cause.TENSION  # without redistribution they break at once
        bonds = np.flatnonzero(chosen | moving)
        gone = ~((wrench[bonds, 2] < 0.0) | self._dry[bonds] | brief)
        gone |= (cause[bonds] == Cause.COMPRESSION) | graph.narrowed(bonds)
        tied = (graph.mortar.reinforcement[bonds] > 0.0) & (cause[bonds] == Cause.TENSION)
        keeps, torn = ties.give_way(graph, bonds, wrench[bonds])
        gone = np.where(tied, torn, gone | moving[bonds])
        had_cracked = graph.has_cracked(bonds)
        solver.crack(bonds[~gone & ~tied])
        solver.weaken(bonds[~gone & tied], keeps[~gone & tied])
        solver.cut(bonds[gone], self.dynamic_factor)
        return Failures(bonds, cause[bonds], share[bonds], gone, had_cracked)

    def _lets_go(self, adrift: np.ndarray, share: np.ndarray, balanced: bool) -> np.ndarray:
        """Mark the overloaded bonds that release parts without equilibrium, (M,) bool."""
        solver, graph = self.solver, self.solver.graph
        moving = np.zeros(len(graph), bool)
        if len(adrift):
            moving = mechanisms.loosening(graph, share, adrift, solver.labels, solver.drift)
            if not balanced and not moving.any():
                moving[graph.neighbours(adrift)] = True  # the displacements are meaningless
        return moving & (share > 1.0)

    def _straighten(self, parts: np.ndarray) -> bool:
        """
        Linearise the cracked joints of parts without equilibrium; return whether there were any.

        They become bonds of the width of their pressed zone, or are gone without one.
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
