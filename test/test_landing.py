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

from procphys_ros.physics.world import installed_engines
from procphys_ros.scene import Scene, Settings
from procphys_ros.simulation import impacts, Simulation


def falling(counts, height, tension=0.2e6, engine='auto', stone=True):
    """
    Let walls fall.

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
    assert not simulation.state.rubble.waiting


def test_small_pieces_wait(monkeypatch):
    """Take one of two walls of eight bricks apart after the other."""
    monkeypatch.setattr(impacts, '_WORK', 0)
    simulation = falling([(4, 2)] * 2, 1.0)
    while not simulation.bonds_broken:
        simulation.step()
    assert len(simulation.state.rubble.waiting) == 1


def test_a_wall_that_lands_flat_and_slowly_stays_whole():
    """Drop a wall by 2 cm on level ground, and one by a metre on a stone."""
    for height, stone in ((0.02, False), (1.0, True)):
        simulation = falling([(8, 6)], height, 0.4e6, stone=stone)
        simulation.step(60)
        assert (simulation.bonds_broken > 0) == stone
