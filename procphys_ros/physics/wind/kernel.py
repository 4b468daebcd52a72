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


"""Wind at many points at once: mean profile, boxes of eddies, gust fronts."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.elementary import functions, log

LOG, POWER, UNIFORM = 0, 1, 2  # profile codes
GUST_COLUMNS = 12  # velocity (3), travel direction (3), speed, start, upwind, duration, rise, kind
_SLOWED = 2.0  # [m] height below which the ground slows gusts and eddies
# Points per block, so that the arithmetic vectorises. The last block is padded: a remainder would
# be computed by scalar code, with roots that differ in their last digits, and the wind at a point
# would depend on the number of points.
_BLOCK = 128
_U = np.uint64  # unsigned indices avoid the test for negative ones
# Eddies are stored and interpolated in single precision, twice as many at once.
_NOTHING, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


def profile_terms(name: str, reference: float, roughness: float, exponent: float) -> tuple:
    """
    Compute the parameters of `profile_factor`.

    :param name: 'log', 'power' or 'uniform'.
    :param reference: height at which the factor is 1 [m].
    :param roughness: roughness length of the log profile [m].
    :param exponent: of the power profile.
    :returns: code, reference length of heights [m], scale or exponent.
    """
    if name == 'log':
        return LOG, roughness, 1.0 / log(reference / roughness)
    return (POWER, reference, exponent) if name == 'power' else (UNIFORM, 1.0, 1.0)


@subroutine(error_model='numpy')
def profile_factor(height: float, code: int, length: float, number: float) -> float:
    """Return the mean speed at a height over that at the reference height."""
    relative = height / length
    if code == LOG:
        return number * functions.log(relative) if relative > 1.0 else 0.0
    if code == POWER:
        return functions.power(relative, number) if relative > 0.0 else 0.0
    return 1.0


@subroutine(error_model='numpy')
def _slowed(height: float, profile: tuple) -> float:
    """Return the attenuation factor of gusts and eddies near the ground at a height."""
    if height >= _SLOWED:
        return 1.0
    full = profile_factor(_SLOWED, profile[0], profile[1], profile[2])
    if full <= 0.0:
        return 1.0
    return profile_factor(height, profile[0], profile[1], profile[2]) / full


@subroutine(error_model='numpy')
def _turn(points, first, axes, turned):
    """Write the points of a block in wind axes: along, across and up [m], (3, B)."""
    ax, ay, az = axes[0]
    bx, by, bz = axes[1]
    cx, cy, cz = axes[2]
    for i in range(_BLOCK):
        k = min(first + i, len(points) - 1)
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        turned[0, i] = ax * x + ay * y + az * z
        turned[1, i] = bx * x + by * y + bz * z
        turned[2, i] = cx * x + cy * y + cz * z


@subroutine(error_model='numpy')
def _locate(turned, travelled, density, cells, fractions):
    """Write the cell, and the fractions within it, of each point of a block."""
    for k in range(3):
        scale, start = density[k], density[k] * travelled[k]
        for i in range(_BLOCK):
            place = scale * turned[k, i] - start
            cell = np.floor(place)
            cells[k, i], fractions[k, i] = np.int32(cell), np.float32(place - cell)


@subroutine(error_model='numpy')
def _find_scales(fractions, lags, sigma, scales):
    """
    Write the scale factors of the interpolated velocities of a block, (3, B).

    The variance of a tri-linear mean of correlated nodes is itself tri-linear in the lag
    covariances, with 2 f (1 - f) in place of the fraction f: dividing by its root restores
    the variance at every position within a cell.
    """
    for c in range(3):
        l0, l1, l2, l3 = lags[c, 0], lags[c, 1], lags[c, 2], lags[c, 3]
        l4, l5, l6, l7 = lags[c, 4], lags[c, 5], lags[c, 6], lags[c, 7]
        for i in range(_BLOCK):
            x, y, z = fractions[0, i], fractions[1, i], fractions[2, i]
            x, y, z = _TWO * x * (_ONE - x), _TWO * y * (_ONE - y), _TWO * z * (_ONE - z)
            near = l0 + z * (l1 - l0) + y * (l2 - l0 + z * (l3 - l2 - l1 + l0))
            far = l4 + z * (l5 - l4) + y * (l6 - l4 + z * (l7 - l6 - l5 + l4))
            scales[c, i] = sigma / np.sqrt(near + x * (far - near))


@subroutine(error_model='numpy')
def _interpolate(flat, bits, cells, fractions, scales, sums):
    """Add the scaled tri-linear mean of the nodes around each point of a block, (3, B)."""
    mx, my, mz = (1 << bits[0]) - 1, (1 << bits[1]) - 1, (1 << bits[2]) - 1
    row, column = bits[1] + bits[2], bits[2]
    for i in range(_BLOCK):
        ix, iy, iz = np.int64(cells[0, i]), np.int64(cells[1, i]), np.int64(cells[2, i])
        xa, xb = (ix & mx) << row, ((ix + 1) & mx) << row
        ya, yb = (iy & my) << column, ((iy + 1) & my) << column
        za, zb = iz & mz, (iz + 1) & mz
        n0, n1 = _U(3 * (xa + ya + za)), _U(3 * (xa + yb + za))
        n2, n3 = _U(3 * (xb + ya + za)), _U(3 * (xb + yb + za))
        f0, f1 = _U(3 * (xa + ya + zb)), _U(3 * (xa + yb + zb))
        f2, f3 = _U(3 * (xb + ya + zb)), _U(3 * (xb + yb + zb))
        x, y, z = fractions[0, i], fractions[1, i], fractions[2, i]
        w0, w1, w2, w3 = (_ONE - x) * (_ONE - y), (_ONE - x) * y, x * (_ONE - y), x * y
        for c in range(3):
            k = _U(c)
            low = w0 * flat[n0 + k] + w1 * flat[n1 + k] + w2 * flat[n2 + k] + w3 * flat[n3 + k]
            high = w0 * flat[f0 + k] + w1 * flat[f1 + k] + w2 * flat[f2 + k] + w3 * flat[f3 + k]
            sums[c, i] += scales[c, i] * (low + z * (high - low))


@subroutine(error_model='numpy')
def gust_strength(gust: np.ndarray, x: float, y: float, z: float, time: float) -> float:
    """
    Return the present share of a gust's velocity at a point.

    :param gust: row of GUST_COLUMNS numbers.
    :param x, y, z: the point [m], world.
    :param time: [s].
    """
    ahead = gust[8] + gust[3] * x + gust[4] * y + gust[5] * z
    t = time - gust[7] - max(ahead, 0.0) / gust[6]
    duration, rise = gust[9], gust[10]
    if t <= 0.0 or t >= duration:
        return 0.0
    if gust[11] == 0.0:
        # Extreme operating gust, IEC 61400-1 ed. 3, equation 14.
        return (-0.37 * functions.sin(3.0 * np.pi * t / duration)
                * (1.0 - functions.cos(2.0 * np.pi * t / duration)))
    return 0.5 - 0.5 * functions.cos(np.pi * min(t / rise, (duration - t) / rise, 1.0))


@kernel(error_model='numpy', nogil=True)
def fill_mean(points: np.ndarray, out: np.ndarray, along: tuple, speed: float,
              profile: tuple) -> None:
    """
    Write the mean air velocity at every point.

    :param points: (N, 3) [m], world.
    :param out: (N, 3) [m/s], world.
    :param along: unit vector of the mean wind, world.
    :param speed: at the reference height [m/s].
    :param profile: from `profile_terms`.
    """
    for i in range(len(points)):
        u = speed * profile_factor(points[i, 2], profile[0], profile[1], profile[2])
        out[i, 0], out[i, 1], out[i, 2] = u * along[0], u * along[1], u * along[2]


@kernel(error_model='numpy', nogil=True)
def add_eddies(points: np.ndarray, out: np.ndarray, axes: tuple, travelled: tuple,
               sigma: float, boxes: tuple, profile: tuple) -> None:
    """
    Add the velocity of all boxes of eddies at every point, block by block.

    Their strength does not depend on the height except near the ground, which slows them too.

    :param axes: unit vectors along the mean wind, across it and up from it, world.
    :param travelled: displacement of each box along these [m], one triple per box.
    :param sigma: standard deviation along the wind [m/s].
    :param boxes: flat field, log2 of its shape, lags (3, 8) and nodes per metre (3) of each.
    :param profile: from `profile_terms`.
    """
    turned, cells = np.empty((3, _BLOCK)), np.empty((3, _BLOCK), np.int32)
    fractions, scales, sums = (np.empty((3, _BLOCK), np.float32),
                               np.empty((3, _BLOCK), np.float32),
                               np.empty((3, _BLOCK), np.float32))
    for first in range(0, len(points), _BLOCK):
        count = min(_BLOCK, len(points) - first)
        _turn(points, first, axes, turned)
        sums[:] = _NOTHING
        for b in range(len(boxes)):
            flat, bits, lags, density = boxes[b]
            _locate(turned, travelled[b], density, cells, fractions)
            _find_scales(fractions, lags, np.float32(sigma), scales)
            _interpolate(flat, bits, cells, fractions, scales, sums)
        for i in range(count):
            share = _slowed(points[first + i, 2], profile)
            u, v, w = share * sums[0, i], share * sums[1, i], share * sums[2, i]
            for k in range(3):
                out[first + i, k] += u * axes[0][k] + v * axes[1][k] + w * axes[2][k]


@kernel(error_model='numpy', nogil=True)
def add_gusts(points: np.ndarray, out: np.ndarray, gusts: np.ndarray, time: float,
              profile: tuple) -> None:
    """
    Add the velocity of gusts, rows of GUST_COLUMNS numbers, at every point.

    They have the same strength at all heights except near the ground, which slows them like the
    mean wind: bodies lying on it must not be blown away by unrealistic air speeds.

    :param profile: from `profile_terms`.
    """
    for i in range(len(points)):
        slowed = _slowed(points[i, 2], profile)
        for g in range(len(gusts)):
            share = slowed * gust_strength(gusts[g], points[i, 0], points[i, 1], points[i, 2],
                                           time)
            for k in range(3):
                out[i, k] += share * gusts[g, k]
