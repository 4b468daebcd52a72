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


"""
Services in a flood of commands: those of the node, and of the least node that rclpy can make.

Both run at once and are flooded in turn by one sender, so that a busy machine holds up both. The
bare node does nothing with what it hears. Run: python bench/flood.py
"""

import os
import signal
import subprocess
import sys
import tempfile
from threading import Thread
from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray
from node import forest, start
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool

_TREES = 50
_RATES = (0, 1000, 5000)  # [1/s]
_SPAN = 6.0  # [s] of each flood
_ROUNDS = 2
_BETWEEN = 0.02  # [s] between an answer and the next call
_SETTLE = 8.0  # [s] in which kernels load, and what waits after all floods is come to

_BARE = """
import rclpy
from geometry_msgs.msg import WrenchStamped
from std_srvs.srv import SetBool

def serve(request, response):
    response.success = True
    return response

rclpy.init()
node = rclpy.create_node('bare')
node.create_service(SetBool, '~/set_wind_enabled', serve)
node.create_subscription(WrenchStamped, '~/impulse', lambda message: None, 10000)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""

_SENDER = """
import sys
from time import monotonic, sleep
from geometry_msgs.msg import WrenchStamped
import rclpy

rclpy.init()
node = rclpy.create_node('sender')
message = WrenchStamped()
message.wrench.force.x = 1e-3
publishers = {name: node.create_publisher(WrenchStamped, f'/{name}/impulse', 1000)
              for name in ('sim', 'bare')}
while not all(one.get_subscription_count() for one in publishers.values()):
    sleep(0.1)
for line in sys.stdin:
    name, rate, span = line.split()
    sent, begin = 0, monotonic()
    while (elapsed := monotonic() - begin) < float(span):
        while sent < float(rate) * elapsed:
            message.header.frame_id = ('oak_0/1', 'nobody/1')[sent % 2]
            publishers[name].publish(message)
            sent += 1
        sleep(0.001)
    print(sent, flush=True)
"""


class _Flood:
    """
    A sender, the nodes that it floods, and a caller of their services.

    :param folder: for the parameter file.
    """

    def __init__(self, folder: str):
        self._node = rclpy.create_node('bench_caller')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._looks: list[dict[str, str]] = []
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics',
            lambda m: self._looks.append({v.key: v.value for v in m.status[0].values}), 10)
        sim, self.summary = start(forest(_TREES), folder)
        Thread(target=sim.stdout.read, daemon=True).start()  # a pipe that is full would stop it
        bare = subprocess.Popen([sys.executable, '-c', _BARE])
        self._sender = subprocess.Popen([sys.executable, '-c', _SENDER], text=True,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.nodes = {'sim': sim, 'bare': bare}
        self._clients = {name: self._node.create_client(SetBool, f'/{name}/set_wind_enabled')
                         for name in self.nodes}
        for client in self._clients.values():
            client.wait_for_service()
        self.spin(_SETTLE)

    def spin(self, seconds: float) -> None:
        """Listen for some time."""
        end = monotonic() + seconds
        while monotonic() < end:
            self._executor.spin_once(timeout_sec=0.01)

    def run(self, name: str, rate: int) -> tuple[list[float], int]:
        """Call the service of a flooded node; return answer times, and how many were sent."""
        self._sender.stdin.write(f'{name} {rate} {_SPAN}\n')
        self._sender.stdin.flush()
        waits: list[float] = []
        end = monotonic() + _SPAN
        while monotonic() < end:
            asked = monotonic()
            future = self._clients[name].call_async(SetBool.Request(data=True))
            while not future.done():
                self._executor.spin_once(timeout_sec=0.05)
            waits.append(monotonic() - asked)
            self.spin(_BETWEEN)
        return waits, int(self._sender.stdout.readline())

    def answered(self) -> dict[str, int]:
        """Return the simulation's counts of commands after all have been handled."""
        self.spin(_SETTLE)
        return {what: int(self._looks[-1][f'commands {what}'])
                for what in ('taken', 'rejected', 'waiting')}

    def close(self) -> None:
        """End all processes."""
        self._sender.stdin.close()
        for process in (*self.nodes.values(), self._sender):
            process.send_signal(signal.SIGINT)
            process.wait()


def main() -> None:
    """Print how long services take without a flood and in two."""
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        flood = _Flood(folder)
        try:
            print(f'{flood.summary}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores')
            asked = _compare(flood)
            print(f'{asked} commands and calls for sim: {flood.answered()}')
        finally:
            flood.close()
    rclpy.shutdown()


def _compare(flood: _Flood) -> int:
    """Flood both nodes in turn; return how many commands and calls went to the simulation."""
    asked = 0
    for rate in _RATES:
        waits: dict[str, list[float]] = {name: [] for name in flood.nodes}
        for _ in range(_ROUNDS):
            for name in flood.nodes:
                found, sent = flood.run(name, rate)
                waits[name] += found
                asked += (sent + len(found)) * (name == 'sim')
                flood.spin(1.0)
        for name, found in waits.items():
            middle, most = 1e3 * np.quantile(found, [0.5, 0.9])
            print(f'{rate} commands/s, {name:4}: {len(found)} calls, {middle:.0f} ms (median), '
                  f'{most:.0f} ms (90 %), {1e3 * max(found):.0f} ms (slowest)')
    return asked


if __name__ == '__main__':
    main()
