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


"""Objects that stand on others: bonded to what is under them, told when there is nothing."""

from building_checks import count_loose
from masonry_walls import wall
import numpy as np
import pytest
import yaml

from procphys_ros.errors import SceneError
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

STONE = """
building {name}
  footprint: (0, 0) ({length}, 0)
  facades: wall
  storey_height: 0.6
layout running {{ unit: 0.6 0.3 0.19  joint: 0.01  material: brick }}
panel wall: running
"""


def parameters(**changes):
    """Return the parameters of a wall 2.4 m long and one of 1.2 m on it."""
    upper = {'grammar_text': STONE.format(name='upper', length=1.2), 'origin': [0.6, 0.0, 0.0],
             'on': 'lower', **changes}
    return {'scene': {'objects': ['lower', 'upper']}, 'upper': upper,
            'lower': {'grammar_text': STONE.format(name='lower', length=2.4)}}


def test_an_object_stands_on_another_and_is_bonded_to_it():
    """Lay a wall on a wall: it starts at its top, with as much area bonded as it has."""
    scene = Scene.from_parameters(parameters())
    upper = scene.objects[1]
    plan = scene.blueprint
    own = np.arange(upper.first, upper.first + upper.count)
    assert plan.poses[own, 2].min() == pytest.approx(0.6 + 0.01 + 0.095)
    between = (plan.bonds[:, 0] < upper.first) & (plan.bonds[:, 1] >= upper.first)
    assert (plan.bonds[between, 0] >= 0).all() and count_loose(plan) == 0
    alone = 1.2 - 0.01  # [m] two stones, with a joint between them
    assert plan.bond_area[between].sum() == pytest.approx(0.3 * (alone - 0.01), rel=0.05)
    assert Simulation(scene).warnings == ()


def test_what_stands_on_another_comes_down_with_it():
    """Take the lower wall out: the upper one falls."""
    simulation = Simulation(Scene.from_parameters(parameters()))
    upper = simulation.objects[1]
    simulation.remove('lower')
    simulation.step(30)
    own = slice(upper.first, upper.first + upper.count)
    assert simulation.poses[own, 2].max() < simulation.blueprint.poses[own, 2].max() - 0.3


@pytest.mark.parametrize(('changes', 'message'), [
    ({'on': 'lowr'}, 'upper.on: there is no object "lowr" before it; did you mean lower?'),
    ({'origin': [0.6, 5.0, 0.0]}, 'upper.on: nothing of "lower" is under it'),
    ({'origin': [0.6, 0.0, 0.5]}, 'above the top of "lower", which is at 0.60 m there; set the z '
                                  'of upper.origin to 0'),
    ({'origin': [0.6, 0.0, -0.1]}, 'its feet are more than 0.02 m below the top of "lower"'),
])
def test_what_has_nothing_under_it_is_refused(changes, message):
    """Name the key and what is allowed."""
    with pytest.raises(SceneError) as caught:
        Scene.from_parameters(parameters(**changes))
    assert message in str(caught.value)


def test_trees_stand_on_the_ground():
    """Refuse a tree on a wall: it has roots."""
    scene = Scene()
    scene.add(wall(4, 4), name='wall')
    tree = LSystem.parse('axiom: Width(0.1) Density(900) F(1)').build()
    with pytest.raises(SceneError, match='only what is built'):
        scene.add(tree, name='tree', on='wall')


def test_shares_of_a_scene_hold_what_stands_on_the_ground():
    """Refuse objects on others where the scene is shared among nodes."""
    with pytest.raises(SceneError, match='shard.count'):
        Scene.from_parameters({**parameters(), 'shard': {'index': 1, 'count': 2}})


def test_on_is_a_name_in_scene_files(tmp_path):
    """Read `on: lower` as ROS does, though YAML 1.1 takes `on` for a truth value."""
    path = tmp_path / 'two.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters()}}).replace(
        "'on':", 'on:'), 'utf-8')
    assert '      on: lower' in path.read_text('utf-8')
    assert [thing.name for thing in Scene.from_yaml(path).objects] == ['lower', 'upper']
