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

"""What meets trees, one sentence after the other: blows, roofs, heaps of trees, and rest."""

from grown_trees import bush, effective_mass
from masonry_walls import bonded, wall
import numpy as np
import pytest

from procphys_ros.blueprint import Blueprint, Shape, skeleton
from procphys_ros.geometry import rotation
from procphys_ros.physics.masonry.standing_loads import StandingLoads
from procphys_ros.physics.world import rigid_sum
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, masonry, Simulation

_DT = 1.0 / 60.0
_TURN = np.array([0.0, 0.0, 0.0, 1.0])
_ALONG_Y = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
_BRICK = np.array([0.065, 0.1025, 0.215])
_EDGE = 0.5 * np.hypot(_BRICK[0], _BRICK[2])  # [m] from a brick's centre to its edge along y ...
_ON_EDGE = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]),  # ... when it stands on that edge
                                    np.arctan2(_BRICK[0], _BRICK[2]))
_RADIUS = 0.04  # [m] of the bough


def bough(strength: float = 5e8) -> Blueprint:
    """Stand a post with a straight bough 2.5 m to one side, 2 m above the ground."""
    nodes = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2], *([0.5 * k, 0, 2] for k in range(1, 6))])
    radii = np.concatenate([np.full(3, 0.12), np.full(5, _RADIUS)])
    return skeleton.from_nodes(nodes, np.arange(8) - 1, radii, strength=strength,
                               damping_ratio=0.1)


def scene_of(*placed: tuple[Blueprint, tuple], gravity: float = 9.81,
             time_step: float = _DT) -> Simulation:
    """Simulate blueprints where they are put, in still air."""
    scene = Scene.from_parameters({'scene': {'objects': []}, 'gravity': gravity,
                                   'time_step': time_step,
                                   'engine': 'native'})  # stems come to rest in heaps
    for i, (blueprint, place) in enumerate(placed):
        scene.add(blueprint, place, 0.0, f'thing_{i}')
    return Simulation(scene)


def falling(simulation: Simulation, kind: str, mass: float, speed: float) -> int:
    """Put something right above the bough, 1.75 m from the post, on its way down."""
    world, velocity = simulation.state.world, np.array([0.0, 0.0, -speed, 0.0, 0.0, 0.0])
    over = np.array([1.75, 0.0, 2.0 + _RADIUS + 1e-6])
    if kind == 'ball':
        return world.add_body(Shape.CAPSULE, np.full(3, 0.1), mass,
                              np.concatenate([over + [0, 0, 0.05], _TURN]), velocity)
    if kind == 'brick':
        return world.add_body(Shape.BOX, _BRICK, mass,
                              np.concatenate([over + [0, 0, _EDGE], _ON_EDGE]), velocity)
    if kind == 'branch':
        return world.add_body(Shape.CAPSULE, np.array([0.06, 0.06, 1.2]), mass,
                              np.concatenate([over + [0, 0, 0.03], _ALONG_Y]), velocity)
    poses = np.array([[*over, *_ON_EDGE] for _ in range(3)])
    poses[:, 1] += (-0.11, 0.0, 0.11)
    poses[:, 2] += _EDGE
    total = rigid_sum(np.full(3, mass / 3.0), np.full((3, 3), 0.004 * mass), poses)
    return world.add_fragment(np.full(3, Shape.BOX), np.tile(_BRICK, (3, 1)), total.local_poses,
                              total.mass, total.inertia, total.pose, velocity)


@pytest.mark.parametrize(('kind', 'mass'), [
    ('ball', 0.2), ('ball', 20.0), ('brick', 3.0), ('fragment', 20.0), ('branch', 0.2)])
def test_whatever_hits_a_bough_is_stopped_by_the_mass_that_it_shows(kind, mass):
    """Pass on m·v·M / (m + M), with M of the tree at this point, to 1 % on both sides."""
    simulation = scene_of((bough(), (0.0, 0.0, 0.0)), gravity=0.0)
    forest = simulation.state.forest
    body = falling(simulation, kind, mass, 5.0)
    point = np.array([1.75, 0.0, 2.0 + _RADIUS])
    row = int(np.argmin(np.linalg.norm(forest.poses[:, :3] - point, axis=1)))
    shown = effective_mass(forest, row, point, np.array([0.0, 0.0, 1.0]))
    before = simulation.state.world.bodies.velocities[body, 2]
    simulation.step()
    touches = simulation.state.contacts
    assert (touches.row == row).all() and (touches.body == body).all()
    push = -touches.impulse[:, 2].sum()
    assert push == pytest.approx(mass * 5.0 * shown / (mass + shown), rel=0.01)
    after = simulation.state.world.bodies.velocities[body, 2]
    assert mass * (after - before) == pytest.approx(push, rel=0.01)


@pytest.mark.parametrize('kind', ['ball', 'fragment', 'branch'])
def test_whatever_hits_a_bough_hard_breaks_it(kind):
    """Break a bough of weak wood by a heavy blow, not by a light one."""
    broken = []
    for mass, speed in ((0.3, 2.0), (30.0, 12.0)):
        simulation = scene_of((bough(strength=4e7), (0.0, 0.0, 0.0)))
        falling(simulation, kind, mass, speed)
        simulation.step(30)
        broken.append(simulation.bonds_broken)
    assert broken[0] == 0 and broken[1] > 0


def test_a_projectile_breaks_a_bough():
    """Launch a light and a heavy ball at it."""
    broken = []
    for mass, speed in ((0.2, 3.0), (30.0, 20.0)):
        simulation = scene_of((bough(strength=4e7), (0.0, 0.0, 0.0)))
        simulation.launch(Projectile(shape='sphere', size=0.15, mass=mass,
                                     position=(1.75, -0.3, 2.0), velocity=(0.0, speed, 0.0)))
        simulation.step(60)
        assert simulation.impacts
        broken.append(simulation.bonds_broken)
    assert broken[0] == 0 and broken[1] > 0


@pytest.mark.parametrize(('start', 'height'), [
    (-1.0, 1.0), (-1.5, 1.5), (-2.0, 1.0), (-2.5, 1.5), (-3.0, 1.0)])
def test_a_pebble_at_100_m_s_does_not_miss_a_twig(start, height):
    """Strike 16 mm of wood, at a joint too, whatever the phase of the step, launched or loose."""
    twig = skeleton.from_nodes(np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 2.0]]),
                               np.array([-1, 0, 1]), np.array([0.008, 0.008, 0.008]))
    size, mass = 0.05, 0.2
    simulation = scene_of((twig, (0.0, 0.0, 0.0)))
    simulation.launch(Projectile(shape='sphere', size=size, mass=mass,
                                 position=(0.005, start, height), velocity=(0.0, 100.0, 0.0)))
    simulation.step(5)
    assert simulation.impacts
    simulation = scene_of((twig, (0.0, 0.0, 0.0)))
    pose = np.array([0.005, start, height, *_TURN])
    body = simulation.state.world.add_projectile(Shape.CAPSULE, np.full(3, size), mass, pose,
                                                 np.array([0.0, 100.0, 0.0, 0.0, 0.0, 0.0]))
    given = 0.0
    for _ in range(5):
        simulation.step()
        given -= simulation.state.contacts.impulse[:, 1].sum()
    slower = 100.0 - simulation.state.world.bodies.velocities[body, 1]
    assert -given > 0.1 and mass * slower == pytest.approx(-given, rel=0.01)


def portal(**strengths: float) -> Blueprint:
    """Build two piers along y, 2 m apart, and a lintel of four blocks between them."""
    piers = [[x, 0.0, 0.25 + 0.5 * i] for x in (-1.0, 1.0) for i in range(4)]
    roof = [[-1.0 + 0.5 * i, 0.0, 2.125] for i in range(5)]
    sizes = np.concatenate([np.tile([0.5, 0.6, 0.5], (8, 1)), np.tile([0.5, 0.6, 0.25], (5, 1))])
    return bonded(piers + roof, sizes, **strengths)


def log(length: float = 4.0, radius: float = 0.1, density: float = 700.0) -> Blueprint:
    """Stand a straight stem of ten segments that does not break."""
    nodes = np.zeros((11, 3))
    nodes[:, 2] = np.linspace(0.0, length, 11)
    return skeleton.from_nodes(nodes, np.arange(11) - 1, np.full(11, radius), density=density,
                               strength=1e12, damping_ratio=0.2)


def lay(simulation: Simulation, thing: str, place: tuple, attitude: np.ndarray) -> None:
    """Take a stem off its root, all but the lowest segment, and put it somewhere else."""
    forest = simulation.state.forest
    row = int(simulation.state.parts.row[simulation.names.index(f'{thing}/1')])
    forest.release(row)
    forest.poses[row] = np.concatenate([place, attitude])


def is_still(simulation: Simulation) -> bool:
    """Return whether all rests: no body awake, no branch flexible, nothing moves by 10 nm."""
    before = simulation.poses.copy()
    simulation.step(60)
    return (simulation.awake_bodies == 0 and not len(simulation.state.forest.free_roots)
            and np.abs(before - simulation.poses).max() < 1e-8)  # [m] stumps ring by less


_LYING = rotation.from_axis_angle(np.array([1.0, 0.0, 0.0]), np.array(-0.5 * np.pi))  # along y
_ACROSS = rotation.from_axis_angle(np.array([0.0, 1.0, 0.0]), np.array(0.5 * np.pi))  # along x


def test_a_stem_lies_on_a_roof_with_its_weight():
    """Load the lintel with it, first as a flexible tree, then as debris, and break nothing."""
    simulation = scene_of((portal(), (0.0, 0.0, 0.0)), (log(), (8.0, 0.0, 0.0)))
    lay(simulation, 'thing_1', (0.0, -1.8, 2.36), _LYING)  # 5 cm higher it breaks it
    weight = 9.81 * simulation.blueprint.mass[14:].sum()
    loads = {}
    for _ in range(240):
        stage = 'branches' if len(simulation.state.forest.free_roots) else 'debris'
        simulation.step()
        if stage in simulation.state.loads.sources:
            parts, wrenches = simulation.state.loads.layer(stage)
            assert (parts >= 8).all()  # the lintel's
            loads[stage] = wrenches[:, 2].sum()
    assert loads == pytest.approx({'branches': -weight, 'debris': -weight}, rel=0.03)
    assert simulation.bonds_broken == 0 and is_still(simulation)
    assert simulation.poses[14:, 2].min() > 2.3


def test_a_stem_that_lands_strikes_as_hard_at_every_time_step(monkeypatch):
    """Drop it from half a metre onto a strong lintel, which feels what comes within a period."""
    add, told, hardest = StandingLoads.add_blow, [0.0], []

    def heard(self, parts, wrenches, *of_blow):
        told.append(-wrenches[:, 2].sum())
        add(self, parts, wrenches, *of_blow)
    monkeypatch.setattr(StandingLoads, 'add_blow', heard)
    for time_step in (1.0 / 30.0, 1.0 / 60.0, 1.0 / 120.0, 1.0 / 240.0):
        simulation = scene_of((portal(tension=1e9, cohesion=1e9), (0.0, 0.0, 0.0)),
                              (log(), (8.0, 0.0, 0.0)), time_step=time_step)
        lay(simulation, 'thing_1', (0.0, -1.8, 2.85), _LYING)
        momentum = simulation.blueprint.mass[14:].sum() * np.sqrt(2.0 * 9.81 * 0.5)
        simulation.step(round(0.5 / time_step))
        hardest.append(max(told) / (masonry.WALL_RATE * momentum))
        told[1:] = []
        assert simulation.state.standing[:13].all()
    assert min(hardest) > 0.6 and max(hardest) < min(1.1, 1.3 * min(hardest)), hardest


@pytest.mark.parametrize(('rate', 'speed', 'torn'), [
    (60.0, 2.0, False), (60.0, 15.0, True), (240.0, 15.0, True)])
def test_a_stem_drives_bricks_out_of_a_wall(rate, speed, torn):
    """Ram a wall with it, end on: bricks hold it at 2 m/s; at 15 m/s it goes through them."""
    simulation = scene_of((wall(20, 20), (0.0, 0.0, 0.0)), (log(), (8.0, 0.0, 0.0)),
                          time_step=1.0 / rate)
    count = len(wall(20, 20))
    lay(simulation, 'thing_1', (2.2, -4.2, 0.8), _LYING)
    simulation.step()  # its other segments follow
    for part in range(count + 1, count + 10):
        simulation.apply_impulse(part, (0.0, simulation.blueprint.mass[part] * speed, 0.0))
    simulation.step(round(1.5 * rate / speed))
    assert simulation.state.standing[:count].all() != torn
    assert (Cause.IMPACT in simulation.events['cause']) == torn
    assert (simulation.velocities[count + 1:, 1].mean() > 0.6 * speed) == torn


def test_a_heap_of_fallen_trees_comes_to_rest():
    """Drop five bushy crowns upon each other and on a wall between them."""
    tree = bush(24, seed=3, damping_ratio=0.2, strength=1e12)
    wall = bonded([[0.0, 0.5 * j - 1.0, 0.25 + 0.5 * i] for i in range(2) for j in range(5)],
                  (0.4, 0.5, 0.5))
    simulation = scene_of((wall, (0.0, 0.0, 0.0)),
                          *((tree, (9.0 + 6.0 * i, 0.0, 0.0)) for i in range(5)))
    for i in range(5):
        lay(simulation, f'thing_{i + 1}', (-0.6 + 0.3 * i, 0.2 * i - 0.5, 1.8 + 0.7 * i), _LYING)
    while not is_still(simulation):
        assert simulation.time < 25.0
        simulation.step(60)
    simulation.step(120)
    assert is_still(simulation)
    assert np.isfinite(simulation.poses).all() and simulation.poses[:, 2].min() > -0.02


def test_trees_that_collide_share_their_momentum():
    """Throw a flexible stem across another that floats: what one loses the other gets, to 1 %."""
    simulation = scene_of((log(), (0.0, 0.0, 0.0)), (log(), (9.0, 0.0, 0.0)), gravity=0.0)
    lay(simulation, 'thing_0', (4.0, 0.0, 3.0), _LYING)
    lay(simulation, 'thing_1', (2.5, 2.3, 3.4), _ACROSS)
    simulation.step()
    forest, objects = simulation.state.forest, simulation.objects
    own = [simulation.state.parts.row[np.arange(o.first + 1, o.first + o.count)]
           for o in objects]
    mass = simulation.blueprint.mass[forest.parts]
    for row in own[1]:
        forest.push(np.array([row]), forest.poses[[row], :3],
                    mass[row] * np.array([[-0.5, 0.0, -3.0]]))

    def momenta() -> np.ndarray:
        return np.array([(mass[rows, None] * forest.velocities[rows, :3]).sum(axis=0)
                         for rows in own])
    simulation.step()
    start, pushed = momenta(), np.zeros(3)
    for _ in range(20):
        simulation.step()
        touches = simulation.state.contacts
        sign = np.where(np.isin(touches.row, own[0]), 1.0, -1.0)
        pushed += (sign[:, None] * touches.impulse).sum(axis=0)
    end, scale = momenta(), np.linalg.norm(start)
    assert np.linalg.norm(pushed) > 0.3 * scale
    np.testing.assert_allclose(end.sum(axis=0), start.sum(axis=0), atol=0.01 * scale)
    np.testing.assert_allclose(end[0] - start[0], pushed, atol=0.01 * scale)
