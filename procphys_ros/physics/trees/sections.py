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
Sections: what a saw leaves of a round joint.

A kerf from one side leaves a segment of a circle, a felling cut a strip between a notch and the
cut from the back, its hinge. Both bend most easily about one axis, along the kerf; across it they
are taken as rectangles with the same ratio of moments of area.
"""

from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import asin, cos, sin


class Section(NamedTuple):
    """
    Remaining section of joints, (K,) each.

    :ivar stiffness: second moment of area about the weakest axis, over that of the whole circle.
    :ivar strength: section modulus about it, over that of the whole circle.
    :ivar ratio: of the sides of the rectangle that has the same moments about both axes; 1 or
        more.
    """

    stiffness: np.ndarray
    strength: np.ndarray
    ratio: np.ndarray


def kerfed(share: np.ndarray) -> Section:
    """
    Compute what a kerf leaves.

    :param share: depth of the kerf over the diameter, 0 to below 1, (K,).
    """
    edge = 1.0 - 2.0 * share  # of a circle of radius 1, measured from its middle
    turn = asin(edge)
    c, wide = cos(turn), sin(4.0 * turn)
    area = turn + 0.5 * np.pi + edge * c
    first = -(2.0 / 3.0) * c * c * c
    middle = first / area
    weak = 0.25 * (turn + 0.5 * np.pi - 0.25 * wide) - first * middle
    strong = (0.25 * (turn + 0.5 * np.pi) + sin(2.0 * turn) / 6.0 + wide / 48.0)
    furthest = np.maximum(edge - middle, middle + 1.0)
    return Section(weak / (0.25 * np.pi), weak / furthest / (0.25 * np.pi),
                   np.sqrt(np.maximum(strong / weak, 1.0)))


def hinge(thickness: np.ndarray) -> Section:
    """
    Compute what a felling cut leaves: a strip as long as the diameter.

    :param thickness: of the strip over the diameter, above 0 and at most 1, (K,).
    """
    square = thickness * thickness
    return Section(square * thickness / 12.0 / (np.pi / 64.0), square / 6.0 / (np.pi / 32.0),
                   1.0 / thickness)
