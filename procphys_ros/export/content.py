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

"""Content: what a scene holds at one moment, as every exporter reads it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from procphys_ros.appearance.paving import Paving
from procphys_ros.blueprint import Blueprint, GROUND, Law
from procphys_ros.geometry import rotation
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.scene import Scene, SceneObject
from procphys_ros.simulation import mechanisms, Simulation

Report = Callable[[float, float], None]  # amount done and total amount


@dataclass(frozen=True)
class Content:
    """
    Parts and bonds of a scene at one moment.

    :ivar blueprint: all parts and bonds; its poses are those at rest.
    :ivar objects: owners of the parts, in part order.
    :ivar poses: present centres of mass and attitudes, world [m], (N, 7).
    :ivar petioles: present poses of all leaves, world [m], (L, 7).
    :ivar broken: bonds that have broken, (M,) bool.
    :ivar gravity: downward acceleration [m/s²].
    :ivar time: simulated time since the start at rest [s].
    :ivar terrain: the surface of the ground.
    :ivar paving: of the ground.
    :ivar torn: joints of mechanisms that have broken, (T,) indices.
    """

    blueprint: Blueprint
    objects: Sequence[SceneObject]
    poses: np.ndarray
    petioles: np.ndarray
    broken: np.ndarray
    gravity: float
    time: float = 0.0
    terrain: Terrain = FLAT
    paving: Sequence[Paving] = ()
    torn: Sequence[int] = ()

    @classmethod
    def at_rest(cls, scene: Scene) -> 'Content':
        """Read a scene as authored."""
        blueprint = scene.blueprint
        leaves = blueprint.leaves
        return cls(blueprint, scene.objects, blueprint.poses,
                   rotation.compose(blueprint.poses[leaves.part], leaves.pose),
                   np.zeros(len(blueprint.bonds), bool), scene.settings.gravity,
                   terrain=scene.settings.terrain, paving=scene.paving)

    @classmethod
    def of(cls, simulation: Simulation) -> 'Content':
        """Read a simulation in its present state."""
        broken = np.zeros(len(simulation.blueprint.bonds), bool)
        broken[simulation.log.bonds] = True
        return cls(simulation.blueprint, list(simulation.objects), simulation.poses.copy(),
                   simulation.leaf_poses(), broken, simulation.scene.settings.gravity,
                   simulation.time, simulation.scene.settings.terrain,
                   simulation.scene.paving,
                   mechanisms.torn(simulation.model, simulation.state).tolist())

    @classmethod
    def at(cls, scene: Scene, time: float, report: Report) -> 'Content':
        """
        Simulate a scene from rest and read it.

        :param time: [s]; 0 = at rest.
        :param report: called after each step with the simulated and the total time [s].
        """
        if time == 0.0:
            return cls.at_rest(scene)
        simulation = Simulation(scene)
        for _ in range(max(1, round(time / simulation.time_step))):
            simulation.step()
            report(simulation.time, time)
        content = cls.of(simulation)
        simulation.close()
        return content

    @cached_property
    def exists(self) -> np.ndarray:
        """Mark the parts that have not been crushed or split into others, (N,) bool."""
        return np.isfinite(self.poses).all(axis=1)

    @cached_property
    def balls(self) -> np.ndarray:
        """Mark launched balls, whose skin of ornaments is not written, (N,) bool."""
        return self.blueprint.balls

    @cached_property
    def holds(self) -> np.ndarray:
        """Mark the bonds that still hold existing parts, (M,) bool."""
        first, second = self.blueprint.bonds.T
        there = np.append(self.exists, True)  # the last entry is the ground
        return ~self.broken & there[first] & there[second]

    @cached_property
    def joints_hold(self) -> np.ndarray:
        """Mark the joints of mechanisms that hold existing parts, without ropes to trees, (J,)."""
        first, second = self.blueprint.joints.parts.T
        there, wood = np.append(self.exists, True), self.blueprint.bond_law == Law.HINGE
        out = there[first] & there[second] & ~np.isin(first, self.blueprint.bonds[wood, 1])
        out[np.asarray(self.torn, np.intp)] = False
        return out

    @cached_property
    def joint_names(self) -> list[str]:
        """Names of all joints of mechanisms, `<object>/<joint>`."""
        joints = self.blueprint.joints
        return [f'{self.objects[self.owner[part]].name}/{self.blueprint.joint_names[name]}'
                for part, name in zip(joints.parts[:, 1].tolist(), joints.name.tolist())]

    @cached_property
    def part_names(self) -> list[str]:
        """Names of all parts inside their objects, `<kind>_<index>`."""
        kinds, kind = self.blueprint.kinds, self.blueprint.kind
        return [f'{kinds[kind[o.first + i]]}_{i}' for o in self.objects for i in range(o.count)]

    @property
    def textures(self) -> tuple[str, ...]:
        """Names for the texture columns of the blueprint; there is at least one."""
        return self.blueprint.textures or ('plain',)

    @cached_property
    def owner(self) -> np.ndarray:
        """Index of each part's object in `objects`, (N,) int."""
        return np.repeat(np.arange(len(self.objects)), [o.count for o in self.objects])

    @cached_property
    def full_names(self) -> list[str]:
        """Names of all parts, `<object>/<kind>_<index>`."""
        return [f'{self.objects[o].name}/{name}'
                for o, name in zip(self.owner, self.part_names)]

    @cached_property
    def bond_seats(self) -> np.ndarray:
        """
        Frames of all bonds in the frames of their two parts, or of the world, [m], (2, M, 7).

        Both frames of an unbroken bond coincide in the world.
        """
        blueprint = self.blueprint
        first, second = blueprint.bonds.T
        carried = rotation.relative(blueprint.poses[second], blueprint.bond_frame)
        world = rotation.compose(self.poses[second], carried)
        other = np.where(first[:, None] == GROUND, world,
                         rotation.relative(self.poses[first], world))
        return np.stack([other, carried])
