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


"""Skins of buildings: outer faces with a room behind them, loaded by air on one side only."""

import numpy as np

from procphys_ros.elementary import cbrt
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.loads.lattice import CELL, heading, Lattice

_MOST = 4_000_000     # largest number of cells
_MARGIN = 3           # [cells] of air around a building
_OUT = (1.0, 1.5)     # [cells] distances from a face at which it must be in the open
_DEPTH = 1.0          # [m] behind a box, within which its room is searched


def outer_faces(poses: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """
    Find the outer faces of a building.

    The building stands on the ground with its lowest box. Faces of free-standing walls are
    excluded, as the air soon presses on both sides of them.

    :param poses: of its boxes, (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :returns: (N, 6) bool, sides -x +x -y +y -z +z of each box.
    """
    axes = rotation.to_matrix(poses[:, 3:])
    lattice = _around(poses, sizes, axes)
    inside = lattice.enclosed(float(lattice.origin[2]))
    outside = ~lattice.solid & ~inside
    found = np.zeros((len(poses), 6), bool)
    for face in range(6):
        axis, side = face // 2, 2.0 * (face % 2) - 1.0
        normal = side * axes[:, :, axis]
        middle = poses[:, :3] + 0.5 * sizes[:, axis, None] * normal
        free, room = np.zeros((2, len(poses)), bool)
        for step in _OUT:
            free |= lattice.holds(outside, middle + step * lattice.cell * normal)
        rows = np.flatnonzero(free)
        for depth in np.arange(lattice.cell, sizes[rows, axis].max(initial=0.0) + _DEPTH,
                               lattice.cell):
            behind = depth < sizes[rows, axis] + _DEPTH
            room[rows] |= behind & lattice.holds(inside, middle[rows] - depth * normal[rows])
        found[:, face] = room
    return found


def _around(poses: np.ndarray, sizes: np.ndarray, axes: np.ndarray) -> Lattice:
    """Voxelise a building in a lattice aligned with its largest box."""
    turn = heading(poses[int(np.argmax(sizes.prod(axis=1))), 3:])
    reach = 0.5 * np.einsum('nij,nj->ni', np.abs(axes), sizes)
    reach[:, :2] = norm(reach[:, :2], axis=1, keepdims=True)
    local = rotation.rotate(rotation.conjugate(turn), poses[:, :3])
    low, high = (local - reach).min(axis=0), (local + reach).max(axis=0)
    cell = max(CELL, float(cbrt(np.prod(high - low) / _MOST)))
    low = low - [_MARGIN * cell, _MARGIN * cell, 0.0]
    shape = np.ceil((high - low) / cell).astype(np.intp) + _MARGIN
    return Lattice.draw(poses, sizes, rotation.rotate(turn, low), turn, cell, shape)
