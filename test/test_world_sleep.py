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

"""What sleeps is no wall: islands fall asleep, and wake before anything would move them."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G, heap, rest
import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.physics.world import BodyState, FRICTION, installed_engines, World
from procphys_ros.physics.world.sleeping import SLEEP_TIME

engines = pytest.mark.parametrize('engine', installed_engines())


def run(world, seconds):
    """Step until the time is over."""
    for _ in range(round(seconds / DT)):
        world.step(DT)


def asleep(world, ids):
    """Return whether all of these bodies sleep."""
    return (world.bodies.state[ids] == BodyState.RESTING).all()


def column(world, x, count):
    """Stack bricks on the ground, the lowest first."""
    return [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(x, 0, BRICK[2] * (n + 0.5)))
            for n in range(count)]


def test_dominoes_that_sleep_all_fall():
    """Push the first of twenty that have come to rest, in rows that run along and askew."""
    count, height, pitch = 20, 0.24, 0.13
    for heading in (0.0, 0.6):
        way = np.array([np.cos(heading), np.sin(heading), 0.0])
        turn = (0.0, 0.0, np.sin(0.5 * heading), np.cos(0.5 * heading))
        with World(engine='native') as world:
            ids = [world.add_body(Shape.BOX, np.array([0.05, 0.12, height]), 2.6,
                                  at(*(pitch * n * way)[:2], 0.5 * height, turn))
                   for n in range(count)]
            rest(world)
            world.apply_impulse(ids[0], 2.6 * 0.5 * way,
                                world.poses(ids[:1])[0, :3] + [0.0, 0.0, 0.4 * height])
            for _ in range(30):
                run(world, 0.2)
                upright = 1.0 - 2.0 * np.square(world.poses(ids)[:, 3:5]).sum(axis=1)
                if (upright < 0.95).all():
                    break
            assert (upright < 0.95).all()


@engines
def test_what_slides_into_a_sleeping_equal_shares_its_momentum(engine):
    """Slide a brick at 0.77 m/s into one that rests on ice: momentum is kept within 5 %."""
    with World(friction=0.0, engine=engine) as world:
        target = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0.5, 0, 0.5 * BRICK[2]),
                                friction=0.0)
        rest(world)
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0.2, 0, 0.5 * BRICK[2]),
                               [0.77, 0, 0, 0, 0, 0], friction=0.0)
        run(world, 0.5)
        speed = world.velocities([brick, target])[:, 0]
        assert speed.sum() == pytest.approx(0.77, rel=0.05) and speed[1] > 0.3


@engines
def test_a_brick_that_slides_into_a_sleeping_one_moves_it(engine):
    """Slide a brick at 0.77 m/s on the ground into an equal one that rests: both slide on."""
    with World(engine=engine) as world:
        target = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0.2205, 0, 0.5 * BRICK[2]))
        rest(world)
        world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 0.5 * BRICK[2]),
                       [0.77, 0, 0, 0, 0, 0])
        run(world, 1.0)
        speed = np.sqrt(0.77 ** 2 - 2.0 * FRICTION * G * 0.0055)
        way = (0.5 * speed) ** 2 / (2.0 * FRICTION * G)  # both at half the speed, where they meet
        assert world.poses([target])[0, 0] - 0.2205 == pytest.approx(way, rel=0.3)


@engines
def test_a_blow_goes_through_a_row_that_sleeps(engine):
    """Push a brick at 2 m/s into five on ice, 1 mm apart: none of them is a wall for a step."""
    with World(friction=0.0, engine=engine) as world:
        ids = [world.add_body(Shape.BOX, BRICK, BRICK_MASS,
                              at((BRICK[0] + 0.001) * n, 0, 0.5 * BRICK[2]), friction=0.0)
               for n in range(5)]
        rest(world)
        ids.append(world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(-0.5, 0, 0.5 * BRICK[2]),
                                  [2.0, 0, 0, 0, 0, 0], friction=0.0))
        run(world, 0.5)
        assert world.velocities(ids)[:, 0].sum() == pytest.approx(2.0, rel=0.05)


@engines
def test_a_weight_tips_a_plank_that_sleeps(engine):
    """Set eleven times what tips it down on the end of a plank: not a wall, but a see-saw."""
    with World(engine=engine) as world:
        world.add_bricks(at(0, 0, 0.1)[None], np.array([[0.4, 0.4, 0.2]]), np.array([60.0]))
        plank = world.add_body(Shape.BOX, [2.0, 0.2, 0.05], 10.0, at(0, 0, 0.225))
        rest(world)
        tips = 10.0 * 0.2 / 0.7  # on an arm of 0.7 m about the edge of the block
        weight = world.add_body(Shape.BOX, np.full(3, 0.15), 11.0 * tips, at(0.9, 0, 0.3251))
        run(world, 1.0)
        assert world.poses([weight])[0, 2] < 0.2
        assert np.abs(2.0 * np.arctan2(world.poses([plank])[0, 4],
                                       world.poses([plank])[0, 6])) > 0.1


def test_an_island_sleeps_and_wakes_as_a_whole():
    """Set one of eight stacked bricks free: all of its stack wakes, and none of the other."""
    with World(engine='native') as world:
        one, other = column(world, 0.0, 8), column(world, 1.0, 8)
        moves = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(1.0, 0, 8.5 * BRICK[2]),
                               [0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
        run(world, SLEEP_TIME + 2 * DT)
        states = world.bodies.state
        assert asleep(world, one)
        assert len(set(states[other + [moves]].tolist())) == 1
        rest(world)
        world.thaw([one[5]])
        assert (world.bodies.state[one] == BodyState.AWAKE).all() and asleep(world, other)


@engines
def test_what_sleeps_keeps_its_pose_to_the_bit(engine):
    """Let bricks fall beside a stack that sleeps: not a bit of it changes."""
    with World(engine=engine) as world:
        ids = column(world, 0.0, 3)
        rest(world)
        before = world.poses(ids).copy()
        heap(world, 0, 2, 12)
        world.set_poses(world.awake, world.poses(world.awake) + [2, 0, 0, 0, 0, 0, 0])
        run(world, 2.0)
        np.testing.assert_array_equal(world.poses(ids), before)
        assert asleep(world, ids)


@pytest.mark.parametrize(('share', 'wakes'), [(0.05, False), (0.3, True)])
def test_a_change_of_load_wakes_when_it_is_a_tenth(share, wakes):
    """Lay a pebble, and a heavier one, on a brick that sleeps: the first one wakes nothing."""
    with World(engine='native') as world:
        brick = column(world, 0.0, 1)
        rest(world)
        world.add_body(Shape.BOX, np.full(3, 0.04), share * BRICK_MASS,
                       at(0.0, 0.0, BRICK[2] + 0.02))
        woken = False
        for _ in range(30):
            world.step(DT)
            woken |= not asleep(world, brick)
        assert woken == wakes


@engines
@pytest.mark.parametrize('how', ['removed', 'moved'])
def test_taking_away_one_of_the_supports_wakes(engine, how):
    """Let a slab lie on four bricks, then take one away, or push it out: the slab tips over."""
    with World(engine=engine) as world:
        low = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(x, y, 0.5 * BRICK[2]))
               for x in (-0.4, 0.4) for y in (-0.4, 0.4)]
        slab = world.add_body(Shape.BOX, [1.1, 1.1, 0.1], 50.0, at(0.1, 0.1, BRICK[2] + 0.05))
        rest(world)
        if how == 'removed':
            world.remove(low[-1:])
        else:
            world.thaw(low[-1:])
            world.set_poses(low[-1:], world.poses(low[-1:]) + [1.0, 1.0, 0, 0, 0, 0, 0])
        run(world, 2.0)
        assert np.linalg.norm(world.poses([slab])[0, 3:5]) > 0.02


@pytest.mark.parametrize(('share', 'slides'), [(0.99, False), (1.01, True)])
def test_a_slope_at_the_limit_of_friction(share, slides):
    """Lay a brick on a slope 1 % too steep: it starts slowly, yet never falls asleep."""
    angle = np.arctan(share * FRICTION)
    with World((G * np.sin(angle), 0.0, -G * np.cos(angle)), engine='native') as world:
        brick = column(world, 0.0, 1)
        run(world, 2.0)
        free = 2.0 * G * (np.sin(angle) - FRICTION * np.cos(angle))
        if slides:
            assert world.poses(brick)[0, 0] == pytest.approx(free, rel=0.1)
        else:
            assert asleep(world, brick) and abs(world.poses(brick)[0, 0]) < 1e-3


@engines
def test_a_heap_that_sleeps_is_restored_asleep(engine):
    """Save a heap at rest and restore it: it stays to the bit, and wakes on the same blow."""
    with World(engine=engine) as world:
        ids = heap(world, 3, 2, 12)
        rest(world)
        world.rebuild()
        with World.restore(world.save_state(), engine) as copy:
            before = world.poses(ids).copy()
            run(copy, 1.0)
            np.testing.assert_array_equal(copy.poses(ids), before)
            np.testing.assert_array_equal(copy.asleep.body_a, world.asleep.body_a)
            for each in (world, copy):
                each.apply_impulse(ids[0], [5.0, 1.0, 0.0])
                run(each, 0.5)
            np.testing.assert_array_equal(copy.poses(ids), world.poses(ids))
            assert np.abs(copy.poses(ids) - before).max() > 0.03
