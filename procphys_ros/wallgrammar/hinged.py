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

"""Doors and shutters on hinges: leaves that are bonded to nothing, and their joints."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count as count_up

import numpy as np

from procphys_ros.blueprint import Blueprint, box_inertia, chain, Joints, JointType, Plates, Shape
from procphys_ros.geometry import rotation
from procphys_ros.wallgrammar import openings
from procphys_ros.wallgrammar.boxes import Boxes, from_cells, MICRO
from procphys_ros.wallgrammar.construction import HungLeaf
from procphys_ros.wallgrammar.derivation import Piece
from procphys_ros.wallgrammar.materials import Material, texture_numbers
from procphys_ros.wallgrammar.openings import CLEARANCE, Wall

_DOOR, _SHUTTER = 40_000, 25_000  # [µm] thickness of leaves
_OPENS = {'door': (0.0, 110.0), 'shutters': (0.0, 170.0)}  # [degrees] when nothing is said
_FURTHEST = 180.0  # [degrees]
_SCREWED = 5000.0  # [N] that a hinge of steel bears: an estimate, the same as in gate.mech
_FRICTION = 0.5    # [N·m] in hinges, likewise
_HELD = 75.0       # [N] push at its edge up to which a latch holds a leaf (EN 12217, class 1,
#                    as quoted from memory)
_REBATE = 15_000   # [µm] by which a leaf lies over its frame, which stops it
_GAP = 1_000       # [µm] between them
_SHUT = 5.0        # [degrees] beyond shut, which frames prevent: limits of hinges bear no slams
_WALKING = 1.0     # [rad/s] at which a door is driven: open within the two seconds of a person
_APART = 0.7       # of the height: distance of the two hinges, as there


def door(wall: Wall, piece: Piece, material: str, side: str) -> None:
    """
    Put a door on hinges into a panel, in a frame open at the bottom.

    :param wall: around it.
    :param piece: the panel.
    :param material: of leaf and frame.
    :param side: of its hinges, seen from outside, 'left' or 'right'.
    """
    limits = _limits(piece, 'door')
    post = wall.site.count
    left, right, top = openings.door_frame(wall, piece, material)
    face = openings.middle(piece.scope.depth, wall.thickness, openings.FRAME_DEPTH)
    swings = limits[0] < 0.0 < limits[1]
    near, far = (openings.middle(piece.scope.depth, wall.thickness, _DOOR) if swings
                 else _before(face, limits, _DOOR))
    rebate = -CLEARANCE if swings else _REBATE
    _add(wall, (left - rebate, near, right + rebate, far),
         (piece.scope.bottom + CLEARANCE, top + rebate), side, post + (side == 'right'), limits,
         material, 'door')


def shutters(wall: Wall, piece: Piece, frame: str, glass: str, material: str) -> None:
    """
    Put a window into a panel, with two shutters before it.

    :param wall: around it.
    :param piece: the panel.
    :param frame, glass, material: names of the materials, the last of the shutters.
    """
    limits, scope = _limits(piece, 'shutters'), piece.scope
    post = wall.site.count
    openings.glazing(wall, piece, frame, glass)
    half = wall.joint // 2 + CLEARANCE
    near, far = _before(openings.middle(scope.depth, wall.thickness, openings.FRAME_DEPTH),
                        limits, _SHUTTER)
    rise = scope.bottom + wall.joint + CLEARANCE, scope.top - CLEARANCE
    middle = (scope.left + scope.right) // 2
    for a, b, side in ((scope.left + half, middle - CLEARANCE // 2, 'left'),
                       (middle + CLEARANCE // 2, scope.right - half, 'right')):
        _add(wall, (a, near, b, far), rise, side, post + (side == 'right'), limits, material,
             'shutter')


def hang(built: Blueprint, leaves: Sequence[HungLeaf], frames: np.ndarray,
         materials: dict[str, Material]) -> Blueprint:
    """
    Add leaves to a building: loose parts after all others, a joint each.

    :param leaves: hung on parts of the building.
    :param frames: pose of each frame in the building [m], (f, 7).
    :param materials: by name, in the order of the indices `Boxes.material`.
    """
    if not leaves:
        return built
    boxes, names = Boxes.stack([leaf.box for leaf in leaves]), tuple(materials)
    table = list(materials.values())
    size = (boxes.high - boxes.low) / MICRO
    density = np.array([m.density for m in table])[boxes.material]
    mass, rows = density * size.prod(axis=1), np.arange(len(boxes))
    textures, texture = texture_numbers(materials)
    kinds = tuple(dict.fromkeys(leaf.name for leaf in leaves))
    normal = np.argmin(size, axis=1)
    poses = rotation.compose(frames[boxes.frame], np.column_stack([
        (boxes.low + boxes.high) / (2.0 * MICRO), np.tile(rotation.IDENTITY, (len(boxes), 1))]))
    loose = Blueprint(
        shape=np.full(len(boxes), Shape.BOX, np.uint8), size=size, visual_size=size.copy(),
        density=density, mass=mass, inertia=box_inertia(mass, size), poses=poses,
        kind=np.array([kinds.index(leaf.name) for leaf in leaves], np.int16),
        material=boxes.material.astype(np.int16), texture=texture[boxes.material],
        leaf_area=np.zeros(len(boxes)),
        plates=Plates(rows.astype(np.int32), normal.astype(np.uint8),
                      size.prod(axis=1) / size[rows, normal]),
        kinds=kinds, materials=names, textures=textures)
    joints, named = _joints(leaves, len(built), frames)
    return replace(chain([built, loose]), joints=joints, joint_names=named)


def _joints(leaves: Sequence[HungLeaf], first: int,
            frames: np.ndarray) -> tuple[Joints, tuple[str, ...]]:
    """
    Make a joint for the two hinges of each leaf, whose parts follow from `first` on.

    Two joints in one line would share the weight in any way, as rigid bodies do not tell.
    """
    pins = Boxes.stack([leaf.pin for leaf in leaves])
    foot, head = (rotation.compose(frames[pins.frame], np.column_stack([
        end / MICRO, np.tile(rotation.IDENTITY, (len(pins), 1))]))[:, :3]
        for end in (pins.low, pins.high))
    count = len(leaves)
    sense = np.array([leaf.outwards for leaf in leaves], float)
    turn = np.sqrt(0.5) * np.column_stack([0.0 * sense, -sense, 0.0 * sense, np.ones(count)])
    low, high = np.array([leaf.limits for leaf in leaves]).T
    width = np.array([(leaf.box.high - leaf.box.low)[0, :2].max() for leaf in leaves]) / MICRO
    shut, nothing = np.radians(_SHUT), np.zeros(count)
    parts = np.array([(leaf.post, first + n) for n, leaf in enumerate(leaves)], np.int32)
    return Joints(
        kind=np.full(count, JointType.HINGE, np.uint8), parts=parts,
        frame=np.column_stack([0.5 * (foot + head), turn]), anchor=np.zeros((count, 3)),
        low=np.where(low == 0.0, -shut, low), high=np.where(high == 0.0, shut, high),
        stiffness=nothing, damping=nothing, rest=nothing, friction=np.full(count, _FRICTION),
        speed=nothing, fastest=np.full(count, _WALKING), effort=_HELD * width,
        force=np.full(count, 2.0 * _SCREWED),
        moment=_SCREWED * _APART * (head - foot)[:, 2], collides=np.zeros(count, bool),
        name=np.arange(count, dtype=np.int32)), _numbered([leaf.name for leaf in leaves])


def _numbered(names: Sequence[str]) -> tuple[str, ...]:
    """Return names with their number among equal ones: door_0, shutter_0, shutter_1, door_1."""
    numbers: defaultdict[str, Iterator[int]] = defaultdict(count_up)
    return tuple(f'{name}_{next(numbers[name])}' for name in names)


def _before(frame: tuple[int, int], limits: tuple[float, float],
            thickness: int) -> tuple[int, int]:
    """Return near and far face of a leaf that shuts against the face of a frame [µm]."""
    if limits[1] > 0.0:
        return frame[0] - _GAP - thickness, frame[0] - _GAP
    return frame[1] + _GAP, frame[1] + _GAP + thickness


def _limits(piece: Piece, kind: str) -> tuple[float, float]:
    """Return how far leaves open inwards, negative, and outwards [rad]."""
    low, high = piece.numbers or _OPENS[kind]
    if not -_FURTHEST <= low <= 0.0 <= high <= _FURTHEST or low == high:
        raise piece.place.error(
            f'the panel "{piece.panel}" opens from {low:g} to {high:g} degrees; it must be from '
            f'-{_FURTHEST:g} … 0, inwards, to 0 … {_FURTHEST:g}, outwards, and not both 0')
    return float(np.radians(low)), float(np.radians(high))


def _add(wall: Wall, plan: tuple[int, int, int, int], rise: tuple[int, int], side: str, post: int,
         limits: tuple[float, float], material: str, name: str) -> None:
    """
    Hang a leaf; its hinges are at the face that it opens towards.

    :param plan: left, near, right and far face of the leaf [µm], in the facade.
    :param rise: its bottom and top [µm].
    """
    (left, near, right, far), (bottom, top) = plan, rise
    box = from_cells([left, near, bottom], [right, far, top], 0, 0)
    at, face = left if side == 'left' else right, near if limits[1] >= -limits[0] else far
    pin = from_cells([at, face, bottom], [at, face, top], 0, 0)
    box.material[:] = wall.site.material(material)
    wall.site.hung.append(HungLeaf(wall.facade.place(box), wall.facade.place(pin), post,
                                   -1 if side == 'left' else 1, limits, name))
