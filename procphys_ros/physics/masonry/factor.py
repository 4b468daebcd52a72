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
Factor of a sparse matrix of 6 x 6 blocks.

L·D·Lᵀ by block columns. Elimination tree and rows of L after Liu 1990, SIAM J. Matrix Anal. Appl.
11(1); the ordering is SuperLU's minimum degree on the graph of the blocks.
"""

from collections.abc import Sequence
from typing import Self

import numpy as np
import scipy  # subpackages are imported on first use

from procphys_ros.compilation import kernel, subroutine

_SINGULAR = 1e-11  # pivot over the diagonal of the matrix, below which a motion is free


class Factor:
    """
    L·D·Lᵀ of a symmetric positive definite matrix, L unit lower triangular.

    Free motions, as of loose parts, are left out: their solution is zero.

    :param start, column: block pattern by rows, sorted, diagonal included, (n + 1,), (K,).
    :param blocks: all of the matrix, symmetric, (K, 6, 6).

    :ivar panels: arguments of `solve`: unknown of each column, start of its rows in L (n + 1,),
        these rows, the numbers there in single precision, and inverses of D. The numbers of a
        column are stored transposed, as six rows of the height of the column, for SIMD. Single
        precision halves the memory traffic; the solution is that of a nearby matrix, also
        symmetric and positive.
    """

    def __init__(self, start: np.ndarray, column: np.ndarray, blocks: np.ndarray):
        count = len(start) - 1
        pattern = scipy.sparse.csc_matrix((np.ones(len(column)), column, start),
                                          shape=(count, count))
        order = _ordering(pattern)
        self._rank = rank = np.empty(count, np.int64)
        rank[order] = np.arange(count)
        places = start.astype(np.int64), column.astype(np.int64)
        fill = _symbolic(*places, order, rank)
        below, rows = fill[:2]
        self.panels = (order, below, rows, np.zeros(36 * len(rows), np.float32),
                       np.zeros((count, 6, 6)))
        _factor(*places, blocks, rank, fill, self.panels)

    @classmethod
    def chained(cls, factors: Sequence['Factor']) -> Self:
        """Concatenate the factors of independent matrices."""
        factor = cls.__new__(cls)
        size = np.cumsum([0] + [len(each._rank) for each in factors])
        filled = np.cumsum([0] + [len(each.panels[2]) for each in factors])
        order, below, rows, numbers, inverse = zip(*(each.panels for each in factors))
        starts = _shifted([start[:-1] for start in below], filled)
        factor.panels = (
            _shifted(order, size), np.append(starts, filled[-1]),
            _shifted(rows, size), np.concatenate(numbers), np.concatenate(inverse))
        factor._rank = _shifted([each._rank for each in factors], size)
        return factor

    def reached(self, unknowns: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        List the columns reached from some unknowns: their own and their ancestors.

        With a right-hand side that is zero elsewhere, `solve` needs no others for their solution
        (Gilbert 1994, SIAM J. Matrix Anal. Appl. 15(1)).

        :param unknowns: of several sets, concatenated, (U,).
        :param start: start of the unknowns of each set, (S + 1,).
        :returns: columns of each set, ascending, and their starts, (S + 1,).
        """
        _, below, rows, _, _ = self.panels
        return _reached(unknowns, start, self._rank, below, rows)


def _shifted(columns: Sequence[np.ndarray], before: np.ndarray) -> np.ndarray:
    """Concatenate arrays of indices, each shifted by its offset."""
    return np.concatenate([column + start for column, start in zip(columns, before)])


def _ordering(pattern: 'scipy.sparse.csc_matrix') -> np.ndarray:
    """Compute a fill-reducing ordering: the block of each column of the factor, (n,)."""
    count = pattern.shape[0]
    pattern = pattern.copy()
    pattern.data[:] = -1.0
    pattern.setdiag(2.0 * count)
    lu = scipy.sparse.linalg.splu(pattern, permc_spec='MMD_AT_PLUS_A', diag_pivot_thresh=0.0,
                                  options={'SymmetricMode': True})
    return np.argsort(lu.perm_c, kind='stable')


@subroutine
def _elimination_tree(start, column, order, rank):
    """Compute the parent of each column: the first row below the diagonal of L; -1 = a root."""
    parent, ancestor = np.full(len(order), -1), np.full(len(order), -1)
    for i in range(len(order)):
        for k in range(start[order[i]], start[order[i] + 1]):
            j = rank[column[k]]
            while j != -1 and j < i:
                above = ancestor[j]
                ancestor[j] = i
                if above == -1:
                    parent[j] = i
                j = above
    return parent


@kernel(nogil=True)
def _symbolic(start, column, order, rank):
    """
    Compute the block pattern of L.

    :returns: start of each column (n + 1,), its rows ascending, and by rows: start (n + 1,),
        indices into the columns, and these columns.
    """
    count, parent = len(order), _elimination_tree(start, column, order, rank)
    below, across = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    mark = np.full(count, -1)
    for i in range(count):
        mark[i] = i
        for k in range(start[order[i]], start[order[i] + 1]):
            j = rank[column[k]]
            while j < i and mark[j] != i:
                mark[j] = i
                below[j + 1] += 1
                across[i + 1] += 1
                j = parent[j]
    for i in range(count):
        below[i + 1] += below[i]
        across[i + 1] += across[i]
    rows, place, owner = np.empty((3, below[-1]), np.int64)
    filled = below[:-1].copy()
    mark[:] = -1
    for i in range(count):
        mark[i] = i
        n = across[i]
        for k in range(start[order[i]], start[order[i] + 1]):
            j = rank[column[k]]
            while j < i and mark[j] != i:
                mark[j] = i
                rows[filled[j]] = i
                place[n], owner[n] = filled[j], j
                filled[j] += 1
                n += 1
                j = parent[j]
    return below, rows, across, place, owner


@kernel(nogil=True)
def _factor(start, column, blocks, rank, fill, panels):
    """Compute the columns of L and D one after the other."""
    below, rows, across, place, owner = fill
    order, _, _, single, inverse = panels
    lower, scaled = np.empty((2, len(rows), 6, 6))  # L and L·D
    total = np.zeros((len(order), 6, 6))
    other, left, at = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    for j in range(len(order)):
        begin, height = below[j], below[j + 1] - below[j]
        panel = single[36 * begin:36 * (begin + height)].reshape((6, 6 * height))
        for k in range(start[order[j]], start[order[j] + 1]):
            i = rank[column[k]]
            if i >= j:
                _turned(total[i], blocks[k])
        for r in range(6):
            at[r] = total[j, r, r]
        for t in range(across[j], across[j + 1]):
            first = place[t]
            _turned(other, scaled[first])
            _subtract(total[j], lower[first], other)
            for p in range(first + 1, below[owner[t] + 1]):
                _subtract(total[np.uint64(rows[p])], lower[p], other)
        _invert(total[j], at, inverse[j])
        total[j] = 0.0
        for p in range(below[j], below[j + 1]):
            i = np.uint64(rows[p])
            for r in range(6):
                for c in range(6):
                    scaled[p, r, c] = total[i, r, c]
                    total[i, r, c] = 0.0
            left[:] = 0.0
            _subtract(left, scaled[p], inverse[j])
            for r in range(6):
                for c in range(6):
                    lower[p, r, c] = -left[r, c]
                    panel[c, 6 * (p - begin) + r] = -left[r, c]


@subroutine
def _subtract(total, left, right):
    """Subtract a product of 6 x 6 matrices."""
    for r in range(6):
        a, b, c = left[r, 0], left[r, 1], left[r, 2]
        d, e, f = left[r, 3], left[r, 4], left[r, 5]
        for k in range(6):
            total[r, k] -= (a * right[0, k] + b * right[1, k] + c * right[2, k]
                            + d * right[3, k] + e * right[4, k] + f * right[5, k])


@subroutine
def _turned(out, matrix):
    """Write the transpose of a 6 x 6 matrix; slice assignments take seconds to compile."""
    for r in range(6):
        for c in range(6):
            out[r, c] = matrix[c, r]


@subroutine
def _invert(matrix, scale, out):
    """
    Invert a symmetric matrix by the sweep operator (Goodnight 1979, Am. Stat. 33(3)).

    :param scale: magnitude that pivots are compared with, (6,); rows of vanishing pivots become 0.
    """
    for r in range(6):
        for c in range(6):
            out[r, c] = matrix[r, c]
    free = np.zeros(6, np.bool_)
    for k in range(6):
        pivot = out[k, k]
        if pivot <= _SINGULAR * scale[k]:
            free[k] = True
            continue
        for r in range(6):
            if r != k and not free[r]:
                share = out[r, k] / pivot
                for c in range(6):
                    if c != k:
                        out[r, c] -= share * out[k, c]
        for r in range(6):
            out[r, k] /= -pivot
            out[k, r] /= pivot
        out[k, k] = 1.0 / pivot
    for k in range(6):
        if free[k]:
            out[k, :] = 0.0
            out[:, k] = 0.0


@kernel
def _reached(unknowns, start, rank, below, rows):
    """List the columns on the paths from unknowns to the roots of the elimination tree."""
    seen = np.full(len(rank), -1)
    columns, begin = np.empty(len(rank), np.int64), np.zeros(len(start), np.int64)
    for s in range(len(start) - 1):
        found = begin[s]
        for k in range(start[s], start[s + 1]):
            j = rank[unknowns[k]]
            while seen[j] != s:
                seen[j] = s
                found += 1
                if below[j] < below[j + 1]:
                    j = rows[below[j]]
        if found > len(columns):
            more = np.empty(2 * found, np.int64)
            more[:begin[s]] = columns[:begin[s]]
            columns = more
        found = begin[s]
        for j in range(len(rank)):
            if seen[j] == s:
                columns[found] = j
                found += 1
        begin[s + 1] = found
    return columns[:begin[-1]].copy(), begin


@kernel
def clear(panels, columns, b):
    """Set the unknowns of some columns to zero, see `solve`."""
    order = panels[0]
    for j in columns:
        b[order[j]] = 0.0


@kernel
def solve(panels, columns, b, work):
    """
    Solve L·D·Lᵀ x = b in place.

    :param panels: of `Factor`.
    :param columns: columns to solve for, ascending, see `Factor.reached`.
    :param b: right-hand side, overwritten by the solution, (n, 6).
    :param work: scratch, (n, 6).
    """
    order, below, rows, lower, inverse = panels
    highest = 0
    for j in columns:
        work[j] = b[order[j]]
        highest = max(highest, below[j + 1] - below[j])
    there = np.empty(6 * highest)
    for j in columns:
        begin, height = below[j], below[j + 1] - below[j]
        panel = lower[36 * begin:36 * (begin + height)].reshape((6, 6 * height))
        x0, x1, x2, x3, x4, x5 = work[j]
        for k in range(6 * height):
            there[k] = (panel[0, k] * x0 + panel[1, k] * x1 + panel[2, k] * x2
                        + panel[3, k] * x3 + panel[4, k] * x4 + panel[5, k] * x5)
        for p in range(height):
            i = np.uint64(rows[begin + p])
            for r in range(6):
                work[i, r] -= there[6 * p + r]
    for n in range(len(columns) - 1, -1, -1):
        j = columns[n]
        begin, height = below[j], below[j + 1] - below[j]
        panel = lower[36 * begin:36 * (begin + height)].reshape((6, 6 * height))
        for p in range(height):
            i = np.uint64(rows[begin + p])
            for r in range(6):
                there[6 * p + r] = work[i, r]
        y0, y1, y2, y3, y4, y5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(6 * height):
            x = there[k]
            y0 += panel[0, k] * x
            y1 += panel[1, k] * x
            y2 += panel[2, k] * x
            y3 += panel[3, k] * x
            y4 += panel[4, k] * x
            y5 += panel[5, k] * x
        own, y = work[j], b[order[j]]
        for r in range(6):
            v = inverse[j, r]
            y[r] = (v[0] * own[0] + v[1] * own[1] + v[2] * own[2]
                    + v[3] * own[3] + v[4] * own[4] + v[5] * own[5])
        y[0] -= y0
        y[1] -= y1
        y[2] -= y2
        y[3] -= y3
        y[4] -= y4
        y[5] -= y5
        work[j] = y
