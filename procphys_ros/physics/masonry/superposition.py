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


"""Superposition: initial guesses of displacements from earlier solutions of linear structures."""

from typing import Any

import numpy as np

from procphys_ros.compilation import kernel

_KEPT = 24  # solutions; wind that turns by 98 degrees in a minute of storm spans 16 patterns
_SMALLEST = 1e-6  # of the largest energy of a solution: least new energy of one that is kept
_BLOCK = 64  # parts that stay in the cache while all solutions are summed


class Superposition:
    """
    Solutions for changes of load, orthonormal in the energy of each building separately.

    The projection of Fischer (1998, Comput. Methods Appl. Mech. Eng. 163, 193-204, method 2): the
    combination of kept solutions that is nearest to the new one in energy. The loads of solutions
    are differences of residuals, which the solver keeps exact, so no product with the
    stiffness is needed, and solutions that have not converged serve as well.
    """

    _start: tuple[np.ndarray, np.ndarray] | None

    def __init__(self) -> None:
        self._start = None
        self.forget(np.zeros(0, np.intp), np.zeros(0, bool))

    def forget(self, labels: np.ndarray, straight: np.ndarray) -> None:
        """
        Discard all solutions after a change of stiffness.

        :param labels: building of each part, (N,).
        :param straight: parts of buildings with a linear response, (N,) bool; there is no guess
            for the others.
        """
        self._owner = np.append(labels, 0)  # the ground, which neither moves nor is loaded
        self._straight = np.append(straight, True)[:, None]
        self._known = 0
        self._answers = self._loads = np.empty((0, len(self._owner), 6))
        self._largest = np.zeros((len(self._owner), 1))  # energy of a solution, per building
        self._start = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without unused capacity, for snapshots."""
        return {**self.__dict__, '_answers': self._answers[:self._known],
                '_loads': self._loads[:self._known]}

    def shift(self, change: np.ndarray) -> None:
        """Record a change of load without a guess of its displacements, (N + 1, 6)."""
        if self._start is not None:
            self._start[1][:] += change

    def guess(self, displacement: np.ndarray, residual: np.ndarray, change: np.ndarray) -> None:
        """
        Add a change of load to the residual, and its guessed solution to the displacements.

        :param displacement: [m, rad], (N + 1, 6), changed in place.
        :param residual: unbalanced load [N, N·m], (N + 1, 6), changed in place.
        :param change: of the load, (N + 1, 6).
        """
        if self._start is not None and not np.array_equal(displacement, self._start[0]):
            self._learn(self._straight * (displacement - self._start[0]),
                        self._straight * (self._start[1] - residual))
        residual += change
        self._project(displacement, residual, 1.0)
        self._start = displacement.copy(), residual.copy()

    def _project(self, answer: np.ndarray, load: np.ndarray, sign: float) -> None:
        """Subtract the projection of a load, and add sign times its solution to `answer`."""
        if self._known:
            _project(self._owner, self._answers[:self._known], self._loads[:self._known], answer,
                     load, sign)

    def _energy(self, answer: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Compute the work of a load on a solution, summed over each building, (N + 1, 1)."""
        work = np.bincount(self._owner, np.einsum('ki,ki->k', answer, load))
        return work[self._owner, None]

    def _learn(self, answer: np.ndarray, load: np.ndarray) -> None:
        """Keep the solution since the last guess, if a relevant part of its energy is new."""
        self._largest = np.maximum(self._largest, self._energy(answer, load))
        self._project(answer, load, -1.0)
        energy = self._energy(answer, load)
        new = energy > _SMALLEST * self._largest
        if not new.any():
            return
        if self._known == _KEPT:
            self._known = 0
        if self._known == len(self._answers):
            self._answers, self._loads = (_with_room(known) for known in (self._answers,
                                                                          self._loads))
        scale = np.where(new, 1.0 / np.sqrt(np.where(new, energy, 1.0)), 0.0)
        self._answers[self._known] = scale * answer
        self._loads[self._known] = scale * load
        self._known += 1


def _with_room(known: np.ndarray) -> np.ndarray:
    """Extend an array of solutions or loads to full capacity, (_KEPT, N + 1, 6)."""
    room = np.empty((_KEPT, *known.shape[1:]))
    room[:len(known)] = known
    return room


@kernel
def _project(owner, answers, loads, answer, load, sign):
    """
    Subtract the projection of a load, by building, and add sign times its solution to `answer`.

    :param owner: building of each part, (N + 1,).
    :param answers, loads: orthonormal solutions and their loads, (K, N + 1, 6).
    :param answer, load: (N + 1, 6), changed in place.
    """
    shares = np.zeros((len(answers), len(owner)))
    for k in range(len(answers)):
        for i in range(len(owner)):
            work = 0.0
            for c in range(6):
                work += answers[k, i, c] * load[i, c]
            shares[k, owner[i]] += work
    for first in range(0, len(owner), _BLOCK):
        for k in range(len(answers)):
            for i in range(first, min(first + _BLOCK, len(owner))):
                share = shares[k, owner[i]]
                for c in range(6):
                    answer[i, c] += sign * share * answers[k, i, c]
                    load[i, c] -= share * loads[k, i, c]
