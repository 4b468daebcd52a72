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


"""Folders of compiled kernels: where they are, which are kept."""

import errno
from functools import cache
import hashlib
import os
from pathlib import Path
import shutil
import sys
from time import time

import llvmlite
from llvmlite import binding
import numba
from numba import config

from procphys_ros import __version__
from procphys_ros.compilation.sources import source_digest

_VERSIONS_KEPT = 8  # of each module: installations and branches that are used in turn
_UNUSED = 30 * 86400.0  # [s] after which kernels for another numba, Python or CPU are removed
# Other settings that change the code that numba makes.
_SETTINGS = ('OPT', 'LOOP_VECTORIZE', 'SLP_VECTORIZE', 'BOUNDSCHECK', 'DEBUGINFO_DEFAULT',
             'ENABLE_AVX', 'CPU_NAME', 'CPU_FEATURES', 'ENABLE_PROFILING')


def cache_folder() -> Path:
    """Find the folder of all kernels, following NUMBA_CACHE_DIR and XDG_CACHE_HOME."""
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR, 'procphys_ros')
    home = os.environ.get('XDG_CACHE_HOME', '')
    if not os.path.isabs(home):  # the specification: a relative one counts as unset
        home = os.path.expanduser('~/.cache')
    return Path(home, 'procphys_ros', 'kernels')


@cache
def module_folder(module: str) -> Path:
    """
    Find the folder of a module's kernels, and mark it as used.

    It depends on what decides the machine code: sources, this package's and numba's version,
    Python and the CPU.

    :param module: dotted name of an imported module.
    """
    environment = environment_folder()
    folder = environment / f'{module}-{source_digest(module)}'
    for used in (environment, folder):
        try:
            os.utime(used)
        except OSError:
            pass  # does not exist yet, or belongs to somebody else
    return folder


def prepare(folder: Path) -> None:
    """
    Create the folder of a module's kernels, and remove outdated ones.

    Processes that still use a removed folder keep the kernels that they have loaded, and compile
    the others.

    :param folder: from `module_folder`.
    :raises OSError: when it cannot be created.
    """
    if folder.is_dir():
        return
    if folder.parts[0] == '~':  # neither HOME nor the users' table knows a home
        raise OSError(errno.ENOENT, 'there is no home folder')
    folder.mkdir(parents=True, exist_ok=True)
    module = folder.name.rpartition('-')[0]
    versions = [path for path in folder.parent.iterdir()
                if path.name.rpartition('-')[0] == module]
    for old in sorted(versions, key=_last_use)[:-_VERSIONS_KEPT]:
        shutil.rmtree(old, ignore_errors=True)
    for other in folder.parents[1].iterdir():
        if other != folder.parent and _last_use(other) < time() - _UNUSED:
            shutil.rmtree(other, ignore_errors=True)


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # another process has removed it
        return 0.0


@cache
def environment_folder() -> Path:
    """Find the folder of all kernels for this numba, this Python and this CPU."""
    settings = [str(getattr(config, name, None)) for name in _SETTINGS]
    cpu = [binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()]
    facts = [__version__, numba.__version__, llvmlite.__version__, sys.version, *cpu, *settings]
    digest = hashlib.sha256('\n'.join(facts).encode()).hexdigest()[:16]
    return cache_folder() / f'numba-{numba.__version__}-{sys.implementation.cache_tag}-{digest}'
