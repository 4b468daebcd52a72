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


"""Small scenes that together call every kernel as simulations do."""

from collections.abc import Callable
from typing import Any

import numpy as np

from procphys_ros.blueprint import Blueprint, Shape, skeleton
from procphys_ros.files.resources import shared_folder
from procphys_ros.messages import MarkerStyle, pose_array, SceneMarkers, stamp
from procphys_ros.physics import touch
from procphys_ros.physics.masonry import FreeBodies, strength, subdomains
from procphys_ros.physics.trees import (
    contact_response,
    equilibrium,
    integrator,
    layout,
    pose,
    state,
)
from procphys_ros.physics.world import JointKind, merge_boxes, World
from procphys_ros.recording.marker_state import find_markers
from procphys_ros.scene import Scene
from procphys_ros.scene.earthquake import Earthquake
from procphys_ros.scene.lidar import LidarSettings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.scene.terrain import make_terrain, TerrainSettings
from procphys_ros.simulation import Simulation

# Worlds import these when they are made, so that the mark of complete kernels depends on them:
# procphys_ros.physics.world.bullet, procphys_ros.physics.world.native.

# Rules with contexts, trees that are culled, and shelter.
_SAPLINGS: dict[str, Any] = {
    'scene': {'objects': ['sapling']}, 'wind': {'velocity': [20.0, 0.0, 0.0], 'shelter': True},
    'culling': {'distance': 60.0, 'sleeping': True, 'far_distance': 10.0, 'far_interval': 2},
    'sapling': {'count': 9, 'spacing': 0.6, 'grammar_text': """
axiom: Width(0.05) Density(700) Modulus(8e9) DampingRatio(0.05) Preload(0.5) F(1) A B F(1) Leaf(1)
derivation length: 2
production:
A < B -> F(0.5)
A > F -> F(0.5)
"""}}
# A wall of so poor mortar that its joints crack in the wind, open and close.
_WALL: dict[str, Any] = {
    'scene': {'objects': ['wall']}, 'wind': {'velocity': [0.0, 18.0, 0.0]},
    'load': {'snow': 5.0},
    'wall': {'grammar_text': """
building wall
  footprint: (0, 0) (2, 0)
  facades: brickwork
  storey_height: 1.5
layout running { unit: 0.215 0.1025 0.065  joint: 0.01  material: brick }
panel brickwork: running
material brick { tension: 500  cohesion: 500 }
"""}}
# What asks where it stands grows after the wall.
_ASKING: dict[str, Any] = {
    'scene': {'objects': ['wall', 'twig']}, 'wall': _WALL['wall'],
    'twig': {'origin': [1.0, 1.0, 0.0], 'grammar_text': """
axiom: F(1) ?P(0, 0, 0) ?E(light; 0) ?E(space; 0) ?E(neighbour; 0) ?E(load; 0, 0) ?E(sag; 0, 0, 0)
"""}}
# Both on a hillside, where the wall has footings.
_HILL: dict[str, Any] = {
    'scene': {'objects': ['wall', 'sapling']},
    'wind': {'velocity': [0.0, 8.0, 0.0], 'hills': True},
    'load': {'snow': 5.0},
    'intruder': {'shape': 'sphere', 'size': [0.6]},
    'terrain': {'noise': 3.0, 'wavelength': 12.0, 'extent': 24.0},
    'wall': _WALL['wall'],
    'sapling': {'origin': [3.0, 0.0, 0.0],
                'grammar_text': _SAPLINGS['sapling']['grammar_text']}}


# A flap in the wind on a frame whose parts overlap.
_FLAP: dict[str, Any] = {
    'scene': {'objects': ['flap']}, 'wind': {
        'velocity': [0.0, 8.0, 0.0], 'zones': ['size=4,4,4 speed=1.1']},
    'flap': {'grammar_text': """
mechanism flap {
    box post { size: 0.1, 0.1, 2  at: 0, 0, 1  weld {} }
    box beam { size: 1, 0.1, 0.1  at: 0.5, 0, 1.95  weld { to: post } }
    rod stay { from: 0, 0, 1.2  to: 0.7, 0, 1.95  diameter: 0.05
        weld { to: ground  strength: 1e6 } }
    plate flap { size: 0.8, 0.01, 0.6  at: 0.55, 0, 1.55
        hinge { to: beam  at: 0.55, 0, 1.9  axis: 1, 0, 0  strength: 5 } }
}
"""}}


def step_trees() -> None:
    """Compile the step of trees, which takes longest, by stepping none."""
    plan, *where = _tree(0)
    none = np.zeros(0, np.int64)
    integrator.step(plan, none, np.zeros(0), *where)
    equilibrium.lean(plan, none, *where, 1e-6)


def pile_up() -> None:
    """Drop a capsule on a box that hangs by a joint."""
    world = World(engine='native')
    place = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    body = np.array([world.add_body(Shape.BOX, np.full(3, 0.2), 1.0, place)])
    world.add_body(Shape.CAPSULE, np.array([0.1, 0.1, 0.3]), 1.0, place + np.eye(7)[2] * 0.15)
    world.join(JointKind.BALL, body, np.array([World.ground]), place)
    world.add_velocities(body, np.zeros((1, 6)))
    world.step(1.0 / 60.0)


def lie_down() -> None:
    """Let two boxes fall asleep on each other, and throw a third at them."""
    world, size = World(engine='native'), np.full(3, 0.2)
    for height in (0.1, 0.3):
        world.add_body(Shape.BOX, size, 1.0, np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0]))
    for _ in range(60):
        world.step(1.0 / 60.0)
    world.add_body(Shape.BOX, size, 1.0, np.array([-0.4, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]),
                   np.array([10.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    for _ in range(10):
        world.step(1.0 / 60.0)


def touch_trees() -> None:
    """Compile contacts of trees: how a twig responds to an impulse, and with what none touches."""
    rows, points = np.zeros(1, np.intp), np.zeros((1, 3))
    plan, model, columns, scratch, wind, gravity = _tree(1)
    contact_response.predict_response(plan, rows, points, points, model, columns, [scratch], wind,
                                      gravity, 1.0 / 60.0, 1)
    none, numbers, matrices = rows[:0], np.zeros(0), np.zeros((0, 3, 3))
    poses, sizes, velocities = np.zeros((0, 7)), np.zeros((0, 3)), np.zeros((0, 6))
    touch.meet(none, poses, sizes, velocities, none, np.zeros(0, np.uint8), poses, sizes,
               velocities, 1.0 / 60.0)
    touch.resolve(sizes, numbers, numbers, numbers, touch.Partners(
        none, none, none, sizes, numbers, matrices, velocities), sizes, none, none, none,
        matrices, sizes)


def strike_twig() -> None:
    """Strike a piece in flight, the only part of it."""
    FreeBodies(_twig()).strike(np.zeros(1, np.intp), np.zeros((1, 6)), 1)


def merge_bricks() -> None:
    """Merge two bricks."""
    merge_boxes(np.eye(7)[[6, 6]], np.ones((2, 3)))


def erode_hill() -> None:
    """Let rain wear a hill of a few cells."""
    make_terrain(TerrainSettings(noise=3.0, extent=4.0, erosion=1.0), 0)


def sway() -> None:
    """Step saplings, near and far, awake and asleep, and show them."""
    simulation = Simulation(Scene.from_parameters(_SAPLINGS))
    simulation.step()
    _publish(simulation)
    simulation.set_observer((-8.0, 0.0, 1.0))
    simulation.step(4)


def grow_beside() -> None:
    """Grow a twig that asks everything of its place, beside a wall, and let it grow on."""
    simulation = Simulation(Scene.from_parameters(_ASKING))
    simulation.grow(rate=30.0, years=1)
    simulation.step(3)


def flap_in_wind() -> None:
    """Let a flap swing in the wind, tear off and meet its frame."""
    simulation = Simulation(Scene.from_parameters(_FLAP))
    simulation.step(40)


def break_trees() -> None:
    """Blow up and strike trees."""
    simulation = _shipped('felled_by_wind')
    simulation.step()
    _strike_tree(simulation)
    _damage(simulation)


def crack_wall() -> None:
    """Crack a wall by the wind, then blow it up."""
    simulation = Simulation(Scene.from_parameters(_WALL))
    simulation.step(30)
    simulation.apply_impulse(len(simulation.blueprint) // 2, (0.0, 2.0, 0.0))
    simulation.step(30)
    solver = simulation.state.solver
    rows = solver.graph.neighbours(np.array([0]))
    _, low, high = strength.opening(solver.graph, rows, solver.wrenches(rows))
    solver.narrow(rows, low, high)
    subdomains.surroundings(solver.graph, np.array([0]), len(simulation.blueprint))
    _damage(simulation)


def wreck_cottage() -> None:
    """Blow up a cottage, and demolish it."""
    simulation = _shipped('figure_1')
    simulation.step(2)
    _strike(simulation)
    simulation.step(17)
    simulation.demolish()
    simulation.step(2)
    _meddle(simulation, 2)


def demolish_on_hill() -> None:
    """Strike a wall on a hillside, and demolish it."""
    simulation = Simulation(Scene.from_parameters(_HILL))
    simulation.step()
    simulation.launch(Projectile('sphere', (0.4,), 60.0, (-3.0, 1.0, 4.0), (10.0, -1.0, 0.0)))
    simulation.step(30)
    simulation.demolish()
    simulation.step(30)
    _meddle(simulation)
    simulation.model.terrain.normal(simulation.poses)
    _publish(simulation)


def _tree(count: int) -> tuple:
    """Return a plan with that many twigs, 0 or 1, and what kernels of trees take besides."""
    rows = np.zeros(count, np.int64)
    plan = state.TraversalPlan(rows, rows - 1, np.arange(count + 1), rows)
    model, columns = state.make_model(layout.arrange(_twig(), 0.0)), state.make_state(1)
    pose.place_all(plan, model, columns)
    return plan, model, columns, state.make_scratch(plan), np.zeros((1, 3)), np.zeros(3)


def _twig() -> Blueprint:
    return skeleton.from_nodes(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([-1, 0]),
                               np.array([0.1, 0.1]))


def _publish(simulation: Simulation) -> None:
    """Write all messages, markers for a new and an old subscriber, and read them; then scan."""
    markers = SceneMarkers(simulation.blueprint, simulation.objects, 'world',
                           MarkerStyle(40_000, '', ''))
    now = stamp(simulation.time)
    pose_array(simulation.poses, now, 'world')
    for write in (markers.whole, markers.changes):
        leaves = simulation.leaf_poses() if markers.shows_leaf_poses else None
        data = write(simulation.poses, now, leaves, simulation.dust)
        if data is not None:
            find_markers(bytes(data))
    simulation.scan(LidarSettings(rows=4, columns=8))


def _damage(simulation: Simulation) -> None:
    """Do to a scene what commands can do."""
    blueprint = simulation.blueprint
    simulation.set_observer((-30.0, 0.0, 2.0))
    simulation.set_wind((8.0, 2.0, 0.0))
    simulation.gust()
    simulation.shake(Earthquake(peak=0.1, duration=0.5))
    simulation.apply_impulse(int(np.argmin(blueprint.poses[:, 2])), (50.0, 0.0, 0.0))
    simulation.apply_wrench(len(blueprint) - 1, (20.0, 0.0, 0.0))
    _strike(simulation)
    simulation.step(40)
    _meddle(simulation)
    _publish(simulation)


def _strike(simulation: Simulation) -> None:
    """Set off a charge beside the middle part, and shoot a ball and a box at it."""
    x, y, z = simulation.blueprint.poses[len(simulation.blueprint) // 2, :3]
    simulation.explode((x + 1.0, y, z), 5.0)
    for shape, size in (('sphere', (0.5,)), ('box', (0.5, 0.5, 0.5))):
        simulation.launch(Projectile(shape, size, 60.0, (x - 10.0, y, z + 1.0),
                                     (25.0, 0.0, 0.0)))
        simulation.step()


def _strike_tree(simulation: Simulation) -> None:
    """Shoot a heavy box through a trunk."""
    x, y, z = simulation.blueprint.poses[0, :3]
    simulation.launch(Projectile('box', (0.5, 0.5, 0.5), 500.0, (x - 3.0, y, z + 1.0),
                                 (40.0, 0.0, 0.0)))
    simulation.step(30)


def _meddle(simulation: Simulation, steps: int = 40) -> None:
    """Move an intruder with rotors into what is left of the middle part."""
    x, y, z = simulation.blueprint.poses[len(simulation.blueprint) // 2, :3]
    simulation.place_intruder((x, y, z, 0.0, 0.0, 0.0, 1.0))
    simulation.set_thrust((0.0, 0.0, 20.0))
    simulation.step(steps)


def _shipped(name: str) -> Simulation:
    return Simulation(Scene.from_yaml(shared_folder() / 'config' / f'{name}.yaml'))


SCENES: dict[str, Callable[[], None]] = {
    scene.__name__.replace('_', ' '): scene
    for scene in (step_trees, pile_up, lie_down, sway, touch_trees, strike_twig, crack_wall,
                  merge_bricks, erode_hill, flap_in_wind, break_trees, grow_beside,
                  wreck_cottage, demolish_on_hill)}
"""By name; the first is what a node that starts comes to last."""
