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


"""Cues: what a scene does by itself, and when."""

import numpy as np
import pytest

from procphys_ros.errors import SceneError
from procphys_ros.physics.wind import Gust
from procphys_ros.scene import Scene
from procphys_ros.scene.cues import Blow, read_cues
from procphys_ros.scene.strikes import Cut, Demolition, Explosion, Projectile
from procphys_ros.simulation import Simulation

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
