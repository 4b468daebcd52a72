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

"""Walls that are struck: contact times, and that all a blow pushes is judged together."""

from types import SimpleNamespace

from masonry_walls import bonded, BRICK, JOINT, resistance_of, wall_boxes
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from procphys_ros.files.resources import shared_folder
from procphys_ros.physics.fracture_energy import CRUSHING, SHEARING
from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.masonry import blow_kernels, cells, FreeBodies, links
from procphys_ros.physics.world import World
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.scene.yaml_file import read_yaml
from procphys_ros.simulation import masonry, projectiles, Simulation
from procphys_ros.simulation.blows import energies, measure

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
    """Drive a course out through all leaves once the blow exceeds both beds, not before."""
    # It moves the bricks behind the one that is struck as well, half as fast at least; and where
    # it lasts long enough to move all that stands on the course, too, it needs to exceed one bed
    # only.
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
    """Strike walls of one to three leaves with 3 kg to 12 t at 1 to 30 m/s."""
    # What the loose have then is what they had, less what the ledger knows to be in the wall. What
    # the leaves together do not bear goes through: a heavy block takes them along at its speed.
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


_MODULUS, _DENSITY, _SPEED = 0.5e9, 1900.0, 3.0  # [Pa], [kg/m³], [m/s], of which the law is told
_STEP = 1.0 / 60.0  # [s]
_GROUND = (1e9, 0.0)  # mass [kg] and velocity [m/s]


@pytest.mark.parametrize('mass', [0.3, 3.0, 2000.0])
def test_contact_lasts_as_long_as_that_of_hertz(mass):
    """Integrate a ball that meets a flat wall, F = 4/3·E*·√R·δ^1.5, until it has sprung back."""
    radius = np.cbrt(3.0 * mass / (4.0 * np.pi * _DENSITY))
    stiffness = 4.0 / 3.0 * _MODULUS * np.sqrt(radius)

    def leaves(time, state):
        return state[0]

    leaves.terminal, leaves.direction = True, -1.0
    flight = solve_ivp(lambda t, s: [s[1], -stiffness / mass * max(s[0], 0.0) ** 1.5], (0.0, 1.0),
                       [0.0, _SPEED], events=leaves, rtol=1e-9, atol=1e-12, max_step=1e-3)
    assert flight.y[1, -1] == pytest.approx(-_SPEED, rel=1e-6)
    assert flight.t_events[0][-1] == pytest.approx(contact_time(mass), rel=0.03)


def test_contact_times_of_a_brick_and_of_a_wrecking_ball():
    """Expect 2 ms for a brick and 18 for two tonnes: eight times as long for 1000 times m."""
    np.testing.assert_allclose(contact_time(np.array([3.0, 2000.0])), [2e-3, 17.6e-3], rtol=0.02)
    assert contact_time(1000.0) == pytest.approx(10.0 * contact_time(1.0))
    assert contact_time(np.inf) == np.inf


def measured(bodies, pairs, fall=0.0, step=_STEP):
    """
    Measure vertical contacts, all at the middle of the bodies; what has 1e9 kg is immovable.

    :param bodies: masses [kg] and changes of velocity by all contacts [m/s].
    :param pairs: of each contact: first body, second body, impulse on the first [N·s].
    :param fall: speed that gravity gives in the step [m/s].
    :param step: its length [s].
    """
    with World() as world:
        ids = [world.add_body(0, np.full(3, 0.2), mass, np.array([0.0, 0, 2, 0, 0, 0, 1]))
               for mass, _ in bodies]
        change = np.zeros((len(world.bodies.state), 6))
        change[ids, 2] = [speed for _, speed in bodies]
        start = world.bodies.poses.copy()
        loose = np.where(world.bodies.mass < 1e9, world.bodies.mass, 0.0)
    first, second, impulse = zip(*pairs)
    contacts = SimpleNamespace(
        body_a=np.array([ids[i] for i in first]), body_b=np.array([ids[i] for i in second]),
        impulse=np.outer(impulse, [0.0, 0.0, 1.0]),
        point=np.tile([0.0, 0.0, 2.0], (len(pairs), 1)))
    return measure(contacts, change, start, loose, fall, step)


def test_mass_in_a_contact_is_that_which_it_stops():
    """Reduce two free masses, and share one that lands on two."""
    free = measured([(10.0, -4.0), (40.0, 1.0)], [(0, 1, -40.0)])
    np.testing.assert_allclose(free.duration, contact_time(8.0))
    landing = measured([(10.0, -4.0), _GROUND, _GROUND], [(0, 1, -10.0), (0, 2, -30.0)])
    np.testing.assert_allclose(landing.duration, contact_time(np.array([2.5, 7.5])))


def test_what_does_not_close_lasts_as_long_as_what_it_passes_on():
    """Squeeze a brick, and land one on top of the other: forces on the light ones balance."""
    squeezed = measured([(100.0, 4.0), (3.0, 0.0), _GROUND], [(0, 1, 400.0), (1, 2, 400.0)])
    np.testing.assert_allclose(squeezed.duration, contact_time(100.0), rtol=0.01)
    pile = measured([(100.0, 4.0), (3.0, 4.0), (20.0, 4.0), _GROUND],
                    [(0, 1, 400.0), (1, 2, 412.0), (2, 3, 492.0)])
    np.testing.assert_allclose(pile.duration, contact_time(123.0), rtol=0.05)
    slower = measured([(100.0, 4.0), (3.0, 2.0), _GROUND], [(0, 1, 400.0), (1, 2, 406.0)])
    np.testing.assert_allclose(slower.duration, contact_time(203.0), rtol=0.01)


@pytest.mark.parametrize('step', [_STEP, 0.25 * _STEP, 3.0 * _STEP])
def test_what_bears_a_weight_lasts(step):
    """Stack two that rest: contacts give them speed against gravity, and stop nothing."""
    fall = 9.81 * step
    rests = [(50.0, fall), (100.0, fall), _GROUND]
    borne = [(0, 1, 50.0 * fall), (1, 2, 150.0 * fall)]
    np.testing.assert_allclose(measured(rests, borne, fall, step).duration, step, rtol=0.05)


@pytest.mark.parametrize('mass', [1.0, 1e2, 1e5])
def test_no_blow_hangs_on_the_time_step(mass):
    """Land two on top of each other, in steps of different length."""
    fallen = [(mass, 4.0), (mass, 4.0), _GROUND], [(0, 1, 4.0 * mass), (1, 2, 8.0 * mass)]
    for step in (0.25 * _STEP, 0.5 * _STEP):
        np.testing.assert_allclose(measured(*fallen, 9.81 * step, step).duration,
                                   measured(*fallen, 9.81 * _STEP).duration, rtol=0.1)


def stopped(bodies, pairs):
    """Return the energy of the blows on all bodies but the last, see `measured`."""
    blows = measured(bodies, pairs)
    rows = [(body, c, side) for body in range(len(bodies) - 1) for c, pair in enumerate(pairs)
            for side in (0, 1) if pair[side] == body]
    energy = np.array([[blows.energy[c, side], blows.energy[c, 1 - side]] for _, c, side in rows])
    other = np.array([pairs[c][1 - side] for _, c, side in rows])
    ends = np.searchsorted([body for body, _, _ in rows], np.arange(len(bodies)))
    return energies(energy, other, ends)


def test_a_blow_has_the_energy_of_all_the_motion_that_it_stops():
    """Share that of a free blow, pass on that of what is squeezed, stop each by its own below."""
    free = stopped([(10.0, -4.0), (40.0, 1.0), _GROUND], [(0, 1, -40.0)])
    np.testing.assert_allclose(free, 0.5 * 8.0 * 5.0 ** 2)
    squeezed = stopped([(100.0, -4.0), (3.0, 0.0), _GROUND], [(0, 1, -400.0), (1, 2, -400.0)])
    np.testing.assert_allclose(squeezed, 800.0)
    both = stopped([(100.0, -4.0), (3.0, -4.0), _GROUND], [(0, 1, -400.0), (1, 2, -412.0)])
    np.testing.assert_allclose(both, [800.0, 824.0])
    slower = stopped([(100.0, -4.0), (3.0, -2.0), _GROUND], [(0, 1, -400.0), (1, 2, -406.0)])
    np.testing.assert_allclose(slower, [800.0, 806.0])


def test_what_is_rocked_takes_no_more_energy_than_it_gets():
    """Add what many contacts give to one body, less what they take from it."""
    given = np.array([[100.0, 500.0], [100.0, -450.0], [100.0, -80.0], [0.0, 30.0]])
    told = energies(given, np.array([1, 1, 1, 2]), np.array([0, 3, 4]))
    np.testing.assert_allclose(told, [300.0, 30.0])


def bricks_in_air(along, courses):
    """Bond bricks in the air, half a brick shifted in every other course."""
    length, tall = BRICK[0] + JOINT, BRICK[2] + JOINT
    return bonded([[length * (i + 0.5 * (k % 2)), 0.0, tall * k + 1.0]
                   for k in range(courses) for i in range(along)], BRICK, ground=False)


def loads_of_bonds(piece, wrenches, wanted):
    """
    Solve rigid cells and all bonds between them densely, in the accelerating frame of the piece.

    :returns: rows of the bonds between cells, and load over strength of each.
    """
    free, parts = FreeBodies(piece), np.arange(len(piece))
    graph, count = free.graph, len(piece)
    rows, a, b = cells.inside(parts, graph.start, graph.incident, graph.alive, graph.first,
                              graph.second, free._place)
    node, made = cells.grow(count, a, b, free._rank[parts], wanted)
    a, b = node[a], node[b]
    rows, a, b = rows[a != b], a[a != b], b[a != b]
    rigid = [_motions(graph.centre - graph.centre[node == cell].mean(axis=0), node == cell)
             for cell in range(made)]  # bricks weigh the same
    back = np.concatenate(rigid, axis=1)  # motion of parts by that of cells
    centre = np.array([graph.centre[node == cell].mean(axis=0) for cell in range(made)])
    packed = links.build(a, b, graph.centroid[rows], centre, graph.axes[rows], graph.spring[rows])
    whole = _motions(graph.centre - graph.centre.mean(axis=0), np.ones(count, bool))
    inertia = np.zeros((6 * count, 6 * count))
    for k in range(count):
        inertia[6 * k:6 * k + 3, 6 * k:6 * k + 3] = np.eye(3) * graph.mass[k]
        inertia[6 * k + 3:6 * k + 6, 6 * k + 3:6 * k + 6] = free._inertia[k]
    push = np.linalg.solve(whole.T @ inertia @ whole, whole.T @ wrenches.ravel())
    load = back.T @ (wrenches.ravel() - inertia @ whole @ push)
    stiffness = np.zeros((6 * made, 6 * made))
    for column in range(6 * made):
        q, out = np.zeros((2, made, 6))
        q.flat[column] = 1.0
        links.add_pulls(np.arange(len(rows)), packed, a, b, q, out, -1.0)
        stiffness[:, column] = out.ravel()
    moved = np.linalg.lstsq(stiffness, load, rcond=1e-10)[0].reshape(made, 6)
    wrench = np.zeros((len(rows), 6))
    links.pulls(np.arange(len(rows)), packed, graph.axes[rows], a, b, moved, wrench)
    over = np.zeros(len(rows))
    blow_kernels._overloads(
        wrench, rows, np.ones(len(rows), bool), (
            graph.centroid, graph.axes, graph.spring, graph.area, graph.extent,
            graph.whole_extent, graph.held), free._strength, free._wood, 1.0, over)
    return rows, over


def _motions(arms, moving):
    """Return the motions of parts with a body that they are rigid parts of, (6N, 6)."""
    out = np.zeros((len(arms), 6, 6))
    out[moving] = np.eye(6)
    x, y, z = arms[moving].T
    for (row, column), value in {(0, 4): z, (0, 5): -y, (1, 3): -z, (1, 5): x, (2, 3): y,
                                 (2, 4): -x}.items():
        out[moving, row, column] = value
    return out.reshape(-1, 6)


@pytest.mark.parametrize('wanted', [6, 20, 96])
def test_what_a_blow_breaks_first_is_what_a_dense_solution_tells(wanted):
    """Strike a wall of 96 bricks in one corner and turn another: few cells, many, and bricks."""
    piece = bricks_in_air(8, 12)
    wrenches = np.zeros((len(piece), 6))
    wrenches[3] = 3e3, -8e3, 2e4, 40.0, 900.0, -300.0
    wrenches[90] = -5e3, 2e3, 0.0, 0.0, -700.0, 100.0
    rows, over = loads_of_bonds(piece, wrenches, wanted)
    clear = rows[over > 0.42 * over.max()]  # 0.4 of the worst and more break at once
    broken = FreeBodies(piece).strike(np.arange(len(piece)), wrenches, wanted)
    assert broken.share == pytest.approx(1.0 / over.max(), rel=0.02)
    loads = dict(zip(broken.bonds.tolist(), broken.load.tolist()))
    expected = dict(zip(rows.tolist(), over.tolist()))
    for row in clear.tolist():
        assert loads[row] == pytest.approx(expected[row], rel=0.02, abs=0.01 * over.max())
    first = broken.bonds[:len(clear)].tolist()
    assert min(expected[row] for row in first) > 0.38 * over.max()
