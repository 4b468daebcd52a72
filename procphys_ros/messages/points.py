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


"""PointCloud2 as bytes: one point per row of a structured numpy array."""

from collections.abc import Mapping

import numpy as np

from procphys_ros.messages.cdr import ENCAPSULATION, Stamp, Writer

# sensor_msgs/PointField datatypes
_DATATYPES = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}

BREAK = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('bond', '<i4'), ('part_a', '<i4'),
                  ('part_b', '<i4'), ('cause', '<u4'), ('load', '<f4')])


DUST = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('size', '<f4'), ('opacity', '<f4')])


def point_cloud(rows: np.ndarray, at: Stamp, frame_id: str) -> bytes:
    """
    Write a sensor_msgs/PointCloud2, one field per column.

    :param rows: structured array with x, y, z and any other numbers, (N,).
    :param at: stamp of the message.
    :param frame_id: name of the frame.
    """
    writer = Writer()
    writer.header(at, frame_id)
    writer.numbers('I', 1, len(rows))  # height, width
    fields: Mapping = rows.dtype.fields or {}
    writer.numbers('I', len(fields))
    for name, (kind, offset, *_) in fields.items():
        writer.string(name)
        writer.numbers('I', offset)
        writer.numbers('B', _DATATYPES[kind.str[1:]])
        writer.numbers('I', 1)
    writer.numbers('?', False)  # little endian
    writer.numbers('I', rows.dtype.itemsize, rows.nbytes, rows.nbytes)  # steps, length of data
    writer.raw(np.ascontiguousarray(rows))
    writer.numbers('?', True)  # no invalid points
    return ENCAPSULATION + writer.getvalue()


def dust_rows(positions: np.ndarray, sizes: np.ndarray, opacity: np.ndarray) -> np.ndarray:
    """
    Turn puffs of dust into rows of a point cloud.

    :param positions: [m], (N, 3).
    :param sizes: diameters [m], (N,).
    :param opacity: 0 to 1, (N,).
    :returns: rows of dtype `DUST`, (N,).
    """
    rows = np.empty(len(positions), DUST)
    rows['x'], rows['y'], rows['z'] = positions.T
    rows['size'], rows['opacity'] = sizes, opacity
    return rows


def break_rows(events: np.ndarray) -> np.ndarray:
    """
    Turn break events into rows of a point cloud.

    :param events: records with position, bond, part_a, part_b, cause and load, (N,).
    :returns: rows of dtype `BREAK`, (N,).
    """
    rows = np.empty(len(events), BREAK)
    rows['x'], rows['y'], rows['z'] = events['position'].T
    for name in ('bond', 'part_a', 'part_b', 'cause', 'load'):
        rows[name] = events[name]
    return rows
