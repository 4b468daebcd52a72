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

"""What bonds could not transmit is taken back: no momentum is lost, and no energy won."""

import numpy as np
import pytest

from procphys_ros.blueprint import Shape
from procphys_ros.geometry import rotation
from procphys_ros.physics.kinetic import free_spins, motion_energy
from procphys_ros.physics.world import World
from procphys_ros.physics.world.pieces import single
from procphys_ros.physics.world.returned_impulses import Begun, give_back

_STEP = 1.0 / 60.0  # [s]


def energy(bodies):
    """Compute the kinetic energy of all bodies [J]."""
    return motion_energy(bodies.mass[1:], bodies.inertia[1:], bodies.poses[1:, 3:],
                         bodies.velocities[1:]).sum()


def flung_together(rng):
    """Throw rods and blocks of grams to tonnes at each other, some of them spinning fast."""
    world = World(gravity=(0.0, 0.0, 0.0), engine='native')
    for _ in range(30):
        size = np.exp(rng.uniform(np.log(0.03), np.log(0.6), 3))
        place = rng.uniform(-0.8, 0.8, 3) + [0.0, 0.0, 9.0]
        turn = rng.normal(size=4)
        motion = np.concatenate([-4.0 * (place - [0.0, 0.0, 9.0]), rng.normal(size=3) * 20.0])
        world.add_body(Shape.BOX, size, 2000.0 * size.prod() * np.exp(rng.normal()),
                       np.concatenate([place, turn / np.linalg.norm(turn)]), motion)
    return world


@pytest.mark.parametrize('seed', range(3))
def test_books_are_kept_whatever_is_taken_back(seed):
    """Take back any shares of what bodies gave each other: momentum stays, no energy is won."""
    rng = np.random.default_rng(seed)
    world, taken = flung_together(rng), 0.0
    with world:
        bodies = world.bodies
        for _ in range(25):
            start = Begun(bodies.poses.copy(), bodies.velocities.copy())
            before = energy(bodies)
            momentum = bodies.mass[1:] @ bodies.velocities[1:, :3]
            world.step(_STEP)
            stopped = energy(bodies)
            share = np.where(rng.random(len(bodies.mass)) < 0.3, rng.random(len(bodies.mass)), 1.0)
            given = bodies.velocities[:, :3] - start.velocities[:, :3]
            left = give_back(world, world.contacts(), start, _STEP, share)
            assert stopped < before * (1.0 + 1e-6)
            assert energy(bodies) < before * (1.0 + 1e-6)
            np.testing.assert_allclose(bodies.mass[1:] @ bodies.velocities[1:, :3], momentum,
                                       atol=1e-9 * bodies.mass[1:].sum())
            told = world.contacts().both_ways()
            kept = np.zeros((len(bodies.mass), 3))
            np.add.at(kept, told.body_a, np.concatenate([left[:, :3], -left[:, :3]]))
            np.testing.assert_allclose(
                bodies.mass[1:, None] * (bodies.velocities - start.velocities)[1:, :3], kept[1:],
                atol=1e-6 * bodies.mass[1:].max())
            taken += np.abs(bodies.velocities[:, :3] - start.velocities[:, :3] - given).sum()
    assert taken > 10.0  # [m/s]


def test_what_is_free_spins_on_with_its_angular_momentum():
    """Turn bodies: the moment that their new spins have is the one of before."""
    rng = np.random.default_rng(3)
    inertia, spin = rng.uniform(0.01, 2.0, (9, 3)), rng.normal(size=(9, 3))
    attitudes = rng.normal(size=(2, 9, 4))
    attitudes /= np.linalg.norm(attitudes, axis=2)[..., None]

    def momentum(attitude, motion):
        own = rotation.rotate(rotation.conjugate(attitude), motion)
        return rotation.rotate(attitude, inertia * own)
    found = free_spins(inertia, *attitudes, spin)
    np.testing.assert_allclose(momentum(attitudes[1], found), momentum(attitudes[0], spin),
                               rtol=1e-12, atol=1e-12)


def test_what_still_has_support_stays_up():
    """Let one of two posts under a falling slab break: the other one stops its end of the slab."""
    with World(engine='native') as world:
        whole, weak = (world.add_body(Shape.BOX, np.full(3, 0.2), 16.0,
                                      np.array([x, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]))
                       for x in (-0.9, 0.9))
        slab = world.add_body(Shape.BOX, np.array([2.2, 0.4, 0.1]), 176.0,
                              np.array([0.0, 0.0, 0.252, 0.0, 0.0, 0.0, 1.0]),
                              np.array([0.0, 0.0, -3.0, 0.0, 0.0, 0.0]))
        start = Begun(world.bodies.poses.copy(), world.bodies.velocities.copy())
        world.step(1.0 / 240.0)
        share = np.ones(len(world.bodies.mass))
        share[weak] = 0.1
        contacts = world.contacts()
        left = give_back(world, contacts, start, 1.0 / 240.0, share)
        motion = world.bodies.velocities
        ends = [motion[slab, 2] - x * motion[slab, 4] for x in (-0.8, 0.8)]
        assert ends[0] > -0.5  # [m/s]; -2.7 if a share of 0.1 held for all that the slab touches
        assert ends[1] < -1.0
        assert np.abs(motion[whole, :3]).max() < 0.3
        on_weak = (contacts.body_a == weak) | (contacts.body_b == weak)
        assert left[on_weak, 3] == pytest.approx(0.1 * contacts.normal_impulse[on_weak])


def test_what_is_driven_pushes_on():
    """Drive a plate against two blocks of which the second breaks: the first keeps its push."""
    with World(gravity=(0.0, 0.0, 0.0), engine='native') as world:
        plate = world.add_driven(single(Shape.BOX, np.full(3, 0.2)),
                                 np.array([-0.2, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
        whole, weak = (world.add_body(Shape.BOX, np.full(3, 0.2), 10.0,
                                      np.array([x, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
                       for x in (0.0, 0.2))
        world.drive(plate, np.array([-0.19, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))
        start = Begun(world.bodies.poses.copy(), world.bodies.velocities.copy())
        world.step(1.0 / 240.0)
        share = np.ones(len(world.bodies.mass))
        share[weak] = 0.1
        pushed = world.bodies.velocities[whole, 0]
        give_back(world, world.contacts(), start, 1.0 / 240.0, share)
        assert pushed > 2.0  # [m/s]; the plate has 2.4
        assert world.bodies.velocities[whole, 0] == pytest.approx(pushed, abs=0.1)
        assert world.bodies.velocities[weak, 0] < 0.2 * pushed
