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


"""The player behind a page: what is clicked while the scene changes."""

import numpy as np
import pytest
from view_scene import simulation_at_rest, TREE

from procphys_ros.scene.strikes import Explosion, Projectile
from procphys_ros.simulation.commands import Impulse
from procphys_ros.view.commands import Inspect, LoadScene, Reset, SetPause
from procphys_ros.view.player import Player


@pytest.fixture
def simulation():
    """Give the scene at rest."""
    return simulation_at_rest()


def test_clicks_while_a_scene_is_loaded_are_not_for_it(simulation, tmp_path):
    """Set off no charge in a scene that nobody has seen yet; a pause holds for it, too."""
    path = tmp_path / 'one.yaml'
    path.write_text(f'/**: {{ros__parameters: {{scene: {{objects: [twig]}}, '
                    f'twig: {{grammar_text: "{TREE.strip()}"}}}}}}', 'utf-8')
    player = Player(simulation)
    for command in (LoadScene(path), Inspect(30), Impulse(0, (1e3, 0.0, 0.0)), SetPause(True),
                    Explosion((1.0, 0.0, 0.0), 10.0)):
        player.say(command)
    player.turn(0.0)
    assert player.answer() == '' and player.status().paused
    assert player.simulation is not simulation and player.simulation.time == 0.0
    assert not player.simulation.state.parts.velocities.any()


def test_a_part_that_is_no_more_has_no_load(simulation):
    """Answer a click on what went with a reset, and go on."""
    player = Player(simulation)
    ball = len(simulation.blueprint)
    player.say(Projectile(size=0.4, position=(0.0, -5.0, 2.0), velocity=(0.0, 1.0, 0.0)))
    player.say(Reset())
    player.say(Inspect(ball))
    player.turn(0.0)
    assert f'there is no part "{ball}"' in player.answer()


def test_what_is_thrown_after_a_reset_is_drawn_anew(simulation):
    """Show a block that was thrown before the page saw that the ball of before is gone."""
    player = Player(simulation)
    place = {'position': (0.0, -5.0, 2.0), 'velocity': (0.0, 1.0, 0.0)}
    player.say(Projectile(size=0.4, **place))
    player.turn(0.0)
    first = player.frame().content
    player.say(Reset())
    player.say(Projectile('box', (0.9, 0.5, 0.3), **place))
    player.turn(1.0)
    shown = player.frame().content
    np.testing.assert_allclose(shown.size[-1], [0.9, 0.5, 0.3])
    assert not shown.ball[-1] and shown.scene != first.scene
