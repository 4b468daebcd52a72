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
Speed of the tree kernel beside PyBullet multibodies and MuJoCo, on one forest in one run.

Run `python bench/kernel.py` (MuJoCo is optional: `pip install mujoco`). The kernel steps the whole
forest in turbulent wind, different at every segment, and tests every joint for breaking. MuJoCo
gets ready-made forces on the same forest. PyBullet gets springs and weight but no wind, for the
trees that fit its joint limit, and is compared per segment. So both rivals have the easier task.
The engines take turns in every round; times are processor times of the one thread that works.
"""

from collections.abc import Callable
import importlib.util
import statistics
import time

from forests import plant
import numpy as np
from rivals import MOST_JOINTS, MuJoCoForest, PyBulletForest

from procphys_ros.blueprint import chain
from procphys_ros.physics.trees import Forest

_TREES = 250
_DT = 1.0 / 60.0  # [s]
_ROUNDS = 15
_WIND, _GUST = 12.0, 4.0  # [m/s], mean and standard deviation
_FIELDS = 16  # random wind fields to draw from


def main() -> None:
    """Print medians and ratios."""
    trees = plant(_TREES)
    fitting = [tree for tree in trees if len(tree) <= MOST_JOINTS]
    forest = Forest(chain(trees))
    count, few = len(forest), sum(len(tree) for tree in fitting)
    print(f'{_TREES} trees, {count} segments, dt 1/60 s, one core')
    wind = np.random.default_rng(0).normal((_WIND, 0.0, 0.0), _GUST, (_FIELDS, count, 3))
    bullet = PyBulletForest(chain(fitting), _DT)
    work: dict[str, tuple[Callable, int, int]] = {
        'kernel': (_kernel(forest, wind), 20, count), 'PyBullet': (bullet.step, 1, few)}
    if importlib.util.find_spec('mujoco'):
        work['MuJoCo'] = (_mujoco(MuJoCoForest(chain(trees), _DT), wind), 3, count)
    else:
        print('MuJoCo is not installed: left out')
    times = _take_turns({name: (step, repeats) for name, (step, repeats, _) in work.items()})
    per_segment = {name: times[name] / segments for name, (_, _, segments) in work.items()}
    for name, (_, _, segments) in work.items():
        print(f'{name:9}{segments:7} segments {1e3 * times[name]:9.3f} ms/step '
              f'{1e6 * per_segment[name]:9.4f} us/segment '
              f'{per_segment[name] / per_segment["kernel"]:9.1f} x kernel')
    print(f'largest bend: kernel {np.abs(forest.bends).max():.3f} rad, '
          f'PyBullet {np.abs(bullet.bends()).max():.3f} rad')


def _kernel(forest: Forest, wind: np.ndarray) -> Callable:
    fields = iter(range(1 << 62))

    def step() -> None:
        forest.step(_DT, wind[next(fields) % _FIELDS])
        forest.overloaded()

    return step


def _mujoco(rival: MuJoCoForest, wind: np.ndarray) -> Callable:
    fields = iter(range(1 << 62))
    return lambda: rival.step(wind[next(fields) % _FIELDS])


def _take_turns(work: dict[str, tuple[Callable, int]]) -> dict[str, float]:
    """Time steps of all engines in turns; return the median of each [s]."""
    samples: dict[str, list[float]] = {name: [] for name in work}
    for turn in range(_ROUNDS + 1):
        for name, (step, repeats) in work.items():
            for _ in range(repeats):
                start = time.process_time()
                step()
                if turn:  # the first turn compiles and warms up
                    samples[name].append(time.process_time() - start)
    return {name: statistics.median(values) for name, values in samples.items()}


if __name__ == '__main__':
    main()
