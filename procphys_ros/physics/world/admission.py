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
Admission: add standing bricks to the engine when a moving body comes near them.

Even frozen bodies cost an engine time in every step, and creating a body takes some 0.1 ms: a
second or two for a large building.
"""

import numpy as np

from procphys_ros.physics.touch import overlaps, piece_bounds
from procphys_ros.physics.world.body_table import BodyTable
from procphys_ros.physics.world.engine import Engine
from procphys_ros.physics.world.extents import bounds
from procphys_ros.physics.world.sleeping import rim_speed

_ROOM = 0.5  # [m] around the swept bounds of moving bodies; engines look for contacts within 2 cm
_WAYS = 2.0  # steps of motion in these swept bounds
_GONE = 0.1  # share of listed bodies that have left the queue at which the list is rebuilt


class Queue:
    """
    Immovable bodies that are not yet in an engine.

    Kinematic bodies pass through them, so only awake bodies admit them.

    :param engine: engine to add them to.
    :param bodies: table of the bodies.
    """

    def __init__(self, engine: Engine, bodies: BodyTable):
        self._engine, self._bodies = engine, bodies
        self._waits = np.zeros(0, bool)  # by id
        self._keep(np.zeros(0, np.intp))

    def _keep(self, ids: np.ndarray) -> None:
        """Store ids and bounds of queued bodies; bodies that leave later stay listed at first."""
        self._ids, self._bounds = ids, self._bodies.bounds[ids]
        self._left = 0  # of these
        self._low = self._bounds[:, :3].min(axis=0, initial=np.inf)
        self._high = self._bounds[:, 3:].max(axis=0, initial=-np.inf)

    def append(self, ids: np.ndarray) -> None:
        """Queue plain boxes, (K,) ids, and compute their bounds."""
        bodies, piece = self._bodies, self._bodies.first_piece[ids]
        bodies.bounds[ids] = piece_bounds(
            bodies.piece_shape[piece], bodies.poses[ids], bodies.piece_size[piece],
            np.zeros((len(ids), 6)), 0.0, 0.0)
        self._keep(np.concatenate([self._ids[self._waits[self._ids]], ids]))
        more = len(bodies.state) - len(self._waits)
        self._waits = np.concatenate([self._waits, np.zeros(more, bool)])
        self._waits[ids] = True

    def drop(self, ids: np.ndarray) -> np.ndarray:
        """Drop removed bodies from the queue; return the others, which the engine has."""
        waits = self._find(ids)
        self._leave(ids[waits])
        return ids[~waits]

    def admit_among(self, ids: np.ndarray) -> np.ndarray:
        """Add the queued ones of some bodies to the engine; return those that it already had."""
        waits = self._find(ids)
        self._admit(np.unique(ids[waits]))
        return ids[~waits]

    def _find(self, ids: np.ndarray) -> np.ndarray:
        """Mark the bodies that are queued, (K,) bool."""
        known = ids < len(self._waits)
        known[known] = self._waits[ids[known]]
        return known

    def advance(self, awake: np.ndarray, time_step: float) -> None:
        """
        Add to the engine the queued bodies that awake bodies may touch in this step.

        :param awake: ids of the bodies that move freely, (K,).
        :param time_step: [s].
        """
        if not len(self._ids) or not len(awake):
            return
        reach = (_ROOM + _WAYS * time_step * rim_speed(self._bodies, awake))[:, None]
        box = bounds(self._bodies, awake)
        low, high = box[:, :3] - reach, box[:, 3:] + reach
        near = ((low < self._high) & (high > self._low)).all(axis=1)
        if near.any():
            found = overlaps(np.hstack([low[near], high[near]]), self._bounds)[1]
            found = np.unique(self._ids[found])
            self._admit(found[self._waits[found]])

    def _admit(self, ids: np.ndarray) -> None:
        if len(ids):
            self._leave(ids)
            self._engine.add(self._bodies, ids)

    def _leave(self, ids: np.ndarray) -> None:
        """Remove bodies from the queue, (K,) ids."""
        self._waits[ids] = False
        self._left += len(ids)
        if self._left > _GONE * len(self._ids):
            self._keep(self._ids[self._waits[self._ids]])
