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

"""Overlaps of the bodies of a world by the geometry of their shapes, whatever the engine knows."""

import numpy as np

from procphys_ros.blueprint import Shape
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners, faces
from procphys_ros.physics.touch import overlaps
from procphys_ros.physics.world import BodyState, World

_EDGES = np.array([(c, c | bit) for bit in (1, 2, 4) for c in range(8) if not c & bit])


def solid_corners(world: World, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of all boxes and hexahedra of bodies, (P, 8, 3), and their bodies."""
    found = [world.pieces(body) for body in ids.tolist()]
    size = np.concatenate([own.sizes for own in found])
    corners = box_corners(-0.5 * size, 0.5 * size)
    count = np.array([len(own.shapes) for own in found])
    for first, own in zip(np.cumsum(count) - count, found):
        corners[first + own.hexahedra.part] = own.hexahedra.corners.reshape(-1, 8, 3)
    owner = np.repeat(ids, count)
    poses = rotation.compose(world.poses(owner), np.concatenate([p.local_poses for p in found]))
    corners = poses[:, None, :3] + rotation.rotate(poses[:, None, 3:], corners)
    solid = np.concatenate([own.shapes for own in found]) == Shape.BOX
    return corners[solid], owner[solid]


def least_depth(axes: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Compute the least overlap of the shadows of pairs of solids along axes (K, A, 3), (K,)."""
    length = np.linalg.norm(axes, axis=2)
    first, second = (np.einsum('kac,kpc->kap', axes, points) for points in (one, two))
    depth = np.minimum(first.max(axis=2) - second.min(axis=2),
                       second.max(axis=2) - first.min(axis=2))
    return np.where(length > 1e-9, depth / np.maximum(length, 1e-9), np.inf).min(axis=1)


def depth_between(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Compute the overlap depth of pairs of convex hexahedra by separating axes [m], (K,)."""
    depth = least_depth(np.concatenate([faces(one)[1], faces(two)[1]], axis=1), one, two)
    rows = np.flatnonzero(depth > 0.0)
    for some in np.array_split(rows, len(rows) // 500 + 1):
        u, v = (points[some][:, _EDGES[:, 1]] - points[some][:, _EDGES[:, 0]]
                for points in (one, two))
        u, v = (edges / np.maximum(np.linalg.norm(edges, axis=2, keepdims=True), 1e-9)
                for edges in (u, v))
        axes = np.cross(u[:, :, None], v[:, None]).reshape(-1, 144, 3)
        depth[some] = np.minimum(depth[some], least_depth(axes, one[some], two[some]))
    return np.maximum(depth, 0.0)


def deepest_overlap(world: World, awake: bool = True) -> float:
    """
    Measure how deep loose bodies reach into anything else or into level ground [m].

    By the geometry of the shapes alone, independent of the engine's contacts; round shapes are
    ignored.

    :param awake: whether moving bodies count, too.
    """
    state = world.bodies.state
    counts = (BodyState.FIXED, BodyState.RESTING, *(BodyState.AWAKE, BodyState.KINEMATIC) * awake)
    ids = np.flatnonzero(np.isin(state, counts))
    if not len(ids):
        return 0.0
    corners, owner = solid_corners(world, ids)
    bounds = np.column_stack([corners.min(axis=1), corners.max(axis=1)])
    loose = np.flatnonzero(state[owner] != BodyState.FIXED)
    one, two = overlaps(bounds[loose], bounds)
    one = loose[one]
    pair = (owner[one] != owner[two]) & ((state[owner[two]] == BodyState.FIXED) | (one < two))
    between = depth_between(corners[one[pair]], corners[two[pair]])
    return float(max(between.max(initial=0.0), -corners[loose, :, 2].min(initial=0.0)))
