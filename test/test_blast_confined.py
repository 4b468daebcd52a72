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


"""Confined charges: what stands around one never takes load off a wall."""

from masonry_walls import bonded
import numpy as np
from numpy.testing import assert_allclose
import pytest

from procphys_ros.geometry import rotation
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.blasts import on_everything
from procphys_ros.wallgrammar import WallGrammar

GATE = """
building gate()
  footprint: (0, 0) (9.0, 0)
  facades: front
  storey_height: 5.0
rule front -> split(x) { ~1: wall | 2.6: gateway | ~1: wall }
rule gateway -> split(y) { 2.0: gap | 0.5 * scope_x + 0.62: arch | ~1: wall }
material stone { density: 2400  tension: 0.2e6  cohesion: 0.25e6  friction: 0.6
                 compression: 40e6  modulus: 15e9  texture: sandstone }
layout ashlar { bond: running  unit: 0.60 0.60 0.19  joint: 0.010  material: stone }
panel wall: ashlar
panel gap: none
panel arch: arch(round, 1)
"""


def stand(built, place=(0.0, 0.0, 0.0), yaw=0.0):
    """Make a simulation of a blueprint."""
    scene = Scene(Settings())
    scene.add(built, place, yaw)
    return Simulation(scene)


def impulses(simulation, point, charge=30.0):
    """Return the impulse of a charge on each part [N·s], (N, 3)."""
    (parts, gift), = on_everything(simulation.model, simulation.state, point, charge, 0.0)
    found = np.zeros((len(simulation.blueprint), 3))
    found[parts] = gift.linear
    return found


def passage(rng):
    """Lay a random passage along y: its left jamb, its right one, and its ceiling."""
    half, depth, rows = rng.uniform(0.8, 2.0), rng.uniform(0.4, 4.0), int(rng.integers(4, 9))
    thick = rng.uniform(0.3, 1.0)
    z = 0.4 * np.arange(rows) + 0.195
    jamb = np.column_stack([np.full(rows, half + 0.5 * thick), np.zeros(rows), z])
    size = np.tile([thick, depth, 0.39], (rows, 1))
    ceiling = np.array([[0.0, 0.0, 0.4 * rows + 0.2]]), np.array(
        [[2.0 * (half + thick), depth, 0.4]])
    return half, depth, (jamb * [-1, 1, 1], size), (jamb, size), ceiling


@pytest.mark.parametrize('seed', range(5))
def test_a_passage_takes_no_load_off_its_walls(seed):
    """Compare a wall alone with the same one in a passage, without and with a ceiling."""
    rng = np.random.default_rng(seed)
    half, depth, left, right, ceiling = passage(rng)
    point = np.array([rng.uniform(-0.8, 0.8) * half, rng.uniform(-0.45, 0.45) * depth,
                      rng.uniform(0.3, 1.2)])
    count, found = len(left[0]), []
    for boxes in ((left,), (left, right), (left, right, ceiling)):
        built = bonded(*(np.vstack(column) for column in zip(*boxes)), 2400.0)
        found.append(-impulses(stand(built), point)[:count, 0])
    alone, between, under = found
    assert (alone > 0.0).all()
    assert (between >= alone * (1.0 - 1e-9)).all() and between.sum() > alone.sum()
    assert (under >= between * (1.0 - 1e-9)).all() and under.sum() > between.sum()


def test_a_charge_between_two_jambs_pushes_both_alike_wherever_it_is_along_them():
    """Move a charge through a gateway: the jambs get the like on both sides, without a jump."""
    simulation = stand(WallGrammar.parse(GATE).build())
    x = simulation.blueprint.poses[:, 0]
    found = np.array([[np.abs(impulses(simulation, (4.5, y, 1.0))[side, 0]).sum()
                       for side in (x < 3.2, x > 5.8)] for y in (0.1, 0.299, 0.3, 0.5)])
    assert_allclose(found[:, 0], found[:, 1], rtol=0.03)
    assert found.max() < 1.15 * found.min()


def test_turning_a_building_turns_its_loads():
    """Stand a gate askew: pressure clears over its own edges, not over those of its bounds."""
    built, point, yaw = WallGrammar.parse(GATE).build(), np.array([4.5, -200.0, 1.0]), 0.6
    plain = impulses(stand(built), point, 8000.0)
    turn = rotation.from_yaw(yaw)
    turned = impulses(stand(built, yaw=yaw), rotation.rotate(turn, point), 8000.0)
    assert_allclose(turned, rotation.rotate(turn, plain), atol=1e-6 * np.abs(plain).max())


def test_a_charge_in_a_gateway_brings_it_down():
    """Set 30 kg off in the middle of a gateway: stones of both of its sides and its arch move."""
    simulation = stand(WallGrammar.parse(GATE).build())
    start = simulation.poses[:, :3].copy()
    simulation.explode((4.5, 0.3, 1.0), 30.0)
    simulation.step(30)
    moved = np.linalg.norm(simulation.poses[:len(start), :3] - start, axis=1) > 0.1
    assert moved.sum() > 40
    assert all(moved[side].any() for side in (start[:, 0] < 4.0, start[:, 0] > 5.0))
