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
Admission: standing bricks go to the engine bit by bit, or when something comes near them.

To create them all at once takes some 0.1 ms each: a second or two for a large building that joins.
"""

import numpy as np

from procphys_ros.physics.touch import overlaps, piece_bounds
from procphys_ros.physics.world.body_table import BodyTable
from procphys_ros.physics.world.engine import Engine

_PER_STEP = 64  # bodies: a few milliseconds; 15,000 have joined after four seconds
_ROOM = 0.5  # [m] from what moves, beyond its way; engines look for contacts within 2 cm
_WAYS = 2.0  # steps that it is looked ahead


class Queue:
    """
    Immovable bodies that an engine does not have yet, in the order in which it gets them.

    :param engine: that gets them.
    :param bodies: the table that they are in.
    """

    def __init__(self, engine: Engine, bodies: BodyTable):
        self._engine, self._bodies = engine, bodies
        self._ids = np.zeros(0, np.intp)

    def append(self, ids: np.ndarray) -> None:
        """Let plain boxes wait, (K,) ids; works out their bounds."""
        bodies, piece = self._bodies, self._bodies.first_piece[ids]
        bodies.bounds[ids] = piece_bounds(
            bodies.piece_shape[piece], bodies.poses[ids], bodies.piece_size[piece],
            np.zeros((len(ids), 6)), 0.0, 0.0)
        self._ids = np.concatenate([self._ids, ids])

    def drop(self, ids: np.ndarray) -> np.ndarray:
        """Forget bodies that are removed, and give those that the engine has."""
        if not len(self._ids):
            return ids
        known = ids[~np.isin(ids, self._ids)]
        self._ids = self._ids[~np.isin(self._ids, ids)]
        return known

    def admit_all(self) -> None:
        """Give the engine everything that waits."""
        self._admit(np.ones(len(self._ids), bool))

    def admit_among(self, ids: np.ndarray) -> np.ndarray:
        """Give the engine what waits of some bodies, as they are now; give those that it had."""
        if not len(self._ids):
            return ids
        known = ids[~np.isin(ids, self._ids)]
        self._admit(np.isin(self._ids, ids))
        return known

    def advance(self, awake: np.ndarray, time_step: float) -> None:
        """
        Give the engine what something may touch in this step, and the next ones in turn.

        :param awake: ids of the bodies that move freely, (K,).
        :param time_step: [s].
        """
        if not len(self._ids):
            return
        bodies, velocity = self._bodies, self._bodies.velocities[awake, :3]
        reach = (bodies.radius[awake] + _ROOM
                 + _WAYS * time_step * np.sqrt((velocity ** 2).sum(axis=1)))[:, None]
        centre = bodies.poses[awake, :3]
        due = np.arange(len(self._ids)) < _PER_STEP
        due[overlaps(np.hstack([centre - reach, centre + reach]),
                     bodies.bounds[self._ids])[1]] = True
        self._admit(due)

    def _admit(self, due: np.ndarray) -> None:
        if due.any():
            ids, self._ids = self._ids[due], self._ids[~due]
            self._engine.add(self._bodies, ids)
