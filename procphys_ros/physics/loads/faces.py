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


"""Faces of oriented boxes, cut into patches that are small enough to load at their centres."""

from dataclasses import dataclass

import numpy as np

from procphys_ros import rotation

_PATCH = 0.5       # [m] wished edge of a patch
_MOST_PATCHES = 8  # along one edge of a face


@dataclass(frozen=True)
class Patches:
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

    def take(self, rows: np.ndarray) -> 'Patches':
        """Select patches, (K,) indices or a mask."""
        return Patches(self.owner[rows], self.face[rows], self.centre[rows], self.normal[rows],
                       self.area[rows])


def facing(poses: np.ndarray, sizes: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Say which faces of boxes a point lies in front of, (N, 6) bool."""
    offset = np.einsum('nji,nj->ni', rotation.to_matrix(poses[:, 3:]), point - poses[:, :3])
    return np.stack([offset < -0.5 * sizes, offset > 0.5 * sizes], axis=2).reshape(-1, 6)


def cut(poses: np.ndarray, sizes: np.ndarray, wanted: np.ndarray,
        patch: float = _PATCH) -> Patches:
    """
    Cut faces of boxes into patches.

    :param poses: (N, 7) [m], xyzw, world.
    :param sizes: full extents, (N, 3) [m].
    :param wanted: which faces to cut, (N, 6) bool.
    :param patch: wished edge of a patch [m]; inf = one patch per face.
    """
    poses, sizes = np.asarray(poses, float), np.asarray(sizes, float)
    counts = np.clip(np.ceil(sizes / patch), 1, _MOST_PATCHES).astype(int)
    parts = [_cut_face(sizes, counts, face, np.flatnonzero(wanted[:, face]))
             for face in range(6)]
    owner, face, place, area = (np.concatenate(column) for column in zip(*parts))
    matrices = rotation.to_matrix(poses[:, 3:])
    sign = 2.0 * (face % 2) - 1.0
    normal = matrices[owner, :, face // 2] * sign[:, None]
    centre = poses[owner, :3] + (matrices[owner] @ place[:, :, None])[:, :, 0]
    return Patches(owner, face, centre, normal, area)


def _cut_face(sizes: np.ndarray, counts: np.ndarray, face: int, boxes: np.ndarray) -> tuple:
    """Return owner, face, place in the box and area of the patches of one face of some boxes."""
    axis, side = face // 2, 2 * (face % 2) - 1
    u, v = (axis + 1) % 3, (axis + 2) % 3
    per_box = counts[boxes, u] * counts[boxes, v]
    owner = np.repeat(boxes, per_box)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(per_box) - per_box, per_box)
    place = np.empty((len(owner), 3))
    place[:, axis] = 0.5 * side * sizes[owner, axis]
    for k, index in ((u, number // counts[owner, v]), (v, number % counts[owner, v])):
        place[:, k] = ((index + 0.5) / counts[owner, k] - 0.5) * sizes[owner, k]
    area = sizes[owner, u] * sizes[owner, v] / (counts[owner, u] * counts[owner, v])
    return owner, np.full(len(owner), face), place, area


def gather(patches: Patches, loads: np.ndarray, poses: np.ndarray) -> tuple:
    """
    Sum loads on patches per box.

    :param patches: K of them.
    :param loads: (K, 3), world.
    :param poses: (N, 7) of the boxes.
    :returns: sum (N, 3) and its moment about the centre (N, 3), world.
    """
    count = len(poses)
    moments = np.cross(patches.centre - np.asarray(poses)[patches.owner, :3], loads)
    return tuple(
        np.column_stack([np.bincount(patches.owner, column, count) for column in values.T])
        for values in (loads, moments))
