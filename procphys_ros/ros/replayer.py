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

"""Replayer: publishes recorded messages when they are due."""

import argparse
from collections.abc import Callable, Iterable, Sequence
import sys
from time import monotonic, sleep

import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions

from procphys_ros.recording.recording import Message, Recording
from procphys_ros.ros import qos
from procphys_ros.ros.starting import start_ros
from procphys_ros.ros.topics import KIND_NAMES, RECORDED, TOPICS

_NAP = 0.05    # [s] longest sleep between checks of signals
_HELLO = 0.5   # [s] between the first subscriber and the first message, for other subscribers
_ALONE = 3.0   # [s] to wait for a subscriber, whose discovery may take that long
_GLANCE = 0.5  # [s] between checks for other publishers of the topics
_SHORTEST = 1.0  # [s] of a loop: one that begins near the end would flood subscribers
_PATIENCE = 1.0  # [s] for the last messages to arrive
_CLASSES = {name: kind for kind, name in KIND_NAMES.items()}


def replay(recording: Recording, said: argparse.Namespace, ros_words: Sequence[str],
           ended: Callable[[], bool]) -> None:
    """
    Publish a recording.

    :param said: `file`, `start` [s], `rate` and `loop`.
    :param ros_words: arguments for ROS.
    :param ended: returns whether to end early.
    :raises RecordingError: if the file is damaged.
    :raises SceneError: if the arguments for ROS are invalid.
    """
    start_ros(['replay', *ros_words], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node('replay', start_parameter_services=False)
        publishers = _publishers(node, recording)
        print(f'{said.file}: {recording.duration:.1f} s, from {said.start:g} s at {said.rate:g} '
              'times the speed; Ctrl-C ends it', flush=True)
        rivals = _Rivals(node, list(publishers))
        _wait_for_subscribers(list(publishers.values()), ended)
        _play(recording, said, publishers, ended, rivals.look)
        for publisher in publishers.values():
            publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=_PATIENCE))
    finally:
        recording.close()
        rclpy.try_shutdown()


def _wait_for_subscribers(publishers: Sequence[Publisher], ended: Callable[[], bool]) -> None:
    """Wait until present subscribers have discovered the publishers, but for no others."""
    end = monotonic() + _ALONE
    is_heard = False
    while (left := end - monotonic()) > 0.0 and not ended():
        if not is_heard and any(p.get_subscription_count() for p in publishers):
            is_heard, end = True, monotonic() + _HELLO
        sleep(min(left, _NAP))


def _play(recording: Recording, said: argparse.Namespace, publishers: dict[str, Publisher],
          ended: Callable[[], bool], meanwhile: Callable[[], None]) -> None:
    """Publish the state at the start and the messages after it, repeatedly in a loop."""
    while not ended():
        again = monotonic() + _SHORTEST
        for message in recording.state_at(said.start):
            _send(publishers, message)
        _pass(recording.messages(said.start), publishers,
              recording.start + round(said.start * 1e9), said.rate, ended, meanwhile)
        if not said.loop:
            return
        _sleep_until(again, ended)


class _Rivals:
    """
    Log once for each topic that has another publisher.

    :param node: of the replay.
    :param topics: published by the replay.
    """

    def __init__(self, node: Node, topics: Sequence[str]):
        self._node, self._topics = node, set(topics)
        self._due = monotonic()

    def look(self) -> None:
        """Check the topics, if that is due."""
        if monotonic() < self._due:
            return
        self._due = monotonic() + _GLANCE
        for topic in sorted(self._topics):
            if self._node.count_publishers(topic) > 1:
                self._topics.remove(topic)
                print(f'replay: somebody else publishes {topic}, too', file=sys.stderr,
                      flush=True)


def _publishers(node: Node, recording: Recording) -> dict[str, Publisher]:
    """Make a publisher for each topic; report the omitted ones."""
    publishers = {}
    for topic, kind in recording.topics.items():
        if kind not in _CLASSES:
            print(f'replay: {topic} is left out: {kind} is none of the messages of this package',
                  file=sys.stderr)
            continue
        own = next((name for name in RECORDED if topic.endswith(f'/{name.lstrip("/")}')), None)
        profile = TOPICS[own][1] if own else qos.arrays
        publishers[topic] = node.create_publisher(_CLASSES[kind], topic, profile())
    return publishers


def _pass(messages: Iterable[Message], publishers: dict[str, Publisher], start: int, rate: float,
          ended: Callable[[], bool], meanwhile: Callable[[], None]) -> None:
    """Publish messages when they are due."""
    began = monotonic()
    for message in messages:
        meanwhile()
        _sleep_until(began + (message.at - start) * 1e-9 / rate, ended)
        if ended():
            return
        _send(publishers, message)


def _sleep_until(due: float, ended: Callable[[], bool]) -> None:
    while (left := due - monotonic()) > 0.0 and not ended():
        sleep(min(left, _NAP))


def _send(publishers: dict[str, Publisher], message: Message) -> None:
    if message.topic in publishers:
        publishers[message.topic].publish(message.data)
