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


"""numba's cache in folders of our own, used by one process at a time."""

from collections.abc import Callable
from contextlib import suppress
from itertools import count
import os
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from numba.core.bytecode import FunctionIdentity
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.compiler import Compiler
from numba.core.targetconfig import ConfigStack
from numba.core.types import Dispatcher
from numba.core.types.containers import BaseNamedTuple, BaseTuple
from numba.core.typing.templates import infer_global

from procphys_ros.compilation.folder import kernel_folder, prepare, warn_once
from procphys_ros.compilation.progress import COMPILING
from procphys_ros.files.output_files import lock
from procphys_ros.progress import stage

_PATIENCE = 120.0  # [s] of waiting for another process: it may have been stopped
_LOOK = 0.02       # [s] between two looks


def number_functions() -> None:
    """
    Let numba number functions from a random number on, as part of their names in machine code.

    It counts from 1 in every process. Closures of its own then have the same names in two, and a
    kernel that is linked of what both have compiled may run either for the other.
    """
    next(FunctionIdentity._unique_ids)  # AttributeError where numba does otherwise
    FunctionIdentity._unique_ids = count(int.from_bytes(os.urandom(6), 'big'))


number_functions()
os.register_at_fork(after_in_child=number_functions)


class KernelCompiler(Compiler):
    """numba's compiler, which compiles what numba brings once for kernels and for subroutines."""

    def define_pipelines(self) -> list:
        """Set options that callees do not heed, but are told apart by."""
        options = ConfigStack().top()  # a copy of this function's
        options.no_cpython_wrapper, options.release_gil = True, False
        return super().define_pipelines()


def let_kernels_call(function: Callable, compiled: Any) -> None:
    """Let kernels call what a function was compiled to where they name the function itself."""
    infer_global(function, Dispatcher(compiled))


class _Locator:
    """The place of a function's files: the same for all installations of the same sources."""

    def __init__(self, function: Callable, file: str):
        self._function, self._py_file = function, file

    from_function = classmethod(lambda cls, function, file: cls(function, file))

    def get_cache_path(self) -> str:
        return str(kernel_folder(self._function.__module__))

    def ensure_cache_path(self) -> None:
        prepare(Path(self.get_cache_path()))

    def get_source_stamp(self) -> str:
        return ''  # the name of the folder tells of the sources

    def get_disambiguator(self) -> str:
        return str(self._function.__code__.co_firstlineno)


class _Files(CompileResultCacheImpl):
    _locator_classes = [_Locator]


def _fields(kind: Any) -> tuple:
    """Return the fields of a named tuple, and of those in a tuple."""
    own = kind.fields if isinstance(kind, BaseNamedTuple) else ()
    return own, *map(_fields, kind.types if isinstance(kind, BaseTuple) else ())


class KernelCache(FunctionCache):
    """
    numba's cache of one function, for several processes that start at once.

    Who finds nothing locks a file until it has saved what it compiles; others that need the same
    wait for it and load it. A function waits for those that it calls, never the other way round,
    and the system ends the locks of a process that dies. Without the lock two processes that save
    different overloads could leave an index that leads to the wrong machine code. File errors
    never keep a kernel from running.

    :param function: to be compiled.
    """

    _impl_class = _Files
    _numbas_key = FunctionCache._index_key  # AttributeError where numba does otherwise

    def __init__(self, function: Callable):
        super().__init__(function)
        self._function = function
        self._lock: int | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the compiled overload of a signature; None = this process is to compile it."""
        found = self._try_to_load(sig, target_context)
        if found is None:
            with stage(COMPILING, self._function.__name__.lstrip('_')):
                self._acquire()
            found = self._try_to_load(sig, target_context)
            # Others would wait too long for a process of low priority.
            if found is not None or os.getpriority(os.PRIO_PROCESS, 0) > 0:
                self._release()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled overload."""
        try:
            if self._acquire():
                super().save_overload(sig, data)
        except OSError as error:
            warn_once(error.strerror)
        finally:
            self._release()

    def _index_key(self, sig: Any, codegen: Any) -> tuple:
        """Tell named tuples apart by their fields too: the class may come from anywhere."""
        return (*self._numbas_key(sig, codegen), *map(_fields, sig))

    def _try_to_load(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever a damaged file may raise
            with suppress(OSError):
                self.flush()
            return None

    def _acquire(self) -> bool:
        """Lock the function, or wait; return False when that is impossible or takes too long."""
        if self._lock is not None:
            return True
        path = Path(self.cache_path, f'{self._function.__qualname__}.lock')
        try:
            prepare(path.parent)
            file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            warn_once(error.strerror)
            return False
        end = monotonic() + _PATIENCE
        while not lock(file):
            if monotonic() > end:
                os.close(file)
                return False
            sleep(_LOOK)
        self._lock = file
        return True

    def _release(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
