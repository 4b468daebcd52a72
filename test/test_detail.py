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

"""Level of detail: what nobody looks at costs less, and nothing pops, drifts or gets lost."""

from masonry_walls import wall
import numpy as np
import pytest
from test_collapse import tilted

from procphys_ros.errors import CommandError
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.culling import CullingSettings
from procphys_ros.simulation import Simulation

POLE = ('axiom: Width(0.05) Density(800) Modulus(8e9) DampingRatio(0.05) F(1) F(1) '
        '[ +(40) &(50) Width(0.02) F(0.6) Leaf(0.3, 1) ] F(1) Leaf(0.4, 1)')
BREEZE = {'velocity': [8.0, 0.0, 0.0], 'turbulence_intensity': 0.2}
PER_TREE = 4  # parts
BEHIND = (0.0, 0.0, 1.0, 0.0)  # quaternion of a look along -x


def stand(wind=None, **culling):
    """Make a simulation of a stand of 7 x 7 thin poles, 6 m apart."""
    return Simulation(Scene.from_parameters({
        'scene': {'objects': ['pole']}, 'wind': wind or BREEZE, 'culling': culling,
        'pole': {'grammar_text': POLE, 'count': 49, 'spacing': 6.0, 'variants': 1}}))


def places(simulation):
    """Return the places of the trees [m], (49, 3)."""
    return simulation.blueprint.bond_frame[::PER_TREE, :3]


def moved(simulation, before):
    """Compute how far each tree has moved since [m], (49,)."""
    step = np.linalg.norm(simulation.poses[:, :3] - before[:, :3], axis=1)
    return step.reshape(-1, PER_TREE).max(axis=1)


def test_distance_culling_holds_the_far_and_leaves_the_near_exact():
    """Freeze trees beyond the distance; those within move as in the full simulation."""
    full, culled = stand(), stand(distance=20.0)
    culled.set_observer((-18.0, 0.0, 1.5))
    for simulation in (full, culled):
        simulation.step(60)
    away = np.linalg.norm(places(full) - [-18.0, 0.0, 1.5], axis=1)
    near, far = away < 17.0, away > 25.0
    before = culled.poses.copy()
    error = moved(culled, full.poses)
    culled.step(30)
    assert error[near].max() == 0.0 and near.sum() > 8
    assert moved(culled, before)[far].max() == 0.0 and far.sum() > 8
    assert moved(culled, before)[near].min() > 1e-5


def test_frustum_culling_spares_what_lies_outside_the_view():
    """Move what a brute-force look at the angle finds in view, hold what lies behind."""
    culled = stand(frustum=True, field_of_view=0.8, aspect=1.0, widening=0.1)
    culled.set_observer((0.0, 0.0, 1.5))
    culled.step(150)
    before = culled.poses.copy()
    culled.step(30)
    away = places(culled)[:, :2]
    distance = np.linalg.norm(away, axis=1)
    angle = np.abs(np.arctan2(away[:, 1], away[:, 0]))
    change = moved(culled, before)
    assert change[(angle < 0.3) & (distance > 1.0)].min() > 1e-5
    assert change[(angle > 1.2) & (distance > 8.0)].max() == 0.0


def test_nothing_pops_when_the_view_turns():
    """Change poses no faster than the full simulation does, whatever comes into view."""
    full, culled = stand(), stand(frustum=True, distance=60.0, far_interval=3, far_distance=15.0)
    fastest = []
    for simulation in (full, culled):
        culled.set_observer((-30.0, 0.0, 2.0))
        simulation.step(60)
        before, peak = simulation.poses.copy(), 0.0
        for k in range(160):
            if simulation is culled:
                half = 0.5 * np.pi * k / 40.0
                culled.set_observer((-30.0, 0.0, 2.0), (0.0, 0.0, np.sin(half), np.cos(half)))
            simulation.step()
            peak = max(peak, moved(simulation, before).max())
            before = simulation.poses.copy()
        fastest.append(peak)
    assert 0.0 < fastest[1] < 1.5 * fastest[0]


def test_an_impulse_on_a_held_tree_is_not_lost():
    """Rouse a tree that nobody sees when something strikes it."""
    culled = stand(frustum=True)
    culled.set_observer((-30.0, 0.0, 2.0), BEHIND)
    culled.step(150)
    before = culled.poses.copy()
    culled.apply_impulse('pole_24/3', (0.0, 20.0, 0.0))
    culled.step(10)
    change = moved(culled, before)
    assert change[24] > 0.05 and np.delete(change, 24).max() == 0.0


def test_sleeping_trees_rest_exactly_and_wake_at_once():
    """Stop stepping what rests in still air; wind and impulses wake it, unlike the others."""
    calm = {'velocity': [0.0, 0.0, 0.0]}
    sleeper, full = stand(calm, sleeping=True), stand(calm)
    sleeper.step(300)
    assert np.abs(sleeper.poses - sleeper.blueprint.poses).max() < 1e-12
    for simulation in (sleeper, full):
        simulation.apply_impulse('pole_3/3', (5.0, 0.0, 0.0))
        simulation.step(20)
    assert np.abs(sleeper.poses - full.poses).max() < 1e-9
    before = sleeper.poses.copy()
    sleeper.set_wind((10.0, 0.0, 0.0))
    sleeper.step(30)
    assert moved(sleeper, before).min() > 1e-4


def test_far_trees_stepped_less_often_stay_close_to_the_full_simulation():
    """Bound the error of stepping far trees every third step by a share of their sway."""
    full, coarse = stand(), stand(far_interval=3, far_distance=5.0)
    coarse.set_observer((-40.0, 0.0, 2.0))
    error = sway = 0.0
    for _ in range(60):
        for simulation in (full, coarse):
            simulation.step(3)
        error = max(error, moved(coarse, full.poses).max())
        sway = max(sway, moved(full, full.blueprint.poses).max())
    assert 0.0 < error < 0.35 * sway


def test_an_impulse_at_the_centre_of_a_far_branch_does_not_spin_it():
    """Push a branch whose shown pose lies between two steps: the middle is still its middle."""
    coarse = stand(far_interval=4, far_distance=5.0)
    coarse.set_observer((-60.0, 0.0, 2.0))
    coarse.step(31)
    forest, row = coarse.state.forest, coarse.state.parts.row
    apart = np.abs(coarse.poses[:, :3] - forest.poses[row, :3]).max(axis=1)
    part = int(np.argmax(apart))
    assert apart[part] > 1e-3
    before, arm = forest.velocities[row[part]].copy(), np.array([0.0, 0.0, 0.1])
    coarse.apply_impulse(part, (0.0, 1.0, 0.0))
    change = forest.velocities[row[part]] - before
    np.testing.assert_allclose(change, [0.0, 1.0 / coarse.blueprint.mass[part], 0, 0, 0, 0],
                               atol=1e-12)
    coarse.apply_impulse(part, (0.0, 1.0, 0.0), point=coarse.poses[part, :3] + arm)
    spun = forest.velocities[row[part], 3:].copy()
    twin = coarse.fork()
    twin.apply_impulse(part, angular=-np.cross(arm, [0.0, 1.0, 0.0]))
    assert np.abs(spun - before[3:]).max() > 1e-3
    np.testing.assert_allclose(twin.state.forest.velocities[row[part], 3:], before[3:], atol=1e-12)


def test_culling_off_changes_nothing_and_on_repeats_itself():
    """Match a scene without culling bit by bit when off, and itself in two runs when on."""
    plain, off = stand(), stand(field_of_view=0.5)
    off.set_observer((0.0, 0.0, 0.0))
    twice = [stand(frustum=True, distance=30.0, far_interval=2) for _ in range(2)]
    for simulation in twice:
        simulation.set_observer((-20.0, 5.0, 2.0))
    for simulation in (plain, off, *twice):
        simulation.step(60)
    assert np.array_equal(plain.poses, off.poses)
    assert np.array_equal(twice[0].poses, twice[1].poses)


def test_a_bad_observer_is_refused():
    """Refuse a camera that is nowhere."""
    with pytest.raises(CommandError):
        stand(frustum=True).set_observer((float('nan'), 0.0, 0.0))


def test_far_debris_is_coarser_and_near_debris_exact():
    """Drop a wall: near the observer as ever, far from it in fewer pieces, and all of it down."""
    def dropped(eye, **culling):
        scene = Scene(Settings(culling=CullingSettings(**culling)))
        made = tilted(wall(12, 12, ground=False, tension=2e4, cohesion=3e4))
        scene.add(made, (0.0, 0.0, 6.0), name='wall')
        simulation = Simulation(scene)
        simulation.set_observer(eye)
        simulation.step(80)  # it lands after 66
        return simulation
    full = dropped((0.0, -10.0, 2.0))
    near = dropped((0.0, -10.0, 2.0), debris_distance=50.0)
    far = dropped((0.0, -100.0, 2.0), debris_distance=50.0)
    np.testing.assert_array_equal(near.poses, full.poses)
    few, many = (len(run.state.bodies.members) for run in (far, full))
    assert 2 < few < 0.7 * many
    assert np.median(far.poses[:, 2]) < 1.0 and far.poses[:, 2].min() > 0.0
