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


"""Earthquakes: oscillators, blocks, trees and walls on shaken ground, against closed forms."""

from dataclasses import replace
import math

from grown_trees import beam, BENDING, DENSITY, LENGTH, RADIUS
from masonry_walls import bonded, wall
import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.physics.ground_motion import integrated, recorded, respond, synthetic
from procphys_ros.physics.masonry import BondGraph, first_modes
from procphys_ros.scene import Scene
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.ground_record import read_ground_record
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import Owner

_G = 9.81
_X = np.eye(3)[0]


def _simulation(record=(), plan=None, dt=1.0 / 60.0, engine='native'):
    scene = Scene.from_parameters({'scene': {'objects': []}, 'engine': engine, 'time_step': dt})
    scene.settings = replace(scene.settings, ground_record=record)
    if plan is not None:
        scene.add(plan, name='thing')
    return Simulation(scene)


def _pulse(peak, duration, count=101):
    """Make the record of a half sine."""
    time = np.linspace(0.0, duration, count)
    rows = [(t, peak * math.sin(math.pi * t / duration)) for t in time.tolist()]
    return (*rows, (duration + 10.0, 0.0))


def test_an_oscillator_follows_the_closed_form():
    """Shake one by a ramp: x = (t − 2ζ/ω)/ω² and what dies away; harmonically: Duhamel."""
    w, z, h = 7.0, 0.1, 0.02
    time = h * np.arange(3000)
    ramp = respond(-time, h, w, z)
    assert ramp[-1] == pytest.approx([(time[-1] - 2.0 * z / w) / w ** 2, 1.0 / w ** 2], rel=1e-9)
    fine = 1e-3 * np.arange(20000)
    steady = respond(np.sin(5.0 * fine), 1e-3, w, z)[10000:, 0]
    size = 1.0 / math.hypot(w * w - 25.0, 2.0 * z * w * 5.0)
    assert np.abs(steady).max() == pytest.approx(size, rel=1e-3)


@pytest.mark.parametrize('frequency', [1.0, 4.0])
def test_synthetic_motions_have_their_peak_frequency_and_end(frequency):
    """Draw motions: the same ones of a seed, of a given peak, that leave the ground at rest."""
    def draw(seed):
        return synthetic(3.0, 12.0, frequency, 0.4, _X, np.random.default_rng(seed))
    one = draw(0)
    assert np.array_equal(one.acceleration, draw(0).acceleration)
    assert not np.array_equal(one.acceleration, draw(1).acceleration)
    assert np.abs(one.acceleration).max(axis=0) == pytest.approx([3.0, 2.55, 2.0])
    assert np.abs(one.velocity[-1]).max() < 0.01 * np.abs(one.velocity).max()
    power = np.mean([np.square(np.abs(np.fft.rfft(draw(seed).acceleration[:, 0])))
                     for seed in range(20)], axis=0)
    scale = np.fft.rfftfreq(len(one.time), one.time[1])
    low, high = (power[(scale > a * frequency) & (scale < b * frequency)].mean()
                 for a, b in ((0.8, 1.1), (3.0, 4.0)))
    assert low > 10.0 * high


def test_motion_is_the_integral_of_its_acceleration():
    """Sample a motion between its rows, and beyond its end."""
    motion = integrated(np.array([0.0, 0.5, 2.0]), np.array([[0.0, 1.0, 0.0], [3.0, 1.0, 0.0],
                                                             [0.0, 1.0, 0.0]]))
    time = np.linspace(0.0, 2.0, 4001)
    sampled = np.array([motion.at(float(t)) for t in time])
    for order in (0, 1):
        rate = np.gradient(sampled[:, order + 1], time, axis=0)
        assert np.abs(rate - sampled[:, order])[1:-1].max() < 2e-3
    assert motion.at(3.0)[1] == pytest.approx([3.0, 2.0, 0.0])
    assert motion.mean_acceleration(0.25, 1.0) == pytest.approx(
        (motion.at(1.0)[1] - motion.at(0.25)[1]) / 0.75)


def test_a_record_begins_with_its_first_row():
    """Begin records at 5 s: the ground is not accelerated for 5 s by the value of that row."""
    record = ((5.0, 2.0), (6.0, 0.0))
    for start, end in ((0.0, 1.0), (5.5, 0.25)):
        motion = recorded(record, start, 1.0, _X)
        assert motion.duration == 6.0 - max(start, 5.0)
        assert motion.velocity[-1] == pytest.approx([end, 0.0, 0.0])


def test_rows_that_follow_at_once_are_a_jump():
    """Let two rows be as close as numbers can: all that is read of the motion is a number."""
    motion = integrated(np.array([0.0, 5e-324, 1.0]), np.array([1.0, 50.0, 0.0])[:, None] * _X)
    assert np.isfinite(motion.at(0.0)).all()
    assert motion.mean_acceleration(0.0, 1.0) == pytest.approx([25.0, 0.0, 0.0])


@pytest.mark.parametrize('engine, off, peak, duration', [
    ('native', 0.002, 9.0, 0.2), ('bullet', 0.03, 8.0, 0.3)])
def test_a_block_slides_as_newmark_says(engine, off, peak, duration):
    """Shake a block by a rectangular pulse: it slides by A·t²/2·(A/(μ·g) − 1), and rests."""
    simulation = _simulation(((0.0, peak), (duration, peak), (duration + 1e-6, 0.0), (4.0, 0.0)),
                             engine=engine)
    world = simulation.state.world
    block = world.add_body(Shape.BOX, [0.3] * 3, 50.0, np.array([0, 0, 0.15, 0, 0, 0, 1.0]),
                           friction=0.7)
    simulation.step(60)
    assert not simulation.awake_bodies
    simulation.shake()
    simulation.step(60)
    slid = 0.5 * peak * duration ** 2 * (peak / (0.7 * _G) - 1.0)
    assert world.poses([block])[0, 0] == pytest.approx(-slid, rel=off)
    simulation.step(240)
    assert not simulation.awake_bodies


def _overturns(width, height, duration, peak, dt=1e-4):
    """Integrate Housner's rocking block under a half sine."""
    lean, square = math.atan2(width, height), 1.5 * _G / math.hypot(width, height)
    left = 1.0 - 1.5 * math.sin(lean) ** 2
    turn, spin = 0.0, 0.0
    for step in range(60_000):
        t = step * dt
        push = peak * math.sin(math.pi * t / duration) if t < duration else 0.0
        if turn == spin == 0.0 and abs(push) <= _G * math.tan(lean):
            continue
        side = math.copysign(1.0, turn or spin or -push)
        spin -= dt * square * (math.sin(side * lean - turn)
                               + push / _G * math.cos(side * lean - turn))
        after = turn + dt * spin
        if turn * after < 0.0:
            after, spin = 0.0, left * spin
        turn = after
        if abs(turn) > 0.5 * math.pi:
            return True
    return False


def test_a_block_is_overturned_as_housner_says(width=0.2, height=1.0, duration=0.4):
    """Find the least half sine that overturns a block: within 3 % of the equation of motion."""
    low, high = (_G * width / height, 10.0 * _G * width / height)
    for _ in range(8):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _overturns(width, height, duration, middle) else (middle,
                                                                                       high)
    for share, falls in ((0.97, False), (1.03, True)):
        simulation = _simulation(_pulse(share * high, duration))
        world = simulation.state.world
        block = world.add_body(Shape.BOX, [width, 0.4, height], 400.0 * width * height,
                               np.array([0.0, 0.0, 0.5 * height, 0.0, 0.0, 0.0, 1.0]),
                               friction=3.0)
        simulation.shake()
        simulation.step(300)
        assert (world.poses([block])[0, 2] < 0.4 * height) == falls


def _cantilever(angular, place):
    """Return the steady displacement of a cantilever over the ground's acceleration [s²]."""
    total = 0.0
    for order, wave in enumerate((1.8751041, 4.6940911, 7.8547574)):
        square = (wave / LENGTH) ** 4 * BENDING / (DENSITY * math.pi * RADIUS ** 2)
        if order == 0:  # its weight softens it as it would buckle it (Greenhill 1881)
            square *= 1.0 - DENSITY * math.pi * RADIUS ** 2 * _G * LENGTH ** 3 / BENDING / 7.837
        slope = (math.cosh(wave) + math.cos(wave)) / (math.sinh(wave) + math.sin(wave))
        x = wave * place
        shape = math.cosh(x) - math.cos(x) - slope * (math.sinh(x) - math.sin(x))
        total += 2.0 * slope / wave * shape / (square - angular ** 2)
    return abs(total)


@pytest.mark.parametrize('frequency', [0.6, 3.0])
def test_a_tree_sways_by_its_transfer_function(frequency):
    """Shake a beam below and above its first frequency of 1.67 Hz: its last segment follows."""
    time, angular = np.arange(0.0, 16.0, 0.01), 2.0 * math.pi * frequency
    shaken = 0.5 * np.minimum(time / 8.0, 1.0) * np.sin(angular * time)
    simulation = _simulation(tuple(zip(time.tolist(), shaken.tolist())), beam(20), 1.0 / 120.0)
    simulation.shake()
    simulation.step(10 * 120)
    way = []
    for _ in range(5 * 120):
        simulation.step()
        way.append(simulation.poses[-1, 0])
    waves = angular * np.arange(len(way)) / 120.0
    sine, cosine = 2.0 * np.mean(np.array(way) * [np.sin(waves), np.cos(waves)], axis=1)
    assert math.hypot(sine, cosine) == pytest.approx(0.5 * _cantilever(angular, 0.975), rel=0.02)


def test_first_modes_are_those_of_a_cantilever():
    """Stack blocks into a pillar: its first mode is that of a beam that bends and shears."""
    count, edge, stiffness = 80, 0.25, 1e9
    centres = np.zeros((count, 3))
    centres[:, 2] = edge * (0.5 + np.arange(count))
    plan = bonded(centres, (edge, edge, edge), normal=stiffness, shear=0.4 * stiffness)
    modes = first_modes(BondGraph(plan), np.zeros(count, int), 20_000)
    height = count * edge
    bending = stiffness * edge * edge ** 4 / 12.0
    per_length = 1900.0 * edge ** 2
    bends = 3.516 / height ** 2 * math.sqrt(bending / per_length)
    shears = 0.5 * math.pi / height * math.sqrt(0.4 * stiffness * edge / 1900.0)
    expected = 1.0 / math.sqrt(bends ** -2 + shears ** -2)  # Dunkerley
    assert modes.angular[0] == pytest.approx([expected] * 2, rel=0.02)
    assert modes.shape[-1, 0, 0] == pytest.approx(1.566, rel=0.02)
    still = modes.forces(np.array([[0.0, 0.0, 2.0, 0.0, 1.0]]), plan.mass)
    assert still == pytest.approx(plan.mass[:, None] * [[-2.0, 0.0, -1.0]])


@pytest.mark.parametrize('share, stands', [(0.9, True), (1.1, False)])
def test_a_dry_wall_is_overturned_beyond_its_static_limit(share, stands):
    """Push a dry wall by a slow pulse of acceleration to and fro: its limit is g·t/h."""
    plan = wall(4, 13, tension=0.0, cohesion=0.0)
    peak = share * _G * 0.1025 / (13 * 0.075)
    record = ((0.0, 0.0), (0.5, peak), (0.7, peak), (0.8, -peak), (1.0, -peak), (2.0, 0.0))
    simulation = _simulation(record, plan)
    simulation.shake(Earthquake(direction=(0.0, 1.0, 0.0)))
    simulation.step(150)
    loose = np.count_nonzero(simulation.state.parts.owner[:len(plan)] == Owner.BODY)
    assert (loose == 0) == stands
    assert stands or loose > 0.9 * len(plan)
    if stands:
        assert np.array_equal(simulation.poses[:len(plan)], plan.poses)


def test_strong_shaking_brings_a_gable_wall_down_and_weak_shaking_nothing():
    """Shake a wall in poor mortar by seeds: none falls at 0.05 g, and each at 1.5 g."""
    plan = wall(5, 12, tension=2e4, cohesion=4e4)
    fallen = {}
    for peak in (0.5, 15.0):
        simulation = _simulation(plan=plan)
        for seed in range(2):
            fork = simulation.fork()
            fork.shake(Earthquake(peak=peak, duration=4.0, seed=seed, direction=(0.0, 1.0, 0.0)))
            down = 0
            while down <= 0.3 * len(plan) and fork.time < 4.0:
                fork.step(20)
                down = np.count_nonzero(fork.poses[:len(plan), 2] < plan.poses[:, 2] - 0.1)
            fallen.setdefault(peak, []).append(down)
    assert fallen[0.5] == [0, 0]
    assert min(fallen[15.0]) > 0.3 * len(plan)


def test_a_saved_and_a_forked_earthquake_go_on_to_the_bit():
    """Save, fork and restore amid the shaking; reset begins on ground at rest."""
    scene = Scene.from_parameters({
        'scene': {'objects': [], 'cues': ['0.2 earthquake peak=8 duration=3']},
        'engine': 'native'})
    scene.add(beam(), (3.0, 0.0, 0.0), name='beam')
    scene.add(wall(5, 10, tension=5e4, cohesion=5e4), name='wall')
    simulation = Simulation(scene)
    simulation.step(90)
    assert simulation.ground_acceleration.any()
    data, fork = simulation.save(), simulation.fork()
    simulation.step(60)
    fork.step(60)
    assert np.array_equal(fork.poses, simulation.poses)
    fork.restore(data)
    fork.step(60)
    assert np.array_equal(fork.poses, simulation.poses)
    assert simulation.bonds_broken > 0
    fork.reset()
    assert not fork.ground_acceleration.any()
    fork.step(5)
    assert np.array_equal(fork.state.world.gravity, [0.0, 0.0, -_G])


@pytest.mark.parametrize('text, rows', [
    ('time [s], along [m/s2]\n0, 1\n0.5, -2\n', [(0.0, 1.0), (0.5, -2.0)]),
    ('# by hand\ntime [s],along [g],across [gal]\n0,1,100\n1,0,0\n',
     [(0.0, 9.80665, 1.0), (1.0, 0.0, 0.0)]),
    ('time [s], along [cm/s²], across [m/s²], up [g]\n1e-2,5,6,0\n2,0,0,0\n',
     [(0.01, 0.05, 6.0, 0.0), (2.0, 0.0, 0.0, 0.0)])])
def test_tables_of_accelerations_are_read(text, rows, tmp_path):
    (tmp_path / 'quake.csv').write_text(text)
    assert read_ground_record(['quake.csv'], tmp_path) == tuple(rows)


_PEER = ('PEER NGA STRONG MOTION DATABASE RECORD\nMade up\n'
         'ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  5, DT=   .0100 SEC\n'
         '  .1000E+00 -.2000E+00  .0 .3\n .1E-1\n')


def test_components_of_peer_are_read(tmp_path):
    """Read one and three components; the shortest one ends the record."""
    (tmp_path / 'a.AT2').write_text(_PEER)
    (tmp_path / 'b.at2').write_text(_PEER.replace('5,', '3,'))
    alone = np.array(read_ground_record(['a.AT2'], tmp_path))
    assert alone == pytest.approx(np.column_stack([
        0.01 * np.arange(5), 9.80665 * np.array([0.1, -0.2, 0.0, 0.3, 0.01])]))
    both = np.array(read_ground_record(['a.AT2', 'b.at2', 'a.AT2'], tmp_path))
    assert both.shape == (3, 4) and np.array_equal(both[:, 1], both[:, 2])


@pytest.mark.parametrize('name, text, told', [
    ('a.csv', '', '0 rows'), ('a.csv', 'time, along\n0,1\n', 'first line must be'),
    ('a.csv', 'time [s], along [ft]\n', 'units: m/s2'),
    ('a.csv', 'time [s], up [g]\n0,1\n1,1\n', 'first line must be'),
    ('a.csv', 'time [s], along [g]\n0,1\n', '1 rows'),
    ('a.csv', 'time [s], along [g]\n0,1,2\n', 'line 2: 3 values'),
    ('a.csv', 'time [s], along [g]\n0,x\n', 'line 2: along must be a number'),
    ('a.csv', 'time [s], along [g]\n0,nan\n1,0\n', 'line 2: an acceleration is nan'),
    ('a.csv', 'time [s], along [g]\n1,0\n1,0\n', 'line 3: time is 1'),
    ('a.AT2', 'nothing\n', 'no file of PEER'),
    ('a.AT2', _PEER.replace('OF G', 'OF CM/S'), 'no file of PEER'),
    ('a.AT2', _PEER.replace('OF G', 'OF GAL'), 'no file of PEER'),
    ('a.AT2', _PEER.replace('.0100', '0'), 'line 4: DT is 0'),
    ('a.AT2', _PEER.replace('5,', '50,'), 'has 5 numbers, its head says 50'),
    ('a.AT2', _PEER.replace('.3', 'x'), 'line 5: an acceleration must be a number')])
def test_records_with_faults_are_refused_with_file_and_line(name, text, told, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(SceneError, match=told) as refused:
        read_ground_record([name], tmp_path)
    assert 'ground.motion' in str(refused.value) and name in str(refused.value)


def test_records_that_do_not_go_together_are_refused(tmp_path):
    (tmp_path / 'a.AT2').write_text(_PEER)
    (tmp_path / 'b.AT2').write_text(_PEER.replace('.0100', '.0200'))
    for names, told in ((['a.AT2'] * 4, 'names 4 files'), (['a.AT2', 'b.csv'], 'no file "b.csv"'),
                        (['a.AT2', 'b.AT2'], 'different steps')):
        with pytest.raises(SceneError, match=told):
            read_ground_record(names, tmp_path)


@pytest.mark.parametrize('values, told', [
    ({'direction': (0.0, 0.0, 1.0)}, 'earthquake.direction'),
    ({'direction': (0.0, 0.0, 0.0)}, 'level and have a length'),
    ({'peak': 0.0}, 'earthquake.peak'), ({'duration': math.inf}, 'earthquake.duration'),
    ({'damping': 1.0}, 'earthquake.damping')])
def test_earthquakes_that_cannot_be_are_refused(values, told):
    with pytest.raises(CommandError, match=told):
        Earthquake(**values)


def test_a_start_behind_the_record_is_refused():
    simulation = _simulation(((0.0, 1.0), (2.0, 0.0)))
    with pytest.raises(CommandError, match='earthquake.start is 3 s, the record .* ends at 2 s'):
        simulation.shake(Earthquake(start=3.0))
    assert not simulation.ground_motion.duration
    simulation.shake(Earthquake(start=1.0, scale=-2.0))
    assert simulation.ground_acceleration == pytest.approx([-1.0, 0.0, 0.0])
