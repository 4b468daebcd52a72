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

"""All kernels compiled beforehand: small scenes call each of them."""

from collections.abc import Iterator
import dis
from functools import cache
import importlib
import inspect
import json
import os
from pathlib import Path
import pkgutil
import subprocess
import sys
from time import sleep
from typing import Any

import pytest

import procphys_ros
from procphys_ros.compilation import folder
from procphys_ros.compilation.decorator import KERNELS, SUBROUTINES
from procphys_ros.ros.background_compilation import BackgroundCompilation
from procphys_ros.warming import command

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = """
import json
from procphys_ros.compilation.decorator import KERNELS
from procphys_ros.files.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation
from procphys_ros.warming.scenes import SCENES

def tell():
    print(json.dumps({name: list(map(str, one.signatures)) for name, one in KERNELS.items()
                      if one.signatures}))

for run in SCENES.values():
    run()
tell()
for name in ('demo', 'dry_stone', 'ivy_on_wall', 'mechanisms'):
    simulation = Simulation(Scene.from_yaml(shared_folder() / 'config' / f'{name}.yaml'))
    simulation.step(20)
    simulation.explode(tuple(simulation.blueprint.poses[0, :3] + (0.0, 1.0, 1.0)), 3.0)
    simulation.step(10)
    simulation.close()
tell()
"""


@pytest.fixture(scope='module')
def called() -> list[dict[str, list[str]]]:
    """Return the types that small scenes call each kernel with; then those of shipped ones too."""
    done = subprocess.run([sys.executable, '-c', PROGRAM], cwd=ROOT, capture_output=True,
                          text=True)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith('{')]


@cache
def import_all() -> None:
    """Import the whole package, but what draws pictures and the node."""
    for module in pkgutil.walk_packages(procphys_ros.__path__, 'procphys_ros.'):
        if not module.name.startswith(('procphys_ros.render', 'procphys_ros.ros')):
            importlib.import_module(module.name)


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


def callees(kernel: Any) -> set[str]:
    """List the kernels and subroutines that a kernel calls."""
    found = [value.py_func for value in loaded(kernel.py_func) if hasattr(value, 'py_func')]
    return {f'{value.__module__}.{value.__qualname__}' for value in found}


def test_small_scenes_call_all_kernels(called):
    """Reach every kernel of the package from those that the scenes call."""
    import_all()
    known = {name: one for name, one in {**KERNELS, **SUBROUTINES}.items()
             if name.startswith('procphys_ros.')}
    waiting, reached = set(called[0]), set()
    while waiting:
        name = waiting.pop()
        reached.add(name)
        waiting |= callees(known[name]) - reached
    assert known.keys() - reached == set()


def test_simulations_call_what_is_compiled(called):
    """Run shipped scenes, and blow something up: no kernel is called with other types."""
    assert len(called[0]) > 80
    assert called[1] == called[0]


def test_scenes_import_all_kernels():
    """Compile again after an edit of any kernel: scenes name what is imported by its name only."""
    import_all()
    modules = {name.rpartition('.')[0] for name in {**KERNELS, **SUBROUTINES}
               if name.startswith('procphys_ros.')}
    assert len(modules) > 80
    assert modules - folder.sources('procphys_ros.warming.scenes') == set()


def python_functions() -> Iterator[Any]:
    """Yield all functions and methods of the package that are not compiled."""
    import_all()
    for module in [m for name, m in sys.modules.items() if name.startswith('procphys_ros.')]:
        for scope in (module, *filter(inspect.isclass, vars(module).values())):
            yield from filter(inspect.isfunction, vars(scope).values())


def test_only_kernels_call_subroutines():
    """Find no subroutine, which would end the process, among what Python's functions load."""
    functions = list(python_functions())
    subroutines = {id(one): one.__name__ for one in SUBROUTINES.values()}
    assert len(functions) > 1000 and len(subroutines) > 100
    for function in functions:
        if not set(subroutines.values()).isdisjoint(function.__code__.co_names):
            assert not any(id(one) in subroutines for one in loaded(function)), function


def test_background_fills_the_cache(tmp_path, monkeypatch):
    """Compile in a child that tells how far it is, and end it with its owner."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    monkeypatch.setattr('procphys_ros.ros.background_compilation.is_complete', lambda: False)
    said: list[str] = []
    background = BackgroundCompilation(said.append)
    background.start()
    while not list(tmp_path.rglob('*.nbc')):  # the time limit of all tests ends this
        assert background.progress, said
        sleep(0.05)
    background.close()
    assert 'background' in said[0]


def test_complete_cache_needs_no_child(monkeypatch):
    """Start nothing when everything is there."""
    monkeypatch.setattr('procphys_ros.ros.background_compilation.is_complete', lambda: True)
    said: list[str] = []
    background = BackgroundCompilation(said.append)
    background.start()
    background.close()
    assert (background.progress, said) == ('', [])


@pytest.mark.parametrize('jobs', [1, 2])
def test_progress_is_told_scene_by_scene(jobs, monkeypatch, capsys):
    """Run each scene once, in as many processes as were asked for, and mark the end."""
    monkeypatch.setattr(command, 'is_complete', lambda: False)
    marked: list[int] = []
    monkeypatch.setattr(command, 'mark_complete', lambda: marked.append(1))
    monkeypatch.setattr('procphys_ros.warming.scenes.SCENES',
                        dict.fromkeys(['one', 'two'], os.getpid))
    if jobs == 2:  # other processes know the real scenes only
        monkeypatch.setattr('procphys_ros.warming.scenes.SCENES',
                            {'step trees': os.getpid})
    assert command.main(['--jobs', str(jobs)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[:-1] == (['1/2 one', '2/2 two'] if jobs == 1 else ['1/1 step trees'])
    assert marked == [1]


@pytest.mark.parametrize('number', ['-1', '1.5', 'all'])
def test_jobs_are_a_whole_number(number, capsys):
    """Refuse other numbers of processes in one line."""
    with pytest.raises(SystemExit):
        command.main(['--jobs', number])
    assert f'"{number}" is not a whole number' in capsys.readouterr().err
