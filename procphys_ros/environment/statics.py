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

"""Statics: what the joints of plants bear at rest, and how far they are bent."""

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import dot, norm
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.breaks import section_modulus

_UP = np.array([0.0, 0.0, 1.0])
_STEP = 1e-3  # [s] of the kernel, from rest in equilibrium: it tells the forces in the joints
_GOAL = 1e-4  # [rad], [m] of that equilibrium
_SIDES = np.array([[1.0, 0.0, 0.0], [-0.5, np.sqrt(0.75), 0.0], [-0.5, -np.sqrt(0.75), 0.0]])


def load(plants: Blueprint, storm: float, gravity: float, threads: int) -> np.ndarray:
    """
    Solve for what the joints of plants bear under their weight and a storm from any side.

    :param plants: part i is the child of bond i.
    :param storm: steady speed of the air at all heights [m/s].
    :param gravity: [m/s²], downwards.
    :param threads: largest number of threads.
    :returns: largest bending stress over strength and bending moment [N·m] at the lower end of
        each segment, (S, 2).
    """
    forest = Forest(plants, (0.0, 0.0, -gravity))
    bending = np.zeros(len(plants))
    for side in _SIDES if storm > 0.0 else _SIDES[:1]:
        air = np.tile(storm * side, (len(forest), 1))
        forest.reset()
        _lean(forest, air, threads)
        axis = rotation.rotate(forest.poses[:, 3:], _UP)
        forest.step(_STEP, air, threads)
        moment = forest.joint_wrenches[:, 3:]
        across = norm(moment - dot(moment, axis)[:, None] * axis, axis=1)
        bending[forest.parts] = np.maximum(bending[forest.parts], across)
    use = bending / section_modulus(plants.bond_extent[:, 0]) / plants.hinges.strength
    return np.column_stack([use, bending])


def sag(plants: Blueprint, wind: np.ndarray, gravity: float, threads: int) -> np.ndarray:
    """
    Solve for the displacement of the upper ends of segments by weight and wind [m], (S, 3).

    :param plants: part i is the child of bond i.
    :param wind: steady velocity of the air at each segment [m/s], (S, 3).
    :param gravity: [m/s²], downwards.
    :param threads: largest number of threads.
    """
    forest = Forest(plants, (0.0, 0.0, -gravity))
    _lean(forest, wind[forest.parts], threads)
    poses = np.empty((len(plants), 7))
    poses[forest.parts] = forest.poses
    return _tips(poses, plants) - _tips(plants.poses, plants)


def _lean(forest: Forest, air: np.ndarray, threads: int) -> None:
    forest.lean(np.arange(len(forest.plan.start) - 1), air, threads, _GOAL)


def _tips(poses: np.ndarray, plants: Blueprint) -> np.ndarray:
    """Locate the upper ends of segments [m], (S, 3)."""
    half = 0.5 * plants.visual_size[:, 2:]
    return poses[:, :3] + half * rotation.rotate(poses[:, 3:], _UP)
