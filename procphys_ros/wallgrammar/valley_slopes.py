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

"""Slopes that end at valleys: their rafters, battens and tiles are cut along the valley line."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import cos, hypot, sin, tan
from procphys_ros.geometry.hexahedron import box_corners
from procphys_ros.wallgrammar.boxes import (
    Boxes,
    from_cells,
    Joint,
    MICRO,
    micros,
    split_along,
)
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.slopes import (
    APART,
    BATTEN,
    COVER,
    Ends,
    GAUGE,
    LAP,
    OVERHANG,
    PIECE,
    RAFTER,
    rafter_depth,
    RIDGE_TILE,
    Slope,
    TILE,
)

_CLEAR = 0.001        # [m] along the eaves, between the tiles of a slope and the valley
_LEAST = 0.05         # [m] least length of a tile on a batten
_SHORTEST = 0.1       # [m] batten
_SLEEPER = (0.15, 0.35)  # [m] least and largest width along the eaves
_TOP = 0.06           # [m] in plan, from the ridge to the uppermost batten, with a margin
_TAPERED = 0.02       # [m] least length of a rafter's underside


class Edge(NamedTuple):
    """
    End of a slope along the eaves: at + way · u, with u the distance from the eaves in plan.

    :ivar at: [m].
    :ivar way: -1, 0 or 1.
    """

    at: float
    way: int

    def place(self, u: float) -> float:
        """Return the end at a distance from the eaves [m]."""
        return self.at + self.way * u


class Field(NamedTuple):
    """
    Trapezium in plan, part of a slope.

    :ivar low, high: least and greatest distance from the eaves in plan [m].
    :ivar start, end: its ends along the eaves.
    """

    low: float
    high: float
    start: Edge
    end: Edge


class FieldRow(NamedTuple):
    """
    Row of a field.

    :ivar low, high: along the slope [m].
    :ivar start, end: along the eaves, at its low and its high side [m], (2,).
    """

    low: float
    high: float
    start: np.ndarray
    end: np.ndarray


def bar_fields(length: float, span: float, mouths: Sequence[tuple[float, float]]
               ) -> tuple[Field, ...]:
    """
    Divide a slope that stems join into fields.

    :param length: of the eaves [m].
    :param span: horizontal distance from the eaves to the ridge [m].
    :param mouths: of the stems along the eaves, in order [m].
    """
    halves = [0.5 * (b - a) for a, b in mouths]
    levels = sorted({-1.0, 0.0, *(h for h in halves if h < span - 0.01), 2.0 * span})
    fields = []
    for low, high in zip(levels, levels[1:]):
        start = Edge(0.0, 0)
        for (a, b), half in zip(mouths, halves):
            if half > low + 0.01:
                fields.append(Field(low, high, start, Edge(a, 1)))
                start = Edge(b, -1)
        fields.append(Field(low, high, start, Edge(length, 0)))
    return tuple(fields)


def least_step(span: float, pitch: float) -> float:
    """
    Compute the least difference in width between a bar and a narrower stem [m].

    Its valleys then end below the ridge tiles of the bar.

    :param span: of the bar, horizontal distance from the eaves to the ridge [m].
    :param pitch: [rad].
    """
    level = rafter_depth(span, pitch) + COVER
    return 2.0 * (_TOP + (BATTEN[0] + LAP) * float(cos(pitch)) + level * float(sin(pitch)))


def stem_field(length: float, mouth: float, mouth_first: bool) -> tuple[Field, ...]:
    """
    Return the field of a stem's slope.

    :param length: of the eaves, with their part over the bar [m].
    :param mouth: place of the bar's wall along the eaves [m].
    :param mouth_first: whether the valley is where the eaves start.
    """
    ends = (Edge(mouth, -1), Edge(length, 0)) if mouth_first else (Edge(0.0, 0), Edge(mouth, 1))
    return (Field(-1.0, 1e3, *ends),)


@dataclass(frozen=True)
class ValleySlope(Slope):
    """
    Plane of a roof that ends at valleys.

    :ivar fields: its parts.
    :ivar mouths: stretches of the eaves without a wall below, at which rafters end flush [m].
    :ivar valley: place of the valley's foot and the way from there over the bar, along the eaves,
        for slopes of stems; None for those of bars.
    :ivar yields: whether ridge tiles leave room for those of a stem that reach over them.
    """

    fields: tuple[Field, ...] = ()
    mouths: tuple[tuple[float, float], ...] = ()
    valley: Edge | None = None
    yields: bool = False

    def _plan(self, x: float, z: float) -> float:
        """Compute the distance from the eaves in plan of a point of the slope's frame [m]."""
        return x * float(cos(self.pitch)) - z * float(sin(self.pitch))

    def _along(self, u: float, z: float) -> float:
        """Compute the x of a point at a distance from the eaves in plan [m]."""
        return (u + z * float(sin(self.pitch))) / float(cos(self.pitch))

    def set_rafters(self, site: Site, frame: int, place: np.ndarray, head: float) -> Ends:
        """
        Set rafters; those beyond the foot of the valley are cut to lie on the bar's sleepers.

        :param site: takes the parts.
        :param frame: index of the slope's frame.
        :param place: middles along the eaves [m], (n,).
        :param head: length from the eaves line to the top [m].
        """
        near = np.array([any(a - OVERHANG - RAFTER < p < b + OVERHANG + RAFTER
                             for a, b in self.mouths) for p in place])
        start = np.where(near, 0.0, -OVERHANG / cos(self.pitch))
        over = self.beyond(place) > 0.5 * RAFTER
        sides = np.array([-0.5 * RAFTER, 0.5 * RAFTER])
        feet = np.stack([self.foot(place[:, None] + sides, z) for z in (0.0, self.depth)], axis=2)
        start = np.where(over, feet.min(axis=(1, 2)), start)
        keep = ~over | (feet.max(axis=(1, 2)) < head - _TAPERED)
        place, start, over = place[keep], start[keep], over[keep]
        low = np.column_stack([start, -place - 0.5 * RAFTER, np.zeros(len(place))])
        high = np.column_stack([np.full(len(place), head), -place + 0.5 * RAFTER,
                                np.full(len(place), self.depth)])
        pieces = split_along(from_cells(
            micros(low), micros(high), frame=frame, axis=0, joint=Joint.NAIL,
            kind=site.kind('rafter'), material=site.material('timber')), PIECE, site.next_member)
        first = np.flatnonzero(np.diff(pieces.member, prepend=-1))
        for row in first[over].tolist():
            shape(site, pieces, row, 0, False, lambda p: self.foot(-p[:, 1], p[:, 2]))
        rows = site.add(pieces)
        last = np.append(first[1:], len(pieces)) - 1
        return Ends(rows.start + first, rows.start + last, place, np.full(len(place), head))

    def beyond(self, place: np.ndarray) -> np.ndarray:
        """Compute how far over the bar places along the eaves of a stem lie [m]."""
        if self.valley is None:
            return np.full(np.shape(place), -np.inf)
        return self.valley.way * (place - self.valley.at)

    def foot(self, place: np.ndarray, z: np.ndarray | float) -> np.ndarray:
        """Compute the x at which a stem's rafter meets the top of the bar's sleepers [m]."""
        bed = (self.depth + BATTEN[1]) / cos(self.pitch)
        away = np.where(np.isinf(self.beyond(place)), 0.0, self.beyond(place))
        return (away * tan(self.pitch) + bed - z * cos(self.pitch)) / sin(self.pitch)

    def cover(self, site: Site, frame: int, rafters: Ends) -> None:
        """Nail battens across the rafters, and hang tiles on them that end at the valleys."""
        lines = self._lines(float(rafters.reach.max()))
        starts = np.where(self.beyond(rafters.place) > 0.5 * RAFTER,
                          self.foot(rafters.place, self.depth), -1.0)
        battens = [(x, *ends) for x in lines for ends in self._battens(x, rafters, starts)]
        ends = [((x - 0.5 * BATTEN[0], -b, self.depth),
                 (x + 0.5 * BATTEN[0], -a, self.depth + BATTEN[1])) for x, a, b in battens]
        site.add(_boxes(site, ends, frame, 'batten', 'timber', Joint.NAIL), PIECE)
        level = self.depth + BATTEN[1]
        rows = [row for field in self.fields for row in self._rows(field, lines, battens)]
        self._hang(site, frame, rows, level, TILE[0], Joint.NAIL)
        low, (_, high) = lines[-1] - LAP, self._ridge_levels()
        level = self.depth + COVER
        cut = level + 2.0 * TILE[1] if self.yields else level
        top = [self._cut_row(field, low, high, cut) for field in self.fields
               if field.low <= self._plan(low, level) < field.high]
        self._hang(site, frame, top, level, RIDGE_TILE, Joint.FIXING)

    def _lines(self, top: float) -> list[float]:
        """Place battens: evenly between the eaves, the feet and tops of valleys, and the ridge."""
        ends = [-OVERHANG / float(cos(self.pitch)) + 0.5 * BATTEN[0], top - 0.5 * BATTEN[0]]
        marks = sorted({x for f in self.fields
                        if ends[0] + 0.1 < (x := self._along(f.low, self.depth + COVER))
                        < ends[1] - 0.1})
        lines = [ends[0]]
        for start, end in zip([ends[0], *marks], [*marks, ends[1]]):
            lines += np.linspace(start, end, int(np.ceil((end - start) / GAUGE)) + 1)[1:].tolist()
        return lines

    def _battens(self, x: float, rafters: Ends, starts: np.ndarray) -> list[tuple[float, float]]:
        """Return the ends of the battens that rafters hold on a line [m]."""
        level = self.depth + COVER
        u = self._plan(x, level) + 1e-9
        found = []
        for field in self.fields:
            if not field.low <= u < field.high:
                continue
            row = self._cut_row(field, x - 0.5 * BATTEN[0], x + 0.5 * BATTEN[0], level)
            start, end = float(row.start.max()), float(row.end.min())
            held = ((rafters.place - 0.5 * RAFTER > start) & (rafters.place + 0.5 * RAFTER < end)
                    & (starts < x - 0.5 * BATTEN[0]) & (rafters.reach > x))
            if end - start > _SHORTEST and held.any():
                found.append((start, end))
        return found

    def _cut_row(self, field: Field, low: float, high: float, level: float) -> FieldRow:
        us = [self._plan(low, level), self._plan(high, level)]
        start = np.array([field.start.place(u) + abs(field.start.way) * _CLEAR for u in us])
        end = np.array([field.end.place(u) - abs(field.end.way) * _CLEAR for u in us])
        empty = end < start  # at the foot of a valley: empty, at the fixed end
        still = end if field.start.way else start
        return FieldRow(low, high, np.where(empty, still, start), np.where(empty, still, end))

    def _rows(self, field: Field, lines: Sequence[float],
              battens: Sequence[tuple[float, float, float]]) -> list[FieldRow]:
        """Return rows of tiles that end on battens; rows without one between them are joined."""
        level = self.depth + COVER
        own = [x for x in lines if field.low - 1e-9 <= self._plan(x, level) <= field.high + 1e-9]
        rows: list[FieldRow] = []
        for low, high in zip(own, own[1:]):
            row = self._cut_row(field, low, high, level)
            if float(row.end[1] - row.start[1]) < APART and float(row.end[0] - row.start[0]) < (
                    APART):
                continue
            if rows and not any(
                    y == rows[-1].high and min(b, rows[-1].end[1]) - max(a, rows[-1].start[1])
                    > _LEAST for y, a, b in battens):
                row = self._cut_row(field, rows.pop().low, high, level)
            rows.append(row)
        return rows

    def _hang(self, site: Site, frame: int, rows: Sequence[FieldRow], level: float,
              width: float, joint: Joint) -> None:
        """Divide rows into tiles; the first and the last of each are cut to its ends."""
        whole, cut = [], []
        for low, high, start, end in rows:
            first, last = float(start.max()), float(end.min())
            count = max(round((last - first) / width), 1)
            marks = np.linspace(first, last, count + 1)
            lefts = np.column_stack([marks[:-1], marks[:-1]])
            rights = np.column_stack([marks[1:], marks[1:]])
            lefts[0], rights[-1] = start, end
            if count == 1 and last <= first:
                lefts, rights = start[None], end[None]
            for a, b in zip(lefts + APART, rights - APART):
                a, b = np.where(a > b, 0.5 * (a + b), a), np.where(a > b, 0.5 * (a + b), b)
                if np.ptp(a) + np.ptp(b) < 1e-9:
                    whole.append(((low + APART, -b[0], level),
                                  (high - APART, -a[0], level + TILE[1])))
                elif float((b - a).sum()) > _LEAST:
                    cut.append(np.array([[low + APART, -b[0]], [high - APART, -b[1]],
                                         [low + APART, -a[0]], [high - APART, -a[1]]]))
        if whole:
            boxes = _boxes(site, whole, frame, 'tile', 'tile', joint)
            boxes.axis[:] = 1
            site.add(boxes)
        if cut:
            tiles = prisms(site, np.array(cut), level, level + TILE[1], frame, 'tile', 'tile')
            tiles.joint[:] = joint
            site.add(tiles)

    def sleepers(self, site: Site, frame: int) -> None:
        """Lay boards along the valleys onto the rafters of a bar, for the rafters of its stems."""
        for a, b in self.mouths:
            half = 0.5 * (b - a)
            bed = self.depth + BATTEN[1]
            first = BATTEN[1] / sin(self.pitch) + 0.005
            last = first + np.clip(bed / sin(self.pitch), *_SLEEPER)
            foot = self._along(0.0, bed)
            top = [self._along(half - d, bed) for d in (first, last)]
            if top[1] - foot < _SHORTEST:
                continue
            centre = half - 0.5 * _CLEAR
            count = int(np.ceil(hypot(top[0] - foot, half) / (PIECE / MICRO)))
            share = np.linspace(0.0, 1.0, count + 1)
            inner = np.column_stack([foot + share * (top[0] - foot),
                                     first + share * (centre - first)])
            outer = np.column_stack([foot + share * (top[1] - foot),
                                     last + share * (centre - last)])
            for side in (0, 1):
                quads = []
                for k in range(count):
                    quad = np.array([outer[k], outer[k + 1], inner[k], inner[k + 1]])
                    quad[:, 1] = -(a + quad[:, 1]) if side == 0 else -(b - quad[:, 1])
                    quads.append(quad if side == 0 else quad[[2, 3, 0, 1]])
                boards = prisms(site, np.array(quads), self.depth, bed, frame, 'sleeper',
                                'timber')
                boards.member[:] = site.next_member
                site.add(boards)


def prisms(site: Site, outlines: np.ndarray, low: float, high: float, frame: int, kind: str,
           material: str) -> Boxes:
    """
    Make upright prisms on outlines.

    :param site: receives their corners.
    :param outlines: corners -x -y, +x -y, -x +y, +x +y [m], (n, 4, 2).
    :param low, high: levels [m].
    """
    corners = np.zeros((len(outlines), 8, 3))
    corners[:, :4, :2] = corners[:, 4:, :2] = outlines
    corners[:, :4, 2], corners[:, 4:, 2] = low, high
    boxes = from_cells(micros(corners.min(axis=1)), micros(corners.max(axis=1)), frame=frame,
                       joint=Joint.FIXING, kind=site.kind(kind), material=site.material(material))
    boxes.form[:] = len(site.forms) + np.arange(len(boxes))
    site.forms += list(corners)
    return boxes


def shape(site: Site, boxes: Boxes, row: int, axis: int, upper: bool,
          place: Callable[[np.ndarray], np.ndarray]) -> None:
    """
    Cut one end of a box slantwise.

    :param site: receives its corners.
    :param axis: normal to the end.
    :param upper: whether it is the end at larger coordinates.
    :param place: returns the coordinate of the end at points [m], (4, 3).
    """
    corners = box_corners(boxes.low[row:row + 1] / MICRO, boxes.high[row:row + 1] / MICRO)[0]
    there = ((np.arange(8) >> axis) & 1) == int(upper)
    corners[there, axis] = place(corners[there])
    boxes.form[row] = len(site.forms)
    site.forms.append(corners)


def _boxes(site: Site, ends: Sequence[tuple], frame: int, kind: str, material: str,
           joint: Joint) -> Boxes:
    low, high = (np.array(side) for side in zip(*ends))
    return from_cells(micros(low), micros(high), frame=frame, axis=1, joint=joint,
                      kind=site.kind(kind), material=site.material(material))
