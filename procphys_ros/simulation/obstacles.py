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


"""Obstacles: boxes and capsules that branches may collide with."""

from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.touch import overlaps, piece_bounds
from procphys_ros.physics.world import BodyState, expand, World

_CELL = 2.0  # [m] edge of the cells of bricks


class Obstacles(NamedTuple):
    """
    Boxes and capsules, one row per piece.

    :ivar shape: `Shape`, (P,).
    :ivar pose: world, (P, 7).
    :ivar size: as in `Blueprint.size` [m], (P, 3).
    :ivar velocity: world axes, (P, 6).
    :ivar body: id of its body in the world, -1 for a branch, (P,).
    :ivar row: of a branch in the forest, -1 for all others, (P,).
    :ivar part: of a standing brick, -1 for all others, (P,).
    """

    shape: np.ndarray
    pose: np.ndarray
    size: np.ndarray
    velocity: np.ndarray
    body: np.ndarray
    row: np.ndarray
    part: np.ndarray

    @classmethod
    def none(cls) -> 'Obstacles':
        """Return a table without rows."""
        return cls.of(np.zeros(0, np.uint8), np.zeros((0, 7)), np.zeros((0, 3)),
                      np.zeros((0, 6)))

    @classmethod
    def of(cls, shape: np.ndarray, pose: np.ndarray, size: np.ndarray, velocity: np.ndarray,
           body: np.ndarray | None = None, row: np.ndarray | None = None,
           part: np.ndarray | None = None) -> 'Obstacles':
        """Make a table; omitted columns are -1."""
        nothing = np.full(len(pose), -1, np.intp)
        return cls(np.asarray(shape, np.uint8), pose, size, velocity,
                   nothing if body is None else body, nothing if row is None else row,
                   nothing if part is None else part)

    def bounds(self, reach: float, margin: float) -> np.ndarray:
        """Return axis-aligned bounds, swept over a time [s], with a margin [m], (P, 6)."""
        return piece_bounds(self.shape, self.pose, self.size, self.velocity, reach, margin)


def of_bodies(world: World, ids: np.ndarray) -> Obstacles:
    """Return the collision shapes of bodies, (K,) ids, at their present poses."""
    if not len(ids):
        return Obstacles.none()
    bodies = world.bodies
    count = bodies.piece_count[ids]
    owner = np.repeat(ids, count)
    piece = np.arange(len(owner)) + np.repeat(bodies.first_piece[ids] - np.cumsum(count) + count,
                                              count)
    poses, velocities = np.empty((len(owner), 7)), np.empty((len(owner), 6))
    expand(bodies.poses, bodies.velocities, owner, bodies.piece_pose[piece],
           np.arange(len(owner)), poses, velocities)
    return Obstacles.of(bodies.piece_shape[piece], poses, bodies.piece_size[piece], velocities,
                        owner)


def of_branches(rows: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
                velocities: np.ndarray) -> Obstacles:
    """Return branches as obstacles for others; arguments as of the forest."""
    return Obstacles.of(np.full(len(rows), Shape.CAPSULE), poses[rows], sizes[rows],
                        velocities[rows], row=np.asarray(rows, np.intp))


class Bricks:
    """
    Masonry as built, sorted into cells once.

    :param blueprint: all parts of the scene.
    :param parts: of buildings, (K,).

    :ivar cells: bounds of the contents of each cell [m], (C, 6).
    """

    def __init__(self, blueprint: Blueprint, parts: np.ndarray):
        self.parts = parts
        self._all = Obstacles.of(
            blueprint.shape[parts], blueprint.poses[parts], blueprint.size[parts],
            np.zeros((len(parts), 6)), part=parts)
        self._cell, self.cells = sorted_into_cells(self._all.bounds(0.0, 0.0))
        room = 0.5 * norm(blueprint.size[parts], axis=1)[:, None]
        place = blueprint.poses[parts, :3]
        self.reach = sorted_into_cells(np.hstack([place - room, place + room]))[1]

    def __len__(self) -> int:
        return len(self.parts)

    def within(self, bounds: np.ndarray, standing: np.ndarray | None = None,
               body: np.ndarray | None = None) -> Obstacles:
        """
        List the bricks in the cells that some boxes overlap.

        :param bounds: of these boxes, (K, 6).
        :param standing: whether each part still stands, (N,) bool; None = all.
        :param body: id of each part's body, (N,).
        """
        _, cells = overlaps(bounds, self.cells)
        if not len(cells):
            return Obstacles.none()
        wanted = np.zeros(len(self.cells), bool)
        wanted[cells] = True
        chosen = wanted[self._cell]
        if standing is not None:
            chosen &= standing[self.parts]
        rows = np.flatnonzero(chosen)
        found = Obstacles(*(column[rows] for column in self._all))
        return found if body is None else found._replace(body=body[self.parts[rows]])


def sorted_into_cells(bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Sort boxes by their centres into cells of space.

    :param bounds: three minima, three maxima [m], (K, 6).
    :returns: cell of each box, (K,), and bounds of the contents of each cell, (C, 6).
    """
    key = np.floor(0.5 * (bounds[:, :3] + bounds[:, 3:]) / _CELL).astype(np.int64)
    _, cell = np.unique(key, axis=0, return_inverse=True)
    count = int(np.max(cell, initial=-1)) + 1
    cells = np.hstack([np.full((count, 3), np.inf), np.full((count, 3), -np.inf)])
    np.minimum.at(cells[:, :3], cell, bounds[:, :3])
    np.maximum.at(cells[:, 3:], cell, bounds[:, 3:])
    return cell, cells


def meets_trees(world: World) -> np.ndarray:
    """List the bodies that branches may collide with: all but standing parts, (K,)."""
    state = world.bodies.state
    return np.flatnonzero((state == BodyState.AWAKE) | (state == BodyState.KINEMATIC)
                          | (state == BodyState.RESTING))
