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
Seconds from the start of the node to its first poses, and of what a first explosion waits for.

Run `python bench/start.py`; it begins with an empty cache and takes minutes. Each row starts the
executable `sim` anew: "cold" without compiled kernels, "warm" with all of them. Wall time depends
on what else the machine does; CPU time of the node, without the child that compiles in the
background, is what to compare.
"""

import os
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
from time import monotonic

from geometry_msgs.msg import PointStamped, PoseArray
import rclpy
from rclpy.executors import SingleThreadedExecutor

from procphys_ros.files.resources import shared_folder

_PATIENCE = 1200.0  # [s]
_SWAYING = 20.0  # [s] of watching for stops after the first poses
_AFTERMATH = 3.0  # [s] of watching after the explosion
os.environ['ROS_DOMAIN_ID'] = str(101 + os.getpid() % 100)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# An installed package has its bytecode; modules compiled in each process would cost 0.3 s.
_ENVIRONMENT = {k: v for k, v in os.environ.items() if k != 'PYTHONDONTWRITEBYTECODE'}


class Run:
    """
    One start of the node.

    :param scene: file in `config/`.
    :param cache: folder of compiled kernels.
    """

    def __init__(self, scene: str, cache: Path):
        rclpy.init()
        self._node = rclpy.create_node('bench')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._poses: list[float] = []
        self._node.create_subscription(PoseArray, '/sim/poses', self._note, 5)
        self._blast = self._node.create_publisher(PointStamped, '/sim/explosion', 10)
        self._began = monotonic()
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'procphys_ros.ros.sim', '--ros-args', '--params-file',
             str(shared_folder() / 'config' / scene)],
            env={**_ENVIRONMENT, 'NUMBA_CACHE_DIR': str(cache)}, stdout=subprocess.DEVNULL)

    def _note(self, _: PoseArray) -> None:
        self._poses.append(monotonic())

    def first_poses(self) -> tuple[float, float]:
        """Wait for them; return wall and CPU time of the node [s]."""
        while not self._poses:
            assert self._process.poll() is None, 'the node ended'
            assert monotonic() - self._began < _PATIENCE
            self._executor.spin_once(0.05)
        return self._poses[0] - self._began, self._cpu()

    def longest_stop(self, seconds: float) -> tuple[float, float]:
        """Watch for a while; return the longest time between two poses, and CPU time [s]."""
        start, before = monotonic(), self._cpu()
        first = len(self._poses)
        while monotonic() - start < seconds or len(self._poses) == first:
            self._executor.spin_once(0.05)
        times = [start, *self._poses[first:]]
        return max(b - a for a, b in zip(times, times[1:])), self._cpu() - before

    def explode(self) -> None:
        """Set off a charge amid the scene."""
        message = PointStamped()
        message.header.frame_id = 'world'
        message.point.z = 1.0
        self._blast.publish(message)

    def close(self) -> None:
        """End the node."""
        self._process.terminate()
        self._process.wait()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def _cpu(self) -> float:
        """Read the CPU time of the node so far, all threads [s]; children have their own."""
        fields = Path(f'/proc/{self._process.pid}/stat').read_text('ascii').rpartition(')')[2]
        user, system = fields.split()[11:13]
        return (int(user) + int(system)) / os.sysconf('SC_CLK_TCK')


def measure(label: str, scene: str, cache: Path) -> None:
    """Start a scene, let it sway, explode something; print a row."""
    run = Run(scene, cache)
    try:
        wall, cpu = run.first_poses()
        stop, _ = run.longest_stop(_SWAYING)
        run.explode()
        blast, blast_cpu = run.longest_stop(_AFTERMATH)
    finally:
        run.close()
    print(f'{label:22} {wall:10.1f} {cpu:10.1f} {stop:12.2f} {blast:14.2f} {blast_cpu:12.1f}',
          flush=True)


def main() -> None:
    """Print the table."""
    print(f'{"":22} {"poses [s]":>10} {"CPU [s]":>10} {"stop [s]":>12} {"explosion [s]":>14} '
          f'{"CPU [s]":>12}')
    with TemporaryDirectory() as folder:
        cache = Path(folder)
        measure('demo, cold', 'demo.yaml', cache)
        subprocess.run([sys.executable, '-m', 'procphys_ros.warm'], check=True,
                       env={**os.environ, 'NUMBA_CACHE_DIR': folder}, stdout=subprocess.DEVNULL)
        for scene in ('demo.yaml', 'figure_1.yaml'):
            measure(f'{scene.partition(".")[0]}, warm', scene, cache)


if __name__ == '__main__':
    main()
