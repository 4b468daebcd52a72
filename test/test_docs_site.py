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

"""The documentation builds without a warning; one would be a page that no list names."""

from pathlib import Path
import pickle
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
_PATIENCE = 600.0  # [s]
# To look through documents for garbage takes a tenth of the time.
_UNCOLLECTED = """
import gc, runpy, sys
gc.disable()
del sys.argv[0]
runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)
"""


def test_the_site_builds_without_a_warning(tmp_path):
    """Find every link's target, every page in a list, and every documented class."""
    # Pages are read and their links resolved, but not written: that takes a third of the time.
    # It would say which code is not of its language; `test_docs_blocks` runs all but the shell's.
    for package in ('sphinx', 'myst_parser'):
        pytest.importorskip(package)
    run = subprocess.run(
        [sys.executable, '-c', _UNCOLLECTED, 'sphinx', '-W', '--keep-going', '-q', '-b', 'dummy',
         '-D', 'smartquotes=0', str(ROOT / 'docs'), str(tmp_path)],
        timeout=_PATIENCE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert run.returncode == 0, run.stdout
    api = pickle.loads((tmp_path / '.doctrees' / 'api.doctree').read_bytes())
    assert 'procphys_ros.simulation.Simulation.apply_impulse' in api.ids
    assert '[N·s]' in api.astext()
