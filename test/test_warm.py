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


"""All kernels compiled beforehand: the list of overloads is whole and fits the kernels."""

from collections.abc import Iterator
import dis
import importlib
import inspect
import json
import os
from pathlib import Path
import pkgutil
import subprocess
import sys
from time import sleep
from typing import Any, NamedTuple

from numba import from_dtype, types
import numpy as np
import pytest

import procphys_ros
from procphys_ros.compilation import warming
from procphys_ros.compilation.decorator import KERNELS
from procphys_ros.compilation.linking import Subroutine
from procphys_ros.compilation.overloads import shipped
from procphys_ros.compilation.signatures import from_text, to_text
from procphys_ros.ros.background_compilation import BackgroundCompilation

ROOT = Path(__file__).resolve().parents[1]
REMEDY = 'run python bench/overloads.py'


class Pair(NamedTuple):
    """A named tuple as kernels take them."""

    first: np.ndarray
    second: float


def all_kernels() -> dict[str, Any]:
    """Import the whole package, and give its kernels by name."""
    for module in pkgutil.walk_packages(procphys_ros.__path__, 'procphys_ros.'):
        if not module.name.startswith(('procphys_ros.render', 'procphys_ros.ros')):
            importlib.import_module(module.name)
    return {name: kernel for name, kernel in KERNELS.items() if name.startswith('procphys_ros.')}


def callees(kernel: Any) -> set[str]:
    """List the kernels that a kernel calls, also as members of modules."""
    function = kernel.py_func
    scopes = [function.__globals__, *(value.__dict__ for value in function.__globals__.values()
                                      if inspect.ismodule(value))]
    found = [scope[name] for name in function.__code__.co_names for scope in scopes
             if name in scope]
    return {f'{value.py_func.__module__}.{value.py_func.__qualname__}' for value in found
            if hasattr(value, 'py_func')}


def test_no_kernel_is_forgotten():
    """Reach every kernel of the package from those that are compiled beforehand."""
    kernels = all_kernels()
    waiting = {f'{overload.module}.{overload.name}' for group in shipped() for overload in group}
    reached: set[str] = set()
    while waiting:
        name = waiting.pop()
        reached.add(name)
        waiting |= callees(kernels[name]) - reached
    assert kernels.keys() - reached == set(), REMEDY


def python_functions() -> Iterator[Any]:
    """Yield all functions and methods of the package that are not compiled."""
    all_kernels()
    for module in [m for name, m in sys.modules.items() if name.startswith('procphys_ros.')]:
        for scope in (module, *filter(inspect.isclass, vars(module).values())):
            yield from filter(inspect.isfunction, vars(scope).values())


def loaded(function: Any) -> Iterator[Any]:
    """Yield the globals that a function loads, and the attributes of those that are modules."""
    found = None
    for step in dis.get_instructions(function):
        if step.opname == 'LOAD_GLOBAL':
            found = function.__globals__.get(step.argval)
            yield found
        elif step.opname in ('LOAD_ATTR', 'LOAD_METHOD') and inspect.ismodule(found):
            yield getattr(found, step.argval, None)
            found = None


def test_only_kernels_call_subroutines():
    """Find no subroutine among what Python's functions load, nor in the list of overloads."""
    subroutines = {name for name, one in all_kernels().items() if isinstance(one, Subroutine)}
    assert len(subroutines) > 100
    assert not subroutines & {f'{overload.module}.{overload.name}'
                              for group in shipped() for overload in group}
    for function in python_functions():
        assert not any(isinstance(one, Subroutine) for one in loaded(function)), function


def test_list_fits_the_kernels():
    """Name kernels that exist, with as many arguments as they take, and none twice."""
    kernels = all_kernels()
    overloads = [overload for group in shipped() for overload in group]
    assert len({(str(o), json.dumps(o.arguments)) for o in overloads}) == len(overloads)
    for overload in overloads:
        kernel = kernels[f'{overload.module}.{overload.name}']
        assert len(overload.arguments) == len(inspect.signature(kernel.py_func).parameters), (
            f'{overload}: {REMEDY}')
        for argument in overload.arguments:
            assert to_text(from_text(argument)) == argument


@pytest.mark.parametrize('kind', [
    types.float64, types.boolean, types.Array(types.float64, 2, 'C'),
    types.Array(types.int32, 1, 'A', readonly=True),
    types.UniTuple(types.Array(types.uint8, 3, 'C'), 2),
    types.Tuple((types.int64, types.float64)),
    types.NamedTuple((types.Array(types.float64, 1, 'C'), types.float64), Pair),
    types.NamedUniTuple(types.float64, 2, Pair), types.Omitted(0.5)], ids=str)
def test_types_survive_as_text(kind):
    """Write the type of an argument as JSON, and read the same type again."""
    assert from_text(json.loads(json.dumps(to_text(kind)))) == kind


@pytest.mark.parametrize('name', ['bool', 'int64', 'float32'])
def test_types_are_named_alike_by_all_versions_of_numba(name, monkeypatch):
    """Need no attribute of `types`: numba 0.58 has no `bool` there."""
    kind = from_dtype(np.dtype(name))
    monkeypatch.delattr(types, name, raising=False)
    assert from_text(to_text(kind)) == kind
    assert from_text(['array', name, 1, 'C']) == types.Array(kind, 1, 'C')


def test_unknown_type_is_refused():
    """Say which type has no text."""
    with pytest.raises(ValueError, match='unicode'):
        to_text(types.List(types.unicode_type))


def test_background_fills_the_cache(tmp_path, monkeypatch):
    """Compile in a child that tells how far it is, and end it with its owner."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    monkeypatch.setattr('procphys_ros.ros.background_compilation.is_complete', lambda: False)
    said: list[str] = []
    background = BackgroundCompilation(said.append)
    background.start()
    while not background.progress.startswith('1/'):  # the time limit of all tests ends this
        assert background.progress, said
        sleep(0.05)
    background.close()
    assert list(tmp_path.rglob('*.nbc'))
    assert 'background' in said[0]


def test_complete_cache_needs_no_child(monkeypatch):
    """Start nothing when everything is there."""
    monkeypatch.setattr('procphys_ros.ros.background_compilation.is_complete', lambda: True)
    said: list[str] = []
    background = BackgroundCompilation(said.append)
    background.start()
    background.close()
    assert (background.progress, said) == ('', [])


@pytest.mark.parametrize('number', ['-1', '1.5', 'all'])
def test_jobs_are_a_whole_number(number, capsys):
    """Refuse other numbers of processes in one line."""
    with pytest.raises(SystemExit):
        warming.main(['--jobs', number])
    assert f'"{number}" is not a whole number' in capsys.readouterr().err


def test_overload_compiles_once(tmp_path, monkeypatch):
    """Return whether an overload had to be compiled."""
    shortest = min(shipped()[0], key=lambda overload: len(str(overload.arguments)))
    code = ('from procphys_ros.compilation.overloads import Overload; '
            f'print(Overload(*{[shortest.module, shortest.name, shortest.arguments]}).compile())')
    answers = [subprocess.run([sys.executable, '-c', code], cwd=ROOT, text=True, check=True,
                              env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)},
                              capture_output=True).stdout.strip() for _ in range(2)]
    assert answers == ['True', 'False']
