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

"""Collapse: what lost the ground leaves its building and joins the debris."""

import numpy as np

from procphys_ros.physics.masonry import FreeBodies
from procphys_ros.physics.world import World
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.standing.buildings import Buildings, Collapse


class Release:
    """
    Hands pieces of buildings over to the world of rigid bodies.

    :param buildings: what stands.
    :param free: bonds of what flies about.
    """

    def __init__(self, buildings: Buildings, free: FreeBodies):
        self._buildings = buildings
        self._free = free

    def let_go(self, collapse: Collapse, world: World, debris: Debris, poses: np.ndarray,
               velocities: np.ndarray) -> None:
        """
        Let every piece that lost the ground fall: single bricks as they are, others in one piece.

        :param collapse: what happened to the buildings.
        :param world: where the bricks stood.
        :param debris: takes the pieces over.
        :param poses: of all parts, (N, 7).
        :param velocities: of all parts, (N, 6).
        """
        if not collapse.pieces:
            return
        self._free.take_over(self._buildings.graph, np.concatenate(collapse.pieces))
        single = np.array([p[0] for p in collapse.pieces if len(p) == 1], np.intp)
        bodies = self._buildings.body[single]
        world.thaw(bodies, velocities[single])
        debris.adopt(single, bodies)
        for parts in collapse.pieces:
            if len(parts) > 1:
                world.remove(self._buildings.body[parts])
                debris.gather(parts, poses[parts], velocities[parts])
