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


"""Includes: grammars that take definitions from others."""

import pytest

from procphys_ros.errors import GrammarError
from procphys_ros.lsystem import LSystem
from procphys_ros.wallgrammar import WallGrammar

_WALL = """include "bricks.wall"
building b
  footprint: (0, 0) (3, 0)
  facades: front
  storey_height: 1
rule front -> wall
material stone { density: 2222 }
"""
_BRICKS = """include "stones.wall"
layout laid { bond: running unit: 0.3 0.15 0.1 joint: 0.01 material: stone }
panel wall: laid
material stone { density: 1111 }
"""
_STONES = """include "bricks.wall"
building other
  footprint: (0, 0) (9, 0)
  facades: front
  storey_height: 9
rule front -> wall
material stone { density: 1500 tension: 1e5 cohesion: 1e5 compression: 1e7 }
material flint { density: 2600 tension: 1e6 cohesion: 1e6 compression: 1e8 }
"""


def test_a_tree_takes_modules_defines_and_rules(tmp_path):
    """Derive with rules of another file; the grammar's own rules and defines come first."""
    (tmp_path / 'twigs.lsys').write_text(
        'module: Twig, Bud\ndefine: size = 1, half = size / 2\naxiom: Twig\nproduction:\n'
        'Twig -> F(half) Bud\nBud -> F(9)\ninterpretation:\nBud -> G(size)\ninclude: a.lsys')
    (tmp_path / 'a.lsys').write_text('include: twigs.lsys\ndefine: size = 4\naxiom: Twig\n'
                                     'derivation length: 2\nproduction:\nBud -> F(size) Bud')
    system = LSystem.load(tmp_path / 'a.lsys')
    assert str(system.derive()) == 'F(2)F(4)Bud' and str(system.interpret(0, size=3)) == 'Twig'
    assert str(system.interpret()) == 'F(2)F(4)G(4)'


def test_errors_of_an_included_tree_name_its_file(tmp_path):
    """Say in which file the slip stands, and where a file is missing."""
    (tmp_path / 'twigs.lsys').write_text('axiom: F\nproduction:\nF -> F(lenght)')
    with pytest.raises(GrammarError) as caught:
        LSystem.parse('axiom: F\ninclude: twigs.lsys', folder=tmp_path)
    assert str(caught.value).startswith(f'{tmp_path / "twigs.lsys"}:3:8: unknown name "lenght"')
    with pytest.raises(GrammarError, match='<text>:2:1: there is no "twig.lsys" to include'):
        LSystem.parse('axiom: F\ninclude: twig.lsys', folder=tmp_path)


@pytest.fixture
def folder(tmp_path):
    """Make a folder with three walls that include each other."""
    for name, text in (('b', _WALL), ('bricks', _BRICKS), ('stones', _STONES)):
        (tmp_path / f'{name}.wall').write_text(text)
    return tmp_path


def test_a_wall_takes_materials_layouts_and_panels(folder):
    """Build with what others declare; the nearest declaration wins, buildings stay their own."""
    text = _WALL.replace('2222', '2222 tension: 1e5 cohesion: 1e5 compression: 1e7')
    (folder / 'b.wall').write_text(text)
    grammar = WallGrammar.load(folder / 'b.wall')
    built = grammar.build()
    assert 'flint' in grammar.materials and grammar.materials['stone'].density == 2222
    assert built.density == pytest.approx(2222) and built.poses[:, 2].max() < 1.1


def test_shipped_grammars_may_be_included():
    """Find a file among the shipped ones when none lies beside."""
    text = _WALL.replace('bricks.wall', 'garden_wall.wall').split('material')[0]
    assert len(WallGrammar.parse(text).build()) > 50


@pytest.mark.parametrize('name, words', [
    ('nowhere.wall', 'there is no "nowhere.wall" to include'), ('', 'is not a file name'),
    ('x' * 5000, 'there is no "xxx'), ('.', 'Is a directory')])
def test_missing_includes_are_refused_where_they_stand(folder, name, words):
    """Name the line that asks for the file."""
    with pytest.raises(GrammarError) as caught:
        WallGrammar.parse('\n' + _WALL.replace('bricks.wall', name), 'b.wall', folder=folder)
    assert words in str(caught.value) and str(caught.value).startswith('b.wall:2:')


def test_errors_in_an_included_file_name_that_file(folder):
    """Say in which of the files the slip stands."""
    (folder / 'stones.wall').write_text('material stone { density: 1 weight: 3 }')
    (folder / 'bricks.wall').write_text(_BRICKS.replace('material stone { density: 1111 }', ''))
    text = _WALL.replace('material stone { density: 2222 }', '')
    with pytest.raises(GrammarError) as caught:
        WallGrammar.parse(text, 'b.wall', folder=folder)
    assert str(caught.value).startswith(str(folder / 'stones.wall') + ':1')


def test_programs_name_shipped_grammars_anywhere(tmp_path, monkeypatch):
    """Find a shipped grammar by its name in any folder, but first a file that lies there."""
    monkeypatch.chdir(tmp_path)
    assert len(LSystem.load('shrub.lsys').build()) > 1
    assert 'brick' in WallGrammar.load('garden_wall.wall').build().kinds
    (tmp_path / 'shrub.lsys').write_text('axiom: F(1)')
    assert len(LSystem.load('shrub.lsys').build()) == 1
    with pytest.raises(GrammarError, match='No such file'):
        LSystem.load('shrubs.lsys')
