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


"""Leaf publisher: what leaves there are, and where they are while somebody wants to know."""

from rclpy.node import Node

from procphys_ros import messages
from procphys_ros.messages.leaves import leaf_rows
from procphys_ros.ros.late_joiners import LateJoinerTracker
from procphys_ros.ros.pacing import RateLimiter
from procphys_ros.ros.topics import offer
from procphys_ros.simulation import Simulation

_EARLY = 0.2  # share of their period that poses may come early, as turns jitter


class LeafPublisher:
    """
    Publish the leaves of a simulation.

    :param node: the node that publishes.
    :param frame: `frame_id` of all messages.
    :ivar new: tracks new subscribers of the poses.
    """

    def __init__(self, node: Node, frame: str):
        self._frame = frame
        self.new = LateJoinerTracker()
        self._leaves = offer(node, 'leaves')
        self._poses = offer(node, 'leaf_poses', event_callbacks=self.new.events)
        self._limiter = RateLimiter(1.0, _EARLY)
        self._described = -1
        self._has_news = True

    def restart(self) -> None:
        """Publish the leaves at the next call, even if their number has not changed."""
        self._described = -1

    def describe(self, simulation: Simulation) -> None:
        """Publish the leaves on their parts, if not done yet."""
        if len(simulation.blueprint.leaves) == self._described:
            return
        self._described = len(simulation.blueprint.leaves)
        self._leaves.publish(messages.point_cloud(
            leaf_rows(simulation.blueprint.leaves), messages.stamp(simulation.time), self._frame))

    def publish(self, simulation: Simulation, has_moved: bool, rate: float) -> None:
        """
        Publish the poses of all leaves, fluttering, flying or fallen.

        :param has_moved: whether steps were run since the last call.
        :param rate: highest rate [Hz].
        """
        self._limiter.rate = rate
        # Changes while nothing was due are still to be published, also if time stands still since.
        self._has_news |= self.new.are_waiting() or has_moved
        if self._has_news and self._poses.get_subscription_count() and self._limiter.is_due():
            self._has_news = False
            self._poses.publish(messages.pose_array(
                simulation.leaf_poses(), messages.stamp(simulation.time), self._frame))
