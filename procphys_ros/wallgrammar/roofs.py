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

"""Roofs: gables and hips over a rectangular building; plates, ridge and the bonds between."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from procphys_ros import rotation
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.boxes import (
    Boxes,
    from_cells,
    Joint,
    MICRO,
    micro,
    micros,
    split_along,
    stack,
)
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.footprint import Corner
from procphys_ros.wallgrammar.slopes import COVER, Ends, OVERHANG, RAFTER, rafter_depth, Slope
from procphys_ros.wallgrammar.tiling import lay, Runs
from procphys_ros.wallgrammar.walls import Elevation, unit_of

_PLATE = 100_000      # [µm] width of wall plates, at most the wall
_RIDGE = 0.075        # [m] thickness of the ridge board
_RIDGE_SEAT = 0.15    # [m] least depth of the ridge board below the rafters' ends
_RIDGE_ROOM = 12_000  # [µm] beside the ridge board in its pocket: it rests there, no more
_HIP = 0.05           # [m] thickness of hip boards
_STRUT = 1_200_000    # [µm] largest distance of struts
_CAP = (0.45, 0.4, 0.02)  # [m] length, width and thickness of hip caps
_STRIP = 0.04         # [m] width of the strip below them
_TIE = (50_000, 600_000)  # [µm] width and spacing of ties between plates
_PIECE = 1_500_000    # [µm] plates, ridges and hips splinter into pieces of at most this length
_TIE_GAP = 0.001      # [m] mean gap of cut timber joints
_GABLE_CLEAR = 0.01   # [m] between the gable and the battens
_LEAST_RUN = 50_000   # [µm] shorter pieces of a gable course are left out
_EDGE = 0.06          # [m] between the outermost rafters and the gable
_SHORTEST_RIDGE = 0.5  # [m]


class Roof:
    """
    A roof under construction, ridge along the frame's x.

    :ivar low, high: outer corners of the building [µm], (2,) in the first frame.
    :ivar depth: of the rafters [m].
    """

    def __init__(self, site: Site, walls: Sequence[Elevation], height: int, pitch: float):
        self.site = site
        self.walls = walls
        self.height = height
        self.layout = walls[0].layout
        self.gauge = self.layout.gauge
        self.pitch = float(np.radians(pitch))
        corners = np.array([w.facade.origin for w in walls])
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.plate = min(_PLATE, self.layout.thickness)
        self.depth = 0.0

    @property
    def eaves(self) -> float:
        """Height of the rafters' underside over the outer edge of the wall [m]."""
        return (self.height + self.gauge) / MICRO

    def tie(self, axis: int) -> None:
        """
        Tie opposite plates together, so that the rafters do not push the walls apart.

        :param axis: of the first frame, along which the ridge runs.
        """
        across = 1 - axis
        for place in self._tie_places(axis):
            self._timber(across, (self.low[across] + self.plate, self.high[across] - self.plate),
                         (place, place + _TIE[0]), self.height, self.height + self.gauge, 0, 'tie')

    def _tie_places(self, axis: int) -> list[int]:
        first = int(self.low[axis]) + self.layout.thickness + _TIE[1]
        last = int(self.high[axis]) - self.layout.thickness - _TIE[1] - _TIE[0]
        count = max(-(-(last - first) // _TIE[1]), 1) + 1
        return [round(place) for place in np.linspace(first, last, count).tolist()]

    def _strut(self, axis: int) -> None:
        """Set struts between the ties, that hold the plates below the hipped ends."""
        across = 1 - axis
        low, high = int(self.low[across]), int(self.high[across])
        places = np.linspace(low, high, max(-(-(high - low) // _STRUT), 2) + 1)[1:-1]
        ties = self._tie_places(axis)
        starts = [int(self.low[axis]) + self.plate, *(place + _TIE[0] for place in ties)]
        ends = [*ties, int(self.high[axis]) - self.plate]
        for place in places.astype(int).tolist():
            for start, end in zip(starts, ends):
                self._timber(axis, (start, end), (place, place + _TIE[0]), self.height,
                             self.height + self.gauge, 0, 'tie')

    def gable(self, axis: int) -> None:
        """
        Build a gable roof.

        :param axis: of the first frame, along which the ridge runs.
        """
        across = 1 - axis
        size = (self.high - self.low) / MICRO
        span = 0.5 * size[across]
        self.depth = rafter_depth(span, self.pitch)
        thickness = self.layout.thickness
        ends = (self.low[axis] + thickness, self.high[axis] - thickness)
        plates = [self._timber(axis, ends, (edge, edge + self.plate), self.height,
                               self.height + self.gauge, 5_000) for edge in
                  (self.low[across], self.high[across] - self.plate)]
        bottom, top = self._ridge_levels(span)
        middle = int(self.low[across] + self.high[across]) // 2
        half = micro(0.5 * _RIDGE)
        for wall in self.walls:
            if wall.facade.quarter % 2 == across:
                self._gable_wall(wall, bottom, top, half + _RIDGE_ROOM)
        ridge = self._timber(axis, (self.low[axis], self.high[axis]), (middle - half,
                             middle + half), bottom, top, 0, 'ridge')
        for slope in self._opposite(axis, span, size[axis], False):
            frame = self._frame(slope)
            rafters = slope.rafters(self.site, frame, thickness / MICRO + _EDGE, 0.5 * _RIDGE,
                                    0.0)
            self._seat(slope, rafters, np.concatenate(plates))
            self._head(slope, rafters, ridge, self._square_end(slope, rafters))
            slope.cover(self.site, frame, rafters)

    def hip(self, axis: int) -> None:
        """
        Build a hip roof.

        :param axis: of the first frame, along which the ridge runs: the longer one.
        """
        across = 1 - axis
        size = (self.high - self.low) / MICRO
        span = 0.5 * size[across]
        self.depth = rafter_depth(span, self.pitch)
        if size[axis] - size[across] < _SHORTEST_RIDGE:
            raise self.site.place.error(
                f'a hip roof needs a footprint at least {_SHORTEST_RIDGE:g} m longer than wide, '
                f'found {size.max():g} x {size.min():g} m; use gable(pitch) or flat')
        plates = self._plate_ring(axis)
        self._strut(axis)
        bottom, top = self._ridge_levels(span)
        middle = int(self.low[across] + self.high[across]) // 2
        half = micro(0.5 * _RIDGE)
        ends = (self.low[axis] + micro(span), self.high[axis] - micro(span))
        ridge = self._timber(axis, ends, (middle - half, middle + half), bottom, top, 0, 'ridge')
        hips = self._hips(axis, span, ridge, plates)
        slopes = [*self._opposite(axis, span, size[axis], True),
                  *self._opposite(across, span, size[across], True)]
        for slope in slopes:
            frame = self._frame(slope)
            rafters = slope.rafters(self.site, frame, 0.5, 0.5 * _RIDGE, 0.5 * _HIP)
            full = rafters.reach * np.cos(self.pitch) > span - 0.5 * _RIDGE - 0.01
            self._seat(slope, rafters, plates)
            ends_at = self._square_end(slope, rafters)
            rows = Ends(*(column[full] for column in rafters))
            self._head(slope, rows, ridge, ends_at[full])
            rows = Ends(*(column[~full] for column in rafters))
            self._head(slope, rows, hips, ends_at[~full])
            slope.cover(self.site, frame, rafters)

    def _ridge_levels(self, span: float) -> tuple[int, int]:
        """Give bottom (on a course) and top of the ridge board [µm]."""
        underside = self.eaves + (span - 0.5 * _RIDGE) * np.tan(self.pitch)
        bottom = micro(underside - _RIDGE_SEAT) // self.gauge * self.gauge
        top = micro(underside + self.depth * np.cos(self.pitch) - 0.005)
        if bottom < self.height + self.gauge:
            raise self.site.place.error('the roof is too low to stand: give it more pitch, or the '
                                        'building more depth')
        return bottom, top

    def _plate_ring(self, axis: int) -> np.ndarray:
        """Lay plates on all four walls, half-lapped at the corners into one ring."""
        across = 1 - axis
        inner = (self.low[across] + self.plate, self.high[across] - self.plate)
        sides = [(axis, (self.low[axis], self.high[axis]), edge)
                 for edge in (self.low[across], self.high[across] - self.plate)]
        sides += [(across, inner, edge)
                  for edge in (self.low[axis], self.high[axis] - self.plate)]
        boxes = split_along(stack([
            self._box(run, along, (edge, edge + self.plate), self.height,
                      self.height + self.gauge, 0, 'plate') for run, along, edge in sides]),
            _PIECE, 0)
        boxes.member[:] = self.site.next_member
        rows = self.site.add(boxes)
        return np.arange(rows.start, rows.stop)

    def _frame(self, slope: Slope) -> int:
        self.site.frames.append(slope.pose)
        return len(self.site.frames) - 1

    def _timber(self, axis: int, along: tuple[int, int], across: tuple[int, int], bottom: int,
                top: int, joint: int, kind: str = 'plate') -> np.ndarray:
        """Lay an upright timber along an axis of the first frame; give its parts."""
        rows = self.site.add(self._box(axis, along, across, bottom, top, joint, kind), _PIECE)
        return np.arange(rows.start, rows.stop)

    def _box(self, axis: int, along: tuple[int, int], across: tuple[int, int], bottom: int,
             top: int, joint: int, kind: str) -> Boxes:
        low, high, margin = np.zeros(3, int), np.zeros(3, int), np.zeros(3, int)
        low[axis], high[axis] = along
        low[1 - axis], high[1 - axis] = across
        low[2], high[2] = bottom, top
        margin[axis] = joint
        return from_cells(low, high, margin, margin, axis=axis, joint=Joint.FIXING,
                          kind=self.site.kind(kind), material=self.site.material('timber'))

    def _gable_wall(self, wall: Elevation, seat: int, top: int, half: int) -> None:
        """Carry the courses of a wall on under the roof, with room for the ridge board."""
        length = wall.facade.length
        first = self.height // self.gauge
        peak = micro(self.eaves + 0.5 * length / MICRO * np.tan(self.pitch)) // self.gauge
        course = np.arange(first, peak + 1)
        bottom = np.maximum(course * self.gauge, self.height)
        upper = (course + 1) * self.gauge
        plane = self.eaves + (self.depth - _GABLE_CLEAR) / np.cos(self.pitch)
        inset = np.maximum(micros((upper / MICRO - plane) / np.tan(self.pitch)), 0)
        left = np.concatenate([inset, np.full(len(course), length // 2 + half)])
        right = np.concatenate([np.full(len(course), length - length // 2 - half), length - inset])
        whole = upper <= seat
        right[:len(course)][whole] = (length - inset)[whole]
        keep = right - left >= _LEAST_RUN
        keep[len(course):] &= ~whole
        keep &= np.tile(bottom < top, 2)
        twice = [np.tile(v, 2)[keep] for v in (course, bottom, upper)]
        zero = np.zeros(int(keep.sum()), int)
        runs = Runs(twice[0], left[keep], right[keep], twice[1], twice[2], zero, zero, zero > 0,
                    zero > 0, zero)
        facade = replace(wall.facade, start=Corner(), end=Corner())
        kind, joint = unit_of(self.layout, wall.unit)
        self.site.add(facade.place(lay(runs, self.layout, self.site.kind(kind), joint,
                                       self.site.next_member)))

    def _opposite(self, axis: int, span: float, length: float, hipped: bool) -> list[Slope]:
        """Give the two slopes whose eaves run along an axis."""
        ahead = rotation.rotate(self.site.frames[0][3:], np.array([1.0, 0.0, 0.0]))
        yaw = float(np.arctan2(ahead[1], ahead[0]))
        low, high = self.low / MICRO, self.high / MICRO
        if axis == 0:
            starts = [(low[0], low[1], 0.5 * np.pi), (high[0], high[1], -0.5 * np.pi)]
        else:
            starts = [(low[0], high[1], 0.0), (high[0], low[1], np.pi)]
        return [Slope.at(rotation.rotate(self.site.frames[0][3:], np.array([x, y, self.eaves])),
                         yaw + turn, self.pitch, span, length, hipped) for x, y, turn in starts]

    def _seat(self, slope: Slope, rafters: Ends, plates: np.ndarray) -> None:
        """Cut each rafter over its plate and nail it."""
        width = self.plate / MICRO
        points = slope.world(0.5 * width / np.cos(self.pitch), -rafters.place, 0.0)
        points[:, 2] = self.eaves + 0.25 * width * np.tan(self.pitch)
        upright = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        reach = np.tile([0.5 * self.gauge / MICRO, 0.5 * self.depth], (len(points), 1))
        # A long rafter is cut in pieces: the one over the plate carries.
        self._bond(self._nearest(plates, points), rafters.foot, points, upright,
                   (RAFTER, width), reach)

    def _square_end(self, slope: Slope, rafters: Ends) -> np.ndarray:
        """Locate the middles of the rafters' upper ends [m], (n, 3)."""
        return slope.world(rafters.reach, -rafters.place, 0.5 * self.depth)

    def _head(self, slope: Slope, rafters: Ends, holders: np.ndarray,
              points: np.ndarray) -> None:
        """Nail rafters with their upper ends to a ridge or hip."""
        if not len(points):
            return
        along = slope.world(np.ones(1), np.zeros(1), 0.0)[0] - slope.pose[:3]
        along[2] = 0.0
        normal = np.tile(along / np.linalg.norm(along), (len(points), 1))
        reach = np.column_stack([0.5 * (rafters.reach), np.full(len(points), 0.5 * _RIDGE)])
        self._bond(rafters.head, self._nearest(holders, points), points, normal,
                   (RAFTER, self.depth), np.minimum(reach, 0.5))

    def _nearest(self, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Choose of some parts the one whose middle line passes nearest to each point."""
        boxes = self.site.boxes().take(rows)
        frames = np.array(self.site.frames)[boxes.frame]
        local = rotation.rotate(rotation.conjugate(frames[None, :, 3:]),
                                points[:, None] - frames[None, :, :3])
        outside = np.maximum(np.maximum(boxes.low / MICRO - local, local - boxes.high / MICRO), 0)
        return rows[np.argmin((outside ** 2).sum(axis=-1), axis=1)]

    def _hips(self, axis: int, span: float, ridge: np.ndarray, plates: np.ndarray) -> np.ndarray:
        """Set the four hip boards on the corners of the plates, up to the ends of the ridge."""
        rise = span * np.tan(self.pitch)
        plan = span * np.sqrt(2.0)
        slope = np.arctan2(rise, plan)
        depth = (self.depth / np.cos(self.pitch) - 0.5 * _HIP / np.sqrt(2.0) * np.tan(self.pitch)
                 - 0.003) * np.cos(slope)
        end = (plan - 0.5 * _HIP - 0.005) / np.cos(slope)
        low, high = self.low / MICRO, self.high / MICRO
        first, parts = self.site.frames[0], []
        for x, y, turn in ((low[0], low[1], 0.25), (high[0], low[1], 0.75),
                           (high[0], high[1], 1.25), (low[0], high[1], 1.75)):
            corner = rotation.rotate(first[3:], np.array([x, y, self.eaves]))
            attitude = rotation.multiply(rotation.multiply(first[3:], rotation.from_yaw(
                turn * np.pi)), rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]),
                                                         np.array(-slope)))
            pose = np.concatenate([corner, attitude])
            self.site.frames.append(pose)
            box = from_cells(
                micros([-OVERHANG / np.cos(slope), -0.5 * _HIP, 0.0]),
                micros([end, 0.5 * _HIP, depth]), frame=len(self.site.frames) - 1,
                joint=Joint.FIXING, kind=self.site.kind('hip'),
                material=self.site.material('timber'))
            parts.append(self._set_hip(box, pose, end, depth, slope, ridge, plates))
            self._cap(len(self.site.frames) - 1, end, depth, slope)
        return np.concatenate(parts)

    def _cap(self, frame: int, end: float, depth: float, slope: float) -> None:
        """Cover a hip with caps on a strip that lifts them over the tiles."""
        start, stop = -OVERHANG / np.cos(slope), end - 0.6 * _CAP[1] / np.cos(slope)
        top = depth + COVER / np.cos(self.pitch) * np.cos(slope) + 0.01
        strip = from_cells(
            micros([start, -0.5 * _STRIP, depth]), micros([stop, 0.5 * _STRIP, top]), frame=frame,
            joint=Joint.FIXING, kind=self.site.kind('batten'),
            material=self.site.material('timber'))
        self.site.add(strip, _PIECE)
        count = max(round((stop - start) / _CAP[0]), 1)
        lines = np.linspace(start, stop, count + 1)
        low = np.column_stack([lines[:-1] + 0.001, np.full(count, -0.5 * _CAP[1]),
                               np.full(count, top)])
        high = np.column_stack([lines[1:] - 0.001, np.full(count, 0.5 * _CAP[1]),
                                np.full(count, top + _CAP[2])])
        self.site.add(from_cells(micros(low), micros(high), frame=frame, joint=Joint.FIXING,
                                 kind=self.site.kind('tile'),
                                 material=self.site.material('tile')))

    def _set_hip(self, box: Boxes, pose: np.ndarray, end: float, depth: float, slope: float,
                 ridge: np.ndarray, plates: np.ndarray) -> np.ndarray:
        rows = self.site.add(box, _PIECE)
        parts = np.arange(rows.start, rows.stop)
        seat = 0.5 * np.sqrt(2.0) * self.plate / MICRO
        points = pose[:3] + rotation.rotate(pose[3:], np.array([
            [seat / np.cos(slope), 0.0, 0.0], [end, 0.0, 0.5 * depth]]))
        points[0, 2] = self.eaves + 0.5 * seat * np.tan(slope)
        reach = np.array([[0.5 * self.gauge / MICRO, 0.5 * depth]])
        self._bond(self._nearest(plates, points[:1]), parts[:1], points[:1],
                   np.array([[0.0, 0.0, 1.0]]), (_HIP, 2 * seat), reach)
        normal = rotation.rotate(pose[3:], np.array([1.0, 0.0, 0.0])) * [1.0, 1.0, 0.0]
        self._bond(parts[-1:], self._nearest(ridge, points[1:]), points[1:],
                   (normal / np.linalg.norm(normal))[None], (_HIP, depth),
                   np.array([[0.5, 0.5 * _RIDGE]]))
        return parts

    def _bond(self, first: np.ndarray, second: np.ndarray, points: np.ndarray,
              normals: np.ndarray, extent: tuple[float, float], reach: np.ndarray) -> None:
        """Join parts of different frames; the patch's x lies level."""
        level = np.cross([0.0, 0.0, 1.0], normals)
        steep = np.linalg.norm(level, axis=1) < 1e-6
        level[steep] = [1.0, 0.0, 0.0]
        level /= np.linalg.norm(level, axis=1, keepdims=True)
        axes = np.stack([level, np.cross(normals, level), normals], axis=-1)
        n = len(points)
        self.site.patches.append(Patches(
            np.column_stack([first, second]), np.column_stack([points,
                                                               rotation.from_matrix(axes)]),
            np.tile(extent, (n, 1)), np.full(n, extent[0] * extent[1]), np.full(n, _TIE_GAP),
            reach))
