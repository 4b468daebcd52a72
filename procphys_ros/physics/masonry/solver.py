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

from procphys_ros.physics.gravity import GRAVITY
from procphys_ros.physics.masonry import components, strength, tolerances
from procphys_ros.physics.masonry.conjugate_gradients import ConjugateGradients
from procphys_ros.physics.masonry.equilibrium import Equilibrium
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.islands import BondIslands, out_of_balance
from procphys_ros.physics.masonry.joints import CREEP, PLAY, Reach
from procphys_ros.physics.masonry.newton import NewtonStep
from procphys_ros.physics.masonry.superposition import Superposition

_TOLERANCE = 0.1     # of the median part's weight: largest nodal residual of a converged state
_STALE_AFTER = 10    # iterations since a change until the coarse space is rebuilt (decision 24)
_CURVED_STALE = 40   # the same while joints open: each step changes the tangents again
_PATIENCE = 2000     # iterations since a change after which unbalanced parts are a mechanism
DRIFT = 0.01         # [m] displacement since the last stable state at which a part is a mechanism,
SWAY = 0.25          # and under loads that end soon, or before the first stable state


class StressSolver:
    """
    Resumable equilibrium of the supported islands of a bond graph.

    Bonds are linear; cracked ones are solved by Newton's method (`newton`, `joints`).
    `Equilibrium` keeps the residual f - K·u exact through every change (loads, cuts), so the
    solver works on the islands in which the residual exceeds the tolerance.

    :param graph: the bonds; the solver is their only owner and changes them by `cut`.
    :param gravity: [m/s²], (3,).
    :param tolerance: largest residual force on a part in a converged state [N], or its moment
        over `BondGraph.reach`; default a tenth of the median part's weight.

    :ivar equilibrium: bonds, displacements and loads.
    :ivar goal: tolerance under the present loads [N], see `tolerances`.
    :ivar iterations: number of iterations on each part so far, (N,) int.
    :ivar spent: iterations since the last reset, those of the slowest island.
    :ivar state: counts changes of bonds or displacements.
    :ivar problem: counts changes of bonds or loads.
    :ivar residual: largest nodal residual when last computed [N].
    :ivar sound: displacements of the last stable state, (N + 1, 6).
    :ivar working: number of parts in islands that the last call of `iterate` has not finished.
    """

    equilibrium: Equilibrium
    _gradients: ConjugateGradients
    _past: Superposition
    _step: NewtonStep
    _islands: BondIslands

    def __init__(self, graph: BondGraph, gravity: Sequence[float] = (0.0, 0.0, -GRAVITY),
                 tolerance: float | None = None):
        graph.restore()
        self._make_room(Equilibrium(graph, gravity), tolerance)
        self._begin_anew()

    @classmethod
    def joined(cls, graph: BondGraph, gravity: Sequence[float],
               solvers: Sequence[tuple['StressSolver', int, np.ndarray]]) -> Self:
        """
        Join solvers of parts of a graph, with their present state.

        :param graph: undamaged graph.
        :param gravity: [m/s²], (3,).
        :param solvers: each with the row of its first part here, its parts being consecutive, and
            the rows of its bonds here, (M,).
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
        weight = graph.mass[np.diff(graph.start) > 0] * GRAVITY
        self.tolerance = tolerance or _TOLERANCE * float(np.median(weight if len(weight) else 1.0))
        self._gradients, self._past = ConjugateGradients(graph), Superposition()
        self.state = self.problem = 0

    def reset(self) -> None:
        """Reset bonds, displacements and all loads but the weight."""
        self.graph.restore()
        self.equilibrium.reset()
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Recompute residual, blocks and coarse space from bonds and displacements."""
        self._begin_at_displacements()
        self._gradients.invert_blocks(np.arange(self.graph.count))
        self._refresh()

    def _begin_at_displacements(self) -> None:
        """Restart at the present displacements; the caller updates blocks and coarse space."""
        equilibrium, graph = self.equilibrium, self.graph
        self._step, self._target = NewtonStep.straight(equilibrium), 0.0
        self._begun = self._renewed = False
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
        """Return the bond graph."""
        return self.equilibrium.graph

    @property
    def displacement(self) -> np.ndarray:
        """Return the displacements of the parts [m, rad], world, (N + 1, 6), see `Equilibrium`."""
        return self.equilibrium.displacement

    @property
    def labels(self) -> np.ndarray:
        """Return the component of each part, see `components.label`, (N,)."""
        return self.equilibrium.labels

    @property
    def supported(self) -> np.ndarray:
        """Return the mask of parts connected to the ground, (N,) bool."""
        return self.equilibrium.supported

    def wrenches(self, bonds: np.ndarray | None = None) -> np.ndarray:
        """Return the wrenches of bonds [N, N·m], (K, 6), see `Equilibrium.wrenches`."""
        return self.equilibrium.wrenches(bonds)

    def utilisation(self) -> tuple[np.ndarray, np.ndarray]:
        """Compute utilisation and failure mode of every bond, see `strength.utilisation`."""
        return strength.utilisation(self.graph, self.wrenches())

    def set_loads(self, force: np.ndarray, moment: np.ndarray | None = None) -> None:
        """
        Replace the loads besides the weight: wind, blast, impacts, resting debris.

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
        Break bonds; their forces become residual, redistributed by later iterations.

        :param bonds: rows of the graph, (K,).
        :param dynamic_factor: factor on the released forces until `forget_sudden`: 2
            is the peak of an undamped structure whose support vanishes at once (Biggs 1964,
            Introduction to Structural Dynamics, section 2.3), 1 is slow release.
        """
        bonds = np.asarray(bonds)[self.graph.alive[bonds]]
        if len(bonds):
            self._change(self.equilibrium.cut, bonds, dynamic_factor)

    def narrow(self, bonds: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Open bonds partly and permanently, see `strength.opening` and `BondGraph.narrow`."""
        self._change(self.equilibrium.narrow, bonds, low, high)

    def weaken(self, bonds: np.ndarray, share: np.ndarray) -> None:
        """Scale the stiffness of reinforced bonds by a share each, see `ties`."""
        if len(bonds):
            self._change(self.equilibrium.weaken, bonds, share)

    def crack(self, bonds: np.ndarray) -> None:
        """Crack bonds, which carry no tension from then on, see `Equilibrium.crack`."""
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
        """Finish the present step by line search before loads or bonds change."""
        if not self.known:
            self._finish()
            self._moved()

    def _moved(self, renewed: bool = False) -> None:
        """
        Record that loads, bonds or the bounds of friction have changed.

        :param renewed: whether these bounds are those of the present pressures.
        """
        self._begun, self._renewed = False, renewed
        self._stale_view = True

    def _look(self) -> None:
        """Find the islands out of equilibrium."""
        self._stale_view = False
        if self._gradients.coarse is None:  # no standing parts
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
        Iterate on the islands out of equilibrium.

        :param limit: largest number of iterations.
        :param enough: largest nodal residual to stop at, in tolerances, not less than 1.
        :param least: least motion of hinges; also stop when there are any.
        :returns: the largest nodal residual [N].
        """
        target = self._target = enough * self.goal
        while limit > 0 and not self.converged and not self._exhausted:
            if self._balanced:
                self.equilibrium.joints.release()
                self._renew(np.flatnonzero(self.graph.cracked))
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
        """Start a step of Newton's method at the present displacements."""
        rows = self._islands.cracked(self.graph)
        self._begun, self._step = True, NewtonStep.straight(self.equilibrium)
        if len(rows):
            self._linearise(rows, not self._renewed)
            self._next_step()

    def _end(self) -> None:
        """Finish a step by line search with the true forces, and start the next step."""
        rows = self._islands.cracked(self.graph)
        self._finish()
        self._next_step()
        if not self._step.curved:  # balanced under old friction bounds: update the bounds
            self._renew(rows)

    def _finish(self) -> None:
        """Finish a step by line search with the true forces."""
        self._step.finish(self.equilibrium)
        self._linearise(self._step.rows, False)

    def _next_step(self) -> None:
        """Start a step at the end of the last one."""
        self._look()
        self._step = self._step.next(self.equilibrium, self._islands, self._target, self.goal)
        if self._step.confined:
            self._gradients.confine(self._step.islands)

    def _linearise(self, rows: np.ndarray, renew: bool) -> None:
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

    def _renew(self, rows: np.ndarray) -> None:
        """Let friction follow the pressure, all the way or until parts are out of balance."""
        lag, self.residual = np.inf, 0.0
        while lag > self.goal and self.residual <= self.goal:
            lag = self.equilibrium.linearise(rows)
            self._moved(renewed=True)
            self.residual = float(self.equilibrium.residual_sizes().max(initial=0.0))

    def _refresh(self) -> None:
        """Rebuild the coarse space."""
        self._gradients.aggregate(np.flatnonzero(self.supported))
        self._worked = 0
        if self.known or self._gradients.coarse is None:
            self._look()
        else:  # the islands of a step stay the same
            self._gradients.begin(self._islands)

    def part_hinges(self, least: Reach = PLAY) -> np.ndarray:
        """
        Cut the hinges of a mechanism: cracked joints that open or slide without bound.

        Reset all displacements to the last equilibrium.

        :returns: rows of the graph.
        """
        rows = self._hinges(least)
        self.cut(rows)
        if len(rows):
            self.equilibrium.rewind(self._calm)
        return rows

    def in_motion(self, least: Reach, balanced: bool,
                  furthest: float = SWAY) -> list[np.ndarray]:
        """
        List the mechanisms: connected parts that have moved since the last equilibrium.

        :param least: least motion of hinges.
        :param balanced: whether the displacements are accurate enough to measure drift.
        :param furthest: see `adrift`.
        """
        far = self.adrift(furthest) if balanced else self.mechanisms(furthest)
        moves = len(self._hinges(least)) or len(far)
        if not moves:
            return []
        graph = self.graph
        moved = np.zeros(graph.count + 1, bool)
        moved[self.equilibrium.moved_from(self._calm)] = True
        joined = graph.alive & moved[graph.first] & moved[graph.second]
        labels, _ = components.label(graph.count, graph.first, graph.second, joined)
        return components.groups(labels, moved[:-1])

    def motion(self, parts: np.ndarray) -> np.ndarray:
        """Return displacements and rotations since the last equilibrium [m], [rad], (K, 6)."""
        return (self.displacement - self._calm)[parts]

    def rewind(self) -> None:
        """Return to the displacements of the last equilibrium; loads and bonds stay."""
        self._halt()
        self.equilibrium.rewind(self._calm)
        self._patience = self._worked = 0
        self._moved()
        self.state, self.problem = self.state + 1, self.problem + 1

    def _hinges(self, least: Reach) -> np.ndarray:
        """List the joints that `part_hinges` would cut; none during a step."""
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
        List the parts that have drifted since the last stable state; none during a step.

        :param furthest: threshold of the drift [m]: `DRIFT` or `SWAY`.
        """
        if not self.known:
            return np.zeros(0, np.intp)
        return np.flatnonzero(self.supported & (self.drift > furthest))

    @property
    def drift(self) -> np.ndarray:
        """Return the drift of parts since the last stable state, along x, y or z [m], (N,)."""
        return np.abs(self.displacement - self.sound)[:-1, :3].max(axis=1, initial=0.0)

    def hold(self) -> None:
        """Record the present displacements as stable; drift is measured from them."""
        self.sound = self.displacement.copy()

    def mechanisms(self, furthest: float) -> np.ndarray:
        """
        List the parts without a static equilibrium.

        After convergence, these are the parts displaced too far; otherwise the parts still
        unbalanced when the iterations since the last change have reached their limit.

        :param furthest: see `adrift`.
        """
        if self.converged:
            return self.adrift(furthest)
        return self.unbalanced() if self._exhausted else np.zeros(0, np.intp)

    @property
    def curved(self) -> bool:
        """Whether the islands out of balance have cracked joints."""
        return self._step.curved

    @property
    def _exhausted(self) -> bool:
        """Whether the iterations since the last change have reached their limit."""
        return self._patience >= _PATIENCE and self.known
