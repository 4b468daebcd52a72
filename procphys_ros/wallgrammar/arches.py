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

"""Arches: division of rings into voussoirs, and the outlines that the wall keeps clear of."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from procphys_ros.elementary import acos, asin, cos, hypot, sin
from procphys_ros.geometry.linear import product, solve

SHAPES = {'round': 0, 'segmental': 1, 'pointed': 0, 'flat': 0}  # number of parameters of each
_SKEW = np.sqrt(0.75)  # height over span of the triangle at whose apex joints of flat arches meet
_SHALLOWEST = 0.02  # of the span: least rise of a segmental arch
_MOST = 400  # in a ring at most
_TAPER = 0.3  # of a joint: largest increase of its thickness along a brick


class Line(NamedTuple):
    """
    Joint line between two voussoirs.

    :ivar inner, outer: ends at the intrados and the extrados [m], (2,).
    """

    inner: np.ndarray
    outer: np.ndarray


@dataclass(frozen=True)
class Curve:
    """
    Intrados of an arch: arcs of a circle, or a level line.

    Origin halfway between the springings, x along the wall, y up.

    :ivar shape: one of `SHAPES`.
    :ivar span: between the springings [m].
    :ivar rise: of the intrados [m].
    """

    shape: str
    span: float
    rise: float

    @classmethod
    def of(cls, shape: str, span: float, numbers: tuple[float, ...]) -> 'Curve':
        """
        Make the curve of an arch, with its rise.

        :param numbers: the rise of a segmental arch [m].
        :raises ValueError: for a rise out of range; the message names the range.
        """
        rise = {'round': 0.5 * span, 'pointed': _SKEW * span, 'flat': 0.0}.get(shape)
        if rise is None:
            rise, = numbers
            low, high = _SHALLOWEST * span, 0.5 * span
            if not low <= rise <= high:
                raise ValueError(f'the rise of a segmental arch of {span:g} m span must be from '
                                 f'{low:.3g} to {high:.3g} m, found {rise:g} m')
        return cls(shape, span, rise)

    def ring(self, offset: float, depth: float, pitch: float) -> list[Line]:
        """
        Divide a ring into voussoirs that are nowhere wider than the pitch.

        :param offset: of its inside from the intrados [m].
        :param depth: from its inside to its outside [m].
        :param pitch: largest width of a voussoir with its joint [m].
        :returns: lines between the voussoirs, from the left springing to the right one.
        """
        outside = offset + depth
        if self.shape == 'flat':
            tip = _SKEW * self.span
            whole = self.span * (tip + outside) / tip
            at = np.linspace(-0.5, 0.5, _odd(whole / pitch) + 1) * self.span
            return [Line(np.array([x * (tip + offset) / tip, offset]),
                         np.array([x * (tip + outside) / tip, outside])) for x in at]
        centre, radius, half = self._arc()
        if self.shape == 'pointed':
            return self._pointed(radius + offset, radius + outside, pitch)
        count = _odd(2.0 * half * (radius + outside) / pitch)
        turn = np.linspace(-half, half, count + 1)
        way = np.column_stack([sin(turn), cos(turn)])
        return [Line(centre + (radius + offset) * w, centre + (radius + outside) * w)
                for w in way]

    def rings(self, count: int, depth: float, joint: float, pitch: float) -> list[list[Line]]:
        """
        Divide rings over each other, so that none reaches into the next.

        The flat undersides of wide voussoirs lie inside their circle: where the sagitta exceeds
        the joint, the ring moves out.

        :param count: of rings.
        :param depth: of each [m].
        :param joint: between them [m].
        :param pitch: see `ring`.
        """
        found: list[list[Line]] = []
        offset = 0.0
        for _ in range(count):
            lines = self.ring(offset, depth, pitch)
            if found:
                inside = self._sagitta(lines, offset) - joint
                if inside > 0.0:
                    offset += inside
                    lines = self.ring(offset, depth, pitch)
            found.append(lines)
            offset += depth + joint
        return found

    def _sagitta(self, lines: list[Line], offset: float) -> float:
        """Compute the sagitta of the widest voussoir's underside in a ring [m]."""
        if self.shape == 'flat':
            return 0.0
        radius = self._arc()[1] + offset
        half = 0.5 * max(float(hypot(*(b.inner - a.inner))) for a, b in zip(lines, lines[1:]))
        return float(radius - np.sqrt(radius * radius - half * half))

    def _arc(self) -> tuple[np.ndarray, float, float]:
        """Return centre [m], radius [m] and half angle [rad] of a circular arch."""
        radius = (0.25 * (self.span * self.span) + self.rise * self.rise) / (2.0 * self.rise)
        if self.shape == 'pointed':
            radius = self.span
        half = asin(min(0.5 * self.span / radius, 1.0))
        return np.array([0.0, self.rise - radius]), radius, float(half)

    def _pointed(self, inner: float, outer: float, pitch: float) -> list[Line]:
        """Divide the two arcs of a pointed arch, which meet in a vertical joint at the apex."""
        reach = acos(0.5 * self.span / inner)
        count = max(int(np.ceil(outer * acos(0.5 * self.span / outer) / pitch)), 2)
        turn = np.linspace(0.0, reach, count + 1)[:-1]
        way = np.column_stack([-cos(turn), sin(turn)])
        centre = np.array([0.5 * self.span, 0.0])
        left = [Line(centre + inner * w, centre + outer * w) for w in way]
        half = 0.5 * self.span
        top = [np.array([0.0, np.sqrt(r * r - half * half)]) for r in (inner, outer)]
        mirror = np.array([-1.0, 1.0])
        return [*left, Line(*top),
                *(Line(line.inner * mirror, line.outer * mirror) for line in reversed(left))]


def _odd(count: float) -> int:
    """Round up to an odd number, so that there is a keystone."""
    whole = max(int(np.ceil(count - 1e-9)), 3)
    return whole + (whole + 1) % 2


def too_many(curve: Curve, depth: float, pitch: float) -> bool:
    """Return whether a ring would have more voussoirs than `_MOST`."""
    return bool(np.pi * (curve.span + 2.0 * depth) > _MOST * pitch)


def voussoirs(lines: list[Line], joint: float) -> np.ndarray:
    """
    Cut the voussoirs of a ring, their sides half a joint from the lines, (n, 4, 2).

    :param lines: of the ring, see `Curve.ring`.
    :param joint: [m].
    :returns: corners: inner left, inner right, outer right, outer left: clockwise seen from the
        middle of the arch, counter-clockwise seen from outside the wall.
    """
    out = []
    for left, right in zip(lines, lines[1:]):
        sides = [(line.inner, line.outer - line.inner) for line in (left, right)]
        moved = []
        for (start, way), sign in zip(sides, (1.0, -1.0)):
            across = sign * np.array([way[1], -way[0]]) / hypot(*way)
            moved.append((start + 0.5 * joint * across, way))
        faces = [(left.inner, right.inner - left.inner), (left.outer, right.outer - left.outer)]
        out.append([_cross(*moved[0], *faces[0]), _cross(*moved[1], *faces[0]),
                    _cross(*moved[1], *faces[1]), _cross(*moved[0], *faces[1])])
    return np.array(out)


def _cross(point: np.ndarray, way: np.ndarray, other: np.ndarray,
           its_way: np.ndarray) -> np.ndarray:
    """Compute the intersection of two lines [m], (2,)."""
    share = solve(np.column_stack([way, -its_way]), other - point)[0]
    return point + share * way


def extrados(lines: list[Line], joint: float) -> np.ndarray:
    """
    Return the outline of the outermost ring and its skewbacks, which the wall keeps clear of.

    :param lines: of the outermost ring, and the inner ends of the first and last of the innermost.
    :returns: half planes whose intersection is the outline: a·x + b·y <= c, rows a b c, (n, 3).
    """
    points, rooms = _joined(np.array([line.outer for line in lines]), joint)
    return _half_planes([lines[0].inner, *points, lines[-1].inner],
                        [0.5 * joint, *(joint + room for room in rooms), 0.5 * joint,
                         0.5 * joint])


def intrados(lines: list[Line], joint: float) -> np.ndarray:
    """Return the outline of the infill of an arch as half planes, see `extrados`."""
    points, rooms = _joined(np.array([line.inner for line in lines]), joint)
    return _half_planes(list(points), [*(room - joint for room in rooms), 0.5 * joint])


def _joined(points: np.ndarray, joint: float) -> tuple[np.ndarray, list[float]]:
    """
    Merge sides of an outline, from the middle outwards, where a tapering joint allows it.

    :param points: of the outline, symmetric, (n, 2).
    :returns: the corners that are kept, and the outward shift of each side between them [m].
    """
    last = len(points) - 1
    start = last - (last - 1) // 2 if last % 2 else last // 2  # right end of the keystone, or apex
    kept = [start]
    if last % 2:
        while kept[0] < last and _bulge(points[last - kept[0] - 1:kept[0] + 2]) < _TAPER * joint:
            kept[0] += 1
    while kept[-1] < last:
        end = kept[-1] + 1
        while end < last and _bulge(points[kept[-1]:end + 2]) < _TAPER * joint:
            end += 1
        kept.append(end)
    rows = sorted({*kept, *(last - k for k in kept)})
    return points[rows], [0.5 * _bulge(points[a:b + 1]) for a, b in zip(rows, rows[1:])]


def _bulge(points: np.ndarray) -> float:
    """Compute the largest distance of points from the chord of the first and the last [m]."""
    way = points[-1] - points[0]
    off = product(points - points[0], np.array([-way[1], way[0]])) / hypot(*way)
    return float(np.abs(off).max())


def _half_planes(points: list[np.ndarray], rooms: list[float]) -> np.ndarray:
    """Convert a clockwise polygon into half planes, each moved outwards by its room [m]."""
    rows = []
    for a, b, room in zip(points, [*points[1:], points[0]], rooms):
        way = b - a
        if hypot(*way) < 1e-9:
            continue
        out = np.array([-way[1], way[0]]) / hypot(*way)
        rows.append([*out, float(product(out, a)) + room])
    return np.array(rows)
