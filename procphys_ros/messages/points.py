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

from procphys_ros.messages.cdr import CdrWriter, ENCAPSULATION, Stamp
from procphys_ros.physics.dust import Puffs

# sensor_msgs/PointField datatypes
_DATATYPES = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}

BREAK = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('bond', '<i4'), ('part_a', '<i4'),
                  ('part_b', '<i4'), ('cause', '<u4'), ('load', '<f4'), ('crack', '<u4')])


DUST = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('size', '<f4'), ('opacity', '<f4')])


# Points of a lidar scan: the range along the ray, and the hit part.
SCAN = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('range', '<f4'), ('part', '<i4')])


def point_cloud(rows: np.ndarray, at: Stamp, frame_id: str) -> bytes:
    """
    Write a sensor_msgs/PointCloud2, one field per column.

    :param rows: structured array with x, y, z and any other numbers, (N,); or (H, W) where points
        are ordered as in an image, missing ones NaN.
    :param at: stamp of the message.
    :param frame_id: name of the frame.
    """
    writer = CdrWriter()
    writer.header(at, frame_id)
    height, width = rows.shape if rows.ndim == 2 else (1, len(rows))
    writer.numbers('I', height, width)
    fields: Mapping = rows.dtype.fields or {}
    writer.numbers('I', len(fields))
    for name, (kind, offset, *_) in fields.items():
        writer.string(name)
        writer.numbers('I', offset)
        writer.numbers('B', _DATATYPES[kind.str[1:]])
        writer.numbers('I', 1)
    writer.numbers('?', False)  # little endian
    step = rows.dtype.itemsize
    writer.numbers('I', step, step * width, rows.nbytes)  # of a point, of a row, of all
    writer.raw(np.ascontiguousarray(rows))
    writer.numbers('?', rows.ndim == 1)  # no invalid points
    return ENCAPSULATION + writer.getvalue()


def dust_rows(puffs: Puffs) -> np.ndarray:
    """Convert puffs of dust to rows of a point cloud, of dtype `DUST`, (N,)."""
    rows = np.empty(len(puffs.sizes), DUST)
    rows['x'], rows['y'], rows['z'] = puffs.positions.T
    rows['size'], rows['opacity'] = puffs.sizes, puffs.opacity
    return rows


def scan_rows(points: np.ndarray, ranges: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """
    Convert a lidar scan to rows of a point cloud.

    :param points: [m], (H, W, 3), NaN without a hit.
    :param ranges: [m], (H, W).
    :param parts: hit ones, (H, W).
    :returns: rows of dtype `SCAN`, (H, W).
    """
    rows = np.empty(ranges.shape, SCAN)
    for axis, name in enumerate('xyz'):
        rows[name] = points[..., axis]
    rows['range'], rows['part'] = ranges, parts
    return rows


def break_rows(events: np.ndarray) -> np.ndarray:
    """
    Convert break events to rows of a point cloud.

    :param events: records with position, bond, part_a, part_b, cause, load and crack, (N,).
    :returns: rows of dtype `BREAK`, (N,).
    """
    rows = np.empty(len(events), BREAK)
    rows['x'], rows['y'], rows['z'] = events['position'].T
    for name in ('bond', 'part_a', 'part_b', 'cause', 'load', 'crack'):
        rows[name] = events[name]
    return rows
