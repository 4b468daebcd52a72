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


"""What a part carries, against closed forms."""

from dataclasses import replace

from grown_trees import beam
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.culling import CullingSettings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Owner, Simulation
from procphys_ros.simulation.readings import describe_load, load_of

GRAVITY = 9.81
STRENGTH = 40e6  # [Pa]


@pytest.fixture(scope='module')
def simulation():
    """Stand a beam and a pier of bricks up, and let a ball lie beside them."""
    scene = Scene()
    scene.add(beam(strength=STRENGTH), name='beam')
    scene.add(wall(2, 9), (9.0, 0.0, 0.0), name='pier')
    made = Simulation(scene)
    made.launch(Projectile(size=0.4, position=(-20.0, 0.0, 0.2), velocity=(0.0, 0.0, 0.0)))
    made.step(30)
    return made


def test_a_trunk_carries_all_that_stands_on_it(simulation):
    """Find the whole weight at the foot, a tenth of it at the top, and no bending."""
    parts = np.arange(10)
    weights = GRAVITY * simulation.blueprint.mass[parts]
    for part in (0, 4, 9):
        load = load_of(simulation.state, part)
        np.testing.assert_allclose(load.force, weights[part:].sum(), rtol=1e-3)
        assert load.share < 1e-3


def test_a_bent_trunk_is_loaded_by_the_stress_in_its_fibres(simulation):
    """Push a cantilever aside at its tip: the moment at the foot is force times height."""
    pushed = simulation.fork()
    pushed.apply_wrench(9, (30.0, 0.0, 0.0))
    pushed.step(900)
    foot = load_of(pushed.state, 0)
    arm = pushed.poses[9, 2]
    sag = pushed.poses[:10, 0] @ (GRAVITY * pushed.blueprint.mass[:10])
    np.testing.assert_allclose(foot.moment, 30.0 * arm + sag, rtol=0.03)
    width = pushed.blueprint.bond_extent[0, 0]
    np.testing.assert_allclose(foot.share, foot.moment / (np.pi / 32.0 * width ** 3) / STRENGTH,
                               rtol=1e-3)


def test_a_trunk_may_be_nearest_to_being_uprooted():
    """Push a tree whose root plate gives way long before its wood: the share is that of it."""
    grown = beam(strength=STRENGTH)
    moment = 0.2 * STRENGTH * np.pi / 32.0 * grown.bond_extent[0, 0] ** 3
    root = np.where(grown.bonds[:, 0] == GROUND, moment, np.inf)
    scene = Scene()
    scene.add(replace(grown, hinges=replace(grown.hinges, root_moment=root)), name='tree')
    simulation = Simulation(scene)
    simulation.apply_wrench(9, (30.0, 0.0, 0.0))
    simulation.step(300)
    foot = load_of(simulation.state, 0)
    np.testing.assert_allclose(foot.share, foot.moment / moment, rtol=1e-3)
    assert load_of(simulation.state, 1).share < 0.3 * foot.share


def test_a_tree_that_joins_has_no_load_before_its_first_step(simulation):
    """Say nothing of a new tree, not that it carries nothing, while others go on."""
    grown = simulation.fork()
    late = grown.add(beam(), (30.0, 0.0, 0.0), name='late')
    assert np.isnan(grown.loads()[late.first:]).all()
    assert np.isfinite(grown.loads()[:late.first]).all()
    grown.step()
    weight = GRAVITY * grown.blueprint.mass[late.first:].sum()
    np.testing.assert_allclose(grown.load(late.first).force, weight, rtol=1e-9)


def test_a_branch_that_came_off_has_no_load_at_its_base():
    """Break the foot of a beam, which goes on as a flexible branch: nothing holds it there."""
    grown = beam()
    strength = np.where(grown.bonds[:, 0] == GROUND, 0.1 * STRENGTH, np.inf)
    scene = Scene()
    scene.add(replace(grown, hinges=replace(grown.hinges, strength=strength)), name='beam')
    broken = Simulation(scene)
    broken.apply_impulse(9, (400.0, 0.0, 0.0))
    while not broken.bonds_broken:
        broken.step()
    assert broken.state.parts.owner[0] == Owner.TREE
    assert broken.load(0).force == broken.load(0).share == 0.0 < broken.load(1).force


def test_a_sleeping_tree_carries_its_weight():
    """Let a beam fall asleep: it is stepped no more, and stands on its foot as before."""
    scene = Scene(Settings(culling=CullingSettings(sleeping=True)))
    scene.add(beam(strength=STRENGTH), name='beam')
    resting = Simulation(scene)
    resting.set_wind_enabled(False)
    resting.step(200)
    assert resting.state.trees.lod.asleep.all()
    np.testing.assert_allclose(resting.load(0).force, GRAVITY * resting.blueprint.mass.sum(),
                               rtol=1e-6)


def test_the_bricks_at_the_foot_carry_the_pier(simulation):
    """Find the weight above in the bonds of the bottom course, shared by its two bricks."""
    pier = simulation.objects[1]
    parts = np.arange(pier.first, pier.first + pier.count)
    weight = GRAVITY * simulation.blueprint.mass[parts].sum()
    foot = parts[np.argsort(simulation.blueprint.poses[parts, 2])[:2]]
    loads = [load_of(simulation.state, int(part)) for part in foot]
    np.testing.assert_allclose(sum(load.force for load in loads), weight, rtol=0.02)
    assert all(0.0 < load.share < 0.1 for load in loads)


def test_loads_are_said_in_one_line(simulation):
    """Say what carries what, and what lies loose."""
    assert describe_load(simulation.state, 0).startswith('beam/segment_0 carries ')
    ball = len(simulation.poses) - 1
    assert 'is loose' in describe_load(simulation.state, ball)
    assert load_of(simulation.state, ball).force == 0.0
