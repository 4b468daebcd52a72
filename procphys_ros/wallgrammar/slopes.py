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

"""Slopes: rafters, battens and tiles of one plane of a roof, in the frame of that plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from procphys_ros.elementary import cos, sin
from procphys_ros.geometry import rotation
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, Joint, micros, stack
from procphys_ros.wallgrammar.construction import Site

RAFTER = 0.05            # [m] width of rafters
_SHALLOWEST = 0.12       # [m] least depth of rafters
_SLENDER = 25.0          # length over depth of rafters, a joiner's rule
RAFTER_SPACING = 0.6     # [m] largest
BATTEN = (0.05, 0.025)  # [m] width and depth (BS 5534)
COVER = 0.045            # [m] depth of battens and tiles together
TILE = (0.40, 0.02)     # [m] width and thickness of a body that stands for a few tiles
GAUGE = 0.32            # [m] largest distance of battens
TILE_AREA = TILE[0] * GAUGE  # [m²] of roof that a tile covers
APART = 0.001           # [m] tiles do not touch each other
_CLEAR = 0.005           # [m] between pieces that meet at a hip
LAP = 0.15              # [m] by which ridge tiles lie on the tiles below
RIDGE_TILE = 0.45       # [m] length of ridge tiles
_TIP = (0.24, 0.09)      # [m] width of the tile below an apex, and its distance from the hips
_VERGE = (0.025, 0.12)   # [m] thickness of boards at gables, and how far they hang below battens
_HIP_ROOM = 0.05         # [m] along the eaves, for the strip that carries the caps of a hip
PIECE = 1_500_000       # [µm] rafters and battens splinter into pieces of at most this length
OVERHANG = 0.25          # [m] of the eaves
APEX = 0.20              # [m] half the side of the blocks that close the apexes of hips


class Ends(NamedTuple):
    """
    Rafters as added to the site.

    :ivar foot, head: part at the eaves and at the top of each, (n,).
    :ivar place: middle of each along the eaves [m], (n,).
    :ivar reach: length from the eaves line to the top [m], (n,).
    """

    foot: np.ndarray
    head: np.ndarray
    place: np.ndarray
    reach: np.ndarray


def rafter_depth(span: float, pitch: float) -> float:
    """
    Compute the depth of rafters [m].

    :param span: horizontal distance from the eaves to the ridge [m].
    :param pitch: [rad].
    """
    return max(_SHALLOWEST, span / cos(pitch) / _SLENDER)


@dataclass(frozen=True)
class Slope:
    """
    A plane of a roof; local x runs up the slope, y along the eaves, z out of the plane.

    The origin lies on the underside of the rafters, over the outer edge of the wall.

    :ivar pose: of the frame in the building [m], (7,).
    :ivar pitch: [rad].
    :ivar span: horizontal distance from the eaves to the ridge [m].
    :ivar length: of the eaves, which run from y = -length to 0 [m].
    :ivar hipped: whether the plane ends at hips instead of gables.
    :ivar depth: of the rafters [m].
    """

    pose: np.ndarray
    pitch: float
    span: float
    length: float
    hipped: bool
    depth: float

    @classmethod
    def at(cls, origin: np.ndarray, inwards: float, pitch: float, span: float, length: float,
           hipped: bool) -> 'Slope':
        """
        Place a slope.

        :param origin: start of the eaves seen from outside, from the left [m], (3,).
        :param inwards: direction in plan from the eaves to the ridge [rad].
        """
        tilt = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-pitch))
        turn = rotation.multiply(rotation.from_yaw(inwards), tilt)
        return cls(np.concatenate([origin, turn]), pitch, span, length, hipped,
                   rafter_depth(span, pitch))

    def world(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> np.ndarray:
        """Transform points from the slope's frame to the building's [m], (n, 3)."""
        points = np.column_stack(np.broadcast_arrays(x, y, z)).astype(float)
        return self.pose[:3] + rotation.rotate(self.pose[3:], points)

    def rafters(self, site: Site, frame: int, edge: float, ridge_half: float,
                hip_half: float) -> Ends:
        """
        Set rafters from the eaves to the ridge, or to the hip where that comes first.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param edge: distance of the outermost rafters from the ends of the eaves [m].
        :param ridge_half: half the thickness of the ridge board [m].
        :param hip_half: half the thickness of the hip boards [m].
        """
        count = max(int(np.ceil((self.length - 2 * edge) / RAFTER_SPACING)), 1) + 1
        count += count % 2 if self.hipped else 0  # none in the middle, where the hips meet
        place = np.linspace(edge, self.length - edge, count)
        plan = np.full(count, self.span - ridge_half - _CLEAR)
        if self.hipped:
            near = np.minimum(place, self.length - place) - 0.5 * RAFTER
            plan = np.minimum(plan, near - np.sqrt(2.0) * hip_half - _CLEAR)
        keep = plan > 0.2
        place, reach = place[keep], plan[keep] / cos(self.pitch)
        low = np.column_stack([np.full(len(place), -OVERHANG / cos(self.pitch)),
                               -place - 0.5 * RAFTER, np.zeros(len(place))])
        high = np.column_stack([reach, -place + 0.5 * RAFTER, np.full(len(place), self.depth)])
        boxes = from_cells(micros(low), micros(high), frame=frame, axis=0, joint=Joint.NAIL,
                           kind=site.kind('rafter'), material=site.material('timber'))
        foot, head = site.add_spans(boxes, PIECE)
        return Ends(foot, head, place, reach)

    def cover(self, site: Site, frame: int, rafters: Ends) -> None:
        """
        Nail battens across the rafters and hang tiles on them.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param rafters: that carry the battens.
        """
        top = rafters.reach.max()
        bottom = -OVERHANG / cos(self.pitch)
        rows = np.linspace(bottom, top - BATTEN[0],
                           int(np.ceil((top - BATTEN[0] - bottom) / GAUGE)) + 1)
        battens, lines = [], []
        for x in rows:
            ends = self._row(x + BATTEN[0], self.depth)
            held = rafters.place[rafters.reach > x]
            inside = (held - 0.5 * RAFTER > ends[0]) & (held + 0.5 * RAFTER < ends[1])
            if not inside.any():
                break
            battens.append(_box([x, -ends[1], self.depth],
                                [x + BATTEN[0], -ends[0], self.depth + BATTEN[1]], frame, 1))
            lines.append(x + 0.5 * BATTEN[0])
        tiles = [tile for low, high in zip(lines, lines[1:])
                 for tile in self._tiles(low, high, frame)]
        ridge = self._ridge_tiles(lines[-1], frame)
        for boxes, kind, material, longest, joint in (
                (battens, 'batten', 'timber', PIECE, Joint.NAIL),
                (tiles, 'tile', 'tile', 0, Joint.NAIL), (ridge, 'tile', 'tile', 0, Joint.FIXING)):
            if boxes:
                column = stack(boxes)
                column.kind[:], column.material[:] = site.kind(kind), site.material(material)
                column.joint[:] = joint
                site.add(column, longest)

    def verges(self, site: Site, frame: int,
               taken: Sequence[Sequence[tuple[float, float]]] = ((), ())) -> None:
        """
        Nail boards to the ends of the battens, which cover the steps of the gables.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param taken: for the ends at -length and at 0, stretches in plan where something stands
            against the gable, measured from the eaves [m].
        """
        low, high = self.depth - _VERGE[1], self.depth + COVER
        bottom = -OVERHANG / cos(self.pitch)
        top = (self.span + low * sin(self.pitch)) / cos(self.pitch) - APART
        boards = []
        for y, stretches in zip((-self.length - _VERGE[0], 0.0), taken):
            start = bottom
            for near, far in sorted(stretches):
                end = (near + low * sin(self.pitch)) / cos(self.pitch) - APART
                if end - start > _VERGE[1]:
                    boards.append(_box([start, y, low], [min(end, top), y + _VERGE[0], high],
                                       frame, 0))
                start = max(start, (far + high * sin(self.pitch)) / cos(self.pitch) + APART)
            if top - start > _VERGE[1]:
                boards.append(_box([start, y, low], [top, y + _VERGE[0], high], frame, 0))
        if boards:
            column = stack(boards)
            column.kind[:], column.material[:] = site.kind('verge'), site.material('timber')
            site.add(column, PIECE)

    @property
    def crest(self) -> float:
        """Height of the ridge tiles over the eaves [m]."""
        lower, upper = self._ridge_levels()
        return upper * sin(self.pitch) + (lower + TILE[1]) * cos(self.pitch)

    def _ridge_levels(self) -> tuple[float, float]:
        """Return z of the underside of ridge tiles, and x where they meet the other side [m]."""
        bottom = self.depth + COVER
        return bottom, (self.span + bottom * sin(self.pitch)) / cos(self.pitch) - APART

    def _ridge_tiles(self, edge: float, frame: int) -> list[Boxes]:
        """Lay tiles over the upper edge of the slope up to the ridge, or near the apex of hips."""
        bottom, top = self._ridge_levels()
        start = self.span + APEX if self.hipped else 0.0
        end = self.length - start
        if end - start < RIDGE_TILE:  # the slope ends in an apex
            start, end = (0.5 * self.length + side * 0.5 * _TIP[0] for side in (-1, 1))
            top -= (0.5 * _TIP[0] + _TIP[1]) / cos(self.pitch)
        count = max(round((end - start) / RIDGE_TILE), 1)
        lines = np.linspace(start, end, count + 1)
        return [_box([edge - LAP, -b + APART, bottom], [top, -a - APART, bottom + TILE[1]],
                     frame, 1) for a, b in zip(lines, lines[1:])]

    def _row(self, x: float, z: float) -> tuple[float, float]:
        """Return the start and end of a row across the slope, along the eaves [m]."""
        if not self.hipped:
            return 0.0, self.length
        inset = max(x * cos(self.pitch) - z * sin(self.pitch), -OVERHANG) + _HIP_ROOM
        return inset, self.length - inset

    def _tiles(self, low: float, high: float, frame: int) -> list[Boxes]:
        bottom = self.depth + BATTEN[1]
        start, end = self._row(high, bottom)
        count = max(int(round((end - start) / TILE[0])), 1)
        lines = np.linspace(start, end, count + 1)
        spans = [(a, b, high) for a, b in zip(lines, lines[1:])]
        if self.hipped:  # half tiles follow the hips more closely
            middle = 0.5 * (low + high)
            left, right = self._row(middle, bottom)
            spans += [(left, start, middle), (end, right, middle)]
        return [_box([low + APART, -b + APART, bottom],
                     [top - APART, -a - APART, bottom + TILE[1]], frame, 1)
                for a, b, top in spans if b - a > 4 * APART]


def _box(low: list[float], high: list[float], frame: int, axis: int) -> Boxes:
    return from_cells(micros(low), micros(high), frame=frame, axis=axis,
                      joint=Joint.FIXING)
