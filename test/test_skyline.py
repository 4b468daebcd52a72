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


"""Skyline: leaves and dust come down on roofs, stop at walls, and fall on when these are gone."""

from masonry_walls import bonded, BRICK
import numpy as np
import pytest

from procphys_ros.physics.dust import DustCloud, State
from procphys_ros.physics.foliage import FallingLeaves
from procphys_ros.physics.skyline import height_at, Skyline
from procphys_ros.scene import Scene
from procphys_ros.simulation import particles, Simulation
from procphys_ros.simulation.parts import Owner

STEP = 1.0 / 60.0
HOUSE = np.array([[-3.0, -2.0, 0.0, 3.0, 2.0, 5.0]])
EDGE = 0.25  # [m] of a cell: what stands is so much wider for leaves


def leaves_at(points):
    """Release leaves at some points."""
    falling = FallingLeaves(9.81, 1)
    pose = np.hstack([points, np.tile([0.0, 0.0, 0.0, 1.0], (len(points), 1))])
    falling.let_go(np.arange(len(points)), pose, np.zeros((len(points), 3)),
                   np.full(len(points), 0.1))
    return falling


def over_house(count, height, reach=6.0, seed=0):
    """Scatter points over a square around the house, at one height."""
    place = np.random.default_rng(seed).uniform(-reach, reach, (count, 2))
    return np.column_stack([place, np.full(count, height)])


def on_house(points, room=0.0):
    """Mark the points above or inside the ground plan of the house."""
    return ((np.abs(points[:, 0]) < 3.0 + room) & (np.abs(points[:, 1]) < 2.0 + room))


def test_heights_are_those_of_the_boxes():
    """Compare every place with the highest of all boxes that reach into its cell."""
    rng = np.random.default_rng(1)
    low = rng.uniform(-8.0, 6.0, (40, 2))
    bounds = np.column_stack([low, np.zeros(40), low + rng.uniform(0.1, 3.0, (40, 2)),
                              rng.uniform(0.5, 9.0, 40)])
    skyline = Skyline.over(bounds)
    for x, y in rng.uniform(-10.0, 10.0, (500, 2)):
        corner = skyline.low + EDGE * np.floor((np.array([x, y]) - skyline.low) / EDGE)
        meets = ((bounds[:, :2] < corner + EDGE) & (bounds[:, 3:5] >= corner)).all(axis=1)
        assert height_at(skyline, x, y) == bounds[meets, 5].max(initial=0.0)


def test_leaves_come_to_rest_on_a_roof():
    """Lie on the roof where there is one below, and on the ground beside it."""
    start = over_house(400, 9.0)
    falling = leaves_at(start)
    skyline = Skyline.over(HOUSE)
    for _ in range(900):
        falling.step(np.flatnonzero(falling.flying), np.zeros((falling.flying.sum(), 3)), STEP,
                     skyline)
    assert not falling.flying.any()
    height = falling.poses[:, 2]
    assert height[on_house(start)] == pytest.approx(5.01)
    assert height[~on_house(start, EDGE)] == pytest.approx(0.01)


def test_leaves_do_not_fly_through_walls():
    """Stop at the windward wall, fall down along it, and never be inside the house."""
    points = np.random.default_rng(2).uniform((-9.0, -1.5, 1.0), (-6.0, 1.5, 3.0), (300, 3))
    falling, free = leaves_at(points), leaves_at(points)
    skyline = Skyline.over(HOUSE)
    for _ in range(600):
        for leaves, obstacles in ((falling, (skyline,)), (free, ())):
            rows = np.flatnonzero(leaves.flying)
            leaves.step(rows, np.tile([12.0, 0.0, 0.0], (len(rows), 1)), STEP, *obstacles)
        inside = on_house(falling.poses) & (falling.poses[:, 2] < 5.0)
        assert not inside.any()
    assert (np.abs(falling.poses[:, 0] + 3.0) < 2.0 * EDGE).mean() > 0.9
    assert (free.poses[:, 0] > -2.0).mean() > 0.9


def test_leaves_fly_on_when_a_roof_is_gone():
    """Lift what lay on it, and nothing else."""
    start = over_house(200, 5.5)
    falling = leaves_at(start)
    skyline = Skyline.over(HOUSE)
    for _ in range(600):
        falling.step(np.flatnonzero(falling.flying), np.zeros((falling.flying.sum(), 3)), STEP,
                     skyline)
    falling.lift(skyline)
    assert not falling.flying.any()
    lay_high = falling.poses[:, 2] > 1.0
    falling.lift(Skyline.over(HOUSE[:0]))
    assert np.array_equal(falling.flying, lay_high) and lay_high.any() and not lay_high.all()


def test_dust_settles_on_a_roof_and_stays_outside():
    """Lay dust on top of a house, and let turbulence carry none of it inside."""
    cloud = DustCloud(20_000, 1)
    cloud.raise_dust(np.array([[0.0, 0.0, 5.5]]), np.array([0.3]), np.array([1e6]))
    cloud.position[:, 2] = np.maximum(cloud.position[:, 2], 5.2)
    rows = cloud.state == State.AIRBORNE
    skyline = Skyline.over(HOUSE)
    for _ in range(900):
        cloud.step(STEP, np.zeros_like, skyline)
        place = cloud.position[rows]
        assert not (on_house(place) & (place[:, 2] < 5.0 - 1e-9)).any()
    lies = cloud.state == State.LYING
    assert np.count_nonzero(lies) > 20
    assert cloud.position[lies & on_house(cloud.position), 2] == pytest.approx(5.0)
    cloud.lift(Skyline.over(HOUSE[:0]))
    assert np.count_nonzero(cloud.state == State.LYING) < 0.5 * np.count_nonzero(lies)


def test_the_skyline_follows_what_stands():
    """Draw a wall as high as it is, the same object until bricks are torn out, lower then."""
    scene = Scene()
    centres = np.array([[0.225 * i, 0.0, 0.0325 + 0.075 * j] for i in range(9) for j in range(10)])
    scene.add(bonded(centres, BRICK), name='wall')
    simulation = Simulation(scene)
    model, state = simulation.model, simulation.state
    whole = particles.current_skyline(model, state)
    top = BRICK[2] / 2.0 + 0.0325 + 0.075 * 9
    assert height_at(whole, 0.9, 0.0) == pytest.approx(top)
    simulation.step(40)
    assert particles.current_skyline(model, state) is whole
    state.parts.owner[centres[:, 2] > 0.4] = Owner.GONE
    state.time += 0.3
    drawn = particles.current_skyline(model, state)
    assert height_at(drawn, 0.9, 0.0) == pytest.approx(BRICK[2] / 2.0 + 0.0325 + 0.075 * 4)
