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
Solving with the Cholesky factor of a sparse matrix, many columns at a time.

SuperLU orders and factors. Its columns are then gathered into supernodes, which have (nearly) the
same rows, so that a solve runs over dense panels instead of scattering each number by itself
(Ng and Peyton 1993, SIAM J. Sci. Comput. 14(5)).
"""

from dataclasses import dataclass

from numba import njit
import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

_WIDEST = 48  # columns of a supernode
_PADDING = 1.5  # numbers stored over numbers that are not zero, to which columns are joined


@dataclass(frozen=True)
class Factor:
    """
    L·D·Lᵀ of a symmetric positive definite matrix, L unit lower triangular.

    :ivar panels: arguments of `solve`: first column of each supernode (S + 1,), start of its rows
        below the diagonal block (S + 1,), these rows, start of its values (S + 1,), the values
        (of each column: diagonal block, then rows below), the diagonal of D, and the unknown
        that each column stands for.
    :ivar component: island of each supernode, (S,).
    :ivar component_of: island of each unknown, (n,).
    """

    panels: tuple
    component: np.ndarray
    component_of: np.ndarray

    @classmethod
    def of(cls, matrix: csc_matrix) -> 'Factor':
        """
        Factor a matrix.

        :raises FloatingPointError: when it is not positive definite.
        """
        lu = splu(matrix, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0,
                  options={'SymmetricMode': True})
        if np.any(lu.perm_r != lu.perm_c):
            raise FloatingPointError('the matrix is not positive definite')
        lower = lu.L
        lower.sort_indices()
        source = np.argsort(lu.perm_r)
        gathered = _gather(lower.indptr, lower.indices, lower.data)
        component = connected_components(matrix, directed=False)[1]
        return cls((*gathered, lu.U.diagonal(), source), component[source[gathered[0][:-1]]],
                   component)

    def supernodes(self, unknowns: np.ndarray) -> np.ndarray:
        """List the supernodes that right-hand sides on some unknowns can reach, ascending."""
        wanted = np.zeros(len(self.component_of), bool)
        wanted[self.component_of[unknowns]] = True
        return np.flatnonzero(wanted[self.component])


@njit(cache=True)
def _gather(start, row, value):
    """
    Join columns of L, given with its diagonal, into supernodes.

    A column joins those before it when it is the next row of theirs and few zeros are added.
    """
    count = len(start) - 1
    first, row_start = np.empty(count + 1, np.int64), np.empty(count + 1, np.int64)
    rows = np.empty(len(row), np.int64)
    below, joined = np.empty(count, np.int64), np.empty(count, np.int64)
    made, filled, length, numbers = 0, 0, 0, 0
    for c in range(count + 1):
        fits = False
        if c < count and c > 0:
            own = row[start[c] + 1:start[c + 1]]
            width = c - first[made] + 1
            if length and below[0] == c and width <= _WIDEST:
                union = _union(below[1:length], own, joined)
                fits = width * (union + 0.5 * width) <= _PADDING * (numbers + len(own))
            if fits:
                below, joined, length = joined, below, union
                numbers += len(own) + width
                continue
        if c > 0:  # the supernode ends here
            row_start[made] = filled
            rows[filled:filled + length] = below[:length]
            filled += length
            made += 1
        if c < count:
            length = start[c + 1] - start[c] - 1
            below[:length] = row[start[c] + 1:start[c + 1]]
            numbers = length + 1
        first[made], row_start[made] = c, filled
    first, row_start = first[:made + 1].copy(), row_start[:made + 1].copy()
    width, height = np.diff(first), np.diff(row_start)
    value_start = np.zeros(made + 1, np.int64)
    value_start[1:] = np.cumsum(width * (width + height))
    values = _fill(first, row_start, rows, value_start, start, row, value)
    return first, row_start, rows[:filled].copy(), value_start, values


@njit(cache=True)
def _union(left, right, out):
    """Merge two ascending lists; return the length of the result."""
    i, j, filled = 0, 0, 0
    while i < len(left) or j < len(right):
        if j == len(right) or (i < len(left) and left[i] < right[j]):
            out[filled] = left[i]
            i += 1
        else:
            if i < len(left) and left[i] == right[j]:
                i += 1
            out[filled] = right[j]
            j += 1
        filled += 1
    return filled


@njit(cache=True)
def _fill(first, row_start, rows, value_start, start, row, value):
    values = np.zeros(value_start[-1])
    place = np.empty(len(start), np.int64)
    for s in range(len(first) - 1):
        left, right = first[s], first[s + 1]
        width = right - left
        for k in range(row_start[s], row_start[s + 1]):
            place[rows[k]] = width + k - row_start[s]
        height = width + row_start[s + 1] - row_start[s]
        for c in range(left, right):
            place[c] = c - left
        for c in range(left, right):
            for k in range(start[c] + 1, start[c + 1]):
                values[value_start[s] + (c - left) * height + place[row[k]]] = value[k]
    return values


@njit(cache=True)
def clear(panels, supernodes, b):
    """Zero the unknowns of some supernodes, see `solve`."""
    first, source = panels[0], panels[6]
    for s in supernodes:
        for c in range(first[s], first[s + 1]):
            b[source[c]] = 0.0


@njit(cache=True, fastmath=True)
def solve(panels, supernodes, b, work):
    """
    Solve L·D·Lᵀ x = b in place.

    :param panels: of `Factor`.
    :param supernodes: to work on, ascending: whole islands.
    :param b: right-hand side, overwritten by the solution, (n,).
    :param work: scratch, (n,).
    """
    first, row_start, rows, value_start, values, pivot, source = panels
    part = np.empty(len(work))
    for s in supernodes:
        for c in range(first[s], first[s + 1]):
            work[c] = b[source[c]]
    for s in supernodes:
        left, width = first[s], first[s + 1] - first[s]
        below = rows[row_start[s]:row_start[s + 1]]
        part[:width] = work[left:left + width]
        part[width:width + len(below)] = 0.0
        _descend(values[value_start[s]:value_start[s + 1]], width, len(below), part)
        work[left:left + width] = part[:width]
        for k in range(len(below)):
            work[np.uint64(below[k])] += part[width + k]
    for n in range(len(supernodes) - 1, -1, -1):
        s = supernodes[n]
        left, width = first[s], first[s + 1] - first[s]
        below = rows[row_start[s]:row_start[s + 1]]
        for c in range(width):
            part[c] = work[left + c] / pivot[left + c]
        for k in range(len(below)):
            part[width + k] = work[np.uint64(below[k])]
        _ascend(values[value_start[s]:value_start[s + 1]], width, len(below), part)
        for c in range(width):
            work[left + c] = part[c]
            b[source[left + c]] = part[c]


@njit(cache=True, fastmath=True)
def _descend(values, width, height, part):
    """Solve with the diagonal block of L, and take its share from what is below."""
    total = width + height
    for c in range(width):
        _subtract(part[c + 1:total], values[c * total + c + 1:(c + 1) * total], part[c])


@njit(cache=True, fastmath=True)
def _ascend(values, width, height, part):
    """Solve with the transposed diagonal block, given what is below."""
    total = width + height
    for c in range(width - 1, -1, -1):
        part[c] -= _product(part[c + 1:total], values[c * total + c + 1:(c + 1) * total])


@njit(cache=True, fastmath=True)
def _subtract(out, column, factor):
    for k in range(len(out)):
        out[k] -= factor * column[k]


@njit(cache=True, fastmath=True)
def _product(left, right):
    total = 0.0
    for k in range(len(left)):
        total += left[k] * right[k]
    return total
