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


"""Leaning: what branches that lie or fall on standing walls do to them."""

import numpy as np

from procphys_ros.physics.trees import Forest
from procphys_ros.simulation.blows import Blows, CONTACT
from procphys_ros.simulation.events import Cause

_HEAVY = 200.0  # [N] on one brick; lighter pushes, such as of twigs in the wind, load no wall


class Leaning:
    """
    Hands the impulses of branches on bricks to the walls.

    :param blows: on masonry.
    :param forest: all trees.
    """

    def __init__(self, blows: Blows, forest: Forest):
        self._blows = blows
        self._forest = forest

    def tear_out(self, rows: np.ndarray, parts: np.ndarray, points: np.ndarray,
                 impulses: np.ndarray, time: float, time_step: float) -> bool:
        """
        Break bricks out where branches press harder in a step than their bonds withstand.

        The branch feels the bonds until they have broken; what holds then is only the brick.

        :param rows: of the forest, (C,).
        :param parts: standing bricks that these rows touch, -1 for none, (C,).
        :param points: where, world [m], (C, 3).
        :param impulses: on the rows over the step [N·s], (C, 3).
        :param time: of the simulation [s].
        :param time_step: [s].
        :returns: whether any brick came out.
        """
        torn = False
        for part, total in zip(*_per_part(parts, impulses)):
            size = float(np.linalg.norm(total))
            if size < _HEAVY * time_step:
                continue
            chosen, direction = np.array([part]), -total / size
            resistance = self._blows.resistance(chosen, direction)
            withstood = resistance.momentum(CONTACT)
            if size * CONTACT / time_step <= withstood:
                continue
            touching = parts == part
            share = impulses[touching] * (withstood / size)
            self._forest.push(rows[touching], points[touching], share)
            self._blows.press_around(resistance.bonds, chosen, withstood * direction)
            self._blows.tear_out(chosen, np.zeros((1, 6)), Cause.IMPACT,
                                 size * CONTACT / time_step / max(withstood, 1e-9), time)
            torn = True
        return torn

    def press(self, parts: np.ndarray, impulses: np.ndarray, time_step: float) -> None:
        """Load bricks that hold with what presses on them; arguments as for `tear_out`."""
        chosen, total = _per_part(parts, impulses)
        heavy = np.linalg.norm(total, axis=1) > _HEAVY * time_step
        heavy &= self._blows.buildings.standing[chosen]
        if heavy.any():
            self._blows.press(chosen[heavy], -total[heavy], 1.0 / time_step)


def _per_part(parts: np.ndarray, impulses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum up impulses on each brick."""
    on_brick = parts >= 0
    chosen, place = np.unique(parts[on_brick], return_inverse=True)
    total = np.zeros((len(chosen), 3))
    np.add.at(total, place, impulses[on_brick])
    return chosen, total
