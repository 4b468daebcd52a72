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
MarkerArray of a scene: the whole set when somebody starts to look, then only what changed.

One marker per part (`ns` = object, `id` = part index) and one per texture of an object's leaves
and ornaments (`ns` = `<object>/leaves`, `id` = texture index).
"""

from collections.abc import Sequence

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.messages.cdr import Stamp
from procphys_ros.messages.foliage import balls, foliage, PlacedObject, too_many
from procphys_ros.messages.marker_rows import Action, Kind, marker_array, row_layout, TriangleList
from procphys_ros.palette import look
from procphys_ros.rotation import compose

# A part is drawn anew when it has moved by this much since it was last sent: [m] in position,
# [-] in the quaternion (0.01 degrees). No screen shows less.
_VISIBLE = 1e-4


class SceneMarkers:
    """
    Writes the markers of a scene and remembers what it wrote.

    A part whose pose is not finite does not exist: its marker is deleted.

    :param blueprint: all parts.
    :param objects: their owners, in part order.
    :param frame_id: frame of the poses.
    :param most_triangles: of leaves and twigs drawn in all, see `foliage`.
    :ivar shows_leaf_poses: whether leaves are drawn one by one, where their own poses are.
    """

    def __init__(self, blueprint: Blueprint, objects: Sequence[PlacedObject], frame_id: str,
                 most_triangles: int = 40_000):
        self._count = len(blueprint)
        self._petioles = blueprint.leaves
        self.shows_leaf_poses = bool(len(blueprint.leaves)) and not too_many(blueprint,
                                                                              most_triangles)
        rows = len(blueprint) + self.shows_leaf_poses * len(blueprint.leaves)
        self._sent = np.full((rows, 7), np.nan)
        self._rows = _part_rows(blueprint, objects, frame_id)
        self._leaves = [
            (entry, TriangleList(f'{o.name}/leaves', entry.texture, frame_id,
                                 look(blueprint.textures[entry.texture]).rgba))
            for o, entry in foliage(blueprint, objects, most_triangles)]
        self._clear, fields = _blank_rows(0, 1, frame_id)
        fields['action'] = Action.DELETEALL

    def __len__(self) -> int:
        """Give the number of parts."""
        return self._count

    def whole(self, poses: np.ndarray, at: Stamp, leaf_poses: np.ndarray | None = None) -> bytes:
        """
        Write every marker that exists, after one that clears what stood there before.

        :param poses: poses of all parts, (N, 7).
        :param at: stamp of the markers.
        :param leaf_poses: petioles of all leaves, (L, 7), if `shows_leaf_poses`; None = still.
        """
        self._sent[:] = np.nan
        chunks, count = self._changed(self._all_rows(poses, leaf_poses), at)
        return marker_array([self._clear.tobytes(), *chunks], count + 1)

    def changes(self, poses: np.ndarray, at: Stamp,
                leaf_poses: np.ndarray | None = None) -> bytes | None:
        """
        Write the markers that changed since the last call; None when there are none.

        :param poses: poses of all parts, (N, 7).
        :param at: stamp of the markers.
        :param leaf_poses: as for `whole`.
        """
        chunks, count = self._changed(self._all_rows(poses, leaf_poses), at)
        return marker_array(chunks, count) if count else None

    def _all_rows(self, poses: np.ndarray, leaf_poses: np.ndarray | None) -> np.ndarray:
        """Put the poses of leaves behind those of parts, when leaves are shown one by one."""
        if not self.shows_leaf_poses:
            return poses
        if leaf_poses is None:
            leaf_poses = compose(poses[self._petioles.part], self._petioles.pose)
        return np.concatenate([poses, leaf_poses])

    def _changed(self, poses: np.ndarray, at: Stamp) -> tuple[list[bytes], int]:
        there, was = np.isfinite(poses).all(axis=1), np.isfinite(self._sent[:, 0])
        moved = there & ~(np.abs(poses - self._sent).max(axis=1) <= _VISIBLE)
        gone = was & ~there
        chunks, count = [], 0
        for parts, rows, layout in self._rows:
            chosen = np.flatnonzero((moved | gone)[parts])
            if len(chosen):
                out = rows[chosen]
                fields = out.view(layout)[:, 0]
                fields['stamp'] = at
                fields['pose'] = np.where(there[parts[chosen], None], poses[parts[chosen]],
                                          (0, 0, 0, 0, 0, 0, 1))
                fields['action'][gone[parts[chosen]]] = Action.DELETE
                chunks.append(out.tobytes())
                count += len(chosen)
        shown = np.where(there[:, None], poses, 0.0)  # corners of lost parts shrink to a point
        for entry, marker in self._leaves:
            if (moved | gone)[entry.carriers].any():
                chunks.append(marker.write(entry.placed(shown), at))
                count += 1
        self._sent[moved] = poses[moved]
        self._sent[gone] = np.nan
        return chunks, count


def _blank_rows(namespace_bytes: int, count: int,
                frame_id: str) -> tuple[np.ndarray, np.ndarray]:
    """
    Give empty markers as bytes (count, L), and the same memory as records (count,).

    The bytes lead, because numpy does not copy what lies between the fields of a record.
    """
    layout, template = row_layout(namespace_bytes, frame_id)
    rows = np.tile(np.frombuffer(template, np.uint8), (count, 1))
    return rows, rows.view(layout)[:, 0]


def _part_rows(blueprint: Blueprint, objects: Sequence[PlacedObject],
               frame_id: str) -> list[tuple[np.ndarray, np.ndarray, np.dtype]]:
    """Prepare the markers of all parts, grouped by the length of their namespace."""
    size, kind, colour = _appearance(blueprint)
    lengths = np.array([len(o.name.encode()) for o in objects], int)
    groups = []
    for length in np.unique(lengths):
        mine = [o for o, n in zip(objects, lengths) if n == length and o.count]
        if not mine:
            continue
        parts = np.concatenate([np.arange(o.first, o.first + o.count) for o in mine])
        rows, fields = _blank_rows(int(length), len(parts), frame_id)
        names = np.array([np.frombuffer(o.name.encode(), np.uint8) for o in mine])
        fields['ns'] = np.repeat(names, [o.count for o in mine], axis=0)
        fields['id'], fields['type'] = parts, kind[parts]
        fields['scale'], fields['color'] = size[parts], colour[parts]
        groups.append((parts, rows, fields.dtype))
    return groups


def _appearance(blueprint: Blueprint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give extents [m], marker type and colour of every part."""
    capsule = blueprint.shape == Shape.CAPSULE
    size = blueprint.visual_size.copy()
    # RViz draws no cones: a tapered segment becomes a cylinder of its middle diameter.
    size[capsule, :2] = blueprint.visual_size[capsule, :2].mean(axis=1, keepdims=True)
    kind = np.where(capsule, Kind.CYLINDER, Kind.CUBE)
    ball = balls(blueprint)
    kind[ball], size[ball] = Kind.SPHERE, blueprint.size[ball]
    looks = [look(name) for name in blueprint.textures] or [look('')]
    colour = np.array([one.rgba for one in looks])[blueprint.texture]
    # Neighbouring bricks differ a little, always in the same way.
    spread = np.array([one.variation for one in looks])[blueprint.texture]
    shade = 1.0 + spread * np.random.default_rng(0).uniform(-1.0, 1.0, len(blueprint))
    colour[:, :3] = np.clip(colour[:, :3] * shade[:, None], 0.0, 1.0)
    return size, kind, colour
