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

"""What commands take for a scene: a file, the name of a shipped scene, or a grammar."""

import pytest

from procphys_ros.errors import SceneError
from procphys_ros.export import command as export_command
from procphys_ros.lsystem import LSystem
from procphys_ros.ros import view
from procphys_ros.scene.named import open_scene, scene_file

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
