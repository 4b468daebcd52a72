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


"""Compiled kernels: found again by later processes, never after what they contain has changed."""

import ast
from concurrent.futures import ThreadPoolExecutor
import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

from procphys_ros.compilation import kernel, subroutine
from procphys_ros.compilation.claims import claim, release
from procphys_ros.compilation.folders import cache_folder, prepare
from procphys_ros.compilation.sources import imported_names
from procphys_ros.language.parsers import make_parser

ROOT = Path(__file__).resolve().parents[1]
CALLEE = """
from procphys_ros.compilation import {decorator}

FACTOR = {factor}

@{decorator}
def enlarge(x):
    return FACTOR * x
"""
CALLER = """
from procphys_ros.compilation import kernel
from small.callee import (  # one (1) of many
    enlarge)

@kernel
def total(values):
    result = 0.0
    for value in values:
        result += enlarge(value)
    return result
"""
FACTOR = """
import hashlib
import numpy as np
from procphys_ros.physics.masonry.factor import Factor

count = 9
rows = np.random.default_rng(1).random((6 * count, 6 * count))
matrix = (rows @ rows.T + 6 * count * np.eye(6 * count)).reshape(count, 6, count, 6)
blocks = np.ascontiguousarray(matrix.swapaxes(1, 2)).reshape(-1, 6, 6)
factor = Factor(np.arange(0, count ** 2 + 1, count), np.tile(np.arange(count), count), blocks)
print(hashlib.sha256(factor.panels[3].tobytes() + factor.panels[4].tobytes()).hexdigest())
"""
COUNTING = """
import numba.core.event as event

class Compiled(event.Listener):
    count = 0
    def on_start(self, _): Compiled.count += 1
    def on_end(self, _): pass

event.register('numba:compile', Compiled())
"""
PROGRAM = COUNTING + """
import numpy as np
from small.caller import total
print(total(np.array([1.0, 10.0])), Compiled.count)
"""
CLAIMS = pytest.mark.skipif(os.nice(0) > 0, reason='processes of low priority claim nothing')


def run_python(program: str, folder: Path, cache: Path,
               **environment: str) -> subprocess.CompletedProcess:
    """Run a program with the modules of a folder, and the caches of another."""
    known = {**os.environ, 'XDG_CACHE_HOME': str(cache), 'PYTHONDONTWRITEBYTECODE': '1',
             'PYTHONPATH': os.pathsep.join([str(folder), str(ROOT)])}
    known.pop('NUMBA_CACHE_DIR', None)
    return subprocess.run([sys.executable, '-c', program], env={**known, **environment},
                          capture_output=True, text=True, check=True)


class SmallPackage:
    """
    A package of two kernels, one of which calls the other, in processes of its own.

    :param folder: where it lies.
    :param cache: XDG_CACHE_HOME of its processes.
    """

    def __init__(self, folder: Path, cache: Path):
        self._folder, self._cache = folder, cache
        (folder / 'small').mkdir(parents=True)
        (folder / 'small' / '__init__.py').touch()
        (folder / 'small' / 'caller.py').write_text(CALLER, 'utf-8')

    def install(self, factor: float, decorator: str = 'kernel') -> None:
        """Replace the file of the callee only, as an upgrade may."""
        (self._folder / 'small' / 'callee.py').write_text(
            CALLEE.format(factor=factor, decorator=decorator), 'utf-8')

    def run(self, then: str = '', **environment: str) -> tuple[float, int, str]:
        """
        Call the caller in a new process.

        :param then: what the process is to do after that; it prints its own results.
        :param environment: variables.
        :returns: result, number of overloads compiled, errors and warnings.
        """
        done = run_python(PROGRAM + then, self._folder, self._cache, **environment)
        result, compiled = done.stdout.split()[-2:]
        return float(result), int(compiled), done.stderr


@pytest.fixture
def small(tmp_path: Path) -> SmallPackage:
    """Install a small package that returns 22."""
    package = SmallPackage(tmp_path / 'site', tmp_path / 'cache')
    package.install(2.0)
    return package


@pytest.fixture(scope='module')
def first(tmp_path_factory) -> tuple[SmallPackage, Path]:
    """Make a package that has run once; return it and the folder of its `site` and `cache`."""
    folder = tmp_path_factory.mktemp('first')
    package = SmallPackage(folder / 'site', folder / 'cache')
    package.install(2.0)
    assert package.run()[:2] == (22.0, 2)
    return package, folder


@pytest.fixture
def used(small: SmallPackage, tmp_path: Path, first: tuple) -> SmallPackage:
    """Install the package with the cache folder of another installation that has run."""
    shutil.copytree(first[1] / 'cache', tmp_path / 'cache')
    return small


def compiled_files(folder: Path) -> list[Path]:
    """List the files of compiled kernels."""
    return sorted(folder.rglob('*.nbc'))


def test_second_process_compiles_nothing(first):
    """Find kernels again in the user's cache folder, and keep the installation clean."""
    package, folder = first
    assert package.run()[:2] == (22.0, 0)
    assert len(compiled_files(folder / 'cache' / 'procphys_ros' / 'kernels')) == 2
    assert compiled_files(folder / 'site') == []


def test_without_a_home_no_folder_is_made(tmp_path, monkeypatch):
    """Run as a user without a home: nothing is kept, nor put into the working folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('HOME', raising=False)
    monkeypatch.setattr('os.path.expanduser', lambda path: path)
    monkeypatch.delenv('XDG_CACHE_HOME', raising=False)
    monkeypatch.setattr('numba.config.CACHE_DIR', '')
    with pytest.raises(OSError, match='no home folder'):
        prepare(cache_folder() / 'environment' / 'small-0123')
    assert not (tmp_path / '~').exists()


def test_other_install_path_compiles_nothing(used):
    """Share kernels between installations of the same sources."""
    assert used.run()[:2] == (22.0, 0)


def test_upgrade_of_a_callee_takes_effect(used):
    """Compile a caller anew whose own file is the same; find the old one on the way back."""
    used.install(3.0)
    assert used.run()[:2] == (33.0, 2)
    used.install(2.0)
    assert used.run()[:2] == (22.0, 0)


def test_subroutines_are_kept_for_other_kernels(small):
    """Take what was compiled of a subroutine into a kernel that is compiled later."""
    small.install(2.0, 'subroutine')
    assert small.run()[:2] == (22.0, 2)
    assert small.run()[:2] == (22.0, 0)
    integers = 'print(total(np.array([1, 10])), Compiled.count)'
    assert small.run(then=integers)[:2] == (22.0, 2)
    more = ('from small.callee import enlarge; import small.caller as caller\n'
            'from procphys_ros.compilation import kernel\n'
            'twice = kernel(lambda x: enlarge(enlarge(x)))\n'
            'print(twice(5.0), Compiled.count)')
    assert small.run(then=more)[:2] == (20.0, 1)


def test_what_numba_makes_is_not_taken_for_another(tmp_path):
    """Link two subroutines of two processes, in which numba gave its closures the same names."""
    for name, end in (('first', 'start'), ('last', 'stop')):
        (tmp_path / f'{name}.py').write_text(
            'from procphys_ros.compilation import kernel, subroutine\n\n'
            f'@subroutine\ndef {name}(numbers):\n    return numbers.{end}\n\n'
            f'@kernel\ndef of_nine():\n    return {name}(range(3, 9))\n', 'utf-8')
    both = ('from first import first\nfrom last import last\n'
            'from procphys_ros.compilation import kernel\n'
            'both = kernel(lambda count: (first(range(3, count)), last(range(3, count))))\n'
            'print(both(9))')
    found = [run_python(program, tmp_path, tmp_path / 'cache').stdout.strip() for program in (
        'import first\nprint(first.of_nine())', 'import last\nprint(last.of_nine())', both)]
    assert found == ['3', '9', '(3, 9)']


def test_python_cannot_call_a_subroutine(small):
    """Name what was called, and compile nothing."""
    small.install(2.0, 'subroutine')
    refused = """
from small.callee import enlarge
try:
    enlarge(1.0)
except TypeError as error:
    print(7.0 if str(error).startswith('enlarge is a subroutine') else 0.0, 0)
"""
    assert small.run(then=refused)[:2] == (7.0, 0)


@pytest.mark.parametrize('decorator', [kernel, subroutine])
def test_kernels_leave_the_threads_of_numba_alone(decorator):
    """Refuse them: what comes from a file does not start them."""
    with pytest.raises(TypeError, match='parallel'):
        decorator(parallel=True)(lambda x: x)


def test_setting_of_numba_takes_effect(used):
    """Keep kernels with bounds checks apart from those without."""
    assert used.run(NUMBA_BOUNDSCHECK='1')[:2] == (22.0, 2)


def test_numba_cache_dir_is_respected(small, tmp_path):
    """Put kernels where NUMBA_CACHE_DIR says."""
    small.run(NUMBA_CACHE_DIR=str(tmp_path / 'given'))
    assert len(compiled_files(tmp_path / 'given')) == 2
    assert not (tmp_path / 'cache').exists()


def test_damaged_files_are_replaced(used, tmp_path):
    """Compile again what was cut short."""
    for path in compiled_files(tmp_path / 'cache'):
        path.write_bytes(path.read_bytes()[:100])
    assert used.run()[:2] == (22.0, 2)
    assert used.run()[:2] == (22.0, 0)


def test_kernels_run_without_a_folder_for_them(small, tmp_path):
    """Compile in every process where nothing can be written, and say so."""
    (tmp_path / 'cache').write_text('a file is in the way', 'utf-8')
    result, compiled, errors = small.run()
    assert (result, compiled) == (22.0, 2)
    assert errors.count('NUMBA_CACHE_DIR') == 1


def test_old_versions_are_removed(tmp_path):
    """Keep the versions of a module that were used last, whatever its neighbours do."""
    def use(module: str, version: int) -> Path:
        folder = tmp_path / 'environment' / f'{module}-{version:016x}'
        prepare(folder)
        os.utime(folder, (version, version))
        return folder

    neighbour = use('trees', 0)
    folders = [use('walls', version) for version in range(1, 20)]
    assert neighbour.is_dir()
    assert not any(folder.exists() for folder in folders[:10])
    assert all(folder.is_dir() for folder in folders[-8:])


def test_kernels_of_forgotten_environments_are_removed(tmp_path):
    """Remove what was compiled for a numba that nothing has used for months."""
    old, present = tmp_path / 'numba-1', tmp_path / 'numba-2'
    prepare(old / 'trees-1')
    os.utime(old, (0.0, 0.0))
    prepare(present / 'trees-1')
    assert present.is_dir()
    assert not old.exists()


def test_kernels_survive_removal_by_others(small, tmp_path):
    """Go on compiling when another process has removed the folder that is in use."""
    cache = str(tmp_path / 'cache')
    removal = (f'import shutil; shutil.rmtree({cache!r}); '
               "print(total(np.array([1.0, 10.0], dtype='f4')), Compiled.count)")
    assert small.run(then=removal)[:2] == (22.0, 4)
    assert compiled_files(tmp_path / 'cache')


@CLAIMS
def test_two_processes_share_the_work(small):
    """Compile each kernel once when two processes need them at the same time."""
    with ThreadPoolExecutor(2) as both:
        runs = list(both.map(lambda _: small.run(), range(2)))
    assert [result for result, _, _ in runs] == [22.0, 22.0]
    assert sum(compiled for _, compiled, _ in runs) == 2


@CLAIMS
@pytest.mark.parametrize('before, is_claimed', [('', True), ('os.nice(1);', False)])
def test_claims_end_with_their_process(tmp_path, before, is_claimed):
    """Wait for nobody who has died; processes of low priority make no claims at all."""
    path = tmp_path / 'trees-0' / 'step.nbc'
    code = (f'import os, pathlib, procphys_ros.compilation.claims as claims; {before}'
            f'path = pathlib.Path({str(path)!r}); claims.claim(path);'
            f'assert path.with_suffix(".lock").exists() is {is_claimed}; os._exit(0)')
    subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True)
    claim(path)
    assert path.with_suffix('.lock').exists()
    release(path)
    assert list(path.parent.iterdir()) == []


def test_kernels_from_files_do_the_same_to_the_bit(tmp_path):
    """Factor a matrix by kernels that round freely: just compiled, and loaded."""
    hashes = [subprocess.run([sys.executable, '-c', FACTOR], cwd=ROOT, text=True, check=True,
                             env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)},
                             capture_output=True).stdout for _ in range(2)]
    assert hashes[0] == hashes[1]


LOADING = COUNTING + """
from procphys_ros.compilation.overloads import shipped

overloads = [overload for group in shipped() for overload in group]
for overload in overloads:
    overload.compile()
print(len(overloads), Compiled.count)
"""


def test_all_kernels_load():
    """Load each kernel that Python calls; a name that its code lacks would end the process."""
    for _ in range(2):  # the first one compiles what is not there yet
        done = subprocess.run([sys.executable, '-c', LOADING], cwd=ROOT, text=True, check=True,
                              capture_output=True).stdout.split()
        if int(done[1]) == 0:
            break
    assert int(done[0]) > 100
    assert int(done[1]) == 0


_SUM = """
start: NUMBER ("+" NUMBER)*
NUMBER: /[0-9]+/
"""


@pytest.fixture
def tables(tmp_path, monkeypatch) -> Path:
    """Keep tables of parsers in a folder of the test's own, and say which."""
    monkeypatch.setattr('procphys_ros.language.parsers.environment_folder',
                        lambda: tmp_path / 'numba')
    return tmp_path


def test_tables_of_parsers_are_kept(tables, monkeypatch):
    """Read again what the first parser wrote, places included; make another language's anew."""
    first = make_parser('sum', _SUM).parse('1+23')
    monkeypatch.setattr('lark.Lark.__init__', None)  # nothing is made any more
    again = make_parser('sum', _SUM).parse('1+23')
    assert again == first and again.meta.end_column == first.meta.end_column == 5
    with pytest.raises(TypeError):
        make_parser('sum', _SUM.replace('"+"', '"-"'))


def test_damaged_tables_are_replaced(tables, monkeypatch):
    """Make a parser whose file was cut short, and write it anew."""
    make_parser('sum', _SUM)
    file, = (path for path in tables.rglob('*') if path.is_file())
    file.write_bytes(file.read_bytes()[:100])
    assert make_parser('sum', _SUM).parse('1+2').children == ['1', '2']
    monkeypatch.setattr('lark.Lark.__init__', None)
    assert make_parser('sum', _SUM).parse('1+2').children == ['1', '2']


def test_parsers_need_no_folder(tables):
    """Make them in every process where nothing can be written."""
    (tables / 'numba').write_text('a file is in the way', 'utf-8')
    assert make_parser('sum', _SUM).parse('1+2').children == ['1', '2']


def test_imports_are_found():
    """Find the same imports in a source as Python's parser does."""
    for path in sorted((ROOT / 'procphys_ros').rglob('*.py')):
        text = path.read_text('utf-8')
        expected = set()
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                expected |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                expected |= {node.module, *(f'{node.module}.{a.name}' for a in node.names)}
        assert expected <= imported_names(text), path
