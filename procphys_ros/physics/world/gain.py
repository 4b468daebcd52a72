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


"""Gain: remove energy that bodies gained in a step and that no contact accounts for."""

from collections.abc import Callable

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.linear import product
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.masonry.components import label
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.engine import Engine
from procphys_ros.physics.world.spin import FAST

_LEAP = 1.0  # [m/s] by which a body has become faster in a step that is looked at; falls give 0.16
_ASKED = 40  # bodies whose contacts are asked for one by one: so many take as long as all do
_FREE = int(BodyState.AWAKE)
_SLACK = 1.01  # share of its energy that a body may have won by rounding


def limit_gain(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray, velocities: np.ndarray,
               time_step: float, gravity: np.ndarray,
               touching: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """
    Slow down what turns very fast or leaps, and won energy that none of those it touches has lost.

    An engine meets the same contact point all along a step, while the body turns several times: a
    twig that spins on the ground was thrown off with twenty times its energy. What is wedged into
    others is pushed out at some speed: a batten at rest in a heap was thrown off at 59 m/s. What
    bodies that touch each other win together, the fast ones among them give back; what is moved
    along a prescribed path may give any energy.

    :param ids: bodies that move, (K,).
    :param poses: theirs before the step, (K, 7).
    :param velocities: likewise, (K, 6).
    :param time_step: [s].
    :param gravity: [m/s²], (3,).
    :param touching: gives pairs of bodies that touched, (C, 2), of all the islands that some
        bodies are in; called where it matters.
    :returns: bodies, and their velocities, (M, 6).
    """
    fast = _fast(ids, velocities, bodies.velocities, bodies.radius, time_step)
    most, now = _energies(bodies, ids[fast], poses[fast], velocities[fast], gravity)
    fast = fast[now > _SLACK * most]
    if not len(fast):
        return ids[:0], velocities[:0]
    island, driven = _islands(bodies, ids, touching(ids[fast]))
    most, now = _energies(bodies, ids, poses, velocities, gravity)
    won = np.bincount(island, now - most, len(ids))
    won[(won <= (_SLACK - 1.0) * np.bincount(island, most, len(ids))) | driven] = 0.0
    theirs = np.bincount(island[fast], now[fast] - most[fast], len(won))
    back = np.minimum(won / np.maximum(theirs, 1e-300), 1.0)[island[fast]]
    gained = back > 0.0
    fast = fast[gained]
    share = np.sqrt(1.0 - back[gained] * (1.0 - most[fast] / now[fast]))
    return ids[fast], share[:, None] * bodies.velocities[ids[fast]]


def pairs_around(engine: Engine, bodies: BodyTable, ids: np.ndarray) -> np.ndarray | None:
    """
    Follow contacts from some bodies to all that move freely and hang together with them.

    :returns: pairs of bodies that touched, (C, 2); None = too many to ask one by one.
    """
    pairs, waiting = [], ids.tolist()
    seen = set(waiting)
    while waiting:
        if len(seen) > _ASKED:
            return None
        body = waiting.pop()
        for other in engine.touched(body):
            pairs.append((body, other))
            if other not in seen and bodies.state[other] == _FREE:
                seen.add(other)
                waiting.append(other)
    return np.array(pairs, np.intp).reshape(-1, 2)


@kernel
def _fast(ids, velocities, now, radius, time_step):
    """List the bodies that turn very fast or leap, rows of the ids, (M,)."""
    fast = np.zeros(len(ids), np.bool_)
    for k in range(len(ids)):
        old, new = velocities[k], now[ids[k]]
        way = _size(new[:3]) - _size(old[:3])
        before, after = _size(old[3:]), _size(new[3:])
        fast[k] = (max(before, after) * time_step > FAST or way > _LEAP
                   or (after - before) * radius[ids[k]] > _LEAP)
    return np.flatnonzero(fast)


@kernel
def _size(vector):
    return np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)


def _energies(bodies: BodyTable, ids: np.ndarray, poses: np.ndarray, velocities: np.ndarray,
              gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give the energies that bodies may have without contacts, and that they have [J], (K,)."""
    mass, inertia, now = bodies.mass[ids], bodies.inertia[ids], bodies.poses[ids]
    most = (motion_energy(mass, inertia, poses[:, 3:], velocities)
            + np.maximum(mass * product(now[:, :3] - poses[:, :3], gravity), 0.0))
    return most, motion_energy(mass, inertia, now[:, 3:], bodies.velocities[ids])


def _islands(bodies: BodyTable, ids: np.ndarray,
             touched: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Label bodies by what touches, (K,); say which labels touch what is driven, (K,) bool."""
    index = np.full(len(bodies.state), -1)
    index[ids] = np.arange(len(ids))
    touched = touched.astype(np.intp)
    touched = touched[(touched >= 0).all(axis=1)]
    pairs = index[touched]
    both = pairs[(pairs >= 0).all(axis=1)]
    first, second = both.T.astype(np.int32, order='C')
    island, _ = label(len(ids), first, second, np.ones(len(both), bool))
    drives = bodies.state[touched] == BodyState.KINEMATIC
    driven = np.zeros(len(ids), bool)
    for one, other in ((0, 1), (1, 0)):
        moved = pairs[drives[:, one], other]
        driven[island[moved[moved >= 0]]] = True
    return island, driven
