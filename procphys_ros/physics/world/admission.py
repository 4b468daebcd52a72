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

Even what is frozen costs an engine every step, and to create a body some 0.1 ms: a second or two
for a large building.
"""

import numpy as np

from procphys_ros.physics.touch import overlaps, piece_bounds
from procphys_ros.physics.world.body_table import BodyTable
from procphys_ros.physics.world.engine import Engine
from procphys_ros.physics.world.extents import bounds
from procphys_ros.physics.world.sleeping import rim_speed

_ROOM = 0.5  # [m] from what moves, beyond its way; engines look for contacts within 2 cm
_WAYS = 2.0  # steps that it is looked ahead
_GONE = 0.1  # share of the listed ones that may wait no more before they are listed anew


class Queue:
    """
    Immovable bodies that an engine does not have yet.

    What is driven passes through them, so that only what moves freely fetches them.

    :param engine: that gets them.
    :param bodies: the table that they are in.
    """

    def __init__(self, engine: Engine, bodies: BodyTable):
        self._engine, self._bodies = engine, bodies
        self._waits = np.zeros(0, bool)  # by id
        self._keep(np.zeros(0, np.intp))

    def _keep(self, ids: np.ndarray) -> None:
        """List the ids and bounds of those that wait; some of them may wait no more since."""
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
        """Forget bodies that are removed, and give those that the engine has."""
        waits = self._find(ids)
        self._leave(ids[waits])
        return ids[~waits]

    def admit_among(self, ids: np.ndarray) -> np.ndarray:
        """Give the engine what waits of some bodies, as they are now; give those that it had."""
        waits = self._find(ids)
        self._admit(np.unique(ids[waits]))
        return ids[~waits]

    def _find(self, ids: np.ndarray) -> np.ndarray:
        """Return which bodies are queued, (K,) bool."""
        known = ids < len(self._waits)
        known[known] = self._waits[ids[known]]
        return known

    def advance(self, awake: np.ndarray, time_step: float) -> None:
        """
        Give the engine what something may touch in this step.

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
