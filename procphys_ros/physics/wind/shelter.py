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

"""
Shelter: reduction of the wind in the lee of stands of trees and of buildings.

Inside a stand the mean wind decays exponentially downwards from its top, u(z) = u(h)·exp(-a·(1 -
z/h)) (Cionco 1965, J. Appl. Meteorology 4:517), with a = 0.28·LAI^(2/3)·h^(1/3)·s^(-1/3) for
leaves of size s (Goudriaan 1977, Crop Micrometeorology; Norman et al. 1995, Agric. For.
Meteorology 77:263). The leaf area index is that of the trees upwind, within three tree heights,
over which the wind adjusts to a canopy (Belcher et al. 2003, J. Fluid Mech. 488:369): those at
the windward edge are exposed to the full wind. A crown does not shelter itself, as the drag
coefficient of foliage is that of whole crowns.

Behind a building of height H the deficit at the distance x is Δu/u(H) = 9.75·(H/x)·η·exp(-0.67·
η^1.5) with η = (z/H)·(K·x/H)^-0.47 and K = 0.32/ln(H/z₀) (Perera 1981, J. Wind Eng. Ind.
Aerodynamics 8:93, after Counihan, Hunt and Jackson 1974, J. Fluid Mech. 64:529; coefficients
quoted from the obstacle model of the European Wind Atlas). It holds beyond five heights; the
value at five heights is used at smaller distances.
"""

from dataclasses import dataclass, field
import math

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import functions, hypot
from procphys_ros.physics.wind.kernel import profile_factor

LEAF_SIZE = 0.1    # [m] s, of most broad leaves and of tufts of needles
_FETCH = 3.0       # heights of a tree: length of its shelter downwind
_NEAREST = 5.0     # heights of a building: least distance of the far wake
_SPREAD = 0.1      # lateral standard deviation of wakes over the distance (estimate)
_LEAST = 0.2       # least share of the wind in any lee (estimate)


@dataclass(frozen=True)
class Shelter:
    """
    Sheltering trees and buildings, as built.

    :ivar trees: x, y, top, radius of the crown [m] and leaf area [m²] of each, (T, 5).
    :ivar buildings: least x and y, greatest x and y, top of each [m], (B, 5).
    """

    trees: np.ndarray = field(default_factory=lambda: np.zeros((0, 5)))
    buildings: np.ndarray = field(default_factory=lambda: np.zeros((0, 5)))

    def apply(self, points: np.ndarray, out: np.ndarray, direction: np.ndarray, profile: tuple,
              roughness: float) -> None:
        """
        Reduce air velocities by the strongest shelter of trees and buildings upwind.

        Eddies and gusts are reduced like the mean wind.

        :param points: (N, 3) [m], world.
        :param out: velocities of the air there, changed in place, (N, 3) [m/s].
        :param direction: of the mean wind, (3,); no shelter without a horizontal component.
        :param profile: from `kernel.profile_terms`.
        :param roughness: roughness length of the ground [m].
        """
        level = hypot(direction[0], direction[1])
        if level > 1e-9 and (len(self.trees) or len(self.buildings)):
            _shelter(points, out, direction[0] / level, direction[1] / level, self.trees,
                     self.buildings, profile, roughness)


@kernel
def _shelter(points, out, ex, ey, trees, buildings, profile, roughness):
    for i in range(len(points)):
        here = profile_factor(points[i, 2], profile[0], profile[1], profile[2])
        if not here > 0.0:
            continue
        left = min(_in_canopy(points[i], ex, ey, trees, profile, here),
                   _in_wakes(points[i], ex, ey, buildings, profile, roughness, here))
        for k in range(3):
            out[i, k] *= left


@subroutine
def _in_canopy(point, ex, ey, trees, profile, here):
    """Compute the share of the wind that remains in the lee of trees upwind of a point."""
    index, heights = 0.0, 0.0
    for t in range(len(trees)):
        dx, dy, reach = point[0] - trees[t, 0], point[1] - trees[t, 1], _FETCH * trees[t, 2]
        along, square = dx * ex + dy * ey, dx * dx + dy * dy
        if along <= 0.0 or square >= reach * reach or square <= trees[t, 3] ** 2:
            continue
        # Sums to the leaf area index of a uniform stand: the weight over the half plane is 1.
        away = math.sqrt(square)
        share = trees[t, 4] * 3.0 / reach ** 2 * (along / away) * (1.0 - away / reach)
        index += share
        heights += share * trees[t, 2]
    if index == 0.0:
        return 1.0
    top = heights / index
    if point[2] >= top:
        return 1.0
    decay = 0.28 * functions.power(index, 2.0 / 3.0) * functions.cbrt(top / LEAF_SIZE)
    inside = profile_factor(top, profile[0], profile[1], profile[2]) * functions.exp(
        -decay * (1.0 - point[2] / top))
    return min(1.0, inside / here)


@subroutine
def _in_wakes(point, ex, ey, buildings, profile, roughness, here):
    """Compute the share of the wind that remains in the strongest wake at a point."""
    left = 1.0
    for b in range(len(buildings)):
        lee, low, high = -np.inf, np.inf, -np.inf
        for cx in (buildings[b, 0], buildings[b, 2]):
            for cy in (buildings[b, 1], buildings[b, 3]):
                lee = max(lee, cx * ex + cy * ey)
                low, high = min(low, cy * ex - cx * ey), max(high, cy * ex - cx * ey)
        top, beyond = buildings[b, 4], point[0] * ex + point[1] * ey - lee
        if beyond <= 0.0 or top <= 2.0 * roughness:
            continue
        blur = math.sqrt(2.0) * _SPREAD * beyond
        aside = point[1] * ex - point[0] * ey
        share = 0.5 * (functions.erf((high - aside) / blur) - functions.erf((low - aside) / blur))
        deficit = share * wake_deficit(max(beyond / top, _NEAREST), point[2] / top,
                                       top / roughness)
        at_top = profile_factor(top, profile[0], profile[1], profile[2])
        left = min(left, max(1.0 - at_top * deficit / here, _LEAST))
    return left


@subroutine
def wake_deficit(distance: float, height: float, size: float) -> float:
    """
    Compute the velocity deficit behind a long solid obstacle over the free wind at its top.

    :param distance: downwind, in heights of the obstacle.
    :param height: above the ground, likewise.
    :param size: height of the obstacle over the roughness length.
    """
    eta = height * functions.power(0.32 / functions.log(size) * distance, -0.47)
    return 9.75 / distance * eta * functions.exp(-0.67 * eta * math.sqrt(eta))
