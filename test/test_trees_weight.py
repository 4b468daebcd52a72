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

"""Trees that cannot carry their weight are told of; polygons weigh, segments taper."""

import numpy as np
import pytest
from random_grammars import draw

from procphys_ros.blueprint.skeleton import LEAF_AREAL_DENSITY
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees import Forest
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_BRACKET = 'axiom: Strength({}) !(0.1) F(2) &(90) F(1) F(1) F(1) F(1)'
_STRESS = 0.25 * np.pi * 0.01 * 900 * 9.81 * 4.0 * 2.0 / (np.pi / 32.0 * 0.001)  # [Pa] at its root


def simulation(text, *more):
    """Make a simulation of a tree, and of others beside it."""
    scene = Scene()
    for i, tree in enumerate((text, *more)):
        scene.add(LSystem.parse(tree).build(), (20.0 * i, 0.0, 0.0), 0.0, f'tree_{i}')
    return Simulation(scene)


def mass(text):
    """Return the masses of the segments of a tree [kg]."""
    return LSystem.parse(f'axiom: {text}').build().mass


@pytest.mark.parametrize('share', [0.99, 1.01, 58.0])
def test_a_tree_that_cannot_carry_itself_is_told_of(share):
    """Warn from m·g·L/2 = σ·Z on, and say by how much; what is told of breaks at once."""
    sim = simulation(_BRACKET.format(_STRESS / share), 'axiom: Strength(60e6) F(2)')
    if share < 1.0:
        assert not sim.warnings
    else:
        line, = sim.warnings
        assert line.startswith('tree_0 does not carry its own weight: ') and 'Strength' in line
        # The bend of the stem is as long a lever as the first joint of the arm.
        assert float(line.split(' m by ')[1].split()[0]) == pytest.approx(share, rel=5e-3)
    sim.step()
    assert (len(sim.events) > 0) == (share > 1.0)


def test_trees_that_join_are_told_of():
    """Warn of what is added to a running scene, and of that alone."""
    sim = simulation(_BRACKET.format(0.5 * _STRESS))
    before = sim.warnings
    pole = LSystem.parse('axiom: BreakForce(10) !(0.1) F(1)').build()
    sim.add(pole, (0.0, 9.0, 0.0), 0.0, 'new')
    assert sim.warnings[:len(before)] == before and len(sim.warnings) == len(before) + 1
    assert 'new does not carry its own weight: 1 of 1 joints are overloaded' in sim.warnings[-1]
    assert sim.warnings[-1].endswith('times its BreakForce')


@pytest.mark.parametrize('seed', range(12))
def test_weight_overloads_what_breaks_in_the_first_step(seed):
    """Compare with the joints that a forest at rest finds overloaded, for trees of all sorts."""
    for sample in draw(seed, 3, 0)[0]:
        forest = Forest(LSystem.parse(sample.text).build(seed=sample.seed))
        if forest.has_sagged:
            continue
        rows, causes, ratio = forest.overloaded_by_weight()
        forest.step(1.0 / 60.0)
        found, found_causes, _, _ = forest.overloaded()
        sure = ratio > 1.0 + 1e-6
        assert set(rows[sure]) <= set(found) and len(found) <= len(rows) + np.sum(~sure)
        told = dict(zip(rows.tolist(), causes.tolist()))
        assert all(told.get(row, cause) == cause for row, cause in
                   zip(found.tolist(), found_causes.tolist()))


def test_trees_that_hold_are_not_told_of():
    """Stay silent about trees without weight or strength, and where the roots hold."""
    scene = simulation('axiom: !(0.1) F(9)', 'axiom: RootMoment(1e5) !(0.1) F(2) &(30) F(3)')
    assert not scene.warnings
    line, = simulation('axiom: RootMoment(1) !(0.1) F(2) &(30) F(3)').warnings
    assert line.endswith('times its RootMoment')
    blueprint = LSystem.parse(_BRACKET.format(1.0)).build()
    assert len(Forest(blueprint, gravity=(0.0, 0.0, 0.0)).overloaded_by_weight()[0]) == 0
    rows, causes, _ = Forest(blueprint).overloaded_by_weight()
    assert len(rows) == 5 and set(causes.tolist()) == {Cause.BENDING}


@pytest.mark.parametrize(('polygon', 'area'), [
    ('{ . f(1) +(90) . f(1) +(90) . f(1) +(90) . }', 1.0),
    ('{ . f(2) +(90) f(0.5) +(90) f(2) }', 1.0), ('[ +(90) { . f(1) +(90) f(1) } ]', 0.5),
    ('{ f(1) }', 0.0), ('{ . f(1) +(120) . f(1) . } ~(0.5)', 0.25 + 0.75 ** 0.5 / 2)])
def test_polygons_weigh_and_catch_wind_as_leaves_do(polygon, area):
    """Add the area of what is drawn to that of the leaves of the segment."""
    bare, tree = (LSystem.parse(f'axiom: !(0.03) F(1) F(1) {more}').build()
                  for more in ('', polygon))
    assert tree.leaf_area == pytest.approx([0.0, area])
    assert tree.mass - bare.mass == pytest.approx([0.0, LEAF_AREAL_DENSITY * area])
    leaf = LSystem.parse(f'axiom: !(0.03) F(1) F(1) ~({max(area, 1e-6) ** 0.5})').build()
    leant = [Forest(blueprint) for blueprint in (tree, leaf)]
    for forest in leant:
        forest.lean(np.arange(1), np.tile([10.0, 0.0, 0.0], (2, 1)))
    assert leant[0].poses == pytest.approx(leant[1].poses, abs=1e-6)


def test_segments_end_as_wide_as_the_next_one_begins():
    """Taper to what goes on; keep the width before a branch, and where nothing follows."""
    cylinder = 900 * np.pi * 0.25 * 0.01
    assert mass('!(0.1) F(1) !(0.1) F(1)')[0] == pytest.approx(cylinder)
    total = mass('!(0.1) F(1) !(0.05) F(1)').sum()
    assert total == pytest.approx(cylinder * (1.75 / 3.0 + 0.25))
    assert mass('!(0.1) F(1) [ !(0.05) F(1) ]') == pytest.approx([cylinder, 0.25 * cylinder])
    stalk = 'F(0.1) [ !(0.1) F(0.1) ]'
    assert mass(f'!(0.01) {stalk}') == pytest.approx([0.001 * cylinder, 0.1 * cylinder])
    assert mass('!(0.1) WidthRate(0.5) F(1)') == pytest.approx([cylinder * 1.75 / 3.0])


@pytest.mark.parametrize('branch', [False, True])
def test_a_column_buckles_at_greenhills_height(branch):
    """Stand below 7.837·E·I/(w·h³) = 1, be told of above; a branch weighs where it sits."""
    height = (7.8373 * 1e10 * 0.05**2 / 16.0 / 800.0 / 9.81) ** (1.0 / 3.0)
    pole = 'axiom: Density(800) Modulus(1e10) !(0.05) ' + 'F({0})' * 20
    pole += ' [ &(90) !(0.02) F(0.5) ]' * branch
    low, high = (simulation(pole.format(part * height / 20.0))
                 for part in (0.93 if branch else 0.99, 1.01))
    assert not low.warnings
    line, = high.warnings
    assert line.startswith('tree_0 is too slender to stand upright: it buckles under 0.9')
    share = high.state.forest.buckling()[1][0]
    lightest = 0.92 if branch else 0.998
    assert lightest < share * 1.01**3 < (0.99 if branch else 1.001)


def test_what_is_told_to_buckle_topples():
    """Let a touch decide: a column above Greenhill's height falls, one below swings back."""
    for part, falls in ((0.9, False), (1.15, True)):
        height = part * (7.8373 * 1e10 * 0.05**2 / 16.0 / 800.0 / 9.81) ** (1.0 / 3.0)
        sim = simulation('axiom: Density(800) Modulus(1e10) DampingRatio(0.3) !(0.05) '
                         + f'F({height / 12.0})' * 12)
        sim.apply_impulse(11, (0.02, 0.0, 0.0))
        sim.step(1500)
        assert (abs(sim.poses[11, 0]) > 0.5) == falls
