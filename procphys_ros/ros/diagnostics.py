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
from dataclasses import dataclass
import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
from rclpy.node import Node

from procphys_ros.messages import stamp
from procphys_ros.ros.activity import Activity
from procphys_ros.ros.background_compilation import BackgroundCompilation
from procphys_ros.ros.commands import CommandQueue
from procphys_ros.ros.pacing import Pacer, RateLimiter, Speedometer
from procphys_ros.ros.session import REMEDY, Session
from procphys_ros.ros.topics import offer

_ON_TIME = 0.95  # share of the wanted real-time factor below which the node counts as overloaded
_LOOKS = 4.0  # [Hz] rate of samples of the simulation
_LONG_TURN = 1.0  # [s] after which a single step or command is reported


@dataclass(frozen=True)
class SimulationStatus:
    """
    The status of the simulation at one moment.

    :ivar time: simulated time [s].
    :ivar wanted: requested real-time factor; 0 = as fast as possible.
    :ivar paused: whether the simulation is paused.
    :ivar failure: error that stopped the simulation; '' = none.
    :ivar stages: mean duration of each stage of a step [ms].
    :ivar parts: number of all parts.
    :ivar awake: number of moving loose bodies.
    :ivar broken: number of bonds broken.
    :ivar wind: speed at the reference height [m/s].
    """

    time: float
    wanted: float
    paused: bool
    failure: str
    stages: Mapping[str, float]
    parts: int
    awake: int
    broken: int
    wind: float


class Diagnostics:
    """
    Sample the simulation in its thread, and publish /diagnostics in the other.

    :param node: the node that publishes.
    :param commands: counts commands.
    :param speed: measures the real-time factor.
    :param work: of the simulation thread.
    :param building: work of the thread that builds scenes.
    :param compilation: of kernels in the background.
    :ivar latest: last sample; None before the first scene.
    :ivar factor: real-time factor of the last second; NaN before that.
    """

    def __init__(self, node: Node, commands: CommandQueue, speed: Speedometer, work: Activity,
                 building: Activity, compilation: BackgroundCompilation):
        self._publisher = offer(node, '/diagnostics')
        self._name = node.get_fully_qualified_name()
        self._commands = commands
        self._speed = speed
        self._work = work
        self._building = building
        self._compilation = compilation
        self.factor = math.nan
        self._limiter = RateLimiter(_LOOKS)
        self._stages: Counter[str] = Counter()
        self._steps = 0
        self.latest: SimulationStatus | None = None

    def note(self, timings: Mapping[str, float]) -> None:
        """Add the durations of the stages of one step [s], for their mean in the status."""
        self._stages.update(timings)
        self._steps += 1

    def look(self, session: Session, pacer: Pacer) -> None:
        """Sample the simulation, if that is due."""
        if not session.has_scene or not self._limiter.is_due():
            return
        simulation = session.simulation
        wind = np.linalg.norm(np.sum(simulation.wind.at_reference(simulation.time), axis=0))
        stages = self.latest.stages if self.latest else {}
        if self._steps:
            stages = {stage: 1e3 * seconds / self._steps
                      for stage, seconds in self._stages.items()}
            self._stages.clear()
            self._steps = 0
        self.latest = SimulationStatus(
            simulation.time, pacer.factor, session.paused, session.failure, stages,
            len(simulation.poses), simulation.awake_bodies, simulation.bonds_broken, float(wind))

    def publish(self) -> None:
        """Publish the status; to be called once a second."""
        look = self.latest
        self.factor = self._speed.read()
        level, message = judge(look, self.factor, self._work, self._building)
        array = DiagnosticArray(status=[DiagnosticStatus(
            level=level, name=f'{self._name}: simulation', message=message,
            hardware_id='procphys_ros',
            values=[KeyValue(key=key, value=value) for key, value in self._values(look).items()])])
        if look is not None:
            array.header.stamp.sec, array.header.stamp.nanosec = stamp(look.time)
        self._publisher.publish(array)

    def _values(self, look: SimulationStatus | None) -> dict[str, str]:
        taken, rejected = self._commands.counts()
        shown = {} if look is None else {
            'simulation time [s]': f'{look.time:.3f}',
            'real-time factor': f'{self.factor:.2f}',
            'real-time factor wanted': f'{look.wanted:g}',
            **{f'{stage} [ms/step]': f'{milliseconds:.3f}'
               for stage, milliseconds in look.stages.items()},
            'parts': str(look.parts),
            'awake bodies': str(look.awake),
            'bonds broken': str(look.broken)}
        return {
            **shown,
            'under way': '; '.join(filter(None, (self._work.now(), self._building.now()))),
            'compiling beforehand': self._compilation.progress,
            'commands waiting': str(len(self._commands)),
            'commands taken': str(sum(taken.values())),
            'commands rejected': str(sum(rejected.values())),
            'last rejection': self._commands.last_rejection,
            **{f'rejected {name}': str(count) for name, count in sorted(rejected.items())},
        }


def judge(look: SimulationStatus | None, factor: float, work: Activity, building: Activity
          ) -> tuple[bytes, str]:
    """
    Return the level and the message of the status.

    :param look: last sample; None = there is no scene yet.
    :param factor: real-time factor reached.
    :param work: of the simulation thread.
    :param building: work of the thread that builds scenes.
    """
    if look is None:
        return DiagnosticStatus.OK, building.now() or 'no scene yet'
    level, message = DiagnosticStatus.OK, 'running'
    if look.failure:
        level, message = DiagnosticStatus.ERROR, f'a step went wrong: {look.failure}; {REMEDY}'
    elif work.seconds > _LONG_TURN:
        level, message = DiagnosticStatus.WARN, f'busy with {work.now()}; time stands still'
    elif look.paused:
        message = 'paused'
    elif factor < _ON_TIME * look.wanted:
        level = DiagnosticStatus.WARN
        message = f'overloaded: simulated time runs at {factor:.2f} of real time'
    building_now = building.now()
    return level, f'{message}; {building_now}' if building_now else message


def status_line(look: SimulationStatus | None, factor: float, building: str) -> str:
    """
    Describe the state in one line for a terminal.

    :param look: last sample; None = there is no scene yet.
    :param factor: real-time factor reached.
    :param building: work of the thread that builds scenes.
    """
    if look is None:
        return building or 'starting'
    pace = ('stopped by an error' if look.failure else 'paused' if look.paused
            else f'real-time factor {factor:.2f}')
    return (f't {look.time:8.2f} s   {pace}   wind {look.wind:4.1f} m/s   '
            f'{look.broken} broken' + (f'   {building}' if building else ''))
