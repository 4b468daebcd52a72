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


"""Transforms of objects as tf2_msgs/TFMessage: one template, of which only numbers change."""

from collections.abc import Sequence

import numpy as np

from procphys_ros.messages.cdr import CdrWriter, ENCAPSULATION, Stamp

_NOWHERE = (0, 0, 0, 0, 0, 0, 1)


class TransformMessage:
    """
    Write the transforms of a set of frames.

    :param names: of the frames.
    :param frame_id: of the parent frame.
    """

    def __init__(self, names: Sequence[str], frame_id: str):
        writer = CdrWriter()
        writer.numbers('I', len(names))
        stamps, poses = [], []
        for name in names:
            stamps.append(writer.header((0, 0), frame_id))
            writer.string(name)
            poses.append(writer.numbers('d', *_NOWHERE))
        self._length = len(writer.getvalue())
        writer.align(8)
        self._bytes = np.frombuffer(writer.getvalue(), np.uint8).copy()
        # Every field lies at a multiple of its own size.
        self._stamps = np.array(stamps, int)[:, None] // 4 + np.arange(2)
        self._poses = np.array(poses, int)[:, None] // 8 + np.arange(7)

    def write(self, poses: np.ndarray, at: Stamp) -> bytes:
        """
        Write the message.

        :param poses: of the frames, (K, 7), in their order.
        :param at: stamp of all of them.
        """
        self._bytes.view('<u4')[self._stamps] = at
        self._bytes.view('<f8')[self._poses] = poses
        return ENCAPSULATION + self._bytes.tobytes()[:self._length]
