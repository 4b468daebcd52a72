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


"""Leaves as rows of a point cloud: what each looks like, and where it hangs on its part."""

import numpy as np

from procphys_ros.blueprint import Leaves

LEAF = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('qx', '<f4'), ('qy', '<f4'),
                 ('qz', '<f4'), ('qw', '<f4'), ('size', '<f4'), ('part', '<i4'),
                 ('texture', '<i4')])
_POSE = ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')


def leaf_rows(leaves: Leaves) -> np.ndarray:
    """
    Convert leaves to rows of a point cloud.

    :param leaves: fixed to parts.
    :returns: rows of dtype `LEAF`, (L,): petiole in the frame of the part, length [m], part, and
        index into the textures of the scene.
    """
    rows = np.empty(len(leaves), LEAF)
    for name, column in zip(_POSE, leaves.pose.T):
        rows[name] = column
    rows['size'], rows['part'], rows['texture'] = leaves.size, leaves.part, leaves.texture
    return rows


def leaves_of(rows: np.ndarray) -> Leaves:
    """Convert rows of dtype `LEAF` to leaves."""
    pose = np.stack([rows[name].astype(float) for name in _POSE], axis=-1)
    return Leaves(rows['part'], pose, rows['size'].astype(float), rows['texture'])
