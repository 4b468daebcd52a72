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


"""Walls of several leaves that are struck: all that a blow pushes ahead is judged together."""

from masonry_walls import bonded, BRICK, JOINT, resistance_of, wall_boxes
import numpy as np
import pytest

from procphys_ros.files.resources import shared_folder
from procphys_ros.physics.fracture_energy import CRUSHING, SHEARING
from procphys_ros.physics.impact import contact_time
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.scene.yaml_file import read_yaml
from procphys_ros.simulation import masonry, projectiles, Simulation

LEAF = BRICK[1] + JOINT  # [m]
COHESION = 0.3e6         # [Pa]
ALONG = np.array([0.0, 1.0, 0.0])


def stand(built):
    """Make a simulation without gravity, so that beds are not pressed; no engine moves any yet."""
    scene = Scene(Settings(gravity=0.0, engine='native'))
    scene.add(built)
    return Simulation(scene)


def pier(leaves, courses=9):
    """Stack bricks to a pier a brick wide and some leaves deep, which no head joints hold."""
    place = np.mgrid[:1, :leaves, :courses].reshape(3, -1).T
    centres = place * [0.0, LEAF, BRICK[2] + JOINT] + [0.0, 0.0, 0.5 * BRICK[2]]
    return bonded(centres, BRICK, cohesion=COHESION)


def wall(leaves):
    """Lay a wall of some leaves, each against the next by half a brick."""
    boxes = [wall_boxes(12, 24, shift=(0.0, k * LEAF, 0.0), offset=k % 2) for k in range(leaves)]
    return bonded(*(np.vstack(column) for column in zip(*boxes)), cohesion=COHESION)


def strike(simulation, mass, speed, place, size, shape='sphere'):
    """Throw a projectile at a wall, and make its first blows only; return it."""
    simulation.launch(Projectile(shape, size, mass, place, (0.0, speed, 0.0)))
    for _ in range(200):
        before = loose(simulation)
        projectiles.step(simulation.model, simulation.state, simulation.time_step)
        if simulation.impacts:
            return before
        simulation.step()
    raise AssertionError('nothing was struck')


def loose(simulation):
    """Compute momentum [N·s] and kinetic energy [J] of everything loose."""
    ids = np.array(list(simulation.state.bodies.members))
    world = simulation.state.world.bodies
    velocity, mass = world.velocities[ids], world.mass[ids]
    spin = (world.inertia[ids].max(axis=1) * (velocity[:, 3:] ** 2).sum(axis=1)).sum()
    return (mass @ velocity[:, :3],
            0.5 * float(mass @ (velocity[:, :3] ** 2).sum(axis=1)) + 0.5 * float(spin))


@pytest.mark.parametrize('leaves', [1, 2, 3])
@pytest.mark.parametrize('mass', [3.0, 30.0])
def test_a_pier_holds_what_its_beds_bear_over_its_whole_depth(leaves, mass):
    """
    Drive a course out through all leaves once the blow exceeds both beds, not before.

    It moves the bricks behind the one that is struck as well, half as fast at least; and where it
    lasts long enough to move all that stands on the course, too, it needs to exceed one bed only.
    """
    simulation = stand(pier(leaves))
    own, height = simulation.blueprint.mass, simulation.poses[:, 2]
    course = np.flatnonzero(np.abs(height - height[4]) < 0.01)
    above = np.flatnonzero(height > height[4] + 0.01)
    bed = leaves * BRICK[0] * BRICK[1] * COHESION
    behind, over = (0.5 * own[parts].sum() / (mass + own[4]) for parts in (course[1:], above))
    force, out = min((2.0 * bed / max(1.0 - behind, 1e-9), course.tolist()),
                     (bed / max(1.0 - behind - over, 1e-9), [*course, *above]))
    limit = force * float(contact_time(mass)) / 1.25 / mass
    for share, comes in ((0.97, False), (1.03, True)):
        simulation.reset()
        strike(simulation, mass, share * limit, (0.0, -0.3, simulation.poses[4, 2]), 0.06)
        impact = simulation.impacts[0]
        assert impact.torn == comes
        if comes:
            np.testing.assert_array_equal(np.sort(impact.parts), np.sort(out))
            moved = mass + own[out].sum()
            left = (mass * share * limit / moved) ** 2 - 2.0 * impact.work / moved
            assert impact.carried[1] == pytest.approx((moved - mass) * np.sqrt(left))


@pytest.mark.parametrize('leaves', [1, 2, 3])
@pytest.mark.parametrize('courses', [1, 2])
def test_an_intruder_feels_what_all_that_it_pushes_withstands(leaves, courses):
    """Drive a box into a pier: feel its lower bed, and the inertia of all above that over dt."""
    height, speed = courses * (BRICK[2] + JOINT) - 2.0 * JOINT, 1.2
    scene = Scene.from_parameters({
        'scene': {'objects': []}, 'gravity': 0.0,
        'intruder': {'shape': 'box', 'size': [0.3, 0.2, height]}})
    built = pier(leaves)
    scene.add(built)
    simulation = Simulation(scene)
    middle = built.poses[4, 2] + 0.5 * (courses - 1) * (BRICK[2] + JOINT)
    while not simulation.intruder_wrench.any():
        way = -0.3 + speed * simulation.time
        simulation.place_intruder([0.0, way, middle, 0.0, 0.0, 0.0, 1.0])
        simulation.step()
    out = simulation.velocities[:, 1] > 0.5 * speed
    assert out.sum() == 5 * leaves
    beds = leaves * BRICK[0] * BRICK[1] * COHESION
    thrust = built.mass[out].sum() * speed / simulation.time_step
    assert -simulation.intruder_wrench[1] == pytest.approx(beds + thrust, rel=1e-3)


def test_a_plug_widens_as_bricks_overlap_and_ends_behind_the_wall():
    """Push on one stretcher: two lie behind it, and three behind these."""
    simulation = stand(wall(3))
    built = simulation.blueprint
    front = np.flatnonzero(built.poses[:, 1] < 0.5 * LEAF)
    brick = front[np.argmin(np.linalg.norm(built.poses[front, :3] - [1.3, 0.05, 0.9], axis=1))]
    whole, withstood = masonry.weakest_plug(simulation.state, np.array([brick]), ALONG, 10.0)
    depth = np.bincount(np.round(built.poses[whole, 1] / LEAF).astype(int), minlength=3)
    assert depth[0] >= 1 and depth[0] <= depth[1] <= depth[2] and depth[2] >= 3
    alone = resistance_of(simulation.state.solver, np.array([brick]), ALONG).force
    assert alone > 1e7 * 0.9 * BRICK[0] * BRICK[2]  # alone it would have to crush its mortar
    assert withstood.force < 0.7 * alone


@pytest.mark.parametrize('cracked', [False, True])
def test_what_is_crushed_takes_the_work_for_that(cracked):
    """Drive a brick into the next of its course, head on and askew: crush the joint, or slide."""
    simulation = stand(bonded([[0.0, 0.0, 0.5], [0.0, BRICK[1] + JOINT, 0.5]], BRICK,
                              cohesion=COHESION, ground=False))
    graph = simulation.state.solver.graph
    graph.cracked[:] = cracked
    area = BRICK[0] * BRICK[2]
    head_on = resistance_of(simulation.state.solver, np.array([0]), ALONG)
    assert head_on.force == pytest.approx(1e7 * area)
    assert head_on.energy == pytest.approx(CRUSHING * area)
    askew = resistance_of(simulation.state.solver, np.array([0]), np.array([0.8, 0.6, 0.0]))
    assert askew.energy == pytest.approx(0.0 if cracked else SHEARING * area)


def test_whatever_strikes_momentum_is_kept_and_no_energy_won():
    """
    Strike walls of one to three leaves with 3 kg to 12 t at 1 to 30 m/s.

    What the loose have then is what they had, less what the ledger knows to be in the wall. What
    the leaves together do not bear goes through: a heavy block takes them along at its speed.
    """
    rng, through = np.random.default_rng(0), set()
    walls = [stand(wall(leaves)) for leaves in (1, 2, 3)]
    for turn in range(30):
        simulation = walls[turn % 3]
        simulation.reset()
        mass, speed = np.exp(rng.uniform(np.log([3.0, 1.0]), np.log([12e3, 30.0])))
        size = min((mass / 2500.0) ** (1.0 / 3.0), 1.4)
        momentum, energy = strike(
            simulation, mass, speed, (1.3 + rng.uniform(-0.2, 0.2), -0.1 - size, 0.9), size,
            ('sphere', 'box')[turn % 2])
        grounded = sum(impact.grounded for impact in simulation.impacts)
        now, left = loose(simulation)
        np.testing.assert_allclose(now + grounded, momentum, atol=1e-6 * mass * speed)
        assert left <= energy * (1.0 + 1e-9)
        first = simulation.impacts[0]
        depth = np.ptp(simulation.blueprint.poses[first.parts, 1])
        if first.torn:
            through.add(turn % 3)
            assert depth > (turn % 3 - 0.01) * LEAF  # all leaves, or a hole in none
        elif mass > 1000.0 and speed > 6.0:
            raise AssertionError(f'{mass:.0f} kg at {speed:.1f} m/s bounced')
    assert through == {0, 1, 2}


def test_a_wall_becomes_no_faster_than_what_strikes_it():
    """
    Strike a light wall with a tonne, while something faster flies far away: that changes nothing.

    The momentum that it takes would make the wall of 60 kg faster than the box, if it had it all.
    Until it leaves the ground it has no speed.
    """
    boxes, fastest = wall_boxes(12, 24), []
    for others in ((), (Projectile('sphere', 0.2, 5.0, (1.3, 300.0, 90.0), (0.0, 100.0, 0.0)),)):
        scene = Scene()
        scene.add(bonded(*boxes, density=100.0, cohesion=2e6, tension=1e6))
        simulation = Simulation(scene)
        for projectile in (Projectile('box', 1.2, 1000.0, (1.3, -0.75, 0.7), (0.0, 4.0, 0.0)),
                           *others):
            simulation.launch(projectile)
        mass, speeds = simulation.blueprint.mass[:len(boxes[0])], []
        for _ in range(12):
            simulation.step()
            assert not simulation.velocities[simulation.state.standing].any()
            gone = ~simulation.state.standing[:len(mass)]
            if gone.any():
                speeds.append(np.average(simulation.velocities[:len(mass), 1][gone],
                                         weights=mass[gone]))
        fastest.append(max(speeds))
        assert not simulation.state.standing[:len(mass)].all()
    assert fastest[0] == fastest[1]
    assert 4.0 * 1000.0 / 1060.0 < 1.02 * fastest[0] < 1.02 * 4.0


def test_twelve_tonnes_go_through_the_pier_of_an_arcade():
    """Drive all that the block covers out of the pier; it goes on, slower by their inertia."""
    config = shared_folder() / 'config'
    values = read_yaml(config / 'arcade_pier.yaml')
    values['projectile']['position'] = [3.35, -1.5, 0.73]  # upright: it does not bounce before
    simulation = Simulation(Scene.from_parameters(values, config))
    built = len(simulation.blueprint)
    speed, front = 0.0, np.zeros(2)  # at which it slides there, and the middle of its front, x, z
    while not simulation.impacts:
        if simulation.state.missiles:
            block = simulation.state.missiles[0].part
            speed, front = simulation.velocities[block, 1], simulation.poses[block, [0, 2]]
        simulation.step()
    impact, = simulation.impacts
    place = simulation.blueprint.poses[impact.parts]
    assert impact.torn and np.ptp(place[:, 1]) > 0.1
    apart = np.abs(simulation.blueprint.poses[:built, [0, 2]] - front)  # upright boxes along x
    reach = 0.5 * simulation.blueprint.size[:built, [0, 2]] + [0.5, 0.7]  # and half of the block
    covered = np.flatnonzero((apart < reach).all(axis=1))
    assert len(covered) > 150 and np.array_equal(np.sort(impact.parts), covered)
    assert np.array_equal(np.flatnonzero(~simulation.state.standing[:built]), covered)
    moved = 12000.0 + simulation.blueprint.mass[impact.parts].sum()
    left = np.sqrt((12000.0 * speed / moved) ** 2 - 2.0 * impact.work / moved)
    assert impact.lost[1] == pytest.approx(12000.0 * (speed - left), rel=0.01)
    simulation.step(15)
    block = simulation.state.missiles[0].part
    assert simulation.poses[block, 1] > 0.5 and simulation.velocities[block, 1] > 4.0
    place = simulation.blueprint.poses[:built]
    above = np.flatnonzero((place[:, 0] > 2.9) & (place[:, 0] < 3.8) & (place[:, 2] > 2.5))
    end = simulation.time + 1.25  # 1.5 s after the blow; it hung in the air for three before
    while np.median(place[above, 2] - simulation.poses[above, 2]) <= 0.1:
        assert simulation.time < end
        simulation.step(5)
