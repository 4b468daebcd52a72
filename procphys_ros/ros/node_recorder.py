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

"""Node recorder: writes the bytes that a node publishes as they arrive."""

import argparse
from collections.abc import Callable, Sequence
import os
import re
from time import monotonic, time_ns

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from procphys_ros.errors import RecordingError
from procphys_ros.recording.marker_state import MarkerState
from procphys_ros.recording.recording import FULL_EVERY
from procphys_ros.recording.writer import McapWriter
from procphys_ros.ros import qos
from procphys_ros.ros.starting import start_ros
from procphys_ros.ros.topics import full_name, KIND_NAMES, RECORDED, TOPICS

_TURN = 0.05  # [s] between checks of the clock
_WRENCH = 'intruder_wrench'
_OF_INTRUDERS = re.compile('intruders/[^/]+/wrench')


class NodeRecorder:
    """
    Subscribe to all topics of a node, and write full frames once a second.

    :param node: of the subscriptions.
    :param source: absolute name of the publishing node.
    :param writer: receives the messages.
    :ivar failure: error that ended the recording; None = it goes on.
    """

    def __init__(self, node: Node, source: str, writer: McapWriter):
        self._node, self._writer, self._source = node, writer, source
        self._markers = MarkerState()
        self._poses = b''
        self._full_due = monotonic()
        self.failure: RecordingError | None = None
        self._taken: set[str] = set()
        for topic in RECORDED:
            self._subscribe(topic)
        self._find_intruders()
        # A separate clock: with use_sim_time a node waits for the clock, which may stand still.
        node.create_timer(FULL_EVERY, self._look,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def remark(self) -> str:
        """Return a remark if no markers were received, with a possible reason."""
        if len(self._markers):
            return ''
        return (f'; none on {self._name("markers")}: where the node has remapped it, remap it '
                f'here, too, --ros-args -r {self._name("markers")}:=/its/name')

    def _subscribe(self, topic: str) -> None:
        kind, published = TOPICS.get(topic, TOPICS[_WRENCH])
        profile = qos.changes()  # even where only the newest counts, else some are missed
        profile.durability = published().durability
        self._node.create_subscription(kind, self._name(topic), self._taker(topic), profile,
                                       raw=True)

    def _find_intruders(self) -> None:
        """Subscribe to the wrenches of named intruders."""
        own = f'{self._source}/'
        for full, kinds in self._node.get_topic_names_and_types():
            topic = full.removeprefix(own)
            if (full != topic and topic not in self._taken and _OF_INTRUDERS.fullmatch(topic)
                    and kinds == [KIND_NAMES[TOPICS[_WRENCH][0]]]):
                self._taken.add(topic)
                self._subscribe(topic)

    def _look(self) -> None:
        self._find_intruders()
        self._fill()

    def _name(self, topic: str) -> str:
        return full_name(self._source, topic)

    def _taker(self, topic: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            self._write(topic, data)
            if topic == 'poses':
                self._poses = data
            elif topic == 'markers':
                self._markers.update(data)
                if monotonic() >= self._full_due:
                    self._fill()
        return take

    def _fill(self) -> None:
        """Write full frames, so that playback can start here."""
        self._full_due = monotonic() + FULL_EVERY
        if len(self._markers):
            self._write('markers', self._markers.whole())
        if self._poses:
            self._write('poses', self._poses)

    def _write(self, topic: str, data: bytes) -> None:
        if self.failure is None:
            try:
                kind = TOPICS.get(topic, TOPICS[_WRENCH])[0]
                self._writer.write(self._name(topic), KIND_NAMES[kind], data, time_ns())
            except RecordingError as error:
                self.failure = error


def record(said: argparse.Namespace, ros_words: Sequence[str], ended: Callable[[], bool]) -> str:
    """
    Record a node until the end is signalled.

    :param said: `out`, `node`, `seconds` and `timeout`.
    :param ros_words: arguments for ROS.
    :param ended: returns whether to end.
    :returns: summary of the recording, in one line.
    :raises RecordingError: if the file cannot be written (any further).
    :raises LookupError: if the node is not found.
    :raises SceneError: if the arguments for ROS are invalid.
    """
    start_ros(['record', *ros_words], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(f'record_{os.getpid()}', start_parameter_services=False)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        source = '/' + said.node.strip('/')
        _find(node, executor, source, said.timeout, ended)
        started = monotonic()
        with McapWriter(said.out) as writer:
            recorder = NodeRecorder(node, source, writer)
            while not (ended() or recorder.failure
                       or (said.seconds and monotonic() - started > said.seconds)):
                executor.spin_once(timeout_sec=_TURN)
        if recorder.failure is not None:
            raise recorder.failure
        return (f'{said.out}: {writer.messages} messages in {monotonic() - started:.1f} s, '
                f'{said.out.stat().st_size / 1e6:.1f} MB{recorder.remark()}')
    finally:
        rclpy.try_shutdown()


def _find(node: Node, executor: SingleThreadedExecutor, source: str, timeout: float,
          ended: Callable[[], bool]) -> None:
    end = monotonic() + timeout
    found = node.resolve_topic_name(f'{source}/scene_description')
    while not node.count_publishers(found) and not ended():
        if monotonic() > end:
            raise LookupError(f'nothing publishes {source}/scene_description; is the node '
                              'running? --node names another one, --ros-args -r another topic')
        executor.spin_once(timeout_sec=_TURN)
    if ended():
        raise LookupError(f'ended before {source} was found; nothing has been written')
