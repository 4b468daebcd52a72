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

"""The parameter table and cues: what they accept and refuse, as scenes and docs say."""

from array import array
from dataclasses import fields
import math
from pathlib import Path
import re

import numpy as np
import pytest

from procphys_ros.errors import ProcPhysError, SceneError
from procphys_ros.physics.wind import Gust, GUST_KINDS, PROFILES, SPECTRA, WindSettings
from procphys_ros.scene import Scene
from procphys_ros.scene.cues import Blow, read_cues
from procphys_ros.scene.culling import CullingSettings
from procphys_ros.scene.intruder import IntruderSettings
from procphys_ros.scene.layout import LAYOUTS
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.objects import OBJECT_KEYS, ObjectSpec, read_objects
from procphys_ros.scene.parameter_table import (
    check_object_names,
    find,
    GLOBAL,
    markdown,
    nested,
    OBJECT,
)
from procphys_ros.scene.particles import DustSettings, LeafSettings
from procphys_ros.scene.scenery import CameraSettings, SkySettings, SunSettings
from procphys_ros.scene.settings import read_settings, Settings
from procphys_ros.scene.shards import Shard
from procphys_ros.scene.spawn import Spawn
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.schema import parameters, short
from procphys_ros.simulation import Simulation

TABLE = {p.name: p for p in GLOBAL}
DEFAULTS = {p.name: p.default for p in GLOBAL}
DOCS = (Path(__file__).resolve().parents[1] / 'docs' / 'parameters.md').read_text('utf-8')


def test_defaults_are_accepted_by_their_own_rows():
    """Accept each default, unchanged, and describe each row."""
    for parameter in (*GLOBAL, *OBJECT):
        assert parameter.read(parameter.default) == parameter.default, parameter.name
        assert parameter.description
        assert not parameter.choices or parameter.default in parameter.choices


def test_defaults_are_those_of_scenes_and_wind():
    """Expect a node without parameters to equal a scene file without settings."""
    settings = read_settings(nested(DEFAULTS, []))
    assert settings == Settings()


def test_table_lists_every_setting():
    """Offer every field of wind and gust, and every key of an object."""
    assert {n.removeprefix('wind.') for n in TABLE if n.startswith('wind.')} == {
        f.name for f in fields(WindSettings)}
    assert {n.removeprefix('gust.') for n in TABLE if n.startswith('gust.')} == {
        f.name for f in fields(Gust)}
    for group, kind in (('leaves', LeafSettings), ('dust', DustSettings)):
        assert {n for n in TABLE if n.startswith(group)} == {
            f'{group}.{f.name}' for f in fields(kind)}
    assert {p.name for p in OBJECT} == set(OBJECT_KEYS)


def test_choices_and_object_defaults_are_those_of_the_scene():
    """Name the same choices and defaults as the code that uses them."""
    assert TABLE['wind.profile'].choices == PROFILES
    assert TABLE['wind.spectrum'].choices == SPECTRA
    assert TABLE['gust.kind'].choices == GUST_KINDS
    for parameter in OBJECT:
        default = next(f.default for f in fields(ObjectSpec) if f.name == parameter.name)
        assert parameter.default == (list(default) if isinstance(default, tuple) else default)
    assert next(p for p in OBJECT if p.name == 'layout').choices == LAYOUTS


@pytest.mark.parametrize(('name', 'value', 'expected'), [
    ('wind.velocity', [5, 0, 0], [5.0, 0.0, 0.0]),
    ('wind.velocity', np.array([1.5, 0.0, 2.0]), [1.5, 0.0, 2.0]),
    ('publish_rate', 20, 20.0),
    ('scene.objects', [], []),
    ('scene.objects', ['', 'oak'], ['oak']),
    ('seed', 2**40, 2**40),
    ('status_line', True, 'on'), ('status_line', False, 'off'),  # as YAML 1.1 reads on and off
])
def test_value_is_brought_to_its_type(name, value, expected):
    """Turn whole numbers into floats, arrays into lists, empty texts into nothing."""
    read = TABLE[name].read(value)
    assert read == expected and type(read) is type(expected)
    if isinstance(read, list) and read:
        assert type(read[0]) is type(expected[0])


@pytest.mark.parametrize(('name', 'value', 'said'), [
    ('wind.velocity', [1.0, math.nan, 0.0], 'from -150 to 150 m/s'),
    ('wind.velocity', [1.0, math.inf, 0.0], 'wind.velocity'),
    ('wind.velocity', [1.0, 2.0], 'list of 3 numbers'),
    ('wind.velocity', ['a', 'b', 'c'], 'number'),
    ('wind.velocity', 'strong', 'list of 3 numbers'),
    ('wind.velocity', None, 'list of 3 numbers'),
    ('publish_rate', True, 'number'),
    ('dust.enabled', 'x' * 10**6, 'true or false'),
    ('dust.enabled', [0.0] * 10**5, 'true or false'),
    ('publish_rate', 0.0, 'from 0.1 to 240 Hz'),
    ('seed', 1.5, 'whole number'),
    ('seed', -1, 'whole number from 0'),
    ('wind.profile', 'loq', 'log, power, uniform'),
    ('wind.profile', 3, 'text'), ('wind.profile', True, 'text'),
    ('scene.objects', 'oak', 'list of texts'),
    ('scene.objects', [1, 2], 'list of texts'),
    ('impulse.target', 'x' * 10**6, None),
])
def test_bad_value_is_refused_in_one_short_line(name, value, said):
    """Name the parameter and what is allowed; never echo a megabyte."""
    if said is None:
        assert TABLE[name].read(value) == value
        return
    with pytest.raises(SceneError) as caught:
        TABLE[name].read(value)
    assert said in str(caught.value) and name in str(caught.value)
    assert len(str(caught.value)) < 300 and '\n' not in str(caught.value)


@pytest.mark.parametrize('name', ['wind', 'seed', 'two words', '', '1oak', 'a.b', 'é' * 3 + '/'])
def test_object_names_that_cannot_head_parameters_are_refused(name):
    """Refuse names that hide the node's own parameters, or that ROS does not allow."""
    with pytest.raises(SceneError):
        check_object_names([name])


def test_nested_leaves_out_what_is_not_given():
    """Turn dotted names into groups, without the defaults that stand for nothing."""
    values = {'wind.velocity': [1.0, 0.0, 0.0], 'gust.rise': 0.0, 'gust.direction': [0.0] * 3,
              'gust.amplitude': 5.0, 'oak.count': 3, 'elm.count': 2}
    assert nested(values, ['oak']) == {
        'wind': {'velocity': [1.0, 0.0, 0.0]}, 'gust': {'amplitude': 5.0}, 'oak': {'count': 3}}


def test_rows_are_found_by_full_name():
    """Find parameters of the node and of known objects only."""
    assert find('wind.velocity', []) is TABLE['wind.velocity']
    assert find('oak.count', ['oak']).name == 'count'
    assert find('oak.count', []) is None
    assert find('oak.counts', ['oak']) is None


@pytest.mark.parametrize(('name', 'value'), [
    ('yaw', 2000.0), ('spacing', 2e5), ('origin', [0.0, 2e6, 0.0]), ('count', 2.0),
    ('seed', 2**63), ('layout', 'ring'), ('defines', 'n=3')])
def test_the_library_refuses_what_the_node_refuses(name, value):
    """Check objects that are made in Python by the same declaration."""
    row = next(p for p in OBJECT if p.name == name)
    for refuse in (lambda: row.read(value, f'oak.{name}'),
                   lambda: ObjectSpec('oak', grammar='oak.lsys', **{name: value}),
                   lambda: read_objects({'scene': {'objects': ['oak']},
                                         'oak': {'grammar': 'oak.lsys', name: value}})):
        with pytest.raises(SceneError, match=f'oak.{name}'):
            refuse()


@pytest.mark.parametrize('kind', [
    Settings, WindSettings, Gust, LeafSettings, DustSettings, CullingSettings, IntruderSettings,
    Blow, Projectile, Explosion, Demolition, Cut, Shard, Spawn, LidarSettings, CameraSettings,
    SunSettings, SkySettings])
def test_every_number_of_every_setting_is_checked(kind):
    """Refuse what is just outside of the range that is declared, also in Python."""
    rows = parameters(kind)
    assert rows
    for row in rows:
        name = row.name.rpartition('.')[2]
        items = row.default if isinstance(row.default, list) else [row.default]
        numbers = [v for v in items if isinstance(v, (int, float)) and not isinstance(v, bool)]
        if not numbers and not row.any_length:
            continue
        for bad in (row.low - 1, row.high + 1, math.nan):
            value = [bad] * max(len(items), 1) if isinstance(row.default, list) else bad
            with pytest.raises(ProcPhysError, match=re.escape(row.name)):
                kind(**{name: value})


def test_docs_show_the_table():
    """Keep the tables of the docs as the table of parameters has them."""
    assert markdown(GLOBAL) in DOCS
    assert markdown(OBJECT, '<name>.') in DOCS


def test_lists_are_shown_as_they_are_written():
    """Say [1.0] where ROS gives an array."""
    assert short(array('d', [1.0])) == short((1.0,)) == '[1.0]'


POST = 'axiom: Width(0.1) Density(700) Modulus(8e9) DampingRatio(0.05) F(1) F(1)'


def scene(*cues, **groups):
    """Describe a post and its cues."""
    return {'scene': {'objects': ['post'], 'cues': list(cues)}, 'post': {'grammar_text': POST},
            **groups}


def test_cues_are_read_in_the_order_of_their_times():
    """Take from the scene's groups what a cue does not say."""
    cues = read_cues(scene(
        '3 demolish', '0 launch position=1,-9,2 mass=12', '1.5 gust duration=4',
        '2 explode charge=3', '2.5 cut target=post/1 normal=0,0,1',
        '1e0 impulse target=post/1 linear=0,5,0',
        projectile={'shape': 'box', 'size': [1.0, 2.0, 0.5], 'mass': 5.0},
        gust={'amplitude': 25.0}))
    assert [cue.time for cue in cues] == [0.0, 1.0, 1.5, 2.0, 2.5, 3.0]
    thrown, blow, gust, blast, sawn, charges = (cue.what for cue in cues)
    assert thrown == Projectile('box', [1.0, 2.0, 0.5], 12.0, [1.0, -9.0, 2.0])
    assert blow == Blow('post/1', [0.0, 5.0, 0.0])
    assert gust == Gust(amplitude=25.0, duration=4.0)
    assert blast == Explosion(charge=3.0) and charges == Demolition()
    assert sawn == Cut('post/1', normal=[0.0, 0.0, 1.0])


@pytest.mark.parametrize('cue, words', [
    ('gust', 'there is no verb'), ('1 gale', 'did you mean|there is no verb "gale"'),
    ('soon gust', '"soon" is not a time'), ('-1 gust', 'is not a time'),
    ('nan gust', 'is not a time'), ('1 launch mas=3', 'did you mean mass'),
    ('1 launch mass=3 mass=4', '"mass" stands there twice'),
    ('1 launch mass', 'sets nothing'), ('1 launch mass=heavy', 'numbers are expected'),
    ('1 launch mass=-3', 'projectile.mass'), ('1 launch position=1,2', 'projectile.position'),
    ('1 explode position=0,0,-4', 'under the ground'), ('1 gust duration=0', 'duration'),
])
def test_bad_cues_are_named(cue, words):
    """Say which cue is wrong, in which word, and what is allowed."""
    with pytest.raises(SceneError, match=words) as error:
        Scene.from_parameters(scene('0 gust direction=1,0,0', cue))
    assert f'scene.cues[1] "{cue}"' in str(error.value)


@pytest.mark.parametrize('cues', ['1 gust', [3], {'1': 'gust'}])
def test_cues_are_a_list_of_texts(cues):
    """Refuse anything else."""
    with pytest.raises(SceneError, match='scene.cues'):
        read_cues({'scene': {'cues': cues}})


def test_cues_happen_at_their_time_and_again_after_a_reset():
    """Throw at one second, not before; do all of it again after a reset."""
    simulation = Simulation(Scene.from_parameters(scene(
        '1.0 launch position=5,-9,2 velocity=0,3,0', '0.5 impulse target=post/1 linear=3,0,0')))
    poses = []
    for _ in range(2):
        simulation.step(30)
        assert not np.any(simulation.velocities)
        simulation.step(30)
        assert np.any(simulation.velocities) and len(simulation.objects) == 1
        simulation.step(1)
        assert [o.name for o in simulation.objects] == ['post', 'projectile_0']
        poses.append(simulation.poses)
        simulation.reset()
    np.testing.assert_array_equal(*poses)


def test_a_refused_cue_is_told_and_the_play_goes_on(caplog):
    """Warn of a blow on a part that there is not, and throw what comes next."""
    simulation = Simulation(Scene.from_parameters(scene(
        '0 impulse target=oak/7 linear=1,0,0', '0 launch position=5,-9,2')))
    simulation.step()
    assert 'oak/7' in caplog.text and 'refused' in caplog.text
    assert any('oak/7' in line and 'so far' in line for line in simulation.warnings)
    assert len(simulation.objects) == 2
