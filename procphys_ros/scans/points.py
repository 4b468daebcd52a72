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

"""Points of a skeleton with a parent each, and the cylinders between them."""

import numpy as np

from procphys_ros.scans.cylinders import Cylinders


def between(points: np.ndarray, parents: np.ndarray, radii: np.ndarray) -> Cylinders:
    """
    Make the cylinders that end at points; points without a parent are the feet of trees.

    :param points: (K, 3).
    :param parents: index of each point's parent, -1 = none, (K,) int.
    :param radii: at the points, (K,); NaN = unknown.
    """
    tip = np.flatnonzero(parents >= 0)
    cylinder = np.full(len(points), -1)
    cylinder[tip] = np.arange(len(tip))
    above = parents[tip]
    return Cylinders(cylinder[above], points[above], points[tip], radii[tip], radii[above],
                     tapered=True)
