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

"""Striking: projectiles against walls, panes and trees; blows on bricks; wind on walls."""

from grown_trees import effective_mass
from masonry_walls import blueprint, bonded, resistance_of, wall
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.blueprint.skeleton import from_nodes
from procphys_ros.errors import CommandError
from procphys_ros.geometry import rotation
from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.wind import WindSettings
from procphys_ros.physics.world import BodyState, Contacts, installed_engines, World
from procphys_ros.scene import Scene
from procphys_ros.scene.settings import Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, fragments, masonry, Simulation

GRAVITY = 9.81


def stand(*blueprints, **settings):
    """Make a simulation of placed blueprints, without dust."""
    scene = Scene(Settings(**settings))
    for built in blueprints:
        scene.add(built)
    return Simulation(scene)


def window():
    """Build a frame of two heavy posts with a pane between them, all bonded to the ground."""
    centres = [[-0.6, 0.0, 0.5], [0.6, 0.0, 0.5], [0.0, 0.0, 0.5]]
    sizes = [[0.2, 0.2, 1.0], [0.2, 0.2, 1.0], [1.0, 0.006, 1.0]]
    x = [0.0, 0.5 ** 0.5, 0.0, 0.5 ** 0.5]
    frames = [[-0.6, 0, 0, 0, 0, 0, 1.0], [0.6, 0, 0, 0, 0, 0, 1.0],
              [-0.5, 0.0, 0.5, *x], [0.5, 0.0, 0.5, *x]]
    made = blueprint(np.array(centres), sizes, [[GROUND, 0], [GROUND, 1], [0, 2], [2, 1]], frames,
                     [[0.2, 0.2], [0.2, 0.2], [1.0, 0.006], [1.0, 0.006]], density=2500.0,
                     cohesion=2e6, tension=2e6)
    made.material[2] = 1
    object.__setattr__(made, 'materials', ('brick', 'glass'))
    return made


def trunk():
    """Grow a straight trunk of three segments, 12 cm thick and 3 m high."""
    return from_nodes(np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2], [0, 0, 3.0]]),
                      np.array([-1, 0, 1, 2]), np.full(4, 0.06),
                      density=700.0, strength=np.inf)


def throw(simulation, mass, speed, height=0.86, shape='sphere', size=0.2, x=1.3, start=-1.0):
    """Throw something along y and give its part."""
    return simulation.launch(Projectile(shape, size, mass, (x, start, height),
                                        (0.0, speed, 0.0)))


def energy(simulation):
    """Compute the mechanical energy of everything loose [J]."""
    parts = np.flatnonzero(simulation.state.carrier >= 0)
    bodies = np.unique(simulation.state.carrier[parts])
    world = simulation.state.world.bodies
    v, mass = world.velocities[bodies], world.mass[bodies]
    own = rotation.rotate(rotation.conjugate(world.poses[bodies, 3:]), v[:, 3:])
    spin = 0.5 * (world.inertia[bodies] * own ** 2).sum()
    return float((mass * (0.5 * (v[:, :3] ** 2).sum(axis=1)
                          + GRAVITY * world.poses[bodies, 2])).sum() + spin)


def momentum(simulation):
    """Compute the momentum of everything loose [N·s], (3,)."""
    parts = np.flatnonzero(simulation.state.carrier >= 0)
    bodies = np.unique(simulation.state.carrier[parts])
    world = simulation.state.world.bodies
    return world.mass[bodies] @ world.velocities[bodies, :3]


def told(simulation, monkeypatch):
    """Collect the impulses of contacts on what is fixed when they are found, along y [N·s]."""
    given, step = [], World.step

    def watched(world, dt, threads, looked):
        def look(rows, poses, velocities, duration):
            stood, pairs = world.bodies.state < BodyState.AWAKE, rows[:, :2].copy()
            if looked is not None:
                looked(rows, poses, velocities, duration)
            contacts = Contacts.of(np.hstack([pairs, rows[:, 2:]]), duration).both_ways()
            fixed = stood[contacts.body_a] & ~stood[contacts.body_b]
            given.append(contacts.impulse[fixed, 1].sum())
        step(world, dt, threads, look)

    monkeypatch.setattr(World, 'step', watched)
    return given


def test_a_slow_ball_bounces_off():
    """Throw a ball back with the stated restitution; the wall cracks at its foot and stands."""
    simulation = stand(wall(12, 24))
    ball = throw(simulation, 5.0, 3.0)
    simulation.step(60)
    speeds = simulation.velocities[ball]
    assert simulation.poses[ball, 1] < -0.15 and speeds[1] < 0.0
    impact = simulation.impacts[0]
    assert not impact.torn
    assert impact.lost[1] == pytest.approx(1.25 * 5.0 * 3.0, rel=0.01)
    assert simulation.state.standing[:ball].all()
    graph = simulation.state.solver.graph
    assert graph.alive.all() and graph.cracked.any()
    assert simulation.state.solver.converged  # rocking ends, and what was pulled apart closes


@pytest.mark.parametrize(('engine', 'time_step'), [
    (installed_engines()[0], 1.0 / 60.0), (installed_engines()[-1], 1.0 / 20.0)])
def test_a_bounce_takes_no_time(engine, time_step):
    """Throw balls at a wall, to bounce early and late in a step: none flies on for longer."""
    late = []
    for share in (0.05, 0.35, 0.65, 0.95):
        scene = Scene(Settings(engine=engine, time_step=time_step, gravity=0.0))
        scene.add(wall(12, 24, tension=1e7, cohesion=1e7))
        simulation = Simulation(scene)
        gap = 0.4 + share * 6.0 * time_step
        ball = throw(simulation, 1.0, 6.0, start=-0.15 - gap, height=0.86)
        simulation.step(round(0.3 / time_step))
        back = simulation.velocities[ball, 1]
        assert back < -1.0
        late.append((simulation.poses[ball, 1] + 0.15) / back - simulation.time + gap / 6.0)
    assert max(late) - min(late) < 0.1 * time_step


@pytest.mark.parametrize(('engine', 'speed'), [
    (installed_engines()[0], 2.0), (installed_engines()[-1], 3.0)])
def test_momentum_of_a_wall_that_is_thrown_over_is_accounted_for_at_all_times(engine, speed,
                                                                              monkeypatch):
    """
    Throw a wall over with a box, and follow the momentum until it lies still, a second at most.

    What is loose has, in every step, what the box had, less what the ledger knows to be in the
    ground, plus what contacts gave with what was fixed when they were found: the wall knocks its
    own foot out, whose bonds take some of it before they part. Rest takes what is left in the
    end, some centimetres per second, and enters it nowhere.
    """
    simulation = stand(wall(12, 24), engine=engine)
    throw(simulation, 150.0, speed, height=0.7, shape='box', size=1.2, start=-0.75)
    simulation.stages = tuple(stage for stage in simulation.stages
                              if stage.step is not fragments.apply_drag)
    given = told(simulation, monkeypatch)
    start = momentum(simulation)[1]
    for _ in range(60):
        simulation.step()
        ledger = simulation.state.ledger
        if not simulation.awake_bodies:
            break
        whole = start - ledger.grounded[1] - sum(given)  # what falls gets more than start
        assert momentum(simulation)[1] == pytest.approx(whole, abs=5e-4 * max(start, whole))
    assert simulation.time > 0.5
    assert (~simulation.state.standing[:300]).sum() > 200
    assert not any(impact.torn for impact in simulation.impacts)
    np.testing.assert_allclose(ledger.lost, ledger.carried + ledger.grounded, atol=1e-9)
    assert ledger.carried[1] > 100.0


@pytest.mark.parametrize(('mass', 'speed', 'size'), [
    (7.0, 75.0, 0.12), (1500.0, 4.0, 0.8)])
def test_contacts_tell_what_they_gave(mass, speed, size, monkeypatch):
    """Throw balls through a wall: no momentum is lost on the way, level and along the throw."""
    # What moves has, in every step, what the ball had, less what contacts tell that they gave to
    # what stood or lay fixed then, and what the ledger knows to be in the wall. What comes to rest
    # loses some centimetres per second.
    simulation = stand(wall(12, 24), engine='native')
    simulation.stages = tuple(stage for stage in simulation.stages
                              if stage.step is not fragments.apply_drag)
    throw(simulation, mass, speed, size=size, start=-0.3 - size)
    given = told(simulation, monkeypatch)
    for _ in range(30):
        simulation.step()
        left = momentum(simulation)[1] + sum(given) + simulation.state.ledger.grounded[1]
        assert left == pytest.approx(mass * speed, rel=5e-3)
    assert sum(given) > 0.01 * mass * speed
    for impact in simulation.impacts:
        np.testing.assert_allclose(impact.lost, impact.carried + impact.grounded, atol=1e-9)
        assert impact.work >= 0.0


@pytest.mark.parametrize(('mass', 'speed', 'size', 'shape'), [
    (5.0, 3.0, 0.2, 'sphere'), (20.0, 40.0, 0.3, 'sphere'), (1000.0, 8.0, 0.8, 'box'),
])
def test_energy_is_never_gained(mass, speed, size, shape):
    """Let the energy of all that is loose only fall, but for the height of what falls out."""
    # Masonry that a blow throws over comes off later, with energy that was lost to it before.
    simulation = stand(wall(12, 24))
    throw(simulation, mass, speed, size=size, shape=shape)
    last, lost = energy(simulation), 0.0
    for _ in range(60):
        stood = simulation.state.standing.copy()
        simulation.step()
        fresh = stood & ~simulation.state.standing
        height = GRAVITY * (simulation.blueprint.mass[:len(fresh)][fresh]
                            @ simulation.blueprint.poses[:len(fresh)][fresh, 2])
        now = energy(simulation)
        gain = now - last - height
        assert gain < (lost if fresh.any() else 0.0) + 0.002 * last + 0.5
        last, lost = now, max(lost - gain, 0.0)
    assert simulation.ledger.carried[1] <= simulation.ledger.lost[1] + 1e-9  # no blow twice


def test_the_work_of_fracture_slows_what_goes_through():
    """Take momentum, then energy: inelastic impact first, fracture of what is torn after it."""
    simulation = stand(wall(12, 24), gravity=0.0)
    throw(simulation, 200.0, 10.0, start=-0.5, size=0.5, shape='box')
    simulation.step(3)
    first = next(i for i in simulation.impacts if i.torn)
    struck = simulation.blueprint.mass[first.parts].sum()
    shared = 200.0 * 10.0 / (200.0 + struck)
    left = np.sqrt(shared ** 2 - 2.0 * first.work / (200.0 + struck))
    assert first.work > 1.0
    assert first.carried[1] == pytest.approx(struck * left, rel=0.01)
    assert first.lost[1] == pytest.approx(200.0 * (10.0 - left), rel=0.01)
    loads = simulation.events['load'][simulation.events['cause'] == Cause.IMPACT]
    assert len(loads) > 5 and (loads > 1.0).all()


@pytest.mark.parametrize(('height', 'speed'), [
    (0.86, 100.0), (0.895, 390.0)])
def test_nothing_tunnels_through_a_wall(height, speed):
    """Stop or strike a pebble wherever it comes, joints included, whatever its phase."""
    simulation = stand(wall(12, 24))
    for start in np.linspace(-3.0, -1.0, 5):
        simulation.reset()
        throw(simulation, 0.2, speed, height, size=0.05, start=start)
        simulation.step(8)
        assert simulation.impacts


def test_glass_breaks_before_brick():
    """Shatter a pane with a pebble that a wall throws back; it flies on, slower."""
    simulation = stand(window())
    stone = throw(simulation, 0.2, 20.0, 0.55, size=0.05, x=0.05)
    simulation.step(10)
    assert 0.0 < simulation.velocities[stone, 1] < 19.0 and simulation.poses[stone, 1] > 0.1
    assert np.isnan(simulation.poses[2]).all()
    assert not simulation.state.standing[2] and simulation.state.standing[:2].all()
    kinds = [simulation.blueprint.kinds[k] for k in simulation.blueprint.kind]
    shards = np.array([k == 'shard' for k in kinds])
    assert simulation.blueprint.mass[shards].sum() == pytest.approx(simulation.blueprint.mass[2])
    simulation.step(200)
    assert (simulation.poses[shards, 2] < 0.3).all() and (simulation.poses[shards, 2] > 0.0).all()
    walled = stand(wall(12, 24))
    stone = throw(walled, 0.2, 20.0, size=0.05)
    walled.step(10)
    assert walled.state.standing[:stone].all() and walled.velocities[stone, 1] < 0.0


def test_a_pane_holds_a_gentle_knock():
    """Let a light ball bounce off a pane."""
    simulation = stand(window())
    ball = throw(simulation, 0.05, 2.0, 0.55, size=0.06, x=0.05, start=-0.2)
    simulation.step(12)
    assert simulation.velocities[ball, 1] < 0.0 and np.isfinite(simulation.poses[2]).all()


def test_a_tree_gets_exactly_what_the_ball_loses():
    """Pass on the impulse of two bodies, one of them as heavy as the tree is there."""
    simulation = stand(trunk(), gravity=0.0)
    forest = simulation.state.forest
    effective = effective_mass(forest, 1, np.array([0.0, -0.06, 1.5]),
                               np.array([0.0, 1.0, 0.0]))
    throw(simulation, 3.0, 12.0, 1.5, x=0.0, start=-0.4)
    simulation.step(3)
    impact, = simulation.impacts
    expected = 1.25 * 12.0 / (1.0 / 3.0 + 1.0 / effective)
    assert impact.lost[1] == pytest.approx(expected, rel=0.01)
    np.testing.assert_array_equal(impact.carried, impact.lost)
    assert forest.bends[:, :2].any()
    assert momentum(simulation)[1] == pytest.approx(36.0 - impact.lost[1], rel=0.01)


def test_wind_carries_projectiles():
    """Slow a light ball down as a sphere of drag coefficient 0.47."""
    simulation = stand(gravity=0.0)
    ball = simulation.launch(Projectile('sphere', 0.2, 0.05, (0, 0, 5.0), (0.0, 30.0, 0.0)))
    simulation.step(60)
    rate = 0.5 * 1.225 * 0.47 * np.pi * 0.01 / 0.05
    assert simulation.velocities[ball, 1] == pytest.approx(30.0 / (1.0 + 30.0 * rate), rel=0.03)


def test_parts_grow_and_names_follow():
    """Append what is launched under its own name, and renumber nothing."""
    simulation = stand(wall(4, 4))
    count = len(simulation.blueprint)
    before = simulation.poses.copy()
    first, second = (throw(simulation, 1.0, 1.0, x=x, start=-5.0) for x in (0.0, 1.0))
    assert (first, second) == (count, count + 1)
    assert simulation.names.index('projectile_1/projectile_0') == second
    assert simulation.objects[-1].name == 'projectile_1'
    assert simulation.poses.shape == (count + 2, 7) == (len(simulation.blueprint), 7)
    np.testing.assert_array_equal(simulation.poses[:count], before)


@pytest.mark.parametrize(('changes', 'words'), [
    ({'shape': 'cone'}, ['sphere, box']), ({'size': 0.0}, ['size']), ({'size': -1.0}, ['size']),
    ({'size': float('nan')}, ['size']), ({'size': (1, 2)}, ['size']), ({'mass': 0.0}, ['mass']),
    ({'mass': float('inf')}, ['mass']), ({'mass': 'heavy'}, ['mass']),
    ({'position': (0, 0, 0.1)}, ['into the ground']), ({'position': (0, 0)}, ['position']),
    ({'velocity': (0, 500, 0)}, ['400']), ({'velocity': (0, float('nan'), 0)}, ['velocity']),
    ({'position': (1.3, 0.0, 0.9)}, ['touches']), ({'size': (0.1, 0.1, 0.2)}, ['diameter']),
])
def test_bad_projectiles_are_refused(changes, words):
    """Refuse in one line, and leave the state alone."""
    simulation = stand(wall(12, 24))
    count = len(simulation.blueprint)
    good = {'shape': 'sphere', 'size': 0.3, 'mass': 5.0, 'position': (0, -3, 2.0),
            'velocity': (0, 5, 0)}
    with pytest.raises(CommandError) as caught:
        simulation.launch(Projectile(**{**good, **changes}))
    assert all(word in str(caught.value) for word in words) and '\n' not in str(caught.value)
    assert len(simulation.blueprint) == len(simulation.poses) == count
    simulation.step(2)
    assert simulation.awake_bodies == 0


def test_projectiles_are_limited():
    """Refuse one too many."""
    simulation = stand()
    for i in range(200):
        throw(simulation, 1.0, 1.0, x=float(i))
    with pytest.raises(CommandError, match='200'):
        throw(simulation, 1.0, 1.0, x=300.0)


def test_a_stone_that_is_driven_out_rubs_on_its_neighbours():
    """Spend half of friction · pressure · length on both beds of a middle stone."""
    built = bonded([[0.0, 0.0, 0.05 + 0.1 * i] for i in range(3)], (0.2, 0.3, 0.1), friction=0.7)
    brick, along = np.array([1]), np.array([1.0, 0.0, 0.0])
    free, pressed = (resistance_of(stand(built, gravity=g).state.solver, brick, along).energy
                     for g in (0.0, GRAVITY))
    weight = GRAVITY * built.mass[0]
    assert pressed - free == pytest.approx(0.5 * 0.7 * (weight + 2.0 * weight) * 0.2, rel=1e-3)


def test_an_impulse_tears_a_brick_out_or_loads_the_wall():
    """Hold below what the bonds withstand, give way above, and say which."""
    simulation = stand(wall(12, 24), gravity=0.0)
    brick = int(np.argmin(np.linalg.norm(simulation.poses[:, :3] - [1.3, 0, 0.9], axis=1)))
    capacity = resistance_of(simulation.state.solver, np.array([brick]), np.array([0.0, 1, 0]))
    limit = capacity.force * contact_time(simulation.blueprint.mass[brick])
    assert not simulation.apply_impulse(brick, (0.0, 0.98 * limit, 0.0))
    simulation.step(2)
    assert simulation.state.standing[brick] and simulation.awake_bodies == 0
    assert simulation.state.solver.displacement[:, 1].max() > 0.0
    simulation.reset()
    assert simulation.apply_impulse(brick, (0.0, 1.02 * limit, 0.0))
    simulation.step(1)
    mass = simulation.blueprint.mass[brick]
    speed = np.sqrt((1.02 * limit / mass) ** 2 - 2.0 * capacity.energy / mass)
    assert simulation.velocities[brick, 1] == pytest.approx(speed, rel=0.02)


def test_of_equal_momentum_the_heavier_blow_lasts_longer_and_is_gentler():
    """Break a brick out with 2 kg, and hold 20 kg of the same momentum, half the force."""
    simulation = stand(wall(12, 24), gravity=0.0)
    brick = int(np.argmin(np.linalg.norm(simulation.poses[:, :3] - [1.3, 0, 0.9], axis=1)))
    place = simulation.poses[brick, :3]
    solver, along = simulation.state.solver, np.array([0.0, 1.0, 0.0])
    withstood = resistance_of(solver, np.array([brick]), along)
    momentum = 2.0 * withstood.force * contact_time(2.0) / 1.25  # of the ball; it bounces
    for mass, torn in ((20.0, False), (2.0, True)):
        simulation.reset()
        simulation.launch(Projectile('sphere', 0.1, mass, tuple(place - [0.0, 0.3, 0.0]),
                                     (0.0, momentum / mass, 0.0)))
        simulation.step(20)
        assert simulation.impacts[0].torn == torn


def test_a_lasting_force_on_a_brick_loads_its_wall():
    """Carry a push down to the ground as the stress solver's load, and let go of it."""
    simulation = stand(wall(6, 8))
    simulation.apply_wrench(20, (0.0, 0.0, -500.0))
    simulation.step(30)
    graph, solver = simulation.state.solver.graph, simulation.state.solver
    weight = simulation.blueprint.mass.sum() * GRAVITY
    foot = graph.grounded()
    assert -solver.wrenches()[foot, 2].sum() == pytest.approx(weight + 500.0, rel=0.01)
    simulation.clear_wrenches()
    simulation.step(30)
    assert -solver.wrenches()[foot, 2].sum() == pytest.approx(weight, rel=0.01)


def test_a_breeze_costs_a_standing_wall_nothing():
    """Leave the stresses alone in a light wind, and end the load when the wind dies down."""
    simulation = stand(wall(12, 20), wind=WindSettings(velocity=(0.0, 7.0, 0.0)))
    spent = simulation.state.solver.spent
    simulation.step(60)
    assert simulation.state.solver.spent == spent
    simulation.set_wind((0.0, 15.0, 0.0))
    simulation.step(60)
    assert simulation.state.solver.spent > spent
    simulation.set_wind_enabled(False)
    simulation.step(120)
    bent = simulation.state.solver.displacement[:-1, 1]
    assert np.abs(bent).max() < 1e-6 and masonry.is_stable(simulation.state)
