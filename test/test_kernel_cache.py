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

from concurrent.futures import ThreadPoolExecutor
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
from tempfile import TemporaryDirectory
from time import time

import pytest

from procphys_ros.compilation import folder, kernel, subroutine
from procphys_ros.language.parsers import make_parser

ROOT = Path(__file__).resolve().parents[1]
CALLEE = """
from procphys_ros.compilation import subroutine

FACTOR = {factor}

@subroutine
def enlarge(x):
    return FACTOR * x
"""
CALLER = """
from procphys_ros.compilation import kernel
from procphys_ros.callee import enlarge

@kernel
def total(values):
    result = values[0] - values[0]
    for value in values:
        result += enlarge(value)
    return result
"""
PROGRAM = """
import numba.core.event as event
import numpy as np

class Compiled(event.Listener):
    count = 0
    def on_start(self, _): Compiled.count += 1
    def on_end(self, _): pass

event.register('numba:compile', Compiled())
{before}
from procphys_ros.caller import total
print(total(np.array([1, 10], {dtype!r})), Compiled.count)
{after}
"""
# Runs each line of its input as a program, in a fork: numba's compiler is there already.
SERVER = """
import json, os, sys, traceback
from contextlib import suppress
import numba, numpy

numba.njit(lambda x: x[0] + 1.0)(numpy.ones(1))
sys.dont_write_bytecode = True
for line in sys.stdin:
    program, folder, environment, outputs = json.loads(line)
    files = [os.open(path, os.O_WRONLY | os.O_CREAT) for path in outputs]
    if os.fork() == 0:
        for number, file in enumerate(files, 1):
            os.dup2(file, number)
        os.chdir(folder)
        sys.path.insert(0, folder)
        os.environ.update(environment)
        numba.core.config.reload_config()
        try:
            exec(program, {'__name__': '__main__'})
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        os._exit(0)
    for file in files:
        os.close(file)
with suppress(ChildProcessError):
    while True:
        os.wait()
"""
LOCKED = pytest.mark.skipif(os.nice(0) > 0, reason='processes of low priority hold no locks')


@pytest.fixture(scope='module', autouse=True)
def server():
    """Start what all processes are forked from."""
    known = {name: value for name, value in os.environ.items()
             if name not in ('NUMBA_CACHE_DIR', 'PYTHONPATH')}
    with subprocess.Popen([sys.executable, '-c', SERVER], stdin=subprocess.PIPE,
                          env=known) as Installation.server:
        yield  # it ends with its input


class Installation:
    """
    A copy of the package with one kernel more, which calls a subroutine of another module.

    :param root: of the package, `site`, and of XDG_CACHE_HOME of its processes, `cache`.
    """

    server: subprocess.Popen

    def __init__(self, root: Path):
        self.site, self.cache = root / 'site', root / 'cache'
        (self.site / 'procphys_ros').mkdir(parents=True)
        for part in ('__init__.py', 'progress.py', 'files', 'errors.py', 'compilation'):
            copy = shutil.copy if part.endswith('.py') else shutil.copytree
            copy(ROOT / 'procphys_ros' / part, self.site / 'procphys_ros' / part)
        self.add('caller', CALLER)
        self.install(2.0)

    def install(self, factor: float) -> None:
        """Replace the file of the callee only, as an upgrade may."""
        self.add('callee', CALLEE.format(factor=factor))

    def add(self, module: str, source: str) -> None:
        """Write another module."""
        (self.site / 'procphys_ros' / f'{module}.py').write_text(source, 'utf-8')

    def run(self, dtype: str = 'f8', before: str = '', after: str = '',
            **environment: str) -> tuple[float, int, str]:
        """
        Call the caller in a new process.

        :param dtype: of the argument.
        :param before: what the process is to do before.
        :param after: what it is to do then; it prints its own results.
        :param environment: variables.
        :returns: result, number of functions compiled, errors and warnings.
        """
        program = PROGRAM.format(dtype=dtype, before=before, after=after)
        with TemporaryDirectory() as folder:
            said, errors = Path(folder, 'said'), Path(folder, 'errors')
            os.mkfifo(said)  # ends with the process
            order = [program, str(self.site), {'XDG_CACHE_HOME': str(self.cache), **environment},
                     [str(said), str(errors)]]
            os.write(self.server.stdin.fileno(), f'{json.dumps(order)}\n'.encode())
            *_, result, compiled = ['', '', *said.read_text().split()]
            assert compiled, errors.read_text()
            return float(result), int(compiled), errors.read_text()


@pytest.fixture(scope='module')
def first(tmp_path_factory) -> Installation:
    """Install the package, and run it once."""
    package = Installation(tmp_path_factory.mktemp('first'))
    assert package.run() == (22.0, 2, '')
    return package


@pytest.fixture
def fresh(tmp_path: Path) -> Installation:
    """Install the package for a user without kernels."""
    return Installation(tmp_path)


@pytest.fixture
def used(fresh: Installation, first: Installation) -> Installation:
    """Install the package with the kernels of another installation that has run."""
    shutil.copytree(first.cache, fresh.cache)
    return fresh


def compiled_files(root: Path) -> list[Path]:
    """List the files of compiled kernels."""
    return sorted(root.rglob('*.nbc'))


def test_later_processes_compile_nothing(first, used):
    """Find kernels in the user's cache folder, from any installation of the same sources."""
    assert first.run()[:2] == used.run()[:2] == (22.0, 0)
    assert len(compiled_files(first.cache / 'procphys_ros' / 'kernels')) == 2
    assert compiled_files(first.site) == []


def test_upgrade_of_a_callee_takes_effect(used):
    """Compile a caller anew whose own file is the same; find the old one on the way back."""
    used.install(3.0)
    assert used.run()[:2] == (33.0, 2)
    used.install(2.0)
    assert used.run()[:2] == (22.0, 0)


def test_edit_of_another_module_compiles_nothing(used):
    """Keep the kernels of a module that neither is nor imports what was edited."""
    used.add('another', '')
    used.add('callee', CALLEE.format(factor=2.0) + 'from procphys_ros import another\n')
    assert used.run()[:2] == (22.0, 2)
    for module, source, compiled in [('third', 'from procphys_ros import caller', 0),
                                     ('caller', f'{CALLER}\n', 1), ('another', 'LIMIT = 1', 2)]:
        used.add(module, source)
        assert used.run()[:2] == (22.0, compiled), module


@pytest.mark.parametrize('imported', [
    'from procphys_ros.deep import module', 'from procphys_ros.deep import other, module as m',
    'from procphys_ros.deep import (  # (sorted)\n    other,  # )\n    module)',
    'from procphys_ros.deep \\\n    import other, \\\n    module',
    'import procphys_ros.deep.module',
    'if 1: from procphys_ros.deep import other; from procphys_ros.deep.module import x',
    'import os, procphys_ros.deep.module as m', 'from procphys_ros.deep.module import x',
    'def later():\n    from procphys_ros.deep.module import x'])
def test_imports_are_found_however_written(imported, tmp_path, monkeypatch):
    """Find a module by all forms of an import statement."""
    monkeypatch.setattr(folder, '_ROOT', tmp_path)
    (tmp_path / 'procphys_ros' / 'deep').mkdir(parents=True)
    for name, source in {'__init__': '', 'first': imported, 'deep/__init__': '',
                         'deep/module': 'from procphys_ros import last', 'deep/other': '',
                         'last': ''}.items():
        (tmp_path / 'procphys_ros' / f'{name}.py').write_text(source, 'utf-8')
    for found in (folder._read, folder._module_of):
        found.cache_clear()
    try:
        assert folder.sources('procphys_ros.first') >= {'procphys_ros.deep.module',
                                                        'procphys_ros.last'}
    finally:
        for found in (folder._read, folder._module_of):
            found.cache_clear()


def test_fields_of_named_tuples_take_effect(used):
    """Compile a kernel anew when the fields of its argument are exchanged, where none imports."""
    used.add('sample', 'from procphys_ros.compilation import kernel\n\n'
             '@kernel\ndef first(pair):\n    return pair.low\n')
    after = ('from procphys_ros.sample import first\nfrom procphys_ros.pair import Pair\n'
             'before = Compiled.count\nprint(first(Pair(1.0, 2.0)), Compiled.count - before)')
    for fields, expected in [('low high', (1.0, 1)), ('low high', (1.0, 0)),
                             ('high low', (2.0, 1))]:
        used.add('pair', 'from collections import namedtuple\n'
                 f'Pair = namedtuple("Pair", "{fields}")')
        assert used.run(after=after)[:2] == expected


def test_setting_of_numba_takes_effect(used):
    """Keep kernels with bounds checks apart from those without."""
    assert used.run(NUMBA_BOUNDSCHECK='1')[:2] == (22.0, 2)


def test_numba_cache_dir_is_respected(fresh, tmp_path):
    """Put kernels where NUMBA_CACHE_DIR says."""
    fresh.run(NUMBA_CACHE_DIR=str(tmp_path / 'given'))
    assert len(compiled_files(tmp_path / 'given')) == 2
    assert not (tmp_path / 'cache').exists()


@pytest.mark.parametrize('suffix', ['nbc', 'nbi'])
def test_damaged_files_are_replaced(used, suffix):
    """Compile again what was cut short."""
    for path in used.cache.rglob(f'*.{suffix}'):
        path.write_bytes(path.read_bytes()[:20])
    assert used.run()[:2] == (22.0, 2)
    assert used.run()[:2] == (22.0, 0)


def test_kernels_run_without_a_folder_for_them(fresh, tmp_path):
    """Compile in every process where nothing can be written, and say so."""
    (tmp_path / 'cache').write_text('a file is in the way', 'utf-8')
    result, compiled, errors = fresh.run()
    assert (result, compiled) == (22.0, 2)
    assert errors.count('NUMBA_CACHE_DIR') == 1


def test_a_full_disk_stops_no_kernel(fresh):
    """Compile in every process where files cannot be completed, and say so."""
    full = ('import os, errno\n'
            'def replace(*_): raise OSError(errno.ENOSPC, "No space left on device")\n'
            'os.replace = replace')
    result, compiled, errors = fresh.run(before=full)
    assert (result, compiled) == (22.0, 2)
    assert errors.count('No space left on device') == 1


def test_a_folder_may_be_read_only(used):
    """Load kernels from a folder that belongs to somebody else; compile and say what it lacks."""
    locked = ('import errno, os\n'
              'def refuse(*_): raise OSError(errno.EROFS, "Read-only file system")\n'
              'os.open = os.utime = refuse')
    before = sorted(used.cache.rglob('*'))
    assert used.run(before=locked) == (22.0, 0, '')
    result, compiled, errors = used.run('f4', before=locked)
    assert (result, compiled, errors.count('Read-only file system')) == (22.0, 2, 1)
    assert sorted(used.cache.rglob('*')) == before


def test_without_a_home_no_folder_is_made(tmp_path, monkeypatch):
    """Run as a user without a home: nothing is kept, nor put into the working folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv('HOME', raising=False)
    monkeypatch.setattr('os.path.expanduser', lambda path: path)
    monkeypatch.delenv('XDG_CACHE_HOME', raising=False)
    monkeypatch.setattr('numba.config.CACHE_DIR', '')
    with pytest.raises(OSError, match='no home folder'):
        folder.prepare(folder.user_folder() / 'small')
    assert not (tmp_path / '~').exists()


def test_kernels_survive_removal_by_others(fresh):
    """Go on compiling when another process has removed the folder that is in use."""
    removal = (f'import shutil; shutil.rmtree({str(fresh.cache)!r})\n'
               "print(total(np.array([1.0, 10.0], 'f4')), Compiled.count)")
    assert fresh.run(after=removal)[:2] == (22.0, 4)
    assert compiled_files(fresh.cache)


def test_old_folders_are_removed(tmp_path, monkeypatch):
    """Keep the folders of each module that were used last and within a month."""
    monkeypatch.setattr(folder, 'user_folder', lambda: tmp_path)
    monkeypatch.setattr(folder, 'kernel_folder', lambda module: tmp_path / f'{module}-present')
    for age in range(20):
        (tmp_path / f'one.module-{age:02}').mkdir()
        then = time() - age
        os.utime(tmp_path / f'one.module-{age:02}', (then, then))
    for module, used in [('used', time() - 86400.0), ('forgotten', 0.0)]:
        (tmp_path / f'{module}-0' / 'inner').mkdir(parents=True)
        os.utime(tmp_path / f'{module}-0', (used, used))
    assert not folder.is_complete()
    folder.mark_complete()
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {*(f'one.module-{age:02}' for age in range(8)), 'used-0',
                    'procphys_ros.warming.scenes-present'}
    assert folder.is_complete()


@LOCKED
def test_processes_share_the_work(fresh):
    """Compile each overload once though several processes need it, and find all of them again."""
    with ThreadPoolExecutor(3) as all_of_them:
        runs = list(all_of_them.map(fresh.run, ['f8', 'f8', 'i8']))
    assert [result for result, _, _ in runs] == [22.0] * 3
    assert sum(compiled for _, compiled, _ in runs) == 4
    assert fresh.run('i8')[:2] == fresh.run()[:2] == (22.0, 0)


def test_what_numba_makes_has_other_names_in_every_process(fresh):
    """Compile one kernel in two processes; of two functions with one name either might be run."""
    fresh.add('sorting', 'from procphys_ros.compilation import kernel\n\n'
              '@kernel\ndef largest(x):\n    return x.max()\n')
    names = r"""import re, sys; from procphys_ros.sorting import largest; largest(np.ones(2))
names = re.findall(r'define[^@]*@"?(_ZN5numba[^"(]*)', *largest.inspect_llvm().values())
print(*names, file=sys.stderr); print(len(names), 0)"""
    found = []
    for user in ('one', 'other'):
        count, _, said = fresh.run(after=names, XDG_CACHE_HOME=str(fresh.cache / user))
        found.append(set(said.split()))
        assert len(found[-1]) == count > 0
    assert not found[0] & found[1]


def test_another_numba_compiles_at_every_start(fresh):
    """Warn and go on where numba lacks what the cache is made of."""
    other = 'import numba.core.bytecode as b; del b.FunctionIdentity._unique_ids'
    restored = ('import numba.core.bytecode as b, itertools, procphys_ros.compilation\n'
                'b.FunctionIdentity._unique_ids = itertools.count(1)')
    result, compiled, errors = fresh.run(before=f'{other}\n'
                                         'from procphys_ros.compilation import decorator\n'
                                         f'decorator._cache_module()\n{restored}')
    assert (result, compiled, errors.count('has another cache')) == (22.0, 2, 1)
    assert compiled_files(fresh.cache) == []


@pytest.mark.parametrize('decorator', [kernel, subroutine])
def test_kernels_leave_the_threads_of_numba_alone(decorator):
    """Refuse them: what comes from a file does not start them."""
    with pytest.raises(TypeError, match='parallel'):
        decorator(parallel=True)(lambda x: x)


def test_kernels_of_others_are_not_kept():
    """Keep no kernel whose sources the folder's name does not tell of."""
    assert kernel(lambda x: x).stats.cache_path is None


_SUM = """
start: NUMBER ("+" NUMBER)*
NUMBER: /[0-9]+/
"""


@pytest.fixture
def tables(tmp_path, monkeypatch) -> Path:
    """Keep tables of parsers in a folder of the test's own, and say which."""
    monkeypatch.setattr('procphys_ros.language.parsers.kernel_folder', lambda _: tmp_path)
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


def test_parsers_need_no_folder(tables, monkeypatch):
    """Make them in every process where nothing can be written."""
    (tables / 'file').write_text('in the way', 'utf-8')
    monkeypatch.setattr('procphys_ros.language.parsers.kernel_folder', lambda _: tables / 'file')
    assert make_parser('sum', _SUM).parse('1+2').children == ['1', '2']
