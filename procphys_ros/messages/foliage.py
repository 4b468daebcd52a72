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


"""Triangles that ride on parts: leaves, and the ornaments of grammars."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from numba import njit
import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint, Leaves, Ornaments, Shape
from procphys_ros.palette import look


class PlacedObject(Protocol):
    """An object of a scene: its name and the range of its parts."""

    @property
    def name(self) -> str: ...

    @property
    def first(self) -> int: ...

    @property
    def count(self) -> int: ...


@dataclass(frozen=True)
class Foliage:
    """
    Triangles of one texture on the parts of one object.

    :ivar texture: index into the textures of the blueprint.
    :ivar part: part that each corner rides on, (3·T,) int32.
    :ivar corners: in the part's frame [m], (3·T, 3).
    :ivar carriers: the parts that appear in `part`, each once.
    """

    texture: int
    part: np.ndarray
    corners: np.ndarray
    carriers: np.ndarray

    def placed(self, poses: np.ndarray) -> np.ndarray:
        """Give the corners in the frame of the poses (N, 7), [m], (3·T, 3)."""
        out = np.empty_like(self.corners)
        _place(poses, self.part, self.corners, out)
        return out


def foliage(blueprint: Blueprint, objects: Sequence[PlacedObject],
            most_triangles: int) -> list[tuple[PlacedObject, Foliage]]:
    """
    Collect the leaves and ornaments of all objects, one entry per object and texture.

    :param objects: owners of the parts, in part order.
    :param most_triangles: of leaves and of boneless twigs in all; when there are more, the twigs
        are left out first, then evenly chosen leaves are drawn larger in place of all, so that
        the area of green stays.
    """
    leaves, ornaments = blueprint.leaves, blueprint.ornaments
    on_tree = blueprint.shape[ornaments.part] == Shape.CAPSULE
    if 2 * len(leaves) + np.count_nonzero(on_tree) > most_triangles:
        leaves = _thinned(leaves, most_triangles // 2)
        ornaments = Ornaments(ornaments.part[~on_tree], ornaments.triangle[~on_tree],
                              ornaments.texture[~on_tree])
    part = np.concatenate([np.repeat(leaves.part, 6), np.repeat(ornaments.part, 3)])
    texture = np.concatenate([np.repeat(leaves.texture, 6), np.repeat(ornaments.texture, 3)])
    corners = np.concatenate([_leaf_corners(leaves, blueprint.textures),
                              ornaments.triangle.reshape(-1, 3)])
    owner = np.searchsorted([o.first for o in objects], part, side='right') - 1
    order = np.lexsort([texture, owner])
    changes = np.flatnonzero(np.diff(owner[order]) | np.diff(texture[order])) + 1
    return [(objects[owner[mine[0]]],
             Foliage(int(texture[mine[0]]), part[mine].astype(np.int32), corners[mine],
                     np.unique(part[mine])))
            for mine in np.split(order, changes) if len(mine)]


def _thinned(leaves: Leaves, most: int) -> Leaves:
    """Keep every so manieth leaf, enlarged to the area of those that it stands for."""
    share = min(1.0, most / max(len(leaves), 1))
    count = np.floor(np.arange(len(leaves) + 1) * share)
    kept = np.flatnonzero(np.diff(count) > 0)
    return Leaves(leaves.part[kept], leaves.pose[kept],
                  leaves.size[kept] / np.sqrt(share or 1.0), leaves.texture[kept])


def _leaf_corners(leaves: Leaves, textures: tuple[str, ...]) -> np.ndarray:
    """
    Shape every leaf as two crossed triangles that stand on the petiole, (6·L, 3).

    Marker textures are loaded anew at every update, so a leaf cannot be a quad with a cut-out
    picture; a triangle is the plainest pointed shape, and half the bytes.
    """
    aspects = np.array([look(name).aspect for name in textures] or [1.0])
    half = 0.5 * aspects[leaves.texture] * leaves.size
    local = np.zeros((len(leaves), 6, 3))
    local[:, [1, 2, 4, 5], 2] = leaves.size[:, None]
    for corner, axis, sign in ((1, 0, 1), (2, 0, -1), (4, 1, 1), (5, 1, -1)):
        local[:, corner, axis] = sign * half
    turned = rotation.rotate(leaves.pose[:, None, 3:], local)
    return (leaves.pose[:, None, :3] + turned).reshape(-1, 3)


@njit(cache=True)
def _place(poses, part, corners, out):  # pragma: no cover - compiled
    for i in range(len(part)):
        p = part[i]
        x, y, z, w = poses[p, 3], poses[p, 4], poses[p, 5], poses[p, 6]
        a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
        tx = 2.0 * (y * c - z * b)
        ty = 2.0 * (z * a - x * c)
        tz = 2.0 * (x * b - y * a)
        out[i, 0] = poses[p, 0] + a + w * tx + y * tz - z * ty
        out[i, 1] = poses[p, 1] + b + w * ty + z * tx - x * tz
        out[i, 2] = poses[p, 2] + c + w * tz + x * ty - y * tx
