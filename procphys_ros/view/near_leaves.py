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

"""Near leaves: draw clusters near the camera leaf by leaf."""

from typing import Any

import numpy as np

from procphys_ros.appearance.palette import look
from procphys_ros.appearance.texture import CLUSTERS
from procphys_ros.view import shapes
from procphys_ros.view.source import PageContent

_NEAR = 50.0  # lengths of a leaf: distance at which it has 22 px of 1000, as in `render`
_MOST_BLADES = 12_000  # per texture, those of the nearest clusters: 200,000 triangles
COLUMNS = [0, 1, 2, 6, 3, 4, 5]  # of a pose, in the order of the page: x y z, qw qx qy qz
AWAY = np.array([0.0, 0.0, -1e3, 0.0, 0.0, 0.0, 1.0])  # [m] where copies that are not seen are
_PERIOD = 10    # frames between searches for near clusters
_VISIBLE = 4e-3  # [m] and [-]: smaller moves are not sent


class NearLeaves:
    """
    Draw the nearest clusters as single leaves, a fixed number of copies of one mesh per texture.

    :param scene: `ViserServer.scene` or a substitute.
    :param unit: length of the page [1/m].
    """

    def __init__(self, scene: Any, unit: float):
        self._scene, self._unit = scene, unit
        self._handles: dict[int, Any] = {}  # by texture
        self._sent: dict[int, np.ndarray] = {}
        self._near: dict[int, np.ndarray] = {}  # rows of the leaves, ascending
        self._eyes = np.zeros((0, 3))
        self._turn = 0

    def update(self, content: PageContent, poses: np.ndarray, eyes: np.ndarray) -> np.ndarray:
        """
        Draw the near clusters.

        :param content: leaves and their textures.
        :param poses: of the petioles, (L, 7).
        :param eyes: positions of the cameras, world [m], (K, 3).
        :returns: leaves drawn here, and not as clusters, (M,).
        """
        if self._turn % _PERIOD == 0 or not np.array_equal(eyes, self._eyes):
            self._eyes = eyes
            self._near = _nearest(content, poses, eyes)
        self._turn += 1
        for texture in self._near.keys() | self._handles.keys():
            rows = self._near.get(texture, np.zeros(0, np.intp))
            self._show(content, texture, rows, poses[rows])
        return np.concatenate([*self._near.values(), np.zeros(0, np.intp)])

    def close(self) -> None:
        """Remove all leaves from the page."""
        for handle in self._handles.values():
            handle.remove()

    def _show(self, content: PageContent, texture: int, rows: np.ndarray,
              poses: np.ndarray) -> None:
        name = content.textures[texture]
        most = _most(name)
        placed = np.tile(AWAY, (most, 1))
        placed[:len(rows)] = poses
        placed = placed[:, COLUMNS] * ([self._unit] * 3 + [1.0] * 4)
        scales = np.full((most, 3), 1e-6)
        scales[:len(rows)] = self._unit * content.leaves.size[rows, None]
        now = np.hstack([placed, scales]).astype(np.float32)
        handle = self._handles.get(texture)
        if handle is None:
            self._handles[texture] = self._scene.add_batched_glb(
                f'/near_leaves/{texture}', shapes.spray(name), now[:, 3:7], now[:, :3],
                batched_scales=now[:, 7:], lod='off')
        elif np.abs(now - self._sent[texture]).max() > _VISIBLE * min(self._unit, 1.0):
            handle.batched_positions, handle.batched_wxyzs = now[:, :3], now[:, 3:7]
            handle.batched_scales = now[:, 7:]
        else:
            return
        self._sent[texture] = now


def _most(name: str) -> int:
    return _MOST_BLADES // CLUSTERS[look(name).pattern][0]


def _nearest(content: PageContent, poses: np.ndarray, eyes: np.ndarray) -> dict[int, np.ndarray]:
    """Return the clusters within range, the nearest of each texture."""
    near: dict[int, np.ndarray] = {}
    if not len(eyes) or not len(poses):
        return near
    leaves = content.leaves
    for texture in np.unique(leaves.texture[:len(poses)]).tolist():
        pattern = look(content.textures[texture]).pattern
        if pattern not in CLUSTERS:
            continue
        rows = np.flatnonzero(leaves.texture[:len(poses)] == texture)
        place, blade = poses[rows, :3], CLUSTERS[pattern][3] * leaves.size[rows]
        away = np.full(len(rows), np.inf)
        for eye in eyes:
            away = np.fmin(away, np.linalg.norm(place - eye, axis=1))  # NaN = gone
        order = np.argsort(away, kind='stable')[:_most(content.textures[texture])]
        chosen = np.sort(rows[order[away[order] < _NEAR * blade[order]]])
        if len(chosen):
            near[texture] = chosen
    return near
