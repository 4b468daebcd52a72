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

"""Spires: pyramids of masonry over convex plans, course by course, hollow up to their tops."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procphys_ros.elementary import acos, atan2, cos, hypot, sin, tan
from procphys_ros.geometry.linear import product, solve
from procphys_ros.language import Place
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.boxes import MICRO
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.footprint import Footprint

STONE = 'spire'
_SHARPEST = 75.0   # [degrees] smallest angle of the plan at which courses bond around corners
_SHAFT = 0.4       # of the thickness: half the width of the hollow below which a course is solid
_NEAR_END = 0.35   # of a unit: no joint stands nearer to a corner
_BLUNT = acos(0.5 * (np.sqrt(5.0) - 1.0))  # [rad] turn below which tan is less than 1 / sin
_MOST_SECTORS = 8  # corners of solid courses, whose stones fill two sectors each
_LEAST_CAP = 0.1   # [m] width of the cap: stones under a smaller one would have no beds
_ALIKE = 1e-5      # [rad] tolerance of equal angles between corners in whole micrometres
_LEAST_LAP = 0.5   # of the thickness: overlap of each course with the one below


@dataclass(frozen=True)
class Pyramid:
    """
    A pyramid with its apex over the middle of a convex plan.

    :ivar middle: of the plan [m], (2,).
    :ivar normals: outwards, of the edges in plan, (n, 2).
    :ivar reach: distance of the edges from the middle [m], (n,).
    :ivar height: [m].
    :ivar shell: thickness, measured level [m].
    """

    middle: np.ndarray
    normals: np.ndarray
    reach: np.ndarray
    height: float
    shell: float

    def line(self, edge: int, level: float, inwards: float) -> tuple[np.ndarray, float]:
        """Return a line along an edge at some height: normal and distance from the middle [m]."""
        edge %= len(self.reach)
        share = 1.0 - level / self.height
        return self.normals[edge], float(self.reach[edge] * share - inwards)

    def outline(self, level: float) -> np.ndarray:
        """Compute the corners at some height, each the start of an edge [m], (n, 2)."""
        return np.array([_cross(self.line(i - 1, level, 0.0), self.line(i, level, 0.0))
                         for i in range(len(self.reach))])

    @cached_property
    def turns(self) -> np.ndarray:
        """Turn of the plan where each edge begins [rad], (n,)."""
        return acos((self.normals * np.roll(self.normals, 1, axis=0)).sum(axis=1))

    def corners(self, most: int) -> np.ndarray:
        """Choose at most `most` corners, evenly around the middle; return ascending indices."""
        outline = self.outline(0.0)
        if len(outline) <= most:
            return np.arange(len(outline))
        angle = atan2(*outline.T[::-1]) - atan2(*outline[0, ::-1])
        aside = angle[:, None] - 2.0 * np.pi * np.arange(most) / most
        aside = np.abs((aside + np.pi) % (2.0 * np.pi) - np.pi)
        return np.unique(np.argmax(aside < aside.min(axis=0) + _ALIKE, axis=0))  # the first

    def is_solid(self, level: float) -> bool:
        """Return whether a course that ends at a height leaves no hollow, or no room for sides."""
        share = 1.0 - level / self.height
        sides = np.roll(self.outline(0.0), -1, axis=0) - self.outline(0.0)
        taken = self.shell * np.where(self.turns < _BLUNT, tan(self.turns), 1.0 / sin(self.turns))
        room = np.minimum(self.reach * share - self.shell,
                          hypot(*sides.T) * share - np.maximum(taken, np.roll(taken, -1)))
        return bool(room.min() < _SHAFT * self.shell)

    def end(self, edge: int, corner: int, level: float, owning: bool,
            gap: float) -> tuple[np.ndarray, float]:
        """
        Return the line where the stones along an edge end at some height.

        At sharp corners one side runs up to the face of its neighbour, which ends inside of it.
        At blunt ones both end where one is cut off square.

        :param corner: edge that begins at the corner.
        :param owning: whether the side fills the corner.
        :param gap: joint between the sides [m].
        """
        other = corner - 1 if corner == edge else corner
        if self.turns[corner % len(self.turns)] >= _BLUNT:
            return self.line(other, level, 0.0 if owning else self.shell + gap)
        normal = self.normals[(edge if owning else other) % len(self.normals)]
        along = np.array([-normal[1], normal[0]])
        point = _cross(self.line(corner - 1, level, 0.0), self.line(corner, level, 0.0))
        back = 0.0 if owning else gap
        return along, float((along * point).sum() + (back if corner == edge else -back))


def build(site: Site, plan: Footprint, layout: Layout, base: int, pitch: float,
          place: Place) -> None:
    """
    Build a spire on the walls.

    :param site: takes the stones.
    :param plan: convex; walls as thick as the layout bear the spire.
    :param layout: of the walls.
    :param base: level of their tops [µm].
    :param pitch: of the faces nearest to the middle [degrees].
    :param place: of the roof in its text.
    :raises GrammarError: for plans and pitches that do not suit a spire.
    """
    pyramid = _pyramid(plan, layout, np.radians(pitch), place)
    gauge, joint = layout.gauge / MICRO, layout.joint / MICRO
    if gauge / tan(np.radians(pitch)) > _LEAST_LAP * pyramid.shell:
        raise place.error(f'courses of {gauge:g} m in a spire of {pitch:g} degrees rest on less '
                          f'than half the wall, {pyramid.shell:g} m; make it steeper, the courses '
                          f'lower or the wall thicker')
    # A single stone ends the spire, from the last level where it is as wide as the wall is thick.
    thin = pyramid.height * (1.0 - 0.5 * max(pyramid.shell, _LEAST_CAP) / pyramid.reach.min())
    levels = np.arange(0.0, max(thin, 1.5 * gauge), gauge)
    tops = np.append(levels[1:], pyramid.height)
    faces = float(hypot(*(np.roll(pyramid.outline(0.0), -1, 0) - pyramid.outline(0.0)).T).sum())
    site.expect(0.5 * len(levels) * faces * MICRO / layout.pitch)
    stones = [stone for k, (low, high) in enumerate(zip(levels[:-1].tolist(), tops.tolist()))
              for stone in _course(pyramid, layout, k, low + joint, high)]
    cap = pyramid.corners(4)
    stones.append(_prism(pyramid.outline(levels[-1] + joint)[cap],
                         pyramid.outline(pyramid.height)[cap], levels[-1] + joint, pyramid.height))
    corners = np.array(stones) + np.array([*pyramid.middle, base / MICRO])
    yaw = plan.yaws[0]
    turn = np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])
    corners[..., :2] = product(corners[..., :2], turn)  # from the building into the first frame
    site.add(site.hexahedra(corners, site.kind(STONE), layout.material))


def _pyramid(plan: Footprint, layout: Layout, pitch: float, place: Place) -> Pyramid:
    points = plan.points
    edges = np.roll(points, -1, axis=0) - points
    turns = np.roll(atan2(*edges.T[::-1]), -1) - atan2(*edges.T[::-1])
    turns = (turns + np.pi) % (2.0 * np.pi) - np.pi
    if len(points) < 3 or turns.min() < 0.02 or np.degrees(np.pi - turns.max()) < _SHARPEST:
        raise place.error(f'a spire needs a convex plan with angles from {_SHARPEST:g} to 178 '
                          'degrees; use another roof here')
    following = np.roll(points, -1, axis=0)
    cross = points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]
    middle = ((points + following) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum())
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / hypot(*edges.T)[:, None]
    reach = ((points - middle) * normals).sum(axis=1)
    shell = layout.thickness / MICRO
    if reach.min() < 1.5 * shell:
        raise place.error(f'a spire over walls of {shell:g} m needs at least {3 * shell:g} m from '
                          f'side to side, found {2 * reach.min():g} m')
    return Pyramid(middle, normals, reach, float(reach.min() * tan(pitch)), shell)


def _course(pyramid: Pyramid, layout: Layout, number: int, low: float,
            high: float) -> list[np.ndarray]:
    """Compute the corners of the stones of a course between two levels [m], (8, 3) each."""
    if pyramid.is_solid(high):
        chosen = pyramid.corners(_MOST_SECTORS)
        bottom, top = pyramid.outline(low)[chosen], pyramid.outline(high)[chosen]
        count = len(bottom)
        if count == 4:
            return [_prism(bottom, top, low, high)]
        first = number % 2
        stones = []
        for i in range(first, first + count, 2):
            rows = [i % count, (i + 1) % count, (i + 2 if i + 2 <= first + count else i + 1)
                    % count]
            inner, outer = (np.concatenate([np.zeros((1, 2)), ring[rows]])
                            for ring in (bottom, top))
            stones.append(_prism(inner, outer, low, high))
        return stones
    return [stone for edge in range(len(pyramid.reach))
            for stone in _side(pyramid, layout, number, edge, low, high)]


def _side(pyramid: Pyramid, layout: Layout, number: int, edge: int, low: float,
          high: float) -> list[np.ndarray]:
    """Compute the stones along one side; the sides fill the corners in alternate courses."""
    joint, pitch = layout.joint / MICRO, layout.pitch / MICRO
    ends = [[pyramid.end(edge, corner, level, owning, joint) for level in (low, high)]
            for corner, owning in ((edge, number % 2 == 0), (edge + 1, number % 2 == 1))]
    faces = [[pyramid.line(edge, level, depth) for level in (low, high)]
             for depth in (0.0, pyramid.shell)]
    # Corners of the side, by end, face and level.
    corners = np.array([[[_cross(face[k], end[k]) for k in (0, 1)] for face in faces]
                        for end in ends])
    normal = pyramid.normals[edge]
    along = np.array([-normal[1], normal[0]])
    reach = product(corners, along)
    first, last = reach[0].max() + _NEAR_END * pitch, reach[1].min() - _NEAR_END * pitch
    shift = 0.5 * (number // 2 % 2)  # in pairs of courses, for the corners move every other
    shift += 0.25 * (number % 2)
    cuts = (np.arange(np.ceil(first / pitch - shift), np.floor(last / pitch - shift) + 1)
            + shift) * pitch
    lines = [corners[0]]
    for x in cuts.tolist():
        for side in (-0.5, 0.5):
            lines.append(np.array([[_cross(face[k], (along, x + side * joint)) for k in (0, 1)]
                                   for face in faces]))
    lines.append(corners[1])
    stones = []
    for start, end in zip(lines[::2], lines[1::2]):
        bottom, top = (np.array([start[0, k], end[0, k], end[1, k], start[1, k]]) for k in (0, 1))
        stones.append(_prism(bottom, top, low, high))
    return stones


def _cross(line: tuple[np.ndarray, float], other: tuple[np.ndarray, float]) -> np.ndarray:
    return solve(np.array([line[0], other[0]]), np.array([line[1], other[1]]))


def _prism(bottom: np.ndarray, top: np.ndarray, low: float, high: float) -> np.ndarray:
    """Compute the corners of a solid between two counter-clockwise outlines, (4, 2) each."""
    order = [0, 1, 3, 2]
    return np.concatenate([np.column_stack([outline[order], np.full(4, level)])
                           for outline, level in ((bottom, low), (top, high))])
