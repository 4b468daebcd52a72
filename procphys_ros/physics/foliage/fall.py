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

"""Fall: flight of detached leaves in the wind, tumbling until they land."""

import math

import numpy as np

from procphys_ros.blueprint.skeleton import LEAF_AREAL_DENSITY
from procphys_ros.compilation import kernel
from procphys_ros.compilation import threads as pool
from procphys_ros.elementary import atan2, cos, exp, sin, standard_normal
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.air import AIR_DENSITY, PLATE_DRAG
from procphys_ros.physics.skyline import keep_out, OPEN, Skyline

DRAG = 0.5 * AIR_DENSITY * PLATE_DRAG / LEAF_AREAL_DENSITY  # [1/m] deceleration over speed²
_SPREAD = 0.12  # of the logarithm of the drag: some fall edge-on for longer than others
_TUMBLING = 0.8  # tip speed over air speed (autorotating plates, Smith 1971)
_REACH = 200.0  # [m] from its tree, beyond which a leaf lands at once
_LYING = 0.01  # [m] height of a leaf's axis when it lies on the ground


class FallingLeaves:
    """
    Detached leaves in the air and on the ground; each leaf of the scene falls at most once.

    :param gravity: downward acceleration [m/s²].
    :param seed: of tumbling.

    :ivar leaf: row of each in the leaves of the scene, in the order of falling, (K,).
    :ivar poses: petioles, world, (K, 7).
    :ivar velocities: [m/s], world, (K, 3).
    :ivar flying: True until they land, (K,) bool.
    """

    _rng: np.random.Generator

    def __init__(self, gravity: float, seed: int):
        self._gravity = gravity
        self._seed = seed
        self.clear()

    def clear(self) -> None:
        """Remove all leaves."""
        self._rng = np.random.default_rng(self._seed)
        self.leaf = np.zeros(0, np.intp)
        self.poses = np.zeros((0, 7))
        self.velocities = np.zeros((0, 3))
        self.flying = np.zeros(0, bool)
        self._drag = np.zeros(0)
        self._start = np.zeros((0, 2))
        self._spin = np.zeros((0, 3))

    def __len__(self) -> int:
        return len(self.leaf)

    def let_go(self, leaf: np.ndarray, poses: np.ndarray, velocities: np.ndarray,
               size: np.ndarray) -> None:
        """
        Add detached leaves.

        :param leaf: their rows, (K,).
        :param poses: petioles, world, (K, 7).
        :param velocities: of their branches [m/s], world, (K, 3).
        :param size: lengths [m], (K,).
        """
        count = len(leaf)
        axis = standard_normal(self._rng, (count, 3))
        axis /= norm(axis, axis=1, keepdims=True)
        drag = DRAG * exp(_SPREAD * standard_normal(self._rng, count))
        self.leaf = np.concatenate([self.leaf, leaf])
        self.poses = np.concatenate([self.poses, poses])
        self.velocities = np.concatenate([self.velocities, velocities])
        self.flying = np.concatenate([self.flying, np.ones(count, bool)])
        self._drag = np.concatenate([self._drag, drag])
        self._start = np.concatenate([self._start, poses[:, :2]])
        # Rotation in radians per metre of motion through the air.
        self._spin = np.concatenate(
            [self._spin, _TUMBLING * axis / (0.5 * np.maximum(size, 1e-3))[:, None]])

    def step(self, rows: np.ndarray, air: np.ndarray, time_step: float,
             skyline: Skyline = OPEN, threads: int = 1) -> None:
        """
        Advance the flying leaves.

        :param rows: leaves in the air, `flatnonzero(flying)`, (F,).
        :param air: velocity of the air at these [m/s], world, (F, 3).
        :param time_step: [s].
        :param skyline: of structures in their way.
        :param threads: number of threads; results do not depend on it, to the last bit.
        """
        ends = np.empty(len(rows), bool)

        def work(_: int, first: int, last: int) -> None:
            ends[first:last] = _fly(rows[first:last], air[first:last], time_step, self._gravity,
                                    skyline, self._drag, self._spin, self._start, self.poses,
                                    self.velocities)
        pool.run(work, pool.even_ranges(len(rows), threads))
        landed = rows[ends]
        if len(landed):
            self.flying[landed] = False
            self.velocities[landed] = 0.0
            self.poses[landed, 3:] = _laid_flat(self.poses[landed, 3:])

    def lift(self, skyline: Skyline) -> None:
        """Release landed leaves whose supporting structure is gone."""
        self.flying |= skyline.left_in_the_air(self.poses[:, :3])


def _laid_flat(attitude: np.ndarray) -> np.ndarray:
    """Return attitudes (K, 4) with the leaf's axis level at its previous heading."""
    axis = rotation.rotate(attitude, np.array([0.0, 0.0, 1.0]))
    yaw = atan2(axis[:, 1], axis[:, 0])
    level = np.array([0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)])  # z onto x
    turn = np.zeros((len(yaw), 4))
    turn[:, 2], turn[:, 3] = sin(0.5 * yaw), cos(0.5 * yaw)
    return rotation.multiply(turn, level)


@kernel(nogil=True)
def _fly(rows, air, dt, gravity, skyline, drag, spin, start, poses,
         velocities):
    """
    Advance leaves by quadratic drag, implicit with the slip of the last step: no overshoot.

    In still air the speed tends to √(gravity/drag) exactly, at any time step.

    :returns: whether each leaf has landed, or is too far away, (F,).
    """
    ends = np.zeros(len(rows), np.bool_)
    for k in range(len(rows)):
        i = rows[k]
        slip = math.sqrt((air[k, 0] - velocities[i, 0]) ** 2 + (air[k, 1] - velocities[i, 1]) ** 2
                         + (air[k, 2] - velocities[i, 2]) ** 2)
        hold = dt * drag[i] * slip
        for c in range(3):
            weight = -gravity * dt if c == 2 else 0.0
            velocities[i, c] = (velocities[i, c] + weight + hold * air[k, c]) / (1.0 + hold)
        x, y, floor = keep_out(skyline, poses[i], poses[i, 0] + dt * velocities[i, 0],
                               poses[i, 1] + dt * velocities[i, 1],
                               poses[i, 2] + dt * velocities[i, 2])
        if x == poses[i, 0] and y == poses[i, 1]:
            velocities[i, 0], velocities[i, 1] = 0.0, 0.0
        poses[i, 0], poses[i, 1] = x, y
        poses[i, 2] += dt * velocities[i, 2]
        half = 0.5 * slip * dt
        x, y, z = half * spin[i, 0], half * spin[i, 1], half * spin[i, 2]
        a, b, c, d = poses[i, 3], poses[i, 4], poses[i, 5], poses[i, 6]
        qx, qy = a + d * x + b * z - c * y, b + d * y + c * x - a * z
        qz = c + d * z + a * y - b * x
        qw = d - a * x - b * y - c * z
        scale = 1.0 / math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        poses[i, 3], poses[i, 4], poses[i, 5] = qx * scale, qy * scale, qz * scale
        poses[i, 6] = qw * scale
        far = (poses[i, 0] - start[i, 0]) ** 2 + (poses[i, 1] - start[i, 1]) ** 2 > _REACH ** 2
        if far or poses[i, 2] <= floor + _LYING:
            ends[k] = True
            poses[i, 2] = floor + _LYING
    return ends
