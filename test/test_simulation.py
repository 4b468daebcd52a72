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
"""The whole simulation: commands, determinism, resets, and what is read of it."""

from copy import copy, deepcopy
from dataclasses import fields
import gc
from inspect import getmembers
import pickle
import weakref

from building_checks import take_out
from grown_trees import beam
from masonry_walls import bonded, wall
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.errors import CommandError, ProcPhysError
from procphys_ros.export import export, export_animation
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.recording.recorder import Recorder
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import EventLog, Simulation
from procphys_ros.simulation.parts import Owner
from procphys_ros.simulation.stages import Stage, STAGES
from procphys_ros.wallgrammar import WallGrammar

TREE = """
angle: 40
axiom: Width(0.12) Density(800) Modulus(8e9) DampingRatio(0.05) Strength({strength})
  F(1) F(1) [ +(30) &(50) Width(0.05) F(0.8) F(0.8) Leaf(0.3, 1) ] F(1) Width(0.06) F(0.8)
"""


def grow(strength=5e7, count=1):
    """Make a simulation of a few small trees in still air."""
    scene = Scene()
    blueprint = LSystem.parse(TREE.format(strength=strength)).build()
    for i in range(count):
        scene.add(blueprint, (4.0 * i, 0.0, 0.0), 0.3 * i, f'tree_{i}')
    return Simulation(scene)


def test_an_impulse_moves_the_named_part_and_dies_out():
    """Move the tree that was struck, only that tree, and let it come back to rest."""
    simulation = grow(count=2)
    rest = simulation.poses.copy()
    simulation.apply_impulse('tree_1/segment_5', (20.0, 0.0, 0.0))
    simulation.step(10)
    moved = np.linalg.norm(simulation.poses[:, :3] - rest[:, :3], axis=1)
    half = len(rest) // 2
    assert moved[:half].max() < 1e-12 and moved[half:].max() > 0.01
    simulation.step(1800)
    assert np.abs(simulation.poses - rest).max() < 1e-3


@pytest.fixture(scope='module')
def with_a_ball():
    """Make a simulation of a tree, and a ball that flies past it."""
    simulation = grow()
    simulation.launch(Projectile('sphere', 0.2, 5.0, (0.0, -9.0, 1.0), (3.0, 0.0, 0.0)))
    return simulation


@pytest.mark.parametrize(('call', 'words'), [
    (lambda s: s.step('a'), "number of steps is 'a', it must be a whole number"),
    (lambda s: s.step(2.0), 'number of steps is 2.0'),
    (lambda s: s.step(None), 'number of steps is None'),
    (lambda s: s.step(-1), 'is -1, it must be a whole number, 0 or more'),
    (lambda s: s.gust('strong'), "'strong' is no command"),
    (lambda s: s.add(LSystem), "object_0 is <class '.*it must be a Blueprint; `build`"),
    (lambda s: s.add(s.blueprint, (0.0, 0.0, 0.0), 'east'), "object_0.yaw is 'east'"),
    (lambda s: s.add(s.blueprint, (0.0, 'b', 0.0)), "object_0.position is 'b'"),
    (lambda s: s.add(s.blueprint, (0.0, 0.0)), 'must be a list of 3 numbers'),
    (lambda s: s.add(s.blueprint, (0.0, 0.0, np.nan)), 'must be'),
    (lambda s: s.remove(3), 'there is no object "3"'),
    (lambda s: s.set_wind_enabled('off'), "wind is 'off', it must be True or False"),
    (lambda s: s.set_body_state('projectile_0/0', 3), 'part: 3 is not a pose of seven numbers'),
    (lambda s: s.set_body_state('projectile_0/0', None, 3), 'twist: 3 is not six numbers'),
    (lambda s: s.place_intruder(3), 'intruder: 3 is not a pose of seven numbers'),
    (lambda s: s.place_intruder((0, 0, 9, 0, 0, 0, 1), 'a'), "time is 'a'"),
    (lambda s: s.apply_impulse(s.blueprint, (0, 0, 1)), 'Blueprint.* is neither the name nor'),
    (lambda s: s.set_wind(s.blueprint), 'Blueprint.* must be a list of 3 numbers'),
    (lambda s: s.place_intruder((0, 0, 9, 0, 0, 0, 1), np.nan), 'time is nan'),
    (lambda s: s.place_intruder((0, 0, 9, 0, 0, 0, 1), name=3), 'there is no intruder "3"'),
    (lambda s: s.pose_of_intruder([3]), 'there is no intruder'),
    (lambda s: s.wrench_on_intruder(None), 'there is no intruder'),
    (lambda s: s.scan('lidar'), "'lidar' is no LidarSettings"),
    (lambda s: s.restore('x'), 'this is no snapshot'),
    (lambda s: s.restore(None), 'this is no snapshot'),
])
def test_values_of_a_wrong_type_are_named(with_a_ball, call, words):
    """Say what was given and what is allowed, instead of an error of Python from deep inside."""
    parts, time = len(with_a_ball.poses), with_a_ball.time
    with pytest.raises(CommandError, match=words):
        call(with_a_ball)
    assert len(with_a_ball.poses) == parts and with_a_ball.time == time
    with_a_ball.step(np.int64(1))
    assert with_a_ball.time > time


@pytest.mark.parametrize('call, words', [
    (lambda b: Simulation('demo.yaml'), "'demo.yaml' is no scene; Scene.from_yaml"),
    (lambda b: Simulation(Scene(), time_step=0.0), 'time_step is 0, it must be'),
    (lambda b: Simulation(Scene(), time_step=np.nan), 'time_step is nan'),
    (lambda b: Simulation(Scene(), seed=-1), 'seed is -1'),
    (lambda b: Simulation(Scene(), engine='havok'), 'engine'),
    (lambda b: Simulation(b), 'Blueprint.* is no scene; .* and Scene.add places'),
    (lambda b: Scene.from_parameters(3), 'the parameters are 3, they must be a mapping'),
    (lambda b: Scene().add(b, np.array(3.0)), 'must be a list of 3 numbers'),
    (lambda b: Scene().add(b, (0.0, 0.0, np.nan)), 'must be'),
    (lambda b: LSystem.parse(3), 'the grammar is 3, it must be a text'),
    (lambda b: WallGrammar.parse(None), 'the grammar is None, it must be a text'),
    (lambda b: export(b, 'tree.glb'), 'Blueprint.* is no scene; Scene.add places'),
    (lambda b: export_animation(b, 'tree.usda', 0.0, 1.0), 'Blueprint.* is no scene'),
    (lambda b: Recorder(Scene(), 'tree.mcap'), r'is no simulation; Simulation\(scene\) is one'),
])
def test_what_stands_in_place_of_a_scene_is_named(call, words):
    """Name what was given in place of a scene, and how to get one."""
    with pytest.raises(ProcPhysError, match=words):
        call(grow().blueprint)


def test_parts_go_by_index_or_name():
    """Take 'tree_1/2', 'tree_1/segment_2' and the plain index for the same part."""
    results = []
    for part in ('tree_1/2', 'tree_1/segment_2', 10 - 2, '8'):
        simulation = grow(count=2)
        assert len(simulation.blueprint) == 12
        simulation.apply_impulse(part, (1.0, 0.0, 0.0))
        simulation.step(3)
        results.append(simulation.poses.copy())
    assert all(np.array_equal(results[0], other) for other in results[1:])


@pytest.mark.parametrize(('part', 'linear', 'words'), [
    ('tree_9/1', (1, 0, 0), ['tree_9/1', 'did you mean tree_0']),
    ('tree_0', (1, 0, 0), ['object/index']),
    ('tree_0/99', (1, 0, 0), ['0 to 5']),
    ('tree_0/brick_1', (1, 0, 0), ['tree_0/segment_1']),
    (-1, (1, 0, 0), ['-1']),
    ('tree_0/1', (float('nan'), 0, 0), ['not finite']),
    ('tree_0/1', (1e308, 0, 0), ['larger']),
    ('tree_0/1', (1, 0), ['three numbers']),
    ('', (1, 0, 0), ['no part']),
])
def test_refused_commands_say_why_and_change_nothing(part, linear, words):
    """Refuse what cannot be done, in one line, and leave the state alone."""
    simulation = grow()
    with pytest.raises(CommandError) as caught:
        simulation.apply_impulse(part, linear)
    for word in words:
        assert word in str(caught.value)
    simulation.step(5)
    assert np.abs(simulation.poses - simulation.blueprint.poses).max() < 1e-9


def test_a_lasting_force_bends_and_is_cleared():
    """Hold a tip aside with a force, then let it go."""
    simulation = grow()
    simulation.apply_wrench('tree_0/5', (60.0, 0.0, 0.0))
    simulation.step(200)
    bent = simulation.poses[5, 0] - simulation.blueprint.poses[5, 0]
    assert bent > 0.01
    assert simulation.clear_wrenches() == 1
    simulation.step(800)
    assert simulation.poses[5, 0] == pytest.approx(simulation.blueprint.poses[5, 0], abs=1e-3)


def test_lasting_forces_end_with_their_parts():
    """Count no force on what is gone."""
    simulation = grow(count=2)
    for part in ('tree_0/1', 'tree_0/5', 'tree_1/5'):
        simulation.apply_wrench(part, (1.0, 0.0, 0.0))
    simulation.remove('tree_0')
    simulation.step()
    assert simulation.clear_wrenches() == 1


def test_an_empty_scene_steps():
    """Simulate nothing without complaint."""
    simulation = Simulation(Scene())
    simulation.step(3)
    assert simulation.poses.shape == (0, 7) and simulation.time == pytest.approx(0.05)


def test_memory_goes_with_the_last_reference():
    """Free a simulation at once, its walls and projectiles too, without Python's collector."""
    scene = Scene()
    scene.add(LSystem.parse(TREE.format(strength=5e7)).build(), (0, 0, 0), 0.0, 'tree')
    scene.add(WallGrammar.load(shared_folder() / 'grammars' / 'garden_wall.wall').build(),
              (6, 0, 0), 0.0, 'wall')

    def lived() -> weakref.ref:
        simulation = Simulation(scene)
        simulation.launch(Projectile(position=(6.0, -3.0, 1.0), velocity=(0.0, 20.0, 0.0)))
        simulation.step(10)
        return weakref.ref(simulation)

    lived()  # kernels that are compiled on the way may keep what they were called with for a while
    gc.disable()
    try:
        assert lived()() is None
    finally:
        gc.enable()


GRAVITY = 9.81


@pytest.fixture
def simulation():
    """Grow a tree in the wind beside a wall that a ball flies at, with an intruder on its way."""
    scene = Scene()
    scene.add(beam(strength=40e6), name='beam')
    scene.add(wall(3, 6), (9.0, 0.0, 0.0), name='pier')
    made = Simulation(scene)
    made.set_wind((0.0, 12.0, 0.0))
    made.launch(Projectile(size=0.2, mass=20.0, position=(9.3, -2.0, 0.4), velocity=(0, 25, 0)))
    made.place_intruder((0.0, 3.0, 2.0, 0.0, 0.0, 0.0, 1.0))
    made.place_intruder((0.0, -1.0, 2.0, 0.0, 0.0, 0.0, 1.0), 0.3)
    made.step()
    return made


def arrays(simulation) -> dict[str, np.ndarray]:
    """Read all arrays that are properties, and those of the intruder."""
    found = {name: getattr(simulation, name) for name, member in getmembers(type(simulation))
             if isinstance(member, property)}
    found |= {'pose': simulation.pose_of_intruder('intruder'), 'loads': simulation.loads(),
              'wrench': simulation.wrench_on_intruder('intruder'),
              'leaf_poses': simulation.leaf_poses(), 'objects': np.array(simulation.objects)}
    found |= {f'dust.{name}': column for name, column in simulation.dust._asdict().items()}
    return {name: value for name, value in found.items() if isinstance(value, np.ndarray)}


def test_what_was_read_stays_as_it_was(simulation):
    """Keep all that can be read while a ball breaks a wall: it is that of its own moment."""
    kept, copies = [], []
    for _ in range(12):
        kept.append(arrays(simulation))
        copies.append({name: value.copy() for name, value in kept[-1].items()})
        simulation.step(2)
    assert {'poses', 'velocities', 'exists', 'events', 'intruder_pose'} <= set(kept[0])
    for before, after in zip(kept, copies):
        for name in before:
            np.testing.assert_array_equal(before[name], after[name], name)
    changing = {name for name in kept[0] if not np.array_equal(kept[0][name], kept[-1][name])}
    assert {'poses', 'velocities', 'events', 'intruder_pose', 'intruder_wrench'} <= changing


def test_what_was_read_cannot_be_written(simulation):
    """Write to what shows the state: there is an error, and nothing moves."""
    simulation.step(15)
    before = simulation.fork()
    for name in ('poses', 'velocities', 'events', 'intruder_pose', 'intruder_wrench'):
        with pytest.raises(ValueError, match='read-only'):
            getattr(simulation, name)[0] = 1
    simulation.objects.clear()
    assert len(simulation.objects) == 3
    simulation.step(5)
    before.step(5)
    np.testing.assert_array_equal(simulation.poses, before.poses)


def test_a_series_is_what_was_read_step_by_step(simulation):
    """Record a ball, a course of bricks and the tree: each row is what the step showed."""
    other = simulation.fork()
    parts = ['pier/0', 'beam', len(simulation.poses) - 1]
    series = simulation.series(20, parts, every=3)
    assert series.names == ('pier/brick_0', *(f'beam/segment_{i}' for i in range(10)),
                            'projectile_0/projectile_0')
    assert simulation.time == pytest.approx(21 * simulation.time_step)
    for row in range(6):
        other.step(3)
        assert series.times[row] == other.time
        np.testing.assert_array_equal(series.poses[row], other.poses[series.parts])
        np.testing.assert_array_equal(series.velocities[row], other.velocities[series.parts])
        np.testing.assert_array_equal(series.loads[row], other.loads(parts))
    assert (np.diff(series.poses[:3, -1, 1]) > 0.5).all()  # the ball flies
    assert len(series.times) == 6 and np.ptp(series.poses[:, 5], axis=0).any()
    assert {f.name: len(getattr(series, f.name)) for f in fields(series)} == {
        'parts': 12, 'names': 12, 'times': 6, 'poses': 6, 'velocities': 6, 'loads': 6}
    assert simulation.series(0).poses.shape == (0, len(simulation.poses), 7)


def test_loads_are_those_of_statics(simulation):
    """Find the weight above every segment, and that of the pier in its lowest course."""
    scene = simulation.scene
    calm = Simulation(scene)
    assert np.isnan(calm.load('beam/0').force) and calm.load('pier/0').force > 0.0
    calm.step()
    weight = GRAVITY * calm.blueprint.mass
    loads = calm.loads()
    np.testing.assert_allclose(loads[:10, 0], np.cumsum(weight[9::-1])[::-1], rtol=1e-3)
    ends = calm.blueprint.bonds[(calm.blueprint.bonds == GROUND).any(axis=1)].max(axis=1)
    foot = ends[ends >= 10]
    np.testing.assert_allclose(loads[foot, 0].sum(), weight[10:].sum(), rtol=0.02)
    for part in (0, 4, 11):
        one = calm.load(part)
        assert [one.force, one.moment, one.share] == loads[part].tolist()
    ball = len(simulation.poses) - 1
    assert simulation.load(ball).force == 0.0 and not simulation.loads([ball]).any()


@pytest.mark.parametrize('arguments, words', [
    ((3, ['bem']), 'did you mean beam'), ((3, ['beam/99']), 'indices go from 0 to 9'),
    ((-1,), 'number of steps is -1'), ((3, None, 0), 'every is 0'), ((3, [2.5]), 'neither'),
    ((3, 2.5), 'neither'), ((10 ** 9,), 'GiB of memory')], ids=str)
def test_series_that_cannot_be_are_refused(simulation, arguments, words):
    """Say what is wrong before any step."""
    with pytest.raises(CommandError, match=words):
        simulation.series(*arguments)
    assert simulation.time == simulation.time_step


@pytest.mark.parametrize('way', [copy, lambda s: pickle.loads(pickle.dumps(s)),
                                 lambda s: deepcopy({'in': [s]})['in'][0]])
def test_copies_and_pickles_go_on_alike(simulation, way):
    """Copy a run in Python's own ways, with what was added: it goes on as a fork does."""
    simulation.add(wall(1, 2), (0.0, 30.0, 0.0), name='late')
    simulation.step(8)
    twin = way(simulation)
    assert twin.state is not simulation.state and twin.added == ('late',)
    simulation.step(6)
    assert twin.time < simulation.time
    twin.step(6)
    np.testing.assert_array_equal(twin.poses, simulation.poses)
    np.testing.assert_array_equal(twin.events, simulation.events)
    twin.reset()
    assert twin.time == 0.0


@pytest.mark.parametrize('way', [deepcopy, pickle.dumps])
@pytest.mark.parametrize('inner', [lambda s: s.state, lambda s: s.state.world])
def test_what_lives_in_an_engine_says_how_it_is_copied(simulation, way, inner):
    """Copy only the state: the error names what to copy instead."""
    with pytest.raises(TypeError, match='fork, save, copy or pickle the Simulation'):
        way(inner(simulation))


BRICK = [0.215, 0.1025, 0.065]  # [m]


def simulate(blueprint, name='wall'):
    """Make a simulation of one object in still air."""
    scene = Scene()
    scene.add(blueprint, name=name)
    return Simulation(scene)


def test_a_part_without_bonds_is_a_rigid_body():
    """Let a brick that nothing holds fall freely from the first step on."""
    simulation = simulate(bonded([[0.0, 0.0, 2.0]], BRICK, ground=False))
    assert simulation.state.parts.owner[0] == Owner.BODY
    simulation.step(30)
    fallen = 2.0 - simulation.poses[0, 2]
    assert fallen == pytest.approx(0.5 * 9.81 * 0.5 ** 2, rel=0.06)
    assert simulation.apply_impulse(0, (0.1, 0.0, 0.0))
    simulation.step()
    assert simulation.velocities[0, 0] == pytest.approx(0.1 / simulation.blueprint.mass[0],
                                                        rel=0.05)


def test_every_part_has_one_owner_all_the_time():
    """Follow owners while a wall loses bricks: standing, flying or gone, never two of them."""
    simulation = simulate(wall(8, 10))
    state = simulation.state
    assert (state.parts.owner == Owner.STANDING).all()
    take_out(simulation, np.array([40, 41]))
    simulation.launch(Projectile('sphere', 0.3, 40.0, (0.9, -2.0, 0.4), (0.0, 25.0, 0.0)))
    simulation.step(30)
    owner, body = state.parts.owner, state.parts.body
    assert set(owner[[40, 41]]) == {Owner.GONE} and not simulation.exists[[40, 41]].any()
    assert (owner == Owner.BODY).sum() > 1  # the ball, and what it knocked out
    assert (body[owner == Owner.GONE] == -1).all() and (body[owner != Owner.GONE] >= 0).all()
    assert np.isfinite(state.parts.poses).all()
    assert np.isnan(simulation.poses[40]).all() and np.isfinite(simulation.poses[0]).all()


def test_a_blow_beside_the_centre_turns_the_brick_that_comes_out():
    """Strike a weak brick at its end: it leaves its wall spinning about the vertical."""
    spins = []
    for side in (-0.1, 0.0, 0.1):
        simulation = simulate(wall(4, 4, tension=1e3, cohesion=1e3))
        place = simulation.poses[-1, :3] + [side, 0.0, 0.0]
        assert simulation.apply_impulse(len(simulation.poses) - 1, (0.0, 20.0, 0.0), point=place)
        simulation.step()
        spins.append(simulation.velocities[-1, 5])
    assert spins[0] < -1.0 < abs(spins[1]) + 1.0 and spins[2] > 1.0
    assert spins[0] == pytest.approx(-spins[2], rel=0.3)


def test_an_angular_impulse_loads_a_brick_that_holds():
    """Hand the moment of a blow on to the stresses of the wall."""
    simulation = simulate(wall(4, 6))
    state, top = simulation.state, len(simulation.poses) - 1
    before = state.solver.displacement[top].copy()
    assert not simulation.apply_impulse(top, angular=(3.0, 0.0, 0.0))
    simulation.step()
    turned = state.solver.displacement[top, 3:] - before[3:]
    assert abs(turned[0]) > 5.0 * max(abs(turned[1]), abs(turned[2])) > 0.0


def test_what_is_gone_takes_no_force():
    """Refuse impulses and lasting forces on parts that were pulverised."""
    simulation = simulate(wall(4, 4))
    take_out(simulation, np.array([3]))
    for command in (simulation.apply_impulse, simulation.apply_wrench):
        with pytest.raises(CommandError, match='exists no more'):
            command(3, (1.0, 0.0, 0.0))


def test_a_log_of_nothing_stays_empty():
    """Record what broke a thousand times without anything broken: nothing is kept."""
    log, none = EventLog(), np.zeros(0, np.intp)
    for _ in range(1000):
        log.record(0.0, np.zeros((0, 3)), none, np.zeros((0, 2), np.intp), none, none)
    assert not log._chunks and log.total == 0 and not len(log.rows)


def test_a_load_given_in_a_step_acts_in_that_step():
    """Load a wall by a stage of one's own: the bonds carry it in the same step."""
    simulation = simulate(wall(3, 3))
    state, push = simulation.state, np.array([[0.0, 0.0, -500.0, 0.0, 0.0, 0.0]])
    names = [stage.name for stage in STAGES]

    def weigh():
        graph = state.solver.graph
        feet = graph.grounded()
        return (np.einsum('kij,kj->ki', graph.axes[feet], state.solver.wrenches()[feet, :3])
                * np.where(graph.first[feet] == graph.count, -1.0, 1.0)[:, None])[:, 2].sum()
    before = weigh()
    for name in ('cues', 'contact', 'branches'):
        place = names.index(name) + 1
        load = Stage('load', lambda model, state, dt: state.loads.set_layer('x', [8], push))
        simulation.stages = (*STAGES[:place], load, *STAGES[place:])
        simulation.step(1)
        assert weigh() - before == pytest.approx(500.0, rel=0.02), name
        state.loads.remove_layer('x')
        simulation.stages = STAGES
        simulation.step(20)


def test_every_stage_says_what_it_does():
    """Describe each stage where it stands, and time each by its name, which is its own."""
    assert len({stage.name for stage in STAGES}) == len(STAGES)
    for stage in STAGES:
        assert stage.step.__doc__, stage.name
    simulation = simulate(wall(3, 3))
    simulation.step(2)
    assert simulation.timings.keys() == {stage.name for stage in STAGES}


def test_a_stage_can_be_added():
    """Step a stage of somebody else's between the others."""
    simulation, seen = simulate(wall(3, 3)), []
    simulation.stages = (*STAGES, Stage('spy', lambda model, state, dt: seen.append(state.time)))
    simulation.step(3)
    assert seen == pytest.approx([0.0, 1 / 60, 2 / 60])
    assert 'spy' in simulation.timings
