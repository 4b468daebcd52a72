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


"""PoseArray as bytes: one row of a numpy array per pose."""

import numpy as np

from procphys_ros.messages.cdr import CdrWriter, ENCAPSULATION, Stamp


def pose_array(poses: np.ndarray, at: Stamp, frame_id: str) -> bytes:
    """
    Write a geometry_msgs/PoseArray.

    :param poses: x y z qx qy qz qw, (N, 7), in the frame named by `frame_id`.
    :param at: stamp of the message.
    :param frame_id: name of the frame.
    """
    writer = CdrWriter()
    writer.header(at, frame_id)
    writer.numbers('I', len(poses))
    if len(poses):
        writer.align(8)
    body = np.ascontiguousarray(poses, '<f8').tobytes()
    return b''.join((ENCAPSULATION, writer.getvalue(), body))


def read_pose_array(data: bytes) -> np.ndarray:
    """
    Read the poses of a geometry_msgs/PoseArray written by `pose_array`.

    :param data: little-endian CDR with its encapsulation.
    :returns: x y z qx qy qz qw, (N, 7).
    """
    name = int.from_bytes(data[12:16], 'little')  # after encapsulation and stamp: frame_id
    at = 12 + name + (-name) % 4  # in the body, after the encapsulation
    count = int.from_bytes(data[4 + at:8 + at], 'little')
    at += 4
    at += (-at) % 8
    return np.frombuffer(data, '<f8', 7 * count, 4 + at).reshape(count, 7) if count \
        else np.zeros((0, 7))
