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

"""URDF and SDF: joints of mechanisms, as PyBullet reads and moves them."""

import xml.etree.ElementTree as ElementTree

from exported import scene_of, written
import numpy as np
import pybullet
import pytest

from procphys_ros.geometry import rotation
from procphys_ros.mechanism import MechanismGrammar
from procphys_ros.simulation import Simulation

_MACHINE = """mechanism m {
    box post { size: 0.2, 0.2, 3  at: 0, 0, 1.5  weld {} }
    box arm { size: 1, 0.1, 0.1  at: 0.6, 0, 2  turn: 0, 20, 0
        hinge turn { to: post  at: 0.1, 0, 2  axis: 0, 1, 2  limits: -40, 70  damper: 3
            friction: 2  spring: 5, 10  motor: 0, 90, 60 } }
    box hand { size: 0.2, 0.1, 0.1  at: 1.2, 0, 2
        slider reach { to: arm  axis: 1, 0, 0  limits: -0.1, 0.3 } }
    rod bob { from: 1.2, 0, 1.9  to: 1.2, 0, 1.2  diameter: 0.05
        ball { to: hand  at: 1.2, 0, 1.9 } }
    wheel wheel { diameter: 0.5  width: 0.1  at: 0, 0.2, 2
        hinge axle { to: post  axis: 0, 1, 0 } }
    box cart { size: 1, 0.5, 0.2  at: 5, 0, 0.2 hinge hook { to: bob  at: 1.2, 0, 1.2 } }
    box load { size: 1, 0.5, 0.2  at: 8, 0, 0.2 } }"""


def bullet(path, client):
    """Load a URDF without PyBullet's own motors and damping; return it and its joints by name."""
    body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
    infos = [pybullet.getJointInfo(body, i, physicsClientId=client)
             for i in range(pybullet.getNumJoints(body, physicsClientId=client))]
    for info in infos:
        if info[2] != pybullet.JOINT_FIXED:
            pybullet.setJointMotorControl2(body, info[0], pybullet.VELOCITY_CONTROL, force=0.0,
                                           physicsClientId=client)
        pybullet.changeDynamics(body, info[0], linearDamping=0.0, angularDamping=0.0,
                                physicsClientId=client)
    return body, {info[1].decode(): info for info in infos}


@pytest.fixture
def client():
    """Connect to a world of PyBullet's own."""
    number = pybullet.connect(pybullet.DIRECT)
    yield number
    pybullet.disconnect(number)


def test_urdf_has_the_joints_of_a_machine_under_way(tmp_path, client):
    """Find kinds, places, axes, limits, damping, friction and motors, from where joints are."""
    simulation = Simulation(scene_of(m=MechanismGrammar.parse(_MACHINE).build()))
    simulation.drive_joint('m/turn', 'velocity', 0.7)
    simulation.step(30)
    path, content = written(simulation, tmp_path / 'm.urdf')
    table, names = content.blueprint.joints, content.joint_names
    body, joints = bullet(path, client)
    turned = simulation.joints.position[simulation.joints.names.index('m/turn')]
    assert turned > 0.2
    info = joints['m_turn']
    assert info[6:12] == pytest.approx((3.0, 2.0, np.radians(-40.0) - turned,
                                        np.radians(70.0) - turned, 90.0, np.radians(60.0)),
                                       abs=1e-6)
    assert [joints[name][2] for name in ('m_reach', 'm_axle', 'm_hook')] == [
        pybullet.JOINT_PRISMATIC, pybullet.JOINT_REVOLUTE, pybullet.JOINT_REVOLUTE]
    assert joints['m_axle'][8] > joints['m_axle'][9]  # continuous
    assert sum('bob' in name for name in joints) == 3
    for name in ('m_turn', 'm_reach', 'm_axle', 'm_hook'):
        row = names.index(name.replace('_', '/', 1))
        part = int(table.parts[row, 1])
        frame = rotation.compose(content.poses[part], rotation.relative(
            content.blueprint.poses[part], table.frame[row]))
        state = pybullet.getLinkState(body, joints[name][0], physicsClientId=client)
        assert np.allclose(state[4], frame[:3], atol=1e-5)
        assert np.allclose(state[0], content.poses[part, :3], atol=1e-5)
        axis = rotation.rotate(np.array(state[1]), np.array(joints[name][13]))
        assert np.allclose(axis, rotation.rotate(frame[3:], np.array([1.0, 0.0, 0.0])), atol=1e-5)


def zero_crossings(values, step):
    """Return the mean time between passages upwards through zero [s]."""
    values = np.asarray(values)
    at = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    moments = at + values[at] / (values[at] - values[at + 1])
    return step * np.diff(moments).mean()


def test_a_door_swings_as_in_bullet(tmp_path, client):
    """Let a heavy door on a leaning hinge swing for 8 s in both programs."""
    scene = scene_of(m=MechanismGrammar.parse("""mechanism m {
        box post { size: 0.1, 0.1, 4  at: 0, 0, 2  weld {} }
        box door { size: 0.9, 0.04, 1.8  at: 0.5, 0, 3  mass: 30  material: oak
            hinge { to: post  at: 0.05, 0, 3  axis: 1, 0.5, 3 } } }""").build())
    simulation = Simulation(scene)
    ours = []
    for _ in range(round(8.0 / simulation.time_step)):
        simulation.step()
        ours.append(simulation.joints.position[0])
    path, _ = written(scene, tmp_path / 'm.urdf')
    body, joints = bullet(path, client)
    pybullet.setGravity(0.0, 0.0, -scene.settings.gravity, physicsClientId=client)
    pybullet.setTimeStep(1e-3, physicsClientId=client)
    theirs = []
    for _ in range(8000):
        pybullet.stepSimulation(physicsClientId=client)
        theirs.append(pybullet.getJointState(body, joints['m_door'][0], physicsClientId=client)[0])
    middle = 0.5 * (min(theirs) + max(theirs))
    assert 0.3 < np.ptp(theirs) < 3.0
    assert np.ptp(ours) == pytest.approx(np.ptp(theirs), rel=0.02)
    assert zero_crossings(np.subtract(ours, middle), simulation.time_step) == pytest.approx(
        zero_crossings(np.subtract(theirs, middle), 1e-3), rel=0.02)


def test_sdf_has_joints_of_any_graph_and_tells_of_ropes(tmp_path, caplog, client):
    """Write loops as joints at their places; both formats tell what they leave out."""
    text = _MACHINE.replace('box load {', """box load {
        hinge loop { to: hand  at: 7.5, 0, 0.2  axis: 1, 0, 0  limits: -10, 20 }
        hinge pin { to: cart  at: 6, 0, 0  spring: 7, 30 }
        rope line { to: post  at: 8, 0, 0.2  end: 0, 0, 3 }""")
    scene = scene_of(m=MechanismGrammar.parse(text).build())
    path, content = written(scene, tmp_path / 'm.sdf')
    assert 'm/line' in caplog.text and 'm/pin' not in caplog.text
    model = next(e for e in ElementTree.parse(path).getroot()[0].findall('model')
                 if e.get('name') == 'm')
    names = [element.get('name') for element in model]
    assert len(set(names)) == len(names)
    joints = {e.get('name'): e for e in model.findall('joint')}
    links = {e.get('name'): np.array([float(x) for x in e.findtext('pose').split()])
             for e in model.findall('link') if e.get('name') != 'base'}
    assert [joints[name].get('type') for name in ('m_turn', 'm_reach', 'm_loop')] == [
        'revolute', 'prismatic', 'revolute']
    assert 'ball' in {e.get('type') for e in joints.values()}
    loops = [e for e in joints.values() if e.find('pose') is not None]
    assert len(loops) == 1 and len(joints) == len(content.blueprint.joints) - 1
    there = content.blueprint.joints.frame[content.joint_names.index(
        loops[0].get('name').replace('_', '/', 1)), :3]
    link = links[loops[0].findtext('child')]
    turn = [rotation.from_axis_angle(axis, a) for axis, a in zip(np.eye(3), link[3:])]
    local = np.array([float(x) for x in loops[0].findtext('pose').split()])
    turned = rotation.multiply(turn[2], rotation.multiply(turn[1], turn[0]))
    assert np.allclose(link[:3] + rotation.rotate(turned, local[:3]), there, atol=1e-6)
    spring = joints['m_pin'].find('axis/dynamics')
    assert float(spring.findtext('spring_stiffness')) == pytest.approx(7.0)
    assert float(spring.findtext('spring_reference')) == pytest.approx(np.radians(30.0))
    caplog.clear()
    written(scene, tmp_path / 'm.urdf')
    assert 'm/line' in caplog.text and 'm/pin' in caplog.text


def test_bullet_loads_machines_and_what_hangs_on_walls_from_sdf(tmp_path, client):
    """Put every link of a machine without ball joints in its place."""
    text = """mechanism m {
        box post { size: 0.1, 0.1, 2  at: 0, 0, 1  weld {} }
        box door { size: 0.9, 0.04, 1.8  at: 0.5, 0, 1.2
            hinge { to: post  at: 0.05, 0, 1.2  axis: 0, 0, 1  limits: -90, 0 } } }"""
    path, content = written(scene_of(m=MechanismGrammar.parse(text).build()), tmp_path / 'm.sdf')
    body = pybullet.loadSDF(str(path), physicsClientId=client)[-1]
    infos = {info[1].decode(): info for info in (
        pybullet.getJointInfo(body, i, physicsClientId=client) for i in range(2))}
    assert infos['m_door'][8:10] == pytest.approx((-0.5 * np.pi, 0.0))
    for part, name in enumerate(('m_post', 'm_door')):
        state = pybullet.getLinkState(body, infos[name][0], physicsClientId=client)
        assert np.allclose(state[0], content.poses[part, :3], atol=1e-5)
