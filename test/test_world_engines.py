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

"""What every engine that is installed must do alike: closed forms of bodies in contact."""

from loose_bricks import at, BRICK, BRICK_MASS, DT, G, heap
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.physics.world import BodyState, FRICTION, installed_engines, World
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.simulation import Simulation

pytestmark = pytest.mark.parametrize('engine', installed_engines())


def run(world, steps):
    """Step `steps` times."""
    for _ in range(steps):
        world.step(DT)


def slid(engine, slope):
    """Measure the slide of a brick in 2 s down a slope of this tangent [m]; gravity is turned."""
    angle = np.arctan(slope)
    with World((G * np.sin(angle), 0.0, -G * np.cos(angle)), engine=engine) as world:
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 0.5 * BRICK[2]))
        run(world, 120)
        return world.poses([brick])[0, 0]


def test_bricks_slide_above_the_friction_angle_only(engine):
    """Put a brick on slopes 2 % below and above the coefficient of friction: it never rests."""
    assert slid(engine, 0.98 * FRICTION) < 1e-3
    angle = np.arctan(1.02 * FRICTION)
    free = 2.0 * G * (np.sin(angle) - FRICTION * np.cos(angle))
    assert slid(engine, 1.02 * FRICTION) == pytest.approx(free, rel=0.1)  # 0.2 % of friction


@pytest.mark.parametrize('restitution', [0.0, 0.3, 0.6])
def test_balls_part_with_their_restitution(engine, restitution):
    """Let two balls collide: they part with the stated share of their speed, momentum kept."""
    with World((0.0, 0.0, 0.0), engine=engine) as world:
        balls = [world.add_projectile(Shape.CAPSULE, np.full(3, 0.2), mass, at(x, 0, 1),
                                      [speed, 0, 0, 0, 0, 0], restitution=restitution)
                 for mass, x, speed in ((1.0, 0.0, 5.0), (2.0, 1.0, 0.0))]
        run(world, 40)
        first, second = world.velocities(balls)[:, 0]
        assert second - first == pytest.approx(5.0 * restitution, abs=0.01)
        assert first + 2.0 * second == pytest.approx(5.0, rel=1e-5)


def test_contacts_of_what_is_replaced_are_those_of_its_heirs(engine):
    """Replace a bar by its two halves while it lands: each has the contacts that are its own."""
    bar, halves, seen = np.array([0.4, 0.1, 0.1]), [], []
    with World(engine=engine) as world:
        body = world.add_body(Shape.BOX, bar, 8.0, at(0, 0, 0.052), [0, 0, -1.0, 0, 0, 0])

        def look(rows, poses, velocities, duration):
            if halves or not (rows[:, 12] > 0.0).any():
                return
            seen.append(rows[rows[:, 12] > 0.0])
            halves.extend(world.add_body(Shape.BOX, bar * [0.5, 1, 1], 4.0,
                                         at(x, 0, world.poses([body])[0, 2])) for x in (-0.1, 0.1))
            world.replace(np.array([body, body]), np.array(halves))
        world.step(DT, looked=look)
        contacts = world.contacts()
        assert len(seen[0]) >= 4 and body not in (*contacts.body_a, *contacts.body_b)
        for half, side in zip(halves, (-1.0, 1.0)):
            own = (contacts.body_a == half) | (contacts.body_b == half)
            assert own.sum() >= 2 and (side * contacts.point[own, 0] > -1e-3).all()
        told = np.concatenate([contacts.impulse[contacts.body_a > 0, 2],
                               -contacts.impulse[contacts.body_b > 0, 2]])
        assert abs(told.sum()) > 4.0  # of the 8 N·s that stop the bar


def test_the_first_contact_turns_by_the_inertia_that_was_given(engine):
    """Slide a ball with the inertia of a wide disc: friction turns it as that from the start."""
    mass, radius, moment, speed = 400.0, 0.01, 80.0, 1.0
    with World(engine=engine) as world:
        ball = world.add_body(Shape.CAPSULE, np.full(3, 2 * radius), mass, at(0, 0, radius),
                              [speed, 0, 0, 0, 0, 0], np.full(3, moment))
        for _ in range(3):
            world.step(DT)
            velocity = world.velocities([ball])[0]
            assert abs(velocity[4]) <= 1.01 * mass * (speed - velocity[0]) * radius / moment + 1e-9
        assert velocity[0] < 0.99 * speed and velocity[4] > 0.0


def test_the_ground_takes_the_root_of_the_restitution(engine):
    """Throw a ball at the ground, whose own restitution is one."""
    with World(engine=engine) as world:
        ball = world.add_projectile(Shape.CAPSULE, np.full(3, 0.4), 1.0, at(0, 0, 1.3),
                                    [0, 0, -10, 0, 0, 0], restitution=0.25)
        speeds = []
        for _ in range(20):
            world.step(DT)
            speeds.append(world.velocities([ball])[0, 2])
        assert max(speeds) / -min(speeds) == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize(('overhang', 'stands'), [(0.495, True), (0.505, False)])
def test_a_corbelled_brick_stands_up_to_half_its_length(engine, overhang, stands):
    """Lay a loose brick over the end of a fixed one."""
    with World(engine=engine) as world:
        world.add_bricks(at(0, 0, 0.0325)[None], BRICK[None], np.array([BRICK_MASS]))
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(overhang * BRICK[0], 0, 0.0975))
        run(world, 180)
        assert (world.poses([brick])[0, 2] > 0.095) == stands


def test_contacts_tell_all_that_changes_the_motion(engine):
    """
    Let three bricks tumble onto each other: in every step contacts and weight move each brick.

    Bullet leaves friction where a contact let go.
    """
    rng = np.random.default_rng(1)
    with World(engine=engine) as world:
        turn = rng.normal(size=(3, 4))
        bricks = [world.add_body(
            Shape.BOX, BRICK, BRICK_MASS, at(0.05 * n, 0, 0.2 + 0.15 * n, each),
            [1.0, 0.3, 0.0, 3.0, 2.0, 1.0])
            for n, each in enumerate(turn / np.linalg.norm(turn, axis=1)[:, None])]
        for _ in range(60):
            before = world.velocities(bricks)[:, :3]
            world.step(DT)
            told = [world.contacts().on(brick)[2].sum(axis=0) for brick in bricks]
            change = world.velocities(bricks)[:, :3] - before + [0.0, 0.0, G * DT]
            moves = world.bodies.state[bricks] == BodyState.AWAKE
            np.testing.assert_allclose(np.array(told)[moves], BRICK_MASS * change[moves],
                                       atol=1e-4)


def test_contacts_tell_what_turns_bodies_that_fly(engine):
    """Let two bricks meet off centre at 12 m/s: contacts lie where the bricks were, 0.2 m back."""
    with World((0.0, 0.0, 0.0), engine=engine) as world:
        inertia = box_inertia(np.array([BRICK_MASS]), BRICK[None])[0]
        bricks = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(*place),
                                 [12.0, speed, 0.0, 0.0, 0.0, 0.0])
                  for place, speed in (((0, 0, 1), 0.5), ((0.15, 0.13, 1), -0.5))]
        while not len(world.contacts()):
            world.step(DT)
            assert world.poses(bricks)[0, 0] < 3.0
        for brick in bricks:
            spin = world.velocities([brick])[0, 5]
            assert abs(spin) > 1.0
            assert world.wrench(brick)[5] * DT == pytest.approx(inertia[2] * spin, rel=0.1)


def test_contacts_of_a_step_stay_those_when_bodies_are_moved(engine):
    """Move, turn and stop what touches: its contacts were read late when nobody asked before."""
    with World(engine=engine) as world:
        bodies, most = heap(world, 2, 2, 12), 0
        for _ in range(60):
            world.step(DT)
            before = world._engine.contacts()
            poses, velocities = world.poses(bodies), world.velocities(bodies)
            world.set_poses(bodies, poses[::-1])
            world.set_velocities(bodies, velocities[::-1])
            np.testing.assert_array_equal(world._engine.contacts(), before)
            world.set_poses(bodies, poses)
            world.set_velocities(bodies, velocities)
            most = max(most, len(before))
        assert most > 20


def test_what_loses_its_support_tells_the_contacts_of_that_step(engine):
    """Pull the lower of two bricks away: the upper one is set free, and has rubbed on it."""
    with World(engine=engine) as world:
        low, high = (world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, (n + 0.5) * BRICK[2]))
                     for n in range(2))
        run(world, 120)
        assert (world.bodies.state[[low, high]] == BodyState.RESTING).all()
        world.apply_impulse(low, [2.0 * BRICK_MASS, 0.0, 0.0])
        world.step(DT)
        assert world.bodies.state[high] == BodyState.AWAKE
        others, _, impulses = world.contacts().on(high)
        assert set(others.tolist()) == {low} and impulses[:, 2].sum() > 0.0


def test_what_spins_keeps_what_a_blow_gave_it_early_in_a_step(engine):
    """Hit a spinning rod with a ball while bricks have the step divided: no momentum goes."""
    with World(engine=engine) as world:
        for i in range(2):
            world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(5.0 + i, 0.0, 0.5 * BRICK[2]))
        rod = world.add_body(Shape.CAPSULE, np.array([0.02, 0.02, 0.15]), 0.1, at(0, 0, 1),
                             [0.0, 0.0, 0.0, 0.0, 100.0, 0.0], restitution=0.95)
        ball = world.add_body(Shape.CAPSULE, np.full(3, 0.1), 5.0, at(-0.065, 0, 1),
                              [8.0, 0.0, 0.0, 0.0, 0.0, 0.0], restitution=0.95)
        run(world, 2)
        speed = world.velocities([rod, ball])[:, 0]
        assert speed[0] > 12.0 and speed @ [0.1, 5.0] == pytest.approx(8.0 * 5.0, rel=2e-3)


def test_a_scene_may_choose_its_engine(engine):
    """Name the engine in a scene or for a simulation; refuse others in one line."""
    with pytest.raises(SceneError, match="is 'jolt', it must be one of auto, bullet, native"):
        Settings(engine='jolt')
    scene = Scene.from_parameters({'scene': {'objects': []}, 'engine': engine})
    for simulation in (Simulation(scene), Simulation(Scene(), engine=engine)):
        assert simulation.state.world.engine == engine
        simulation.close()


def test_bricks_that_join_after_others_were_removed_are_where_they_belong(engine):
    """Remove every other brick of a row and add another row: the engine has each at its place."""
    with World(engine=engine) as world:
        def row(y):
            return np.array([at(0.3 * i, y, 0.5 * BRICK[2]) for i in range(8)])
        size, mass = np.tile(BRICK, (8, 1)), np.full(8, BRICK_MASS)
        first = world.add_bricks(row(0.0), size, mass)
        world.remove(first[::2])
        second = world.add_bricks(row(5.0), size, mass)
        bounds = world.bounds(second)
        np.testing.assert_allclose(0.5 * (bounds[:, :3] + bounds[:, 3:]), row(5.0)[:, :3],
                                   atol=1e-6)
        world.thaw(second, np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (8, 1)))
        world.step(DT)
        assert (world.poses(second)[:, 2] > 0.5 * BRICK[2]).all()
        np.testing.assert_array_equal(world.poses(first[1::2]), row(0.0)[1::2])


def test_bricks_hold_what_falls_on_them_in_the_step_that_they_join(engine):
    """Lay a floor of 900 bricks under falling ones, and build the engine anew: none falls in."""
    with World(engine=engine) as world:
        poses = np.array([at(0.25 * i, 0.12 * j, 1.0) for i in range(30) for j in range(30)])
        loose = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(x, y, 1.0 + 1.05 * BRICK[2]))
                 for x, y in ((0.0, 0.0), (7.25, 3.48), (3.5, 1.8))]
        floor = world.add_bricks(poses, np.tile(BRICK, (900, 1)), np.full(900, BRICK_MASS))
        for begin in (lambda: None, world.rebuild, lambda: world.thaw(loose)):
            begin()
            for _ in range(12):
                world.step(DT)
            np.testing.assert_allclose(world.poses(loose)[:, 2], 1.0 + BRICK[2], atol=4e-3)
        world.remove(floor[::2])
        world.thaw(floor[1::2])
        world.step(DT)
        np.testing.assert_allclose(world.velocities(floor[1::2])[:, 2], -9.81 * DT, rtol=0.5)


def test_bricks_meet_what_comes_from_afar_as_if_the_engine_had_always_had_them(engine):
    """Fire a ball at one brick, turn a long beam into another one: both hit in the same steps."""
    courses = []
    for known in (False, True):
        with World((0.0, 0.0, 0.0), engine=engine) as world:
            poses = np.array([at(0.0, 0.0, 1.0), at(20.0, 0.0, 1.0)])
            bricks = world.add_bricks(poses, np.tile(BRICK, (2, 1)), np.full(2, BRICK_MASS))
            if known:
                world.set_poses(bricks, poses)  # so that the engine gets them at once
            ball = world.add_projectile(Shape.CAPSULE, np.full(3, 0.2), 30.0, at(-6.0, 0.0, 1.0),
                                        np.array([60.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
            beam = world.add_body(Shape.BOX, [8.0, 0.1, 0.1], 50.0, at(17.0, 1.5, 1.0),
                                  np.array([0.0, 0.0, 0.0, 0.0, 0.0, -3.0]))
            course = []
            for _ in range(20):
                world.step(DT)
                course.append(world.velocities([ball, beam]))
            courses.append(np.array(course))
    joined, known = (np.abs(np.diff(course, axis=0)).max(axis=2) > 0.5 for course in courses)
    assert known.any(axis=0).all()  # a ball and a beam that do hit
    np.testing.assert_array_equal(joined.argmax(axis=0), known.argmax(axis=0))
    np.testing.assert_allclose(courses[0][:, 0], courses[1][:, 0], atol=1e-6)


def test_new_bodies_answer_to_contacts_as_old_ones_do(engine):
    """Drop a beam on its end: created above an edge, or elsewhere, moved and stopped first."""
    spins = []
    for start in (0.0, 50.0):
        with World(engine=engine) as world:
            world.add_bricks(at(0, 0, 0.0325)[None], BRICK[None], np.array([BRICK_MASS]))
            beam = world.add_body(Shape.BOX, [2.0, 0.2, 0.2], 60.0, at(start + 0.9, 0, 0.165))
            if start:
                world.step(DT)
            world.set_poses(beam, at(0.9, 0, 0.165))
            world.set_velocities(beam, np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]))
            world.step(DT)
            spins.append(world.velocities([beam])[0])
    assert abs(spins[1][4]) > 0.5
    np.testing.assert_allclose(spins[0], spins[1], atol=0.02)


def test_what_is_wedged_together_is_not_thrown_apart(engine):
    """Let go of a tangle of boards: overlaps give no energy but 15 of the 310 J of its height."""
    rng = np.random.default_rng(1)
    sizes = np.array([[2.4, 0.07, 0.05], [0.59, 0.04, 0.14], [0.45, 0.08, 0.2]])
    with World(engine=engine) as world:
        for size in sizes[rng.integers(3, size=14)]:
            attitude = rng.normal(size=4)
            world.add_body(Shape.BOX, size, 640.0 * size.prod(), at(
                *rng.uniform(-0.25, 0.25, 3) + [0.0, 0.0, 0.6],
                attitude / np.linalg.norm(attitude)))
        ids = world.awake
        mass, inertia = world.bodies.mass[ids], world.bodies.inertia[ids]
        for _ in range(20):
            before = world.poses(ids)
            kinetic = _kinetic(world, ids, mass, inertia)
            run(world, 1)
            fallen = (mass * (before[:, 2] - world.poses(ids)[:, 2])).clip(min=0.0).sum()
            won = _kinetic(world, ids, mass, inertia) - kinetic
            assert won < G * fallen + 15.0


def _kinetic(world, ids, mass, inertia):
    velocity = world.velocities(ids)
    spin = rotation.rotate(rotation.conjugate(world.poses(ids)[:, 3:]), velocity[:, 3:])
    return 0.5 * ((mass * (velocity[:, :3] ** 2).sum(axis=1)).sum() + (inertia * spin ** 2).sum())


def test_the_spin_of_what_is_thrown_makes_no_energy(engine):
    """Throw a crooked piece that turns at 200 rad/s: its energy of rotation never grows."""
    inertia = np.array([2e-5, 4e-5, 5.5e-5])
    with World((0.0, 0.0, 0.0), engine=engine) as world:
        body = world.add_fragment(
            np.full(2, Shape.BOX), np.array([[0.04, 0.02, 0.02], [0.01, 0.05, 0.01]]),
            np.array([at(0, 0, 0), at(0.02, 0.02, 0.005)]), 0.1, inertia, at(0, 0, 9),
            np.array([0.0, 0.0, 0.0, 90.0, 145.0, 130.0]))
        energy = []
        for _ in range(60):
            pose, spin = world.poses([body])[0], world.velocities([body])[0, 3:]
            inner = rotation.rotate(rotation.conjugate(pose[3:]), spin)
            energy.append(0.5 * (inertia * inner ** 2).sum())
            world.step(DT)
    assert max(energy) <= 1.001 * energy[0]


def test_what_nothing_does_leaves_no_contacts(engine):
    """Stop all that moves, step, and set it free: no contact of before comes back."""
    with World(engine=engine) as world:
        brick = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 0.5 * BRICK[2]))
        run(world, 3)
        assert len(world.contacts())
        world.freeze(np.array([brick]))
        world.step(DT)
        world.thaw(np.array([brick]))
        assert not len(world.contacts())
