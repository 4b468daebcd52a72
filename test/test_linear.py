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

"""Linear algebra of small matrices against numpy's."""

import numpy as np
import pytest

from procphys_ros.compilation import kernel
from procphys_ros.geometry import linear, linear_kernels

_RNG = np.random.default_rng(2)


@pytest.mark.parametrize('a, b', [((3,), (3,)), ((3,), (3, 2)), ((4, 3), (3,)), ((4, 3), (3, 5)),
                                  ((7, 4, 3), (3,)), ((7, 4, 3), (3, 2)), ((7, 4, 3), (7, 3, 2))])
def test_products_have_the_shapes_of_matmul(a, b):
    """Multiply vectors, matrices and stacks of them."""
    a, b = _RNG.normal(size=a), _RNG.normal(size=b)
    np.testing.assert_allclose(linear.product(a, b), a @ b, rtol=1e-13, atol=1e-14)


def test_norms_dots_and_determinants():
    """Compare with `numpy.linalg`."""
    a, b = _RNG.normal(size=(2, 6, 3))
    np.testing.assert_allclose(linear.norm(a, axis=1), np.linalg.norm(a, axis=1))
    np.testing.assert_allclose(linear.norm(a), np.linalg.norm(a))
    np.testing.assert_allclose(linear.dot(a, b), (a * b).sum(axis=1))
    stack = _RNG.normal(size=(5, 3, 3))
    np.testing.assert_allclose(linear.determinant(stack), np.linalg.det(stack))
    np.testing.assert_allclose(linear.solve(stack[0, :2, :2], [1.0, 2.0]),
                               np.linalg.solve(stack[0, :2, :2], [1.0, 2.0]))
    with pytest.raises(ZeroDivisionError):
        linear.solve(np.ones((2, 2)), [1.0, 2.0])


@pytest.mark.parametrize('count', [2, 3, 6])
def test_eigenvectors_diagonalise(count):
    """Order eigenvalues, and find orthonormal vectors, also where eigenvalues are alike."""
    root = _RNG.normal(size=(50, count, count))
    matrices = root @ root.transpose(0, 2, 1)
    matrices[0], matrices[1] = np.eye(count), np.zeros((count, count))
    matrices[2] = np.diag(np.arange(count)[::-1].astype(float))
    matrices[3, :] = 1.0  # of rank 1
    values, vectors = linear.eigen(matrices.transpose(1, 2, 0).copy().transpose(2, 0, 1))
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrices), rtol=1e-12, atol=1e-13)
    back = np.einsum('nij,nj,nkj->nik', vectors, values, vectors)
    np.testing.assert_allclose(back, matrices, rtol=1e-12, atol=1e-13)
    turned = np.einsum('nji,njk->nik', vectors, vectors)
    np.testing.assert_allclose(turned, np.tile(np.eye(count), (50, 1, 1)), atol=1e-13)


@kernel
def _invert(matrix, right):
    return linear_kernels.inverse(matrix), linear_kernels.solve(matrix, right)


def test_inverses_in_kernels():
    """Invert a matrix whose first pivot is zero, and one whose units differ by 1e6."""
    scale = np.diag([1e3, 1e3, 1e3, 1.0, 1.0, 1.0])
    root = _RNG.normal(size=(6, 6))
    for matrix in (np.array([[0.0, 2.0], [1.0, 3.0]]), scale @ (root @ root.T) @ scale):
        right = _RNG.normal(size=len(matrix))
        inverse, solution = _invert(matrix, right)
        np.testing.assert_allclose(inverse, np.linalg.inv(matrix), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(matrix @ solution, right, rtol=1e-7, atol=1e-8)
