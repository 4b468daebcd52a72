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


"""Batches: parts and leaves of one look, drawn as copies of one mesh, and sent when they move."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.view import shapes
from procphys_ros.view.source import Content, Frame

_MOST = 512  # copies in a batch: one brick that moves has to be sent with its whole batch
_VISIBLE = 5e-4  # [m] and [-]: moves of parts below this are not sent
_VISIBLE_LEAF = 4e-3  # the same for leaves, which nobody looks at one by one
_AWAY = np.array([0.0, 0.0, -1e3, 0.0, 0.0, 0.0, 1.0])  # [m] where parts go that are no more


class _Batch:
    """
    Copies of one mesh.

    :param handle: the copies on the page.
    :param rows: part or leaf behind each copy, (K,).
    :param unit: length of the page [1/m].
    """

    def __init__(self, handle: Any, rows: np.ndarray, unit: float):
        self.handle, self.rows, self._unit = handle, rows, unit

    def send(self, poses: np.ndarray) -> None:
        """Send the poses of all copies, (K, 7)."""
        self.handle.batched_positions = self._unit * poses[:, :3]
        self.handle.batched_wxyzs = poses[:, [6, 3, 4, 5]]


class Batches:
    """
    Draws the parts and leaves of one scene and remembers what it has sent.

    :param scene: `ViserServer.scene` or what takes its place.
    :param unit: length of the page [1/m].
    :ivar sent: number of batches sent by the last `update`.
    """

    def __init__(self, scene: Any, unit: float):
        self._scene, self._unit = scene, unit
        self._batches: list[_Batch] = []
        self._leaf_batches: list[_Batch] = []
        self._poses, self._leaf_poses = np.zeros((0, 7)), np.zeros((0, 7))
        self.sent = 0

    def update(self, frame: Frame) -> None:
        """Draw what is new, and send what has moved."""
        poses = _present(frame.poses)
        leaves = _present(frame.leaf_poses)
        self._grow(frame.content, poses, leaves)
        self.sent = (_send(self._batches, self._poses, poses, _VISIBLE)
                     + _send(self._leaf_batches, self._leaf_poses, leaves, _VISIBLE_LEAF))

    def close(self) -> None:
        """Take everything off the page."""
        for batch in [*self._batches, *self._leaf_batches]:
            batch.handle.remove()

    def _grow(self, content: Content, poses: np.ndarray, leaves: np.ndarray) -> None:
        first, first_leaf = len(self._poses), len(self._leaf_poses)
        if first < len(poses):
            self._poses = np.concatenate([self._poses, poses[first:]])
            for rows, mesh in _part_groups(content, np.arange(first, len(poses))):
                self._batches.append(self._add('parts', rows, mesh, poses,
                                               _scales(content, rows)))
        if first_leaf < len(leaves):
            self._leaf_poses = np.concatenate([self._leaf_poses, leaves[first_leaf:]])
            for rows, mesh in _leaf_groups(content, np.arange(first_leaf, len(leaves))):
                scales = np.repeat(content.leaves.size[rows, None], 3, axis=1)
                self._leaf_batches.append(self._add('leaves', rows, mesh, leaves, scales))

    def _add(self, group: str, rows: np.ndarray, mesh: bytes, poses: np.ndarray,
             scales: np.ndarray) -> _Batch:
        number = len(self._leaf_batches if group == 'leaves' else self._batches)
        handle = self._scene.add_batched_glb(
            f'/{group}/{number}', mesh, poses[rows][:, [6, 3, 4, 5]],
            self._unit * poses[rows, :3], batched_scales=self._unit * scales, lod='off')
        return _Batch(handle, rows, self._unit)


def _send(batches: list[_Batch], sent: np.ndarray, poses: np.ndarray, visible: float) -> int:
    """Send the batches of which anything has moved, and remember; give their number."""
    if not len(poses):
        return 0
    moved = (np.abs(poses - sent) > visible).any(axis=1)
    count = 0
    for batch in batches:
        if moved[batch.rows].any():
            now = poses[batch.rows]
            sent[batch.rows] = now
            batch.send(now)
            count += 1
    return count


def _present(poses: np.ndarray) -> np.ndarray:
    """Put away what is gone."""
    gone = ~np.isfinite(poses[:, 0])
    return np.where(gone[:, None], _AWAY, poses) if gone.any() else poses


def _scales(content: Content, rows: np.ndarray) -> np.ndarray:
    """Give the factors along the axes of the unit meshes of parts, (K, 3)."""
    scales = content.size[rows].copy()
    branch = (content.shape[rows] == Shape.CAPSULE) & ~content.ball[rows]
    scales[branch, 1] = scales[branch, 0]
    return scales


def _part_groups(content: Content, rows: np.ndarray) -> Iterator[tuple[np.ndarray, bytes]]:
    """Split parts by what they look like; give rows and mesh."""
    capsule = content.shape[rows] == Shape.CAPSULE
    taper = content.size[rows, 1] / np.maximum(content.size[rows, 0], 1e-9)
    kind = np.where(capsule, np.abs(taper[:, None] - shapes.TAPERS).argmin(axis=1), -1)
    kind[content.ball[rows]] = len(shapes.TAPERS)
    makers: dict[int, Callable[[str, int], bytes]] = {
        -1: shapes.box, len(shapes.TAPERS): shapes.ball}
    for chosen, name, tone, which in _groups(content, rows, content.texture[rows], kind):
        maker = makers.get(which)
        yield chosen, (maker(name, tone) if maker else shapes.branch(name, tone, which))


def _leaf_groups(content: Content, rows: np.ndarray) -> Iterator[tuple[np.ndarray, bytes]]:
    for chosen, name, tone, _ in _groups(content, rows, content.leaves.texture[rows],
                                         np.zeros(len(rows), int)):
        yield chosen, shapes.leaf(name, tone)


def _groups(content: Content, rows: np.ndarray, texture: np.ndarray, kind: np.ndarray
            ) -> Iterator[tuple[np.ndarray, str, int, int]]:
    """Give rows of one texture, tone and kind, at most `_MOST` at a time."""
    keys = np.column_stack([texture, shapes.tone_of(rows), kind])
    distinct, place = np.unique(keys, axis=0, return_inverse=True)
    for number, (index, tone, which) in enumerate(distinct.tolist()):
        mine = rows[place.ravel() == number]
        name = content.textures[index] if content.textures else ''
        for start in range(0, len(mine), _MOST):
            yield mine[start:start + _MOST], name, tone, which
