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

"""Openings: windows, doors and beams in panels that are not tiled."""

from typing import NamedTuple

import numpy as np

from procphys_ros.wallgrammar.boxes import Boxes, from_cells, Joint, SPAN
from procphys_ros.wallgrammar.construction import Site
from procphys_ros.wallgrammar.derivation import Piece
from procphys_ros.wallgrammar.footprint import Facade

_FRAME_FACE = 50_000     # [µm] face width of frames
FRAME_DEPTH = 70_000    # [µm]
_PANE = 6_000            # [µm] glass
_LIGHT = (1_200_000, 1_800_000)  # [µm] widest and highest pane; beyond it bars divide the window
_BOARD = (150_000, 40_000)       # [µm] widest board of a door, and its thickness
_BOARD_PIECE = 750_000   # [µm] boards splinter into pieces of this length
_BEAM_PIECE = 1_500_000  # [µm] beams likewise
CLEARANCE = 5_000        # [µm] under a door


class Wall(NamedTuple):
    """
    The wall that openings stand in.

    :ivar site: takes the parts.
    :ivar facade: where the wall stands.
    :ivar thickness: of the wall [µm].
    :ivar joint: of its masonry [µm].
    """

    site: Site
    facade: Facade
    thickness: int
    joint: int

    def add(self, boxes: Boxes, longest: int = 0, multiple: int = 1) -> None:
        """Add parts given in the frame of the facade, cut into pieces, see `Site.add`."""
        self.site.add(self.facade.place(boxes), longest, multiple)


def glazing(wall: Wall, piece: Piece, frame: str, glass: str) -> None:
    """
    Put a window into a panel: frame, bars where it is large, panes.

    :param wall: around it.
    :param piece: the panel.
    :param frame, glass: names of the materials.
    """
    scope = piece.scope
    half = wall.joint // 2
    left, right = scope.left + half + _FRAME_FACE, scope.right - half - _FRAME_FACE
    bottom, top = scope.bottom + wall.joint + _FRAME_FACE, scope.top - _FRAME_FACE
    _check_room(piece, left, right, bottom, top)
    near, far = middle(scope.depth, wall.thickness, FRAME_DEPTH)
    columns, rows = (-(-(right - left) // _LIGHT[0]), -(-(top - bottom) // _LIGHT[1]))
    x = _bars(left, right, columns)
    z = _bars(bottom, top, rows)
    bars = [*_jambs(piece, left, right, near, far, wall.joint),
            _bar(left, scope.bottom, right, bottom, near, far, wall.joint, 0),
            *(_bar(left, a, right, b, near, far, 0, 0) for a, b in zip(z[1::2], z[2::2])),
            _bar(left, top, right, scope.top, near, far, 0, 0)]
    lights = list(zip(z[0::2], z[1::2]))
    bars += [_bar(a, low, b, high, near, far, 0, 2)
             for low, high in lights for a, b in zip(x[1::2], x[2::2])]
    _add(wall, bars, 'frame', frame)
    near, far = middle(scope.depth, wall.thickness, _PANE)
    _add(wall, [_bar(a, low, b, high, near, far, 0, 0)
                for low, high in lights for a, b in zip(x[0::2], x[1::2])], 'pane', glass)


def door(wall: Wall, piece: Piece, material: str) -> None:
    """
    Put a door of upright boards into a panel, in a frame open at the bottom.

    :param wall: around it.
    :param piece: the panel.
    :param material: of boards and frame.
    """
    left, right, top = door_frame(wall, piece, material)
    bottom = piece.scope.bottom + CLEARANCE
    near, far = middle(piece.scope.depth, wall.thickness, _BOARD[1])
    lines = np.rint(np.linspace(left, right, -(-(right - left) // _BOARD[0]) + 1)).astype(int)
    _add(wall, [_bar(a, bottom, b, top, near, far, 0, 2) for a, b in zip(lines, lines[1:])],
         'board', material, _BOARD_PIECE)


def door_frame(wall: Wall, piece: Piece, material: str) -> tuple[int, int, int]:
    """
    Put a frame open at the bottom into a panel, first its left and its right post.

    :param wall: around it.
    :param piece: the panel.
    :param material: of the frame.
    :returns: left, right and top of the opening in it [µm], in the facade.
    """
    scope = piece.scope
    half = wall.joint // 2
    left, right = scope.left + half + _FRAME_FACE, scope.right - half - _FRAME_FACE
    top = scope.top - _FRAME_FACE
    _check_room(piece, left, right, scope.bottom + CLEARANCE, top)
    near, far = middle(scope.depth, wall.thickness, FRAME_DEPTH)
    _add(wall, [*_jambs(piece, left, right, near, far, wall.joint),
                _bar(left, top, right, scope.top, near, far, 0, 0)], 'frame', material)
    return left, right, top


def beam(wall: Wall, piece: Piece, material: str, kind: str) -> None:
    """
    Lay a beam through the whole wall.

    :param wall: around it.
    :param piece: the panel, with its bearings.
    :param material: of the beam.
    :param kind: 'lintel' or 'beam'.
    """
    scope = piece.scope
    half = wall.joint // 2
    cell = from_cells([scope.left, scope.depth, scope.bottom],
                      [scope.right, scope.depth + wall.thickness, scope.top],
                      [half, 0, wall.joint], [wall.joint - half, 0, 0],
                      kind=wall.site.kind(kind), material=wall.site.material(material))
    wall.add(cell, _BEAM_PIECE, SPAN if kind == 'lintel' else 1)


def _check_room(piece: Piece, left: int, right: int, bottom: int, top: int) -> None:
    if right - left < _FRAME_FACE or top - bottom < _FRAME_FACE:
        scope = piece.scope
        raise piece.place.error(
            f'the panel "{piece.panel}" is {(scope.right - scope.left) / 1e6:g} x '
            f'{(scope.top - scope.bottom) / 1e6:g} m, too small for its frame of '
            f'{_FRAME_FACE / 1e6:g} m on each side')


def middle(depth: int, thickness: int, wanted: int) -> tuple[int, int]:
    """Centre a depth in the thickness of the wall; return near and far face [µm]."""
    wanted = min(wanted, thickness)
    near = depth + (thickness - wanted) // 2
    return near, near + wanted


def _bars(low: int, high: int, count: int) -> list[int]:
    """List the edges of `count` openings with bars between them, from low to high."""
    clear = (high - low - (count - 1) * _FRAME_FACE) / count
    starts = [low + round(i * (clear + _FRAME_FACE)) for i in range(count)]
    ends = [low + round(i * (clear + _FRAME_FACE) + clear) for i in range(count)]
    ends[-1] = high
    return [edge for pair in zip(starts, ends) for edge in pair]


def _jambs(piece: Piece, left: int, right: int, near: int, far: int, joint: int) -> list[Boxes]:
    scope = piece.scope
    half = joint // 2
    return [from_cells([scope.left, near, scope.bottom], [left, far, scope.top],
                       [half, 0, joint], 0, axis=2, joint=Joint.FIXING),
            from_cells([right, near, scope.bottom], [scope.right, far, scope.top],
                       [0, 0, joint], [half, 0, 0], axis=2, joint=Joint.FIXING)]


def _bar(left: int, bottom: int, right: int, top: int, near: int, far: int, joint: int,
         axis: int) -> Boxes:
    return from_cells([left, near, bottom], [right, far, top], [0, 0, joint], 0, axis=axis,
                      joint=Joint.FIXING)


def _add(wall: Wall, pieces: list[Boxes], kind: str, material: str, longest: int = 0) -> None:
    boxes = Boxes.stack(pieces)
    boxes.kind[:] = wall.site.kind(kind)
    boxes.material[:] = wall.site.material(material)
    wall.add(boxes, longest)
