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


"""Friction impulses that an engine does not report, from the momentum balance of bodies."""

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from procphys_ros.compilation import kernel, subroutine

_REGULAR = 1e-6  # share of the largest entry, for bodies that only touch each other


def friction(ids: np.ndarray, impulse: np.ndarray, normal: np.ndarray, mass: np.ndarray,
             change: np.ndarray) -> np.ndarray:
    """
    Share out among contacts what the momenta of bodies lack, the least that does it.

    Least squares weighed by the normal impulses: W Aᵀ (A W Aᵀ)⁻¹ r, with A the incidence of
    contacts and bodies, and r the change of momentum beyond gravity and normal impulses.

    :param ids: of the two bodies of each contact, (2, C).
    :param impulse: along the normals, on the first bodies [N·s], (C, 3).
    :param normal: the same without direction [N·s], (C,).
    :param mass: of all bodies [kg], 0 for those that nothing moves, (B,).
    :param change: of their velocities beyond gravity [m/s], (B, 3).
    :returns: on the first bodies [N·s], (C, 3).
    """
    pressed = np.zeros(len(mass), bool)
    pressed[ids[:, normal > 0.0]] = True
    moved = np.flatnonzero(pressed & (mass > 0.0))
    if not len(moved):
        return np.zeros_like(impulse)
    row = np.full(len(mass), -1)
    row[moved] = np.arange(len(moved))
    sides, normal = np.ascontiguousarray(row[ids]), np.ascontiguousarray(normal)
    start, column, weight, pushed = _weigh(sides, normal, impulse, len(moved))
    matrix = csc_matrix((weight, column, start), (len(moved), len(moved)))
    lacking = mass[moved, None] * change[moved] - pushed
    return _share(sides, normal, np.ascontiguousarray(splu(matrix).solve(lacking)))


@kernel
def _weigh(sides, normal, impulse, count):
    """
    Give A W Aᵀ by columns, each with its rows ascending, and what the normal impulses push.

    :param sides: row of the two bodies of each contact, -1 for what nothing moves, (2, C).
    :param count: of the rows.
    :returns: first entry of each column, row and value of each entry, sums of impulses (R, 3).
    """
    first, contact, pushed = _by_row(sides, normal, impulse, count)
    start, end = np.zeros(count + 1, np.int32), 0
    other, weight = np.empty(len(contact) + count, np.int32), np.empty(len(contact) + count)
    total, own = np.zeros(count), np.empty(count, np.int32)
    for i in range(count):
        other[end] = i
        end += 1
        for c in contact[first[i]:first[i + 1]]:
            j = sides[0, c] + sides[1, c] - i
            total[i] += normal[c]
            if j >= 0:
                if total[j] == 0.0:
                    other[end] = j
                    end += 1
                total[j] -= normal[c]
        other[start[i]:end].sort()
        for at in range(start[i], end):
            if other[at] == i:
                own[i] = at
            weight[at], total[other[at]] = total[other[at]], 0.0
        start[i + 1] = end
    weight[own] += _REGULAR * weight[own].max()
    return start, other[:end], weight[:end], pushed


@subroutine
def _by_row(sides, normal, impulse, count):
    """List the pressing contacts of each row, ascending, and sum up their impulses on it."""
    first, pushed = np.zeros(count + 1, np.int32), np.zeros((count, 3))
    for c in range(len(normal)):
        for side in range(2):
            i = sides[side, c]
            if i >= 0 and normal[c] > 0.0:
                first[i + 1] += 1
                for k in range(3):
                    pushed[i, k] += (1.0 - 2.0 * side) * impulse[c, k]
    for i in range(count):
        first[i + 1] += first[i]
    contact, place = np.empty(first[-1], np.int32), first[:-1].copy()
    for c in range(len(normal)):
        for side in range(2):
            i = sides[side, c]
            if i >= 0 and normal[c] > 0.0:
                contact[place[i]] = c
                place[i] += 1
    return first, contact, pushed


@kernel
def _share(sides, normal, solution):
    """Give W Aᵀ times a solution, (C, 3)."""
    out = np.zeros((len(normal), 3))
    for c in range(len(normal)):
        one, two = sides[0, c], sides[1, c]
        low, high = min(one, two), max(one, two)
        for i in (low, high):
            if i >= 0 and normal[c] > 0.0:
                weight = normal[c] if i == one else -normal[c]
                for k in range(3):
                    out[c, k] += weight * solution[i, k]
    return out
