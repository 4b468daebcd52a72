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


"""Spin: what turns by more than a radian per step must not gain energy from its own inertia."""

from collections.abc import Callable

import numpy as np

from procphys_ros import rotation
from procphys_ros.physics.world.body_table import BodyState, BodyTable

_FAST = 1.0  # [rad] per step, from which an implicit gyroscopic term no longer converges
_SLACK = 1.01  # share of its energy that a body may have won by rounding


def rotational_energy(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray,
                      spin: np.ndarray) -> np.ndarray:
    """Give the energy with which bodies turn [J], (K,); poses (K, 7), spin [rad/s], (K, 3)."""
    inner = rotation.rotate(rotation.conjugate(poses[:, 3:]), spin)
    return 0.5 * (bodies.inertia[ids] * inner ** 2).sum(axis=1)


def limit_spin(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray, spin: np.ndarray,
               time_step: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Slow down what has got more energy of rotation by a step than it had, and turns very fast.

    :param ids: bodies that move, (K,).
    :param poses: theirs before the step, (K, 7).
    :param spin: likewise [rad/s], (K, 3).
    :param time_step: [s].
    :returns: bodies, and their velocities, (M, 6).
    """
    size = np.linalg.norm(bodies.velocities[ids, 3:], axis=1)
    fast = np.flatnonzero(size * time_step > _FAST)
    chosen = ids[fast]
    velocities = bodies.velocities[chosen].copy()
    now = rotational_energy(bodies, chosen, bodies.poses[chosen], velocities[:, 3:])
    slow = now * (_FAST / (size[fast] * time_step)) ** 2  # at a radian per step
    most = np.maximum(rotational_energy(bodies, chosen, poses[fast], spin[fast]), slow)
    gained = now > most
    velocities[:, 3:] *= np.where(gained, np.sqrt(most / now), 1.0)[:, None]
    return chosen[gained], velocities[gained]


def limit_gain(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray, velocities: np.ndarray,
               time_step: float, gravity: np.ndarray,
               touching: Callable[[], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """
    Slow down what turns very fast and has got more energy from its contacts than there was.

    An engine meets the same contact point all along a step, while the body turns several times: a
    twig that spins on the ground was thrown off with twenty times its energy.

    :param ids: bodies that move, ascending, (K,).
    :param poses: theirs before the step, (K, 7).
    :param velocities: likewise, (K, 6).
    :param time_step: [s].
    :param gravity: [m/s²], (3,).
    :param touching: gives pairs of bodies that touched, (C, 2); called where it matters.
    :returns: bodies, and their velocities, (M, 6).
    """
    fastest = np.maximum(np.linalg.norm(bodies.velocities[ids, 3:], axis=1),
                         np.linalg.norm(velocities[:, 3:], axis=1))
    fast = np.flatnonzero(fastest * time_step > _FAST)
    chosen = ids[fast]
    before = _energy(bodies, chosen, poses[fast], velocities[fast])
    now = _energy(bodies, chosen, bodies.poses[chosen], bodies.velocities[chosen])
    way = bodies.poses[chosen, :3] - poses[fast, :3]
    most = before + np.maximum(bodies.mass[chosen] * (way @ gravity), 0.0)
    gained = np.flatnonzero(now > _SLACK * most)
    if not len(gained):
        return ids[:0], velocities[:0]
    owned = np.zeros(len(bodies.state))
    owned[ids] = _energy(bodies, ids, poses, velocities)
    owned[bodies.state == BodyState.KINEMATIC] = np.inf  # may give any
    pairs = np.unique(np.sort(touching().astype(np.intp), axis=1), axis=0)
    lent = np.zeros(len(bodies.state))
    for one, other in ((0, 1), (1, 0)):
        np.add.at(lent, pairs[:, one], owned[pairs[:, other]])
    most += lent[chosen]
    gained = np.flatnonzero(now > _SLACK * most)
    share = np.sqrt(most[gained] / now[gained])
    return chosen[gained], share[:, None] * bodies.velocities[chosen[gained]]


def _energy(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray,
            velocities: np.ndarray) -> np.ndarray:
    """Give kinetic energies [J], (K,)."""
    return (0.5 * bodies.mass[ids] * (velocities[:, :3] ** 2).sum(axis=1)
            + rotational_energy(bodies, ids, poses, velocities[:, 3:]))
