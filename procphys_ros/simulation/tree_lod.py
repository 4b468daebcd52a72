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

"""Level of detail of trees: which are stepped now, and how far, given who looks from where."""

import math

import numpy as np

from procphys_ros.elementary import atan, cos, sin, tan
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm, product
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.state import TraversalPlan
from procphys_ros.physics.wind import Wind
from procphys_ros.scene.culling import CullingSettings

_STRAIGHT = 0.5 * math.pi  # [rad] widest half angle that planes can bound
REST_ENERGY = 5e-7  # [J/kg] of a tree that counts as quiet: 1 mm/s of its whole mass
REST_TIME = 2.0     # [s] of quiet before rest, half a period of the slowest trees
BREEZE = 0.2        # [m/s] wind that moves a tree less than this counts as still
LINGER = 0.5        # [s] that trees outside the view are still stepped: its edge must not flicker
ROUSED = 10.0       # [s] that an unseen tree is simulated after a hit, at most
_SWAY = 1.15        # margin for sway in the bounding spheres of trees
_EDGES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0],
                   [0.0, -1.0, 0.0]])  # of a sphere, where the wind at a sleeping tree is sampled


class Observer:
    """
    A camera that looks along the x axis of its pose, z up (REP 103).

    :param settings: view angle and range.
    :param position: [m], (3,), world.
    :param orientation: unit quaternion xyzw, (4,), world.
    """

    def __init__(self, settings: CullingSettings, position: np.ndarray, orientation: np.ndarray):
        self.position = position
        self._reach = settings.distance
        self._normals = np.zeros((0, 3))
        if settings.frustum:
            inward = _planes(settings)
            self._normals = rotation.rotate(np.tile(orientation, (len(inward), 1)), inward)

    def distance(self, centres: np.ndarray) -> np.ndarray:
        """Return the distances of points from the camera [m], (K,)."""
        return norm(centres - self.position, axis=1)

    def sees(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """
        Return which spheres reach into the view, according to its planes and its range.

        A sphere near an edge of the view may count as seen though it just misses it, never the
        other way round.

        :param centres: [m], (K, 3), world.
        :param radii: [m], (K,).
        :returns: (K,) bool.
        """
        away = centres - self.position
        seen = np.ones(len(centres), bool)
        for normal in self._normals:
            seen &= product(away, normal) >= -radii
        if self._reach > 0.0:
            seen &= np.einsum('ki,ki->k', away, away) <= np.square(self._reach + radii)
        return seen


def _planes(settings: CullingSettings) -> np.ndarray:
    """Return inward normals of the planes through the eye: sides, top, bottom, behind, (5, 3)."""
    half = 0.5 * settings.field_of_view
    up = min(half + settings.widening, _STRAIGHT)
    side = min(atan(settings.aspect * tan(half)) + settings.widening, _STRAIGHT)
    return np.array([[sin(side), cos(side), 0.0], [sin(side), -cos(side), 0.0],
                     [sin(up), 0.0, cos(up)], [sin(up), 0.0, -cos(up)],
                     [1.0, 0.0, 0.0]])


class LodScheduler:
    """
    Schedule the steps of every tree.

    Columns follow the trees of the forest's plan; they are kept when trees break.

    :param settings: schemes in use.
    :param forest: the trees at rest.

    :ivar now: number of the next step.
    :ivar due: number of each tree's next step, (T,) int.
    :ivar steps: number of time steps in its last step, (T,) int.
    :ivar asleep: whether it rests in still air, (T,) bool.
    :ivar held: whether it is not stepped, asleep or unseen, (T,) bool.
    :ivar roused: remaining time of its simulation while unseen [s], (T,).
    :ivar since: time since it came back into the view [s], (T,); infinite = it never left.
    """

    _settings: CullingSettings
    _plan: TraversalPlan | None

    _START = {'due': 0, 'steps': 1, 'asleep': False, 'held': False, 'roused': 0.0,
              'since': np.inf, 'unseen': 0.0, 'quiet': 0.0}

    due: np.ndarray
    steps: np.ndarray
    asleep: np.ndarray
    held: np.ndarray
    roused: np.ndarray
    since: np.ndarray
    unseen: np.ndarray
    quiet: np.ndarray

    def __init__(self, settings: CullingSettings, forest: Forest):
        self._settings = settings
        self._plan = None
        self.now = 0
        self._roots = np.zeros(0, np.int64)
        for name, value in self._START.items():
            setattr(self, name, np.full(0, value))
        self.update_trees(forest)

    def update_trees(self, forest: Forest) -> None:
        """Update the list of trees, after branches have come off."""
        plan = forest.plan
        if plan is self._plan:
            return
        roots = plan.row[plan.start[:-1]]
        old = np.searchsorted(self._roots, roots)
        old[old == len(self._roots)] = 0
        known = self._roots[old] == roots if len(self._roots) else np.zeros(len(roots), bool)
        for name, value in self._START.items():
            column = np.full(len(roots), value)
            column[known] = getattr(self, name)[old[known]]
            setattr(self, name, column)
        self.due[~known] = self.now
        self._plan, self._roots = plan, roots
        self._free = forest.is_free(roots)
        self.enclose(forest)

    def renumber(self, rows: np.ndarray) -> None:
        """Follow trees whose segments have new rows, (S,)."""
        order = np.argsort(rows[self._roots], kind='stable')
        self._roots, self._plan = rows[self._roots][order], None
        for name in self._START:
            setattr(self, name, getattr(self, name)[order])

    def of_rows(self, forest: Forest, rows: np.ndarray) -> np.ndarray:
        """Return the trees that rows belong to, without inactive rows."""
        rows = rows[forest.active[rows]]
        return np.unique(np.searchsorted(self._roots, forest.roots(rows)))

    def stand_still(self, forest: Forest, rows: np.ndarray) -> np.ndarray:
        """Return whether the trees of active rows are not stepped at present, (K,) bool."""
        return self.held[np.searchsorted(self._roots, forest.roots(rows))]

    def wake(self, trees: np.ndarray) -> None:
        """Simulate trees that were hit, seen or not, until they are quiet again."""
        self.roused[trees] = ROUSED
        self.asleep[trees] = False
        self.quiet[trees] = 0.0

    def choose(self, forest: Forest, observer: Observer | None, wind: Wind, time: float
               ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """
        Choose the trees to step, to stop and to start.

        :param forest: the trees.
        :param observer: point of view; None = all trees count as seen and near.
        :param wind: wakes sleeping trees.
        :param time: [s].
        :returns: trees to step, those of them that were stopped before without being asleep, and
            trees to stop.
        """
        self.wake(self.of_rows(forest, forest.take_disturbed()))
        slept = self.asleep.copy()
        self._wake_in_wind(wind, time)
        seen = self._free | self._seen(observer)
        self.unseen[seen] = 0.0
        moves = (seen | (self.unseen < LINGER) | (self.roused > 0.0)) & ~self.asleep
        ready = self.due <= self.now
        stops = np.flatnonzero(ready & ~moves & ~self.held)
        back = np.flatnonzero(moves & self.held & ~(slept & (self.unseen < LINGER)))
        self.held[stops] = True
        self.held[moves] = False
        self.since[back] = 0.0
        self.due[stops], self.steps[stops] = self.now + 1, 1
        return np.flatnonzero(ready & moves), back, stops

    def stride(self, observer: Observer | None, trees: np.ndarray) -> np.ndarray:
        """
        Set the number of time steps per step of trees, staggered so that equal numbers are due.

        :param observer: point of view.
        :param trees: trees to step, (K,).
        :returns: (K,) int.
        """
        most, interval = self._settings.far_interval, np.ones(len(trees), np.int64)
        if observer is not None and most > 1:
            away = observer.distance(self._centre[trees]) - self._radius[trees]
            interval += (np.maximum(away, 0.0) // self._settings.far_distance).astype(np.int64)
            np.minimum(interval, most, out=interval)
            interval[(self.roused[trees] > 0.0) | self._free[trees]] = 1
        self.steps[trees] = interval - (self.now + trees) % interval
        self.due[trees] = self.now + self.steps[trees]
        return self.steps[trees]

    def elapse(self, forest: Forest, trees: np.ndarray, air: np.ndarray,
               time_step: float) -> None:
        """
        Advance the clocks by a step, and find the stepped trees that have come to rest.

        :param forest: the trees.
        :param trees: stepped ones.
        :param air: at every row, (S, 3) [m/s].
        :param time_step: [s].
        """
        self.now += 1
        self.unseen += time_step
        self.since += time_step
        self.roused = np.maximum(self.roused - time_step, 0.0)
        sleepy = self._settings.sleeping
        if not sleepy:
            trees = trees[self.roused[trees] > 0.0]
        if not len(trees):
            return
        calm = self._calm(forest, trees, air)
        judged = calm | (self.roused[trees] > 0.0)
        trees, calm = trees[judged], calm[judged]
        rests = forest.kinetic(trees) < REST_ENERGY
        self.quiet[trees] = np.where(rests, self.quiet[trees] + self.steps[trees] * time_step, 0.0)
        rests = self.quiet[trees] > REST_TIME - 1e-9
        self.roused[trees[rests]] = 0.0
        if sleepy:
            self.asleep[trees[rests & calm & ~self._free[trees]]] = True

    def shown_shares(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the trees whose shown poses change now, and their interpolation shares."""
        begun = self.due - self.steps
        trees = np.flatnonzero(self.due >= self.now)
        return trees, (self.now - begun[trees]) / self.steps[trees]

    def _seen(self, observer: Observer | None) -> np.ndarray:
        if observer is None:
            return np.ones(len(self._roots), bool)
        return observer.sees(self._centre, self._radius)

    def _wake_in_wind(self, wind: Wind, time: float) -> None:
        """Wake the sleeping trees with wind at their tops or edges."""
        trees = np.flatnonzero(self.asleep)
        if not len(trees) or not wind.moves:
            return
        points = self._centre[trees, None] + self._radius[trees, None, None] * _EDGES
        air = wind.velocity(points.reshape(-1, 3), time)
        felt = (air * air).sum(axis=1).reshape(len(trees), -1).max(axis=1) > BREEZE * BREEZE
        self.asleep[trees[felt]] = False
        self.quiet[trees[felt]] = 0.0

    def _calm(self, forest: Forest, trees: np.ndarray, air: np.ndarray) -> np.ndarray:
        rows, plan = forest.rows_of(trees), forest.plan
        square = np.einsum('ri,ri->r', air[rows], air[rows])
        count = plan.start[trees + 1] - plan.start[trees]
        first = np.cumsum(count) - count
        return np.maximum.reduceat(square, first) <= BREEZE * BREEZE

    def enclose(self, forest: Forest) -> None:
        """Compute the bounding sphere of each tree in its present pose."""
        plan, poses = forest.plan, forest.poses[forest.plan.row, :3]
        first = plan.start[:-1]
        if not len(first):
            self._centre, self._radius = np.zeros((0, 3)), np.zeros(0)
            return
        low, high = np.minimum.reduceat(poses, first), np.maximum.reduceat(poses, first)
        self._centre = 0.5 * (low + high)
        arm = poses - np.repeat(self._centre, np.diff(plan.start), axis=0)
        reach = np.sqrt(np.einsum('ri,ri->r', arm, arm)) + forest.half_lengths[plan.row]
        self._radius = _SWAY * np.maximum.reduceat(reach, first)
