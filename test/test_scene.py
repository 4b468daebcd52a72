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
"""Scenes: where they come from, how instances are placed, and what cannot be built."""

from dataclasses import fields, replace
import json
import os
import subprocess
import sys
import tracemalloc

from node_process import SAPLING
import numpy as np
import pytest

from procphys_ros.batch.sweep import Sweep, Variation
from procphys_ros.errors import (
    CommandError,
    GrammarError,
    nearest_names,
    ProcPhysError,
    SceneError,
)
from procphys_ros.export import command as export_command
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.ros import view
from procphys_ros.scene import Scene
from procphys_ros.scene.layout import places
from procphys_ros.scene.named import open_scene, scene_file
from procphys_ros.scene.objects import ObjectSpec
from procphys_ros.scene.parameter_table import GROUPS
from procphys_ros.scene.sources import load_grammar, parse_grammar
from procphys_ros.scene.yaml_file import read_yaml
from procphys_ros.simulation import Simulation

POLE = 'axiom: Width(0.1) F(1) F(1)'


def parameters(**groups):
    """Return the parameters of a scene with one object called pole."""
    return {'scene': {'objects': ['pole']}, 'pole': {'grammar_text': POLE}, **groups}


def refused(given):
    """Return the message with which a scene is refused."""
    with pytest.raises(SceneError) as caught:
        Scene.from_parameters(given)
    return str(caught.value)


def test_instances_follow_each_other_in_part_order():
    """Number the parts of instances one after the other, named as the interface says."""
    scene = Scene.from_parameters(parameters(pole={'grammar_text': POLE, 'count': 3}))
    assert [o.name for o in scene.objects] == ['pole_0', 'pole_1', 'pole_2']
    assert [(o.first, o.count) for o in scene.objects] == [(0, 2), (2, 2), (4, 2)]
    assert len(scene.blueprint) == 6
    assert Scene.from_parameters(parameters()).objects[0].name == 'pole'


def test_placing_moves_parts_and_bonds_alike():
    """Turn and move a blueprint rigidly, joints included."""
    blueprint = LSystem.parse(POLE + ' +(90) &(90) F(1)').build()
    scene = Scene()
    scene.add(blueprint, (3.0, 4.0, 0.5), np.pi / 2)
    x, y, z = blueprint.poses[2, :3]
    assert scene.blueprint.poses[2, :3] == pytest.approx([3.0 - y, 4.0 + x, 0.5 + z])
    arm = np.linalg.norm(scene.blueprint.bond_frame[:, :3] - scene.blueprint.poses[:, :3], axis=1)
    assert arm == pytest.approx(np.full(3, 0.5))


def test_yaw_turns_the_layout_with_its_instances():
    """Turn a row about its origin, rigidly, as its description says."""
    given = {'grammar_text': POLE + ' &(90) F(1)', 'count': 3, 'layout': 'row', 'spacing': 4.0}
    straight, turned = (Scene.from_parameters(parameters(pole={
        **given, 'origin': [5.0, 1.0, 0.0], 'yaw': yaw})).blueprint.poses for yaw in (0.0, 0.5))
    x, y = (straight[:, :2] - [5.0, 1.0]).T
    moved = np.column_stack([np.cos(0.5) * x - np.sin(0.5) * y, np.sin(0.5) * x + np.cos(0.5) * y])
    np.testing.assert_allclose(turned[:, :2], moved + [5.0, 1.0], atol=1e-9)
    described = {field.name: str(field.metadata) for field in fields(ObjectSpec)}
    assert 'turn of the whole layout' in described['yaw']


def test_layouts_keep_their_distances():
    """Space rows and grids exactly, and keep scattered instances apart."""
    rng = np.random.default_rng(1)
    row, _ = places('row', 5, 2.0, rng)
    assert np.diff(row[:, 0]) == pytest.approx([2.0] * 4) and row.mean(axis=0) == pytest.approx(0)
    grid, _ = places('grid', 9, 3.0, rng)
    gaps = np.linalg.norm(grid[:, None] - grid[None], axis=2)
    assert gaps[gaps > 0].min() == pytest.approx(3.0)
    scattered, headings = places('scatter', 200, 4.0, rng)
    gaps = np.linalg.norm(scattered[:, None] - scattered[None], axis=2) + 1e9 * np.eye(200)
    assert gaps.min() > 1.0 and np.ptp(headings) > 5.0


def test_scattered_instances_keep_clear_of_all_others():
    """Draw again while any of those before is too near, which means less after sixty throws."""
    rng, spacing, count = np.random.default_rng(4), 3.0, 300
    found = np.empty((count, 2))
    for i in range(count):
        for throw in range(1, 6000):
            found[i] = rng.uniform(-0.5, 0.5, 2) * spacing * np.sqrt(count)
            gap = np.linalg.norm(found[:i] - found[i], axis=1)
            if not i or gap.min() >= 0.55 * spacing * 0.5 ** (throw // 60):
                break
    scattered, _ = places('scatter', count, spacing, np.random.default_rng(4))
    np.testing.assert_allclose(scattered, found, atol=1e-9)


def test_many_thousand_instances_are_scattered():
    """Look at neighbours only: that takes no time that grows with the square of the number."""
    scattered, _ = places('scatter', 10_000, 3.0, np.random.default_rng(1))
    assert np.isfinite(scattered).all() and len(np.unique(scattered, axis=0)) == 10_000


def test_same_seed_same_scene():
    """Build the same individuals from the same seed, and others from another."""
    text = 'axiom: Width(0.1) F(rand(1,2)) F(1)'
    given = parameters(pole={'grammar_text': text, 'count': 4, 'layout': 'scatter'})
    first, second = (Scene.from_parameters(given).blueprint.poses for _ in range(2))
    other = Scene.from_parameters({**given, 'seed': 5}).blueprint.poses
    assert np.array_equal(first, second) and not np.array_equal(first, other)
    lengths = Scene.from_parameters(given).blueprint.visual_size[::2, 2]
    assert len(set(lengths)) == 4
    few = {**given, 'pole': {**given['pole'], 'variants': 2}}
    assert len(set(Scene.from_parameters(few).blueprint.visual_size[::2, 2])) == 2


def test_defines_reach_the_grammar():
    """Override a define of the grammar from the parameters."""
    text = 'define: n = 2\naxiom: Width(0.1) F(n)'
    scene = Scene.from_parameters(parameters(
        pole={'grammar_text': text, 'defines': ['n=7']}))
    assert scene.blueprint.visual_size[0, 2] == 7.0


@pytest.mark.parametrize(('given', 'words'), [
    ({'scene': {'objects': ['pole', 'pole']}, 'pole': {}}, ['pole', 'twice']),
    ({'scene': {'objects': ['a b']}}, ['a b', 'letters']),
    ({'scene': {'objects': 'oak'}}, ['scene.objects', 'list']),
    ({'scene': {'object': ['oak']}}, ['scene.object: there is no such key', 'mean objects?']),
    (parameters(pole={}), ['pole.grammar', 'pole.grammar_text']),
    (parameters(pole={'grammer': 'oak.lsys'}), ['pole.grammer', 'did you mean grammar']),
    (parameters(pole={'grammar': 'aok.lsys'}), ['pole.grammar', 'aok.lsys', 'oak.lsys']),
    (parameters(pole={'grammar': __file__}), ['.py', '.lsys', '.wall']),
    (parameters(pole={'grammar_text': POLE, 'count': -1}), ['pole.count', '-1', '0']),
    (parameters(pole={'grammar_text': POLE, 'spacing': 0}), ['pole.spacing', '0.001']),
    (parameters(pole={'grammar_text': POLE, 'origin': [1, 2]}), ['pole.origin', '3 numbers']),
    (parameters(pole={'grammar_text': POLE, 'yaw': float('nan')}), ['pole.yaw', 'nan']),
    (parameters(pole={'grammar_text': POLE, 'layout': 'ring'}), ['pole.layout', 'scatter']),
    (parameters(pole={'grammar_text': POLE, 'defines': ['n:3']}), ['pole.defines', 'name=number']),
    (parameters(wind={'velocity': [1, 2]}), ['wind.velocity', '3 numbers']),
    (parameters(wind={'speed': 3}), ['wind.speed', 'velocity']),
    (parameters(time_step=5.0), ['time_step', '0.1']),
    (parameters(seed=-3), ['seed', '-3']),
])
def test_bad_parameters_are_named(given, words):
    """Name the key, what was found and what is allowed."""
    message = refused(given)
    assert '\n' not in message
    for word in words:
        assert word in message


def test_grammar_errors_name_the_parameter():
    """Say which parameter held the text that cannot be read, and where in it."""
    with pytest.raises(GrammarError) as caught:
        Scene.from_parameters(parameters(pole={'grammar_text': 'axiom: F(1'}))
    assert str(caught.value).startswith('pole.grammar_text:1')


def changed(blueprint, table, column, value):
    """Return a blueprint with another value in the second row of a column."""
    owner = getattr(blueprint, table) if table else blueprint
    array = np.array(getattr(owner, column))
    array[1] = value
    owner = replace(owner, **{column: array})
    return replace(blueprint, **{table: owner}) if table else owner


@pytest.mark.parametrize(('table', 'column', 'value', 'words'), [
    ('', 'mass', np.nan, 'part 1: mass is nan'), ('', 'mass', 0.0, 'above 0'),
    ('', 'inertia', -1.0, 'part 1: inertia'), ('', 'size', np.inf, 'part 1: size'),
    ('', 'poses', 0.0, 'a quaternion of length 1'), ('', 'poses', np.nan, 'part 1: poses'),
    ('', 'shape', 7, 'part 1: shape is 7'), ('', 'kind', 5, 'it must be from 0 to 0'),
    ('', 'material', -1, 'part 1: material'), ('', 'texture', 99, 'part 1: texture'),
    ('', 'bonds', (0, 0), 'two different parts'), ('', 'bonds', (0, 9999), 'bond 1: bonds'),
    ('', 'bonds', (-2, 0), 'bond 1'), ('', 'bonds', (0, -1), 'bond 1'),
    ('', 'bond_frame', np.nan, 'bond 1: bond_frame'), ('', 'bond_extent', 0.0, 'bond_extent'),
    ('', 'bond_area', -1.0, 'bond 1: bond_area'), ('hinges', 'swing_stiffness', np.nan, 'hinge 1'),
    ('leaves', 'size', np.nan, 'leaf 1: size'), ('leaves', 'texture', 9, 'leaves 1: texture'),
    ('leaves', 'part', 9999, 'leaves 1: part'), ('leaves', 'pose', 0.0, 'leaf 1: pose'),
    ('mortar', 'tension', -1.0, 'mortar 1: tension is -1.0, it must be 0 or more'),
    ('mortar', 'compression', 0.0, 'mortar 1: compression'),
    ('mortar', 'normal_stiffness', np.inf, 'mortar 1: normal_stiffness')])
def test_arrays_that_cannot_be_simulated_are_refused(table, column, value, words):
    """Name the object, the row, the column, the value and what is allowed; change nothing."""
    grammar = 'garden_wall.wall' if table == 'mortar' else 'shrub.lsys'
    blueprint = load_grammar(grammar, 'test').build(seed=1)
    scene = Scene()
    scene.add(blueprint, name='sound')
    wrong = changed(blueprint, table, column, value)
    with pytest.raises(SceneError, match=f'it: .*{words}'):
        scene.add(wrong, name='it')
    assert len(scene.objects) == 1
    with pytest.raises(CommandError, match=words):
        Simulation(scene).add(wrong, name='it')


def test_settings_are_settings():
    """Refuse the path of a file, with the way to read it."""
    with pytest.raises(SceneError, match='Scene.from_yaml reads a file'):
        Scene('scene.yaml')


def test_yaml_is_a_ros_parameter_file(tmp_path):
    """Read nested and dotted keys alike, as rclpy does."""
    path = tmp_path / 'scene.yaml'
    path.write_text('sim:\n  ros__parameters:\n    scene.objects: [pole]\n    seed: 3\n'
                    f'    pole: {{grammar_text: "{POLE}"}}\n    pole.count: 2\n'
                    '    wind.velocity: [5, 0, 0]\n')
    scene = Scene.from_yaml(path)
    assert len(scene.objects) == 2 and scene.settings.seed == 3
    assert scene.settings.wind.velocity == (5.0, 0.0, 0.0)


@pytest.mark.parametrize(('word', 'value'), [
    ('1e3', 1000.0), ('-2.5E-1', -0.25), ('1.0e0', 1.0), ('5.', 5.0), ('.5', 0.5), ('09', 9.0),
    ('+3', 3), ('010', 8), ('0x10', 16), ('y', True), ('off', False), ('"1e3"', '1e3'),
    ('1_0.0', '1_0.0'), ('1:30', '1:30'), ('0b11', '0b11'), ('2026-02-30', '2026-02-30')])
def test_words_are_read_as_ros_reads_them(tmp_path, word, value):
    """Read what rcl_yaml_param_parser takes for numbers, switches and texts for the same."""
    path = tmp_path / 'scene.yaml'
    path.write_text(f'sim: {{ros__parameters: {{a: {word}, b: [{word}]}}}}')
    read = read_yaml(path)
    assert read == {'a': value, 'b': [value]} and type(read['a']) is type(value)


@pytest.mark.parametrize(('text', 'words'), [
    ('a: [1', ['scene.yaml:', 'not valid YAML']),
    ('a\0b: 1', ['scene.yaml:', 'not valid YAML']),
    ('a: !!int 2.5', ['scene.yaml:1:4', 'no int']), ('a: [!!bool so]', ['1:5', 'no bool']),
    ('a: !!float ""', ['scene.yaml:1:4', 'no float']), ('a: !!map [b]', ['scene.yaml:1:4']),
    ('a: !!timestamp soon', ['scene.yaml:1:4', 'no timestamp']),
    ('/**: {ros__parameters: {a: 1, b: 2, a: 3}}', ['scene.yaml:1:37', '"a" stands there twice']),
    ('sim: {ros__parameters: {wind: {velocity: [1, 0, 0]}, wind.velocity: [2, 0, 0]}}',
     ['scene.yaml', '"wind.velocity" stands there twice']),
    ('sim: {ros__parameters: {wind.velocity: 1, wind.velocity.x: 2}}',
     ['scene.yaml', 'both a value and a group']),
    ('sim: {ros__parameters: {wind.velocity: 1, wind: 2}}', ['wind: it is both a value and a']),
    ('/**: {ros__parameters: &a {b: *a}}', ['scene.yaml', 'contains itself']),
    ('a: ' + 600 * '[', ['scene.yaml', 'nested too deep']),
    ('sim: {ros__parameters: {gravity: 1' + 400 * '0' + '}}', ['scene.yaml', 'gravity is 100']),
    ('sim: {ros__parameters: {terrain: {file: ' + 300 * 'n' + '.asc}}}', ['no file "nnn']),
    ('hello', ['no parameters', 'ros__parameters']),
    ('sim: {ros__parameters: {seed: x}}', ['scene.yaml', 'seed']),
], ids=lambda value: str(value)[:30])
def test_bad_files_are_named(tmp_path, text, words):
    """Name the file and the place in it."""
    path = tmp_path / 'scene.yaml'
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        Scene.from_yaml(path)
    for word in words:
        assert word in str(caught.value)
    assert '\n' not in str(caught.value)


def test_files_that_are_no_scene_files_are_refused(tmp_path):
    """Read neither what never ends nor what is not there."""
    with pytest.raises(SceneError, match='more than 10000000 characters'):
        Scene.from_yaml('/dev/zero')
    with pytest.raises(SceneError, match='No such file'):
        Scene.from_yaml(tmp_path / 'none.yaml')


def bomb(kind, levels=9, width=9):
    """Write a few lines of aliases that stand for `width ** levels` values."""
    pairs = {'list': ('[{}]', '*{0}'), 'map': ('{{{}}}', 'k{1}: *{0}'), 'merge': ('{{{}}}', '')}
    whole, item = pairs[kind]
    lines = ['  a0: &a0 x' if kind == 'list' else '  a0: &a0 {k: x}']
    for level in range(1, levels + 1):
        inner = ', '.join(item.format(f'a{level - 1}', i) for i in range(width))
        if kind == 'merge':
            inner = '<<: [' + ', '.join([f'*a{level - 1}'] * width) + ']'
        lines.append(f'  a{level}: &a{level} ' + whole.format(inner))
    return '/**:\n ros__parameters:\n' + '\n'.join(lines)


@pytest.mark.parametrize('text', [
    bomb('list'), bomb('map'), bomb('merge'), bomb('list', 40, 2),
    '/**: {ros__parameters: {a: &a ' + 'x' * 30_000 + ', b: [' + '*a,' * 1000 + ']}}'])
def test_aliases_count_as_what_they_stand_for(tmp_path, text):
    """Refuse a small file that stands for billions of values, with its place; in no time."""
    path = tmp_path / 'scene.yaml'
    path.write_text(text)
    tracemalloc.start()
    try:
        with pytest.raises(SceneError, match='scene.yaml:1:1: .* aliases written out'):
            Scene.from_yaml(path)
        assert tracemalloc.get_traced_memory()[1] < 30_000_000
    finally:
        tracemalloc.stop()


def test_aliases_within_bounds_are_read(tmp_path):
    """Read a scene that says a grammar once and names it again."""
    path = tmp_path / 'scene.yaml'
    path.write_text('/**:\n ros__parameters:\n  scene: {objects: [a, b]}\n'
                    '  a: &a {grammar_text: "axiom: Width(0.1) F(1)"}\n'
                    '  b: {<<: *a, origin: [3, 0, 0]}\n')
    assert len(Scene.from_yaml(path).blueprint) == 2


_POLE = 'axiom: Width(0.1) F(1) F(1)'
_BLOCK = """building block()
  footprint: (0, 0) (1, 0)
  facades: wall
  storey_height: 0.5
layout running { unit: 0.215 0.1025 0.065  material: brick }
panel wall: running
"""


@pytest.mark.parametrize('name, words', [
    ('~nosuchuser/oak.lsys', 'there is no grammar "~nosuchuser/oak.lsys"'),
    ('~nosuchuser', 'there is no grammar'),
    ('o' * 5000 + '.lsys', '(5005 characters)'),
    ('ab/' * 5000 + '.lsys', '(15005 characters)'),
    ('oak\udcff.lsys', 'is not a file name'), ('oak\0.lsys', 'is not a file name'),
    ('oak\n.lsys', 'is not a file name'), ('', 'is not a file name'),
    ('/dev/zero', 'not a regular file'), ('/dev/null', 'not a regular file'),
    ('/etc', 'it is a folder'), ('aok.lsys', 'did you mean oak.lsys'),
    ('package://other/oak.lsys', 'another package'), ('oak.lsys/x', 'there is no grammar')])
def test_names_of_no_grammar_are_refused_in_one_line(name, words):
    """Say what is wrong, shortly, for whatever a parameter holds."""
    with pytest.raises(SceneError) as caught:
        load_grammar(name, 'tree.grammar')
    message = str(caught.value)
    assert words in message and message.startswith('tree.grammar: ')
    assert '\n' not in message and len(message) < 700


def test_a_folder_that_cannot_be_searched(monkeypatch, tmp_path):
    """Report what the system answers, whoever asks."""
    def refuse(path, **_):
        raise PermissionError(13, 'Permission denied', str(path))
    shared_folder()  # has been found by then
    monkeypatch.setattr('pathlib.Path.stat', refuse)
    with pytest.raises(SceneError, match='cannot be read: Permission denied'):
        load_grammar(str(tmp_path / 'oak.lsys'), 'tree.grammar')


def test_a_pipe_is_not_waited_for(tmp_path):
    """Refuse a pipe that nobody writes to, at once."""
    os.mkfifo(tmp_path / 'pipe.lsys')
    with pytest.raises(SceneError, match='not a regular file'):
        load_grammar(str(tmp_path / 'pipe.lsys'), 'tree.grammar')


@pytest.mark.parametrize('content', [
    b'\xef\xbb\xbf' + _POLE.encode(), _POLE.encode().replace(b' ', b'\r\n', 1)])
def test_files_of_windows_are_read(tmp_path, content):
    """Accept a mark in front of UTF-8, and its ends of lines."""
    path = tmp_path / 'pole.lsys'
    path.write_bytes(content)
    assert len(load_grammar(str(path), 'key').build()) == 2


def test_a_mark_in_front_of_a_text_is_accepted():
    """Read a parameter that was copied out of such a file."""
    assert len(parse_grammar('\ufeff' + _POLE, 'key').build()) == 2


@pytest.mark.parametrize('content, words', [
    (_POLE.encode('utf-16'), 'no UTF-8 text'), (b'\n\n\xff', ':3: cannot read'),
    (b'#' * 300_000, 'more than 200000 characters'),
    ('é'.encode() * 500_001, 'more than 200000 characters')])
def test_what_is_no_text_or_too_long_is_refused(tmp_path, content, words):
    """Name the file, and the line at fault; read no more than the longest grammar."""
    path = tmp_path / 'pole.lsys'
    path.write_bytes(content)
    with pytest.raises(GrammarError) as caught:
        load_grammar(str(path), 'key')
    assert words in str(caught.value) and str(caught.value).startswith(str(path))


def test_long_texts_are_refused_before_they_are_read():
    """Bound the work for a parameter of any length."""
    with pytest.raises(ProcPhysError, match='at most 200000'):
        parse_grammar('F' * 300_000, 'key')


def test_files_beside_the_scene_come_first(tmp_path):
    """Take the grammar that lies beside the scene file, then the shipped one."""
    (tmp_path / 'oak.lsys').write_text(_POLE)
    scene = tmp_path / 'scene.yaml'
    scene.write_text('/**: {ros__parameters: {scene: {objects: [a, b]},\n'
                     '  a: {grammar: oak.lsys}, b: {grammar: shrub.lsys}}}\n')
    first, second = Scene.from_yaml(scene).objects
    assert first.count == 2 and second.count > 20


def test_what_was_said_is_not_suggested():
    """Offer only other names than the one given."""
    assert nearest_names('oak_0', ['oak_0']) == ''
    assert nearest_names('oak_0', ['oak_0', 'oak_1']) == '; did you mean oak_1?'


def test_names_that_the_system_cannot_have_are_refused():
    """Say so in one line where names of files are ASCII and that of a grammar is not."""
    code = ('from procphys_ros.scene.sources import load_grammar\n'
            'try: load_grammar("b\\xe4ume.lsys", "oak.grammar")\n'
            'except Exception as error: print(ascii(str(error)))')
    done = subprocess.run([sys.executable, '-c', code], text=True, capture_output=True, env={
        **os.environ, 'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0'})
    assert 'oak.grammar: "b\\xe4ume.lsys" cannot be read' in done.stdout, done.stderr


@pytest.mark.parametrize('text', [_POLE, _BLOCK])
@pytest.mark.parametrize('seed', [-1, 1.5, 'a', None])
def test_seeds_of_grammars_are_whole_numbers(text, seed):
    """Name the seed; none at all would make another object each time."""
    grammar = parse_grammar(text, 'thing.grammar_text')
    with pytest.raises(GrammarError, match=f'thing.grammar_text: the seed is {seed!r}, it must'):
        grammar.build(seed=seed)


_TWIG = 'axiom: Width(0.1) F(length)\nderivation length: 0\ndefine: length = 2\nproduction:\n'


def test_a_grammar_beside_goes_before_the_shipped_one_of_its_name(tmp_path, monkeypatch):
    """Take the oak that lies where the command is given, as its name says, with or without ./."""
    monkeypatch.chdir(tmp_path)
    shipped = len(open_scene('oak.lsys').blueprint)
    (tmp_path / 'oak.lsys').write_text(_TWIG)
    for word in ('oak.lsys', './oak.lsys', str(tmp_path / 'oak.lsys')):
        assert len(open_scene(word).blueprint) == len(LSystem.parse(_TWIG).build()) < shipped


def test_a_grammar_takes_a_seed_and_defines(tmp_path, monkeypatch):
    """Grow what the options say."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'twig.lsys').write_text(_TWIG)
    scene = open_scene('twig.lsys', seed=1, defines={'length': 3.0})
    assert scene.blueprint.visual_size[:, 2].sum() == pytest.approx(3.0)
    assert [placed.name for placed in scene.objects] == ['twig']


def test_scenes_are_found_by_name_or_path(tmp_path, monkeypatch):
    """Know shipped scenes by name, own ones by path, whatever their suffix."""
    monkeypatch.chdir(tmp_path)
    assert scene_file('garden').name == 'garden.yaml'
    (tmp_path / 'mine.params').touch()
    (tmp_path / 'garden').mkdir()
    assert scene_file('mine.params').is_file() and scene_file('garden').is_file()


@pytest.mark.parametrize('word', ['gardn', '', 'none.txt'])
def test_what_is_none_is_refused_with_the_names(word):
    """Say what there is, and the nearest name."""
    with pytest.raises(SceneError, match='neither a scene file') as told:
        scene_file(word)
    assert 'shipped: arcade_pier' in str(told.value)
    assert ('did you mean garden' in str(told.value)) == (word == 'gardn')


def test_a_grammar_is_exported(tmp_path, monkeypatch, capsys):
    """Write one tree, without a scene file around it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'twig.lsys').write_text(_TWIG)
    assert export_command.main(['twig.lsys', '--define', 'length=3', '--out', 'twig.urdf']) == 0
    assert 'twig' in (tmp_path / 'twig.urdf').read_text()
    assert export_command.main(['garden', '--seed', '2', '--out', 'garden.urdf']) == 1
    assert 'is for a grammar' in capsys.readouterr().err


def test_a_page_of_a_node_takes_no_seed(capsys):
    """End invalid usage with 2: a node has its own grammars."""
    with pytest.raises(SystemExit) as end:
        view.main(['--seed', '3'])
    assert end.value.code == 2
    assert capsys.readouterr().err == 'view: --seed and --define are for a grammar\n'


@pytest.mark.parametrize('words, says', [
    (['nowhere.yaml'], 'nowhere.yaml'),
    (['garden', '--host', '192.0.2.1'], '192.0.2.1:8080'),
    (['--ros-args', '-r', 'bad'], 'remap rule'),
    (['garden', '--host', 'a..b'], 'a..b: that is no name'),
])
def test_mistakes_of_view_are_answered_in_one_line(words, says, capsys):
    """End with one readable line."""
    assert view.main(words) == 1
    complaint = capsys.readouterr().err
    assert says in complaint
    assert complaint.count('\n') == 1
    assert complaint.startswith('view: ')


_POLES = {'scene': {'objects': ['pole']},
          'pole': {'grammar_text': 'axiom: Width(0.1) Density(700) F(1)'}}


@pytest.mark.parametrize('given, words', [
    ({'cues': ['1 gust']}, 'there is no parameter cues; did you mean scene.cues?'),
    ({'wind2': {'velocity': [9.0, 0.0, 0.0]}}, 'there is no parameter wind2.velocity'),
    ({'Seed': 3}, 'there is no parameter Seed; did you mean seed?'),
    ({'elm': {'grammar': 'oak.lsys', 'count': 3}}, 'parameters of elm are not used'),
    ({300 * 'q': 1}, 'there is no parameter qqq')])
def test_what_nobody_reads_is_told_in_one_line(given, words, caplog):
    """Warn of a top-level name that neither the node nor an object has, and of a spare object."""
    Scene.from_parameters({**_POLES, **given})
    line, = caplog.messages
    assert line.startswith(words) and '\n' not in line


def test_the_allowed_names_are_told(caplog):
    """List the groups there are, beside those that the scene names itself."""
    Scene.from_parameters({**_POLES, 'cues': ['1 gust']})
    assert f'they begin with {", ".join(sorted(GROUPS))}, or a name of scene.' in caplog.text


@pytest.mark.parametrize('given, words', [
    ({'projectile': {'masss': 3.0}}, r'projectile.masss: .* did you mean mass\? \(known: shape'),
    ({'projectile': {'masss': 3.0}, 'scene': {'objects': ['pole'], 'cues': ['1 launch']}},
     'projectile.masss'), ({'projectile': [1]}, r'projectile is \[1\], it must be a group of sh'),
    ({'explosion': {'charge': 'much'}}, "explosion.charge is 'much', it must be a number"),
    ({'publish_rate': 'fast'}, 'publish_rate is .* must be a number'),
    ({'lidar': {'rows': {'a': 1}}}, 'lidar.rows.a: there is no such key'),
    ({'seed': {'a': 1}}, 'seed is .* must be a whole number'),
    ({'scene': {'objects': ['gust']}, 'gust': {'grammar': 'oak.lsys'}}, '"gust" cannot name an')])
def test_what_a_group_of_the_node_does_not_know_is_refused(given, words):
    """Refuse it, and values of a wrong type, where only the running node would use it, too."""
    with pytest.raises(SceneError, match=words):
        Scene.from_parameters({**_POLES, **given})


def test_parameters_of_every_node_are_no_mistake(caplog):
    """Pass over what ROS itself declares on each node."""
    Scene.from_parameters({**_POLES, 'use_sim_time': False,
                           'qos_overrides': {'/sim/poses': {'publisher': {'depth': 3}}}})
    assert not caplog.messages


def test_a_sweep_is_refused_before_its_runs(tmp_path):
    """Name the key when the scene file is read, not once for each run."""
    path = tmp_path / 'scene.yaml'
    path.write_text('/**: {ros__parameters: {scene: {objects: [oak]}, oak: {grammar: oak.lsys}, '
                    'explosion: {chrage: 3}}}', 'utf-8')
    with pytest.raises(SceneError, match='explosion.chrage: .* did you mean charge'):
        Sweep.read(path, [], 1, 1.0)


def test_a_define_that_stands_there_twice_is_refused():
    """Refuse it, for one of its values would be lost."""
    pole = {**_POLES['pole'], 'defines': ['a=1', 'a=2']}
    with pytest.raises(SceneError, match='pole.defines: "a" stands there twice'):
        Scene.from_parameters({**_POLES, 'pole': pole})


@pytest.mark.parametrize('name', ['steps', 'self', 'overrides'])
@pytest.mark.parametrize('grammar', ['abop_2_6.lsys', 'garden_wall.wall'])
def test_a_define_called_as_an_argument_of_python_is_told_like_any_other(name, grammar):
    """Refuse names that a grammar does not have in its own words, whatever they mean elsewhere."""
    given = {'scene': {'objects': ['pole']},
             'pole': {'grammar': grammar, 'defines': [f'{name}=1']}}
    with pytest.raises(GrammarError, match=f'unknown define "{name}"'):
        Scene.from_parameters(given)


def test_a_scene_without_objects_is_told(caplog):
    """Say in one line that nothing stands in a scene."""
    Scene.from_parameters({'seed': 3})
    assert caplog.messages == ['scene.objects is empty: nothing stands in the scene']


CALM = {'scene': {'objects': ['post']}, 'post': {'grammar_text': SAPLING}}


@pytest.fixture
def scene(tmp_path):
    """Write a scene file of a tree."""
    path = tmp_path / 'calm.yaml'
    path.write_text(json.dumps({'/**': {'ros__parameters': CALM}}), 'utf-8')
    return path


def test_variations_are_combined(scene):
    """Combine lists, YAML and evenly spaced numbers with seeds, the last one fastest."""
    sweep = Sweep.read(scene, ['wind.velocity=[[1, 0, 0], [2, 0, 0]]', 'gust.duration=1..2/3',
                               'post.count=1,4'], 2, 5.0)
    runs = list(sweep.runs())
    assert len(runs) == len(sweep) == 2 * 3 * 2 * 2
    assert sweep.columns == ('wind.velocity', 'gust.duration', 'post.count', 'seed')
    assert runs[0][0] == ([1.0, 0.0, 0.0], 1.0, 1, 0) and runs[1][0][3] == 1
    values, last = runs[-1]
    assert values == ([2.0, 0.0, 0.0], 2.0, 4, 1) and last.number == 23
    assert last.parameters['wind'] == {'velocity': [2.0, 0.0, 0.0]}
    assert last.parameters['post']['count'] == 4 and last.parameters['seed'] == 1
    assert 'count' not in CALM['post']


@pytest.mark.parametrize('text, values', [
    ('wind.velocity=10..40/4', [[6, 8, 0], [12, 16, 0], [18, 24, 0], [24, 32, 0]]),
    ('wind.velocity=[0,0,0]..[20, -10, 2]/3', [[0, 0, 0], [10, -5, 1], [20, -10, 2]]),
    ('post.origin=[1,2,0] .. [3,2,0] / 2', [[1, 2, 0], [3, 2, 0]]),
    ('gust.amplitude=-5..5/3', [-5, 0, 5]), ('post.count=1..4/4', [1, 2, 3, 4]),
    ('post.grammar=../a.lsys,b..1/2.lsys', ['../a.lsys', 'b..1/2.lsys']),
    ('scene.cues=[["0 gust"], ["1 gust # .."]]', [['0 gust'], ['1 gust # ..']])])
def test_ranges_are_numbers_or_vectors(text, values):
    """Space numbers evenly, vectors between two, and lengths along the scene's direction."""
    found = Variation.read(text, ['post'], {'wind': {'velocity': [3.0, 4.0, 0.0]}}).values
    assert [pytest.approx(value) for value in found] == values
    kind = type(found[0])
    assert all(type(value) is kind for value in found)


def test_a_range_of_speeds_needs_a_direction():
    """Vary the speed of a wind that the scene does not have: say what to write instead."""
    for scene in ({}, {'wind': {'velocity': [0.0, 0.0, 0.0]}}):
        with pytest.raises(SceneError, match=r'no direction in the scene.*\[40, 0, 0\]/4'):
            Variation.read('wind.velocity=10..40/4', [], scene)


@pytest.mark.parametrize('text, reason', [
    ('post.count=1..2/3', 'post.count is 1.5, it must be a whole number'),
    ('wind.velocity=[0,0]..[1,1]/3', r'\[0, 0, 0\]..\[20, 0, 0\]/5'),
    ('wind.velocity=0..[1,1,1]/3', 'first..last'), ('gust.duration=[1,2]..[3,4]/2', 'first..last'),
    ('wind.velocity=0..1/-3', 'first..last'), ('wind.velocity=[0,0,0]..[999,0,0]/3', '499.5'),
    ('gust.duration=1..nan/3', 'gust.duration is nan'),
    ('wind.velocty=[1,0,0]', 'did you mean wind.velocity'), ('wind.velocity', 'name=values'),
    ('wind.velocity=1,2', 'list of 3'), ('post.count=-1', 'post.count'), ('seed=1,2', '--seeds'),
    ('gust.duration=[', 'YAML'),
    ('gust.duration=1..2', 'first..last/number'), ('elm.count=2', 'elm.count'),
    ('gust.duration=1..x/3', 'first..last'),
    ('gust.duration=1..2/1000000000', 'at most 1000000'),
    ('gust.duration=2026-02-30', 'must be a number'),
    ('publish_rate=10,20', 'no run depends on it'), ('camera.part=a,b', 'no run depends'),
    ('lidar.rate=1,2', 'no run depends'), ('spawn.name=a,b', 'no run depends'),
    ('gust.duration=' + 1000 * '[', 'YAML'), ('gust.duration=', 'no values')],
    ids=lambda value: value[:30])
def test_variations_that_make_no_sense_are_refused(scene, text, reason):
    """Say what is wrong in one line."""
    with pytest.raises(SceneError, match=reason):
        Sweep.read(scene, [text], 1, 1.0)


@pytest.mark.parametrize(('variations', 'reason'), [
    (['scene.cues=[["0 gust"], ["1 gst"]]'], 'scene.cues.*did you mean gust'),
    (['gust.duration=8,2', 'gust.rise=1,4'], 'gust.rise is 4'),
    (['time_step=0.001,0.1'], r'one time step \(0.1 s\)'),
    (['post.grammar=a.lsys'], 'post')])
def test_values_that_do_not_go_together_are_refused(scene, variations, reason):
    """Look at each combination before any of them runs; what fits with others is no mistake."""
    with pytest.raises(SceneError, match=reason):
        Sweep.read(scene, variations, 1, 0.05)
    assert len(Sweep.read(scene, ['gust.duration=8,10', 'gust.rise=1,4'], 2, 0.05)) == 8


@pytest.mark.parametrize('duration', [1e300, float('inf'), float('nan'), 1e-300, 0.0, -1.0])
def test_runs_without_an_end_or_a_step_are_refused(scene, duration):
    """Say from what to what a run may last, before any begins."""
    with pytest.raises(SceneError, match=r'from one time step \(0.0\d+ s\) to 1e\+06 s'):
        Sweep.read(scene, [], 1, duration)


def test_seeds_of_objects_are_varied(scene):
    """Take the seed of an object, as any of its parameters; only that of the scene has --seeds."""
    sweep = Sweep.read(scene, ['post.seed=4,5'], 1, 1.0)
    assert [run.parameters['post']['seed'] for _, run in sweep.runs()] == [4, 5]
