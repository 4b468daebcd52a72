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

"""USD, read by Pixar's library: validators, bodies, joints, textures, time samples."""

from pathlib import Path
import resource

from exported import bent_in_wind, grown, scene_of, small_wall, written
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.export import export_animation
from procphys_ros.geometry import rotation
from procphys_ros.mechanism import MechanismGrammar
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.trees.layout import STIFFNESS
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

pxr = pytest.importorskip('pxr')
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade, UsdValidation  # noqa: E402

from procphys_ros.export.usd_layer import Layer  # noqa: E402

_STRUCK = {
    'scene': {'objects': ['wall'],
              'cues': ['0.2 launch position=0.45,-3.0,0.3 velocity=0,25,0 mass=20 size=0.2']},
    'wall': {'grammar': 'garden_wall.wall', 'defines': ['length=0.89', 'height=0.6']}}


def errors_in(stage: Usd.Stage) -> list[str]:
    """Run every validator that comes with the library."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert any('Physics' in v.GetMetadata().name for v in validators)
    return [e.GetErrorAsString() for e in UsdValidation.ValidationContext(validators).Validate(
        stage)]


def pose_of(prim: Usd.Prim) -> np.ndarray:
    """Return a prim's pose in the world, (7,)."""
    matrix = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(Usd.TimeCode.Default())
    turn = matrix.ExtractRotationQuat()
    return np.array([*matrix.ExtractTranslation(), *turn.GetImaginary(), turn.GetReal()])


def seat(joint: UsdPhysics.Joint, number: int) -> np.ndarray:
    """Return a joint's frame in one of its bodies, (7,)."""
    turn = getattr(joint, f'GetLocalRot{number}Attr')().Get()
    return np.array([*getattr(joint, f'GetLocalPos{number}Attr')().Get(), *turn.GetImaginary(),
                     turn.GetReal()])


@pytest.fixture(scope='module')
def standing(tmp_path_factory):
    """Write a tree and a wall at rest, as text."""
    scene = scene_of(oak=grown('oak.lsys'), wall=small_wall())
    path, content = written(scene, tmp_path_factory.mktemp('usd') / 'scene.usda')
    return Usd.Stage.Open(str(path)), content


@pytest.fixture(scope='module')
def bent(tmp_path_factory):
    """Write a tree and a wall in a storm, as binary."""
    simulation = bent_in_wind(scene_of(oak=grown('oak.lsys'), wall=small_wall()))
    path, content = written(simulation, tmp_path_factory.mktemp('usd') / 'scene.usdc')
    return Usd.Stage.Open(str(path)), content


def test_validators_find_nothing(standing, bent):
    """Pass all validators of usd-core, those of UsdPhysics included."""
    assert errors_in(standing[0]) == []
    assert errors_in(bent[0]) == []


def test_physics_is_parsed_as_it_is_meant(standing):
    """Let UsdPhysics itself say which bodies, joints and articulations it sees."""
    stage, content = standing
    found = UsdPhysics.UsdPhysicsLoadStageFromPrimRange(stage, ['/'])
    counts = {kind: len(paths) for kind, (paths, _) in found.items()}
    tree, wall = content.objects
    assert counts[UsdPhysics.ObjectType.RigidBody] == tree.count + wall.count + 1
    assert counts[UsdPhysics.ObjectType.Articulation] == 1
    assert counts[UsdPhysics.ObjectType.CapsuleShape] == tree.count
    assert counts[UsdPhysics.ObjectType.CubeShape] == wall.count
    assert counts[UsdPhysics.ObjectType.D6Joint] == tree.count
    assert counts[UsdPhysics.ObjectType.FixedJoint] == len(small_wall().bonds) + 1


@pytest.mark.parametrize('which', ['standing', 'bent'])
def test_bodies_have_pose_and_mass(which, request):
    """Find each part where it is, with its mass and inertia."""
    stage, content = request.getfixturevalue(which)
    for part, name in enumerate(content.full_names):
        prim = stage.GetPrimAtPath(f'/World/{name}')
        found = pose_of(prim)
        assert np.allclose(found[:3], content.poses[part, :3], atol=1e-6)
        assert abs(np.dot(found[3:], content.poses[part, 3:])) == pytest.approx(1.0, abs=1e-6)
        body = UsdPhysics.MassAPI(prim)
        assert body.GetMassAttr().Get() == pytest.approx(content.blueprint.mass[part], rel=1e-6)
        assert np.allclose(body.GetDiagonalInertiaAttr().Get(), content.blueprint.inertia[part],
                           rtol=1e-6)


def test_joints_meet_where_they_are_at_rest(standing):
    """See every joint from both of its bodies at one place."""
    stage, content = standing
    joints = [UsdPhysics.Joint(p) for p in stage.Traverse() if p.IsA(UsdPhysics.Joint)]
    assert len(joints) == len(content.blueprint.bonds) + 1
    for joint in joints:
        places = []
        for number in (0, 1):
            targets = getattr(joint, f'GetBody{number}Rel')().GetTargets()
            own = seat(joint, number)
            places.append(rotation.compose(pose_of(stage.GetPrimAtPath(targets[0])), own)
                          if targets else own)
        assert np.allclose(places[0][:3], places[1][:3], atol=1e-5)
        assert abs(np.dot(places[0][3:], places[1][3:])) == pytest.approx(1.0, abs=1e-5)


def test_drives_are_the_springs_of_the_kernel(bent):
    """Find stiffness per degree, the damping, and a target that carries the weight."""
    stage, content = bent
    forest = Forest(content.blueprint)
    for row, part in enumerate(forest.parts.tolist()):
        prim = stage.GetPrimAtPath(f'/World/{content.full_names[part]}_joint')
        for axis in ('rotX', 'rotY'):
            drive = UsdPhysics.DriveAPI.Get(prim, axis)
            stiffness = np.degrees(drive.GetStiffnessAttr().Get())
            assert stiffness == pytest.approx(forest.model.swing[row, STIFFNESS], rel=1e-5)
            assert drive.GetDampingAttr().Get() > 0.0
    lean = UsdPhysics.DriveAPI.Get(prim, 'rotX').GetTargetPositionAttr().Get()
    assert 0.0 < abs(lean) < 90.0


def test_mortar_breaks_at_its_strength(standing):
    """Let a joint break at the pull or shear that its patch bears."""
    stage, content = standing
    blueprint = content.blueprint
    hinges = len(blueprint.hinges)
    for row in range(0, len(blueprint.mortar), 7):
        bond = hinges + row
        joint = UsdPhysics.Joint.Get(stage, f'/World/wall/bonds/bond_{bond}')
        weakest = min(blueprint.mortar.tension[row], blueprint.mortar.cohesion[row])
        assert joint.GetBreakForceAttr().Get() == pytest.approx(
            weakest * blueprint.bond_area[bond], rel=1e-5)
        assert 0.0 < joint.GetBreakTorqueAttr().Get() < np.inf
        grounded = blueprint.bonds[bond, 0] == GROUND
        assert (not joint.GetBody0Rel().GetTargets()) == grounded


def test_bricks_are_instances_of_few_shapes(standing):
    """Share one prototype per size of brick, with its true extents."""
    stage, content = standing
    first, count = content.objects[1].first, content.objects[1].count
    bricks = [stage.GetPrimAtPath(f'/World/{name}') for name in content.full_names[first:]]
    sizes = np.unique(content.blueprint.size[first:].round(6), axis=0)
    assert len(bricks) == count and all(brick.IsInstance() for brick in bricks)
    assert len({brick.GetPrototype().GetName() for brick in bricks}) == len(sizes)
    for part, brick in enumerate(bricks, first):
        size = content.blueprint.size[part]
        low, high = UsdGeom.Mesh.Get(stage, brick.GetPath().AppendChild('visual')
                                     ).GetExtentAttr().Get()
        assert np.allclose(high - low, size, atol=1e-6)
        collider = stage.GetPrimAtPath(brick.GetPath().AppendChild('collider'))
        assert np.allclose(collider.GetAttribute('xformOp:scale').Get(), size, atol=1e-6)


def test_textures_are_found(standing):
    """Bind materials whose images lie beside the file."""
    stage, content = standing
    for name in (content.full_names[0] + '/bark', content.full_names[-1] + '/visual'):
        material = UsdShade.MaterialBindingAPI(
            stage.GetPrimAtPath(f'/World/{name}')).ComputeBoundMaterial()[0]
        surface = material.ComputeSurfaceSource()[0]
        image = surface.GetInput('diffuseColor').GetConnectedSources()[0][0].source
        resolved = UsdShade.Shader(image).GetInput('file').Get().resolvedPath
        assert Path(resolved).read_bytes().startswith(b'\x89PNG')


@pytest.fixture(scope='module')
def animated(tmp_path_factory):
    """Write how a ball strikes a wall."""
    path = tmp_path_factory.mktemp('usd') / 'run.usdc'
    export_animation(Scene.from_parameters(_STRUCK), path, 0.1, 0.5, 30.0)
    return Usd.Stage.Open(str(path))


def instances(stage: Usd.Stage, name: str, code: float, mask=UsdGeom.PointInstancer.IgnoreMask):
    instancer = UsdGeom.PointInstancer.Get(stage, f'/World/{name}')
    return np.array(instancer.ComputeInstanceTransformsAtTime(
        code, code, UsdGeom.PointInstancer.ExcludeProtoXform, mask))


def test_animation_is_the_simulation(animated):
    """Find bricks and ball at each frame where a simulation has them."""
    assert errors_in(animated) == []
    assert (animated.GetStartTimeCode(), animated.GetEndTimeCode()) == (3.0, 15.0)
    simulation = Simulation(Scene.from_parameters(_STRUCK))
    bricks = len(simulation.blueprint)
    for code in range(3, 16):
        while simulation.time < code / 30.0 - 1e-6:
            simulation.step()
        found = instances(animated, 'parts_0', code)
        assert np.allclose(found[:, 3, :3], simulation.poses[:bricks, :3], atol=1e-5)
        turn = np.swapaxes(found[:, :3, :3], 1, 2)
        assert np.allclose(turn, rotation.to_matrix(simulation.poses[:bricks, 3:]), atol=2e-3)
    assert simulation.bonds_broken > 0
    ball = instances(animated, f'parts_{bricks}', 15.0)
    assert np.allclose(ball[0, 3, :3], simulation.poses[bricks, :3], atol=1e-5)


def test_what_comes_late_is_hidden_before(animated):
    """Show the ball from the frame on in which it flies."""
    late = next(p for p in animated.Traverse()
                if p.IsA(UsdGeom.PointInstancer) and p.GetName() != 'parts_0')
    shown = [code for code in range(3, 16)
             if UsdGeom.Imageable(late).ComputeVisibility(code) != 'invisible']
    assert shown == list(range(shown[0], 16)) and 6 <= shown[0] <= 7


_ARCH = """building b
  footprint: (0, 0) (2.4, 0)
  facades: front
  storey_height: 1.8
rule front -> split(x) { ~1: wall | 0.9: split(y) { 0.6: hole | 0.8: arch | ~1: wall } | ~1: wall }
layout running { unit: 0.215 0.1025 0.065 joint: 0.01 material: brick }
panel wall: running
panel hole: none
panel arch: arch(round, 1)
"""


def test_cut_stones_keep_their_own_form_in_an_animation(tmp_path):
    """Find the corners of each stone of an arch in the shape of its instance."""
    scene = Scene.from_parameters({'scene': {'objects': ['b']}, 'b': {'grammar_text': _ARCH}})
    export_animation(scene, tmp_path / 'run.usdc', 0.0, 0.01, 30.0)
    stage = Usd.Stage.Open(str(tmp_path / 'run.usdc'))
    instancer = UsdGeom.PointInstancer.Get(stage, '/World/parts_0')
    shapes = instancer.GetPrototypesRel().GetTargets()
    which = instancer.GetProtoIndicesAttr().Get()
    solids = scene.blueprint.hexahedra
    assert len(solids) > 20
    for part, corners in zip(solids.part.tolist(), solids.corners.reshape(-1, 8, 3)):
        mesh = UsdGeom.Mesh.Get(stage, shapes[which[part]].AppendChild('surface'))
        points = np.array(mesh.GetPointsAttr().Get())
        apart = np.linalg.norm(corners[:, None] - points, axis=2).min(axis=1)
        assert apart.max() < 1e-5


@pytest.mark.parametrize('suffix', ['.usda', '.usdc'])
def test_usd_tells_in_one_line_that_a_layer_cannot_be_written(tmp_path, suffix):
    """Say so in place of USD, and leave neither half a file nor what it was written to."""
    layer, before = Layer('/World'), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))  # [B] of any file
    try:
        with pytest.raises(OSError, match='the disk may be full$'):
            layer.write(tmp_path / f'x{suffix}')
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def test_mechanisms_have_their_joints(tmp_path):
    """Write a machine that has moved: joints meet where its parts are, with limits and springs."""
    text = """mechanism m {
        box arm { size: 1, 0.1, 0.1  at: 0.5, 0, 2
            hinge h { at: 0, 0, 2  axis: 0, 1, 0  limits: -100, 80  spring: 90, 10  damper: 2
                strength: 800 } }
        box slide { size: 0.2, 0.2, 0.2  at: 1.1, 0, 2  slider s { to: arm  axis: 1, 0, 0
            limits: -0.1, 0.3 } }
        ball bob { diameter: 0.2  at: 1.1, 0, 1.2  rope r { to: slide  at: 1.1, 0, 1.3
            end: 1.1, 0, 1.9 } }
        rod stick { from: 1.1, 0, 1  to: 1.1, 0, 0.6  diameter: 0.05
            ball b { to: bob  at: 1.1, 0, 1.1 } } }"""
    simulation = Simulation(scene_of(m=MechanismGrammar.parse(text).build()))
    simulation.step(20)
    path, content = written(simulation, tmp_path / 'machine.usda')
    stage = Usd.Stage.Open(str(path))
    assert errors_in(stage) == []
    joints = {prim.GetName(): prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)}
    assert {name: prim.GetTypeName() for name, prim in joints.items()} == {
        'h': 'PhysicsRevoluteJoint', 's': 'PhysicsPrismaticJoint', 'r': 'PhysicsDistanceJoint',
        'b': 'PhysicsSphericalJoint'}
    hinge = UsdPhysics.RevoluteJoint(joints['h'])
    assert [hinge.GetLowerLimitAttr().Get(), hinge.GetUpperLimitAttr().Get()] == pytest.approx(
        [-100.0, 80.0])
    drive = UsdPhysics.DriveAPI(joints['h'], 'angular')
    assert drive.GetStiffnessAttr().Get() == pytest.approx(90.0 * np.pi / 180.0)
    assert drive.GetTargetPositionAttr().Get() == pytest.approx(10.0)
    assert hinge.GetBreakForceAttr().Get() == pytest.approx(800.0)
    assert UsdPhysics.DistanceJoint(joints['r']).GetMaxDistanceAttr().Get() == pytest.approx(0.6)
    names = dict(zip(simulation.joints.names, simulation.joints.position))
    for name in ('h', 's', 'b'):
        joint = UsdPhysics.Joint(joints[name])
        ends = [rotation.compose(pose_of(stage.GetPrimAtPath(body[0])), seat(joint, number))
                if (body := getattr(joint, f'GetBody{number}Rel')().GetTargets())
                else seat(joint, number) for number in (0, 1)]
        moved = rotation.relative(*ends)
        along = names.get(f'm/{name}', 0.0) if name == 's' else 0.0
        assert moved[:3] == pytest.approx([along, 0.0, 0.0], abs=1e-3)
        if name == 'h':
            assert 2.0 * np.arctan2(moved[3], moved[6]) == pytest.approx(names['m/h'], abs=1e-3)
