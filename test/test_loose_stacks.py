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

"""Loose stacks at the default time step stand and fall as statics says, with every engine."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G, heap, nudged, rest
from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.blueprint import Hexahedra, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.air import AIR_DENSITY, CUBE_DRAG
from procphys_ros.physics.world import BodyState, FRICTION, installed_engines, World
from procphys_ros.physics.world.rolling import ROLLING
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.fragments import holding_wind

engines = pytest.mark.parametrize('engine', installed_engines())
exact = pytest.mark.parametrize('engine', [name for name in installed_engines()
                                           if name != 'bullet'])  # see docs/limits.md


def run(world, seconds):
    """Step until the time is over."""
    for _ in range(round(seconds / DT)):
        world.step(DT)


def moved(world, ids, seconds):
    """Run a world and compute the largest displacement of the centre of any body [m]."""
    start = world.poses(ids)[:, :3].copy()
    run(world, seconds)
    return np.linalg.norm(world.poses(ids)[:, :3] - start, axis=1).max()


def voussoir(low, high, inner, outer, width):
    """Compute corners in its own frame (24,), size, centre (2,), area and lean of a voussoir."""
    points = np.array([[radius * np.cos(angle), radius * np.sin(angle)]
                       for angle, radius in ((high, inner), (low, inner), (high, outer),
                                             (low, outer))])
    x, y = points[[1, 3, 2, 0]].T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * cross.sum()
    centre = np.array([((x + np.roll(x, -1)) * cross).sum(),
                       ((y + np.roll(y, -1)) * cross).sum()]) / (6.0 * area)
    middle = 0.5 * (low + high)
    across = np.array([np.sin(middle), -np.cos(middle)])
    up = np.array([np.cos(middle), np.sin(middle)])
    flat = (points - centre) @ np.column_stack([across, up])
    corners = np.array([[flat[(i & 1) + (i >> 2) * 2, 0], width * ((i >> 1 & 1) - 0.5),
                         flat[(i & 1) + (i >> 2) * 2, 1]] for i in range(8)])
    return corners, 2.0 * np.abs(corners).max(axis=0), centre, area, 0.5 * np.pi - middle


def arch(engine, ratio, count=24, width=0.3, foot=0.5):
    """Set up a loose semicircle of mean radius 1 m on fixed blocks; see how it goes [m]."""
    with World(engine=engine) as world:
        world.add_bricks(np.array([at(-1, 0, 0.5 * foot), at(1, 0, 0.5 * foot)]),
                         np.tile([0.6, 0.6, foot], (2, 1)), np.full(2, 400.0))
        ids = []
        for low in np.pi * np.arange(count) / count:
            corners, size, centre, area, lean = voussoir(
                low, low + np.pi / count, 1.0 - 0.5 * ratio, 1.0 + 0.5 * ratio, width)
            turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array(lean))
            ids.append(world.add_body(
                Shape.BOX, size, 2000.0 * area * width, at(centre[0], 0, foot + centre[1], turn),
                hexahedra=Hexahedra(np.zeros(1, np.int32), corners.reshape(1, 24))))
        return moved(world, ids, 2.0)


@exact
def test_a_loose_arch_stands_down_to_its_least_thickness(engine):
    """Set up 24 voussoirs of t/R 0.13 and 0.10; limit analysis has 0.1075 (Milankovitch)."""
    assert arch(engine, 0.13) < 0.02
    assert arch(engine, 0.10) > 0.2


@engines
def test_many_posts_carry_a_slab(engine):
    """Put 3 t on 49 loose posts of two bricks each: they stand, and none is squeezed away."""
    grid = 0.3 * np.stack(np.meshgrid(np.arange(7), np.arange(7)), axis=-1).reshape(-1, 2)
    heading = np.random.default_rng(0).uniform(0.0, np.pi, 2 * len(grid))
    with World(engine=engine) as world:
        for k, place in enumerate(np.repeat(grid, 2, axis=0)):
            turn = rotation.from_axis_angle(np.array([0, 0, 1.0]), heading[k])
            world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(*place, 0.033 + 0.066 * (k % 2), turn))
        slab = world.add_body(Shape.BOX, [2.2, 2.2, 0.2], 3000.0, at(0.9, 0.9, 0.242))
        rest(world, 5.0)
        assert world.poses([slab])[0, 2] == pytest.approx(0.1 + 2 * BRICK[2], abs=0.003)


@engines
def test_a_ball_rolls_to_a_stop(engine):
    """Roll a ball at 1 m/s: v² / 2a with a = 5/7 g · lever / r, and no boxes are held by it."""
    radius, speed = 0.1, 1.0
    with World(engine=engine) as world:
        ball = world.add_body(Shape.CAPSULE, np.full(3, 2.0 * radius), 5.0, at(0, 0, radius),
                              [speed, 0, 0, 0, speed / radius, 0])
        run(world, 4.0)
        want = 0.5 * speed ** 2 / (5.0 / 7.0 * G * ROLLING / radius)
        assert world.poses([ball])[0, 0] == pytest.approx(want, rel=0.03)
        assert not len(world.awake)


@engines
def test_settled_rubble_hardly_overlaps(engine):
    """Drop 150 bricks: they lie still before 10 s are over, and overlap by 1 cm at most."""
    with World(engine=engine) as world:
        ids = heap(world, 0, 5, 150)
        for _ in range(600):
            world.step(DT)
            if not len(world.awake):
                break
        assert (world.bodies.state[ids] == BodyState.RESTING).all()
        world.thaw(np.array(ids))
        world.step(1e-4)
        assert world.contacts().distance.min() > -0.01


@exact
def test_a_slab_on_bricks_lies_still_and_squeezes_none_into_others(engine):
    """
    Drop 3 t on 20 bricks: at rest within 4 s, with overlaps of 1 cm at most.

    Twenty nudged runs are at rest by 1.9 s and overlap by up to 0.5 cm.
    """
    for seed in range(2):
        with World(nudged(seed), engine=engine) as world:
            ids = heap(world, 0, 4, 20)
            turn = rotation.from_axis_angle(np.array([0, 1.0, 0]), np.array(0.1))
            ids.append(world.add_body(Shape.BOX, [2.0, 2.0, 0.3], 3000.0,
                                      at(0.5, 0.3, 1.4, turn)))
            rest(world, 4.0)
            world.thaw(np.array(ids))
            world.step(1e-4)
            assert world.contacts().distance.min() > -0.01


def test_wind_that_holds_and_wind_that_does_not():
    """Compare the wind that slides a cube, and tips a slab, with the balance of forces."""
    bounds = np.array([[0, 0, 0, 0.2, 0.2, 0.2], [0, 0, 0, 2.0, 0.1, 1.0]])
    got = holding_wind(np.array([80.0, 4000.0]), np.full(2, FRICTION), bounds,
                       np.array([0.05, 2.4]))
    want = np.sqrt([80.0 * FRICTION / (0.5 * AIR_DENSITY * 0.05),
                    4000.0 * 0.1 / (0.5 * AIR_DENSITY * 2.4)])
    np.testing.assert_allclose(got, want)


def test_rubble_wakes_in_a_storm_but_not_in_a_breeze():
    """Let a light box come to rest: 5 m/s leave it where it is, 60 m/s carry it off."""
    simulation = Simulation(Scene(Settings()))
    box = simulation.launch(Projectile('box', 0.4, 2.0, (0.0, 0.0, 0.25), (0.0, 0.0, 0.0)))
    simulation.step(90)
    assert not len(simulation.state.world.awake)
    place = simulation.poses[box].copy()
    simulation.set_wind([5.0, 0.0, 0.0])
    simulation.step(30)
    np.testing.assert_array_equal(simulation.poses[box], place)
    simulation.set_wind([60.0, 0.0, 0.0])
    simulation.step(60)
    assert simulation.poses[box, 0] > place[0] + 0.5


def test_wind_blows_on_the_outside_of_a_piece_of_wall():
    """Let a cube of 125 bonded blocks fall in a storm: it is pushed like one block of its size."""
    edge = 0.2 * np.arange(5)
    built = bonded(np.stack(np.meshgrid(edge, edge, edge), -1).reshape(-1, 3), (0.2, 0.2, 0.2),
                   ground=False)
    scene = Scene.from_parameters({'scene': {'objects': []}, 'wind': {
        'velocity': [40.0, 0.0, 0.0], 'profile': 'uniform', 'turbulence_intensity': 0.0}})
    scene.add(built, (0.0, 0.0, 5.0), 0.3, 'cube')
    simulation = Simulation(scene)
    simulation.step()
    force = 0.5 * AIR_DENSITY * CUBE_DRAG * 1.5 * 40.0 ** 2
    assert simulation.velocities[0, 0] == pytest.approx(
        force / built.mass.sum() * simulation.time_step, rel=0.01)
