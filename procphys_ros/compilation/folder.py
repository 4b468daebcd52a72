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


"""The folder of compiled kernels: one for each set of sources, versions and processor."""

from contextlib import suppress
import errno
from functools import cache
import hashlib
import os
from pathlib import Path
import shutil
import sys
from time import time
import warnings

import llvmlite
from llvmlite import binding
import numba
from numba import config

_PACKAGE = Path(__file__).parents[1]
ABOVE = ('batch', 'command_line', 'examples', 'export', 'render', 'ros', 'view')
"""Packages without kernels, from which modules with kernels import nothing."""

_KEPT, _UNUSED = 8, 30 * 86400.0  # folders that are kept, those used last; [s] at most since then
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
def kernel_folder() -> Path:
    """
    Return the folder named by all that decides the machine code of kernels; mark it as used.

    That is every source that a kernel may contain, whichever file it comes from, the versions of
    numba, llvmlite and Python, numba's settings, and the processor.
    """
    settings = [str(getattr(config, name, None)) for name in _SETTINGS]
    cpu = [binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()]
    facts = [numba.__version__, llvmlite.__version__, sys.version, *cpu, *settings]
    digest = hashlib.sha256('\n'.join(facts).encode())
    for path in sorted(_PACKAGE.rglob('*.py')):
        name = path.relative_to(_PACKAGE)
        if name.parts[0] not in ABOVE:
            digest.update(f'{name}\n'.encode() + path.read_bytes())
    folder = user_folder() / digest.hexdigest()[:16]
    with suppress(OSError):  # does not exist yet, or belongs to somebody else
        os.utime(folder)
    return folder


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
        _mark().touch()
        others = sorted(kernel_folder().parent.iterdir(), key=_last_use)
    except OSError:
        return  # nothing can be kept here, as a warning has said
    for place, old in enumerate(others):
        if place < len(others) - _KEPT or _last_use(old) < time() - _UNUSED:
            shutil.rmtree(old, ignore_errors=True)


@cache
def warn_once(reason: str) -> None:
    """Warn that kernels cannot be kept."""
    warnings.warn(f'compiled kernels cannot be kept in {kernel_folder()}, every start will '
                  f'compile them: {reason}; NUMBA_CACHE_DIR names another folder',
                  RuntimeWarning, stacklevel=3)


def _mark() -> Path:
    return kernel_folder() / 'complete'


def _last_use(folder: Path) -> float:
    try:
        return folder.stat().st_mtime
    except OSError:  # another process has removed it
        return 0.0
