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
Anchors: springs between segments of climbing plants and their hosts.

At rest an anchor carries its segment and those that hang on it up to the next anchors, so that
joints bend as little as on a real wall. It is a spring and damper between the centre of mass of
the segment and a point of the host, integrated implicitly like the springs of joints.
"""

from typing import Any, NamedTuple

import numpy as np

from procphys_ros.compilation import subroutine
from procphys_ros.geometry.linear import norm
from procphys_ros.physics.trees.spatial import INLINE

# Columns of `ForestState.anchor`: spring [N/m], damper [N·s/m], target point of the centre of mass
# [m], and force there [N]; without a spring, a constant force.
STIFFNESS, DAMPING, TARGET, FORCE, WIDTH = 0, 1, 2, 5, 8

# Rootlets hold by hairs that stretch by millimetres before they tear off the wall (estimate).
_GIVE = 0.005   # [m] displacement from rest at which an anchor fails
_RATIO = 0.3    # damping ratio of a segment on its anchor: leaves and rootlets rub (estimate)
_SHARE = 0.25   # of the stiffness m/dt², for stability of anchors on moving hosts: see `make`
_STEP = 1 / 60  # [s] time step of this bound


class Anchors(NamedTuple):
    """
    Anchored segments of climbing plants and their hosts.

    :ivar part: the segment, (K,).
    :ivar host: part that it grows on, (K,).
    :ivar strength: pull at which the anchor fails [N], (K,).
    """

    part: np.ndarray
    host: np.ndarray
    strength: np.ndarray

    @classmethod
    def none(cls) -> 'Anchors':
        """Return a table without rows."""
        return cls(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0))


def carried(parents: np.ndarray, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """
    Compute the weights that anchors carry at rest [N], (K, 3).

    :param parents: row of each row's parent, -1 for roots; parents come first, (S,).
    :param rows: anchored rows, (K,).
    :param weight: of each row [N], (S, 3).
    """
    if not len(rows):
        return weight[rows]
    total, held = weight.copy(), np.zeros(len(parents), bool)
    held[rows] = True
    for i in range(len(parents) - 1, -1, -1):
        if parents[i] >= 0 and not held[i]:
            total[parents[i]] += total[i]
    return total[rows]


def make(climbers: Anchors, parts: np.ndarray, parents: np.ndarray, mass: np.ndarray,
         gravity: np.ndarray) -> np.ndarray:
    """
    Build `ForestState.anchor` of all rows, without target points, (S, 8).

    A host that is a tree receives the force of the last step, which limits the stiffness that is
    stable.

    :param climbers: anchored segments and their hosts.
    :param parts: part of each row, (S,).
    :param parents: row of each row's parent, (S,).
    :param mass: of all rows [kg], (S,).
    :param gravity: [m/s²], (3,).
    """
    row = np.full(max(parts.max(initial=0), climbers.host.max(initial=0)) + 1, -1)
    row[parts] = np.arange(len(parts))
    rows, hosts = row[climbers.part], row[climbers.host]
    load = carried(parents, rows, mass[:, None] * gravity)
    out = np.zeros((len(mass), WIDTH))
    out[rows, FORCE:] = -load
    wooden = np.flatnonzero(hosts >= 0)
    np.add.at(out[:, FORCE:], hosts[wooden], load[wooden])
    stiffness = climbers.strength / _GIVE
    shared = np.bincount(hosts[wooden], minlength=len(mass))[hosts[wooden]]
    stiffness[wooden] = np.minimum(
        stiffness[wooden], _SHARE * mass[hosts[wooden]] / (shared * (_STEP * _STEP)))
    fall = float(norm(gravity))
    held = norm(load, axis=1) / fall if fall > 0.0 else mass[rows]
    out[rows, STIFFNESS] = stiffness
    out[rows, DAMPING] = 2.0 * _RATIO * np.sqrt(stiffness * held)
    return out


def forces(table: np.ndarray, places: np.ndarray) -> np.ndarray:
    """
    Compute the forces of anchors on segments, without dampers [N], (K, 3).

    :param table: rows of `ForestState.anchor`, (K, 8).
    :param places: centres of mass of the segments [m], (K, 3).
    """
    return table[:, FORCE:] - table[:, STIFFNESS, None] * (places - table[:, TARGET:FORCE])


def energy(table: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Compute the energy of anchors above that at their targets [J], (K,); see `forces`."""
    off = places - table[:, TARGET:FORCE]
    return (0.5 * table[:, STIFFNESS] * (off * off).sum(axis=1)
            - (table[:, FORCE:] * off).sum(axis=1))


def place(state: Any, table: np.ndarray, parents: np.ndarray) -> None:
    """
    Set the anchors of a forest, and mark the anchored trees; others skip anchors.

    :param state: `ForestState`.
    :param table: new `ForestState.anchor`, (S, 8).
    :param parents: row of each row's parent, -1 for roots; parents come first, (S,).
    """
    state.anchor[:] = table
    state.struck[:, 1] = 0.0
    anchored = (table[:, STIFFNESS] > 0.0) | table[:, FORCE:].any(axis=1)
    if anchored.any():
        root = np.arange(len(parents))
        for i in np.flatnonzero(parents >= 0):
            root[i] = root[parents[i]]
        state.struck[:, 1] = np.isin(root, root[anchored])


def cut(table: np.ndarray, rest: np.ndarray, rows: np.ndarray, hosts: np.ndarray) -> None:
    """
    Release segments, and remove their load from their hosts.

    :param table: `ForestState.anchor`, changed in place, (S, 8); `rest` the same at rest.
    :param rows: of the segments, (K,).
    :param hosts: rows of the host trees, -1 for walls, (K,).
    """
    wooden = hosts >= 0
    np.add.at(table[:, FORCE:], hosts[wooden], rest[rows[wooden], FORCE:])
    table[rows] = 0.0


@subroutine(**INLINE)
def pull(i, anchor, poses, h):
    """Compute the force of the anchor of row i at its present pose [N], and c + h·k."""
    k = anchor[i, 0]
    return (anchor[i, 5] - k * (poses[i, 0] - anchor[i, 2]),
            anchor[i, 6] - k * (poses[i, 1] - anchor[i, 3]),
            anchor[i, 7] - k * (poses[i, 2] - anchor[i, 4])), anchor[i, 1] + h * k


@subroutine(**INLINE)
def energy_between(i, anchor, x, y, z, poses):
    """Compute the energy of the anchor of row i at its pose above that at (x, y, z) [J]."""
    dx, dy, dz = poses[i, 0] - x, poses[i, 1] - y, poses[i, 2] - z
    k = 0.5 * anchor[i, 0]
    return (dx * (k * (poses[i, 0] + x - 2.0 * anchor[i, 2]) - anchor[i, 5])
            + dy * (k * (poses[i, 1] + y - 2.0 * anchor[i, 3]) - anchor[i, 6])
            + dz * (k * (poses[i, 2] + z - 2.0 * anchor[i, 4]) - anchor[i, 7]))
