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
Split one forest over 1 to 4 nodes, and see how much simulated time each makes in a second.

Every node runs as fast as it can with its share of the trees, all at the same time, each on one
core. Prints simulated seconds times trees per second of real time, all shares together, and its
ratio to one node with the whole forest; as many as there are nodes would be linear. Nodes that
find no free core share one; so it prints also the work per second of processor time, relative to
one node, which is 1 when only cores are missing. Run: python bench/shards.py [trees]
"""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
from time import monotonic

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.executors import SingleThreadedExecutor

_ROOT = Path(__file__).resolve().parents[1]
_KINDS = ('oak', 'pine', 'birch', 'willow')
_WARM_UP = 6.0  # [s] of real time that are not counted
_SPAN = 12.0  # [s] of real time that are


def start(count: int, index: int, trees: int, folder: str) -> subprocess.Popen:
    """Start one of several nodes with its share of the forest, at full speed."""
    scene = {'scene': {'objects': list(_KINDS)}, 'real_time_factor': 0.0,
             'shard': {'index': index, 'count': count},
             'wind': {'velocity': [8.0, 0.0, 0.0], 'turbulence_intensity': 0.2},
             **{kind: {'grammar': f'{kind}.lsys', 'count': trees // len(_KINDS), 'variants': 8,
                       'origin': [0.0, 100.0 * i, 0.0]} for i, kind in enumerate(_KINDS)}}
    path = Path(folder) / f'scene_{index}.yaml'  # JSON is YAML
    path.write_text(json.dumps({'/**': {'ros__parameters': scene}}), 'utf-8')
    process = subprocess.Popen(
        [sys.executable, '-m', 'procphys_ros.ros.sim', '--ros-args', '-r', f'__node:=sim_{index}',
         '--params-file', str(path)],
        cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    for line in process.stdout:
        if 'Ctrl-C' in line:
            return process
    raise SystemExit('a node did not start')


def processor_seconds(processes: list[subprocess.Popen]) -> float:
    """Read the processor time that processes have used [s]."""
    used = 0
    for process in processes:
        text = Path(f'/proc/{process.pid}/stat').read_text('utf-8')
        used += sum(int(ticks) for ticks in text.rpartition(')')[2].split()[11:13])
    return used / os.sysconf('SC_CLK_TCK')


def measure(count: int, trees: int) -> tuple[float, float]:
    """
    Run a number of nodes.

    :returns: simulated seconds times the trees they were simulated for, all shares, per second of
        real time, and per second of processor time.
    """
    node = rclpy.create_node(f'bench_shards_{count}')
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    seen: dict[str, list[tuple[float, float]]] = {}

    def note(message: DiagnosticArray) -> None:
        for status in message.status:
            time = next(v.value for v in status.values if v.key == 'simulation time [s]')
            seen.setdefault(status.name, []).append((monotonic(), float(time)))
    node.create_subscription(DiagnosticArray, '/diagnostics', note, 10)
    with tempfile.TemporaryDirectory() as folder:
        processes = [start(count, index, trees, folder) for index in range(count)]
        try:
            for span in (_WARM_UP, _SPAN):
                seen.clear()
                used, begin = processor_seconds(processes), monotonic()
                while monotonic() - begin < span:
                    executor.spin_once(timeout_sec=0.1)
            cores = (processor_seconds(processes) - used) / (monotonic() - begin)
        finally:
            for process in processes:
                process.send_signal(signal.SIGINT)
            for process in processes:
                process.wait()
    executor.shutdown()
    node.destroy_node()
    done = sum((looks[-1][1] - looks[0][1]) / (looks[-1][0] - looks[0][0]) * trees / count
               for looks in seen.values())
    return done, done / cores


def main() -> None:
    """Print one line per number of nodes."""
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    trees = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    rclpy.init()
    alone: tuple[float, float] | None = None
    for count in (1, 2, 3, 4):
        done, per_core = measure(count, trees)
        alone = alone or (done, per_core)
        print(f'{count} nodes, {trees} trees: {done:.0f} tree-seconds per second, '
              f'{done / alone[0]:.2f} times one node; per second of processor time '
              f'{per_core / alone[1]:.2f} times ({os.cpu_count()} cores)', flush=True)
    rclpy.shutdown()


if __name__ == '__main__':
    main()
