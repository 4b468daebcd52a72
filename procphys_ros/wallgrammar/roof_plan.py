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

"""Roof plans: straight skeletons, the faces of a roof of one pitch over any simple polygon."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import atan2, hypot

_SAME = 2e-6       # [m] points this near are one: plans are in whole micrometres
_LOST = 1e-6       # of the area of a plan: most that its faces may miss or cover twice
_STILL = 1e-9      # m of a vertex per m of its edges, that counts as none


class Strip(NamedTuple):
    """
    Part of a face between two places along its eaves, at which a rafter begins and ends.

    :ivar start, end: along the eaves [m].
    :ivar foot, head: distances from the eaves at both ends [m], (2,) each.
    """

    start: float
    end: float
    foot: tuple[float, float]
    head: tuple[float, float]


class Arc(NamedTuple):
    """
    Line where two faces meet.

    :ivar start, end: in plan, the lower end first [m], (2,).
    :ivar low, high: their distances from the eaves [m]; the same at ridges.
    :ivar valley: whether water runs towards it.
    :ivar planes: of the two faces.
    """

    start: np.ndarray
    end: np.ndarray
    low: float
    high: float
    valley: bool
    planes: tuple[int, int]


class NoRoofError(ValueError):
    """Corners so close to others, or angles so close to straight, that no roof was found."""


@dataclass
class RoofPlan:
    """
    Faces of a roof whose eaves all lie at one level and whose faces all have one pitch.

    All edges but gables move inwards at one speed, as in Aichholzer and others (1995, J. UCS
    1(12)); the ways of their corners are the lines where faces meet. All changes at one time are
    made at once: the shrunken polygon touches itself, and is cut where it does.

    :raises NoRoofError: when changes do not end.

    :ivar points: corners, counter-clockwise [m], (n, 2).
    :ivar gables: edges that stand still.
    :ivar ways, normals: directions of the edges, and at right angles inwards, (n, 2).
    :ivar turns: angles between edges at the corners where they begin, left positive [rad], (n,).
    :ivar plane: first edge in the same line, (n,).
    :ivar edges: without those in one line with the one before.
    :ivar arcs: lines between faces, without those at gables.
    :ivar lowest_top: least distance from the eaves where a ridge or a point is left [m].
    """

    points: np.ndarray
    gables: frozenset[int] = frozenset()
    arcs: list[Arc] = field(default_factory=list)
    lowest_top: float = np.inf
    _between: dict[tuple[int, int], list[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        edges = np.roll(self.points, -1, axis=0) - self.points
        self.ways = edges / hypot(*edges.T)[:, None]
        self.normals = np.column_stack([-self.ways[:, 1], self.ways[:, 0]])
        before = np.roll(self.ways, 1, axis=0)
        self.turns = atan2(before[:, 0] * self.ways[:, 1] - before[:, 1] * self.ways[:, 0],
                           (before * self.ways).sum(axis=1))
        self.lines = (self.normals * self.points).sum(axis=1)
        self.speeds = np.array([float(i not in self.gables) for i in range(len(edges))])
        alike = ((np.abs(self.normals[:, None] - self.normals) < _STILL).all(axis=2)
                 & (np.abs(self.lines[:, None] - self.lines) < _SAME)
                 & (self.speeds[:, None] == self.speeds))
        self.plane = np.argmax(alike, axis=1)
        self.edges = self._joined(list(range(len(edges))))
        time, loops = 0.0, [self.edges]
        for _ in range(2 * len(edges)):  # each change takes an edge away, or cuts a polygon in two
            after = time + min(self._next(loop, time) for loop in loops)
            for loop in loops:
                self._sweep(loop, time, after)
            loops = [part for loop in loops for part in self._cut(loop, after)]
            time = after
            if not loops:
                break
        ends = np.roll(self.points, -1, axis=0)
        whole = 0.5 * (self.points[:, 0] * ends[:, 1] - self.points[:, 1] * ends[:, 0]).sum()
        covered = sum(0.5 * (strip.end - strip.start) * (sum(strip.head) - sum(strip.foot))
                      for plane in set(self.plane[self.eaves].tolist())
                      for strip in self.strips(plane, 0.0))
        if loops or abs(covered - whole) > _LOST * whole:
            raise NoRoofError

    @property
    def eaves(self) -> list[int]:
        """Return the edges without gables."""
        return [edge for edge in range(len(self.points)) if edge not in self.gables]

    def local(self, edge: int, places: np.ndarray) -> np.ndarray:
        """Return places along an edge from its start, and at right angles inwards [m], (…, 2)."""
        away = places - self.points[edge]
        return np.stack([(away * self.ways[edge]).sum(axis=-1),
                         (away * self.normals[edge]).sum(axis=-1)], axis=-1)

    def strips(self, plane: int, overhang: float) -> list[Strip]:
        """
        Divide a face into strips up the slope.

        Faces of straight skeletons have one foot and one head at each place along the eaves.

        :param plane: of the face.
        :param overhang: how far faces go on below the eaves [m].
        """
        lines = self._around(plane, overhang)
        places = np.unique(lines[:, :, 0])
        places = places[np.diff(places, prepend=-np.inf) > _SAME].tolist()
        found: list[Strip] = []
        for start, end in zip(places, places[1:]):
            middle = 0.5 * (start + end)
            (a, u), (b, v) = lines[(lines[:, 0, 0] < middle) & (lines[:, 1, 0] > middle)
                                   ].transpose(1, 2, 0)
            spans = sorted(np.column_stack([u + (place - a) * (v - u) / (b - a)
                                            for place in (start, end)]).tolist(), key=sum)
            if not spans or sum(spans[-1]) <= sum(spans[0]):
                continue
            foot, head = tuple(spans[0]), tuple(spans[-1])
            new = Strip(start, end, foot, head)
            if found and _in_line(found[-1], new):
                found[-1] = Strip(found[-1].start, end, (found[-1].foot[0], foot[1]),
                                  (found[-1].head[0], head[1]))
            else:
                found.append(new)
        return found

    def _around(self, plane: int, overhang: float) -> np.ndarray:
        """List the lines around a face, by places along its eaves and from them [m], (k, 2, 2)."""
        corners = dict(zip(self.edges, self.outline(self.edges, -overhang)[0]))
        lines = [[corners[edge], corners[after]]
                 for edge, after in zip(self.edges, self.edges[1:] + self.edges[:1])
                 if self.plane[edge] == plane and edge not in self.gables]
        lines += [[arc.start - (arc.low == 0.0) * overhang / arc.high * (arc.end - arc.start),
                   arc.end] for arc in self.arcs if plane in arc.planes]
        found = self.local(plane, np.array(lines)).round(9)
        return np.take_along_axis(found, np.argsort(found[:, :, :1], axis=1, kind='stable'), 1)

    def outline(self, loop: Sequence[int], time: float) -> tuple[np.ndarray, np.ndarray]:
        """
        Compute the corners of a moving polygon, where its edges begin.

        :param loop: its edges in order.
        :param time: distance that edges have moved by [m]; negative outwards.
        :returns: corners [m] and their motion per distance, (k, 2) each.
        """
        first, second = np.roll(loop, 1), np.asarray(loop)
        a, b = self.normals[first], self.normals[second]
        turn = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]

        def meet(p: np.ndarray, q: np.ndarray) -> np.ndarray:
            return np.column_stack([p * b[:, 1] - q * a[:, 1], q * a[:, 0] - p * b[:, 0]]
                                   ) / turn[:, None]

        motion = meet(self.speeds[first], self.speeds[second])
        return meet(self.lines[first], self.lines[second]) + time * motion, motion

    def _joined(self, loop: list[int]) -> list[int]:
        """Drop edges in one line with the one before."""
        return [edge for before, edge in zip([loop[-1], *loop], loop)
                if self.plane[before] != self.plane[edge]]

    def _next(self, loop: list[int], time: float) -> float:
        """Compute how far a polygon can shrink before an edge vanishes or a corner meets one."""
        points, motion = self.outline(loop, time)
        ways, normals = self.ways[loop], self.normals[loop]
        ends = [((p * ways).sum(axis=1), (m * ways).sum(axis=1)) for p, m in (
            (points, motion), (np.roll(points, -1, axis=0), np.roll(motion, -1, axis=0)))]
        (start, before), (end, after) = ends  # of edges, along them, and their motion
        shrinks = after - before < -_STILL
        steps = ((end - start)[shrinks] / (before - after)[shrinks]).tolist()
        inward = np.flatnonzero(np.roll(ways, 1, axis=0)[:, 0] * ways[:, 1]
                                < np.roll(ways, 1, axis=0)[:, 1] * ways[:, 0] - _STILL)
        away = (_products(points[inward], normals) - self.lines[loop]
                - self.speeds[loop] * time)
        closing = self.speeds[loop] - _products(motion[inward], normals)
        step = away / np.where(closing > _STILL, closing, 1.0)
        place = _products(points[inward], ways) + step * _products(motion[inward], ways)
        meets = ((closing > _STILL) & (away > -_SAME) & (place > start + step * before - _SAME)
                 & (place < end + step * after + _SAME))
        meets[np.arange(len(inward))[:, None], np.column_stack([inward - 1, inward])] = False
        steps += step[meets].tolist()
        if not steps:
            raise NoRoofError
        return max(min(steps), 0.0)

    def _sweep(self, loop: list[int], low: float, high: float) -> None:
        """Add the ways of the corners of a polygon to the lines between faces."""
        points, motion = self.outline(loop, low)
        later = points + (high - low) * motion
        for k, edge in enumerate(loop):
            if self.gables.isdisjoint((edge, loop[k - 1])):
                a, b = self.ways[loop[k - 1]], self.ways[edge]
                self._extend(Arc(
                    points[k], later[k], low, high, bool(a[0] * b[1] - a[1] * b[0] < 0.0),
                    (int(self.plane[loop[k - 1]]), int(self.plane[edge]))))

    def _extend(self, new: Arc) -> None:
        """Add a line between two planes, or go on with one that ends where it begins."""
        for i in self._between.setdefault(new.planes, []):
            old = self.arcs[i]
            if old.high == new.low and (np.abs(old.end - new.start) < _SAME).all():
                self.arcs[i] = old._replace(end=new.end, high=new.high)
                return
        self._between[new.planes].append(len(self.arcs))
        self.arcs.append(new)

    def _cut(self, loop: list[int], time: float) -> list[list[int]]:
        """Cut a polygon where it touches itself; what has no area is gone, or is a ridge."""
        places, edges = self._walk(np.asarray(loop), self.outline(loop, time)[0])
        same = (np.abs(places[:, None] - places) < _SAME).all(axis=2)
        path: list[tuple[int, int]] = []
        parts = []
        for node, edge in zip(np.argmax(same, axis=1).tolist(), edges.tolist()):
            been = [step[0] for step in path]
            if node in been:
                parts.append(path[been.index(node):])
                del path[been.index(node):]
            path.append((node, edge))
        parts.append(path)
        self.arcs += [Arc(places[part[0][0]], places[part[1][0]], time, time, False,
                          (int(self.plane[part[0][1]]), int(self.plane[part[1][1]])))
                      for part in parts if len(part) == 2]
        rest = [self._joined([edge for _, edge in part]) for part in parts if len(part) > 2]
        rest = [part for part in rest if len(part) > 2]
        if not rest or any(len(part) == 2 for part in parts):
            self.lowest_top = min(self.lowest_top, time)
        return rest

    def _walk(self, loop: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """List places along a polygon, (m, 2), and the edges that go on from there, (m,)."""
        along, aside = (_products(points, axis[loop]).T for axis in (self.ways, self.normals))
        along, aside = (side - np.diagonal(side)[:, None] for side in (along, aside))
        corners = np.arange(len(loop))
        end = along[corners, (corners + 1) % len(loop), None]
        on, place = np.nonzero((np.abs(aside) < _SAME) & (along > _SAME) & (along < end - _SAME))
        edge = np.concatenate([corners, on])
        order = np.lexsort((np.concatenate([0.0 * corners, along[on, place]]), edge))
        return points[np.concatenate([corners, place])[order]], loop[edge[order]]


def _in_line(strip: Strip, after: Strip) -> bool:
    """Return whether one strip goes on as another one."""
    ends = np.array([[s.foot, s.head] for s in (strip, after)])
    rise = (ends[..., 1] - ends[..., 0]) / np.array([[s.end - s.start] for s in (strip, after)])
    return bool(strip.end == after.start and np.abs(rise[0] - rise[1]).max() < _SAME
                and np.abs(ends[0, :, 1] - ends[1, :, 0]).max() < _SAME)


def _products(points: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Compute the products of all vectors with all others, (n, 2) and (m, 2), (n, m)."""
    return points[:, :1] * ways[:, 0] + points[:, 1:] * ways[:, 1]
