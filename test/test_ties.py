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

"""Ropes tied to branches: closed forms, momentum, time steps, and what breaks."""

import numpy as np
import pytest
from scipy.special import ellipk

from procphys_ros.blueprint import Blueprint, skeleton
from procphys_ros.errors import SceneError
from procphys_ros.export import Content
from procphys_ros.mechanism import MechanismGrammar
from procphys_ros.physics.causes import Cause
from procphys_ros.scene import Scene, Settings
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.state import TIED

_GRAVITY = Settings().gravity


def arm(modulus: float = 5e10, strength: float = 1e12) -> Blueprint:
    """Make a tree whose arm reaches 2 m from a post of 5 m."""
    nodes = np.array([[0, 0, 0], [0, 0, 2.5], [0, 0, 5], [1, 0, 5], [2, 0, 5]], float)
    return skeleton.from_nodes(nodes, [-1, 0, 1, 2, 3], [0.08] * 5, density=900.0,
                               modulus=modulus, strength=strength)


def hung(body: str, dt: float = 1.0 / 60.0, modulus: float = 5e10,
         strength: float = 1e12) -> Simulation:
    """Tie a mechanism to an arm."""
    scene = Scene(Settings(time_step=dt))
    scene.add(arm(modulus, strength), name='tree')
    scene.add(MechanismGrammar.parse(f'mechanism m {{ {body} }}').build(), name='m',
              tied_to='tree')
    return Simulation(scene)


def ball(x: float, y: float, z: float, mass: float = 20.0, more: str = '') -> str:
    """Write a ball on a rope to the end of the arm."""
    return (f'ball {{ diameter: 0.2  mass: {mass}  at: {x}, {y}, {z} '
            f'rope line {{ to: ground  at: {x}, {y}, {z}  end: 2, 0, 5  {more} }} }}')


@pytest.mark.parametrize('dt', [1.0 / 60.0, 1.0 / 240.0])
def test_a_ball_on_a_stiff_branch_is_a_pendulum(dt, length=2.0, angle=0.9):
    """Keep period, energy and length over two swings of 50°, in any step."""
    simulation = hung(ball(2.0, length * np.sin(angle), 5.0 - length * np.cos(angle)), dt, 8e12)
    rows = []
    for _ in range(round(7.0 / dt)):
        simulation.step()
        rows.append([simulation.time, *simulation.poses[-1, :3], *simulation.velocities[-1, :3]])
    time, y, z = np.array(rows)[:, [0, 2, 3]].T
    up = np.flatnonzero((y[:-1] < 0.0) & (y[1:] >= 0.0))
    passed = time[up] - y[up] * dt / (y[up + 1] - y[up])
    period = 4.0 * np.sqrt(length / _GRAVITY) * ellipk(np.sin(0.5 * angle) ** 2)
    assert np.diff(passed) == pytest.approx(period, rel=1e-3)
    energy = _GRAVITY * (z - 3.0) + 0.5 * np.square(np.array(rows)[:, 4:]).sum(axis=1)
    assert np.ptp(energy) < 1e-3 * _GRAVITY * length
    assert np.hypot(y, 5.0 - z) == pytest.approx(length, abs=1e-3)


def test_what_hangs_weighs_on_its_branch():
    """Bend the arm by a seat on two ropes as much as by its weight, and hang level."""
    seat = ('box seat { size: 0.2, 0.5, 0.04  mass: 30  at: 1.9, 0, 3 '
            'rope { to: ground  at: 1.9, -0.2, 3  end: 1.9, 0, 5 } '
            'rope { to: ground  at: 1.9, 0.2, 3  end: 1.9, 0, 5 } }')
    simulation, tree = hung(seat), Scene()
    tree.add(arm(), name='tree')
    bare = Simulation(tree)
    bare.apply_wrench('tree/3', (0.0, 0.0, -30.0 * _GRAVITY), (0.0, 0.4 * 30.0 * _GRAVITY, 0.0))
    for one in (simulation, bare):
        one.step(900)
    sag = 5.0 - simulation.poses[3, 2]
    assert sag == pytest.approx(5.0 - bare.poses[3, 2], rel=0.02) and sag > 0.002
    assert simulation.state.contacts.impulse.sum(axis=0) * 60.0 == pytest.approx(
        [0.0, 0.0, -30.0 * _GRAVITY], abs=3.0)
    assert np.abs(simulation.velocities[-1]).max() < 0.02
    assert np.abs(simulation.poses[-1, 3:5]).max() < 0.01


def test_a_rope_that_snaps_taut_acts_alike_in_any_step():
    """Drop 30 kg by 1.5 m into a rope on a soft branch; keep momentum in every step."""
    heights = []
    for dt in (1.0 / 60.0, 1.0 / 240.0):
        simulation = hung(ball(2.0, 0.0, 4.5, 30.0, 'length: 2'), dt)
        found = []
        for _ in range(round(3.0 / dt)):
            before = simulation.velocities[-1, :3].copy()
            simulation.step()
            contacts = simulation.state.contacts
            got = -contacts.impulse[contacts.rope >= 0].sum(axis=0)
            got[2] -= 30.0 * _GRAVITY * dt
            if simulation.poses[-1, 2] > 0.2:
                assert 30.0 * (simulation.velocities[-1, :3] - before) == pytest.approx(
                    got, abs=1e-3 * 30.0 * _GRAVITY * dt + 1e-6)
            found.append(simulation.poses[-1, 2])
        heights.append(np.array(found)[round(0.5 / dt) - 1::round(0.5 / dt)])
    assert heights[0][1:] == pytest.approx(heights[1][1:], abs=0.02)
    assert heights[0][-1] == pytest.approx(3.0, abs=0.02)


@pytest.mark.parametrize('share, breaks', [(0.9, True), (1.2, False)])
def test_a_rope_breaks_beyond_its_strength(share, breaks):
    """Let a ball that hangs still fall if its rope bears less than its weight, and tell it."""
    simulation = hung(ball(2.0, 0.0, 3.0, 20.0, f'strength: {share * 20.0 * _GRAVITY}'),
                      modulus=8e12)
    simulation.step(60)
    events = simulation.log.take()
    assert (simulation.poses[-1, 2] < 2.0) == breaks
    assert (len(events) == 1 and events['cause'][0] == Cause.FORCE) == breaks
    assert (simulation.state.mechanisms.joint[0] == TIED) != breaks


def test_a_branch_that_breaks_takes_its_load_along():
    """Hang too much on a weak arm: it comes off, and stays on the rope as a body."""
    simulation = hung(ball(2.0, 0.0, 3.0, 400.0), strength=2e6, modulus=8e9)
    simulation.step(42)
    assert simulation.state.parts.owner[3] == Owner.BODY
    assert simulation.state.mechanisms.joint[0] >= 0
    assert np.isfinite(simulation.poses).all()
    assert simulation.poses[-1, 2] < 1.0
    end = simulation.poses[3, :3]
    assert np.linalg.norm(end - simulation.poses[-1, :3]) < 2.0 + 0.7


@pytest.mark.parametrize('name', ['tree', 'm'])
def test_either_end_may_be_removed(name):
    """Let the ball fall without its tree, and the arm swing back without its ball."""
    simulation = hung(ball(2.0, 0.5, 3.0))
    simulation.step(30)
    simulation.remove(name)
    simulation.step(60)
    assert simulation.state.mechanisms.joint[0] == -1
    assert not (simulation.state.contacts.rope >= 0).any()
    if name == 'tree':
        assert simulation.poses[-1, 2] < 0.2
    else:
        assert simulation.poses[3, 2] == pytest.approx(5.0, abs=2e-3)


def test_a_swing_returns_from_a_snapshot():
    """Repeat half a second to the bit, also with level of detail and a tree that rests."""
    simulation = hung(ball(2.0, 1.0, 3.3))
    simulation.step(20)
    saved = simulation.save()
    simulation.step(30)
    there = simulation.poses.copy()
    simulation.restore(saved)
    simulation.step(30)
    assert np.array_equal(simulation.poses, there)
    assert not Content.of(simulation).joints_hold.any()


def test_ties_need_ropes_and_branches():
    """Say what is missing, and where the nearest branch is."""
    grammar = {'grammar_text': 'mechanism m { ball { diameter: 0.2  at: 0, 0, 2 '
               'rope { to: ground  end: 0, 0, 40 } } }'}
    for tie, other, message in (
            ('oak', grammar, r'm.tied_to: no branch of "oak" is within 0.5 m of the end of a rope '
             r'at 0.00, 0.00, 40.00 m; the nearest is at '),
            ('okk', grammar, 'm.tied_to: there is no object "okk" before it; did you mean oak?'),
            ('wall', grammar, '"wall" has no branches'),
            ('oak', {'grammar': 'cart.mech'}, 'there is no rope to the ground in it')):
        with pytest.raises(SceneError, match=message):
            Scene.from_parameters({
                'scene': {'objects': ['oak', 'wall', 'm']}, 'oak': {'grammar': 'oak.lsys'},
                'wall': {'grammar': 'garden_wall.wall', 'defines': ['length=0.89']},
                'm': {**other, 'tied_to': tie}})
