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
Air blast of a charge of TNT: pressure, duration, impulse, arrival.

Curves of Kingery & Bulmash (`kingery_bulmash`) over the scaled distance Z = R / W^(1/3)
[m/kg^(1/3)] for a spherical charge in free air and a hemispherical one on the ground. Times and
impulses of W kg are W^(1/3) those of 1 kg. `ground` is 0 for the one, 1 for the other; between
them logarithms are interpolated.
"""

import numpy as np

from procphys_ros.elementary import atan, cbrt, cos, power, sin
from procphys_ros.physics.loads import kingery_bulmash as fits

AMBIENT = 101_325.0      # [Pa]
SOUND = 340.3           # [m/s] at 15 °C
_FREE_AIR = 1.0          # [m/kg^(1/3)] least scaled height of a free-air burst
_FAR_PRESSURE = -1.4066  # exponents of Z beyond the range of the fits: those of Swisdak 1994 for
_FAR_IMPULSE = -1.062    # the last part of it


def _curve(air: fits.Fit, ground_fit: fits.Fit, z: np.ndarray, ground: float,
           unit: float) -> np.ndarray:
    z = np.asarray(z, float)
    return unit * (power(fits.evaluate(air, z), 1.0 - ground)
                   * power(fits.evaluate(ground_fit, z), ground))


def _beyond(z: np.ndarray) -> np.ndarray:
    """Return the distance over the largest distance of the fits, at least 1."""
    return np.maximum(np.asarray(z, float) / fits.MOST, 1.0)


def overpressure(z: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """
    Compute the peak side-on overpressure [Pa].

    :param z: scaled distance [m/kg^(1/3)].
    :param ground: share of a burst on the ground.
    """
    return power(_beyond(z), _FAR_PRESSURE) * _curve(
        fits.PRESSURE_AIR, fits.PRESSURE_GROUND, z, ground, fits.PRESSURE_UNIT)


def reflected(z: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """Compute the peak overpressure on a wall normal to the wave [Pa]."""
    return power(_beyond(z), _FAR_PRESSURE) * _curve(
        fits.REFLECTED_AIR, fits.REFLECTED_GROUND, z, ground, fits.PRESSURE_UNIT)


def impulse(z: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """Compute the side-on impulse of the positive phase [Pa·s/kg^(1/3)]."""
    return power(_beyond(z), _FAR_IMPULSE) * _curve(
        fits.IMPULSE_AIR, fits.IMPULSE_GROUND, z, ground, fits.IMPULSE_UNIT)


def reflected_impulse(z: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """Compute the impulse of the positive phase on a wall normal to the wave [Pa·s/kg^(1/3)]."""
    return power(_beyond(z), _FAR_IMPULSE) * _curve(
        fits.REFLECTED_IMPULSE_AIR, fits.REFLECTED_IMPULSE_GROUND, z, ground, fits.IMPULSE_UNIT)


def cleared_impulse(z: np.ndarray, front: np.ndarray | float,
                    ground: float = 0.0) -> np.ndarray:
    """
    Compute the impulse on a wall normal to the wave, with clearing over its edges.

    UFC 3-340-02, 2-15.3: the reflected pressure falls linearly to the sum of side-on and
    dynamic pressure within 4·S / ((1 + S/G)·c); these go on falling linearly. S is the
    lesser of the height and half the width of the wall, G the greater. The reflected impulse of an
    infinite wall is the upper bound; it remains where the wave has passed before the pressure
    can fall, as near a charge. The sound speed c in the reflected wave follows from the
    Rankine-Hugoniot relations, where the UFC reads it off a curve; the drag coefficient is 1.

    :param z: scaled distance [m/kg^(1/3)], (K,).
    :param front: S and G [m/kg^(1/3)], (2, K); inf = an infinite wall.
    :param ground: share of a burst on the ground.
    :returns: [Pa·s/kg^(1/3)], (K,).
    """
    most = reflected_impulse(z, ground)
    less, greater = np.broadcast_to(np.asarray(front, float), (2, *np.shape(z)))
    endless = np.isinf(less)
    if endless.all():
        return most
    side_on = overpressure(z, ground)
    square = np.divide(less, greater, out=np.ones(np.shape(z)), where=~endless)
    time = 4.0 * less / ((1.0 + square) * _reflected_sound(side_on))
    end = 2.0 * impulse(z, ground) / side_on
    endless = endless | (time >= end)
    time = np.minimum(time, end)
    then = (side_on + dynamic_pressure(side_on)) * (1.0 - time / end)
    cleared = np.minimum(0.5 * (reflected(z, ground) * time + then * end), most)
    return np.where(endless, most, cleared)


def _reflected_sound(pressure: np.ndarray) -> np.ndarray:
    """Compute the speed of sound behind a reflected shock of a side-on overpressure [m/s]."""
    square = 1.0 + 6.0 * pressure / (7.0 * AMBIENT)  # of the Mach number
    heat = (0.8 * square + 1.6) * (3.2 * square - 0.8) / (5.76 * square)
    return SOUND * np.sqrt(heat)


def duration(z: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """Compute the duration of the positive phase [s/kg^(1/3)]."""
    return _curve(fits.DURATION_AIR, fits.DURATION_GROUND, z, ground, fits.TIME_UNIT)


def arrival(z: np.ndarray, ground: float = 0.0) -> np.ndarray:
    """Compute the arrival time of the front [s/kg^(1/3)]."""
    beyond = np.maximum(np.asarray(z, float) - fits.MOST, 0.0) / SOUND
    return beyond + _curve(fits.ARRIVAL_AIR, fits.ARRIVAL_GROUND, z, ground, fits.TIME_UNIT)


def dynamic_pressure(pressure: np.ndarray) -> np.ndarray:
    """Compute the dynamic pressure [Pa] of the air behind a shock of an overpressure."""
    return 2.5 * (pressure * pressure) / (7.0 * AMBIENT + pressure)


def dynamic_load_factor(phase: np.ndarray) -> np.ndarray:
    """
    Compute the dynamic load factor: largest deflection under a triangular pulse over the static.

    Of an undamped oscillator (Biggs 1964, Introduction to Structural Dynamics, 2.5): phase/2 for a
    short pulse, 2 for an infinite one.

    :param phase: angular frequency of the oscillator times the duration of the pulse, (K,).
    """
    phase = np.maximum(phase, 1e-3)
    after = np.sqrt(np.maximum(
        1.0 + 2.0 * (1.0 - cos(phase)) / (phase * phase) - 2.0 * sin(phase) / phase, 0.0))
    turn = atan(phase)  # half of the phase at which the deflection is largest
    return np.where(2.0 * turn < phase, 2.0 * (1.0 - turn / phase), after)


def shock_speed(pressure: np.ndarray) -> np.ndarray:
    """Compute the speed [m/s] of a shock of an overpressure (Rankine-Hugoniot)."""
    return SOUND * np.sqrt(1.0 + 6.0 * pressure / (7.0 * AMBIENT))


def ground_share(charge: float, height: float) -> float:
    """
    Compute the interpolation parameter of a burst: 1 on the ground, 0 in free air.

    The linear interpolation stands for Mach stems, which the curves do not include.

    :param charge: mass of TNT [kg].
    :param height: of the charge above ground [m].
    """
    return max(0.0, 1.0 - max(height, 0.0) / (_FREE_AIR * cbrt(charge)))
