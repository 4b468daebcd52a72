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

"""Roads of a map as straight pieces."""

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import atan2, hypot, tan
from procphys_ros.maps.features import Feature
from procphys_ros.maps.numbers import metres

_LANE = 3.25  # [m] of one lane, between the 2.75 and 3.75 m of RASt 06
_SHORT = 0.05  # [m] pieces below are left out


class Road(NamedTuple):
    """
    Straight piece of a road.

    :ivar start: of its middle [m], (2,).
    :ivar end: likewise.
    :ivar width: [m].
    """

    start: np.ndarray
    end: np.ndarray
    width: float


def roads_of(feature: Feature, width: float) -> list[Road]:
    """
    Divide a road into straight pieces, which overlap where it bends.

    :param width: where its tags tell neither width nor lanes [m].
    """
    lanes = metres(feature.tags, 'lanes')
    width = metres(feature.tags, 'width', 'est_width') or (lanes or 0.0) * _LANE or width
    line = feature.rings[0]
    way = np.diff(line, axis=0)
    keep = hypot(*way.T) > _SHORT
    starts, way = line[:-1][keep], way[keep]
    length = hypot(*way.T)
    ahead = way / length[:, None] if len(way) else way
    more = _beyond(ahead, 0.5 * width)
    return [Road(start - a * step, start + step * (far + b), width) for start, step, far, a, b
            in zip(starts, ahead, length.tolist(), [0.0, *more], [*more, 0.0])]


def _beyond(ahead: Sequence[np.ndarray] | np.ndarray, half: float) -> list[float]:
    """Compute how far pieces go on where a road bends, so that no gap is left outside [m]."""
    found = []
    for one, two in zip(ahead[:-1], ahead[1:]):
        turn = abs(float(atan2(one[0] * two[1] - one[1] * two[0], float((one * two).sum()))))
        found.append(half * float(tan(0.5 * min(turn, 0.5 * math.pi))))
    return found
