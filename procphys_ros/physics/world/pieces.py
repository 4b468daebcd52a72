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

from procphys_ros.blueprint import Shape
from procphys_ros.compilation import kernel
from procphys_ros.physics.world.assembly import axes_of

_BOX = int(Shape.BOX)  # numba reads no enums


@dataclass(frozen=True)
class Pieces:
    """
    Collision shapes of one body.

    :ivar shapes: `Shape`, (P,).
    :ivar sizes: as in `Blueprint.size` [m], (P, 3).
    :ivar local_poses: in the body's frame, (P, 7).
    :ivar teeth: corners of the body's parts that stick out of these shapes and that only the
        ground meets, in the body's frame [m], (T, 3).
    """

    shapes: np.ndarray
    sizes: np.ndarray
    local_poses: np.ndarray
    teeth: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def radius(self) -> float:
        """Give the radius of the sphere about the body's frame that holds all of it [m]."""
        own = np.where(self.shapes == Shape.BOX, 0.5 * np.linalg.norm(self.sizes, axis=1),
                       0.5 * self.sizes[:, [0, 2]].max(axis=1))
        bulk = float((np.linalg.norm(self.local_poses[:, :3], axis=1) + own).max())
        return max(bulk, np.linalg.norm(self.teeth, axis=1).max(initial=0.0))

    def lowest(self, pose: np.ndarray) -> float:
        """
        Give the height of the lowest point [m].

        PyBullet's bounds will not do: those of a turned compound are larger than the compound.

        :param pose: of the body in the world, (7,).
        """
        return _lowest(pose, self.shapes, self.sizes, self.local_poses, self.teeth)


@kernel
def _lowest(pose, shapes, sizes, local, teeth):
    up = axes_of(pose[3:])[2].copy()  # the vertical in the body's axes
    height = np.inf
    for p in range(len(shapes)):
        down = np.abs(up @ axes_of(local[p, 3:]))
        size = sizes[p]
        if shapes[p] == _BOX:
            reach = down[0] * size[0] + down[1] * size[1] + down[2] * size[2]
        else:
            reach = down[2] * max(size[2] - size[0], 0.0) + size[0]
        centre = pose[2] + up[0] * local[p, 0] + up[1] * local[p, 1] + up[2] * local[p, 2]
        height = min(height, centre - 0.5 * reach)
    for t in range(len(teeth)):
        height = min(height, pose[2] + (up * teeth[t]).sum())
    return height


def single(shape: int, size: np.ndarray) -> Pieces:
    """Give the one piece of a plain box or capsule."""
    return Pieces(np.array([shape], np.int64), np.asarray(size, float)[None],
                  np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]))
