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

Fits of Kinney & Graham, *Explosive Shocks in Air*, 2nd ed. 1985, chapter 6, for a free spherical
charge, over the scaled distance Z = R / W^(1/3) [m/kg^(1/3)]. Their pressures are in atmospheres,
read here as bar as is usual (1.3 % less). Times and impulses of W kg are W^(1/3) those of 1 kg.
"""

import numpy as np

AMBIENT = 1e5            # [Pa]
_SOUND = 340.3           # [m/s] at 15 °C
_BAR = 1e5               # [Pa]
_CHARGE_SURFACE = 0.053  # [m/kg^(1/3)] radius of 1 kg of TNT at 1600 kg/m³, the least distance
_ON_GROUND = 1.8         # effective charge of a burst on the ground over the charge, UFC 3-340-02
_FREE_AIR = 1.0          # [m/kg^(1/3)] scaled height from which a burst counts as free


def overpressure(z: np.ndarray) -> np.ndarray:
    """
    Compute the peak side-on overpressure [Pa].

    :param z: scaled distance [m/kg^(1/3)].
    """
    z = np.maximum(z, _CHARGE_SURFACE)
    return _BAR * 808.0 * (1.0 + (z / 4.5) ** 2) / np.sqrt(
        (1.0 + (z / 0.048) ** 2) * (1.0 + (z / 0.32) ** 2) * (1.0 + (z / 1.35) ** 2))


def duration(z: np.ndarray) -> np.ndarray:
    """Compute the duration of the positive phase [s/kg^(1/3)] at scaled distances."""
    z = np.maximum(z, _CHARGE_SURFACE)
    return 0.98 * (1.0 + (z / 0.54) ** 10) / (
        (1.0 + (z / 0.02) ** 3) * (1.0 + (z / 0.74) ** 6) * np.sqrt(1.0 + (z / 6.9) ** 2))


def impulse(z: np.ndarray) -> np.ndarray:
    """
    Compute the side-on impulse of the positive phase [Pa·s/kg^(1/3)] at scaled distances.

    Over (peak · duration / 2) this is the factor of the wave form: 0.45 at Z = 1, where the
    pressure drops steeply, 1 near Z = 4; beyond, the two fits disagree by up to 15 %.
    """
    z = np.maximum(z, _CHARGE_SURFACE)
    return 1e-3 * _BAR * 0.067 * np.sqrt(1.0 + (z / 0.23) ** 4) / (
        z ** 2 * np.cbrt(1.0 + (z / 1.55) ** 3))


def reflection(pressure: np.ndarray) -> np.ndarray:
    """
    Compute reflected over side-on overpressure at normal incidence, 2 (weak) to 8 (strong).

    From the shock relations of an ideal gas (Kinney & Graham 1985, chapter 4).
    """
    return 2.0 * (7.0 * AMBIENT + 4.0 * pressure) / (7.0 * AMBIENT + pressure)


def dynamic_pressure(pressure: np.ndarray) -> np.ndarray:
    """Compute the dynamic pressure [Pa] of the air behind a shock of that overpressure."""
    return 2.5 * pressure ** 2 / (7.0 * AMBIENT + pressure)


def shock_speed(pressure: np.ndarray) -> np.ndarray:
    """Compute the speed [m/s] of a shock of that overpressure (Rankine-Hugoniot)."""
    return _SOUND * np.sqrt(1.0 + 6.0 * pressure / (7.0 * AMBIENT))


def arrival(z: np.ndarray) -> np.ndarray:
    """Compute when the front arrives [s/kg^(1/3)]: the integral of dR over the shock's speed."""
    nodes = np.geomspace(_CHARGE_SURFACE, 1000.0, 600)
    slowness = 1.0 / shock_speed(overpressure(nodes))
    times = np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(nodes))
    return np.interp(z, nodes, np.concatenate([[0.0], times]))


def effective_charge(charge: float, height: float) -> float:
    """
    Compute the free charge [kg] that does the same, counting what the ground throws back.

    The blend between a burst on the ground and a free one is a straight line.

    :param charge: mass of TNT [kg].
    :param height: of the charge above ground [m].
    """
    share = max(0.0, 1.0 - max(height, 0.0) / (_FREE_AIR * charge ** (1.0 / 3.0)))
    return charge * (1.0 + (_ON_GROUND - 1.0) * share)
