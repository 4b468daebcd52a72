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

"""Kernels on several threads: the same results to the bit, for trees, wind, leaves and scenes."""

from functools import partial
from itertools import cycle
import os
import signal
from threading import Event, get_ident, Timer
from time import sleep

import numpy as np
import pytest

from procphys_ros.compilation import threads
from procphys_ros.messages import SceneMarkers
from procphys_ros.physics.wind import Wind, WindSettings
from procphys_ros.physics.world import installed_engines
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Demolition, Projectile
from procphys_ros.simulation import masonry, Simulation

COUNTS = (1, 2, 5)


@pytest.fixture(autouse=True)
def small_ranges(monkeypatch):
    """Make few rows enough for several ranges."""
    monkeypatch.setattr(threads, '_WORTH', 16)


def stand(count: int, **more) -> Simulation:
    """Make seven shrubs and a birch whose leaves flutter in a gusty wind that breaks twigs."""
    return Simulation(Scene.from_parameters({
        'scene': {'objects': ['shrub', 'birch']}, 'threads': count,
        'shrub': {'grammar': 'shrub.lsys', 'count': 7, 'spacing': 3.0},
        'birch': {'grammar': 'birch.lsys', 'origin': [9.0, 9.0, 0.0]},
        'wind': {'velocity': [38.0, 0.0, 0.0], 'turbulence_intensity': 0.3}, **more}))


def course(simulation: Simulation) -> list[np.ndarray]:
    """Run it with a gust and a push, and give all that can be seen of it."""
    simulation.gust()
    simulation.step(15)
    simulation.apply_impulse('birch/5', (0.0, 400.0, 0.0))
    simulation.step(15)
    return [simulation.poses, simulation.velocities, simulation.leaf_poses(),
            np.array([simulation.bonds_broken])]


@pytest.mark.parametrize('more', [{}, {'culling': {'sleeping': True}}], ids=['all', 'culled'])
def test_scenes_run_alike_on_any_number_of_threads(more):
    """Compare poses, velocities, leaves and breaks to the bit."""
    alone, *others = (course(stand(count, **more)) for count in COUNTS)
    assert np.ptp(alone[0][:, 0]) > 1.0 and alone[3] > 0
    for other in others:
        for one, same in zip(alone, other):
            np.testing.assert_array_equal(one, same)


@pytest.mark.parametrize('count, engine', list(zip(COUNTS[1:], cycle(installed_engines()))))
def test_walls_come_down_alike_on_any_number_of_threads(count, engine):
    """Charge a house and strike it: the same poses, breaks, stresses and dust to the bit."""
    looks = []
    for number in (1, count):
        simulation = Simulation(Scene.from_parameters({
            'scene': {'objects': ['house']}, 'threads': number, 'engine': engine,
            'house': {'grammar': 'office.wall',
                      'defines': ['bays=1', 'deep=1', 'storeys=1', 'module=2.8']}}))
        simulation.demolish(Demolition())
        simulation.launch(Projectile('box', 0.5, 300.0, (-6.0, 1.0, 1.2), (20.0, 0.0, 0.0)))
        simulation.step(35)
        looks.append([simulation.poses, simulation.velocities, simulation.log.rows,
                      simulation.state.solver.displacement, simulation.dust.positions])
    alone, other = looks
    assert len(alone[2]) > 200 and len(alone[4]) > 100
    for one, same in zip(alone, other):
        np.testing.assert_array_equal(one, same)


@pytest.mark.parametrize('count', COUNTS)
def test_stresses_are_solved_beside_rigid_bodies(count, monkeypatch):
    """Let the engine wait until stresses are solved, which only another thread can do."""
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['wall']}, 'threads': count,
        'wall': {'grammar': 'garden_wall.wall'}}))
    solved, solvers, moved = Event(), [], []

    def solve(*_):
        solvers.append(get_ident())
        solved.set()
    monkeypatch.setattr(masonry, 'solve_stresses', solve)
    monkeypatch.setattr(type(simulation.state.world), 'step',
                        lambda *_: moved.append(solved.wait(60.0)))
    simulation.step()
    assert moved == [True] and (solvers == [get_ident()]) == (count == 1)


def test_trees_answer_to_contacts_alike_on_any_number_of_threads():
    """Compare to the bit what points of eight trees will do that are pushed there."""
    looks = []
    for count in COUNTS:
        simulation, rng = stand(1), np.random.default_rng(3)
        simulation.step(5)
        forest = simulation.state.forest
        rows = np.sort(rng.choice(np.flatnonzero(forest.active), 60, replace=False))
        points = forest.poses[rows, :3] + rng.normal(0.0, 0.02, (60, 3))
        looks.append(forest.predict_response(rows, points, 1.0 / 60.0, simulation.state.trees.air,
                                             rng.normal(0.0, 0.1, (60, 3)), count))
    alone, *others = (vars(look) for look in looks)
    assert alone['tree'].max() >= 5
    for other in others:
        for name, column in alone.items():
            np.testing.assert_array_equal(column, other[name], err_msg=name)


@pytest.mark.parametrize('number', [0, 1, 127, 128, 1000, 1307])
def test_wind_is_the_same_on_any_number_of_threads(number):
    """Compare mean, eddies and gusts at points whose number is no multiple of a block."""
    wind = Wind(WindSettings(velocity=(12.0, 3.0, 0.0), turbulence_intensity=0.2), seed=1)
    points = np.random.default_rng(1).uniform(0.0, 30.0, (number, 3))
    alone, *others = (wind.velocity(points, 2.0, threads=count) for count in COUNTS)
    for other in others:
        np.testing.assert_array_equal(alone, other)


def test_ranges_cover_everything_once():
    """Lay ranges of rows and of trees end to end, with about as many rows in each."""
    for rows in (0, 15, 40, 5000):
        for count in COUNTS:
            bounds = threads.even_ranges(rows, count)
            assert bounds[0] == 0 and bounds[-1] == rows and (np.diff(bounds) >= 0).all()
            assert len(bounds) <= count + 1 and not (bounds[:-1] % threads.BLOCK).any()
    starts = np.append(0, np.cumsum(np.random.default_rng(2).integers(1, 60, 200)))
    for count in COUNTS:
        bounds = threads.group_ranges(starts, count)
        shares = np.diff(starts[bounds])
        assert bounds[0] == 0 and bounds[-1] == 200 and len(shares) == count
        assert np.ptp(shares) <= 120


def test_ranges_run_once_each_and_their_errors_arrive():
    """Write rows from several threads, and raise in one of them."""
    out = np.zeros(100)

    def count(place, first, last):
        out[first:last] += 1.0
        if place == 2:
            raise ValueError('range 2')
    with pytest.raises(ValueError, match='range 2'):
        threads.run(count, np.array([0, 10, 50, 100]))
    assert (out == 1.0).all()


@pytest.mark.parametrize('count', COUNTS)
def test_work_beside_something_else_gives_its_result_or_its_error(count):
    """Do what has the same name one after the other, and all of it before its end is known."""
    done = []

    def add(number):
        done.append(number)
        if number == 3:
            raise ValueError('three')
        return number ** 2
    first, second, third = (threads.beside('test', partial(add, number), count)
                            for number in (1, 2, 4))
    assert (third(), first(), second()) == (16, 1, 4) and done == [1, 2, 4]
    with pytest.raises(ValueError, match='three'):
        threads.beside('test', partial(add, 3), count)()
    assert threads.beside('test', partial(add, 5), count)() == 25  # goes on after an error


def test_work_beside_something_else_has_begun_when_that_goes_on():
    """Wait for nobody who holds the interpreter, with more than one thread."""
    begun, go = Event(), Event()

    def work():
        begun.set()
        assert go.wait(60.0)
        return get_ident()
    finish = threads.beside('test', work, 2)
    assert begun.wait(60.0)
    go.set()
    assert finish() != get_ident()
    go.set()
    assert threads.beside('test', work, 1)() == get_ident()


def test_markers_written_beside_the_next_steps_are_the_same_to_the_bit():
    """Compare the bytes of a storm's markers with those written while nothing moved on."""
    sent = []
    for count in COUNTS:
        simulation, data = stand(count), []
        markers = SceneMarkers(simulation.blueprint, simulation.objects, 'world')
        data.append(markers.whole(simulation.poses, (0, 0), simulation.leaf_poses()))
        for at in range(10):
            simulation.step(4)
            if len(markers) < len(simulation.blueprint):
                markers.grow(simulation.blueprint, simulation.objects)
            finish = threads.beside('markers', partial(
                markers.changes, simulation.poses.copy(), (at, 0), simulation.leaf_poses(),
                simulation.dust), count)
            simulation.step(2)
            data.append(finish())
        sent.append(data)
    assert all(data for data in sent[0])
    assert sent[0] == sent[1] == sent[2]


def test_snapshots_go_on_with_another_number_of_threads():
    """Save with one thread, restore into a simulation with five, and compare to the bit."""
    first, second = stand(1), stand(5)
    first.step(10)
    second.restore(first.save())
    for simulation in (first, second):
        simulation.step(20)
    np.testing.assert_array_equal(first.poses, second.poses)


def test_an_interrupt_waits_for_the_end_of_work_beside():
    """Interrupt the wait for work by a signal: it comes through when the work is done."""
    done = []

    def work():
        sleep(1.0)
        done.append(True)

    def interrupt(*_):
        raise KeyboardInterrupt
    before = signal.signal(signal.SIGUSR1, interrupt)
    try:
        finish = threads.beside('test', work, 2)
        with pytest.raises(KeyboardInterrupt):
            Timer(0.1, os.kill, (os.getpid(), signal.SIGUSR1)).start()
            finish()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert done
