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

from procphys_ros.elementary import hypot

EVERYWHERE = -1.0e3  # [m] where fields begin that reach out over the eaves
_SAME = 2e-6       # [m] points this near are one: plans are in whole micrometres
_STILL = 1e-9      # m of a vertex per m of its edges, that counts as none


class Edge(NamedTuple):
    """
    End of a field along the eaves: at + way · u, with u the distance from the eaves in plan.

    :ivar at: [m].
    :ivar way: 0 at gables; over right angles 1 or -1, towards the field or away from it.
    """

    at: float
    way: float

    def place(self, u: float) -> float:
        """Return the end at a distance from the eaves [m]."""
        return self.at + self.way * u


class Field(NamedTuple):
    """
    Trapezium in plan between two distances from the eaves, part of a face.

    :ivar low, high: these distances [m]; the lowest fields go on below the eaves.
    :ivar start, end: its ends along the eaves.
    """

    low: float
    high: float
    start: Edge
    end: Edge


class Arc(NamedTuple):
    """
    Line where two faces meet.

    :ivar start, end: in plan, the lower end first [m], (2,).
    :ivar low, high: their distances from the eaves [m]; the same at ridges.
    :ivar valley: whether water runs towards it.
    """

    start: np.ndarray
    end: np.ndarray
    low: float
    high: float
    valley: bool


@dataclass
class RoofPlan:
    """
    Faces of a roof whose eaves all lie at one level and whose faces all have one pitch.

    All edges but gables move inwards at one speed, as in Aichholzer and others (1995, J. UCS
    1(12)). What they sweep between two changes of the polygon are trapezia. All changes at one
    time are made at once: the shrunken polygon touches itself, and is cut where it does.

    :ivar points: corners, counter-clockwise [m], (n, 2).
    :ivar gables: edges that stand still.
    :ivar ways, normals: directions of the edges, and at right angles inwards, (n, 2).
    :ivar turns: sines of the turns at the corners, where edges begin, (n,).
    :ivar plane: first edge in the same line, (n,).
    :ivar edges: without those in one line with the one before.
    :ivar faces: fields by plane; along the eaves 0 is the start of the plane's first edge.
    :ivar arcs: lines between faces, without those at gables.
    """

    points: np.ndarray
    gables: frozenset[int] = frozenset()
    faces: dict[int, list[Field]] = field(default_factory=dict)
    arcs: list[Arc] = field(default_factory=list)

    def __post_init__(self) -> None:
        edges = np.roll(self.points, -1, axis=0) - self.points
        self.ways = edges / hypot(*edges.T)[:, None]
        self.normals = np.column_stack([-self.ways[:, 1], self.ways[:, 0]])
        before = np.roll(self.ways, 1, axis=0)
        self.turns = before[:, 0] * self.ways[:, 1] - before[:, 1] * self.ways[:, 0]
        self.lines = (self.normals * self.points).sum(axis=1)
        self.speeds = np.array([float(i not in self.gables) for i in range(len(edges))])
        alike = ((np.abs(self.normals[:, None] - self.normals) < _STILL).all(axis=2)
                 & (np.abs(self.lines[:, None] - self.lines) < _SAME)
                 & (self.speeds[:, None] == self.speeds))
        self.plane = np.argmax(alike, axis=1)
        self.edges = self._joined(list(range(len(edges))))
        time, loops = 0.0, [self.edges]
        while loops:
            after = time + min(self._next(loop, time) for loop in loops)
            for loop in loops:
                self._sweep(loop, time, after)
            loops = [part for loop in loops for part in self._cut(loop, after)]
            time = after

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
        length = ((np.roll(points, -1, axis=0) - points) * ways).sum(axis=1)
        rate = ((np.roll(motion, -1, axis=0) - motion) * ways).sum(axis=1)
        steps = (length / -np.where(rate < -_STILL, rate, -1.0))[rate < -_STILL].tolist()
        before = np.roll(ways, 1, axis=0)
        inward = before[:, 0] * ways[:, 1] - before[:, 1] * ways[:, 0] < -_STILL
        for k in np.flatnonzero(inward).tolist():
            away = (normals * points[k]).sum(axis=1) - self.lines[loop] - self.speeds[loop] * time
            closing = self.speeds[loop] - (normals * motion[k]).sum(axis=1)
            step = away / np.where(closing > _STILL, closing, 1.0)
            there = points[k] + step[:, None] * motion[k]
            start = points + step[:, None] * motion
            end = np.roll(points, -1, axis=0) + step[:, None] * np.roll(motion, -1, axis=0)
            meets = (closing > _STILL) & (away > -_SAME)
            meets &= ((there - start) * ways).sum(axis=1) > -_SAME
            meets &= ((end - there) * ways).sum(axis=1) > -_SAME
            meets[[k - 1, k]] = False
            steps += step[meets].tolist()
        return max(min(steps), 0.0)

    def _sweep(self, loop: list[int], low: float, high: float) -> None:
        """Add what the edges of a polygon sweep to its faces, and the ways of its corners."""
        points, motion = self.outline(loop, low)
        later = points + (high - low) * motion
        for k, edge in enumerate(loop):
            plane, after = int(self.plane[edge]), (k + 1) % len(loop)
            if edge not in self.gables:
                way = self.ways[plane]
                start, end = (Edge(round(float(((points[i] - low * motion[i] - self.points[plane])
                                                * way).sum()), 9),
                                   round(float((motion[i] * way).sum()), 9)) for i in (k, after))
                self._add(plane, Field(low or EVERYWHERE, high, start, end))
            if self.gables.isdisjoint((edge, loop[k - 1])):
                a, b = self.ways[loop[k - 1]], self.ways[edge]
                self._extend(Arc(points[k], later[k], low, high,
                                 bool(a[0] * b[1] - a[1] * b[0] < 0.0)))

    def _add(self, plane: int, new: Field) -> None:
        """Add a field to a face, or go on with one below it whose ends are the same."""
        fields = self.faces.setdefault(plane, [])
        for i, old in enumerate(fields):
            if old.high == new.low and np.allclose([*old.start, *old.end],
                                                   [*new.start, *new.end], 0.0, _SAME):
                fields[i] = old._replace(high=new.high)
                return
        fields.append(new)

    def _extend(self, new: Arc) -> None:
        """Add a line, or go on with one that ends where it begins, in the same direction."""
        for i, old in enumerate(self.arcs):
            a, b = old.end - old.start, new.end - new.start
            if old.high == new.low > old.low and old.valley == new.valley and (
                    np.abs(old.end - new.start) < _SAME).all() and (
                    abs(a[0] * b[1] - a[1] * b[0]) < _SAME and (a * b).sum() > 0.0):
                self.arcs[i] = old._replace(end=new.end, high=new.high)
                return
        self.arcs.append(new)

    def _cut(self, loop: list[int], time: float) -> list[list[int]]:
        """Cut a polygon where it touches itself; what has no area is gone, or is a ridge."""
        points = self.outline(loop, time)[0]
        nodes: list[np.ndarray] = []
        path: list[tuple[int, int]] = []
        parts = []
        for place, edge in self._walk(loop, points):
            found = [n for n, node in enumerate(nodes) if (np.abs(node - place) < _SAME).all()]
            if not found:
                nodes.append(place)
            node = found[0] if found else len(nodes) - 1
            been = [k for k, step in enumerate(path) if step[0] == node]
            if been:
                parts.append(path[been[0]:])
                del path[been[0]:]
            path.append((node, edge))
        for part in (*parts, path):
            if len(part) == 2:
                self.arcs.append(Arc(nodes[part[0][0]], nodes[part[1][0]], time, time, False))
        rest = [self._joined([edge for _, edge in part]) for part in (*parts, path)
                if len(part) > 2]
        return [part for part in rest if len(part) > 2]

    def _walk(self, loop: list[int], points: np.ndarray) -> list[tuple[np.ndarray, int]]:
        """List places along a polygon with the edges that go on from there."""
        found = []
        for k, edge in enumerate(loop):
            found.append((points[k], edge))
            along = ((points - points[k]) * self.ways[edge]).sum(axis=1)
            aside = np.abs(((points - points[k]) * self.normals[edge]).sum(axis=1))
            end = along[(k + 1) % len(loop)]
            on = np.flatnonzero((aside < _SAME) & (along > _SAME) & (along < end - _SAME))
            found += [(points[i], edge) for i in on[np.argsort(along[on], kind='stable')]]
        return found
