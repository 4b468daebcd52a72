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

"""Stems: plans like L, T, U and H, divided into a bar and stems at right angles to it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from procphys_ros.language import Place
from procphys_ros.wallgrammar.boxes import from_cells, Joint, MICRO
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.footprint import Facade, Footprint
from procphys_ros.wallgrammar.plan import along_facade
from procphys_ros.wallgrammar.valley_slopes import least_step
from procphys_ros.wallgrammar.walls import Elevation

_NARROWEST = 1_200_000  # [µm] least width and length of a stem with a roof
_NEAREST = 600_000    # [µm] between stems and corners of the bar: room for eaves and a rafter
_EQUAL = 2_000        # [µm] by which widths that count as equal may differ
_BEARING = 250_000    # [µm] of girders on the walls
_SLENDER = 10         # span over height of girders, a joiner's rule for beams that carry a roof
_LEAST_JOINT = 1_000  # [µm] between girders and the ends of walls beside them, also of dry walls
_PAD = 2              # courses of the concrete padstones that spread their load
_PIECE = 1_500_000    # [µm] girders splinter into pieces of at most this length


class Stem(NamedTuple):
    """
    A rectangle that joins the bar at one of its long sides, in the first frame [µm].

    :ivar low, high: its sides, along the bar.
    :ivar mouth: the long side of the bar that it joins, across.
    :ivar end: its gable, across.
    """

    low: int
    high: int
    mouth: int
    end: int

    @property
    def upwards(self) -> bool:
        """Return whether it leaves the bar towards larger coordinates."""
        return self.end > self.mouth


class Division(NamedTuple):
    """
    A plan as a bar and its stems, in the first frame.

    :ivar axis: along which the bar runs.
    :ivar low, high: corners of the bar [µm], (2,).
    :ivar stems: may be empty.
    """

    axis: int
    low: np.ndarray
    high: np.ndarray
    stems: tuple[Stem, ...]


def divide(plan: Footprint, pitch: float, place: Place) -> Division:
    """
    Divide a plan into bar and stems; the bar runs along its first edge if possible, else across.

    :param plan: right-angled.
    :param pitch: of the roof [degrees].
    :param place: of the roof in its text.
    :raises GrammarError: for plans that cannot be divided, or leave roofs no room.
    """
    first = plan.facades[0].quarter % 2
    found = [division for axis in (first, 1 - first)
             if (division := _along(plan, axis)) is not None]
    if not found:
        raise place.error(
            f'a gable roof needs a rectangle, or a bar with narrower wings at right angles (L, T, '
            f'U, H), found {len(plan.facades)} corners; use flat or none')
    problems = [_problem(division, float(np.radians(pitch))) for division in found]
    for division, problem in zip(found, problems):
        if problem is None:
            return division
    raise place.error(str(problems[0]))


def _along(plan: Footprint, axis: int) -> Division | None:
    """Divide a plan with its bar along an axis; None if that is impossible."""
    across = 1 - axis
    first, last = plan.corners[:, axis].min(), plan.corners[:, axis].max()
    lines = np.unique(plan.corners[:, across])
    slabs = [_stretches(plan, axis, 0.5 * float(a + b)) for a, b in zip(lines, lines[1:])]
    whole = [slab == [(first, last)] for slab in slabs]
    if not any(whole):
        return None
    low, high = whole.index(True), len(whole) - whole[::-1].index(True)
    if not all(whole[low:high]):
        return None
    stems = []
    for mouth, step, beyond in ((low, -1, list(range(low - 1, -1, -1))),
                                (high, 1, list(range(high, len(slabs))))):
        if any(not set(slabs[k]) <= set(slabs[k - step]) for k in beyond[1:]):
            return None
        for stretch in slabs[beyond[0]] if beyond else ():
            end = mouth + step * sum(stretch in slabs[k] for k in beyond)
            stems.append(Stem(*stretch, int(lines[mouth]), int(lines[end])))
    corners = np.zeros((2, 2), np.int64)
    corners[:, axis], corners[:, across] = (first, last), (lines[low], lines[high])
    return Division(axis, corners[0], corners[1], tuple(sorted(stems)))


def _stretches(plan: Footprint, axis: int, level: float) -> list[tuple[int, int]]:
    """List the stretches of a line along an axis that lie inside a plan [µm]."""
    crossed = []
    for facade in plan.facades:
        start = facade.origin[1 - axis]
        end = start + (facade.length if facade.quarter < 2 else -facade.length)
        if facade.quarter % 2 != axis and min(start, end) < level < max(start, end):
            crossed.append(facade.origin[axis])
    crossed.sort()
    return list(zip(crossed[0::2], crossed[1::2]))


def _problem(division: Division, pitch: float) -> str | None:
    """Describe why the roofs of a plan have no room; None if they have."""
    axis, across = division.axis, 1 - division.axis
    depth = int(division.high[across] - division.low[across])
    step = least_step(0.5 * depth / MICRO, pitch)
    for stem in division.stems:
        width = stem.high - stem.low
        least = min(width, abs(stem.end - stem.mouth))
        if least < _NARROWEST:
            return (f'the wing from {stem.low / MICRO:g} to {stem.high / MICRO:g} m is too small '
                    f'for a gable roof, {least / MICRO:g} m; at least {_NARROWEST / MICRO:g} m '
                    f'are needed')
        if width > depth + _EQUAL or _EQUAL < depth - width < step * MICRO:
            return (f'the wing from {stem.low / MICRO:g} to {stem.high / MICRO:g} m is '
                    f'{width / MICRO:g} m wide, the bar that it joins {depth / MICRO:g} m: under '
                    f'a gable roof it must be as wide, or at least {step:.2f} m narrower')
        edges = [int(division.low[axis]), int(division.high[axis])]
        edges += [edge for other in division.stems
                  if other is not stem and other.mouth == stem.mouth for edge in other[:2]]
        rooms = [room for room in [*(stem.low - e for e in edges), *(e - stem.high for e in edges)]
                 if 0 < room < _NEAREST]
        if rooms:
            return (f'a wing stands {min(rooms) / MICRO:g} m beside a corner or another wing: '
                    f'under a gable roof let it start at the corner, or at least '
                    f'{_NEAREST / MICRO:g} m away')
    return None


def stretch_of(facade: Facade, axis: int, place: int, low: int,
               high: int) -> tuple[int, int] | None:
    """
    Find a stretch of the plan on a facade.

    :param axis: along which the stretch runs.
    :param place: of the stretch across.
    :param low, high: its ends [µm].
    :returns: its ends in the facade's own x, or None if it is not on it.
    """
    if facade.quarter % 2 != axis or facade.origin[1 - axis] != place:
        return None
    start, end = along_facade(facade, low, high)
    return (start, end) if start >= 0 and end <= facade.length else None


def bridge(site: Site, division: Division, walls: Sequence[Elevation],
           inner: Sequence[Elevation], level: int) -> None:
    """
    Lay a girder over the mouth of each stem, which carries the eaves of the bar there.

    :param site: takes the parts.
    :param walls: of the facades; pockets are cut into them.
    :param inner: of the partitions, likewise.
    :param level: upper side of the walls [µm].
    :raises GrammarError: where an opening is in the way.
    """
    layout = walls[0].layout
    thickness, gauge = layout.thickness, layout.gauge
    axis = division.axis
    for stem in division.stems:
        wanted = max((stem.high - stem.low) // _SLENDER, 2 * gauge)
        bottom = (level - wanted) // gauge * gauge
        under = bottom - _PAD * gauge
        if under < gauge:
            raise site.place.error(
                f'over the mouth of a wing {(stem.high - stem.low) / MICRO:g} m wide lies a '
                f'girder that needs {(level - under + gauge) / MICRO:.3f} m of wall below the '
                f'roof, found {level / MICRO:g} m')
        out = -1 if stem.upwards else 1
        sides = sorted((stem.mouth, stem.mouth + out * thickness))
        ends, holes = _bearings(division, stem, walls, sides)
        holes += _through(inner, axis, sides, ends)
        for wall, (left, right) in holes:
            met = wall.obstacle(left, under, right, level)
            if met:
                raise site.place.error(
                    f'the girder that carries the roof over the mouth of a wing meets the panel '
                    f'"{met}" at {bottom / MICRO:g} m; leave wall there')
            wall.cut(left, under, right, level)
        pads = [sorted((edge, inside)) for edge, inside in zip(
            ends, (stem.low + thickness, stem.high - thickness))]
        for (start, end), (foot, top), kind, material, joint in (
                *((pad, (under, bottom), 'padstone', 'concrete', Joint.MORTAR) for pad in pads),
                (ends, (bottom, level), 'girder', 'timber', Joint.BEARING)):
            low, high = np.zeros(3, int), np.zeros(3, int)
            low[axis], high[axis] = start, end
            low[1 - axis], high[1 - axis] = sides
            low[2], high[2] = foot, top
            site.add(from_cells(low, high, [0, 0, layout.joint], 0, axis=axis, joint=joint,
                                kind=site.kind(kind), material=site.material(material)), _PIECE)


def _bearings(division: Division, stem: Stem, walls: Sequence[Elevation], sides: Sequence[int]
              ) -> tuple[list[int], list[tuple[Elevation, tuple[int, int]]]]:
    """Find the ends of a girder along the bar, and the stretches of walls that it lies in."""
    axis = division.axis
    joint = max(walls[0].layout.joint, _LEAST_JOINT) * (1 if stem.upwards else -1)
    near = sorted((stem.mouth, stem.mouth + joint))
    ends, holes = [stem.low, stem.high], []
    for k, (edge, out) in enumerate(((stem.low, -1), (stem.high, 1))):
        for wall in walls:
            beside = sorted((edge, edge + out * _BEARING))
            found = stretch_of(wall.facade, axis, stem.mouth, *beside)
            if found is not None:
                ends[k] = edge + out * _BEARING
                holes.append((wall, found))
            found = stretch_of(wall.facade, 1 - axis, edge, *sides)
            if found is not None:
                holes.append((wall, found))
            found = stretch_of(wall.facade, 1 - axis, edge, *near)
            if found is not None and 0 in (found[0], wall.facade.length - found[1]):
                holes.append((wall, found))  # the corner's end, which the girder passes
    return ends, holes


def _through(inner: Sequence[Elevation], axis: int, sides: Sequence[int],
             ends: Sequence[int]) -> list[tuple[Elevation, tuple[int, int]]]:
    """List the partitions that a girder passes through, with their stretches."""
    box = np.zeros((2, 2), np.int64)
    box[:, axis], box[:, 1 - axis] = ends, sides
    found = []
    for wall in inner:
        facade, run = wall.facade, wall.facade.quarter % 2
        # Along x a partition lies above its origin, along y below it.
        face = facade.origin[1 - run] - (wall.layout.thickness if run else 0)
        left, right = along_facade(facade, int(box[0, run]), int(box[1, run]))
        left, right = max(left, 0), min(right, facade.length)
        if left < right and face < box[1, 1 - run] and face + wall.layout.thickness > (
                box[0, 1 - run]):
            found.append((wall, (left, right)))
    return found
