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

"""Pieces: the collision shapes of a body."""

from dataclasses import dataclass, field

import numpy as np

from procphys_ros.blueprint import box_inertia, cylinder_inertia, Hexahedra, Shape
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.world.merging import corners_outside, merge_boxes


@dataclass(frozen=True)
class Pieces:
    """
    Collision shapes of one body.

    :ivar shapes: `Shape`, (P,).
    :ivar sizes: as in `Blueprint.size` [m], (P, 3).
    :ivar local_poses: in the body's frame, (P, 7).
    :ivar ground_points: corners of the body's parts that protrude from these shapes and collide
        only with the ground, in the body's frame [m], (Q, 3).
    :ivar hexahedra: corners of boxes that are not rectangular.
    """

    shapes: np.ndarray
    sizes: np.ndarray
    local_poses: np.ndarray
    ground_points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    hexahedra: Hexahedra = field(default_factory=Hexahedra)

    def radius(self) -> float:
        """Compute the radius of the bounding sphere about the body's frame [m]."""
        own = np.where(self.shapes == Shape.BOX, 0.5 * norm(self.sizes, axis=1),
                       0.5 * self.sizes[:, [0, 2]].max(axis=1))
        bulk = float((norm(self.local_poses[:, :3], axis=1) + own).max())
        return max(bulk, norm(self.ground_points, axis=1).max(initial=0.0))

    @property
    def are_hexahedra(self) -> np.ndarray:
        """Mask of the boxes that are not rectangular, (P,) bool."""
        mask = np.zeros(len(self.shapes), bool)
        mask[self.hexahedra.part] = True
        return mask


def single(shape: int, size: np.ndarray, hexahedra: Hexahedra | None = None) -> Pieces:
    """Return the single piece of a plain box, hexahedron or capsule."""
    return Pieces(np.array([shape], np.int64), np.asarray(size, float)[None],
                  np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]),
                  hexahedra=hexahedra or Hexahedra())


def merge_pieces(pieces: Pieces, tolerance: float) -> Pieces:
    """Merge boxes that lie end to end, see `merge_boxes`; other pieces are unchanged."""
    box = (pieces.shapes == Shape.BOX) & ~pieces.are_hexahedra
    if np.count_nonzero(box) < 2:
        return pieces
    poses, sizes = merge_boxes(pieces.local_poses[box], pieces.sizes[box], tolerance)
    kept = pieces.hexahedra.among(np.flatnonzero(~box))
    return Pieces(np.concatenate([np.full(len(poses), Shape.BOX, np.int64), pieces.shapes[~box]]),
                  np.concatenate([sizes, pieces.sizes[~box]]),
                  np.concatenate([poses, pieces.local_poses[~box]]),
                  corners_outside(pieces.local_poses[box], pieces.sizes[box], poses, sizes),
                  Hexahedra(kept.part + np.int32(len(poses)), kept.corners))


def solid_inertia(shape: int, size: np.ndarray, mass: float) -> np.ndarray:
    """
    Compute the principal moments of a solid box, cylinder or sphere [kg·m²], (3,).

    :param size: as in `Blueprint.size` [m], (3,).
    :param mass: [kg].
    """
    if shape == Shape.BOX:
        return box_inertia(np.array([mass]), np.asarray(size)[None])[0]
    if size[2] <= size[0]:
        return np.full(3, 0.1 * mass * (size[0] * size[0]))
    return cylinder_inertia(np.array([mass]), np.array([size[0]]), np.array([size[2]]))[0]
