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


"""Dust: puffs as translucent balls, a fixed number of copies of one mesh."""

from typing import Any

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.view.source import Frame

_MOST = 1500  # puffs drawn at once; of more, evenly chosen ones
_FAINTEST = 0.01  # smallest visible opacity


class DustSpheres:
    """
    Draw puffs; send nothing while there are none.

    :param scene: `ViserServer.scene`.
    :param unit: length of the page [1/m].
    """

    def __init__(self, scene: Any, unit: float):
        self._scene, self._unit = scene, unit
        self._handle: Any = None
        self._drawn = np.zeros((0, 3))

    def update(self, frame: Frame) -> None:
        """Draw the present puffs."""
        puffs = frame.dust
        seen = np.flatnonzero(puffs.opacity > _FAINTEST)
        seen = seen[::-(-len(seen) // _MOST) or 1]
        place = puffs.positions[seen]
        if np.array_equal(place, self._drawn):
            return
        self._drawn = place.copy()
        if self._handle is None:
            self._handle = self._add()
        positions, scales, opacity = np.zeros((_MOST, 3)), np.zeros((_MOST, 3)), np.zeros(_MOST)
        positions[:len(seen)] = self._unit * place
        scales[:len(seen)] = self._unit * puffs.sizes[seen, None]
        opacity[:len(seen)] = puffs.opacity[seen]
        self._handle.batched_positions = positions
        self._handle.batched_scales = scales
        self._handle.batched_opacities = opacity

    def close(self) -> None:
        """Remove the dust from the page."""
        if self._handle is not None:
            self._handle.remove()

    def _add(self) -> Any:
        import trimesh
        mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
        colour = tuple(int(255 * value) for value in rgba('mortar')[:3])
        return self._scene.add_batched_meshes_simple(
            '/dust', mesh.vertices, mesh.faces, np.tile([1.0, 0.0, 0.0, 0.0], (_MOST, 1)),
            np.zeros((_MOST, 3)), batched_scales=np.zeros((_MOST, 3)), batched_colors=colour,
            batched_opacities=np.zeros(_MOST), opacity=0.99, lod='off', cast_shadow=False,
            receive_shadow=False)
