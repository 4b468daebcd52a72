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
from functools import cache, partial
from typing import Any

import numba
from numba import config, njit, types
from numba.extending import register_jitable

from procphys_ros.compilation.folder import warn_once

KERNELS: dict[str, Any] = {}
"""Every kernel that has been imported, by its dotted name."""
SUBROUTINES: dict[str, Any] = {}
"""Every subroutine that has been imported, likewise."""
_INLINED: dict[str, Any] = {}


def kernel(function: Callable | None = None, /, **options: Any) -> Any:
    """
    Compile a function with numba when it is first called, and cache it for the user.

    :param function: to be compiled; None = return a decorator with these options.
    :param options: of `numba.njit` but `parallel`; `cache` is implied.
    """
    if function is None:
        return partial(kernel, **options)
    return _compiled(KERNELS, function, **options)


def subroutine(function: Callable | None = None, /, **options: Any) -> Any:
    """
    Compile a function that kernels call; Python must not, for which it has no wrapper.

    :param function: to be compiled; None = return a decorator with these options.
    :param options: of `numba.njit` but `parallel`; `cache` is implied.
    """
    if function is None:
        return partial(subroutine, **options)
    return _compiled(SUBROUTINES, function, no_cpython_wrapper=True, **options)


def inlined(function: Callable) -> Callable:
    """
    Let kernels call a function of numbers; Python calls it uncompiled.

    :param function: divides by nothing that may be zero.
    """
    ours = _cache_module()
    if ours is None:
        return register_jitable(function)
    if not config.DISABLE_JIT:
        compiled = _compiled(_INLINED, function, no_cpython_wrapper=True,
                             error_model='numpy', _nrt=False)
        ours.let_kernels_call(function, compiled)
    return function


def _compiled(known: dict[str, Any], function: Callable, **options: Any) -> Any:
    """
    Compile a function at its first call.

    Nothing calls kernels from C, so there are no wrappers for that. Threads are those of
    `threads`: code from a file would find numba's own not started. Folders of kernels are
    named by this package's sources only, so functions of others are not kept.
    """
    ours = _cache_module()
    if ours is not None:
        options['pipeline_class'] = ours.KernelCompiler
    options.setdefault('error_model', 'python')  # else that of whichever caller comes first
    compiled = njit(no_cfunc_wrapper=True, parallel=False, **options)(function)
    if not config.DISABLE_JIT:
        if ours is not None and function.__module__.startswith('procphys_ros.'):
            compiled._cache = ours.KernelCache(function)
        # Without the values of constants, with each of which numba would compile it once more.
        template = compiled.get_call_template
        compiled.get_call_template = lambda args, kws: template(
            tuple(map(types.unliteral, args)), {k: types.unliteral(v) for k, v in kws.items()})
    known[f'{function.__module__}.{function.__qualname__}'] = compiled
    return compiled


@cache
def _cache_module() -> Any:
    """Import the cache, which takes from numba what that does not promise; None = it is gone."""
    try:
        from procphys_ros.compilation import cache
    except (ImportError, AttributeError) as error:
        warn_once(f'numba {numba.__version__} has another cache ({error})')
        return None
    return cache
