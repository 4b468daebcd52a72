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

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import (
    PointStamped,
    PoseArray,
    PoseStamped,
    Vector3Stamped,
    WrenchStamped,
)
from rclpy.node import Node
from sensor_msgs.msg import JointState

from procphys_ros.errors import CommandError
from procphys_ros.ros.commands import Act, Command, CommandQueue
from procphys_ros.ros.conversions import check_frame, joint_drives, part_name, pose, triple
from procphys_ros.ros.receiver import Inlet, Receiver
from procphys_ros.ros.requests import Requests
from procphys_ros.ros.session import Session
from procphys_ros.scene.intruders import INTRUDER
from procphys_ros.simulation.commands import checked_rotation, checked_vector


class TopicCommands:
    """
    Subscribe to the command topics.

    :param node: the node that subscribes.
    :param queue: of commands for the next step.
    :param session: executes the commands.
    :param requests: reads the parameters that a command needs.
    :param frame: required frame of vectors.
    :param intruders: names of the movable bodies besides the unnamed one.
    :ivar receiver: of the topics.
    """

    def __init__(self, node: Node, queue: CommandQueue, session: Session, requests: Requests,
                 frame: str, intruders: Sequence[str] = ()):
        self._queue = queue
        self._session = session
        self._requests = requests
        self._frame = frame
        self.receiver = Receiver(node)
        try:
            self._subscribe_all(intruders)
        except Exception:
            self.receiver.stop(0.0)
            raise

    def _subscribe_all(self, intruders: Sequence[str]) -> None:
        for name, kind, read in (('wind', Vector3Stamped, self._wind),
                                 ('impulse', WrenchStamped, self._impulse),
                                 ('wrench', WrenchStamped, self._wrench),
                                 ('explosion', PointStamped, self._explosion),
                                 ('observer', PoseStamped, self._observer),
                                 ('downwash', WrenchStamped, self._downwash),
                                 ('joint_command', JointState, self._joint_command),
                                 (INTRUDER, PoseStamped, partial(self._intruder, INTRUDER))):
            self._subscribe(name, kind, read)
        for name in intruders:
            self._subscribe(f'intruders/{name}', PoseStamped, partial(self._intruder, name))
        if intruders:
            self._subscribe('intruders', PoseArray, partial(self._intruders, tuple(intruders)))

    def _subscribe(self, name: str, kind: type, read: Callable[[Any], Act]) -> None:
        def reject(error: Exception) -> None:
            self._queue.reject(name, error)

        def receive(message: Any) -> None:
            self._queue.submit(Command(name, read(message)))

        def lose(count: int) -> None:
            self._queue.reject(name, f'{count} messages were lost, they came faster than they can '
                                     'be taken', count=count)

        self.receiver.subscribe(kind, f'~/{name}', Inlet(
            receive, reject, lose, lambda: self._queue.is_full,
            lambda: self._queue.reject_surplus(name)))

    def _wind(self, message: Vector3Stamped) -> Act:
        check_frame(message.header, self._frame)
        velocity = triple(message.vector, 'wind')
        return lambda: self._session.set_wind(velocity)

    def _impulse(self, message: WrenchStamped) -> Act:
        part, linear, angular = _on_part(message, 'impulse', 'angular impulse')
        return lambda: self._session.strike(part, linear, angular)

    def _wrench(self, message: WrenchStamped) -> Act:
        part, force, torque = _on_part(message, 'force', 'torque')
        return lambda: self._session.push(part, force, torque)

    def _explosion(self, message: PointStamped) -> Act:
        check_frame(message.header, self._frame)
        return self._requests.explode_at(triple(message.point, 'explosion'))

    def _observer(self, message: PoseStamped) -> Act:
        check_frame(message.header, self._frame)
        place = pose(message.pose)
        return lambda: self._session.look_from(place[:3], place[3:])

    def _downwash(self, message: WrenchStamped) -> Act:
        name = message.header.frame_id or INTRUDER
        return self._requests.drive_rotors(name, triple(message.wrench.force, 'thrust'))

    def _joint_command(self, message: JointState) -> Act:
        wishes = joint_drives(message)
        return lambda: self._session.drive_joints(wishes)

    def _intruder(self, name: str, message: PoseStamped) -> Act:
        check_frame(message.header, self._frame)
        place = pose(message.pose)
        return lambda: self._session.place_intruder(name, place)

    def _intruders(self, names: tuple[str, ...], message: PoseArray) -> Act:
        check_frame(message.header, self._frame)
        if len(message.poses) != len(names):
            raise CommandError(f'there are {len(message.poses)} poses for {len(names)} intruders '
                               f'({", ".join(names)})')
        places = [pose(one) for one in message.poses]
        for name, place in zip(names, places):  # all of them, before any is moved
            checked_vector(f'{name} position', place[:3])
            checked_rotation(f'{name} orientation', place[3:])

        def act() -> str:
            for name, place in zip(names, places):
                self._session.place_intruder(name, place)
            return f'{len(names)} intruders moved'
        return act


def _on_part(message: WrenchStamped, linear: str, angular: str) -> tuple:
    """Read the name of the part, and the two vectors."""
    part = part_name(message.header.frame_id, 'header.frame_id')
    return part, triple(message.wrench.force, linear), triple(message.wrench.torque, angular)
