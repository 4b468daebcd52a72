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
Petioles: strength of leaves, and the wind speed that tears them off.

Drag and strength are both proportional to leaf area (petioles grow in proportion to their blades,
Niklas 1999, New Phytologist 143:19), so failure depends on the local wind speed alone.
"""

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import power, weibull
from procphys_ros.physics.air import AIR_DENSITY, CALM, LEAF_DRAG, SHEDDING_SPEED

_STORM = 20.0  # [m/s] wind speed up to which leaves roll up, from `CALM` on
_STREAMLINING = -0.85  # Vogel exponent there (Vogel 1989, J. Exp. Botany 40:941, 10 and 20 m/s)

# A hurricane of category 3 (50 m/s) strips trees (Simpson 1974, Weatherwise 27).
_STRIPPED = 50.0 / SHEDDING_SPEED  # speed that tears off 63 % of leaves, over the least speed
_WEIBULL_SHAPE = 2.0  # of strengths above the least


def drag_pressure(speed: np.ndarray | float) -> np.ndarray:
    """
    Compute the drag of leaves per area [N/m²].

    :param speed: of the air past the leaf [m/s], (...).
    """
    speed = np.asarray(speed, float)
    rolled = power(np.clip(speed, CALM, _STORM) / CALM, _STREAMLINING)
    return 0.5 * AIR_DENSITY * LEAF_DRAG * rolled * (speed * speed)


def speed_of(pressure: np.ndarray) -> np.ndarray:
    """
    Invert `drag_pressure`.

    :param pressure: drag per leaf area [N/m²], (...).
    """
    root = np.sqrt(np.asarray(pressure, float) / (0.5 * AIR_DENSITY * LEAF_DRAG))
    half = 0.5 * _STREAMLINING
    rolling = power(root * power(CALM, half), 1.0 / (1.0 + half))
    beyond = root * power(CALM / _STORM, half)
    return np.where(root <= CALM, root, np.where(rolling <= _STORM, rolling, beyond))


def strengths(area: np.ndarray, shedding_speed: np.ndarray | float,
              rng: np.random.Generator) -> np.ndarray:
    """
    Draw the strength of each petiole [N], (L,).

    A Weibull distribution above a least strength: weaker leaves have already fallen.

    :param area: of the leaves [m²], (L,).
    :param shedding_speed: least wind that tears off each leaf [m/s], (L,) or one for all.
    :param rng: source of the strengths.
    """
    least = drag_pressure(shedding_speed)
    scale = drag_pressure(_STRIPPED * shedding_speed) - least
    return np.asarray(area) * (least + scale * weibull(rng, _WEIBULL_SHAPE, len(area)))


@kernel
def air_speeds(air, velocities, active, out):
    """
    Compute the speed of the air relative to segments [m/s], 0 for inactive ones.

    :param air: air velocity at the segments [m/s], (S, 3).
    :param velocities: of the segments, linear first, (S, 6).
    :param active: (S,) bool.
    :param out: (S,), written.
    """
    for i in range(len(out)):
        x, y, z = (air[i, 0] - velocities[i, 0], air[i, 1] - velocities[i, 1],
                   air[i, 2] - velocities[i, 2])
        out[i] = np.sqrt(x * x + y * y + z * z) if active[i] else 0.0
