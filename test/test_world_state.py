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

"""Saving, restoring and rebuilding a world."""

from functools import cache
import io

from loose_bricks import at, BRICK, BRICK_MASS, DT
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.errors import SceneError
from procphys_ros.physics.world import BodyState, installed_engines, rigid_sum, World
from procphys_ros.physics.world import engine as engine_module
from procphys_ros.physics.world.pieces import single

_ENGINES = pytest.mark.parametrize('engine', installed_engines())


def busy_world(engine):
    """Set up standing bricks, a heap, a compound, a fast ball and a pusher, and let them go."""
    world = World(engine=engine)
    rng = np.random.default_rng(4)
    standing = world.add_bricks(np.array([at(1.0 + 0.25 * i, 0, 0.0325) for i in range(8)]),
                                np.tile(BRICK, (8, 1)), np.full(8, BRICK_MASS))
    for i in range(12):
        world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(*rng.uniform(-0.1, 0.1, 2), 0.1 + 0.1 * i))
    size = np.array([[1.0, 0.2, 0.2], [0.2, 0.2, 0.6]])
    mass = np.array([40.0, 20.0])
    total = rigid_sum(mass, box_inertia(mass, size), np.array([at(0, 2, 1), at(0.4, 2, 1.4)]))
    world.add_fragment(np.full(2, Shape.BOX), size, total.local_poses, total.mass, total.inertia,
                       total.pose)
    gone = world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 5, 1))
    world.add_projectile(Shape.CAPSULE, np.full(3, 0.1), 3.0, at(-3, 0, 0.3), [30, 0, 1, 0, 0, 0])
    world.drive(world.add_driven(single(Shape.BOX, [0.2, 1.0, 0.2]), at(-0.6, 0, 0.11)),
                at(-0.5, 0, 0.11))
    world.remove([gone])
    world.thaw(standing[:2])
    run(world, 45)
    return world


def run(world, steps):
    """Step `steps` times."""
    for _ in range(steps):
        world.step(DT)


def through_a_file(arrays):
    """Write arrays to a file without pickles, and read them back."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    file.seek(0)
    with np.load(file, allow_pickle=False) as loaded:
        return dict(loaded)


def assert_same(first, second):
    """Compare two worlds bit for bit."""
    for name, column in first.save_state().items():
        np.testing.assert_array_equal(column, second.save_state()[name], err_msg=name)


@_ENGINES
def test_restored_worlds_step_alike(engine):
    """Restore a world twice from a file: both go on alike, bit for bit."""
    with busy_world(engine) as world:
        arrays = through_a_file(world.save_state())
    with World.restore(arrays, engine) as first, World.restore(arrays, engine) as second:
        assert (first.bodies.state == BodyState.RESTING).any() or len(first.awake)
        run(first, 60)
        run(second, 60)
        assert_same(first, second)


@_ENGINES
def test_a_world_that_was_rebuilt_goes_on_as_its_copy(engine):
    """Rebuild a running world and restore its copy: both stay identical, whatever they do."""
    with busy_world(engine) as world:
        arrays = world.save_state()
        world.rebuild()
        with World.restore(arrays, engine) as copy:
            assert_same(world, copy)
            for each in (world, copy):
                run(each, 30)
                each.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 2))
                each.thaw(np.flatnonzero(each.bodies.state == BodyState.FIXED))
                run(each, 30)
            assert_same(world, copy)


@_ENGINES
def test_saving_changes_nothing(engine):
    """Save in between: what follows is the same as without."""
    with busy_world(engine) as saved, busy_world(engine) as other:
        saved.save_state()
        run(saved, 40)
        run(other, 40)
        assert_same(saved, other)


def test_an_engine_that_can_be_saved_goes_on_as_if_it_had_never_been():
    """Save and restore again and again while things come and go: no bit differs from without."""
    def change(world, turn):
        world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 1.0))
        world.remove(world.awake[turn:turn + 2])
        run(world, 15)
    with busy_world('native') as never:
        copy = busy_world('native')
        for turn in range(4):
            saved = through_a_file(copy.save_state())
            copy.close()
            copy = World.restore(saved, 'native')
            for world in (never, copy):
                change(world, turn)
        assert len(saved['engine.contacts.key']) > 20
        assert_same(never, copy)
        copy.close()


@cache
def saved_native():
    """Save a busy world, once."""
    with busy_world('native') as world:
        return world.save_state()


@pytest.mark.parametrize(('name', 'spoil'), [
    ('order', lambda rows: rows + 1000), ('order', lambda rows: rows[[0, 0]]),
    ('order', lambda rows: rows.astype(float)), ('contacts.first', lambda rows: -rows),
    ('contacts.second', lambda rows: rows[:-1]), ('contacts.key', lambda rows: -rows),
    ('contacts.key', lambda rows: rows[::-1]), ('contacts.key', lambda rows: rows | 0xffff),
    ('contacts.key', lambda rows: np.sort(rows + (900 << 32))), ('resting.point', np.ravel),
    ('held', lambda rows: np.zeros(10_000, bool))])
def test_what_an_engine_cannot_start_from_is_refused(name, spoil):
    """Check which bodies and pieces saved contacts name before any kernel follows them."""
    arrays, name = saved_native(), f'engine.{name}'
    with pytest.raises(ValueError, match='engine'):
        World.restore(arrays | {name: spoil(arrays[name])}, 'native')


@_ENGINES
def test_restored_world_is_where_it_was(engine):
    """Find poses, velocities, contacts and bounds as they were, and motion as it was to be."""
    with busy_world(engine) as world, World.restore(world.save_state(), engine) as copy:
        ids = world.bodies.ids
        np.testing.assert_array_equal(copy.poses(ids), world.poses(ids))
        np.testing.assert_array_equal(copy.velocities(ids), world.velocities(ids))
        np.testing.assert_array_equal(copy.contacts().impulse, world.contacts().impulse)
        assert all(np.array_equal(copy.pieces(body).sizes, world.pieces(body).sizes)
                   for body in ids.tolist())
        run(world, 2)
        run(copy, 2)
        np.testing.assert_allclose(copy.poses(ids)[:, :3], world.poses(ids)[:, :3], atol=5e-3)


def test_ids_of_removed_bodies_come_back_in_a_restored_world():
    """Assign new bodies the same ids as the world that was saved would."""
    with World() as world:
        ids = [world.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 1 + i)) for i in range(5)]
        world.remove([ids[1], ids[3]])
        with World.restore(world.save_state()) as copy:
            for expected in (ids[3], ids[1], ids[4] + 1):
                for each in (world, copy):
                    assert each.add_body(Shape.BOX, BRICK, 1.0, at(0, 0, 9)) == expected


def test_shapes_survive_the_removal_of_others():
    """Add and remove compounds until their rows move: each body keeps its own shapes."""
    with World() as world:
        rng = np.random.default_rng(1)
        known = {}
        for _ in range(200):
            size = rng.uniform(0.1, 0.3, (3, 3))
            size[:, 2] += size[:, :2].max(axis=1)
            stack = np.array([at(0, 0, 90 + i) for i in range(3)])
            total = rigid_sum(np.ones(3), np.ones((3, 3)), stack)
            body = world.add_fragment(np.full(3, Shape.CAPSULE), size, total.local_poses,
                                      total.mass, total.inertia, total.pose)
            known[body] = size
            if rng.random() < 0.6:
                victim = list(known)[rng.integers(len(known))]
                world.remove([victim])
                del known[victim]
        assert len(known) > 40
        for body, size in known.items():
            np.testing.assert_array_equal(world.pieces(body).sizes, size)


def test_unknown_and_missing_engines_are_refused_in_one_line(monkeypatch):
    """Name the known engines, and how to install one."""
    with pytest.raises(SceneError, match='engine is "bulet"; did you mean bullet.*known: auto, b'):
        World(engine='bulet')
    monkeypatch.setattr(engine_module, 'installed_engines', lambda: ['native'])
    with pytest.raises(SceneError, match='"bullet", but pybullet is not installed: pip install '
                                         'pybullet, or take one that is there: native'):
        World(engine='bullet')


def test_the_native_engine_stands_in_where_others_are_missing(monkeypatch, caplog):
    """Take the engine that is there, and say so once."""
    monkeypatch.setattr(engine_module, 'installed_engines', lambda: ['native'])
    engine_module._log_once.cache_clear()
    for _ in range(2):
        with World() as world:
            assert world.engine == 'native'
    assert [record.getMessage() for record in caplog.records] == [
        'pybullet is not installed: engine is native']
