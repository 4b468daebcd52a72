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
Bytes of single markers: rows of one layout that numpy fills many at a time.

In a MarkerArray the first marker starts four bytes after the encapsulation. Every marker written
here is as long as a multiple of eight bytes, so each of them starts at the same alignment and
they can be put together in any order. The filling goes into the field `text`, which RViz reads
for text markers only.
"""

from collections.abc import Sequence
import struct
from typing import Any

import numpy as np

from procphys_ros.elementary.array_enum import ArrayEnum
from procphys_ros.messages.cdr import CdrWriter, ENCAPSULATION, Stamp

Colour = tuple[float, float, float, float]

_NO_TIME: Stamp = (0, 0)
_START = 4  # alignment of every marker: after the count of the array
BEFORE = 8 - _START  # bytes before markers in memory, so that their numbers are aligned there
Chunk = bytes | memoryview
"""Markers as they go into a message: contiguous bytes."""


class MarkerType(ArrayEnum):
    """Used values of Marker.type."""

    CUBE = 1
    SPHERE = 2
    CYLINDER = 3
    SPHERE_LIST = 7
    MESH_RESOURCE = 10
    TRIANGLE_LIST = 11


class Action(ArrayEnum):
    """Marker.action."""

    ADD = 0
    DELETE = 2
    DELETEALL = 3


def row_layout(namespace_bytes: int, frame_id: str, mesh: str = '',
               points: int = 0) -> tuple[np.dtype, bytes]:
    """
    Lay out a marker with a fixed number of points for all namespaces of one length.

    :param namespace_bytes: length of `ns` in UTF-8.
    :param frame_id: frame of the markers.
    :param mesh: resource drawn with its own materials; '' = none.
    :param points: their number.
    :returns: dtype of the varying fields, with the size of a marker; and the marker's bytes
        with those fields empty.
    """
    namespace = 'x' * namespace_bytes
    head, offsets = _head(namespace, frame_id, MarkerType.CUBE, (0.0, 0.0, 0.0, 0.0))
    head.numbers('I', points)
    if points:
        offsets['points'] = head.align(8)
        head.raw(bytes(24 * points))
    data = _finish(head, mesh)
    formats: dict[str, Any] = {
        'stamp': ('<u4', 2), 'ns': ('u1', (namespace_bytes,)), 'id': '<i4', 'type': '<i4',
        'action': '<i4', 'pose': ('<f8', 7), 'scale': ('<f8', 3), 'color': ('<f4', 4)}
    if points:
        formats['points'] = ('<f8', (points, 3))
    layout = np.dtype({'names': list(formats), 'formats': list(formats.values()),
                       'offsets': [offsets[name] for name in formats], 'itemsize': len(data)})
    return layout, data


class ListMarker:
    """
    A marker with a varying list of points: TRIANGLE_LIST or SPHERE_LIST.

    :param kind: one of these.
    :param namespace: `ns` of the marker.
    :param number: `id` of the marker.
    :param frame_id: frame of the points.
    :param rgba: colour without colours of points.
    :ivar deletion: marker that deletes it.
    """

    def __init__(self, kind: MarkerType, namespace: str, number: int, frame_id: str, rgba: Colour):
        self.deletion = command(Action.DELETE, namespace, number, frame_id)
        head, self._offsets = _head(namespace, frame_id, kind, rgba, number)
        self._count_at = head.numbers('I', 0)
        head.align(8)
        self._before = bytearray(head.getvalue())
        colour_count = 4  # bytes
        self._behind = _finish(head)[len(self._before) + colour_count:]

    def laid_out(self, points: int) -> tuple[bytes, int, int]:
        """Return the marker with points at the origin, and the offsets of its stamp and points."""
        data = self.write(np.zeros((points, 3)), (0, 0))
        return data, self._offsets['stamp'], len(self._before)

    def write(self, points: np.ndarray, at: Stamp, colours: np.ndarray | None = None,
              diameter: float = 1.0) -> bytes:
        """
        Write the marker.

        :param points: at least one; three for each triangle [m], (P, 3).
        :param at: stamp of the marker.
        :param colours: of the points, 0 to 1, (P, 4); None = the marker's own.
        :param diameter: of spheres [m].
        """
        struct.pack_into('<iI', self._before, self._offsets['stamp'], *at)
        struct.pack_into('<3d', self._before, self._offsets['scale'], *[diameter] * 3)
        struct.pack_into('<I', self._before, self._count_at, len(points))
        shades = b'' if colours is None else np.ascontiguousarray(colours, '<f4').tobytes()
        return b''.join((self._before, np.ascontiguousarray(points, '<f8').tobytes(),
                         struct.pack('<I', len(shades) // 16), shades, self._behind))


def command(action: Action, namespace: str, number: int, frame_id: str) -> bytes:
    """Write a marker that only executes an action on the marker of this `ns` and `id`."""
    layout, template = row_layout(len(namespace.encode()), frame_id)
    data = np.frombuffer(template, np.uint8).copy()
    fields = data.view(layout)
    fields['ns'] = np.frombuffer(namespace.encode(), np.uint8)
    fields['id'], fields['action'] = number, action
    return data.tobytes()


def marker_array(chunks: Sequence[Chunk], count: int) -> bytes:
    """Join markers, whole rows or single ones, to a visualization_msgs/MarkerArray."""
    return b''.join((ENCAPSULATION, np.uint32(count).tobytes(), *chunks))


def _head(namespace: str, frame_id: str, kind: MarkerType, rgba: Colour,
          number: int = 0) -> tuple[CdrWriter, dict[str, int]]:
    """Write a marker up to its points; return the offsets of its fields."""
    writer = CdrWriter(_START)
    offsets = {'stamp': writer.header(_NO_TIME, frame_id)}
    writer.string(namespace)
    offsets['ns'] = len(writer.getvalue()) - 1 - len(namespace.encode())
    offsets['id'] = writer.numbers('i', number)
    offsets['type'] = writer.numbers('i', kind)
    offsets['action'] = writer.numbers('i', Action.ADD)
    offsets['pose'] = writer.numbers('d', 0, 0, 0, 0, 0, 0, 1)
    offsets['scale'] = writer.numbers('d', 1, 1, 1)
    offsets['color'] = writer.numbers('f', *rgba)
    writer.numbers('I', 0, 0)  # lifetime: for ever
    writer.numbers('?', False)  # not locked to a moving frame
    return writer, offsets


def _finish(head: CdrWriter, mesh: str = '') -> bytes:
    """Write the fields after the points, padded to a multiple of eight bytes."""
    for filling in range(8):
        writer = CdrWriter(_START)
        writer.raw(head.getvalue())
        writer.numbers('I', 0)  # colours
        writer.string('')  # texture_resource
        writer.header(_NO_TIME, '')  # texture: header, format, data
        writer.string('')
        writer.numbers('I', 0)
        writer.numbers('I', 0)  # uv_coordinates
        writer.string(' ' * filling)  # text
        writer.string(mesh)  # mesh_resource
        writer.string('')  # mesh_file: filename, data
        writer.numbers('I', 0)
        writer.numbers('?', bool(mesh))  # mesh_use_embedded_materials
        if writer.align(4) % 8 == 0:
            return writer.getvalue()
    raise AssertionError('a string of 0 to 7 blanks reaches every alignment')
