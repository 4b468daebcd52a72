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
Holds: the anchors of climbing plants in a scene.

Each segment that clings (`Hinges.cling`) holds on to the nearest part of another object that
reaches to within `REACH` of its middle: a brick or beam of a wall, or a branch that is no climber.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint, Law, Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.touch import overlaps, piece_bounds
from procphys_ros.physics.trees import Anchors, Forest
from procphys_ros.scene import SceneObject
from procphys_ros.simulation.obstacles import Bricks

REACH = 0.1  # [m] from the middle of a segment to the surface that holds it


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


def find(blueprint: Blueprint, objects: Sequence[SceneObject], bricks: Bricks,
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


def place(forest: Forest, anchors: Anchors, row: np.ndarray) -> Climbers:
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
