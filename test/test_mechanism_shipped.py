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


"""The shipped mechanisms: what their titles say, against statics and blade elements."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from procphys_ros.mechanism import MechanismGrammar
from procphys_ros.physics.air import AIR_DENSITY, PLATE_DRAG
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.wind import WindSettings
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

G = 9.81


def simulate(name, wind=0.0, **defines):
    """Simulate a shipped mechanism in a steady wind along y."""
    scene = Scene(Settings(wind=WindSettings(velocity=(0.0, wind, 0.0), turbulence_intensity=0.0,
                                             profile='uniform')))
    scene.add(MechanismGrammar.load(f'{name}.mech').build(**defines), name=name)
    return Simulation(scene)


def kind(simulation, name):
    """List the parts whose kind has a name."""
    source = simulation.blueprint
    return np.flatnonzero(np.array(source.kinds)[source.kind] == name)


def test_the_chain_of_the_crane_bears_the_ball():
    """Hang the ball straight down: the topmost link pulls by its weight and that of the chain."""
    simulation = simulate('crane', back=0.0)
    simulation.step(30)
    parts = np.concatenate([kind(simulation, 'link'), kind(simulation, 'ball')])
    weight = simulation.blueprint.mass[parts].sum() * G
    rows = simulation.state.world.joints
    first = simulation.state.parts.body[parts[0]]
    pull = np.linalg.norm(rows.force[rows.first == first], axis=1).max()
    assert pull == pytest.approx(weight, rel=1e-3)


def test_the_ball_of_the_crane_gains_what_it_falls():
    """Draw it back and let it go: its speed at the lowest point is that of a free fall."""
    simulation = simulate('crane', back=40.0)
    ball = kind(simulation, 'ball')[0]
    height = simulation.poses[ball, 2]
    speed = 0.0
    for _ in range(120):
        simulation.step()
        speed = max(speed, np.linalg.norm(simulation.velocities[ball, :3]))
        height = max(height, simulation.poses[ball, 2])
    fall = height - simulation.poses[ball, 2]
    assert speed == pytest.approx(np.sqrt(2.0 * G * fall), rel=0.25)
    assert not len(simulation.events)


def test_the_windmill_turns_as_its_blade_elements_say(wind=9.0):
    """Balance the moment of all blades with that of load and friction (one law, no wake)."""
    simulation = simulate('windmill', wind)
    simulation.step(360)
    blades, span, chord, pitch, load, friction = 8, 1.6, 0.55, np.radians(35.0), 20.0, 1.0

    def moment(turn):
        def element(r):
            speed = wind * np.cos(pitch) - turn * r * np.sin(pitch)
            return (0.5 * AIR_DENSITY * PLATE_DRAG * chord * abs(speed) * speed
                    * np.sin(pitch) * r)
        return blades * quad(element, 0.3, 0.3 + span)[0] - load * turn - friction
    turn = brentq(moment, 0.0, 50.0)
    assert -simulation.joints.velocity[0] == pytest.approx(turn, rel=0.15)


def test_the_swing_swings_as_a_pendulum():
    """Take all that hangs as one rigid body about the beam; chains bend by little."""
    simulation = simulate('swing', angle=8.0)
    source = simulation.blueprint
    parts = np.concatenate([kind(simulation, name) for name in ('seat', 'child', 'arm', 'link')])
    mass, arm = source.mass[parts], source.poses[parts, :3] - [0.0, 0.0, 2.6]
    far = np.square(arm[:, 1:]).sum(axis=1)
    inertia = (mass * far).sum() + source.inertia[parts].max(axis=1).sum()
    depth = np.linalg.norm((mass[:, None] * arm[:, 1:]).sum(axis=0))
    period = 2.0 * np.pi * np.sqrt(inertia / (G * depth))
    y = simulation.series(330, ['swing/5']).poses[:, 0, 1]
    turns = np.flatnonzero(np.diff(np.sign(y)))
    assert 2.0 * np.diff(turns).mean() / 60.0 == pytest.approx(period, rel=0.05)


def test_the_gate_slams_in_the_wind():
    """Let the wind turn an open gate to its stop, where a storm tears it off."""
    simulation = simulate('gate', 10.0, open=-60.0)
    simulation.step(240)
    assert np.degrees(simulation.joints.position[0]) == pytest.approx(115.0, abs=0.5)
    storm = simulate('gate', 32.0, open=-60.0)
    storm.step(120)
    assert set(storm.events['part_b']) == {2} and not len(storm.joints.names)


def test_the_ropes_of_the_bridge_pull_as_its_sag_says():
    """Compare the springs at their ends with w·L²/8h, in the mean as the bridge bounces."""
    simulation = simulate('rope_bridge')
    mass = simulation.blueprint.mass[np.concatenate([kind(simulation, name) for name in (
        'plank', 'left', 'right')])]
    ropes, told = kind(simulation, 'left'), []
    for _ in range(150):
        simulation.step()
        told.append((2.05 - simulation.poses[ropes, 2].min(),
                     80000.0 * np.abs(simulation.joints.position).mean()))
    sag, pull = np.mean(told[30:], axis=0)
    assert pull == pytest.approx(0.5 * G * mass.sum() * 8.0 / (8.0 * sag), rel=0.05)
    assert not len(simulation.events)


def test_the_rope_bridge_bears_a_load_and_breaks_by_more():
    """Put 80 kg on its middle, but not three tonnes."""
    simulation = simulate('rope_bridge')
    simulation.step(30)
    middle = simulation.poses[kind(simulation, 'plank'), 2].min()
    block = {'shape': 'box', 'size': (0.4, 0.4, 0.4), 'velocity': (0.0, 0.0, 0.0)}
    simulation.launch(Projectile(mass=80.0, position=(0.0, 0.0, middle + 0.25), **block))
    simulation.step(60)
    assert not len(simulation.events)
    simulation.launch(Projectile(mass=3000.0, position=(0.0, 0.0, middle + 1.2), **block))
    simulation.step(60)
    assert Cause.FORCE in simulation.events['cause']


def test_the_last_domino_tips_the_seesaw():
    """Let the row fall, and the ball on the other end rise."""
    simulation = simulate('dominoes')
    ball = kind(simulation, 'ball')[0]
    heights = simulation.series(360, [int(ball)]).poses[:, 0, 2]
    assert heights.max() > heights[60] + 0.2


def test_the_cart_rolls_where_it_is_pushed():
    """Push it for a second: it rolls on straight, on all its wheels."""
    simulation = simulate('cart')
    simulation.apply_wrench('cart/0', (40.0, 0.0, 0.0))
    simulation.step(60)
    simulation.clear_wrenches()
    simulation.step(30)
    poses, source = simulation.poses, simulation.blueprint
    moved = poses[0, :3] - source.poses[0, :3]
    assert moved[0] > 0.4 and abs(moved[1]) < 0.05 and abs(moved[2]) < 0.01
    turned = simulation.joints.position
    np.testing.assert_allclose(turned * 0.125, moved[0], rtol=0.05)
