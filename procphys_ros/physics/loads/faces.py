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


"""Faces of oriented boxes, divided into patches that are loaded at their centres."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.geometry import rotation

_PATCH = 0.5       # [m] target edge of a patch
_MOST_PATCHES = 8  # along one edge of a face


@dataclass(frozen=True)
class FacePatches:
    """
    Pieces of faces, one row each.

    :ivar owner: box of the patch, (K,).
    :ivar face: 0 to 5 for the sides -x +x -y +y -z +z of the box, (K,).
    :ivar centre: (K, 3) [m], world.
    :ivar normal: unit vector out of the box, (K, 3), world.
    :ivar area: (K,) [m²].
    """

    owner: np.ndarray
    face: np.ndarray
    centre: np.ndarray
    normal: np.ndarray
    area: np.ndarray

    def take(self, rows: np.ndarray) -> 'FacePatches':
        """Select patches, (K,) indices or a mask."""
        return FacePatches(self.owner[rows], self.face[rows], self.centre[rows], self.normal[rows],
                           self.area[rows])


def facing(poses: np.ndarray, sizes: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Mark the faces of boxes that face a point, (N, 6) bool."""
    offset = np.einsum('nji,nj->ni', rotation.to_matrix(poses[:, 3:]), point - poses[:, :3])
    return np.stack([offset < -0.5 * sizes, offset > 0.5 * sizes], axis=2).reshape(-1, 6)


def cut(poses: np.ndarray, sizes: np.ndarray, wanted: np.ndarray,
        patch: float = _PATCH) -> FacePatches:
    """
    Divide faces of boxes into patches.

    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param wanted: faces to divide, (N, 6) bool.
    :param patch: target edge of a patch [m]; inf = one patch per face.
    """
    poses, sizes = np.asarray(poses, float), np.asarray(sizes, float)
    counts = np.clip(np.ceil(sizes / patch), 1, _MOST_PATCHES).astype(np.int64)
    return FacePatches(*_cut(poses, rotation.to_matrix(poses[:, 3:]), sizes, counts, wanted))


@kernel
def _cut(poses, axes, sizes, counts, wanted):
    """Write the patches face by face, so that equal patches of neighbours are adjacent."""
    total = 0
    for face in range(6):
        u, v = (face // 2 + 1) % 3, (face // 2 + 2) % 3
        for i in range(len(poses)):
            if wanted[i, face]:
                total += counts[i, u] * counts[i, v]
    owner, faces = np.empty(total, np.int64), np.empty(total, np.int64)
    centre, normal, area = np.empty((total, 3)), np.empty((total, 3)), np.empty(total)
    row = 0
    for face in range(6):
        axis, side = face // 2, 2.0 * (face % 2) - 1.0
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for i in range(len(poses)):
            if not wanted[i, face]:
                continue
            du, dv = sizes[i, u] / counts[i, u], sizes[i, v] / counts[i, v]
            for number in range(counts[i, u] * counts[i, v]):
                a = (number // counts[i, v] + 0.5) * du - 0.5 * sizes[i, u]
                b = (number % counts[i, v] + 0.5) * dv - 0.5 * sizes[i, v]
                owner[row], faces[row], area[row] = i, face, du * dv
                for k in range(3):
                    normal[row, k] = side * axes[i, k, axis]
                    centre[row, k] = (poses[i, k] + 0.5 * sizes[i, axis] * normal[row, k]
                                      + a * axes[i, k, u] + b * axes[i, k, v])
                row += 1
    return owner, faces, centre, normal, area


def gather(patches: FacePatches, loads: np.ndarray, centres: np.ndarray) -> tuple:
    """
    Sum loads on patches per box.

    :param patches: K patches.
    :param loads: (K, 3), world.
    :param centres: of mass of the boxes, (N, 3).
    :returns: sum (N, 3) and its moment about the centre (N, 3), world.
    """
    count = len(centres)
    moments = np.cross(patches.centre - centres[patches.owner], loads)
    return tuple(
        np.column_stack([np.bincount(patches.owner, column, count) for column in values.T])
        for values in (loads, moments))
