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

"""Wrenches: forces that last until they are cleared."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from procphys_ros.simulation.bounds import checked_vector


class Wrenches:
    """Forces and torques on parts, at most one of each per part."""

    def __init__(self) -> None:
        self._of: dict[int, np.ndarray] = {}

    def put(self, part: int, force: Sequence[float], torque: Sequence[float]) -> None:
        """
        Let a wrench act on a part from now on; zero ends the one that acts.

        :param part: index.
        :param force: at its centre of mass [N], (3,), world axes.
        :param torque: [N·m], (3,), world axes.
        :raises CommandError: when a value is not finite or too large.
        """
        wrench = np.concatenate([checked_vector('force', force),
                                 checked_vector('torque', torque)])
        self._of.pop(part, None)
        if wrench.any():
            self._of[part] = wrench

    def clear(self) -> int:
        """End all of them, and say how many there were."""
        count = len(self._of)
        self._of.clear()
        return count

    def on(self, chosen: Callable[[int], bool]) -> tuple[np.ndarray, np.ndarray]:
        """List the parts that are chosen, (K,), and what acts on them, (K, 6)."""
        parts = [part for part in self._of if chosen(part)]
        return (np.array(parts, np.intp),
                np.array([self._of[part] for part in parts]).reshape(-1, 6))

    def impulses(self, time_step: float) -> Iterator[tuple[int, np.ndarray]]:
        """Give each part with its impulse and angular impulse over a step [s], (6,)."""
        for part, wrench in self._of.items():
            yield part, wrench * time_step
