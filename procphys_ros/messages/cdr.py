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
Common Data Representation, the bytes that ROS 2 messages travel as (OMG DDS-XTypes, XCDR1).

Little endian; every primitive is aligned to its own size, counted from the end of the four bytes
that head the message. Only what the simulator publishes is here.
"""

from collections.abc import Sequence
import struct

import numpy as np

ENCAPSULATION = b'\x00\x01\x00\x00'  # plain CDR, little endian, no options

Stamp = tuple[int, int]  # seconds and nanoseconds of simulation time


def stamp(time: float) -> Stamp:
    """Split a time [s] into whole seconds and nanoseconds, as in builtin_interfaces/Time."""
    nanoseconds = round(time * 1e9)
    return nanoseconds // 10**9, nanoseconds % 10**9


class CdrWriter:
    """
    Append primitives with the padding of CDR.

    :param position: number of bytes between the encapsulation and this writer's first one.
    """

    def __init__(self, position: int = 0):
        self._start = position
        self._buffer = bytearray()

    @property
    def position(self) -> int:
        """Offset of the next byte, counted from the end of the encapsulation."""
        return self._start + len(self._buffer)

    def align(self, size: int) -> int:
        """Pad to a multiple of `size` bytes; return the offset inside this writer's bytes."""
        self._buffer += bytes(-self.position % size)
        return len(self._buffer)

    def numbers(self, code: str, *values: float) -> int:
        """
        Write numbers of one type; return the offset of the first inside this writer's bytes.

        :param code: format character of `struct`: i, I, f, d, B or ?.
        """
        offset = self.align(struct.calcsize(code))
        self._buffer += struct.pack(f'<{len(values)}{code}', *values)
        return offset

    def string(self, text: str) -> None:
        """Write a string: its length with the closing NUL, then its UTF-8 bytes."""
        encoded = text.encode() + b'\0'
        self.numbers('I', len(encoded))
        self._buffer += encoded

    def header(self, at: Stamp, frame_id: str) -> int:
        """Write a std_msgs/Header; return the offset of its stamp inside this writer's bytes."""
        offset = self.numbers('i', at[0])
        self.numbers('I', at[1])
        self.string(frame_id)
        return offset

    def raw(self, data: bytes | np.ndarray) -> None:
        """Write bytes as they are."""
        self._buffer += data if isinstance(data, bytes) else data.tobytes()

    def getvalue(self) -> bytes:
        """Return all bytes written so far, without encapsulation."""
        return bytes(self._buffer)


def stamped_numbers(values: Sequence[float] | np.ndarray, at: Stamp, frame_id: str) -> bytes:
    """
    Write a header and doubles: a Vector3Stamped, AccelStamped or WrenchStamped of geometry_msgs.

    :param values: 3 or 6.
    :param at: stamp of the message.
    :param frame_id: name of the frame.
    """
    writer = CdrWriter()
    writer.header(at, frame_id)
    writer.numbers('d', *values)
    return ENCAPSULATION + writer.getvalue()


def clock(at: Stamp) -> bytes:
    """Write a rosgraph_msgs/Clock."""
    return ENCAPSULATION + np.array(at, '<i4').tobytes()
