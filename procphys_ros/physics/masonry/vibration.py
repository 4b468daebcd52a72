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


"""Buildings on shaken ground: their first modes, and which loads they have not borne yet."""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from procphys_ros.physics.gravity import GRAVITY
from procphys_ros.physics.ground_motion import transition
from procphys_ros.physics.masonry.graph import BondGraph
from procphys_ros.physics.masonry.solver import StressSolver

_DAMPING = 0.05  # ratio of buildings (EN 1998-1, 3.2.2.2)
_KEPT = 32       # loads kept of each building: the oldest one is judged anew if it returns
_MORE = 1.05     # times what was borne: smaller loads need no new stresses


class Modes(NamedTuple):
    """
    First mode of each building along world x and along y.

    :ivar building: of each part, a number from 0 on, -1 = none, (N,).
    :ivar angular: frequencies [rad/s], (B, 2).
    :ivar shape: displacement of the parts per displacement of an oscillator of that frequency on
        the same ground [-], (N, 2, 3): the shape of the mode by its participation factor.
    """

    building: np.ndarray
    angular: np.ndarray
    shape: np.ndarray

    def forces(self, demand: np.ndarray, mass: np.ndarray) -> np.ndarray:
        """
        Compute the static forces that bend parts as the shaken ground does.

        What the first modes leave of the mass moves with the ground (missing mass, e.g. Gupta
        1990, Response spectrum method, section 3.4).

        :param demand: see `ShakenBuildings.take_peaks`, (B, 5).
        :param mass: of the parts [kg], (N,).
        :returns: [N], (N, 3), world.
        """
        own = demand[self.building]
        felt = -own[:, 2:]
        for axis in range(2):
            felt += self.shape[:, axis] * own[:, axis, None]
        return mass[:, None] * felt


def first_modes(graph: BondGraph, building: np.ndarray, iterations: int) -> Modes:
    """
    Estimate the first modes of buildings by Rayleigh's quotient, from how they bend sideways.

    :param graph: intact bonds; it is changed.
    :param building: number of the connected building of each part, -1 = none, (N,).
    :param iterations: of the stress solver, at most.
    """
    count, parts = int(building.max(initial=-1)) + 1, np.flatnonzero(building >= 0)
    angular, shape = np.ones((count, 2)), np.zeros((graph.count, 2, 3))
    owner, mass = building[parts], graph.mass[parts]
    for axis in range(2):
        solver = StressSolver(graph, GRAVITY * np.eye(3)[axis])  # sideways; they bend linearly
        solver.iterate(iterations)
        bent = solver.displacement[parts, :3]
        along = np.bincount(owner, mass * bent[:, axis], count)
        square = np.bincount(owner, mass * np.square(bent).sum(axis=1), count)
        bends = along > 0.0  # not a slab that lies on the ground, say
        share = np.divide(along, square, out=np.zeros(count), where=bends)
        angular[bends, axis] = np.sqrt(GRAVITY * share[bends])
        shape[parts, axis] = share[owner, None] * bent
    return Modes(building, angular, shape)


@dataclass
class ShakenBuildings:
    """
    Response of buildings to a shaken ground.

    A structure that stands under two loads stands under all between them (lower bound theorem), so
    only loads beyond those that it has borne since its last crack are new.

    :ivar sway: displacement [m] and velocity [m/s] of the first modes along x and y relative to
        the ground, (B, 2, 2).
    :ivar borne: peaks that were judged since its last crack [m/s²], see `take_peaks`,
        (B, _KEPT, 5).
    :ivar next: row of it to be written next, (B,).
    :ivar peak: highest so far, beyond what was borne, 0 = none, (B, 5).
    :ivar failed: cracked and broken bonds, (B,).
    """

    sway: np.ndarray
    borne: np.ndarray
    next: np.ndarray
    peak: np.ndarray
    failed: np.ndarray

    @classmethod
    def none(cls) -> Self:
        """Return the response of no building."""
        return cls(np.zeros((0, 2, 2)), np.zeros((0, _KEPT, 5)), np.zeros(0, np.intp),
                   np.zeros((0, 5)), np.zeros(0, np.intp))

    def step(self, modes: Modes, before: np.ndarray, after: np.ndarray, dt: float) -> None:
        """
        Let buildings sway in a time step; those that are new do so from rest.

        :param before, after: accelerations of the ground at its start and end [m/s²], (3,).
        :param dt: [s].
        """
        more = len(modes.angular) - len(self.sway)
        if more:
            for name, column in vars(self).items():
                fresh = np.zeros((more, *column.shape[1:]), column.dtype)
                setattr(self, name, np.concatenate([column, fresh]))
        for axis in range(2):
            step, sway = transition(modes.angular[:, axis], _DAMPING, dt), self.sway[:, axis]
            self.sway[:, axis] = (step[:, :, 0] * sway[:, :1] + step[:, :, 1] * sway[:, 1:]
                                  + step[:, :, 2] * before[axis] + step[:, :, 3] * after[axis])

    def recall(self, building: np.ndarray, failed: np.ndarray) -> None:
        """
        Forget what buildings have borne whose bonds have failed since.

        :param building: of each bond, (M,).
        :param failed: whether it has cracked or is broken, (M,) bool.
        """
        now = np.bincount(building[failed], minlength=len(self.failed))
        self.borne[now != self.failed] = 0.0
        self.failed = now

    def take_peaks(self, modes: Modes, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the peaks that buildings have just passed, if these go beyond what they have borne.

        What decides the forces in a building are the accelerations of its oscillators in excess of
        the ground's, and the ground's.

        :param acceleration: of the ground [m/s²], (3,), world.
        :returns: buildings, (K,), and these accelerations of all [m/s²], (B, 5).
        """
        swings = np.square(modes.angular) * self.sway[:, :, 0] + acceleration[:2]
        now = np.column_stack([swings, np.tile(acceleration, (len(swings), 1))])
        square, highest = np.square(now).sum(axis=1), np.square(self.peak).sum(axis=1)
        fresh = square > _MORE * (self.borne * now[:, None]).sum(axis=2).max(axis=1)
        rises = fresh & (square >= highest)
        rows = np.flatnonzero(~rises & (highest > 0.0))
        passed = self.peak.copy()
        self.borne[rows, self.next[rows]] = passed[rows]
        self.next[rows] = (self.next[rows] + 1) % _KEPT
        self.peak[rows], self.peak[rises] = 0.0, now[rises]
        return rows, passed
