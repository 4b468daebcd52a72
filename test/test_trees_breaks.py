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

"""Trees at their limits: swing, breaks, and branches that come off."""

from dataclasses import replace

from grown_trees import beam, bush, LENGTH, RADIUS
import numpy as np
import pytest

from procphys_ros.blueprint import Blueprint, chain, skeleton
from procphys_ros.errors import SceneError
from procphys_ros.geometry import rotation
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees import Forest
from procphys_ros.physics.world import BodyState
from procphys_ros.scene import Scene
from procphys_ros.simulation import fragments, Simulation, trees

_DT = 1.0 / 60.0
_NO_WEIGHT = (0.0, 0.0, 0.0)


def _wind(forest: Forest, speed: float) -> np.ndarray:
    return np.tile([speed, 0.0, 0.0], (len(forest), 1))


def _pull(forest: Forest, load: float) -> np.ndarray:
    """Load the tip of an upright beam across until it rests; return the lever arms."""
    for _ in range(900):
        tip = 1.5 * forest.poses[-1, :3] - 0.5 * forest.poses[-2, :3]
        forest.apply_impulse(len(forest) - 1, tip, (load * _DT, 0.0, 0.0))
        forest.step(_DT)
    return tip


def test_cantilever_breaks_at_its_root():
    """Expect the break where P·L/Z first exceeds the strength, and the stress as load."""
    strength = 5e6
    limit = strength * np.pi * RADIUS ** 3 / 4.0 / LENGTH
    below = Forest(beam(10, strength=strength, damping_ratio=0.7), gravity=_NO_WEIGHT)
    _pull(below, 0.99 * limit)
    assert len(below.overloaded()[0]) == 0
    above = Forest(beam(10, strength=strength, damping_ratio=0.7), gravity=_NO_WEIGHT)
    _pull(above, 1.03 * limit)
    rows, causes, loads, bonds = above.overloaded()
    assert rows.tolist() == [0] and causes.tolist() == [Cause.BENDING] and bonds.tolist() == [0]
    assert loads[0] == pytest.approx(1.03 * strength, rel=5e-3)


def test_weight_breaks_a_weak_joint():
    """Expect the transmitted force at rest, the weight above, to be tested in newtons."""
    blueprint = beam(2)
    weight = 9.81 * blueprint.mass[1]
    for force, found in ((1.01 * weight, 0), (0.99 * weight, 1)):
        hinges = replace(blueprint.hinges, break_force=np.array([np.inf, force]))
        forest = Forest(replace(blueprint, hinges=hinges))
        forest.step(_DT)
        rows, causes, loads, _ = forest.overloaded()
        assert len(rows) == found
    assert causes.tolist() == [Cause.FORCE] and loads[0] == pytest.approx(weight, rel=1e-9)


def test_twist_breaks_a_joint():
    """Expect the moment about the segment, locked or not, to be tested against break_torque."""
    forest = Forest(beam(1, break_torque=50.0), gravity=_NO_WEIGHT)
    for moment, found in ((45.0, 0), (-55.0, 1)):
        forest.apply_impulse(0, angular=(0.0, 0.0, moment * _DT))
        forest.step(_DT)
        rows, causes, loads, _ = forest.overloaded()
        assert len(rows) == found
    assert causes.tolist() == [Cause.TWIST] and loads[0] == pytest.approx(55.0, rel=1e-6)


def test_detached_rows_leave_the_articulation():
    """Expect poses and velocities as they were, rows that stay put, and no more breaks there."""
    forest = Forest(bush(strength=1e5))
    for _ in range(30):
        forest.step(_DT, _wind(forest, 20.0))
    row = int(forest.ends[0] // 3)
    poses, velocities = forest.poses.copy(), forest.velocities.copy()
    rows, taken, speeds = forest.detach(row)
    assert rows.tolist() == list(range(row, forest.ends[row]))
    assert np.array_equal(taken, poses[rows]) and np.array_equal(speeds, velocities[rows])
    for _ in range(30):
        forest.step(_DT, _wind(forest, 20.0))
        assert not np.isin(forest.overloaded()[0], rows).any()
    assert np.array_equal(forest.poses[rows], taken)
    assert not forest.active[rows].any() and forest.active.sum() == len(forest) - len(rows)


def test_stump_springs_back_when_a_bough_comes_off():
    """Expect what is left to rise once its load is gone, to the moment over the stiffness."""
    blueprint = _gallows()
    forest = Forest(blueprint)
    forest.detach(1)
    for _ in range(1200):
        forest.step(_DT)
    lean = 2.0 * np.arcsin(forest.poses[0, 4])
    moment = 9.81 * blueprint.mass[1] * blueprint.poses[1, 0]
    own = 9.81 * blueprint.mass[0] * 0.5 * np.sin(lean)
    assert -lean == pytest.approx((moment - own) / blueprint.hinges.swing_stiffness[0], rel=1e-3)


def _gallows() -> Blueprint:
    """Build a post that carries a bar on one side."""
    return skeleton.from_nodes([[0, 0, 0], [0, 0, 1], [1, 0, 1]], [-1, 0, 1], [0.03, 0.03, 0.03],
                               damping_ratio=0.3, modulus=1e9)


def test_released_rows_go_on_as_their_own_tree():
    """Expect the cut part to fall and its own breaks and detachments to work."""
    forest = Forest(beam(10))
    forest.release(4)
    for _ in range(60):
        forest.step(_DT)
    assert np.all(forest.poses[4:, 2] < forest.poses[3, 2] + LENGTH - 4.0)
    assert np.all(np.abs(forest.poses[:4, :2]) < 1e-9)
    assert forest.detach(2)[0].tolist() == [2, 3]
    assert forest.detach(6)[0].tolist() == [6, 7, 8, 9]
    forest.step(_DT)
    assert forest.active.tolist() == [True] * 2 + [False] * 2 + [True] * 2 + [False] * 4


@pytest.mark.parametrize('stiffness', [8e7, 8e9])
def test_swing_limits_hold_in_a_storm(stiffness: float):
    """Expect no joint beyond its limit in 60 m/s of wind, however soft it is."""
    forest = Forest(bush(stiffness=stiffness, swing_limit=0.3))
    touched = False
    for _ in range(300):
        forest.step(_DT, _wind(forest, 60.0))
        bend = np.hypot(*forest.bends[:, :2].T)
        assert bend.max() <= 0.3 * (1.0 + 1e-12)
        touched |= bool(bend.max() > 0.299)
    assert touched or stiffness > 8e7


def test_limits_take_energy_out():
    """Expect branches thrown against their limits to stop there and tremble with what is left."""
    forest = Forest(bush(stiffness=8e8, swing_limit=0.2, damping_ratio=0.0), air_density=0.0)
    rng = np.random.default_rng(5)
    for row in rng.integers(0, len(forest), 10):
        forest.apply_impulse(int(row), linear=rng.normal(0.0, 30.0, 3))
    forest.step(_DT)
    energy = [forest.energy()]
    for _ in range(300):
        forest.step(_DT)
        energy.append(forest.energy())
    assert np.diff(energy).max() <= 1e-9 * energy[0]
    assert energy[-1] < 0.1 * energy[0]


def test_rough_treatment_leaves_everything_finite():
    """Expect finite poses for any stiffness, damping, wind to 60 m/s and hits of 300 N·s."""
    rng = np.random.default_rng(3)
    forest = Forest(chain([
        bush(int(rng.integers(12, 40)), i, stiffness=8e9 * 10 ** rng.uniform(-2, 4),
             damping_ratio=float(rng.choice([0.0, 0.02, 0.5, 2.0])),
             swing_limit=float(rng.choice([0.2, 0.8, 1.5, 3.0]))).placed((6.0 * i, 0, 0))
        for i in range(16)]))
    for i in range(600):
        wind = rng.normal(0.0, 25.0, (1, 3)) + rng.normal(0.0, 5.0, (len(forest), 3))
        if i % 20 == 0:
            for row in rng.integers(0, len(forest), 10):
                point = forest.poses[row, :3] + rng.normal(0.0, 0.2, 3)
                forest.apply_impulse(int(row), point, rng.normal(0.0, 300.0, 3))
        forest.step(_DT, wind)
        assert np.isfinite(forest.poses).all() and np.isfinite(forest.velocities).all()
    reach = np.linalg.norm(forest.poses[:, :3] - forest.poses[forest._plan.row[0], :3], axis=1)
    assert reach.max() < 120.0


def test_hinges_that_are_no_trees_are_refused():
    """Expect a part on two hinges, a ring, and a lopsided part to be named."""
    blueprint = beam(3)
    with pytest.raises(SceneError, match='one hinge only'):
        Forest(replace(blueprint, bonds=np.array([[-1, 0], [0, 1], [0, 1]], np.int32)))
    with pytest.raises(SceneError, match='2 hinges form a ring'):
        Forest(replace(blueprint, bonds=np.array([[-1, 0], [2, 1], [1, 2]], np.int32)))
    with pytest.raises(SceneError, match='symmetric'):
        Forest(replace(blueprint, inertia=blueprint.inertia * [1.0, 1.1, 1.0]))


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
