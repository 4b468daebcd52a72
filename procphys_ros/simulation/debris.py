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

"""Debris: parts of the scene that rigid bodies of the world carry along."""

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.physics.world import expand, rigid_sum, State, World

_AIR_DENSITY = 1.225  # [kg/m³], ISO 2533 standard atmosphere at sea level, 15 °C
_WOOD_FRICTION = 0.6  # green wood and bark on soil or wood
_CYLINDER_DRAG = 1.1  # cross flow, 1e3 < Re < 2e5 (Hoerner 1965, Fluid-Dynamic Drag, 3-9)
_LEAF_DRAG = 0.3      # crowns in a strong wind, per leaf area (Vollsinger 2005: 0.15 to 0.4)
_BOX_DRAG = 1.05      # cube, face on (Hoerner 1965, 3-16)
_SIDE_MEAN = np.pi / 4.0  # mean projected width of a slender body over all attitudes


class Debris:
    """
    Keeps track of which body of the world carries which parts.

    :param blueprint: all parts of the scene.
    :param world: where the bodies live.
    """

    def __init__(self, blueprint: Blueprint, world: World):
        self._blueprint = blueprint
        self._world = world
        self._drag_area = drag_area(blueprint)
        self.carrier = np.full(len(blueprint), -1, np.intp)
        self._body = np.zeros(0, np.intp)
        self._part = np.zeros(0, np.intp)
        self._local = np.zeros((0, 7))
        self._moved = np.zeros(0, bool)
        self._area = np.zeros(0)

    @property
    def body_count(self) -> int:
        """Count the bodies that carry parts."""
        return len(np.unique(self._body))

    def gather(self, parts: np.ndarray, poses: np.ndarray, velocities: np.ndarray) -> int:
        """
        Make one rigid body of parts; momentum and angular momentum are kept.

        :param parts: (P,) indices.
        :param poses: of these parts, (P, 7).
        :param velocities: of these parts, world axes, (P, 6).
        :returns: id of the body.
        """
        source = self._blueprint
        total = rigid_sum(source.mass[parts], source.inertia[parts], poses, velocities)
        friction = _WOOD_FRICTION
        body = self._world.add_fragment(
            source.shape[parts], source.size[parts], total.local_poses, total.mass,
            total.inertia, total.pose, total.velocity, friction=friction)
        self._enter(body, parts, total.local_poses)
        return body

    def adopt(self, parts: np.ndarray, bodies: np.ndarray) -> None:
        """
        Take over bodies that are one part each.

        :param parts: (P,) indices.
        :param bodies: ids in the world, (P,).
        """
        for part, body in zip(parts, bodies):
            self._enter(int(body), np.array([part]), np.array([[0, 0, 0, 0, 0, 0, 1.0]]))

    def carry(self, poses: np.ndarray, velocities: np.ndarray) -> None:
        """
        Move the parts of all bodies that moved in this step.

        :param poses: of all parts, (N, 7), written in place.
        :param velocities: of all parts, world axes, (N, 6), written in place.
        """
        if not len(self._body):
            return
        bodies = self._world.bodies
        moves = bodies.state[self._body] >= State.LOOSE
        rows = np.flatnonzero(moves | self._moved)
        self._moved = moves
        expand(bodies.poses, bodies.velocities, self._body[rows], self._local[rows],
               self._part[rows], poses, velocities)

    def drag(self, air: np.ndarray, time_step: float) -> None:
        """
        Let the air slow down or carry off what is loose.

        Quadratic drag with the speed of the last step, integrated exactly over the step, so that
        no light body overshoots the speed of the air.

        :param air: velocity of the air at the loose bodies `World.awake`, (K, 3) [m/s].
        :param time_step: [s].
        """
        awake = self._world.awake
        if not len(awake):
            return
        area = np.zeros(max(awake[-1] + 1, len(self._area)))
        area[:len(self._area)] = self._area
        velocities = self._world.velocities(awake).copy()
        slip = air - velocities[:, :3]
        rate = (0.5 * _AIR_DENSITY * area[awake] * np.linalg.norm(slip, axis=1)
                / self._world.bodies.mass[awake])
        share = -np.expm1(-rate * time_step)[:, None]
        velocities[:, :3] += share * slip
        velocities[:, 3:] *= 1.0 - share
        self._world.set_velocities(awake, velocities)

    def _enter(self, body: int, parts: np.ndarray, local: np.ndarray) -> None:
        self.carrier[parts] = body
        self._body = np.concatenate([self._body, np.full(len(parts), body, np.intp)])
        self._part = np.concatenate([self._part, np.asarray(parts, np.intp)])
        self._local = np.concatenate([self._local, local])
        self._moved = np.concatenate([self._moved, np.ones(len(parts), bool)])
        if body >= len(self._area):
            self._area = np.concatenate([self._area, np.zeros(2 * body + 1 - len(self._area))])
        self._area[body] = self._drag_area[parts].sum()


def drag_area(blueprint: Blueprint) -> np.ndarray:
    """
    Give the mean drag area Cd·A of each part over all attitudes [m²], (N,).

    The mean shadow of a convex body is a quarter of its surface (Cauchy).

    :param blueprint: the parts.
    """
    x, y, z = blueprint.visual_size.T
    box = _BOX_DRAG * 0.5 * (x * y + y * z + z * x)
    rod = _CYLINDER_DRAG * _SIDE_MEAN * 0.5 * (x + y) * z
    solid = np.where(blueprint.shape == Shape.BOX, box, rod)
    return solid + _LEAF_DRAG * blueprint.leaf_area
