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


"""Boughs: what breaks off trees, the large pieces flexible while they fall."""

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.masonry import FreeBodies
from procphys_ros.simulation.debris import Debris
from procphys_ros.simulation.events import EventLog
from procphys_ros.simulation.trees.grove import Grove

SMALLEST = 8     # segments; smaller pieces bend too little to be seen
_MOST = 16       # at a time; each costs about as much as a standing tree while it touches nothing,
#                  and up to a millisecond per step while it lies on many contacts
_SLOW = 0.25     # [m/s] no segment faster
_CALM = 0.5      # [s] so long, before a bough counts as lying
_LOW = 0.3       # [m] height of the lowest segment of a bough that has come down
_DOWN = 1.0      # [s] so long, before what has come down becomes rigid: it has hit and sprung back
_LONGEST = 8.0   # [s] from coming off, after which a bough becomes rigid anyway


class Boughs:
    """
    Lets overloaded branches come off, and decides how long they go on as trees with free roots.

    Boughs that are small, lie still, or came down a while ago become rigid fragments, which freeze
    and thaw as all debris does. Both changes keep poses, momentum and angular momentum.

    :param blueprint: all parts and bonds of the scene.
    :param grove: its trees.
    :param free: bonds of what flies about.
    :param log: where broken bonds are recorded.
    """

    def __init__(self, blueprint: Blueprint, grove: Grove, free: FreeBodies, log: EventLog):
        self._blueprint = blueprint
        self._grove = grove
        self._forest = grove.forest
        self._free = free
        self._log = log
        self.begin()

    def begin(self) -> None:
        """Start anew with whole trees."""
        self._age: dict[int, float] = {}
        self._quiet: dict[int, float] = {}
        self._down: dict[int, float] = {}

    def shed(self, debris: Debris, time: float, time_step: float) -> None:
        """
        Break what the last step of the trees overloaded, and hand over what is to be rigid.

        :param debris: takes the parts.
        :param time: [s].
        :param time_step: [s].
        """
        self.stiffen(debris, time_step)
        broken = self._grove.snap(self.stays_limp)
        if broken is None:
            return
        self._log.record(time, broken.position, broken.bond, self._blueprint.bonds[broken.bond],
                         broken.cause, broken.load)
        self._free.graph.cut(broken.bond)
        for parts, poses, velocities in broken.pieces:
            debris.gather(parts, poses, velocities)

    def stays_limp(self, row: int) -> bool:
        """
        Say whether a piece that is about to come off goes on as a flexible tree.

        :param row: its first row in the forest.
        """
        return (len(self._forest.free_roots) < _MOST
                and len(self._forest.subtree(row)) >= SMALLEST)

    def stiffen(self, debris: Debris, time_step: float) -> None:
        """
        Hand over to the debris what need not be flexible any more.

        :param debris: takes the parts.
        :param time_step: since the last call [s].
        """
        forest = self._forest
        roots = forest.free_roots.tolist()
        if not roots and not self._age:
            return
        self._age = {r: self._age.get(r, 0.0) + time_step for r in roots}
        self._quiet = {r: self._quiet.get(r, 0.0) + time_step if self._lies(r) else 0.0
                       for r in roots}
        self._down = {r: self._down.get(r, 0.0) + (time_step if self._is_low(r) else 0.0)
                      for r in roots}
        for root in roots:
            if (len(forest.subtree(root)) < SMALLEST or self._age[root] > _LONGEST - 1e-9
                    or self._quiet[root] > _CALM - 1e-9 or self._down[root] > _DOWN - 1e-9):
                rows, poses, velocities = forest.detach(root)
                debris.gather(forest.parts[rows], poses, velocities)

    def _lies(self, root: int) -> bool:
        rows = self._forest.subtree(root)
        return bool((np.abs(self._forest.velocities[rows, :3]).max(axis=1) < _SLOW).all())

    def _is_low(self, root: int) -> bool:
        return bool(self._forest.poses[self._forest.subtree(root), 2].min() < _LOW)
