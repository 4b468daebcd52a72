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


"""Rotation matrices inside kernels; `rotation` has the same for arrays of quaternions."""

import numpy as np

from procphys_ros.compilation import subroutine


@subroutine
def matrix_rows(q):
    """Convert a quaternion xyzw to the rows of a matrix, as tuples that need no memory."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    return ((1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
            (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)),
            (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)))


@subroutine
def carried(pose, point):
    """Transform a point from a frame with a pose to the parent frame, as a tuple."""
    axes, x, y, z = matrix_rows(pose[3:]), point[0], point[1], point[2]
    return (pose[0] + axes[0][0] * x + axes[0][1] * y + axes[0][2] * z,
            pose[1] + axes[1][0] * x + axes[1][1] * y + axes[1][2] * z,
            pose[2] + axes[2][0] * x + axes[2][1] * y + axes[2][2] * z)


@subroutine
def matrix(q):
    """Convert a quaternion xyzw to a matrix, (3, 3); its columns are the rotated axes."""
    rows = matrix_rows(q)
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = rows[i][j]
    return out
