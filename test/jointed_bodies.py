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

"""The way of Baxter et al. (2010), to compare with: a body per part and a joint per bond."""

import numpy as np
import pybullet

from procphys_ros.blueprint import Blueprint, GROUND, Law, Shape
from procphys_ros.geometry import rotation

ITERATIONS = 50  # of PyBullet's solver, per step; its own choice is 50


def bond_gaps(blueprint: Blueprint, poses: np.ndarray) -> np.ndarray:
    """Compute the distance between the two sides of every bond [m], (M,)."""
    # Each side carries the point of contact along; bonded parts that move rigidly or turn about it
    # keep the two points together. Not a number where a side no longer exists.
    first, second = blueprint.bonds[:, 0], blueprint.bonds[:, 1]
    place = []
    for side in (first, second):
        local = rotation.relative(blueprint.poses[side], blueprint.bond_frame)
        place.append(rotation.compose(poses[side], local)[:, :3])
    place[0] = np.where((first == GROUND)[:, None], blueprint.bond_frame[:, :3], place[0])
    return np.linalg.norm(place[1] - place[0], axis=1)


class JointedBodies:
    """
    All parts of a blueprint as bodies of PyBullet, every bond a joint of its solver.

    Mortar becomes fixed joints, branches hang on point-to-point joints (without springs: what
    they are used for here is the distance that joints keep).

    :param blueprint: what to simulate.
    :param gravity: downward acceleration [m/s²].
    :param bone: length of capsules over that of their segments; above 0.95 they overlap.

    :ivar poses: of all parts, world, (N, 7).
    """

    def __init__(self, blueprint: Blueprint, gravity: float = 9.81, bone: float | None = None):
        self._client = pybullet.connect(pybullet.DIRECT)
        self._to = {'physicsClientId': self._client}
        pybullet.setGravity(0, 0, -gravity, **self._to)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=1.0 / 60.0,
                                           numSolverIterations=ITERATIONS, **self._to)
        self.blueprint = blueprint
        ground = pybullet.createCollisionShape(pybullet.GEOM_PLANE, **self._to)
        self._ground = pybullet.createMultiBody(0, ground, useMaximalCoordinates=1, **self._to)
        self.bodies = [self._make(i, bone) for i in range(len(blueprint))]
        for i in range(len(blueprint.bonds)):
            self._join(i)
        self.read()

    def __enter__(self) -> 'JointedBodies':
        return self

    def __exit__(self, *_: object) -> None:
        pybullet.disconnect(self._client)

    def push(self, part: int, force: np.ndarray) -> None:
        """Push a part at its centre of mass during the next step [N], (3,)."""
        pybullet.applyExternalForce(self.bodies[part], -1, list(force),
                                    self.poses[part, :3].tolist(), pybullet.WORLD_FRAME,
                                    **self._to)

    def kick(self, parts: np.ndarray, velocity: np.ndarray) -> None:
        """Set the velocity of parts [m/s], (3,)."""
        for part in parts:
            pybullet.resetBaseVelocity(self.bodies[part], list(velocity), [0, 0, 0], **self._to)

    def step(self) -> None:
        """Step by a sixtieth of a second."""
        pybullet.stepSimulation(**self._to)
        self.read()

    def read(self) -> None:
        """Take over where everything is."""
        self.poses = np.array([np.concatenate(pybullet.getBasePositionAndOrientation(
            body, **self._to)) for body in self.bodies])
        self.velocities = np.array([np.concatenate(pybullet.getBaseVelocity(body, **self._to))
                                    for body in self.bodies])

    def _make(self, part: int, bone: float | None) -> int:
        plan = self.blueprint
        if plan.shape[part] == Shape.BOX:
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_BOX, halfExtents=(0.5 * plan.size[part]).tolist(), **self._to)
        else:
            width, _, length = plan.visual_size[part]
            length = plan.size[part, 2] if bone is None else bone * length
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_CAPSULE, radius=0.5 * width, height=max(length - width, 0.0),
                **self._to)
        return pybullet.createMultiBody(
            plan.mass[part], shape, basePosition=plan.poses[part, :3].tolist(),
            baseOrientation=plan.poses[part, 3:].tolist(), useMaximalCoordinates=1, **self._to)

    def _join(self, bond: int) -> None:
        plan = self.blueprint
        first, second = plan.bonds[bond]
        frame = plan.bond_frame[bond]
        near = frame if first == GROUND else rotation.relative(plan.poses[first], frame)
        far = rotation.relative(plan.poses[second], frame)
        kind = (pybullet.JOINT_FIXED if plan.bond_law[bond] == Law.MORTAR
                else pybullet.JOINT_POINT2POINT)
        body = self._ground if first == GROUND else self.bodies[first]
        pybullet.createConstraint(
            body, -1, self.bodies[second], -1, kind, [0, 0, 0], near[:3].tolist(),
            far[:3].tolist(), near[3:].tolist(), far[3:].tolist(), **self._to)
