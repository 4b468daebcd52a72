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

"""Gables: a roof between two walls that continue up to it."""

from dataclasses import replace

import numpy as np

from procphys_ros.elementary import cos, tan
from procphys_ros.geometry import rotation
from procphys_ros.wallgrammar.boxes import MICRO, micro, micros
from procphys_ros.wallgrammar.footprint import Corner
from procphys_ros.wallgrammar.roofs import RIDGE, Roof
from procphys_ros.wallgrammar.slopes import Slope
from procphys_ros.wallgrammar.tiling import lay, Runs
from procphys_ros.wallgrammar.walls import Elevation, unit_of

RIDGE_ROOM = 12_000   # [µm] beside the ridge board in its pocket, where it only rests
_GABLE_CLEAR = 0.01   # [m] between the gable and the battens
_LEAST_RUN = 50_000   # [µm] shorter pieces of a gable course are left out
_NEAR = 60_000        # [µm] walls this near to a gable leave no room for its boards
EDGE = 0.06           # [m] between the outermost rafters and the gable


class GableRoof(Roof):
    """A roof of two slopes between masonry gables."""

    def _eaves_axes(self) -> tuple[int, ...]:
        return (self.axis,)

    def build(self) -> None:
        """Build plates, gables, ridge, slopes and ties."""
        axis, across, size, span = self.axis, 1 - self.axis, self.size, self.span
        thickness = self.layout.thickness
        ends = (self.low[axis] + thickness, self.high[axis] - thickness)
        plates = [self._timber(axis, ends, (edge, edge + self.plate), self.height,
                               self.height + self.gauge, 5_000) for edge in
                  (self.low[across], self.high[across] - self.plate)]
        bottom, top = self._ridge_levels(span)
        middle = int(self.low[across] + self.high[across]) // 2
        half = micro(0.5 * RIDGE)
        for wall in self.walls:
            if wall.facade.quarter % 2 == across:
                self._gable_wall(wall, bottom, top, half + RIDGE_ROOM)
        ridge = self._timber(axis, (self.low[axis], self.high[axis]), (middle - half,
                             middle + half), bottom, top, 0, 'ridge')
        for slope in self._opposite(axis, span, size[axis], False):
            frame = self._frame(slope)
            rafters = slope.rafters(self.site, frame, thickness / MICRO + EDGE, 0.5 * RIDGE,
                                    0.0)
            self._seat(slope, rafters, np.concatenate(plates))
            self._head(slope, rafters, ridge, self._square_end(slope, rafters))
            slope.cover(self.site, frame, rafters)
            slope.verges(self.site, frame, self.abutments(slope))
        self.tie(axis)

    def abutments(self, slope: Slope) -> list[list[tuple[float, float]]]:
        """
        Find the stretches of the gables that other bodies stand against.

        :returns: for either end of the eaves, the first at -length, occupied stretches in plan,
            measured from the eaves [m].
        """
        axis, across = self.axis, 1 - self.axis
        first = self.site.frames[0][3:]
        found: list[list[tuple[float, float]]] = []
        for y in (-slope.length, 0.0):
            foot = rotation.rotate(rotation.conjugate(first), slope.world(0.0, y, 0.0)[0]) * MICRO
            at_low = abs(foot[axis] - self.low[axis]) < abs(foot[axis] - self.high[axis])
            taken = []
            for other in self.neighbours:
                face = other.high[axis] - self.low[axis] if at_low else (
                    self.high[axis] - other.low[axis])
                if abs(face) < _NEAR and other.top > self.height:
                    ends = sorted(abs(edge - foot[across]) / MICRO if (
                        self.low[across] < edge < self.high[across]) else (
                        -1.0 if abs(edge - foot[across]) < abs(
                            edge - self.low[across] - self.high[across] + foot[across]) else 1e3)
                        for edge in (other.low[across], other.high[across]))
                    taken.append((ends[0], ends[1]))
            found.append(taken)
        return found

    def _gable_wall(self, wall: Elevation, seat: int, top: int, half: int, start: int = 0,
                    end: int | None = None) -> None:
        """Continue the courses of a wall, or a stretch of it, up to the roof."""
        length = (wall.facade.length if end is None else end) - start
        first = self.height // self.gauge
        peak = micro(self.eaves + 0.5 * length / MICRO * tan(self.pitch)) // self.gauge
        course = np.arange(first, peak + 1)
        bottom = np.maximum(course * self.gauge, self.height)
        upper = (course + 1) * self.gauge
        plane = self.eaves + (self.depth - _GABLE_CLEAR) / cos(self.pitch)
        inset = np.maximum(micros((upper / MICRO - plane) / tan(self.pitch)), 0)
        left = np.concatenate([inset, np.full(len(course), length // 2 + half)])
        right = np.concatenate([np.full(len(course), length - length // 2 - half), length - inset])
        whole = upper <= seat
        right[:len(course)][whole] = (length - inset)[whole]
        keep = right - left >= _LEAST_RUN
        keep[len(course):] &= ~whole
        keep &= np.tile(bottom < top, 2)
        twice = [np.tile(v, 2)[keep] for v in (course, bottom, upper)]
        zero = np.zeros(int(keep.sum()), int)
        runs = Runs(twice[0], start + left[keep], start + right[keep], twice[1], twice[2], zero,
                    zero, zero, zero, zero)
        facade = replace(wall.facade, start=Corner(), end=Corner())
        kind, joint = unit_of(self.layout, wall.unit)
        self.site.add(facade.place(lay(runs, self.layout, self.site.kind(kind), joint,
                                       self.site.next_member, self.site.generator)))
