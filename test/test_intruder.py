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

"""The intruder: where it goes, what it pushes, and the wrench on it."""

from grown_trees import LENGTH
from masonry_walls import bonded, BRICK, wall_boxes
import numpy as np
import pytest

from procphys_ros.blueprint import Blueprint, Shape, skeleton
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.physics.touch import overlap_ball, overlap_box
from procphys_ros.physics.world import BodyState
from procphys_ros.physics.world.kinematic import PoseInterpolator
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_DT = 1.0 / 60.0
_TURN = [0.0, 0.0, 0.0, 1.0]


def scene_of(blueprint: Blueprint, engine: str = 'auto', gravity: float = 9.81,
             **intruder: object) -> Simulation:
    """Simulate a blueprint and an intruder of a shape and size."""
    scene = Scene.from_parameters({'scene': {'objects': []}, 'gravity': gravity, 'engine': engine,
                                   'intruder': intruder})
    scene.add(blueprint, (0.0, 0.0, 0.0), 0.0, 'thing')
    return Simulation(scene)


def mast() -> Blueprint:
    """Stand a uniform cantilever with many segments and plenty of damping."""
    nodes = np.zeros((21, 3))
    nodes[:, 2] = np.linspace(0.0, LENGTH, 21)
    return skeleton.from_nodes(nodes, np.arange(21) - 1, np.full(21, 0.05), density=900.0,
                               modulus=8e9, strength=1e12, damping_ratio=0.5)


def drive(simulation: Simulation, start: np.ndarray, velocity: np.ndarray, duration: float,
          every: int = 6) -> None:
    """Send poses at a lower rate than that of the steps."""
    for i in range(int(round(duration / _DT))):
        if i % every == 0:
            place = start + velocity * simulation.time
            simulation.place_intruder([*place, *_TURN])
        simulation.step()


def wall(length: int = 8, paths: int = 8) -> Blueprint:
    """Stack a wall of blocks along y."""
    centres = [[0.0, 0.5 * j + 0.25 * (i % 2), 0.25 * i + 0.125] for i in range(paths)
               for j in range(length)]
    return bonded(centres, (0.2, 0.49, 0.24), gap=0.02)


def test_the_mast_springs_back_when_it_leaves():
    """Let go of a bent mast, and feel nothing any more."""
    simulation = scene_of(mast(), shape='sphere', size=0.2)
    drive(simulation, np.array([-0.3, 0.0, 3.0]), np.array([0.2, 0.0, 0.0]), 2.0)
    assert simulation.poses[12, 0] > 0.02
    simulation.place_intruder([-50.0, 0.0, 3.0, *_TURN])
    simulation.step(300)
    assert np.abs(simulation.poses - simulation.blueprint.poses).max() < 1e-3
    assert np.abs(simulation.intruder_wrench).max() == 0.0
    assert np.abs(simulation.wrench_on_intruder('intruder')).max() < 1e-6


def test_it_pushes_loose_blocks_along():
    """Push a block over the ground: it goes as fast, and friction is felt."""
    # Friction on the pushed side may press the block down as well: F = μ(m·g + μ·F) at most.
    simulation = scene_of(mast(), shape='box', size=[0.5, 0.5, 0.5])
    body = simulation.state.world.add_body(Shape.BOX, np.full(3, 0.4), 20.0,
                                           np.array([5.0, 0.0, 0.2, *_TURN]))
    forces = []
    start = np.array([4.3, 0.0, 0.3])
    for i in range(180):
        if i % 3 == 0:
            simulation.place_intruder([*(start + [0.4 * simulation.time, 0.0, 0.0]), *_TURN])
        simulation.step()
        forces.append(simulation.wrench_on_intruder('intruder')[0])
    assert simulation.state.world.bodies.velocities[body, 0] == pytest.approx(0.4, abs=0.05)
    friction, weight = 0.7, 20.0 * 9.81
    least, most = friction * weight, friction * weight / (1.0 - friction ** 2)
    assert 0.95 * least < -np.mean(forces[-60:]) < 1.05 * most


@pytest.mark.parametrize('engine', ['native', 'bullet'])
def test_it_bears_what_sleeps_on_it(engine):
    """Carry a block until it has long been asleep: weight and moment are felt all along."""
    simulation = scene_of(mast(), engine, shape='box', size=[1.0, 1.0, 0.2])
    simulation.place_intruder([9.0, 0.0, 1.0, *_TURN])
    simulation.step()
    world, weight = simulation.state.world, 20.0 * 9.81
    body = world.add_body(Shape.BOX, np.full(3, 0.4), 20.0, np.array([9.1, 0.0, 1.3, *_TURN]))
    simulation.step(20)
    felt = []
    for _ in range(60):
        simulation.step()
        felt.append(simulation.intruder_wrench)
    assert world.bodies.state[body] == BodyState.RESTING
    np.testing.assert_allclose(felt, [[0.0, 0.0, -weight, 0.0, 0.1 * weight, 0.0]] * 60, atol=1.0)


def test_a_slow_push_loads_a_wall_and_a_drive_breaks_it():
    """Lean on a wall without harm; go through it and knock bricks out."""
    simulation = scene_of(wall(), shape='box', size=[0.4, 0.2, 0.2])
    simulation.place_intruder([-0.2 - 0.1 + 2e-5, 1.0, 0.375, *_TURN])
    simulation.step(30)
    assert simulation.bonds_broken == 0
    assert simulation.intruder_wrench[0] < -100.0
    assert np.array_equal(simulation.poses, simulation.blueprint.poses)
    simulation = scene_of(wall(), shape='box', size=[1.0, 1.0, 1.0])
    drive(simulation, np.array([-1.0, 1.0, 1.0]), np.array([3.0, 0.0, 0.0]), 1.0)
    assert simulation.bonds_broken > 10
    out = simulation.poses[:, 0] > 0.3
    assert 3 < out.sum() < len(simulation.blueprint)
    assert simulation.poses[:, 2].min() > 0.0


@pytest.mark.parametrize('speed', [0.05, 0.01])
def test_a_wall_that_is_pushed_slowly_presses_back_with_what_it_bears(speed):
    """Push a wall over: it bears what cracks its lowest bed, (f + σ)·L·t²/6 over the arm."""
    built = bonded(*wall_boxes(12, 20), tension=0.2e6, cohesion=0.4e6)
    simulation = scene_of(built, shape='box', size=[0.3, 0.3, 0.3])
    low, height = built.poses[:, 2] < 0.05, 1.2
    length, depth = built.size[low, 0].sum(), BRICK[1]
    strength = 0.2e6 + 9.81 * built.mass.sum() / (length * depth)
    bears = strength * length * depth ** 2 / 6.0 / height
    start = np.array([built.poses[:, 0].mean(), -0.15 + built.poses[:, 1].min() - 0.5 * depth,
                      height])
    largest = 0.0
    for _ in range(round(0.02 / speed * 60)):
        simulation.place_intruder([*(start + [0.0, speed * simulation.time, 0.0]), *_TURN])
        simulation.step()
        largest = max(largest, -simulation.wrench_on_intruder('intruder')[1])
    assert 0.6 * bears < largest < 1.7 * bears
    assert not simulation.state.standing[:len(built)].any()


def test_poses_at_a_low_rate_make_an_even_motion():
    """Pass through every pose one interval late, evenly, and stop at the last."""
    path = PoseInterpolator()
    seen = []
    for i in range(40):
        time = i * _DT
        if i % 6 == 0 and i <= 24:
            path.set_target(np.array([0.5 * time, 0.0, 1.0, *_TURN]), time)
        velocity = path.advance(time, _DT)
        seen.append((path.pose[0], velocity[0]))
    place, speed = np.array(seen).T
    np.testing.assert_allclose(speed[6:30], 0.5, rtol=1e-9)
    np.testing.assert_allclose(place[29], 0.5 * 24 * _DT, rtol=1e-9)
    assert np.abs(speed[30:]).max() == 0.0


def test_poses_at_a_high_rate_make_an_even_motion():
    """Send three poses between two steps: it goes to the last of them in a step, at its speed."""
    path, speed = PoseInterpolator(), 0.8
    for step in range(30):
        time = step * _DT
        for late in (0.0, _DT / 3.0, 2.0 * _DT / 3.0):
            path.set_target(np.array([speed * (time + late), 0.0, 1.0, *_TURN]), time)
        velocity = path.advance(time, _DT)
        if step:
            assert velocity[0] == pytest.approx(speed, rel=1e-9)
            assert path.pose[0] == pytest.approx(speed * (time + 2.0 * _DT / 3.0))


def test_turns_are_followed_too():
    """Turn evenly from one attitude to the next."""
    path = PoseInterpolator()
    path.set_target(np.array([0.0, 0.0, 1.0, *_TURN]), 0.0)
    path.set_target(np.concatenate([[0.0, 0.0, 1.0], rotation.from_yaw(0.4)]), 0.1)
    for i in range(6):
        velocity = path.advance(0.1 + i * _DT, _DT)
        assert velocity[5] == pytest.approx(4.0, rel=1e-6)
    np.testing.assert_allclose(path.pose[3:], rotation.from_yaw(0.4), atol=1e-9)


def test_a_jump_is_no_motion():
    """Put it somewhere else at once rather than at 1 km/s."""
    path = PoseInterpolator()
    path.set_target(np.array([0.0, 0.0, 1.0, *_TURN]), 0.0)
    assert path.set_target(np.array([100.0, 0.0, 1.0, *_TURN]), 0.1)
    assert np.abs(path.advance(0.1, _DT)).max() == 0.0


@pytest.mark.parametrize('pose', [[0, 0, 1], [0, 0, np.nan, 0, 0, 0, 1], [0] * 7,
                                  [0, 0, 1, 0, 0, 0, np.inf], [1e30, 0, 0, 0, 0, 0, 1]])
def test_what_is_no_pose_is_refused(pose):
    """Name what is wrong, and change nothing."""
    simulation = scene_of(mast(), shape='sphere', size=0.2)
    with pytest.raises(CommandError, match='intruder'):
        simulation.place_intruder(pose)
    assert simulation.intruder_pose is None


@pytest.mark.parametrize('settings', [{'shape': 'cone'}, {'size': 0.0}, {'size': [1, 2]},
                                      {'shape': 'sphere', 'size': [1.0, 2.0, 3.0]},
                                      {'size': 'big'}, {'colour': 3}])
def test_settings_are_checked(settings):
    """Refuse shapes and sizes that there are not."""
    with pytest.raises(SceneError, match='intruder'):
        scene_of(mast(), **settings)


def test_reset_takes_it_away():
    """Begin again without it, and repeat the same run."""
    simulation = scene_of(wall(), shape='box', size=[1.0, 1.0, 1.0])
    runs = []
    for _ in range(2):
        drive(simulation, np.array([-1.0, 1.0, 1.0]), np.array([3.0, 0.0, 0.0]), 0.7)
        runs.append(simulation.poses.copy())
        simulation.reset()
        assert simulation.intruder_pose is None
    assert np.array_equal(*runs)


def test_depths_of_boxes_and_balls():
    """Compute the overlap of shifted boxes and of a ball over a face and an edge."""
    box = np.array([[0.0, 0.0, 0.0, *_TURN]])
    size = np.ones((1, 3))
    pose = np.array([0.9, 0.2, 0.0, *_TURN])
    depth, normal, point = overlap_box(pose, np.ones(3), box, size)
    assert depth[0] == pytest.approx(0.1) and normal[0] == pytest.approx([1.0, 0.0, 0.0])
    assert point[0] == pytest.approx([0.5, 0.2, 0.0])
    pose[:2] = 0.5 + 0.4
    depth, normal, _ = overlap_ball(pose[:3], 0.6, box, size)
    assert depth[0] == pytest.approx(0.6 - 0.4 * 2 ** 0.5)
    assert normal[0] == pytest.approx([0.5 ** 0.5, 0.5 ** 0.5, 0.0])
    pose[0] = 3.0
    assert overlap_ball(pose[:3], 0.6, box, size)[0][0] == 0.0
