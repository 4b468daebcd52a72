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

"""Substeps: solve contacts more finely where a few bodies support each other."""

from collections.abc import Callable
from functools import cache, partial

import numpy as np

from procphys_ros.linear import norm
from procphys_ros.physics.world import kinematic
from procphys_ros.physics.world.body_table import BodyState, BodyTable
from procphys_ros.physics.world.engine import Engine
from procphys_ros.physics.world.flight import correct_flight

_SLOW = 1.0  # [m/s] at which bodies may still hold each other up
_MOST = 40  # bodies that move, and with which a fine step of Bullet takes some 6 ms
_HEAP = 40  # resting ones: large heaps stand on broad feet, and their pieces jam


def are_dense(bodies: BodyTable, awake: np.ndarray) -> bool:
    """
    Return whether loose bodies may hold each other up, and are few enough to look closely.

    Rubble that falls is too fast to stand on itself; a loose arch or a corbel stands or falls by
    the last percent of its contact forces.

    :param awake: ids, (K,).
    """
    if len(awake) > _MOST or np.count_nonzero(bodies.state == BodyState.RESTING) > _HEAP:
        return False
    speed = norm(bodies.velocities[awake, :3], axis=1)
    return bool(np.count_nonzero(speed < _SLOW) > 1)


def move(engine: Engine, bodies: BodyTable, awake: np.ndarray, gravity: np.ndarray,
         time_step: float) -> tuple[np.ndarray, Callable[[], np.ndarray]]:
    """
    Step an engine, in substeps where bodies lean on each other; writes poses and velocities.

    :param awake: ids of the bodies that move freely, (K,).
    :param gravity: [m/s²], (3,).
    :param time_step: [s].
    :returns: contacts of all substeps but the last as in `mean_contacts`, and what reads those of
        the last, once, when it is asked for them.
    """
    substeps = engine.refine(len(awake), are_dense(bodies, awake))
    early = [np.zeros((0, 13))]
    time_step /= substeps
    for substep in range(substeps):
        if substep > 0:
            table = mean_contacts(engine, substeps)
            early.append(table[table[:, 9:].any(axis=1)])  # Bullet may rub without pressing
        kinematic.keep_course(engine, bodies, gravity, time_step)
        before = bodies.velocities[awake]
        engine.step(time_step)
        bodies.poses[awake], bodies.velocities[awake] = engine.read(awake)
        flying, poses = correct_flight(bodies, awake, before, gravity, time_step,
                                       engine.integrations)
        bodies.poses[flying] = poses
        engine.set_poses(flying, poses)
        engine.set_velocities(flying, bodies.velocities[flying])  # Bullet resets them
    bodies.pushed[awake] = False
    return np.concatenate(early), cache(partial(mean_contacts, engine, substeps))


def mean_contacts(engine: Engine, substeps: int) -> np.ndarray:
    """Read the contacts of the last substep, (C, 13), with its mean forces over the step."""
    table = engine.contacts()
    table[:, 9:] /= substeps
    return table
