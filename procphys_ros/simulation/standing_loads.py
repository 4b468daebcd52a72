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


"""Loads on standing walls besides their weight: one layer for each thing that presses."""

import numpy as np

from procphys_ros.physics.masonry import StressSolver


class StandingLoads:
    """
    Sums what different sources put on standing parts and hands it to the stress solver.

    Nothing reaches the solver while nothing changes, so that standing walls cost nothing.

    :param solver: of the stresses in all buildings.
    """

    def __init__(self, solver: StressSolver):
        self._solver = solver
        self._layers: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._changed = False

    def put(self, source: str, parts: np.ndarray, wrenches: np.ndarray) -> None:
        """
        Replace everything that a source presses with.

        :param source: name of the layer, such as 'wind' or 'debris'.
        :param parts: indices; one that stands twice gets both, (K,).
        :param wrenches: force at the centre of mass and moment [N], [N·m], world, (K, 6).
        """
        parts, wrenches = np.asarray(parts, np.intp), np.asarray(wrenches, float)
        before = self._layers.pop(source, None)
        if len(parts):
            self._layers[source] = parts, wrenches
        same = (before is not None and np.array_equal(before[0], parts)
                and np.array_equal(before[1], wrenches))
        self._changed |= not same and (before is not None or len(parts) > 0)

    def take_off(self, source: str) -> None:
        """End a layer, if there is one."""
        self._changed |= self._layers.pop(source, None) is not None

    def clear(self) -> None:
        """Forget all layers; the solver has been reset."""
        self._layers.clear()
        self._changed = False

    def apply(self) -> None:
        """Tell the solver when anything has changed; before it works on the stresses."""
        if not self._changed:
            return
        total = np.zeros((self._solver.graph.count, 6))
        for parts, wrenches in self._layers.values():
            np.add.at(total, parts, wrenches)
        self._solver.set_loads(total[:, :3], total[:, 3:])
        self._changed = False
