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
Boxes of frozen turbulence, periodic in all directions.

For each wave number along the wind the coherence across the wind is a covariance on a torus, which
the Fourier transform diagonalises: white noise times the roots of its eigenvalues has exactly the
desired one-point spectrum and coherence (Shinozuka & Deodatis 1991; the eigenvalues replace the
Cholesky factors of Veers 1988). One inverse transform yields the box.

Coherence falls off within a twelfth of a wavelength, so short waves need a fine grid and long ones
a large one: three boxes share the spectrum. Each is interpolated with its own compensation of the
variance lost by interpolation, which is exact for every position within a cell.

The boxes move past the scene on a slant that returns none of them to an earlier position: see
`DRIFT`.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # subpackages are imported on first use

from procphys_ros.elementary import cos, exp, hypot, power, sin, standard_normal
from procphys_ros.geometry.linear import product
from procphys_ros.physics.wind.spectra import Spectrum

_SHORT = 16.5 / 512.0  # [cycles/m] waves shorter than 31 m go to the small box
_LONG = 2.5 / 2048.0  # [cycles/m] waves longer than 819 m go to the longest box

# Displacement of all boxes across the wind and upwards per displacement along it. A box that has
# passed returns beside its earlier position, so these slants determine how soon it is back at
# almost the same position. Of 4000 random pairs of slants below 0.02 and 0.011, these keep the
# boxes furthest from all of their earlier positions: the box of 2048 m by 5.4 m in 864 km (24 h at
# 10 m/s), 2.3 m in 2592 km and 1.1 m in 12960 km (24 h at the fastest wind allowed).
DRIFT = (0.009951444823, 0.003443965631)


@dataclass(frozen=True)
class Eddies:
    """
    A box of turbulence, scaled so that standard deviations of the whole spectrum are IEC ratios.

    :ivar field: air velocities (nx, ny, nz, 3) float32, each n a power of two.
    :ivar spacing: of the nodes [m], (3,).
    :ivar lags: covariance of nodes one step apart along the axes over the variance,
        (3, 2, 2, 2): component, steps along x, y, z.
    """

    field: np.ndarray
    spacing: np.ndarray
    lags: np.ndarray

    @property
    def period(self) -> np.ndarray:
        """Lengths after which the box repeats itself [m], (3,)."""
        return self.spacing * self.field.shape[:3]


def make_boxes(spectrum: Spectrum, rng: np.random.Generator) -> tuple[Eddies, Eddies, Eddies]:
    """
    Generate the boxes of waves: those from 31 m to 819 m long, the shorter and the longer ones.

    The boxes measure 2048 x 256 x 64 m, 512 x 64 x 32 m and 65536 x 256 x 64 m.
    """
    return (_draw(spectrum, (512, 128, 32), (4.0, 2.0, 2.0), (_LONG, _SHORT), rng),
            _draw(spectrum, (1024, 64, 32), (0.5, 1.0, 1.0), (_SHORT, np.inf), rng),
            _draw(spectrum, (512, 64, 16), (128.0, 4.0, 4.0), (0.0, _LONG), rng))


def _draw(spectrum: Spectrum, shape: tuple[int, int, int], spacing: tuple[float, float, float],
          band: tuple[float, float], rng: np.random.Generator) -> Eddies:
    field = np.empty(shape + (3,), np.float32)
    lags = np.empty((3, 2, 2, 2))
    wave_numbers = np.arange(shape[0] // 2 + 1) / (shape[0] * spacing[0])
    for component in range(3):
        variances = _bin_variances(spectrum, component, wave_numbers, band)
        used = np.flatnonzero(variances)
        rates = spectrum.decay(component, wave_numbers[used])
        variances[used] = _emphasise(variances[used], rates, wave_numbers[used], spacing)
        shares = _cross_wind_shares(rates, shape[1:], spacing[1:])
        # Double precision with any numpy: before numpy 2 the array determined the type.
        field[..., component] = np.multiply(
            spectrum.ratios[component], _transform(variances[used], shares, used, shape, rng),
            dtype=np.float64)
        lags[component] = _lag_table(variances[used], shares, used, shape[0])
    return Eddies(field, np.array(spacing), lags)


def _bin_variances(spectrum: Spectrum, component: int, wave_numbers: np.ndarray,
                   band: tuple[float, float]) -> np.ndarray:
    """
    Distribute the variance within a band over the wave numbers of a grid.

    The variance of waves too short for the grid is distributed over all waves, so none is lost.
    """
    def below(wave_number):
        return spectrum.variance_below(component, np.clip(wave_number, *band))

    half = 0.5 * wave_numbers[1]
    variances = below(wave_numbers + half) - below(wave_numbers - half)
    variances[1] += variances[0]  # the mean over the box belongs to the mean wind
    variances[0] = 0.0
    whole = below(1e9) - below(0.0)
    return variances * (whole / variances.sum())


def _emphasise(variances: np.ndarray, rates: np.ndarray, wave_numbers: np.ndarray,
               spacing: tuple[float, float, float]) -> np.ndarray:
    """
    Amplify the waves that tri-linear interpolation attenuates most; the sum is unchanged.

    Averaged over a cell, a wave along the wind keeps sinc^4 of its power, and across the wind the
    two nodes of a pair contribute 1/3 each and their covariance 1/3.
    """
    angle = np.pi * np.maximum(wave_numbers * spacing[0], 1e-9)
    kept = power(sin(angle) / angle, 4.0)
    y, z = spacing[1:]
    kept = kept * (4.0 + 2.0 * exp(-rates * y) + 2.0 * exp(-rates * z)
                   + exp(-rates * hypot(y, z))) / 9.0
    raised = variances / kept
    return raised * (variances.sum() / raised.sum())


def _cross_wind_shares(rates: np.ndarray, counts: tuple[int, ...],
                       spacing: tuple[float, ...]) -> np.ndarray:
    """Distribute each wave along the wind over waves across it, (rates, ny, nz), sums 1."""
    y, z = (step * np.minimum(np.arange(n), n - np.arange(n))
            for n, step in zip(counts, spacing))
    distance = hypot(y[:, None], z[None, :])
    coherence = exp(-rates[:, None, None] * distance).astype(np.float32)
    shares = np.maximum(scipy.fft.fft2(coherence).real, 0.0)
    return shares / shares.sum(axis=(1, 2), keepdims=True)


def _transform(variances: np.ndarray, shares: np.ndarray, used: np.ndarray,
               shape: tuple[int, int, int], rng: np.random.Generator) -> np.ndarray:
    """Generate a real field (nx, ny, nz) from noise of the given variances."""
    noise = standard_normal(rng, shares.shape + (2,)).astype(np.float32)
    amplitude = np.sqrt(0.25 * variances.astype(np.float32)[:, None, None] * shares)
    waves = np.zeros((shape[0] // 2 + 1,) + shape[1:], np.complex64)
    noise *= amplitude[..., None]  # complex products differ between processors
    waves[used] = noise.view(np.complex64)[..., 0]
    if used[-1] == shape[0] // 2:
        # A real field keeps only the real part of its Nyquist wave, and counts it once.
        waves[-1] *= 2.0
    plane = scipy.fft.ifft2(waves, norm='forward')
    return scipy.fft.irfft(plane, shape[0], axis=0, norm='forward')


def _lag_table(variances: np.ndarray, shares: np.ndarray, used: np.ndarray,
               count: int) -> np.ndarray:
    """Compute covariance over variance of nodes 0 or 1 step apart along each axis, (2, 2, 2)."""
    weights = variances[:, None, None] * shares / variances.sum()
    along = cos(2.0 * np.pi * used / count)
    table = np.empty((2, 2, 2))
    ny, nz = shares.shape[1:]
    for j in range(2):
        for k in range(2):
            across = (cos(2.0 * np.pi * j * np.arange(ny) / ny)[:, None]
                      * cos(2.0 * np.pi * k * np.arange(nz) / nz))
            waves = (weights * across).sum(axis=(1, 2))
            table[0, j, k] = waves.sum()
            table[1, j, k] = product(waves, along)
    return table
