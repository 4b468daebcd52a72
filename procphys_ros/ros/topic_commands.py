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


"""Commands on topics: read, checked, and put in the queue; the bad ones dropped and counted."""

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PointStamped, PoseStamped, Vector3Stamped, WrenchStamped
from rclpy.node import Node

from procphys_ros.errors import CommandError
from procphys_ros.ros import qos
from procphys_ros.ros.commands import Command, CommandQueue
from procphys_ros.ros.conversions import check_frame, triple
from procphys_ros.ros.session import Session

_MOST_AT_ONCE = 2000  # messages taken from a topic in one go, so that a flood cannot stop the node


class TopicCommands:
    """
    Subscribes to the command topics.

    :param node: the node that subscribes.
    :param queue: where commands wait for the next step.
    :param session: carries the commands out.
    :param frame: frame that vectors must be in.
    """

    def __init__(self, node: Node, queue: CommandQueue, session: Session,
                 frame: str):
        self._queue = queue
        self._session = session
        self._frame = frame
        for name, kind, read in (('wind', Vector3Stamped, self._wind),
                                 ('impulse', WrenchStamped, self._impulse),
                                 ('wrench', WrenchStamped, self._wrench),
                                 ('explosion', PointStamped, self._explosion),
                                 ('observer', PoseStamped, self._observer),
                                 ('intruder', PoseStamped, self._intruder)):
            _subscribe(node, f'~/{name}', kind, self._receiver(name, read))

    def _receiver(self, name: str, read: Callable[[Any], Callable[[], str]]):
        def receive(message: Any) -> None:
            try:
                self._queue.submit(Command(name, read(message)))
            except CommandError as error:
                self._queue.reject(name, str(error))
        return receive

    def _wind(self, message: Vector3Stamped) -> Callable[[], str]:
        check_frame(message.header, self._frame)
        velocity = triple(message.vector, 'wind')
        return lambda: self._session.set_wind(velocity)

    def _impulse(self, message: WrenchStamped) -> Callable[[], str]:
        part, linear, angular = _on_part(message, 'impulse', 'angular impulse')
        return lambda: self._session.strike(part, linear, angular)

    def _explosion(self, message: PointStamped) -> Callable[[], str]:
        check_frame(message.header, self._frame)
        point = triple(message.point, 'explosion')
        return lambda: self._session.explode_at(point)

    def _observer(self, message: PoseStamped) -> Callable[[], str]:
        check_frame(message.header, self._frame)
        place, turn = message.pose.position, message.pose.orientation

        def carry_out() -> str:
            self._session.simulation.set_observer((place.x, place.y, place.z),
                                                  (turn.x, turn.y, turn.z, turn.w))
            return 'looks from there'
        return carry_out

    def _intruder(self, message: PoseStamped) -> Callable[[], str]:
        check_frame(message.header, self._frame)
        place, turn = message.pose.position, message.pose.orientation

        def carry_out() -> str:
            self._session.simulation.place_intruder(
                (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w))
            return f'intruder to {[place.x, place.y, place.z]} m'
        return carry_out

    def _wrench(self, message: WrenchStamped) -> Callable[[], str]:
        part, force, torque = _on_part(message, 'force', 'torque')

        def carry_out() -> str:
            self._session.simulation.apply_wrench(part, force, torque)
            return f'wrench on {part}'
        return carry_out


def _subscribe(node: Node, topic: str, kind: type, receive: Callable[[Any], None]) -> None:
    """
    Subscribe so that a flood is taken in one go.

    The executor takes one message of a topic at a time and looks at everything else in between,
    which is far slower than a busy sender.
    """
    def receive_all(message: Any) -> None:
        receive(message)
        with subscription.handle:
            for _ in range(_MOST_AT_ONCE):
                taken = subscription.handle.take_message(kind, False)
                if taken is None:
                    break
                receive(taken[0])

    subscription = node.create_subscription(kind, topic, receive_all, qos.COMMANDS)


def _on_part(message: WrenchStamped, linear: str, angular: str) -> tuple:
    """Read which part is meant, and the two vectors."""
    part = message.header.frame_id
    if not part:
        raise CommandError('header.frame_id is empty, it must name a part, such as oak_0/17')
    return part, triple(message.wrench.force, linear), triple(message.wrench.torque, angular)
