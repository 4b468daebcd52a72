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

"""Several intruders by name: shapes, wrenches, and the air that their rotors blow down."""

import warnings

from grown_trees import BENDING
import numpy as np
import pytest
from test_intruder import mast, wall

from procphys_ros.blueprint import Shape
from procphys_ros.errors import CommandError, SceneError
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.wind.downwash import add_jets, jet
from procphys_ros.physics.world import installed_engines
from procphys_ros.scene import Scene
from procphys_ros.scene.intruders import IntrudersSettings
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.mesh import boxes_in
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.commands import checked_rotation
from procphys_ros.simulation.readings import FIRST_INTRUDER

_TURN = [0.0, 0.0, 0.0, 1.0]
_LYING = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]  # z of the body along -y of the world


def test_huge_rotations_are_refused_without_a_warning():
    """Name what is no rotation, and let NumPy say nothing of its length."""
    with warnings.catch_warnings(), pytest.raises(CommandError, match='no rotation'):
        warnings.simplefilter('error')
        checked_rotation('orientation', (1e308, 1e308, 0.0, 0.0))


def cube(low=(-0.5, -0.5, -0.5), high=(0.5, 0.5, 0.5)):
    """Return the twelve triangles of a box, outwards."""
    low, high = np.array(low), np.array(high)
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (0, 1):
            corner = np.array([low, low, low, low], float)
            corner[:, axis] = (low, high)[side][axis]
            corner[[1, 2], u] = high[u]
            corner[[2, 3], v] = high[v]
            ring = corner if side else corner[::-1]
            faces += [ring[[0, 1, 2]], ring[[0, 2, 3]]]
    return np.array(faces)


def written(path, triangles):
    """Write triangles as STL text."""
    facets = ''.join('facet normal 0 0 0\nouter loop\n' + ''.join(
        'vertex {:.6f} {:.6f} {:.6f}\n'.format(*corner) for corner in triangle)
        + 'endloop\nendfacet\n' for triangle in triangles)
    path.write_text(f'solid thing\n{facets}endsolid thing\n', 'ascii')
    return path


def scene_of(blueprint, gravity=0.0, **shapes):
    """Simulate a blueprint with intruders of these shapes by name."""
    scene = Scene.from_parameters({'scene': {'objects': []}, 'gravity': gravity, 'intruders': {
        'names': list(shapes), 'shapes': list(shapes.values())}})
    scene.add(blueprint, (0.0, 0.0, 0.0), 0.0, 'thing')
    return Simulation(scene)


def press_the_mast(shape, reach, turn=_TURN, push=0.15, height=3.125):
    """Push a cantilever aside by so much, and give the force on the intruder along the push."""
    simulation = scene_of(mast(), body=shape)
    radius = 0.5 * float(simulation.blueprint.size[0, 0])
    start = -reach - radius - 0.05
    for step in range(300):
        if step % 6 == 0:
            way = min(0.05 + push, simulation.time * 0.1)
            simulation.place_intruder([start + way, 0.0, height, *turn], name='body')
        simulation.step()
    return simulation.wrench_on_intruder('body')[0]


@pytest.mark.parametrize('shape', ['capsule 0.2 0.9', 'mesh'])
def test_every_shape_feels_the_stiffness_of_what_it_bends(shape, tmp_path):
    """Feel k·x of a weightless cantilever, k = 3·E·I/a³, with each shape."""
    reach = 0.1
    if shape == 'mesh':
        pytest.importorskip('trimesh')
        shape = f'mesh {written(tmp_path / "bar.stl", cube((-1, -4, -1), (1, 4, 1)))} 0.1'
    force = press_the_mast(shape, reach, _LYING if 'capsule' in shape else _TURN)
    edge = 0.1 if 'mesh' in shape else 0.0  # a box bends it by its upper or its lower edge
    stiffness = [3.0 * BENDING / (3.125 + off) ** 3 for off in (-edge, edge)]
    assert 0.95 * min(stiffness) * 0.15 < -force < 1.05 * max(stiffness) * 0.15


def test_each_feels_what_it_does_itself():
    """Move two at once: one bends the mast, the other is in the air; a third is not placed."""
    simulation = scene_of(mast(), left='sphere 0.2', right='box 0.2 0.2 0.2', absent='sphere 1')
    for step in range(120):
        if step % 6 == 0:
            way = min(0.2, 0.1 * simulation.time)
            simulation.place_intruder([-0.15 - 0.1 + way, 0.0, 3.0, *_TURN], name='left')
            simulation.place_intruder([4.0 - way, 0.0, 3.0, *_TURN], name='right')
        simulation.step()
    assert simulation.wrench_on_intruder('left')[0] < -1.0
    assert not simulation.wrench_on_intruder('right').any()
    assert simulation.pose_of_intruder('absent') is None
    assert simulation.intruders == ('intruder', 'left', 'right', 'absent')
    for ask in (simulation.wrench_on_intruder, simulation.pose_of_intruder,
                lambda name: simulation.place_intruder([0.0, 0.0, 1.0, *_TURN], name=name)):
        with pytest.raises(CommandError, match='no intruder "lefd"; did you mean left'):
            ask('lefd')


@pytest.mark.parametrize('shape', ['capsule 0.4 1.2', 'box 0.4 0.4 1.2'])
def test_a_lying_capsule_presses_a_wall_where_a_box_would(shape):
    """Lean on a wall with a bar: it holds and presses back; drive on, and bricks come out."""
    simulation = scene_of(wall(), gravity=9.81, bar=shape)
    simulation.place_intruder([-0.1 - 0.2 + 2e-5, 1.6, 0.625, *_LYING], name='bar')
    simulation.step(30)
    assert simulation.bonds_broken == 0 and simulation.wrench_on_intruder('bar')[0] < -100.0
    for step in range(60):
        simulation.place_intruder([-0.3 + 0.02 * step, 1.6, 0.625, *_LYING], name='bar')
        simulation.step()
    assert simulation.bonds_broken > 5


@pytest.mark.parametrize('engine', installed_engines())
def test_a_bent_mesh_pushes_with_its_arm(engine, tmp_path):
    """Drive an L along: its arm takes a block with it, one in its corner is left alone."""
    pytest.importorskip('trimesh')
    bent = np.concatenate([cube((0, 0, 0), (2, 1, 1)), cube((0, 0, 1.0001), (1, 1, 2))])
    path = written(tmp_path / 'bent.stl', bent)
    scene = Scene.from_parameters({'scene': {'objects': []}, 'engine': engine, 'intruders': {
        'names': ['bent'], 'shapes': [f'mesh {path}']}})
    simulation = Simulation(scene)
    low = simulation.state.world.add_body(Shape.BOX, np.full(3, 0.4), 20.0,
                                          np.array([2.3, 0.5, 0.2, *_TURN]))
    high = simulation.state.world.add_body(Shape.BOX, np.full(3, 0.4), 20.0,
                                           np.array([1.5, 0.5, 1.24, *_TURN]))
    for step in range(30):
        simulation.place_intruder([0.02 * step, 0.0, 0.03, *_TURN], name='bent')
        simulation.step()
    velocities = simulation.state.world.bodies.velocities
    assert velocities[low, 0] == pytest.approx(1.2, abs=0.1)
    assert 1.2 < simulation.state.world.bodies.poses[high, 2] < 1.3  # it rides on the foot
    assert simulation.wrench_on_intruder('bent')[2] < -100.0


def test_a_mesh_is_filled_with_boxes():
    """Fill a cube with one box, an L with its volume; a sheet becomes the box around it."""
    whole = boxes_in(cube())
    assert len(whole.shapes) == 1 and whole.shapes[0] == Shape.BOX
    np.testing.assert_allclose(whole.sizes[0], 1.0)
    np.testing.assert_allclose(whole.local_poses[0], [0, 0, 0, *_TURN], atol=1e-12)
    corner = np.concatenate([cube((0, 0, 0), (2, 1, 1)), cube((0, 0, 1.0001), (1, 1, 2))])
    bent = boxes_in(corner)
    assert np.prod(bent.sizes, axis=1).sum() == pytest.approx(3.0, rel=0.05)
    assert 2 <= len(bent.shapes) <= 4
    sheet = boxes_in(cube()[:2])
    assert len(sheet.shapes) == 1 and sheet.sizes[0].min() == pytest.approx(1e-3)


def test_snapshots_have_intruders_and_lidars_see_them():
    """Save with a placed intruder, restore in another simulation; see which one a ray meets."""
    def make():
        return scene_of(mast(), ball='sphere 0.4', car='box 1 1 1')
    simulation = make()
    simulation.place_intruder([3.0, 0.0, 1.0, *_TURN], name='car')
    simulation.step(3)
    other = make()
    other.restore(simulation.save())
    np.testing.assert_array_equal(other.pose_of_intruder('car'), [3.0, 0.0, 1.0, *_TURN])
    scan = other.scan(LidarSettings(rows=1, columns=1, horizontal_field=0.1,
                                    position=(6.0, 0.0, 1.0), rotation=(0.0, 0.0, np.pi)))
    assert scan.parts[0, 0] == FIRST_INTRUDER - 2 and scan.ranges[0, 0] == pytest.approx(2.5)
    other.reset()
    assert other.pose_of_intruder('car') is None


@pytest.mark.parametrize('names, shapes, reason', [
    (['a'], [], 'one shape'), (['a', 'a'], ['sphere 1'] * 2, 'twice'),
    (['a b'], ['sphere 1'], 'cannot name'), (['intruder'], ['sphere 1'], 'cannot name'),
    (['a'], ['cone 1'], 'no shape'), (['a'], ['box 1 2'], '3 numbers'),
    (['a'], ['sphere 0'], 'above 0'), (['a'], ['capsule 1 x'], '2 numbers'),
    (['a'], ['mesh'], 'no shape'), (['a'], ['sphere 99'], 'up to 50')])
def test_settings_that_make_no_sense_are_refused(names, shapes, reason):
    """Name what is wrong and what is allowed."""
    with pytest.raises(SceneError, match=reason):
        IntrudersSettings(tuple(names), tuple(shapes))


@pytest.mark.parametrize('content', [None, b'', b'solid x\nendsolid x\n', b'\0' * 400])
def test_meshes_that_cannot_be_read_are_refused(tmp_path, content):
    """Name the file."""
    pytest.importorskip('trimesh')
    path = tmp_path / 'thing.stl'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError, match='thing.stl'):
        IntrudersSettings(('a',), (f'mesh {path}',)).pieces()


THRUST, RADIUS = 20.0, 0.3  # [N], [m]: a drone of 2 kg
SPEED = np.sqrt(THRUST / (2.0 * AIR_DENSITY * np.pi * RADIUS**2))  # [m/s] at the disk


def air(points: np.ndarray, centre=(0.0, 0.0, 10.0), thrust=(0.0, 0.0, THRUST)) -> np.ndarray:
    """Return the velocities of the air in the jet of one rotor."""
    out = np.zeros((len(points), 3))
    add_jets(np.asarray(points, float), out, jet(np.array(centre), np.array(thrust), RADIUS)[None])
    return out


def below(distance: float, across: np.ndarray) -> np.ndarray:
    """Return the speed of the air downwards, some distance below the disk."""
    points = np.column_stack([across, np.zeros(len(across)), np.full(len(across), 10 - distance)])
    return -air(points)[:, 2]


@pytest.mark.parametrize('distance', [1.5, 3.0, 4.0, 8.0, 30.0])
def test_the_flux_of_momentum_is_the_thrust(distance):
    """Carry the thrust through every plane below, where the stream has contracted."""
    r = np.linspace(0.0, 0.5 * distance + 1.0, 20_001)
    flux = np.trapezoid(2.0 * np.pi * r * AIR_DENSITY * below(distance, r)**2, r)
    contracted = 0.5 * (1.0 + distance / np.hypot(distance, RADIUS))
    assert flux == pytest.approx(contracted * THRUST, rel=2e-3)


def test_air_has_half_of_its_speed_at_the_disk():
    """Follow momentum theory: v at the disk, twice that below, next to none above."""
    assert below(0.0, np.array([0.0, 0.9 * RADIUS, 1.1 * RADIUS])) == pytest.approx(
        [SPEED, SPEED, 0.0])
    assert below(4.0 * RADIUS, np.zeros(1)) == pytest.approx(2.0 * SPEED, rel=0.02)
    assert below(-1.9 * RADIUS, np.zeros(1)) < 0.15 * SPEED
    assert below(-3.0 * RADIUS, np.zeros(1)) == 0.0


def test_far_below_it_is_a_round_jet():
    """Fall with 1/x on the axis, with the profile exp(-(r/b)²), b = 0.107·x."""
    near, far = below(20.0, np.array([0.0, 2.14])), below(40.0, np.array([0.0, 4.28]))
    assert near[0] == pytest.approx(2.0 * far[0], rel=1e-3)
    assert near[0] == pytest.approx(np.sqrt(2.0 * THRUST / AIR_DENSITY / np.pi) / 2.14, rel=1e-3)
    assert near[1] / near[0] == pytest.approx(np.exp(-1.0), rel=1e-3)


def test_jets_point_against_the_thrust():
    """Blow along any axis, and add up."""
    sideways = air([[5.0, 0.0, 10.0], [-5.0, 0.0, 10.0]], thrust=(-THRUST, 0.0, 0.0))
    assert sideways[0, 0] > 3.0
    assert not sideways[1].any()
    assert not sideways[:, 1:].any()


def _orchard(**parameters) -> Simulation:
    tree = {'grammar_text': """
axiom: Density(900) Modulus(6e9) !(0.03) F(1.5) [ &(60) !(0.008) F(0.8) Leaf(0.3) Leaf(0.3) ] F(1)
""", 'count': 2, 'layout': 'row', 'spacing': 20.0}
    return Simulation(Scene.from_parameters(
        {'scene': {'objects': ['tree']}, 'tree': tree, 'engine': 'native', **parameters}))


@pytest.mark.parametrize('enabled', [True, False])
def test_a_drone_moves_the_branches_below_it(enabled):
    """Press down a twig below a drone, whether or not there is a wind, and no other tree."""
    simulation = _orchard()
    simulation.set_wind_enabled(enabled)
    simulation.place_intruder((-10.0, -0.5, 4.0, 0.0, 0.0, 0.0, 1.0))
    start = simulation.poses.copy()
    simulation.step(60)
    assert np.abs(simulation.poses - start).max() < 1e-9  # it hovers above, without thrust
    simulation.set_thrust((0.0, 0.0, THRUST))
    simulation.step(120)
    moved = np.abs(simulation.poses - start)[:, :3].max(axis=1)
    half = len(moved) // 2
    assert moved[:half].max() > 0.01
    assert moved[half:].max() < 1e-6
    simulation.set_thrust((0.0, 0.0, 0.0))
    simulation.step(300)
    assert np.abs(simulation.poses - start).max() < 2e-3


def test_thrust_is_kept_in_a_saved_state_and_ends_at_a_reset():
    """Go on alike from a saved state; begin without jets after a reset."""
    simulation = _orchard()
    simulation.place_intruder((-10.0, -0.5, 4.0, 0.0, 0.0, 0.0, 1.0))
    simulation.set_thrust((0.0, 0.0, THRUST))
    simulation.step(30)
    state = simulation.save()
    simulation.step(30)
    after = simulation.poses.copy()
    simulation.restore(state)
    simulation.step(30)
    assert np.array_equal(simulation.poses, after)
    simulation.reset()
    simulation.step(2)
    assert not len(simulation.wind.jets)


@pytest.mark.parametrize('thrust, name, radius, told', [
    ((0.0, np.nan, 1.0), 'intruder', 0.3, 'thrust'),
    ((0.0, 1.0), 'intruder', 0.3, 'three numbers'),
    ((0.0, 0.0, 1.0), 'drone', 0.3, 'there is no intruder "drone"'),
    ((0.0, 0.0, 1.0), 'intruder', 0.0, 'downwash.radius')])
def test_what_is_no_thrust_is_refused(thrust, name, radius, told):
    """Say what is wrong, and change nothing."""
    simulation = _orchard()
    with pytest.raises(CommandError, match=told):
        simulation.set_thrust(thrust, name, radius)
    assert not simulation.state.intruders['intruder'].thrust.any()
