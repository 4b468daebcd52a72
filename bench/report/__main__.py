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


"""
Write docs/report: what was measured, what was expected, and how far they may be apart.

Runs the tests that are marked `report` and leave figures (test/measurement.py), and writes what
they have left as tables and plots; no number is typed in. Takes some minutes.
Run: python bench/report [folder]; needs `pip install '.[report]'`.
"""

import os
from pathlib import Path
import platform
import subprocess
import sys
from tempfile import TemporaryDirectory
from time import perf_counter

from page import INTRODUCTIONS, write_section
from results import read

from procphys_ros import __version__

_ROOT = Path(__file__).resolve().parents[2]


def main() -> int:
    """
    Measure, and write the report.

    :returns: exit code of the tests: other than 0 when a figure is out of its tolerance.
    """
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else _ROOT / 'docs' / 'report'
    folder.mkdir(parents=True, exist_ok=True)
    began = perf_counter()
    with TemporaryDirectory() as scratch:
        results = Path(scratch) / 'results.xml'
        code = _measure(results)
        sections = read(results)
    minutes = (perf_counter() - began) / 60.0
    for old in folder.glob('*.svg'):
        old.unlink()
    page = [f'# Report of measurements\n\nMade by `make report` with procphys_ros {__version__}, '
            f'Python {platform.python_version()} on {platform.machine()}, in {minutes:.0f} min on '
            f'{len(os.sched_getaffinity(0))} cores. Every row is compared by the test that is '
            'named behind it, which fails beyond the tolerance. Where a row stands for several '
            'cases, it shows the one that comes nearest to its tolerance.\n']
    page += [write_section(key, sections[key], folder) for key in INTRODUCTIONS if key in sections]
    (folder / 'README.md').write_text('\n'.join(page), 'utf-8')
    print(f'{folder / "README.md"} written, {minutes:.1f} min')
    return code


def _measure(results: Path) -> int:
    """Run the tests that leave figures, two files at a time."""
    files = [str(path) for path in sorted((_ROOT / 'test').glob('test_*.py'))
             if '@pytest.mark.report(' in path.read_text('utf-8')]
    return subprocess.run([
        sys.executable, '-m', 'pytest', '-m', 'report', '-n', '2', '--dist', 'loadfile',
        f'--junitxml={results}', *files], cwd=_ROOT, check=False,
        env={**os.environ, 'PYTHONPATH': str(_ROOT)}).returncode


if __name__ == '__main__':
    sys.exit(main())
