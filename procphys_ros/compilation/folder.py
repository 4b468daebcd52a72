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


"""Folders of compiled kernels: one per module, for its sources, versions and processor."""

from collections import Counter
from contextlib import suppress
import errno
from functools import cache
import hashlib
import os
from pathlib import Path
import re
import shutil
import sys
from time import time
import warnings

import llvmlite
from llvmlite import binding
import numba
from numba import config

_ROOT = Path(__file__).parents[2]
_PACKAGE = 'procphys_ros'
_SCENES = f'{_PACKAGE}.warming.scenes'  # imports all modules with kernels; not so this one, hence:
# A dotted name, even in a string, and what an import statement takes from there. To parse all
# files would take a second of every start.
_IMPORT = re.compile(rf'({_PACKAGE}(?:\.\w+)*)'
                     r'(?:(?=[\s\\]+import\b(\s*\((?:#[^\n]*|[^)#])*\)|(?:\\\n|[^\n])*))|)')

_KEPT, _UNUSED = 8, 30 * 86400.0  # folders kept of a module, those used last; [s] at most since
# Settings of numba that change the code that it makes.
_SETTINGS = ('OPT', 'LOOP_VECTORIZE', 'SLP_VECTORIZE', 'BOUNDSCHECK', 'DEBUGINFO_DEFAULT',
             'ENABLE_AVX', 'CPU_NAME', 'CPU_FEATURES', 'ENABLE_PROFILING')


def user_folder() -> Path:
    """Return the folder of all kernels of this user, by NUMBA_CACHE_DIR and XDG_CACHE_HOME."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR, 'procphys_ros')
    home = os.environ.get('XDG_CACHE_HOME', '')
    if not os.path.isabs(home):  # the specification: a relative one counts as unset
        home = os.path.expanduser('~/.cache')
    return Path(home, 'procphys_ros', 'kernels')


@cache
def kernel_folder(module: str) -> Path:
    """
    Return the folder of a module's kernels, named by all that decides their code; mark it as used.

    That is every source that they may contain, the versions of numba, llvmlite and Python, numba's
    settings, and the processor.

    :param module: dotted name, of this package.
    """
    settings = [str(getattr(config, name, None)) for name in _SETTINGS]
    cpu = [binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()]
    facts = [numba.__version__, llvmlite.__version__, sys.version, *cpu, *settings]
    facts += [f'{name} {_read(name)[0]}' for name in sorted(sources(module))]
    digest = hashlib.sha256('\n'.join(facts).encode()).hexdigest()[:16]
    folder = user_folder() / f'{module}-{digest}'
    with suppress(OSError):  # does not exist yet, or belongs to somebody else
        os.utime(folder)
    return folder


def sources(module: str) -> set[str]:
    """
    List a module and all of this package that it imports, also through others.

    :param module: dotted name, of this package.
    """
    found, waiting = set(), {module}
    while waiting:
        name = waiting.pop()
        found.add(name)
        waiting |= _read(name)[1] - found
    return found


@cache
def _read(module: str) -> tuple[str, set[str]]:
    """Return the digest of a module's source, and the modules of this package that it names."""
    source = Path(_file(module)).read_bytes()
    names = set()
    for origin, members in _IMPORT.findall(source.decode()):
        names |= {origin, *(f'{origin}.{member}' for member in re.findall(r'\w+', members))}
    return hashlib.sha256(source).hexdigest(), {_module_of(name) for name in names}


@cache
def _module_of(name: str) -> str:
    """Return the module that a dotted name tells, or is found in."""
    return name if os.path.isfile(_file(name)) else _module_of(name.rpartition('.')[0])


def _file(module: str) -> str:
    path = os.path.join(_ROOT, *module.split('.'))
    package = f'{path}/__init__.py'
    return package if os.path.isfile(package) else f'{path}.py'


def prepare(folder: Path) -> None:
    """
    Create a folder in that of the kernels.

    :raises OSError: when it cannot be created.
    """
    if folder.parts[0] == '~':  # neither HOME nor the users' table knows a home
        raise OSError(errno.ENOENT, 'there is no home folder')
    folder.mkdir(parents=True, exist_ok=True)


def is_complete() -> bool:
    """Return whether all kernels have been compiled for these sources and this machine."""
    return _mark().is_file()


def mark_complete() -> None:
    """Record that all kernels have been compiled, and remove what has not been used for long."""
    try:
        prepare(_mark().parent)
        _mark().touch()
        found = sorted(user_folder().iterdir(), key=_last_use, reverse=True)
    except OSError:
        return  # nothing can be kept here, as a warning has said
    newer: Counter[str] = Counter()
    for folder in found:
        module = folder.name.rpartition('-')[0]
        if newer[module] == _KEPT or _last_use(folder) < time() - _UNUSED:
            shutil.rmtree(folder, ignore_errors=True)
        else:
            newer[module] += 1


@cache
def warn_once(reason: str) -> None:
    """Warn that kernels cannot be kept."""
    warnings.warn(f'compiled kernels cannot be kept in {user_folder()}, every start will '
                  f'compile them: {reason}; NUMBA_CACHE_DIR names another folder',
                  RuntimeWarning, stacklevel=3)


def _mark() -> Path:
    return kernel_folder(_SCENES) / 'complete'


def _last_use(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except OSError:  # another process has removed it
        return 0.0
