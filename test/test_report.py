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

"""The report: figures of tests become rows and plots, and the page names the tests there are."""

import json
from pathlib import Path
import re
import subprocess
import sys

from measurement import Measured
import pytest

ROOT = Path(__file__).resolve().parents[1]
BENCH = ROOT / 'bench' / 'report'


@pytest.fixture
def records():
    """Collect what is recorded."""
    return []


@pytest.fixture
def law(records):
    """Make the recorder of one test."""
    return Measured('laws', 'test_fall.py::test_fall',
                    lambda name, value: records.append(json.loads(value)))


def test_figures_out_of_tolerance_fail(law, records):
    """Fail beyond a tolerance or a bound, and record the figure nevertheless."""
    law('fall', 4.9, 4.905, 'm', rtol=0.01)
    law.within('speed', 1.0, 0.0, 1.0)
    with pytest.raises(AssertionError, match='fall'):
        law('fall', 5.2, 4.905, 'm', rtol=0.01)
    with pytest.raises(AssertionError, match='speed'):
        law.within('speed', 1.1, 0.0, 1.0)
    with pytest.raises(AssertionError):
        law('fall', float('nan'), 4.905, atol=1.0)
    assert [record['got'] for record in records[:4]] == [4.9, 1.0, 5.2, 1.1]


def test_figures_become_rows_and_plots(law, records, tmp_path):
    """Write the case nearest to its tolerance, the baseline, and a plot of every title."""
    pytest.importorskip('matplotlib')
    law('fall', 4.9, 4.905, 'm', rtol=0.01)
    law('fall', 1.01, 1.0, 'm', rtol=0.02)
    law.within('gap', 0.5, 0.0, 1.0, 'mm')
    law.instead('gap', 27.0, 'mm')
    law('stands', True, True)
    law.curve('Errors', 'error', [1, 2], [1.0, 0.25], ('steps', 'error'), ('log', 'log'))
    (tmp_path / 'records.json').write_text(json.dumps(records), 'utf-8')
    code = ('import json, sys; from pathlib import Path; sys.path.insert(0, sys.argv[1]);'
            'from page import write_section; from results import group;'
            'records = json.loads(Path("records.json").read_text("utf-8"));'
            'print(write_section("laws", group(records)["laws"], Path(".")))')
    page = subprocess.run([sys.executable, '-c', code, str(BENCH)], cwd=tmp_path, text=True,
                          capture_output=True, check=True).stdout
    by = '`test_fall.py::test_fall`'
    assert f'| fall | 2 | 1 m | 1.01 m | 2 % | {by} | – |' in page
    assert f'| gap | 1 | at most 1 mm | 0.5 mm | bound | {by} | 27 mm |' in page
    assert f'| stands | 1 | yes | yes | – | {by} | – |' in page
    drawn = re.findall(r'\]\((\w+\.svg)\)', page)
    assert 'errors.svg' in drawn and 'laws_bounds.svg' in drawn
    assert all((tmp_path / name).stat().st_size > 1000 for name in drawn)


def test_the_report_in_the_docs_has_every_test_that_leaves_figures():
    """Have run `make report` since such a test came or went."""
    page = (ROOT / 'docs' / 'report' / 'README.md').read_text('utf-8')
    marked = {f'{path.name}::{name}' for path in ROOT.glob('test/test_*.py')
              for name in re.findall(r'@pytest\.mark\.report\((?:.*\n)+?def (\w+)',
                                     path.read_text('utf-8')) if path != Path(__file__)}
    named = set(re.findall(r'`(test_\w+\.py::\w+)`', page))
    assert named <= marked
    assert {name for name in marked - named if not name.endswith('_would_be_found')} == set()
