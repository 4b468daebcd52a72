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
from procphys_ros.physics.air import AIR_DENSITY, CUBE_DRAG, CYLINDER_DRAG, FOLIAGE_DRAG
from procphys_ros.physics.world import expand, rigid_sum, State, World
from procphys_ros.physics.world.registry import FRICTION

_WOOD_FRICTION = 0.6  # green wood and bark on soil or wood
_NONE = np.zeros(0, np.intp)
_UNFELT = 0.05  # [m/s²] drag not worth the call that sets a velocity, half a per cent of gravity
_SAME = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])  # the part's frame is the body's
_SIDE_MEAN = np.pi / 4.0  # mean projected width of a slender body over all attitudes


class Debris:
    """
    Keeps track of which body of the world carries which parts.

    :param blueprint: all parts of the scene.
    :param world: where the bodies live.

    :ivar carrier: id of the body that carries each part, -1 = none, (N,).
    :ivar size: number of parts that each body carries, by id, grows with the largest id.
    """

    def __init__(self, blueprint: Blueprint, world: World):
        self._blueprint = blueprint
        self._world = world
        self._drag_area = drag_area(blueprint)
        self.carrier = np.full(len(blueprint), -1, np.intp)
        self._local = np.zeros((len(blueprint), 7))
        self._moved = np.zeros(len(blueprint), bool)
        self._members: dict[int, np.ndarray] = {}
        self._carried: np.ndarray | None = None
        self._area = np.zeros(0)
        self.size = np.zeros(0, np.intp)

    def grow(self, blueprint: Blueprint) -> None:
        """Make room for parts that joined behind those there were; see `Debris` for the rest."""
        more = len(blueprint) - len(self.carrier)
        self._blueprint = blueprint
        self._drag_area = drag_area(blueprint)
        self.carrier = np.concatenate([self.carrier, np.full(more, -1, np.intp)])
        self._local = np.concatenate([self._local, np.zeros((more, 7))])
        self._moved = np.concatenate([self._moved, np.zeros(more, bool)])

    @property
    def body_count(self) -> int:
        """Count the bodies that carry parts."""
        return len(self._members)

    def parts_of(self, body: int) -> np.ndarray:
        """List the parts that a body carries, ascending; none for one that carries nothing."""
        return self._members.get(int(body), _NONE)

    def local_poses(self, parts: np.ndarray) -> np.ndarray:
        """Give the poses of carried parts in the frames of their bodies, (K, 7)."""
        return self._local[parts]

    def poses_of(self, body: int) -> np.ndarray:
        """Give the present poses of the parts that a body carries, (P, 7)."""
        return self._states_of(body)[0]

    def gather(self, parts: np.ndarray, poses: np.ndarray, velocities: np.ndarray) -> int:
        """
        Make one rigid body of parts; momentum and angular momentum are kept.

        :param parts: (P,) indices.
        :param poses: of these parts, (P, 7).
        :param velocities: of these parts, world axes, (P, 6).
        :returns: id of the body.
        """
        order = np.argsort(parts)  # rows of a tree follow its branches, not the part indices
        parts, poses, velocities = np.asarray(parts)[order], poses[order], velocities[order]
        source = self._blueprint
        friction = FRICTION if source.shape[parts[0]] == Shape.BOX else _WOOD_FRICTION
        sizes = source.solid_size(parts)
        if len(parts) == 1:
            part = int(parts[0])
            body = self._world.add_body(
                source.shape[part], sizes[0], float(source.mass[part]), poses[0],
                velocities[0], source.inertia[part], friction)
            self._enter(body, parts, _SAME)
            return body
        total = rigid_sum(source.mass[parts], source.inertia[parts], poses, velocities)
        body = self._world.add_fragment(
            source.shape[parts], sizes, total.local_poses, total.mass,
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
            self._enter(int(body), np.array([part]), _SAME)

    def split(self, body: int, pieces: list[np.ndarray]) -> list[int]:
        """
        Replace a body by its pieces, which go on as parts of the rigid body did: v + ω × r, ω.

        :param body: id.
        :param pieces: its parts, (P,) each.
        :returns: ids of the new bodies.
        """
        whole = self._members[body]
        poses, velocities = self._states_of(body)
        self._leave(body)
        self._world.remove(np.array([body]))
        rows = [np.searchsorted(whole, np.sort(parts)) for parts in pieces]
        return [self.gather(whole[row], poses[row], velocities[row]) for row in rows]

    def set_drag_area(self, body: int, area: float) -> None:
        """
        Say what drag a body has that its parts' mean shadows would not give.

        :param body: id in the world.
        :param area: drag coefficient times shadow [m²].
        """
        self._area[body] = area

    def carry(self, poses: np.ndarray, velocities: np.ndarray) -> None:
        """
        Move the parts of all bodies that moved in this step.

        :param poses: of all parts, (N, 7), written in place.
        :param velocities: of all parts, world axes, (N, 6), written in place.
        """
        if not self._members:
            return
        if self._carried is None:
            self._carried = np.flatnonzero(self.carrier >= 0)
        bodies, parts = self._world.bodies, self._carried
        moves = bodies.state[self.carrier[parts]] >= State.LOOSE
        rows = parts[moves | self._moved[parts]]
        self._moved[parts] = moves
        expand(bodies.poses, bodies.velocities, self.carrier[rows], self._local[rows], rows,
               poses, velocities)

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
        rate = (0.5 * AIR_DENSITY * area[awake] * np.linalg.norm(slip, axis=1)
                / self._world.bodies.mass[awake])
        share = -np.expm1(-rate * time_step)[:, None]
        velocities[:, :3] += share * slip
        velocities[:, 3:] *= 1.0 - share
        felt = rate * np.linalg.norm(slip, axis=1) > _UNFELT
        self._world.set_velocities(awake[felt], velocities[felt])

    def _states_of(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        bodies, parts = self._world.bodies, self._members[body]
        poses, velocities = np.empty((len(parts), 7)), np.empty((len(parts), 6))
        expand(bodies.poses, bodies.velocities, np.full(len(parts), body), self._local[parts],
               np.arange(len(parts)), poses, velocities)
        return poses, velocities

    def _enter(self, body: int, parts: np.ndarray, local: np.ndarray) -> None:
        self.carrier[parts] = body
        self._local[parts] = local
        self._moved[parts] = True
        self._members[body] = np.asarray(parts, np.intp)
        self._carried = None
        if body >= len(self._area):
            more = 2 * body + 1 - len(self._area)
            self._area = np.concatenate([self._area, np.zeros(more)])
            self.size = np.concatenate([self.size, np.zeros(more, np.intp)])
        self._area[body] = self._drag_area[parts].sum()
        self.size[body] = len(parts)

    def _leave(self, body: int) -> None:
        self.carrier[self._members.pop(body)] = -1
        self.size[body] = 0


def drag_area(blueprint: Blueprint) -> np.ndarray:
    """
    Give the mean drag area Cd·A of each part over all attitudes [m²], (N,).

    The mean shadow of a convex body is a quarter of its surface (Cauchy).

    :param blueprint: the parts.
    """
    x, y, z = blueprint.visual_size.T
    box = CUBE_DRAG * 0.5 * (x * y + y * z + z * x)
    rod = CYLINDER_DRAG * _SIDE_MEAN * 0.5 * (x + y) * z
    solid = np.where(blueprint.shape == Shape.BOX, box, rod)
    return solid + FOLIAGE_DRAG * blueprint.leaf_area
