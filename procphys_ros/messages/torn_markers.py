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

"""Markers of torn wood: the ends of broken branches, root plates and pits, a marker per look."""

import numpy as np

from procphys_ros.appearance.palette import look
from procphys_ros.appearance.torn_wood import End, SOIL, TORN, TornEnds, WoodJoints
from procphys_ros.blueprint import Blueprint, GROUND
from procphys_ros.messages.cdr import Stamp
from procphys_ros.messages.marker_rows import ListMarker, MarkerType
from procphys_ros.messages.triangle_lists import place

_SEEN = 5e-4  # [m] smaller motion is not sent
_NONE = np.zeros((0, 3))


class TornMarkers:
    """
    Write the markers of torn wood, and remember the written state.

    :param blueprint: all parts and bonds.
    :param frame_id: frame of the poses.
    :param prefix: before the `ns` of the markers, `torn_wood` and `soil`.
    """

    def __init__(self, blueprint: Blueprint, frame_id: str, prefix: str = ''):
        self._joints = WoodJoints(blueprint)
        self._lists = {name: ListMarker(MarkerType.TRIANGLE_LIST, prefix + name, 0, frame_id,
                                        look(name).rgba) for name in (TORN, SOIL)}
        self._torn = TornEnds()
        self._known: dict[int, list[End]] = {}
        self._corners: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._sent: dict[str, np.ndarray] = {}

    def grow(self, blueprint: Blueprint) -> None:
        """Include the joints of parts that have joined."""
        self._joints = WoodJoints(blueprint)

    def forget(self) -> None:
        """Write all markers next time."""
        self._sent = {}
        self._torn.forget()

    @property
    def deletions(self) -> list[bytes]:
        """Return the deletions of all markers."""
        return [marker.deletion for marker in self._lists.values()]

    def write(self, poses: np.ndarray, at: Stamp) -> tuple[list[bytes], int]:
        """
        Write the markers that changed.

        :param poses: of all parts, (N, 7); not finite for missing parts.
        :param at: stamp of the markers.
        :returns: the markers, and their number.
        """
        torn = self._torn.update(self._joints, poses)
        if torn is not self._known:
            self._known = torn
            self._corners = {name: _joined(torn, name) for name in self._lists}
        chunks = []
        for name, marker in self._lists.items():
            points = _placed(poses, *self._corners.get(name, _joined({}, name)))
            sent = self._sent.get(name, _NONE)
            if len(points) == len(sent) and np.abs(points - sent).max(initial=0.0) < _SEEN:
                continue
            self._sent[name] = points
            chunks.append(marker.write(points, at) if len(points) else marker.deletion)
        return chunks, len(chunks)


def _joined(torn: dict[int, list[End]], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Join the ends of one look: the part of each corner, (P,), and the corners, (P, 3)."""
    ends = [(part, corners.reshape(-1, 3)) for some in torn.values()
            for own, part, corners in some if own == name]
    part = np.repeat(np.array([part for part, _ in ends], np.int64),
                     [len(corners) for _, corners in ends])
    return part, np.concatenate([_NONE, *(corners for _, corners in ends)])


def _placed(poses: np.ndarray, part: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Transform corners to the world, without those of missing parts, [m], (P, 3)."""
    there = (part == GROUND) | np.isfinite(poses[part, 0])
    if not there.all():
        part, corners = part[there], corners[there]
    out = np.empty_like(corners)
    if len(out):
        place(poses, part, corners, out)
    return out
