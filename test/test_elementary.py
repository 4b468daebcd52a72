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

"""Elementary functions, small matrices and components: exact, and the same everywhere."""

import math

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from procphys_ros import elementary
from procphys_ros.compilation import kernel
from procphys_ros.elementary import functions
from procphys_ros.geometry import linear, linear_kernels
from procphys_ros.physics.masonry import components

_EXACT = np.longdouble  # 64 bits of mantissa on x86-64, by code of its own
_FEW = 4.0  # units in the last place, as the module says
_RNG = np.random.default_rng(1)
_WIDE = np.concatenate([_RNG.uniform(-10.0, 10.0, 20000), _RNG.uniform(-1e6, 1e6, 5000),
                        _RNG.uniform(-1e-3, 1e-3, 5000)])
_UNIT = _RNG.uniform(-1.0, 1.0, 20000)
_ABOVE = np.concatenate([10.0 ** _RNG.uniform(-300.0, 300.0, 10000), 1.0 + 1e-3 * _UNIT])
_EXPONENTS = np.concatenate([_RNG.uniform(-700.0, 700.0, 10000), _UNIT])
_CASES = {'sin': (np.sin, _WIDE), 'cos': (np.cos, _WIDE), 'tan': (np.tan, _WIDE),
          'asin': (np.arcsin, _UNIT), 'acos': (np.arccos, _UNIT), 'atan': (np.arctan, _WIDE),
          'exp': (np.exp, _EXPONENTS), 'expm1': (np.expm1, _UNIT), 'log': (np.log, _ABOVE),
          'cbrt': (np.cbrt, _ABOVE)}


def units(got: np.ndarray, exact: np.ndarray) -> float:
    """Compute the largest error in units in the last place."""
    return float(np.max(np.abs(got - exact) / np.spacing(np.abs(exact.astype(float)))))


@pytest.mark.parametrize('name', _CASES)
def test_functions_are_exact_to_a_few_units(name):
    """Compare with numpy in extended precision."""
    function, x = _CASES[name]
    assert units(getattr(elementary, name)(x), function(x.astype(_EXACT))) < _FEW


@pytest.mark.parametrize('name', _CASES)
def test_numbers_and_arrays_give_the_same_bits(name):
    """Work out numbers in Python and arrays in a kernel."""
    function, some = getattr(elementary, name), _CASES[name][1][::40]
    np.testing.assert_array_equal(function(some), [function(float(value)) for value in some])


def test_angles_of_points_are_those_of_libm_in_all_quadrants():
    """Compare also for zeros of both signs and for infinities."""
    values = [0.0, -0.0, 1.0, -1.0, 0.3, -7.0, math.inf, -math.inf]
    for y in values:
        for x in values:
            got, known = elementary.atan2(y, x), math.atan2(y, x)
            assert math.isclose(got, known, rel_tol=1e-15), (y, x)
            assert math.copysign(1.0, got) == math.copysign(1.0, known), (y, x)
    x, y = _WIDE, _WIDE[::-1]
    assert units(elementary.atan2(y, x), np.arctan2(y.astype(_EXACT), x.astype(_EXACT))) < _FEW


def test_powers():
    """Take whole exponents as products, and others to 1 + |y ln x| units."""
    x, y = _RNG.uniform(0.01, 100.0, 20000), _RNG.uniform(-3.0, 3.0, 20000)
    exact = np.power(x.astype(_EXACT), y.astype(_EXACT))
    error = np.abs(elementary.power(x, y) - exact) / np.spacing(exact.astype(float))
    assert np.all(error < 2.0 * (1.0 + np.abs(y * np.log(x))) + _FEW)
    known = [(2.0, 10.0, 1024.0), (10.0, 3.0, 1000.0), (9.0, 0.5, 3.0), (4.0, 1.5, 8.0),
             (-2.0, 3.0, -8.0), (0.0, 0.0, 1.0), (0.0, 2.0, 0.0), (0.0, -1.0, math.inf),
             (2.0, -2.0, 0.25)]
    for base, exponent, power in known:
        assert elementary.power(base, exponent) == power, (base, exponent)
    assert math.isnan(elementary.power(-2.0, 0.5)) and math.isnan(elementary.power(-2.0, 0.3))


def test_ends_of_ranges():
    """Overflow to infinity, underflow to zero, and pass on what is not a number."""
    assert elementary.exp(1e3) == math.inf and elementary.exp(-1e3) == 0.0
    assert elementary.exp(-745.0) == math.exp(-745.0) and elementary.exp(0.0) == 1.0
    assert elementary.log(0.0) == -math.inf and elementary.log(math.inf) == math.inf
    assert elementary.log(5e-324) == pytest.approx(math.log(5e-324), rel=1e-15)
    for name in ('sin', 'cos', 'log', 'asin', 'acos'):
        assert math.isnan(getattr(elementary, name)(-math.inf)), name
        assert math.isnan(getattr(elementary, name)(math.nan)), name
    assert elementary.sin(1e22) == pytest.approx(math.sin(math.fmod(1e22, 2.0 * math.pi)))
    x = np.linspace(-7.0, 7.0, 29).tolist()
    np.testing.assert_allclose([functions.erf(v) for v in x], [math.erf(v) for v in x], rtol=0.0,
                               atol=1e-15)


def test_shapes_are_those_of_numpy():
    """Broadcast, keep shapes, and give a number for numbers."""
    x, y = np.ones((3, 1)), np.arange(4)
    assert elementary.atan2(x, y).shape == (3, 4) and elementary.hypot(x, y).shape == (3, 4)
    assert elementary.sin(np.zeros((0, 2))).shape == (0, 2)
    assert isinstance(elementary.sin(1), float) and isinstance(elementary.hypot(3, 4, 12), float)
    assert elementary.hypot(3, 4, 12) == 13.0


def test_normal_numbers_are_normal():
    """Find mean, deviation, kurtosis and no correlation within four standard errors."""
    drawn = elementary.standard_normal(np.random.default_rng(3), (100001,))
    error = 1.0 / math.sqrt(len(drawn))
    assert abs(drawn.mean()) < 4.0 * error and abs(drawn.std() - 1.0) < 3.0 * error
    assert abs((drawn ** 4).mean() - 3.0) < 4.0 * 9.8 * error  # the variance of x⁴ is 96
    assert abs((drawn[::2][:50000] * drawn[1::2]).mean()) < 4.0 * error * 1.42
    assert elementary.standard_normal(np.random.default_rng(3), (2, 3)).shape == (2, 3)


def test_weibull_numbers_have_their_mean():
    """Compare the mean with the gamma function of 1 + 1/k."""
    drawn = elementary.weibull(np.random.default_rng(4), 2.5, 100000)
    assert drawn.mean() == pytest.approx(math.gamma(1.4), rel=0.006) and drawn.min() >= 0.0


_MATRICES = np.random.default_rng(2)


@pytest.mark.parametrize('a, b', [((3,), (3,)), ((3,), (3, 2)), ((4, 3), (3,)), ((4, 3), (3, 5)),
                                  ((7, 4, 3), (3,)), ((7, 4, 3), (3, 2)), ((7, 4, 3), (7, 3, 2))])
def test_products_have_the_shapes_of_matmul(a, b):
    """Multiply vectors, matrices and stacks of them."""
    a, b = _MATRICES.normal(size=a), _MATRICES.normal(size=b)
    np.testing.assert_allclose(linear.product(a, b), a @ b, rtol=1e-13, atol=1e-14)


def test_norms_dots_and_determinants():
    """Compare with `numpy.linalg`."""
    a, b = _MATRICES.normal(size=(2, 6, 3))
    np.testing.assert_allclose(linear.norm(a, axis=1), np.linalg.norm(a, axis=1))
    np.testing.assert_allclose(linear.norm(a), np.linalg.norm(a))
    np.testing.assert_allclose(linear.dot(a, b), (a * b).sum(axis=1))
    stack = _MATRICES.normal(size=(5, 3, 3))
    np.testing.assert_allclose(linear.determinant(stack), np.linalg.det(stack))
    np.testing.assert_allclose(linear.solve(stack[0, :2, :2], [1.0, 2.0]),
                               np.linalg.solve(stack[0, :2, :2], [1.0, 2.0]))
    with pytest.raises(ZeroDivisionError):
        linear.solve(np.ones((2, 2)), [1.0, 2.0])


@pytest.mark.parametrize('count', [2, 3, 6])
def test_eigenvectors_diagonalise(count):
    """Order eigenvalues, and find orthonormal vectors, also where eigenvalues are alike."""
    root = _MATRICES.normal(size=(50, count, count))
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
    root = _MATRICES.normal(size=(6, 6))
    for matrix in (np.array([[0.0, 2.0], [1.0, 3.0]]), scale @ (root @ root.T) @ scale):
        right = _MATRICES.normal(size=len(matrix))
        inverse, solution = _invert(matrix, right)
        np.testing.assert_allclose(inverse, np.linalg.inv(matrix), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(matrix @ solution, right, rtol=1e-7, atol=1e-8)


def pairs_of(*pairs):
    """Return first and second of bonds, ground written as 'g' in a graph of ten parts."""
    array = np.array([[10 if p == 'g' else p for p in pair] for pair in pairs], np.int32)
    return array[:, 0].copy(), array[:, 1].copy()


def test_ground_supports_but_does_not_join():
    """Keep two islands apart that both stand on the ground."""
    first, second = pairs_of(('g', 0), (0, 1), ('g', 5), (5, 4))
    labels, supported = components.label(10, first, second, np.ones(4, bool))
    assert labels[0] == labels[1] == 0
    assert labels[4] == labels[5] == 4
    assert np.flatnonzero(supported).tolist() == [0, 1, 4, 5]


def test_cut_takes_the_ground_from_what_hangs_on_it():
    """Cut the bond that carries an arm: the arm falls, the rest stands."""
    first, second = pairs_of(('g', 0), (0, 1), (1, 2), (2, 3), (3, 4))
    alive = np.array([True, True, False, True, True])
    labels, supported = components.label(10, first, second, alive)
    assert supported[[0, 1]].all() and not supported[2:5].any()
    falling = np.zeros(10, bool)
    falling[:5] = ~supported[:5]
    assert [g.tolist() for g in components.groups(labels, falling)] == [[2, 3, 4]]


def test_groups_list_each_component_once_in_order():
    """Split several falling pieces into ascending part lists."""
    first, second = pairs_of((7, 2), (5, 9), (9, 8))
    labels, supported = components.label(10, first, second, np.ones(3, bool))
    pieces = components.groups(labels, ~supported)
    assert [p.tolist() for p in pieces] == [[0], [1], [2, 7], [3], [4], [5, 8, 9], [6]]
    assert components.groups(labels, np.zeros(10, bool)) == []


def test_labels_agree_with_scipy_on_random_graphs():
    """Find the same partition as scipy for graphs from dust to one lump."""
    rng = np.random.default_rng(11)
    count = 2000
    for bonds in (200, 1000, 1500, 5000):
        first, second = rng.integers(0, count + 1, (2, bonds)).astype(np.int32)
        keep = first != second
        first, second = first[keep], second[keep]
        alive = rng.random(len(first)) < 0.8
        labels, supported = components.label(count, first, second, alive)
        inner = alive & (first < count) & (second < count)
        matrix = coo_matrix((np.ones(inner.sum()), (first[inner], second[inner])), (count, count))
        number, expected = connected_components(matrix, directed=False)
        assert len(np.unique(labels)) == number
        assert len(np.unique(labels.astype(np.int64) * count + expected)) == number
        feet = np.minimum(first, second)[alive & ((first == count) | (second == count))]
        np.testing.assert_array_equal(supported, np.isin(expected, expected[feet]))
        assert np.all(labels[labels] == labels) and np.all(labels <= np.arange(count))
