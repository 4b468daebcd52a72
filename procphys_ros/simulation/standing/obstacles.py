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


"""Obstacles: what branches may run into, cut into boxes and capsules."""

from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape
from procphys_ros.physics.touch import overlaps, piece_bounds
from procphys_ros.physics.world import expand, State, World
from procphys_ros.physics.world.pieces import Pieces
from procphys_ros.simulation.standing.buildings import Buildings

_CELL = 2.0  # [m], edge of the cells that bricks are sorted into


class Obstacles(NamedTuple):
    """
    Boxes and capsules, one row per piece.

    :ivar shape: `Shape`, (P,).
    :ivar pose: world, (P, 7).
    :ivar size: as in `Blueprint.size` [m], (P, 3).
    :ivar velocity: world axes, (P, 6).
    :ivar body: id of the body of the world that it belongs to, -1 for a branch, (P,).
    :ivar row: of the forest for a branch, -1 for all else, (P,).
    :ivar part: of the scene for a standing brick, -1 for all else, (P,).
    """

    shape: np.ndarray
    pose: np.ndarray
    size: np.ndarray
    velocity: np.ndarray
    body: np.ndarray
    row: np.ndarray
    part: np.ndarray

    @classmethod
    def join(cls, tables: list['Obstacles']) -> 'Obstacles':
        """Put tables below each other."""
        return cls(*(np.concatenate(columns) for columns in zip(*tables)))

    @classmethod
    def none(cls) -> 'Obstacles':
        """Give a table without rows."""
        return cls._of(np.zeros(0, np.uint8), np.zeros((0, 7)), np.zeros((0, 3)),
                       np.zeros((0, 6)))

    @classmethod
    def _of(cls, shape: np.ndarray, pose: np.ndarray, size: np.ndarray, velocity: np.ndarray,
            body: np.ndarray | None = None, row: np.ndarray | None = None,
            part: np.ndarray | None = None) -> 'Obstacles':
        nothing = np.full(len(pose), -1, np.intp)
        return cls(np.asarray(shape, np.uint8), pose, size, velocity,
                   nothing if body is None else body, nothing if row is None else row,
                   nothing if part is None else part)

    def bounds(self, reach: float, margin: float) -> np.ndarray:
        """Give axis-aligned bounds, swept over a time [s], with a margin [m], (P, 6)."""
        return piece_bounds(self.shape, self.pose, self.size, self.velocity, reach, margin)


class Outlines:
    """
    Shapes of the bodies of a world, in columns that are kept from step to step.

    :param world: of these bodies.
    """

    def __init__(self, world: World):
        self._world = world
        self._known: dict[int, Pieces] = {}
        self._first, self._count = np.zeros((2, 0), np.intp)
        self._shape = np.zeros(0, np.uint8)
        self._local, self._size = np.zeros((0, 7)), np.zeros((0, 3))

    def of(self, ids: np.ndarray) -> Obstacles:
        """Cut bodies, (K,) ids, into their pieces, where these are now."""
        self._learn([b for b in ids.tolist() if self._known.get(b) is not self._world.pieces(b)])
        if not len(ids):
            return Obstacles.none()
        count = self._count[ids]
        owner = np.repeat(ids, count)
        piece = np.arange(len(owner)) + np.repeat(self._first[ids] - np.cumsum(count) + count,
                                                  count)
        poses, velocities = np.empty((len(owner), 7)), np.empty((len(owner), 6))
        bodies = self._world.bodies
        expand(bodies.poses, bodies.velocities, owner, self._local[piece], np.arange(len(owner)),
               poses, velocities)
        return Obstacles._of(self._shape[piece], poses, self._size[piece], velocities, owner)

    def _learn(self, ids: list[int]) -> None:
        """Append the pieces of bodies that are new, or that took the ids of others."""
        if not ids:
            return
        more = max(ids) + 1 - len(self._first)
        if more > 0:
            self._first = np.concatenate([self._first, np.zeros(more, np.intp)])
            self._count = np.concatenate([self._count, np.zeros(more, np.intp)])
        pieces = [self._world.pieces(body) for body in ids]
        self._known.update(zip(ids, pieces))
        count = np.array([len(p.shapes) for p in pieces])
        self._first[ids] = len(self._shape) + np.cumsum(count) - count
        self._count[ids] = count
        self._shape = np.concatenate([self._shape, *(p.shapes for p in pieces)], dtype=np.uint8,
                                     casting='unsafe')
        self._local = np.concatenate([self._local, *(p.local_poses for p in pieces)])
        self._size = np.concatenate([self._size, *(p.sizes for p in pieces)])


def of_branches(rows: np.ndarray, poses: np.ndarray, sizes: np.ndarray,
                velocities: np.ndarray) -> Obstacles:
    """Take branches as obstacles for others; arguments as of the forest."""
    return Obstacles._of(np.full(len(rows), Shape.CAPSULE), poses[rows], sizes[rows],
                         velocities[rows], row=np.asarray(rows, np.intp))


class Bricks:
    """
    Standing masonry, sorted into cells once.

    :param blueprint: all parts of the scene.
    :param buildings: what stands of it.
    """

    def __init__(self, blueprint: Blueprint, buildings: Buildings):
        self._buildings = buildings
        self._parts = np.flatnonzero(buildings.standing)
        self._all = Obstacles._of(
            blueprint.shape[self._parts], blueprint.poses[self._parts],
            blueprint.size[self._parts], np.zeros((len(self._parts), 6)), part=self._parts)
        bounds = self._all.bounds(0.0, 0.0)
        self._cell, self.cells = sorted_into_cells(bounds)

    def __len__(self) -> int:
        return len(self._parts)

    def within(self, bounds: np.ndarray) -> Obstacles:
        """List the bricks still standing in the cells that any of some boxes, (K, 6), reach."""
        _, cells = overlaps(bounds, self.cells)
        if not len(cells):
            return Obstacles.none()
        wanted = np.zeros(len(self.cells), bool)
        wanted[cells] = True
        rows = np.flatnonzero(wanted[self._cell] & self._buildings.standing[self._parts])
        body = self._buildings.body[self._parts[rows]]
        return Obstacles(*(column[rows] for column in self._all))._replace(body=body)


def sorted_into_cells(bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Sort boxes by their centres into cells of space.

    :param bounds: three minima, three maxima [m], (K, 6).
    :returns: cell of each box, (K,), and bounds of what is in each cell, (C, 6).
    """
    key = np.floor(0.5 * (bounds[:, :3] + bounds[:, 3:]) / _CELL).astype(np.int64)
    _, cell = np.unique(key, axis=0, return_inverse=True)
    count = int(np.max(cell, initial=-1)) + 1
    cells = np.hstack([np.full((count, 3), np.inf), np.full((count, 3), -np.inf)])
    np.minimum.at(cells[:, :3], cell, bounds[:, :3])
    np.maximum.at(cells[:, 3:], cell, bounds[:, 3:])
    return cell, cells


def meets_trees(world: World) -> np.ndarray:
    """List the bodies that branches may meet: all but what stands, (K,)."""
    state = world.bodies.state
    return np.flatnonzero((state == State.LOOSE) | (state == State.DRIVEN)
                          | (state == State.RESTING))
