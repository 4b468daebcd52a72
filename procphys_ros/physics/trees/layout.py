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


"""Layout: order the hinged parts of a blueprint into rows for the kernel."""

from dataclasses import dataclass

import numpy as np

from procphys_ros.blueprint import Blueprint, Hinges, Law
from procphys_ros.compilation import kernel
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.physics.air import CYLINDER_DRAG, FOLIAGE_DRAG, VOGEL_EXPONENT
from procphys_ros.physics.trees.breaks import section_modulus

# Columns of `Rows.body`, constants of a segment.
MASS, ACROSS, ALONG, REACH, LENGTH, CROSS_FLOW, LEAF_FLOW, VOGEL = range(8)
# Columns of `Rows.swing`, constants of its two bending degrees of freedom.
STIFFNESS, DAMPING, LIMIT, PRELOAD_X, PRELOAD_Y, YIELD, HARDENING = range(7)
# The next ones are those of sawn joints, see `breaks`.
# Columns of `Rows.extra`: the same for twist (first) and stretch (from EXTRA_STRIDE on).
EXTRA_STIFFNESS, EXTRA_DAMPING, EXTRA_PRELOAD, EXTRA_STRIDE = range(4)

_MISFIT = 1e-9  # [m] and [-], tolerance between the frames of a part and its joint


@dataclass
class Rows:
    """
    Constants of the forest, one row per segment in depth-first preorder.

    :ivar part: part index, (S,) int.
    :ivar bond: bond index, (S,) int.
    :ivar hinge: row in the blueprint's hinge table, (S,) int.
    :ivar parent: row of the parent, -1 for a clamped start, (S,) int.
    :ivar end: one past the last row of the subtree, (S,) int.
    :ivar axis: first row of the branch (axis) that the row belongs to, (S,) int.
    :ivar mount: joint frame in the parent's joint frame (world for a root) [m], (S, 7).
    :ivar body: see the column names above; SI, drag as force per speed squared, (S, 8).
    :ivar swing: see the column names above, (S, 11).
    :ivar extra: twist and stretch springs, inf where locked, (S, 6).
    :ivar width: diameter at the joint [m], (S,).
    """

    part: np.ndarray
    bond: np.ndarray
    hinge: np.ndarray
    parent: np.ndarray
    end: np.ndarray
    axis: np.ndarray
    mount: np.ndarray
    body: np.ndarray
    swing: np.ndarray
    extra: np.ndarray
    width: np.ndarray


def arrange(blueprint: Blueprint, air_density: float) -> Rows:
    """
    Arrange the parts that are children of hinges into rows.

    :param blueprint: a hinge on any other part counts as clamped.
    :param air_density: [kg/m³].
    :raises SceneError: when hinges do not form trees or a segment is not symmetric about them.
    """
    bond = np.flatnonzero(blueprint.bond_law == Law.HINGE)
    child = blueprint.bonds[bond, 1]
    hinge_of = np.full(len(blueprint) + 1, -1)  # the last entry stands for the ground
    hinge_of[child] = np.arange(len(bond))
    if len(np.unique(child)) < len(child) or (child < 0).any():
        raise SceneError('hinge bonds must name the parent first, and each part hangs on one '
                         'hinge only')
    order, parent, end = _preorder(hinge_of[blueprint.bonds[bond, 0]])
    part, bond = child[order], bond[order]
    frame = blueprint.bond_frame[bond]
    inner = rotation.relative(frame, blueprint.poses[part])
    inertia = blueprint.inertia[part]
    if (np.abs(inner[:, [0, 1, 3, 4, 5]]) > _MISFIT).any() or not np.allclose(
            inertia[:, 0], inertia[:, 1], rtol=_MISFIT):
        raise SceneError('a hinged part must be symmetric about the z axis of its joint')
    mount = np.where(parent[:, None] < 0, frame, rotation.relative(frame[parent], frame))
    width = blueprint.bond_extent[bond, 0]
    length = blueprint.visual_size[part, 2]
    body = np.column_stack([
        blueprint.mass[part], inertia[:, 0], inertia[:, 2], inner[:, 2], length,
        0.5 * air_density * CYLINDER_DRAG * blueprint.visual_size[part, :2].mean(axis=1) * length,
        0.5 * air_density * FOLIAGE_DRAG * blueprint.leaf_area[part],
        _vogel_exponents(blueprint)[part]])
    swing, extra = _springs(blueprint.hinges, order, section_modulus(width))
    return Rows(part, bond, order, parent, end, _axes(parent, width, frame), mount, body, swing,
                extra, width)


def set_damping(rows: Rows, rate: np.ndarray) -> None:
    """
    Set unspecified dampers, c = rate·k.

    :param rows: changed in place.
    :param rate: [s], (S,).
    """
    columns = [(rows.swing, STIFFNESS, DAMPING)]
    for start in (0, EXTRA_STRIDE):
        columns.append((rows.extra, start + EXTRA_STIFFNESS, start + EXTRA_DAMPING))
    for table, k, c in columns:
        stiffness = np.where(np.isinf(table[:, k]), 0.0, table[:, k])
        table[:, c] = np.where(np.isnan(table[:, c]), rate * stiffness, table[:, c])


def _springs(hinges: Hinges, order: np.ndarray,
             section: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    nothing = np.zeros(len(hinges))
    swing = np.column_stack([hinges.swing_stiffness, hinges.swing_damping, hinges.swing_limit,
                             nothing, nothing, hinges.yield_stress, hinges.hardening,
                             nothing, nothing, nothing, nothing])
    extra = np.column_stack([hinges.twist_stiffness, hinges.twist_damping, nothing,
                             hinges.stretch_stiffness, hinges.stretch_damping, nothing])
    swing, extra = swing[order], extra[order]
    swing[:, YIELD] *= section
    return swing, extra


def _vogel_exponents(blueprint: Blueprint) -> np.ndarray:
    """Compute the area-weighted mean Vogel exponent of the leaves on every part, (N,)."""
    leaves, area = blueprint.leaves, blueprint.leaves.size * blueprint.leaves.size
    total = np.bincount(leaves.part, area, len(blueprint))
    weighted = np.bincount(leaves.part, area * leaves.vogel, len(blueprint))
    return np.where(total > 0.0, weighted / np.maximum(total, 1e-300), VOGEL_EXPONENT)


def _preorder(parent: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sort hinges depth first; return their order, parent rows and subtree ends."""
    sequence, parents, end = _sort(parent)
    if len(sequence) < len(parent):
        raise SceneError(f'{len(parent) - len(sequence)} hinges form a ring; branches must be '
                         'trees')
    return sequence, parents, end


@kernel
def _sort(parent):
    """
    Sort what hangs on others depth first, siblings in their order.

    :param parent: that each hangs on, -1 = none, (K,).
    :returns: the order, shorter where there are rings; and, by places in it, parents and one past
        the last of those that hang on each.
    """
    first = np.zeros(len(parent) + 2, np.int64)  # child of each, of -1 first
    for i in range(len(parent)):
        first[parent[i] + 2] += 1
    for i in range(1, len(first)):
        first[i] += first[i - 1]
    child, filled = np.empty(len(parent), np.int64), first.copy()
    for i in range(len(parent)):
        child[filled[parent[i] + 1]] = i
        filled[parent[i] + 1] += 1
    order, stack = np.empty(len(parent), np.int64), np.empty(len(parent), np.int64)
    row, done, waiting, at = np.full(len(parent), -1), 0, 0, -1
    while True:
        for k in range(first[at + 2] - 1, first[at + 1] - 1, -1):
            stack[waiting] = child[k]
            waiting += 1
        if waiting == 0:
            break
        waiting -= 1
        at = stack[waiting]
        order[done], row[at] = at, done
        done += 1
    parents, end = np.full(done, -1), np.arange(1, done + 1)
    for i in range(done - 1, -1, -1):
        up = parent[order[i]]
        if up >= 0:
            parents[i] = row[up]
            end[row[up]] = max(end[row[up]], end[i])
    return order[:done], parents, end


def _axes(parent: np.ndarray, width: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Find the axis of each row: the widest child, then the straightest, continues an axis."""
    direction = rotation.rotate(frame[:, 3:], np.array([0.0, 0.0, 1.0]))
    straight = np.einsum('ij,ij->i', direction, direction[parent])
    best = np.lexsort((-straight, -width, parent))
    best = best[parent[best] >= 0]
    heir = best[np.unique(parent[best], return_index=True)[1]]
    follows = np.zeros(len(parent), bool)
    follows[heir] = True
    axis = np.arange(len(parent))
    for i in np.flatnonzero(follows):
        axis[i] = axis[parent[i]]
    return axis
