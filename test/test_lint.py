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

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = [str(ROOT / name) for name in ('procphys_ros', 'test', 'bench', 'setup.py')]


def test_flake8_finds_nothing():
    """Keep to ament's style, with this package's own imports in a block of their own."""
    lint = pytest.importorskip('ament_flake8.main')
    code, errors = lint.main_with_errors(argv=['--config', str(ROOT / 'setup.cfg'), *FOLDERS])
    assert code == 0, '\n'.join(errors)


def test_pep257_finds_nothing():
    """Keep to ament's docstring convention."""
    lint = pytest.importorskip('ament_pep257.main')
    assert lint.main(argv=FOLDERS) == 0


def test_copyright_headers_are_recognised():
    """Have ament_copyright find holder and licence in every file."""
    lint = pytest.importorskip('ament_copyright.main')
    assert lint.main(argv=FOLDERS) == 0


def test_types_fit():
    """Have mypy accept the package."""
    api = pytest.importorskip('mypy.api')
    report, errors, code = api.run(['--config-file', str(ROOT / 'setup.cfg'),
                                    str(ROOT / 'procphys_ros')])
    assert code == 0, report + errors
