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

"""The command `export` and what all formats share: times, names, complaints."""

from pathlib import Path
import resource
import xml.etree.ElementTree as ElementTree

from exported import bent_in_wind, grown, scene_of, small_wall, written
from grown_trees import beam
import numpy as np
import pybullet
import pytest

from procphys_ros import export as exporter
from procphys_ros.errors import ExportError
from procphys_ros.export import command, Content, export, export_animation, formats
from procphys_ros.export.markup import roll_pitch_yaw
from procphys_ros.files import output_files
from procphys_ros.geometry import rotation
from procphys_ros.geometry.rotation import from_axis_angle, multiply
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

_SCENE = """
/**:
  ros__parameters:
    scene:
      objects: [wall, bush]
      cues: ["0.0 launch position=0.2,-1.5,0.3 velocity=0,25,0 mass=20 size=0.2"]
    wall: {grammar: garden_wall.wall, defines: ["length=0.89", "height=0.6"]}
    bush: {grammar: shrub.lsys, origin: [5.0, 0.0, 0.0]}
"""


@pytest.fixture
def scene_file(tmp_path):
    """Write a small scene in which a ball strikes a wall at once."""
    path = tmp_path / 'scene.yaml'
    path.write_text(_SCENE)
    return path


def test_content_of_a_run_names_what_broke(scene_file):
    """Hold the ball, its place, and the bonds that it broke."""
    content = Content.at(Scene.from_yaml(scene_file), 0.3, lambda done, whole: None)
    assert content.time == pytest.approx(0.3)
    assert len(content.full_names) == len(content.blueprint) == len(content.owner)
    assert content.full_names[0] == 'wall/brick_0'
    assert content.full_names[-1].split('/')[1] == 'projectile_0'
    assert content.broken.any() and not content.holds[content.broken].any()
    assert len(set(content.full_names)) == len(content.full_names)


def shapes_of(path):
    """Return the boxes in which the launched ball of a file lies, with and without physics."""
    if path.suffix in ('.urdf', '.sdf'):
        root = ElementTree.parse(path).getroot()
        return [2.0 * np.full(3, float(ball.get('radius') or ball.findtext('radius')))
                for ball in root.iter('sphere')]
    if path.suffix == '.glb':
        trimesh = pytest.importorskip('trimesh')
        mesh = next(mesh for name, mesh in trimesh.load_scene(path).geometry.items()
                    if 'projectile' in name)
        assert mesh.volume == pytest.approx(np.pi / 6.0 * 0.3 ** 3, rel=0.05)
        return 2 * [mesh.extents]
    from pxr import Usd, UsdGeom, UsdPhysics
    stage = Usd.Stage.Open(str(path))
    body = next(prim for prim in stage.Traverse() if prim.GetName() == 'projectile_0'
                and prim.HasAPI(UsdPhysics.RigidBodyAPI))
    shapes = [prim for prim in Usd.PrimRange(body, Usd.TraverseInstanceProxies())
              if prim.IsA(UsdGeom.Boundable)]
    return [np.subtract(*UsdGeom.Boundable(prim).GetExtentAttr().Get()[::-1]) for prim in shapes]


@pytest.mark.parametrize('suffix', ['.urdf', '.sdf', '.glb', '.usda'])
def test_balls_are_round_and_as_large_as_launched(tmp_path, suffix):
    """Write a ball for what is seen of a launched ball and for what collides."""
    if suffix == '.usda':
        pytest.importorskip('pxr')
    simulation = Simulation(scene_of(wall=small_wall()))
    simulation.launch(Projectile(size=0.3, mass=5.0, position=(9.0, 0.0, 3.0)))
    path, _ = written(simulation, tmp_path / f'ball{suffix}')
    np.testing.assert_allclose(shapes_of(path), np.full((2, 3), 0.3), atol=1e-6)


@pytest.mark.parametrize('suffix', ['.usda', '.xml'])
def test_events_may_be_taken_before_an_export(scene_file, tmp_path, suffix):
    """Leave out what has broken, whether or not somebody took the events; so of copies."""
    if suffix == '.usda':
        pytest.importorskip('pxr')
    simulation = Simulation(Scene.from_yaml(scene_file))
    simulation.step(10)
    before = written(simulation, tmp_path / f'scene{suffix}')[0].read_bytes()
    taken = simulation.log.take()
    assert np.array_equal(simulation.log.bonds, np.unique(taken['bond'])) and len(taken)
    other = simulation.fork()
    other.restore(simulation.save())
    for one in (simulation, other):
        assert written(one, tmp_path / f'scene{suffix}')[0].read_bytes() == before
    simulation.reset()
    assert not len(simulation.log.bonds)


def test_library_takes_simulations_and_scenes(tmp_path):
    """Write the same file from a scene at rest and from a simulation that has not begun."""
    scene = scene_of(bush=grown('shrub.lsys'))
    export(scene, tmp_path / 'scene.xml')
    export(Simulation(scene), tmp_path / 'simulation.xml')
    texts = [(tmp_path / name).read_text().partition('<compiler')[2]
             for name in ('scene.xml', 'simulation.xml')]
    assert texts[0] == texts[1]
    with pytest.raises(ExportError, match='own time'):
        export(Simulation(scene), tmp_path / 'x.xml', time=1.0)


@pytest.mark.parametrize('suffix', ['.usda', '.xml', '.urdf', '.sdf', '.glb'])
def test_command_writes_each_format(scene_file, tmp_path, suffix, capsys):
    """Write what the ball has done, say how much, and reach the end of the bar."""
    out = tmp_path / f'out{suffix}'
    assert command.main([str(scene_file), '--out', str(out), '--time', '0.2']) == 0
    assert 'parts' in capsys.readouterr().out
    assert out.stat().st_size > 1000
    if suffix not in ('.usda', '.glb'):
        names = {element.get('name', '') for element in ElementTree.parse(out).iter()}
        assert any('projectile' in name for name in names)


@pytest.mark.parametrize('words, complaint', [
    (['--out', 'x.obj'], 'names no format; use one of .usda, .usdc, .xml, .urdf, .sdf, .glb'),
    (['--out', 'x'], 'names no format'),
    (['--out', 'nowhere/x.glb'], 'there is no folder "nowhere"'),
    (['--out', '.glb'], 'names no format'),
    (['--out', 'folder.glb'], 'is a folder'),
    (['--out', 'x.glb', '--time', '-1'], 'the time is -1 s, it must lie from 0 to 3600'),
    (['--out', 'x.glb', '--time', 'nan'], '"nan" is not finite'),
    (['--out', 'x.glb', '--time', '1e9'], 'it must lie from 0 to 3600'),
    (['--out', 'x.glb', '--time', 'soon'], '"soon" is not a number'),
    (['--out', 'x.glb', '--animate', '0', '1'], 'written as .usda or .usdc'),
    (['--out', 'x.glb', '--animate', '0', '1', '--time', '2'], 'not allowed with'),
    ([], 'required: --out'),
])
def test_mistakes_are_one_line(scene_file, tmp_path, monkeypatch, capsys, words, complaint):
    """Say in one line what is wrong, end with 1 or for invalid usage with 2, leave no file."""
    (tmp_path / 'folder.glb').mkdir()
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.iterdir())
    try:
        code = command.main([str(scene_file), *words])
    except SystemExit as end:
        code = end.code
    lines = capsys.readouterr().err.splitlines()
    assert code == (2 if ': argument ' in lines[0] or 'required' in lines[0] else 1)
    assert len(lines) == 1
    assert complaint in lines[0]
    assert sorted(tmp_path.iterdir()) == before


def test_missing_package_is_named(tmp_path, monkeypatch):
    """Say how to install what is missing."""
    def gone(name):
        raise ModuleNotFoundError("No module named 'pxr'", name='pxr')
    monkeypatch.setattr(formats, 'import_module', gone)
    with pytest.raises(ExportError, match='pip install usd-core'):
        export(scene_of(), tmp_path / 'x.usda')


def test_a_folder_that_takes_nothing_is_told_before_anything_runs(tmp_path, monkeypatch):
    """Refuse to replace a file that could be written, in a folder that cannot."""
    target = tmp_path / 'x.xml'
    target.write_text('before', 'utf-8')
    monkeypatch.setattr(output_files.os, 'access', lambda path, mode: Path(path) != tmp_path)

    monkeypatch.setattr(Simulation, 'step', lambda *_: pytest.fail('the scene was simulated'))
    with pytest.raises(ExportError, match='nothing can be written into its folder'):
        export(scene_of(wall=small_wall()), target, time=1.0)
    assert not output_files.obstacle(target, beside=False)


@pytest.mark.parametrize('suffix', ['.glb', '.xml', '.urdf', '.sdf', '.usda', '.usdc'])
def test_full_disk_is_said(tmp_path, suffix):
    """Turn the error of the system into one of ours, and leave the file that was there before."""
    target = tmp_path / f'x{suffix}'
    export(scene_of(wall=small_wall()), target)  # textures, too
    target.write_text('before', 'utf-8')
    known = {path: path.stat().st_size for path in tmp_path.rglob('*')}
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, before[1]))  # [B] of any file
    try:
        with pytest.raises(ExportError, match='cannot be written: File too large') as refused:
            export(scene_of(wall=small_wall()), target)
        with pytest.raises(ExportError, match='cannot be written: File too large'):
            export(scene_of(wall=small_wall()), target.with_stem('new'))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert '\n' not in str(refused.value)
    assert target.read_text('utf-8') == 'before'
    assert {path: path.stat().st_size for path in tmp_path.rglob('*')} == known


def test_devices_are_not_written_to(tmp_path):
    """Refuse a name that leads to something else than a file, before anything is simulated."""
    target = tmp_path / 'x.glb'
    target.symlink_to('/dev/full')
    with pytest.raises(ExportError, match='it is not a regular file'):
        export(scene_of(wall=small_wall()), target)


def test_animation_times_are_checked(tmp_path):
    """Refuse to end before the start, and nonsense rates."""
    scene = scene_of()
    for start, end, fps, complaint in ((2.0, 1.0, 30.0, 'last moment is 1 s'),
                                       (-1.0, 1.0, 30.0, 'first moment is -1 s'),
                                       (0.0, 1.0, 0.0, 'fps is 0 1/s')):
        with pytest.raises(ExportError, match=complaint):
            export_animation(scene, tmp_path / 'x.usda', start, end, fps)


def test_suffixes_are_those_documented():
    """Offer the formats that the command line names."""
    assert exporter.SUFFIXES == ('.usda', '.usdc', '.xml', '.urdf', '.sdf', '.glb')


def test_roll_pitch_yaw_turn_as_the_quaternion():
    """Put the three turns together again, straight up and down included."""
    axes = np.eye(3)
    for attitude in (*np.random.default_rng(0).normal(size=(20, 4)), np.array([0, 1, 0, 1.0]),
                     np.array([1.0, -1.0, 1.0, 1.0])):
        unit = attitude / np.linalg.norm(attitude)
        x, y, z = (from_axis_angle(axis, angle)
                   for axis, angle in zip(axes, roll_pitch_yaw(unit)))
        assert abs(np.dot(multiply(z, multiply(y, x)), unit)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize('suffix', ['.usda', '.sdf', '.urdf'])
def test_names_of_objects_meet_no_others(tmp_path, suffix):
    """Call objects as the world, its physics, or a branch of another: no name stands twice."""
    tree = {'grammar_text': 'axiom: !(0.1) F(1) F(1)'}
    wall = {'grammar': 'garden_wall.wall', 'defines': ['length=0.89', 'height=0.3']}
    names = {'world': tree, 'physics': wall, 'materials': wall, 'world_segment_0': wall,
             'world_anchor': wall}
    scene = Scene.from_parameters({'scene': {'objects': list(names)}, **{
        name: {**given, 'origin': [3.0 * i, 0.0, 0.0]}
        for i, (name, given) in enumerate(names.items())}})
    path = tmp_path / f'named{suffix}'
    export(scene, path)
    text = path.read_text('utf-8')
    if suffix == '.usda':
        assert 'def Scope "materials"' in text and 'def PhysicsScene "physics"' in text
        assert 'def Xform "materials_"' in text and 'def Xform "physics_"' in text
        return
    root = ElementTree.fromstring(text)
    found = [e.get('name') for e in (root[0] if suffix == '.sdf' else root)
             if e.tag in ('model', 'joint', 'link')]
    assert len(found) == len(set(found)) >= 5


def test_a_path_that_usd_cannot_take_is_told(tmp_path):
    """Refuse in one line a folder whose name has a byte that is not UTF-8."""
    folder = tmp_path / 'b\udce4ume'
    folder.mkdir()
    with pytest.raises(ExportError, match='cannot be written: USD takes no path'):
        export(scene_of(bush=grown('shrub.lsys')), folder / 'a.usda')


_CLOSE = 1e-5  # [m], PyBullet's rounding


@pytest.fixture
def client():
    """Connect to a world of PyBullet's own."""
    number = pybullet.connect(pybullet.DIRECT)
    yield number
    pybullet.disconnect(number)


def joints_of(body: int, client: int) -> dict[str, int]:
    """Return the joint index of each link by its name."""
    count = pybullet.getNumJoints(body, physicsClientId=client)
    infos = [pybullet.getJointInfo(body, i, physicsClientId=client) for i in range(count)]
    return {info[12].decode(): info[0] for info in infos}


def link_names(content) -> list[str]:
    return [name.replace('/', '_') for name in content.full_names]


def assert_stands_in_bullet(body: int, content, client: int) -> None:
    joint = joints_of(body, client)
    for part, name in enumerate(link_names(content)):
        state = pybullet.getLinkState(body, joint[name], physicsClientId=client)
        assert np.allclose(state[0], content.poses[part, :3], atol=_CLOSE)
        assert abs(np.dot(state[1], content.poses[part, 3:])) > 1.0 - _CLOSE


@pytest.mark.parametrize('grammar', ['oak.lsys', 'palm.lsys', 'shrub.lsys'])
def test_tree_stands_in_bullet(grammar, tmp_path, client):
    """Load a tree as a chain of revolute joints with each segment in its place."""
    path, content = written(scene_of(tree=grown(grammar)), tmp_path / 'tree.urdf')
    body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
    assert_stands_in_bullet(body, content, client)
    kinds = [pybullet.getJointInfo(body, i, physicsClientId=client)[2]
             for i in range(pybullet.getNumJoints(body, physicsClientId=client))]
    assert kinds.count(pybullet.JOINT_REVOLUTE) > len(content.blueprint)
    masses = [pybullet.getDynamicsInfo(body, i, physicsClientId=client)[0]
              for i in range(len(kinds))]
    assert sum(masses) == pytest.approx(content.blueprint.mass.sum(), rel=1e-5)


def test_bent_tree_stands_as_it_is(tmp_path, client):
    """Take the bends of the moment as the zero of the joints, in both formats."""
    simulation = bent_in_wind(scene_of(pine=grown('pine.lsys')))
    path, content = written(simulation, tmp_path / 'tree.urdf')
    body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
    assert np.abs(content.poses - content.blueprint.poses).max() > 0.05
    assert_stands_in_bullet(body, content, client)
    path, _ = written(simulation, tmp_path / 'tree.sdf')
    ground, tree = pybullet.loadSDF(str(path), physicsClientId=client)
    assert pybullet.getNumJoints(ground, physicsClientId=client) == 0
    assert_stands_in_bullet(tree, content, client)


def test_joints_turn_about_the_axes_of_the_kernel(tmp_path, client):
    """Bend one joint of an upright beam, and find the tip where a circle has it."""
    blueprint = beam(segments=2)
    path, content = written(scene_of(beam=blueprint), tmp_path / 'beam.urdf')
    body = pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
    joint = joints_of(body, client)
    pybullet.resetJointState(body, joint['beam_segment_0_middle'], 0.3, physicsClientId=client)
    state = pybullet.getLinkState(body, joint['beam_segment_1'], computeForwardKinematics=True,
                                  physicsClientId=client)
    foot, tip = content.blueprint.bond_frame[0], content.poses[1]
    turned = rotation.from_axis_angle(rotation.rotate(foot[3:], np.array([1.0, 0.0, 0.0])), 0.3)
    assert np.allclose(state[0], foot[:3] + rotation.rotate(turned, tip[:3] - foot[:3]), atol=1e-5)


def test_wall_is_static_and_hit_by_rays(tmp_path, client):
    """Load a wall in both formats and meet its bricks where they are."""
    scene = scene_of(wall=small_wall())
    for suffix in ('urdf', 'sdf'):
        path, content = written(scene, tmp_path / f'wall.{suffix}')
        if suffix == 'urdf':
            pybullet.loadURDF(str(path), useFixedBase=True, physicsClientId=client)
        else:
            pybullet.loadSDF(str(path), physicsClientId=client)
        for part in range(0, len(content.blueprint), 5):
            across = rotation.rotate(content.poses[part, 3:], np.array([0.0, 1.0, 0.0]))
            middle = content.poses[part, :3]
            start, end = middle - 3.0 * across, middle + 3.0 * across
            hit = pybullet.rayTest(start, end, physicsClientId=client)[0]
            depth = 0.5 * content.blueprint.size[part, 1]
            assert np.allclose(hit[3], middle - depth * across, atol=1e-4), suffix
        pybullet.resetSimulation(physicsClientId=client)


def test_yourdfpy_reads_trees_and_walls(tmp_path):
    """Validate the URDF of a whole scene and find every segment in its place."""
    yourdfpy = pytest.importorskip('yourdfpy')
    scene = scene_of(birch=grown('birch.lsys'), wall=small_wall())
    path, content = written(scene, tmp_path / 'scene.urdf')
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    assert robot.validate()
    segments = content.objects[0].count
    assert robot.num_actuated_joints >= segments
    assert len(robot.link_map['wall'].collisions) == content.objects[1].count
    for part, name in enumerate(link_names(content)[:segments]):
        found = robot.get_transform(name, 'world') @ robot.link_map[name].inertial.origin
        assert np.allclose(found[:3, 3], content.poses[part, :3], atol=1e-6)
        assert np.allclose(found[:3, :3], rotation.to_matrix(content.poses[part, 3:]), atol=1e-6)
