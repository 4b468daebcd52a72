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


"""Call C functions from kernels, by addresses that are passed as arguments."""

import ctypes
from typing import Any

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic
import numpy as np


@intrinsic
def _compiled_call(_: Any, address: Any, arguments: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        given = [builder.extract_value(values[1], k) for k in range(len(arguments))]
        kind = ir.FunctionType(ir.IntType(64), [value.type for value in given])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)
    return types.int64(address, arguments), generate


@intrinsic
def _compiled_load(_: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.load(builder.inttoptr(values[0], ir.DoubleType().as_pointer()))
    return types.float64(address), generate


def _python_call(address: int, arguments: tuple) -> int:
    kinds: dict[type, Any] = {float: ctypes.c_double, np.float64: ctypes.c_double,
                              np.int32: ctypes.c_int32}
    given = [kinds.get(type(value), ctypes.c_int64) for value in arguments]
    values = [kind(value.item() if isinstance(value, np.generic) else value)
              for kind, value in zip(given, arguments)]
    return ctypes.CFUNCTYPE(ctypes.c_int64, *given)(int(address))(*values)


def _python_load(address: int) -> float:
    return ctypes.c_double.from_address(int(address)).value


call: Any = _python_call if config.DISABLE_JIT else _compiled_call
"""
Call the C function at an address, with a tuple of what it takes.

Integers are as wide as they are in numba, pointers int64. What it gives is taken for a pointer; of
a function that gives nothing, or an int, it means nothing.
"""

load: Any = _python_load if config.DISABLE_JIT else _compiled_load
"""Load the number in double precision at an address."""
