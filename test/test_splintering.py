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

"""Boards and beams: they break across, and the pieces of a barn's boards fly."""

from dataclasses import replace
from functools import cache
from pathlib import Path

from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, Simulation
from procphys_ros.wallgrammar import WallGrammar

BARN = Path(__file__).parents[1] / 'grammars' / 'barn.wall'
CONCRETE = {'tension': 3.5e6, 'cohesion': 0.9e6, 'friction': 0.75, 'compression': 40e6}
WOOD = 18e6  # [Pa] tension along the grain in that grammar; nails hold far less


@cache
def new_barn():
    """Make a simulation of a small barn, once."""
    scene = Scene()
    scene.add(WallGrammar.load(BARN).build(seed=0, width=5.0, depth=3.0), name='barn')
    return Simulation(scene)


def barn():
    """Fork a simulation of a small barn; return it and a mask of the bonds within boards."""
    built = new_barn().blueprint
    board = built.kind == built.kinds.index('board')
    grain = (built.mortar.tension == WOOD) & board[built.bonds].all(axis=1)
    return new_barn().fork(), grain


def broken_grain(simulation, grain):
    """Return the events of bonds that broke across the grain of a board."""
    events = simulation.events
    return events[grain[events['bond']]]


def apart(simulation, events):
    """Compute how far the two pieces of each broken board have moved apart [m], (K,)."""
    source, a, b = simulation.scene.blueprint, events['part_a'], events['part_b']
    rest = source.poses[b, :3] - source.poses[a, :3]
    return np.linalg.norm(simulation.poses[b, :3] - simulation.poses[a, :3] - rest, axis=1)


def splinters(simulation, events):
    """Count the loose bodies that carry a piece of a board broken across the grain."""
    parts = np.unique(np.concatenate([events['part_a'], events['part_b']]))
    carrier = simulation.state.carrier[parts]
    return len(np.unique(carrier[carrier >= 0]))


def test_a_ball_breaks_boards_across_the_grain():
    """Throw a heavy ball through a wall: pieces of planks fly in, the rest of the planks stays."""
    simulation, grain = barn()
    simulation.launch(Projectile('sphere', 0.3, 100.0, (1.6, -2.0, 1.2), (0.0, 25.0, 0.0)))
    simulation.step(20)
    events = broken_grain(simulation, grain)
    assert len(events) >= 4 and np.all(events['cause'] == Cause.IMPACT)
    standing = simulation.state.standing
    stays = standing[events['part_a']] | standing[events['part_b']]
    assert np.any(stays & (apart(simulation, events) > 0.5))
    assert splinters(simulation, events) >= 2
    assert simulation.blueprint.mass[:-1][~standing[:-1]].sum() < 100.0  # the ball is the last


def test_a_blast_breaks_boards_across_the_grain():
    """Set off 4 kg of TNT before a wall: many planks break in several pieces that part."""
    simulation, grain = barn()
    simulation.explode((1.6, -2.0, 1.2), 4.0)
    simulation.step(45)
    events = broken_grain(simulation, grain)
    near = events[np.linalg.norm(events['position'] - [1.6, -2.0, 1.2], axis=1) < 2.5]
    assert len(near) > 30  # further off, what broke flies on side by side
    assert np.mean(apart(simulation, near) > 0.1) > 0.5  # 0.65 to 0.90, by where it stands
    assert splinters(simulation, events) > 20


def test_a_collapse_breaks_boards_across_the_grain():
    """Blow up the foot of a barn: boards that fall break again where they hit, within 3.3 s."""
    simulation, grain = barn()
    simulation.demolish()
    for _ in range(20):
        simulation.step(10)
        events = broken_grain(simulation, grain)
        fallen = events[events['cause'] == Cause.IMPACT]
        if len(fallen) > 10 and np.any(apart(simulation, fallen) > 0.3):
            return
    raise AssertionError(f'{len(fallen)} bonds are broken')


@pytest.mark.parametrize(('height', 'log', 'breaks'), [
    (1.0, True, False), (5.0, True, True), (5.0, False, False)])
def test_a_board_breaks_over_a_log(height, log, breaks):
    """Drop an oak board of 2.4 m, 40 mm thick, across a log or flat on the ground."""
    # It bends more than the log yields. A free bar that is pushed in its middle has the stiffness
    # 320·EI/L³ and stops in T = π·√(m·L³/(320·EI)), by F = m·v/T; where its middle piece ends,
    # 0.24 m from there, the moment is F/L·(L/2 - 0.24)²/2, which it bears up to about 3 m.
    centres = [[0.48 * i - 0.96, 0.0, 0.0] for i in range(5)]
    board = bonded(centres, (0.48, 0.2, 0.04), density=640.0, ground=False, gap=1e-3, tension=WOOD,
                   cohesion=3.9e6, friction=0.4, compression=24e6)
    board.mortar.normal_stiffness[:] = 11e9 / 0.48  # [N/m³], of oak between two middles
    scene = Scene()
    if log:
        scene.add(bonded([[0.0, 0.0, 0.15]], (0.1, 0.5, 0.3), density=640.0, tension=1e6))
    scene.add(board, (0.0, 0.0, height + (0.32 if log else 0.02)), 0.0, 'board')
    simulation = Simulation(scene)
    simulation.step(75)
    assert (simulation.bonds_broken > 0) == breaks


LINTEL = """
building bay()
  footprint: (0, 0) (4.6025, 0) (4.6025, 2.0) (0, 2.0)
  facades: front side
  storey_height: 2.1
  floors: none
  roof: none
rule front -> split(x) { ~1: wall | 2.0: opening | ~1: wall }
rule side -> wall
rule opening -> split(y) { 1.5: gap | 0.225: lintel | ~1: wall }
layout running { unit: 0.215 0.1025 0.065  joint: 0.010  offset: 1/2  material: brick }
panel wall: running
panel gap: none
panel lintel: beam(concrete)
"""


@pytest.mark.parametrize(('force', 'breaks'), [(2e3, False), (60e3, True)])
def test_a_lintel_in_a_wall_cracks_in_its_middle_when_overloaded(force, breaks):
    """Press the halves of a lintel of 2.3 m down: it bears two bricklayers, not twelve tonnes."""
    built = WallGrammar.parse(LINTEL).build()
    halves = np.flatnonzero(built.kind == built.kinds.index('lintel'))
    middle = np.flatnonzero(np.isin(built.bonds, halves).all(axis=1))
    assert len(halves) == 2 and len(middle) == 1
    scene = Scene()
    scene.add(built)
    simulation = Simulation(scene)
    simulation.step(30)
    assert simulation.bonds_broken == 0
    for half in halves.tolist():
        simulation.apply_wrench(half, (0.0, 0.0, -force))
    simulation.step(20)
    assert (middle[0] in simulation.events['bond']) == breaks
    assert breaks or simulation.bonds_broken == 0


@pytest.mark.parametrize(('share', 'breaks'), [(0.9, False), (1.1, True)])
def test_a_beam_breaks_where_its_concrete_does(share, breaks):
    """Load the free half of a built-in beam: (F + m·g)·l/2 meets tension·b·h²/6 at its root."""
    beam = bonded([[-0.3725, 0.0, 0.07], [0.3725, 0.0, 0.07]], (0.745, 0.1025, 0.14),
                  density=2400.0, **CONCRETE)
    held = np.flatnonzero((beam.bonds != [GROUND, 1]).any(axis=1))
    beam = replace(beam, mortar=beam.mortar.take(held), **{
        name: getattr(beam, name)[held]
        for name in ('bonds', 'bond_law', 'bond_frame', 'bond_extent', 'bond_area')})
    capacity = CONCRETE['tension'] * 0.1025 * 0.14 ** 2 / 6.0
    force = share * capacity / 0.3725 - 9.81 * beam.mass[1]
    scene = Scene()
    scene.add(beam.placed((0.0, 0.0, 1.0), 0.0))
    simulation = Simulation(scene)
    simulation.apply_wrench(1, (0.0, 0.0, -force))
    simulation.step(10)
    assert (simulation.bonds_broken == 1) == breaks
    assert simulation.state.standing[1] != breaks


@pytest.mark.parametrize(('height', 'breaks'), [(0.004, False), (0.05, True)])
def test_a_falling_beam_breaks_over_a_stone(height, breaks):
    """Drop a lintel of two halves with its middle on a stone: 5 ms bear F = m·v/T = 6.3 kN."""
    beam = bonded([[-0.3725, 0.0, 0.07], [0.3725, 0.0, 0.07]], (0.745, 0.1025, 0.14),
                  density=2400.0, ground=False, **CONCRETE)
    scene = Scene()
    scene.add(bonded([[0.0, 0.0, 0.2]], (0.1, 0.4, 0.4), tension=1e6))
    scene.add(beam, (0.0, 0.0, height + 0.4), 0.0, 'beam')
    simulation = Simulation(scene)
    simulation.step(60)
    assert (simulation.bonds_broken > 0) == breaks
