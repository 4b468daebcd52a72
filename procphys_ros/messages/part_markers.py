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


"""Markers of parts: cubes, cylinders, spheres, and meshes for boxes that have moved."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.appearance.palette import look
from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.blueprint.cut_bricks import first_pieces
from procphys_ros.compilation import kernel
from procphys_ros.geometry.hexahedron import FACES
from procphys_ros.messages.cdr import Stamp
from procphys_ros.messages.foliage import PlacedObject
from procphys_ros.messages.marker_rows import Action, BEFORE, MarkerType, row_layout

_HULL = np.concatenate([FACES[:, [0, 1, 2]], FACES[:, [0, 2, 3]]]).ravel()  # of a hexahedron
_DELETE = int(Action.DELETE)


class _Rows:
    """
    Prepared markers of some parts with namespaces of equal length.

    :param parts: their indices, (K,).
    :param namespaces: bytes of `ns`, (K, L).
    :param frame_id: frame of the poses.
    :param mesh: resource to draw; '' = the shape.
    :param points: number of points of each marker.
    """

    def __init__(self, parts: np.ndarray, namespaces: np.ndarray, frame_id: str, mesh: str = '',
                 points: int = 0):
        self.parts = parts
        layout, template = row_layout(namespaces.shape[1], frame_id, mesh, points)
        # The bytes are the base array: numpy does not copy gaps between the fields of a record.
        self._bytes = np.tile(np.frombuffer(template, np.uint8), (len(parts), 1))
        self._layout = layout
        self.fields = self._bytes.view(layout)[:, 0]
        self.fields['ns'], self.fields['id'] = namespaces, parts
        assert layout.fields is not None
        self._places = np.array([layout.fields[name][1] // 4
                                 for name in ('stamp', 'action', 'pose')])

    def write(self, chosen: np.ndarray, poses: np.ndarray, at: Stamp) -> memoryview:
        """Write the chosen rows; those of missing parts are deletions."""
        length = self._layout.itemsize
        out = np.empty(BEFORE + len(chosen) * length + BEFORE, np.uint8)
        _write(self._bytes.view(np.uint32), chosen, self.parts, poses, self._places,
               np.array(at, np.uint32), out.view(np.uint32), out.view(np.float64))
        return out.data[BEFORE:-BEFORE]


class PartMarkers:
    """
    Write one marker per part, `ns` = object, `id` = part index.

    :param frame_id: frame of the poses.
    :param mesh: resource for boxes once they have moved, a unit cube; '' = they stay cubes.
    """

    def __init__(self, frame_id: str, mesh: str = ''):
        self._frame = frame_id
        self._mesh = mesh
        self._shapes: list[_Rows] = []
        self._meshes: list[_Rows] = []
        self._may_have_mesh = np.zeros(0, bool)
        self._has_mesh = np.zeros(0, bool)

    def add(self, blueprint: Blueprint, objects: Sequence[PlacedObject]) -> None:
        """
        Prepare the markers of new parts.

        :param blueprint: all parts.
        :param objects: owners of the new ones.
        """
        new = len(blueprint) - len(self._has_mesh)
        self._has_mesh = np.append(self._has_mesh, np.zeros(new, bool))
        size, kind, colour = _appearance(blueprint)
        self._may_have_mesh = (kind == MarkerType.CUBE) & bool(self._mesh)
        hexahedra = blueprint.hexahedra
        lengths = np.array([len(o.name.encode()) for o in objects], int)
        for length in np.unique(lengths):
            mine = [o for o, n in zip(objects, lengths) if n == length and o.count]
            if not mine:
                continue
            parts = np.concatenate([np.arange(o.first, o.first + o.count) for o in mine])
            names = np.array([np.frombuffer(o.name.encode(), np.uint8) for o in mine])
            names = np.repeat(names, [o.count for o in mine], axis=0)
            box = kind[parts] == MarkerType.CUBE
            cut = hexahedra.among(parts)
            solids = _Rows(parts[cut.part], names[cut.part], self._frame,
                           points=len(_HULL))
            solids.fields['points'] = cut.corners.reshape(-1, 8, 3)[:, _HULL]
            plain = np.setdiff1d(np.arange(len(parts)), cut.part)
            shapes = _Rows(parts[plain], names[plain], self._frame)
            meshes = _Rows(parts[box], names[box], self._frame, self._mesh)
            for rows in (shapes, meshes, solids):
                rows.fields['scale'] = size[rows.parts]
                rows.fields['color'] = colour[rows.parts]
            shapes.fields['type'] = kind[parts[plain]]
            meshes.fields['type'] = MarkerType.MESH_RESOURCE
            solids.fields['type'] = MarkerType.TRIANGLE_LIST
            self._shapes += [shapes, solids]
            if self._mesh:
                self._meshes.append(meshes)

    def resize(self, blueprint: Blueprint) -> None:
        """Set the sizes of branches."""
        size = _appearance(blueprint)[0]
        for rows in self._shapes:
            own = blueprint.shape[rows.parts] == Shape.CAPSULE
            rows.fields['scale'][own] = size[rows.parts[own]]

    def write(self, poses: np.ndarray, at: Stamp, changed: np.ndarray,
              away: np.ndarray) -> tuple[list[memoryview], int]:
        """
        Write the markers of changed parts.

        :param poses: of all parts, (N, 7); parts with non-finite ones are deleted.
        :param at: stamp of the markers.
        :param changed: parts to write, (N,) bool.
        :param away: parts that have left their built poses, (N,) bool.
        :returns: the markers, and their number.
        """
        there = np.isfinite(poses[:, 0])
        self._has_mesh |= away & there & self._may_have_mesh
        chunks, count = [], 0
        for groups, wanted in ((self._meshes, changed & self._has_mesh),
                               (self._shapes, changed & ~self._has_mesh)):
            for rows in groups:
                chosen = np.flatnonzero(wanted[rows.parts])
                if len(chosen):
                    chunks.append(rows.write(chosen, poses, at))
                    count += len(chosen)
        return chunks, count


def _appearance(blueprint: Blueprint) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return extents [m], marker type and colour of every part."""
    capsule = blueprint.shape == Shape.CAPSULE
    size = blueprint.visual_size.copy()
    # RViz has no cones: a tapered segment becomes a cylinder of its middle diameter.
    size[capsule, :2] = blueprint.visual_size[capsule, :2].mean(axis=1, keepdims=True)
    kind = np.where(capsule, MarkerType.CYLINDER, MarkerType.CUBE)
    ball = blueprint.balls
    kind[ball], size[ball] = MarkerType.SPHERE, blueprint.size[ball]
    solid = blueprint.hexahedra.part
    kind[solid], size[solid] = MarkerType.TRIANGLE_LIST, 1.0
    looks = [look(name) for name in blueprint.textures] or [look('')]
    colour = np.array([one.rgba for one in looks])[blueprint.texture]
    # Neighbouring bricks differ slightly, always in the same way; pieces of one brick do not.
    spread = np.array([one.variation for one in looks])[blueprint.texture]
    tone = np.random.default_rng(0).uniform(-1.0, 1.0, len(blueprint))[first_pieces(blueprint)]
    shade = 1.0 + spread * tone
    colour[:, :3] = np.clip(colour[:, :3] * shade[:, None], 0.0, 1.0)
    return size, kind, colour


@kernel(nogil=True)
def _write(rows, chosen, parts, poses, places, at, words, numbers):
    """
    Copy consecutive rows, and fill in the varying fields; the first one begins at 4 bytes.

    :param places: of stamp, action and pose in a row, in words of 4 bytes.
    """
    length = rows.shape[1]
    for k in range(len(chosen)):
        i, start = chosen[k], 1 + k * length
        for word in range(length):
            words[start + word] = rows[i, word]
        words[start + places[0]], words[start + places[0] + 1] = at[0], at[1]
        part, pose = parts[i], (start + places[2]) // 2
        if np.isfinite(poses[part, 0]):
            for c in range(7):
                numbers[pose + c] = poses[part, c]
        else:
            words[start + places[1]] = _DELETE
