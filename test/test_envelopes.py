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

"""The harness of envelopes finds what breaks its laws, and runs that leave their bounds."""

from envelopes import Envelope, nudge, nudged, Watch
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.physics.world import BodyState
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.cues import Cue
from procphys_ros.scene.strikes import Demolition, Explosion, Projectile
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import Owner

_BALL = Projectile('sphere', 0.4, 80.0, (0.6, -0.6, 0.3), (0.0, 6.0, 0.0))


def struck():
    """Make a scene with a wall of 33 bricks that a ball knocks down."""
    scene = Scene(Settings(cues=(Cue(0.0, '', _BALL),)))
    scene.add(wall(5, 6, tension=2e4, cohesion=2e4))
    return scene


def test_a_bound_that_too_few_runs_keep_is_told():
    """Name the figure, the bounds, and what the runs gave."""
    numbers = iter([1, 2, 3, 4])
    found = Envelope(lambda rng: nudge(struck(), rng), 0.1, {'run': lambda _: next(numbers)},
                     runs=4)
    found.bound('run', 2, 4, share=0.75)
    with pytest.raises(AssertionError, match=r'run: 75% .* 2 to 4, 90% are due: \[1.0, 2.0'):
        found.bound('run', 2, 4)


def not_finite(simulation):
    """Lose a number of a pose."""
    simulation.state.parts.poses[0, 1] = np.nan


def sunk(simulation):
    """Put a part under the ground."""
    simulation.state.parts.poses[0, 2] = -0.1


def faster(simulation):
    """Make all that moves three times as fast."""
    simulation.state.parts.velocities *= 3.0


@pytest.mark.parametrize('fault, word', [
    (not_finite, 'not finite'), (sunk, '0.075 m deeper'), (faster, 'energy rises by')])
def test_a_step_that_breaks_a_law_ends_the_run(monkeypatch, fault, word):
    """Damage the state at the end of the 20th step."""
    watch = Watch(Simulation(struck()))
    watch.run(19.0 / 60.0)
    step = watch.simulation.step
    monkeypatch.setattr(watch.simulation, 'step', lambda: (step(), fault(watch.simulation)))
    with pytest.raises(AssertionError, match=f'at 0.33 s: .*{word}'):
        watch.step()


def floating(simulation):
    """Lift a brick that rests."""
    world = simulation.state.world
    brick = np.flatnonzero(world.bodies.state == BodyState.RESTING)[[0]]
    world.set_poses(brick, world.bodies.poses[brick] + [0, 0, 2.0, 0, 0, 0, 0])


def unbonded(simulation):
    """Count what has fallen as standing."""
    simulation.state.parts.owner[:33] = Owner.STANDING


def lost(simulation):
    """Take momentum from the books."""
    simulation.ledger.carried = 0.9 * simulation.ledger.carried


@pytest.mark.parametrize('fault, word', [
    (floating, 'a piece floats'), (unbonded, 'stands on nothing'), (lost, 'Not equal')])
def test_what_is_left_is_checked(fault, word):
    """Find nothing in what a ball leaves, and each of three faults in it."""
    watch = Watch(Simulation(struck()))
    watch.run(1.5)
    watch.check_rest()
    fault(watch.simulation)
    with pytest.raises(AssertionError, match=word):
        watch.check_rest()


def test_a_nudge_is_small():
    """Change commands by a millimetre or a thousandth, and leave the rest of them alone."""
    rng = np.random.default_rng(0)
    other = nudged(_BALL, rng)
    np.testing.assert_allclose([*other.position, *other.velocity],
                               [*_BALL.position, *_BALL.velocity], atol=1e-3)
    assert other.velocity != _BALL.velocity and other.mass == _BALL.mass
    assert nudged(Demolition(), rng) == Demolition()
    assert nudged(Explosion((0.0, 0.0, 0.0), 2.0), rng).position[2] == 0.0
