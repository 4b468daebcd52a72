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

"""Pieces: the boxes and capsules that a body collides with, and how far down they reach."""

from dataclasses import dataclass, field

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import box_inertia, cylinder_inertia, Hexahedra, Shape
from procphys_ros.compilation import kernel
from procphys_ros.physics.terrain import FLAT, height_at, normal_at, Terrain
from procphys_ros.physics.touch import overlap, piece_bounds
from procphys_ros.physics.world.ground_points import corners_outside
from procphys_ros.physics.world.merging import merge_boxes
from procphys_ros.rotation_kernels import matrix

_BOX = int(Shape.BOX)  # numba reads no enums


@dataclass(frozen=True)
class Pieces:
    """
    Collision shapes of one body.

    :ivar shapes: `Shape`, (P,).
    :ivar sizes: as in `Blueprint.size` [m], (P, 3).
    :ivar local_poses: in the body's frame, (P, 7).
    :ivar ground_points: corners of the body's parts that stick out of these shapes, which only
        the ground meets, in the body's frame [m], (Q, 3).
    :ivar hexahedra: corners of boxes that are no rectangular ones.
    """

    shapes: np.ndarray
    sizes: np.ndarray
    local_poses: np.ndarray
    ground_points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    hexahedra: Hexahedra = field(default_factory=Hexahedra)

    def radius(self) -> float:
        """Give the radius of the sphere about the body's frame that holds all of it [m]."""
        own = np.where(self.shapes == Shape.BOX, 0.5 * np.linalg.norm(self.sizes, axis=1),
                       0.5 * self.sizes[:, [0, 2]].max(axis=1))
        bulk = float((np.linalg.norm(self.local_poses[:, :3], axis=1) + own).max())
        return max(bulk, np.linalg.norm(self.ground_points, axis=1).max(initial=0.0))

    def lowest(self, pose: np.ndarray, terrain: Terrain = FLAT) -> float:
        """
        Give the height over the ground of the lowest point [m].

        Over a terrain, corners of boxes, ends of capsules and the middles of all are looked at.

        PyBullet's bounds will not do: those of a turned compound are larger than the compound.

        :param pose: of the body in the world, (7,).
        :param terrain: the surface of the ground.
        """
        if terrain.is_flat and not len(self.hexahedra):
            return _lowest(pose, self.shapes, self.sizes, self.local_poses, self.ground_points)
        plain = ~self.are_hexahedra
        points = np.concatenate([self.ground_points,
                                 self.hexahedra.points(self.local_poses).reshape(-1, 3)])
        columns = self.shapes[plain], self.sizes[plain], self.local_poses[plain], points
        if terrain.is_flat:
            return _lowest(pose, *columns)
        return _clearance(terrain, pose, *columns)

    @property
    def are_hexahedra(self) -> np.ndarray:
        """Boxes that are no rectangular ones, (P,) bool."""
        mask = np.zeros(len(self.shapes), bool)
        mask[self.hexahedra.part] = True
        return mask


@kernel
def _lowest(pose, shapes, sizes, local, points):
    up = matrix(pose[3:])[2].copy()  # the vertical in the body's axes
    height = np.inf
    for p in range(len(shapes)):
        down = np.abs(up @ matrix(local[p, 3:]))
        size = sizes[p]
        if shapes[p] == _BOX:
            reach = down[0] * size[0] + down[1] * size[1] + down[2] * size[2]
        else:
            reach = down[2] * max(size[2] - size[0], 0.0) + size[0]
        centre = pose[2] + up[0] * local[p, 0] + up[1] * local[p, 1] + up[2] * local[p, 2]
        height = min(height, centre - 0.5 * reach)
    for q in range(len(points)):
        height = min(height, pose[2] + (up * points[q]).sum())
    return height


@kernel
def _clearance(terrain, pose, shapes, sizes, local, points):
    turn = matrix(pose[3:])
    room = np.inf
    for p in range(len(shapes)):
        own = turn @ matrix(local[p, 3:])
        centre = pose[:3] + turn @ local[p, :3]
        size = sizes[p]
        room = min(room, _over(terrain, centre, 0.0))
        if shapes[p] == _BOX:
            for corner in range(8):
                point = centre.copy()
                for axis in range(3):
                    point += own[:, axis] * size[axis] * (0.5 - ((corner >> axis) & 1))
                room = min(room, _over(terrain, point, 0.0))
        else:
            arm = own[:, 2] * 0.5 * max(size[2] - size[0], 0.0)
            room = min(room, min(_over(terrain, centre + arm, 0.5 * size[0]),
                                 _over(terrain, centre - arm, 0.5 * size[0])))
    for q in range(len(points)):
        room = min(room, _over(terrain, pose[:3] + turn @ points[q], 0.0))
    return room


@kernel
def _over(terrain, point, radius):
    """Give how high a ball is over the plane of the ground below it, straight down [m]."""
    steep = normal_at(terrain, point[0], point[1])[2]
    return point[2] - height_at(terrain, point[0], point[1]) - radius / steep


def bounds_of(pieces: Pieces, pose: np.ndarray) -> np.ndarray:
    """Give the axis-aligned bounds of a body in a pose, (7,): three minima, three maxima [m]."""
    inside = place(pieces, pose)
    still = np.zeros((len(inside), 6))
    each = piece_bounds(pieces.shapes, inside, pieces.sizes, still, 0.0, 0.0)
    return np.concatenate([each[:, :3].min(axis=0), each[:, 3:].max(axis=0)])


def place(pieces: Pieces, pose: np.ndarray) -> np.ndarray:
    """Give the poses of a body's pieces in the world, (P, 7)."""
    return rotation.compose(pose, pieces.local_poses)


def are_within(pieces: Pieces, pose: np.ndarray, others: Pieces, other_pose: np.ndarray,
               distance: float) -> bool:
    """
    Tell whether two bodies are less than a distance [m] apart.

    What is no box counts as the box about it, and edges reach a little farther than they do.

    :param pose: of the first body, (7,).
    :param other_pose: of the second body, (7,).
    """
    poses, boxes = place(others, other_pose), _boxes(others)
    room = _boxes(pieces) + 2.0 * distance
    return any((overlap(False, at, size, poses, boxes)[0] > 0.0).any()
               for at, size in zip(place(pieces, pose), room))


def _boxes(pieces: Pieces) -> np.ndarray:
    """Give the extents of the boxes about pieces [m], (P, 3)."""
    length = np.where(pieces.shapes == Shape.BOX, pieces.sizes[:, 2],
                      pieces.sizes[:, [0, 2]].max(axis=1))
    return np.column_stack([pieces.sizes[:, :2], length])


def single(shape: int, size: np.ndarray, hexahedra: Hexahedra | None = None) -> Pieces:
    """Give the one piece of a plain box, hexahedron or capsule."""
    return Pieces(np.array([shape], np.int64), np.asarray(size, float)[None],
                  np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]),
                  hexahedra=hexahedra or Hexahedra())


def merge_pieces(pieces: Pieces, tolerance: float) -> Pieces:
    """Merge boxes that lie end to end, see `merge_boxes`; others stay as they are."""
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
    Give the principal moments of a solid box, cylinder or sphere [kg·m²], (3,).

    :param size: as in `Blueprint.size` [m], (3,).
    :param mass: [kg].
    """
    if shape == Shape.BOX:
        return box_inertia(np.array([mass]), np.asarray(size)[None])[0]
    if size[2] <= size[0]:
        return np.full(3, 0.1 * mass * size[0] ** 2)
    return cylinder_inertia(np.array([mass]), np.array([size[0]]), np.array([size[2]]))[0]
