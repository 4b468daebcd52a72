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

"""The linters that ROS packages are judged by, and the type checker, find nothing."""

# They remember what they have found clean: linters that look at a file at a time by its content,
# in the cache of pytest, and mypy in its own.

from functools import cache
import hashlib
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = [ROOT / name for name in ('procphys_ros', 'test', 'bench', 'setup.py')]
_PATIENCE = 600.0  # [s]
# Syntax trees are large: to look through them for garbage takes a seventh of a linter's time.
_SELDOM_COLLECTED = """
import gc, runpy, sys
gc.set_threshold(1_000_000)
del sys.argv[0]
runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)
"""


@pytest.fixture
def lint_files(pytestconfig):
    """Return a function that runs a linter on all files that it has not found clean before."""
    kept = getattr(pytestconfig, 'cache', None)  # without, all files are looked at

    def lint(module: str, *arguments: str) -> None:
        clean = set(kept.get(f'lint/{module}', [])) if kept else set()
        found = {_digest(path): str(path) for folder in FOLDERS for path in _sources(folder)}
        changed = [path for digest, path in found.items() if digest not in clean]
        if changed:
            _lint(module, *arguments, *changed)
        if kept:
            kept.set(f'lint/{module}', sorted(found))
    return lint


def _sources(folder: Path) -> list[Path]:
    return sorted(folder.rglob('*.py')) if folder.is_dir() else [folder]


@cache
def _judges() -> bytes:
    """Return all that a verdict depends on but the file: settings and installed packages."""
    installed = sorted(f'{own.name} {own.version}' for own in distributions())
    return (ROOT / 'setup.cfg').read_bytes() + repr((sys.version, installed)).encode()


def _digest(path: Path) -> str:
    name = str(path.relative_to(ROOT)).encode()
    return hashlib.sha256(b'\0'.join([_judges(), name, path.read_bytes()])).hexdigest()


def _lint(module: str, *arguments: str) -> None:
    """
    Run a linter in a process of its own: it forks, and this one holds what must not be forked.

    :param module: its command.
    """
    package = module.partition('.')[0]
    if find_spec(package) is None:
        pytest.skip(f'{package} is not installed')
    run = subprocess.run([sys.executable, '-c', _SELDOM_COLLECTED, module, *arguments], cwd=ROOT,
                         timeout=_PATIENCE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                         text=True)
    assert run.returncode == 0, run.stdout


def test_flake8_finds_nothing(lint_files):
    """Keep to ament's style, with this package's own imports in a block of their own."""
    lint_files('ament_flake8.main', '--config', str(ROOT / 'setup.cfg'))


def test_pep257_finds_nothing(lint_files):
    """Keep to ament's docstring convention."""
    lint_files('ament_pep257.main')


def test_copyright_headers_are_recognised(lint_files):
    """Have ament_copyright find holder and licence in every file."""
    lint_files('ament_copyright.main')


def test_types_fit():
    """Have mypy accept the package."""
    _lint('mypy', '--config-file', str(ROOT / 'setup.cfg'), str(ROOT / 'procphys_ros'))
