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

"""Linear algebra of small matrices inside kernels; `linear` has the same for arrays."""

import math

import numpy as np

from procphys_ros.compilation import subroutine

_SWEEPS = 50  # of Jacobi's method, which needs less than ten for 3 by 3


@subroutine
def dot(a, b):
    """Return the inner product of two vectors."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@subroutine
def transformed(matrix, v):
    """Multiply a matrix with a vector."""
    out = np.zeros(matrix.shape[0])
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            out[i] += matrix[i, j] * v[j]
    return out


@subroutine
def transformed_back(matrix, v):
    """Multiply the transpose of a matrix with a vector."""
    out = np.zeros(matrix.shape[1])
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            out[j] += matrix[i, j] * v[i]
    return out


@subroutine
def product(a, b):
    """Multiply two matrices."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            for k in range(b.shape[1]):
                out[i, k] += a[i, j] * b[j, k]
    return out


@subroutine
def _eliminate(a, right):
    """Solve a x = right for the columns of right, in place (Gauss & Jordan, partial pivoting)."""
    n = len(a)
    for c in range(n):
        best = c
        for i in range(c + 1, n):
            if abs(a[i, c]) > abs(a[best, c]):
                best = i
        if best != c:
            for k in range(n):
                a[c, k], a[best, k] = a[best, k], a[c, k]
            for k in range(right.shape[1]):
                right[c, k], right[best, k] = right[best, k], right[c, k]
        for i in range(n):
            if i != c:
                share = a[i, c] / a[c, c]
                for k in range(c, n):
                    a[i, k] -= share * a[c, k]
                for k in range(right.shape[1]):
                    right[i, k] -= share * right[c, k]
    for c in range(n):
        for k in range(right.shape[1]):
            right[c, k] /= a[c, c]


@subroutine
def inverse(matrix):
    """Invert a square matrix; divides by zero if it is singular."""
    out = np.eye(len(matrix))
    _eliminate(matrix.copy(), out)
    return out


@subroutine
def solve(matrix, right):
    """Solve matrix x = right for a vector; divides by zero if the matrix is singular."""
    out = np.empty((len(right), 1))
    for i in range(len(right)):
        out[i, 0] = right[i]
    _eliminate(matrix.copy(), out)
    return out[:, 0].copy()


@subroutine
def _turn(a, vectors, p, q):
    """Turn a symmetric matrix so that its element (p, q) vanishes (Jacobi 1846)."""
    lean = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    t = 1.0 / (abs(lean) + math.sqrt(1.0 + lean * lean))
    if lean < 0.0:
        t = -t
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = t * c
    for k in range(len(a)):
        a[k, p], a[k, q] = c * a[k, p] - s * a[k, q], s * a[k, p] + c * a[k, q]
    for k in range(len(a)):
        a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
        vectors[k, p], vectors[k, q] = (c * vectors[k, p] - s * vectors[k, q],
                                        s * vectors[k, p] + c * vectors[k, q])
    a[p, q] = a[q, p] = 0.0


@subroutine
def diagonalise(matrix):
    """Return eigenvalues of a symmetric matrix in rising order, and eigenvectors as columns."""
    a, vectors = matrix.copy(), np.eye(len(matrix))
    n = len(a)
    for _ in range(_SWEEPS):
        turned = False
        for p in range(n - 1):
            for q in range(p + 1, n):
                if abs(a[p, q]) > 1e-17 * (abs(a[p, p]) + abs(a[q, q])):
                    turned = True
                    _turn(a, vectors, p, q)
        if not turned:
            break
    values = np.empty(n)
    order = np.arange(n)
    for i in range(n):  # sorted by insertion
        values[i] = a[i, i]
        k = i
        while k > 0 and a[order[k - 1], order[k - 1]] > a[i, i]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = i
    columns = np.empty((n, n))
    for k in range(n):
        values[k] = a[order[k], order[k]]
        for i in range(n):
            columns[i, k] = vectors[i, order[k]]
    return values, columns
