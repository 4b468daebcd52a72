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

"""Objects that stand on others or lie loose: bonded to what is under them, pressed, or told."""

from building_checks import count_loose
from masonry_walls import bonded, wall
import numpy as np
import pytest
import yaml

from procphys_ros.errors import SceneError
from procphys_ros.lsystem import LSystem
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import contact, Simulation
from procphys_ros.simulation.contact_pairs import TreeContacts

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


_DT = 1.0 / 60.0
_HEIGHTS = pytest.mark.parametrize('height', [0.5, 1.5, 2.5])


def post(tension: float = 1e6, **settings: object) -> Simulation:
    """Stand a stone post of 0.3 x 0.3 x 3 m on the ground."""
    scene = Scene.from_parameters({'scene': {'objects': []}, **settings})
    scene.add(bonded([[0.0, 0.0, 1.5]], (0.3, 0.3, 3.0), tension=tension, cohesion=1e6),
              (0.0, 0.0, 0.0), 0.0, 'post')
    return Simulation(scene)


@_HEIGHTS
def test_an_intruder_bends_a_post_by_the_height_at_which_it_pushes(height):
    """Find the moment at the foot, force times height, to 0.1 %."""
    simulation = post(intruder={'shape': 'sphere', 'size': 0.2})
    for _ in range(7):  # some hundreds of newtons then
        way = min(0.05 * simulation.time, 0.0022)
        simulation.place_intruder([way - 0.252, 0.0, height, 0.0, 0.0, 0.0, 1.0])
        simulation.step()
    foot = simulation.state.solver.wrenches()[0]
    assert foot[0] > 100.0 and foot[4] == pytest.approx(foot[0] * height, rel=1e-3)


@pytest.mark.parametrize('shape', ['sphere', 'box'])
@_HEIGHTS
def test_a_blow_on_its_head_cracks_a_post_that_holds_one_on_its_foot(shape, height):
    """Strike with 620 N: 69, 207 and 345 kPa in the foot, which bears 276 with its weight."""
    simulation = post(2.2e5)
    simulation.launch(Projectile(shape, 0.2, 1.0, (-1.0, 0.0, height), (5.0, 0.0, 0.0)))
    simulation.step(30)
    assert len(simulation.impacts) == 1
    assert (simulation.bonds_broken > 0) == (height > 2.0)


@_HEIGHTS
def test_a_branch_bends_a_post_by_the_height_at_which_it_leans(height):
    """Press with 300 N for some seconds; the moment about the middle of the post is that."""
    simulation = post()
    model, state = simulation.model, simulation.state
    state.contacts = TreeContacts(
        np.array([0]), np.array([-1]), np.array([-1]), np.array([0]),
        np.array([[-0.15, 0.0, height]]), np.array([[-300.0 * _DT, 0.0, 0.0]]), np.ones(1),
        np.zeros(1))
    for _ in range(120):
        contact.press_walls(model, state, _DT)
    parts, wrenches = state.loads.layer('branches')
    assert parts.tolist() == [0]
    assert wrenches[0] == pytest.approx([300.0, 0.0, 0.0, 0.0, 300.0 * (height - 1.5), 0.0],
                                        rel=0.02, abs=1e-9)
