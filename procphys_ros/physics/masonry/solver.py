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


"""Stresses in a bond graph: static equilibrium of rigid parts on elastic bonds, K·u = f."""

from collections.abc import Callable, Sequence
from typing import Self

import numpy as np

from procphys_ros.physics.masonry import strength, tolerances
from procphys_ros.physics.masonry.conjugate_gradients import ConjugateGradients
from procphys_ros.physics.masonry.equilibrium import Equilibrium
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.islands import Islands, out_of_balance
from procphys_ros.physics.masonry.joints import CREEP, PLAY, Reach
from procphys_ros.physics.masonry.newton import Step
from procphys_ros.physics.masonry.superposition import Superposition

_TOLERANCE = 0.1     # of the median part's weight: largest nodal residual of a converged state
_STALE_AFTER = 10    # iterations since a change until the coarse space is renewed (decision 24)
_CURVED_STALE = 40   # the same while joints open: each step changes tangents again
_PATIENCE = 2000     # iterations since a change after which what is unbalanced is a mechanism
_STANDARD_GRAVITY = 9.81  # [m/s²], only scales the tolerance
DRIFT = 0.01         # [m] displacement, since all held, at which a part counts as a mechanism, ...
SWAY = 0.25          # ... under loads that are soon over, or while nothing has held yet


class StressSolver:
    """
    Resumable equilibrium of the supported islands of a bond graph.

    Bonds are linear; those that have cracked are followed by Newton's method (`newton`, `joints`).
    `Equilibrium` keeps the residual f - K·u exact through every change (loads, cuts), so what must
    be worked on is simply where it is too large: islands in which it exceeds the tolerance.

    :param graph: the bonds; the solver is their only owner and changes them by `cut`.
    :param gravity: [m/s²], (3,).
    :param tolerance: of a converged state, the largest force on a part [N], or its moment over
        `BondGraph.reach`; default a tenth of the median part's weight.

    :ivar equilibrium: bonds, displacements and loads.
    :ivar goal: the tolerance that the present loads ask for [N], see `tolerances`.
    :ivar iterations: spent on each part so far, (N,) int.
    :ivar spent: iterations done since the last reset, those of the slowest island.
    :ivar state: changes with every change of bonds or displacements, never comes back.
    :ivar problem: changes with every change of bonds or loads, never comes back.
    :ivar residual: largest nodal residual of the last look [N].
    :ivar sound: displacements in which all held last, (N + 1, 6).
    :ivar working: number of parts in islands that the last call of `iterate` has not finished.
    """

    equilibrium: Equilibrium
    _gradients: ConjugateGradients
    _past: Superposition
    _step: Step
    _islands: Islands

    def __init__(self, graph: BondGraph, gravity: Sequence[float] = (0.0, 0.0, -9.81),
                 tolerance: float | None = None):
        graph.restore()
        self._make_room(Equilibrium(graph, gravity), tolerance)
        self._begin_anew()

    @classmethod
    def joined(cls, graph: BondGraph, gravity: Sequence[float],
               solvers: Sequence[tuple['StressSolver', int, np.ndarray]]) -> Self:
        """
        Join solvers of parts of a graph, with their present state.

        :param graph: whole.
        :param gravity: [m/s²], (3,).
        :param solvers: each of parts that follow each other here, with the first of these, and
            the rows here of its bonds, (M,).
        """
        equilibrium = Equilibrium(graph, gravity)
        for other, first, bonds in solvers:
            equilibrium.adopt(other.equilibrium, first, bonds)
        solver = cls.__new__(cls)
        solver._make_room(equilibrium, None)
        solver._gradients.adopt([(other._gradients, first) for other, first, _ in solvers])
        cracked = np.flatnonzero(graph.cracked)
        solver._begin_at_displacements()
        solver._gradients.invert_blocks(graph.parts_of(cracked))
        solver._look()
        for other, first, _ in solvers:
            own = slice(first, first + other.graph.count)
            solver.iterations[own] = other.iterations
            solver.sound[own], solver._calm[own] = other.sound[:-1], other._calm[:-1]
        return solver

    def _make_room(self, equilibrium: Equilibrium, tolerance: float | None) -> None:
        self.equilibrium = equilibrium
        graph = equilibrium.graph
        weight = graph.mass[np.diff(graph.start) > 0] * _STANDARD_GRAVITY
        self.tolerance = tolerance or _TOLERANCE * float(np.median(weight if len(weight) else 1.0))
        self._gradients, self._past = ConjugateGradients(graph), Superposition()
        self.state = self.problem = 0

    def reset(self) -> None:
        """Reset bonds, displacements and all loads but the weight."""
        self.graph.restore()
        self.equilibrium.reset()
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Recompute all that follows from bonds and displacements."""
        self._begin_at_displacements()
        self._gradients.invert_blocks(np.arange(self.graph.count))
        self._refresh()

    def _begin_at_displacements(self) -> None:
        """Restart at the present displacements; blocks and coarse space are left to the caller."""
        equilibrium, graph = self.equilibrium, self.graph
        self._step, self._begun, self._target = Step.straight(equilibrium), False, 0.0
        self._calm, self._calm_at = np.zeros_like(self.displacement), -1
        self.sound, self.goal = self.displacement.copy(), self.tolerance
        self.iterations = np.zeros(graph.count, np.int64)
        self.spent = self._patience = self._worked = 0
        equilibrium.linearise(np.flatnonzero(graph.cracked))
        equilibrium.relabel()
        self._past.forget(self.labels, equilibrium.linear())
        self.state, self.problem = self.state + 1, self.problem + 1

    @property
    def graph(self) -> BondGraph:
        """Give the bonds."""
        return self.equilibrium.graph

    @property
    def displacement(self) -> np.ndarray:
        """Give the displacements of the parts [m, rad], world, (N + 1, 6), see `Equilibrium`."""
        return self.equilibrium.displacement

    @property
    def labels(self) -> np.ndarray:
        """Give the component of each part, see `components.label`, (N,)."""
        return self.equilibrium.labels

    @property
    def supported(self) -> np.ndarray:
        """Mark the parts that hold on to the ground, (N,) bool."""
        return self.equilibrium.supported

    def wrenches(self, bonds: np.ndarray | None = None) -> np.ndarray:
        """Give what bonds carry [N, N·m], (K, 6), see `Equilibrium.wrenches`."""
        return self.equilibrium.wrenches(bonds)

    def utilisation(self) -> tuple[np.ndarray, np.ndarray]:
        """Give utilisation and cause of failure of every bond, see `strength.utilisation`."""
        return strength.utilisation(self.graph, self.wrenches())

    def set_loads(self, force: np.ndarray, moment: np.ndarray | None = None) -> None:
        """
        Replace the loads that act besides the weight: wind, blast, impacts, what rests on parts.

        :param force: at the centres of mass, world [N], (N, 3).
        :param moment: about the centres of mass, world [N·m], (N, 3).
        :raises ValueError: when a load is not finite.
        """
        equilibrium = self.equilibrium
        change = equilibrium.replace_loads(force, moment)
        if np.any(change[:-1]):
            self._halt()
            self._past.guess(equilibrium.displacement, equilibrium.residual, change)
            self.goal = tolerances.sharpened(self.tolerance, equilibrium.residual, self.labels,
                                             self.graph.reach)
            self._moved()
            self.state, self.problem = self.state + 1, self.problem + 1

    def cut(self, bonds: np.ndarray, dynamic_factor: float = 1.0) -> None:
        """
        Break bonds; what they carried becomes residual and is redistributed by later iterations.

        :param bonds: rows of the graph, (K,).
        :param dynamic_factor: how many times the released forces count until `forget_sudden`: 2
            is the peak of an undamped structure whose support vanishes at once (Biggs 1964,
            Introduction to Structural Dynamics, section 2.3), 1 is slow release.
        """
        bonds = np.asarray(bonds)[self.graph.alive[bonds]]
        if len(bonds):
            self._change(self.equilibrium.cut, bonds, dynamic_factor)

    def narrow(self, bonds: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Open bonds partly and for good, see `strength.opening` and `BondGraph.narrow`."""
        self._change(self.equilibrium.narrow, bonds, low, high)

    def weaken(self, bonds: np.ndarray, share: np.ndarray) -> None:
        """Leave reinforced bonds so much of the stiffness they have, see `ties`."""
        if len(bonds):
            self._change(self.equilibrium.weaken, bonds, share)

    def crack(self, bonds: np.ndarray) -> None:
        """Crack bonds, which then carry no tension, see `Equilibrium.crack`."""
        graph = self.graph
        bonds = bonds[graph.alive[bonds] & ~graph.cracked[bonds]]
        if len(bonds):
            self._change(self.equilibrium.crack, bonds)

    def forget_sudden(self, share: float = 1.0) -> None:
        """Fade the dynamic part of released forces by a share, 1 = all of it."""
        if self.equilibrium.sudden:
            self._halt()
            self._past.shift(self.equilibrium.fade_sudden(share))
            self._moved()
            self.problem += 1

    def _change(self, how: Callable, bonds: np.ndarray, *values: object) -> None:
        """Change bonds by a method of the equilibrium, with these values."""
        self._halt()
        how(bonds, *values)
        self._gradients.invert_blocks(self.graph.parts_of(bonds))
        self._gradients.fresh = False
        self._patience = self._worked = 0
        self._past.forget(self.labels, self.equilibrium.linear())
        self._moved()
        self.state, self.problem = self.state + 1, self.problem + 1

    def _halt(self) -> None:
        """End the present step before loads or bonds change: it might go too far."""
        if not self.known:
            self._finish()
            self._moved()

    def _moved(self) -> None:
        """Record that loads or bonds have changed."""
        self._begun = False
        self._stale_view = True

    def _look(self) -> None:
        """Find the islands out of equilibrium."""
        self._stale_view = False
        if self._gradients.coarse is None:  # nothing stands, so nothing is loaded
            self.residual, self.working = 0.0, 0
            return
        sizes = self.equilibrium.residual_sizes()
        self.residual = float(sizes.max(initial=0.0))
        self._islands = out_of_balance(self.equilibrium, sizes, self.goal)
        self._gradients.begin(self._islands)
        self.working = len(self._islands.parts)

    @property
    def converged(self) -> bool:
        """Whether every supported part is in equilibrium within the tolerance."""
        if self._stale_view:
            self._look()
        return self._balanced and not self.equilibrium.joints.sticking

    @property
    def _balanced(self) -> bool:
        return self.known and self.residual <= self.goal

    @property
    def known(self) -> bool:
        """Whether the residual is that of the true forces, not of tangents."""
        return not self._begun or self._step.fresh

    def iterate(self, limit: int, enough: float = 1.0, least: Reach = PLAY) -> float:
        """
        Work on the islands out of equilibrium.

        :param limit: largest number of iterations.
        :param enough: largest nodal residual to stop at, in tolerances, not less than 1.
        :param least: that hinges have moved by, at which to stop, too.
        :returns: the largest nodal residual [N].
        """
        target = self._target = enough * self.goal
        while limit > 0 and not self.converged and not self._exhausted:
            if self._balanced:
                self.equilibrium.joints.release()
                self.equilibrium.linearise(np.flatnonzero(self.graph.cracked))
                self._moved()
                continue
            if self.known and self.residual <= target:
                break
            if not self._begun:
                self._begin()
            step = self._step
            if step.curved and len(self._hinges(least)):
                break
            stale = not (self._gradients.fresh or step.confined)
            after = _CURVED_STALE if step.curved else _STALE_AFTER
            if stale and self._worked >= after:
                self._refresh()
                continue
            now = min(limit, after - self._worked) if stale else limit
            goal = max(step.goal, 0.5 * target) if step.curved else target
            limit -= max(self._run(min(now, step.left), goal), 1)
            if step.curved and (self.residual <= goal or not step.left):
                self._end()
        if self.converged and self._calm_at != self.state:
            self._calm, self._calm_at = self.displacement.copy(), self.state
        return self.residual

    def _begin(self) -> None:
        """Start a step of Newton's method from where the displacements are."""
        rows = self._islands.cracked(self.graph)
        self._begun, self._step = True, Step.straight(self.equilibrium)
        if len(rows):
            self._linearise(rows)
            self._next_step()

    def _end(self) -> None:
        """Finish a step by line search with the true forces, and start the next one there."""
        rows = self._islands.cracked(self.graph)
        self._finish()
        self._next_step()
        if not self._step.curved:  # balanced with that friction: now with that of these pressures
            self.equilibrium.linearise(rows)
            self._moved()

    def _finish(self) -> None:
        """Finish a step by line search with the true forces."""
        self._step.finish(self.equilibrium)
        self._linearise(self._step.rows, False)

    def _next_step(self) -> None:
        """Start a step where the last one has ended."""
        self._look()
        self._step = self._step.next(self.equilibrium, self._islands, self._target, self.goal)
        if self._step.confined:
            self._gradients.confine(self._step.islands)

    def _linearise(self, rows: np.ndarray, renew: bool = True) -> None:
        """Update the tangents of joints, see `CrackedJoints.linearise`."""
        self.equilibrium.linearise(rows, renew)
        self._gradients.invert_blocks(self.graph.parts_of(rows))
        if self._gradients.fresh:
            self._gradients.fresh, self._worked = False, 0

    def _run(self, limit: int, target: float) -> int:
        parts, _, part, _ = self._gradients.islands
        each, left = self._gradients.iterate(self.displacement, self.equilibrium.residual, target,
                                             limit)
        size, done = np.diff(part), int(each.max(initial=0))
        self.iterations[parts] += np.repeat(each, size)
        self.residual = float(left.max(initial=0.0))
        if not self._step.confined:
            self.working = int(size[left > target].sum())
            self._worked += done
        self.spent += done
        self.state += 1
        self._step.spend(done)
        self._patience += done
        if self.converged:
            self._patience = self._worked = 0
        return done

    def _refresh(self) -> None:
        """Renew the coarse space."""
        self._gradients.aggregate(np.flatnonzero(self.supported))
        self._worked = 0
        if self.known or self._gradients.coarse is None:
            self._look()
        else:  # a step keeps to its islands
            self._gradients.begin(self._islands)

    def part_hinges(self, least: Reach = PLAY) -> np.ndarray:
        """
        Cut the cracked joints that open or slide without end: the hinges of a mechanism.

        All goes back to where it was in equilibrium last: how it moved since does not count.

        :returns: rows of the graph.
        """
        rows = self._hinges(least)
        self.cut(rows)
        if len(rows):
            self.equilibrium.rewind(self._calm)
        return rows

    def in_motion(self, least: Reach, balanced: bool) -> np.ndarray:
        """
        List the parts that a mechanism moves away from where they were in equilibrium last.

        :param least: that hinges have moved by.
        :param balanced: whether displacements tell how far all has come.
        """
        far = self.adrift(SWAY) if balanced else self.mechanisms(SWAY)
        moves = len(self._hinges(least)) or len(far)
        return self.equilibrium.moved_from(self._calm) if moves else np.zeros(0, np.intp)

    def motion(self, parts: np.ndarray) -> np.ndarray:
        """Give how far parts have come since they were in equilibrium last [m], (K, 3)."""
        return (self.displacement - self._calm)[parts, :3]

    def rewind(self) -> None:
        """Return to the displacements of the last equilibrium; loads and bonds stay."""
        self._halt()
        self.equilibrium.rewind(self._calm)
        self._patience = self._worked = 0
        self._moved()
        self.state, self.problem = self.state + 1, self.problem + 1

    def _hinges(self, least: Reach) -> np.ndarray:
        """List the joints that `part_hinges` would cut; none while a step is under way."""
        rows = np.flatnonzero(self.graph.cracked) if self.known else np.zeros(0, np.intp)
        if not len(rows):
            return rows
        return self.equilibrium.joints.hinges(rows, self.displacement - self._calm,
                                              CREEP if self._exhausted else least)

    def unbalanced(self) -> np.ndarray:
        """List the parts whose nodal residual exceeds the tolerance."""
        return np.flatnonzero((self.equilibrium.residual_sizes() > self.goal) & self.supported)

    def adrift(self, furthest: float) -> np.ndarray:
        """
        List the parts that have drifted since all held; none while a step is under way.

        :param furthest: from here on [m]: `DRIFT` or `SWAY`.
        """
        if not self.known:
            return np.zeros(0, np.intp)
        return np.flatnonzero(self.supported & (self.drift > furthest))

    @property
    def drift(self) -> np.ndarray:
        """Give how far parts have come since all held, along x, y or z [m], (N,)."""
        return np.abs(self.displacement - self.sound)[:-1, :3].max(axis=1, initial=0.0)

    def hold(self) -> None:
        """Record that all holds: drift counts from here on."""
        self.sound = self.displacement.copy()

    def mechanisms(self, furthest: float) -> np.ndarray:
        """
        List the parts that no static equilibrium worth the name holds.

        Converged, these are the parts displaced too far; otherwise the parts still unbalanced when
        the iterations since the last change have run out of patience.

        :param furthest: see `adrift`.
        """
        if self.converged:
            return self.adrift(furthest)
        return self.unbalanced() if self._exhausted else np.zeros(0, np.intp)

    @property
    def curved(self) -> bool:
        """Whether cracked joints are among what is out of balance."""
        return self._step.curved

    @property
    def _exhausted(self) -> bool:
        """Whether the iterations since the last change have run out of patience."""
        return self._patience >= _PATIENCE and self.known
