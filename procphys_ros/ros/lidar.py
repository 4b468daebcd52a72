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


"""Publisher of what a simulated lidar sees, at its own rate of simulated time."""

from time import perf_counter

from rclpy.node import Node

from procphys_ros import messages
from procphys_ros.ros.parameters import Parameters
from procphys_ros.ros.topics import offer
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.simulation import Simulation

_EARLY = 1e-6  # [s] rounding of simulated time


class LidarPublisher:
    """
    Scan the scene after the steps at which a scan is due, while there are subscribers.

    :param node: the node that publishes.
    :param parameters: of the node, with `lidar.*`.
    """

    def __init__(self, node: Node, parameters: Parameters):
        self._parameters = parameters
        self._publisher = offer(node, 'lidar')
        self._due = 0.0
        self.apply({'lidar.rate'})

    def apply(self, names: set[str]) -> None:
        """Apply changed parameters."""
        if any(name.startswith('lidar.') for name in names):
            self._settings = LidarSettings.read(self._parameters.nested())

    def look(self, simulation: Simulation) -> None:
        """Publish a scan if one is due at the present time of a simulation."""
        settings, time = self._settings, simulation.time
        if not settings.rate or not self._publisher.get_subscription_count():
            return
        period = 1.0 / settings.rate
        late = time - self._due + _EARLY
        if -period < late < 0.0:  # else it is due, or time has jumped back
            return
        start = perf_counter()
        in_turn = 0.0 <= late < simulation.time_step  # else the first, or after a pause
        self._due = period + (self._due if in_turn else time)
        scan = simulation.scan(settings)
        if scan is not None:
            rows = messages.scan_rows(scan.points(not settings.frame), scan.ranges, scan.parts)
            self._publisher.publish(messages.point_cloud(
                rows, messages.stamp(time), settings.frame or self._parameters['world_frame']))
        simulation.timings['lidar'] = perf_counter() - start
