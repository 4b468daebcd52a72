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


"""Wind at many points at once: mean profile, two boxes of eddies, gust fronts."""

from numba import njit
import numpy as np

LOG, POWER, UNIFORM = 0, 1, 2  # profile codes, in the order of settings.PROFILES
GUST_COLUMNS = 12  # velocity (3), travel direction (3), speed, start, upwind, duration, rise, kind


@njit(cache=True)
def profile_factor(height: float, code: int, reference: float, parameter: float) -> float:
    """
    Return the mean speed at a height over that at the reference height.

    :param height: above ground [m].
    :param code: LOG, POWER or UNIFORM.
    :param reference: reference height [m].
    :param parameter: roughness length [m] (LOG) or exponent (POWER).
    """
    if code == UNIFORM:
        return 1.0
    if code == POWER:
        return (height / reference) ** parameter if height > 0.0 else 0.0
    if height <= parameter:
        return 0.0
    return np.log(height / parameter) / np.log(reference / parameter)


@njit(cache=True, inline='always')
def _add_eddies(flat, log2_shape, lags, x, y, z, sums):
    """
    Add one box's velocity, interpolated at node coordinates x, y, z, to `sums`.

    The variance of a tri-linear mean of correlated nodes is itself tri-linear in the lag
    covariances, with 2 f (1 - f) in the place of the fraction f: dividing by its root restores
    the variance at every place within a cell.
    """
    x0, y0, z0 = np.floor(x), np.floor(y), np.floor(z)
    fx, fy, fz = x - x0, y - y0, z - z0
    mx, my, mz = (1 << log2_shape[0]) - 1, (1 << log2_shape[1]) - 1, (1 << log2_shape[2]) - 1
    ix, iy, iz = np.int64(x0) & mx, np.int64(y0) & my, np.int64(z0) & mz
    xa, xb = ix << log2_shape[1], ((ix + 1) & mx) << log2_shape[1]
    ya, yb = iy, (iy + 1) & my
    za, zb = 3 * iz, 3 * ((iz + 1) & mz)
    aa, ab = 3 * ((xa + ya) << log2_shape[2]), 3 * ((xa + yb) << log2_shape[2])
    ba, bb = 3 * ((xb + ya) << log2_shape[2]), 3 * ((xb + yb) << log2_shape[2])
    waa, wab = (1.0 - fx) * (1.0 - fy), (1.0 - fx) * fy
    wba, wbb = fx * (1.0 - fy), fx * fy
    gx, gy, gz = 2.0 * fx * (1.0 - fx), 2.0 * fy * (1.0 - fy), 2.0 * fz * (1.0 - fz)
    vaa, vab = (1.0 - gx) * (1.0 - gy), (1.0 - gx) * gy
    vba, vbb = gx * (1.0 - gy), gx * gy
    for c in range(3):
        low = (waa * flat[np.uint64(aa + za + c)] + wab * flat[np.uint64(ab + za + c)]
               + wba * flat[np.uint64(ba + za + c)] + wbb * flat[np.uint64(bb + za + c)])
        high = (waa * flat[np.uint64(aa + zb + c)] + wab * flat[np.uint64(ab + zb + c)]
                + wba * flat[np.uint64(ba + zb + c)] + wbb * flat[np.uint64(bb + zb + c)])
        kept = ((1.0 - gz) * (vaa * lags[c, 0] + vab * lags[c, 2]
                              + vba * lags[c, 4] + vbb * lags[c, 6])
                + gz * (vaa * lags[c, 1] + vab * lags[c, 3] + vba * lags[c, 5] + vbb * lags[c, 7]))
        sums[c] += (low + fz * (high - low)) / np.sqrt(kept)


@njit(cache=True)
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
        return (-0.37 * np.sin(3.0 * np.pi * t / duration)
                * (1.0 - np.cos(2.0 * np.pi * t / duration)))
    return 0.5 - 0.5 * np.cos(np.pi * min(t / rise, (duration - t) / rise, 1.0))


@njit(cache=True)
def fill(points: np.ndarray, out: np.ndarray, time: float, axes: np.ndarray, speed: float,
         profile: tuple, travelled: tuple, sigma: float,
         large: tuple, small: tuple, gusts: np.ndarray) -> None:
    """
    Write the air velocity at every point.

    :param points: (N, 3) [m], world.
    :param out: (N, 3) [m/s], world.
    :param time: [s].
    :param axes: rows along the mean wind, across it and up from it, (3, 3), world.
    :param speed: mean speed at the reference height [m/s].
    :param profile: code, reference height, parameter as in `profile_factor`.
    :param travelled: how far the eddies have moved along and across [m].
    :param sigma: standard deviation along the wind [m/s].
    :param large, small: flat field, log2 of its shape, lags (3, 8), nodes per metre (3).
    :param gusts: (G, GUST_COLUMNS).
    """
    sums = np.empty(3)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        factor = speed * profile_factor(z, profile[0], profile[1], profile[2])
        sums[0] = sums[1] = sums[2] = 0.0
        if sigma > 0.0:
            a = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z - travelled[0]
            b = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z - travelled[1]
            c = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
            for box in (large, small):
                _add_eddies(box[0], box[1], box[2],
                            a * box[3][0], b * box[3][1], c * box[3][2], sums)
        u, v, w = factor + sigma * sums[0], sigma * sums[1], sigma * sums[2]
        for k in range(3):
            out[i, k] = u * axes[0, k] + v * axes[1, k] + w * axes[2, k]
        for g in range(len(gusts)):
            share = gust_strength(gusts[g], x, y, z, time)
            for k in range(3):
                out[i, k] += share * gusts[g, k]
