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
Elementary functions of one number, for Python and for kernels.

They consist of sums, products, quotients and square roots in double precision, which IEEE 754
rounds in one way only. Those of libm and numpy do not: they choose other code on other processors,
with and without FMA or AVX-512. Arguments are reduced as by Cody & Waite 1980, *Software Manual
for the Elementary Functions*; the rest is summed by Taylor's series. Errors are below four units
in the last place, unless a function states another bound.
"""

import math

import numpy as np

from procphys_ros.compilation import inlined

# 1.5 * 2^52 [-]: added and taken away again, it rounds to an integer.
_ROUNDER = 6755399441055744.0
_TWO_OVER_PI = 2.0 / math.pi
# pi/2 in three parts; multiples of the first two by less than 2^20 are exact.
_PI_1, _PI_2, _PI_3 = 1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21
_MOST_TURNS = 1e6  # [rad] beyond which whole turns are taken off with the remainder of a division
_LN2_1, _LN2_2 = 0.6931471803691238, 1.9082149292705877e-10  # ln 2 in two parts
_LARGEST, _SMALLEST = 709.782712893384, -745.1332191019412  # arguments of exp, IEEE 754 doubles
_ROOT_HALF = 0.7071067811865476
_TAN_EIGHTH = 0.41421356237309503  # tan(pi/8)
_WHOLE = 64.0  # exponents up to which powers with whole exponents are products


@inlined
def _reduced(x):
    """Split an angle into the number of quarter turns, mod 4, and the rest, a sum of two parts."""
    if abs(x) > _MOST_TURNS:
        x = math.copysign(abs(x) % (2.0 * math.pi), x)
    quarters = (x * _TWO_OVER_PI + _ROUNDER) - _ROUNDER
    first, less = x - quarters * _PI_1, quarters * _PI_2
    rest = first - less
    low = ((first - rest) - less) - quarters * _PI_3
    return quarters - 4.0 * ((0.25 * quarters - 0.375 + _ROUNDER) - _ROUNDER), rest, low


@inlined
def _sine(r, low):
    """Sum the series of the sine of r + low for at most an eighth of a turn."""
    z = r * r
    return r + (low * (1.0 - 0.5 * z) + r * z * (-1.0 / 6.0 + z * (
        1.0 / 120.0 + z * (-1.0 / 5040.0 + z * (1.0 / 362880.0 + z * (
            -1.0 / 39916800.0 + z * (1.0 / 6227020800.0 + z * (-1.0 / 1307674368000.0))))))))


@inlined
def _cosine(r, low):
    """Sum the series of the cosine of r + low for at most an eighth of a turn."""
    z = r * r
    return 1.0 - (0.5 * z + r * low - z * z * (1.0 / 24.0 + z * (
        -1.0 / 720.0 + z * (1.0 / 40320.0 + z * (-1.0 / 3628800.0 + z * (
            1.0 / 479001600.0 + z * (-1.0 / 87178291200.0 + z * (1.0 / 20922789888000.0))))))))


@inlined
def cos_sin(x):
    """
    Return the cosine and the sine of an angle [rad].

    Beyond a million radians the error is that of as many turns, x * 2^-53.
    """
    if not math.isfinite(x):
        return math.nan, math.nan
    quarters, rest, low = _reduced(x)
    c, s = _cosine(rest, low), _sine(rest, low)
    if quarters == 0.0:
        return c, s
    if quarters == 1.0:
        return -s, c
    if quarters == 2.0:
        return -c, -s
    return s, -c


@inlined
def sin(x):
    """Return the sine of an angle [rad]."""
    return cos_sin(x)[1]


@inlined
def cos(x):
    """Return the cosine of an angle [rad]."""
    return cos_sin(x)[0]


@inlined
def _arctangent(x):
    """Sum the series of the arc tangent for 0 to tan(pi/8)."""
    z = x * x  # tan(pi/8)^44 / 45 is below 2^-53
    total = z * (1.0 / 3.0 - z * (1.0 / 5.0 - z * (1.0 / 7.0 - z * (1.0 / 9.0 - z * (
        1.0 / 11.0 - z * (1.0 / 13.0 - z * (1.0 / 15.0 - z * (1.0 / 17.0 - z * (
            1.0 / 19.0 - z * (1.0 / 21.0 - z * (1.0 / 23.0 - z * (1.0 / 25.0 - z * (
                1.0 / 27.0 - z * (1.0 / 29.0 - z * (1.0 / 31.0 - z * (1.0 / 33.0 - z * (
                    1.0 / 35.0 - z * (1.0 / 37.0 - z * (1.0 / 39.0 - z * (1.0 / 41.0 - z * (
                        1.0 / 43.0)))))))))))))))))))))
    return x - x * total


@inlined
def atan2(y, x):
    """Return the angle of a point (x, y) from the x axis, -pi to pi [rad]."""
    a, b = abs(y), abs(x)
    if math.isnan(a) or math.isnan(b):
        return math.nan
    low, high = min(a, b), max(a, b)
    share = 1.0 if math.isinf(low) else 0.0 if high == 0.0 else low / high
    if share > _TAN_EIGHTH:
        angle = 0.25 * math.pi - _arctangent((1.0 - share) / (1.0 + share))
    else:
        angle = _arctangent(share)
    if a > b:
        angle = 0.5 * math.pi - angle
    if math.copysign(1.0, x) < 0.0:
        angle = math.pi - angle
    return math.copysign(angle, y)


@inlined
def atan(x):
    """Return the angle with a tangent, -pi/2 to pi/2 [rad]."""
    return atan2(x, 1.0)


@inlined
def acos(x):
    """Return the angle with a cosine, 0 to pi [rad]; not a number beyond 1."""
    return math.nan if abs(x) > 1.0 else atan2(math.sqrt((1.0 - x) * (1.0 + x)), x)


@inlined
def _power_of_two(k):
    """Return 2^k from its bits, for k from -1022 to 1023."""
    return np.int64((k + 1023) << 52).view(np.float64)


@inlined
def _growth(r):
    """Sum the series of e^r - 1 for |r| up to 0.35."""
    return r + r * r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (
        1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0 + r * (
            1.0 / 40320.0 + r * (1.0 / 362880.0 + r * (1.0 / 3628800.0 + r * (
                1.0 / 39916800.0 + r * (1.0 / 479001600.0 + r / 6227020800.0)))))))))))


@inlined
def exp(x):
    """Return e^x."""
    if math.isnan(x):
        return x
    if x > _LARGEST:
        return math.inf
    if x < _SMALLEST:
        return 0.0
    number = (x / (_LN2_1 + _LN2_2) + _ROUNDER) - _ROUNDER
    rest = (x - number * _LN2_1) - number * _LN2_2
    k = int(number)
    half = k >> 1  # 2^k alone may be too large, or too small, for a double
    return (1.0 + _growth(rest)) * _power_of_two(half) * _power_of_two(k - half)


@inlined
def expm1(x):
    """Return e^x - 1, with all digits near 0."""
    return _growth(x) if abs(x) < 0.35 else exp(x) - 1.0


@inlined
def log(x):
    """Return the natural logarithm; -inf of 0, not a number below."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else math.inf if x == math.inf else math.nan
    k = 0
    if x < 2.2250738585072014e-308:  # subnormal
        x, k = x * 18014398509481984.0, -54
    bits = np.float64(x).view(np.int64)
    k += (bits >> 52) - 1022
    part = np.int64((bits & 0xFFFFFFFFFFFFF) | (1022 << 52)).view(np.float64)  # 0.5 to 1
    if part < _ROOT_HALF:
        part, k = 2.0 * part, k - 1
    f = part - 1.0
    s, half = f / (2.0 + f), 0.5 * f * f
    z = s * s  # 2 artanh(s) - 2 s; s^24 / 25 is below 2^-60
    total = z * (2.0 / 3.0 + z * (2.0 / 5.0 + z * (2.0 / 7.0 + z * (2.0 / 9.0 + z * (
        2.0 / 11.0 + z * (2.0 / 13.0 + z * (2.0 / 15.0 + z * (2.0 / 17.0 + z * (
            2.0 / 19.0 + z * (2.0 / 21.0 + z * (2.0 / 23.0)))))))))))
    return k * _LN2_1 + (f - (half - (s * (half + total) + k * _LN2_2)))


@inlined
def power(x, y):
    """
    Return x^y.

    Whole exponents up to 64 are products, halves the square root of these; the error of others is
    some (1 + |y ln x|) units in the last place. A negative x needs a whole exponent.
    """
    if abs(y) <= _WHOLE and 2.0 * y == math.floor(2.0 * y):
        whole = int(abs(y))
        square, out = x, 1.0
        while whole:
            if whole & 1:
                out *= square
            square, whole = square * square, whole >> 1
        if abs(y) != math.floor(abs(y)):
            out *= math.sqrt(x) if x >= 0.0 else math.nan
        if y >= 0.0:
            return out
        return math.copysign(math.inf, out) if out == 0.0 else 1.0 / out
    if x > 0.0:
        return exp(y * log(x))
    if x == 0.0:
        return 0.0 if y > 0.0 else math.inf
    if y != math.floor(y):
        return math.nan
    size = exp(y * log(-x))
    return -size if y % 2.0 != 0.0 else size


@inlined
def cbrt(x):
    """Return the cube root."""
    if x == 0.0 or not math.isfinite(x):
        return x
    root = exp(log(abs(x)) / 3.0)
    root -= (root * root * root - abs(x)) / (3.0 * root * root)
    return math.copysign(root, x)


@inlined
def hypot(x, y):
    """Return the length of a vector (x, y), whose square must be within range."""
    return math.sqrt(x * x + y * y)


@inlined
def erf(x):
    """Return the error function to 1e-15, by its series (Abramowitz & Stegun 7.1.6)."""
    if abs(x) > 6.0:
        return math.copysign(1.0, x)
    term = total = x
    n = 0
    while abs(term) > 1e-17 * abs(total):
        n += 1
        term *= 2.0 * x * x / (2 * n + 1)
        total += term
    return 1.1283791670955126 * exp(-x * x) * total
