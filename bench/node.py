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


"""The node under load: does simulated time keep up while a forest is published to a subscriber."""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
from time import monotonic

from geometry_msgs.msg import PoseArray
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
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
    """Start the node, and give it with the line that says what it simulates."""
    path = Path(folder) / 'scene.yaml'  # JSON is YAML
    path.write_text(json.dumps({'/**': {'ros__parameters': scene}}), 'utf-8')
    process = subprocess.Popen(
        [sys.executable, '-m', 'procphys_ros.ros.sim', '--ros-args', '--params-file', str(path)],
        cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    for line in process.stdout:
        if line.startswith('procphys_ros:'):
            return process, line.partition(': ')[2].strip()
    raise SystemExit('the node did not start')


def processor_seconds(pid: int) -> float:
    """Read the processor time that a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text('utf-8').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def measure(trees: int, topics: dict[str, type]) -> None:
    """Run the node on so many trees, listen to some topics, and print what arrived."""
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


def main() -> None:
    """Print the figures for poses and markers, and for many trees with poses only."""
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init()
    measure(250, {'/sim/poses': PoseArray, '/sim/markers': MarkerArray})
    measure(1000, {'/sim/poses': PoseArray})
    rclpy.shutdown()


if __name__ == '__main__':
    main()
