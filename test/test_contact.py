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

"""Contact of trees with what is loose, with walls, with the ground and with each other."""

import pickle

from grown_trees import bush
from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.blueprint import Blueprint, Shape, skeleton
from procphys_ros.geometry import rotation
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.touch import meet, meet_ground, Partners, resolve
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation, trees
from procphys_ros.simulation.stages import STAGES

_DT = 1.0 / 60.0
_TURN = np.array([0.0, 0.0, 0.0, 1.0])


def gallows(reach: float = 2.0, radius: float = 0.04, strength: float = 5e8) -> Blueprint:
    """Stand a post with a long straight bough to one side, 2 m above the ground."""
    count = 5
    post = np.column_stack([np.zeros(3), np.zeros(3), np.array([0.0, 1.0, 2.0])])
    bough = np.column_stack([np.linspace(0.0, reach, count + 1)[1:], np.zeros(count),
                             np.full(count, 2.0)])
    nodes = np.concatenate([post, bough])
    parents = np.arange(len(nodes)) - 1
    radii = np.concatenate([np.full(3, 0.12), np.full(count, radius)])
    return skeleton.from_nodes(nodes, parents, radii, strength=strength, damping_ratio=0.1)


def single(blueprint: Blueprint) -> Simulation:
    """Simulate one blueprint alone, in still air."""
    scene = Scene()
    scene.add(blueprint, (0.0, 0.0, 0.0), 0.0, 'tree')
    return Simulation(scene)


def drop(simulation: Simulation, place: tuple, mass: float = 5.0, edge: float = 0.2,
         velocity: tuple = (0.0, 0.0, 0.0)) -> int:
    """Put a loose block into the world."""
    pose = np.concatenate([place, _TURN])
    motion = np.concatenate([velocity, np.zeros(3)])
    return simulation.state.world.add_body(Shape.BOX, np.full(3, edge), mass, pose, motion)


def momentum(simulation: Simulation) -> np.ndarray:
    """Add up the momentum of all trees."""
    forest = simulation.state.forest
    mass = simulation.blueprint.mass[forest.parts]
    return (mass[:, None] * forest.velocities[:, :3])[forest.active].sum(axis=0)


def test_a_block_rests_on_a_bough_and_bends_it():
    """Hold a block up with its weight, sagging as under a force of this size at this place."""
    # A block higher than the wood is thick tips off it, ten times as far every third of a second
    # (√(g·(h - r)/(k² + h²)) = 6.9/s): look after 1.5 s, when a nudge of 1e-9 is one of 1e-4.
    simulation, pulled = single(gallows(radius=0.02)), single(gallows(radius=0.02))
    body = drop(simulation, (1.0, 0.0, 2.13), mass=2.0)
    row = int(np.argmin(np.abs(pulled.state.forest.poses[:, 0] - 0.9)))
    forces = []
    for i in range(120):
        pulled.state.forest.push(np.array([row]), np.array([[1.0, 0.0, 2.0]]),
                                 np.array([[0.0, 0.0, -2.0 * 9.81 * _DT]]))
        pulled.step()
        simulation.step()
        touches = simulation.state.contacts
        if i >= 90:
            forces.append(touches.impulse[touches.body == body].sum(axis=0) / _DT)
    bodies = simulation.state.world.bodies
    sag = simulation.poses[4:, 2] - simulation.blueprint.poses[4:, 2]
    expected = pulled.poses[4:, 2] - pulled.blueprint.poses[4:, 2]
    assert expected.min() < -0.003
    np.testing.assert_allclose(sag, expected, rtol=0.05, atol=1e-4)
    assert np.mean(forces, axis=0)[2] == pytest.approx(-2.0 * 9.81, rel=0.01)
    # Read before the tree gives back what the weight gave in the second half of the step.
    assert np.abs(bodies.velocities[body]).max() < 0.02 + 0.5 * 9.81 * _DT


@pytest.mark.parametrize(('mass', 'speed'), [(0.3, 4.0), (5.0, 8.0), (80.0, 6.0)])
def test_momentum_is_accounted_for_in_every_contact(mass, speed):
    """Balance body, tree, weight and the push of the ground at the root, to 1 % of the blow."""
    simulation = single(bush(30, seed=5, damping_ratio=0.1, strength=1e12))
    forest = simulation.state.forest
    tip = forest.poses[-1, :3]
    body = drop(simulation, tuple(tip + [-1.0, 0.0, 0.3]), mass, 0.25, (speed, 0.0, 0.0))
    weight = simulation.blueprint.mass.sum() * np.array([0.0, 0.0, -9.81]) * _DT
    given, worst = np.zeros(3), 0.0
    world, seen = simulation.state.world, []
    real = world.step

    def watched(*step) -> None:
        seen.append(world.bodies.velocities[body, :3].copy())
        real(*step)
    world.step = watched
    for _ in range(40):
        start, flying = momentum(simulation), world.bodies.velocities[body, :3].copy()
        simulation.step()
        touches = simulation.state.contacts
        push = touches.impulse[touches.body == body].sum(axis=0)
        if len(touches):
            assert simulation.state.carrier.max(initial=-1) != body
            np.testing.assert_allclose(mass * (seen[-1] - flying), -push, atol=1e-9 * mass)
            held = forest.joint_wrenches[0, :3] * _DT
            left = momentum(simulation) - start - push - held - weight
            worst = max(worst, np.linalg.norm(left))
            given += push
    assert np.linalg.norm(given) > 0.5 * mass
    assert worst < 0.01 * np.linalg.norm(given)


def test_crowns_that_hit_the_ground_hardly_sink_in():
    """Fell a pine: no tip goes deeper than it moves in one step."""
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['pine']}, 'wind': {'velocity': [0.0, 0.0, 0.0]},
        'pine': {'grammar': 'pine.lsys'}}))
    forest = simulation.state.forest
    sizes = simulation.blueprint.solid_size(forest.parts)
    for root in np.flatnonzero(forest.parents < 0).tolist():
        forest.release(root)
        rows = forest.subtree(root)
        forest.apply_impulse(int(rows[np.argmax(forest.poses[rows, 2])]), linear=(0, 300, 0))
    deepest, fastest = 0.0, 0.0
    for _ in range(340):
        fastest = max(fastest, -forest.velocities[forest.active, 2].min(initial=0.0))
        simulation.step()
        up = np.abs(rotation.rotate(forest.poses[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2])
        half = 0.5 * np.maximum(sizes[:, 2] - sizes[:, 0], 0.0)
        lowest = forest.poses[:, 2] - half * up - 0.5 * sizes[:, 0]
        deepest = max(deepest, -lowest[forest.active].min(initial=0.0))
    assert fastest > 8.0
    assert deepest < min(fastest / 60.0, 0.1)


def test_branches_do_not_pass_through_a_wall():
    """Blow a bush against a wall: no branch gets deeper than 2 cm into any brick."""
    scene = Scene()
    scene.add(bush(40, seed=4, damping_ratio=0.2, strength=1e12, stiffness=1e8),
              (0.0, 0.0, 0.0), 0.0, 'bush')
    reach = scene.blueprint.poses[:, 0].max()
    scene.add(slab(0.3, 6, 3.0), (reach + 0.35, 0.0, 0.0), 0.0, 'wall')
    simulation = Simulation(scene)
    simulation.set_wind((18.0, 0.0, 0.0))
    forest = simulation.state.forest
    sizes = simulation.blueprint.size[forest.parts]
    face = reach + 0.2
    deepest, touched = 0.0, 0
    for _ in range(240):
        simulation.step()
        touches = simulation.state.contacts
        touched += int((touches.part >= 0).any())
        turn = simulation.poses[:len(forest), 3:]
        axis = 2.0 * (turn[:, 0] * turn[:, 2] + turn[:, 3] * turn[:, 1])
        half = 0.5 * (sizes[:, 2] - sizes[:, 0])
        ends = simulation.poses[:len(forest), 0] + half * np.abs(axis) + 0.5 * sizes[:, 0]
        deepest = max(deepest, float(ends.max()) - face)
    assert touched > 20
    assert deepest < 0.02
    assert simulation.state.standing[len(forest):].all()


@pytest.mark.parametrize(('width', 'length', 'count'), [
    (0.3, 0.04, 3), (0.02, 0.01, 1)])
def test_a_stout_foot_turns_as_its_spring_says(width, length, count):
    """Lean a pole on a foot wider than long by torque over stiffness; the ground does not hold."""
    stiffness = 2000.0  # [N·m/rad]
    grammar = LSystem.parse(
        f'axiom: SwingForce({stiffness * count}) SwingDamper(400) Density(300) !({width}) '
        + f'F({length}) ' * count + 'SwingForce(1e9) F(1.2)')
    simulation = single(grammar.build())
    base = count * length
    lever = float(simulation.poses[-1, 2])
    weight = simulation.blueprint.mass[-1] * 9.81
    for _ in range(400):
        simulation.step()
        simulation.apply_impulse('tree/' + str(count), (4.0 * _DT, 0.0, 0.0))
    moved = float(simulation.poses[-1, 0])
    levers = lever - length * np.arange(count)
    bent = 4.0 * (levers ** 2).sum() / (stiffness * count)
    assert simulation.poses[-1, 2] == pytest.approx(base + 0.6, abs=0.05)
    assert weight * lever < 0.1 * stiffness
    assert moved == pytest.approx(bent, rel=0.1)


def test_what_cannot_move_takes_no_impulse():
    """Leave out contacts that nothing answers to, and solve those beside them."""
    partners = Partners(np.arange(2), np.full(2, -1), np.full(2, -1), np.zeros((2, 3)),
                        np.zeros(0), np.zeros((0, 3, 3)), np.zeros((0, 6)))
    response = np.zeros((2, 3, 3))
    response[1] = np.eye(3)
    velocity = np.tile([0.0, 0.0, -2.0], (2, 1))
    ones = np.ones(2, np.intp)
    impulse = np.zeros((2, 3))
    resolve(np.tile([0.0, 0.0, 1.0], (2, 1)), np.zeros(2), np.ones(2), np.full(2, 0.5), partners,
            velocity, np.arange(2), 0 * ones, ones, response, impulse)
    np.testing.assert_allclose(impulse, [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]], atol=1e-9)


def slab(thick: float, wide: int, high: float) -> Blueprint:
    """Stand a wall of big blocks, mortared."""
    rows = int(high / 0.5)
    centres = [[0.0, j - 0.5 * wide + 0.5, 0.5 * i + 0.25] for i in range(rows)
               for j in range(wide)]
    return bonded(centres, (thick, 1.0, 0.5))


def test_nothing_changes_where_nothing_touches():
    """Expect the same poses to the bit with and without the search for contacts."""
    def run(blind: bool) -> np.ndarray:
        scene = Scene()
        for i in range(3):
            scene.add(bush(20, seed=i, damping_ratio=0.1), (6.0 * i, 0.0, 0.0), 0.0, f't{i}')
        simulation = Simulation(scene, seed=1)
        simulation.set_wind((9.0, 0.0, 0.0))
        if blind:
            simulation.stages = tuple(s for s in STAGES if s.name not in ('contact', 'waking'))
        simulation.step(120)
        return simulation.poses
    assert np.array_equal(run(True), run(False))


def test_a_body_meets_a_tree_that_stands_still_unseen():
    """Hit a tree out of view, whose bounds are not renewed, as hard as one in view."""
    def push(culling: dict) -> np.ndarray:
        scene = Scene.from_parameters({'scene': {'objects': []}, 'culling': culling})
        for i in range(4):
            scene.add(gallows(), (6.0 * i, 0.0, 0.0), 0.0, f't{i}')
        simulation = Simulation(scene)
        simulation.set_observer((-20.0, 0.0, 2.0), (0.0, 0.0, 1.0, 0.0))
        simulation.set_wind((4.0, 2.0, 0.0))
        simulation.step(60)
        assert len(trees.movers(simulation.state)) == (0 if culling else 4)
        drop(simulation, (13.5, 0.0, 2.25), mass=4.0)
        pushed = np.zeros(3)
        for _ in range(20):
            simulation.step()
            pushed += simulation.state.contacts.impulse.sum(axis=0)
        return pushed
    seen, unseen = push({}), push({'frustum': True})
    assert seen[2] < -4.0
    np.testing.assert_allclose(unseen, seen, atol=0.1 * np.linalg.norm(seen))


def test_bodies_that_come_and_go_leave_nothing_behind():
    """Drop blocks onto a bough one after the other, and take each away: nothing grows."""
    simulation = single(gallows())
    kept = []
    for _ in range(6):
        body = drop(simulation, (1.0, 0.0, 2.15))
        simulation.step(3)
        simulation.state.world.remove(np.array([body]))
        kept.append(len(pickle.dumps(simulation.state.tree_bounds)))
    assert kept[-1] == kept[0]


def test_the_nearest_point_of_a_box_is_found():
    """Agree with a dense search along the capsule's axis."""
    rng = np.random.default_rng(1)
    for _ in range(60):
        size = np.array([0.1, 0.1, rng.uniform(0.2, 1.5)])
        box = rng.uniform(0.2, 1.0, 3)
        turns = rng.normal(size=(2, 4))
        turns /= np.linalg.norm(turns, axis=1, keepdims=True)
        poses = np.hstack([rng.uniform(-1.2, 1.2, (2, 3)), turns])
        found = meet(np.zeros(1, np.intp), poses[:1], size[None], np.zeros((1, 6)),
                     np.zeros(1, np.intp), np.array([Shape.BOX], np.uint8), poses[1:], box[None],
                     np.zeros((1, 6)), 10.0)
        gap = _dense_gap(poses, size, box)
        if gap > 0.004:
            assert not len(found.gap)
        elif gap > -0.05:
            assert found.gap.min() == pytest.approx(gap, abs=1e-4)


def test_a_fast_stone_does_not_tunnel_and_a_passing_one_is_left_alone():
    """Look along the way of a step: meet what is in it, not what is beside it."""
    pose = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]])
    for aside, hits in ((0.0, 1), (0.3, 0)):
        stone = np.array([[-1.0, aside, 1.0, 0.0, 0.0, 0.0, 1.0]])
        found = meet(np.zeros(1, np.intp), pose, np.array([[0.04, 0.04, 1.0]]),
                     np.zeros((1, 6)), np.zeros(1, np.intp), np.array([Shape.BOX], np.uint8),
                     stone, np.full((1, 3), 0.1), np.array([[90.0, 0, 0, 0, 0, 0]]), _DT)
        assert len(found.gap) == hits
        if hits:
            assert found.normal[0, 0] == pytest.approx(1.0, abs=1e-6)
            assert found.gap[0] == pytest.approx(0.93, abs=1e-3)


def test_tips_meet_the_ground():
    """See only the ends of segments that are about to touch."""
    poses = np.array([[0, 0, 0.5, 0, 0, 0, 1.0], [0, 0, 5.0, 0, 0, 0, 1.0]])
    sizes = np.tile([0.1, 0.1, 1.0], (2, 1))
    still = np.zeros((2, 6))
    found = meet_ground(np.arange(2), np.ones(2, bool), poses, sizes, still, _DT)
    assert found.pair.tolist() == [0] and found.gap[0] == pytest.approx(0.0, abs=1e-12)
    still[1, 2] = -300.0
    assert 1 in meet_ground(np.arange(2), np.ones(2, bool), poses, sizes, still, _DT).pair


def _dense_gap(poses: np.ndarray, size: np.ndarray, box: np.ndarray) -> float:
    half = 0.5 * (size[2] - size[0])
    axis = rotation.rotate(poses[0, 3:], np.array([0.0, 0.0, 1.0]))
    points = poses[0, :3] + np.linspace(-half, half, 20001)[:, None] * axis
    inside = rotation.rotate(rotation.conjugate(poses[1, 3:]), points - poses[1, :3])
    outside = np.abs(inside) - 0.5 * box
    distance = np.linalg.norm(np.maximum(outside, 0.0), axis=1) + np.minimum(
        outside.max(axis=1), 0.0)
    return float(distance.min()) - 0.5 * size[0]
