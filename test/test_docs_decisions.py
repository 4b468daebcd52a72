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

"""The index of decisions and the glossary: complete, short, and about what there is."""

from pathlib import Path
import re

ROOT = Path(__file__).resolve().parents[1]
RECORDS = ROOT / 'docs' / 'decisions'
_LINE = re.compile(r'^\* \[(\d{4})\]\((\S+)\): (.+); (live.*|superseded by .*)\.$', re.MULTILINE)


def test_every_decision_is_in_the_index_with_what_became_of_it():
    """List each record once; those that hold are short, those that do not name their successor."""
    found = _LINE.findall((RECORDS / 'README.md').read_text('utf-8'))
    files = sorted(path.name for path in RECORDS.glob('0*.md'))
    assert sorted(name for _, name, _, _ in found) == files
    numbers = {name[:4] for name in files}
    for number, name, _, fate in found:
        assert name.startswith(number)
        assert set(re.findall(r'\d{4}', fate)) <= numbers, f'{name}: {fate}'
        if fate.startswith('live'):
            lines = (RECORDS / name).read_text('utf-8').count('\n')
            assert lines <= 60, f'{name} has {lines} lines'


def test_the_glossary_is_short_and_names_modules_that_exist():
    """Explain at most 40 words, each with the module where it lives."""
    rows = re.findall(r'^\| (.+?) \| (.+?) \| `(\S+)` \|$',
                      (ROOT / 'docs' / 'glossary.md').read_text('utf-8'), re.MULTILINE)
    assert 30 < len(rows) <= 40
    assert [word for word, _, _ in rows] == sorted((word for word, _, _ in rows), key=str.lower)
    for word, _, module in rows:
        assert (ROOT / 'procphys_ros' / module).is_file(), word
