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
Client of a PyBullet world: each method sends one command to Bullet, or one per body.

Bodies go by the numbers that Bullet gives them.
"""

import ctypes
import weakref

import numpy as np

from procphys_ros.physics.world import bullet_commands as commands
from procphys_ros.physics.world.bullet_library import (
    addresses,
    CONTACT,
    ContactInformation,
    load_library,
    load_submit,
)

MOST_SHAPES = 16  # of a compound that is made without a file, MAX_COMPOUND_COLLISION_SHAPES
_SLEEPING, _INERTIA_FROM_FILE = 2048, 2  # URDF_ENABLE_SLEEPING, URDF_USE_INERTIA_FROM_FILE
_BASE = -1  # the only link of a rigid body

_ZERO, _ONES = np.zeros(3), np.ones(3)
_UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
_DOUBLE = 8  # [bytes]


class BulletClient:
    """
    A world of rigid bodies in maximal coordinates.

    :ivar close: frees the world; a second call does nothing.
    """

    def __init__(self) -> None:
        self._c = load_library()
        self._submit_freely = load_submit()
        self._world = self._c.b3ConnectPhysicsDirect()
        if not self._world:
            raise RuntimeError('Bullet gave no world')
        self._information = ContactInformation()
        self._read, self._set_poses, self._set_velocities, self._dynamics = (
            addresses(names) for names in (commands.READ, commands.SET_POSES,
                                           commands.SET_VELOCITIES, commands.DYNAMICS))
        self._visual = self._create_visual()
        self.close = weakref.finalize(self, self._c.b3DisconnectSharedMemory, self._world)

    def _submit(self, command: int) -> int:
        return self._c.b3SubmitClientCommandAndWaitStatus(self._world, command)

    def set_gravity(self, gravity: list[float]) -> None:
        """Set the acceleration of bodies that move [m/s²], (3,)."""
        command = self._c.b3InitPhysicsParamCommand(self._world)
        self._c.b3PhysicsParamSetGravity(command, *gravity)
        self._submit(command)

    def set_solver(self, iterations: int, erp: float, warm_start: float) -> None:
        """Set how contacts are solved, with penetrations corrected apart from velocities."""
        c, command = self._c, self._c.b3InitPhysicsParamCommand(self._world)
        c.b3PhysicsParamSetNumSolverIterations(command, iterations)
        c.b3PhysicsParamSetUseSplitImpulse(command, 1)
        c.b3PhysicsParamSetSplitImpulsePenetrationThreshold(command, 0.0)
        c.b3PhysicsParamSetEnableFileCaching(command, 0)
        c.b3PhysicsParamSetDefaultNonContactERP(command, erp)
        c.b3PhysicsParamSetDefaultContactERP(command, erp)
        c.b3PhysicsParameterSetDeterministicOverlappingPairs(command, 1)
        c.b3PhysicsParamSetWarmStartingFactor(command, warm_start)
        self._submit(command)

    def set_iterations(self, number: int) -> None:
        """Set the iterations of the contact solver."""
        command = self._c.b3InitPhysicsParamCommand(self._world)
        self._c.b3PhysicsParamSetNumSolverIterations(command, number)
        self._submit(command)

    def set_time_step(self, time_step: float) -> None:
        """Set the time that a step takes [s]."""
        command = self._c.b3InitPhysicsParamCommand(self._world)
        self._c.b3PhysicsParamSetTimeStep(command, time_step)
        self._submit(command)

    def step(self) -> None:
        """Advance time; other threads run meanwhile."""
        self._submit_freely(self._world, self._c.b3InitStepSimulationCommand(self._world))

    def _create_visual(self) -> int:
        """
        Make a tiny box that all bodies are drawn as.

        Without one Bullet triangulates every collision shape for a renderer that is never used,
        which costs 0.16 ms per capsule, 40 times the rest.
        """
        command = self._c.b3CreateVisualShapeCommandInit(self._world)
        half = np.full(3, 0.01)
        self._c.b3CreateVisualShapeAddBox(command, _address(half))
        return self._c.b3GetStatusVisualShapeUniqueId(self._submit(command))

    def create_box(self, half: np.ndarray) -> int:
        """Make a shape of half extents [m], (3,)."""
        command = self._c.b3CreateCollisionShapeCommandInit(self._world)
        self._c.b3CreateCollisionShapeAddBox(command, _address(half))
        return self._shape(command)

    def create_capsule(self, radius: float, length: float) -> int:
        """Make a capsule along z, or a sphere where its cylinder has no length [m]."""
        command = self._c.b3CreateCollisionShapeCommandInit(self._world)
        if length > 0.0:
            self._c.b3CreateCollisionShapeAddCapsule(command, radius, length)
        else:
            self._c.b3CreateCollisionShapeAddSphere(command, radius)
        return self._shape(command)

    def create_hull(self, points: np.ndarray) -> int:
        """Make the convex hull of points [m], (K, 3)."""
        command = self._c.b3CreateCollisionShapeCommandInit(self._world)
        self._c.b3CreateCollisionShapeAddConvexMesh(
            self._world, command, _address(_ONES), _address(points), len(points))
        return self._shape(command)

    def create_heights(self, heights: np.ndarray, edge: float) -> int:
        """
        Make a height field, about the middle of its grid and heights.

        :param heights: [m], (rows along y, columns along x).
        :param edge: between two of them [m].
        """
        rows, columns = heights.shape
        scale, values = np.array([edge, edge, 1.0]), np.ascontiguousarray(heights, np.single)
        command = self._c.b3CreateCollisionShapeCommandInit(self._world)
        self._c.b3CreateCollisionShapeAddHeightfield2(
            self._world, command, _address(scale), 1.0, _address(values), columns, rows, -1)
        return self._shape(command)

    def create_list(self, is_box: np.ndarray, sizes: np.ndarray, poses: np.ndarray,
                    shortest: float) -> int:
        """
        Make one shape of at most `MOST_SHAPES` boxes and capsules.

        :param is_box: or a capsule, (K,).
        :param sizes: [m], (K, 3).
        :param poses: (K, 7).
        :param shortest: cylinder of a capsule [m].
        """
        c, command = self._c, self._c.b3CreateCollisionShapeCommandInit(self._world)
        for box, size, half, pose in zip(is_box.tolist(), sizes, 0.5 * sizes, poses):
            if box:
                place = c.b3CreateCollisionShapeAddBox(command, _address(half))
            else:
                place = c.b3CreateCollisionShapeAddCapsule(
                    command, half[0], max(size[2] - size[0], shortest))
            at = _address(pose)
            c.b3CreateCollisionShapeSetChildTransform(command, place, at, at + 3 * _DOUBLE)
        return self._shape(command)

    def _shape(self, command: int) -> int:
        return self._c.b3GetStatusCollisionShapeUniqueId(self._submit(command))

    def create_bodies(self, mass: float, shape: int, positions: np.ndarray,
                      orientation: np.ndarray) -> int:
        """
        Make bodies that differ in their places only; give the number of the last.

        :param mass: of each [kg].
        :param positions: [m], (K, 3).
        :param orientation: quaternion, (4,).
        """
        c, command = self._c, self._c.b3CreateMultiBodyCommandInit(self._world)
        positions = np.ascontiguousarray(positions)
        first, number = _address(positions), len(positions)
        c.b3CreateMultiBodyBase(command, mass, shape, self._visual, first, _address(orientation),
                                _address(_ZERO), _address(_UPRIGHT))
        if number > 1:
            c.b3CreateMultiBodySetBatchPositions(self._world, command, first, number)
        c.b3CreateMultiBodyUseMaximalCoordinates(command)
        c.b3CreateMultiBodySetFlags(command, _SLEEPING)
        return c.b3GetStatusBodyIndex(self._submit(command))

    def load_urdf(self, path: str, pose: list[float]) -> int:
        """Create a body from a file, with the inertia given there, and give its number."""
        c, command = self._c, self._c.b3LoadUrdfCommandInit(self._world, path.encode())
        c.b3LoadUrdfCommandSetFlags(command, _SLEEPING | _INERTIA_FROM_FILE)
        c.b3LoadUrdfCommandSetStartPosition(command, *pose[:3])
        c.b3LoadUrdfCommandSetStartOrientation(command, *pose[3:])
        c.b3LoadUrdfCommandSetUseMultiBody(command, 0)
        return c.b3GetStatusBodyIndex(self._submit(command))

    def remove(self, bodies: list[int]) -> None:
        """Remove bodies."""
        for body in bodies:
            self._submit(self._c.b3InitRemoveBodyCommand(self._world, body))

    def set_up(self, bodies: np.ndarray, frees: np.ndarray, holds: np.ndarray,
               surfaces: np.ndarray, mass: np.ndarray, inertia: np.ndarray,
               filters: np.ndarray) -> None:
        """Give new bodies surfaces, masses and filters, see `bullet_commands.set_up`."""
        commands.set_up(self._dynamics, self._world, bodies, frees, holds, surfaces, mass,
                        inertia, filters)

    def thaw(self, bodies: np.ndarray, mass: np.ndarray, inertia: np.ndarray,
             filters: np.ndarray) -> None:
        """Make bodies move and never sleep: mass [kg], (K,), principal moments [kg·m²], (K, 3)."""
        commands.thaw(self._dynamics, self._world, bodies, mass, inertia, filters)

    def freeze(self, bodies: np.ndarray, filters: np.ndarray) -> None:
        """Make bodies immovable at no cost per step."""
        commands.freeze(self._dynamics, self._set_velocities, self._world, bodies, filters)

    def set_swept(self, body: int, radius: float) -> None:
        """Sweep a sphere along its steps [m]."""
        command = self._c.b3InitChangeDynamicsInfo(self._world)
        self._c.b3ChangeDynamicsInfoSetCcdSweptSphereRadius(command, body, _BASE, radius)
        self._submit(command)

    def set_pair(self, one: int, other: int, meet: bool) -> None:
        """Set for good whether two bodies collide, whatever their masks say."""
        command = self._c.b3CollisionFilterCommandInit(self._world)
        self._c.b3SetCollisionFilterPair(command, one, other, _BASE, _BASE, int(meet))
        self._submit(command)

    def set_poses(self, bodies: np.ndarray, poses: np.ndarray) -> None:
        """Set places [m] and quaternions, world, (K, 7)."""
        commands.set_poses(self._set_poses, self._world, bodies, np.ascontiguousarray(poses))

    def set_velocities(self, bodies: np.ndarray, velocities: np.ndarray) -> None:
        """Set linear [m/s] and angular velocities [rad/s], world axes, (K, 6)."""
        commands.set_velocities(self._set_velocities, self._world, bodies,
                                np.ascontiguousarray(velocities))

    def read(self, bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Read poses (K, 7) and velocities (K, 6), world axes."""
        poses, velocities = np.empty((len(bodies), 7)), np.empty((len(bodies), 6))
        commands.read(self._read, self._world, bodies, poses, velocities)
        return poses, velocities

    def contacts(self, body: int | None = None) -> np.ndarray:
        """Read the contact points of the last step, or those of a body, (C,) of `CONTACT`."""
        command = self._c.b3InitRequestContactPointInformation(self._world)
        if body is not None:
            self._c.b3SetContactFilterBodyA(command, body)
        return self._points(command)

    def _points(self, command: int) -> np.ndarray:
        """Copy the contact points that a command asks for."""
        self._submit(command)
        found = self._information
        self._c.b3GetContactPointInformation(self._world, ctypes.addressof(found))
        if not found.count:
            return np.empty(0, CONTACT)
        return np.frombuffer(ctypes.string_at(found.points, found.count * CONTACT.itemsize),
                             CONTACT)


def _address(array: np.ndarray) -> int:
    """Give where values lie, one after the other; whoever asks keeps the array until then."""
    if not array.flags.c_contiguous:
        raise ValueError('values must lie one after the other')
    return array.__array_interface__['data'][0]
