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


"""What a scene file says and nobody reads: refused in a known group, else told in a line."""

import pytest

from procphys_ros.batch.sweep import Sweep
from procphys_ros.errors import GrammarError, SceneError
from procphys_ros.scene import Scene
from procphys_ros.scene.parameter_table import GROUPS

_POLE = {'scene': {'objects': ['pole']},
         'pole': {'grammar_text': 'axiom: Width(0.1) Density(700) F(1)'}}


@pytest.mark.parametrize('given, words', [
    ({'cues': ['1 gust']}, 'there is no parameter cues; did you mean scene.cues?'),
    ({'wind2': {'velocity': [9.0, 0.0, 0.0]}}, 'there is no parameter wind2.velocity'),
    ({'Seed': 3}, 'there is no parameter Seed; did you mean seed?'),
    ({'elm': {'grammar': 'oak.lsys', 'count': 3}}, 'parameters of elm are not used'),
    ({300 * 'q': 1}, 'there is no parameter qqq')])
def test_what_nobody_reads_is_told_in_one_line(given, words, caplog):
    """Warn of a top-level name that neither the node nor an object has, and of a spare object."""
    Scene.from_parameters({**_POLE, **given})
    line, = caplog.messages
    assert line.startswith(words) and '\n' not in line


def test_the_allowed_names_are_told(caplog):
    """List the groups there are, beside those that the scene names itself."""
    Scene.from_parameters({**_POLE, 'cues': ['1 gust']})
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
        Scene.from_parameters({**_POLE, **given})


def test_parameters_of_every_node_are_no_mistake(caplog):
    """Pass over what ROS itself declares on each node."""
    Scene.from_parameters({**_POLE, 'use_sim_time': False,
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
    pole = {**_POLE['pole'], 'defines': ['a=1', 'a=2']}
    with pytest.raises(SceneError, match='pole.defines: "a" stands there twice'):
        Scene.from_parameters({**_POLE, 'pole': pole})


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
