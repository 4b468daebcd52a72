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


"""Variations of a batch: lists, ranges, vectors, combinations, and what makes no sense."""

import json

from node_process import SAPLING
import pytest

from procphys_ros.batch import Sweep, Variation
from procphys_ros.errors import SceneError

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
    ('gust.duration=' + 3000 * '[', 'YAML'), ('gust.duration=', 'no values')],
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
