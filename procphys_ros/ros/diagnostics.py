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


"""Diagnostics: one status that says how the simulation is doing, once a second."""

from collections import Counter
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from procphys_ros.ros import qos
from procphys_ros.ros.commands import CommandQueue
from procphys_ros.ros.pacing import Pacer
from procphys_ros.simulation import Simulation

_ON_TIME = 0.95  # share of the wanted real-time factor below which the node counts as overloaded


class Diagnostics:
    """
    Publishes /diagnostics.

    :param node: the node that publishes.
    :param commands: where commands are counted.
    """

    def __init__(self, node: Node, commands: CommandQueue):
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', qos.ARRAYS)
        self._name = node.get_fully_qualified_name()
        self._commands = commands
        self._stages: Counter[str] = Counter()
        self._steps = 0

    def note(self, timings: Mapping[str, float]) -> None:
        """Add what the stages of one step took [s]; the status tells their mean."""
        self._stages.update(timings)
        self._steps += 1

    def publish(self, simulation: Simulation, pacer: Pacer, paused: bool) -> None:
        """Publish the present status."""
        level, message = judge(pacer, paused)
        values = {
            'simulation time [s]': f'{simulation.time:.3f}',
            'real-time factor': f'{pacer.measured:.2f}',
            'real-time factor wanted': f'{pacer.factor:g}',
            **{f'{stage} [ms/step]': f'{1e3 * seconds / self._steps:.3f}'
               for stage, seconds in self._stages.items()},
            'parts': str(len(simulation.poses)),
            'awake bodies': str(simulation.awake_bodies),
            'bonds broken': str(simulation.bonds_broken),
            'commands waiting': str(len(self._commands)),
            'commands taken': str(self._commands.taken.total()),
            'commands rejected': str(self._commands.rejected.total()),
            'last rejection': self._commands.last_rejection,
            **{f'rejected {name}': str(count)
               for name, count in sorted(self._commands.rejected.items())},
        }
        status = DiagnosticStatus(
            level=level, name=f'{self._name}: simulation', message=message,
            hardware_id='procphys_ros',
            values=[KeyValue(key=key, value=value) for key, value in values.items()])
        array = DiagnosticArray(status=[status])
        seconds, nanoseconds = divmod(round(simulation.time * 1e9), 10**9)
        array.header.stamp.sec, array.header.stamp.nanosec = seconds, nanoseconds
        self._publisher.publish(array)
        self._stages.clear()
        self._steps = 0


def judge(pacer: Pacer, paused: bool) -> tuple[bytes, str]:
    """Give the level and the message of the status."""
    if paused:
        return DiagnosticStatus.OK, 'paused'
    if pacer.factor and pacer.measured < _ON_TIME * pacer.factor:
        return DiagnosticStatus.WARN, (f'overloaded: simulated time runs at '
                                       f'{pacer.measured:.2f} of real time')
    return DiagnosticStatus.OK, 'running'
