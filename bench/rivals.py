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


"""The bench forest as MuJoCo and PyBullet see it: same segments, two hinges per joint."""

import numpy as np

from procphys_ros.blueprint import Blueprint
from procphys_ros.geometry import rotation
from procphys_ros.physics.trees.layout import arrange, Rows, STIFFNESS

MOST_JOINTS = 60  # universal joints that PyBullet's state buffers hold per body; more corrupt them
_BETA = 0.01  # [s], damping over stiffness
_GAIN = 0.5  # [-], of PyBullet's joint motors, 1 at most
_DUMMY = 1e-5  # [kg] and [kg·m²], mass of the massless link inside a universal joint


class MuJoCoForest:
    """
    One MuJoCo model of all trees, springs and dampers in the model.

    Its springs are explicit, so it is stable only with c ≥ dt/2·k.
    """

    def __init__(self, blueprint: Blueprint, dt: float) -> None:
        """
        Write and compile the model.

        :param blueprint: the trees.
        :param dt: [s].
        """
        import mujoco
        self._mujoco = mujoco
        rows = arrange(blueprint, 0.0)
        self.model = mujoco.MjModel.from_xml_string(_mjcf(rows, blueprint.size[rows.part], dt))
        self.data = mujoco.MjData(self.model)

    def step(self, force: np.ndarray) -> None:
        """
        Advance one step under a force at each centre of mass.

        :param force: [N], (S, 3), world.
        """
        self.data.xfrc_applied[1:, :3] = force
        self._mujoco.mj_step(self.model, self.data)


def _mjcf(rows: Rows, sizes: np.ndarray, dt: float) -> str:
    lines = [f'<mujoco><option timestep="{dt}" integrator="implicitfast"/><worldbody>']
    open_ends: list[int] = []
    for i, (body, mount, size) in enumerate(zip(rows.body, rows.mount, sizes)):
        while open_ends and open_ends[-1] <= i:
            open_ends.pop()
            lines.append('</body>')
        x, y, z, qx, qy, qz, qw = mount
        stiffness = rows.swing[i, STIFFNESS]
        spring = f'stiffness="{stiffness}" damping="{_BETA * stiffness}"'
        lines.append(
            f'<body pos="{x} {y} {z}" quat="{qw} {qx} {qy} {qz}"><joint axis="1 0 0" {spring}/>'
            f'<joint axis="0 1 0" {spring}/><inertial pos="0 0 {body[3]}" mass="{body[0]}" '
            f'diaginertia="{body[1]} {body[1]} {body[2]}"/><geom type="capsule" contype="0" '
            f'conaffinity="0" pos="0 0 {body[3]}" size="{0.5 * size[0]} '
            f'{0.5 * (size[2] - size[0])}"/>')
        open_ends.append(int(rows.end[i]))
    lines.append('</body>' * len(open_ends) + '</worldbody></mujoco>')
    return ''.join(lines)


class PyBulletForest:
    """
    One PyBullet multibody of capsules per tree, its joint motors as springs.

    The motors' stiffness is an artefact of gain and solver iterations, but they hold: spring
    torques set from outside explode at 1/60 s.
    """

    def __init__(self, blueprint: Blueprint, dt: float) -> None:
        """
        Build the bodies.

        :param blueprint: trees of at most `MOST_JOINTS` segments.
        :param dt: [s].
        """
        import pybullet
        self._bullet = pybullet
        self._client = pybullet.connect(pybullet.DIRECT)
        pybullet.setTimeStep(dt, physicsClientId=self._client)
        pybullet.setGravity(0, 0, -9.81, physicsClientId=self._client)
        rows = arrange(blueprint, 0.0)
        self._trees = [self._add(rows, first, blueprint.size[rows.part])
                       for first in np.flatnonzero(rows.parent < 0)]

    def _add(self, rows: Rows, first: int, sizes: np.ndarray) -> tuple:
        """Create one tree; return its id and joints."""
        bullet, count = self._bullet, int(rows.end[first]) - first
        span = slice(first, first + count)
        mount, body = rows.mount[span].copy(), rows.body[span]
        base = mount[0].copy()
        mount[0] = [0, 0, 0, 0, 0, 0, 1]
        masses = np.column_stack([np.full(count, _DUMMY), body[:, 0]]).ravel()
        start = np.zeros((count, 2, 3))
        start[:, 0] = mount[:, :3]
        turn = np.tile(rotation.IDENTITY, (count, 2, 1))
        turn[:, 0] = mount[:, 3:]
        centre = np.zeros((count, 2, 3))
        centre[:, 1, 2] = body[:, 3]
        shapes = np.full((count, 2), -1)
        shapes[:, 1] = [bullet.createCollisionShape(
            bullet.GEOM_CAPSULE, radius=0.5 * size[0], height=size[2] - size[0],
            collisionFramePosition=[0, 0, reach], physicsClientId=self._client)
            for size, reach in zip(sizes[span], body[:, 3])]
        above = np.arange(2 * count)  # 1-based parents: first link 1 hangs on the base, 0
        above[::2] = np.where(rows.parent[span] < 0, 0, 2 * (rows.parent[span] - first) + 2)
        ident = bullet.createMultiBody(
            0.0, basePosition=base[:3], baseOrientation=base[3:], linkMasses=masses.tolist(),
            linkCollisionShapeIndices=shapes.ravel().tolist(),
            linkVisualShapeIndices=[-1] * (2 * count),
            linkPositions=start.reshape(-1, 3).tolist(),
            linkOrientations=turn.reshape(-1, 4).tolist(),
            linkInertialFramePositions=centre.reshape(-1, 3).tolist(),
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * (2 * count),
            linkParentIndices=above.tolist(),
            linkJointTypes=[bullet.JOINT_REVOLUTE] * (2 * count),
            linkJointAxis=[[1, 0, 0], [0, 1, 0]] * count, physicsClientId=self._client)
        self._finish(ident, body)
        links = list(range(2 * count))
        bullet.setJointMotorControlArray(
            ident, links, bullet.POSITION_CONTROL, targetPositions=[0.0] * (2 * count),
            positionGains=[_GAIN] * (2 * count), velocityGains=[1.0] * (2 * count),
            physicsClientId=self._client)
        return ident, links

    def _finish(self, ident: int, body: np.ndarray) -> None:
        """Set inertias; let a tree meet others, but not itself nor other trees."""
        bullet, client = self._bullet, self._client
        moments = np.column_stack([np.full((len(body), 3), _DUMMY), body[:, [1, 1, 2]]])
        for link, moment in enumerate(moments.reshape(-1, 3).tolist()):
            bullet.changeDynamics(ident, link, localInertiaDiagonal=moment, linearDamping=0,
                                  angularDamping=0, jointDamping=0, physicsClientId=client)
        for link in range(-1, 2 * len(body)):
            bullet.setCollisionFilterGroupMask(ident, link, 2, 1, physicsClientId=client)

    def step(self) -> None:
        """Step all trees and read where their segments are."""
        bullet, client = self._bullet, self._client
        bullet.stepSimulation(physicsClientId=client)
        for ident, links in self._trees:
            bullet.getLinkStates(ident, links[1::2], physicsClientId=client)

    def bends(self) -> np.ndarray:
        """Return all joint angles [rad]."""
        return np.array([s[0] for ident, links in self._trees for s in
                         self._bullet.getJointStates(ident, links, physicsClientId=self._client)])
