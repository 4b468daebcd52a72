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

"""Which files may be named or included, and what errors tell of what is in them."""

import json
import os

import numpy as np
import pytest

from procphys_ros.errors import CommandError, GrammarError, ProcPhysError, SceneError
from procphys_ros.files.file_bounds import FileBounds, within
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.ros.file_access import bounds_at_start, state_path
from procphys_ros.ros.state_file import write_state
from procphys_ros.scene import Scene
from procphys_ros.scene.intruders import IntrudersSettings
from procphys_ros.scene.spawn import Spawn
from procphys_ros.wallgrammar import WallGrammar

SECRET = 'hunter2'
TREE = 'axiom: Width(0.1) F(1)'
WALL = (shared_folder() / 'grammars/garden_wall.wall').read_text('utf-8')


@pytest.fixture
def places(tmp_path):
    """Make a folder that is allowed, one that is not, and their bounds."""
    inside, outside = tmp_path / 'inside', tmp_path / 'outside'
    for folder in (inside, outside):
        folder.mkdir()
        for ending in ('.lsys', '.wall', '.plan', '.asc', '.csv', '.mtg', '.ply', '.stl',
                       '.npz', '.png', ''):
            (folder / f'secret{ending}').write_text(f'{SECRET} {SECRET}\n' * 3)
        (folder / 'tree.lsys').write_text(TREE)
    (inside / 'link.lsys').symlink_to(outside / 'tree.lsys')
    (inside / 'folder').symlink_to(outside)
    return inside, outside, FileBounds((inside, shared_folder()), {})


def namers(path):
    """List what names a file, each with the function that reads it."""
    def scene(**parameters):
        return lambda: Scene.from_parameters(parameters)
    one = {'scene': {'objects': ['one']}}
    return {
        'spawn.grammar': Spawn(grammar=path).build,
        'spawn.grammar_text': Spawn(grammar_text=f'include: {path}\n{TREE}').build,
        'wall': Spawn(grammar_text=f'include "{path}"\n{WALL}').build,
        'one.grammar': scene(**one, one={'grammar': path}),
        'one.grammar_text': scene(**one, one={'grammar_text': f'include: {path}\n{TREE}'}),
        'terrain.file': scene(terrain={'file': path}),
        'wind.file': scene(wind={'file': path}),
        'wind.map': scene(wind={'map': path}),
        'intruders.shapes': IntrudersSettings(('a',), (f'mesh {path}',)).pieces,
    }


@pytest.mark.parametrize('name', namers('x'))
@pytest.mark.parametrize('ending', ['', '.lsys', '.wall', '.plan', '.asc', '.csv', '.stl', '.npz'])
def test_nothing_outside_is_read(places, name, ending):
    """Refuse files, links and ways around, there or not, with the same words."""
    inside, outside, bounds = places
    for path in (outside / f'secret{ending}', outside / f'nothing{ending}',
                 inside / f'../outside/secret{ending}', inside / f'folder/secret{ending}',
                 inside / 'link.lsys', '/etc/passwd', '/dev/zero'):
        with within(bounds), pytest.raises(ProcPhysError, match='files.root allows') as told:
            namers(str(path))[name]()
        assert SECRET not in str(told.value) and '\n' not in str(told.value)


@pytest.mark.parametrize('ending', ['', '.asc', '.csv', '.mtg', '.ply', '.stl', '.npz', '.png'])
def test_errors_tell_nothing_of_what_is_no_grammar(places, ending):
    """Name the file and what is wrong, and nothing that stands in it."""
    inside, _, bounds = places
    for read in namers(str(inside / f'secret{ending}')).values():
        for limits in (bounds, None):
            with within(limits), pytest.raises(ProcPhysError) as told:
                read()
            assert SECRET not in str(told.value)


def test_what_the_start_gave_may_lie_anywhere(places):
    """Read what a value names that the start gave; another value of the same name is refused."""
    inside, outside, _ = places
    (outside / 'more.lsys').write_text(f'include: tree.lsys\n{TREE}')
    path = str(outside / 'more.lsys')
    bounds = FileBounds((inside, shared_folder()), {'one.grammar': path, 'spawn.grammar': path})
    parameters = {'scene': {'objects': ['one']}, 'one': {'grammar': path}}
    with within(bounds):
        assert len(Spawn(grammar=path).build()) == 1
        assert len(Scene.from_parameters(parameters).blueprint) == 1
        with pytest.raises(SceneError, match='files.root'):
            Spawn(grammar=str(outside / 'tree.lsys')).build()
        with pytest.raises(GrammarError, match='files.root'):
            Spawn(grammar_text=f'include: {path}\n{TREE}').build()
        assert len(Spawn(grammar=str(inside / 'tree.lsys')).build()) == 1
        assert len(Spawn(grammar='oak.lsys').build()) > 10
        with pytest.raises(SceneError, match='did you mean oak.lsys'):
            Spawn(grammar='oka.lsys').build()


def test_folders_are_those_of_the_start(tmp_path, monkeypatch):
    """Take the folders of scene and state, or those that are told; `launch` writes no scenes."""
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros'))
    arguments = ['sim', '--ros-args', '--params-file', f'{tmp_path}/scenes/a.yaml',
                 '--params-file', '/tmp/launch_params_x']
    package = shared_folder().resolve()
    assert bounds_at_start([], {}, arguments).folders == (
        tmp_path / 'ros/procphys_ros', tmp_path / 'scenes', package)
    given = {'state.file': f'{tmp_path}/states/a.state'}
    assert bounds_at_start([], given, []).folders == (tmp_path / 'states', package)
    assert bounds_at_start([str(tmp_path)], given, arguments).folders == (tmp_path, package)


def test_states_go_below_the_folders(places, tmp_path, monkeypatch):
    """Take a mere name as one in the first folder, and refuse others but that of the start."""
    inside, outside, bounds = places
    assert state_path('a.state', bounds) == inside / 'a.state'
    assert state_path(str(inside / 'a.state'), bounds) == inside / 'a.state'
    for name in (str(outside / 'a.state'), '../a.state', '~/a.state', 'folder/a.state',
                 'a\0.state', 'x' * 300 + '/a'):
        with pytest.raises(CommandError, match='state.file') as told:
            write_state(state_path(name, bounds), b'')
        assert '\n' not in str(told.value)
    own = str(outside / 'a.state')
    assert str(state_path(own, FileBounds((inside,), {'state.file': own}))) == own
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros'))
    path = state_path('a.state', bounds_at_start([], {}, []))
    write_state(path, b'')
    assert os.listdir(tmp_path / 'ros/procphys_ros') == ['a.state']


@pytest.mark.parametrize('content', [b'/**:\n', b'\x89MCAP0\r\n', b'procphys', b'\0'])
def test_only_states_are_replaced(tmp_path, content):
    """Leave a file as it is that holds something else."""
    path = tmp_path / 'scene.yaml'
    path.write_bytes(content)
    with pytest.raises(CommandError, match='is no saved state'):
        write_state(path, b'procphys_ros state 2\n')
    assert path.read_bytes() == content


def test_large_archives_are_refused_before_they_are_read(tmp_path):
    """Refuse heights of which a few kilobytes unpack to gigabytes."""
    path = tmp_path / 'a.npz'
    np.savez_compressed(path, heights=np.zeros((4000, 4000)))
    with pytest.raises(SceneError, match='at most'):
        Scene.from_parameters(json.loads(json.dumps({'terrain': {'file': str(path)}})))


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
