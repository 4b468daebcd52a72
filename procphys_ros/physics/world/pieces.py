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

from dataclasses import dataclass

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Shape


@dataclass(frozen=True)
class Pieces:
    """
    Collision shapes of one body.

    :ivar shapes: `Shape`, (P,).
    :ivar sizes: as in `Blueprint.size` [m], (P, 3).
    :ivar local_poses: in the body's frame, (P, 7).
    """

    shapes: np.ndarray
    sizes: np.ndarray
    local_poses: np.ndarray

    def radius(self) -> float:
        """Give the radius of the sphere about the body's frame that holds all pieces [m]."""
        own = np.where(self.shapes == Shape.BOX, 0.5 * np.linalg.norm(self.sizes, axis=1),
                       0.5 * self.sizes[:, [0, 2]].max(axis=1))
        return float((np.linalg.norm(self.local_poses[:, :3], axis=1) + own).max())

    def lowest(self, pose: np.ndarray) -> float:
        """
        Give the height of the lowest point [m].

        PyBullet's bounds will not do: those of a turned compound are larger than the compound.

        :param pose: of the body in the world, (7,).
        """
        poses = rotation.compose(pose, self.local_poses)
        down = np.abs(rotation.to_matrix(poses[:, 3:])[:, 2])
        box = (down * self.sizes).sum(axis=1)
        round_end = self.sizes[:, 0]
        capsule = down[:, 2] * np.maximum(self.sizes[:, 2] - round_end, 0.0) + round_end
        reach = 0.5 * np.where(self.shapes == Shape.BOX, box, capsule)
        return float((poses[:, 2] - reach).min())


def single(shape: int, size: np.ndarray) -> Pieces:
    """Give the one piece of a plain box or capsule."""
    return Pieces(np.array([shape]), np.asarray(size, float)[None],
                  np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]))
