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
Hills: how the ground shapes the wind, faster over crests and slower at their feet and in hollows.

Potential flow over low hills, to the first order in their slope (the outer layer of Jackson and
Hunt 1975, Q. J. R. Meteorol. Soc. 101:929). For a wave of the ground with wave numbers k and
amplitude h, a wind v gains k (k·v) h exp(-|k| z) / |k| along the ground, and rises as i (k·v) h
exp(-|k| z). So the gain is a symmetric matrix per place and height, whatever the wind is.

Steep slopes shed the flow, which this does not know. So no more is gained or lost than EN 1991-1-4
(A.3) has for crests of slopes of 0.3 and steeper.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import cos, exp, sin
from procphys_ros.physics.terrain import Terrain

_NODES = 64      # of the grid along the longer side of the ground; transforms cost its third power
_LEVELS = np.array([0.0, 1.0, 3.0, 7.0, 15.0, 30.0, 60.0, 120.0, 240.0])  # [m] above the ground
_STEEPEST = 0.3  # slope that counts, and ...
_MOST = 2.0 * _STEEPEST  # ... gain of speed at its crest, 2·s·Φ with s = 1


class Hills(NamedTuple):
    """
    Gain of the wind over nodes of the ground and levels above it.

    :ivar gain: xx, xy and yy of its matrix, and rise along x and y, (L, X, Y, 5).
    :ivar low: position of the first node [m], (2,).
    :ivar edge: distance of nodes [m].
    """

    gain: np.ndarray
    low: np.ndarray
    edge: float

    @classmethod
    def over(cls, terrain: Terrain) -> 'Hills':
        """Compute the gain over a ground, which is level far from it."""
        if terrain.is_flat:
            return LEVEL
        span = terrain.edge * (np.array(terrain.heights.shape) - 1.0)
        edge = float(span.max()) / _NODES
        count = np.ceil(span / edge).astype(int) + 1
        wide = 2 * (count // 2)  # on both sides together, down or up to the mean height
        x, y = (terrain.low[a] + edge * np.arange(count[a]) for a in (0, 1))
        heights = terrain.height(np.column_stack([np.repeat(x, count[1]), np.tile(y, count[0])]))
        heights = heights.reshape(count) - heights.mean()
        heights = np.pad(heights, [(n // 2, n // 2) for n in wide], mode='linear_ramp')
        return cls(_gains(heights, edge), terrain.low - edge * (wide // 2), edge)

    def bend(self, points: np.ndarray, air: np.ndarray) -> None:
        """
        Add to the wind what hills make of it.

        :param points: z from the ground [m], (N, 3).
        :param air: velocity there, over level ground [m/s], (N, 3), changed in place.
        """
        if len(self.gain):
            _bend(np.ascontiguousarray(points), air, self.gain, self.low, self.edge, _LEVELS)


LEVEL = Hills(np.zeros((0, 0, 0, 5)), np.zeros(2), 1.0)


def _gains(heights: np.ndarray, edge: float) -> np.ndarray:
    """Transform heights, and their waves back into gains, (L, X, Y, 5)."""
    shape = heights.shape
    waves = [_waves(n) for n in shape]
    numbers = [2.0 * np.pi / (n * edge) * ((np.arange(n) + n // 2) % n - n // 2) for n in shape]
    kx, ky = np.meshgrid(*numbers, indexing='ij')
    size = np.sqrt(kx * kx + ky * ky)
    size[0, 0] = 1.0
    real, imaginary = _transform(heights, np.zeros(shape), *waves[0], *waves[1], -1.0)
    out = np.empty((len(_LEVELS), *shape, 5))
    for level, height in enumerate(_LEVELS.tolist()):
        fade = exp(-size * height) / heights.size
        for c, factor in enumerate((kx * kx / size, kx * ky / size, ky * ky / size)):
            scale = factor * fade
            out[level, ..., c] = _transform(scale * real, scale * imaginary, *waves[0], *waves[1],
                                            1.0)[0]
        for c, number in ((3, kx), (4, ky)):  # times i
            scale = number * fade
            out[level, ..., c] = _transform(-scale * imaginary, scale * real, *waves[0],
                                            *waves[1], 1.0)[0]
    return out


def _waves(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Tabulate cosine and sine of all multiples of a turn over a number, (N, N)."""
    turn = 2.0 * np.pi / count * (np.outer(np.arange(count), np.arange(count)) % count)
    return cos(turn), sin(turn)


@kernel
def _transform(real, imaginary, cos_x, sin_x, cos_y, sin_y, sign):
    """Compute the discrete Fourier transform of a grid, in a fixed order of sums."""
    rows, columns = real.shape
    a, b = np.zeros((rows, columns)), np.zeros((rows, columns))
    for i in range(rows):
        for n in range(columns):
            for k in range(columns):
                c, s = cos_y[n, k], sign * sin_y[n, k]
                a[i, k] += real[i, n] * c - imaginary[i, n] * s
                b[i, k] += real[i, n] * s + imaginary[i, n] * c
    out, other = np.zeros((rows, columns)), np.zeros((rows, columns))
    for k in range(rows):
        for i in range(rows):
            c, s = cos_x[i, k], sign * sin_x[i, k]
            for n in range(columns):
                out[k, n] += a[i, n] * c - b[i, n] * s
                other[k, n] += a[i, n] * s + b[i, n] * c
    return out, other


@kernel(nogil=True)
def _bend(points, air, gain, low, edge, levels):
    """Interpolate the gains at points, linearly, and apply them; nothing beyond the nodes."""
    rows, columns = gain.shape[1] - 1, gain.shape[2] - 1
    own = np.empty(5)
    for p in range(len(points)):
        x, y = (points[p, 0] - low[0]) / edge, (points[p, 1] - low[1]) / edge
        z = max(points[p, 2], 0.0)
        if not (0.0 <= x < rows and 0.0 <= y < columns and z < levels[-1]):
            continue
        i, j, m = int(x), int(y), 0
        while levels[m + 1] <= z:
            m += 1
        u, v, w = x - i, y - j, (z - levels[m]) / (levels[m + 1] - levels[m])
        for c in range(5):
            own[c] = 0.0
            for a, share in ((m, 1.0 - w), (m + 1, w)):
                own[c] += share * ((1.0 - u) * ((1.0 - v) * gain[a, i, j, c]
                                                + v * gain[a, i, j + 1, c])
                                   + u * ((1.0 - v) * gain[a, i + 1, j, c]
                                          + v * gain[a, i + 1, j + 1, c]))
        vx, vy = air[p, 0], air[p, 1]
        speed = np.sqrt(vx * vx + vy * vy)
        gx, gy = own[0] * vx + own[1] * vy, own[1] * vx + own[2] * vy
        rise = own[3] * vx + own[4] * vy
        size = np.sqrt(gx * gx + gy * gy)
        if size > _MOST * speed:
            gx, gy = gx * _MOST * speed / size, gy * _MOST * speed / size
        air[p, 0] += gx
        air[p, 1] += gy
        air[p, 2] += max(min(rise, _STEEPEST * speed), -_STEEPEST * speed)
