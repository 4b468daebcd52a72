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
from procphys_ros.simulation.events import Cause
from procphys_ros.simulation.standing.blows import Blows, CONTACT
from procphys_ros.simulation.standing.standing_loads import StandingLoads

_HEAVY = 200.0    # [N] on one brick; lighter pushes, such as of twigs in the wind, load no wall
_SMOOTHING = 0.1  # [s] over which pushes count as a steady load, as for debris
_CHANGE = 0.25    # of the largest load: smaller changes are not worth new stresses
_LEAST = 1.0      # [N] below which a push is forgotten
_LAYER = 'branches'


class Leaning:
    """
    Hands the impulses of branches on bricks to the walls.

    What a branch presses with over some time is a load that lasts as long as it does; what goes
    far beyond that in one step is a blow.

    :param blows: on masonry.
    :param loads: on what stands.
    :param forest: all trees.
    """

    def __init__(self, blows: Blows, loads: StandingLoads, forest: Forest):
        self._blows = blows
        self._loads = loads
        self._forest = forest
        self._parts, self._mean = np.zeros(0, np.intp), np.zeros((0, 3))
        self._given: dict[int, np.ndarray] = {}

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
        """
        Load bricks that hold with what presses on them; arguments as for `tear_out`.

        Call it in every step, also when nothing touches.
        """
        chosen, total = _per_part(parts, impulses)
        if not len(chosen) and not len(self._parts):
            return
        before = len(self._parts)
        both, place = np.unique(np.concatenate([self._parts, chosen]), return_inverse=True)
        mean, now = np.zeros((2, len(both), 3))
        mean[place[:before]] = self._mean
        now[place[before:]] = -total / time_step
        beyond = now - mean
        size = np.linalg.norm(beyond, axis=1)
        struck = ((size > np.maximum(_HEAVY, np.linalg.norm(mean, axis=1)))
                  & now.any(axis=1) & self._blows.buildings.standing[both])
        if struck.any():
            self._blows.press(both[struck], beyond[struck] * time_step, 1.0 / time_step)
        mean -= np.expm1(-time_step / _SMOOTHING) * beyond
        felt = np.linalg.norm(mean, axis=1) > _LEAST
        self._parts, self._mean = both[felt], mean[felt]
        self._renew()

    def _renew(self) -> None:
        """Put the lasting loads on the walls, if they have changed."""
        standing = self._blows.buildings.standing[self._parts]
        heavy = standing & (np.linalg.norm(self._mean, axis=1) > _HEAVY)
        now = dict(zip(self._parts[heavy].tolist(), self._mean[heavy]))
        none = np.zeros(3)
        change = max((np.linalg.norm(now.get(part, none) - self._given.get(part, none))
                      for part in now.keys() | self._given.keys()), default=0.0)
        largest = max((np.linalg.norm(force) for force in now.values()), default=0.0)
        if change > max(_CHANGE * largest, 0.5 * _HEAVY):
            self._given = now
            wrenches = np.zeros((len(now), 6))
            wrenches[:, :3] = self._mean[heavy]
            self._loads.put(_LAYER, self._parts[heavy], wrenches)


def _per_part(parts: np.ndarray, impulses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum up impulses on each brick."""
    on_brick = parts >= 0
    chosen, place = np.unique(parts[on_brick], return_inverse=True)
    total = np.zeros((len(chosen), 3))
    np.add.at(total, place, impulses[on_brick])
    return chosen, total
