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
import os
from pathlib import Path
import shutil
import subprocess
import sys
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
LOCKED = pytest.mark.skipif(os.nice(0) > 0, reason='processes of low priority hold no locks')


class Installation:
    """
    A copy of the package with one kernel more, which calls a subroutine of another module.

    :param folder: where it lies.
    :param cache: XDG_CACHE_HOME of its processes.
    """

    def __init__(self, folder: Path, cache: Path):
        self._folder, self.cache = folder, cache
        for part in ('__init__', 'progress', 'files', 'errors', 'compilation'):
            source = ROOT / 'procphys_ros' / part
            if source.is_dir():
                shutil.copytree(source, folder / 'procphys_ros' / part)
            else:
                (folder / 'procphys_ros').mkdir(parents=True, exist_ok=True)
                shutil.copy(source.with_suffix('.py'), folder / 'procphys_ros')
        self.add('caller', CALLER)
        self.install(2.0)

    def install(self, factor: float) -> None:
        """Replace the file of the callee only, as an upgrade may."""
        self.add('callee', CALLEE.format(factor=factor))

    def add(self, module: str, source: str) -> None:
        """Write another module."""
        (self._folder / 'procphys_ros' / f'{module}.py').write_text(source, 'utf-8')

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
        known = {**os.environ, 'XDG_CACHE_HOME': str(self.cache), 'PYTHONDONTWRITEBYTECODE': '1',
                 'PYTHONPATH': str(self._folder)}
        known.pop('NUMBA_CACHE_DIR', None)
        done = subprocess.run(
            [sys.executable, '-c', PROGRAM.format(dtype=dtype, before=before, after=after)],
            env={**known, **environment}, cwd=self._folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        result, compiled = done.stdout.split()[-2:]
        return float(result), int(compiled), done.stderr


@pytest.fixture(scope='module')
def first(tmp_path_factory) -> Installation:
    """Install the package, and run it once."""
    root = tmp_path_factory.mktemp('first')
    package = Installation(root / 'site', root / 'cache')
    assert package.run()[:2] == (22.0, 2)
    return package


@pytest.fixture
def fresh(tmp_path: Path) -> Installation:
    """Install the package for a user without kernels."""
    return Installation(tmp_path / 'site', tmp_path / 'cache')


@pytest.fixture
def used(fresh: Installation, first: Installation) -> Installation:
    """Install the package with the kernels of another installation that has run."""
    shutil.copytree(first.cache, fresh.cache)
    return fresh


def compiled_files(root: Path) -> list[Path]:
    """List the files of compiled kernels."""
    return sorted(root.rglob('*.nbc'))


def test_second_process_compiles_nothing(first):
    """Find kernels again in the user's cache folder, and keep the installation clean."""
    assert first.run()[:2] == (22.0, 0)
    assert len(compiled_files(first.cache / 'procphys_ros' / 'kernels')) == 2
    assert compiled_files(first.cache.parent / 'site') == []


def test_other_install_path_compiles_nothing(used):
    """Share kernels between installations of the same sources."""
    assert used.run()[:2] == (22.0, 0)


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
    used.add('third', 'from procphys_ros import caller\n')
    assert used.run()[:2] == (22.0, 0)
    used.add('caller', CALLER + '\n')
    assert used.run()[:2] == (22.0, 1)
    used.add('another', 'LIMIT = 1\n')
    assert used.run()[:2] == (22.0, 2)


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
def test_two_processes_share_the_work(fresh):
    """Compile each function once when two processes need them at the same time."""
    with ThreadPoolExecutor(2) as both:
        runs = list(both.map(lambda _: fresh.run(), range(2)))
    assert [result for result, _, _ in runs] == [22.0, 22.0]
    assert sum(compiled for _, compiled, _ in runs) == 2


@LOCKED
def test_processes_do_not_mix_up_their_overloads(fresh):
    """Find every overload again when several processes compiled one function for other types."""
    kinds = ['f8', 'f4', 'i8', 'c16']
    with ThreadPoolExecutor(len(kinds)) as all_of_them:
        list(all_of_them.map(lambda kind: fresh.run(kind, after='print(0, 0)'), kinds))
    both = '\n'.join(f'print(total(np.array([1, 10], {kind!r})))' for kind in kinds)
    assert fresh.run(after=f'{both}\nprint(22, Compiled.count)')[:2] == (22.0, 0)


def test_what_numba_makes_has_other_names_in_every_process(tmp_path):
    """Compile one kernel in two processes; of two functions with one name either might be run."""
    found = []
    for user in ('one', 'other'):
        package = Installation(tmp_path / user, tmp_path / user / 'cache')
        package.add('sorting',
                    'import numpy as np\nfrom procphys_ros.compilation import kernel\n\n'
                    '@kernel\ndef order(x):\n    return np.argsort(x)\n')
        names = (r"""import re; from procphys_ros.sorting import order; order(np.ones(2))
names = re.findall(r'define[^@]*@"?(_ZN5numba[^"(]*)', *order.inspect_llvm().values())
print(*names, file=sys.stderr); print(len(names), 0)""")
        count, _, said = package.run(before='import sys', after=names)
        found.append(said.split())
        assert len(found[-1]) == count > 1
    assert not set(found[0]) & set(found[1])


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


def test_kernels_from_files_do_the_same_to_the_bit(tmp_path):
    """Factor a matrix by kernels just compiled, and by loaded ones."""
    hashes = [subprocess.run([sys.executable, '-c', FACTOR], cwd=ROOT, text=True, check=True,
                             env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)},
                             capture_output=True).stdout for _ in range(2)]
    assert hashes[0] == hashes[1]


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
