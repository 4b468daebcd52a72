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

"""Courses: the bricks of a wall beside arches, before they are cut."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from procphys_ros.wallgrammar import cutting


class Ledge(NamedTuple):
    """
    Stretch where a course of slivers is left out, and the next course takes its place.

    :ivar level: edge of the cells of both courses [m].
    :ivar up: whether the next course is the upper one.
    :ivar left, right: ends of the stretch [m].
    :ivar limit: level to which the next course extends at most [m].
    """

    level: float
    up: bool
    left: float
    right: float
    limit: float


@dataclass
class Courses:
    """
    Bricks of a wall before they are cut.

    :ivar low, high: corners in the plane of the wall [m], (n, 2).
    :ivar joint: [m].
    :ivar longest: length of the longest unit [m].
    """

    low: np.ndarray
    high: np.ndarray
    joint: float
    longest: float
    bottoms: np.ndarray = field(init=False)
    tops: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        # Whole micrometres, so that edges of neighbours are the same number.
        self.bottoms = np.rint(1e6 * (self.low[:, 1] - self.joint)).astype(int)
        self.tops = np.rint(1e6 * self.high[:, 1]).astype(int)

    def stretches(self, row: int, outline: np.ndarray, ledges: list[Ledge]) -> list[np.ndarray]:
        """
        Split a brick, or a piece of one, at ledges, into stretches that are dropped or extended.

        :param row: index of the brick.
        :param outline: convex, (n, 2).
        :param ledges: those that may touch it.
        """
        low, high = outline.min(axis=0), outline.max(axis=0)
        cuts = [low[0], high[0]]
        mine: list[tuple[float, float, Ledge | None]] = []
        for ledge in ledges:
            edges = (self.tops[row], self.bottoms[row])
            level = round(1e6 * ledge.level)
            shorter, taller = level == edges[not ledge.up], level == edges[ledge.up]
            if shorter:
                mine.append((ledge.left - self.joint, ledge.right + self.joint, None))
            elif taller:
                mine.append((ledge.left, ledge.right, ledge))
        cuts += [cut for a, b, _ in mine for cut in (a, b) if low[0] < cut < high[0]]
        lines = np.unique(cuts)
        found = []
        for a, b in zip(lines, lines[1:]):
            inside = [ledge for start, end, ledge in mine if start < 0.5 * (a + b) < end]
            if None in inside:
                continue
            part = outline if len(lines) < 3 else cutting.within(
                outline, np.array([[-1.0, 0.0, -a], [1.0, 0.0, b]]))
            found.append(_grown(part, [ledge for ledge in inside if ledge is not None]))
        return found

    def least(self, rows: np.ndarray) -> float:
        """Return the height below which bricks are slivers, a quarter of a course [m]."""
        height = float(np.median(self.high[rows, 1] - self.low[rows, 1]))
        return float(np.clip(0.25 * height, 0.012, 0.05))


def _grown(part: np.ndarray, ledges: list[Ledge]) -> np.ndarray:
    """Extend a rectangle to the limits of its ledges."""
    low, high = part.min(axis=0), part.max(axis=0)
    if not ledges or cutting.area(part) < (1.0 - 1e-6) * float((high - low).prod()):
        return part
    for ledge in ledges:
        if ledge.up:
            low[1] = min(low[1], ledge.limit)
        else:
            high[1] = max(high[1], ledge.limit)
    return cutting.rectangles(low[None], high[None])[0]
