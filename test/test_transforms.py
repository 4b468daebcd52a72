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


"""Transforms of objects: bytes as tf2_msgs has them, frames of what is left, a clear warning."""

import struct
import sys
from types import SimpleNamespace

from geometry_msgs.msg import TransformStamped
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from procphys_ros import messages
from procphys_ros.messages.transforms import TransformMessage
from procphys_ros.ros import qos
from procphys_ros.ros.transforms import frames, TransformPublisher


def test_messages_are_those_that_ros_writes():
    """Compare with bytes that ROS makes of one transform after the other."""
    names = ['a', 'oak_0', 'a_longer_name']
    poses = np.random.default_rng(0).random((3, 7))
    data = TransformMessage(names, 'world').write(poses, (5, 7))
    assert struct.unpack_from('<I', data, 4) == (3,)
    for name, pose in zip(names, poses):
        stamped = TransformStamped(child_frame_id=name)
        stamped.header.frame_id = 'world'
        stamped.header.stamp.sec, stamped.header.stamp.nanosec = 5, 7
        for target, values in ((stamped.transform.translation, pose[:3]),
                               (stamped.transform.rotation, pose[3:])):
            for axis, value in zip('xyzw', values):
                setattr(target, axis, value)
        whole = serialize_message(stamped)
        # Numbers have the same bytes wherever they are; what lies between only fills up.
        assert whole[-56:] in data
    alone = TransformMessage(['oak'], 'map').write(poses[:1], (5, 7))
    assert struct.unpack_from('<iI', alone, 8) == (5, 7)
    assert alone[16:24] == b'\x04\0\0\0map\0' and alone[24:32] == b'\x04\0\0\0oak\0'
    assert np.frombuffer(alone[36:], '<f8').tolist() == poses[0].tolist()


def test_frames_are_at_the_first_part_that_is_left():
    """Leave out objects of which nothing is left."""
    poses = np.zeros((7, 7))
    poses[[0, 1, 5, 6]] = np.nan
    objects = [SimpleNamespace(name=name, first=first, count=count) for name, first, count in
               (('wall', 0, 3), ('oak', 3, 2), ('ball', 5, 1), ('none', 7, 0))]
    names, parts = frames(SimpleNamespace(poses=poses, objects=objects))
    assert names == ('wall', 'oak') and parts.tolist() == [2, 3]


class Node:
    """Takes down what is said, and publishes nothing."""

    def __init__(self):
        self.said = []
        self.context = SimpleNamespace(ok=lambda: True)

    def get_logger(self):
        """Return an object that records warnings."""
        return SimpleNamespace(warning=self.said.append)


@pytest.mark.parametrize('messages', [None, SimpleNamespace(),
                                      SimpleNamespace(TFMessage=SimpleNamespace)])
def test_without_tf2_msgs_one_warning_is_all(monkeypatch, messages):
    """Say what is missing, and how to get it; then do nothing. Half of it is as good as none."""
    monkeypatch.setitem(sys.modules, 'tf2_msgs', SimpleNamespace())
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', messages)
    node = Node()
    publisher = TransformPublisher(node, 'world')
    for moved in (True, False):
        publisher.publish(SimpleNamespace(), moved)
    assert len(node.said) == 1 and 'tf2-msgs' in node.said[0]


def test_an_object_called_as_the_world_has_no_frame(monkeypatch):
    """Send no transform from a frame to itself, which tf refuses, and say so once."""
    sent = []
    topic = SimpleNamespace(publish=sent.append, get_subscription_count=lambda: 1)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', SimpleNamespace(TFMessage=object))
    monkeypatch.setattr(qos, 'publisher', lambda *given, **options: topic)
    node = Node()
    publisher = TransformPublisher(node, 'oak')
    objects = [SimpleNamespace(name=name, first=i, count=1)
               for i, name in enumerate(('wall', 'oak', 'ball'))]
    simulation = SimpleNamespace(poses=np.arange(21.0).reshape(3, 7), objects=objects, time=1.5)
    for _ in range(2):
        publisher.publish(simulation, True)
    expected = TransformMessage(('wall', 'ball'), 'oak').write(simulation.poses[[0, 2]],
                                                               messages.stamp(1.5))
    assert sent == [expected, expected]
    assert len(node.said) == 1 and 'oak' in node.said[0]
