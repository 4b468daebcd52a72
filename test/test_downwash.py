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

"""Jets of rotors: momentum theory, round jets, and what they move in a scene."""

import numpy as np
import pytest

from procphys_ros.errors import CommandError
from procphys_ros.physics.air import AIR_DENSITY
from procphys_ros.physics.wind.downwash import add_jets, jet
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

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
