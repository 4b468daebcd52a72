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

"""The C functions of PyBullet's library, and a world that is driven by them."""

from concurrent.futures import ThreadPoolExecutor
import subprocess
import sys
from threading import Thread
from time import monotonic, sleep

import numpy as np
from numpy._core import _multiarray_umath
import pytest

from procphys_ros.errors import SceneError
from procphys_ros.physics.world import bullet_client, bullet_library

pybullet = pytest.importorskip('pybullet')

DT = 1.0 / 60.0  # [s]
GROUND, BRICK = (1.0, 1.0, 0.5), (0.2, 0.1, 0.05)  # [m] half extents
BODIES = ((GROUND, 0.0, -0.5), (BRICK, 3.0, 0.2), (BRICK, 2.0, 0.5))  # mass [kg], height [m]


@pytest.fixture
def client():
    """Give a world with gravity."""
    made = bullet_client.BulletClient()
    made.set_gravity([0.0, 0.0, -9.81])
    made.set_time_step(DT)
    yield made
    made.close()


def create(client, half, mass, *places):
    """Make boxes; give the number of the last."""
    return client.create_bodies(mass, client.create_box(np.array(half)), np.array(places),
                                np.array([0.0, 0.0, 0.0, 1.0]))


def simulate_by_python(steps):
    """Let bricks fall on a slab by PyBullet's Python functions; give states and contacts."""
    to = {'physicsClientId': pybullet.connect(pybullet.DIRECT)}
    pybullet.setGravity(0.0, 0.0, -9.81, **to)
    pybullet.setTimeStep(DT, **to)
    bodies = [pybullet.createMultiBody(
        mass, pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, **to),
        basePosition=(0.01 * mass, 0.0, height), useMaximalCoordinates=1, **to)
        for half, mass, height in BODIES]
    for _ in range(steps):
        pybullet.stepSimulation(**to)
    states = np.array([[*sum(pybullet.getBasePositionAndOrientation(body, **to), ()),
                        *sum(pybullet.getBaseVelocity(body, **to), ())] for body in bodies])
    points = pybullet.getContactPoints(**to)
    pybullet.disconnect(to['physicsClientId'])
    return states, points


def test_bodies_move_and_touch_as_by_the_functions_of_pybullet(client):
    """Let two bricks fall on a slab: the same to the bit, contact points included."""
    bodies = [create(client, half, mass, (0.01 * mass, 0.0, height))
              for half, mass, height in BODIES]
    for _ in range(40):
        client.step()
    states, theirs = simulate_by_python(40)
    assert np.array_equal(np.hstack(client.read(np.array(bodies))), states)
    points = client.contacts()
    assert len(points) == len(theirs) > 4
    for mine, one in zip(points, theirs):
        told = {'bodies': one[1:3], 'links': one[3:5], 'on_first': one[5], 'on_second': one[6],
                'normal': one[7], 'distance': one[8], 'pressing': one[9],
                'rubbing': (one[10], one[12]), 'ways': (one[11], one[13])}
        assert all(np.array_equal(mine[name], value) for name, value in told.items())
    assert len(client.contacts(bodies[0])) == sum(bodies[0] in one[1:3] for one in theirs)


def set_in_motion_by_python(poses, velocities, steps):
    """Set three bricks up, moved, pushed and held by PyBullet's Python functions; give states."""
    to = {'physicsClientId': pybullet.connect(pybullet.DIRECT)}
    pybullet.setGravity(0.0, 0.0, -9.81, **to)
    pybullet.setTimeStep(DT, **to)
    shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=BRICK, **to)
    bodies = [pybullet.createMultiBody(
        2.0, shape, basePosition=(float(n), 0.0, 1.0), useMaximalCoordinates=1,
        flags=pybullet.URDF_ENABLE_SLEEPING, **to) for n in range(3)]
    for n, body in enumerate(bodies):
        pybullet.changeDynamics(body, -1, lateralFriction=0.3, restitution=0.1, linearDamping=0.0,
                                angularDamping=0.0, **to)
        pybullet.changeDynamics(body, -1, mass=4.0 + n, localInertiaDiagonal=(0.1, 0.2, 0.3),
                                activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING, **to)
        pybullet.setCollisionFilterGroupMask(body, -1, 1, 0, **to)
        pybullet.resetBasePositionAndOrientation(body, poses[n, :3], poses[n, 3:], **to)
        pybullet.resetBaseVelocity(body, velocities[n, :3], velocities[n, 3:], **to)
    pybullet.resetBaseVelocity(bodies[2], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), **to)
    pybullet.changeDynamics(bodies[2], -1, mass=0.0,
                            activationState=pybullet.ACTIVATION_STATE_SLEEP, **to)
    for _ in range(steps):
        pybullet.stepSimulation(**to)
    states = np.array([[*sum(pybullet.getBasePositionAndOrientation(body, **to), ()),
                        *sum(pybullet.getBaseVelocity(body, **to), ())] for body in bodies])
    pybullet.disconnect(to['physicsClientId'])
    return states


def test_commands_for_many_bodies_are_those_of_pybullet(client):
    """Set bricks up, move and push them, and hold one: they go on the same to the bit."""
    rng = np.random.default_rng(4)
    poses, velocities = rng.normal(size=(3, 7)), rng.normal(size=(3, 6))
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    create(client, BRICK, 2.0, *((float(n), 0.0, 1.0) for n in range(3)))
    bodies, inertia = np.arange(3), np.tile([0.1, 0.2, 0.3], (3, 1))
    yes, filters = np.ones(3, bool), np.tile(np.array([1, 0], np.intc), (3, 1))
    client.set_up(bodies, yes, ~yes, np.tile([0.3, 0.1], (3, 1)), 4.0 + bodies, inertia, filters)
    client.set_poses(bodies, poses)
    client.set_velocities(bodies, velocities)
    client.freeze(bodies[1:], filters[1:])
    client.thaw(bodies[1:2], np.array([5.0]), inertia[1:2], filters[1:2])
    client.set_velocities(bodies[1:2], velocities[1:2])
    for _ in range(30):
        client.step()
    states = set_in_motion_by_python(poses, velocities, 30)
    assert np.array_equal(np.hstack(client.read(bodies)), states)
    np.testing.assert_allclose(states[2], [*poses[2], *np.zeros(6)], atol=1e-12)


def test_other_threads_run_while_bullet_computes(client):
    """Step a heap where no thread is made to let go: one that waits gets its turn all the same."""
    create(client, GROUND, 0.0, (0.0, 0.0, -0.5))
    rng = np.random.default_rng(0)
    create(client, BRICK, 3.0, *rng.uniform((-0.5, -0.5, 0.1), (0.5, 0.5, 4.0), (300, 3)))
    turns = []
    other = Thread(target=lambda: (sleep(0.02), turns.append(None)))
    before, end = sys.getswitchinterval(), monotonic() + 60.0
    sys.setswitchinterval(1000.0)
    try:
        other.start()
        while not turns and monotonic() < end:
            client.step()
        assert turns
    finally:
        sys.setswitchinterval(before)
        other.join()


def fall(seed):
    """Let boxes, hulls and capsules come and go in a world of their own; give what is left."""
    client, rng = bullet_client.BulletClient(), np.random.default_rng(seed)
    client.set_gravity([0.0, 0.0, -9.81])
    client.set_time_step(DT)
    create(client, GROUND, 0.0, (0.0, 0.0, -0.5))
    bodies = []
    for _ in range(4):
        for shape in (client.create_box(np.array(BRICK)), client.create_capsule(0.05, 0.3),
                      client.create_hull(rng.uniform(-0.2, 0.2, (8, 3)))):
            place = rng.uniform((-0.3, -0.3, 0.2), (0.3, 0.3, 1.5))
            bodies.append(client.create_bodies(2.0, shape, place[None],
                                               np.array([0.0, 0.0, 0.0, 1.0])))
        for _ in range(15):
            client.step()
        client.remove([bodies.pop(0)])
    states, count = np.hstack(client.read(np.array(bodies))), len(client.contacts())
    client.close()
    return states.tobytes(), count


def test_worlds_in_several_threads_do_not_disturb_each_other():
    """Make and step worlds in four threads at once: the same to the bit as one by one."""
    seeds = [*range(6)] * 4
    alone = {seed: fall(seed) for seed in set(seeds)}
    assert len(set(alone.values())) == 6 and all(count for _, count in alone.values())
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(4) as threads:
            assert list(threads.map(fall, seeds)) == [alone[seed] for seed in seeds]
    finally:
        sys.setswitchinterval(before)


def test_a_library_without_c_functions_is_told(monkeypatch):
    """Name the function that is missing, and what to do."""
    monkeypatch.setattr(bullet_library, '_path', lambda: _multiarray_umath.__file__)
    with pytest.raises(SceneError, match='exports no b3ConnectPhysicsDirect: .*engine: rapier'):
        bullet_library.load_library.__wrapped__()


def test_nothing_is_printed():
    """Start an engine in a fresh interpreter: PyBullet's banner is not for users."""
    code = ('from procphys_ros.physics.world import World\n'
            'with World(engine="bullet") as world:\n    world.step(0.01)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ('', '')
