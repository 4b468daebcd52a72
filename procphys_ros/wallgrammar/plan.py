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

"""Plan: a right-angled footprint cut into rectangles that joists, slabs and rooms fill."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from procphys_ros.wallgrammar.footprint import Facade, Footprint


class Rectangle(NamedTuple):
    """A rectangle of the plan, in the first frame [µm]."""

    low: tuple[int, int]
    high: tuple[int, int]

    @property
    def size(self) -> tuple[int, int]:
        """Extents [µm]."""
        return self.high[0] - self.low[0], self.high[1] - self.low[1]

    def within(self, margin: int) -> 'Rectangle':
        """Return the rectangle inside a margin [µm] on all sides."""
        return Rectangle((self.low[0] + margin, self.low[1] + margin),
                         (self.high[0] - margin, self.high[1] - margin))


@dataclass(frozen=True)
class Bay:
    """
    Rectangle of the plan between two walls, bridged by spans.

    :ivar outer: up to the outer faces of the two walls, and to the lines where the plan changes.
    :ivar inner: clear of all walls.
    :ivar ends: facades at the low and the high end of the span, (2,).
    """

    outer: Rectangle
    inner: Rectangle
    ends: tuple[int, int]


def span_axis(plan: Footprint) -> int:
    """Return the axis of the first frame along which the building is shorter."""
    extent = np.ptp(plan.corners, axis=0)
    return 0 if extent[0] < extent[1] else 1


def bays(plan: Footprint, axis: int, thickness: int) -> list[Bay]:
    """
    Cut a right-angled footprint into bays.

    :param plan: the footprint.
    :param axis: along which spans run.
    :param thickness: of the walls [µm].
    """
    corners = plan.corners
    across = 1 - axis
    lines = np.unique(corners[:, across])
    found = []
    for start, end in zip(lines, lines[1:]):
        middle = 0.5 * (start + end)
        crossed = [(f.origin[axis], i) for i, f in enumerate(plan.facades)
                   if _covers(f, across, middle)]
        crossed.sort()
        for (low, i), (high, j) in zip(crossed[0::2], crossed[1::2]):
            inset = [thickness if _wall_at(plan, across, line, axis, low, high) else 0
                     for line in (start, end)]
            found.append(Bay(
                _rectangle(axis, low, high, start, end),
                _rectangle(axis, low + thickness, high - thickness, start + inset[0],
                           end - inset[1]), (i, j)))
    return found


def trapezia(points: np.ndarray) -> list[np.ndarray]:
    """
    Cut a simple polygon into trapezia with level sides, at the levels of its corners.

    :param points: corners, counter-clockwise, (n, 2).
    :returns: corners of each, lower left, lower right, upper left, upper right, (4, 2).
    """
    after, found = np.roll(points, -1, axis=0), []
    levels = np.unique(points[:, 1].round(6))
    for low, high in zip(levels, levels[1:]):
        middle = 0.5 * (low + high)
        rows = np.flatnonzero((points[:, 1] < middle) != (after[:, 1] < middle))
        rise = (after[rows, 0] - points[rows, 0]) / (after[rows, 1] - points[rows, 1])
        lines = [points[rows, 0] + rise * (level - points[rows, 1])
                 for level in (middle, low, high)]
        order = np.argsort(lines[0], kind='stable')
        for left, right in zip(order[0::2], order[1::2]):
            found.append(np.array([[lines[k][side], level] for k, level in ((1, low), (2, high))
                                   for side in (left, right)]))
    return found


def _covers(facade: Facade, across: int, place: float) -> bool:
    """Return whether a facade that runs along `across` passes a place on it."""
    low, high = _stretch(facade)
    return facade.quarter % 2 == across and low < place < high


def _wall_at(plan: Footprint, across: int, line: int, axis: int, low: int, high: int) -> bool:
    """Return whether a facade runs along a line between two places."""
    return any(facade.quarter % 2 == axis and facade.origin[across] == line
               and _stretch(facade)[0] < high and _stretch(facade)[1] > low
               for facade in plan.facades)


def _stretch(facade: Facade) -> list[int]:
    """Return the ends of a facade along its axis, the lower one first [µm]."""
    start = facade.origin[facade.quarter % 2]
    return sorted((start, start + (facade.length if facade.quarter < 2 else -facade.length)))


def _rectangle(axis: int, low: int, high: int, start: int, end: int) -> Rectangle:
    along, across = (int(low), int(high)), (int(start), int(end))
    first, second = (along, across) if axis == 0 else (across, along)
    return Rectangle((first[0], second[0]), (first[1], second[1]))


def along_facade(facade: Facade, low: int, high: int) -> tuple[int, int]:
    """
    Express a stretch of the plan, along the axis a facade runs on, in the facade's own x.

    :param facade: the facade.
    :param low, high: ends of the stretch in the frame [µm].
    """
    start = facade.origin[facade.quarter % 2]
    if facade.quarter < 2:
        return low - start, high - start
    return start - high, start - low
