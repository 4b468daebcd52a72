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

"""Floors: joists with boards, or slabs, that bear on the walls of every storey."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from procphys_ros.elementary import cos, sin
from procphys_ros.geometry.hexahedron import prisms
from procphys_ros.geometry.linear import product
from procphys_ros.language import Place
from procphys_ros.wallgrammar.boxes import (
    Boxes,
    from_cells,
    Joint,
    MICRO,
    SPAN,
)
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.contacts import spread
from procphys_ros.wallgrammar.footprint import Facade, Footprint
from procphys_ros.wallgrammar.plan import along_facade, Bay, bays, Rectangle, span_axis, trapezia
from procphys_ros.wallgrammar.regions import snap_level
from procphys_ros.wallgrammar.walls import Elevation

_Hole: TypeAlias = tuple[Elevation, int, int, int, int]  # left, bottom, right, top [µm]

_JOIST = (50_000, 150_000)  # [µm] width and least height
_SLENDER = 20               # span over height of joists, a joiner's rule
_SPACING = 450_000          # [µm] of joists, UK practice (NHBC 6.4)
_CLEAR = 110_000            # [µm] between a joist and the wall along it
_PACKING = 5_000            # [µm] of mortar on either side of a joist in its pocket
_JOIST_PIECE = 1_500_000    # [µm] joists splinter into pieces of at most this length
_BOARD = (200_000, 22_000)  # [µm] width and thickness of floor boards
_BOARD_PIECE = 1_200_000    # [µm]
_EXPANSION = 10_000         # [µm] between boards and walls
_SLAB_PIECE = 3_000_000     # [µm] largest extent of a piece of slab; pieces crack apart


def timber_floor(site: Site, plan: Footprint, level: int, walls: Sequence[Elevation],
                 partitions: Sequence[Elevation], rooms: Sequence[Rectangle],
                 place: Place) -> None:
    """
    Lay joists into pockets of the walls and boards onto them.

    Joists run along the shorter side of the building, or along the longer one where the walls
    leave them no room otherwise.

    :param site: takes the parts.
    :param plan: right-angled footprint.
    :param level: upper side of the joists [µm], on a course.
    :param walls: of the facades, in their order; pockets are cut into them.
    :param partitions: walls inside, likewise.
    :param rooms: to be boarded.
    :param place: of the floor or roof in its text.
    :raises GrammarError: when joists meet openings in both directions.
    """
    first = span_axis(plan)
    problems = []
    for axis in (first, 1 - first):
        joists, holes = _joists(site, plan, level, axis, walls, partitions)
        problem = next(filter(None, (_problem(*hole) for hole in holes)), None)
        if problem is None:
            break
        problems.append(problem)
    else:
        raise place.error(
            f'the joists below {level / MICRO:g} m need wall to lie in: along the shorter side '
            f'of the building one meets {problems[0]}, along the longer side {problems[1]}; leave '
            f'wall there')
    for wall, *hole in holes:
        wall.cut(*hole)
    if joists:
        boxes = Boxes.stack(joists)
        boxes.kind[:], boxes.material[:] = site.kind('joist'), site.material('timber')
        site.add(boxes, _JOIST_PIECE, SPAN)
        _boards(site, rooms, 1 - axis, level)


def joist_height(bay: Bay, axis: int, gauge: int) -> int:
    """
    Compute the height of joists across a bay, in whole courses [µm].

    :param axis: along which they run.
    :param gauge: height of a course [µm].
    """
    wanted = max(_JOIST[1], bay.inner.size[axis] // _SLENDER)
    return -(-wanted // gauge) * gauge


def _joists(site: Site, plan: Footprint, level: int, axis: int, walls: Sequence[Elevation],
            partitions: Sequence[Elevation]) -> tuple[list[Boxes], list[_Hole]]:
    """Place joists along an axis; list the pockets and passages that they need."""
    layout = walls[0].layout
    joists: list[Boxes] = []
    holes: list[_Hole] = []
    for bay in bays(plan, axis, layout.thickness):
        height = joist_height(bay, axis, layout.gauge)
        lines = _joist_lines(bay, axis, partitions)
        site.expect(len(lines) * bay.outer.size[axis] / _JOIST_PIECE)
        for low, high in lines:
            passed = [walls[end] for end in bay.ends]
            passed += [p for p in partitions if _crosses(p.facade, bay, axis, low, high)]
            for wall in passed:
                left, right = along_facade(wall.facade, low, high)
                holes.append((wall, max(left, 0), level - height,
                              min(right, wall.facade.length), level))
            joists.append(_joist(bay, axis, low, high, level, height))
    return joists, holes


def _problem(wall: Elevation, left: int, bottom: int, right: int, top: int) -> str | None:
    """Describe the obstacle in the way of a joist; None when there is none."""
    panel = wall.obstacle(left, bottom, right, top)
    if panel is None and wall.covers(left, bottom, right, top):
        return None
    found = 'a place without wall' if panel is None else f'the panel "{panel}"'
    x, y, z = wall.facade.place_points(
        np.array([left + right, 0, bottom + top]) / (2.0 * MICRO)).round(2) + 0.0
    return f'{found} at ({x:.2f}, {y:.2f}, {z:.2f}) m'


def _joist_lines(bay: Bay, axis: int,
                 partitions: Sequence[Elevation]) -> list[tuple[int, int]]:
    """
    Space joists evenly between the walls that run along them.

    :returns: edges of their cells, pocket included.
    """
    across = 1 - axis
    first, last = bay.inner.low[across], bay.inner.high[across]
    sides = [(first, first), *sorted(_along(partitions, axis, first, last)), (last, last)]
    width = _JOIST[0] + 2 * _PACKING
    lines = []
    for (_, start), (end, _) in zip(sides, sides[1:]):
        low, high = start + _CLEAR, end - _CLEAR
        if high - low < width <= end - start:  # one alone
            low = (start + end - width) // 2
            lines.append((low, low + width))
        elif high - low >= width:
            count = max(-(-(high - low - width) // _SPACING), 1) + 1
            starts = np.rint(np.linspace(low, high - width, count)).astype(int)
            lines += [(int(s), int(s) + width) for s in starts]
    return lines


def _along(partitions: Sequence[Elevation], axis: int, start: int,
           end: int) -> list[tuple[int, int]]:
    """List the sides of the partitions along an axis that stand between two lines."""
    found = []
    for wall in partitions:
        place = wall.facade.origin[1 - axis]
        if wall.facade.quarter % 2 == axis and start < place < end:
            # Along x the wall lies above its origin, along y below it.
            low = place - (wall.layout.thickness if wall.facade.quarter else 0)
            found.append((low, low + wall.layout.thickness))
    return found


def _crosses(facade: Facade, bay: Bay, axis: int, low: int, high: int) -> bool:
    """Return whether joists of a bay run through a partition."""
    if facade.quarter % 2 == axis:
        return False
    inside = bay.outer.low[axis] < facade.origin[axis] < bay.outer.high[axis]
    start, end = along_facade(facade, low, high)
    return inside and end > 0 and start < facade.length


def _joist(bay: Bay, axis: int, low: int, high: int, level: int, height: int) -> Boxes:
    start, end = bay.outer.low[axis], bay.outer.high[axis]
    cell = np.array([[0, 0, level - height], [0, 0, level]])
    cell[:, axis] = start, end
    cell[:, 1 - axis] = low, high
    margin = [0, 0, 0]
    margin[1 - axis] = _PACKING
    return from_cells(cell[0], cell[1], margin, margin, axis=axis, joint=Joint.BEARING)


def _boards(site: Site, rooms: Sequence[Rectangle], axis: int, level: int) -> None:
    """Cover rooms with boards that run along an axis."""
    cells = []
    for room in rooms:
        low, high = np.array(room.low) + _EXPANSION, np.array(room.high) - _EXPANSION
        if (high - low < _BOARD[0]).any():
            continue
        across = 1 - axis
        lines = np.linspace(low[across], high[across],
                            -(-int(high[across] - low[across]) // _BOARD[0]) + 1)
        lines = np.rint(lines).astype(int)
        cell = np.zeros((len(lines) - 1, 2, 3), int)
        cell[:, 0, axis], cell[:, 1, axis] = low[axis], high[axis]
        cell[:, 0, across], cell[:, 1, across] = lines[:-1], lines[1:]
        cell[:, 0, 2], cell[:, 1, 2] = level, level + _BOARD[1]
        cells.append(cell)
    if cells:
        cell = np.concatenate(cells)
        site.add(from_cells(cell[:, 0], cell[:, 1], axis=axis, kind=site.kind('board'),
                            material=site.material('timber'), joint=Joint.FIXING), _BOARD_PIECE)


def slab_floor(site: Site, plan: Footprint, level: int, depth: int,
               walls: Sequence[Elevation]) -> None:
    """
    Lay a slab over the whole plan, bearing on the full thickness of all walls.

    :param site: takes the parts.
    :param plan: footprint.
    :param level: upper side [µm], on a course.
    :param depth: thickness [µm].
    :param walls: of facades and partitions; they are interrupted where the slab passes.
    :raises GrammarError: when a window or beam stands where the slab passes.
    """
    layout = walls[0].layout
    bottom = int(snap_level(level - depth, layout))
    for wall in walls:
        found = wall.obstacle(0, bottom, wall.facade.length, level)
        if found:
            raise site.place.error(f'the slab from {bottom / 1e6:g} to {level / 1e6:g} m meets '
                                   f'the panel "{found}"; leave a strip of wall there')
        wall.cut(0, bottom, wall.facade.length, level)
    if not plan.right_angled:
        _free_slab(site, plan, bottom, level)
        return
    low, high = [], []
    for bay in bays(plan, span_axis(plan), layout.thickness):
        counts = [max(SPAN, -(-s // _SLAB_PIECE)) for s in bay.outer.size]
        site.expect(counts[0] * counts[1])
        lines = [np.rint(np.linspace(a, b, n + 1)).astype(int) for a, b, n in
                 zip(bay.outer.low, bay.outer.high, counts)]
        row, column = spread(np.full(counts[0], counts[1]))
        low.append(np.column_stack([lines[0][row], lines[1][column], np.full(len(row), bottom)]))
        high.append(np.column_stack([lines[0][row + 1], lines[1][column + 1],
                                     np.full(len(row), level)]))
    site.add(from_cells(np.concatenate(low), np.concatenate(high),
                        [0, 0, max(level - depth - bottom, 0)], 0, kind=site.kind('slab'),
                        material=site.material('concrete'), member=site.next_member))


def _free_slab(site: Site, plan: Footprint, bottom: int, level: int) -> None:
    """Lay a slab over a plan without right angles, in pieces with slanting ends."""
    yaw = plan.yaws[0]
    turn = np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])
    outlines, most = [], _SLAB_PIECE / MICRO
    for piece in trapezia(product(plan.points, turn)):
        wide = float(max(piece[1, 0] - piece[0, 0], piece[3, 0] - piece[2, 0]))
        counts = [max(SPAN, int(np.ceil(wide / most))),
                  int(np.ceil((piece[2, 1] - piece[0, 1]) / most))]
        site.expect(counts[0] * counts[1])
        across, up = (np.linspace(0.0, 1.0, count + 1)[:, None] for count in counts)
        for start, end in zip(up, up[1:]):
            lower, upper = ([side + share * (other - side) for side, other in
                             ((piece[0], piece[2]), (piece[1], piece[3]))]
                            for share in (start, end))
            lines = [left + across * (right - left) for left, right in (lower, upper)]
            outlines += [np.concatenate([line[k:k + 2] for line in lines])
                         for k in range(counts[0])]
    site.add(site.hexahedra(prisms(np.array(outlines), bottom / MICRO, level / MICRO),
                            site.kind('slab'), site.material('concrete'),
                            member=site.next_member))
