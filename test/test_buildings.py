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

"""Buildings in time: they stand still, arch over gaps, and fall when they have to."""

from pathlib import Path

from building_checks import standing, take_out
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.simulation import masonry
from procphys_ros.wallgrammar import WallGrammar

WALLS = sorted((Path(__file__).parents[1] / 'grammars').glob('*.wall'))


@pytest.mark.parametrize('path', WALLS, ids=lambda path: path.stem)
def test_shipped_building_stands_within_its_strength(path):
    """
    Carry all parts to the ground, load every bond below its limit; only dry joints open.

    Every pose stays to the last bit: the small ones for 20 s, the large ones for 2.
    """
    plan = WallGrammar.load(path).build(seed=0)
    simulation = standing(plan)
    simulation.set_wind_enabled(False)
    solver, graph = simulation.state.solver, simulation.state.solver.graph
    dry = (plan.mortar.tension == 0.0) & (plan.mortar.cohesion == 0.0)
    assert dry[graph.rows[graph.cracked]].all() and graph.alive.all()
    assert masonry.is_stable(simulation.state)
    assert solver.supported.all()
    assert 0.0 < solver.utilisation()[0].max() < 1.0
    spent = solver.spent
    simulation.step(1200 if len(plan) < 1000 else 120)
    assert solver.spent == spent  # standing costs nothing
    assert np.array_equal(simulation.poses, plan.poses)
    assert not simulation.velocities.any() and simulation.bonds_broken == 0
    feet = graph.grounded()
    pull = np.einsum('kij,kj->ki', graph.axes[feet], solver.wrenches()[feet, :3])
    sign = np.where(graph.first[feet] == graph.count, -1.0, 1.0)
    held = (sign[:, None] * pull).sum(axis=0)
    accuracy = 4e-3 if dry.any() else 2e-3  # joints that open are iterated on
    assert held[2] == pytest.approx(plan.mass.sum() * 9.81, rel=accuracy)


def test_wall_arches_over_a_hole():
    """Take bricks out of the middle of a wall: at most a few more fall, the rest stands."""
    blueprint = wall(12, 16)
    simulation = standing(blueprint)
    x, z = blueprint.poses[:, 0], blueprint.poses[:, 2]
    hole = np.flatnonzero((np.abs(x - 1.35) < 0.4) & (z > 0.25) & (z < 0.6))
    take_out(simulation, hole)
    simulation.step(240)
    assert simulation.state.standing.sum() >= len(blueprint) - len(hole) - 6


def test_wall_falls_when_its_foot_is_gone():
    """Take the lowest courses out: everything above falls, and comes to rest."""
    blueprint = wall(12, 16)
    simulation = standing(blueprint)
    foot = np.flatnonzero(blueprint.poses[:, 2] < 0.15)
    take_out(simulation, foot)
    simulation.step(600)
    assert not simulation.state.standing.any()
    assert simulation.awake_bodies == 0
    rest = np.setdiff1d(np.arange(len(blueprint)), foot)
    assert simulation.poses[rest, 2].min() > 0.0


def test_wall_without_a_flank_leans_no_further_than_it_can():
    """Take a third of the foot of a weak wall out: what overhangs too far comes down."""
    blueprint = wall(12, 16, tension=1e3, cohesion=1e3)
    simulation = standing(blueprint)
    part = np.flatnonzero((blueprint.poses[:, 2] < 0.15) & (blueprint.poses[:, 0] > 1.7))
    take_out(simulation, part)
    simulation.step(180)  # the last of it has come off before
    left = simulation.state.standing
    assert 0 < left.sum() < len(blueprint) - len(part) - 10
    assert blueprint.poses[left, 0].max() < 2.6


def test_all_broken_bonds_are_told_and_reset_makes_whole():
    """Compare events with dead bonds after a collapse; a reset gives the same collapse again."""
    blueprint = wall(8, 12)
    simulation = standing(blueprint)
    outcome = []
    for _ in range(2):
        take_out(simulation, np.flatnonzero(blueprint.poses[:, 2] < 0.15))
        simulation.step(120)
        events = simulation.events
        assert len(np.unique(events['bond'])) == len(events) == simulation.bonds_broken
        outcome.append((simulation.poses.copy(), events.copy()))
        simulation.reset()
        assert np.array_equal(simulation.poses, blueprint.poses)
    np.testing.assert_array_equal(outcome[0][0], outcome[1][0])
    np.testing.assert_array_equal(outcome[0][1], outcome[1][1])
