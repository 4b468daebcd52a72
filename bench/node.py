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
The node under load: does simulated time keep up, and are services answered in time.

Prints the real-time factor while a forest is published to a subscriber; then, for a node that is
asked for ten times more than it can compute and gets 1,000 commands a second as well, how long
answers to services take and what became of the commands. Run: python bench/node.py
"""

import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import tempfile
from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, WrenchStamped
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

_ROOT = Path(__file__).resolve().parents[1]
_WARM_UP = 8.0  # [s] of real time that are not counted: kernels load, the first gusts arrive
_SPAN = 20.0  # [s] of real time that are counted
_KINDS = ('oak', 'pine', 'birch', 'willow', 'shrub')


def forest(trees: int) -> dict:
    """Describe a stand of mixed trees in a turbulent wind."""
    share = trees // len(_KINDS)
    objects = {kind: {'grammar': f'{kind}.lsys', 'count': share, 'variants': 10,
                      'origin': [0.0, 120.0 * i, 0.0]} for i, kind in enumerate(_KINDS)}
    wind = {'velocity': [8.0, 0.0, 0.0], 'turbulence_intensity': 0.2}
    return {'scene': {'objects': list(_KINDS)}, 'wind': wind, **objects}


def start(scene: dict, folder: str) -> tuple[subprocess.Popen, str]:
    """Start the node; return it with the line that describes its scene."""
    path = Path(folder) / 'scene.yaml'  # JSON is YAML
    path.write_text(json.dumps({'/**': {'ros__parameters': scene}}), 'utf-8')
    process = subprocess.Popen(
        [sys.executable, '-m', 'procphys_ros.ros.sim', '--ros-args', '--params-file', str(path)],
        cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    for line in process.stdout:
        found = re.search(r'\d+ objects, \d+ parts, \d+ bonds', line)
        if found:
            return process, found[0]
    raise SystemExit('the node did not start')


def processor_seconds(pid: int) -> float:
    """Read the processor time that a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text('utf-8').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def measure(trees: int, topics: dict[str, type]) -> None:
    """Run the node on a number of trees, listen to some topics, and print what arrived."""
    node = rclpy.create_node('bench_listener')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    sizes: dict[str, list[int]] = {topic: [] for topic in topics}
    times: list[float] = []
    for topic, kind in topics.items():
        node.create_subscription(
            kind, topic, lambda data, topic=topic: sizes[topic].append(len(data)), 5, raw=True)
    node.create_subscription(
        Clock, '/clock', lambda m: times.append(m.clock.sec + 1e-9 * m.clock.nanosec), 5)

    def listen(seconds: float) -> float:
        begin = monotonic()
        while monotonic() - begin < seconds:
            executor.spin_once(timeout_sec=0.1)
        return monotonic() - begin

    with tempfile.TemporaryDirectory() as folder:
        process, summary = start(forest(trees), folder)
        try:
            listen(_WARM_UP)
            for arrived in (*sizes.values(), times):
                arrived.clear()
            used = processor_seconds(process.pid)
            elapsed = listen(_SPAN)
            used = processor_seconds(process.pid) - used
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()
    print(f'{trees} trees ({summary}): real-time factor '
          f'{(times[-1] - times[0]) / elapsed:.2f}, {100 * used / elapsed:.0f} % of a core')
    for topic, arrived in sizes.items():
        print(f'  {topic:13} {len(arrived) / elapsed:5.1f} Hz   '
              f'{sum(arrived) / elapsed / 1e6:6.1f} MB/s')
    executor.shutdown()
    node.destroy_node()


def overload(trees: int) -> None:
    """Ask far too much of a node, and print how it answers."""
    node = rclpy.create_node('bench_caller')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    looks: list[dict[str, str]] = []
    node.create_subscription(
        DiagnosticArray, '/diagnostics',
        lambda m: looks.append({v.key: v.value for v in m.status[0].values}), 10)
    switch = node.create_client(SetBool, '/sim/set_wind_enabled')
    impulses = node.create_publisher(WrenchStamped, '/sim/impulse', 1000)
    with tempfile.TemporaryDirectory() as folder:
        process, summary = start({**forest(trees), 'real_time_factor': 1000.0}, folder)
        try:
            switch.wait_for_service()
            _spin(executor, _WARM_UP)
            waits, sent = _call_and_send(executor, switch, impulses)
            _spin(executor, 4.0)
            waiting = [int(look['commands waiting']) for look in looks]
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()
    answered = sum(int(looks[-1][f'commands {what}']) for what in ('taken', 'rejected'))
    print(f'{trees} trees ({summary}), overloaded: real-time factor '
          f'{looks[-1]["real-time factor"]} of 1000, {len(waits)} services answered in '
          f'{1000 * np.median(waits):.0f} ms (median), {1000 * max(waits):.0f} ms (slowest); '
          f'{sent + len(waits)} commands sent, {answered} answered for, '
          f'{waiting[-1]} wait 4 s later, {max(waiting)} at most')
    executor.shutdown()
    node.destroy_node()


def _spin(executor: SingleThreadedExecutor, seconds: float) -> None:
    end = monotonic() + seconds
    while monotonic() < end:
        executor.spin_once(timeout_sec=0.1)


def _call_and_send(executor: SingleThreadedExecutor, switch, impulses) -> tuple[list[float], int]:
    """Call a service over and over amid 1,000 impulses a second, half of them on no part."""
    message = WrenchStamped()
    message.wrench.force.x = 1e-3
    waits: list[float] = []
    sent, begin = 0, monotonic()
    while monotonic() - begin < _SPAN:
        asked = monotonic()
        future = switch.call_async(SetBool.Request(data=True))
        while not future.done():
            while sent < 1000 * (monotonic() - begin):
                message.header.frame_id = ('oak_0/1', 'nobody/1')[sent % 2]
                impulses.publish(message)
                sent += 1
            executor.spin_once(timeout_sec=0.001)
        waits.append(monotonic() - asked)
    return waits, sent


def main() -> None:
    """Print the figures for poses and markers, for many trees with poses only, for overload."""
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init()
    measure(250, {'/sim/poses': PoseArray, '/sim/markers': MarkerArray})
    measure(1000, {'/sim/poses': PoseArray})
    overload(1000)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
