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


"""Superposition: earlier answers of a linear structure, added up to guess the next one."""

import numpy as np

_KEPT = 12  # answers; wind on one building spans about 7: its speed, and each façade that it meets
_SMALLEST = 1e-6  # share of the largest energy of an answer that must be new to be worth keeping


class Superposition:
    """
    Keeps answers to changes of load, orthonormal in the energy of each building by itself.

    The projection of Fischer (1998, Comput. Methods Appl. Mech. Eng. 163, 193-204, method 2): the
    combination of kept answers that is nearest to the new one in energy. The loads that answers
    belong to are differences of residuals, which the solver keeps exactly, so no product with the
    stiffness is needed, and answers that were not iterated to the end serve as well.
    """

    def __init__(self) -> None:
        self._start: tuple[np.ndarray, np.ndarray] | None = None
        self.forget(np.zeros(0, np.intp), np.zeros(0, bool))

    def forget(self, labels: np.ndarray, straight: np.ndarray) -> None:
        """
        Drop all: the stiffness has changed.

        :param labels: which building each part belongs to, (N,).
        :param straight: parts whose building answers loads in proportion, (N,) bool; nothing is
            guessed for the others.
        """
        self._owner = np.append(labels, 0)  # the ground, which neither moves nor is loaded
        self._straight = np.append(straight, True)[:, None]
        self._answers: list[np.ndarray] = []
        self._loads: list[np.ndarray] = []
        self._largest = np.zeros((len(self._owner), 1))  # energy of an answer, per building
        self._start = None

    def shift(self, change: np.ndarray) -> None:
        """Note a change of load that is not to be guessed, (N + 1, 6)."""
        if self._start is not None:
            self._start[1][:] += change

    def guess(self, displacement: np.ndarray, residual: np.ndarray, change: np.ndarray) -> None:
        """
        Add a change of load to the residual, and to the displacement what is known to answer it.

        :param displacement: [m, rad], (N + 1, 6), changed in place.
        :param residual: load that nothing balances yet [N, N·m], (N + 1, 6), changed in place.
        :param change: of the load, (N + 1, 6).
        """
        if self._start is not None:
            self._learn(self._straight * (displacement - self._start[0]),
                        self._straight * (self._start[1] - residual))
        residual += change
        for answer, load in zip(self._answers, self._loads):
            share = self._work(answer, residual)
            displacement += share * answer
            residual -= share * load
        self._start = displacement.copy(), residual.copy()

    def _work(self, answer: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Give the work of a load on an answer, summed over each building, (N + 1, 1)."""
        work = np.bincount(self._owner, np.einsum('ki,ki->k', answer, load))
        return work[self._owner, None]

    def _learn(self, answer: np.ndarray, load: np.ndarray) -> None:
        """Keep what was done since the last guess, unless next to nothing of it is new."""
        self._largest = np.maximum(self._largest, self._work(answer, load))
        for known, its_load in zip(self._answers, self._loads):
            share = self._work(known, load)
            answer -= share * known
            load -= share * its_load
        energy = self._work(answer, load)
        new = energy > _SMALLEST * self._largest
        if not new.any():
            return
        if len(self._answers) == _KEPT:
            self._answers.clear()
            self._loads.clear()
        scale = np.where(new, 1.0 / np.sqrt(np.where(new, energy, 1.0)), 0.0)
        self._answers.append(scale * answer)
        self._loads.append(scale * load)
