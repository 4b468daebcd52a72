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

"""Roofs: timber and tiles over any plan: hips, valleys, ridges, gables and lean-tos."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from procphys_ros.elementary import atan2, cos, hypot, sin, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.language import Place
from procphys_ros.wallgrammar.assembly import Patches
from procphys_ros.wallgrammar.bodies import Neighbour
from procphys_ros.wallgrammar.boxes import (
    from_cells,
    Joint,
    MICRO,
    micro,
    micros,
)
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.footprint import Corner, crossing, Facade, Footprint
from procphys_ros.wallgrammar.regions import share_corner
from procphys_ros.wallgrammar.roof_feet import ALIGNED, PIECE, RoofFeet, TIE
from procphys_ros.wallgrammar.roof_plan import Arc, NoRoofError, RoofPlan
from procphys_ros.wallgrammar.slopes import (
    BATTEN,
    BOARD,
    CLEAR,
    COVER,
    distance,
    OVERHANG,
    RAFTER,
    rafter_depth,
    Slope,
    Span,
    TILE_AREA,
    VERGE,
)
from procphys_ros.wallgrammar.tiling import lay, Runs
from procphys_ros.wallgrammar.walls import Elevation, unit_of

_RIDGE_SEAT = 0.15    # [m] least depth of the ridge board below the rafters' ends
_RIDGE_ROOM = 12_000  # [µm] beside the ridge board in its pocket, where it only rests
_LEAST_ROOM = 0.5     # [m] between opposite walls, for ties and rafters
_EAVES_ROOM = 0.03    # [m] kept clear around the eaves
_TIE_GAP = 0.001      # [m] mean gap of cut timber joints
_POST = 0.03          # [m] half the side of the posts where hips, valleys and ridges meet
_NEAREST = 0.25       # [m] least distance of two such posts,
_ONE = 0.002          # [m] if they are not one
_GABLE_CLEAR = 0.01   # [m] between the gable and the battens
_LEAST_RUN = 50_000   # [µm] shorter pieces of a gable course are left out
_BESIDE = 0.06        # [m] walls this near to a gable leave no room for its boards
_EDGE = 0.06          # [m] between the outermost rafters and the gable
_UP, _ASIDE = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
_MARGIN = 0.5         # [m] between the outermost rafters and the corners of other slopes


class Node(NamedTuple):
    """
    Place in plan where hips, valleys and ridges meet: at a post, or at a gable.

    :ivar place: [m], (2,).
    :ivar ends: of the lines that meet here, all near to it [m], (k, 2).
    :ivar height: distance from the eaves in plan [m].
    :ivar radius: at which the boards end around the post [m]; 0 at gables.
    :ivar post: part; -1 at gables.
    """

    place: np.ndarray
    ends: np.ndarray
    height: float
    radius: float
    post: int

    def has(self, end: np.ndarray) -> bool:
        """Return whether a line ends here."""
        return bool((hypot(*(self.ends - end).T) < _ONE).any())

    def clear(self, end: np.ndarray, way: np.ndarray) -> float:
        """Return how far from its end, along a way, a board begins [m]."""
        return float(((self.place - end) * way).sum()) + self.radius

    def ends_of(self, arc: Arc) -> int:
        """Count the ends of a line that are here."""
        return self.has(arc.start) + self.has(arc.end)


class Roof:
    """
    A roof of one pitch under construction.

    :ivar plan: faces and the lines between them, in the first frame.
    :ivar place: of the roof in the text, for errors.
    :ivar head: edge on whose wall the upper ends of a lean-to's rafters lie; None elsewhere.
    :ivar depth: of the rafters [m].
    :ivar feet: plates and ties.
    """

    def __init__(self, site: Site, ground: Footprint, walls: Sequence[Elevation], height: int,
                 kind: str, pitch: float, place: Place, neighbours: Sequence[Neighbour] = ()):
        self.site, self.walls, self.height, self.place = site, walls, height, place
        self.neighbours = neighbours
        self.layout = walls[0].layout
        self.gauge = self.layout.gauge
        self.pitch = float(np.radians(pitch))
        turn = -float(ground.yaws[0])
        points = (ground.corners / MICRO if ground.right_angled else product(
            ground.points, np.array([[cos(turn), sin(turn)], [-sin(turn), cos(turn)]])))
        try:
            self.plan = RoofPlan(points)
            if kind != 'hip':
                self.plan = RoofPlan(points, self._gables() if kind == 'gable' else self._rakes())
        except NoRoofError:
            raise place.error('no gable or hip roof was found over this plan; use flat or '
                              'none') from None
        self.head = 2 if kind == 'lean_to' else None
        self.feet = RoofFeet(site, walls, self.plan, height, ground.right_angled)
        room = ((2.0 if self.head is None else 1.0) * self.plan.lowest_top
                - 2.0 * self.layout.thickness / MICRO)
        if room < _LEAST_ROOM:
            raise place.error(f'a gable, hip or lean-to roof needs at least {_LEAST_ROOM:g} m '
                              f'between opposite walls, found {room:g} m; use flat or none')
        self.depth = rafter_depth(max(arc.high for arc in self.plan.arcs), self.pitch,
                                  self.head is not None)
        site.expect(float(np.ptp(points, axis=0).prod()) / cos(self.pitch) / TILE_AREA)
        self._check_eaves()

    @property
    def eaves(self) -> float:
        """Height of the rafters' underside over the outer edge of the wall [m]."""
        return (self.height + self.gauge) / MICRO

    @property
    def _reach(self) -> int:
        """How far battens and tiles on square ends of rafters reach out of the wall [µm]."""
        return micro(OVERHANG + (self.depth + COVER) * sin(self.pitch) + _EAVES_ROOM)

    @property
    def _rectangular(self) -> bool:
        """Whether the plan has four corners, all of them right angles."""
        return len(self.walls) == 4 and bool(
            (np.abs(self.plan.turns - 0.5 * np.pi) < ALIGNED).all())

    def _rakes(self) -> frozenset[int]:
        """List the edges of a lean-to without eaves: all but the first one of a rectangle."""
        if not self._rectangular:
            raise self.place.error(
                'a lean-to needs a footprint of four corners, all of them right angles, and falls '
                'to its first edge; use hip or gable here, or a wing of four corners')
        return frozenset((1, 2, 3))

    def _gables(self) -> frozenset[int]:
        """
        Choose the edges under gables.

        Over rectangles the ridge runs along the first edge. Elsewhere gables are the triangles of
        the hip roof between two right angles, of which no two are neighbours.
        """
        plan, n = self.plan, len(self.walls)
        square = np.abs(plan.turns - 0.5 * np.pi) < ALIGNED
        if self._rectangular:
            return frozenset((1, 3))
        found: set[int] = set()
        for edge, plane in enumerate(plan.plane.tolist()):
            after = (edge + 1) % n
            ends = [plan.local(plane, plan.points[corner])[0] for corner in (edge, after)]
            face = [strip for strip in plan.strips(plane, 0.0)
                    if strip.end > ends[0] + _ONE and strip.start < ends[1] - _ONE]
            if (square[edge] and square[after] and not found & {(edge - 1) % n, after}
                    and len(face) == 2 and np.allclose(
                        (face[0].start, face[1].end, face[0].head[0], face[1].head[1]),
                        (*ends, 0.0, 0.0), 0.0, _ONE)):
                found.add(edge)
        if not found:
            raise self.place.error(
                'a gable stands on an edge between two right angles where a hip roof has a '
                'triangle, and this plan has none; use hip')
        return frozenset(found)

    def _check_eaves(self) -> None:
        """Check that no wall stands in the way of the eaves of this roof."""
        drop = micro(OVERHANG * tan(self.pitch) + _EAVES_ROOM)
        reach = self._reach
        for edge in self.feet.eaves():
            wall = self.walls[edge]
            for other in self.neighbours:
                (start, near), (end, far) = self._beside(edge, other)
                if (other.crest + other.lean * reach > self.height - drop and -far < reach
                        and near < 0 and start < wall.facade.length and end > 0):
                    raise self.place.error(
                        f'the eaves of a roof reach {reach / MICRO:.2f} m out of its walls, and '
                        f'"{other.name}" stands there; build it against a gable, or keep it below '
                        f'{(self.height - drop) / MICRO:.2f} m')
            if wall.piers_above(self.height - drop):
                raise self.place.error(
                    f'the eaves of a roof reach {OVERHANG:g} m out of its walls, over piers that '
                    f'stand out of them: end the piers below {(self.height - drop) / MICRO:.2f} m')
        points = self.plan.outline(self.plan.edges, -reach / MICRO)[0]
        ends = np.roll(points, -1, axis=0)
        if ((ends - points) * self.plan.ways[self.plan.edges] <= -1e-9).any() or len(
                crossing(points, ends)):
            raise self.place.error(
                f'the eaves of a roof reach {reach / MICRO:.2f} m out of its walls, and meet each '
                f'other there; leave more room between the wings')

    def _beside(self, edge: int, other: Neighbour) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of a body along an edge and inwards from it [µm], (2,) each."""
        x, y = np.array([other.low, other.high]).T
        corners = np.array([[x[0], y[0]], [x[1], y[0]], [x[0], y[1]], [x[1], y[1]]])
        places = np.rint(MICRO * self.plan.local(edge, corners / MICRO)).astype(int)
        return places.min(axis=0), places.max(axis=0)

    def build(self) -> None:
        """Build plates, gables, posts, ridges, hips, valleys, slopes and ties."""
        plates = self.feet.lay_plates()
        if self.head is not None:
            thickness = self.layout.thickness
            plates = np.append(plates, self.feet.lay_head(
                self.head, self._head_levels(), (thickness - self.feet.plate, thickness), 'plate'))
        continue_wall = self._gable_wall if self.head is None else self._leaning_wall
        for edge in sorted(self.plan.gables):
            continue_wall(edge)
        nodes = self._nodes()
        boards = [(arc, self._board(arc, nodes, plates)) for arc in self.plan.arcs
                  if all(node.ends_of(arc) < 2 for node in nodes)]
        holders = np.concatenate([part for _, part in boards])
        valleys = np.concatenate([part for arc, part in boards if arc.valley] or [holders])
        for arc, parts in boards:
            for other, more in boards:
                if (arc.valley and not other.valley and arc.low == other.low == 0.0
                        and hypot(*(arc.end - other.end)) < _ONE
                        and hypot(*(arc.start + other.start - 2.0 * arc.end)) < _ONE):
                    self._brace(arc, other, np.concatenate([parts, more]))
        for plane in dict.fromkeys(int(self.plan.plane[edge]) for edge in self.feet.eaves()):
            self._lay_slope(self._slope(plane, nodes), plane, plates, holders, valleys)
        if self.head is None:  # rafters that lie on walls with both ends need no ties
            self.feet.tie()

    def _lay_slope(self, slope: Slope, plane: int, plates: np.ndarray, holders: np.ndarray,
                   valleys: np.ndarray) -> None:
        """Set rafters on plates and at boards, and lay battens, tiles and verges on them."""
        frame = self._frame(slope.pose)
        rafters = slope.rafters(self.site, frame, self.layout.thickness / MICRO + _EDGE, _MARGIN)
        if not len(rafters.place):
            x, y = self._in_building(self.plan.points[plane])
            raise self.place.error(f'the roof over the edge that begins at ({x:g}, {y:g}) has no '
                                   'room for a rafter; make it longer')
        low = rafters.start <= slope.along(0.0, self.depth)
        self._seat(slope, rafters.place[low], rafters.foot[low], plates,
                   (0.0, self.feet.plate / MICRO))
        if self.head is not None:
            self._seat(slope, rafters.place, rafters.head, plates, self._head_seat)
        self._nail(slope, rafters.head, holders, slope.world(
            rafters.reach + slope.bevel(0.5 * self.depth), -rafters.place, 0.5 * self.depth),
                   0.5 * rafters.reach)
        self._nail(slope, rafters.foot[~low], valleys, slope.world(
            rafters.start, -rafters.place, 0.5 * self.depth)[~low],
            0.5 * rafters.reach[~low], -1.0)
        parts, places = slope.cover(self.site, frame, rafters)
        self._hold(slope, parts, slope.world(*places.T), holders)
        slope.verges(self.site, frame, self._verges(plane))

    def _in_building(self, place: np.ndarray) -> list[float]:
        """Return a place of the first frame in the coordinates of the building [m]."""
        return rotation.rotate(self.site.frames[0][3:], np.array([*place, 0.0]))[:2].tolist()

    def _nodes(self) -> list[Node]:
        """Set posts where boards meet, one where several places are near to each other."""
        ends = np.array([(*place, height) for arc in self.plan.arcs for place, height in (
            (arc.start, arc.low), (arc.end, arc.high)) if height > 0.0])
        near = hypot(*(ends[:, None, :2] - ends[:, :2]).transpose(2, 0, 1)) < _NEAREST
        while (wider := product(near, near)).sum() > near.sum():
            near = wider
        found: list[Node] = []
        for i in np.flatnonzero(~np.tril(near, -1).any(axis=1)).tolist():
            some = ends[near[i]]
            place = some[0, :2] if np.ptp(some, axis=0).max() < _ONE else some[:, :2].mean(axis=0)
            away = hypot(*(some[:, :2] - place).T)
            node = Node(place, some[:, :2], float((some[:, 2] - away).max()), 0.0, -1)
            if not any(abs(self.plan.local(gable, place)[1]) < _ONE for gable in self.plan.gables):
                node = node._replace(radius=self._radius(node),
                                     post=self._post(place, node.height))
            found.append(node)
        return found

    def _radius(self, node: Node) -> float:
        """Compute how far from a node its boards end, so that none meets another or the post."""
        arcs = [arc for arc in self.plan.arcs if node.ends_of(arc) == 1]
        ways = np.array([(1.0 if node.has(arc.start) else -1.0) * (arc.end - arc.start)
                         for arc in arcs])
        angles = np.sort(atan2(*ways.T[::-1]))
        between = np.diff(angles, append=angles[0] + 2.0 * np.pi)
        half = 0.5 * min(max(between.min(), ALIGNED), 0.5 * np.pi)
        off = float(hypot(*(node.ends - node.place).T).max())
        radius = float(max(0.5 * BOARD / tan(half) + (off / sin(half) if off > _ONE else 0.0),
                           np.sqrt(2.0) * _POST) + CLEAR)
        shortest = float(hypot(*ways.T).min())
        beside = [distance(np.array([arc.start, arc.end]), node.place)
                  for arc in self.plan.arcs if not node.ends_of(arc)]
        if radius > 0.5 * shortest or min(beside, default=1.0) < (
                0.5 * BOARD + np.sqrt(2.0) * _POST + CLEAR):
            x, y = self._in_building(node.place)
            raise self.place.error(
                f'ridges, hips or valleys of the roof meet near ({x:.2f}, {y:.2f}) at several '
                'places, too close to each other for one post and too far apart for it: make '
                'opposite edges of the footprint equal, or more different; or use flat')
        return radius

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
        ends = [next((node for node in nodes if node.has(place)), None)
                for place in (arc.start, arc.end)]
        if arc.low == arc.high:
            return self._ridge(arc, [node for node in ends if node is not None])
        plan, rise = hypot(*(arc.end - arc.start)), arc.high - arc.low
        slope, steep = float(atan2(rise * tan(self.pitch), plan)), rise / plan
        drop = 0.0 if arc.valley else 0.5 * BOARD * tan(self.pitch) * np.sqrt(1.0 - steep * steep)
        depth = float((self.depth / cos(self.pitch) - drop - 0.003) * cos(slope))
        start, end = ends
        low = 0.0 if arc.valley else -OVERHANG / steep / cos(slope)
        way = (arc.end - arc.start) / plan
        if start is not None:
            low = (start.clear(arc.start, way) + depth * sin(slope)) / cos(slope)
        high = (plan - (0.0 if end is None else end.clear(arc.end, -way))) / cos(slope)
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
            self._seat_board(pose, parts[0], slope, depth, plates, steep)
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
                   _UP, (2.0 * half, 2.0 * half), half, rotation.rotate(pose[3:], _ASIDE))

    def _seat_board(self, pose: np.ndarray, part: int, slope: float, depth: float,
                    plates: np.ndarray, steep: float) -> None:
        """Nail a hip or valley to the corner of the plates."""
        seat = 0.5 * self.feet.plate / MICRO / steep
        point = pose[:3] + rotation.rotate(pose[3:], np.array([[seat / cos(slope), 0.0, 0.0]]))
        point[0, 2] = self.eaves + 0.5 * seat * tan(slope)
        self._bond(self._nearest(plates, point), np.array([part]), point, _UP, (BOARD, 2 * seat),
                   (0.5 * self.gauge / MICRO, 0.5 * depth), rotation.rotate(pose[3:], _ASIDE))

    def _fix(self, node: Node, part: int, point: np.ndarray, depth: float) -> None:
        """Nail the end of a board to a post."""
        if node.post < 0:
            return
        first = self.site.frames[0]
        way = (rotation.rotate(first[3:], np.array([*node.place, 0.0])) - point) * [1.0, 1.0, 0.0]
        self._bond(np.array([part]), np.array([node.post]), point[None], way / norm(way),
                   (BOARD, depth), (0.5, _POST))

    def _ridge(self, arc: Arc, nodes: Sequence[Node]) -> np.ndarray:
        """Set a ridge board, from post to post or into the gables; half of one on a head."""
        if self.head is not None:
            return self._head_board(self.head)
        bottom, top = self._ridge_levels(arc.high)
        way = (arc.end - arc.start) / hypot(*(arc.end - arc.start))
        aside = np.abs((self.plan.normals * way).sum(axis=1))
        edge = int(np.flatnonzero(aside < aside.min() + ALIGNED)[0])  # along the ridge
        low, high = sorted(nodes, key=lambda node: float(self.plan.local(edge, node.place)[0]))
        (start, end), line = (float(self.plan.local(edge, node.place)[0])
                              for node in (low, high)), self.plan.local(edge, arc.start)[1]
        half, line = micro(0.5 * BOARD), micro(line)
        facade = self.walls[edge].facade
        rows = self.site.add(facade.place(from_cells(
            [micro(start + low.radius), line - half, bottom],
            [micro(end - high.radius), line + half, top], joint=Joint.FIXING,
            kind=self.site.kind('ridge'), material=self.site.material('timber'))), PIECE)
        parts = np.arange(rows.start, rows.stop)
        for node, away in ((low, self.plan.ways[edge]), (high, -self.plan.ways[edge])):
            point = rotation.rotate(self.site.frames[0][3:], np.array(
                [*(node.place + node.radius * away), 0.5 * (bottom + top) / MICRO]))
            self._fix(node, self._nearest(parts, point[None])[0], point, (top - bottom) / MICRO)
        return parts

    def _ridge_levels(self, span: float) -> tuple[int, int]:
        """Compute bottom (on a course) and top of the ridge board [µm]."""
        underside = self.eaves + (span - 0.5 * BOARD) * tan(self.pitch)
        bottom = micro(underside - _RIDGE_SEAT) // self.gauge * self.gauge
        top = micro(underside + self.depth * cos(self.pitch) - 0.005)
        if bottom < self.height + self.gauge:
            raise self.place.error('the roof is too low to stand: give it more pitch, or the '
                                   'building more depth')
        return bottom, top

    @property
    def _head_seat(self) -> Span:
        """Where rafters lie on the plate of a head, from the eaves in plan [m]."""
        start = self.plan.lowest_top - self.layout.thickness / MICRO
        return start, min(start + self.feet.plate / MICRO,
                          self.plan.lowest_top - 0.5 * BOARD - CLEAR)

    def _head_levels(self) -> tuple[int, int]:
        """Compute bottom (on a course) and top of the plate of a head [µm]."""
        top = micro(self.eaves + self._head_seat[0] * tan(self.pitch))
        return max((top - self.gauge) // self.gauge * self.gauge, self.height), top

    def _head_board(self, head: int) -> np.ndarray:
        """Set a board on a head, or on its plate, up to the tiles; rafters are nailed to it."""
        width, place = micro(0.5 * BOARD), self.plan.lowest_top - 0.5 * BOARD
        below, on_plate = self._head_levels()
        if self.layout.thickness - self.feet.plate < width:
            below = on_plate
        top = micro(self.eaves + place * tan(self.pitch) + self.depth / cos(self.pitch) - CLEAR)
        return self.feet.lay_head(head, (below, top), (0, width), 'ridge')

    def _slope(self, plane: int, nodes: Sequence[Node]) -> Slope:
        """Return the slope over the edges in one line."""
        plan, reach = self.plan, self._reach / MICRO
        around = [arc for arc in plan.arcs
                  if plane in arc.planes and hypot(*(arc.end - arc.start)) > _ONE]
        lines = [plan.local(plane, np.array([
            arc.start - bool(arc.low == 0.0) * reach / arc.high * (arc.end - arc.start),
            arc.end])) for arc in around]
        ridges = [(*sorted(line[:, 0].tolist()), arc.high)
                  for arc, line in zip(around, lines) if arc.low == arc.high]
        posts = [(place, u, node.radius) for node in nodes
                 for place, u in [plan.local(plane, node.place).tolist()]
                 if node.post >= 0 and any(node.ends_of(arc) for arc in around)]
        facade, first = self.walls[plane].facade, self.site.frames[0][3:]
        ahead = rotation.rotate(self.site.frames[facade.frame][3:], np.array([1.0, 0.0, 0.0]))
        yaw = float(atan2(ahead[1], ahead[0])) + ((facade.quarter + 2) % 4 - 1) * 0.5 * np.pi
        tilt = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-self.pitch))
        origin = rotation.rotate(first, np.array([*plan.points[plane], self.eaves]))
        pose = np.concatenate([origin, rotation.multiply(rotation.from_yaw(yaw), tilt)])
        return Slope(pose, self.pitch, self.depth, plan.strips(plane, reach), reach,
                     tuple(ridges), lines, posts, self.head is not None)

    def _verges(self, plane: int) -> list[tuple[float, int, float, list[Span]]]:
        """List the gables at the ends of a slope, the last first: see `Slope.verges`."""
        plan, n, found = self.plan, len(self.walls), []
        for edge in np.flatnonzero(plan.plane == plane).tolist():
            for gable, corner, last in ((edge - 1, edge, 0), (edge + 1, edge + 1, 1)):
                if gable % n in plan.gables:
                    place = float(plan.local(plane, plan.points[corner % n])[0])
                    found.append((place, last, self._summit(gable % n),
                                  self._abutments(gable % n, not last)))
        return sorted(found, key=lambda verge: -verge[0])

    def _abutments(self, gable: int, from_end: bool) -> list[Span]:
        """List where other bodies stand against a gable, measured from one of its corners [m]."""
        length, found = self.walls[gable].facade.length / MICRO, []
        boards = self.eaves + (self.depth - VERGE[1]) / cos(self.pitch)  # at the eaves
        for other in self.neighbours:
            bounds = np.array(self._beside(gable, other)) / MICRO
            start, end = length - bounds[::-1, 0] if from_end else bounds[:, 0]
            crest = other.crest / MICRO + other.lean * VERGE[0]
            end = min(end, (crest - boards) / tan(self.pitch))  # above it boards go on
            if abs(bounds[1, 1]) < _BESIDE and start < end:
                found.append((float(start), float(end)))
        return found

    def _summit(self, gable: int) -> float:
        """Return how far from the eaves the roof over a gable is highest [m]."""
        return (0.5 if self.head is None else 1.0) * self.walls[gable].facade.length / MICRO

    def _gable_wall(self, edge: int) -> None:
        """Continue the courses of a wall up to the roof, around the ridge."""
        length, half = self.walls[edge].facade.length, micro(0.5 * BOARD) + _RIDGE_ROOM
        seat, top = self._ridge_levels(self._summit(edge))
        course, bottom, upper, inset = self._steps(
            micro(self.eaves + self._summit(edge) * tan(self.pitch)))
        whole = upper <= seat
        left = np.append(inset, np.full(len(course), length // 2 + half))
        right = np.append(np.where(whole, length - inset, length - length // 2 - half),
                          length - inset)
        keep = np.append(bottom < top, ~whole & (bottom < top))
        facade = replace(self.walls[edge].facade, start=Corner(), end=Corner())
        self._lay(edge, facade, keep, left, right, *(np.tile(v, 2) for v in (
            course, bottom, upper)))

    def _leaning_wall(self, edge: int) -> None:
        """Continue the courses of a wall up to a lean-to, or to the plate of its head."""
        facade, seat = self.walls[edge].facade, self._head_levels()[0]
        top = seat - 1 if edge == self.head else micro(
            self._batten_level + self.plan.lowest_top * tan(self.pitch))
        course, bottom, upper, inset = self._steps(top)
        low = [other % len(self.walls) in self.plan.eaves for other in (edge - 1, edge + 1)]
        left, right = inset * low[0], facade.length - inset * low[1]
        below = upper <= seat  # here the walls share their corner, above it a side wall fills it
        for some, shared in ((below, True), (~below, False)):
            start, end = (corner if shared and not at_eaves else Corner() for corner, at_eaves
                          in zip((facade.start, facade.end), low))
            self._lay(edge, replace(facade, start=start, end=end), some, left, right, course,
                      bottom, upper)

    @property
    def _batten_level(self) -> float:
        """Height that walls below the roof reach over their outer edge at the eaves [m]."""
        return self.eaves + (self.depth - _GABLE_CLEAR) / cos(self.pitch)

    def _steps(self, top: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """
        Divide what is above the walls into courses.

        :param top: level of the highest course [µm].
        :returns: of each its number, bottom and top [µm], and how far from the eaves it is below
            the battens [µm].
        """
        course = np.arange(self.height // self.gauge, top // self.gauge + 1)
        upper = (course + 1) * self.gauge
        inset = micros((upper / MICRO - self._batten_level) / tan(self.pitch))
        return (course, np.maximum(course * self.gauge, self.height), upper,
                np.maximum(inset, 0))

    def _lay(self, edge: int, facade: Facade, keep: np.ndarray, left: np.ndarray,
             right: np.ndarray, course: np.ndarray, bottom: np.ndarray, upper: np.ndarray) -> None:
        """Lay courses of a wall from end to end [µm], those to keep that are long enough."""
        keep = keep & (right - left >= _LEAST_RUN)
        left, right, course, bottom, upper = (
            v[keep] for v in (left, right, course, bottom, upper))
        self.site.expect((right - left).sum() / self.layout.pitch * self.layout.pieces)
        zero = np.zeros(len(course), int)
        left, left_joint, left_filled = share_corner(left, zero, 0, facade.start,
                                                     course % 2 == 0, -1)
        right, right_joint, right_filled = share_corner(right, zero, facade.length, facade.end,
                                                        course % 2 == 1, 1)
        runs = Runs(course, left, right, bottom, upper, left_joint, right_joint, left_filled,
                    right_filled, zero)
        kind, joint = unit_of(self.layout, self.walls[edge].unit)
        self.site.add(facade.place(lay(runs, self.layout, self.site.kind(kind), joint,
                                       self.site.next_member, self.site.generator)))

    def _frame(self, pose: np.ndarray) -> int:
        self.site.frames.append(pose)
        return len(self.site.frames) - 1

    def _seat(self, slope: Slope, place: np.ndarray, parts: np.ndarray, plates: np.ndarray,
              span: Span) -> None:
        """Cut each rafter over its plate, between two places from the eaves, and nail it."""
        start, width = span[0], span[1] - span[0]
        points = slope.world((start + 0.5 * width) / cos(self.pitch), -place, 0.0)
        points[:, 2] = self.eaves + (start + 0.25 * width) * tan(self.pitch)
        # A long rafter is cut in pieces: the one over the plate carries.
        self._bond(self._nearest(plates, points), parts, points, _UP, (RAFTER, width),
                   (0.5 * self.gauge / MICRO, 0.5 * self.depth),
                   rotation.rotate(slope.pose[3:], _ASIDE))

    def _nail(self, slope: Slope, parts: np.ndarray, holders: np.ndarray, points: np.ndarray,
              half: np.ndarray, side: float = 1.0) -> None:
        """
        Nail rafters with their ends to ridges, hips or valleys.

        :param half: half the lengths of the rafters [m], (n,).
        :param side: 1 at their upper ends, -1 at the lower ones.
        """
        along = slope.world(np.ones(1), np.zeros(1), 0.0)[0] - slope.pose[:3]
        along[2] = 0.0
        reach = np.column_stack([half, np.full(len(points), 0.5 * BOARD)])
        self._bond(parts, self._nearest(holders, points), points, side * along / norm(along),
                   (RAFTER, self.depth), np.minimum(reach, 0.5))

    def _hold(self, slope: Slope, parts: np.ndarray, points: np.ndarray,
              holders: np.ndarray) -> None:
        """Fix battens and cut tiles on hips and valleys."""
        out = slope.world(np.zeros(1), np.zeros(1), 1.0)[0] - slope.pose[:3]
        boards = self._nearest(holders, points)
        once = np.unique(np.column_stack([boards, parts]), axis=0, return_index=True)[1]
        self._bond(boards[once], parts[once], points[once], out, (BATTEN[0], BATTEN[0]),
                   (0.5 * self.depth, 0.5 * BATTEN[1]))

    def _nearest(self, rows: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Find the part among some that is nearest to each point, (n,)."""
        boxes = self.site.boxes().take(rows)
        frames = np.array(self.site.frames)[boxes.frame]
        local = rotation.rotate(rotation.conjugate(frames[None, :, 3:]),
                                points[:, None] - frames[None, :, :3])
        outside = np.maximum(np.maximum(boxes.low / MICRO - local, local - boxes.high / MICRO), 0)
        return rows[np.argmin((outside * outside).sum(axis=-1), axis=1)]

    def _bond(self, first: np.ndarray, second: np.ndarray, points: np.ndarray,
              normal: np.ndarray, extent: tuple[float, float], reach: ArrayLike,
              ahead: np.ndarray | None = None) -> None:
        """
        Bond parts of different frames.

        :param points: middles of the patches [m], (n, 3).
        :param normal: of all patches, from the first to the second parts, (3,).
        :param extent: along their x and y [m].
        :param reach: half of each part's size along the normal [m], (n, 2), (2,) or a number.
        :param ahead: along x, (3,); None = level.
        """
        n = len(points)
        level = np.cross(_UP, normal) if ahead is None else ahead
        level = level / norm(level)
        turn = rotation.from_matrix(np.stack([level, np.cross(normal, level), normal], axis=-1))
        self.site.patches.append(Patches(
            np.column_stack([first, second]), np.column_stack([points, np.tile(turn, (n, 1))]),
            np.tile(extent, (n, 1)), np.full(n, extent[0] * extent[1]), np.full(n, _TIE_GAP),
            np.broadcast_to(reach, (n, 2))))
