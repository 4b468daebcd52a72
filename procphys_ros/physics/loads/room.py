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
Rooms around a point: their volume of air and area of openings.

A room is a connected component of enclosed cells of a lattice, see `lattice`.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # subpackages are imported on first use

from procphys_ros.elementary import cbrt
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.loads.lattice import CELL, heading, Lattice, SIX_WAYS
from procphys_ros.physics.loads.sight import Sight

_REACH = 15.0    # [m] to each side: extent of the search for a room
_LEAST = 4       # least number of blocked directions, of six, at the point: an early test
_OPEN = 0.6      # vents over volume^(2/3), above which gas escapes at once: an estimate, ascribed
#                  to UFC 3-340-02, 2-14, which could not be read
_WALL = 2        # [cells] thickness of walls that move together with their inner face
_STEPS = (0.5, 1.0, 1.5)  # [cells] distances from a face at which its room is looked up


@dataclass(frozen=True)
class Room:
    """
    Enclosed air around a charge.

    :ivar volume: [m³].
    :ivar vents: area of its openings [m²].
    :ivar walls: area of its walls, without the ground [m²].
    :ivar lattice: of the surrounding boxes.
    :ivar inside: cells of the room, (I, J, K) bool.
    """

    volume: float
    vents: float
    walls: float
    lattice: Lattice
    inside: np.ndarray

    def is_confined(self) -> bool:
        """Return whether gas stays long enough to build up pressure."""
        return self.vents < _OPEN * np.square(cbrt(self.volume))

    def faces(self, centres: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """
        Mark the faces that border on the room, (K,) bool.

        :param centres: (K, 3) [m], world.
        :param normals: unit vectors out of the bodies, (K, 3), world.
        """
        found = np.zeros(len(centres), bool)
        for step in _STEPS:
            found |= self.lattice.holds(self.inside, centres + step * CELL * normals)
        return found

    def encloses(self, points: np.ndarray) -> np.ndarray:
        """Mark the points that lie in the walls around the room, (K,) bool; world, (K, 3)."""
        around = scipy.ndimage.binary_dilation(self.inside, iterations=_WALL) & ~self.inside
        return self.lattice.holds(around, points)


def find_room(point: np.ndarray, poses: np.ndarray, sizes: np.ndarray, sight: Sight,
              ground: float = 0.0) -> Room | None:
    """
    Find the room around a point.

    :param point: (3,) [m], world.
    :param poses: of the boxes that enclose rooms, (N, 7) [m], world.
    :param sizes: full extents, (N, 3) [m].
    :param sight: lines of sight among these and other boxes, for an early test.
    :param ground: its height [m].
    :returns: None when the point is in the open.
    """
    if not len(poses):
        return None
    nearest = int(np.argmin(np.square(poses[:, :3] - point).sum(axis=1)))
    turn = heading(poses[nearest, 3:])
    ways = point + _REACH * rotation.rotate(turn, SIX_WAYS)
    ends = ~sight.clear(np.tile(point, (6, 1)), ways, np.full(6, -1)) | (ways[:, 2] < ground)
    if ends.sum() < _LEAST:
        return None
    reach = _REACH + 0.5 * norm(sizes, axis=1)
    away = rotation.rotate(rotation.conjugate(turn), poses[:, :3] - point)
    near = (np.abs(away) < reach[:, None]).all(axis=1)
    low = np.array([-_REACH, -_REACH, max(ground - point[2], -_REACH)])
    shape = np.ceil((_REACH - low) / CELL).astype(np.intp)
    lattice = Lattice.draw(poses[near], sizes[near], point + rotation.rotate(turn, low), turn,
                           CELL, shape)
    labels, _ = scipy.ndimage.label(lattice.enclosed(ground))
    number = _label_near(labels, tuple(lattice.cells(point[None])[0]))
    return _measure(labels == number, lattice) if number else None


def _label_near(labels: np.ndarray, cell: tuple[int, int, int]) -> int:
    """Return the label of the room at a cell, or beside it where the cell is solid; 0 for none."""
    if labels[cell]:
        return int(labels[cell])
    around = labels[tuple(slice(max(c - 1, 0), c + 2) for c in cell)]
    found = np.bincount(around[around > 0])
    return int(found.argmax()) if len(found) else 0


def _measure(inside: np.ndarray, lattice: Lattice) -> Room:
    """Measure a room by cells and faces; walls occupy half a cell too much on average."""
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
    area = CELL * CELL
    volume = inside.sum() * (CELL * CELL * CELL) + 0.5 * CELL * walls * area
    return Room(float(volume), vents * area, walls * area, lattice, inside)


def _shifted(mask: np.ndarray, shift: int, axis: int) -> np.ndarray:
    """Return the mask of the neighbours of all cells along an axis; False beyond the lattice."""
    moved = np.roll(mask, shift, axis)
    edge = [slice(None)] * 3
    edge[axis] = slice(0, 1) if shift == 1 else slice(-1, None)
    moved[tuple(edge)] = False
    return moved
