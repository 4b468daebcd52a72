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

"""The reference of wall grammars and the README say what the code does."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
import re

import numpy as np
import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.simulation import Cause
from procphys_ros.wallgrammar import WallGrammar
from procphys_ros.wallgrammar.bonds import BONDS
from procphys_ros.wallgrammar.materials import NUMBERS
from procphys_ros.wallgrammar.parser import SCOPE_NAMES

_DOCS = Path(__file__).resolve().parents[1] / 'docs'
_PAGE = (_DOCS / 'wall_language.md').read_text('utf-8')
_SHED = re.search(r'```\n(building .*?)```', _PAGE, re.DOTALL)[1]


def _rows(section: str, head: str) -> dict[str, list[str]]:
    """Return the rows of a table by the first name in them, as cells."""
    text = _PAGE.split(f'## {section}\n')[1].split('\n## ')[0]
    table = re.search(rf'^\| {head} \|.*\n\|[-|]+\n((?:\|.*\n)+)', text, re.MULTILINE)[1]
    rows = [[cell.strip() for cell in re.split(r'(?<!\\)\|', line)[1:-1]]
            for line in table.splitlines()]
    return {re.search(r'`(\w+)', row[0])[1]: row for row in rows if '`' in row[0]}


def _refusal(text: str) -> str:
    """Return the reason why a grammar is refused."""
    with pytest.raises(GrammarError) as refused:
        WallGrammar.parse(text).build()
    return str(refused.value)


def _allowed(message: str, what: str) -> list[str]:
    return re.search(rf'\({what}: ([^)]*)\)', message)[1].split(', ')


def test_tables_are_those_of_the_code():
    """Have run docs/wall_tables.py since materials or textures were changed."""
    spec = spec_from_file_location('wall_tables', _DOCS / 'wall_tables.py')
    tables = module_from_spec(spec)
    spec.loader.exec_module(tables)
    assert tables.updated(_PAGE) == _PAGE and '| `brick_red` |' in _PAGE


def test_statements():
    """List all that a file may hold."""
    expected = set(re.findall(r'"(\w+)"', _refusal('something').partition('expected')[2]))
    assert set(_rows('Statements', 'statement')) == expected


def test_properties_of_buildings():
    """List every property, and what must not be left out."""
    rows = _rows('Building', 'property')
    refusal = _refusal(_SHED.replace('  roof:', '  colour: 3 roof:'))
    assert list(rows) == _allowed(refusal, 'properties')
    for name, row in rows.items():
        without = re.sub(rf'^  {name}: .*\n', '', _SHED, flags=re.MULTILINE)
        assert without != _SHED or row[2] != 'an error', name
        if row[2] == 'an error':
            assert f'needs "{name}:"' in _refusal(without)


@pytest.mark.parametrize('key', ['floors', 'roof', 'partitions'])
def test_words_of_floors_roofs_and_partitions(key):
    """Check that every word is documented with the range of its number."""
    shed = re.sub(r'^  roof: .*\n', '', _SHED, flags=re.MULTILINE)

    def with_word(word: str) -> str:
        return shed.replace('  storey_height', f'  {key}: {word}\n  storey_height')
    allowed = _allowed(_refusal(with_word('thatch')).replace('(number)', ''), 'allowed')
    property_row = _rows('Building', 'property')[key]
    assert re.findall(r'`(\w+)[^`]*`', property_row[1]) == allowed
    for word, (_, number, low, high, _) in _rows('Building', 'word').items():
        if word in allowed and number:
            refusal = _refusal(with_word(f'{word}(1e6)'))
            assert f'must be from {float(low):g} to {float(high):g},' in refusal


def test_panels():
    """List every kind with its number of arguments."""
    rows = _rows('Panels', 'kind')
    kinds = _refusal(_SHED.replace('boards(oak)', '1 + 2')).partition(' layout, or ')[2]
    assert list(rows) == re.sub(r'\([^)]*\)', '', kinds).split(', ')
    for kind, row in rows.items():
        words = [name.strip() for name in row[1].split(',') if name]
        count = len([name for name in words if name not in ('from', 'to')])
        refusal = _refusal(_SHED.replace('boards(oak)', f'{kind}({", ".join(6 * ["oak"])})'))
        if kind == 'arch':
            shapes = re.findall(r'^\| `(\w+(?:\(\w+\))?)`', _PAGE.split('| shape of an arch')[1]
                                .split('\n\n')[0], re.MULTILINE)
            assert refusal.endswith(f'(shapes: {", ".join(shapes)})')
            continue
        assert f'takes {("no", "one name", "2", "3")[count]}' in refusal


def test_layouts():
    """List every key, every bond, what must be there, and ranges."""
    rows = _rows('Layouts', 'key')
    keys = _allowed(_refusal(_SHED.replace('unit:', 'size:')), 'keys')
    assert sorted(rows) == sorted(keys)
    assert sorted(re.findall(r'`(\w+)`', rows['bond'][1])) == sorted(BONDS)
    for key, (_, _, low, high, default) in rows.items():
        if default == 'an error':
            without = re.sub(rf'({{.*){key}: [0-9. ]*(brick)?', r'\1', _SHED)
            assert f'needs "{key}:"' in _refusal(without)
        elif high:
            for wrong in (float(low) - 1.0, float(high) + 1.0):
                refusal = _refusal(_SHED.replace('unit:', f'{key}: {wrong} unit:'))
                assert f'from {low} to {high}' in refusal


def test_materials():
    """List every key with its range, and what a new material needs."""
    rows = _rows('Materials', 'key')
    assert list(rows) == [*NUMBERS, 'texture']
    needed = _refusal(_SHED + 'material clay { }').rpartition(' needs ')[2].split(', ')
    assert [key for key, row in rows.items() if row[5] == 'required'] == needed
    for key in NUMBERS:
        low, high = rows[key][3:5]
        refusal = _refusal(_SHED + f'material brick {{ {key}: 1e20 }}')
        assert f'must be from {float(low):g} to {float(high):g},' in refusal


def test_successors_and_names():
    """Let every successor that is listed be read, with the names that rules know."""
    written = re.findall(r'^\| `(\w+)[({].*?` \|', _PAGE.split('## Rules')[1], re.MULTILINE)
    assert {'split', 'border', 'insert', 'grid', 'extrude'} <= set(written)
    for successor in ("split(x) { 2: plain | '0.3: plain | ~1: plain }",
                      'split(y) { { ~1: plain }* }', 'border(0.2) { plain | plain }',
                      'insert(1, 1) { plain | plain }', 'grid(1, 1) { plain }',
                      'extrude(0.03) { plain }', 'plain'):
        rule = f': {" + ".join(SCOPE_NAMES)} > 0 -> {successor} : 0.5'
        house = WallGrammar.parse(re.sub(r'rule front .*', f'rule front {rule}', _SHED))
        assert len(house.build()) > 100
    assert all(f'`{name}`' in _PAGE for name in SCOPE_NAMES)


ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / 'README.md').read_text('utf-8')
NODE = (ROOT / 'docs' / 'node.md').read_text('utf-8')
PAGES = sorted([*ROOT.glob('*.md'), *ROOT.glob('docs/**/*.md')])


def python_of(page: str) -> str:
    """Return all blocks of Python of a page, concatenated."""
    text = (ROOT / page).read_text('utf-8')
    return '\n'.join(re.findall(r'```python\n(.*?)```', text, re.DOTALL))


def test_no_link_is_dead():
    """Find every file that a page links to or shows."""
    linked = [(page, link) for page in PAGES
              for link in re.findall(r'\]\(([^)\s#]+)', page.read_text('utf-8'))]
    assert [(page, link) for page, link in linked if not link.startswith('http')
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
