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
"""Dust, and what comes down on the skyline: roofs, walls, and where these are gone."""

from masonry_walls import bonded, BRICK
import numpy as np
from PIL import Image
import pytest

from procphys_ros.physics.air import AIR_VISCOSITY
from procphys_ros.physics.dust import (
    DUST_PER_ENERGY,
    DustCloud,
    lost_energy,
    Puffs,
    State,
    stokes_speed,
)
from procphys_ros.physics.foliage import FallingLeaves
from procphys_ros.physics.kinetic import motion_energy
from procphys_ros.physics.skyline import height_at, Skyline
from procphys_ros.physics.wind import WindSettings
from procphys_ros.render import draw
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import read_settings, Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import particles, Simulation
from procphys_ros.simulation.parts import Owner

STEP = 1.0 / 60.0


def blowing(velocity):
    """Return a wind that is the same everywhere."""
    return lambda points: np.broadcast_to(np.asarray(velocity, float), points.shape).copy()


def cloud_of(energy=5000.0, height=50.0, capacity=50_000, seed=1):
    """Make a cloud of dust that rose from one place."""
    cloud = DustCloud(capacity, seed)
    cloud.raise_dust(np.array([[0.0, 0.0, height]]), np.array([0.1]), np.array([energy]))
    return cloud


def total_mass(cloud):
    """Sum the mass of all puffs and of dust that waits to become one [kg]."""
    return cloud.mass[cloud.state != State.GONE].sum() + cloud.owed


def tower(drop=0.0, wind=(0.0, 0.0, 0.0), **groups):
    """Make a simulation of a column of ten bricks, hung up so high that it falls by `drop`."""
    settings = read_settings(groups)
    wind = WindSettings(wind, turbulence_intensity=0.0, profile='uniform')
    scene = Scene(Settings(wind=wind, dust=settings.dust))
    centres = np.array([[0.0, 0.0, 0.0325 + 0.075 * i] for i in range(10)])
    scene.add(bonded(centres, BRICK), (0.0, 0.0, drop), name='tower')
    return Simulation(scene)


def fallen(drop, seconds=3.0):
    """Cut a tower off the ground and let it fall."""
    simulation = tower(drop)
    solver = simulation.state.solver
    simulation.step()
    solver.cut(np.arange(len(simulation.state.solver.graph)))
    simulation.step(round(seconds / STEP))
    return simulation


def test_dust_is_proportional_to_energy():
    """Expect 5 % of a mill's 1/53.6 g/J, in puffs and the rest kept for the next."""
    assert pytest.approx(0.05 / 53.57e3, rel=1e-3) == DUST_PER_ENERGY
    for energy in (1.0, 30.0, 1000.0, 1e6):
        cloud = cloud_of(energy)
        assert total_mass(cloud) == pytest.approx(energy * DUST_PER_ENERGY, rel=1e-9)
    dribble = DustCloud(1000, 1)
    for _ in range(200):
        dribble.raise_dust(np.zeros((3, 3)), np.zeros(3), np.array([2.0, 4.0, 6.0]))
    assert total_mass(dribble) == pytest.approx(2400.0 * DUST_PER_ENERGY, rel=1e-9)
    assert 20 <= (dribble.state == State.AIRBORNE).sum() <= 23  # 2.24 g in puffs of 0.1 g


def test_dust_rises_where_energy_was_spent():
    """Share puffs among places by their energies."""
    cloud = DustCloud(50_000, 1)
    places = np.array([[0.0, 0.0, 5.0], [100.0, 0.0, 5.0], [200.0, 0.0, 5.0]])
    cloud.raise_dust(places, np.full(3, 0.2), np.array([1000.0, 3000.0, 0.0]))
    x = cloud.puffs.positions[:, 0]
    assert (x < 50).sum() * 3 == pytest.approx((x > 50).sum(), abs=3)
    assert not (x > 150).any()


def test_motion_energy_matches_rigid_body_energy():
    """Count translation, and rotation about turned principal axes."""
    inertia = np.array([[1.0, 2.0, 3.0]])
    half = np.sqrt(0.5)
    turned = np.array([[0.0, half, 0.0, half]])  # the body's x axis points down
    velocity = np.array([[3.0, 4.0, 0.0, 0.0, 0.0, 2.0]])
    assert motion_energy(np.array([2.0]), inertia, turned, velocity)[0] == pytest.approx(25 + 2)


def test_energy_that_is_handed_on_is_not_spent():
    """Share out only the balance, to those who lost."""
    before, after = np.array([10.0, 0.0, 4.0]), np.array([2.0, 3.0, 2.0])
    assert lost_energy(before, after, 0.0) == pytest.approx([8.0 * 0.7, 0.0, 2.0 * 0.7])
    assert lost_energy(before, after, 6.0) == pytest.approx([0.8, 0.0, 0.2])
    assert lost_energy(before, after, 60.0).sum() == 0.0
    assert lost_energy(after, after, 0.0).sum() == 0.0


def test_dust_settles_at_the_stokes_speed():
    """Fall by the closed form d²·g·Δρ/(18·μ) times the time, within the turbulence's error."""
    grains = np.array([5e-6, 20e-6, 60e-6])
    assert stokes_speed(grains) == pytest.approx(
        grains ** 2 * 9.81 * (2000 - 1.225) / (18 * AIR_VISCOSITY))
    assert stokes_speed(20e-6) == pytest.approx(0.0244, rel=0.01)
    sutherland = 1.458e-6 * 288.15 ** 1.5 / (288.15 + 110.4)  # ISO 2533, at 15 °C
    assert sutherland == pytest.approx(AIR_VISCOSITY, rel=1e-3)
    cloud = cloud_of(100e3, height=50.0)
    start, grain = cloud.position.copy(), cloud.grain.copy()
    for _ in range(600):
        cloud.step(STEP, blowing((0.0, 0.0, 0.0)))
    up = cloud.state == State.AIRBORNE
    miss = start[up, 2] - cloud.position[up, 2] - 10.0 * stokes_speed(grain[up])
    assert miss.mean() == pytest.approx(0.0, abs=4.0 * miss.std() / np.sqrt(up.sum()))
    assert miss.std() == pytest.approx(np.sqrt(0.02 * 10.0), rel=0.1)
    assert up.sum() > 500


def test_grain_sizes_are_those_of_the_distribution():
    """Draw a median of 20 µm with a factor of 2, and nothing that Stokes' law fails for."""
    cloud = cloud_of(40_000.0)
    grain = cloud.grain[cloud.state == State.AIRBORNE]
    assert np.median(grain) == pytest.approx(20e-6, rel=0.1)
    assert grain.max() <= 60e-6 and np.quantile(grain, 0.16) == pytest.approx(10e-6, rel=0.15)


def test_dust_drifts_with_the_wind_and_spreads():
    """Move with the air on average, and widen as a neutral puff does: 4 m after 100 m."""
    cloud = cloud_of(1e6, height=200.0)

    def variance(puffs):
        return puffs.positions[:, 0].var() + ((puffs.sizes / 4.0) ** 2).mean()

    start = cloud.puffs
    for _ in range(1200):
        cloud.step(STEP, blowing((5.0, -1.0, 0.0)))
    puffs = cloud.puffs
    assert len(puffs.ages) == len(start.ages) > 500
    way = (puffs.positions - start.positions).mean(axis=0)
    assert way[:2] == pytest.approx([100.0, -20.0], abs=0.5)
    wider = variance(puffs) - variance(start)
    assert wider == pytest.approx(2.0 * (0.08 * np.hypot(5.0, 1.0) + 0.02) * 20.0, rel=0.15)
    assert np.sqrt(wider) == pytest.approx(4.0, rel=0.1)


def test_dust_starts_as_dense_as_air_takes_it():
    """Hold 2 g/m³ in the middle of a new puff, and around a hit that made many."""
    for energy in (5.5, 1e5):
        cloud = cloud_of(energy, height=1000.0)
        some = cloud.state != State.GONE
        dense = cloud.mass[some] / (2.0 * np.pi * cloud.deviation[some] ** 2) ** 1.5
        assert dense == pytest.approx(2e-3)
    wide = cloud.puffs.positions.std(axis=0)
    assert total_mass(cloud) / (2.0 * np.pi * (wide ** 2).mean()) ** 1.5 == pytest.approx(
        2e-3, rel=0.1)


def test_puffs_thin_out_with_age_and_vanish():
    """Lose opacity for good while they widen, and be gone when nobody could see them."""
    cloud = cloud_of(200.0)
    last = cloud.puffs.opacity
    for _ in range(20):
        cloud.step(0.1, blowing((3.0, 0.0, 0.0)))
        now = cloud.puffs.opacity
        assert len(now) < len(last) or (now < last).all()
        last = now
    assert np.allclose(cloud.puffs.ages, 2.0)
    for _ in range(3000):
        cloud.step(0.1, blowing((3.0, 0.0, 0.0)))
    assert len(cloud.puffs.ages) == 0


def test_dust_lies_where_it_lands():
    """Come down, stay above ground all the time, and not move any more."""
    cloud = cloud_of(500.0, height=0.3)
    cloud.grain[:] = 60e-6
    cloud._fall[:] = stokes_speed(60e-6)
    for _ in range(1200):
        cloud.step(STEP, blowing((0.0, 0.0, 0.0)))
        assert (cloud.puffs.positions[:, 2] >= 0.0).all()
    lying = cloud.state == State.LYING
    assert lying.sum() > 0.9 * (cloud.state != State.GONE).sum() > 0
    there = cloud.position[lying].copy()
    cloud.step(STEP, blowing((20.0, 0.0, 0.0)))
    assert np.array_equal(cloud.position[lying], there) and (there[:, 2] == 0.0).all()


def test_the_number_of_puffs_is_bounded_and_the_oldest_go_first():
    """Keep the newest of ever more dust, heavier puffs when too much rises at once."""
    cloud = DustCloud(500, 1)
    for i in range(100):
        cloud.raise_dust(np.array([[1e3 * i, 0.0, 30.0]]), np.zeros(1), np.array([1e5]))
    puffs = cloud.puffs
    assert len(puffs.ages) == 500 and len(cloud.state) == 500
    assert set(np.round(puffs.positions[:, 0] / 1e3)) == set(range(50, 100))
    assert cloud.raise_dust(np.zeros((1, 3)), np.zeros(1), np.array([1e9])) == 10
    assert cloud.mass.max() == pytest.approx(0.1 * 1e9 * DUST_PER_ENERGY, rel=1e-3)


def test_the_same_seed_gives_the_same_dust_also_after_clear():
    """Repeat everything bit for bit."""
    runs = []
    for seed in (1, 1, 2):
        cloud = cloud_of(seed=seed)
        cloud.step(STEP, blowing((3.0, 0.0, 0.0)))
        runs.append(cloud.puffs.positions)
    cloud.clear()
    assert len(cloud.puffs.ages) == 0 and cloud.owed == 0.0
    cloud.raise_dust(np.array([[0.0, 0.0, 50.0]]), np.array([0.1]), np.array([5000.0]))
    cloud.step(STEP, blowing((3.0, 0.0, 0.0)))
    runs.append(cloud.puffs.positions)
    assert np.array_equal(runs[0], runs[1]) and np.array_equal(runs[2], runs[3])
    assert not np.array_equal(runs[0], runs[2])


def test_a_fall_gives_dust_in_proportion_to_the_height():
    """Spend on dust the potential energy of a tower that falls apart, within a tenth."""
    for drop in (2.0, 6.0):
        simulation = fallen(drop)
        mass = simulation.blueprint.mass.sum()
        joints = simulation.blueprint.bond_area.sum() * 18.0
        height = simulation.blueprint.poses[:, 2].mean() - simulation.poses[:, 2].mean()
        spent = total_mass(simulation.state.dust.cloud) / DUST_PER_ENERGY
        assert spent - joints == pytest.approx(mass * 9.81 * height, rel=0.1)


def test_dust_lies_around_what_fell():
    """Raise dust at the place of the impact, at the time of the impact."""
    simulation = fallen(6.0, seconds=1.0)
    assert len(simulation.dust.ages) == 0  # 6 m take 1.1 s
    simulation.step(30)
    puffs = simulation.dust
    assert len(puffs.ages) > 3 and puffs.ages.max() < 0.6
    assert np.abs(np.median(puffs.positions, axis=0)).max() < 1.0


def test_a_projectile_gives_dust_for_the_energy_it_leaves_in_a_wall():
    """Turn into dust what a ball loses in a wall and no brick takes along; nothing in flight."""
    scene = Scene()
    centres = np.array([[0.225 * i, 0.0, 0.0325 + 0.075 * j] for i in range(7) for j in range(9)])
    scene.add(bonded(centres, BRICK), name='wall')
    simulation = Simulation(scene)
    ball = simulation.launch(Projectile('sphere', 0.2, 20.0, (0.675, -2.0, 0.4), (0.0, 30.0, 0.0)))
    simulation.step(3)
    cloud = simulation.state.dust.cloud
    assert total_mass(cloud) == 0.0
    simulation.step(2)
    speed, bricks = simulation.velocities[:, :3] ** 2, slice(0, 63)
    lost = 0.5 * 20.0 * (30.0 ** 2 - speed[ball].sum())
    carried = 0.5 * simulation.blueprint.mass[bricks] @ speed[bricks].sum(axis=1)
    assert simulation.impacts[0].torn and lost > 1000.0
    assert total_mass(cloud) / DUST_PER_ENERGY == pytest.approx(lost - carried, rel=0.1)
    assert np.abs(np.median(cloud.puffs.positions, axis=0) - [0.675, 0.0, 0.4]).max() < 0.5


def test_standing_and_resting_things_do_not_smoke():
    """Expect no dust at all from a standing tower, and none from one that lies still."""
    simulation = tower()
    simulation.step(60)
    assert total_mass(simulation.state.dust.cloud) == 0.0
    simulation = fallen(1.0, seconds=6.0)
    before = total_mass(simulation.state.dust.cloud)
    assert before > 0.0
    simulation.step(120)
    cloud = simulation.state.dust.cloud
    assert cloud.owed == pytest.approx(before - cloud.mass[cloud.state > 0].sum(), abs=1e-4)
    assert total_mass(cloud) <= before * (1.0 + 1e-9)


def test_switched_off_dust_changes_nothing():
    """Expect the same poses with and without dust, and no puffs without."""
    runs = []
    for enabled in (True, False):
        simulation = tower(2.0, dust={'enabled': enabled})
        simulation.state.solver.cut(np.arange(len(simulation.state.solver.graph)))
        simulation.step(90)
        runs.append((simulation.poses, len(simulation.dust.ages)))
    assert np.array_equal(runs[0][0], runs[1][0])
    assert runs[0][1] > 0 and runs[1][1] == 0


def test_puffs_fade_towards_their_edges_and_before_what_they_touch(tmp_path):
    """Whiten the middle of a puff most, and less where a wall stands in it."""
    wall = bonded(np.array([[0.3 * i, 0.0, 0.0325] for i in range(4)]), BRICK)
    pictures = {}
    for name, away in (('clear', None), ('before', -0.5), ('inside', 0.0)):
        puff = None if away is None else Puffs(
            np.array([[0.5, away, 0.03]]), np.array([0.5]), np.array([0.6]), np.zeros(1))
        path = tmp_path / f'{name}.png'
        draw(wall, wall.poses, path, size=(160, 90), camera=(0.5, -3.0, 0.03, 0.5, 0.0, 0.03),
             dust=puff)
        pictures[name] = np.asarray(Image.open(path).convert('RGB'), float)
    change = {name: np.abs(pictures[name] - pictures['clear']).max(axis=2)
              for name in ('before', 'inside')}
    middle, side = change['before'][43:47, 78:82].mean(), change['before'][43:47, 68:72].mean()
    assert middle > side > 2.0
    assert change['inside'][43:47, 78:82].mean() < 0.8 * middle


HOUSE = np.array([[-3.0, -2.0, 0.0, 3.0, 2.0, 5.0]])
EDGE = 0.25  # [m] of a cell: what stands is so much wider for leaves


def leaves_at(points):
    """Release leaves at some points."""
    falling = FallingLeaves(9.81, 1)
    pose = np.hstack([points, np.tile([0.0, 0.0, 0.0, 1.0], (len(points), 1))])
    falling.let_go(np.arange(len(points)), pose, np.zeros((len(points), 3)),
                   np.full(len(points), 0.1))
    return falling


def over_house(count, height, reach=6.0, seed=0):
    """Scatter points over a square around the house, at one height."""
    place = np.random.default_rng(seed).uniform(-reach, reach, (count, 2))
    return np.column_stack([place, np.full(count, height)])


def on_house(points, room=0.0):
    """Mark the points above or inside the ground plan of the house."""
    return ((np.abs(points[:, 0]) < 3.0 + room) & (np.abs(points[:, 1]) < 2.0 + room))


def test_heights_are_those_of_the_boxes():
    """Compare every place with the highest of all boxes that reach into its cell."""
    rng = np.random.default_rng(1)
    low = rng.uniform(-8.0, 6.0, (40, 2))
    bounds = np.column_stack([low, np.zeros(40), low + rng.uniform(0.1, 3.0, (40, 2)),
                              rng.uniform(0.5, 9.0, 40)])
    skyline = Skyline.over(bounds)
    for x, y in rng.uniform(-10.0, 10.0, (500, 2)):
        corner = skyline.low + EDGE * np.floor((np.array([x, y]) - skyline.low) / EDGE)
        meets = ((bounds[:, :2] < corner + EDGE) & (bounds[:, 3:5] >= corner)).all(axis=1)
        assert height_at(skyline, x, y) == bounds[meets, 5].max(initial=0.0)


def landed(start, steps, skyline):
    """Let leaves fall in still air, to a roof or to the ground, until they lie."""
    falling = leaves_at(start)
    for _ in range(steps):
        falling.step(np.flatnonzero(falling.flying), np.zeros((falling.flying.sum(), 3)), STEP,
                     skyline)
    assert not falling.flying.any()
    return falling


def test_leaves_come_to_rest_on_a_roof():
    """Lie on the roof where there is one below, and on the ground beside it."""
    start = over_house(400, 9.0)
    falling = landed(start, 900, Skyline.over(HOUSE))
    height = falling.poses[:, 2]
    assert height[on_house(start)] == pytest.approx(5.01)
    assert height[~on_house(start, EDGE)] == pytest.approx(0.01)


def test_leaves_do_not_fly_through_walls():
    """Stop at the windward wall, fall down along it, and never be inside the house."""
    points = np.random.default_rng(2).uniform((-9.0, -1.5, 1.0), (-6.0, 1.5, 3.0), (300, 3))
    falling, free = leaves_at(points), leaves_at(points)
    skyline = Skyline.over(HOUSE)
    for _ in range(600):
        for leaves, obstacles in ((falling, (skyline,)), (free, ())):
            rows = np.flatnonzero(leaves.flying)
            leaves.step(rows, np.tile([12.0, 0.0, 0.0], (len(rows), 1)), STEP, *obstacles)
        inside = on_house(falling.poses) & (falling.poses[:, 2] < 5.0)
        assert not inside.any()
    assert (np.abs(falling.poses[:, 0] + 3.0) < 2.0 * EDGE).mean() > 0.9
    assert (free.poses[:, 0] > -2.0).mean() > 0.9


def test_leaves_fly_on_when_a_roof_is_gone():
    """Lift what lay on it, and nothing else."""
    start = over_house(200, 5.5)
    skyline = Skyline.over(HOUSE)
    falling = landed(start, 600, skyline)
    falling.lift(skyline)
    assert not falling.flying.any()
    lay_high = falling.poses[:, 2] > 1.0
    falling.lift(Skyline.over(HOUSE[:0]))
    assert np.array_equal(falling.flying, lay_high) and lay_high.any() and not lay_high.all()


def test_dust_settles_on_a_roof_and_stays_outside():
    """Lay dust on top of a house, and let turbulence carry none of it inside."""
    cloud = DustCloud(20_000, 1)
    cloud.raise_dust(np.array([[0.0, 0.0, 5.5]]), np.array([0.3]), np.array([1e6]))
    cloud.position[:, 2] = np.maximum(cloud.position[:, 2], 5.2)
    rows = cloud.state == State.AIRBORNE
    skyline = Skyline.over(HOUSE)
    for _ in range(900):
        cloud.step(STEP, np.zeros_like, skyline)
        place = cloud.position[rows]
        assert not (on_house(place) & (place[:, 2] < 5.0 - 1e-9)).any()
    lies = cloud.state == State.LYING
    assert np.count_nonzero(lies) > 20
    assert cloud.position[lies & on_house(cloud.position), 2] == pytest.approx(5.0)
    cloud.lift(Skyline.over(HOUSE[:0]))
    assert np.count_nonzero(cloud.state == State.LYING) < 0.5 * np.count_nonzero(lies)


def test_the_skyline_follows_what_stands():
    """Draw a wall as high as it is, the same object until bricks are torn out, lower then."""
    scene = Scene()
    centres = np.array([[0.225 * i, 0.0, 0.0325 + 0.075 * j] for i in range(9) for j in range(10)])
    scene.add(bonded(centres, BRICK), name='wall')
    simulation = Simulation(scene)
    model, state = simulation.model, simulation.state
    whole = particles.current_skyline(model, state)
    top = BRICK[2] / 2.0 + 0.0325 + 0.075 * 9
    assert height_at(whole, 0.9, 0.0) == pytest.approx(top)
    simulation.step(40)
    assert particles.current_skyline(model, state) is whole
    state.parts.owner[centres[:, 2] > 0.4] = Owner.GONE
    state.time += 0.3
    drawn = particles.current_skyline(model, state)
    assert height_at(drawn, 0.9, 0.0) == pytest.approx(BRICK[2] / 2.0 + 0.0325 + 0.075 * 4)
