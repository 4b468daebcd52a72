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


"""Steps of Newton's method over cracked joints: tolerance, line search, damping."""

from collections.abc import Callable
from typing import Self

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.physics.masonry import links, subdomains
from procphys_ros.physics.masonry.equilibrium import Equilibrium
from procphys_ros.physics.masonry.islands import BondIslands

_FORCING = 0.1    # of the residual at the start: tolerance of the linear solve of a step
_ITERATIONS = 60  # of conjugate gradients per step: the tangents are out of date by then
_AGREES = 0.3     # of the first power: largest power of the true forces at the end of a step
_ROUGH = 10.0     # tolerances: below this goal a step is solved on all parts
_LESSENED = 0.5   # of its residual: after a confined step that leaves more, solve on all parts
_TRIES = 40       # of the line search
_FURTHEST = 0.5  # [m] largest motion of a part in one step: parts that reach it are a mechanism


class NewtonStep:
    """
    One step from a state whose true forces and tangents are known.

    Inexact Newton with a line search on a convex energy (Nocedal & Wright 2006, Numerical
    Optimization, 3.5 and 7.1), for each island of bonds separately: the power of the true forces
    along the step falls monotonically, and the step ends where it vanishes. Where that is much
    earlier than the tangents predicted, they get stiffer (`CrackedJoints.damp`), as in the
    Levenberg-Marquardt method; where they were right, softer, so that hinges finally move freely.

    :param equilibrium: at the start.
    :param islands: islands to be solved.
    :param size: largest nodal residual [N].
    :param confined: whether the parts around them are fixed, see `subdomains`.

    :ivar islands, size, confined: the same.
    :ivar rows: their cracked joints, (K,); none if the problem is linear.
    :ivar goal: largest nodal residual at which the linear solve stops [N].
    :ivar left: remaining number of iterations.
    :ivar fresh: whether no part has moved since the start.
    """

    islands: BondIslands
    _start: tuple[np.ndarray, np.ndarray] | None

    def __init__(self, equilibrium: Equilibrium, islands: BondIslands, size: float,
                 confined: bool = False):
        self.islands, self.size, self.confined = islands, size, confined
        self.rows = islands.cracked(equilibrium.graph)
        self.goal = _FORCING * size
        self.fresh = True
        self.left = _ITERATIONS if self.curved else np.iinfo(np.int64).max
        self._start = ((equilibrium.displacement.copy(), equilibrium.residual.copy())
                       if self.curved else None)

    @classmethod
    def straight(cls, equilibrium: Equilibrium) -> Self:
        """Return the only step of a linear problem; it needs no line search."""
        none, begin = np.zeros(0, np.int64), np.zeros(1, np.int64)
        return cls(equilibrium, BondIslands(none, none, begin, begin), 0.0)

    def next(self, equilibrium: Equilibrium, islands: BondIslands, target: float,
             tolerance: float) -> 'NewtonStep':
        """
        Start another step at the end of this one: on the worst subdomain alone, or on all parts.

        Parts near a crack take most of the iterations, and parts far from it most of the
        work of each. A confined step moves no forces to far away, though: where one has not
        achieved much, a step on all parts follows.

        :param islands: all islands out of balance.
        :param target: largest nodal residual in the end [N].
        :param tolerance: largest nodal residual of an equilibrium [N].
        """
        sizes, near = equilibrium.residual_sizes(), None
        size = float(sizes.max(initial=0.0))
        goal = max(_FORCING * size, 0.5 * target)
        if goal > _ROUGH * tolerance and not (self.confined and size > _LESSENED * self.size):
            near = subdomains.furthest_off(equilibrium.graph, islands, sizes, goal)
        return NewtonStep(equilibrium, near or islands, size, near is not None)

    @property
    def curved(self) -> bool:
        """Return whether the step needs `finish`: tangents or forces on neighbours change."""
        return self.confined or len(self.rows) > 0

    def spend(self, iterations: int) -> None:
        """Count iterations of the linear solve."""
        if self.curved and iterations:
            self.fresh = False
            self.left -= iterations

    def finish(self, equilibrium: Equilibrium) -> None:
        """
        Move the parts to the end of the step, found by line search.

        :param equilibrium: at the end predicted by the tangents; displacement and residual are
            changed in place.
        """
        assert self._start is not None
        start, before = self._start
        displacement, residual = equilibrium.displacement, equilibrium.residual
        joints, graph = equilibrium.joints, equilibrium.graph
        parts, bonds, part, bond = self.islands
        step = displacement - start
        label = np.repeat(np.arange(len(part) - 1), np.diff(bond))[graph.cracked[bonds]]
        first, last, far = _measure(parts, part, before, residual, step)

        def work(reach: np.ndarray) -> np.ndarray:
            return ((1.0 - reach) * first + reach * last
                    - joints.power(self.rows, label, start, step, reach))

        reach = np.minimum(_reach(work, first, np.maximum(_FURTHEST / far, 1.0)), _FURTHEST / far)
        joints.damp(self.rows, reach[label])
        _shorten(parts, part, reach, start, before, step, displacement, residual)
        if self.confined:
            push = np.zeros_like(residual)
            moved = displacement - start
            links.add_pulls(bonds, graph.links, graph.first, graph.second, moved, push, 1.0)
            links.add_couplings(self.rows, graph.links, graph.coupling, graph.first, graph.second,
                                moved, push, 1.0)
            push[parts] = push[-1] = 0.0
            residual += push


@kernel
def _measure(parts, part, before, residual, step):
    """Compute the power at start and end of a step, and its largest displacement, (I,) each."""
    count = len(part) - 1
    first, last, far = np.zeros(count), np.zeros(count), np.full(count, 1e-12)
    for k in range(count):
        for i in parts[part[k]:part[k + 1]]:
            here, there = 0.0, 0.0
            for c in range(6):
                here += before[i, c] * step[i, c]
                there += residual[i, c] * step[i, c]
            first[k] += here
            last[k] += there
            far[k] = max(far[k], abs(step[i, 0]), abs(step[i, 1]), abs(step[i, 2]))
    return first, last, far


@kernel
def _shorten(parts, part, reach, start, before, step, displacement, residual):
    """Scale the step of each island by its reach."""
    for k in range(len(reach)):
        for i in parts[part[k]:part[k + 1]]:
            for c in range(6):
                displacement[i, c] = start[i, c] + reach[k] * step[i, c]
                residual[i, c] += (1.0 - reach[k]) * (before[i, c] - residual[i, c])


def _reach(work: Callable[[np.ndarray], np.ndarray], first: np.ndarray,
           most: np.ndarray) -> np.ndarray:
    """
    Find the reach of a step: doubling while power is left, regula falsi once it is negative.

    :param work: power of the true forces along the step at some reach, island by island.
    :param first: the same at reach 0, (I,).
    :param most: largest reach, (I,).
    """
    reach = np.ones(len(first))
    low, low_work = np.zeros(len(first)), first.copy()
    high, high_work = np.full(len(first), np.inf), np.zeros(len(first))
    for _ in range(_TRIES):
        now = work(reach)
        ahead, beyond = now > _AGREES * first, now < -_AGREES * first
        low, low_work = np.where(ahead, reach, low), np.where(ahead, now, low_work)
        high, high_work = np.where(beyond, reach, high), np.where(beyond, now, high_work)
        go_on = (ahead & (reach < most)) | beyond
        if not go_on.any():
            break
        bounded = np.isfinite(high)
        share = np.clip(low_work / np.where(bounded, low_work - high_work, 1.0), 0.1, 0.9)
        with np.errstate(invalid='ignore'):
            between = np.where(bounded, low + share * (high - low), np.minimum(2 * reach, most))
        reach = np.where(go_on, between, reach)
    return reach
