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


"""Boards of a barn: they break across the grain, and their pieces fly."""

from pathlib import Path

from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, Simulation
from procphys_ros.wallgrammar import WallGrammar

BARN = Path(__file__).parents[1] / 'grammars' / 'barn.wall'
WOOD = 18e6  # [Pa] tension along the grain in that grammar; nails hold far less


def barn():
    """Give a simulation of a small barn, and which of its bonds are wood that runs on."""
    built = WallGrammar.load(BARN).build(seed=0, width=7.0, depth=4.0)
    scene = Scene()
    scene.add(built, (0.0, 0.0, 0.0), 0.0, 'barn')
    board = built.kind == built.kinds.index('board')
    grain = (built.mortar.tension == WOOD) & board[built.bonds].all(axis=1)
    return Simulation(scene), grain


def broken_grain(simulation, grain):
    """Give the events of bonds that broke across the grain of a board."""
    events = simulation.events
    return events[grain[events['bond']]]


def apart(simulation, events):
    """Give how far the two pieces of each broken board are from where they joined [m], (K,)."""
    source, a, b = simulation.scene.blueprint, events['part_a'], events['part_b']
    rest = source.poses[b, :3] - source.poses[a, :3]
    return np.linalg.norm(simulation.poses[b, :3] - simulation.poses[a, :3] - rest, axis=1)


def splinters(simulation, events):
    """Count the loose bodies that carry a piece of a board broken across the grain."""
    parts = np.unique(np.concatenate([events['part_a'], events['part_b']]))
    carrier = simulation._debris.carrier[parts]
    return len(np.unique(carrier[carrier >= 0]))


def test_a_ball_breaks_boards_across_the_grain():
    """Throw a heavy ball through a wall: pieces of planks fly in, the rest of the planks stays."""
    simulation, grain = barn()
    simulation.launch(Projectile('sphere', 0.3, 100.0, (1.6, -2.0, 1.2), (0.0, 25.0, 0.0)))
    simulation.step(20)
    events = broken_grain(simulation, grain)
    assert len(events) >= 4 and np.all(events['cause'] == Cause.IMPACT)
    standing = simulation._buildings.standing
    stays = standing[events['part_a']] | standing[events['part_b']]
    assert np.any(stays & (apart(simulation, events) > 0.5))
    assert splinters(simulation, events) >= 2
    assert simulation.blueprint.mass[:len(standing)][~standing].sum() < 100.0


def test_a_blast_breaks_boards_across_the_grain():
    """Set off 4 kg of TNT before a wall: many planks break in several pieces that part."""
    simulation, grain = barn()
    simulation.explode((1.6, -2.0, 1.2), 4.0)
    simulation.step(30)
    events = broken_grain(simulation, grain)
    assert len(events) > 30
    assert np.mean(apart(simulation, events) > 0.1) > 0.7
    assert splinters(simulation, events) > 20


def test_a_collapse_breaks_boards_across_the_grain():
    """Blow up the foot of a barn: boards that fall break again where they hit."""
    simulation, grain = barn()
    simulation.demolish()
    simulation.step(200)
    events = broken_grain(simulation, grain)
    fallen = events[events['cause'] == Cause.IMPACT]
    assert len(fallen) > 10
    assert np.any(apart(simulation, fallen) > 0.3)


@pytest.mark.parametrize(('height', 'log', 'breaks'), [
    (1.0, True, False), (3.0, True, True), (3.0, False, False)])
def test_a_board_breaks_over_a_log(height, log, breaks):
    """
    Drop an oak board of 2.4 m, 40 mm thick, across a log or flat on the ground.

    The log stops its middle in 15 ms by F = m·v/T; where its middle piece ends, 0.24 m from there,
    the bending moment of the free bar is F/L·(L/2 - 0.24)²/2, which it bears up to 1.9 m.
    """
    centres = [[0.48 * i - 0.96, 0.0, 0.0] for i in range(5)]
    board = bonded(centres, (0.48, 0.2, 0.04), density=640.0, ground=False, gap=1e-3, tension=WOOD,
                   cohesion=3.9e6, friction=0.4, compression=24e6)
    scene = Scene()
    if log:
        scene.add(bonded([[0.0, 0.0, 0.15]], (0.1, 0.5, 0.3), density=640.0, tension=1e6))
    scene.add(board, (0.0, 0.0, height + (0.32 if log else 0.02)), 0.0, 'board')
    simulation = Simulation(scene)
    simulation.step(75)
    assert (simulation.bonds_broken > 0) == breaks
