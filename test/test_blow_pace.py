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

"""What blows crack and bring down, however many iterations the stress solver has per step."""

from masonry_walls import braced, wall
import numpy as np
import pytest

from procphys_ros.geometry import rotation
from procphys_ros.physics.masonry import BondGraph, Fracture, StressSolver
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import masonry, Simulation

PACES = (0.4, 10.0)  # times as many iterations per step


def stand(built):
    """Make a simulation of a wall."""
    scene = Scene(Settings())
    scene.add(built)
    return Simulation(scene)


def at_pace(monkeypatch, pace):
    """Multiply the iterations of the stress solver."""
    for name in ('_PACE', '_WORK'):
        monkeypatch.setattr(masonry, name, type(getattr(masonry, name))(
            pace * getattr(masonry, name)))


def fallen(simulation, count):
    """Count the first parts that do not stand."""
    return int(np.count_nonzero(~simulation.state.standing[:count]))


@pytest.mark.parametrize(('length', 'strength', 'upwards', 'least', 'most'), [
    (16, 0.4e6, 0.2, 0.5, 0.6),   # goes through, and rubs the lower edge of its hole over
    (20, 0.9e6, 1.4, 0.02, 0.1),  # goes through; the wall arches over the hole
])
def test_what_a_ball_brings_down_does_not_depend_on_the_pace(monkeypatch, length, strength,
                                                             upwards, least, most):
    """Throw 2 t through a braced wall, with few and many iterations per step."""
    built, share = braced(length, 30, strength), []
    for pace in PACES:
        with monkeypatch.context() as patch:
            at_pace(patch, pace)
            simulation = stand(built)
            middle = 0.5 * length * 0.225
            simulation.launch(Projectile('sphere', 0.8, 2000.0, (middle, -0.75, 1.2),
                                         (0.0, 6.0, upwards)))
            simulation.step(90)
            assert simulation.state.solver.converged
            share.append(fallen(simulation, len(built)) / len(built))
            simulation.close()
    assert least < min(share) and max(share) < most
    assert max(share) - min(share) < 0.01


@pytest.mark.parametrize('rate', [30, 120])
def test_what_a_ball_brings_down_does_not_depend_on_the_time_step(rate):
    """Throw 2 t through a wall: it loses what the ball drives out, a twentieth of it."""
    built = braced(20, 30, 0.6e6)
    scene = Scene(Settings(time_step=1.0 / rate))
    scene.add(built)
    simulation = Simulation(scene)
    simulation.launch(Projectile('sphere', 0.8, 2000.0, (2.25, -0.75, 1.2), (0.0, 6.0, 1.2)))
    simulation.step(round(1.2 * rate))
    assert 0.04 < fallen(simulation, len(built)) / len(built) < 0.055


def test_a_ball_cracks_the_wall_around_its_hole():
    """Throw 2 t through a braced wall: bed and head joints crack between bricks that stand."""
    # It flies up by as much as it falls on the way, so it does not land in its own hole.
    built = braced(20, 30, 0.6e6)
    simulation = stand(built)
    simulation.launch(Projectile('sphere', 0.8, 2000.0, (2.25, -0.75, 1.2), (0.0, 6.0, 1.2)))
    simulation.step(30)
    standing = simulation.state.standing[:len(built)]
    assert 20 < np.count_nonzero(~standing) < 0.2 * len(built)
    bonds = np.unique(simulation.events['bond'])
    pairs = built.bonds[bonds]
    around = bonds[(pairs >= 0).all(axis=1) & standing[pairs].all(axis=1)]
    assert len(around) >= 12
    distance = np.linalg.norm(built.bond_frame[around, :3] - [2.25, 0.05, 1.2], axis=1)
    assert distance.min() < 0.8 and distance.max() > 1.0  # from the hole outwards
    upright = np.abs(rotation.to_matrix(built.bond_frame[around, 3:])[:, 2, 2])
    assert np.any(upright > 0.9) and np.any(upright < 0.1)
    simulation.step(120)
    assert np.array_equal(simulation.state.standing[:len(built)], standing)


@pytest.mark.parametrize('pace', PACES)
def test_a_blast_that_throws_a_wall_over_does_so_from_nearby(monkeypatch, pace):
    """Throw a free wall over from 8 m and from 4 m; from 40 m it stands."""
    at_pace(monkeypatch, pace)
    for distance, falls in ((40.0, False), (8.0, True), (4.0, True)):
        simulation = stand(wall(24, 32))
        count = len(simulation.blueprint)
        simulation.explode((2.7, -distance, 1.2), 3.0)
        simulation.step(30)
        share = fallen(simulation, count) / count
        assert share > 0.95 if falls else share == 0.0, (distance, share)
        simulation.close()


def test_a_blow_onto_the_ground_throws_nothing_over():
    """Let a ball land in its hole: what it throws over gets its push, but not its weight."""
    built = braced(16, 30, 0.4e6)
    simulation = stand(built)
    simulation.launch(Projectile('sphere', 0.8, 2000.0, (1.8, -0.75, 1.2), (0.0, 6.0, 0.0)))
    while fallen(simulation, len(built)) < 0.4 * len(built):
        stood = simulation.state.standing[:len(built)].copy()
        given = simulation.ledger.carried.copy()
        simulation.step()
        assert simulation.time < 1.0
    onto = [impact for impact in simulation.impacts if not impact.torn]
    assert min(impact.lost[2] for impact in onto) < -2000.0  # [N·s] down
    carried = simulation.ledger.carried - given
    assert carried[1] > 500.0 and abs(carried[2]) < 0.1 * carried[1]
    assert np.count_nonzero(stood) > 0.9 * len(built) - 50


def test_what_joins_during_a_blow_does_not_hold_a_wall_up():
    """Let a ball land in its hole, and a brick join far away while what is thrown over hangs."""
    built = braced(16, 30, 0.4e6)
    simulation = stand(built)
    simulation.launch(Projectile('sphere', 0.8, 2000.0, (1.8, -0.75, 1.2), (0.0, 6.0, 0.0)))
    joined = None
    while not (joined and fallen(simulation, len(built)) > 0.4 * len(built)):
        if len(simulation.state.fracture._hanging):  # the last of these moments decides
            joined = simulation.fork()
        simulation.step()
        assert simulation.time < 1.0
    joined.add(wall(1, 1), (50.0, 0.0, 0.0))
    joined.step(2)
    assert fallen(joined, len(built)) > 0.4 * len(built)


def test_a_round_under_a_blow_is_the_same_however_often_it_is_interrupted():
    """Crack the same bonds with 7, 40 and 2,000 iterations at a time."""
    built, found = braced(16, 30, 0.4e6), []
    push = np.zeros((len(built), 3))
    push[150:156, 1] = 1000.0
    for share in (7, 40, 2000):
        fracture = Fracture(StressSolver(BondGraph(built)), 2.0)
        fracture.advance(20_000)
        fracture.solver.set_loads(push)
        rounds = []
        for _ in range(4000 // share + 3):  # a round a call at most
            failed, over = fracture.withstand(share, 1000.0, np.concatenate)
            rounds += [set(failures.bond.tolist()) for failures in failed]
            if over or len(rounds) == 3:
                break
        found.append(rounds)
    assert len(found[0]) == 3 and found[0] == found[1] == found[2]
