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
Archive: a table and arrays as bytes, and back.

The bytes are a line that names the format, a SHA-256 checksum of all that follows, the length of
the table, the table as JSON, and the arrays one behind the other as they lie in memory. Nothing is
compressed, so that what is read takes about as much memory as it has bytes: an archive of a few
megabytes cannot unpack to gigabytes.
"""

from collections.abc import Sequence
import hashlib
import json
import math
from typing import Any

import numpy as np

from procphys_ros.errors import SnapshotError

_MAGIC = b'procphys_ros state 2\n'
_FORMER = b'procphys_ros snapshot 1\n'  # of versions that used pickles
_DIGEST = hashlib.sha256().digest_size
_LENGTH = 8  # [bytes] of the length of the table
# [bytes] of a table: one of 10,000 bodies has 1 MB, and takes 30 times the memory as objects.
_LONGEST_TABLE = 16 << 20
_PLAIN = (np.bool_, np.int8, np.int16, np.int32, np.int64, np.uint8, np.uint16, np.uint32,
          np.uint64, np.float32, np.float64)


def pack(table: dict[str, Any], arrays: Sequence[np.ndarray], records: Sequence[np.dtype]
         ) -> bytes:
    """
    Write a table and arrays.

    :param table: of values that JSON can encode.
    :param arrays: of plain numbers, or of a dtype in `records`.
    :param records: dtypes with several columns.
    """
    names = {dtype: name for name, dtype in _dtypes(records).items()}
    heads = [[names[array.dtype], list(array.shape)] for array in arrays]
    text = json.dumps({**table, 'arrays': heads}, separators=(',', ':')).encode()
    parts = [len(text).to_bytes(_LENGTH, 'little'), text,
             *(np.ascontiguousarray(array).tobytes() for array in arrays)]
    return seal(b''.join(parts))


def seal(content: bytes) -> bytes:
    """Prepend the name of the format and the checksum to the content of an archive."""
    return _MAGIC + hashlib.sha256(content).digest() + content


def is_archive(data: bytes | bytearray) -> bool:
    """Return whether data begin like an archive of this or the former format."""
    return data.startswith((_MAGIC, _FORMER))


def unpack(data: bytes, records: Sequence[np.dtype]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """
    Read a table and arrays.

    :param data: from `pack`.
    :param records: dtypes with several columns.
    :returns: the table, and read-only views of the data.
    :raises SnapshotError: if the data are not an archive, or damaged.
    """
    if not isinstance(data, (bytes, bytearray)) or not is_archive(data):
        raise SnapshotError('this is no snapshot of a simulation')
    if data.startswith(_FORMER):
        raise SnapshotError('the snapshot was saved by an older version of procphys_ros, in a '
                            'format that is not read any more; save it anew')
    start = len(_MAGIC) + _DIGEST
    view = memoryview(data)
    if hashlib.sha256(view[start:]).digest() != view[len(_MAGIC):start]:
        raise SnapshotError('the snapshot is damaged: its content does not fit its checksum')
    rest = start + _LENGTH
    end = rest + int.from_bytes(view[start:rest], 'little')
    if end > min(len(data), rest + _LONGEST_TABLE):
        raise SnapshotError('the snapshot is damaged: its table is longer than it can be')
    try:
        table = json.loads(bytes(view[rest:end]))
        return table, _views(table.pop('arrays'), view[end:], _dtypes(records))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError,
            RecursionError) as error:
        raise SnapshotError('the snapshot is damaged: its table cannot be read') from error


def _views(heads: Any, data: memoryview, dtypes: dict[str, np.dtype]) -> list[np.ndarray]:
    """Create array views of the data; their sizes must add up to it."""
    views, start = [], 0
    for name, shape in heads:
        if not all(type(length) is int and length >= 0 for length in shape):
            raise ValueError('a shape is not one of an array')
        dtype, count = dtypes[name], math.prod(shape)
        end = start + count * dtype.itemsize
        if end > len(data):
            raise ValueError('there are more numbers in the table than behind it')
        views.append(np.ndarray(shape, dtype, data[start:end]))
        start = end
    if start != len(data):
        raise ValueError('there are more numbers behind the table than in it')
    return views


def _dtypes(records: Sequence[np.dtype]) -> dict[str, np.dtype]:
    """Return the dtypes that an archive may hold, by name."""
    return {str(dtype): dtype for dtype in (*map(np.dtype, _PLAIN), *records)}
