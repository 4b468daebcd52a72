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


"""Receiver: takes messages in a thread of its own, as fast as they come."""

from collections.abc import Callable
from threading import Event, Thread
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.subscription import Subscription

from procphys_ros.ros import qos
from procphys_ros.ros.sequence_gaps import SequenceGaps

_PERIOD = 0.005  # [s] between looks at the subscriptions
_MOST = 100  # messages of a topic per look, some 5 ms: a flood must leave time to other threads


class Receiver:
    """
    Hands messages on.

    An executor takes one message of a topic at a time and looks at every other entity of the node
    in between: some 1,000 messages per second, less than a busy sender has, and services wait
    behind them. So it is kept away from these subscriptions, and a thread of their own empties
    them.

    :param node: the node that subscribes.
    """

    def __init__(self, node: Node):
        self._node = node
        self._group = _NotForExecutors()
        self._topics: list[_Topic] = []
        self._stopping = Event()
        self._thread = Thread(target=self._run, name='receiver', daemon=True)

    def subscribe(self, kind: type, topic: str, receive: Callable[[Any], None],
                  reject: Callable[[Exception], None], lose: Callable[[int], None]) -> None:
        """
        Subscribe to a topic.

        :param kind: type of its messages.
        :param topic: its name.
        :param receive: called with each message, in the thread of the receiver.
        :param reject: called with what `receive` raises, or the reading of a message.
        :param lose: called with how many messages were lost, because they came faster than they
            could be taken.
        """
        subscription = qos.subscription(self._node, kind, topic, receive, qos.commands(),
                                        callback_group=self._group)
        self._topics.append(_Topic(subscription, receive, reject, lose))

    def start(self) -> None:
        """Begin to receive."""
        self._thread.start()

    def stop(self, patience: float) -> bool:
        """End receiving, wait some time for that [s], and say whether it has ended."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(patience)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while not self._stopping.wait(_PERIOD):
            for topic in self._topics:
                for _ in range(_MOST):
                    if (self._stopping.is_set() or not self._node.context.ok()
                            or not topic.take()):
                        break


class _Topic:
    """One subscription, and who is told of its messages."""

    def __init__(self, subscription: Subscription, receive: Callable[[Any], None],
                 reject: Callable[[Exception], None], lose: Callable[[int], None]):
        self._subscription = subscription
        self._receive = receive
        self._reject = reject
        self._lose = lose
        self._gaps = SequenceGaps()

    def take(self) -> bool:
        """Take a message and hand it on; say whether there was one."""
        try:
            with self._subscription.handle:
                taken = self._subscription.handle.take_message(self._subscription.msg_type, False)
        except InvalidHandle:  # the node is going
            return False
        except Exception as error:
            self._reject(error)
            return False
        if taken is None:
            return False
        number = taken[1]['publication_sequence_number']  # None where RMW has none
        missing = 0 if number is None else self._gaps.missing(
            number, self._subscription.handle.get_publisher_count())
        if missing:
            self._lose(missing)
        try:
            self._receive(taken[0])
        except Exception as error:
            self._reject(error)
        return True


class _NotForExecutors(CallbackGroup):
    """Keeps executors away from what belongs to the receiver."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass
