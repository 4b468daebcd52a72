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


"""Detached branches: flexible while they fall, rigid fragments afterwards."""

from grown_trees import bush
import numpy as np

from procphys_ros.geometry import rotation
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.world import BodyState
from procphys_ros.scene import Scene
from procphys_ros.simulation import fragments, Simulation, trees

_DT = 1.0 / 60.0


def stand(**material: float) -> Simulation:
    """Simulate one bush in still air."""
    scene = Scene()
    scene.add(bush(40, seed=1, **{'damping_ratio': 0.15, 'strength': 1e12, **material}),
              (0.0, 0.0, 0.0), 0.0, 'bush')
    return Simulation(scene)


def motion(mass: np.ndarray, inertia: np.ndarray, poses: np.ndarray,
           velocities: np.ndarray) -> np.ndarray:
    """Compute momentum, and angular momentum about the origin, (6,)."""
    spin = rotation.rotate(rotation.conjugate(poses[:, 3:]), velocities[:, 3:])
    own = rotation.rotate(poses[:, 3:], inertia * spin)
    push = mass[:, None] * velocities[:, :3]
    return np.concatenate([push.sum(axis=0), (own + np.cross(poses[:, :3], push)).sum(axis=0)])


def test_a_free_flight_keeps_momentum():
    """Lose no momentum in a vacuum, and gain what weight gives, to 1e-9."""
    blueprint = bush(40, seed=1, damping_ratio=0.05)
    forest = Forest(blueprint, air_density=0.0)
    forest.push(np.array([20, 35]), forest.poses[[20, 35], :3],
                np.array([[30.0, 10.0, 5.0], [0.0, -8.0, 2.0]]))
    for _ in range(5):
        forest.step(_DT)
    forest.release(1)
    rows = forest.subtree(1)
    mass = blueprint.mass[forest.parts[rows]]
    start = (mass[:, None] * forest.velocities[rows, :3]).sum(axis=0)
    for _ in range(60):
        forest.step(_DT)
    gained = (mass[:, None] * forest.velocities[rows, :3]).sum(axis=0) - start
    np.testing.assert_allclose(gained, [0.0, 0.0, -9.81 * mass.sum()], atol=1e-9 * mass.sum())
    assert np.abs(forest.bends[rows[1:], :2]).max() > 0.003  # and bends meanwhile


def test_a_large_branch_falls_flexibly_and_comes_to_rest():
    """Bend in the fall, lie still on the ground at last, as a frozen fragment."""
    simulation = stand()
    forest = simulation.state.forest
    forest.release(1)
    flexible = 0
    for _ in range(900):
        simulation.step()
        flexible += len(forest.free_roots)
        assert simulation.poses[:, 2].min() > -0.02
    assert 30 < flexible < 8.1 / _DT
    assert not len(forest.free_roots)
    carrier = simulation.state.carrier[1:]
    assert (carrier == carrier[0]).all()
    assert simulation.state.world.bodies.state[carrier[0]] == BodyState.RESTING
    assert not simulation.velocities[1:].any()
    assert np.abs(simulation.velocities[0]).max() < 1e-4  # the stump: 1e-7 in one of five runs
    sizes = simulation.blueprint.size[1:]
    axis = rotation.rotate(simulation.poses[1:, 3:], np.array([0.0, 0.0, 1.0]))
    low = (simulation.poses[1:, 2] - 0.5 * (sizes[:, 2] - sizes[:, 0]) * np.abs(axis[:, 2])
           - 0.5 * sizes[:, 0])
    assert -0.02 < low.min() < 0.02


def test_becoming_rigid_moves_nothing_and_keeps_all_momentum():
    """Hand poses over as they are, and momentum and angular momentum to rounding."""
    simulation = stand()
    source, forest = simulation.blueprint, simulation.state.forest
    forest.push(np.array([20]), forest.poses[[20], :3], np.array([[40.0, 10.0, 5.0]]))
    simulation.step(4)
    forest.release(1)
    simulation.step(6)
    rows = forest.subtree(1)
    parts = forest.parts[rows]
    poses, velocities = forest.poses[rows].copy(), forest.velocities[rows].copy()
    before = motion(source.mass[parts], source.inertia[parts], poses, velocities)
    simulation.state.trees.age[1] = 100.0
    trees.make_rigid(simulation.model, simulation.state, _DT)
    assert not forest.active[rows].any()
    fragments.write_poses(simulation.model, simulation.state, _DT)
    np.testing.assert_allclose(simulation.poses[parts, :3], poses[:, :3], atol=1e-12)
    same = np.abs((simulation.poses[parts, 3:] * poses[:, 3:]).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    after = motion(source.mass[parts], source.inertia[parts], simulation.poses[parts],
                   simulation.velocities[parts])
    np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9 * np.abs(before).max())


def test_coming_off_moves_nothing_and_keeps_all_momentum():
    """Go over from a branch to a falling tree without a jump of poses or velocities."""
    simulation = stand()
    forest = simulation.state.forest
    simulation.apply_impulse('bush/20', (20.0, 0.0, 0.0))
    simulation.step(10)
    poses, velocities = forest.poses.copy(), forest.velocities.copy()
    forest.release(1)
    assert np.array_equal(poses, forest.poses) and np.array_equal(velocities, forest.velocities)
    simulation.step()
    way = np.linalg.norm(forest.poses[:, :3] - poses[:, :3], axis=1)
    assert way.max() < 1.5 * _DT * np.abs(velocities[:, :3]).max() + 0.5 * 9.81 * _DT ** 2 + 0.01


def test_small_pieces_are_rigid_at_once_and_large_ones_are_not():
    """Break a twig and a trunk: the one is debris, the other a tree with a free root."""
    for part, limp in ((39, False), (1, True)):
        simulation = stand()
        forest = simulation.state.forest
        row = int(simulation.state.parts.row[part])
        assert (len(forest.subtree(row)) >= trees.SMALLEST) == limp
        forest._capacity[row, 2] = 1.0  # [Pa]
        simulation.apply_impulse(part, (0.5, 0.5, 0.0))
        simulation.step(2)
        assert simulation.bonds_broken >= 1
        assert (row in forest.free_roots) == limp
        assert (simulation.state.carrier[part] >= 0) != limp


def test_a_stump_and_the_branch_that_came_off_it_break_in_one_step():
    """Overload a joint of each: they are on one path no more, so neither waits for the other."""
    simulation = stand()
    simulation.step()
    forest = simulation.state.forest
    forest.release(1)
    inner = next(row for row in range(2, len(forest)) if forest.parents[row] == 1)
    forest._capacity[[0, inner], 2] = 1.0  # [Pa]
    forest.apply_impulse(0, linear=(5.0, 0.0, 0.0))
    forest.apply_impulse(inner, linear=(0.0, 5.0, 0.0))
    simulation.step()
    assert sorted(simulation.events['bond']) == sorted(forest.bonds[[0, inner]])


def test_a_falling_branch_breaks_again_where_it_hits():
    """Shatter brittle branches on the ground, not tough ones; only after they have landed."""
    def run(strength: float) -> tuple[int, int]:
        simulation = stand(strength=strength)
        forest = simulation.state.forest
        forest.release(1)
        forest.poses[forest.subtree(1)[0], 2] += 8.0  # the free root carries the others along
        simulation.step(40)
        early = simulation.bonds_broken
        simulation.step(120)
        return early, simulation.bonds_broken
    assert run(1e12) == (0, 0)
    early, late = run(3e7)
    assert early == 0 and late > 0


def test_a_landed_branch_thaws_when_it_is_struck():
    """Freeze and thaw like all debris."""
    simulation = stand()
    simulation.state.forest.release(1)
    simulation.step(900)
    assert simulation.awake_bodies == 0
    simulation.apply_impulse('bush/1', (300.0, 0.0, 0.0))
    simulation.step(3)
    assert simulation.awake_bodies == 1
    simulation.step(600)
    assert simulation.awake_bodies == 0


def test_falls_repeat_to_the_bit():
    """Fall the same way twice, also after a reset."""
    simulation = stand(strength=3e7)
    results = []
    for _ in range(2):
        simulation.apply_impulse('bush/10', (60.0, 0.0, 0.0))
        simulation.step(20)
        simulation.state.forest.release(1)
        simulation.step(90)  # it lands after half a second
        results.append(simulation.poses.copy())
        simulation.reset()
    assert np.array_equal(*results)
    assert np.array_equal(simulation.poses, simulation.blueprint.poses)


def test_no_more_branches_are_flexible_than_can_be_afforded():
    """Let those beyond a fixed number fall as rigid pieces."""
    scene = Scene()
    tree = bush(20, seed=2, damping_ratio=0.1, strength=1e12)
    for i in range(30):
        scene.add(tree, (8.0 * i, 0.0, 0.0), 0.0, f't{i}')
    simulation = Simulation(scene)
    forest = simulation.state.forest
    forest._capacity[forest.plan.start[:-1] + 1, 2] = 1.0  # [Pa] above the lowest segment
    simulation.set_wind((10.0, 0.0, 0.0))
    simulation.step(5)
    assert simulation.bonds_broken == 30
    assert len(forest.free_roots) == trees.MOST
    assert len(simulation.state.bodies.members) == 30 - trees.MOST
