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

"""Forward dynamics of trees against dense mass matrices, and against closed forms in flight."""

from copy import deepcopy
from dataclasses import replace

from grown_trees import beam, bush, effective_mass
import numpy as np
import pytest

from procphys_ros.blueprint import Blueprint, chain
from procphys_ros.geometry import rotation
from procphys_ros.physics.trees import AIR_DENSITY, Forest, pose

_GRAVITY = np.array([0.0, 0.0, -9.81])
_DT = 1.0 / 60.0


def _sprung() -> Blueprint:
    """Grow a tree whose joints twist and stretch, some of them only one of the two."""
    blueprint = bush(24, seed=3, damping_ratio=0.3)
    count = len(blueprint.hinges)
    twist, stretch = np.full(count, 900.0), np.full(count, 4e4)
    twist[::3], stretch[::4] = np.inf, np.inf
    hinges = replace(blueprint.hinges, twist_stiffness=twist, stretch_stiffness=stretch,
                     twist_damping=np.full(count, 3.0), stretch_damping=np.full(count, 50.0))
    return replace(blueprint, hinges=hinges)


def _shaken(blueprint: Blueprint, seed: int = 0) -> Forest:
    """Put a forest into a random state of motion, away from its limits."""
    forest = Forest(blueprint, gravity=_GRAVITY, air_density=0.0)
    rng = np.random.default_rng(seed)
    state, extra = forest._state, forest._model.extra
    state.bend[:] = rng.normal(0.0, 0.1, state.bend.shape)
    state.bend[:, 3] *= 0.1
    state.bend[:, 2:][np.isinf(extra[:, [0, 3]])] = 0.0
    pose.place_all(forest._plan, forest._model, state)
    jacobian, owner = _columns(forest)
    state.velocities[:] = (jacobian @ rng.normal(size=len(owner))).reshape(-1, 6)
    state.carried[:] = state.velocities
    return forest


def _columns(forest: Forest) -> tuple[np.ndarray, np.ndarray]:
    """Build the Jacobian (6S, D) of centres of mass and spins, and (row, kind) of its columns."""
    count = len(forest)
    state, extra = forest._state, forest._model.extra
    columns, owner = [], []
    for i in range(count):
        below = np.zeros(count, bool)
        below[i:forest.ends[i]] = True
        q = state.bend[i]
        attitude = forest._model.mount[i, 3:]
        if forest.parents[i] >= 0:
            attitude = rotation.multiply(forest.poses[forest.parents[i], 3:], attitude)
        first = rotation.rotate(attitude, np.array([1.0, 0.0, 0.0]))
        turned = rotation.multiply(attitude, rotation.from_axis_angle(
            np.array([1.0, 0.0, 0.0]), q[0]))
        second = rotation.rotate(turned, np.array([0.0, 1.0, 0.0]))
        along = rotation.rotate(forest.poses[i, 3:], np.array([0.0, 0.0, 1.0]))
        reach = forest._model.body[i, 3] + q[3]
        point = forest.poses[i, :3] - reach * along
        for kind, axis in enumerate((first, second, along, along)):
            if kind >= 2 and np.isinf(extra[i, 3 * (kind - 2)]):
                continue
            column = np.zeros((count, 6))
            if kind == 3:
                column[below, :3] = axis
            else:
                column[below, 3:] = axis
                column[below, :3] = np.cross(axis, forest.poses[below, :3] - point)
            columns.append(column.ravel())
            owner.append((i, kind))
    return np.array(columns).T, np.array(owner)


def _inertia(forest: Forest) -> np.ndarray:
    """Build the block-diagonal inertia of all segments, (6S, 6S)."""
    full = np.zeros((6 * len(forest), 6 * len(forest)))
    for i, body in enumerate(forest._model.body):
        turn = rotation.to_matrix(forest.poses[i, 3:])
        full[6 * i:6 * i + 3, 6 * i:6 * i + 3] = body[0] * np.eye(3)
        full[6 * i + 3:6 * i + 6, 6 * i + 3:6 * i + 6] = (
            turn @ np.diag([body[1], body[1], body[2]]) @ turn.T)
    return full


def _springs(forest: Forest, owner: np.ndarray) -> np.ndarray:
    """Gather k, c, preload and q of each column, (4, D)."""
    rows, kinds = owner.T
    swing, extra = forest._model.swing[rows], forest._model.extra[rows]
    at = np.arange(len(rows))
    start = 3 * np.maximum(kinds - 2, 0)
    bends = kinds < 2
    k, c = (np.where(bends, swing[:, j], extra[at, start + j]) for j in range(2))
    preload = np.where(bends, swing[at, 3 + np.minimum(kinds, 1)], extra[at, start + 2])
    return np.array([k, c, preload, forest._state.bend[rows, kinds]])


def _dense(forest: Forest) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve one step with dense matrices: Jacobian, implicit inertia and mean joint rates."""
    jacobian, owner = _columns(forest)
    inertia = _inertia(forest)
    k, c, preload, q = _springs(forest, owner)
    half = 0.5 * _DT
    implicit = jacobian.T @ inertia @ jacobian + np.diag(half * c + half ** 2 * k)
    weight = np.zeros((len(forest), 6))
    weight[:, :3] = forest._model.body[:, :1] * _GRAVITY
    push = jacobian.T @ (inertia @ forest.velocities.ravel() + half * weight.ravel())
    return jacobian, implicit, np.linalg.solve(implicit, push + half * (preload - k * q))


@pytest.mark.parametrize('blueprint', [bush(damping_ratio=0.2), bush(30, 5, damping_ratio=0.0),
                                       _sprung()])
def test_step_solves_the_dense_equations(blueprint: Blueprint):
    """
    Expect mean rates w of (M + dt/2·c + dt²/4·k)·w = momentum + loads, and velocities 2·w - v.

    All velocities are scaled alike by what the weight has won or lost on the arcs.
    """
    forest = _shaken(blueprint)
    jacobian, _, rates = _dense(forest)
    owner = tuple(_columns(forest)[1].T)
    expected = 2.0 * (jacobian @ rates).reshape(-1, 6) - forest.velocities
    bends = forest.bends[owner] + _DT * rates
    forest.step(_DT)
    assert np.allclose(forest.bends[owner], bends, rtol=1e-9, atol=1e-9)
    scale = np.linalg.norm(forest.velocities[:, :3]) / np.linalg.norm(expected[:, :3])
    assert scale == pytest.approx(1.0, abs=0.05)
    assert np.allclose(forest.velocities[:, :3], scale * expected[:, :3], rtol=1e-9, atol=1e-9)
    assert np.allclose(np.linalg.norm(forest.velocities[:, 3:], axis=1),
                       scale * np.linalg.norm(expected[:, 3:], axis=1), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('blueprint', [bush(), _sprung()])
def test_effective_mass_equals_a_full_solution(blueprint: Blueprint):
    """Expect the walk to the root and back to agree with dense matrices at any point."""
    forest = _shaken(blueprint)
    jacobian, implicit, _ = _dense(forest)
    rng = np.random.default_rng(2)
    for row in (0, 5, len(forest) - 1):
        offset, way = rng.normal(size=3), rng.normal(size=3)
        way /= np.linalg.norm(way)
        line = np.zeros((len(forest), 6))
        line[row] = np.concatenate([way, np.cross(offset, way)])
        pushed = jacobian.T @ line.ravel()
        mass = 1.0 / (pushed @ np.linalg.solve(implicit, pushed))
        assert effective_mass(forest, row, forest.poses[row, :3] + offset, way) == (
            pytest.approx(mass, rel=1e-11))


def test_impulse_meets_the_effective_mass():
    """Expect an impulse to change the velocity at its point by J/m, but for the arc it takes."""
    row, way = 30, np.array([0.6, 0.0, 0.8])
    hit, still = Forest(bush(), air_density=0.0), Forest(bush(), air_density=0.0)
    mass = effective_mass(hit, row, hit.poses[row, :3], way)
    hit.apply_impulse(row, linear=4.0 * way)
    hit.step(_DT)
    still.step(_DT)
    change = (hit.velocities[row, :3] - still.velocities[row, :3]) @ way
    assert change == pytest.approx(4.0 / mass, rel=1e-3)


@pytest.mark.parametrize('impulse', [None, (1.0, 2.0, 0.0)])
def test_looking_ahead_changes_nothing(impulse):
    """Step a swaying trunk with and without a look ahead: it moves alike to the bit."""
    forest, row, dt = Forest(beam()), np.array([5]), 1.0 / 60.0
    forest.apply_impulse(9, linear=(30.0, 10.0, 0.0))
    given = None if impulse is None else np.array([impulse])
    for _ in range(40):
        other = deepcopy(forest)
        other.predict_response(row, other.poses[row, :3], dt, impulses=given)
        other.step(dt)
        forest.step(dt)
        assert np.array_equal(forest.poses, other.poses)
        assert np.array_equal(forest.velocities, other.velocities)


def test_trees_are_foreseen_one_by_one():
    """Foresee one of two trees anew with impulses: as both together, to the bit."""
    forest, dt = Forest(chain([bush(seed=1), bush(30, seed=2)])), 1.0 / 60.0
    rows = np.array([7, 20, 50, 60, 70])  # two on the first tree, three on the second
    points = forest.poses[rows, :3].copy()
    impulses = np.zeros((5, 3))
    impulses[2:] = [[4.0, 0.0, 1.0], [0.0, -3.0, 0.0], [1.0, 1.0, 1.0]]
    look = forest.predict_response(rows, points, dt)
    ends = look.tree == 1
    fresh = forest.predict_response(rows[ends], points[ends], dt, impulses=impulses[ends])
    whole = forest.predict_response(rows, points, dt, impulses=impulses)
    assert not np.array_equal(look.velocity, whole.velocity)
    for name, column in vars(look.renewed(ends, fresh)).items():
        np.testing.assert_array_equal(column, vars(whole)[name], err_msg=name)


def test_trees_know_their_masses():
    """Cut a branch off the second of two trees: it weighs what its segments do, the rest less."""
    forest = Forest(chain([bush(seed=1), bush(30, seed=2)]))
    mass = chain([bush(seed=1), bush(30, seed=2)]).mass[forest.parts]
    row = next(row for row in range(60, 74) if len(forest.subtree(row)) > 3)
    branch = forest.subtree(row)
    forest.release(row)
    expected = mass[:44].sum(), mass[44:].sum() - mass[branch].sum(), mass[branch].sum()
    np.testing.assert_allclose(forest.masses(np.array([5, 44, row])), expected, rtol=1e-12)


def _momentum(forest: Forest) -> np.ndarray:
    """Sum linear momentum and angular momentum about the origin, (6,)."""
    blocks = (_inertia(forest) @ forest.velocities.ravel()).reshape(-1, 6)
    turning = blocks[:, 3:] + np.cross(forest.poses[:, :3], blocks[:, :3])
    return np.concatenate([blocks[:, :3].sum(axis=0), turning.sum(axis=0)])


def test_released_tree_keeps_its_momentum():
    """Expect J = Δp from a hit on a free tree, and p constant through ten seconds of flight."""
    forest = Forest(bush(), gravity=(0, 0, 0), air_density=0.0)
    forest.release(0)
    forest.apply_impulse(20, forest.poses[20, :3] + [0.0, 0.1, 0.0], (3.0, -2.0, 1.0))
    angular = np.cross(forest.poses[20, :3] + [0.0, 0.1, 0.0], (3.0, -2.0, 1.0))
    start = _momentum(forest)
    assert np.allclose(start, [3, -2, 1, *angular], atol=1e-12)
    for _ in range(600):
        forest.step(_DT)
    assert np.allclose(_momentum(forest)[:3], start[:3], atol=1e-11)
    assert np.allclose(_momentum(forest)[3:], start[3:], atol=1e-3 * np.linalg.norm(start[3:]))


@pytest.mark.report('laws')
def test_loose_segment_falls_on_the_parabola(measured):
    """Expect the closed form to rounding for one rigid segment."""
    forest = Forest(beam(1), air_density=0.0)
    forest.release(0)
    start = forest.poses[0, 2]
    for _ in range(60):
        forest.step(_DT)
    measured('fall of a loose segment in a second, g·t²/2', start - forest.poses[0, 2],
             0.5 * 9.81, 'm', rtol=1e-12)


@pytest.mark.report('laws')
def test_level_segment_falls_at_its_terminal_speed(measured):
    """Expect weight = ρ/2·Cd·d·L·v² for a cylinder that falls across the air."""
    blueprint = beam(1, density=50.0)
    level = replace(blueprint, poses=rotation.compose(_level(), blueprint.poses),
                    bond_frame=rotation.compose(_level(), blueprint.bond_frame))
    forest = Forest(level)
    forest.release(0)
    for _ in range(3000):
        forest.step(_DT)
    width, length = blueprint.visual_size[0, 0], blueprint.visual_size[0, 2]
    speed = np.sqrt(2.0 * 9.81 * blueprint.mass[0] / (AIR_DENSITY * 1.1 * width * length))
    measured('terminal speed of a level segment, √(2mg/(ρ·Cd·d·L))', -forest.velocities[0, 2],
             speed, 'm/s', rtol=1e-6)


def _level() -> np.ndarray:
    """Return the frame that lays the upright beam along x."""
    return np.concatenate([np.zeros(3), rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]),
                                                                 0.5 * np.pi)])


@pytest.mark.parametrize('kind, stiffness, push', [
    ('twist', 500.0, (0.0, 0.0, 20.0)), ('stretch', 2e4, (0.0, 0.0, 100.0))])
def test_sprung_joints_give_way_by_load_over_stiffness(kind: str, stiffness: float, push: tuple):
    """Expect a lasting twist or pull to move a sprung joint by load/k."""
    blueprint = beam(1)
    hinges = replace(blueprint.hinges, **{f'{kind}_stiffness': np.array([stiffness]),
                                          f'{kind}_damping': np.array([0.05 * stiffness])})
    forest = Forest(replace(blueprint, hinges=hinges))
    start = forest.poses[0].copy()
    for _ in range(600):
        load = 'angular' if kind == 'twist' else 'linear'
        forest.apply_impulse(0, **{load: _DT * np.array(push)})
        forest.step(_DT)
    if kind == 'twist':
        assert 2.0 * np.arcsin(forest.poses[0, 5]) == pytest.approx(20.0 / stiffness, rel=1e-6)
    else:
        assert forest.poses[0, 2] - start[2] == pytest.approx(100.0 / stiffness, rel=1e-6)


def test_locked_joints_neither_twist_nor_stretch():
    """Expect no axial rotation and no separation under a violent hit."""
    forest = Forest(bush(damping_ratio=0.1))
    ends = forest.parents >= 0
    mount = np.linalg.norm(forest._model.mount[ends, :3], axis=1)
    forest.apply_impulse(20, linear=(300.0, 100.0, 300.0), angular=(0.0, 0.0, 20.0))
    for _ in range(60):
        forest.step(_DT)
        frame = forest._state.frame
        gap = np.linalg.norm(frame[ends, :3] - frame[forest.parents[ends], :3], axis=1)
        assert np.allclose(gap, mount, atol=1e-12)


@pytest.mark.parametrize('speed', [2.0, 5.0])
def test_tumbling_flexible_pole_keeps_its_angular_momentum(speed: float):
    """Expect a free pole that bends as it turns end over end to keep 99 % over five seconds."""
    forest = Forest(beam(10, modulus=8e8, damping_ratio=0.0), (0.0, 0.0, 0.0), air_density=0.0)
    forest.release(0)
    forest.velocities[:, 0] = speed * (forest.poses[:, 2] - forest.poses[:, 2].mean())
    forest.velocities[:, 4] = speed
    start = _momentum(forest)[3:]
    for _ in range(300):
        forest.step(_DT)
    assert np.linalg.norm(_momentum(forest)[3:] - start) < 0.01 * np.linalg.norm(start)
