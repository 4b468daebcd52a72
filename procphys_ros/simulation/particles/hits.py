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

"""Hits: the energy that loose bodies spend when they meet the ground and each other."""

import numpy as np

from procphys_ros.physics.dust import lost_energy, motion_energy
from procphys_ros.physics.world import State, World

_HARD = 1.0  # [m/s] slower things make no dust when they touch; what rests shall not smoke
_FREE_LOSS = 0.02  # of the energy that a body may lose in a step without having hit anything
_LARGE = 0.5  # [m] radius of bodies whose places of contact are looked up, which takes long
_SPREAD = 0.3  # of a body's radius, around the place where it hit
_JUMP = 0.5  # [m] beyond twice its way that a body may be displaced in a step and be the same


class Hits:
    """
    Compares how bodies would move if nothing was in their way with how they do.

    :param gravity: downward acceleration [m/s²].
    """

    def __init__(self, gravity: float):
        self._gravity = gravity
        self.reset()

    def reset(self) -> None:
        """Forget what was watched."""
        self._alert = False

    def watch(self, world: World, time_step: float) -> bool:
        """
        Note how everything loose would move on freely.

        :param world: about to be stepped.
        :param time_step: [s].
        :returns: whether anything is fast enough to hit hard.
        """
        bodies = world.bodies
        self._ids = ids = world.awake
        self._poses, self._free = bodies.poses[ids], bodies.velocities[ids]  # copies
        self._free[:, 2] -= self._gravity * time_step
        self._fast = (self._free[:, :3] ** 2).sum(axis=1) > _HARD ** 2
        self._alert = bool(self._fast.any())
        if self._alert:
            self._mass, self._radius = bodies.mass[ids], bodies.radius[ids]
            self._energy = motion_energy(self._mass, bodies.inertia[ids], self._poses[:, 3:],
                                         self._free)
        return self._alert

    def spent(self, world: World, spared: np.ndarray,
              time_step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """
        Find where energy was spent since `watch`.

        What a body hands on to others, or to the pieces that it broke into, is not spent.

        :param world: after the step, and after everything that broke has come apart.
        :param spared: bodies that make no dust, (B,) bool.
        :param time_step: [s].
        :returns: places [m] (K, 3), how far around there [m] (K,) and energies [J] (K,).
        """
        if not self._alert:
            return _NOWHERE
        now, after = self._present(world, time_step)
        lost = self._energy - now
        hit = self._fast & (lost > _FREE_LOSS * self._energy) & ~spared[self._ids]
        if not hit.any():
            return _NOWHERE
        others = np.setdiff1d(world.awake, self._ids[self._same])
        bodies = world.bodies
        gained = float(np.sum(motion_energy(bodies.mass[others], bodies.inertia[others],
                                            bodies.poses[others, 3:],
                                            bodies.velocities[others])))
        energy = lost_energy(self._energy, now, gained)[hit]
        kick = (after - self._free)[hit, :3]  # away from what it hit
        kick /= np.maximum(np.linalg.norm(kick, axis=1, keepdims=True), 1e-9)
        radius = self._radius[hit]
        place = self._poses[hit, :3] - radius[:, None] * kick
        place[:, 2] = np.maximum(place[:, 2], 0.0)
        return _at_contacts(world, self._ids[hit], place, radius, energy)

    def _present(self, world: World, time_step: float) -> tuple[np.ndarray, np.ndarray]:
        """Give energies (W,) and velocities (W, 6) now; nothing for bodies that are no more."""
        bodies, ids = world.bodies, self._ids
        poses, after = bodies.poses[ids], bodies.velocities[ids]
        way = np.linalg.norm(self._free[:, :3], axis=1) * time_step
        shift = np.linalg.norm(poses[:, :3] - self._poses[:, :3], axis=1)
        state = bodies.state[ids]
        self._same = (((state == State.LOOSE) | (state == State.RESTING))
                      & (bodies.mass[ids] == self._mass) & (shift < 2.0 * way + _JUMP))
        lift = poses[:, 2] - self._poses[:, 2] - self._free[:, 2] * time_step
        energy = (motion_energy(self._mass, bodies.inertia[ids], poses[:, 3:], after)
                  + self._mass * self._gravity * lift)
        return np.where(self._same, energy, 0.0), np.where(self._same[:, None], after, 0.0)


def _at_contacts(world: World, ids: np.ndarray, place: np.ndarray, radius: np.ndarray,
                 energy: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share the energy of large bodies among the points where they were pushed."""
    spread = _SPREAD * radius
    if radius.max() <= _LARGE:
        return place, spread, energy
    contacts = world.contacts()
    row = np.full(len(world.bodies.state) + 1, -1)
    row[ids[radius > _LARGE]] = np.flatnonzero(radius > _LARGE)
    side = row[np.concatenate([contacts.body_a, contacts.body_b])]
    push = np.tile(np.linalg.norm(contacts.impulse, axis=1), 2)
    point = np.flatnonzero((side >= 0) & (push > 0.0))
    side, push = side[point], push[point]
    total = np.bincount(side, push, minlength=len(ids))
    left = total == 0.0
    return (np.concatenate([place[left], np.tile(contacts.point, (2, 1))[point]]),
            np.concatenate([spread[left], np.full(len(point), _SPREAD * _LARGE)]),
            np.concatenate([energy[left], energy[side] * push / total[side]]))


_NOWHERE = np.zeros((0, 3)), np.zeros(0), np.zeros(0)
