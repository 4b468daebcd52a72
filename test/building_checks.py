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

"""What holds for every building, and what is done to buildings in several tests."""

import numpy as np

from procphys_ros.blueprint import GROUND
from procphys_ros.geometry import rotation
from procphys_ros.geometry.hexahedron import box_corners, FACES, faces, volumes
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.simulation import breaking, Cause, Simulation
from procphys_ros.wallgrammar import contacts

OVERLAP = 1e-3   # [m] deepest that two parts may reach into each other
_EDGES = np.array([[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5],
                   [2, 6], [3, 7]])  # of solids with eight corners
_FLAT = 1e-5  # of a solid's size: how far a corner may stick out of a face
_BUCKET = 0.5    # [m] side of the cubes that near parts share


def standing(blueprint):
    """Make a simulation of one building, with the quick engine: a standing one needs no other."""
    scene = Scene(Settings(engine='native'))
    scene.add(blueprint, (0.0, 0.0, 0.0), 0.0, 'house')
    return Simulation(scene)


def take_out(simulation, parts):
    """Remove parts of walls at once."""
    breaking.destroy(simulation.model, simulation.state, parts, Cause.DEMOLITION, 1.0)


def count_loose(blueprint):
    """Count the parts that no chain of bonds joins to the ground."""
    reached = np.zeros(len(blueprint) + 1, bool)
    reached[GROUND] = True
    first, second = blueprint.bonds.T
    while True:
        meets = reached[first] != reached[second]
        if not meets.any():
            return int((~reached).sum())
        reached[first[meets]] = reached[second[meets]] = True


def near_pairs(low, high):
    """Pair boxes whose bounds overlap, through cubes of space that they share, (n, 2)."""
    first = np.floor(low / _BUCKET).astype(int)
    size = np.floor(high / _BUCKET).astype(int) - first + 1
    row, step = contacts.spread(size.prod(axis=1))
    cube = first[row] + np.column_stack([
        step // (size[row, 1] * size[row, 2]), step // size[row, 2] % size[row, 1],
        step % size[row, 2]])
    key = np.unique(cube, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(key, kind='stable')
    key, row = key[order], row[order]
    left, step = contacts.spread(np.searchsorted(key, key, 'right') - np.arange(len(key)) - 1)
    pairs = np.sort(np.column_stack([row[left], row[left + 1 + step]]), axis=1)
    a, b = pairs.T
    meet = ((low[a] < high[b] - OVERLAP) & (low[b] < high[a] - OVERLAP)).all(axis=1)
    return np.unique(pairs[meet], axis=0)


def deepest_overlap(blueprint):
    """Measure how deep parts reach into each other, by separating axes [m]."""
    points = corners_of(blueprint)
    pairs = near_pairs(points.min(axis=1), points.max(axis=1))
    cut = np.isin(pairs, blueprint.hexahedra.part).any(axis=1)
    turn = rotation.to_matrix(blueprint.poses[:, 3:])
    boxes = turn.transpose(0, 2, 1)
    depth = _depth(points, pairs[~cut], (boxes, boxes))
    rows = blueprint.hexahedra.part
    if cut.any():
        index = np.zeros(len(blueprint), int)
        solids = np.union1d(rows, pairs[cut])
        index[solids] = np.arange(len(solids))
        normals = faces(points[solids])[1]
        edges = points[solids][:, _EDGES[:, 1]] - points[solids][:, _EDGES[:, 0]]
        depth = np.append(depth, _depth(points[solids], index[pairs[cut]], (normals, edges)))
    return depth.max(initial=0.0)


def corners_of(blueprint):
    """Return the corners of all parts, (N, 8, 3)."""
    half = 0.5 * blueprint.size
    points = blueprint.poses[:, None, :3] + rotation.rotate(
        blueprint.poses[:, None, 3:], box_corners(-half, half))
    points[blueprint.hexahedra.part] = blueprint.hexahedra.points(blueprint.poses)
    return points


def _depth(points, pairs, directions):
    """Measure how deep pairs of solids reach into each other, (n,), by normals and edges."""
    a, b = pairs.T
    normals, edges = directions
    depth = np.full(len(pairs), np.inf)
    axes = [*normals[a].transpose(1, 0, 2), *normals[b].transpose(1, 0, 2)]
    axes += [np.cross(edges[a, i], edges[b, j]) for i in range(edges.shape[1])
             for j in range(edges.shape[1])]
    for axis in axes:
        length = np.linalg.norm(axis, axis=1)
        unit = axis / np.maximum(length, 1e-9)[:, None]
        first, second = (np.einsum('nck,nk->nc', points[rows], unit) for rows in (a, b))
        here = np.minimum(first.max(axis=1) - second.min(axis=1),
                          second.max(axis=1) - first.min(axis=1))
        depth = np.where(length > 1e-6, np.minimum(depth, here), depth)
    return depth


def are_convex(corners: np.ndarray) -> np.ndarray:
    """Mark the hexahedra, (N, 8, 3), with a volume, flat faces and no dents, (N,) bool."""
    _, normal, middle = faces(corners)
    size = np.ptp(corners, axis=1).max(axis=1)
    out = np.einsum('nfk,nfck->nfc', normal, corners[:, None] - middle[:, :, None])
    flat = np.abs(np.take_along_axis(out, np.broadcast_to(FACES, (*out.shape[:2], 4)), 2))
    limit = _FLAT * size
    return ((volumes(corners)[0] > _FLAT * size ** 3)
            & (out.max(axis=(1, 2)) < limit) & (flat.max(axis=(1, 2)) < limit))
