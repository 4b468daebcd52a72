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

"""Grove: the standing trees of a scene, what the wind does to them and where they break."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint, Law
from procphys_ros.compilation import kernel
from procphys_ros.physics.trees import Foresight, Forest
from procphys_ros.physics.wind import Wind
from procphys_ros.physics.world import World
from procphys_ros.simulation.observer import Observer
from procphys_ros.simulation.trees.touches import Touches


@dataclass(frozen=True)
class Breakage:
    """
    Branches that came off in one step.

    :ivar bond: broken bonds, (B,).
    :ivar position: of the broken joints, world [m], (B, 3).
    :ivar cause: `events.Cause`, (B,).
    :ivar load: load over strength, (B,).
    :ivar pieces: parts, poses and velocities of what came off, without what stays limp.
    """

    bond: np.ndarray
    position: np.ndarray
    cause: np.ndarray
    load: np.ndarray
    pieces: list[tuple[np.ndarray, np.ndarray, np.ndarray]]


class Grove:
    """
    Wraps the articulated forest in terms of the parts of a scene.

    :param blueprint: all parts of the scene; those on hinges belong to the grove.
    :param gravity: downward acceleration [m/s²].
    """

    def __init__(self, blueprint: Blueprint, gravity: float):
        self.forest = Forest(blueprint, (0.0, 0.0, -gravity))
        self.row_of_part = np.full(len(blueprint), -1, np.intp)
        self.row_of_part[self.forest.parts] = np.arange(len(self.forest))
        self._joint_arm = 0.5 * blueprint.visual_size[self.forest.parts, 2]
        hinge_row = np.cumsum(blueprint.bond_law == Law.HINGE) - 1
        hinges = blueprint.hinges
        self._capacity = np.column_stack([
            hinges.break_force, hinges.break_torque, hinges.strength])[
                hinge_row[self.forest.bonds]]
        self._wind = np.zeros((len(self.forest), 3))
        self._still = True
        self._span = _span(self.forest.parts)

    def __len__(self) -> int:
        return len(self.forest)

    @property
    def air(self) -> np.ndarray:
        """Velocity of the air at every row when `feel` last asked for it [m/s], (S, 3)."""
        return self._wind

    def reset(self) -> None:
        """Put all trees back to rest and whole."""
        self.forest.reset()

    def observe(self, observer: Observer) -> None:
        """Look from another place from now on; here all trees are simulated alike."""

    def movers(self) -> np.ndarray:
        """List the trees, places in the forest's plan, that may move in the step to come."""
        return np.arange(len(self.forest.plan.start) - 1)

    def heed(self, touches: Touches, world: World) -> None:
        """Take note of what touches trees in the step to come; here all of them move anyway."""

    def holds(self, part: int) -> bool:
        """Say whether a part still belongs to a tree that stands or falls, but is no debris."""
        row = self.row_of_part[part]
        return row >= 0 and bool(self.forest.active[row])

    def grow(self, count: int) -> None:
        """Make room for parts that have joined the scene behind all others, none of them trees."""
        late = np.full(max(count - len(self.row_of_part), 0), -1, np.intp)  # 0 after a reset
        self.row_of_part = np.concatenate([self.row_of_part, late])

    def feel(self, wind: Wind, time: float) -> None:
        """
        Ask for the air that acts in the next step.

        :param wind: blows at every segment.
        :param time: [s].
        """
        self._still = not wind.enabled
        if not self._still:
            wind.velocity(self.forest.poses[:, :3], time, out=self._wind)

    def foresee(self, rows: np.ndarray, points: np.ndarray, time_step: float) -> Foresight:
        """Look ahead in the air that was felt; see `Forest.foresee`."""
        return self.forest.foresee(rows, points, time_step, None if self._still else self._wind)

    def sway(self, time_step: float) -> None:
        """Advance all trees in the air that was felt, by one step [s]."""
        self.forest.step(time_step, None if self._still else self._wind)

    def snap(self, stays_limp: Callable[[int], bool]) -> Breakage | None:
        """
        Break what the last step overloaded, the worst joint of each root-to-tip path first.

        What lies above and below a broken joint is judged again in the next step, when the load
        that broke it is gone.

        :param stays_limp: says of the first row of what comes off whether it goes on in the
            forest as a tree of its own, with a free root.
        """
        rows, causes, loads, bonds = self.forest.overloaded()
        if not len(rows):
            return None
        over = loads / self._capacity[rows, causes]
        chosen: list[int] = []
        for i in np.argsort(-over, kind='stable'):
            if not any(self._share_path(rows[i], rows[j]) for j in chosen):
                chosen.append(int(i))
        position = np.array([self._joint(rows[i]) for i in chosen])
        pieces = []
        for i in chosen:
            if stays_limp(rows[i]):
                self.forest.release(rows[i])
                continue
            fallen, poses, velocities = self.forest.detach(rows[i])
            pieces.append((self.forest.parts[fallen], poses, velocities))
        return Breakage(bonds[chosen], position, causes[chosen], over[chosen], pieces)

    def carry(self, poses: np.ndarray, velocities: np.ndarray) -> None:
        """
        Write where the standing segments are.

        :param poses: of all parts, (N, 7), written in place.
        :param velocities: of all parts, (N, 6), written in place.
        """
        active = self.forest.active
        parts = self.forest.parts
        if active.all():
            poses[self._span] = self.forest.poses
            velocities[self._span] = self.forest.velocities
        else:
            _scatter(parts, active, self.forest.poses, poses)
            _scatter(parts, active, self.forest.velocities, velocities)

    def _share_path(self, row: int, other: int) -> bool:
        ends = self.forest.ends
        return row <= other < ends[row] or other <= row < ends[other]

    def _joint(self, row: int) -> np.ndarray:
        x, y, z, w = self.forest.poses[row, 3:]
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        return self.forest.poses[row, :3] - self._joint_arm[row] * axis


@kernel
def _scatter(parts, active, rows, out):
    """Write the active rows to where their parts are."""
    for i in range(len(parts)):
        if active[i]:
            out[parts[i]] = rows[i]


def _span(parts: np.ndarray) -> slice | np.ndarray:
    """Give parts that follow each other as a slice, which copies several times faster."""
    if len(parts) and np.array_equal(parts, np.arange(parts[0], parts[0] + len(parts))):
        return slice(int(parts[0]), int(parts[0]) + len(parts))
    return parts
