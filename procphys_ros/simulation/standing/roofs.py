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


"""Roofs: the skyline of the buildings of a scene, drawn anew when they have changed."""

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.skyline import Skyline
from procphys_ros.physics.touch import piece_bounds
from procphys_ros.simulation.standing.buildings import Buildings

_PATIENCE = 15  # times that the old one is given while a building comes down


class Roofs:
    """
    Keeps the skyline of what stands.

    :param blueprint: all parts of the scene.
    :param buildings: its masonry.
    """

    def __init__(self, blueprint: Blueprint, buildings: Buildings):
        self._blueprint = blueprint
        self._buildings = buildings
        self.reset()

    def reset(self) -> None:
        """Forget what was drawn."""
        self._drawn: Skyline | None = None
        self._standing = np.zeros(0, bool)
        self._asked = 0

    def skyline(self) -> Skyline:
        """Give the present skyline; it is the same object while nothing has changed."""
        self._asked += 1
        standing = self._buildings.standing
        if self._drawn is None or (self._asked > _PATIENCE
                                   and not np.array_equal(standing, self._standing)):
            self._standing, self._asked = standing.copy(), 0
            self._drawn = self._draw(np.flatnonzero(standing))
        return self._drawn

    def _draw(self, parts: np.ndarray) -> Skyline:
        source = self._blueprint
        return Skyline.over(piece_bounds(
            source.shape[parts].astype(np.uint8), source.poses[parts], source.solid_size(parts),
            np.zeros((len(parts), 6)), 0.0, 0.0))
