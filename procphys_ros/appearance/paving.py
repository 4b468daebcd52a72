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


"""Paving: surfaces of streets, drawn but without any physics of their own."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.geometry.linear import norm


@dataclass(frozen=True)
class Paving:
    """
    Surface just above the ground.

    :ivar texture: its name.
    :ivar points: [m], (P, 3), world.
    :ivar faces: triangles, indices of points, counterclockwise from above, (F, 3).
    """

    texture: str
    points: np.ndarray
    faces: np.ndarray

    def vertex_normals(self) -> np.ndarray:
        """Compute upward unit normals at the points, for smooth shading, (P, 3)."""
        a, b, c = self.points[self.faces].transpose(1, 0, 2)
        across = np.cross(b - a, c - a)  # as long as twice the area
        normals = np.zeros_like(self.points)
        for corner in self.faces.T:
            np.add.at(normals, corner, across)
        return normals / np.maximum(norm(normals, axis=1, keepdims=True), 1e-12)
