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


"""Quasi-static pressure of the gas of a charge in a room, until it has escaped."""

import numpy as np

from procphys_ros.elementary import expm1, log, power
from procphys_ros.physics.loads.air_blast import AMBIENT, SOUND

# The two empirical laws are those usually quoted; the originals could not be read, and physical
# bounds limit them: the heat of combustion of TNT and the flow of hot gas, see below.
_PEAK = 2.25e6       # [Pa] at 1 kg/m³: the law of H. J. Weibull 1968, Ann. N.Y. Acad. Sci. 152,
_EXPONENT = 0.72     # 357, 22.5·(W/V)^0.72 bar up to 5 kg/m³
_DENSEST = 5.0       # [kg/m³]
_HEAT = 14.5e6       # [J/kg] of TNT burnt to CO2, steam and N2: enthalpies of formation of -393.5,
#                      -241.8 and, of TNT, -65 kJ/mol; there is air enough up to 0.3 kg/m³
_OUTFLOW = 2.13      # ln P falls by 2.13·A·a/V in a second: the law of G. F. Kinney and R. G. S.
#                      Sewell 1974, NWC TM 2448; a choked flow, 0.81·A·c/V, of gas of 2,000 K
_ADIABATIC = 1.4     # exponent of air
_LONGEST = 1.0       # [s] after which gas has cooled, even in a tight room
_STEPS = 400


def peak_pressure(charge: float, volume: float) -> float:
    """
    Compute the quasi-static overpressure of the gas in a closed room [Pa].

    :param charge: of TNT [kg].
    :param volume: of the room [m³].
    """
    density = min(charge / volume, _DENSEST)
    return min(_PEAK * power(density, _EXPONENT), (_ADIABATIC - 1.0) * _HEAT * density)


def gas_impulse(peak: float, volume: float, vents: float, walls: float,
                mass: float) -> tuple[float, float]:
    """
    Compute the impulse of the gas on moving walls, and the duration of a triangular pulse.

    The gas escapes through the openings (Kinney & Sewell 1974), and cools as it pushes the walls
    outwards; gaps opening between the walls are neglected.

    :param peak: initial overpressure [Pa].
    :param volume: of the room [m³].
    :param vents: area of its openings [m²].
    :param walls: area of its walls [m²].
    :param mass: of its walls [kg].
    :returns: impulse [Pa·s] and duration [s] of a triangular pulse of the same peak.
    """
    push = peak * (walls * walls) / max(mass, 1.0)  # [m³/s²] initial growth of the room
    outflow = _OUTFLOW * SOUND * vents  # [m³/s]
    step = min(0.02 * np.sqrt(volume / push), 0.02 * volume / max(outflow, 1e-9),
               _LONGEST / _STEPS)
    logarithm, space, rate, impulse = log(1.0 + peak / AMBIENT), volume, 0.0, 0.0
    for _ in range(int(_LONGEST / step)):
        over = AMBIENT * expm1(logarithm)
        if over <= 0.0:
            break
        impulse += over * step
        rate += over * (walls * walls) / max(mass, 1.0) * step
        logarithm -= step * (outflow + _ADIABATIC * rate) / space
        space += rate * step
    return impulse, 2.0 * impulse / peak
