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

"""Elementary functions of arrays, element by element as in `elementary.functions`."""

from collections.abc import Callable
from typing import Any

import numpy as np

from procphys_ros.compilation import kernel
from procphys_ros.elementary import functions

Values = float | np.ndarray


@kernel
def _sines(x, out):
    for i in range(len(x)):
        out[i] = functions.sin(x[i])


@kernel
def _cosines(x, out):
    for i in range(len(x)):
        out[i] = functions.cos(x[i])


@kernel
def _arc_tangents(x, out):
    for i in range(len(x)):
        out[i] = functions.atan(x[i])


@kernel
def _exponentials(x, out):
    for i in range(len(x)):
        out[i] = functions.exp(x[i])


@kernel
def _growths(x, out):
    for i in range(len(x)):
        out[i] = functions.expm1(x[i])


@kernel
def _logarithms(x, out):
    for i in range(len(x)):
        out[i] = functions.log(x[i])


@kernel
def _cube_roots(x, out):
    for i in range(len(x)):
        out[i] = functions.cbrt(x[i])


@kernel
def _angles(x, y, out):
    for i in range(len(x)):
        out[i] = functions.atan2(x[i], y[i])


@kernel
def _powers(x, y, out):
    for i in range(len(x)):
        out[i] = functions.power(x[i], y[i])


def _each(scalar: Callable, loop: Callable, *arguments: Values) -> Any:
    """Evaluate a function of numbers in Python, and of arrays, broadcast, in a kernel."""
    if all(isinstance(value, (float, int)) for value in arguments):
        return float(scalar(*map(float, arguments)))
    shape = np.broadcast_shapes(*map(np.shape, arguments))
    out = np.empty(shape)
    # Copies are contiguous and writable: one kind of array, so one kernel.
    loop(*[np.array(np.broadcast_to(value, shape), float, order='C').reshape(-1)
           for value in arguments], out.reshape(-1))
    return out if out.ndim else float(out)


def _other_side(x: Values) -> Values:
    """Return the other side of a right triangle with a side x and the hypotenuse 1."""
    with np.errstate(invalid='ignore'):
        side = np.sqrt(np.subtract(1.0, x) * np.add(1.0, x))
    return side if np.ndim(side) else float(side)


def sin(x: Values) -> Any:
    """Return sines of angles [rad]."""
    return _each(functions.sin, _sines, x)


def cos(x: Values) -> Any:
    """Return cosines of angles [rad]."""
    return _each(functions.cos, _cosines, x)


def tan(x: Values) -> Any:
    """Return tangents of angles [rad]."""
    return sin(x) / cos(x)


def asin(x: Values) -> Any:
    """Return angles with given sines, -pi/2 to pi/2 [rad]; not a number beyond 1."""
    return atan2(x, _other_side(x))


def acos(x: Values) -> Any:
    """Return angles with given cosines, 0 to pi [rad]; not a number beyond 1."""
    return atan2(_other_side(x), x)


def atan(x: Values) -> Any:
    """Return angles with given tangents, -pi/2 to pi/2 [rad]."""
    return _each(functions.atan, _arc_tangents, x)


def exp(x: Values) -> Any:
    """Return e^x."""
    return _each(functions.exp, _exponentials, x)


def expm1(x: Values) -> Any:
    """Return e^x - 1, with all digits near 0."""
    return _each(functions.expm1, _growths, x)


def log(x: Values) -> Any:
    """Return natural logarithms."""
    return _each(functions.log, _logarithms, x)


def cbrt(x: Values) -> Any:
    """Return cube roots."""
    return _each(functions.cbrt, _cube_roots, x)


def atan2(y: Values, x: Values) -> Any:
    """Return angles of points (x, y) from the x axis, -pi to pi [rad]."""
    return _each(functions.atan2, _angles, y, x)


def power(x: Values, y: Values) -> Any:
    """Return x^y."""
    return _each(functions.power, _powers, x, y)


def hypot(*components: Values) -> Any:
    """Return lengths of vectors with these components."""
    length = np.sqrt(sum(np.square(component) for component in components))
    return length if np.ndim(length) else float(length)
