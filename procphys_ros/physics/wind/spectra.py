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
One-point spectra of wind turbulence, by wave number instead of frequency.

For frozen turbulence (Taylor) frequency f corresponds to wave number f/U in
cycles per metre, and the speed drops out: the same eddies serve every wind.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procphys_ros.elementary import exp, hypot, log, power

_SCALE_PER_HEIGHT = 0.7  # Lambda_1 over height below 60 m, IEC 61400-1 ed. 3, equation 5
_LARGEST_SCALE = 42.0    # [m] Lambda_1 above 60 m, same equation
_DECAY = 12.0            # of the coherence with d/wavelength, IEC 61400-1 ed. 3, equation B.16
_FLOOR = 0.12            # of the coherence with d/length, same equation


@dataclass(frozen=True)
class Spectrum:
    """
    Turbulence of unit variance along, across and up (components 0, 1, 2).

    :ivar ratios: standard deviations over the one along the wind, (3,).
    :ivar lengths: integral length scales [m], (3,).
    :ivar shapes: densities of unit variance over x = length · wave number, one per component.
    """

    ratios: np.ndarray
    lengths: np.ndarray
    shapes: tuple[Callable[[np.ndarray], np.ndarray], ...]

    def density(self, component: int, wave_number: np.ndarray) -> np.ndarray:
        """Return the one-sided density [m] of unit variance at wave numbers [cycles/m]."""
        length = self.lengths[component]
        return length * self.shapes[component](length * np.asarray(wave_number, float))

    def variance_below(self, component: int, wave_number: np.ndarray) -> np.ndarray:
        """Return the part of the variance at wave numbers below the given ones [cycles/m]."""
        x = np.concatenate([[0.0], exp(np.linspace(-6.0, 6.0, 6000) * log(10.0))])
        density = self.shapes[component](x)
        total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(x))])
        wanted = self.lengths[component] * np.asarray(wave_number, float)
        return np.interp(wanted, x, total / total[-1])

    def decay(self, component: int, wave_number: np.ndarray) -> np.ndarray:
        """
        Return the decay rate [1/m] of the coherence exp(-rate · distance) across the wind.

        IEC 61400-1 ed. 3 defines it for component 0 only; the others use the same form with their
        own length, as lateral velocities are coherent too.
        """
        return _DECAY * hypot(wave_number, _FLOOR / self.lengths[component])


def make(name: str, height: float) -> Spectrum:
    """
    Create a spectrum of IEC 61400-1 ed. 3, annex B.

    :param name: 'kaimal' or 'von_karman'.
    :param height: above ground [m], which determines the size of the eddies.
    """
    scale = min(_SCALE_PER_HEIGHT * height, _LARGEST_SCALE)
    if name == 'kaimal':
        return Spectrum(np.array([1.0, 0.8, 0.5]), scale * np.array([8.1, 2.7, 0.66]),
                        (_kaimal, _kaimal, _kaimal))
    return Spectrum(np.ones(3), np.full(3, 3.5 * scale),
                    (_von_karman_along, _von_karman_across, _von_karman_across))


def _kaimal(x: np.ndarray) -> np.ndarray:
    """Evaluate the Kaimal shape, equation B.14."""
    return 4.0 * power(1.0 + 6.0 * x, -5.0 / 3.0)


def _von_karman_along(x: np.ndarray) -> np.ndarray:
    """Evaluate the von Kármán shape along the wind, as in TurbSim."""
    return 4.0 * power(1.0 + 71.0 * (x * x), -5.0 / 6.0)


def _von_karman_across(x: np.ndarray) -> np.ndarray:
    """Evaluate the von Kármán shape across the wind and up, as in TurbSim."""
    return 2.0 * (1.0 + 189.0 * (x * x)) * power(1.0 + 71.0 * (x * x), -11.0 / 6.0)
