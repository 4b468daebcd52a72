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


"""Lattices of voxelised boxes, which distinguish the air of rooms from that outside."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from procphys_ros.elementary import atan2, cos, sin
from procphys_ros.geometry import rotation

CELL = 0.25    # [m] edge of a cell, about the length of a brick
SIX_WAYS = np.concatenate([np.eye(3), -np.eye(3)])
_ENCLOSED = 4  # least number of blocked directions, of six along the axes, of enclosed cells


@dataclass(frozen=True)
class Lattice:
    """
    Lattice of cells occupied by boxes.

    :ivar origin, turn: corner, (3,), and attitude, xyzw, (4,), world.
    :ivar cell: edge of a cell [m].
    :ivar solid: occupied cells, (I, J, K) bool.
    """

    origin: np.ndarray
    turn: np.ndarray
    cell: float
    solid: np.ndarray

    @classmethod
    def draw(cls, poses: np.ndarray, sizes: np.ndarray, origin: np.ndarray, turn: np.ndarray,
             cell: float, shape: np.ndarray) -> Self:
        """
        Voxelise boxes by points half a cell apart, which block every path along the axes.

        :param poses: (N, 7) [m], world.
        :param sizes: full extents, (N, 3) [m].
        :param shape: number of cells along each axis, (3,).
        """
        lattice = cls(origin, turn, cell, np.zeros(shape, bool))
        counts = np.ceil(sizes / (0.5 * cell)).astype(np.intp) + 1
        total = counts.prod(axis=1)
        owner = np.repeat(np.arange(len(sizes)), total)
        row = np.arange(len(owner)) - np.repeat(np.cumsum(total) - total, total)
        place = np.empty((len(owner), 3))
        for axis in (2, 1, 0):
            row, place[:, axis] = np.divmod(row, counts[owner, axis])
        local = (place / (counts[owner] - 1) - 0.5) * sizes[owner]
        found = lattice.cells(poses[owner, :3] + rotation.rotate(poses[owner, 3:], local))
        found = found[((found >= 0) & (found < shape)).all(axis=1)]
        lattice.solid[tuple(found.T)] = True
        return lattice

    def cells(self, points: np.ndarray) -> np.ndarray:
        """Return the cells of points, (K, 3); points (K, 3), world."""
        local = rotation.rotate(rotation.conjugate(self.turn), points - self.origin)
        return np.floor(local / self.cell).astype(np.intp)

    def holds(self, mask: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Mark the points that lie in cells of a mask of this lattice, (K,) bool."""
        cell = self.cells(points)
        within = ((cell >= 0) & (cell < mask.shape)).all(axis=1)
        found = np.zeros(len(points), bool)
        found[within] = mask[tuple(cell[within].T)]
        return found

    def enclosed(self, ground: float) -> np.ndarray:
        """
        Mark the enclosed empty cells: blocked in at least four of the six axis directions.

        A room with a window is enclosed, a street of houses is not.

        :param ground: its height [m]; where the lattice does not reach below, it blocks, too.
        """
        solid = self.solid
        ends = np.zeros(solid.shape, np.int8)
        for axis in range(3):
            ends += np.logical_or.accumulate(solid, axis=axis)
            ends += np.flip(np.logical_or.accumulate(np.flip(solid, axis), axis=axis), axis)
        if self.origin[2] < ground + 2.0 * self.cell:
            ends += ~np.logical_or.accumulate(solid, axis=2)  # cells blocked only by the ground
        return ~solid & (ends >= _ENCLOSED)


def heading(attitude: np.ndarray) -> np.ndarray:
    """
    Return the yaw of lattices aligned with boxes, as quaternions xyzw, (..., 4).

    It is that of the box's x, or of its y where x is steep, as of boards on end.
    """
    axis = rotation.rotate(attitude, np.array([1.0, 0.0, 0.0]))
    steep = axis[..., 2:] * axis[..., 2:] > 0.5
    axis = np.where(steep, rotation.rotate(attitude, np.array([0.0, 1.0, 0.0])), axis)
    half = 0.5 * atan2(axis[..., 1], axis[..., 0])
    turn = np.zeros(attitude.shape)
    turn[..., 2], turn[..., 3] = sin(half), cos(half)
    return turn
