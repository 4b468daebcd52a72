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

from procphys_ros.elementary import cos, hypot, sin
from procphys_ros.geometry import rotation
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, Joint, micros
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.roof_plan import Edge, Field

RAFTER = 0.05            # [m] width of rafters
BOARD = 0.075            # [m] thickness of the boards at ridges, hips and valleys
_SHALLOWEST = 0.12       # [m] least depth of rafters
_SLENDER = 25.0          # length over depth of rafters, a joiner's rule
RAFTER_SPACING = 0.6     # [m] largest
_SHORTEST = 0.2          # [m] shortest rafter, in plan
BATTEN = (0.05, 0.025)  # [m] width and depth (BS 5534)
_SHORT = 0.06            # [m] shortest batten
COVER = 0.045            # [m] depth of battens and tiles together
TILE = (0.40, 0.02)     # [m] width and thickness of a body that stands for a few tiles
GAUGE = 0.32            # [m] largest distance of battens
TILE_AREA = TILE[0] * GAUGE  # [m²] of roof that a tile covers
APART = 0.001           # [m] tiles do not touch each other
_LEAST = 0.05           # [m] least length of a tile on a batten
_LOW = (0.06, 0.005)    # [m] least height of rows of tiles, and of those between two changes
_TAIL = 0.15            # [m] in plan: battens nearer to a top than this do not end rows
CLEAR = 0.005           # [m] between timbers that are cut to meet
LAP = 0.15              # [m] by which ridge tiles lie on the tiles below
RIDGE_TILE = 0.45       # [m] length of ridge tiles
_VERGE = (0.025, 0.12)   # [m] thickness of boards at gables, and how far they hang below battens
PIECE = 1_500_000       # [µm] rafters and battens splinter into pieces of at most this length
OVERHANG = 0.25          # [m] of the eaves

Span = tuple[float, float]


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


class Post(NamedTuple):
    """
    Place where lines of the roof meet, seen from a slope.

    :ivar place, height: along the eaves, and from them in plan [m].
    :ivar radius: kept clear of rafters [m].
    """

    place: float
    height: float
    radius: float


class TileRow(NamedTuple):
    """
    TileRow of tiles.

    :ivar low, high: along the slope [m].
    :ivar start, end: along the eaves, at its low and its high side [m], (2,).
    """

    low: float
    high: float
    start: np.ndarray
    end: np.ndarray


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

    The origin lies on the underside of the rafters, over the outer edge of the wall. Places along
    the eaves are -y. All parts stay between upright planes through the ends of its fields.

    :ivar pose: of the frame in the building [m], (7,).
    :ivar pitch: [rad].
    :ivar depth: of the rafters [m].
    :ivar fields: trapezia in plan that it consists of.
    :ivar ridges: start and end along the eaves, and distance from them in plan, of its ridges [m].
    :ivar posts: at its corners.
    """

    pose: np.ndarray
    pitch: float
    depth: float
    fields: tuple[Field, ...]
    ridges: tuple[tuple[float, float, float], ...] = ()
    posts: tuple[Post, ...] = ()

    def world(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> np.ndarray:
        """Transform points from the slope's frame to the building's [m], (n, 3)."""
        points = np.column_stack(np.broadcast_arrays(x, y, z)).astype(float)
        return self.pose[:3] + rotation.rotate(self.pose[3:], points)

    def _plan(self, x: float, z: float) -> float:
        """Compute the distance from the eaves in plan of a point of the slope's frame [m]."""
        return x * float(cos(self.pitch)) - z * float(sin(self.pitch))

    def along(self, u: ArrayLike, z: float) -> np.ndarray:
        """Compute the x of points at distances from the eaves in plan [m]."""
        return (np.asarray(u) + z * sin(self.pitch)) / cos(self.pitch)

    def _extent(self) -> tuple[tuple[float, bool, float], tuple[float, bool, float]]:
        """Return the ends of the slope along the eaves, whether they are cut, and a sign."""
        ends = [(edge.place(u), edge.way != 0.0, side) for f in self.fields
                for side, edge in ((1.0, f.start), (-1.0, f.end))
                for u in (max(f.low, 0.0), f.high)]
        return min(e for e in ends if e[2] > 0.0), max(e for e in ends if e[2] < 0.0)

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
        marks = [low, *sorted(place for post in self.posts for place in self._beside(post)
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
        return Ends(*site.add_spans(boxes, PIECE), place, start, reach)

    def _beside(self, post: Post) -> list[float]:
        """Return where rafters go at a post: below it, or on both sides if they are above it."""
        above = any(abs(f.low - post.height) < APART and f.start.place(f.low) + APART < post.place
                    < f.end.place(f.low) - APART for f in self.fields)
        aside = post.radius + RAFTER
        return [post.place - aside, post.place + aside] if above else [post.place]

    def _reach(self, place: np.ndarray, wall: float) -> tuple[np.ndarray, np.ndarray]:
        """Compute how far rafters reach clear of boards and posts, from the eaves in plan [m]."""
        foot, head = np.full(len(place), 1e3), np.full(len(place), -1e3)
        for field in self.fields:
            low = np.full(len(place), field.low)
            high = np.full(len(place), field.high)
            for edge, sign in ((field.start, 1.0), (field.end, -1.0)):
                room, way = sign * (place - edge.at), sign * edge.way
                if way == 0.0:
                    high[room < wall - 1e-9] = -np.inf
                    continue
                room -= 0.5 * RAFTER + (0.5 * BOARD + CLEAR) * hypot(1.0, way)
                if way > 0.0:
                    high = np.minimum(high, room / way)
                else:
                    low = np.maximum(low, room / way)
            foot = np.where(high > low, np.minimum(foot, low), foot)
            head = np.where(high > low, np.maximum(head, high), head)
        for start, end, height in self.ridges:
            below = (place > start - 0.5 * RAFTER) & (place < end + 0.5 * RAFTER)
            head[below] = np.minimum(head, height - 0.5 * BOARD - CLEAR)[below]
        for post in self.posts:
            near = np.abs(place - post.place) < 0.5 * RAFTER + post.radius
            above = near & (post.height > 0.5 * (np.maximum(foot, 0.0) + head))
            head[above] = np.minimum(head, post.height - post.radius)[above]
            near &= ~above
            foot[near] = np.maximum(foot, post.height + post.radius)[near]
        return foot, head

    def cover(self, site: Site, frame: int, rafters: Ends) -> None:
        """
        Nail battens across the rafters and hang tiles on them.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param rafters: that carry the battens.
        """
        lines = self._lines(rafters)
        battens = [(x, *ends) for x in lines for ends in self._battens(x, rafters)]
        site.add(_boxes(site, [((x - 0.5 * BATTEN[0], -b, self.depth),
                                (x + 0.5 * BATTEN[0], -a, self.depth + BATTEN[1]))
                               for x, a, b in battens], frame, 'batten', 'timber'), PIECE)
        rows = [row for field in self.fields for row in self._rows(field, lines, battens)]
        near = 0.5 * BATTEN[0]
        nailed = [any(row.low - near < x < row.high + near and min(b, row.end.max())
                      > max(a, row.start.min()) for x, a, b in battens) for row in rows]
        for joint in (Joint.NAIL, Joint.FIXING):  # what reaches no batten is fixed to other tiles
            self._hang(site, frame, [row for row, nail in zip(rows, nailed)
                                     if nail == (joint == Joint.NAIL)],
                       self.depth + BATTEN[1], TILE[0], joint)
        level = self.depth + COVER
        top = [(field, line) for field in self.fields
               if (line := self._ridge_line(field, lines)) is not None]
        self._hang(site, frame, [
            self._row(field, line - LAP, float(self.along(field.high, level)) - APART, level)
            for field, line in top], level, RIDGE_TILE, Joint.FIXING)

    def _lines(self, rafters: Ends) -> list[float]:
        """
        Place battens evenly, with one below each ridge and apex, and where fields change.

        :param rafters: that carry the battens.
        """
        top = float(rafters.reach.max()) - BATTEN[0]
        # Those at the ends of rafters come first.
        marks = [self._below(height) for *_, height in self.ridges]
        marks += [reach - 0.5 * BATTEN[0] for post in self.posts
                  for reach in rafters.reach[np.abs(rafters.place - post.place) < APART].tolist()]
        marks += [float(self.along(f.low, self.depth + BATTEN[1])) for f in self.fields]
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
        return float(self.along(height - 0.5 * BOARD - CLEAR, 0.0)) - 0.5 * BATTEN[0]

    def _ridge_line(self, field: Field, lines: Sequence[float]) -> float | None:
        """Return the batten from which ridge tiles reach up to the top of a field, if any do."""
        start, end = field.start.place(field.high), field.end.place(field.high)
        level = self.depth + COVER
        line = max(x for x in lines if x < self._below(field.high) + APART)
        goes_on = any(other.low == field.high and other.start.place(other.low) < end
                      and other.end.place(other.low) > start for other in self.fields)
        room = line - LAP > self.along(field.low, level + TILE[1])
        return line if room and end - start > _SHORT and not goes_on else None

    def _section(self, u: float) -> list[Span]:
        """List the stretches of the slope at a distance from the eaves in plan [m]."""
        return [(f.start.place(u) + APART * (f.start.way != 0.0),
                 f.end.place(u) - APART * (f.end.way != 0.0))
                for f in self.fields if f.low <= u < f.high]

    def _battens(self, x: float, rafters: Ends) -> list[Span]:
        """Return the ends of the battens that rafters hold on a line [m]."""
        sections = [self._section(self._plan(x - 0.5 * BATTEN[0], self.depth + BATTEN[1])),
                    self._section(self._plan(x + 0.5 * BATTEN[0], self.depth))]
        found = []
        for start, end in ((max(a, c), min(b, d)) for a, b in sections[0]
                           for c, d in sections[1]):
            held = ((rafters.place - 0.5 * RAFTER > start) & (rafters.place + 0.5 * RAFTER < end)
                    & (rafters.start < x) & (rafters.reach > x))
            if end - start > _SHORT and held.any():
                found.append((start, end))
        return found

    def _row(self, field: Field, low: float, high: float, level: float) -> TileRow:
        """Cut a row at the ends of a field: at the underside at hips, at the top in valleys."""
        def cut(edge: Edge, sign: float) -> np.ndarray:
            z = level + (TILE[1] if sign * edge.way < 0.0 else 0.0)
            return np.array([edge.place(self._plan(x, z)) for x in (low, high)])
        start, end = cut(field.start, 1.0), cut(field.end, -1.0)
        middle = 0.5 * (start + end)  # of apexes, and of the feet of valleys, which are empty
        return TileRow(low, high, np.where(end < start, middle, start),
                       np.where(end < start, middle, end))

    def _rows(self, field: Field, lines: Sequence[float],
              battens: Sequence[tuple[float, float, float]]) -> list[TileRow]:
        """Return rows of tiles that end on battens; rows without one between them are joined."""
        ends = self.along([field.low, field.high], self.depth + BATTEN[1]).tolist()
        low, high = max(ends[0], lines[0]), ends[1]
        ridge = self._ridge_line(field, lines)
        room = _LOW[0]
        if ridge is None:  # tiles that reach on to the top hang on two battens
            room = float(self.along(_TAIL, self.depth + BATTEN[1]))
        high = ridge or high
        marks = [low, *(x for x in lines if low + _LOW[0] < x < high - room), high]
        rows: list[TileRow] = []
        for start, end in zip(marks, marks[1:]):
            row = self._row(field, start, end, self.depth + BATTEN[1])
            if float((row.end - row.start).max()) < APART or end - start < _LOW[1]:
                continue
            if rows and not any(
                    abs(x - rows[-1].high) < APART and min(b, rows[-1].end[1])
                    - max(a, rows[-1].start[1]) > _LEAST for x, a, b in battens):
                row = self._row(field, rows.pop().low, end, self.depth + BATTEN[1])
            rows.append(row)
        return [row._replace(low=row.low + APART * (row.low in lines),
                             high=row.high - APART * (row.high in lines)) for row in rows]

    def _hang(self, site: Site, frame: int, rows: Sequence[TileRow], level: float, width: float,
              joint: Joint) -> None:
        """Divide rows into tiles; the first and the last of each are cut to its ends."""
        whole, cut = [], []
        for low, high, start, end in rows:
            first, last = float(start.max()), float(end.min())
            count = max(round((last - first) / width), 1)
            marks = np.linspace(first, last, count + 1)
            lefts, rights = (np.column_stack([m, m]) for m in (marks[:-1], marks[1:]))
            lefts[0], rights[-1] = start, end
            for a, b in zip(lefts + APART, rights - APART):
                a, b = np.where(a > b, 0.5 * (a + b), a), np.where(a > b, 0.5 * (a + b), b)
                if np.ptp(a) + np.ptp(b) < 1e-9:
                    whole.append(((low, -b[0], level), (high, -a[0], level + TILE[1])))
                elif float((b - a).sum()) > _LEAST:
                    cut.append(np.array([[low, -b[0]], [high, -b[1]], [low, -a[0]],
                                         [high, -a[1]]]))
        if whole:
            boxes = _boxes(site, whole, frame, 'tile', 'tile')
            boxes.joint[:] = joint
            site.add(boxes)
        if cut:
            tiles = _prisms(site, np.array(cut), level, level + TILE[1], frame)
            tiles.joint[:] = joint
            site.add(tiles)

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
        low, high = self.depth - _VERGE[1], self.depth + COVER
        boards = []
        for place, last, span, stretches in ends:
            y = -place - last * _VERGE[0]
            top = float(self.along(span, low)) - APART
            start = float(self.along(-OVERHANG, 0.0))
            for near, far in (*sorted(stretches), (np.inf, np.inf)):
                end = min(float(self.along(near, low)) - APART, top)
                if end - start > _VERGE[1]:
                    boards.append(((start, y, low), (end, y + _VERGE[0], high)))
                start = max(start, float(self.along(far, high)) + APART)
        if boards:
            column = _boxes(site, boards, frame, 'verge', 'timber')
            column.axis[:], column.joint[:] = 0, Joint.FIXING
            site.add(column, PIECE)


def _prisms(site: Site, outlines: np.ndarray, low: float, high: float, frame: int) -> Boxes:
    """
    Make tiles on outlines.

    :param site: receives their corners.
    :param outlines: corners -x -y, +x -y, -x +y, +x +y [m], (n, 4, 2).
    :param low, high: levels [m].
    """
    corners = np.zeros((len(outlines), 8, 3))
    corners[:, :4, :2] = corners[:, 4:, :2] = outlines
    corners[:, :4, 2], corners[:, 4:, 2] = low, high
    boxes = from_cells(micros(corners.min(axis=1)), micros(corners.max(axis=1)), frame=frame,
                       kind=site.kind('tile'), material=site.material('tile'))
    boxes.form[:] = len(site.forms) + np.arange(len(boxes))
    site.forms += list(corners)
    return boxes


def _boxes(site: Site, ends: Sequence[tuple], frame: int, kind: str, material: str) -> Boxes:
    low, high = (np.array(side) for side in zip(*ends))
    return from_cells(micros(low), micros(high), frame=frame, axis=1, joint=Joint.NAIL,
                      kind=site.kind(kind), material=site.material(material))
