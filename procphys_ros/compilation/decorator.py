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


"""The decorators of all kernels."""

from collections.abc import Callable
from functools import partial
from typing import Any

from numba import config, njit
from numba.extending import register_jitable

from procphys_ros.compilation.cache import KernelCache, SubroutineCache
from procphys_ros.compilation.linking import KernelCompiler, Subroutine, SubroutineCompiler

KERNELS: dict[str, Any] = {}
"""Every kernel and subroutine that has been imported, by its dotted name."""


def kernel(function: Callable | None = None, /, **options: Any) -> Any:
    """
    Compile a function with numba when it is first called, and cache it for the user.

    :param function: to be compiled; None = return a decorator with these options.
    :param options: of `numba.njit` but `parallel`; `cache` is implied.
    """
    if function is None:
        return partial(kernel, **options)
    # Nothing calls kernels from C, and the wrappers for that take a tenth of the compilation.
    # Threads are those of `threads`: code from a file would find numba's own not started.
    compiled = njit(no_cfunc_wrapper=True, parallel=False, pipeline_class=KernelCompiler,
                    **options)(function)
    if not config.DISABLE_JIT:  # else it is the function itself
        compiled._cache = KernelCache(function)
    return _noted(function, compiled)


def subroutine(function: Callable | None = None, /, **options: Any) -> Any:
    """
    Compile a function that kernels call, and Python does not, with the first of them.

    It has no wrapper for Python and no machine code of its own, which is half of the work.

    :param function: to be compiled; None = return a decorator with these options.
    :param options: of `numba.njit` but `parallel`; `cache` is implied.
    """
    if function is None:
        return partial(subroutine, **options)
    if config.DISABLE_JIT:
        return _noted(function, function)
    compiled = Subroutine(function, pipeline_class=SubroutineCompiler, targetoptions=dict(
        nopython=True, no_cfunc_wrapper=True, no_cpython_wrapper=True, parallel=False,
        **options))
    compiled._cache = SubroutineCache(function)
    return _noted(function, compiled)


def inlined(function: Callable) -> Callable:
    """Let kernels compile a function into its callers; Python calls it uncompiled."""
    return register_jitable(function)


def _noted(function: Callable, compiled: Any) -> Any:
    KERNELS[f'{function.__module__}.{function.__qualname__}'] = compiled
    return compiled
