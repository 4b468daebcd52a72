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

"""Scenes: placing instances, reading parameters, refusing what cannot be built."""

from dataclasses import fields, replace
import tracemalloc

import numpy as np
import pytest

from procphys_ros.errors import CommandError, GrammarError, SceneError
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.scene.layout import places
from procphys_ros.scene.objects import ObjectSpec
from procphys_ros.scene.sources import load_grammar
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
    scattered, _ = places('scatter', 30_000, 3.0, np.random.default_rng(1))
    assert np.isfinite(scattered).all() and len(np.unique(scattered, axis=0)) == 30_000


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
    ('a: ' + 1200 * '[', ['scene.yaml', 'nested too deep']),
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
