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

"""URDF files as mechanisms: what they become, how they move, and what is refused."""

import re
import warnings

from exported import grown, PLACE, scene_of, written, YAW
import numpy as np
import pybullet
import pytest

from procphys_ros.blueprint import GROUND, JointType, Shape
from procphys_ros.errors import GrammarError, ProcPhysError, SceneError
from procphys_ros.files.file_bounds import FileBounds, within
from procphys_ros.files.resources import shared_folder
from procphys_ros.geometry import rotation
from procphys_ros.mechanism import RobotGrammar
from procphys_ros.physics.world.assembly import rigid_sum
from procphys_ros.scene import Scene
from procphys_ros.scene.sources import load_grammar, parse_grammar
from procphys_ros.simulation import Simulation

_ARM = (shared_folder() / 'grammars' / 'arm.urdf').read_text('utf-8')
_BOX = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
_HEAVY = ('<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" '
          'iyz="0"/></inertial>')


def robot(body: str, **defines: float):
    """Build the robot of some links and joints."""
    return RobotGrammar.parse(f'<robot name="r">{body}</robot>').build(**defines)


def joined(kind: str, inside: str = '', link: str = _HEAVY + _BOX) -> str:
    """Return a world and an arm with a joint between them."""
    return (f'<link name="world"/><link name="arm">{link}</link><joint name="j" type="{kind}">'
            f'<parent link="world"/><child link="arm"/>{inside}</joint>')


@pytest.mark.parametrize('name', ['gate', 'crane', 'windmill'])
def test_a_machine_returns_from_its_urdf(name, tmp_path):
    """Find masses, places, inertia, joints, axes and limits of what was exported."""
    first = grown(f'{name}.mech').placed(PLACE, YAW)
    path, content = written(scene_of(m=grown(f'{name}.mech')), tmp_path / 'm.urdf')
    again = RobotGrammar.load(path).build()
    assert len(again) == len(first)
    known = [again.kinds[kind] for kind in again.kind]
    names = [part.replace('/', '_') for part in content.full_names]
    order = [known.index('ball' if 'ball' in part else part) for part in names]
    np.testing.assert_allclose(again.mass[order], first.mass, rtol=1e-6)
    np.testing.assert_allclose(again.inertia[order], first.inertia, rtol=1e-6)
    np.testing.assert_allclose(again.poses[order, :3], first.poses[:, :3], atol=1e-6)
    np.testing.assert_allclose(again.size[order], first.size, atol=1e-6)
    old, new = first.joints, again.joints
    mine = {again.joint_names[row]: k for k, row in enumerate(new.name.tolist())}
    compared = 0
    for k, joint in enumerate(content.joint_names):
        row = mine.get(joint.replace('/', '_'))
        if row is None or old.kind[k] == JointType.WELD:
            continue
        compared += 1
        assert new.kind[row] == old.kind[k]
        np.testing.assert_allclose(new.frame[row, :3], old.frame[k, :3], atol=1e-6)
        axes = [rotation.rotate(table.frame[i, 3:], np.array([1.0, 0.0, 0.0]))
                for table, i in ((new, row), (old, k))]
        if old.kind[k] != JointType.BALL:
            np.testing.assert_allclose(*axes, atol=1e-6)
            for column in ('low', 'high', 'damping', 'friction', 'effort'):
                np.testing.assert_allclose(getattr(new, column)[row], getattr(old, column)[k],
                                           rtol=1e-6, err_msg=column)
    assert compared == np.count_nonzero(old.kind != JointType.WELD) - (name == 'gate')


def test_a_crane_from_urdf_swings_as_the_one_that_was_exported(tmp_path):
    """Keep the ball of the crane within a millimetre for a second of its swing."""
    scene = scene_of(m=grown('crane.mech'))
    path, _ = written(scene, tmp_path / 'm.urdf')
    other = Scene()
    other.add(RobotGrammar.load(path).build(), name='m')
    ends = []
    for one in (scene, other):
        simulation = Simulation(one)
        simulation.step(60)
        ends.append(simulation.poses[-1, :3])
    np.testing.assert_allclose(*ends, atol=1e-3)
    assert np.abs(ends[0] - scene.blueprint.poses[-1, :3]).max() > 1.0


def test_links_have_the_mass_and_inertia_of_the_file():
    """Sum the parts of a link with two solids, a mass off their middles, and a massless sensor."""
    made = robot("""<link name="base"><inertial><origin xyz="0.3 0 0.1" rpy="0.3 0.2 0.1"/>
        <mass value="7"/><inertia ixx="1" iyy="2" izz="2.5" ixy="0.1" ixz="-0.2" iyz="0.05"/>
        </inertial><collision><origin xyz="0 0 0.5"/><geometry><box size="1 1 1"/></geometry>
        </collision><collision><origin xyz="1 0 0.5" rpy="0 1.5708 0"/><geometry>
        <cylinder radius="0.1" length="2"/></geometry></collision></link>
        <link name="eye"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>
        <joint name="mount" type="fixed"><parent link="base"/><child link="eye"/>
        <origin xyz="0 0 1.2"/></joint>""")
    assert [made.kinds[kind] for kind in made.kind] == ['base', 'base', 'base', 'ball']
    assert (made.joints.kind == JointType.WELD).all() and len(made.joints) == 3
    body = rigid_sum(made.mass, made.inertia, made.poses)
    assert body.mass == pytest.approx(7.0, rel=1e-5)
    np.testing.assert_allclose(body.pose[:3], [0.3, 0.0, 0.1], atol=1e-5)
    tensor = np.array([[1, 0.1, -0.2], [0.1, 2, 0.05], [-0.2, 0.05, 2.5]])
    np.testing.assert_allclose(np.sort(body.inertia), np.linalg.eigvalsh(tensor), rtol=1e-4)
    turn = rotation.to_matrix(body.pose[3:])
    mine = turn @ np.diag(body.inertia) @ turn.T
    own = np.eye(3)
    for axis, angle in zip(np.eye(3), (0.3, 0.2, 0.1)):
        own = rotation.to_matrix(rotation.from_axis_angle(axis, angle)) @ own
    np.testing.assert_allclose(mine, own @ tensor @ own.T, atol=1e-3)


def test_a_robot_swings_as_in_bullet(tmp_path):
    """Let an arm of two links with masses off their middles swing for 3 s in both programs."""
    text = """<robot name="r"><link name="base"/>
      <link name="one"><inertial><origin xyz="0.1 0.05 -0.5"/><mass value="3"/>
        <inertia ixx="0.3" iyy="0.25" izz="0.1" ixy="0.02" ixz="0.03" iyz="0.01"/></inertial>
        <collision><origin xyz="0 0 -0.4"/><geometry><box size="0.1 0.1 0.7"/></geometry>
        </collision></link>
      <link name="two"><inertial><origin xyz="0 0 -0.3"/><mass value="1"/>
        <inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0.004"/></inertial>
        <collision><origin xyz="0 0 -0.3"/><geometry><cylinder radius="0.04" length="0.5"/>
        </geometry></collision></link>
      <joint name="a" type="continuous"><parent link="base"/><child link="one"/>
        <origin xyz="0 0 3" rpy="0.2 0.9 0"/><axis xyz="0.2 1 0"/></joint>
      <joint name="b" type="revolute"><parent link="one"/><child link="two"/>
        <origin xyz="0 0 -0.9" rpy="0 0 0.4"/><axis xyz="0 -1 0"/>
        <limit lower="-2" upper="2" effort="0" velocity="10"/>
        <dynamics damping="0.2"/></joint></robot>"""
    path = tmp_path / 'r.urdf'
    path.write_text(text)
    scene = Scene()
    scene.add(load_grammar(str(path), 'test').build(fixed=1, b=0.5), name='r')
    simulation = Simulation(scene)
    client = pybullet.connect(pybullet.DIRECT)
    body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client,
                             flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    for i in (-1, 0, 1):
        pybullet.changeDynamics(body, i, linearDamping=0.0, angularDamping=0.0,
                                physicsClientId=client)
    for i in (0, 1):
        pybullet.setJointMotorControl2(body, i, pybullet.VELOCITY_CONTROL, force=0.0,
                                       physicsClientId=client)
    pybullet.resetJointState(body, 1, 0.5, physicsClientId=client)
    pybullet.setGravity(0.0, 0.0, -scene.settings.gravity, physicsClientId=client)
    pybullet.setTimeStep(1.0 / 4800.0, physicsClientId=client)
    ours, theirs = [], []
    for _ in range(60):
        simulation.step()
        for _ in range(80):
            pybullet.stepSimulation(physicsClientId=client)
        ours.append(dict(zip(simulation.joints.names, simulation.joints.position)))
        theirs.append([pybullet.getJointState(body, i, physicsClientId=client)[0]
                       for i in (0, 1)])
    pybullet.disconnect(client)
    theirs = np.array(theirs)
    assert np.ptp(theirs, axis=0).min() > 0.3
    for k, name in enumerate(('r/a', 'r/b')):
        found = np.array([row[name] for row in ours])
        assert np.abs(found - theirs[:, k]).max() < 0.05 * np.ptp(theirs[:, k]), name


def test_joints_keep_the_zero_of_the_file():
    """Start at the nearest displacement allowed, or as defined; tell and take the file's own."""
    text = joined('revolute', '<axis xyz="0 0 1"/><limit lower="0.4" upper="2" effort="50" '
                  'velocity="3"/>')
    for start, defines in ((0.4, {}), (1.0, {'j': 1.0})):
        scene = Scene()
        scene.add(robot(text, **defines).placed((0.0, 0.0, 1.0)), name='r')
        simulation = Simulation(scene)
        simulation.step()
        assert simulation.joints.position == pytest.approx([start], abs=1e-4)
        simulation.drive_joint('r/j', 'position', 1.6)
        simulation.step(60)
        assert simulation.joints.position == pytest.approx([1.6], abs=1e-3)
        arm = simulation.poses[-1, 3:]
        assert 2.0 * np.arctan2(arm[2], arm[3]) == pytest.approx(1.6, abs=1e-3)
        simulation.drive_joint('r/j', 'position', 3.0)
        simulation.step(60)
        assert simulation.joints.position == pytest.approx([2.0], abs=1e-3)
    with pytest.raises(GrammarError, match='define is 0.1, limits are 0.4 to 2'):
        robot(text, j=0.1)


def test_the_shipped_arm_lifts_a_block():
    """Grip a block of 1 kg, lift it, and turn it by a quarter, from the ground."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['arm', 'block'], 'cues': [
            '0.2 joint target=arm/left mode=position value=0.05',
            '0.2 joint target=arm/right mode=position value=0.05',
            '1.0 joint target=arm/shoulder mode=position value=1.0',
            '1.0 joint target=arm/wrist mode=position value=-0.35',
            '2.0 joint target=arm/turn mode=position value=1.57']},
        'arm': {'grammar': 'arm.urdf', 'defines': ['shoulder=1.83', 'elbow=0.93', 'wrist=-1.19']},
        'block': {'origin': [0.6, 0.0, 0.0], 'grammar_text': 'mechanism block { box block { '
                  'size: 0.06, 0.06, 0.2  at: 0, 0, 0.1  mass: 1 } }'}})
    simulation = Simulation(scene)
    simulation.step(round(3.5 / simulation.time_step))
    np.testing.assert_allclose(simulation.poses[-1, :3], [0.0, 0.72, 0.59], atol=0.05)


def test_bases_are_free_unless_they_are_the_world():
    """Weld the world, or what a define fixes; raise a free robot out of the ground."""
    base = f'<link name="base">{_HEAVY}{_BOX}</link>'
    assert robot(base).poses[0, 2] == pytest.approx(0.1)
    fixed = robot(base, fixed=1)
    assert fixed.joints.parts.tolist() == [[GROUND, 0]] and fixed.poses[0, 2] == 0.0
    assert robot(joined('fixed')).joints.kind.tolist() == [JointType.WELD]
    assert len(robot(joined('floating')).joints) == 0
    footprint = joined('fixed').replace('world', 'base_footprint')
    assert len(robot(footprint).joints) == 0
    with pytest.raises(GrammarError, match='call it "world", or set the define fixed=1'):
        robot(joined('continuous').replace('world', 'base'))


def test_shapes_become_parts(tmp_path):
    """Make rods, wheels, balls, capsules, and the box around a mesh, which is drawn."""
    def made(shape, folder=None):
        body = (f'<robot name="r"><link name="a">{_HEAVY}<visual><geometry>{shape}</geometry>'
                '</visual></link></robot>')
        return RobotGrammar.parse(body, folder=folder).build()
    assert made('<cylinder radius="0.1" length="1"/>').size[0] == pytest.approx([0.2, 0.2, 1.0])
    capsule = made('<capsule radius="0.1" length="1"/>')
    assert capsule.size[0] == pytest.approx([0.2, 0.2, 1.2])
    wheel = made('<cylinder radius="0.5" length="0.1"/>')
    np.testing.assert_allclose(np.abs(wheel.poses[0, 3:]), [0, 0, 0, 1], atol=1e-12)
    assert wheel.inertia[0] == pytest.approx([0.1, 0.1, 0.1])
    assert made('<sphere radius="0.3"/>').balls.all()
    trimesh = pytest.importorskip('trimesh')
    shape = trimesh.creation.icosphere(1, 0.5)
    shape.apply_translation([1.0, 0.0, 0.0])
    for folder in ('meshes', 'urdf'):
        (tmp_path / 'my_robot' / folder).mkdir(parents=True)
    shape.export(tmp_path / 'my_robot' / 'meshes' / 'm.stl')
    for name in ('../meshes/m.stl', 'package://my_robot/meshes/m.stl'):
        mesh = made(f'<mesh filename="{name}" scale="1 1 2"/>', tmp_path / 'my_robot' / 'urdf')
        assert mesh.shape[-1] == Shape.BOX and mesh.size[-1] == pytest.approx([1, 1, 2], abs=0.1)
        assert mesh.poses[:, 0] == pytest.approx([0.0, 1.0]) and len(mesh.ornaments) == 80
    with within(FileBounds((tmp_path / 'elsewhere',), {})), pytest.raises(
            GrammarError, match='outside of the folders that files.root allows'):
        made('<mesh filename="../meshes/m.stl"/>', tmp_path / 'my_robot' / 'urdf')
    with pytest.raises(GrammarError, match='cannot be read'):
        made('<mesh filename="/dev/zero"/>', tmp_path)


@pytest.mark.parametrize('body, message', [
    ('<link name="a"/><link name="a"/>', '<link name="a">: there is another one of this name'),
    ('', '<robot name="r">: a robot needs a <link>'),
    (joined('hinge'), 'type="hinge" is not a type of joints (revolute, continuous, prismatic, '
     'fixed, floating)'),
    (joined('planar'), 'planar joints are not there (revolute'),
    (joined('revolute'), '<joint name="j">: needs <limit>'),
    (joined('revolute', '<limit lower="1" upper="0" effort="1" velocity="1"/>'),
     '<limit>: lower="1" must not be above upper="0"'),
    (joined('revolute', '<limit effort="-1" velocity="1"/>'), 'effort="-1" must be from 0 to'),
    (joined('continuous', '<axis xyz="0 0"/>'), '<axis>: xyz="0 0" must be 3 finite numbers'),
    (joined('continuous', '<axis xyz="0 0 0"/>'), 'xyz="0 0 0" has no direction'),
    (joined('continuous', '<axis xyz="0 nan 1"/>'), 'must be 3 finite numbers'),
    (joined('fixed', '<origin xyz="0 0 1e5"/>'), 'xyz="0 0 1e5" must be from -1000 to 1000 m'),
    (joined('fixed').replace('parent link="world"', 'parent link="wrld"'),
     'link="wrld" is not a link; did you mean world?'),
    (joined('fixed') + '<link name="b"/>', 'has one link that is no child of a joint, this one '
     'has 2: world, b'),
    (joined('fixed') + '<joint name="k" type="fixed"><parent link="arm"/><child link="arm"/>'
     '</joint>', 'the link "arm" is the child of "j" already'),
    (joined('continuous', link=_BOX), '<link name="arm">: it moves and has no mass'),
    (joined('fixed', link=_HEAVY.replace('0.1"', '-1"')), 'principal moments must be above 0'),
    (joined('fixed', link='<visual><geometry><cone/></geometry></visual>'),
     'needs one of <box>, <cylinder>, <sphere>, <capsule>, <mesh>'),
    (joined('fixed', link=_BOX.replace('0.2 0.2 0.2', '0.2 0 0.2')),
     'size="0.2 0 0.2" must be from 0.001 to 1000 m each'),
    (joined('fixed', link='<visual><geometry><mesh filename="a.stl"/></geometry></visual>'),
     'a robot given as text has no meshes'),
    ('<link name="${prefix}arm"/>', 'is xacro, which is not read: run "xacro FILE > robot.urdf"'),
    ('<link name="a">', 'this is no XML: mismatched tag'),
    ('<a>' * 200 + '</a>' * 200, 'more than 100 elements inside each other'),
])
def test_errors_name_place_and_remedy(body, message):
    """Tell file, line and column, the element, the attribute, and what is allowed."""
    with pytest.raises(GrammarError, match=re.escape(message)) as caught:
        robot('\n' + body)
    assert re.match(r'<text>:\d+:\d+: ', str(caught.value))


def test_what_is_no_urdf_is_refused_and_what_is_left_out_is_told(tmp_path):
    """Refuse document types, other roots and xacro files; find URDF texts; tell of mimics."""
    bomb = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><robot name="&b;"/>'
    for text, message in ((bomb, 'document type'), ('<sdf/>', 'a URDF begins with <robot>')):
        with pytest.raises(GrammarError, match=message):
            parse_grammar(text, 'r.grammar_text')
    (tmp_path / 'r.urdf.xacro').write_text(_ARM)
    with pytest.raises(SceneError, match='run "xacro FILE > robot.urdf" first'):
        load_grammar(str(tmp_path / 'r.urdf.xacro'), 'r.grammar')
    assert len(parse_grammar(_ARM, 'r.grammar_text').build()) == 7
    with pytest.warns(match='mimic is left out: the joint "j" moves by itself'):
        robot(joined('continuous', '<mimic joint="k"/>'))


def test_mutated_files_are_errors_at_most():
    """Change, drop and double pieces of the shipped arm: refuse it or build what is finite."""
    generator = np.random.default_rng(7)
    pieces = re.findall(r'<[^>]*>|"[^"]*"|\s+|[^<>"\s]+', _ARM)
    words = ['"nan"', '"-1"', '"1e300"', '""', '"world"', '"0 0 0"', '"é"', '<link', '/>', '<',
             '&amp;', '&x;', ']]>', '"a b c"', '"\t"', '"foot"', 'revolute', '"planar"', '\x00']
    built = 0
    for _ in range(400):
        some = list(pieces)
        for _ in range(generator.integers(1, 4)):
            place, kind = int(generator.integers(len(some))), generator.integers(4)
            if kind == 0:
                some[place] = str(generator.choice(words))
            elif kind == 1:
                some[place] = re.sub('"[^"]*"', str(generator.choice(words)), some[place], count=1)
            elif kind == 2:
                del some[place]
            else:
                some.insert(place, some[int(generator.integers(len(some)))])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                made = RobotGrammar.parse(''.join(some), 'arm.urdf').build()
                Scene().add(made)
        except ProcPhysError as error:
            assert str(error).startswith('arm.urdf:') and '\n' not in str(error)
        else:
            built += 1
            assert np.isfinite(made.poses).all() and (made.mass > 0.0).all()
    assert 40 < built < 360
