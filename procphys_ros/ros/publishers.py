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


"""Publishers of the node: rates, and skipping of topics without subscribers."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String

from procphys_ros import messages
from procphys_ros.appearance.joints import seats
from procphys_ros.compilation.threads import beside
from procphys_ros.messages import MarkerStyle, SceneDescription, SceneMarkers
from procphys_ros.messages.ground import thinned
from procphys_ros.physics.terrain import FLAT
from procphys_ros.ros.late_joiners import LateJoinerTracker
from procphys_ros.ros.leaf_publisher import LeafPublisher
from procphys_ros.ros.pacing import RateLimiter
from procphys_ros.ros.parameters import Parameters
from procphys_ros.ros.topics import offer
from procphys_ros.ros.transforms import TransformPublisher
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.simulation import Simulation

_EARLY = 0.2  # share of their period that markers may come early, as turns jitter
_DESCRIPTIONS = 2.0  # [Hz] highest rate of latched messages while they change


class Publishers:
    """
    Publish the state of a simulation; the expensive topics only with subscribers.

    :param node: the node that publishes.
    :param frame: `frame_id` of all messages.
    :param parameters: rates, and style of the markers.
    """

    def __init__(self, node: Node, frame: str, parameters: Parameters):
        self._node = node
        self._parameters = parameters
        self._frame = frame
        self._new_to_poses, self._new_to_markers = LateJoinerTracker(), LateJoinerTracker()
        self._poses = offer(node, 'poses', event_callbacks=self._new_to_poses.events)
        self._markers = offer(node, 'markers', event_callbacks=self._new_to_markers.events)
        self._breaks, self._broken = offer(node, 'breaks'), offer(node, 'broken_bonds')
        self._dust, self._wind_info = offer(node, 'dust'), offer(node, 'wind_info')
        self._description, self._ground = offer(node, 'scene_description'), offer(node, 'ground')
        self._ground_motion = offer(node, 'ground_motion')
        self._joint_states = offer(node, 'joint_states')
        self._wrenches = {INTRUDER: offer(node, 'intruder_wrench')}
        self._wrenches |= {name: offer(node, f'intruders/{name}/wrench', 'intruder_wrench')
                           for name in parameters['intruders.names']}
        self._ready = offer(node, 'ready')
        self._leaves = LeafPublisher(node, frame)
        self._transforms = TransformPublisher(node, frame) if parameters['publish_tf'] else None
        self._ready.publish(Bool(data=False))
        # Time has one source, also if several nodes share a scene.
        self._clock = (offer(node, '/clock')
                       if parameters['publish_clock'] and parameters['shard.index'] == 0 else None)
        self._scene_markers: SceneMarkers | None = None
        self._markers_sent: Callable[[], None] = lambda: None  # waits for the last message
        self._wants_whole = True
        self._marker_limiter = RateLimiter(parameters['marker_rate'], _EARLY)
        self._description_limiter = RateLimiter(_DESCRIPTIONS)
        self._broken_limiter = RateLimiter(_DESCRIPTIONS)
        self._told_breaks = 0
        self._has_news_of_breaks = True
        self._had_dust = False
        self._last = np.empty((0, 7))
        self._added: tuple[str, ...] = ()
        self._layouts = 0

    @property
    def has_late_joiners(self) -> bool:
        """Return whether new subscribers need the full state now."""
        trackers = [self._new_to_poses, self._new_to_markers, self._leaves.new]
        trackers += [] if self._transforms is None else [self._transforms.new]
        return any(tracker.would_be_told for tracker in trackers)

    @property
    def clocks(self) -> int:
        """Return the number of publishers of the clock topic; 0 = this node publishes none."""
        return (0 if self._clock is None
                else len(self._node.get_publishers_info_by_topic(self._clock.topic_name)))

    def start_scene(self, simulation: Simulation) -> None:
        """Announce a loaded scene; subscribers get its full state."""
        self.reset(simulation)
        self._show_ground(simulation)
        self._describe(simulation)
        self._ready.publish(Bool(data=True))

    def close(self) -> None:
        """Wait for the message being written, and ignore its errors."""
        with suppress(Exception):  # ROS may have been shut down meanwhile
            self._wait_for_markers()

    def end_scene(self) -> None:
        """Announce that there is no scene any more, and clear it in viewers."""
        self.close()
        if self._scene_markers is not None:
            self._markers.publish(self._scene_markers.deletions((0, 0)))
            self._scene_markers = None
        self._ground.publish(messages.ground_markers(FLAT, (), (0, 0), self._frame))
        self._ready.publish(Bool(data=False))

    def reset(self, simulation: Simulation) -> None:
        """Restart after a jump of time."""
        self._describer: SceneDescription | None = None
        # Breaks at the start are new; those of a saved state were published before.
        self._told_breaks = simulation.log.total if simulation.time > 0.0 else 0
        self._has_news_of_breaks = True
        self._broken_limiter.hasten()
        self.restart()

    def restart(self) -> None:
        """Publish all markers next, in place of the shown ones, and the description."""
        self.close()
        if self._scene_markers is not None and self._style().shard:
            self._markers.publish(self._scene_markers.deletions((0, 0)))
        self._scene_markers = None
        self._leaves.restart()
        self._marker_limiter.hasten()
        self._described: tuple[int, int] | None = None

    def apply(self, names: set[str]) -> None:
        """Apply changed parameters."""
        self._marker_limiter.rate = self._parameters['marker_rate']
        if names & {'marker_triangles', 'marker_mesh'}:
            self.restart()

    def publish(self, simulation: Simulation, has_moved: bool) -> None:
        """
        Publish the present state.

        :param has_moved: whether steps were run since the last call.
        """
        at = messages.stamp(simulation.time)
        # While time stands still, commands may add or move something.
        poses = simulation.state.shown_poses()
        has_moved = has_moved or not np.array_equal(poses, self._last, equal_nan=True)
        if has_moved:
            self._last = poses.copy()
        is_news = self._new_to_poses.are_waiting() or has_moved
        if is_news and self._poses.get_subscription_count():
            self._poses.publish(messages.pose_array(poses, at, self._frame))
        if self._transforms is not None:
            self._transforms.publish(simulation, has_moved)
        self._follow_content(simulation)
        self._publish_markers(simulation, at)
        self._leaves.publish(simulation, has_moved, self._parameters['marker_rate'])
        self._publish_breaks(simulation, at)
        if has_moved and self._dust.get_subscription_count():
            self._publish_dust(simulation, at)
        if self._clock is not None:
            self._clock.publish(messages.clock(at))
        if self._wind_info.get_subscription_count():
            wind = np.sum(simulation.wind.at_reference(simulation.time), axis=0)
            self._wind_info.publish(messages.stamped_numbers(wind, at, self._frame))
        if self._ground_motion.get_subscription_count():
            self._ground_motion.publish(messages.stamped_numbers(
                [*simulation.ground_acceleration, 0.0, 0.0, 0.0], at, self._frame))
        if len(simulation.state.mechanisms.joint) and self._joint_states.get_subscription_count():
            self._publish_joints(simulation, at)
        if has_moved:
            self._publish_wrenches(simulation, at)

    def _follow_content(self, simulation: Simulation) -> None:
        """Draw again after objects joined or grew, which may have leaves; describe the content."""
        if (simulation.added, simulation.layouts) != (self._added, self._layouts):
            self._added, self._layouts = simulation.added, simulation.layouts
            self._describer = None if simulation.layouts else self._describer
            self.restart()
            self._description_limiter.hasten()
        _, removed = self._described or (0, 0)
        if removed < len(simulation.removed):  # who has removed an object asks next what is left
            self._description_limiter.hasten()
        if self._described != _content(simulation) and self._description_limiter.is_due():
            self._describe(simulation)

    def _show_ground(self, simulation: Simulation) -> None:
        """Publish the ground once per scene; the topic is latched for late joiners."""
        terrain = simulation.model.terrain
        shown = thinned(terrain)
        if shown.edge > terrain.edge:
            self._node.get_logger().info(
                f'topics show the ground in cells of {shown.edge:g} m instead of '
                f'{terrain.edge:g} m: {terrain.heights.size} heights are too many for a message')
        self._ground.publish(messages.ground_markers(
            terrain, simulation.scene.paving, messages.stamp(simulation.time), self._frame))

    def _describe(self, simulation: Simulation) -> None:
        if self._describer is None:
            self._describer = SceneDescription(self._frame, simulation.model.terrain,
                                               simulation.scene.paving, seats)
        text = self._describer.write(simulation.state.blueprint, simulation.objects,
                                     simulation.removed)
        self._description.publish(String(data=text))
        self._leaves.describe(simulation)
        self._described, self._added = _content(simulation), simulation.added
        self._layouts = simulation.layouts

    def _publish_markers(self, simulation: Simulation, at: messages.Stamp) -> None:
        if self._new_to_markers.are_waiting():
            self._wants_whole = True
        if not self._markers.get_subscription_count() or not self._marker_limiter.is_due():
            return
        self._wait_for_markers()
        markers = self._scene_markers
        if markers is None:
            markers = self._scene_markers = SceneMarkers(
                simulation.state.blueprint, simulation.objects, self._frame, self._style())
            self._wants_whole = True
        elif len(markers) < len(simulation.poses):
            markers.grow(simulation.blueprint, simulation.objects)
        if simulation.layouts:
            markers.resize(simulation.blueprint)
        leaves = simulation.leaf_poses() if markers.shows_leaf_poses else None
        # The next steps write the poses.
        poses, dust = simulation.state.shown_poses().copy(), simulation.dust
        if self._wants_whole:
            self._wants_whole = False
            self._markers.publish(markers.whole(poses, at, leaves, dust))
            return

        def send() -> None:
            data = markers.changes(poses, at, leaves, dust)
            if data is not None:
                self._markers.publish(data)
        self._markers_sent = beside('markers', send, simulation.model.threads)

    def _wait_for_markers(self) -> None:
        """Wait until the markers of an earlier frame are published; raise their error."""
        sent, self._markers_sent = self._markers_sent, lambda: None
        sent()

    def _style(self) -> MarkerStyle:
        shard = (f'shard_{self._parameters["shard.index"]}'
                 if self._parameters['shard.count'] > 1 else '')
        return MarkerStyle(self._parameters['marker_triangles'], self._parameters['marker_mesh'],
                           shard)

    def _publish_breaks(self, simulation: Simulation, at: messages.Stamp) -> None:
        log = simulation.log
        new, self._told_breaks = log.total - self._told_breaks, log.total
        if new:
            self._has_news_of_breaks = True
            if self._breaks.get_subscription_count():
                rows = messages.break_rows(log.recent(new))
                self._breaks.publish(messages.point_cloud(rows, at, self._frame))
        if self._has_news_of_breaks and self._broken_limiter.is_due():
            rows = messages.break_rows(log.rows)
            self._broken.publish(messages.point_cloud(rows, at, self._frame))
            self._has_news_of_breaks = False

    def _publish_dust(self, simulation: Simulation, at: messages.Stamp) -> None:
        dust = simulation.dust
        if len(dust.sizes) or self._had_dust:  # one empty cloud when the last has settled
            rows = messages.dust_rows(dust)
            self._dust.publish(messages.point_cloud(rows, at, self._frame))
        self._had_dust = len(dust.sizes) > 0

    def _publish_joints(self, simulation: Simulation, at: messages.Stamp) -> None:
        message, joints = JointState(), simulation.joints
        message.header.stamp.sec, message.header.stamp.nanosec = at
        message.header.frame_id = self._frame
        message.name = list(joints.names)
        message.position, message.velocity, message.effort = (
            column.tolist() for column in (joints.position, joints.velocity, joints.effort))
        self._joint_states.publish(message)

    def _publish_wrenches(self, simulation: Simulation, at: messages.Stamp) -> None:
        for name, publisher in self._wrenches.items():
            if (publisher.get_subscription_count() and name in simulation.intruders
                    and simulation.pose_of_intruder(name) is not None):
                publisher.publish(messages.stamped_numbers(
                    simulation.wrench_on_intruder(name), at, self._frame))


def _content(simulation: Simulation) -> tuple[int, int]:
    """Return the numbers that change with the description."""
    return len(simulation.blueprint), len(simulation.removed)
