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
The engine room: the one module that speaks to PyBullet.

Everything here is a thin, typed layer over one PyBullet client. Bodies are rigid bodies in maximal
coordinates (Bullet's `btRigidBody`): a hundred times cheaper than articulated ones and without
their limits on links.

A body gets a tiny box as its visual shape: without one PyBullet triangulates every collision shape
for a renderer that is never used, which costs 0.16 ms per capsule, 40 times the rest.
"""

from itertools import chain
from operator import itemgetter
import os
import tempfile
import weakref

import numpy as np

from procphys_ros.physics.world.quiet import without_greeting

with without_greeting('pybullet build time'):
    import pybullet

# Measured on piles of 500 bricks that fall 1.2 m: with these iterations and warm starts (and ERP
# 0.3) the worst second runs twice as fast as with PyBullet's ERP 0.08, warm starting 0.1 (and 10
# iterations), everything comes to rest within 5 s instead of a tenth creeping on.
# Overlaps are undone apart from the velocities ("split impulses"): what is squeezed is moved out,
# not thrown out. 12 s after its demolition some 80 pieces of a cottage move instead of some 280,
# and with ERP 0.5 none of four of them rests deeper than 1.4 cm in the ground (0.3: 3.8 cm).
ERP = 0.5  # share of a penetration that is undone per step
ITERATIONS = 15  # of the contact solver
WARM_START = 0.85  # share of the last step's contact impulses that the solver starts from
ROLLING_FRICTION = 0.005  # [m] of each body, lets the last rolling pieces of a pile come to rest
LINEAR_DAMPING = 0.05  # share of the speed lost per second
ANGULAR_DAMPING = 0.1  # share of the spin lost per second

_GROUND_HALF = 5000.0  # [m] half of the ground's sides
_GROUND_DEPTH = 50.0   # [m] half of its thickness

_SLEEPING = pybullet.URDF_ENABLE_SLEEPING  # without it even resting bodies cost every step
_SIZES = itemgetter(1, 2, 8, 9, 10, 12)  # of a contact: bodies, distance, forces along ...
_WAYS = itemgetter(6, 7, 11, 13)  # ... normal and two tangents; point, normal and tangents
_MEMORY_FOLDER = '/dev/shm'  # a folder in memory, where there is one


class Engine:
    """
    One independent PyBullet world; ids are those of PyBullet, unique inside this world.

    :param gravity: acceleration of free bodies [m/s²], (3,).
    """

    def __init__(self, gravity: np.ndarray):
        self._client = pybullet.connect(pybullet.DIRECT)
        if self._client < 0:
            raise RuntimeError('PyBullet gave no client: too many worlds are open')
        pybullet.setGravity(*np.asarray(gravity, float).tolist(), physicsClientId=self._client)
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=ITERATIONS, contactERP=ERP, erp=ERP,
            warmStartingFactor=WARM_START, enableFileCaching=0,
            useSplitImpulse=1, splitImpulsePenetrationThreshold=0.0,
            deterministicOverlappingPairs=1, physicsClientId=self._client)
        self._time_step = 0.0
        self._shapes: dict[tuple, int] = {}
        self._visual = pybullet.createVisualShape(
            pybullet.GEOM_BOX, halfExtents=[0.01] * 3, physicsClientId=self._client)
        self._folder = _MEMORY_FOLDER if os.access(_MEMORY_FOLDER, os.W_OK) else None
        self._release = weakref.finalize(self, pybullet.disconnect, self._client)

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._release()

    def step(self, time_step: float) -> None:
        """Let time pass [s]."""
        if time_step != self._time_step:
            pybullet.setTimeStep(time_step, physicsClientId=self._client)
            self._time_step = time_step
        pybullet.stepSimulation(physicsClientId=self._client)

    def add_ground(self) -> int:
        """
        Add the ground, whose top is z = 0.

        A huge box: against a plane, Bullet finds one contact point per step only, so that what
        lands flat would strike with a corner and be turned.
        """
        slab = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=(_GROUND_HALF, _GROUND_HALF, _GROUND_DEPTH),
            physicsClientId=self._client)
        return pybullet.createMultiBody(
            0.0, slab, self._visual, basePosition=(0.0, 0.0, -_GROUND_DEPTH),
            useMaximalCoordinates=1, flags=_SLEEPING, physicsClientId=self._client)

    def box(self, size: np.ndarray) -> int:
        """Give the shape of a box by its full extents [m], (3,)."""
        half = tuple(round(0.5 * extent, 6) for extent in np.asarray(size).tolist())
        return self._shape(pybullet.GEOM_BOX, halfExtents=half)

    def capsule(self, diameter: float, length: float) -> int:
        """Give the shape of a capsule along z [m]; one no longer than wide is a sphere."""
        radius, straight = round(0.5 * diameter, 6), round(length - diameter, 6)
        if straight <= 0.0:
            return self._shape(pybullet.GEOM_SPHERE, radius=radius)
        return self._shape(pybullet.GEOM_CAPSULE, radius=radius, height=straight)

    def _shape(self, kind: int, **size: float | tuple) -> int:
        """Make each shape once: PyBullet never frees them."""
        key = (kind, *size.values())
        if key not in self._shapes:
            self._shapes[key] = pybullet.createCollisionShape(
                kind, **size, physicsClientId=self._client)
        return self._shapes[key]

    def add_same(self, shape: int, positions: np.ndarray, orientation: np.ndarray
                 ) -> list[int]:
        """
        Add bodies of one shape and attitude, 5 times faster than one by one.

        Every body has 1 kg until `set_mass` is called.

        :param shape: from `box` or `capsule`.
        :param positions: centres of mass [m], (K, 3).
        :param orientation: quaternion (4,).
        """
        ids = pybullet.createMultiBody(
            1.0, shape, self._visual,
            baseOrientation=orientation.tolist(), batchPositions=positions.tolist(),
            useMaximalCoordinates=1, flags=_SLEEPING, physicsClientId=self._client)
        return list(ids)

    def add_compound(self, urdf: str, pose: np.ndarray) -> int:
        """
        Add a rigid body made of many shapes.

        PyBullet's own compounds stop at 16 shapes, a URDF link does not. It never gives back the
        shapes of a URDF, 1 to 5 kB, before the world is closed.

        :param urdf: one link in its principal frame, see `compound.describe`.
        :param pose: of the centre of mass [m], (7,).
        """
        handle, path = tempfile.mkstemp('.urdf', 'procphys_', self._folder)
        try:
            with open(handle, 'w', encoding='ascii') as file:
                file.write(urdf)
            return pybullet.loadURDF(
                path, pose[:3].tolist(), pose[3:].tolist(), useMaximalCoordinates=1,
                flags=_SLEEPING | pybullet.URDF_USE_INERTIA_FROM_FILE,
                physicsClientId=self._client)
        finally:
            os.unlink(path)

    def remove(self, body: int) -> None:
        """Take a body out of the world; its id may be given to a later one."""
        pybullet.removeBody(body, physicsClientId=self._client)

    def set_surface(self, body: int, friction: float, restitution: float) -> None:
        """
        Set how a body touches others.

        Bullet multiplies the two values of a pair, so each body carries the square root of what
        two bodies of its kind have between them.

        :param friction: Coulomb coefficient between two such bodies.
        :param restitution: coefficient of restitution between two such bodies.
        """
        root = float(np.sqrt(friction))
        pybullet.changeDynamics(
            body, -1, lateralFriction=root, restitution=float(np.sqrt(restitution)),
            rollingFriction=ROLLING_FRICTION, linearDamping=LINEAR_DAMPING,
            angularDamping=ANGULAR_DAMPING, physicsClientId=self._client)

    def set_sweep(self, body: int, radius: float) -> None:
        """Sweep a sphere along the moves of a plain body, so that it cannot jump; 0 = do not."""
        pybullet.changeDynamics(body, -1, ccdSweptSphereRadius=radius,
                                physicsClientId=self._client)

    def set_free_of_drag(self, body: int) -> None:
        """Take the numerical damping off a body."""
        pybullet.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0,
                                physicsClientId=self._client)

    def set_mass(self, body: int, mass: float, inertia: np.ndarray) -> None:
        """
        Make a body move; Bullet's own sleeping stays off, it would not notice a lost support.

        :param mass: [kg].
        :param inertia: principal moments in the body's axes [kg·m²], (3,).
        """
        pybullet.changeDynamics(
            body, -1, mass=mass, localInertiaDiagonal=inertia.tolist(),
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING,
            physicsClientId=self._client)

    def hold(self, body: int) -> None:
        """
        Make a body immovable, at no cost per step.

        It must have been created with mass: Bullet never moves a body that was created without.
        """
        pybullet.resetBaseVelocity(body, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
                                   physicsClientId=self._client)
        pybullet.changeDynamics(
            body, -1, mass=0.0, activationState=pybullet.ACTIVATION_STATE_SLEEP,
            physicsClientId=self._client)

    def set_filter(self, body: int, group: int, mask: int) -> None:
        """Say what a body collides with: two meet when each one's mask has the other's group."""
        pybullet.setCollisionFilterGroupMask(body, -1, group, mask,
                                             physicsClientId=self._client)

    def place(self, body: int, pose: np.ndarray) -> None:
        """Set a body's centre of mass and attitude, (7,)."""
        pybullet.resetBasePositionAndOrientation(
            body, pose[:3].tolist(), pose[3:].tolist(), physicsClientId=self._client)

    def set_velocities(self, bodies: list[int], velocities: np.ndarray) -> None:
        """Set linear [m/s] and angular velocities [rad/s], (K, 6) in world axes."""
        client, put = self._client, pybullet.resetBaseVelocity
        for body, velocity in zip(bodies, velocities.tolist()):
            put(body, velocity[:3], velocity[3:], client)

    def read(self, bodies: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """Read poses (K, 7) and velocities (K, 6) of centres of mass, world axes."""
        client = self._client
        pose, velocity = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
        return (_table([pose(body, client) for body in bodies], 7),
                _table([velocity(body, client) for body in bodies], 6))

    def bounds(self, bodies: list[int]) -> np.ndarray:
        """Read the axis-aligned bounds [m], (K, 6): three minima, three maxima."""
        client = self._client
        return _table([pybullet.getAABB(body, -1, client) for body in bodies], 6)

    def near(self, body: int, other: int, reach: float) -> bool:
        """Say whether the shapes of two bodies are nearer to each other than so far [m]."""
        return bool(pybullet.getClosestPoints(body, other, reach, physicsClientId=self._client))

    def contacts(self) -> np.ndarray:
        """
        Read all contact points of the last step.

        :returns: (C, 13): two bodies, point on the second, normal towards the first, distance,
            and the force on the first in world axes [N], (3,), with the normal force last.
        """
        found = pybullet.getContactPoints(physicsClientId=self._client)
        size = np.fromiter(chain.from_iterable(map(_SIZES, found)), float, 6 * len(found))
        size, way = size.reshape(-1, 6), _table(list(map(_WAYS, found)), 12)
        force = (size[:, 3:4] * way[:, 3:6] + size[:, 4:5] * way[:, 6:9]
                 + size[:, 5:6] * way[:, 9:12])
        return np.column_stack([size[:, :2], way[:, :6], size[:, 2], force, size[:, 3]])


def _table(pairs: list, width: int) -> np.ndarray:
    """Flatten pairs of tuples into rows; `fromiter` is four times faster than `array`."""
    flat = chain.from_iterable(chain.from_iterable(pairs))
    return np.fromiter(flat, float, width * len(pairs)).reshape(-1, width)
