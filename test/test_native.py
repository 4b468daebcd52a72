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

"""Calls of C functions by their addresses, from kernels and where kernels are plain Python."""

import ctypes

import numpy as np
import pytest

from procphys_ros.compilation import kernel, native


@kernel
def _compiled(address, one, two, three):
    return native.call(address, (one, two, np.int32(three)))


def _plain(address, one, two, three):
    return native._python_call(address, (one, two, np.int32(three)))


@kernel
def _loaded(address):
    return native.load(address)


@pytest.mark.parametrize('call', [_compiled, _plain])
def test_a_function_gets_what_it_is_called_with(call):
    """Give a pointer, a number and a negative integer of 32 bits, and take a pointer back."""
    taken = []

    @ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_double, ctypes.c_int32)
    def function(*arguments):
        taken.append(arguments)
        return 2 ** 47 + 1
    address = ctypes.cast(function, ctypes.c_void_p).value
    assert call(address, 2 ** 46 + 5, -0.75, -1) == 2 ** 47 + 1
    assert taken == [(2 ** 46 + 5, -0.75, -1)]


@pytest.mark.parametrize('load', [_loaded, native._python_load])
def test_a_number_is_loaded_from_its_address(load):
    """Read the second of two numbers."""
    numbers = np.array([1.5, -2.25])
    assert load(numbers.ctypes.data + 8) == -2.25
