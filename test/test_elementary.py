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

"""Elementary functions are as exact as they say, and the same for numbers, arrays and kernels."""

import math

import numpy as np
import pytest

from procphys_ros import elementary
from procphys_ros.elementary import functions

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
