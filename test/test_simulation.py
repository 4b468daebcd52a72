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

"""The whole simulation: commands, determinism, breaking, reset."""

import gc
import weakref

import numpy as np
import pytest

from procphys_ros.errors import CommandError, ProcPhysError, SceneError
from procphys_ros.export import export, export_animation
from procphys_ros.files.resources import shared_folder
from procphys_ros.lsystem import LSystem
from procphys_ros.recording.recorder import Recorder
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, Simulation
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


def test_a_tree_at_rest_stays_exactly_at_rest():
    """Keep every part where it was authored for ten seconds of still air."""
    simulation = grow()
    simulation.step(600)
    assert np.abs(simulation.poses - simulation.blueprint.poses).max() < 1e-9
    assert simulation.time == pytest.approx(10.0)


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


def test_time_does_not_run_backwards():
    """Refuse a negative number of steps."""
    with pytest.raises(CommandError, match='is -1, it must be a whole number, 0 or more'):
        grow().step(-1)


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
    (lambda s: s.add(LSystem), "object_0 is <class '.*it must be a Blueprint; `build`"),
    (lambda s: s.add(s.blueprint, (0.0, 0.0, 0.0), 'east'), "object_0.yaw is 'east'"),
    (lambda s: s.add(s.blueprint, (0.0, 'b', 0.0)), "object_0.position is 'b'"),
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
    (lambda b: Simulation(b), 'Blueprint.* is no scene; .* and Scene.add places'),
    (lambda b: Scene.from_parameters(3), 'the parameters are 3, they must be a mapping'),
    (lambda b: Scene().add(b, np.array(3.0)), 'must be a list of 3 numbers'),
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


def test_same_seed_and_commands_give_the_same_poses():
    """Repeat a run with wind, impulses and breaks bit for bit; another seed differs."""
    def run(seed):
        simulation = Simulation(grow(2e7, 3).scene, seed=seed)
        simulation.set_wind((22.0, 3.0, 0.0))
        simulation.step(30)
        simulation.apply_impulse('tree_2/5', (0.0, 40.0, 0.0))
        simulation.step(50)
        return simulation
    first, second, other = run(3), run(3), run(4)
    assert first.bonds_broken > 0
    assert np.array_equal(first.poses, second.poses)
    assert not np.array_equal(first.poses, other.poses)


def test_what_breaks_off_falls_and_comes_to_rest():
    """
    Break a branch by a blow: it is reported, falls, and lies still on the ground.

    It has a slight bend, on which it rocks for a while before it lies still.
    """
    simulation = grow(strength=2e7)
    simulation.apply_impulse('tree_0/segment_3', (0.0, 60.0, -60.0))
    simulation.step(30)
    events = simulation.events
    assert len(events) and events['cause'][0] == Cause.BENDING and events['load'][0] > 1.0
    assert simulation.awake_bodies > 0
    while simulation.awake_bodies and simulation.time < 60.0:
        simulation.step(60)
    off = simulation.blueprint.bonds[events['bond'], 1]
    assert simulation.awake_bodies == 0
    assert (simulation.poses[off, 2] < 0.6).all() and (simulation.poses[:, 2] > 0.0).all()
    assert np.abs(simulation.velocities[off]).max() == 0.0


def test_a_broken_branch_keeps_its_momentum():
    """Take over the momentum of the branch at the moment it comes off."""
    simulation = grow(strength=1e5)
    simulation.apply_impulse('tree_0/segment_5', (3.0, 0.0, 0.0))
    mass = simulation.blueprint.mass
    while not simulation.bonds_broken:
        before = simulation.velocities.copy()
        simulation.step()
    off = np.flatnonzero(simulation.state.carrier >= 0)
    after = mass[off] @ simulation.velocities[off, :3]
    weight = np.array([0.0, 0.0, -9.81 * mass[off].sum() * simulation.time_step])
    assert np.isfinite(before).all()
    assert np.linalg.norm(after) > 0.0
    assert np.linalg.norm(after - weight) < 3.5


def test_reset_restores_everything():
    """Bring back poses, time, whole bonds and the first wind, and repeat the same run."""
    simulation = grow(strength=8e6, count=2)
    simulation.set_wind((45.0, 0.0, 0.0))
    simulation.step(60)
    first = simulation.poses.copy()
    assert simulation.bonds_broken
    simulation.reset()
    assert np.array_equal(simulation.poses, simulation.blueprint.poses)
    assert simulation.time == 0.0 and simulation.bonds_broken == 0
    simulation.step(60)
    assert np.abs(simulation.poses - simulation.blueprint.poses).max() < 1e-9
    simulation.reset()
    simulation.set_wind((45.0, 0.0, 0.0))
    simulation.step(60)
    assert np.array_equal(simulation.poses, first)


@pytest.mark.parametrize(('given', 'words'), [
    ({'time_step': 0.0}, 'time_step is 0, it must be'), ({'time_step': np.nan}, 'is nan'),
    ({'time_step': -0.01}, 'time_step'), ({'seed': -1}, 'seed is -1'), ({'seed': 1.5}, 'seed'),
    ({'engine': 'havok'}, 'engine')])
def test_settings_out_of_range_are_refused(given, words):
    """Take from a program what a scene file may hold, and nothing else."""
    with pytest.raises(SceneError, match=words):
        Simulation(Scene(), **given)


def test_what_is_no_command_is_refused():
    """Name what was given in place of a gust."""
    with pytest.raises(CommandError, match="'strong' is no command"):
        Simulation(Scene()).gust('strong')


@pytest.mark.parametrize('position', [(0.0, 0.0), (0.0, 0.0, np.nan), 5.0, (0.0, 0.0, 0.0, 1.0)])
def test_places_that_are_none_are_refused(position):
    """Say so when a scene is made, and when an object is to join."""
    tree = LSystem.parse(TREE.format(strength=5e7)).build()
    with pytest.raises(SceneError, match='must be'):
        Scene().add(tree, position)
    with pytest.raises(CommandError, match='must be'):
        Simulation(Scene()).add(tree, position)


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
