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
"""Snapshots and forks of simulations and worlds: what goes on is the same to the bit."""

from functools import cache
import io
import json
import random
import tracemalloc

from grown_trees import bush
from loose_bricks import at, BRICK, BRICK_MASS, DT
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.blueprint import box_inertia, Shape
from procphys_ros.errors import SceneError, SnapshotError
from procphys_ros.files import archive
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.world import BodyState, installed_engines, rigid_sum, World
from procphys_ros.physics.world import engine as engine_module
from procphys_ros.physics.world.pieces import single
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.particles import DustSettings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.wallgrammar import WallGrammar

HOUSE = 'grammars/garden_wall.wall'


HEAD = len(archive.seal(b''))  # bytes before the length of the table


def taken_apart(data):
    """Return the table of a snapshot and the bytes behind it."""
    start = HEAD + 8
    end = start + int.from_bytes(data[HEAD:start], 'little')
    return json.loads(data[start:end]), data[end:]


def put_together(table, rest):
    """Make a snapshot whose checksum is right."""
    text = table if isinstance(table, bytes) else json.dumps(table).encode()
    return archive.seal(len(text).to_bytes(8, 'little') + text + rest)


def resealed(data, old, new):
    """Replace bytes of the table."""
    table, rest = taken_apart(data)
    text = json.dumps(table, separators=(',', ':')).encode()
    assert old in text
    return put_together(text.replace(old, new), rest)


def busy(seconds=0.4, engine='auto', seed=0):
    """Simulate a wall and two trees in a storm while balls fly and a charge has gone off."""
    scene = Scene(Settings(seed=seed, engine=engine))
    scene.add(wall(8, 10), (0.0, 0.0, 0.0), 0.0, 'wall')
    for i in range(2):
        scene.add(bush(40, seed=i, damping_ratio=0.1, strength=2e7), (3.0 + 2.0 * i, 1.0, 0.0),
                  0.0, f'tree_{i}')
    scene.add(LSystem.parse('axiom: !(0.08) F ~(0.2) F [ +(50) F ~(0.2) ] F ~(0.2) ').build(),
              (8.0, 1.0, 0.0), 0.0, 'shrub')
    return stirred(Simulation(scene), seconds)


def stirred(simulation, seconds):
    """Do to a simulation what there is to do, and let some time pass."""
    simulation.set_wind((35.0, 3.0, 0.0))
    simulation.launch(Projectile('sphere', 0.3, 40.0, (0.9, -3.0, 0.4), (0.0, 25.0, 0.0)))
    simulation.explode((0.5, -4.0, 0.5), 2.0)
    simulation.gust()
    simulation.apply_wrench('tree_1/3', (20.0, 0.0, 0.0))
    simulation.apply_impulse('tree_0/20', (150.0, 0.0, 0.0))
    simulation.step(round(60 * seconds))
    return simulation


def assert_same(one, other):
    """Compare everything that can be seen of two simulations, to the bit."""
    assert one.time == other.time and one.bonds_broken == other.bonds_broken
    np.testing.assert_array_equal(one.poses, other.poses)
    np.testing.assert_array_equal(one.velocities, other.velocities)
    np.testing.assert_array_equal(one.events, other.events)
    np.testing.assert_array_equal(one.leaf_poses(), other.leaf_poses())
    for mine, theirs in zip(one.dust, other.dust):
        np.testing.assert_array_equal(mine, theirs)


def test_snapshots_and_forks_go_the_same_way_until_they_are_told_otherwise():
    """Save and fork in the middle of it all: what is struck differs, in another simulation too."""
    simulation = busy()
    assert simulation.bonds_broken > 0 and simulation.awake_bodies > 0
    data = simulation.save()
    same, struck, other = simulation.fork(), simulation.fork(), busy(0.0)
    struck.apply_impulse('tree_0/5', (30.0, 0.0, 0.0))
    other.restore(data)
    assert other.time == pytest.approx(0.4)
    for run in (simulation, same, struck, other):
        run.step(15)
    assert_same(simulation, same)
    assert_same(simulation, other)
    assert not np.array_equal(simulation.poses, struck.poses)
    simulation.restore(data)
    simulation.step(15)
    assert_same(simulation, other)


def test_a_reset_begins_anew_and_repeats_the_run():
    """Find the scene as it was built after a reset, and then all as it was, to the bit."""
    simulation, first = busy(), busy()
    broken = np.unique(first.events['part_b'])
    assert {first.names.name(part).partition('/')[0] for part in broken} >= {'wall', 'tree_0'}
    assert len(first.dust.ages) and len(first.state.missiles)
    bodies = first.state.carrier.max()
    simulation.reset()
    assert (simulation.time, simulation.bonds_broken, len(simulation.dust.ages)) == (0.0, 0, 0)
    assert len(simulation.poses) == len(simulation.scene.blueprint)
    assert simulation.exists.all()
    simulation.step(5)  # in still air
    np.testing.assert_allclose(simulation.poses, simulation.blueprint.poses, atol=1e-9)
    simulation.reset()
    np.testing.assert_array_equal(simulation.poses, simulation.blueprint.poses)
    assert_same(stirred(simulation, 0.4), first)
    assert simulation.state.carrier.max() == bodies


def test_constants_are_not_saved():
    """Keep a snapshot of a standing building small: it names the arrays of its model."""
    scene = Scene(Settings(dust=DustSettings(enabled=False)))
    scene.add(WallGrammar.load(HOUSE).build(seed=0), name='house')
    simulation = Simulation(scene)
    assert len(simulation.save()) < 2500 * len(simulation.poses)


@pytest.mark.parametrize(('spoil', 'word'), [
    (lambda data: b'', 'no snapshot'), (lambda data: b'PK\x03\x04' + data, 'no snapshot'),
    (lambda data: data[:-1], 'damaged'), (lambda data: data[:60], 'damaged'),
    (lambda data: data[:-9] + b'\xa5' * 9, 'damaged'),
    (lambda data: resealed(data, b'"version":"', b'"version":"9'), 'version 9'),
    (lambda data: resealed(data, b'"scene":"', b'"scene":"f'), 'another scene'),
    (lambda data: b'procphys_ros snapshot 1\n{"version": "1.0"}\n' + data, 'save it anew')])
def test_what_is_no_snapshot_of_this_scene_is_refused(saved, spoil, word):
    """Say in one line what is wrong, and stay in the present state."""
    simulation, data = saved
    before = simulation.poses.copy()
    simulation.step(3)
    now = simulation.poses.copy()
    with pytest.raises(SnapshotError, match=word) as told:
        simulation.restore(spoil(data))
    assert '\n' not in str(told.value)
    np.testing.assert_array_equal(simulation.poses, now)
    simulation.restore(data)
    np.testing.assert_array_equal(simulation.poses, before)


def test_a_snapshot_of_another_scene_is_refused():
    """Tell scenes apart by what they hold, by seed and by time step."""
    scene = Scene()
    scene.add(wall(3, 3), name='wall')
    data = Simulation(scene).save()
    other = Scene()
    other.add(wall(3, 4), name='wall')
    for foreign in (Simulation(other), Simulation(scene, seed=5), Simulation(scene, 1 / 30)):
        with pytest.raises(SnapshotError, match='another scene'):
            foreign.restore(data)


@pytest.fixture(scope='module')
def saved():
    """Simulate a small busy scene, and give it with a snapshot of it."""
    simulation = busy(0.3)
    simulation.add(wall(2, 2), (9.0, 0.0, 0.0), name='added')
    return simulation, simulation.save()


def refusal(simulation, data):
    """Restore, and give the reason why that is refused, '' if it is not."""
    before = simulation.poses.copy()
    try:
        simulation.restore(data)
    except SnapshotError as error:
        np.testing.assert_array_equal(simulation.poses, before)
        return str(error)
    return ''


def test_cut_and_flipped_snapshots_are_refused(saved):
    """Cut a snapshot anywhere, and flip any bit: one line says that it is damaged."""
    simulation, data = saved
    chosen = random.Random(0)
    for _ in range(40):
        cut = data[:chosen.randrange(len(data))]
        flipped = bytearray(data)
        flipped[chosen.randrange(len(data))] ^= 1 << chosen.randrange(8)
        for spoilt in (cut, bytes(flipped), cut + data):
            reason = refusal(simulation, spoilt)
            assert reason and '\n' not in reason


def nodes(value):
    """List all lists and dicts in a table, that of the state included."""
    inner = value.values() if isinstance(value, dict) else value
    return [value, *(node for item in inner if isinstance(item, (dict, list))
                     for node in nodes(item))]


def hostile(chosen, node, others):
    """Put something else at a place of a list or dict."""
    key = chosen.choice(list(node) if isinstance(node, dict) else range(len(node)))
    node[key] = chosen.choice([
        None, True, -1, 2 ** 63, 1e308, 'x' * 50, [], {}, [[]], ['object', 0], ['array', 0],
        ['array', -1], ['set', ['list']], ['dict', [1]], ['constant', 'settings'],
        ['deque', -1, 1], ['procphys_ros.recording.writer.McapWriter', '/tmp/x'],
        chosen.choice(others)])
    return key


def test_hostile_tables_are_refused_or_are_states(saved):
    """Change a table anywhere, its checksum being right: no error but a refusal in one line."""
    simulation, data = saved
    table, rest = taken_apart(data)
    chosen, text = random.Random(0), json.dumps(table)
    refused = 0
    for _ in range(90):
        table = json.loads(text)
        known = [node for node in nodes(chosen.choice(
            [table, table['added'], table['state']['objects']])) if node]
        hostile(chosen, chosen.choice(known), known)
        try:
            spoilt = put_together(table, rest)
        except ValueError:  # it holds itself
            continue
        reason = refusal(simulation, spoilt)
        refused += bool(reason)
        assert '\n' not in reason and 'internal' not in reason
        if not reason:
            assert not refusal(simulation, data)
    assert refused > 45


@pytest.mark.parametrize('table', [
    b'[' * 200_000, b'{"arrays":' * 100_000, b'9' * 10_000, b'\xff', b'null', b'{}',
    b'{"arrays": [["float64", [1099511627776, 1099511627776]]]}',
    b'{"arrays": [["object", [0]]]}', b'{"arrays": [["float64", [0, 1e300]]]}',
    b'{"arrays": [["float64", [' + b'0, ' * 80 + b'0]]]}'])
def test_what_is_no_table_is_refused(saved, table):
    """Refuse deep nesting and huge sizes with the same line as any other damage."""
    simulation, _ = saved
    assert 'damaged' in refusal(simulation, put_together(table, b''))


def many_copies(table):
    """Ask for a hundred thousand copies of an array of the model."""
    places = table['state']['places']
    name = next(place for place in places if isinstance(place, str))
    places += [name] * 100_000


def much_room(table):
    """Set the capacity of the table of bodies to a billion."""
    world = next(record['data'] for record in table['state']['objects']
                 if 'bodies.capacity' in json.dumps(record))
    capacity = next(pair[1] for pair in world[1:] if pair[0] == 'bodies.capacity')
    other = next(pair[1] for pair in world[1:] if pair[0] == 'bodies.mass')
    capacity[:] = other


@pytest.mark.parametrize('enlarge', [many_copies, much_room])
def test_small_snapshots_take_little_memory(saved, enlarge):
    """Take no more than some times the memory that the snapshot has, whatever it asks for."""
    simulation, data = saved
    table, rest = taken_apart(data)
    enlarge(table)
    spoilt = put_together(table, rest)
    tracemalloc.start()
    try:
        assert refusal(simulation, spoilt)
        assert tracemalloc.get_traced_memory()[1] < 30 * len(spoilt)
    finally:
        tracemalloc.stop()


def test_worlds_are_checked_before_they_are_built(saved):
    """Refuse room for a billion bodies, and ids, shapes and widths that there are not."""
    arrays = saved[0].state.world.save_state()
    for name, value in (('bodies.capacity', 10 ** 9), ('bodies.first_piece', 10 ** 6),
                        ('bodies.piece_count', -1), ('bodies.free', 10 ** 9),
                        ('excluded', 10 ** 9), ('bodies.state', 99)):
        column = arrays[name]
        column = np.full(column.shape if column.size else (1, *column.shape[1:]), value,
                         column.dtype)
        with pytest.raises(ValueError, match=name.replace('piece_count', 'first_piece')):
            World.restore({**arrays, name: column})
    for name in arrays:
        with pytest.raises(ValueError, match=name):
            World.restore({**arrays, name: arrays[name].astype(np.float32)})
        with pytest.raises(ValueError, match=name):
            World.restore({key: column for key, column in arrays.items() if key != name})


def test_no_class_is_found_by_name(saved, tmp_path):
    """Leave a recording as it is that a snapshot asks to be opened for writing."""
    simulation, data = saved
    recording = tmp_path / 'run.mcap'
    recording.write_bytes(b'precious')
    table, rest = taken_apart(data)
    for record in ({'data': ['procphys_ros.recording.writer.McapWriter', str(recording)]},
                   ['procphys_ros.recording.writer', 'McapWriter', str(recording)]):
        for number in range(0, len(table['state']['objects']), 9):
            spoilt = json.loads(json.dumps(table))
            spoilt['state']['objects'][number] = record
            assert refusal(simulation, put_together(spoilt, rest))
    assert recording.read_bytes() == b'precious'


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
    run(world, 30)
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


def assert_same_world(first, second):
    """Compare two worlds bit for bit."""
    for name, column in first.save_state().items():
        np.testing.assert_array_equal(column, second.save_state()[name], err_msg=name)


@_ENGINES
def test_a_world_that_was_rebuilt_goes_on_as_its_copy(engine):
    """Rebuild a running world and restore its copy: both stay identical, whatever they do."""
    with busy_world(engine) as world:
        arrays = world.save_state()
        world.rebuild()
        with World.restore(arrays, engine) as copy:
            assert_same_world(world, copy)
            for each in (world, copy):
                run(each, 20)
                each.add_body(Shape.BOX, BRICK, BRICK_MASS, at(0, 0, 2))
                each.thaw(np.flatnonzero(each.bodies.state == BodyState.FIXED))
                run(each, 20)
            assert_same_world(world, copy)


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
        assert_same_world(never, copy)
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
