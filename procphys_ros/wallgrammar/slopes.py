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

"""Slopes: rafters, battens and tiles of one face of a roof, in the frame of its plane."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from procphys_ros.elementary import cos, hypot, sin, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners, prisms
from procphys_ros.wallgrammar.boxes import (
    Boxes,
    from_cells,
    Joint,
    MICRO,
    micros,
    SPAN,
    split_along,
)
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.cutting import half_planes, rectangles, within
from procphys_ros.wallgrammar.polygons import moments
from procphys_ros.wallgrammar.roof_plan import Strip
from procphys_ros.wallgrammar.tiles import (
    APART,
    BATTEN,
    clipped,
    divide,
    ends_at,
    LEVEL,
    rests,
    RowPiece,
    Span,
    TILE,
)

RAFTER = 0.05            # [m] width of rafters
BOARD = 0.075            # [m] thickness of the boards at ridges, hips and valleys
_SHALLOWEST = 0.12       # [m] least depth of rafters
_SLENDER = 25.0          # length over depth of rafters that lean on each other, a joiner's rule
_SPANNING = 20.0         # of those from wall to wall, as joists: their ends push as they bend
RAFTER_SPACING = 0.6     # [m] largest
_SHORTEST = 0.2          # [m] shortest rafter, in plan
_SHORT = 0.06            # [m] shortest batten
COVER = 0.045            # [m] depth of battens and tiles together
GAUGE = 0.32            # [m] largest distance of battens
TILE_AREA = TILE[0] * GAUGE  # [m²] of roof that a tile covers
_LOW = (0.06, 0.005)    # [m] least height of rows of tiles, and of those between two changes
_TAIL = 0.15            # [m] in plan: battens nearer to a top than this do not end rows
CLEAR = 0.005           # [m] between timbers that are cut to meet
LAP = 0.15              # [m] by which ridge tiles lie on the tiles below
RIDGE_TILE = 0.45       # [m] length of ridge tiles
VERGE = (0.025, 0.12)    # [m] thickness of boards at gables, and how far they hang below battens
PIECE = 1_500_000       # [µm] rafters and battens splinter into pieces of at most this length
OVERHANG = 0.25          # [m] of the eaves


class Ends(NamedTuple):
    """
    Rafters as added to the site.

    :ivar foot, head: lowest and uppermost part of each, (n,).
    :ivar place: middle of each along the eaves [m], (n,).
    :ivar start, reach: its ends, measured up the slope from the eaves line [m], (n,).
    """

    foot: np.ndarray
    head: np.ndarray
    place: np.ndarray
    start: np.ndarray
    reach: np.ndarray


Batten = tuple[float, float, float]  # up the slope, and its ends along the eaves [m]


def rafter_depth(span: float, pitch: float, from_wall_to_wall: bool = False) -> float:
    """
    Compute the depth of rafters [m].

    :param span: horizontal distance from the eaves to the upper end [m].
    :param pitch: [rad].
    :param from_wall_to_wall: whether they lie on walls with both ends.
    """
    slender = _SPANNING if from_wall_to_wall else _SLENDER
    return max(_SHALLOWEST, span / cos(pitch) / slender)


@dataclass(frozen=True)
class Slope:
    """
    A plane of a roof; local x runs up the slope, y along the eaves, z out of the plane.

    The origin lies on the underside of the rafters, over the outer edge of the wall. Places along
    the eaves are -y. All parts stay between upright planes through the ends of its fields.

    :ivar pose: of the frame in the building [m], (7,).
    :ivar pitch: [rad].
    :ivar depth: of the rafters [m].
    :ivar strips: of its face, in order along the eaves.
    :ivar overhang: distance of their feet below the eaves in plan [m].
    :ivar ridges: start and end along the eaves, and distance from them in plan, of its ridges [m].
    :ivar lines: ends of the boards around it, along the eaves and from them in plan [m], (2, 2).
    :ivar posts: where lines of the roof meet, along the eaves and from them in plan, and how far
        around rafters keep clear [m].
    :ivar plumb: whether the upper ends of rafters are upright, else at right angles to the slope.
    """

    pose: np.ndarray
    pitch: float
    depth: float
    strips: Sequence[Strip]
    overhang: float
    ridges: tuple[tuple[float, float, float], ...] = ()
    lines: Sequence[np.ndarray] = ()
    posts: Sequence[tuple[float, float, float]] = ()
    plumb: bool = False

    def world(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> np.ndarray:
        """Transform points from the slope's frame to the building's [m], (n, 3)."""
        points = np.column_stack(np.broadcast_arrays(x, y, z)).astype(float)
        return self.pose[:3] + rotation.rotate(self.pose[3:], points)

    def _plan(self, x: ArrayLike, z: float) -> np.ndarray:
        """Compute the distance from the eaves in plan of a point of the slope's frame [m]."""
        return np.asarray(x) * float(cos(self.pitch)) - z * float(sin(self.pitch))

    def along(self, u: ArrayLike, z: float) -> np.ndarray:
        """Compute the x of points at distances from the eaves in plan [m]."""
        return (np.asarray(u) + z * sin(self.pitch)) / cos(self.pitch)

    def _at(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute foot and head of the face at places along the eaves [m]; none: 1e3 and -1e3."""
        foot, head = np.full(len(place), 1e3), np.full(len(place), -1e3)
        for strip in self.strips:
            on = (place >= strip.start) & (place <= strip.end)
            share = ((place - strip.start) / (strip.end - strip.start))[on]
            foot[on], head[on] = (line[0] + share * (line[1] - line[0])
                                  for line in (strip.foot, strip.head))
        return foot, head

    def _extent(self) -> list[tuple[float, bool, float]]:
        """Return the ends of the slope above the eaves, whether they are cut, and a sign."""
        whole = [piece for strip in self.strips
                 for piece in clipped(strip, strip.foot, strip.head, 0.0, np.inf)]
        return [(end, piece.high[k] - piece.low[k] < APART, sign) for piece, end, k, sign in (
            (whole[0], whole[0].start, 0, 1.0), (whole[-1], whole[-1].end, 1, -1.0))]

    def rafters(self, site: Site, frame: int, wall: float, margin: float) -> Ends:
        """
        Set rafters from the eaves or a valley to a ridge or hip.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param wall, margin: distance of the outermost rafters from gables, and from other ends of
            the slope [m].
        """
        low, high = (edge + sign * (margin if edge_is_cut else wall)
                     for edge, edge_is_cut, sign in self._extent())
        if high < low:
            low = high = 0.5 * (low + high)
        marks = [low, *sorted(place for post in self.posts for place in self._beside(*post)
                              if low + RAFTER < place < high - RAFTER), high]
        place = np.concatenate([[low], *(np.linspace(a, b, max(int(np.ceil(
            (b - a) / RAFTER_SPACING)), 1) + 1)[1:] for a, b in zip(marks, marks[1:])
            if b - a > 2.0 * RAFTER)])
        foot, head = self._reach(place, wall)
        keep = head - np.maximum(foot, 0.0) > _SHORTEST
        place, foot, reach = place[keep], foot[keep], self.along(head[keep], 0.0)
        start = np.maximum(self.along(foot, self.depth), self.along(-OVERHANG, 0.0))
        boxes = from_cells(
            micros(np.column_stack([start, -place - 0.5 * RAFTER, np.zeros(len(place))])),
            micros(np.column_stack([reach, -place + 0.5 * RAFTER, np.full(len(place),
                                                                          self.depth)])),
            frame=frame, axis=0, joint=Joint.NAIL, kind=site.kind('rafter'),
            material=site.material('timber'))
        pieces = split_along(boxes, PIECE, site.next_member, SPAN)
        foot, last = (np.flatnonzero(np.diff(pieces.member, **beside)) for beside in (
            {'prepend': -1}, {'append': -1}))
        if self.plumb:
            self._cut_plumb(site, pieces, last)
        row = site.add(pieces).start
        return Ends(row + foot, row + last, place, start, reach)

    def _cut_plumb(self, site: Site, pieces: Boxes, last: np.ndarray) -> None:
        """Let the upper ends of rafters be upright, as they stand at a board."""
        corners = box_corners(pieces.low[last] / MICRO, pieces.high[last] / MICRO)
        corners[:, [5, 7], 0] += self.bevel(self.depth)
        cut = site.hexahedra(corners)
        for name in ('low', 'high', 'form'):
            getattr(pieces, name)[last] = getattr(cut, name)

    def bevel(self, z: float) -> float:
        """Return how much longer rafters are at a height z than along their underside [m]."""
        return z * float(tan(self.pitch)) if self.plumb else 0.0

    def _beside(self, place: float, height: float, radius: float) -> list[float]:
        """Return where rafters go at a post: below it, or on both sides if they are above it."""
        foot, head = self._at(np.array([place]))
        if foot[0] > height - radius and head[0] > height + radius:
            return [place - radius - RAFTER, place + radius + RAFTER]
        return [place]

    def _reach(self, place: np.ndarray, wall: float) -> tuple[np.ndarray, np.ndarray]:
        """Compute how far rafters reach clear of boards and posts, from the eaves in plan [m]."""
        foot, head = self._at(place)
        for end, is_cut, sign in self._extent():
            head[(sign * (place - end) < wall - 1e-9) & (not is_cut)] = -np.inf
        middle = 0.5 * (np.maximum(foot, 0.0) + head)
        for line in self.lines:
            low, high = _beside(line, place)
            above = (low < high) & (0.5 * (low + high) > middle)
            head = np.where(above, np.minimum(head, low), head)
            foot = np.where(above | (high < low), foot, np.maximum(foot, high))
        for post, height, radius in self.posts:
            near = np.abs(place - post) < 0.5 * RAFTER + radius
            above = near & (height > middle)
            head[above] = np.minimum(head, height - radius)[above]
            near &= ~above
            foot[near] = np.maximum(foot, height + radius)[near]
        return foot, head

    def cover(self, site: Site, frame: int, rafters: Ends) -> tuple[np.ndarray, np.ndarray]:
        """
        Nail battens across the rafters and hang tiles on them.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param rafters: that carry the battens.
        :returns: parts that end at boards, (n,), and where, in the slope's frame [m], (n, 3).
        """
        lines = self._lines(rafters)
        battens = [(x, *ends) for x in lines for ends in self._battens(x, rafters)]
        boxes = split_along(_boxes(site, [
            ((x - 0.5 * BATTEN[0], -b, self.depth), (x + 0.5 * BATTEN[0], -a, self.depth
                                                     + BATTEN[1]))
            for x, a, b in battens], frame, 'batten', 'timber'), PIECE, site.next_member)
        added = site.add(boxes)
        tops = self._ridge_rows(lines)
        cut = self._hang(site, frame, self._rows(lines, battens, tops), self.depth + BATTEN[1],
                         TILE[0], battens)
        self._hang(site, frame, [run for _, run in tops], self.depth + COVER, RIDGE_TILE)
        parts, points = self._on_boards(1e-6 * rectangles(boxes.low[:, :2], boxes.high[:, :2]),
                                        self.depth)
        return np.append(added.start + parts, cut[0]), np.concatenate([points, cut[1]])

    def _rows(self, lines: Sequence[float], battens: Sequence[Batten],
              tops: Sequence[tuple[float, list[RowPiece]]]) -> list[list[RowPiece]]:
        """Return rows of tiles that end on battens, around the ridge tiles `tops`."""
        top = max(max(strip.head) for strip in self.strips)
        level = self.depth + BATTEN[1]
        # Tiles that reach on to the top hang on two battens.
        high, room = float(self.along(top, level)), float(self.along(_TAIL, level))
        for line, run in tops:
            if abs(run[0].high[1] - self.along(top, self.depth + COVER)) < 2.0 * APART:
                high, room = line, _LOW[0]
        held = {x for x, *_ in battens}
        marks = [lines[0], *(x for x in lines if lines[0] + _LOW[0] < x < high - room
                             and x in held), high]
        return [run for low, above in zip(marks, marks[1:]) if above - low > _LOW[1]
                for run in self._runs(
                    low + APART * (low in lines), above - APART * (above in lines), level,
                    [(row[0].start, row[-1].end) for line, row in tops if line < low + APART])]

    def _on_boards(self, outlines: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
        """
        Find what lies on the boards of hips, valleys and sloping ridges.

        :param outlines: of parts along x and y [m], (n, 4, 2).
        :param level: of their underside [m].
        :returns: indices of those that do, (k,), and where, in the slope's frame [m], (k, 3).
        """
        found, points = [], []
        plan = np.stack([-outlines[..., 1], self._plan(outlines[..., 0], level)], axis=2)
        for planes in (half_planes(_outline(line)) for line in self.lines):
            for k, outline in enumerate(plan):
                common = within(outline, planes)
                if len(common) > 2 and np.ptp(common, axis=0).min() > 2.0 * APART:
                    place, u = moments(common)[1]
                    found.append(k)
                    points.append((self.along(u, level), -place, level))
        return np.array(found, int), np.array(points).reshape(-1, 3)

    def _lines(self, rafters: Ends) -> list[float]:
        """
        Place battens evenly, with one below each ridge and apex.

        :param rafters: that carry the battens.
        """
        top = float(rafters.reach.max()) + self.bevel(self.depth) - BATTEN[0]
        # Those at the ends of rafters come first.
        marks = [self._below(height) for *_, height in self.ridges]
        marks += [reach - 0.5 * BATTEN[0] for post, *_ in self.posts
                  for reach in rafters.reach[np.abs(rafters.place - post) < APART].tolist()]
        stops = [float(self.along(-OVERHANG, 0.0)), top]
        for x in (mark - 0.5 * BATTEN[0] for mark in marks):
            if stops[0] < x < top and min(abs(x - stop) for stop in stops) > 2.0 * BATTEN[0]:
                stops.append(x)
        stops.sort()
        parts = [np.linspace(a, b, int(np.ceil((b - a) / GAUGE)) + 1)
                 for a, b in zip(stops, stops[1:])]
        return [float(x) + 0.5 * BATTEN[0] for x in (parts[0][0], *np.concatenate(
            [part[1:] for part in parts]))]

    def _below(self, height: float) -> float:
        """Return the place of a batten on the ends of rafters at a ridge [m]."""
        return (float(self.along(height - 0.5 * BOARD - CLEAR, 0.0)) + self.bevel(self.depth)
                - 0.5 * BATTEN[0])

    def _ridge_rows(self, lines: Sequence[float]) -> list[tuple[float, list[RowPiece]]]:
        """Return the battens from which ridge tiles reach up to the ridges, and their rows."""
        level, found = self.depth + COVER, []
        for start, end, height in self.ridges:
            line = max(x for x in lines if x < self._below(height) + APART)
            middle = 0.5 * (start + end)
            foot = float(self._at(np.array([middle]))[0][0])
            if end - start < _SHORT or line - LAP < self.along(foot, level + TILE[1]):
                continue
            top = float(self.along(height, level)) - APART
            for run in self._runs(line - LAP, top, level):
                if not run[0].start < middle < run[-1].end:
                    continue
                at = next(k for k, piece in enumerate(run) if piece.end > middle)
                first = last = at
                # It ends where the face goes on above the ridge.
                while first and ends_at(run[first - 1], start, end, top):
                    first -= 1
                while last + 1 < len(run) and ends_at(run[last + 1], start, end, top):
                    last += 1
                found.append((line, run[first:last + 1]))
        return found

    def _spans(self, u: float) -> list[Span]:
        """List the stretches of the slope at a distance from the eaves in plan [m]."""
        found: list[list] = []
        for strip in self.strips:
            for piece in clipped(strip, strip.foot, strip.head, u, u):
                cut = [end != whole for end, whole in ((piece.start, strip.start),
                                                       (piece.end, strip.end))]
                if found and found[-1][1] == piece.start:
                    found[-1][1], found[-1][3] = piece.end, cut[1]
                else:
                    found.append([piece.start, piece.end, *cut])
        return [(start + APART * first, end - APART * last) for start, end, first, last in found]

    def _battens(self, x: float, rafters: Ends) -> list[Span]:
        """Return the ends of the battens that rafters hold on a line [m]."""
        sections = [self._spans(float(self._plan(x - 0.5 * BATTEN[0], self.depth + BATTEN[1]))),
                    self._spans(float(self._plan(x + 0.5 * BATTEN[0], self.depth)))]
        found = []
        for start, end in ((max(a, c), min(b, d)) for a, b in sections[0]
                           for c, d in sections[1]):
            held = ((rafters.place - 0.5 * RAFTER > start) & (rafters.place + 0.5 * RAFTER < end)
                    & (rafters.start < x) & (rafters.reach + self.bevel(self.depth) > x))
            if end - start > _SHORT and held.any():
                found.append((start, end))
        return found

    def _runs(self, low: float, high: float, level: float,
              without: Sequence[Span] = ()) -> list[list[RowPiece]]:
        """
        Cut a row of tiles at the ends of the face, below at hips, and above in valleys.

        :param low, high: along the slope [m].
        :param level: of their underside [m].
        :param without: stretches along the eaves that other tiles cover.
        :returns: pieces side by side, for each stretch without a gap.
        """
        found: list[list[RowPiece]] = []
        for strip in self.strips:
            eaves = max(strip.foot) < APART - self.overhang
            foot = [-1e3] * 2 if eaves else (self.along(strip.foot, level + TILE[1])
                                             + APART).tolist()
            head = self.along(strip.head, level)
            if abs(head[1] - head[0]) > LEVEL:
                head = head - APART
            for piece in clipped(strip, foot, head.tolist(), low, high, without):
                if found and abs(found[-1][-1].end - piece.start) < LEVEL:
                    found[-1].append(piece)
                else:
                    found.append([piece])
        return found

    def _hang(self, site: Site, frame: int, runs: list[list[RowPiece]], level: float, width: float,
              battens: Sequence[Batten] = ()
              ) -> tuple[np.ndarray, np.ndarray]:
        """
        Divide rows into tiles; the first and the last ones of each are cut to its ends.

        What rests on two battens is nailed to them, all else fixed to what it touches.

        :returns: cut tiles at boards, (n,), and where, in the slope's frame [m], (n, 3).
        """
        pieces = [tile for run in runs for tile in divide(run, width)]
        parts, points = [np.zeros(0, int)], [np.zeros((0, 3))]
        if not pieces:
            return parts[0], points[0]
        corners = np.array(pieces)
        nailed = rests(corners, battens) > 1
        whole = ((corners[:, 0, 0] == corners[:, 2, 0]) & (corners[:, 1, 0] == corners[:, 3, 0])
                 & (np.ptp(corners[:, :2, 1], axis=1) + np.ptp(corners[:, 2:, 1], axis=1) < 1e-9))
        for joint, some in ((Joint.NAIL, nailed), (Joint.FIXING, ~nailed)):
            square, cut = corners[some & whole], corners[some & ~whole]
            if len(square):
                tiles = _boxes(site, [((*low, level), (*high, level + TILE[1]))
                                      for low, high in square[:, [0, 3]]], frame, 'tile', 'tile')
                tiles.joint[:] = joint
                site.add(tiles)
            if len(cut):
                tiles = site.hexahedra(prisms(cut, level, level + TILE[1]), site.kind('tile'),
                                       site.material('tile'), frame)
                tiles.joint[:] = joint
                some_parts, some_points = self._on_boards(cut[:, [0, 1, 3, 2]], level)
                parts.append(site.add(tiles).start + some_parts)
                points.append(some_points)
        return np.concatenate(parts), np.concatenate(points)

    def verges(self, site: Site, frame: int,
               ends: Sequence[tuple[float, int, float, Sequence[Span]]]) -> None:
        """
        Nail boards to the ends of the battens, which cover the steps of the gables.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param ends: of each gable its place along the eaves [m], 0 where the slope starts there
            and 1 where it ends, the height of its ridge in plan [m], and stretches where something
            stands against it, measured from the eaves in plan [m].
        """
        low, high = self.depth - VERGE[1], self.depth + COVER
        boards = []
        for place, last, span, stretches in ends:
            y = -place - last * VERGE[0]
            top = float(self.along(span, low)) - APART
            start = float(self.along(-OVERHANG, 0.0))
            for near, far in (*sorted(stretches), (np.inf, np.inf)):
                end = min(float(self.along(near, low)) - APART, top)
                if end - start > VERGE[1]:
                    boards.append(((start, y, low), (end, y + VERGE[0], high)))
                start = max(start, float(self.along(far, high)) + APART)
        if boards:
            column = _boxes(site, boards, frame, 'verge', 'timber')
            column.axis[:], column.joint[:] = 0, Joint.FIXING
            site.add(column, PIECE)


def _beside(line: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Compute where rafters would meet a board, from the eaves in plan [m].

    :param line: ends of the board, along the eaves and from them [m], (2, 2).
    :param place: middles of the rafters along the eaves [m], (n,).
    :returns: where they would enter and leave it, the first above the second where they pass
        beside it, (n,) each.
    """
    board = _outline(line, CLEAR)
    spans = [within(board, np.array([[1.0, 0.0, x + 0.5 * RAFTER],
                                     [-1.0, 0.0, 0.5 * RAFTER - x]]))[:, 1] for x in place]
    return (np.array([span.min(initial=1e3) for span in spans]),
            np.array([span.max(initial=-1e3) for span in spans]))


def _outline(line: np.ndarray, clear: float = 0.0) -> np.ndarray:
    """Return the outline of a board in plan and beside it, counter-clockwise [m], (4, 2)."""
    way = (line[1] - line[0]) / hypot(*(line[1] - line[0]))
    aside = np.array([-way[1], way[0]])
    return np.concatenate([line - 0.5 * BOARD * aside - clear * aside,
                           line[::-1] + 0.5 * BOARD * aside + clear * aside])


def distance(line: np.ndarray, place: np.ndarray) -> float:
    """Compute the distance of a place from a line between two ends [m]."""
    way = line[1] - line[0]
    length = float((way * way).sum())
    share = float(np.clip(((place - line[0]) * way).sum() / length, 0.0, 1.0)) if length else 0.0
    return float(hypot(*(place - line[0] - share * way)))


def _boxes(site: Site, ends: Sequence[tuple], frame: int, kind: str, material: str) -> Boxes:
    low, high = (np.array(side) for side in zip(*ends))
    return from_cells(micros(low), micros(high), frame=frame, axis=1, joint=Joint.NAIL,
                      kind=site.kind(kind), material=site.material(material))
