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

"""Shards: several nodes together simulate the scene that one would."""

import numpy as np
import pytest

from procphys_ros.errors import SceneError
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

POLE = 'axiom: Width(0.04) Density(800) Modulus(8e9) F(rand(1,2)) F(1) Leaf(0.4, 1)'
WHOLE = {
    'scene': {'objects': ['pole', 'mast', 'lone']}, 'seed': 3,
    'wind': {'velocity': [9.0, 2.0, 0.0], 'turbulence_intensity': 0.2},
    'pole': {'grammar_text': POLE, 'count': 7, 'layout': 'scatter'},
    'mast': {'grammar_text': POLE, 'count': 4, 'origin': [40.0, 0.0, 0.0], 'variants': 2},
    'lone': {'grammar_text': POLE, 'origin': [0.0, 40.0, 0.0]},
}


@pytest.mark.parametrize('count', [2, 3, 12, 15])
def test_the_shares_together_are_the_whole_scene(count):
    """Find every instance in one share, moving as it does in the whole scene."""
    whole = Simulation(Scene.from_parameters(WHOLE))
    whole.step(30)
    expected = {o.name: whole.poses[o.first:o.first + o.count] for o in whole.objects}
    found = {}
    for index in range(count):
        share = Simulation(Scene.from_parameters(
            {**WHOLE, 'shard': {'index': index, 'count': count}}))
        share.step(30)
        for o in share.objects:
            assert o.name not in found
            found[o.name] = share.poses[o.first:o.first + o.count]
    assert set(found) == set(expected)
    for name, poses in expected.items():
        assert np.array_equal(found[name], poses)


@pytest.mark.parametrize(('shard', 'word'), [
    ({'index': 2, 'count': 2}, 'shard.index'), ({'index': -1, 'count': 2}, 'shard.index'),
    ({'index': 0, 'count': 0}, 'shard.count'), ({'index': 'x', 'count': 2}, 'shard.index'),
    ({'index': 0.5, 'count': 2}, 'shard.index'), ({'share': 1}, 'shard'), (7, 'shard'),
])
def test_shares_that_cannot_be_are_named(shard, word):
    """Name the key and what is allowed."""
    with pytest.raises(SceneError, match=word):
        Scene.from_parameters({**WHOLE, 'shard': shard})


def test_what_comes_to_a_share_has_a_name_of_its_own():
    """Throw a ball in each share, and find no name twice; alone, a node calls it projectile_0."""
    def names(**shard):
        share = Simulation(Scene.from_parameters({**WHOLE, **shard}))
        share.launch(Projectile(position=(0.0, -30.0, 5.0), velocity=(0.0, 1.0, 0.0)))
        return [o.name for o in share.objects]
    shares = [name for index in range(2) for name in names(shard={'index': index, 'count': 2})]
    assert len(set(shares)) == len(shares)
    assert {n for n in shares if 'projectile' in n} == {'projectile_0_shard_0',
                                                        'projectile_0_shard_1'}
    assert names()[-1] == 'projectile_0'
