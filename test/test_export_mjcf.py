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

"""MJCF, read by MuJoCo: the same poses, masses, springs, sag and frequency."""

from functools import cache
from pathlib import Path

from exported import bent_in_wind, grown, scene_of, small_wall, written
from grown_trees import beam
import numpy as np
import pytest

from procphys_ros.export import Content
from procphys_ros.export.mjcf import write_mjcf
from procphys_ros.mechanism import MechanismGrammar
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

mujoco = pytest.importorskip('mujoco')
_FORCE = 15.0     # [N] on the tip of a beam 5 m long, which gives way by some centimetres
_AGREE = 0.05     # relative


def load(path: Path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def bodies(model, content: Content) -> list[int]:
    """Return MuJoCo's index of every part."""
    return [model.body(name).id for name in content.full_names]


def crossings(values: np.ndarray, step: float) -> float:
    """Compute the frequency of a decaying oscillation about 0 from its upward crossings [Hz]."""
    up = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    exact = up + values[up] / (values[up] - values[up + 1])
    assert len(exact) >= 3
    return (len(exact) - 1) / (step * (exact[-1] - exact[0]))


def test_poses_and_masses_arrive(tmp_path):
    """Find each part where it is, as heavy as it is, bent by the wind."""
    simulation = bent_in_wind(scene_of(pine=grown('pine.lsys'), wall=small_wall()))
    path, content = written(simulation, tmp_path / 'scene.xml')
    model, data = load(path)
    mine = bodies(model, content)
    assert np.abs(content.poses - content.blueprint.poses).max() > 0.05
    assert np.allclose(data.xpos[mine], content.poses[:, :3], atol=1e-6)
    assert np.allclose(np.abs(np.sum(data.xquat[mine][:, [1, 2, 3, 0]] * content.poses[:, 3:],
                                     axis=1)), 1.0, atol=1e-6)
    assert np.allclose(model.body_mass[mine], content.blueprint.mass, rtol=1e-6)


@pytest.mark.parametrize('grammar', ['oak.lsys', 'pine.lsys', 'shrub.lsys', 'palm.lsys'])
def test_trees_rest_where_they_were_authored(grammar, tmp_path):
    """Carry the weight by preloaded springs: nothing moves."""
    path, content = written(scene_of(tree=grown(grammar)), tmp_path / 'tree.xml')
    model, data = load(path)
    assert model.njnt > len(content.blueprint)
    for _ in range(100):
        mujoco.mj_step(model, data)
    assert np.abs(data.xpos[bodies(model, content)] - content.poses[:, :3]).max() < 1e-5


def test_bent_trees_return_to_their_shape(tmp_path):
    """Know from a bent pose which shape the springs pull back to."""
    simulation = bent_in_wind(scene_of(birch=grown('birch.lsys')))
    path, content = written(simulation, tmp_path / 'tree.xml')
    model, data = load(path)
    away = np.abs(content.poses[:, :3] - content.blueprint.poses[:, :3]).max()
    model.dof_damping *= 20.0
    while data.time < 8.0:
        mujoco.mj_step(model, data, 100)
    rest = content.blueprint.poses[:, :3]
    assert away > 0.1
    assert np.abs(data.xpos[bodies(model, content)] - rest).max() < 0.05 * away


@cache
def pulled(kind: str) -> tuple[Scene, int, Simulation]:
    """Pull at the tip of something until everything rests; return its scene, and the tip."""
    scene = scene_of(tree=beam(damping_ratio=0.02) if kind == 'beam' else grown(kind))
    tip = int(np.argmax(scene.blueprint.poses[:, 2]))
    simulation = Simulation(scene)
    simulation.set_wind_enabled(False)
    simulation.apply_wrench(tip, (_FORCE, 0.0, 0.0))
    simulation.step(1800)
    return scene, tip, simulation


@pytest.mark.parametrize('kind', ['beam', 'pine.lsys'])
def test_static_sag_agrees(kind, tmp_path):
    """Expect the same deflection under a force as from our kernel."""
    scene, tip, simulation = pulled(kind)
    ours = simulation.poses[tip, :3] - scene.blueprint.poses[tip, :3]
    path, content = written(scene, tmp_path / 'tree.xml')
    model, data = load(path)
    model.dof_damping *= 10.0
    body = bodies(model, content)[tip]
    data.xfrc_applied[body, 0] = _FORCE
    while data.time < 8.0:
        mujoco.mj_step(model, data, 100)
    theirs = data.xpos[body] - content.poses[tip, :3]
    assert np.linalg.norm(ours) > 0.01
    assert np.linalg.norm(theirs - ours) < _AGREE * np.linalg.norm(ours)


@pytest.mark.parametrize('kind', ['beam', 'pine.lsys'])
def test_first_frequency_agrees(kind, tmp_path):
    """Swing back as fast as our kernel does, let go from the same bend."""
    _, tip, rests = pulled(kind)
    simulation = rests.fork()
    simulation.clear_wrenches()
    path, content = written(simulation, tmp_path / 'tree.xml')
    rest = content.blueprint.poses[tip, 0]
    ours, theirs = [], []
    for _ in range(600):
        simulation.step()
        ours.append(simulation.poses[tip, 0] - rest)
    model, data = load(path)
    body, steps = bodies(model, content)[tip], round(1.0 / 60.0 / model.opt.timestep)
    while data.time < 10.0:
        mujoco.mj_step(model, data, steps)
        theirs.append(data.xpos[body, 0] - rest)
    expected = crossings(np.array(ours), simulation.time_step)
    found = crossings(np.array(theirs), steps * model.opt.timestep)
    assert found == pytest.approx(expected, rel=_AGREE)


def test_welded_bricks_stand(tmp_path):
    """Hold a wall together by one weld per mortar joint."""
    path, content = written(scene_of(wall=small_wall()), tmp_path / 'wall.xml')
    model, data = load(path)
    assert model.neq == len(content.blueprint.bonds)
    while data.time < 0.3:
        mujoco.mj_step(model, data)
    assert np.abs(data.xpos[bodies(model, content)] - content.poses[:, :3]).max() < 1e-4


def test_broken_bonds_are_no_welds(tmp_path):
    """Leave out what does not hold any more, and what has been crushed."""
    whole = Content.at_rest(scene_of(wall=small_wall()))
    broken, poses = whole.broken.copy(), whole.poses.copy()
    broken[::2] = True
    poses[3] = np.nan
    content = Content(whole.blueprint, whole.objects, poses, whole.petioles, broken, 9.81)
    write_mjcf(content, tmp_path / 'wall.xml', lambda done, whole: None)
    model, _ = load(tmp_path / 'wall.xml')
    assert model.nbody - 1 == len(content.blueprint) - 1
    touched = (content.blueprint.bonds == 3).any(axis=1)
    assert model.neq == np.count_nonzero(~broken & ~touched)


def test_a_mechanism_hangs_on_its_joints(tmp_path):
    """Swing a double pendulum, closed by a weld to a ball, in both programs for half a second."""
    text = """mechanism m {
        rod one { from: 0, 0, 5  to: 1, 0, 5  diameter: 0.08
            hinge h { at: 0, 0, 5  axis: 0, 1, 0  limits: -200, 200  motor: 0, 7 } }
        rod two { from: 1, 0, 5  to: 2, 0, 5  diameter: 0.08  ball { to: one  at: 1, 0, 5 } }
        ball bob { diameter: 0.3  at: 2, 0, 5  weld { to: two } }
        rod stay { from: 1, 0, 5  to: 1, 0, 5.5  diameter: 0.05  weld { to: one }
            ball { to: two  at: 1, 0, 5 } } }"""
    scene = scene_of(m=MechanismGrammar.parse(text).build())
    simulation = Simulation(scene)
    simulation.drive_joint('m/h', 'effort', 0.0)
    simulation.step(10)
    path, content = written(simulation, tmp_path / 'machine.xml')
    model, data = load(path)
    mine = bodies(model, content)
    assert np.allclose(data.xpos[mine], content.poses[:, :3], atol=1e-6)
    assert data.qpos[0] == pytest.approx(simulation.joints.position[0], abs=1e-6)
    assert model.jnt_range[0] == pytest.approx(np.radians([-200.0, 200.0]))
    assert model.actuator_ctrlrange[0] == pytest.approx([-7.0, 7.0])
    assert (model.njnt, model.neq) == (2, 1)
    data.qvel[0] = simulation.joints.velocity[0]
    fallen = simulation.poses[2, 2]
    simulation.step(12)
    for _ in range(round(0.2 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert data.xpos[mine[2], 2] < fallen - 0.1
    assert data.qpos[0] == pytest.approx(simulation.joints.position[0], rel=0.1)
