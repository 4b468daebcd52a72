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


"""The README and the docs: short enough, without dead links, and their Python runs."""

from pathlib import Path
import re

import numpy as np
import pytest

from procphys_ros.simulation import Cause

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / 'README.md').read_text('utf-8')
NODE = (ROOT / 'docs' / 'node.md').read_text('utf-8')
PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')])


def python_of(page: str) -> str:
    """Return all blocks of Python of a page, concatenated."""
    text = (ROOT / page).read_text('utf-8')
    return '\n'.join(re.findall(r'```python\n(.*?)```', text, re.DOTALL))


@pytest.mark.parametrize('page', PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_link_is_dead(page):
    """Find every file that a page links to or shows."""
    linked = re.findall(r'\]\(([^)\s#]+)', page.read_text('utf-8'))
    assert [link for link in linked if not link.startswith('http')
            and not (page.parent / link).exists()] == []


def test_every_page_of_the_docs_is_in_the_index():
    """Lead from docs/README.md to all pages beside it."""
    index = (ROOT / 'docs' / 'README.md').read_text('utf-8')
    for page in ROOT.glob('docs/*.md'):
        assert page.name in ('README.md', 'index.md') or f']({page.name})' in index, page.name


def test_the_readme_is_short():
    """Leave tables and details to the docs."""
    assert len(README.splitlines()) <= 150


def test_the_python_of_the_readme_runs(monkeypatch):
    """Do what it shows, and get a tree that sways and holds."""
    monkeypatch.chdir(ROOT)
    names = {}
    exec(python_of('README.md'), names)
    simulation = names['simulation']
    assert simulation.time == pytest.approx(2.0)
    assert simulation.velocities.any() and simulation.bonds_broken == 0


def test_the_python_of_the_library_page_runs(tmp_path, monkeypatch):
    """Do what it shows: trees sway, a ball breaks the wall, and a stack bears its weight."""
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(python_of('docs/library.md'), names)
    assert names['sway'] > 0.005 and len(names['torn']) and names['loose'] > 3
    assert 0.0 < names['worst'] < 1.0
    assert np.load('sway.npz')['poses'].shape == (120, len(names['series'].parts), 7)
    assert names['model'].load('stack/0').force == pytest.approx(9.81 * names['mass'].sum())
    assert (names['model'].velocities == 0.0).all()


def test_what_the_readme_names_is_there():
    """Find its scenes and executables in the package, its topics and services in docs/node.md."""
    assert all((ROOT / scene).is_file() for scene in re.findall(r'config/\w+\.yaml', README))
    executables = re.search(r'\| executables \|(.*)\|', README)[1]
    setup = (ROOT / 'setup.py').read_text('utf-8')
    assert re.findall(r'`(\w+)`', executables) and all(
        f"'{name} = " in setup for name in re.findall(r'`(\w+)`', executables))
    offered = re.findall(r'`(~/\w+|/clock|/diagnostics)`', README)
    assert offered and all(f'`{name}`' in NODE for name in offered)


def test_every_cause_of_breaks_is_told():
    """Name each number that stands in ~/breaks."""
    told = re.search(r'Causes in `~/breaks`: (.*?);', NODE, re.DOTALL)[1]
    assert [int(n) for n in re.findall(r'\d+', told)] == [cause.value for cause in Cause]
    for cause in Cause:
        assert f'{cause.value} {cause.name.lower()}' in ' '.join(told.split())
