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


"""Cache of one kernel's compiled overloads, in the place of numba's own."""

from collections.abc import Callable
from functools import cache
import hashlib
from pathlib import Path
import pickle
from typing import Any
import warnings

from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from procphys_ros.compilation.claims import claim, release
from procphys_ros.compilation.files import read, write
from procphys_ros.compilation.folders import cache_folder, module_folder, prepare
from procphys_ros.compilation.linking import restore_kernel, restore_subroutine
from procphys_ros.compilation.progress import COMPILING
from procphys_ros.progress import stage


class KernelCache(_Cache):
    """
    Keeps the overloads of a kernel on disk, a file each.

    numba's own cache looks at the file of a kernel only, not at those of its callees, and runs
    old code after an upgrade; its index is not safe against two processes that write at once.
    Here a file's name identifies all that its content depends on, and files are written
    atomically. File errors never keep a kernel from running.

    :param function: to be compiled.
    """

    def __init__(self, function: Callable):
        self._function = function
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """Return the path of the folder."""
        return str(module_folder(self._function.__module__))

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Load the compiled overload of a signature; None when there is none."""
        rtsys.initialize(target_context)  # what machine code calls; numba's compiler needs more
        path = self._file(sig, target_context.codegen())
        payload = read(path)
        if payload is None:
            with stage(COMPILING, self._function.__name__.lstrip('_')):
                claim(path)
            payload = read(path)  # if another process was at it
        if not self._enabled or payload is None:
            return None
        release(path)
        return self._restore(target_context, pickle.loads(payload))

    def save_overload(self, sig: Any, data: CompileResult) -> None:
        """Save the compiled overload of a signature."""
        path = self._file(sig, data.codegen)
        try:
            if self._enabled and not data.lifted and not data.library.has_dynamic_globals:
                prepare(path.parent)
                payload = dumps(data._reduce())
                write(path, payload)
        except OSError as error:
            _warn_once(error.strerror)
        finally:
            release(path)

    def enable(self) -> None:
        """Enable the cache files."""
        self._enabled = True

    def disable(self) -> None:
        """Disable the cache files."""
        self._enabled = False

    def flush(self) -> None:
        """Delete all cached overloads of the kernel."""
        for path in Path(self.cache_path).glob(f'{self._name}-*.nbc'):
            path.unlink(missing_ok=True)

    def _restore(self, target_context: Any, reduced: tuple) -> CompileResult:
        return restore_kernel(target_context, reduced)

    @property
    def _name(self) -> str:
        code = self._function.__code__
        name = self._function.__qualname__.replace('<', '').replace('>', '')
        return f'{name}-{code.co_firstlineno}'

    def _file(self, sig: Any, codegen: Any) -> Path:
        """Return the file of an overload, named by a hash of all that distinguishes it."""
        arguments, _ = normalize_signature(sig)
        cells = self._function.__closure__ or ()
        key = (str(arguments), codegen.magic_tuple(), self._function.__code__.co_code,
               dumps(tuple(cell.cell_contents for cell in cells)))
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return Path(self.cache_path) / f'{self._name}-{digest}.nbc'


class SubroutineCache(KernelCache):
    """Keeps the intermediate code of subroutines."""

    def _restore(self, target_context: Any, reduced: tuple) -> CompileResult:
        return restore_subroutine(target_context, reduced)


@cache
def _warn_once(reason: str) -> None:
    warnings.warn(f'compiled kernels cannot be kept in {cache_folder()}, every start will compile '
                  f'them: {reason}; NUMBA_CACHE_DIR names another folder', RuntimeWarning,
                  stacklevel=3)
