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

"""Curves: functions given by control points."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.language.arithmetic import Value


class ControlCurve:
    """
    Function through control points, monotone between neighbours, level beyond the ends.

    Cubics with the slopes of Fritsch and Butland 1984 (SIAM J. Sci. Stat. Comput. 5:300): the
    weighted harmonic mean of the slopes of the chords beside a point, 0 at a turn.

    :param points: x and y of each, x growing, at least two.
    """

    def __init__(self, points: Sequence[tuple[float, ...]]):
        self._x, self._y = np.array(points, float).T
        step = np.diff(self._x)
        chord = np.diff(self._y) / step
        self._slope = np.concatenate([chord[:1], np.zeros(len(points) - 2), chord[-1:]])
        same = np.flatnonzero(chord[:-1] * chord[1:] > 0.0)
        before, after = chord[same], chord[same + 1]
        first, second = 2.0 * step[same + 1] + step[same], step[same + 1] + 2.0 * step[same]
        self._slope[same + 1] = (first + second) / (first / before + second / after)

    def __call__(self, x: Value) -> Value:
        """Evaluate at x, a number or an array."""
        x = np.clip(x, self._x[0], self._x[-1])
        i = np.clip(np.searchsorted(self._x, x, side='right') - 1, 0, len(self._x) - 2)
        step = self._x[i + 1] - self._x[i]
        t = (x - self._x[i]) / step
        rest = 1.0 - t
        return (self._y[i] * (1.0 + 2.0 * t) * rest * rest
                + self._y[i + 1] * t * t * (3.0 - 2.0 * t)
                + step * t * rest * (self._slope[i] * rest - self._slope[i + 1] * t))
