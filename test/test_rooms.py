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

"""Confined charges, the gas in rooms, and panes that fall and break."""

from dataclasses import replace
from types import SimpleNamespace

from masonry_walls import blueprint
import numpy as np
import pytest

from procphys_ros.geometry import rotation
from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.loads import find_room, gas_impulse, heading, peak_pressure, Sight
from procphys_ros.physics.loads.reflections import images
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, fragments, glass, Simulation

AMBIENT = 101_325.0
WINDOW = (1.0, 1.5)  # [m] wide and high


def room(yaw=0.0, window=True, roof=True):
    """Set up a room of 5 x 4 x 3 m inside, walls of 0.2 m, with a window in its front."""
    plates = [((-2.6, 0.0, 1.5), (0.2, 4.4, 3.0)), ((2.6, 0.0, 1.5), (0.2, 4.4, 3.0)),
              ((0.0, 2.1, 1.5), (5.0, 0.2, 3.0))]
    if roof:
        plates.append(((0.0, 0.0, 3.1), (5.4, 4.4, 0.2)))
    if window:
        wide, high = WINDOW
        side = 0.5 * (5.0 - wide)
        plates += [((0.5 * (wide + side) * s, -2.1, 1.5), (side, 0.2, 3.0)) for s in (-1.0, 1.0)]
        plates += [((0.0, -2.1, 0.375), (wide, 0.2, 0.75)),
                   ((0.0, -2.1, 2.625), (wide, 0.2, 0.75))]
    else:
        plates.append(((0.0, -2.1, 1.5), (5.0, 0.2, 3.0)))
    poses = np.array([[*centre, 0.0, 0.0, 0.0, 1.0] for centre, _ in plates])
    turn = np.array([3.0, 1.0, 0.0, *rotation.from_yaw(yaw)])
    return rotation.compose(turn, poses), np.array([size for _, size in plates]), turn


@pytest.mark.parametrize('yaw', [0.0, 0.6])
def test_a_room_is_measured(yaw):
    """Find volume within 6 %, window within 15 %, walls within 10 %, whichever way it faces."""
    poses, sizes, turn = room(yaw)
    point = rotation.compose(turn, np.array([[0.3, -0.4, 1.1, 0, 0, 0, 1.0]]))[0, :3]
    found = find_room(point, poses, sizes, Sight(poses, sizes))
    assert found.is_confined()
    assert found.volume == pytest.approx(60.0, rel=0.06)
    assert found.vents == pytest.approx(WINDOW[0] * WINDOW[1], rel=0.15)
    assert found.walls == pytest.approx(2 * 3.0 * 9.0 + 20.0 - 1.5, rel=0.1)
    outside = rotation.compose(turn, np.array([[0.0, -4.0, 1.0, 0, 0, 0, 1.0]]))[0, :3]
    assert find_room(outside, poses, sizes, Sight(poses, sizes)) is None


def test_a_board_on_end_does_not_turn_the_room():
    """Put a charge beside a board whose x is upright: its room and its images turn with it."""
    found = []
    on_end = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(-0.5 * np.pi))
    for yaw in (0.0, 0.6):
        poses, sizes, turn = room(yaw)
        board, point = rotation.compose(turn, np.array([
            [-2.3, 0.6, 1.0, *on_end], [-2.1, 0.6, 1.0, 0.0, 0.0, 0.0, 1.0]]))
        poses, sizes = np.vstack([poses, board]), np.vstack([sizes, [2.0, 0.8, 0.05]])
        local = rotation.rotate(rotation.conjugate(turn[3:]), [
            image.place - turn[:3] for image in images(point[:3], poses, sizes)])
        found.append((find_room(point[:3], poses, sizes, Sight(poses, sizes)), local))
    (plain, mirrored), (askew, turned) = found
    assert (plain.volume, plain.vents) == pytest.approx((askew.volume, askew.vents))
    np.testing.assert_allclose(turned, mirrored, atol=1e-9)


def test_a_wide_hall_is_closed_whichever_way_it_faces():
    """Turn a hall of 28 x 28 m by 45°, so that its corners lie 20 m away along the axes."""
    across = np.repeat([-14.1, 14.1], 29), np.tile(np.linspace(-14.0, 14.0, 29), 2)
    walls = np.column_stack([np.concatenate(across), np.concatenate(across[::-1]),
                             np.full(116, 1.0)])
    centres = np.vstack([walls, [0.0, 0.0, 2.1]])
    sizes = np.vstack([np.tile([1.0, 1.0, 2.0], (116, 1)), [29.2, 29.2, 0.2]])
    poses = np.column_stack([centres, np.tile([0.0, 0.0, 0.0, 1.0], (117, 1))])
    poses = rotation.compose(np.array([0.0, 0.0, 0.0, *rotation.from_yaw(0.25 * np.pi)]), poses)
    found = find_room(np.array([0.0, 0.0, 1.0]), poses, sizes, Sight(poses, sizes))
    assert found.vents == 0.0
    assert found.volume == pytest.approx(27.2 ** 2 * 2.0, rel=0.08)


def test_headings_are_those_of_level_edges():
    """Lay boxes on all of their sides, turned and with a little noise: modulo a quarter turn."""
    rng = np.random.default_rng(4)
    sides = rotation.from_axis_angle(
        np.eye(3)[[0, 0, 1, 1, 2]], np.pi * np.array([0.5, 1.0, 0.5, -0.5, 0.5]))
    yaw = rng.uniform(-np.pi, np.pi, 5)
    noise = rotation.from_axis_angle(np.eye(3)[rng.integers(0, 3, 5)], rng.normal(0.0, 1e-9, 5))
    upright = rotation.from_axis_angle(np.tile([0.0, 0.0, 1.0], (5, 1)), yaw)
    turned = rotation.multiply(upright, rotation.multiply(sides, noise))
    x, y, z, w = heading(turned).T
    assert not x.any() and not y.any()
    np.testing.assert_allclose(np.sin(4.0 * (2.0 * np.arctan2(z, w) - yaw)), 0.0, atol=1e-7)
    np.testing.assert_allclose(np.cos(4.0 * (2.0 * np.arctan2(z, w) - yaw)), 1.0, atol=1e-7)


def test_walls_without_a_roof_hold_no_gas():
    """Let it out at once through an opening as large as the floor."""
    poses, sizes, turn = room(window=False, roof=False)
    found = find_room(turn[:3] + [0.0, 0.0, 1.0], poses, sizes, Sight(poses, sizes))
    assert found is None or not found.is_confined()


def test_where_nothing_encloses_there_is_no_room():
    """Ask for the room around a place where panes stand that let the gas out, and nothing else."""
    poses, sizes, turn = room()
    assert find_room(turn[:3], poses[:0], sizes[:0], Sight(poses, sizes)) is None


def test_faces_into_a_room_are_found():
    """Tell the inner from the outer faces of its walls."""
    poses, sizes, turn = room()
    found = find_room(turn[:3] + [0.0, 0.0, 1.0], poses, sizes, Sight(poses, sizes))
    x = np.array([[-2.5, 0.5, 1.0], [-2.7, 0.5, 1.0], [0.0, 0.0, 3.0], [0.0, 0.0, 3.2]]) + turn[:3]
    out = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 0, -1.0], [0, 0, 1.0]])
    np.testing.assert_array_equal(found.faces(x, out), [True, False, True, False])


@pytest.mark.parametrize('density', [0.001, 0.01, 0.03, 0.16, 1.6, 5.0])
def test_gas_has_the_heat_of_the_charge(density):
    """
    Find the pressure between the heat of detonation and that of burning in the air of the room.

    4.2 MJ/kg in gas so hot that its adiabatic exponent is 1.2; 14.5 MJ/kg in air, with 1.4.
    """
    peak = peak_pressure(density * 50.0, 50.0)
    assert 0.2 * 4.2e6 * density < peak < 1.0001 * 0.4 * 14.5e6 * density


def test_heat_of_burning_follows_from_enthalpies_of_formation():
    """Burn C7H5N3O6 to 7 CO2, 2.5 H2O and N2 where there is air in plenty: 1 %."""
    heat = (7 * 393.5e3 + 2.5 * 241.8e3 - 65e3) / 0.22713
    assert peak_pressure(0.05, 50.0) == pytest.approx(0.4 * heat * 0.001, rel=0.01)


def test_gas_escapes_like_a_choked_flow():
    """Compare the exponent of Kinney and Sewell with an orifice and gas of 2,000 K: 3 %."""
    choked = 1.4 * (2.0 / 2.4) ** 3.0 * (2000.0 / 288.15) ** 0.5
    peak, volume, vents = 4e5, 60.0, 1.5
    found, _ = gas_impulse(peak, volume, vents, 70.0, 1e12)  # ln P falls steadily
    rate = (peak - AMBIENT * np.log1p(peak / AMBIENT)) / found
    assert rate * volume / (340.3 * vents) == pytest.approx(choked, rel=0.03)


def test_gas_escapes_through_openings():
    """Compare with the integral of Kinney and Sewell's law, between walls that stay."""
    peak, volume, vents = 4e5, 60.0, 1.5
    rate = 2.13 * 340.3 * vents / volume
    first = AMBIENT + peak
    wanted = (peak - AMBIENT * np.log(first / AMBIENT)) / rate
    found, duration = gas_impulse(peak, volume, vents, 70.0, 1e12)
    assert found == pytest.approx(wanted, rel=0.03)
    assert duration == pytest.approx(2.0 * found / peak)
    assert gas_impulse(peak, volume, 4.0 * vents, 70.0, 1e12)[0] == pytest.approx(
        0.25 * wanted, rel=0.03)


@pytest.mark.parametrize('mass', [1e3, 1e4, 1e5])
def test_walls_get_the_work_of_the_gas(mass):
    """Compare the energy of walls that fly off with that of an adiabatic expansion: 10 %."""
    peak, volume, walls = 4e5, 60.0, 70.0
    impulse, _ = gas_impulse(peak, volume, 0.0, walls, mass)
    speed = impulse * walls / mass
    first = AMBIENT + peak
    end = volume * (first / AMBIENT) ** (1 / 1.4)
    work = (first * volume - AMBIENT * end) / 0.4 - AMBIENT * (end - volume)
    assert 0.5 * mass * speed ** 2 == pytest.approx(work, rel=0.1)


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


def test_shards_stay_shards_when_something_joins():
    """Shatter a pane, and add a window: its pane is one, and no shard is."""
    simulation = dropped(lying(window()), 3.0, 1.5)
    assert not is_whole(simulation)
    whole = len(simulation.blueprint)
    simulation.add(window(), (20.0, 0.0, 0.0), name='later')
    assert simulation.model.glass.parts.tolist() == [PANE, whole + PANE]
