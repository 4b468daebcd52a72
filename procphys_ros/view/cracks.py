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


"""Cracks: dark seams where bonds have broken and the parts are still side by side."""

from typing import Any

import numpy as np

from procphys_ros.blueprint import GROUND, Shape
from procphys_ros.geometry import rotation
from procphys_ros.view.source import Frame

_MOST = 4000  # cracks drawn at once; of more, the newest
_WIDEST = 0.04  # [m] gap beyond which parts are separate, and the gap itself is visible
_LAP = 0.003  # [m] by which a crack protrudes from its joint
_COLOUR = (25, 22, 20)
_PERIOD = 10  # frames between updates: cracks are many, and appear seldom


def seams(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """
    Find the cracked joints between boxes.

    A joint is where the two boxes face each other; its plane is normal to the axis of the first
    along which they are farthest apart.

    :param frame: with the parts of all broken bonds.
    :returns: poses of the seams, world, (K, 7), and their extents [m], (K, 3).
    """
    pairs = frame.broken[(frame.broken != GROUND).all(axis=1)
                         & (frame.broken < len(frame.content)).all(axis=1)]
    pairs = pairs[(frame.content.shape[pairs] == Shape.BOX).all(axis=1)
                  & np.isfinite(frame.poses[pairs, 0]).all(axis=1)]
    first, second = frame.poses[pairs[:, 0]], frame.poses[pairs[:, 1]]
    inner = rotation.relative(first, second)
    half = 0.5 * frame.content.size[pairs[:, 0]]
    other = 0.5 * np.abs(rotation.to_matrix(inner[:, 3:])) @ frame.content.size[pairs[:, 1], :,
                                                                                None]
    other = other[..., 0]
    apart = np.abs(inner[:, :3]) - half - other
    normal = apart.argmax(axis=1)
    near = np.flatnonzero(apart.max(axis=1) < _WIDEST)[-_MOST:]
    low = np.maximum(-half, inner[:, :3] - other)
    high = np.minimum(half, inner[:, :3] + other)
    # Along the normal the boxes do not overlap: there the seam fills the gap.
    low, high = np.minimum(low, high)[near], np.maximum(low, high)[near]
    size = high - low + 2.0 * _LAP
    poses = first[near].copy()
    poses[:, :3] += rotation.rotate(first[near, 3:], 0.5 * (low + high))
    rows = np.arange(len(near))
    size[rows, normal[near]] = np.maximum(apart[near, normal[near]], 0.0) + _LAP
    return poses, size


class Cracks:
    """
    Draw cracks as a fixed number of copies of a cube; send only changes.

    :param scene: `ViserServer.scene`.
    :param unit: length of the page [1/m].
    """

    def __init__(self, scene: Any, unit: float):
        self._scene, self._unit = scene, unit
        self._handle: Any = None
        self._turn = 0

    def update(self, frame: Frame) -> None:
        """Draw the present cracks."""
        self._turn += 1
        if not len(frame.broken) and self._handle is None or self._turn % _PERIOD != 1:
            return
        poses, size = seams(frame)
        if self._handle is None:
            self._handle = self._add()
        count = len(poses)
        positions, turns, scales = np.zeros((_MOST, 3)), np.zeros((_MOST, 4)), np.zeros((_MOST, 3))
        turns[:, 0] = 1.0
        positions[:count], scales[:count] = self._unit * poses[:, :3], self._unit * size
        turns[:count] = poses[:, [6, 3, 4, 5]]
        self._handle.batched_positions = positions
        self._handle.batched_wxyzs = turns
        self._handle.batched_scales = scales

    def close(self) -> None:
        """Remove the cracks from the page."""
        if self._handle is not None:
            self._handle.remove()

    def _add(self) -> Any:
        import trimesh
        cube = trimesh.creation.box()
        return self._scene.add_batched_meshes_simple(
            '/cracks', cube.vertices, cube.faces, np.tile([1.0, 0.0, 0.0, 0.0], (_MOST, 1)),
            np.zeros((_MOST, 3)), batched_scales=np.zeros((_MOST, 3)), batched_colors=_COLOUR,
            flat_shading=True, lod='off', cast_shadow=False)
