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

"""Plants that ask where they stand: queries in strings, growth together, growth in scenes."""

import numpy as np
import pytest

from procphys_ros.environment.habitat import Habitat
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import grow, LSystem
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.breaks import section_modulus
from procphys_ros.scene import Scene

ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def query(text: str, name: str, steps: int = 0, **defines: float) -> list[tuple[float, ...]]:
    """Return the parameters of all modules of a name in the derived string."""
    string = LSystem.parse(text).derive(steps, **defines)
    return [module.parameters for module in string if module.name == name]


def test_queries_tell_place_and_attitude():
    """Tell the turtle's state where each query stands, inside branches and after a cut too."""
    text = """
axiom: F(2) ?P(7, 7, 7) [ +(90) F(1) ?P(0, 0, 0) ?H(0, 0, 0) ?L(0, 0, 0)
  ?U(0, 0, 0) % ?P(7, 7, 7) ] F(1) ?P(0, 0, 0)
"""
    assert np.array(query(text, '?P')) == pytest.approx(np.array(
        [[0, 0, 2], [1, 0, 2], [7, 7, 7], [0, 0, 3]]), abs=1e-12)
    frame = [query(text, name)[0] for name in ('?H', '?L', '?U')]
    assert np.array(frame) == pytest.approx(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
                                            abs=1e-12)


def test_rules_read_what_was_answered():
    """Stop growing at a height that the string itself does not know, interpreted geometry too."""
    text = """
axiom: A
production:
  ?P(x, y, z) < A : z < 2.6 -> S ?P(0, 0, 0) A
  ?P(x, y, z) < A -> *
  A -> S ?P(0, 0, 0) A
interpretation:
  S -> F(0.5) F(0.5)
"""
    assert query(text, '?P', 9) == [(0.0, 0.0, 1.0), (0.0, 0.0, 2.0), (0.0, 0.0, 3.0)]


def test_contexts_may_ignore_what_asks():
    """Skip `?E` of all kinds in contexts."""
    text = 'axiom: F A ?E(light; 0) ?E(sag; 0, 0, 0) B\n%sproduction:\n  A < B -> F\n'
    assert str(LSystem.parse(text % 'ignore: ?E\n').derive(1)).endswith('F')
    assert str(LSystem.parse(text % '').derive(1)).endswith('B')


def test_drawings_between_steps_change_no_random_number():
    """Draw the same numbers whether or not a query has the string drawn."""
    text = """
axiom: F(1) %s A
derivation length: 4
production:
  A -> F(rand(1, 2)) [ +(nran(30, 5)) A ] A
interpretation:
  A -> F(rand(0.1, 0.2))
"""
    plain, asking = (LSystem.parse(text % q).build(seed=4) for q in ('', '?E(light; 0)'))
    assert np.array_equal(plain.poses, asking.poses)


def test_curves_pass_through_their_points_and_do_not_overshoot():
    """Rise and fall only where the points do, and stay level beyond them."""
    text = 'axiom: F(1) A(0)\ncurve f: (0, 1) (1, 1)\n  (2, 5) (4, 0.5)\nproduction:\n' \
           '  A(x) -> B(f(x)) A(x + 0.125)\n'
    values = np.array(query(text, 'B', 40))[:, 0]
    x = np.arange(40) * 0.125
    assert values[x <= 1.0] == pytest.approx(1.0)
    assert values[x >= 4.0] == pytest.approx(0.5)
    assert values[x == 2.0] == pytest.approx(5.0)
    assert (np.diff(values[(x >= 1.0) & (x <= 2.0)]) > 0.0).all()
    assert (np.diff(values[(x >= 2.0) & (x <= 4.0)]) < 0.0).all()


def test_plants_that_grow_together_see_each_other():
    """Get less light among others than alone, and the same answers on any number of threads."""
    system = LSystem.load('garden_tree.lsys')

    def leaves(places: list[tuple[float, float]], threads: int = 1) -> list[int]:
        plants = [system.plant(np.array([x, y, 0.0, 0.0, 0.0, 0.0, 1.0]), 3, {'years': 9})
                  for x, y in places]
        grow(plants, Habitat(threads=threads))
        return [len(plant.build().leaves) for plant in plants]
    alone, = leaves([(0.0, 0.0)])
    crowd = [(0.0, 0.0), (0.7, 0.0), (-0.7, 0.0), (0.0, 0.7), (0.0, -0.7)]
    among = leaves(crowd)
    assert among[0] < 0.8 * alone
    assert leaves(crowd, 3) == among
    assert len(system.build(seed=3, years=9).leaves) == alone


def test_a_plant_that_asks_nothing_is_in_the_way_all_the_same():
    """Shade what asks by what does not."""
    asking = LSystem.parse('axiom: F(1) ?E(light; 0)')
    bush = LSystem.parse('axiom: F(2) ' + '[ &(90) /(45) F(0.3) Leaf(1) Leaf(1) ] /(45)' * 8)
    seen = []
    for others in ([], [bush.plant(ORIGIN)]):
        plant = asking.plant(ORIGIN)
        grow([plant, *others])
        seen += [module.parameters[0] for module in plant.modules if module.name == '?E light']
    assert seen[1] < seen[0] - 0.05


def test_stress_becomes_even_where_wood_is_laid_on_by_it():
    """Make diameters go with the cube root of the moment: Metzger's rule within 10 %."""
    text = """
axiom: Density(900) Modulus(9e9) Strength(50e6) T(0)
derivation length: 24
production:
  T(n) : n < 8 -> !(0.01) F(0.5) ?E(load; 0, 0)
    [ &(60) /(137 * n) !(0.01) F(0.7) ?E(load; 0, 0) Leaf(0.5) ] T(n + 1)
  !(w) > F(l) ?E(load; u, m) -> !(max(0.01, w * pow(4 * u, 1/3)))
"""
    tree = LSystem.parse(text).build()
    bending = _moments(tree, 20.0)
    stress = bending / section_modulus(tree.bond_extent[:, 0])
    thick = tree.bond_extent[:, 0] > 0.0101
    assert np.count_nonzero(thick) >= 8
    assert stress[thick] == pytest.approx(12.5e6, rel=0.3)
    width = tree.bond_extent[thick, 0]
    ratio = width / np.cbrt(bending[thick])
    assert np.ptp(ratio) / ratio.mean() < 0.1


def _moments(tree, storm: float) -> np.ndarray:
    """Return the largest bending moments of joints in a storm from six sides [N·m], (S,)."""
    worst = np.zeros(len(tree))
    for turn in np.arange(6) * np.pi / 3.0:
        forest = Forest(tree)
        air = np.tile([storm * np.cos(turn), storm * np.sin(turn), 0.0], (len(forest), 1))
        forest.lean(np.array([0]), air)
        forest.step(1e-3, air)
        axis = rotation.rotate(forest.poses[:, 3:], np.array([0.0, 0.0, 1.0]))
        moment = forest.joint_wrenches[:, 3:]
        across = moment - (moment * axis).sum(axis=1)[:, None] * axis
        worst[forest.parts] = np.maximum(worst[forest.parts], np.linalg.norm(across, axis=1))
    return worst


WALL = """
building wall
  footprint: (-6, 0) (6, 0)
  facades: brickwork
  storey_height: 5
layout running { unit: 0.5 0.25 0.25  joint: 0.01  material: brick }
panel brickwork: running
material brick { tension: 100000  cohesion: 100000 }
"""


def scene(objects: list[str], **parameters) -> Scene:
    """Build a scene of a wall and small trees."""
    kinds = {'wall': {'grammar_text': WALL},
             'tree': {'grammar': 'garden_tree.lsys', 'origin': [0.0, -1.5, 0.0],
                      'defines': ['years=9']}}
    given = {name: {**kinds[name.partition('_')[0]], **parameters.pop(name, {})}
             for name in objects}
    return Scene.from_parameters({'scene': {'objects': objects}, **given, **parameters})


def test_a_tree_beside_a_wall_leans_away_from_it():
    """Grow away from a wall that is listed before the tree, on either side, turned or not."""
    for y, yaw in ((-1.5, 0.0), (1.5, 2.0)):
        placed = scene(['wall', 'tree'], tree={'origin': [0.0, y, 0.0], 'yaw': yaw})
        thing = placed.objects[1]
        own = placed.blueprint.poses[thing.first:thing.first + thing.count]
        assert np.sign(y) * (np.average(own[:, 1]) - y) > 0.1
    alone = scene(['tree', 'wall'], tree={'origin': [0.0, -1.5, 0.0]})
    assert abs(np.average(alone.blueprint.poses[:alone.objects[0].count, 1]) + 1.5) < 0.1
    assert [thing.name for thing in alone.objects] == ['tree', 'wall']


def test_trees_that_die_are_told_and_left_out(caplog):
    """Leave out a tree that never saw light, and keep the others."""
    placed = scene(['tree_a', 'tree_b'], tree_a={'defines': ['dark=2', 'years=3']},
                   tree_b={'origin': [9.0, 0.0, 0.0], 'defines': ['years=3']})
    assert [thing.name for thing in placed.objects] == ['tree_b']
    assert 'tree_a has died where it stands' in caplog.text


@pytest.mark.parametrize('given, told', [
    ({'tree': {'on': 'wall'}}, 'tree.on: plants whose grammar asks'),
    ({'tree': {'count': 4, 'variants': 2}}, 'tree.variants: plants whose grammar asks'),
    ({'shard': {'count': 2}}, 'tree.grammar: plants that ask where they stand cannot be shared')])
def test_what_such_plants_cannot_do_is_refused(given, told):
    """Name the key."""
    with pytest.raises(SceneError, match=told):
        scene(['wall', 'tree'], **given)
