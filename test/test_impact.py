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

"""How long blows last."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from procphys_ros.physics.impact import contact_time
from procphys_ros.physics.world import World
from procphys_ros.simulation.blows import energies, measure

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
