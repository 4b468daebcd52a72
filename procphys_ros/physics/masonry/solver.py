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

from collections.abc import Sequence

import numpy as np

from procphys_ros.physics.masonry import components, links, pcg, strength
from procphys_ros.physics.masonry.coarse import CoarseSpace
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.superposition import Superposition

_AGGREGATE = 8       # parts per aggregate: cheapest sum of iterations and coarse solves (bench)
_TOLERANCE = 0.1     # of the median part's weight: largest nodal residual of a converged state
_STALE_AFTER = 120   # iterations since a change after which the coarse space is renewed: it costs
#                      as much as about 35 iterations, and most changes are answered sooner
_PATIENCE = 2000     # iterations since a change after which what is unbalanced is a mechanism
_ADRIFT = 0.25       # [m] displacement at which a part counts as a mechanism: more than a brick,
#                      so bonds are no longer where linear theory has them; sound masonry moves
#                      by less than a millimetre, timber floors by a few
_STANDARD_GRAVITY = 9.81  # [m/s²], only scales the tolerance


class StressSolver:
    """
    Resumable equilibrium of the supported islands of a bond graph.

    The residual f - K·u is kept exactly through every change (loads, cuts), so what must be worked
    on is simply where it is too large: islands whose largest nodal residual exceeds the tolerance.
    The others cost nothing. Parts without a path of bonds to the ground are falling: excluded.

    :param graph: the bonds; the solver is their only owner and changes them by `cut`.
    :param gravity: [m/s²], (3,).
    :param tolerance: largest nodal residual of a converged state [N], the force on a part or its
        moment over `BondGraph.reach`; default a tenth of the median part's weight.

    :ivar displacement: of the parts, u and φ [m, rad], world, (N, 6); last row is the ground.
    :ivar iterations: spent on each part so far, (N,) int.
    :ivar spent: iterations done since the last reset, those of the slowest island.
    :ivar state: changes with every change of bonds or displacements, never comes back.
    :ivar problem: changes with every change of bonds or loads, never comes back.
    :ivar residual: largest nodal residual of the last look [N].
    :ivar working: number of parts in islands that the last call of `iterate` has not finished.
    :ivar labels: component of each part, see `components.label`, (N,).
    :ivar supported: parts that hold on to the ground, (N,) bool.
    """

    def __init__(self, graph: BondGraph, gravity: Sequence[float] = (0.0, 0.0, -9.81),
                 tolerance: float | None = None):
        self.graph = graph
        count = graph.count
        bonded = np.diff(graph.start) > 0
        weight = graph.mass[bonded] * _STANDARD_GRAVITY
        self.tolerance = tolerance or _TOLERANCE * float(np.median(weight if len(weight) else 1.0))
        self._weight = np.zeros((count + 1, 6))
        self._weight[:-1, :3] = graph.mass[:, None] * np.asarray(gravity, float)
        self._search = np.zeros((3, count + 1, 6))  # z, p, q of the conjugate gradients
        self._blocks = np.empty((count, 6, 6))
        self._past = Superposition()
        self._coarse: CoarseSpace | None = None
        self.state = self.problem = 0
        self.reset()

    def reset(self) -> None:
        """Return to whole bonds, no loads but the weight, and no displacement."""
        graph = self.graph
        graph.restore()
        self.displacement = np.zeros((graph.count + 1, 6))
        self._given = np.zeros((graph.count + 1, 6))
        self._sudden = np.zeros((graph.count + 1, 6))
        self._residual = self._weight.copy()
        self.iterations = np.zeros(graph.count, np.int64)
        self.spent = self._patience = 0
        self.state += 1
        self.problem += 1
        self._bonds_changed(np.arange(graph.count))
        self._relabel()
        self._past.forget(self.labels)
        self._refresh()

    def adopt(self, other: 'StressSolver', first: int, bonds: np.ndarray) -> None:
        """
        Go on from where a solver of some of these parts is; call `resume` after the last one.

        :param other: of parts that follow each other here, and of all their bonds.
        :param first: its first part here.
        :param bonds: rows here of its bonds, (M,).
        """
        self.graph.adopt(other.graph, np.arange(len(other.graph)), bonds)
        rows = slice(first, first + other.graph.count)
        for mine, theirs in ((self.displacement, other.displacement),
                             (self._given, other._given), (self._sudden, other._sudden),
                             (self._residual, other._residual)):
            mine[rows] = theirs[:-1]
        self.iterations[rows] = other.iterations

    def resume(self) -> None:
        """Take note that others' states were adopted."""
        self._bonds_changed(np.arange(self.graph.count))
        self._relabel()
        self._past.forget(self.labels)
        self._refresh()
        self.state += 1
        self.problem += 1

    def set_loads(self, force: np.ndarray, moment: np.ndarray | None = None) -> None:
        """
        Replace the loads that act besides the weight: wind, blast, impacts, what rests on parts.

        :param force: at the centres of mass, world [N], (N, 3).
        :param moment: about the centres of mass, world [N·m], (N, 3).
        """
        new = np.zeros_like(self._given)
        new[:-1, :3] = force
        if moment is not None:
            new[:-1, 3:] = moment
        if not np.all(np.isfinite(new)):
            raise ValueError('loads must be finite')
        change = new - self._given
        change[:-1][~self.supported] = 0.0
        if np.any(change[:-1]):
            self._past.guess(self.displacement, self._residual, change)
            self._stale_view = True
            self.state += 1
            self.problem += 1
        self._given = new

    def cut(self, bonds: np.ndarray, dynamic_factor: float = 1.0) -> None:
        """
        Break bonds; what they carried becomes residual and is redistributed by later iterations.

        :param bonds: rows of the graph, (K,).
        :param dynamic_factor: how many times the released forces count until `forget_sudden`: 2
            is the peak of an undamped structure whose support vanishes at once (Biggs 1964,
            Introduction to Structural Dynamics, section 2.3), 1 is slow release.
        """
        graph = self.graph
        bonds = np.asarray(bonds)
        bonds = bonds[graph.alive[bonds]]
        if not len(bonds):
            return
        released = np.zeros_like(self._residual)
        links.add_pulls(bonds, graph.links, graph.first, graph.second, self.displacement,
                        released, -1.0)
        graph.cut(bonds)
        self._residual += dynamic_factor * released
        self._sudden += (dynamic_factor - 1.0) * released
        self._relabel()
        self._after_change(bonds)

    def crack(self, bonds: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Open bonds partly, see `strength.opening` and `BondGraph.narrow`."""
        graph = self.graph
        for sign, change in ((-1.0, lambda: graph.narrow(bonds, low, high)), (1.0, None)):
            links.add_pulls(bonds, graph.links, graph.first, graph.second, self.displacement,
                            self._residual, sign)
            if change:
                change()
        self._after_change(bonds)

    def remove_parts(self, parts: np.ndarray, dynamic_factor: float = 2.0) -> np.ndarray:
        """
        Take parts out at once; their neighbours feel it with the dynamic factor of `cut`.

        :returns: the bonds that this cut.
        """
        bonds = self.graph.neighbours(parts)
        bonds = bonds[self.graph.alive[bonds]]
        self.cut(bonds, dynamic_factor)
        return bonds

    def forget_sudden(self, share: float = 1.0) -> None:
        """
        Let the dynamic part of released forces die away, as damping does.

        :param share: how much of it goes, 1 all; 1 - exp(-dt/T) for a decay with time constant T.
        """
        if np.any(self._sudden):
            change = -share * self._sudden
            self._residual += change
            self._past.shift(change)
            self._stale_view = True
            self.problem += 1
            self._sudden *= 1.0 - share

    @property
    def sudden(self) -> bool:
        """Whether dynamic loads of released forces still act."""
        return bool(np.any(self._sudden))

    @property
    def sudden_loads(self) -> np.ndarray:
        """Dynamic part of released forces that still acts on each part [N], [N·m], (N, 6)."""
        return self._sudden[:-1]

    def _after_change(self, bonds: np.ndarray) -> None:
        graph = self.graph
        touched = np.unique(np.concatenate([graph.first[bonds], graph.second[bonds]]))
        self._bonds_changed(touched[touched < graph.count])
        self._coarse_fresh = False
        self._stale_view = True
        self._patience = 0
        self._past.forget(self.labels)
        self.state += 1
        self.problem += 1

    def _bonds_changed(self, parts: np.ndarray) -> None:
        graph = self.graph
        if not len(graph):  # trees only: nothing to compile for
            return
        links.diagonal_inverses(parts, graph.start, graph.incident, graph.alive, graph.links,
                                graph.first, self._blocks)

    def _relabel(self) -> None:
        """Find the islands; those that lost the ground leave the system."""
        graph = self.graph
        self.labels, self.supported = components.label(graph.count, graph.first, graph.second,
                                                       graph.alive)
        for array in (self.displacement, self._residual, self._sudden):
            array[:-1][~self.supported] = 0.0

    def _look(self) -> None:
        """Find the islands out of equilibrium: the active parts and bonds."""
        graph = self.graph
        self._stale_view = False
        if self._coarse is None:  # nothing stands, so nothing is loaded
            self.residual, self.working = 0.0, 0
            return
        size = pcg.residual_sizes(self._residual, graph.reach)
        self.residual = float(size.max(initial=0.0))
        active = np.zeros(graph.count + 1, bool)
        if self.residual > self.tolerance:
            restless = np.zeros(graph.count, bool)
            restless[self.labels[size > self.tolerance]] = True
            active[:-1] = restless[self.labels] & self.supported
        parts = np.flatnonzero(active)
        bonds = np.flatnonzero(graph.alive & (active[graph.first] | active[graph.second]))
        ends = np.minimum(graph.first[bonds], graph.second[bonds])  # never the ground
        parts, part = _grouped(parts, self.labels[parts])
        bonds, bond = _grouped(bonds, self.labels[ends])
        reached = self._coarse.reached(parts[part[:-1]])
        self._islands = parts, bonds, self._coarse.factor.columns, part, bond, reached
        self._products = np.zeros(len(reached))
        self.working = len(parts)

    @property
    def converged(self) -> bool:
        """Whether every supported part is in equilibrium within the tolerance."""
        if self._stale_view:
            self._look()
        return self.residual <= self.tolerance

    def iterate(self, limit: int, enough: float = 1.0) -> float:
        """
        Work on the islands out of equilibrium.

        :param limit: largest number of iterations.
        :param enough: largest nodal residual to stop at, in tolerances, not less than 1.
        :returns: the largest nodal residual [N].
        """
        target = enough * self.tolerance
        while limit > 0 and not self.converged and self._patience < _PATIENCE:
            if self.residual <= target:
                break
            stale = not self._coarse_fresh
            if stale and self._patience >= _STALE_AFTER:
                self._refresh()
                continue
            now = min(limit, _STALE_AFTER - self._patience) if stale else limit
            done = self._run(now, target)
            limit -= max(done, 1)
        return self.residual

    def _run(self, limit: int, target: float) -> int:
        graph, coarse = self.graph, self._coarse
        assert coarse is not None
        preconditioner = (self._blocks, coarse.owner, coarse.arm, coarse.factor.panels,
                          *np.empty((2, coarse.count, 6)))
        state = (self.displacement, self._residual, *self._search)
        each, left = pcg.iterate(
            self._islands, (graph.links, graph.first, graph.second), preconditioner, state,
            graph.reach, self._products, target, limit)
        parts, size = self._islands[0], np.diff(self._islands[3])
        self.iterations[parts] += np.repeat(each, size)
        self.residual = float(left.max(initial=0.0))
        self.working = int(size[left > target].sum())
        done = int(each.max(initial=0))
        self.spent += done
        self.state += 1
        self._patience = 0 if self.residual <= self.tolerance else self._patience + done
        return done

    def _refresh(self) -> None:
        """Aggregate anew what is connected now, and factor."""
        parts = np.flatnonzero(self.supported)
        self._coarse = CoarseSpace(self.graph, parts, _AGGREGATE) if len(parts) else None
        self._coarse_fresh = True
        self._look()

    def wrenches(self) -> np.ndarray:
        """
        Give force and moment with which the second part pulls the first, in the bond frames.

        Tension is positive along z [N, N·m], (M, 6); zero for dead bonds and falling islands.
        """
        graph = self.graph
        out = np.empty((len(graph), 6))
        links.pulls(np.arange(len(graph)), graph.links, graph.axes, graph.first, graph.second,
                    self.displacement, out)
        return out

    def utilisation(self) -> tuple[np.ndarray, np.ndarray]:
        """Give utilisation and `strength.Cause` of every bond, see `strength.utilisation`."""
        return strength.utilisation(self.graph, self.wrenches())

    def unbalanced(self) -> np.ndarray:
        """List the parts whose nodal residual exceeds the tolerance."""
        size = pcg.residual_sizes(self._residual, self.graph.reach)
        return np.flatnonzero((size > self.tolerance) & self.supported)

    def adrift(self) -> np.ndarray:
        """List the parts displaced by more than 25 cm."""
        far = np.abs(self.displacement[:-1, :3]) > _ADRIFT
        return np.flatnonzero(far.any(axis=1)) if far.any() else np.zeros(0, np.intp)

    def mechanisms(self) -> np.ndarray:
        """
        List the parts that no static equilibrium worth the name holds.

        Converged, these are the parts displaced by more than 25 cm; otherwise the parts still
        unbalanced when the iterations since the last change have run out of patience.
        """
        if self.converged:
            return self.adrift()
        return self.unbalanced() if self._patience >= _PATIENCE else np.zeros(0, np.intp)


def _grouped(rows: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort rows by their labels, and give the start of each label's rows, with the end."""
    order = np.argsort(labels, kind='stable')
    cuts = np.flatnonzero(np.diff(labels[order])) + 1
    return rows[order], np.concatenate([[0], cuts, [len(rows)]] if len(rows) else [[0]])
