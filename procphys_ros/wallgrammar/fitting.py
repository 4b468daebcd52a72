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

"""Fitting: the ends of bricks beside an arch, moved so that none is a sliver."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.geometry.linear import product
from procphys_ros.wallgrammar import cutting, ledges
from procphys_ros.wallgrammar.courses import Courses, Ledge
from procphys_ros.wallgrammar.cutting import Gap, Zone

_LONGEST = 1.3   # of the longest unit: greatest length of a brick that absorbs a sliver beside it
_EVEN = 1e-6     # [m]
_MISSED = 0.004  # [m] of a course's height that the side of a gap may miss


def ends(courses: Courses, outline: np.ndarray, inside: bool) -> tuple[np.ndarray, np.ndarray]:
    """
    Move perpends away from the steep sides of a gap, so that no narrow pieces remain beside it.

    :param outline: of the gap, convex, counter-clockwise [m], (n, 2).
    :param inside: whether bricks stand inside of it, or around it.
    :returns: left and right ends of all bricks [m], (n,); left beyond right for bricks that
        their neighbours absorb.
    """
    left, right = courses.low[:, 0].copy(), courses.high[:, 0].copy()
    foot, head = outline[:, 1].min(), outline[:, 1].max()
    bands = np.column_stack([courses.low[:, 1], courses.high[:, 1]])
    near = (bands[:, 1] < head + _EVEN) & (bands[:, 0] > foot - courses.joint - _EVEN)
    for band in np.unique(bands[near], axis=0):
        rows = np.flatnonzero((bands == band).all(axis=1))
        for sign in (1.0, -1.0):
            found = _side(outline, band, sign, inside)
            if found is None:
                continue
            starts, stops = ((left, right) if sign > 0.0 else (-right, -left))
            starts, stops = starts[rows], stops[rows]
            _move(starts, stops, *found, courses)
            if sign > 0.0:
                left[rows], right[rows] = starts, stops
            else:
                left[rows], right[rows] = -stops, -starts
    return left, right


def _side(outline: np.ndarray, band: np.ndarray, sign: float, inside: bool
          ) -> tuple[float, float, float] | None:
    """Find the near and far end of a gap's side in a course, and the course's height [m]."""
    flipped = outline * [sign, 1.0]
    if sign < 0.0:
        flipped = flipped[::-1]
    low = max(band[0], float(flipped[:, 1].min()) + _EVEN)
    high = min(band[1], float(flipped[:, 1].max()) - _EVEN)
    if high - low < band[1] - band[0] - _MISSED:
        return None
    part = cutting.within(flipped, np.array([[0.0, -1.0, -low], [0.0, 1.0, high]]))
    if len(part) < 3:
        return None
    reach = [part[np.abs(part[:, 1] - level) < _EVEN, 0] for level in (low, high)]
    if inside:
        at = [float(xs.max()) for xs in reach]
        near, far = min(at), float(part[:, 0].max())
    else:
        at = [float(xs.min()) for xs in reach]
        near, far = float(part[:, 0].min()), max(at)
    if far - near > high - low:
        return None
    return near, far, float(band[1] - band[0])


def _move(left: np.ndarray, right: np.ndarray, near: float, far: float, height: float,
          courses: Courses) -> None:
    """Move the last perpend before a side of the gap, in place."""
    narrow = float(np.clip(0.35 * height, 0.02, 0.06))
    for edge in np.unique(left[(left > near - narrow) & (left < far + courses.joint)]):
        before = np.abs(right + courses.joint - edge) < 2e-6
        if not before.any():
            continue
        start = float(left[before].max())
        if edge >= far or far - start < _LONGEST * courses.longest or (
                near - narrow - start < 2.0 * narrow):
            taken = (left > edge - _EVEN) & (left < far)
            right[before], left[taken] = far, right[taken]
        else:
            left[np.abs(left - edge) < _EVEN] = near - narrow
            right[before] = near - narrow - courses.joint
        return


@dataclass(frozen=True)
class Fit:
    """
    Fit of the bricks of a wall to one gap.

    :ivar gap: region that they make room for.
    :ivar left, right: ends of the bricks around it [m], (n,).
    :ivar inner_left, inner_right: ends of the bricks inside of it [m], (n,).
    :ivar within: ledges inside.
    :ivar sides: groups of zones around it, each with its ledges over it or under its skewbacks.
    :ivar touched: mask of the bricks that it may change, (n,) bool.
    """

    gap: Gap
    left: np.ndarray
    right: np.ndarray
    inner_left: np.ndarray
    inner_right: np.ndarray
    within: list[Ledge]
    sides: list[tuple[list[Zone], list[Ledge]]]
    touched: np.ndarray

    @classmethod
    def of(cls, courses: Courses, gap: Gap) -> 'Fit':
        """Fit bricks to a gap."""
        left, right = ends(courses, gap.outline, False)
        above = list(ledges.find(courses, left, right, gap.outline, True, False))
        aside, inside = [], []
        inner = (left, right)
        if gap.inside is None:
            aside = list(ledges.find(courses, left, right, gap.outline, False, False))
        else:
            inner = ends(courses, gap.inside, True)
            inside = list(ledges.find(courses, *inner, gap.inside, False, True))
        foot = gap.outline[:, 1].min()
        groups: list[tuple[list[Zone], list[Ledge]]] = []
        for zone, start in zip(cutting.zones(gap.outline), gap.outline):
            base = zone.outwards[1] < -0.999 and start[1] < foot + _EVEN
            mine = above if zone.outwards[1] > 0.0 else [] if base else aside
            if groups and groups[-1][1] is mine:
                groups[-1][0].append(zone)
            else:
                groups.append(([zone], mine))
        planes = cutting.half_planes(gap.outline)
        boxes = cutting.rectangles(np.column_stack([left, courses.low[:, 1]]),
                                   np.column_stack([right, courses.high[:, 1]]))
        clear = product(boxes, planes[:, :2].T) - planes[:, 2]
        touched = ~(clear.min(axis=1) > -1e-9).any(axis=1)
        for ledge in above + aside + inside:
            level = round(1e6 * ledge.level)
            touched |= (((courses.bottoms == level) | (courses.tops == level))
                        & (left < ledge.right) & (right > ledge.left))
        return cls(gap, left, right, *inner, inside, groups, touched)

    def around(self, courses: Courses, row: int, outline: np.ndarray) -> list[np.ndarray]:
        """Split the outline of a brick, or of a piece of one, around the gap."""
        least = courses.least(np.array([row]))
        found = []
        for sides, its_ledges in self.sides:
            for part in courses.stretches(row, outline, its_ledges):
                found += cutting.around(part, sides, least, courses.joint)
        return found

    def inside(self, courses: Courses, row: int) -> list[np.ndarray]:
        """Return the pieces of a brick inside the gap."""
        if self.gap.inside is None or self.inner_left[row] >= self.inner_right[row]:
            return []
        outline = cutting.rectangles(
            np.array([[self.inner_left[row], courses.low[row, 1]]]),
            np.array([[self.inner_right[row], courses.high[row, 1]]]))[0]
        planes = cutting.half_planes(self.gap.inside)
        return [cutting.within(part, planes)
                for part in courses.stretches(row, outline, self.within)]
