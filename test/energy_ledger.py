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

"""Energy ledger: how much kinetic energy the parts of each object can have at most."""

# Kinetic energy must not exceed the sum of these works, each of which is bounded from above by
# what a simulation shows to everybody (poses, velocities, air):
# * weight: m·g·(z₀ − z), exact, of each part from where it stood first; * preload: at rest every
# joint carries the weight above it. That moment τ goes on acting when the branch moves: |τ|·θ of
# the largest turn θ so far of the joint, likewise the force along a sprung joint times its largest
# stretch. Springs themselves start without energy, beside it; * wind: drag is c·|u − v₀|·(u − v)
# with v₀ before and v after a step, so it does most work where v = u / 2: ¼·c·(u + v₀)·u² per
# second, with the faster of the air at the beginning and the end of a step, and c = ½·ρ·C·A of
# bluff bodies; twice in a step in which something comes off a tree, for that has moved with the
# tree and moves on by itself; * impulses J on a part of mass m that moves at v: |J|·v + J²/2m, for
# no tree makes a part lighter; * ground: a tree that was drawn into it is pushed out when it comes
# off, at a speed by its depth, and lifted by it, as engines undo overlaps apart from velocities; *
# projectiles: ½·m·v² when they are launched, and m·g times the height that they should have lost
# in a step and have not: what the engine stops short of what it will hit goes on to fall faster; *
# masonry that breaks what it comes down on keeps its speed, and follows it a step later: m·g times
# the way down that it owes, v·dt at most, for that step alone.

import numpy as np

from procphys_ros.blueprint import GROUND, Law, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.air import AIR_DENSITY, CYLINDER_DRAG, LEAF_DRAG
from procphys_ros.simulation import Simulation

_BLUFF = 2.0  # [-] drag coefficient that no box exceeds
_PUSH_OUT = 0.5  # [m/s] at most at which contacts push trees out of the ground ...
_RECOVERY = 12.0  # [1/s] ... by its depth


class EnergyLedger:
    """
    Watches one simulation from its start; call `note` after every step.

    :param simulation: at rest, with objects in a row along x.
    :param borders: between the objects, ascending x [m], (K - 1,).
    """

    def __init__(self, simulation: Simulation, borders: np.ndarray):
        self._simulation = simulation
        self._borders = borders
        self._gravity = simulation.scene.settings.gravity
        self._start = np.empty((0, 3))
        self._owner = np.empty(0, np.intp)
        self._known = len(simulation.blueprint)
        self._fallen = self._speed = self._owed = self._level = np.empty(0)
        self._given = np.zeros(len(borders) + 1)
        self._height: dict[int, float] = {}  # of projectiles [m]
        self._grow()
        self._air = self._wind()
        self._joints()
        self._sunk = self._pushed_out()

    def launched(self, part: int, mass: float, speed: float) -> None:
        """Book a projectile [kg, m/s]."""
        self._grow()
        self._given[self._owner[part]] += 0.5 * mass * speed ** 2
        self._height[part] = float(self._simulation.poses[part, 2])

    def struck(self, part: int, impulse: float) -> None:
        """Book an impulse on a part [N·s]; call this before it acts."""
        speed = float(np.linalg.norm(self._simulation.velocities[part, :3]))
        mass = float(self._simulation.blueprint.mass[part])
        self._given[self._owner[part]] += impulse * speed + impulse ** 2 / (2.0 * mass)

    def note(self) -> None:
        """Book what wind, weight and preload did in the step that has just ended."""
        self._grow()
        simulation = self._simulation
        air, source = self._wind(), simulation.blueprint
        old = np.zeros(len(air))
        old[:len(self._air)] = self._air
        fastest = np.maximum(air, old)
        power = 0.25 * self._drag() * (fastest + self._speed) * fastest ** 2
        parts = simulation.events['part_b']
        came_off = np.unique(self._owner[parts[source.shape[parts] == Shape.CAPSULE]])
        work = self._sum(power * simulation.time_step)
        work[came_off] *= 2.0
        self._given += work
        self._air = air
        self._speed = np.linalg.norm(simulation.velocities[:, :3], axis=1)
        here = np.isfinite(simulation.poses[:, 2])  # what is gone stays fallen as far as it was
        due = np.maximum(-simulation.velocities[:, 2] * simulation.time_step, 0.0)
        late = np.clip(simulation.poses[:, 2] - self._level + due, 0.0, due)
        self._level = simulation.poses[:, 2].copy()
        self._owed = np.where(here & (source.shape != Shape.CAPSULE),
                              source.mass * self._gravity * late, 0.0)
        fall = self._start[:, 2] - simulation.poses[:, 2]
        self._fallen[here] = (source.mass * self._gravity * fall)[here]
        self._note_joints()
        self._given[came_off] += self._sunk[came_off]
        self._sunk[came_off] = 0.0
        for part, before in self._height.items():
            height = self._height[part] = float(simulation.poses[part, 2])
            due = before + float(simulation.velocities[part, 2]) * simulation.time_step
            self._given[self._owner[part]] += np.fmax(
                float(source.mass[part]) * self._gravity * (height - due), 0.0)

    def kinetic(self) -> np.ndarray:
        """Add up the kinetic energy of each object [J], (K,)."""
        simulation = self._simulation
        here = np.isfinite(simulation.poses[:, 0])
        poses, velocities = simulation.poses[here], simulation.velocities[here]
        spin = rotation.rotate(rotation.conjugate(poses[:, 3:]), velocities[:, 3:])
        energy = np.zeros(len(here))
        source = simulation.blueprint
        energy[here] = 0.5 * (source.mass[here] * (velocities[:, :3] ** 2).sum(axis=1)
                              + (source.inertia[here] * spin ** 2).sum(axis=1))
        return self._sum(energy)

    def bound(self) -> np.ndarray:
        """Return the largest possible kinetic energy of each object [J], (K,)."""
        return (self._given + self._sum(self._fallen + self._owed)
                + self._sum_joints(self._preload))

    def _sum_joints(self, values: np.ndarray) -> np.ndarray:
        return np.bincount(self._joint_owner, values, minlength=len(self._given))

    def _sum(self, values: np.ndarray) -> np.ndarray:
        return np.bincount(self._owner, values, minlength=len(self._given))

    def _grow(self) -> None:
        """Take up parts that have come into being."""
        poses = self._simulation.poses
        new = np.arange(len(self._owner), len(poses))
        place = np.where(np.isfinite(poses[new, :3]), poses[new, :3],
                         self._simulation.blueprint.poses[new, :3])
        self._start = np.concatenate([self._start, place])
        self._owner = np.concatenate([self._owner, np.searchsorted(self._borders, place[:, 0])])
        self._fallen, self._owed = (np.concatenate([each, np.zeros(len(new))])
                                    for each in (self._fallen, self._owed))
        self._level = np.concatenate([self._level, place[:, 2]])
        self._speed = np.concatenate([
            self._speed, np.linalg.norm(self._simulation.velocities[new, :3], axis=1)])

    def _wind(self) -> np.ndarray:
        """Return the speed of the air at all parts [m/s]."""
        simulation = self._simulation
        points = np.where(np.isfinite(simulation.poses[:, :3]), simulation.poses[:, :3], 0.0)
        return np.linalg.norm(simulation.wind.velocity(points, simulation.time), axis=1)

    def _drag(self) -> np.ndarray:
        """Return an upper bound of force over the square of the speed [N·s²/m²]."""
        source = self._simulation.blueprint
        x, y, z = source.visual_size.T
        wood = CYLINDER_DRAG * np.maximum(x, y) * z + LEAF_DRAG * source.leaf_area
        faces = _BLUFF * (x * y + y * z + z * x)
        return 0.5 * AIR_DENSITY * np.where(source.shape == Shape.CAPSULE, wood, faces)

    def _pushed_out(self) -> np.ndarray:
        """Compute the energy of trees that the ground pushes out [J], (K,)."""
        source = self._simulation.blueprint
        size = source.solid_size(np.arange(len(source)))
        radius, half = 0.5 * size[:, 0], 0.5 * np.maximum(size[:, 2] - size[:, 0], 0.0)
        up = rotation.rotate(source.poses[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]
        depth = radius + half * np.abs(up) - source.poses[:, 2]
        depth[source.shape != Shape.CAPSULE] = 0.0
        deepest = np.zeros(len(self._given))
        np.maximum.at(deepest, self._owner, depth)
        speed = np.minimum(_RECOVERY * deepest, _PUSH_OUT)
        return self._sum(source.mass) * (0.5 * speed ** 2 + self._gravity * deepest)

    def _joints(self) -> None:
        """Work out what every joint of a tree carries at rest."""
        source = self._simulation.blueprint
        hinge = source.bond_law == Law.HINGE
        self._parent, self._child = source.bonds[hinge].T
        self._frame = source.bond_frame[hinge]
        self._joint_owner = self._owner[self._child]
        mass, moment = source.mass.copy(), source.mass[:, None] * source.poses[:, :3]
        for parent, child in zip(self._parent[::-1], self._child[::-1]):
            if parent != GROUND:  # parents stand before their children
                mass[parent] += mass[child]
                moment[parent] += moment[child]
        above = mass[self._child]
        arm = moment[self._child] - above[:, None] * self._frame[:, :3]
        self._moment = self._gravity * np.linalg.norm(arm[:, :2], axis=1)
        self._weight = self._gravity * above
        self._preload = np.zeros(len(above))
        self._anchors = [rotation.relative(pose, self._frame) for pose in (
            source.poses[np.maximum(self._parent, 0)], source.poses[self._child])]

    def _note_joints(self) -> None:
        """Keep the largest work that preloads can have done."""
        poses = self._simulation.poses
        first = rotation.compose(poses[np.maximum(self._parent, 0)], self._anchors[0])
        first[self._parent == GROUND] = self._frame[self._parent == GROUND]
        second = rotation.compose(poses[self._child], self._anchors[1])
        cosine = np.abs((first[:, 3:] * second[:, 3:]).sum(axis=1))
        turn = 2.0 * np.arccos(np.minimum(cosine, 1.0))
        stretch = np.linalg.norm(first[:, :3] - second[:, :3], axis=1)
        self._preload = np.fmax(self._preload, self._moment * turn + self._weight * stretch)
