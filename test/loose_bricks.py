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

"""Bricks for tests of the world in which loose bodies fall."""

import numpy as np

from procphys_ros.blueprint import Shape

DT = 1.0 / 60.0
G = 9.81
BRICK = np.array([0.215, 0.1025, 0.065])
BRICK_MASS = 2.7


def at(x, y, z, attitude=(0.0, 0.0, 0.0, 1.0)):
    """Return a pose, (7,)."""
    return np.array([x, y, z, *attitude])


def nudged(seed):
    """Return a gravity that differs by a millionth, to perturb chaotic motion [m/s²]."""
    return np.array([0.0, 0.0, -G]) + 1e-6 * np.random.default_rng(seed).normal(size=3)


def heap(world, seed, wide, count):
    """Drop bricks in loose layers of a width and depth; return their ids."""
    rng = np.random.default_rng(seed)
    return [world.add_body(Shape.BOX, BRICK, BRICK_MASS,
                           at(*(np.array([0.25, 0.15]) * (i % wide, i // wide % wide)
                                + rng.uniform(0, 0.02, 2)), 0.2 + i // wide ** 2 * 0.12))
            for i in range(count)]


def rest(world, limit=10.0):
    """Step until nothing moves; return the time it took [s]."""
    for step in range(round(limit / DT)):
        world.step(DT)
        if not len(world.awake):
            return step * DT
    raise AssertionError(f'{len(world.awake)} bodies still move after {limit} s')
