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

from procphys_ros import rotation
from procphys_ros.blueprint import GROUND
from procphys_ros.scene import Scene
from procphys_ros.simulation import Cause, fragments, Simulation
from procphys_ros.wallgrammar import contacts

OVERLAP = 1e-3   # [m] deepest that two parts may reach into each other
_BUCKET = 0.5    # [m] side of the cubes that near parts share


def standing(blueprint):
    """Give a simulation of one building."""
    scene = Scene()
    scene.add(blueprint, (0.0, 0.0, 0.0), 0.0, 'house')
    return Simulation(scene)


def take_out(simulation, parts):
    """Let parts of walls vanish at once."""
    fragments.destroy(simulation.model, simulation.state, parts, Cause.DEMOLITION, 1.0)


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
    turn = rotation.to_matrix(blueprint.poses[:, 3:])
    half, centre = 0.5 * blueprint.size, blueprint.poses[:, :3]
    reach = (np.abs(turn) @ half[:, :, None])[:, :, 0]
    a, b = near_pairs(centre - reach, centre + reach).T
    apart = centre[b] - centre[a]
    depth = np.full(len(a), np.inf)
    axes = [turn[rows][:, :, i] for i in range(3) for rows in (a, b)]
    axes += [np.cross(turn[a][:, :, i], turn[b][:, :, j]) for i in range(3) for j in range(3)]
    for axis in axes:
        length = np.linalg.norm(axis, axis=1)
        unit = axis / np.maximum(length, 1e-9)[:, None]
        covered = sum((np.abs(np.einsum('nij,ni->nj', turn[rows], unit)) * half[rows]).sum(axis=1)
                      for rows in (a, b))
        here = covered - np.abs((apart * unit).sum(axis=1))
        depth = np.where(length > 1e-6, np.minimum(depth, here), depth)
    return depth.max(initial=0.0)
