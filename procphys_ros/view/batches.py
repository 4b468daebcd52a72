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
from functools import partial
from typing import Any

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.view import shapes
from procphys_ros.view.near_leaves import AWAY, COLUMNS, NearLeaves
from procphys_ros.view.source import Frame, PageContent

MOST_BOXES = 512    # copies in a batch: one moving brick is sent with its whole batch
_MOST_OTHERS = 8192  # the same for branches and leaves, which move all together or not at all
VISIBLE = 5e-4       # [m] and [-]: smaller moves of parts are not sent
_VISIBLE_LEAF = 4e-3  # the same for leaves, which are not seen singly
# Kinds of meshes: boxes, balls, and a kind for each form of hexahedra, counted down; others are
# indices into `shapes.TAPERS`.
_BOX, _BALL, _FIRST_SOLID = -1, -2, -3
_NOBODY = np.zeros((0, 3))
_DIGITS = 4  # of the corners of hexahedra [m]: tenths of a millimetre look alike


class Group:
    """
    Copies of many meshes with their poses in one array.

    :param scene: `ViserServer.scene` or a substitute.
    :param name: of the group on the page.
    :param unit: length of the page [1/m].
    :param visible: smallest move that is sent [m], [-].
    """

    def __init__(self, scene: Any, name: str, unit: float, visible: float):
        self._scene, self._name = scene, name
        self._scale = np.array([unit] * 3 + [1.0] * 4, np.float32)
        self._limit = visible * self._scale
        self._handles: list[Any] = []
        self._rows = np.zeros(0, np.intp)  # part or leaf of each copy, batch after batch
        self._starts = np.zeros(0, np.intp)  # of the batches
        self._sent = np.zeros((0, 7), np.float32)

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, mesh: bytes, rows: np.ndarray, poses: np.ndarray, scales: np.ndarray) -> None:
        """Draw a batch: copies of a mesh for these rows of the poses."""
        now = self._placed(poses, rows)
        self._handles.append(self._scene.add_batched_glb(
            f'/{self._name}/{len(self._handles)}', mesh, now[:, 3:], now[:, :3],
            batched_scales=self._scale[0] * scales, lod='off'))
        self._starts = np.append(self._starts, len(self._rows))
        self._rows = np.append(self._rows, rows)
        self._sent = np.concatenate([self._sent, now])

    def send(self, poses: np.ndarray, places: np.ndarray | None = None) -> int:
        """
        Send the batches with moved copies; return their number.

        :param poses: world, (N, 7).
        :param places: of copies that may have moved, (K,); None = all.
        """
        if places is None:
            places = np.arange(len(self))
        now = self._placed(poses, self._rows[places])
        moved = (np.abs(now - self._sent[places]) > self._limit).any(axis=1)
        places = places[moved]
        self._sent[places] = now[moved]
        chosen = np.unique(np.searchsorted(self._starts, places, 'right') - 1)
        for i in chosen:
            end = self._starts[i + 1] if i + 1 < len(self._starts) else len(self)
            mine = self._sent[self._starts[i]:end].copy()
            self._handles[i].batched_positions = mine[:, :3]
            self._handles[i].batched_wxyzs = mine[:, 3:]
        return len(chosen)

    def close(self) -> None:
        """Remove all batches from the page."""
        for handle in self._handles:
            handle.remove()

    def _placed(self, poses: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return poses[rows][:, COLUMNS].astype(np.float32) * self._scale


class Batches:
    """
    Draw the parts and leaves of one scene, and remember the sent state.

    :param scene: `ViserServer.scene` or a substitute.
    :param unit: length of the page [1/m].
    :ivar sent: number of batches sent by the last `update`.
    """

    def __init__(self, scene: Any, unit: float):
        self._parts = Group(scene, 'parts', unit, VISIBLE)
        self._leaves = Group(scene, 'leaves', unit, _VISIBLE_LEAF)
        self._near = NearLeaves(scene, unit)
        self.sent = 0

    def update(self, frame: Frame, eyes: np.ndarray = _NOBODY) -> None:
        """
        Draw new copies, and send moved ones.

        :param frame: to draw.
        :param eyes: positions of the cameras, world [m], (K, 3).
        """
        poses, leaves = present(frame.poses), present(frame.leaf_poses)
        single = self._near.update(frame.content, leaves, eyes)
        if len(single):
            leaves = leaves.copy()
            leaves[single] = AWAY
        content = frame.content
        if len(self._parts) < len(poses):
            for rows, mesh in _part_groups(content, np.arange(len(self._parts), len(poses))):
                self._parts.add(mesh, rows, poses, _scales(content, rows))
        if len(self._leaves) < len(leaves):
            for rows, mesh in _leaf_groups(content, np.arange(len(self._leaves), len(leaves))):
                self._leaves.add(mesh, rows, leaves,
                                 np.repeat(content.leaves.size[rows, None], 3, axis=1))
        self.sent = self._parts.send(poses) + self._leaves.send(leaves)

    def close(self) -> None:
        """Remove all batches from the page."""
        self._parts.close()
        self._leaves.close()
        self._near.close()


def present(poses: np.ndarray) -> np.ndarray:
    """Replace the poses of parts that are gone by one out of sight."""
    gone = ~np.isfinite(poses[:, 0])
    return np.where(gone[:, None], AWAY, poses) if gone.any() else poses


def _scales(content: PageContent, rows: np.ndarray) -> np.ndarray:
    """Return the scales of parts along the axes of their unit meshes, (K, 3)."""
    scales = content.size[rows].copy()
    branch = (content.shape[rows] == Shape.CAPSULE) & ~content.ball[rows]
    scales[branch, 1] = scales[branch, 0]
    scales[content.hexahedra.among(rows).part] = 1.0
    return scales


def _part_groups(content: PageContent, rows: np.ndarray) -> Iterator[tuple[np.ndarray, bytes]]:
    """Group parts by their appearance; yield rows and mesh."""
    capsule = content.shape[rows] == Shape.CAPSULE
    taper = content.size[rows, 1] / np.maximum(content.size[rows, 0], 1e-9)
    kind = np.where(capsule, np.abs(taper[:, None] - shapes.TAPERS).argmin(axis=1), _BOX)
    kind[content.ball[rows]] = _BALL
    makers: dict[int, Callable[[str, int], bytes]] = {_BOX: shapes.box, _BALL: shapes.ball}
    cut = content.hexahedra.among(rows)
    forms, place = np.unique(cut.corners.round(_DIGITS), axis=0, return_inverse=True)
    kind[cut.part] = _FIRST_SOLID - place.reshape(-1)
    for number, form in enumerate(forms):
        makers[_FIRST_SOLID - number] = partial(shapes.hexahedron, corners=form)
    for chosen, name, tone, which in _groups(content, rows, content.texture[rows], kind,
                                             content.first_piece[rows]):
        maker = makers.get(which)
        yield chosen, (maker(name, tone) if maker else shapes.branch(name, tone, which))


def _leaf_groups(content: PageContent, rows: np.ndarray) -> Iterator[tuple[np.ndarray, bytes]]:
    for chosen, name, tone, _ in _groups(content, rows, content.leaves.texture[rows],
                                         np.zeros(len(rows), int), rows):
        yield chosen, shapes.leaf(name, tone)


def _groups(content: PageContent, rows: np.ndarray, texture: np.ndarray, kind: np.ndarray,
            first: np.ndarray) -> Iterator[tuple[np.ndarray, str, int, int]]:
    """Yield rows of one texture, tone (chosen by `first`) and kind, in groups of limited size."""
    names = content.textures or ['']
    tones = np.array([shapes.tones(name) for name in names])[texture]
    keys = np.column_stack([texture, shapes.tone_of(first, tones), kind])
    distinct, place = np.unique(keys, axis=0, return_inverse=True)
    for number, (index, tone, which) in enumerate(distinct.tolist()):
        mine = rows[place.ravel() == number]
        most = MOST_BOXES if which == _BOX else _MOST_OTHERS
        for start in range(0, len(mine), most):
            yield mine[start:start + most], names[index], tone, which
