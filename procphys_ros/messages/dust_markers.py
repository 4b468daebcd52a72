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


"""Markers of dust: translucent spheres, one marker for puffs of about the same size."""

import numpy as np

from procphys_ros.appearance.palette import rgba
from procphys_ros.messages.cdr import Stamp
from procphys_ros.messages.marker_rows import ListMarker, MarkerType
from procphys_ros.physics.dust import Puffs

NAMESPACE = 'dust'
_EDGES = 0.1 * 2.0 ** np.arange(1, 7)  # [m] diameters between the markers, 0.2 to 6.4
_MOST = 5000  # puffs drawn at once; of more, evenly chosen ones
_FAINTEST = 5e-3  # smallest visible opacity


class DustMarkers:
    """
    Write the markers of puffs, and remember the written state.

    :param frame_id: frame of the positions.
    :param namespace: `ns` of the markers.
    """

    def __init__(self, frame_id: str, namespace: str = NAMESPACE):
        colour = rgba('mortar')
        self._colour = np.array(colour)
        self._lists = [ListMarker(MarkerType.SPHERE_LIST, namespace, number, frame_id, colour)
                       for number in range(len(_EDGES) + 1)]
        self._sent: list[bytes | None] = [b''] * len(self._lists)

    def forget(self) -> None:
        """Write, or delete, all markers next time."""
        self._sent = [None] * len(self._lists)

    @property
    def deletions(self) -> list[bytes]:
        """Return the deletions of all markers."""
        return [marker.deletion for marker in self._lists]

    def write(self, puffs: Puffs, at: Stamp) -> tuple[list[bytes], int]:
        """
        Write the markers that changed.

        :param puffs: all dust.
        :param at: stamp of the markers.
        :returns: the markers, and their number.
        """
        seen = np.flatnonzero(puffs.opacity > _FAINTEST)
        seen = seen[::-(-len(seen) // _MOST) or 1]
        group = np.digitize(puffs.sizes[seen], _EDGES)
        chunks = []
        for number, marker in enumerate(self._lists):
            mine = seen[group == number]
            points = puffs.positions[mine].tobytes()
            if points == self._sent[number]:
                continue
            self._sent[number] = points
            chunks.append(self._write(marker, puffs, mine, at) if len(mine)
                          else marker.deletion)
        return chunks, len(chunks)

    def _write(self, marker: ListMarker, puffs: Puffs, mine: np.ndarray, at: Stamp) -> bytes:
        colours = np.tile(self._colour, (len(mine), 1))
        colours[:, 3] = puffs.opacity[mine]
        return marker.write(puffs.positions[mine], at, colours, float(puffs.sizes[mine].mean()))
