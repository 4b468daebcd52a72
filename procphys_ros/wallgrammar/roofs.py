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

"""Roofs: timber and tiles over right-angled plans, with hips, valleys, ridges and gables."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import atan2, cos, hypot, sin, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.bodies import Neighbour
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
from procphys_ros.wallgrammar.footprint import Corner, crossing, Footprint
from procphys_ros.wallgrammar.plan import bays, Rectangle
from procphys_ros.wallgrammar.roof_plan import Arc, EVERYWHERE, NoRoofError, RoofPlan
from procphys_ros.wallgrammar.slopes import (
    BOARD,
    CLEAR,
    COVER,
    OVERHANG,
    Post,
    RAFTER,
    rafter_depth,
    Slope,
    Span,
    TILE_AREA,
)
from procphys_ros.wallgrammar.tiling import lay, Runs
from procphys_ros.wallgrammar.walls import Elevation, unit_of

PIECE = 1_500_000     # [µm] plates, ridges and hips splinter into pieces of at most this length
TIE = (50_000, 600_000)  # [µm] width and spacing of ties between plates
_PLATE = 100_000      # [µm] width of wall plates, at most the wall
_PLATE_JOINT = 5_000  # [µm] between plates and gables
_RIDGE_SEAT = 0.15    # [m] least depth of the ridge board below the rafters' ends
_RIDGE_ROOM = 12_000  # [µm] beside the ridge board in its pocket, where it only rests
_LEAST_ROOM = 0.5     # [m] between opposite walls, for ties and rafters
_EAVES_ROOM = 0.03    # [m] kept clear around the eaves
_TIE_GAP = 0.001      # [m] mean gap of cut timber joints
_STRUT = 1_200_000    # [µm] largest distance of struts
_LEAST_STRUT = 10_000  # [µm]
_POST = 0.03          # [m] half the side of the posts where hips, valleys and ridges meet
_NEAREST = 0.25       # [m] least distance of two such posts,
_ONE = 0.002          # [m] if they are not one
_GABLE_CLEAR = 0.01   # [m] between the gable and the battens
_LEAST_RUN = 50_000   # [µm] shorter pieces of a gable course are left out
_BESIDE = 60_000      # [µm] walls this near to a gable leave no room for its boards
_EDGE = 0.06          # [m] between the outermost rafters and the gable
_MARGIN = 0.5         # [m] between the outermost rafters and the corners of other slopes


class Node(NamedTuple):
    """
    Place in plan where hips, valleys and ridges meet: at a post, or at a gable.

    :ivar place: [m], (2,).
    :ivar height: distance from the eaves in plan [m].
    :ivar radius: at which the boards end around the post [m]; 0 at gables.
    :ivar post: part; -1 at gables.
    """

    place: np.ndarray
    height: float
    radius: float
    post: int


class Roof:
    """
    A roof of one pitch under construction.

    :ivar axis: of the first frame, along which the plan is cut into fewest bays; the ridge of a
        gable over a rectangle runs along it.
    :ivar plan: faces and the lines between them, in the first frame.
    :ivar depth: of the rafters [m].
    """

    def __init__(self, site: Site, ground: Footprint, walls: Sequence[Elevation], height: int,
                 pitch: float, gabled: bool, neighbours: Sequence[Neighbour] = ()):
        self.site, self.walls, self.height, self.neighbours = site, walls, height, neighbours
        self.layout = walls[0].layout
        self.gauge = self.layout.gauge
        self.pitch = float(np.radians(pitch))
        self.corners, self.plate = ground.corners, min(_PLATE, self.layout.thickness)
        size = np.ptp(self.corners, axis=0) / MICRO
        first = walls[0].facade.quarter % 2 if gabled else int(np.argmax(size))
        self.axis = min(first, 1 - first, key=lambda axis: len(bays(ground, axis, 0)))
        self.bays = bays(ground, self.axis, 0)
        try:
            self.plan = RoofPlan(self.corners / MICRO)
            if gabled:
                self.plan = RoofPlan(self.corners / MICRO, self._gables())
        except NoRoofError:
            raise site.place.error('no gable or hip roof was found over this plan; use flat '
                                   'or none') from None
        room = 2.0 * (min(arc.high for arc in self.plan.arcs) - self.layout.thickness / MICRO)
        if room < _LEAST_ROOM:
            raise site.place.error(f'a gable or hip roof needs at least {_LEAST_ROOM:g} m between '
                                   f'opposite walls, found {room:g} m; use flat or none')
        self.depth = rafter_depth(max(arc.high for arc in self.plan.arcs), self.pitch)
        site.expect(float(size.prod()) / cos(self.pitch) / TILE_AREA)
        self._check_eaves()

    @property
    def eaves(self) -> float:
        """Height of the rafters' underside over the outer edge of the wall [m]."""
        return (self.height + self.gauge) / MICRO

    def _gables(self) -> frozenset[int]:
        """
        Choose the edges under gables.

        Over rectangles the ridge runs along the first edge. Elsewhere gables are the triangles of
        the hip roof, of which no two are neighbours.
        """
        quarters = [wall.facade.quarter for wall in self.walls]
        if len(quarters) == 4:
            return frozenset(i for i, q in enumerate(quarters) if q % 2 != self.axis)
        found: set[int] = set()
        n, plan = len(quarters), self.plan
        for edge, plane in enumerate(plan.plane.tolist()):
            ends = [float(((plan.points[corner] - plan.points[plane]) * plan.ways[plane]).sum())
                    for corner in (edge, (edge + 1) % n)]
            if not found & {(edge - 1) % n, (edge + 1) % n} and any(
                    field.low == EVERYWHERE and field.start.way > 0.0 > field.end.way
                    and field.end.place(field.high) - field.start.place(field.high) < _ONE
                    and np.allclose((field.start.at, field.end.at), ends, 0.0, _ONE)
                    for field in plan.faces[plane]):
                found.add(edge)
        return frozenset(found)

    def _eaves_of(self) -> list[int]:
        """List the edges with eaves, from south and west to north and east in the first frame."""
        return sorted((i for i in range(len(self.walls)) if i not in self.plan.gables),
                      key=lambda i: (self.walls[i].facade.quarter + 1) % 4)

    def _check_eaves(self) -> None:
        """Check that no wall stands in the way of the eaves of this roof."""
        drop = micro(OVERHANG * tan(self.pitch) + _EAVES_ROOM)
        # The battens and tiles on square ends of rafters reach further out than these.
        reach = micro(OVERHANG + (self.depth + COVER) * sin(self.pitch) + _EAVES_ROOM)
        for edge in self._eaves_of():
            wall, across = self.walls[edge], 1 - self.walls[edge].facade.quarter % 2
            start, end = self._along(edge)
            line, out = wall.facade.origin[across], -1 if wall.facade.quarter in (0, 3) else 1
            for other in self.neighbours:
                near, far = sorted((out * (int(other.low[across]) - line),
                                    out * (int(other.high[across]) - line)))
                if (other.crest + other.lean * reach > self.height - drop and near < reach
                        and far > 0 and other.low[1 - across] < end
                        and other.high[1 - across] > start):
                    raise self.site.place.error(
                        f'the eaves of a roof reach {reach / MICRO:.2f} m out of its walls, and '
                        f'"{other.name}" stands there; build it against a gable, or keep it below '
                        f'{(self.height - drop) / MICRO:.2f} m')
            if wall.piers_above(self.height - drop):
                raise self.site.place.error(
                    f'the eaves of a roof reach {OVERHANG:g} m out of its walls, over piers that '
                    f'stand out of them: end the piers below {(self.height - drop) / MICRO:.2f} m')
        points = self.plan.outline(self.plan.edges, -reach / MICRO)[0]
        ends = np.roll(points, -1, axis=0)
        if ((ends - points) * self.plan.ways[self.plan.edges] <= -1e-9).any() or len(
                crossing(points, ends)):
            raise self.site.place.error(
                f'the eaves of a roof reach {reach / MICRO:.2f} m out of its walls, and meet each '
                f'other there; leave more room between the wings')

    def build(self) -> None:
        """Build plates, gables, posts, ridges, hips, valleys, slopes and ties."""
        plates = self._plates()
        for edge in sorted(self.plan.gables):
            self._gable_wall(self.walls[edge])
        nodes = self._nodes()
        boards = [(arc, self._board(arc, nodes, plates)) for arc in self.plan.arcs
                  if hypot(*(arc.end - arc.start)) > _ONE]
        holders = np.concatenate([part for _, part in boards])
        valleys = np.concatenate([part for arc, part in boards if arc.valley] or [holders])
        for arc, parts in boards:
            for other, more in boards:
                if (arc.valley and not other.valley and arc.low == other.low == 0.0
                        and hypot(*(arc.end - other.end)) < _ONE
                        and hypot(*(arc.start + other.start - 2.0 * arc.end)) < _ONE):
                    self._brace(arc, other, np.concatenate([parts, more]))
        planes = list(dict.fromkeys(int(self.plan.plane[edge]) for edge in self._eaves_of()))
        for plane in planes:
            slope = self._slope(plane, nodes)
            frame = self._frame(slope.pose)
            rafters = slope.rafters(self.site, frame, self.layout.thickness / MICRO + _EDGE,
                                    _MARGIN)
            if not len(rafters.place):
                x, y = self.plan.points[plane]
                raise self.site.place.error(f'the roof over the edge that begins at ({x:g}, {y:g})'
                                            ' has no room for a rafter; make it longer')
            low = rafters.start <= slope.along(0.0, self.depth)
            self._seat(slope, rafters.place[low], rafters.foot[low], plates)
            self._nail(slope, rafters.head, holders, slope.world(
                rafters.reach, -rafters.place, 0.5 * self.depth), 0.5 * rafters.reach)
            self._nail(slope, rafters.foot[~low], valleys, slope.world(
                rafters.start, -rafters.place, 0.5 * self.depth)[~low],
                0.5 * rafters.reach[~low], -1.0)
            slope.cover(self.site, frame, rafters)
            slope.verges(self.site, frame, self._verges(plane))
        self._tie()

    def _along(self, edge: int) -> tuple[int, int]:
        """Return the ends of an edge along its axis, in order [µm]."""
        axis = self.walls[edge].facade.quarter % 2
        ends = self.corners[[edge, (edge + 1) % len(self.walls)], axis]
        return int(ends.min()), int(ends.max())

    def _plates(self) -> np.ndarray:
        """
        Lay plates on the walls below eaves, half-lapped at the corners into one ring.

        Those along the axis run on through the plan where it widens, up to the next wall.
        """
        found = {}
        for edge in self._eaves_of():
            quarter, n = self.walls[edge].facade.quarter, len(self.walls)
            line = int(self.corners[edge, 1 - quarter % 2])
            line -= self.plate if quarter in (1, 2) else 0
            ends, others = list(self._along(edge)), [(edge - 1) % n, (edge + 1) % n]
            corners = [edge, others[1]]
            if quarter > 1:
                others.reverse()
                corners.reverse()
            insets = [self.plate * bool(self.plan.turns[corner] > 0.5) for corner in corners]
            if quarter % 2 == self.axis:
                for k, other in enumerate(self._around(line + self.plate // 2, ends)):
                    insets[k] = self.plate * (other != others[k])
                    ends[k], others[k] = int(self.corners[other, self.axis]), other
            gabled = [other in self.plan.gables for other in others]
            low, high = (self.layout.thickness if g else i for g, i in zip(gabled, insets))
            found[quarter, line, ends[0]] = self._box(
                quarter % 2, (ends[0] + low, ends[1] - high), (line, line + self.plate),
                self.height, self.height + self.gauge, 'plate', [_PLATE_JOINT * g for g in gabled])
        boxes = split_along(stack(list(found.values())), PIECE, 0)
        boxes.member[:] = self.site.next_member
        rows = self.site.add(boxes)
        return np.arange(rows.start, rows.stop)

    def _around(self, line: int, ends: Sequence[int]) -> tuple[int, int]:
        """Find the edges at both ends of the stretch of the plan around a part of a line."""
        crossed = sorted((int(self.corners[edge, self.axis]), edge)
                         for edge, wall in enumerate(self.walls)
                         if wall.facade.quarter % 2 != self.axis
                         and self._along(edge)[0] < line < self._along(edge)[1])
        return (max(c for c in crossed if c[0] <= ends[0])[1],
                min(c for c in crossed if c[0] >= ends[1])[1])

    def _nodes(self) -> list[Node]:
        """Set posts where boards meet."""
        found: list[Node] = []
        for arc in self.plan.arcs:
            for place, height in ((arc.start, arc.low), (arc.end, arc.high)):
                near = [float(hypot(*(place - node.place))) for node in found]
                if height == 0.0 or min(near, default=1.0) < _ONE:
                    continue
                if min(near, default=1.0) < _NEAREST:
                    raise self.site.place.error(
                        f'ridges, hips or valleys of the roof meet {min(near):.2f} m apart, at '
                        f'least {_NEAREST:g} m are needed: make opposite edges of the footprint '
                        'equal, or more different; or use flat')
                if any(abs(((place - self.plan.points[g]) * self.plan.normals[g]).sum()) < _ONE
                       for g in self.plan.gables):
                    found.append(Node(place, height, 0.0, -1))
                else:
                    found.append(Node(place, height, self._radius(place),
                                      self._post(place, height)))
        return found

    def _radius(self, place: np.ndarray) -> float:
        """Compute how far from a node its boards end, so that none meets another or the post."""
        ways = [(way if hypot(*(arc.start - place)) < _ONE else -way)
                for arc in self.plan.arcs if hypot(*(way := arc.end - arc.start)) > _ONE and min(
                    hypot(*(arc.start - place)), hypot(*(arc.end - place))) < _ONE]
        angles = np.sort(atan2(*np.array(ways).T[::-1]))
        between = np.diff(angles, append=angles[0] + 2.0 * np.pi)
        return float(max(0.5 * BOARD / tan(0.5 * min(between.min(), 0.5 * np.pi)),
                         np.sqrt(2.0) * _POST) + CLEAR)

    def _post(self, place: np.ndarray, height: float) -> int:
        """Set a post below the tiles; return its part."""
        rise = self.eaves + height * tan(self.pitch)
        top = rise + self.depth / cos(self.pitch) - np.sqrt(2.0) * _POST * tan(self.pitch) - CLEAR
        return self.site.add(from_cells(
            micros([*(place - _POST), max(self.eaves, rise - _RIDGE_SEAT)]),
            micros([*(place + _POST), top]), axis=2, joint=Joint.FIXING,
            kind=self.site.kind('post'), material=self.site.material('timber'))).start

    def _board(self, arc: Arc, nodes: Sequence[Node], plates: np.ndarray) -> np.ndarray:
        """Set the board below a ridge, hip or valley, and bond it at both ends."""
        ends = [next((node for node in nodes if hypot(*(place - node.place)) < _ONE), None)
                for place in (arc.start, arc.end)]
        if arc.low == arc.high:
            return self._ridge(arc, [node for node in ends if node is not None])
        plan, rise = hypot(*(arc.end - arc.start)), arc.high - arc.low
        slope, steep = float(atan2(rise * tan(self.pitch), plan)), rise / plan
        drop = 0.0 if arc.valley else 0.5 * BOARD * tan(self.pitch) * np.sqrt(1.0 - steep * steep)
        depth = float((self.depth / cos(self.pitch) - drop - 0.003) * cos(slope))
        start, end = ends
        low = 0.0 if arc.valley else -OVERHANG / steep / cos(slope)
        if start is not None:
            low = (start.radius + depth * sin(slope)) / cos(slope)
        high = (plan - (0.0 if end is None else end.radius)) / cos(slope)
        way = (arc.end - arc.start) / plan
        first = self.site.frames[0]
        attitude = rotation.multiply(
            rotation.multiply(first[3:], rotation.from_yaw(float(atan2(way[1], way[0])))),
            rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-slope)))
        pose = np.concatenate([rotation.rotate(first[3:], np.array([
            *arc.start, self.eaves + arc.low * tan(self.pitch)])), attitude])
        rows = self.site.add(from_cells(
            micros([low, -0.5 * BOARD, 0.0]), micros([high, 0.5 * BOARD, depth]),
            frame=self._frame(pose), joint=Joint.FIXING,
            kind=self.site.kind('valley' if arc.valley else 'hip'),
            material=self.site.material('timber')), PIECE)
        parts = np.arange(rows.start, rows.stop)
        for node, x, part in ((start, low, parts[0]), (end, high, parts[-1])):
            if node is not None:
                self._fix(node, part, pose[:3] + rotation.rotate(
                    pose[3:], np.array([x, 0.0, 0.5 * depth])), depth)
        if start is None:
            self._seat_board(pose, parts[0], slope, depth, plates)
        return parts

    def _brace(self, arc: Arc, other: Arc, boards: np.ndarray) -> None:
        """
        Tie the foot of a valley to that of the hip which it meets in one line, over other ties.

        :param arc, other: the valley and the hip.
        :param boards: parts of both.
        """
        way = other.start - arc.start
        length, rise = hypot(*way), (arc.high - arc.low) / hypot(*(arc.end - arc.start))
        start = (self.gauge / MICRO + 2.0 * CLEAR) / (rise * tan(self.pitch))
        first, half = self.site.frames[0][3:], 0.5 * TIE[0] / MICRO
        pose = np.concatenate([
            rotation.rotate(first, np.array([*arc.start, self.eaves + CLEAR])),
            rotation.multiply(first, rotation.from_yaw(float(atan2(way[1], way[0]))))])
        rows = self.site.add(from_cells(
            micros([start, -half, 0.0]), micros([length - start, half, self.gauge / MICRO]),
            frame=self._frame(pose), joint=Joint.LAP, kind=self.site.kind('tie'),
            material=self.site.material('timber')), PIECE)
        points = pose[:3] + rotation.rotate(pose[3:], np.array([
            [x, 0.0, self.gauge / MICRO] for x in (start + half, length - start - half)]))
        self._bond(np.array([rows.start, rows.stop - 1]), self._nearest(boards, points), points,
                   np.tile([0.0, 0.0, 1.0], (2, 1)), (2.0 * half, 2.0 * half),
                   np.full((2, 2), half), rotation.rotate(pose[3:], np.array([0.0, 1.0, 0.0])))

    def _seat_board(self, pose: np.ndarray, part: int, slope: float, depth: float,
                    plates: np.ndarray) -> None:
        """Nail a hip or valley to the corner of the plates."""
        seat = 0.5 * np.sqrt(2.0) * self.plate / MICRO
        point = pose[:3] + rotation.rotate(pose[3:], np.array([[seat / cos(slope), 0.0, 0.0]]))
        point[0, 2] = self.eaves + 0.5 * seat * tan(slope)
        self._bond(self._nearest(plates, point), np.array([part]), point,
                   np.array([[0.0, 0.0, 1.0]]), (BOARD, 2 * seat),
                   np.array([[0.5 * self.gauge / MICRO, 0.5 * depth]]),
                   rotation.rotate(pose[3:], np.array([0.0, 1.0, 0.0])))

    def _fix(self, node: Node, part: int, point: np.ndarray, depth: float) -> None:
        """Nail the end of a board to a post."""
        if node.post < 0:
            return
        first = self.site.frames[0]
        way = (rotation.rotate(first[3:], np.array([*node.place, 0.0])) - point) * [1.0, 1.0, 0.0]
        self._bond(np.array([part]), np.array([node.post]), point[None], (way / norm(way))[None],
                   (BOARD, depth), np.array([[0.5, _POST]]))

    def _ridge(self, arc: Arc, nodes: Sequence[Node]) -> np.ndarray:
        """Set a ridge board, from post to post or into the gables."""
        bottom, top = self._ridge_levels(arc.high)
        axis = int(np.argmax(np.abs(arc.end - arc.start)))
        low, high = sorted(nodes, key=lambda node: float(node.place[axis]))
        half, line = micro(0.5 * BOARD), micro(low.place[1 - axis])
        rows = self.site.add(self._box(
            axis, (micro(low.place[axis] + low.radius), micro(high.place[axis] - high.radius)),
            (line - half, line + half), bottom, top, 'ridge'), PIECE)
        parts = np.arange(rows.start, rows.stop)
        for node, part, side in ((low, parts[0], 1.0), (high, parts[-1], -1.0)):
            point = np.array([*node.place, 0.5 * (bottom + top) / MICRO])
            point[axis] += side * node.radius
            self._fix(node, part, rotation.rotate(self.site.frames[0][3:], point),
                      (top - bottom) / MICRO)
        return parts

    def _ridge_levels(self, span: float) -> tuple[int, int]:
        """Compute bottom (on a course) and top of the ridge board [µm]."""
        underside = self.eaves + (span - 0.5 * BOARD) * tan(self.pitch)
        bottom = micro(underside - _RIDGE_SEAT) // self.gauge * self.gauge
        top = micro(underside + self.depth * cos(self.pitch) - 0.005)
        if bottom < self.height + self.gauge:
            raise self.site.place.error('the roof is too low to stand: give it more pitch, or the '
                                        'building more depth')
        return bottom, top

    def _slope(self, plane: int, nodes: Sequence[Node]) -> Slope:
        """Return the slope over the edges in one line."""
        plan = self.plan
        fields, way, normal = plan.faces[plane], plan.ways[plane], plan.normals[plane]

        def local(place: np.ndarray) -> tuple[float, float]:
            away = place - plan.points[plane]
            return float((away * way).sum()), float((away * normal).sum())

        def touches(place: float, u: float, height: float) -> bool:
            return abs(u - height) < _ONE and any(
                f.low - _ONE < u < f.high + _ONE and f.start.place(u) - _ONE < place
                < f.end.place(u) + _ONE for f in fields)

        ridges, posts = [], []
        for arc in plan.arcs:
            (a, u), (b, v) = sorted((local(arc.start), local(arc.end)))
            if arc.low == arc.high and abs(u - v) < _ONE and touches(0.5 * (a + b), u, arc.high):
                ridges.append((a, b, arc.high))
        for node in nodes:
            place, u = local(node.place)
            if node.post >= 0 and touches(place, u, node.height):
                posts.append(Post(place, node.height, node.radius))
        quarter = self.walls[plane].facade.quarter
        first = self.site.frames[0][3:]
        ahead = rotation.rotate(first, np.array([1.0, 0.0, 0.0]))
        yaw = float(atan2(ahead[1], ahead[0])) + ((quarter + 2) % 4 - 1) * 0.5 * np.pi
        tilt = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-self.pitch))
        origin = rotation.rotate(first, np.array([*plan.points[plane], self.eaves]))
        pose = np.concatenate([origin, rotation.multiply(rotation.from_yaw(yaw), tilt)])
        return Slope(pose, self.pitch, self.depth, tuple(fields), tuple(ridges), tuple(posts))

    def _verges(self, plane: int) -> list[tuple[float, int, float, list[Span]]]:
        """List the gables at the ends of a slope, the last first: see `Slope.verges`."""
        plan, n, found = self.plan, len(self.walls), []
        for edge in np.flatnonzero(plan.plane == plane).tolist():
            for gable, corner, last in ((edge - 1, edge, 0), (edge + 1, edge + 1, 1)):
                if gable % n in plan.gables:
                    place = float(((plan.points[corner % n] - plan.points[plane])
                                   * plan.ways[plane]).sum())
                    found.append((place, last, 0.5 * self.walls[gable % n].facade.length / MICRO,
                                  self._abutments(gable % n, self.corners[corner % n])))
        return sorted(found, key=lambda verge: -verge[0])

    def _abutments(self, gable: int, corner: np.ndarray) -> list[Span]:
        """List where other bodies stand against a gable, measured from one of its corners [m]."""
        facade = self.walls[gable].facade
        axis, found = 1 - facade.quarter % 2, []
        for other in self.neighbours:
            face = (other.low[axis] - corner[axis] if facade.quarter in (1, 2)
                    else corner[axis] - other.high[axis])
            if abs(face) < _BESIDE and other.top > self.height:
                ends = (np.array([other.low, other.high]) - corner)[:, 1 - axis] / MICRO
                if corner[1 - axis] == self._along(gable)[1]:
                    ends = -ends
                found.append((float(ends.min()), float(ends.max())))
        return found

    def _gable_wall(self, wall: Elevation) -> None:
        """Continue the courses of a wall up to the roof, around the ridge."""
        length, half = wall.facade.length, micro(0.5 * BOARD) + _RIDGE_ROOM
        seat, top = self._ridge_levels(0.5 * length / MICRO)
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
        runs = Runs(twice[0], left[keep], right[keep], twice[1], twice[2], zero, zero, zero, zero,
                    zero)
        facade = replace(wall.facade, start=Corner(), end=Corner())
        kind, joint = unit_of(self.layout, wall.unit)
        self.site.add(facade.place(lay(runs, self.layout, self.site.kind(kind), joint,
                                       self.site.next_member, self.site.generator)))

    def _tie(self) -> None:
        """Tie opposite plates together, so that the rafters do not push the walls apart."""
        for bay in self.bays:
            sides = [self._side(bay.outer, axis, end) for axis in (0, 1) for end in (0, 1)]
            axis, across = self.axis, 1 - self.axis
            spans = [(sides[2 * way][1] + sides[2 * way + 1][1], bay.outer.size[way])
                     for way in (0, 1)]
            if spans[axis] < spans[across]:  # fewer gables, or shorter
                axis, across = across, axis
            ends = [self._ends(bay.outer, way, sides[2 * way:2 * way + 2]) for way in (0, 1)]
            places = self._tie_places(bay.outer.low[axis], bay.outer.high[axis])
            for place in places:
                self._lay_tie(across, *ends[across], place)
            if not any(inset and not gabled for inset, gabled in sides[2 * axis:2 * axis + 2]):
                continue
            low, high = bay.outer.low[across], bay.outer.high[across]
            middles = np.linspace(low, high, max(-(-(high - low) // _STRUT), 2) + 1)[1:-1]
            for line in (middles.astype(int) - TIE[0] // 2).tolist():
                for start, end in zip([ends[axis][0], *(place + TIE[0] for place in places)],
                                      [*places, ends[axis][1]]):
                    self._lay_tie(axis, start, end, line)

    def _side(self, bay: Rectangle, axis: int, end: int) -> tuple[int, bool]:
        """Return how far inside of one side of a bay ties end [µm], and whether at a gable."""
        line = (bay.low, bay.high)[end][axis]
        for edge in range(len(self.walls)):
            quarter, along = self.walls[edge].facade.quarter, self._along(edge)
            if (quarter % 2 != axis and self.corners[edge, axis] == line
                    and (quarter in (1, 2)) == bool(end)
                    and along[0] < bay.high[1 - axis] and along[1] > bay.low[1 - axis]):
                gabled = edge in self.plan.gables
                return self.layout.thickness if gabled else self.plate, gabled
        return 0, False

    def _ends(self, bay: Rectangle, axis: int, sides: Sequence[tuple[int, bool]]
              ) -> tuple[int, int]:
        return bay.low[axis] + sides[0][0], bay.high[axis] - sides[1][0]

    def _lay_tie(self, axis: int, start: int, end: int, place: int) -> None:
        if end - start > _LEAST_STRUT:
            self.site.add(self._box(axis, (start, end), (place, place + TIE[0]), self.height,
                                    self.height + self.gauge, 'tie'), PIECE)

    def _tie_places(self, low: int, high: int) -> list[int]:
        first = low + self.layout.thickness + TIE[1]
        last = high - self.layout.thickness - TIE[1] - TIE[0]
        if last < first + 2 * TIE[0]:  # no room for two
            return [(first + last) // 2]
        count = max(-(-(last - first) // TIE[1]), 1) + 1
        return [round(place) for place in np.linspace(first, last, count).tolist()]

    def _frame(self, pose: np.ndarray) -> int:
        self.site.frames.append(pose)
        return len(self.site.frames) - 1

    def _box(self, axis: int, along: tuple[int, int], across: tuple[int, int], bottom: int,
             top: int, kind: str, joints: Sequence[int] = (0, 0)) -> Boxes:
        """Return an upright timber along an axis of the first frame."""
        low, high, margins = np.zeros(3, int), np.zeros(3, int), np.zeros((2, 3), int)
        low[axis], high[axis] = along
        low[1 - axis], high[1 - axis] = across
        low[2], high[2] = bottom, top
        margins[:, axis] = joints
        return from_cells(low, high, *margins, axis=axis,
                          joint=Joint.LAP if kind == 'tie' else Joint.FIXING,
                          kind=self.site.kind(kind), material=self.site.material('timber'))

    def _seat(self, slope: Slope, place: np.ndarray, parts: np.ndarray,
              plates: np.ndarray) -> None:
        """Cut each rafter over its plate and nail it."""
        width = self.plate / MICRO
        points = slope.world(0.5 * width / cos(self.pitch), -place, 0.0)
        points[:, 2] = self.eaves + 0.25 * width * tan(self.pitch)
        upright = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        reach = np.tile([0.5 * self.gauge / MICRO, 0.5 * self.depth], (len(points), 1))
        # A long rafter is cut in pieces: the one over the plate carries.
        eaves = rotation.rotate(slope.pose[3:], np.array([0.0, 1.0, 0.0]))
        self._bond(self._nearest(plates, points), parts, points, upright, (RAFTER, width), reach,
                   eaves)

    def _nail(self, slope: Slope, parts: np.ndarray, holders: np.ndarray, points: np.ndarray,
              half: np.ndarray, side: float = 1.0) -> None:
        """
        Nail rafters with their ends to ridges, hips or valleys.

        :param half: half the lengths of the rafters [m], (n,).
        :param side: 1 at their upper ends, -1 at the lower ones.
        """
        if not len(points):
            return
        along = slope.world(np.ones(1), np.zeros(1), 0.0)[0] - slope.pose[:3]
        along[2] = 0.0
        normal = np.tile(side * along / norm(along), (len(points), 1))
        reach = np.column_stack([half, np.full(len(points), 0.5 * BOARD)])
        self._bond(parts, self._nearest(holders, points), points, normal, (RAFTER, self.depth),
                   np.minimum(reach, 0.5))

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
