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


"""Client of a running `sim` node: its services, topics and parameters."""

from collections.abc import Callable, Mapping, Sequence
import os
from threading import Event
from time import monotonic
from types import MappingProxyType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, PointStamped, Vector3, WrenchStamped
from rcl_interfaces.msg import Parameter, ParameterType
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from procphys_ros.errors import CommandError
from procphys_ros.ros import qos
from procphys_ros.ros.topics import follow

PATIENCE = 120.0  # [s] to wait for an answer of a node that may be busy
_TURN = 0.05  # [s] between checks of the clock
_SEARCH = 10.0  # [s] at least for a topic or service of a known node: discovery may be late
_FIRST = 'reset_simulation'  # the service by which a node is found
_REMAPPED = '; where the node has remapped it, remap it here, too: --ros-args -r {}:=/its/name'


class NoNodeError(Exception):
    """No node of that name answers."""


class Remote:
    """
    Communicate with one node and wait for its answers.

    :param name: of the node, absolute, such as /sim.
    :param timeout: time to look for it, and for its topics and services if that is longer
        than usual [s].
    :param patience: time to wait for an answer once it is found [s].
    :param ended: ends every wait as soon as it is set.
    :ivar patience: as given; may be changed from call to call.
    :raises NoNodeError: if it is not found; the message lists the nodes present.
    """

    def __init__(self, name: str, timeout: float, patience: float = PATIENCE,
                 ended: Event | None = None):
        self.name = '/' + name.strip('/')
        self.patience = patience
        self._ended = ended or Event()
        self._search = max(timeout, _SEARCH)
        self._node = rclpy.create_node(f'command_{os.getpid()}', start_parameter_services=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        client = self._node.create_client(Trigger, f'{self.name}/{_FIRST}')
        if not self._has_come(client.service_is_ready, timeout):
            who = self._who_is_there(timeout)
            self.close()
            raise NoNodeError(who)
        self._node.destroy_client(client)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()

    def trigger(self, service: str, given: Mapping[str, Any] = MappingProxyType({})) -> str:
        """
        Call a service without arguments.

        :param service: private name, such as 'gust'.
        :param given: parameters that it reads, to be changed before; as for `change`.
        :returns: the answer of the node.
        :raises CommandError: if it refuses, with its reason.
        """
        if given:
            self.change(given)
        return self._answer(self._call(Trigger, service, Trigger.Request()))

    def switch(self, service: str, on: bool) -> str:
        """Call a service that switches a setting; see `trigger`."""
        return self._answer(self._call(SetBool, service, SetBool.Request(data=on)))

    def change(self, values: Mapping[str, Any]) -> None:
        """
        Change parameters, all or none.

        :param values: bool, int, float, str, or a sequence of numbers or of str, by name.
        :raises CommandError: if the node refuses one, with its reason.
        """
        request = SetParametersAtomically.Request(
            parameters=[_to_message(name, value) for name, value in values.items()])
        result = self._call(SetParametersAtomically, 'set_parameters_atomically', request).result
        if not result.successful:
            raise CommandError(result.reason)

    def holds_texts(self, name: str) -> bool:
        """Return whether a parameter is a list of strings, even an empty one."""
        answer = self._call(GetParameters, 'get_parameters', GetParameters.Request(names=[name]))
        return answer.values[0].type == ParameterType.PARAMETER_STRING_ARRAY

    def values(self, names: Sequence[str]) -> list[Any]:
        """Return the values of parameters; None for unset ones."""
        answer = self._call(GetParameters, 'get_parameters', GetParameters.Request(names=names))
        return [parameter_value_to_python(value) for value in answer.values]

    def parameters(self) -> list[str]:
        """List the names of all parameters."""
        answer = self._call(ListParameters, 'list_parameters', ListParameters.Request())
        return sorted(answer.result.names)

    def push(self, topic: str, part: str, force: Sequence[float], torque: Sequence[float]) -> None:
        """
        Apply an impulse or a lasting force to a part.

        :param topic: 'impulse' [N·s], [N·m·s] or 'wrench' [N], [N·m].
        :param part: name or index.
        :param force: or impulse, world axes.
        :param torque: or angular impulse.
        :raises NoNodeError: if the node does not subscribe.
        """
        message = WrenchStamped()
        message.header.frame_id = part
        message.wrench.force = Vector3(**dict(zip('xyz', force)))
        message.wrench.torque = Vector3(**dict(zip('xyz', torque)))
        self._send(topic, message)

    def drive(self, joint: str, mode: str, value: float) -> None:
        """Drive a joint: 'position', 'velocity' or 'effort'; see `push`."""
        self._send('joint_command', JointState(name=[joint], **{mode: [value]}))

    def explode(self, place: Sequence[float]) -> None:
        """Detonate `explosion.charge` at a point [m], (3,); see `push`."""
        self._send('explosion', PointStamped(point=Point(**dict(zip('xyz', place)))))

    def description(self) -> str:
        """Return the JSON description of the present scene."""
        received: list[String] = []
        subscription = follow(self._node, self.name, 'scene_description', received.append)
        self._find(lambda: self._node.count_publishers(subscription.topic_name),
                   'publishes', f'{self.name}/scene_description')
        self._spin_until(lambda: received, self.patience)
        self._node.destroy_subscription(subscription)
        return received[-1].data

    def follow(self, scenes: list[String], statuses: list[DiagnosticArray],
               breaks: list[PointCloud2]) -> None:
        """Append descriptions of the scene, /diagnostics and `~/breaks` while `spin` is called."""
        for topic, found in (('scene_description', scenes), ('/diagnostics', statuses),
                             ('breaks', breaks)):
            follow(self._node, self.name, topic, found.append)

    def spin(self) -> None:
        """Process incoming messages for a moment."""
        self._executor.spin_once(timeout_sec=_TURN)

    def _send(self, topic: str, message: Any) -> None:
        """Publish a command, and wait until the node has received it."""
        publisher = self._node.create_publisher(type(message), f'{self.name}/{topic}',
                                                qos.commands())
        self._find(publisher.get_subscription_count, 'listens to', f'{self.name}/{topic}')
        publisher.publish(message)
        if not publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=self.patience)):
            raise NoNodeError(f'{self.name} has not taken it within {self.patience:.0f} s')

    def _call(self, kind: type, service: str, request: Any) -> Any:
        client = self._node.create_client(kind, f'{self.name}/{service}')
        self._find(client.service_is_ready, 'offers', f'{self.name}/{service}')
        future: Future = client.call_async(request)
        self._spin_until(future.done, self.patience)
        self._node.destroy_client(client)
        return future.result()

    def _find(self, found: Callable[[], Any], does: str, name: str) -> None:
        """Wait until a topic or a service appears, which may have been remapped."""
        patience = min(self._search, self.patience)
        if not self._has_come(found, patience):
            raise NoNodeError(f'nobody {does} {name} within {patience:g} s'
                              f'{_REMAPPED.format(name)}')

    def _spin_until(self, done: Callable[[], Any], patience: float) -> None:
        if not self._has_come(done, patience):
            raise NoNodeError(f'{self.name} has not answered for {patience:.0f} s')

    def _has_come(self, done: Callable[[], Any], patience: float) -> bool:
        """Process incoming messages until a condition holds; return whether it did in time [s]."""
        end = monotonic() + patience
        while not done():
            if monotonic() > end or self._ended.is_set():
                return False
            self._executor.spin_once(timeout_sec=_TURN)
        return True

    def _who_is_there(self, timeout: float) -> str:
        mark = '/scene_description'
        found = sorted({topic.removesuffix(mark)
                        for topic, _ in self._node.get_topic_names_and_types()
                        if topic.endswith(mark)})
        domain = os.environ.get('ROS_DOMAIN_ID') or '0'
        there = (f'but it publishes{_REMAPPED.format(f"{self.name}/{_FIRST}")}'
                 if self.name in found else
                 f'there is {", ".join(found)} (say --node)' if found else
                 'nor any other sim node; start one with "ros2 run procphys_ros sim"')
        return f'no node {self.name} in ROS domain {domain} within {timeout:g} s, {there}'

    @staticmethod
    def _answer(response: Any) -> str:
        if not response.success:
            raise CommandError(response.message)
        return response.message


def _to_message(name: str, value: Any) -> Parameter:
    """Convert a parameter to the type it looks like; numbers of lists are floats."""
    kind = None
    if not isinstance(value, bool | int | float | str):
        are_texts = all(isinstance(item, str) for item in value)
        kind = RosParameter.Type.STRING_ARRAY if are_texts else RosParameter.Type.DOUBLE_ARRAY
        value = [item if are_texts else float(item) for item in value]
    return RosParameter(name, kind, value).to_parameter_msg()
