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

"""URDF and SDF, read by PyBullet and yourdfpy: chains of joints and static parts."""

from exported import bent_in_wind, grown, scene_of, small_wall, written
from grown_trees import beam
import numpy as np
import pybullet
import pytest

from procphys_ros.geometry import rotation

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
