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


"""Transform publisher: poses of the objects of a scene on `/tf`."""

from importlib import import_module

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher

from procphys_ros import messages
from procphys_ros.messages.transforms import TransformMessage
from procphys_ros.ros import qos
from procphys_ros.ros.late_joiners import LateJoinerTracker
from procphys_ros.schema import short
from procphys_ros.simulation import Simulation

_PACKAGE = 'tf2_msgs'


class TransformPublisher:
    """
    Publish a frame per object, with its name, at its first remaining part.

    Without the package tf2_msgs, or with an incomplete one, it warns once and does nothing.

    :param node: the node that publishes.
    :param frame: the parent frame.
    :ivar new: tracks new subscribers.
    """

    def __init__(self, node: Node, frame: str):
        self._frame = frame
        self._warn = node.get_logger().warning
        self._has_warned = False
        self.new = LateJoinerTracker()
        self._written: tuple[tuple[str, ...], TransformMessage] | None = None
        self._publisher: Publisher | None = None
        try:
            kind = import_module(f'{_PACKAGE}.msg').TFMessage
            self._publisher = qos.publisher(node, kind, '/tf', qos.changes(),
                                            event_callbacks=self.new.events)
        except Exception as error:  # each missing file raises another exception
            if not node.context.ok():
                raise
            node.get_logger().warning(
                f'publish_tf is true, but {_PACKAGE} is not installed, or not wholly: nothing '
                'goes out on /tf; on a ROS installation: apt install --reinstall '
                f'ros-$ROS_DISTRO-tf2-msgs ({short(str(error))})')

    def publish(self, simulation: Simulation, has_moved: bool) -> None:
        """
        Publish the poses of all objects.

        :param has_moved: whether steps were run since the last call.
        """
        is_news = self.new.are_waiting() or has_moved
        if self._publisher is None or not is_news or not self._publisher.get_subscription_count():
            return
        names, parts = frames(simulation)
        if self._frame in names:
            self._warn_of_namesake()
            kept = [name != self._frame for name in names]
            names, parts = tuple(name for name in names if name != self._frame), parts[kept]
        if self._written is None or self._written[0] != names:
            self._written = names, TransformMessage(names, self._frame)
        if names:
            self._publisher.publish(self._written[1].write(
                simulation.poses[parts], messages.stamp(simulation.time)))

    def _warn_of_namesake(self) -> None:
        if not self._has_warned:
            self._has_warned = True
            self._warn(f'the object {self._frame} has no frame on /tf: it is called as the frame '
                       'that all are in; give it another name, or world_frame')


def frames(simulation: Simulation) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the objects that still have parts, and the first remaining part of each, (K,)."""
    there = np.isfinite(simulation.poses[:, 0])
    names, parts = [], []
    for one in simulation.objects:
        left = there[one.first:one.first + one.count]
        if left.any():
            names.append(one.name)
            parts.append(one.first + int(left.argmax()))
    return tuple(names), np.array(parts, int)
