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

"""Roof feet: plates on the walls below eaves, and ties between them, over any plan."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import cos, sin
from procphys_ros.geometry.hexahedron import prisms
from procphys_ros.geometry.linear import product
from procphys_ros.wallgrammar.boxes import (
    Boxes,
    from_cells,
    Joint,
    MICRO,
    split_along,
)
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.roof_plan import RoofPlan
from procphys_ros.wallgrammar.walls import Elevation

PIECE = 1_500_000     # [µm] longest pieces that plates, ties, ridges and hips splinter into
TIE = (50_000, 600_000)  # [µm] width and spacing of ties between plates
_PLATE = 100_000      # [µm] width of wall plates, at most the wall
_PLATE_JOINT = 5_000  # [µm] between plates and gables
_LEAST_STRUT = 10_000  # [µm]
ALIGNED = 1e-6        # [rad] edges this close to a right angle or to one line stand so
_CLEAR = 5_000        # [µm] between such ties and the joints below, and between ties side by side

Sides = tuple[float, float]


class TieLine(NamedTuple):
    """
    Place for a tie, straight inwards from an edge.

    :ivar edge: where it starts, at a plate.
    :ivar sides: places of both its sides along the edge [µm].
    :ivar ends: how far these reach [µm].
    :ivar other: edge where it ends.
    :ivar plated: whether it is a plate, from the foot of a valley; these come first.
    """

    edge: int
    sides: tuple[int, int]
    ends: Sides
    other: int
    plated: bool

    @property
    def length(self) -> float:
        """Distance between the edges [µm]."""
        return max(self.ends)


@dataclass
class RoofFeet:
    """
    Plates and ties of a roof.

    :ivar site: takes the parts.
    :ivar walls: of the facades.
    :ivar plan: faces of the roof.
    :ivar height: of the walls [µm].
    :ivar square: whether the plan has right angles only, so that all parts of one frame meet.
    """

    site: Site
    walls: Sequence[Elevation]
    plan: RoofPlan
    height: int
    square: bool
    _ring: int = -1

    @property
    def plate(self) -> int:
        """Width of the plates [µm]."""
        return min(_PLATE, self.walls[0].layout.thickness)

    @property
    def gauge(self) -> int:
        """Height of the plates and ties, a course [µm]."""
        return self.walls[0].layout.gauge

    def eaves(self) -> list[int]:
        """List the edges with eaves, from south and west to north and east in each frame."""
        return sorted(self.plan.eaves, key=lambda i: (self.walls[i].facade.frame,
                                                      (self.walls[i].facade.quarter + 1) % 4))

    def lay_plates(self) -> np.ndarray:
        """Lay plates on the walls below eaves, mitred at the corners into one ring."""
        found = []
        for edge in self.eaves():
            length, after = self.walls[edge].facade.length, (edge + 1) % len(self.walls)
            gabled = [other in self.plan.gables
                      for other in ((edge - 1) % len(self.walls), after)]
            inner = self._inner(edge)
            outer = [end if g else corner for end, corner, g in zip(inner, (0, length), gabled)]
            found.append(self._timber(edge, 0, np.array([outer, inner]).T, (0, self.plate),
                                      self.height, 'plate', [_PLATE_JOINT * g for g in gabled]))
        boxes = Boxes.stack(found)
        self._ring = boxes.member[:] = self.site.next_member
        rows = self.site.add(boxes)
        return np.arange(rows.start, rows.stop)

    def lay_head(self, edge: int, levels: tuple[int, int], sides: tuple[int, int],
                 kind: str) -> np.ndarray:
        """
        Lay a timber along a wall, between the walls beside it.

        :param edge: of the wall, between gables.
        :param levels: of its underside and its top [µm].
        :param sides: outer and inner side, inwards from the edge [µm].
        :param kind: name of its kind.
        """
        low, high = self._inner(edge)
        joint = [_PLATE_JOINT, 0, 0]
        box = from_cells([low, sides[0], levels[0]], [high, sides[1], levels[1]], joint, joint,
                         joint=Joint.FIXING, kind=self.site.kind(kind),
                         material=self.site.material('timber'))
        rows = self.site.add(self.walls[edge].facade.place(box), PIECE)
        return np.arange(rows.start, rows.stop)

    def _inset(self, edge: int) -> int:
        """Return the distance of plates and ties inside of an edge [µm]: a plate, or a gable."""
        return self.walls[0].layout.thickness if edge in self.plan.gables else self.plate

    @cached_property
    def _inside(self) -> np.ndarray:
        """Corners of the inside of plates and gables, each the start of an edge [µm], (n, 2)."""
        plan, insets = self.plan, np.array([*map(self._inset, range(len(self.walls)))], float)
        bent = np.abs(plan.turns) > ALIGNED
        along = np.where(bent, np.roll(insets, 1) - insets * cos(plan.turns), 0.0) / np.where(
            bent, sin(plan.turns), 1.0)
        return (MICRO * plan.points + along[:, None] * plan.ways
                + insets[:, None] * plan.normals)

    def _inner(self, edge: int) -> tuple[int, int]:
        """Return the ends of the inside of a plate or gable, along its edge [µm]."""
        ends = self._inside[[edge, (edge + 1) % len(self.walls)]] / MICRO
        low, high = np.rint(MICRO * self.plan.local(edge, ends)[:, 0]).astype(int).tolist()
        return low, high

    def tie(self) -> None:
        """Tie opposite plates together, so that the rafters do not push the walls apart."""
        lines = [line for edge in self.eaves() for place, plated in self._tie_places(edge)
                 if (line := self._line(edge, place, plated)) is not None]
        bottom = self.height  # where they are cut aslant they are clear of the walls
        if not self.square:
            bottom += self.walls[0].layout.joint + _CLEAR
        found: dict[int, list[float]] = {}
        laid: list[np.ndarray] = []
        for line in sorted(lines, key=lambda line: (not line.plated, line.length)):
            crossed = self._crossings(line, laid)
            middle = 0.5 * sum(line.sides)
            beside = min((abs(middle - end) for end in found.get(line.edge, ())), default=np.inf)
            if crossed is None or beside < 0.5 * TIE[1]:
                continue
            joint = Joint.HALVED if crossed or not self.square else Joint.LAP
            for piece in self._cut_tie(line, crossed):
                boxes = self._timber(line.edge, 1, piece, line.sides,
                                     self.height if line.plated else bottom,
                                     'plate' if line.plated else 'tie',
                                     joint=Joint.FIXING if line.plated else joint)
                if line.plated:
                    boxes.member[:] = self._ring
                self.site.add(boxes)
            laid.append(self._world_of(line))
            found.setdefault(line.edge, []).append(middle)
            far_end = MICRO * self.plan.local(line.other, laid[-1][2:].mean(axis=0) / MICRO)
            found.setdefault(line.other, []).append(float(far_end[0]))

    def _cut_tie(self, line: TieLine, crossed: Sequence[tuple[Sides, Sides]]
                 ) -> Iterator[np.ndarray]:
        """Yield start and end of the pieces of a tie [µm], on both of its sides, (2, 2)."""
        start = np.full(2, float(self.plate))
        for k in range(len(crossed) + 1):
            # Two that cross each other may cut it at one place.
            near = np.min([line.ends, *(near for near, _ in crossed[k:])], axis=0)
            if (near - start).min() > _LEAST_STRUT:
                yield np.rint([start, near]).astype(int)
            if k < len(crossed):
                start = np.maximum(start, crossed[k][1])

    def _tie_places(self, edge: int) -> list[tuple[int, bool]]:
        """List places of ties along an edge [µm]; plates run on from the feet of valleys."""
        length, (low, high) = self.walls[edge].facade.length, self._inner(edge)
        valleys = [(place, True) for corner, place in (
            (edge, low), ((edge + 1) % len(self.walls), high - self.plate))
            if self.plan.turns[corner] < -ALIGNED]
        first = self.walls[0].layout.thickness + TIE[1]
        last = length - first - TIE[0]
        if last < first + 2 * TIE[0]:  # no room for two with these margins
            return [*valleys, *((share * length // 4 - TIE[0] // 2, False)
                                for share in ((1, 3) if length > 2 * TIE[1] else (2,)))]
        count = max(-(-(last - first) // TIE[1]), 1) + 1
        return [*valleys, *((round(place), False)
                            for place in np.linspace(first, last, count).tolist())]

    def _line(self, edge: int, place: int, plated: bool) -> TieLine | None:
        """Find where a tie from an edge ends, straight across; None where it meets a corner."""
        sides = (place, place + (self.plate if plated else TIE[0]))
        low, high = self._inner(edge)
        points = MICRO * self.plan.local(edge, self._inside / MICRO)
        way = np.roll(points, -1, axis=0) - points
        found, ends = [], []
        for x in sides:
            crossed = np.flatnonzero((points[:, 0] <= x) != (points[:, 0] + way[:, 0] <= x))
            share = (x - points[crossed, 0]) / way[crossed, 0]
            y = points[crossed, 1] + share * way[crossed, 1]
            crossed, y = crossed[y > self.plate + 1.0], y[y > self.plate + 1.0]
            if not len(y) or not low <= x <= high:
                return None
            found.append(int(crossed[np.argmin(y)]))
            ends.append(float(y.min()))
        line = TieLine(edge, sides, (ends[0], ends[1]), found[0], plated)
        in_the_way = (np.abs(points - [0.5 * sum(sides), 0.5 * line.length])
                      < [0.5 * (sides[1] - sides[0]) + _CLEAR, 0.5 * line.length]).all(axis=1)
        for own in (edge, found[0]):  # plates that it lies between may end beside it
            in_the_way[[own, (own + 1) % len(points)]] = False
        return None if found[1] != found[0] or in_the_way.any() else line

    def _crossings(self, line: TieLine, laid: Sequence[np.ndarray]
                   ) -> list[tuple[Sides, Sides]] | None:
        """
        Find where a tie crosses those that were laid, by the near and the far side of each.

        :returns: places on both sides of the tie, in order; None where it meets an end of one.
        """
        sides, found = line.sides, []
        for outline in laid:
            points = MICRO * self.plan.local(line.edge, outline / MICRO)
            left, right = points[[0, 3]], points[[1, 2]]
            if (points[:, 0].max() < sides[0] - _CLEAR or points[:, 0].min() > sides[1] + _CLEAR
                    or points[:, 1].max() < self.plate or points[:, 1].min() > line.length):
                continue
            if max(min(side[:, 0]) for side in (left, right)) > sides[0] or min(
                    max(side[:, 0]) for side in (left, right)) < sides[1]:
                return None
            near, far = sorted([float((side[0, 1] + (x - side[0, 0]) / np.diff(side[:, 0])
                                       * np.diff(side[:, 1]))[0]) for x in sides]
                               for side in (left, right))
            found.append(((near[0], near[1]), (far[0], far[1])))
        return sorted(found)

    def _world_of(self, line: TieLine) -> np.ndarray:
        """Return the outline of a tie in the first frame [µm]: its start, then its end, (4, 2)."""
        left, right = line.sides
        local = np.array([[left, self.plate], [right, self.plate], [right, line.ends[1]],
                          [left, line.ends[0]]])
        return MICRO * self.plan.points[line.edge] + product(local, np.array(
            [self.plan.ways[line.edge], self.plan.normals[line.edge]]))

    def _timber(self, edge: int, axis: int, ends: np.ndarray, sides: tuple[int, int],
                bottom: int, kind: str, joints: Sequence[int] = (0, 0),
                joint: Joint = Joint.FIXING) -> Boxes:
        """
        Return a timber along or across an edge, whose ends may be cut aslant, up to the eaves.

        :param axis: 0 along the edge, 1 inwards from it.
        :param ends: its start and its end [µm], on the low and the high side, (2, 2).
        :param sides: low and high side [µm].
        :param bottom: level of its underside [µm].
        :param joints: at its ends [µm].
        :param joint: to its neighbours.
        """
        facade = self.walls[edge].facade
        low, high, margins = np.zeros(3, int), np.zeros(3, int), np.zeros((2, 3), int)
        low[axis], high[axis] = max(ends[0]), min(ends[1])
        if low[axis] >= high[axis]:  # shorter than it is aslant
            low[axis], high[axis] = min(ends[0]), max(ends[1])
        low[1 - axis], high[1 - axis] = sides
        low[2], high[2] = bottom, self.height + self.gauge
        margins[:, axis] = joints
        box = from_cells(low, high, *margins, axis=axis,
                         joint=joint, kind=self.site.kind(kind),
                         material=self.site.material('timber'))
        if self.square and not np.ptp(ends, axis=1).any():
            return split_along(facade.place(box), PIECE, self.site.next_member)
        pieces = split_along(box, PIECE, self.site.next_member)
        placed = facade.place(pieces)
        along = np.stack([pieces.low[:, [axis, axis]], pieces.high[:, [axis, axis]]], axis=1)
        along[0, 0], along[-1, 1] = ends[0] + joints[0], ends[1] - joints[1]
        for k in {0, len(pieces) - 1}:
            plan = np.stack([along[k], np.tile(sides, (2, 1))], axis=-1)  # by end and side
            if axis == 0:
                plan = plan.transpose(1, 0, 2)
            cut = self.site.hexahedra(facade.place_points(prisms(
                plan[..., [axis, 1 - axis]].reshape(1, 4, 2), low[2], high[2]) / MICRO))
            for name in ('low', 'high', 'before', 'after', 'form'):
                getattr(placed, name)[k] = getattr(cut, name)[0]
        return placed
