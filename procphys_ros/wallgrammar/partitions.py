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

"""Partitions: half-brick walls that divide every storey into rooms."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

from procphys_ros.language import Place
from procphys_ros.wallgrammar.bonds import Layout
from procphys_ros.wallgrammar.derivation import FacadeScope, Piece
from procphys_ros.wallgrammar.footprint import Corner, Facade, Footprint
from procphys_ros.wallgrammar.plan import along_facade, bays, Rectangle, span_axis
from procphys_ros.wallgrammar.regions import snap_level
from procphys_ros.wallgrammar.spec import Panel
from procphys_ros.wallgrammar.walls import Elevation

_DOOR = (900_000, 2_100_000)  # [µm] width and height of door openings
_DOOR_PLACE = 0.375           # of the length: clear of the middle, where other walls meet it
_LINTEL = 150_000             # [µm] least height of lintels
_PIER = 300_000               # [µm] least wall beside a door


def rooms_of(plan: Footprint, thickness: int) -> list[Rectangle]:
    """List the rooms of a plan without partitions."""
    return [bay.inner for bay in bays(plan, span_axis(plan), thickness)]


def halve(rooms: Sequence[Rectangle], least: int,
          thickness: int) -> tuple[list[Rectangle], list[tuple[Rectangle, int]]]:
    """
    Halve rooms across their longer side while both halves keep a least extent.

    :param rooms: initial rooms.
    :param least: extent that no room may fall below [µm].
    :param thickness: of the walls between them [µm].
    :returns: the rooms, and the walls with the axis that each runs along.
    """
    done: list[Rectangle] = []
    walls: list[tuple[Rectangle, int]] = []
    todo = deque(rooms)
    while todo:
        room = todo.popleft()
        axis = 0 if room.size[0] >= room.size[1] else 1
        half = (room.size[axis] - thickness) // 2
        if half < least:
            done.append(room)
            continue
        middle = room.low[axis] + half
        start, end = middle, middle + thickness
        todo += [Rectangle(room.low, _moved(room.high, axis, start)),
                 Rectangle(_moved(room.low, axis, end), room.high)]
        walls.append((Rectangle(_moved(room.low, axis, start), _moved(room.high, axis, end)),
                      1 - axis))
    return done, walls


def _moved(point: tuple[int, int], axis: int, place: int) -> tuple[int, int]:
    """Move a point to another place along one axis."""
    return (place, point[1]) if axis == 0 else (point[0], place)


def half_brick(layout: Layout) -> Layout:
    """Return the layout of partitions: bricks of the facades, or pieces, in running bond."""
    length = layout.unit[0] // layout.pieces
    return replace(layout, bond='running', offset=0.5, pieces=1, unit=(length, *layout.unit[1:]))


def elevations(walls: Sequence[tuple[Rectangle, int]], layout: Layout, levels: Sequence[int],
               depth: int, place: Place) -> list[Elevation]:
    """
    Plan the partitions, each with a door opening on every storey that is high enough.

    :param walls: where they stand and the axis they run along.
    :param layout: of their bricks.
    :param levels: floor of each storey and the top of the walls [µm].
    :param depth: how far floors reach below their level [µm].
    :param place: of the building in the text.
    """
    panels = {'wall': Panel('wall', 'partition', (), place),
              'door': Panel('door', 'none', (), place),
              'lintel': Panel('lintel', 'beam', ('concrete',), place)}
    out = []
    for rectangle, axis in walls:
        quarter = 0 if axis == 0 else 1
        origin = rectangle.low if axis == 0 else (rectangle.high[0], rectangle.low[1])
        tied = Corner(joint=layout.joint)
        facade = Facade(rectangle.size[axis], 0, quarter, origin, tied, tied)
        pieces = [Piece(FacadeScope(0, 0, facade.length, levels[-1]), 'wall', place)]
        for floor, ceiling in zip(levels, levels[1:]):
            pieces += _door(facade.length, floor, ceiling - depth, layout, place)
        out.append(Elevation(facade, pieces, panels, {'partition': layout}, layout, 'partition'))
    return out


def trim(partitions: Sequence[Elevation], walls: Sequence[Elevation]) -> None:
    """
    Cut partitions back to the panels of facades that are set back into the rooms.

    :param partitions: from `elevations`.
    :param walls: of the facades.
    """
    for wall in walls:
        facade, across = wall.facade, 1 - wall.facade.quarter % 2
        inner = facade.origin[across] + wall.layout.thickness * (
            1 if facade.quarter in (0, 3) else -1)
        for scope in wall.set_back():
            for partition in partitions:
                end = inner - partition.facade.origin[across]
                if partition.facade.quarter != across or end not in (0, partition.facade.length):
                    continue
                side = partition.facade.origin[1 - across]
                near = sorted((side, side + partition.layout.thickness * (1 - 2 * across)))
                left, right = along_facade(facade, *near)
                if left < scope.right and right > scope.left:
                    ends = sorted((end, scope.depth if end == 0 else end - scope.depth))
                    partition.cut(ends[0], scope.bottom, ends[1], scope.top)


def _door(length: int, floor: int, ceiling: int, layout: Layout, place: Place) -> list[Piece]:
    left = round(_DOOR_PLACE * length) - _DOOR[0] // 2
    head = int(snap_level(floor + _DOOR[1], layout))
    # A course less of lintel, or of wall above it, is better than no door.
    over = min(head + -(-_LINTEL // layout.gauge) * layout.gauge,
               ceiling // layout.gauge * layout.gauge)
    if left < _PIER or left + _DOOR[0] + _PIER > length or over - head < layout.gauge:
        return []
    right = left + _DOOR[0]
    return [Piece(FacadeScope(left, floor, right, head), 'door', place),
            Piece(FacadeScope(left, head, right, over), 'lintel', place)]
