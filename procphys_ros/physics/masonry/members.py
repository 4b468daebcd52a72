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


"""Reinforced members: the largest bending moment of their pieces, also between joints."""

from typing import NamedTuple

import numpy as np

from procphys_ros.geometry.linear import cross, norm

_STRAIGHT = 0.99  # least cosine between the normals of two joints and the line between them


class MemberPieces(NamedTuple):
    """
    Pieces of members seen from each of their two joints, a row per joint and piece.

    :ivar near, far: rows of the bonds at the near and at the far end of the piece.
    :ivar near_sign, far_sign: 1 where the piece is the first part of that bond, else -1.
    """

    near: np.ndarray
    far: np.ndarray
    near_sign: np.ndarray
    far_sign: np.ndarray


def pieces(rows: np.ndarray, pair: tuple[np.ndarray, np.ndarray], count: int,
           centroid: np.ndarray, axes: np.ndarray) -> MemberPieces:
    """
    Find the parts that lie in line between two reinforced bonds.

    :param rows: reinforced bonds, (K,).
    :param pair: first and second parts of all bonds, `count` for the ground, (M,) each.
    :param count: of the parts.
    :param centroid: of the bonds [m], (M, 3).
    :param axes: of the bonds, columns, (M, 3, 3).
    """
    part = np.concatenate([side[rows] for side in pair])
    bond = np.tile(rows, 2)
    sign = np.repeat([1.0, -1.0], len(rows))
    order = np.argsort(part, kind='stable')
    order = order[part[order] < count]
    part, bond, sign = part[order], bond[order], sign[order]
    found = []
    for step in range(1, int(np.bincount(part).max(initial=1))):
        one = np.flatnonzero(part[step:] == part[:-step])
        way = centroid[bond[one + step]] - centroid[bond[one]]
        way /= np.maximum(norm(way, axis=1, keepdims=True), 1e-12)
        straight = [np.abs((axes[bond[at], :, 2] * way).sum(axis=1)) > _STRAIGHT
                    for at in (one, one + step)]
        one = one[straight[0] & straight[1]]
        found += [(one, one + step), (one + step, one)]
    near, far = (np.concatenate([pair[k] for pair in found] or [np.zeros(0, np.intp)])
                 for k in range(2))
    return MemberPieces(bond[near], bond[far], sign[near], sign[far])


def with_largest_moments(within: MemberPieces, alive: np.ndarray, centroid: np.ndarray,
                         axes: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """
    Return the wrenches of bonds with the largest moments of the half pieces beside them.

    Shear varies linearly along a piece, so its moment is a parabola through the moments at both
    joints, with a curvature from the difference of their shear forces. A peak inside the piece
    is assigned to the nearer joint, which has the same section and strength.

    :param within: from `pieces`.
    :param alive: bonds that still carry load, (M,) bool.
    :param centroid: of the bonds [m], (M, 3).
    :param axes: of the bonds, columns, (M, 3, 3).
    :param wrench: force and moment in the bond frame [N, N·m], (M, 6).
    :returns: the same, with the peak moment in the rows of joints where it is larger, (M, 6).
    """
    whole = alive[within.near] & alive[within.far]
    whole[whole] = (wrench[within.near[whole]].any(axis=1)
                    | wrench[within.far[whole]].any(axis=1))
    near, far = within.near[whole], within.far[whole]
    if not len(near):
        return wrench
    start, end = within.near_sign[whole, None], within.far_sign[whole, None]
    way = centroid[far] - centroid[near]
    pull = (start * np.einsum('kij,kj->ki', axes[near], wrench[near, :3])
            + end * np.einsum('kij,kj->ki', axes[far], wrench[far, :3]))
    first = -start * np.einsum('kij,kj->ki', axes[near], wrench[near, 3:])
    last = end * np.einsum('kij,kj->ki', axes[far], wrench[far, 3:])
    bow = -0.5 * cross(way, pull)
    rise, bow, first = (np.einsum('kji,kj->ki', axes[near], moment)[:, :2]
                        for moment in (last - first - bow, bow, first))
    with np.errstate(divide='ignore', invalid='ignore'):
        place = -0.5 * rise / bow
    inside = (place > 0.0) & (place <= 0.5)
    peak = np.where(inside, first - 0.25 * (rise * rise) / np.where(inside, bow, 1.0), 0.0)
    out = wrench.copy()
    for axis in range(2):
        grown = np.abs(out[:, 3 + axis])
        np.maximum.at(grown, near, np.abs(peak[:, axis]))
        out[:, 3 + axis] = np.copysign(grown, out[:, 3 + axis])
    return out
