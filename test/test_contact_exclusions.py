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

"""Pieces of trees that overlap when they come off pass through each other until they are apart."""

import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.world import installed_engines, World
from procphys_ros.scene import Scene, Settings
from procphys_ros.simulation import contact_exclusions, Simulation

# Two branches, one inside of the other and both inside of the trunk, that their weight breaks off.
_FORK = 'axiom: Density(600) !(0.1) F(2) BreakForce(1) [ &(100) F(1) ] [ &(105) F(1) ]'
_CUBE = np.full(3, 0.4)


def broken(engine: str) -> Simulation:
    """Detach the branches."""
    scene = Scene(Settings(engine=engine))
    scene.add(LSystem.parse(_FORK).build(), name='fork')
    simulation = Simulation(scene)
    simulation.step(3)
    assert simulation.bonds_broken >= 2
    return simulation


@pytest.mark.parametrize('engine', installed_engines())
def test_pieces_that_overlap_fall_side_by_side(engine):
    """Let overlapping branches fall: nothing turns them, or throws them to the side."""
    simulation = broken(engine)
    assert {(0, 1), (0, 2), (1, 2)} == {tuple(sorted(pair)) for pair in simulation.state.excluded}
    before = simulation.poses.copy()
    simulation.step(20)
    moved = simulation.poses[1:] - before[1:]
    assert (moved[:, 2] < -0.5).all()
    assert np.abs(moved[:, [0, 1, 3, 4, 5]]).max() < 1e-3


def test_pieces_meet_once_they_are_apart():
    """Push one branch out of the other: no pair is left over, and the trunk stops it again."""
    simulation = broken('bullet')
    mass = float(simulation.blueprint.mass[1])
    simulation.apply_impulse(1, (0.0, 5.0 * mass, 0.0))
    simulation.step(20)
    assert not {(0, 1), (1, 2)} & {tuple(sorted(pair)) for pair in simulation.state.excluded}


@pytest.mark.parametrize('engine', installed_engines())
def test_exclusions_survive_snapshots(engine):
    """Go on from a snapshot to the bit while branches pass through each other."""
    simulation = broken(engine)
    data = simulation.save()
    other = Simulation(simulation.scene)
    other.restore(data)
    for run in (simulation, other):
        run.step(15)
    assert len(simulation.state.excluded)
    np.testing.assert_array_equal(simulation.poses, other.poses)
    np.testing.assert_array_equal(simulation.velocities, other.velocities)


def test_a_flexible_branch_leaves_the_crown_it_grew_in():
    """Cut a branch loose inside of its tree: it falls by its weight, and nothing kicks it."""
    scene = Scene()
    scene.add(LSystem.parse('axiom: Density(600) !(0.06) F(3) [ &(110) '
                            + '[ &(70) F(0.5) ] F(0.3) ' * 6 + '] [ &(115) F(2) ]').build())
    simulation = Simulation(scene)
    simulation.step()
    forest = simulation.state.forest
    branch = max(range(1, len(forest)), key=lambda row: len(forest.subtree(row)))
    contact_exclusions.add_branch(simulation.state, branch, simulation.model.trees.sizes)
    rows = forest.subtree(branch)
    forest.release(branch)
    assert len(rows) == 11 and len(simulation.state.excluded)
    simulation.step(2)
    mass = simulation.blueprint.mass[forest.parts[rows]]
    mean = (mass[:, None] * forest.velocities[rows, :3]).sum(axis=0) / mass.sum()
    np.testing.assert_allclose(mean, [0.0, 0.0, -2.0 * 9.81 / 60.0], atol=0.01)


@pytest.mark.parametrize('engine', installed_engines())
def test_worlds_keep_excluded_bodies_from_meeting(engine):
    """Let cubes overlap: they stay while excluded, also when restored, and part afterwards."""
    with World((0.0, 0.0, 0.0), engine=engine) as world:
        cubes = [world.add_body(Shape.BOX, _CUBE, 1.0, np.array([x, 0, 5, 0, 0, 0, 1.0]))
                 for x in (0.0, 0.3)]
        world.exclude_contacts(np.array([cubes]))
        world.step(1.0 / 60.0)
        with World.restore(world.save_state(), engine=engine) as restored:
            for each in (world, restored):
                for _ in range(3):
                    each.step(1.0 / 60.0)
                np.testing.assert_allclose(each.poses(cubes)[:, 0], [0.0, 0.3], atol=1e-6)
        world.exclude_contacts(np.zeros((0, 2), int))
        for _ in range(3):
            world.step(1.0 / 60.0)
        assert np.ptp(world.poses(cubes)[:, 0]) > 0.31


@pytest.mark.parametrize('engine', installed_engines())
def test_exclusions_end_with_their_bodies(engine):
    """Remove an excluded body: another one that takes its id meets what is there."""
    with World((0.0, 0.0, 0.0), engine=engine) as world:
        pose = np.array([0.3, 0, 5, 0, 0, 0, 1.0])
        cubes = [world.add_body(Shape.BOX, _CUBE, 1.0, np.array([x, 0, 5, 0, 0, 0, 1.0]))
                 for x in (0.0, 0.3)]
        world.exclude_contacts(np.array([cubes]))
        world.remove(cubes[1])
        assert world.add_body(Shape.BOX, _CUBE, 1.0, pose) == cubes[1]
        for _ in range(3):
            world.step(1.0 / 60.0)
        assert np.ptp(world.poses(cubes)[:, 0]) > 0.31
