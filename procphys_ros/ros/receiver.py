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
from contextlib import ExitStack
from dataclasses import dataclass
from threading import Event, Thread
from time import thread_time
from typing import Any

from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_check_compatible, QoSCompatibility, QoSProfile
from rclpy.subscription import Subscription

from procphys_ros.ros import qos
from procphys_ros.ros.sequence_gaps import SequenceGaps

_PERIOD = 0.005  # [s] between polls of the subscriptions
_NAP = 1.0  # [s] between polls at most, while no message comes
_MOST = 100  # messages of a topic per poll, some 5 ms
_REST = 2.0  # times the processor time of a poll is the pause after it, for other threads


@dataclass(frozen=True)
class Inlet:
    """
    The handlers of a topic's messages, called in the thread of the receiver.

    :ivar receive: called with each message.
    :ivar reject: called with the exception of `receive`, or of reading a message.
    :ivar lose: called with the number of lost messages, which came faster than they were
        taken.
    :ivar is_full: returns whether there is no capacity for another message.
    :ivar turn_away: called for each message beyond the capacity; it is not deserialised, which
        takes ten times as long as taking it.
    """

    receive: Callable[[Any], None]
    reject: Callable[[Exception], None]
    lose: Callable[[int], None]
    is_full: Callable[[], bool] = lambda: False
    turn_away: Callable[[], None] = lambda: None


class Receiver:
    """
    Receive messages and pass them on.

    An executor takes one message of a topic at a time and polls every other entity of the node in
    between: some 1,000 messages per second, fewer than a busy sender publishes, and services wait
    behind them. So no executor has these subscriptions, and a separate thread empties them.

    They belong to a node `<name>_commands` with its own participant: a participant of the
    middleware has one queue and one thread for all input. In a flood it sometimes has no capacity
    for a request, which is repeated only seconds later.

    :param node: receiver of the commands; its parameters override the quality of service, and
        its remappings apply.
    """

    def __init__(self, node: Node):
        self._owner = node
        self._context = Context()
        self._context.init(args=['--ros-args', '--enclave', _enclave(node)],
                           initialize_logging=False, domain_id=node.context.get_domain_id())
        self._node = Node(
            f'{node.get_name()}_commands', context=self._context, namespace=node.get_namespace(),
            use_global_arguments=False, enable_rosout=False, start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)])
        self._topics: list[_Topic] = []
        self._stopping = Event()
        self._wake = self._node.create_guard_condition(lambda: None)
        self._thread = Thread(target=self._run, name='receiver', daemon=True)

    def subscribe(self, kind: type, topic: str, inlet: Inlet) -> None:
        """
        Subscribe to a topic.

        :param kind: type of its messages.
        :param topic: its name.
        :param inlet: its handlers.
        """
        subscription = qos.subscription(self._owner, self._node, kind, topic, inlet.receive,
                                        qos.commands())
        self._topics.append(_Topic(subscription, inlet))

    @property
    def names(self) -> list[str]:
        """Return the names of the topics, after remapping."""
        return sorted(topic.name for topic in self._topics)

    def unheard(self) -> dict[str, tuple[str, str]]:
        """
        Find publishers whose messages the middleware does not deliver here.

        :returns: by topic, the name of a node with an incompatible quality of service, and the
            reason.
        """
        found = {}
        for topic in self._topics:
            for sender in self._owner.get_publishers_info_by_topic(topic.name):
                fits, reason = qos_check_compatible(sender.qos_profile, topic.quality)
                if fits == QoSCompatibility.ERROR:
                    name = f'{sender.node_namespace.rstrip("/")}/{sender.node_name}'
                    found[topic.name] = name, reason.replace('ERROR: ', '').rstrip(';')
        return found

    def start(self) -> None:
        """Start receiving."""
        self._thread.start()

    def stop(self, patience: float) -> bool:
        """End receiving, wait some time [s], and return whether it has ended."""
        self._stopping.set()
        if self._thread.is_alive():
            self._wake.trigger()
            self._thread.join(patience)
        if self._thread.is_alive():
            return False
        if self._context.ok():
            self._node.destroy_node()
            self._context.try_shutdown()
        return True

    def _run(self) -> None:
        rest = _PERIOD
        while not self._stopping.wait(rest):
            begin, has_come = thread_time(), False
            for topic in self._topics:
                for _ in range(_MOST):
                    if (self._stopping.is_set() or not self._context.ok()
                            or not topic.take()):
                        break
                    has_come = True
            rest = max(_PERIOD, _REST * (thread_time() - begin))
            if not has_come and self._context.ok():
                self._wait_for_messages()

    def _wait_for_messages(self) -> None:
        """Wait until a message comes, for a limited time."""
        subscriptions = [topic.handle for topic in self._topics]
        try:
            with ExitStack() as held:
                for handle in (self._context.handle, self._wake.handle, *subscriptions):
                    held.enter_context(handle)
                waiting = rclpy_implementation.WaitSet(len(subscriptions), 1, 0, 0, 0, 0,
                                                       self._context.handle)
                waiting.clear_entities()
                waiting.add_guard_condition(self._wake.handle)
                for handle in subscriptions:
                    waiting.add_subscription(handle)
                waiting.wait(int(1e9 * _NAP))
        except InvalidHandle:  # the node is being destroyed
            pass


class _Topic:
    """One subscription, and the handlers of its messages."""

    def __init__(self, subscription: Subscription, inlet: Inlet):
        self._subscription = subscription
        self._inlet = inlet
        self._gaps = SequenceGaps()

    @property
    def name(self) -> str:
        return self._subscription.topic_name

    @property
    def handle(self) -> Any:
        return self._subscription.handle

    @property
    def quality(self) -> QoSProfile:
        return self._subscription.qos_profile

    def take(self) -> bool:
        """Take a message and pass it on; return whether there was one."""
        is_full = self._inlet.is_full()
        try:
            with self._subscription.handle:
                taken = self._subscription.handle.take_message(self._subscription.msg_type,
                                                               is_full)  # True = as bytes
        except InvalidHandle:  # the node is being destroyed
            return False
        except Exception as error:
            self._inlet.reject(error)
            return False
        if taken is None:
            return False
        number = taken[1]['publication_sequence_number']  # None where RMW has none
        missing = 0 if number is None else self._gaps.missing(
            number, self._subscription.handle.get_publisher_count())
        if missing:
            self._inlet.lose(missing)
        if is_full:
            self._inlet.turn_away()
            return True
        try:
            self._inlet.receive(taken[0])
        except Exception as error:
            self._inlet.reject(error)
        return True


def _enclave(node: Node) -> str:
    """Return the enclave of a node, with its keys if the middleware is secured."""
    own = node.get_name(), node.get_namespace()
    return next((enclave for *name, enclave in node.get_node_names_and_namespaces_with_enclaves()
                 if tuple(name) == own), '/')
