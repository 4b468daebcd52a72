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
Linear algebra of small matrices with the same bits on every processor.

BLAS and LAPACK choose other kernels, and so another order of sums, on other processors; `einsum`
without its `optimize` adds in one order. `linear_kernels` has the same for kernels.
"""

from typing import Any

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.geometry.linear_kernels import diagonalise


def dot(a: np.ndarray, b: np.ndarray) -> Any:
    """Return inner products of vectors, (..., n), broadcast."""
    return np.einsum('...i,...i->...', a, b)


def norm(a: np.ndarray, axis: int | None = None, keepdims: bool = False) -> Any:
    """Return lengths of vectors along an axis; None = of the whole array."""
    return np.sqrt(np.square(a).sum(axis=axis, keepdims=keepdims))


def product(a: np.ndarray, b: np.ndarray) -> Any:
    """Return a matrix product, of the shapes that `numpy.matmul` takes."""
    a, b = np.asarray(a), np.asarray(b)
    if a.ndim == 1:
        return np.einsum('i,i' if b.ndim == 1 else 'i,...ij->...j', a, b)
    return np.einsum('...ij,j->...i' if b.ndim == 1 else '...ij,...jk->...ik', a, b)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return cross products of vectors, (..., 3), broadcast: `np.cross` in a third of its time."""
    a, b = np.asarray(a), np.asarray(b)
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    first = y * w - z * v
    out = np.empty((*np.shape(first), 3))
    out[..., 0], out[..., 1], out[..., 2] = first, z * u - x * w, x * v - y * u
    return out


def determinant(matrices: np.ndarray) -> Any:
    """Return determinants, (...), of matrices (..., 3, 3)."""
    return dot(cross(matrices[..., 0, :], matrices[..., 1, :]), matrices[..., 2, :])


def solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """
    Solve two equations by Cramer's rule, (2,).

    :param matrix: (2, 2).
    :param right: (2,).
    :raises ZeroDivisionError: when the matrix is singular.
    """
    (a, b), (c, d) = np.asarray(matrix, float).tolist()
    x, y = np.asarray(right, float).tolist()
    whole = a * d - b * c
    return np.array([(x * d - b * y) / whole, (a * y - x * c) / whole])


def eigen(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """
    Return eigenvalues in rising order, (..., n), and eigenvectors as columns, (..., n, n).

    :param matrices: symmetric, (..., n, n).
    """
    matrices = np.ascontiguousarray(matrices, float)
    vectors = np.empty(matrices.shape)
    values = np.empty(matrices.shape[:-1])
    n = matrices.shape[-1]
    _diagonalise_each(matrices.reshape(-1, n, n), values.reshape(-1, n),
                      vectors.reshape(-1, n, n))
    return values, vectors


@kernel
def _diagonalise_each(matrices, values, vectors):
    for k in range(len(matrices)):
        values[k], vectors[k] = diagonalise(matrices[k])
