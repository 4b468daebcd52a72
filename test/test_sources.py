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


"""Where grammars are read from: names, files that are none, and the folder of the scene file."""

import os
import subprocess
import sys

import pytest

from procphys_ros.errors import GrammarError, nearest_names, ProcPhysError, SceneError
from procphys_ros.files.resources import shared_folder
from procphys_ros.scene import Scene
from procphys_ros.scene.sources import load_grammar, parse_grammar

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


@pytest.mark.skipif(os.geteuid() == 0, reason='root may search every folder')
def test_a_folder_without_permission_is_reported(tmp_path):
    """Name the reason, as the system gives it."""
    (tmp_path / 'closed').mkdir(mode=0)
    with pytest.raises(SceneError, match='Permission denied'):
        load_grammar(str(tmp_path / 'closed' / 'oak.lsys'), 'tree.grammar')


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


def test_forests_do_not_import_walls():
    """Leave the language of walls, a tenth of all imports, to scenes that have some."""
    code = ('import sys; from procphys_ros.scene import Scene; import procphys_ros.simulation; '
            f'Scene.from_parameters({{"scene": {{"objects": ["pole"]}}, '
            f'"pole": {{"grammar_text": {_POLE!r}}}}}); '
            'assert "procphys_ros.wallgrammar" not in sys.modules')
    subprocess.run([sys.executable, '-c', code], check=True)
