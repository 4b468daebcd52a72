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

"""Doors and shutters of wall grammars: they hang on hinges, open, slam and tear off."""

import math

import numpy as np
import pytest

from procphys_ros.blueprint import JointType
from procphys_ros.errors import GrammarError, SceneError
from procphys_ros.scene import Scene
from procphys_ros.scene.joint_drive import DriveJoint
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.wallgrammar import WallGrammar

_SHED = """
building shed(width = 3, depth = 2.4)
  footprint: (0, 0) (width, 0) (width, depth) (0, depth)
  facades: front back plain side
  storey_height: 2.4
rule front -> split(x) { ~1: plain | 1: doorway | ~1: plain }
rule back -> split(x) { ~1: plain | 1: backdoor | ~1: plain }
rule side -> split(x) { ~1: plain | 1.2: window | ~1: plain }
rule doorway -> split(y) { 1.95: door | 0.225: lintel | ~1: plain }
rule backdoor -> split(y) { 1.95: inner | 0.225: lintel | ~1: plain }
rule window -> split(y) { 0.9: plain | 1.05: pane | 0.225: lintel | ~1: plain }
layout english { unit: 0.215 0.1025 0.065  material: brick }
panel plain: english
panel door: door(oak, left)
panel inner: door(oak, right, -100, 0)
panel pane: shutters(timber, glass, timber)
panel lintel: beam(concrete)
"""


def _simulation(text=_SHED, **more):
    return Simulation(Scene.from_parameters({
        'scene': {'objects': ['shed']}, 'engine': 'native', 'shed': {'grammar_text': text},
        **more}))


def _positions(simulation):
    readings = simulation.joints
    return dict(zip((name.partition('/')[2] for name in readings.names), readings.position))


def test_leaves_hang_on_their_posts():
    """Build a shed: each leaf has one upright hinge on a post beside it, and overlaps nothing."""
    built = WallGrammar.parse(_SHED).build()
    joints = built.joints
    assert [built.joint_names[n] for n in joints.name] == [
        'door_0', 'door_1', 'shutter_0', 'shutter_1']
    assert (joints.kind == JointType.HINGE).all()
    posts, leaves = joints.parts.T
    assert [built.kinds[k] for k in built.kind[posts]] == ['frame'] * 4
    assert np.array_equal(leaves, np.arange(len(built) - 4, len(built)))
    assert not np.isin(leaves, built.bonds).any()
    apart = np.abs(built.poses[posts, :2] - joints.frame[:, :2])
    assert apart.max() < 0.1
    assert built.mass[leaves[0]] == pytest.approx(640.0 * built.size[leaves[0]].prod())
    simulation = _simulation()
    assert simulation.warnings == ()
    before = simulation.poses[leaves].copy()
    simulation.step(60)
    assert simulation.bonds_broken == 0
    assert np.abs(simulation.poses[leaves] - before).max() < 1e-3


def test_walls_bear_the_weight_of_their_doors():
    """Hang doors on posts: what the walls bear more is their weight, at the arm of the hinge."""
    simulation = _simulation()
    simulation.step(30)
    parts, wrenches = simulation.state.loads.layer('hinges')
    leaves = simulation.blueprint.joints.parts[:, 1]
    assert -wrenches[:, 2].sum() == pytest.approx(
        9.81 * simulation.blueprint.mass[leaves].sum(), rel=1e-3)
    arm = simulation.poses[leaves, :2] - simulation.poses[parts, :2]
    weight = 9.81 * simulation.blueprint.mass[leaves]
    assert np.abs(wrenches[:, 4]) == pytest.approx(np.abs(arm[:, 0] * weight), rel=0.05, abs=1.0)
    assert np.abs(wrenches[:, 3]) == pytest.approx(np.abs(arm[:, 1] * weight), rel=0.05, abs=1.0)


def test_doors_open_to_their_side_and_shut_against_their_frames():
    """Turn the handles and push: one opens outwards, one inwards, each as far as it says."""
    simulation = _simulation()
    doors = {name: int(part) for name, part in zip(
        ('door_0', 'door_1'), simulation.blueprint.joints.parts[:2, 1])}
    for name in doors:
        simulation.drive_joint(f'shed/{name}', 'effort', 0.0)
    out = {'door_0': (0.0, -1.0, 0.0), 'door_1': (-1.0, 0.0, 0.0)}  # this opens inwards
    for name, way in out.items():
        simulation.apply_impulse(doors[name], 15.0 * np.array(way))
    simulation.step(60)
    open_ = _positions(simulation)
    assert open_['door_0'] > 0.5 and open_['door_1'] < -0.5
    for name, way in out.items():
        simulation.apply_impulse(doors[name], -25.0 * np.array(way))
    simulation.step(240)
    shut = _positions(simulation)
    assert shut['door_0'] > -0.01 and shut['door_1'] < 0.01
    assert simulation.bonds_broken == 0


def test_a_latch_holds_up_to_its_push():
    """Push at the edge of a shut door: it stays for 60 N, opens for 90 N, and is driven."""
    for force, opens in ((60.0, False), (90.0, True)):
        simulation = _simulation()
        part = int(simulation.blueprint.joints.parts[0, 1])
        width = simulation.blueprint.size[part, 0]
        simulation.apply_wrench(part, (0.0, -force, 0.0), (0.0, 0.0, -force * 0.5 * width))
        simulation.step(60)
        assert (_positions(simulation)['door_0'] > 0.05) == opens
    simulation.clear_wrenches()
    simulation.apply(DriveJoint('shed/door_0', 'position', math.radians(80.0)))
    simulation.step(240)
    assert _positions(simulation)['door_0'] == pytest.approx(math.radians(80.0), abs=0.02)


def test_a_door_opens_that_is_about_to_fall_asleep():
    """Drive a door that has rested for almost as long as it takes to sleep: it does not."""
    simulation = _simulation()
    simulation.step(30)
    simulation.drive_joint('shed/door_0', 'position', 1.0)
    simulation.step(90)
    assert _positions(simulation)['door_0'] > 0.9


def test_driving_a_door_does_not_crack_its_frame():
    """Open a door by its motor: what turns it does not turn its post."""
    simulation = _simulation()
    simulation.step(60)
    simulation.drive_joint('shed/door_0', 'position', 1.2)
    simulation.step(60)
    assert not simulation.state.solver.graph.cracked.any()
    parts, wrenches = simulation.state.loads.layer('hinges')
    assert np.abs(wrenches[:, 5]).max() < 5.0


def test_a_storm_opens_doors_and_tears_some_off():
    """Blow at a shed: in a breeze all stay shut; a storm opens leaves, and tears some off."""
    simulation = _simulation(wind={'velocity': [0.0, -6.0, 0.0]})
    simulation.step(120)
    assert max(map(abs, _positions(simulation).values())) < 0.01
    simulation.set_wind((0.0, -38.0, 0.0))
    left = _positions(simulation)
    while len(left) == 4 and max(map(abs, left.values())) <= 0.5:
        assert simulation.time < 7.0
        simulation.step(10)
        left = _positions(simulation)


def test_a_wall_that_falls_lets_its_door_go():
    """Shoot a door's post away: the door falls loose, the others hang on."""
    simulation = _simulation()
    simulation.launch(Projectile(shape='box', size=(1.0, 1.0, 1.0), mass=2000.0,
                                 position=(1.5, -6.0, 1.0), velocity=(0.0, 15.0, 0.0)))
    simulation.step(45)
    left = _positions(simulation)
    assert 'door_0' not in left and 'shutter_0' in left
    assert np.isfinite(simulation.poses).all()


def test_doors_are_saved_and_join():
    """Save and fork with an open door; a shed that joins has its own doors."""
    simulation = _simulation()
    simulation.drive_joint('shed/door_0', 'position', 1.0)
    simulation.step(30)
    data, other = simulation.save(), simulation.fork()
    simulation.step(30)
    other.step(30)
    assert np.array_equal(simulation.poses, other.poses)
    poses = simulation.poses.copy()
    simulation.restore(data)
    simulation.step(30)
    assert np.array_equal(simulation.poses, poses)
    simulation.add(WallGrammar.parse(_SHED).build(), (8.0, 0.0, 0.0), 0.5, 'late')
    simulation.step(10)
    assert {'late/door_0', 'shed/door_0'} <= set(simulation.joints.names)
    simulation.remove('shed')
    simulation.step(2)
    assert all(name.startswith('late/') for name in simulation.joints.names)


@pytest.mark.parametrize('panel,told', [
    ('door(oak)', '"door" takes 2 names'), ('door(oak, top)', 'its left or its right side'),
    ('door(oak, left, 10, 90)', 'opens from 10 to 90 degrees'),
    ('door(oak, left, 0, 0)', 'not both 0'), ('door(oak, left, 0)', '"door" takes 2 names'),
    ('door(sponge, left)', 'unknown material "sponge"'), ('door(1, left)', 'expected a name'),
    ('door(nail, left)', '"nail" joins parts and has no density'),
    ('shutters(timber, glass)', '"shutters" takes 3 names')])
def test_leaves_that_cannot_hang_are_refused(panel, told):
    """Name what is wrong with a panel, and where."""
    text = _SHED.replace('panel door: door(oak, left)', f'panel door: {panel}')
    with pytest.raises(GrammarError, match=told) as refused:
        WallGrammar.parse(text, 'shed.wall').build()
    assert 'shed.wall:' in str(refused.value)
    with pytest.raises(SceneError, match='which has no joints'):
        _simulation(engine='bullet')
