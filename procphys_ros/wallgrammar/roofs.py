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

"""Roofs: plates, ties, ridge and the bonds of rafters, common to gables and hips."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.elementary import atan2, cos, sin, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.bodies import Neighbour
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, Joint, MICRO, micro
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.slopes import (
    COVER,
    Ends,
    OVERHANG,
    RAFTER,
    rafter_depth,
    Slope,
    TILE_AREA,
)
from procphys_ros.wallgrammar.walls import Elevation

RIDGE = 0.075         # [m] thickness of the ridge board
PIECE = 1_500_000     # [µm] plates, ridges and hips splinter into pieces of at most this length
TIE = (50_000, 600_000)  # [µm] width and spacing of ties between plates
_PLATE = 100_000      # [µm] width of wall plates, at most the wall
_RIDGE_SEAT = 0.15    # [m] least depth of the ridge board below the rafters' ends
_LEAST_ROOM = 0.5     # [m] between opposite walls, for ties and rafters
_EAVES_ROOM = 0.03    # [m] kept clear around the eaves
_TIE_GAP = 0.001      # [m] mean gap of cut timber joints


class Roof:
    """
    A roof over a rectangular building, or a rectangle of one, under construction.

    :ivar axis: of the first frame, along which the ridge runs.
    :ivar low, high: outer corners of the building [µm], (2,) in the first frame.
    :ivar span: horizontal distance from the eaves to the ridge [m].
    :ivar depth: of the rafters [m].
    """

    def __init__(self, site: Site, walls: Sequence[Elevation], height: int, pitch: float,
                 axis: int, neighbours: Sequence[Neighbour] = (),
                 rectangle: tuple[np.ndarray, np.ndarray] | None = None):
        self.site = site
        self.neighbours = neighbours
        self.walls = walls
        self.height = height
        self.layout = walls[0].layout
        self.gauge = self.layout.gauge
        self.pitch = float(np.radians(pitch))
        corners = np.array([w.facade.origin for w in walls])
        self.low: np.ndarray = corners.min(axis=0) if rectangle is None else rectangle[0]
        self.high: np.ndarray = corners.max(axis=0) if rectangle is None else rectangle[1]
        self.plate = min(_PLATE, self.layout.thickness)
        self.axis = axis
        self.size = (self.high - self.low) / MICRO
        room = float(self.size.min()) - 2.0 * self.layout.thickness / MICRO
        if room < _LEAST_ROOM:
            raise site.place.error(f'a gable or hip roof needs at least {_LEAST_ROOM:g} m between '
                                   f'opposite walls, found {room:g} m; use flat or none')
        self.span = 0.5 * float(self.size[1 - axis])
        self.depth = rafter_depth(self.span, self.pitch)
        site.expect(float(self.size.prod()) / cos(self.pitch) / TILE_AREA)
        self._check_eaves()

    @property
    def eaves(self) -> float:
        """Height of the rafters' underside over the outer edge of the wall [m]."""
        return (self.height + self.gauge) / MICRO

    def _check_eaves(self) -> None:
        """Check that no wall stands in the way of the eaves of this roof."""
        drop = micro(OVERHANG * tan(self.pitch) + _EAVES_ROOM)
        # The battens and tiles on square ends of rafters reach further out than these.
        reach = micro(OVERHANG + (self.depth + COVER) * sin(self.pitch) + _EAVES_ROOM)
        for other in self.neighbours:
            if other.crest + other.lean * reach <= self.height - drop:
                continue
            for axis in self._eaves_axes():
                beside = other.low[axis] < self.high[axis] and other.high[axis] > self.low[axis]
                across = 1 - axis
                near = (other.low[across] < self.high[across] + reach
                        and other.high[across] > self.low[across] - reach)
                if beside and near:
                    raise self.site.place.error(
                        f'the eaves of a roof reach {reach / MICRO:.2f} m out of its walls, and '
                        f'"{other.name}" stands there; build it against a gable, or keep it below '
                        f'{(self.height - drop) / MICRO:.2f} m')
        for wall in self.walls:
            if wall.facade.quarter % 2 in self._eaves_axes() and (
                    wall.piers_above(self.height - drop)):
                raise self.site.place.error(
                    f'the eaves of a roof reach {OVERHANG:g} m out of its walls, over piers that '
                    f'stand out of them: end the piers below {(self.height - drop) / MICRO:.2f} m')

    def _eaves_axes(self) -> tuple[int, ...]:
        """Return the axes along which eaves run."""
        return (0, 1)

    def tie(self, axis: int) -> None:
        """
        Tie opposite plates together, so that the rafters do not push the walls apart.

        :param axis: of the first frame, along which the ridge runs.
        """
        across = 1 - axis
        for place in self._tie_places(axis):
            self._timber(across, (self.low[across] + self.plate, self.high[across] - self.plate),
                         (place, place + TIE[0]), self.height, self.height + self.gauge, 0, 'tie')

    def _tie_places(self, axis: int) -> list[int]:
        first = int(self.low[axis]) + self.layout.thickness + TIE[1]
        last = int(self.high[axis]) - self.layout.thickness - TIE[1] - TIE[0]
        if last < first + 2 * TIE[0]:  # no room for two
            return [(first + last) // 2]
        count = max(-(-(last - first) // TIE[1]), 1) + 1
        return [round(place) for place in np.linspace(first, last, count).tolist()]

    def _ridge_levels(self, span: float) -> tuple[int, int]:
        """Compute bottom (on a course) and top of the ridge board [µm]."""
        underside = self.eaves + (span - 0.5 * RIDGE) * tan(self.pitch)
        bottom = micro(underside - _RIDGE_SEAT) // self.gauge * self.gauge
        top = micro(underside + self.depth * cos(self.pitch) - 0.005)
        if bottom < self.height + self.gauge:
            raise self.site.place.error('the roof is too low to stand: give it more pitch, or the '
                                        'building more depth')
        return bottom, top

    def _frame(self, slope: Slope) -> int:
        self.site.frames.append(slope.pose)
        return len(self.site.frames) - 1

    def _timber(self, axis: int, along: tuple[int, int], across: tuple[int, int], bottom: int,
                top: int, joint: int, kind: str = 'plate') -> np.ndarray:
        """Lay an upright timber along an axis of the first frame; return its parts."""
        rows = self.site.add(self._box(axis, along, across, bottom, top, joint, kind), PIECE)
        return np.arange(rows.start, rows.stop)

    def _box(self, axis: int, along: tuple[int, int], across: tuple[int, int], bottom: int,
             top: int, joint: int, kind: str) -> Boxes:
        low, high, margin = np.zeros(3, int), np.zeros(3, int), np.zeros(3, int)
        low[axis], high[axis] = along
        low[1 - axis], high[1 - axis] = across
        low[2], high[2] = bottom, top
        margin[axis] = joint
        return from_cells(low, high, margin, margin, axis=axis,
                          joint=Joint.LAP if kind == 'tie' else Joint.FIXING,
                          kind=self.site.kind(kind), material=self.site.material('timber'))

    def _opposite(self, axis: int, span: float, length: float, hipped: bool) -> list[Slope]:
        """Return the two slopes whose eaves run along an axis."""
        ahead = rotation.rotate(self.site.frames[0][3:], np.array([1.0, 0.0, 0.0]))
        yaw = float(atan2(ahead[1], ahead[0]))
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
        points = slope.world(0.5 * width / cos(self.pitch), -rafters.place, 0.0)
        points[:, 2] = self.eaves + 0.25 * width * tan(self.pitch)
        upright = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        reach = np.tile([0.5 * self.gauge / MICRO, 0.5 * self.depth], (len(points), 1))
        # A long rafter is cut in pieces: the one over the plate carries.
        eaves = rotation.rotate(slope.pose[3:], np.array([0.0, 1.0, 0.0]))
        self._bond(self._nearest(plates, points), rafters.foot, points, upright,
                   (RAFTER, width), reach, eaves)

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
        normal = np.tile(along / norm(along), (len(points), 1))
        reach = np.column_stack([0.5 * (rafters.reach), np.full(len(points), 0.5 * RIDGE)])
        self._bond(rafters.head, self._nearest(holders, points), points, normal,
                   (RAFTER, self.depth), np.minimum(reach, 0.5))

    def _nearest(self, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Find the part among some that is nearest to each point, (n,)."""
        boxes = self.site.boxes().take(rows)
        frames = np.array(self.site.frames)[boxes.frame]
        local = rotation.rotate(rotation.conjugate(frames[None, :, 3:]),
                                points[:, None] - frames[None, :, :3])
        outside = np.maximum(np.maximum(boxes.low / MICRO - local, local - boxes.high / MICRO), 0)
        return rows[np.argmin((outside * outside).sum(axis=-1), axis=1)]

    def _bond(self, first: np.ndarray, second: np.ndarray, points: np.ndarray,
              normals: np.ndarray, extent: tuple[float, float], reach: np.ndarray,
              ahead: np.ndarray | None = None) -> None:
        """Bond parts of different frames; the patch's x lies level, `ahead` in level patches."""
        level = np.cross([0.0, 0.0, 1.0], normals)
        if ahead is not None:
            level[:] = ahead
        level /= norm(level, axis=1, keepdims=True)
        axes = np.stack([level, np.cross(normals, level), normals], axis=-1)
        n = len(points)
        self.site.patches.append(Patches(
            np.column_stack([first, second]), np.column_stack([points,
                                                               rotation.from_matrix(axes)]),
            np.tile(extent, (n, 1)), np.full(n, extent[0] * extent[1]), np.full(n, _TIE_GAP),
            reach))
