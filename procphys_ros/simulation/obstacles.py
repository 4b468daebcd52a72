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
Obstacles: what branches, climbing plants and the wind find in their way.

Each segment that clings (`Hinges.cling`) holds on to the nearest part of another object that
reaches to within `REACH` of its middle: a brick or beam of a wall, or a branch that is no climber.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from procphys_ros.blueprint import Blueprint, Law, Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.terrain import FLAT, Terrain
from procphys_ros.physics.touch import overlaps, piece_bounds
from procphys_ros.physics.trees import Anchors, Forest
from procphys_ros.physics.wind import Shelter
from procphys_ros.physics.world import BodyState, expand, World
from procphys_ros.scene import SceneObject

_CELL = 2.0  # [m] edge of the cells of bricks
REACH = 0.1  # [m] from the middle of a segment to the surface that holds it


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


@dataclass(frozen=True)
class Climbers:
    """
    Anchors of climbing plants.

    :ivar anchors: pairs of held and holding parts, and their strengths.
    :ivar row: held row of the forest, (K,).
    :ivar host_row: holding row of the forest, -1 for a wall, (K,).
    :ivar place: of the middle of the segment at rest [m], world, or in the axes of a host branch,
        from its centre of mass, (K, 3).
    """

    anchors: Anchors
    row: np.ndarray
    host_row: np.ndarray
    place: np.ndarray


def find_holds(blueprint: Blueprint, objects: Sequence[SceneObject], bricks: Bricks,
               loaded: int) -> Anchors:
    """
    Find the anchors of climbing plants.

    Plants that join a running scene are anchored to walls that exist already; they do not add
    load to standing trees.

    :param objects: owners of the parts, in part order.
    :param bricks: all masonry.
    :param loaded: number of parts at the start.
    """
    wood = np.flatnonzero(blueprint.bond_law == Law.HINGE)
    child = blueprint.bonds[wood, 1]
    strength = np.zeros(len(blueprint))
    strength[child] = blueprint.hinges.cling
    part = np.flatnonzero(strength > 0.0)
    if not len(part):
        return Anchors.none()
    first = np.array([thing.first for thing in objects])
    owner = np.searchsorted(first, np.arange(len(blueprint)), side='right') - 1
    climbs = np.zeros(len(first), bool)
    climbs[owner[part]] = True
    branches = child[~climbs[owner[child]]]
    chosen, host = _near(blueprint, part, np.concatenate([bricks.parts, branches]))
    plant, branch = part[chosen], blueprint.shape[host] == Shape.CAPSULE
    there = host < np.maximum(loaded, first[owner[plant]])
    there[branch] &= (plant[branch] < loaded) & (host[branch] < loaded)
    chosen, host = chosen[there], host[there]
    far = _distance(blueprint, part[chosen], host)
    order = np.lexsort((host, far, chosen))
    order = order[far[order] < REACH]
    nearest = order[np.unique(chosen[order], return_index=True)[1]]
    return Anchors(part[chosen[nearest]], host[nearest], strength[part[chosen[nearest]]])


def place_holds(forest: Forest, anchors: Anchors, row: np.ndarray) -> Climbers:
    """
    Record the positions of anchors.

    :param forest: at rest.
    :param row: of each part in the forest, -1 for none, (N,).
    """
    rows, hosts = row[anchors.part], row[anchors.host]
    middle = forest.poses[rows, :3].copy()
    wooden = np.flatnonzero(hosts >= 0)
    pose = forest.poses[hosts[wooden]]
    middle[wooden] = rotation.rotate(rotation.conjugate(pose[:, 3:]),
                                     middle[wooden] - pose[:, :3])
    return Climbers(anchors, rows, hosts, middle)


def _near(blueprint: Blueprint, part: np.ndarray,
          host: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pair segments, by their places in `part`, with parts of nearby bounds."""
    point = blueprint.poses[part, :3]
    bounds = piece_bounds(blueprint.shape[host], blueprint.poses[host], blueprint.solid_size(host),
                          np.zeros((len(host), 6)), 0.0, 0.0)
    chosen, near = overlaps(np.hstack([point - REACH, point + REACH]), bounds)
    return chosen, host[near]


def _distance(blueprint: Blueprint, part: np.ndarray, host: np.ndarray) -> np.ndarray:
    """Return the distances of the middles of segments from the surfaces of parts [m], (K,)."""
    pose, half = blueprint.poses[host], 0.5 * blueprint.solid_size(host)
    local = rotation.rotate(rotation.conjugate(pose[:, 3:]),
                            blueprint.poses[part, :3] - pose[:, :3])
    round_ = blueprint.shape[host] == Shape.CAPSULE
    radius = np.where(round_, half[:, 0], 0.0)
    core = np.where(round_[:, None], [0.0, 0.0, 1.0], 1.0) * (half - radius[:, None])
    return norm(local - np.clip(local, -core, core), axis=1) - radius


def find_shelter(blueprint: Blueprint, objects: Sequence[SceneObject],
                 masonry: np.ndarray, terrain: Terrain = FLAT) -> Shelter:
    """
    Measure the sizes of trees and buildings.

    :param blueprint: all parts.
    :param objects: owners of the parts; each is one tree (or bush) or one building.
    :param masonry: whether each part is in a building, (N,) bool.
    :param terrain: the surface of the ground; heights are above it.
    """
    trees, buildings = [], []
    axes = np.abs(rotation.to_matrix(blueprint.poses[:, 3:]))
    reach = 0.5 * np.einsum('nij,nj->ni', axes, blueprint.visual_size)
    low, high = blueprint.poses[:, :3] - reach, blueprint.poses[:, :3] + reach
    high[:, 2] -= terrain.height(blueprint.poses)
    for own in objects:
        parts = slice(own.first, own.first + own.count)
        area, built = blueprint.leaf_area[parts], masonry[parts]
        if area.sum() > 0.0:
            leafy = area > 0.0
            middle = np.average(blueprint.poses[parts, :2], axis=0, weights=area)
            away = norm(blueprint.poses[parts, :2][leafy] - middle, axis=1)
            trees.append([*middle, high[parts, 2][leafy].max(), away.max(), area.sum()])
        elif built.any():
            buildings.append([*low[parts, :2][built].min(axis=0),
                              *high[parts][built].max(axis=0)])
    return Shelter(np.array(trees).reshape(-1, 5), np.array(buildings).reshape(-1, 5))
