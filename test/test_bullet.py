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

"""PyBullet as the plain reference: what it promises, at any time step."""

from concurrent.futures import ThreadPoolExecutor
import subprocess
import sys

from loose_bricks import at, BRICK, BRICK_MASS, DT, G
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.world import FRICTION, rigid_sum, World

pytest.importorskip('pybullet')

steps = pytest.mark.parametrize('dt', [1 / 30, 1 / 60, 1 / 240])
BALL = np.full(3, 0.2)  # [m]


def dumbbell(world, x=0.0, z=1.0):
    """Add two boxes 2 m apart as one body, whose inertia is not that of the box about it."""
    mass, sizes = np.array([2.0, 2.0]), np.tile([0.2, 0.2, 0.2], (2, 1))
    total = rigid_sum(mass, box_inertia(mass, sizes), np.array([at(x - 1, 0, z), at(x + 1, 0, z)]))
    return world.add_fragment(np.full(2, Shape.BOX), sizes, total.local_poses, total.mass,
                              total.inertia, total.pose)


@pytest.mark.parametrize('place', [0.0, 6e3, 9e5])
def test_level_ground_has_no_end(place):
    """Slide a brick at 3 m/s, near the origin and far from it: it goes as far, v²/2μg."""
    with World(engine='bullet') as world:
        body = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(place, 0.0, 0.5 * BRICK[2]),
                              [3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        for _ in range(60):
            world.step(DT)
        way = world.poses([body])[0, 0] - place
        assert way == pytest.approx(9.0 / (2.0 * FRICTION * G), rel=0.03)


@steps
@pytest.mark.parametrize('restitution', [0.5, 0.8])
def test_balls_bounce_as_high_as_their_restitution_says(dt, restitution):
    """Drop a ball by 0.6 m: it comes up to e² of that."""
    with World(engine='bullet') as world:
        ball = world.add_projectile(Shape.CAPSULE, BALL, 1.0, at(0, 0, 0.7), np.zeros(6),
                                    restitution=restitution ** 2)  # the ground has 1
        heights = []
        for _ in range(round(1.1 / dt)):
            world.step(dt)
            heights.append(world.poses([ball])[0, 2] - 0.1)
        lowest = int(np.argmin(heights[:round(0.6 / dt)]))
        highest = max(heights[lowest:])
        assert highest == pytest.approx(0.6 * restitution ** 2, rel=0.05)


@steps
def test_momentum_stays(dt):
    """Throw a ball into loose bricks and a dumbbell: their momentum is the ball's."""
    with World((0.0, 0.0, 0.0), engine='bullet') as world:
        bodies = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 1 + 0.07 * n))
                  for n in range(4)]
        bodies += [dumbbell(world, 1.5)]
        bodies += [world.add_projectile(Shape.CAPSULE, BALL, 4.0, at(-1, 0.02, 1.1),
                                        [9.0, 0.0, 0.0, 0.0, 0.0, 0.0])]
        for _ in range(round(0.6 / dt)):
            world.step(dt)
        assert np.linalg.norm(world.velocities(bodies[:4]), axis=1).min() > 0.0
        total = world.bodies.mass[bodies] @ world.velocities(bodies)[:, :3]
        np.testing.assert_allclose(total, [36.0, 0.0, 0.0], atol=36e-3)


@steps
@pytest.mark.parametrize('spin', [(0.1, 30.0, 0.1), (50.0, 50.0, 50.0), (0.1, 400.0, 0.1)])
def test_what_spins_wins_no_energy(dt, spin):
    """Spin a box about its middle axis, and about none, at up to 13 rad per 1/30 s."""
    with World((0.0, 0.0, 0.0), engine='bullet') as world:
        box = [world.add_body(Shape.BOX, [0.3, 0.2, 0.1], 5.0, at(0, 0, 9), [0, 0, 0, *spin])]
        energies = []
        for _ in range(100):
            energies.append(motion_energy(np.zeros(1), world.bodies.inertia[box],
                                          world.poses(box)[:, 3:], world.velocities(box))[0])
            world.step(dt)
        assert (np.diff(energies) <= 1e-9 * energies[0]).all()


def test_bodies_move_on_while_others_join():
    """Let a body join that has to take over its inertia first: nothing else is stopped."""
    with World((0.0, 0.0, 0.0), engine='bullet') as world:
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 3, 1), [2, 0, 0, 0, 1, 0])
        world.step(DT)
        dumbbell(world)
        world.step(DT)
        np.testing.assert_allclose(world.poses([brick])[0, :3], [4 * DT, 3, 1], atol=1e-9)
        np.testing.assert_allclose(world.velocities([brick])[0, :3], [2, 0, 0], atol=1e-9)


@pytest.mark.parametrize('held', [False, True])
def test_the_first_blow_turns_a_compound_by_its_own_inertia(held):
    """Hit one end of a dumbbell in the step after it joined, or was woken from a rebuilt world."""
    with World((0.0, 0.0, 0.0), engine='bullet') as world:
        body = dumbbell(world)
        if held:
            world.freeze([body])
            world.rebuild()
            world.thaw([body])
        ball = world.add_projectile(Shape.CAPSULE, BALL, 1.0, at(1, 0, 1.22),
                                    [0, 0, -10.0, 0, 0, 0], restitution=0.0)
        for _ in range(2):
            world.step(DT)
        speed, spin = world.velocities([body])[0, [2, 4]]
        inertia = np.sort(world.bodies.inertia[body])[-1]
        assert speed < -1.0 and world.velocities([ball])[0, 2] > -10.0
        about = rotation.to_matrix(world.poses([body])[0, 3:])
        assert np.abs(about[1]).max() == pytest.approx(1.0)
        assert spin == pytest.approx(-4.0 * speed * 1.0 / inertia, rel=0.02)


def test_compounds_of_many_rods_lie_on_all_of_them():
    """Lay a grid of 24 rods, more than PyBullet's list takes, on two beams."""
    count = 24
    turn = rotation.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(0.5 * np.pi))
    poses = np.array([at(0.1 * n, 0, 0.225, turn) for n in range(count)])
    sizes, mass = np.tile([0.05, 0.05, 1.0], (count, 1)), np.full(count, 1.0)
    total = rigid_sum(mass, np.full((count, 3), 0.08), poses)
    with World(engine='bullet') as world:
        world.add_bricks(np.array([at(0.2, 0, 0.1), at(2.1, 0, 0.1)]),
                         np.tile([0.2, 1.0, 0.2], (2, 1)), np.full(2, 50.0))
        grid = world.add_fragment(np.full(count, Shape.CAPSULE), sizes, total.local_poses,
                                  total.mass, total.inertia, total.pose)
        for _ in range(30):
            world.step(DT)
        assert world.poses([grid])[0, 2] == pytest.approx(0.225, abs=2e-3)
        assert world.wrench(grid)[2] == pytest.approx(count * G, rel=0.02)


def test_contacts_name_those_that_touched_when_others_get_their_handles():
    """Remove what lies on the ground, and add another body: it has none, what is left has its."""
    with World(engine='bullet') as world:
        first = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(x, 0, 0.5 * BRICK[2]))
                 for x in (0.0, 1.0)]
        world.step(DT)
        engine = world._engine
        engine.remove(np.array(first[:1]))
        third = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(2, 0, 1))
        assert set(engine.contacts()[:, :2].ravel().tolist()) == {world.ground, first[1]}
        assert third not in first


def fall(seed):
    """Let boxes and capsules come and go in a world of their own; return what is left."""
    rng = np.random.default_rng(seed)
    with World(engine='bullet') as world:
        bodies = []
        for _ in range(4):
            for shape, size in ((Shape.BOX, BRICK), (Shape.CAPSULE, [0.1, 0.1, 0.4])):
                place = rng.uniform((-0.2, -0.2, 0.3), (0.2, 0.2, 1.0))
                bodies.append(world.add_body(shape, np.array(size), 2.0, at(*place)))
            for _ in range(15):
                world.step(DT)
            world.remove(bodies.pop(0))
        return world.poses(bodies).tobytes(), world.velocities(bodies).tobytes()


def test_worlds_in_several_threads_do_not_disturb_each_other():
    """Make and step worlds in four threads at once: the same to the bit as one by one."""
    seeds = [*range(4)] * 2
    alone = {seed: fall(seed) for seed in set(seeds)}
    assert len(set(alone.values())) == 4
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(fall, seeds)) == [alone[seed] for seed in seeds]


def test_many_moving_bodies_are_told_once(caplog):
    """Let 320 bricks fall in two worlds: one line says which engine is faster."""
    from procphys_ros.physics.world import bullet
    bullet._advise.cache_clear()
    for count in (280, 320, 320):
        with World(engine='bullet') as world:
            for n in range(count):
                world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(n, 0, 50))
            world.step(DT)
            world.step(DT)
        assert len(caplog.messages) == (count > 300)
    assert 'native is faster' in caplog.text


def test_nothing_is_printed():
    """Start an engine in a fresh interpreter: PyBullet's banner is not for users."""
    code = ('from procphys_ros.physics.world import World\n'
            'with World(engine="bullet") as world:\n    world.step(0.01)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ('', '')
