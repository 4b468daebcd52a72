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


"""Panes in pieces that fall: what stops them or bends their frame breaks them."""

from dataclasses import replace
from types import SimpleNamespace

from masonry_walls import blueprint
import numpy as np
import pytest

from procphys_ros.geometry import rotation
from procphys_ros.physics.impact import contact_time
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, fragments, glass, Simulation

PANE = 2


def window(tension=1e9, post=1000.0):
    """Build two posts with a pane of 1 m, 6 mm thick, between them, and nothing below."""
    centres = [[-0.6, 0.0, 0.45], [0.6, 0.0, 0.45], [0.0, 0.0, 0.5], [0.0, 0.0, 1.1]]
    sizes = [[0.2, 0.2, 1.1], [0.2, 0.2, 1.1], [1.0, 0.006, 1.0], [1.4, 0.2, 0.2]]
    x, z = [0.0, 0.5 ** 0.5, 0.0, 0.5 ** 0.5], [0.0, 0.0, 0.0, 1.0]
    frames = [[-0.5, 0.0, 0.5, *x], [0.5, 0.0, 0.5, *x], [0.0, 0.0, 1.0, *z],
              [-0.6, 0.0, 1.0, *z], [0.6, 0.0, 1.0, *z]]
    extent = [[1.0, 0.006], [1.0, 0.006], [1.0, 0.006], [0.2, 0.2], [0.2, 0.2]]
    made = blueprint(np.array(centres), sizes, [[0, 2], [2, 1], [2, 3], [0, 3], [1, 3]], frames,
                     extent, density=[post, post, 2500.0, post], tension=tension,
                     cohesion=tension, compression=1e10)
    made.material[PANE] = 1
    object.__setattr__(made, 'materials', ('brick', 'glass'))
    return made


def lying(made):
    """Turn a blueprint onto its face, so that its panes lie level."""
    frame = np.array([0.0, 0.0, 0.0, 0.5 ** 0.5, 0.0, 0.0, 0.5 ** 0.5])
    return replace(made, poses=rotation.compose(frame, made.poses),
                   bond_frame=rotation.compose(frame, made.bond_frame))


def dropped(made, height, seconds=0.0, **settings):
    """Drop a piece with its lowest point at that height."""
    axes = np.abs(rotation.to_matrix(made.poses[:, 3:]))
    low = (made.poses[:, 2] - np.einsum('nij,nj->ni', axes, 0.5 * made.size)[:, 2]).min()
    scene = Scene(Settings(**settings))
    scene.add(made, (0.0, 0.0, height - low), 0.0, 'window')
    simulation = Simulation(scene)
    simulation.step(round(seconds / simulation.time_step))
    return simulation


def is_whole(simulation):
    """Return whether the pane is in one piece."""
    return bool(np.isfinite(simulation.poses[PANE, 0]))


def mass_and_momentum(simulation):
    """Compute mass and momentum of all existing parts, (4,)."""
    there = np.isfinite(simulation.poses[:, 0])
    mass = simulation.blueprint.mass[there]
    return np.concatenate([[mass.sum()], mass @ simulation.velocities[there, :3]])


def bending_stress(wide, high, thick):
    """Sum Navier's series for the middle of a plate on supports under 1 Pa, ν = 0.3 [Pa]."""
    m = np.arange(1.0, 400.0, 2.0)
    sign = np.where(m % 4.0 == 1.0, 1.0, -1.0)
    x, y = np.square(m / wide)[:, None], np.square(m / high)
    sag = 16.0 / np.pi ** 4 * np.outer(sign / m, sign / m) / np.square(x + y)
    return 6.0 / thick ** 2 * max((sag * (x + 0.3 * y)).sum(), (sag * (y + 0.3 * x)).sum())


def test_panes_of_any_shape_break_and_swing_as_plates_do():
    """Compare oblong panes with series for plates; a narrow one swings as its span does alone."""
    rng = np.random.default_rng(3)
    size = np.column_stack([np.full(12, 0.006), rng.uniform(0.2, 2.0, (12, 2))])
    thin, edge, length = np.sort(np.vstack([size, [0.006, 0.1, 4.0]]), axis=1).T
    model = SimpleNamespace(blueprint=SimpleNamespace(density=np.full(13, 2500.0)),
                            glass=SimpleNamespace(thickness=thin, edge=edge, length=length))
    stress = [bending_stress(*plate) for plate in zip(edge, length, thin)]
    np.testing.assert_allclose(glass.pressure(model, np.arange(13)) * stress, 45e6, rtol=0.02)
    stiffness = 70e9 * 0.006 ** 3 / (12.0 * (1.0 - 0.23 ** 2))
    assert glass.frequency(model, np.array([12]))[0] == pytest.approx(
        (np.pi / 0.1) ** 2 * np.sqrt(stiffness / (2500.0 * 0.006)), rel=1e-3)


def test_a_pane_breaks_at_the_deceleration_that_bends_it_too_far():
    """Drop a window on its face: the pane bends for half its period, and bears that many m/s."""
    stiffness = 70e9 * 0.006 ** 3 / (12.0 * (1.0 - 0.22 ** 2))
    bends = 1.0 / (2.0 * np.pi) * np.sqrt(2500.0 * 0.006 / stiffness)
    lasts = np.hypot(bends, contact_time(window().mass.sum()))
    bearable = 45e6 * 0.006 ** 2 / (0.2874 * 1.0 ** 2) / (2500.0 * 0.006) * lasts
    for factor, holds in ((0.85, True), (1.15, False)):
        height = (factor * bearable) ** 2 / (2.0 * 9.81)
        simulation = dropped(lying(window()), height, 1.5)
        assert is_whole(simulation) == holds
        assert simulation.bonds_broken == (0 if holds else 3)


def test_a_pane_stopped_along_the_glass_holds():
    """Drop the same window on its foot from where it breaks on its face."""
    assert is_whole(dropped(window(), 3.0, 0.9))
    assert not is_whole(dropped(lying(window()), 3.0, 0.9))


def test_a_pane_breaks_with_its_frame():
    """Drop windows on a corner from a height that breaks glass only where the frame breaks."""
    for tension, holds in ((1e9, True), (1e4, False)):
        made = window(tension)
        frame = np.array([0, 0, 0, 0, np.sin(0.15), 0, np.cos(0.15)])
        made = replace(made, poses=rotation.compose(frame, made.poses),
                       bond_frame=rotation.compose(frame, made.bond_frame))
        assert is_whole(dropped(made, 0.3, 1.0)) == holds


@pytest.mark.parametrize(('mass', 'holds'), [(0.5, True), (20.0, False)])
def test_what_falls_onto_the_glass_of_rubble_breaks_it(mass, holds):
    """Throw a pebble and a stone down onto a window that lies on the ground."""
    simulation = dropped(lying(window()), 0.005, 2.0)
    simulation.launch(Projectile('sphere', (0.15, 0.15, 0.15), mass, (0.0, -0.5, 1.5),
                                 (0.0, 0.0, -4.0)))
    simulation.step(40)
    assert is_whole(simulation) == holds


def test_shards_carry_on_mass_and_momentum_of_their_pane():
    """Break the pane of a spinning window in flight: nothing else changes."""
    simulation = dropped(window(), 10.0, 0.1)
    body = int(simulation.state.carrier[PANE])
    motion = np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
    simulation.state.world.set_velocities(np.array([body]), motion)
    fragments.write_poses(simulation.model, simulation.state, simulation.time_step)
    before, where = mass_and_momentum(simulation), simulation.poses.copy()
    simulation.state.glass.load[:] = 2.0
    assert glass.shatter_loose(simulation.model, simulation.state)
    fragments.write_poses(simulation.model, simulation.state, simulation.time_step)
    assert len(simulation.blueprint) == 4 + 12
    np.testing.assert_allclose(mass_and_momentum(simulation), before, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(simulation.poses[[0, 1, 3]], where[[0, 1, 3]], atol=1e-9)
    shards = simulation.poses[4:, :3]
    np.testing.assert_allclose(np.average(shards, axis=0, weights=simulation.blueprint.mass[4:]),
                               where[PANE, :3], atol=1e-9)


def test_broken_bonds_are_told_where_they_are():
    """Tell each bond of a pane once, as broken by impact, at the pane's edges."""
    simulation = dropped(lying(window()), 3.0, 1.2)
    told = simulation.log.take()
    told = told[(told['part_a'] == PANE) | (told['part_b'] == PANE)]
    assert sorted(told['bond']) == [0, 1, 2]
    assert np.all(told['cause'] == Cause.IMPACT) and np.all(told['load'] > 1.0)
    assert np.all(np.abs(told['position'][:, 2] - 0.1) < 0.05)


def test_shards_wait_for_room():
    """Keep a broken pane in its piece while too much moves, and let it fall out after that."""
    simulation = dropped(lying(window()), 3.0, 0.9, debris_bodies=1)
    assert is_whole(simulation) and simulation.state.glass.load.max() > 1.0
    simulation.model = replace(simulation.model, settings=Settings())
    simulation.step()
    assert not is_whole(simulation) and simulation.state.glass.load.max() == 0.0


def test_same_fall_twice_and_after_reset():
    """Repeat a fall exactly, shards included."""
    simulation = dropped(lying(window()), 3.0, 1.5)
    first = simulation.poses.copy()
    simulation.reset()
    simulation.step(90)
    np.testing.assert_array_equal(simulation.poses, first)
    np.testing.assert_array_equal(dropped(lying(window()), 3.0, 1.5).poses, first)


def test_shards_stay_shards_when_something_joins():
    """Shatter a pane, and add a window: its pane is one, and no shard is."""
    simulation = dropped(lying(window()), 3.0, 1.5)
    assert not is_whole(simulation)
    whole = len(simulation.blueprint)
    simulation.add(window(), (20.0, 0.0, 0.0), name='later')
    assert simulation.model.glass.parts.tolist() == [PANE, whole + PANE]
