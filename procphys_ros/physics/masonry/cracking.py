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


"""Progressive failure in which joints crack: they press and rub on, open, close and slide."""

import numpy as np

from procphys_ros.physics.masonry import strength
from procphys_ros.physics.masonry.fracture import Failures, Fracture
from procphys_ros.physics.masonry.solver import StressSolver
from procphys_ros.physics.masonry.strength import Cause


class Cracking(Fracture):
    """
    Let joints crack where `Fracture` breaks them, see `joints` for what cracked ones do.

    A joint pulled or sheared beyond its strength cracks; one that is crushed is gone. Joints that
    never had any strength crack all at once, for they lose nothing. What no equilibrium holds is
    parted at the joints that open or slide in its motion, and falls if that leaves it loose.

    :param solver: loads are set there; bonds crack and break there.
    :param dynamic_factor, band: see `Fracture`.
    """

    def __init__(self, solver: StressSolver, dynamic_factor: float = 1.0, band: float = 0.7):
        super().__init__(solver, dynamic_factor, band)
        mortar = solver.graph.mortar
        self._dry = (mortar.tension == 0.0) & (mortar.cohesion == 0.0)

    def _judge(self, adrift: np.ndarray, least: float) -> Failures:
        """Crack what fails, if anything does; the worst bond must carry `least` its strength."""
        solver, graph = self.solver, self.solver.graph
        share, cause = strength.utilisation(graph, solver.wrenches())
        chosen = np.zeros(len(graph), bool)
        if (solver.converged or not len(adrift)) and share.max(initial=0.0) > least:
            chosen[strength.worst_first(graph, share, self.band)] = True
            chosen |= (share > 1.0) & self._dry
        moving = np.zeros(graph.count + 1, bool)
        moving[adrift] = True
        moving = (moving[graph.first] | moving[graph.second]) & (share > 1.0)
        cause[moving] = Cause.MECHANISM  # nothing to redistribute to: all around it go at once
        bonds = np.flatnonzero(chosen | moving)
        gone = np.isin(cause[bonds], (Cause.COMPRESSION, Cause.MECHANISM))
        solver.crack(bonds[~gone])
        solver.cut(bonds[gone], self.dynamic_factor)
        return Failures(bonds, cause[bonds], share[bonds], gone)
