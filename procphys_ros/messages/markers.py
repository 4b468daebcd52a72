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


"""
MarkerArray of a scene: all markers for new subscribers, then only what changed.

One marker per part (`ns` = object, `id` = part index), one per texture of an object's leaves and
ornaments (`ns` = `<object>/leaves`, `id` = texture index), a few for dust (`ns` = `dust`), two for
the ends of broken branches (`ns` = `torn_wood` and `soil`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.appearance.palette import look
from procphys_ros.blueprint import Blueprint
from procphys_ros.compilation import kernel
from procphys_ros.geometry.rotation import compose
from procphys_ros.messages.cdr import Stamp
from procphys_ros.messages.dust_markers import DustMarkers, NAMESPACE
from procphys_ros.messages.foliage import foliage, PlacedObject, too_many
from procphys_ros.messages.marker_rows import (
    Action,
    Chunk,
    command,
    ListMarker,
    marker_array,
    MarkerType,
)
from procphys_ros.messages.part_markers import PartMarkers
from procphys_ros.messages.torn_markers import TornMarkers
from procphys_ros.messages.triangle_lists import TriangleLists
from procphys_ros.physics.dust import Puffs

# A part is sent again when it has moved by this much since the last time: [m] in position,
# [-] in the quaternion (0.01 degrees). Smaller moves are not visible.
_VISIBLE = 1e-4


@dataclass(frozen=True)
class MarkerStyle:
    """
    Drawing options of a scene.

    :ivar most_triangles: budget for leaves and twigs, see `foliage`.
    :ivar mesh: resource for boxes that have moved, a unit cube; '' = they stay plain cubes.
    :ivar shard: '' = no other node draws into the view, so the full set may clear it; else a
        prefix that distinguishes the dust of this scene from that of others.
    """

    most_triangles: int = 40_000
    mesh: str = ''
    shard: str = ''


class _Sent:
    """
    The last sent poses; NaN = not sent, or not present.

    :param count: number of rows.
    """

    def __init__(self, count: int):
        self.poses = np.full((count, 7), np.nan)

    def grow(self, count: int) -> None:
        """Extend the rows to `count` in all."""
        new = np.full((count - len(self.poses), 7), np.nan)
        self.poses = np.concatenate([self.poses, new])

    def update(self, poses: np.ndarray) -> np.ndarray:
        """
        Store the poses that have visibly moved, appeared or vanished.

        :param poses: present ones, (K, 7).
        :returns: which have changed, (K,) bool.
        """
        changed = np.empty(len(poses), bool)
        _take_over(poses, self.poses, _VISIBLE, changed)
        return changed


class SceneMarkers:
    """
    Write the markers of a scene, and remember the written state.

    A part whose pose is not finite does not exist: its marker is deleted.

    :param blueprint: all parts.
    :param objects: their owners, in part order.
    :param frame_id: frame of the poses.
    :param style: drawing options.
    :ivar shows_leaf_poses: whether leaves are drawn singly, at their own poses.
    """

    def __init__(self, blueprint: Blueprint, objects: Sequence[PlacedObject], frame_id: str,
                 style: MarkerStyle | None = None):
        style = style or MarkerStyle()
        self._first_parts = len(blueprint)
        self._objects = len(objects)
        self._petioles = blueprint.leaves
        self.shows_leaf_poses = bool(len(blueprint.leaves)) and not too_many(
            blueprint, style.most_triangles)
        self._sent = _Sent(len(blueprint))
        self._sent_leaves = _Sent(self.shows_leaf_poses * len(blueprint.leaves))
        self._home, self._size = blueprint.poses, blueprint.visual_size
        self._parts = PartMarkers(frame_id, style.mesh)
        self._parts.add(blueprint, objects)
        leaves = foliage(blueprint, objects, style.most_triangles)
        self._leaves = TriangleLists(
            [ListMarker(MarkerType.TRIANGLE_LIST, f'{o.name}/leaves', entry.texture, frame_id,
                        look(blueprint.textures[entry.texture]).rgba) for o, entry in leaves],
            [entry for _, entry in leaves])
        # No object has a slash in its name, so none has markers of these namespaces.
        self._dust = DustMarkers(frame_id, f'{style.shard}/{NAMESPACE}')
        self._torn = TornMarkers(blueprint, frame_id, f'{style.shard}/')
        self._clear = b'' if style.shard else command(Action.DELETEALL, '', 0, frame_id)

    def __len__(self) -> int:
        """Return the number of parts."""
        return len(self._sent.poses)

    def grow(self, blueprint: Blueprint, objects: Sequence[PlacedObject]) -> None:
        """
        Add parts that have joined the scene.

        :param blueprint: all parts, the old ones first.
        :param objects: all owners, the old ones first.
        """
        self._sent.grow(len(blueprint))
        self._home, self._size = blueprint.poses, blueprint.visual_size
        self._parts.add(blueprint, objects[self._objects:])
        self._torn.grow(blueprint)
        self._objects = len(objects)

    def resize(self, blueprint: Blueprint) -> None:
        """
        Follow the growth of branches; their leaves keep the sizes that they had at first.

        :param blueprint: all parts, as many as so far.
        """
        grown = (np.abs(blueprint.visual_size - self._size) > _VISIBLE).any(axis=1)
        if grown.any():
            self._size = np.where(grown[:, None], blueprint.visual_size, self._size)
            self._sent.poses[grown & np.isfinite(self._sent.poses[:, 0])] = 0.0
            self._parts.resize(blueprint)
        self._torn.grow(blueprint)

    def whole(self, poses: np.ndarray, at: Stamp, leaf_poses: np.ndarray | None = None,
              puffs: Puffs | None = None) -> bytes:
        """
        Write every existing marker, after one that clears earlier markers.

        :param poses: poses of all parts, (N, 7).
        :param at: stamp of the markers.
        :param leaf_poses: petioles of all leaves, (L, 7), if `shows_leaf_poses`; None = at rest.
        :param puffs: of dust.
        """
        # Parts that vanished since the last message are still deleted: a view shared with other
        # nodes is not cleared.
        self._sent.poses[np.isfinite(poses[:, 0])] = np.nan
        leaf_poses = self._shown_leaves(poses, leaf_poses)
        self._sent_leaves.poses[np.isfinite(leaf_poses[:, 0])] = np.nan
        self._dust.forget()
        self._torn.forget()
        chunks, count = self._changed(poses, at, leaf_poses, puffs)
        return marker_array([self._clear, *chunks], count + bool(self._clear))

    def changes(self, poses: np.ndarray, at: Stamp, leaf_poses: np.ndarray | None = None,
                puffs: Puffs | None = None) -> bytes | None:
        """
        Write the markers that changed since the last call; None if there are none.

        :param poses: poses of all parts, (N, 7).
        :param at: stamp of the markers.
        :param leaf_poses: as for `whole`.
        :param puffs: of dust.
        """
        chunks, count = self._changed(poses, at, leaf_poses, puffs)
        return marker_array(chunks, count) if count else None

    def deletions(self, at: Stamp) -> bytes:
        """Write the deletion of every marker, for views shared with other nodes."""
        gone = np.full_like(self._sent.poses, np.nan)
        none = np.zeros(len(gone), bool)
        chunks, count = self._parts.write(gone, at, self._sent.update(gone), none)
        others = [*self._dust.deletions, *self._torn.deletions, *self._leaves.deletions]
        return marker_array([*chunks, *others], count + len(others))

    def _changed(self, poses: np.ndarray, at: Stamp, leaf_poses: np.ndarray | None,
                 puffs: Puffs | None) -> tuple[list[Chunk], int]:
        changed = self._sent.update(poses)
        away = _differ(poses, self._home, _VISIBLE)
        carriers, marks = poses[:self._first_parts], changed[:self._first_parts]
        leaf_poses = self._shown_leaves(poses, leaf_poses)
        carriers = np.concatenate([carriers, leaf_poses])
        marks = np.append(marks, self._sent_leaves.update(leaf_poses))
        found: list[tuple[Sequence[Chunk], int]] = [
            self._parts.write(poses, at, changed, away), self._leaves.write(carriers, marks, at),
            self._torn.write(poses, at)]
        if puffs is not None:
            found.append(self._dust.write(puffs, at))
        return [chunk for some, _ in found for chunk in some], sum(count for _, count in found)

    def _shown_leaves(self, poses: np.ndarray, leaf_poses: np.ndarray | None) -> np.ndarray:
        """Return the poses of leaves that are drawn singly, (L, 7)."""
        if not self.shows_leaf_poses:
            return np.zeros((0, 7))
        if leaf_poses is None:
            return compose(poses[self._petioles.part], self._petioles.pose)
        return leaf_poses


@kernel(nogil=True)
def _take_over(poses, sent, limit, changed):
    """Copy the poses that differ from the sent ones, and mark them."""
    for i in range(len(poses)):
        there, differs = True, False
        for c in range(7):
            there &= np.isfinite(poses[i, c])
            differs |= not abs(poses[i, c] - sent[i, c]) <= limit
        if there:
            changed[i] = differs
        else:
            changed[i] = np.isfinite(sent[i, 0])
        if changed[i]:
            for c in range(7):
                sent[i, c] = poses[i, c] if there else np.nan


@kernel(nogil=True)
def _differ(poses, others, limit):
    """Mark the poses that differ from others by more than a limit in any number, or are NaN."""
    out = np.zeros(len(poses), np.bool_)
    for i in range(len(poses)):
        for c in range(7):
            if not abs(poses[i, c] - others[i, c]) <= limit:
                out[i] = True
                break
    return out
