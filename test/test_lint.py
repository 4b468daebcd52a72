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

from importlib.util import find_spec
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = [str(ROOT / name) for name in ('procphys_ros', 'test', 'bench', 'setup.py')]
_PATIENCE = 600.0  # [s]


def _lint(module: str, *arguments: str) -> None:
    """
    Run a linter in a process of its own: it forks, and this one holds what must not be forked.

    :param module: its command.
    """
    package = module.partition('.')[0]
    if find_spec(package) is None:
        pytest.skip(f'{package} is not installed')
    run = subprocess.run([sys.executable, '-m', module, *arguments], cwd=ROOT, timeout=_PATIENCE,
                         stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert run.returncode == 0, run.stdout


def test_flake8_finds_nothing():
    """Keep to ament's style, with this package's own imports in a block of their own."""
    _lint('ament_flake8.main', '--config', str(ROOT / 'setup.cfg'), *FOLDERS)


def test_pep257_finds_nothing():
    """Keep to ament's docstring convention."""
    _lint('ament_pep257.main', *FOLDERS)


def test_copyright_headers_are_recognised():
    """Have ament_copyright find holder and licence in every file."""
    _lint('ament_copyright.main', *FOLDERS)


def test_types_fit():
    """Have mypy accept the package."""
    _lint('mypy', '--config-file', str(ROOT / 'setup.cfg'), str(ROOT / 'procphys_ros'))
