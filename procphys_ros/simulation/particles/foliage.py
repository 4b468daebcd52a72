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
Leaves of a scene: where they are, which of them the wind takes, and where those come down.

The mass of a leaf that falls stays with its branch: leaves are about 3 % of the mass of a tree
and 7 % of that of the segments which carry them, while their share of the drag is most of it.
"""

import numpy as np

from procphys_ros import rotation
from procphys_ros.blueprint import Blueprint
from procphys_ros.physics.foliage import (
    air_speeds,
    carried,
    FallingLeaves,
    Flutter,
    speed_of,
    strengths,
)
from procphys_ros.physics.skyline import OPEN
from procphys_ros.physics.wind import Wind
from procphys_ros.scene.particles import LeafSettings
from procphys_ros.simulation.standing.buildings import Buildings
from procphys_ros.simulation.standing.roofs import Roofs
from procphys_ros.simulation.trees.grove import Grove

_FLUTTER_SEED, _STRENGTH_SEED, _FALL_SEED = 101, 102, 103  # told apart by the scene's own seed

_TURNS = 4  # steps in which every flying leaf is told of the air anew; it moves a metre meanwhile,
#             far less than the eddies that carry it measure


class Foliage:
    """
    All leaves of a scene.

    Leaves are torn off standing trees only; those on a branch that came off fall with it.

    :param blueprint: all parts of the scene and their leaves.
    :param grove: the trees that stand.
    :param settings: what leaves do.
    :param gravity: downward acceleration [m/s²].
    :param buildings: what leaves come down on.
    :param seed: of all that differs from leaf to leaf.

    :ivar fallen: leaves that came off.
    :ivar critical_speed: air speed that tears each leaf off [m/s], (L,); inf = never.
    """

    def __init__(self, blueprint: Blueprint, grove: Grove, settings: LeafSettings, gravity: float,
                 buildings: Buildings, seed: int):
        self._leaves = blueprint.leaves
        self._grove = grove
        self._settings = settings
        self._roofs = Roofs(blueprint, buildings)
        self._seed = seed
        self._area = self._leaves.size ** 2  # as `Blueprint.leaf_area` has it
        self._leaf_area = blueprint.leaf_area
        self._carriers, self._carrier = np.unique(self._leaves.part, return_inverse=True)
        self._flutter: Flutter | None = None
        self.fallen = FallingLeaves(gravity, _seeded(seed, _FALL_SEED))
        self.critical_speed = self._draw_speeds()
        self._speed = np.zeros(len(grove))
        self._arrange()
        self.reset()

    def reset(self) -> None:
        """Put all leaves back on their petioles (the forest grows its own back)."""
        self.fallen.clear()
        self._roofs.reset()
        self._skyline = OPEN
        self.attached = np.ones(len(self._leaves), bool)
        self._left = self._leaf_area.copy()
        self._next = self._first.copy()
        self._weakest = self._queue_speed[self._next]
        self._felt = np.zeros((0, 3))
        self._turn = 0

    def blow(self, wind: Wind, poses: np.ndarray, velocities: np.ndarray, time: float,
             time_step: float) -> None:
        """
        Tear off what the air takes now, and let what has come off fly on.

        :param wind: the air; `Grove.sway` has already asked for it at the trees.
        :param poses: of all parts, (N, 7).
        :param velocities: of all parts, (N, 6).
        :param time: [s].
        :param time_step: [s].
        """
        if self._settings.shedding and wind.enabled and len(self._queue):
            self._tear_off(poses, velocities)
        if len(self.fallen):
            self._fly(wind, time, time_step)

    def poses(self, wind: Wind, poses: np.ndarray, velocities: np.ndarray,
              time: float) -> np.ndarray:
        """
        Give where every leaf is: on its branch and fluttering, in the air or on the ground.

        :param wind: the air.
        :param poses: of all parts, (N, 7).
        :param velocities: of all parts, (N, 6).
        :param time: [s].
        :returns: petiole poses, z along the leaf, world, (L, 7).
        """
        frames = poses[self._carriers]
        local = self._leaves.pose
        if self._settings.flutter and len(local):
            air = self._air_past(wind, frames, velocities, time)
            local = self._motion().poses(self._carrier, frames, air, time)
        out = carried(self._carrier, frames, local)
        out[self.fallen.leaf] = self.fallen.poses
        return out

    def _fly(self, wind: Wind, time: float, time_step: float) -> None:
        before, self._skyline = self._skyline, self._roofs.skyline()
        if self._skyline is not before:
            self.fallen.lift(self._skyline)
        flying = np.flatnonzero(self.fallen.flying)
        if len(flying):
            self._feel(wind, flying, time)
            self.fallen.step(flying, self._felt[flying], time_step, self._skyline)

    def _feel(self, wind: Wind, flying: np.ndarray, time: float) -> None:
        """Ask for the air at a share of the leaves, in turn, and at those that came off now."""
        fresh = len(self.fallen) - len(self._felt)
        if fresh:
            self._felt = np.concatenate([self._felt, np.full((fresh, 3), np.nan)])
        self._turn = (self._turn + 1) % _TURNS
        due = flying[(flying % _TURNS == self._turn) | np.isnan(self._felt[flying, 0])]
        self._felt[due] = wind.velocity(self.fallen.poses[due, :3], time)

    def _tear_off(self, poses: np.ndarray, velocities: np.ndarray) -> None:
        forest = self._grove.forest
        speed = self._speed
        air_speeds(self._grove.air, forest.velocities, forest.active, speed)
        torn = []
        rows = np.flatnonzero(speed > self._weakest)
        while len(rows):  # the weakest leaf of every row that loses any, then the next weakest
            torn.append(self._queue[self._next[rows]])
            self._next[rows] += 1
            self._weakest[rows] = self._queue_speed[self._next[rows]]
            rows = rows[speed[rows] > self._weakest[rows]]
        if torn:
            self._let_go(np.concatenate(torn), poses, velocities)

    def _let_go(self, leaf: np.ndarray, poses: np.ndarray, velocities: np.ndarray) -> None:
        part = self._leaves.part[leaf]
        self.attached[leaf] = False
        self.fallen.let_go(leaf, rotation.compose(poses[part], self._leaves.pose[leaf]),
                           velocities[part, :3], self._leaves.size[leaf])
        np.subtract.at(self._left, part, self._area[leaf])
        part = np.unique(part)
        share = np.clip(self._left[part] / self._leaf_area[part], 0.0, 1.0)
        self._grove.forest.keep_leaves(self._grove.row_of_part[part], share)

    def _air_past(self, wind: Wind, frames: np.ndarray, velocities: np.ndarray,
                  time: float) -> np.ndarray:
        """Give the air velocity relative to the parts that carry leaves, (C, 3)."""
        exists = np.isfinite(frames).all(axis=1)
        air = np.zeros((len(frames), 3))
        air[exists] = wind.velocity(frames[exists, :3], time)
        return air - velocities[self._carriers, :3]

    def _motion(self) -> Flutter:
        """Draw how each leaf flutters, the first time that somebody looks."""
        if self._flutter is None:
            self._flutter = Flutter(self._leaves, _seeded(self._seed, _FLUTTER_SEED))
        return self._flutter

    def _draw_speeds(self) -> np.ndarray:
        rng = np.random.default_rng(_seeded(self._seed, _STRENGTH_SEED))
        force = strengths(self._area, self._settings.shedding_speed, rng)
        return speed_of(force / np.maximum(self._area, 1e-12))

    def _arrange(self) -> None:
        """Line up the leaves of every row of the forest, the weakest first, an end behind."""
        row = self._grove.row_of_part[self._leaves.part]
        held = np.flatnonzero(row >= 0)
        queued = held[np.lexsort((self.critical_speed[held], row[held]))]
        count = np.bincount(row[held], minlength=len(self._grove))
        ends = np.cumsum(count + 1) - 1
        self._first = ends - count
        self._queue_speed = np.full(len(queued) + len(count), np.inf)
        self._queue = np.full(len(self._queue_speed), -1, np.intp)
        places = np.delete(np.arange(len(self._queue)), ends)
        self._queue_speed[places] = self.critical_speed[queued]
        self._queue[places] = queued


def _seeded(seed: int, purpose: int) -> int:
    return (purpose << 64) + seed
