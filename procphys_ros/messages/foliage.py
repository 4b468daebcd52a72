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

import numpy as np

from procphys_ros.appearance.palette import look
from procphys_ros.blueprint import Blueprint, Leaves, Ornaments, Shape
from procphys_ros.geometry import rotation


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
    :ivar row: pose that carries each corner, (3·T,) int32; parts first, then leaves.
    :ivar corners: in the frame of that pose [m], (3·T, 3).
    :ivar carriers: the distinct values of `row`.
    """

    texture: int
    row: np.ndarray
    corners: np.ndarray
    carriers: np.ndarray


def too_many(blueprint: Blueprint, most_triangles: int) -> bool:
    """Return whether the leaves have more triangles than may be drawn."""
    return 2 * len(blueprint.leaves) > most_triangles


def foliage(blueprint: Blueprint, objects: Sequence[PlacedObject],
            most_triangles: int) -> list[tuple[PlacedObject, Foliage]]:
    """
    Collect the leaves and ornaments of all objects, one entry per object and texture.

    Leaves have separate poses, numbered after the N parts. Twigs are drawn within the budget left
    by the leaves. If there are `too_many` leaves, every n-th one is drawn enlarged instead, such
    that the leaf area is kept, at the pose of its part.

    :param objects: owners of the parts, in part order.
    :param most_triangles: budget for leaves and boneless twigs in all.
    """
    leaves, ornaments = blueprint.leaves, blueprint.ornaments
    carrier = len(blueprint) + np.arange(len(leaves))
    frame = np.tile([0.0, 0.0, 0.0, *rotation.IDENTITY], (len(leaves), 1))
    if too_many(blueprint, most_triangles):
        leaves = _thinned(leaves, most_triangles // 2)
        carrier, frame = leaves.part, leaves.pose
    ball = blueprint.balls[ornaments.part]
    twig = (blueprint.shape[ornaments.part] == Shape.CAPSULE) & ~ball
    room = 2 * len(leaves) + np.count_nonzero(twig) <= most_triangles
    drawn = ~ball & (~twig | room)
    ornaments = Ornaments(ornaments.part[drawn], ornaments.triangle[drawn],
                          ornaments.texture[drawn])
    part = np.concatenate([np.repeat(leaves.part, 6), np.repeat(ornaments.part, 3)])
    row = np.concatenate([np.repeat(carrier, 6), np.repeat(ornaments.part, 3)]).astype(np.int32)
    texture = np.concatenate([np.repeat(leaves.texture, 6), np.repeat(ornaments.texture, 3)])
    corners = np.concatenate([_leaf_corners(leaves, frame, blueprint.textures),
                              ornaments.triangle.reshape(-1, 3)])
    owner = np.searchsorted([o.first for o in objects], part, side='right') - 1
    order = np.lexsort([texture, owner])
    changes = np.flatnonzero(np.diff(owner[order]) | np.diff(texture[order])) + 1
    return [(objects[owner[mine[0]]],
             Foliage(int(texture[mine[0]]), row[mine], corners[mine], np.unique(row[mine])))
            for mine in np.split(order, changes) if len(mine)]


def _thinned(leaves: Leaves, most: int) -> Leaves:
    """Keep every n-th leaf, enlarged to the area of those that it replaces."""
    share = min(1.0, most / max(len(leaves), 1))
    count = np.floor(np.arange(len(leaves) + 1) * share)
    kept = np.flatnonzero(np.diff(count) > 0)
    return Leaves(leaves.part[kept], leaves.pose[kept],
                  leaves.size[kept] / np.sqrt(share or 1.0), leaves.texture[kept])


def _leaf_corners(leaves: Leaves, petiole: np.ndarray, textures: tuple[str, ...]) -> np.ndarray:
    """
    Compute the corners of two crossed triangles per leaf on its petiole (L, 7), (6·L, 3).

    Marker textures are loaded again at every update, so a leaf cannot be a quad with a cut-out
    picture; a triangle is the simplest pointed shape, with half the bytes.
    """
    aspects = np.array([look(name).aspect for name in textures] or [1.0])
    half = 0.5 * aspects[leaves.texture] * leaves.size
    local = np.zeros((len(leaves), 6, 3))
    local[:, [1, 2, 4, 5], 2] = leaves.size[:, None]
    for corner, axis, sign in ((1, 0, 1), (2, 0, -1), (4, 1, 1), (5, 1, -1)):
        local[:, corner, axis] = sign * half
    turned = rotation.rotate(petiole[:, None, 3:], local)
    return (petiole[:, None, :3] + turned).reshape(-1, 3)
