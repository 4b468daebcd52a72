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

"""Marker state: the markers that a viewer shows after all MarkerArrays so far."""

import numpy as np

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.messages.marker_rows import Action, command, marker_array

_START = 8  # of the first marker: after the encapsulation and the count


class MarkerState:
    """
    Keep the newest bytes of every marker.

    Markers from `messages.marker_rows` are a multiple of eight bytes long and can be joined in any
    order; arrays with others are ignored.
    """

    def __init__(self) -> None:
        self._frame = ''
        self._markers: dict[tuple[bytes, int], bytes] = {}

    def __len__(self) -> int:
        return len(self._markers)

    def update(self, data: bytes) -> None:
        """Process a visualization_msgs/MarkerArray, CDR with its encapsulation."""
        for start, end, name, name_end, number, action in find_markers(data).tolist():
            if (end - start) % 8:
                return
            key = (data[name:name_end], number)
            length = int.from_bytes(data[start + 8:start + 12], 'little')
            self._frame = data[start + 12:start + 11 + length].decode()
            if action == Action.DELETEALL:
                self._markers.clear()
            elif action == Action.DELETE:
                self._markers.pop(key, None)
            else:
                self._markers[key] = data[start:end]

    def whole(self) -> bytes:
        """Write a MarkerArray that clears the view and shows all markers."""
        clear = command(Action.DELETEALL, '', 0, self._frame)
        return marker_array([clear, *self._markers.values()], len(self._markers) + 1)


def find_markers(data: bytes) -> np.ndarray:
    """
    Find the markers of a MarkerArray in little-endian CDR.

    :returns: offsets of each marker's start, end, the start and end of its namespace, its id, and
        its action, (K, 6) int.
    """
    count = int.from_bytes(data[4:8], 'little')
    out = np.zeros((count, 6), np.int64)
    _walk(np.frombuffer(data, np.uint8), out)
    return out


@kernel
def _walk(data, out):
    at = _START
    for row in range(len(out)):
        at = _aligned(at, 4)
        out[row, 0] = at
        at = _string(data, at + 8)  # after the stamp: frame_id
        at = _aligned(at, 4)
        out[row, 2] = at + 4
        at = _string(data, at)
        out[row, 3] = at - 1  # without the closing zero
        at = _aligned(at, 4)
        out[row, 4] = np.int32(_word(data, at))
        out[row, 5] = np.int32(_word(data, at + 8))
        # Pose, scale, colour, lifetime, frame_locked.
        at = _aligned(at + 12, 8) + 7 * 8 + 3 * 8 + 4 * 4 + 2 * 4 + 1
        at = _sequence(data, at, 8, 24)   # points
        at = _sequence(data, at, 4, 16)   # colors
        at = _string(data, _aligned(at, 4))  # texture_resource
        at = _string(data, _aligned(at, 4) + 8)  # texture: stamp, frame_id
        at = _string(data, _aligned(at, 4))  # format
        at = _sequence(data, at, 1, 1)    # data
        at = _sequence(data, at, 4, 8)    # uv_coordinates
        for _ in range(3):                # text, mesh_resource, mesh_file.filename
            at = _string(data, _aligned(at, 4))
        at = _sequence(data, at, 1, 1) + 1  # mesh_file.data, mesh_use_embedded_materials
        # The padding after the last flag belongs to the marker, too.
        at = _aligned(at, 4)
        out[row, 1] = min(at, len(data))


@subroutine
def _word(data, at):
    return (np.uint32(data[at]) | np.uint32(data[at + 1]) << np.uint32(8)
            | np.uint32(data[at + 2]) << np.uint32(16) | np.uint32(data[at + 3]) << np.uint32(24))


@subroutine
def _aligned(at, size):
    """Return the next offset with an alignment relative to the end of the encapsulation."""
    return at + (4 - at) % size


@subroutine
def _string(data, at):
    return at + 4 + np.int64(_word(data, at))


@subroutine
def _sequence(data, at, alignment, size):
    at = _aligned(at, 4)
    count = np.int64(_word(data, at))
    at += 4
    return _aligned(at, alignment) + count * size if count else at
