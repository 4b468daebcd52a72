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

"""Time of leaves and dust, beside the same sums written in numpy alone, in one run."""

from statistics import median
from time import perf_counter

import numpy as np

from procphys_ros.blueprint import Leaves
from procphys_ros.geometry import rotation
from procphys_ros.physics.dust import DustCloud, State, stokes_speed
from procphys_ros.physics.foliage import carried, FallingLeaves, Flutter
from procphys_ros.physics.wind import Wind, WindSettings

TREES, SEGMENTS, LEAVES = 250, 44, 400  # per tree: the forest of the paper, 100,000 leaves
PUFFS = 50_000
ROUNDS = 30
STEP = 1.0 / 60.0


def foliage() -> tuple[Leaves, np.ndarray]:
    """Scatter leaves over the segments of a stand, and give the poses of these."""
    rng = np.random.default_rng(0)
    parts, count = TREES * SEGMENTS, TREES * LEAVES
    pose, frames = rng.standard_normal((count, 7)), rng.standard_normal((parts, 7))
    for some in (pose, frames):
        some[:, 3:] /= np.linalg.norm(some[:, 3:], axis=1, keepdims=True)
    frames[:, :2] *= 50.0
    frames[:, 2] = rng.uniform(2.0, 12.0, parts)
    part = np.sort(rng.integers(0, parts, count)).astype(np.int32)
    return Leaves(part, pose, rng.uniform(0.05, 0.5, count), np.zeros(count, np.int16)), frames


def flutter_by_numpy(motion: Flutter, leaves: Leaves, frames: np.ndarray, air: np.ndarray,
                     time: float) -> np.ndarray:
    """Evaluate the same motion with numpy and the package's vectorised rotations."""
    past = air[leaves.part]
    speed = np.linalg.norm(past, axis=1, keepdims=True)
    flow = rotation.rotate(rotation.conjugate(frames[leaves.part, 3:]), past / speed)
    axis = rotation.rotate(leaves.pose[:, 3:], np.array([0.0, 0.0, 1.0]))
    square = (speed / 10.0) ** 2
    aim = axis + 0.9 * square / (1.0 + square) * flow
    turn = np.column_stack([np.cross(axis, aim), np.einsum('ij,ij->i', axis, aim)
                            + np.linalg.norm(aim, axis=1)])
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    share = 1.0 - np.exp(-(speed / motion._onset[:, None]) ** 2)
    small = 0.5 * share * [0.15, 0.15, 0.45] * np.sin(motion._rate * time + motion._phase)
    small = np.column_stack([small, np.ones(len(small))])
    small /= np.linalg.norm(small, axis=1, keepdims=True)
    attitude = rotation.multiply(rotation.multiply(turn, leaves.pose[:, 3:]), small)
    local = np.concatenate([leaves.pose[:, :3], attitude], axis=1)
    return rotation.compose(frames[leaves.part], local)


def drift_by_numpy(position: np.ndarray, deviation: np.ndarray, fall: np.ndarray,
                   wind: Wind, time: float, rng: np.random.Generator) -> None:
    """Step the same dust with numpy, all puffs in the air."""
    air = wind.velocity(position, time)
    widening = (0.02 + 0.08 * np.linalg.norm(air, axis=1)) * STEP
    position += air * STEP + np.sqrt(widening)[:, None] * rng.standard_normal(position.shape)
    height = np.abs(position[:, 2]) - fall * STEP
    position[:, 2] = np.maximum(height, 0.0)
    deviation[:] = np.sqrt(deviation ** 2 + widening)


def falling_leaves(count: int) -> FallingLeaves:
    """Release leaves high up."""
    falling = FallingLeaves(9.81, 1)
    pose = np.zeros((count, 7))
    pose[:, 2], pose[:, 6] = 1e5, 1.0
    falling.let_go(np.arange(count), pose, np.zeros((count, 3)), np.full(count, 0.1))
    return falling


def time_of(call) -> float:
    """Return the median time of `call(t)` [s] while t advances by frames."""
    call(0.0)
    times = []
    for i in range(ROUNDS):
        start = perf_counter()
        call((i + 1) * STEP)
        times.append(perf_counter() - start)
    return median(times)


def main() -> None:
    """Print the figures."""
    leaves, frames = foliage()
    motion = Flutter(leaves, 1)
    wind = Wind(WindSettings((8.0, 2.0, 0.0), turbulence_intensity=0.2), seed=1)
    air = wind.velocity(frames[:, :3], 3.0)

    def ours(time: float) -> np.ndarray:
        return carried(leaves.part, frames, motion.poses(leaves.part, frames, air, time))

    def theirs(time: float) -> np.ndarray:
        return flutter_by_numpy(motion, leaves, frames, air, time)

    difference = np.abs(ours(3.0) - theirs(3.0)).max()
    fast, slow = time_of(ours), time_of(theirs)
    print(f'flutter, {len(leaves)} leaves  {fast * 1e3:7.2f} ms, numpy {slow * 1e3:7.2f} ms, '
          f'ratio {slow / fast:.1f}, largest difference {difference:.0e}')
    cloud = DustCloud(PUFFS, 1)
    for i in range(60):
        cloud.raise_dust(np.array([[i, 0.0, 1000.0]]), np.ones(1), np.array([1e7]))
    assert (cloud.state == State.AIRBORNE).all()
    position, deviation = cloud.position.copy(), cloud.deviation.copy()
    fall, rng = stokes_speed(cloud.grain), np.random.default_rng(2)
    fast = time_of(lambda t: cloud.step(STEP, lambda points: wind.velocity(points, t)))
    slow = time_of(lambda t: drift_by_numpy(position, deviation, fall, wind, t, rng))
    blow = time_of(lambda t: wind.velocity(position, t))
    print(f'dust, {PUFFS} puffs     {fast * 1e3:7.2f} ms, numpy {slow * 1e3:7.2f} ms, '
          f'ratio {slow / fast:.1f}; {blow * 1e3:.2f} ms of both are the wind')
    falling, rows = falling_leaves(10_000), np.arange(10_000)
    still = np.zeros((10_000, 3))
    fast = time_of(lambda t: falling.step(rows, still, STEP))
    print(f'falling, {len(rows)} leaves   {fast * 1e3:7.2f} ms, without the wind')


if __name__ == '__main__':
    main()
