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

"""Hips: a roof of four slopes with boards along their edges."""

import numpy as np

from procphys_ros.elementary import atan2, cos, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
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
from procphys_ros.wallgrammar.roofs import PIECE, RIDGE, Roof, TIE
from procphys_ros.wallgrammar.slopes import APEX, COVER, Ends, OVERHANG

_HIP = 0.05           # [m] thickness of hip boards
_STRUT = 1_200_000    # [µm] largest distance of struts
_CAP = (0.45, 0.4, 0.02)  # [m] length, width and thickness of hip caps
_SHORT = 0.175        # [m] in plan, from the apex to the middle of the uppermost caps' ends
_STRIP = 0.04         # [m] width of the strip below them
_SHORTEST_RIDGE = 0.5  # [m]
_SQUARE = 0.002       # [m] by which the sides of a pyramid may differ
_POST = 0.5 * _HIP + 0.004  # [m] half the side of the post in the middle of a pyramid


class HipRoof(Roof):
    """A roof of four slopes of one pitch."""

    def build(self) -> None:
        """Build a ring of plates, hips, ridge, slopes and ties."""
        axis, across, size, span = self.axis, 1 - self.axis, self.size, self.span
        longer = float(size[axis] - size[across])
        if _SQUARE < longer < _SHORTEST_RIDGE:
            raise self.site.place.error(
                f'a hip roof needs a footprint that is square or at least {_SHORTEST_RIDGE:g} m '
                f'longer than wide, found {size.max():g} x {size.min():g} m; use gable(pitch) or '
                f'flat')
        plates = self._plate_ring(axis)
        self._strut(axis)
        bottom, top = self._ridge_levels(span)
        middle = int(self.low[across] + self.high[across]) // 2
        half = micro(0.5 * RIDGE)
        ends = (self.low[axis] + micro(span), self.high[axis] - micro(span))
        ridge = (self._timber(axis, ends, (middle - half, middle + half), bottom, top, 0, 'ridge')
                 if longer > _SQUARE else self._king_post(bottom, self._apex_level()))
        hips = self._hips(axis, span, ridge, plates)
        slopes = [*self._opposite(axis, span, size[axis], True),
                  *self._opposite(across, span, size[across], True)]
        for slope in slopes:
            frame = self._frame(slope)
            rafters = slope.rafters(self.site, frame, 0.5, 0.5 * RIDGE, 0.5 * _HIP)
            full = rafters.reach * cos(self.pitch) > span - 0.5 * RIDGE - 0.01
            self._seat(slope, rafters, plates)
            ends_at = self._square_end(slope, rafters)
            rows = Ends(*(column[full] for column in rafters))
            self._head(slope, rows, ridge, ends_at[full])
            rows = Ends(*(column[~full] for column in rafters))
            self._head(slope, rows, hips, ends_at[~full])
            slope.cover(self.site, frame, rafters)
        if longer > _SQUARE:
            self._apexes(axis, middle, top, slopes[0].crest)
        else:
            self._crown(axis, middle, ridge, slopes[0].crest)
        self.tie(axis)

    def _king_post(self, bottom: int, top: int) -> np.ndarray:
        """Set a post between the hips of a pyramid, its faces towards them."""
        middle = 0.5 * (self.low + self.high) / MICRO
        first = self.site.frames[0]
        place = rotation.rotate(first[3:], np.array([*middle, 0.0]))
        attitude = rotation.multiply(first[3:], rotation.from_yaw(0.25 * np.pi))
        self.site.frames.append(np.concatenate([place, attitude]))
        half = micro(_POST)
        rows = self.site.add(from_cells(
            [-half, -half, bottom], [half, half, top], frame=len(self.site.frames) - 1, axis=2,
            joint=Joint.FIXING, kind=self.site.kind('post'),
            material=self.site.material('timber')))
        return np.arange(rows.start, rows.stop)

    def _apexes(self, axis: int, middle: int, top: int, crest: float) -> None:
        """Set a post on each end of the ridge, with a block on it that closes the apex."""
        half, wide = micro(0.5 * RIDGE), micro(APEX)
        bottom = self._apex_level()
        for end, inwards in ((int(self.low[axis]) + micro(self.span), 1),
                             (int(self.high[axis]) - micro(self.span), -1)):
            seat = sorted((end, end + inwards * wide))
            self._timber(axis, (seat[0], seat[1]), (middle - half, middle + half), top, bottom, 0,
                         'post')
            self._block(axis, end, middle, bottom, crest)

    def _apex_level(self) -> int:
        """Compute the level of the underside of the blocks that close apexes [µm]."""
        # Over the hip boards, or in flat roofs over the tiles beside the ridge and the hip caps.
        lowest = self.span * tan(self.pitch) + 0.005 + max(
            self.depth / cos(self.pitch), (self.depth + COVER) * cos(self.pitch),
            (self.depth + COVER) / cos(self.pitch) + self._lift + _CAP[2] - _SHORT * tan(
                self.pitch))
        return micro(self.eaves + lowest)

    def _block(self, axis: int, end: int, middle: int, bottom: int, crest: float) -> int:
        """Close an apex with a block; return its part index."""
        wide, crown = micro(APEX), micro(self.eaves + crest + _CAP[2])
        block = self._box(axis, (end - wide, end + wide), (middle - wide, middle + wide), bottom,
                          crown, 0, 'tile')
        block.material[:] = self.site.material('tile')
        return self.site.add(block).start

    def _crown(self, axis: int, middle: int, post: np.ndarray, crest: float) -> None:
        """Set the block that closes the apex of a pyramid on its post."""
        bottom = self._apex_level()
        end = int(self.low[axis] + self.high[axis]) // 2
        block = self._block(axis, end, middle, bottom, crest)
        frame = self.site.frames[self.site.boxes().frame[post[-1]]]
        place = frame[:3] + [0.0, 0.0, bottom / MICRO]
        self._bond(post[-1:], np.array([block]), place[None], np.array([[0.0, 0.0, 1.0]]),
                   (2.0 * _POST, 2.0 * _POST), np.array([[0.5, 0.5 * _CAP[2]]]),
                   rotation.rotate(frame[3:], np.array([1.0, 0.0, 0.0])))

    def _strut(self, axis: int) -> None:
        """Set struts between the ties, to hold the plates below the hipped ends."""
        across = 1 - axis
        low, high = int(self.low[across]), int(self.high[across])
        middles = np.linspace(low, high, max(-(-(high - low) // _STRUT), 2) + 1)[1:-1]
        ties = self._tie_places(axis)
        starts = [int(self.low[axis]) + self.plate, *(place + TIE[0] for place in ties)]
        ends = [*ties, int(self.high[axis]) - self.plate]
        for place in (middles.astype(int) - TIE[0] // 2).tolist():
            for start, end in zip(starts, ends):
                self._timber(axis, (start, end), (place, place + TIE[0]), self.height,
                             self.height + self.gauge, 0, 'tie')

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
            PIECE, 0)
        boxes.member[:] = self.site.next_member
        rows = self.site.add(boxes)
        return np.arange(rows.start, rows.stop)

    def _hips(self, axis: int, span: float, ridge: np.ndarray, plates: np.ndarray) -> np.ndarray:
        """Set the four hip boards on the corners of the plates, up to the ends of the ridge."""
        rise = span * tan(self.pitch)
        plan = span * np.sqrt(2.0)
        slope = atan2(rise, plan)
        depth = (self.depth / cos(self.pitch) - 0.5 * _HIP / np.sqrt(2.0) * tan(self.pitch)
                 - 0.003) * cos(slope)
        end = (plan - 0.5 * _HIP - 0.005) / cos(slope)
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
                micros([-OVERHANG / cos(slope), -0.5 * _HIP, 0.0]),
                micros([end, 0.5 * _HIP, depth]), frame=len(self.site.frames) - 1,
                joint=Joint.FIXING, kind=self.site.kind('hip'),
                material=self.site.material('timber'))
            parts.append(self._set_hip(box, pose, end, depth, slope, ridge, plates))
            self._cap(len(self.site.frames) - 1, end, depth, slope)
        return np.concatenate(parts)

    @property
    def _lift(self) -> float:
        """Height of hip caps over the tiles [m]; in flat roofs a tile comes under them."""
        return float(max(0.01, 0.024 - 0.03 * tan(self.pitch)))

    def _cap(self, frame: int, end: float, depth: float, slope: float) -> None:
        """Cover a hip with caps on a strip that lifts them over the tiles."""
        start = -OVERHANG / cos(slope)
        stop = end - (np.sqrt(2.0) * _SHORT - 0.03) / cos(slope)
        top = depth + COVER / cos(self.pitch) * cos(slope) + self._lift
        strip = from_cells(
            micros([start, -0.5 * _STRIP, depth]), micros([stop, 0.5 * _STRIP, top]), frame=frame,
            joint=Joint.NAIL, kind=self.site.kind('batten'),
            material=self.site.material('timber'))
        self.site.add(strip, PIECE)
        count = max(round((stop - start) / _CAP[0]), 1)
        lines = np.linspace(start, stop, count + 1)
        low = np.column_stack([lines[:-1] + 0.001, np.full(count, -0.5 * _CAP[1]),
                               np.full(count, top)])
        high = np.column_stack([lines[1:] - 0.001, np.full(count, 0.5 * _CAP[1]),
                                np.full(count, top + _CAP[2])])
        self.site.add(from_cells(micros(low), micros(high), frame=frame, joint=Joint.NAIL,
                                 kind=self.site.kind('tile'),
                                 material=self.site.material('tile')))

    def _set_hip(self, box: Boxes, pose: np.ndarray, end: float, depth: float, slope: float,
                 ridge: np.ndarray, plates: np.ndarray) -> np.ndarray:
        rows = self.site.add(box, PIECE)
        parts = np.arange(rows.start, rows.stop)
        seat = 0.5 * np.sqrt(2.0) * self.plate / MICRO
        points = pose[:3] + rotation.rotate(pose[3:], np.array([
            [seat / cos(slope), 0.0, 0.0], [end, 0.0, 0.5 * depth]]))
        points[0, 2] = self.eaves + 0.5 * seat * tan(slope)
        reach = np.array([[0.5 * self.gauge / MICRO, 0.5 * depth]])
        self._bond(self._nearest(plates, points[:1]), parts[:1], points[:1],
                   np.array([[0.0, 0.0, 1.0]]), (_HIP, 2 * seat), reach,
                   rotation.rotate(pose[3:], np.array([0.0, 1.0, 0.0])))
        normal = rotation.rotate(pose[3:], np.array([1.0, 0.0, 0.0])) * [1.0, 1.0, 0.0]
        self._bond(parts[-1:], self._nearest(ridge, points[1:]), points[1:],
                   (normal / norm(normal))[None], (_HIP, depth),
                   np.array([[0.5, 0.5 * RIDGE]]))
        return parts
