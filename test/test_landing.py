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

"""Masonry that lands in one piece breaks where it does, and is stopped by what its joints bear."""

from masonry_walls import bonded, BRICK, JOINT
import numpy as np
import pytest

from procphys_ros.physics.impact import TEETH
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.world import BodyState, installed_engines
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import impacts, Simulation
from procphys_ros.simulation.blows import change_by_contacts, measure

_UNBREAKABLE = {'tension': 1e12, 'cohesion': 1e12, 'compression': 1e12}  # [Pa]
_WEIGHTY = 0.05  # of all energy: what has less is not looked at


def lump(along, courses, **kwargs):
    """Bond bricks in courses of equal length around x = 0, the lowest on the ground."""
    length, tall = BRICK[0] + JOINT, BRICK[2] + JOINT
    centres = [[length * (i - 0.5 * along + 0.5 * (k % 2)), 0.0, tall * (k + 0.5) - 0.5 * JOINT]
               for k in range(courses) for i in range(along)]
    return bonded(centres, BRICK, **kwargs)


def falling(counts, height, tension=0.2e6, engine='auto', stone=True):
    """
    Drop walls.

    :param counts: bricks along and courses of each wall.
    :param height: to fall [m].
    :param stone: whether each has a stone under its middle, or level ground.
    """
    scene = Scene(Settings(engine=engine))
    length, tall = BRICK[0] + JOINT, BRICK[2] + JOINT
    for n, (along, courses) in enumerate(counts):
        centres = [[length * (i - 0.5 * along + 0.5 * (k % 2)), 0.0, tall * k + 0.5 * BRICK[2]]
                   for k in range(courses) for i in range(along)]
        wall = bonded(centres, BRICK, ground=False, tension=tension, cohesion=2.0 * tension)
        if stone:
            scene.add(bonded([[0.0, 0.0, 0.2]], 0.4, tension=1e6), (0.0, 4.0 * n, 0.0), 0.0,
                      f'stone_{n}')
        scene.add(wall, (0.0, 4.0 * n, 0.4 * stone + height), 0.0, f'wall_{n}')
    return Simulation(scene)


@pytest.mark.parametrize('engine', installed_engines())
def test_equal_walls_are_stopped_alike_however_much_breaks_at_once(monkeypatch, engine):
    """
    Drop two walls of 48 bricks on stones, with time to take apart one of them in a step.

    What waits for its turn has been stopped as if no joint could break.
    """
    monkeypatch.setattr(impacts, '_WORK', 0)
    simulation = falling([(8, 6)] * 2, 1.0, engine=engine)
    walls = [np.arange(49 * n + 1, 49 * n + 49) for n in range(2)]
    while not simulation.bonds_broken:
        simulation.step()
    speed = [simulation.state.parts.velocities[wall, 2].mean() for wall in walls]
    assert simulation.time < 0.6 and speed[0] < -2.0
    assert speed[1] == pytest.approx(speed[0], rel=0.05)
    assert all(len(blow.parts) < 8 for blow in simulation.state.rubble.waiting)


def lagging(simulation, steps):
    """Return the share of bodies on their way, not hit in a step, that moved less than half."""
    moving = late = 0
    for _ in range(steps):
        bodies = simulation.state.world.bodies
        place, before = bodies.poses[:, :3].copy(), bodies.velocities[:, :3].copy()
        awake = bodies.state == BodyState.AWAKE
        simulation.step()
        now, after = bodies.poses[:len(place), :3], bodies.velocities[:len(place), :3]
        mean = 0.5 * (before + after)
        square = (mean * mean).sum(axis=1)
        jump = ((after - before) ** 2).sum(axis=1)
        own = (awake & (bodies.state[:len(place)] == BodyState.AWAKE) & (square > 0.25)
               & (jump < 0.25 * square))
        moving += own.sum()
        way = ((now - place) * mean).sum(axis=1)
        late += (own & (way < 0.5 * square * simulation.time_step)).sum()
    assert moving > 500
    return late / moving


@pytest.mark.parametrize('counts, height', [
    ([(8, 6)] * 2, 1.0), ([(16, 10)], 4.0)])
def test_what_breaks_moves_as_its_velocity_says(counts, height):
    """Drop walls on stones: pieces go on the way that their velocities tell, while they break."""
    assert lagging(falling(counts, height, engine='native'), 70) < 0.03  # 0.002 to 0.017


def test_small_pieces_wait(monkeypatch):
    """Take three walls of eight bricks apart: one at once, one after the step, then the last."""
    monkeypatch.setattr(impacts, '_WORK', 0)
    simulation = falling([(4, 2)] * 3, 1.0)
    while not simulation.bonds_broken:
        simulation.step()
    assert len(simulation.state.rubble.waiting) == 1


def test_a_wall_that_lands_flat_and_slowly_stays_whole():
    """Drop a wall by 2 cm on level ground, and one by a metre on a stone."""
    for height, stone in ((0.02, False), (1.0, True)):
        simulation = falling([(8, 6)], height, 0.4e6, stone=stone)
        simulation.step(60)
        assert (simulation.bonds_broken > 0) == stone


def landing(monkeypatch, engine, below, seed):
    """
    Let lumps of random size fall from a random height, and list what is told of their blows.

    :param below: what the lowest falls on; of 'lumps' two or three fall, one on top of the other.
    :returns: for each step with a blow the energy of the change of motion of each body that moves
        and what is told of the blow on it, (K,) each, what the contacts tell, and what the motion
        lost [J].
    """
    rng, scene = np.random.default_rng(seed), Scene(Settings(engine=engine))
    level = 0.0
    if below == 'wall':
        level = 6 * (BRICK[2] + JOINT)
        scene.add(lump(12, 6, **_UNBREAKABLE), (0.0, 0.0, 0.0), 0.0, 'wall')
    level += rng.uniform(0.1, 2.0)
    for n in range(rng.integers(2, 4) if below == 'lumps' else 1):
        along, courses = rng.integers(2, 12, 2)
        scene.add(lump(along, courses, ground=False, **_UNBREAKABLE), (0.0, 0.0, level),
                  rng.uniform(-0.5, 0.5), f'lump_{n}')
        level += courses * (BRICK[2] + JOINT) + rng.choice([2e-3, 0.1])
    simulation, found = Simulation(scene), []
    measure, state = impacts.measure, simulation.state

    def watched(contacts, change, start, loose, fall, duration, uneven):
        made = measure(contacts, change, start, loose, fall, duration, uneven)
        touching = np.union1d(contacts.body_a, contacts.body_b)
        awake, bodies = np.intersect1d(state.world.awake, touching), state.world.bodies
        if uneven != TEETH or (np.abs(change[awake, :3]).max(axis=1) < 0.5).all():
            return made
        own, before, after = (motion_energy(
            bodies.mass[awake], bodies.inertia[awake], start[awake, 3:], velocities)
            for velocities in (change[awake], bodies.velocities[awake] - change[awake],
                               bodies.velocities[awake]))
        found.append((own, np.array(impacts._felt(made, start, awake)[1]), made.energy.sum(),
                      (before - after).sum()))
        return made
    with monkeypatch.context() as patch:
        patch.setattr(impacts, 'measure', watched)
        simulation.step(70)
    return found


@pytest.mark.parametrize('engine', installed_engines())
@pytest.mark.parametrize('below', ['ground', 'wall', 'lumps'])
def test_blows_of_a_landing_have_the_energy_of_what_they_stop(monkeypatch, engine, below):
    """
    Tell of each lump no less than its own motion had, and of none more than all had together.

    What lands together with what lies below it hardly moves against that, but is stopped alike.
    """
    for seed in range(2):
        found = landing(monkeypatch, engine, below, seed)
        assert found
        for own, told, contacts, _ in found:
            assert contacts == pytest.approx(own.sum(), rel=0.1)
            heavy = own > _WEIGHTY * own.sum()
            assert (told[heavy] > 0.9 * own[heavy]).all()
            assert told.max() < 1.25 * own.sum()
        if below == 'ground':
            assert sum(row[2] for row in found) == pytest.approx(sum(row[3] for row in found),
                                                                 rel=0.1)


@pytest.mark.parametrize('engine', installed_engines())
def test_contacts_have_the_energy_of_the_change_of_motion_on_edges(engine):
    """Throw blocks at the ground that turn: what contacts tell is all that they changed."""
    for seed in range(2):
        spin = np.random.default_rng(seed).normal(size=3)
        simulation = Simulation(Scene(Settings(engine=engine)))
        block = simulation.launch(Projectile('box', 0.3, 50.0, (0.0, 0.0, 1.0), (3.0, 0.0, -6.0)))
        simulation.set_body_state(block, twist=[3.0, 0.0, -6.0, *(4.0 * spin)])
        state = simulation.state
        told, own = 0.0, 0.0
        for _ in range(40):
            simulation.step()
            awake, bodies = state.world.awake, state.world.bodies
            if not len(awake):
                break
            change = change_by_contacts(state.world, state.rubble.poses, state.rubble.velocities,
                                        simulation.time_step)
            told += measure(state.world.contacts(), change, state.rubble.poses,
                            np.where(bodies.state == BodyState.AWAKE, bodies.mass, 0.0),
                            simulation.model.gravity * simulation.time_step,
                            simulation.time_step, TEETH).energy.sum()
            own += motion_energy(bodies.mass[awake], bodies.inertia[awake],
                                 state.rubble.poses[awake, 3:], change[awake]).sum()
        assert told == pytest.approx(own, rel=0.01)
