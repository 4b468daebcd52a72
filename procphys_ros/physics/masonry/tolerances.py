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


"""Tolerances of the stress solver, tighter where loads push an island as a whole."""

import numpy as np

from procphys_ros.geometry.linear import norm
from procphys_ros.physics.masonry import pcg

_COHERENT = 0.3  # tolerances times the root of the number of parts: largest sum of the residuals
#                  in an island; small loads on all parts of a wall together tip it
_WEIGHT = 0.015  # tolerances times the number of parts: the same for small islands; a tolerance of
#                  a tenth of a weight makes it 3 % of the load that tips a wall of slenderness 20
_SHARPER = 0.05  # of small loads on each part: their tolerance
_ALONE = 0.015   # of the sum of the loads: tolerance where they act on one part, as on columns


def sharpened(tolerance: float, residual: np.ndarray, labels: np.ndarray,
              reach: np.ndarray) -> float:
    """
    Compute the tolerance, tightened for loads that push islands as a whole.

    :param tolerance: for loads on single parts, the largest nodal residual [N].
    :param residual: unbalanced loads [N, N·m], (N + 1, 6).
    :param labels: island of each part, (N,).
    :param reach: see `BondGraph`, (N,).
    :returns: largest nodal residual [N].
    """
    total = np.column_stack([np.bincount(labels, residual[:-1, c], len(labels)) for c in range(3)])
    parts = np.bincount(labels, minlength=len(labels))
    most = np.minimum(_COHERENT * np.sqrt(parts), _WEIGHT * parts) * tolerance
    pushed = norm(total, axis=1) > most
    if not pushed.any():
        return tolerance
    largest = float(pcg.residual_sizes(residual, reach)[pushed[labels]].max())
    return min(tolerance, _SHARPER * largest,
               _ALONE * float(norm(total[pushed], axis=1).max()))
