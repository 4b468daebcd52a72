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
Link subroutines into the kernels that call them.

numba optimises every callee by itself, makes machine code of it, and optimises its copy within
each caller again; which of the copies runs depends on what was loaded first. Here a kernel always
runs its own copies, so that it does the same whether it was just compiled or comes from a file.
What only kernels call stays intermediate code until it is in one of them
(docs/decisions/0036-subroutines.md).
"""

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import compile_result, Compiler, CompileResult
from numba.core.cpu import _dynfunc
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher

# Names of functions that numba generates: those of closures and array expressions are unique
# within one process only, and code from two processes may be linked into one kernel.
_MADE_BY_NUMBA = ('_ZN5numba', '_ZN13_3cdynamic_3e')


class _Library(JITCodeLibrary):
    """Library that others link as if read back from a file, so that a file changes nothing."""

    _shared_module: binding.ModuleRef | None
    _bitcode: bytes | None = None

    def _get_module_for_linking(self) -> binding.ModuleRef:
        if self._shared_module is None:
            if self._bitcode is None:
                self._bitcode = super()._get_module_for_linking().as_bitcode()
            self._shared_module = binding.parse_bitcode(self._bitcode)
        return self._shared_module

    def _keep_apart(self) -> None:
        """Make functions without unique names internal, so that no others replace them."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.name.startswith(_MADE_BY_NUMBA):
                function.linkage = 'internal'


class KernelLibrary(_Library):
    """Machine code that contains all of its callees."""

    @classmethod
    def restored(cls, codegen: Any, name: str, machine_code: bytes,
                 bitcode: bytes) -> 'KernelLibrary':
        """
        Restore a library from the output of `serialize_using_object_code`.

        The intermediate code is not read until it is linked.
        """
        library = cls(codegen, name)
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._bitcode = bitcode
        JITCodeLibrary._finalize_final_module(library)
        return library

    def get_pointer_to_function(self, name: str) -> int:
        """Look up the address of a function, which must exist."""
        self._ensure_finalized()
        return self._codegen._engine.get_function_address(name)

    def _finalize_final_module(self) -> None:
        self._finalized = True  # no link changes it any more: it can be shared from here on
        self._keep_apart()
        self._get_module_for_linking()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.linkonce_odr:
                function.linkage = 'internal'
        super()._finalize_final_module()
        for variable in self._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                self._codegen.set_env(variable.name, environment)


class SubroutineLibrary(_Library):
    """Intermediate code, to be optimised where it is linked."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True
        self._keep_apart()

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return the name, the format and the bitcode for `restore_subroutine`."""
        return self.name, 'bitcode', self._get_module_for_linking().as_bitcode()


class KernelCompiler(Compiler):
    """numba's compiler with a `KernelLibrary`."""

    def define_pipelines(self) -> list:
        """Create the library before a pass makes another."""
        state = self.state
        state.library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()


class SubroutineCompiler(Compiler):
    """numba's compiler, up to intermediate code."""

    def define_pipelines(self) -> list:
        """Create the library before a pass makes another, and nothing to execute."""
        state = self.state
        state.library = SubroutineLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.targetctx = state.targetctx.subtarget(get_executable=_not_executable)
        return super().define_pipelines()


class Subroutine(CPUDispatcher):
    """A function that kernels call, and Python cannot."""

    def __call__(self, *_: Any) -> None:
        """Raise TypeError: there is no machine code."""
        raise TypeError(f'{self.py_func.__qualname__} is a subroutine, which only kernels can '
                        'call; what Python calls is a kernel')


def restore_kernel(target_context: Any, reduced: tuple) -> CompileResult:
    """Restore a compiled kernel from the output of numba's `CompileResult._reduce`."""
    (name, _, code), fndesc, environment = reduced[:3]
    library = KernelLibrary.restored(target_context.codegen(), name, *code)
    result = _result(target_context, reduced, library,
                     target_context.get_executable(library, fndesc, environment))
    for referenced in result.referenced_envs:
        library.codegen.set_env(referenced.env_name, referenced)
    return result


def restore_subroutine(target_context: Any, reduced: tuple) -> CompileResult:
    """Restore a compiled subroutine from the output of numba's `CompileResult._reduce`."""
    (name, _, bitcode), fndesc, environment = reduced[:3]
    library = SubroutineLibrary(target_context.codegen(), name)
    library._final_module = library._shared_module = binding.parse_bitcode(bitcode)
    library._finalize_final_module()
    return _result(target_context, reduced, library,
                   _not_executable(library, fndesc, environment))


def _result(target_context: Any, reduced: tuple, library: _Library,
            entry_point: Any) -> CompileResult:
    """Make numba's compile result of a function with a restored library."""
    (_, fndesc, environment, signature, objectmode, lifted, annotation, reload_init,
     referenced) = reduced
    return compile_result(
        target_context=target_context, typing_context=target_context.typing_context,
        library=library, environment=environment, fndesc=fndesc, signature=signature,
        entry_point=entry_point, objectmode=objectmode, lifted=lifted,
        type_annotation=annotation, reload_init=reload_init, referenced_envs=referenced)


def _not_executable(library: SubroutineLibrary, fndesc: Any, environment: Any) -> Any:
    """Make a function without code, by which numba knows the subroutine."""
    library._ensure_finalized()
    return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, fndesc.qualname, 0,
                                  environment, (library,))
