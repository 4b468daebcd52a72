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

"""
Rooms around a place: how much air there is, and through how much it gets out.

A room is what is connected of the cells of a lattice that are enclosed, see `lattice`.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts are imported by their first use

from procphys_ros import rotation
from procphys_ros.elementary import cbrt
from procphys_ros.linear import norm
from procphys_ros.physics.loads.lattice import heading, Lattice
from procphys_ros.physics.loads.sight import Sight

_CELL = 0.25     # [m] of the lattice
_REACH = 15.0    # [m] to each side, beyond which a room is not looked for
_LEAST = 4       # of six ways that end at something: a first look
_OPEN = 0.6      # vents over volume^(2/3), above which gas is out at once: an estimate, ascribed
#                  to UFC 3-340-02, 2-14, which could not be read
_WALL = 2        # [cells] thickness of walls that move together with their inner face
_STEPS = (0.5, 1.0, 1.5)  # [cells] off a face, where its room is looked for
_SIX = np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True)
class Room:
    """
    Air around a charge that cannot get out at once.

    :ivar volume: [m³].
    :ivar vents: area of its openings [m²].
    :ivar walls: area of what encloses it, without the ground [m²].
    :ivar lattice: of what is around.
    :ivar inside: which of its cells are the room, (I, J, K) bool.
    """

    volume: float
    vents: float
    walls: float
    lattice: Lattice
    inside: np.ndarray

    def is_confined(self) -> bool:
        """Return whether gas stays long enough to press."""
        return self.vents < _OPEN * np.square(cbrt(self.volume))

    def faces(self, centres: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """
        Return which faces look into the room, (K,) bool.

        :param centres: (K, 3) [m], world.
        :param normals: unit vectors out of the bodies, (K, 3), world.
        """
        found = np.zeros(len(centres), bool)
        for step in _STEPS:
            found |= self.lattice.holds(self.inside, centres + step * _CELL * normals)
        return found

    def encloses(self, points: np.ndarray) -> np.ndarray:
        """Return which points lie in the walls around the room, (K,) bool; world, (K, 3)."""
        around = scipy.ndimage.binary_dilation(self.inside, iterations=_WALL) & ~self.inside
        return self.lattice.holds(around, points)


def find_room(point: np.ndarray, poses: np.ndarray, sizes: np.ndarray, sight: Sight,
              ground: float = 0.0) -> Room | None:
    """
    Find the room that a place is in.

    :param point: (3,) [m], world.
    :param poses: of the boxes that enclose rooms, (N, 7) [m], world.
    :param sizes: full extents, (N, 3) [m].
    :param sight: boxes among which these are, for a first look.
    :param ground: its height [m].
    :returns: None when the place is in the open.
    """
    if not len(poses):
        return None
    nearest = int(np.argmin(np.square(poses[:, :3] - point).sum(axis=1)))
    turn = heading(poses[nearest, 3:])
    ways = point + _REACH * rotation.rotate(turn, _SIX)
    ends = ~sight.clear(np.tile(point, (6, 1)), ways, np.full(6, -1)) | (ways[:, 2] < ground)
    if ends.sum() < _LEAST:
        return None
    reach = _REACH + 0.5 * norm(sizes, axis=1)
    near = (np.abs(poses[:, :3] - point) < reach[:, None]).all(axis=1)
    low = np.array([-_REACH, -_REACH, max(ground - point[2], -_REACH)])
    shape = np.ceil((_REACH - low) / _CELL).astype(np.intp)
    lattice = Lattice.draw(poses[near], sizes[near], point + rotation.rotate(turn, low), turn,
                           _CELL, shape)
    labels, _ = scipy.ndimage.label(lattice.enclosed(ground))
    number = _label_near(labels, tuple(lattice.cells(point[None])[0]))
    return _measure(labels == number, lattice) if number else None


def _label_near(labels: np.ndarray, cell: tuple[int, int, int]) -> int:
    """Give the room at a cell, or beside it where the cell is taken; 0 for none."""
    if labels[cell]:
        return int(labels[cell])
    around = labels[tuple(slice(max(c - 1, 0), c + 2) for c in cell)]
    found = np.bincount(around[around > 0])
    return int(found.argmax()) if len(found) else 0


def _measure(inside: np.ndarray, lattice: Lattice) -> Room:
    """Count cells and the faces between them; a wall takes half a cell too much on average."""
    solid = lattice.solid
    vents, walls = 0.0, 0
    for axis in range(3):
        for shift in (1, -1):
            beside = _shifted(solid, shift, axis)
            leads_out = inside & ~_shifted(inside, shift, axis) & ~beside
            if axis == 2 and shift == 1:
                leads_out[:, :, 0] = False  # the ground
            edges = sum(int((leads_out & _shifted(solid, way, other)).sum())
                        for other in range(3) if other != axis for way in (1, -1))
            vents += float(leads_out.sum()) + 0.5 * edges
            walls += int((inside & beside).sum())
    area = _CELL * _CELL
    volume = inside.sum() * (_CELL * _CELL * _CELL) + 0.5 * _CELL * walls * area
    return Room(float(volume), vents * area, walls * area, lattice, inside)


def _shifted(mask: np.ndarray, shift: int, axis: int) -> np.ndarray:
    """Give the neighbours of all cells along an axis; beyond the lattice there is nothing."""
    moved = np.roll(mask, shift, axis)
    edge = [slice(None)] * 3
    edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
    moved[tuple(edge)] = False
    return moved
