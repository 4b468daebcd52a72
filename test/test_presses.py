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

"""Whatever presses on a standing part does so where it touches: a post is bent by its head."""

from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import contact, Simulation
from procphys_ros.simulation.contact_pairs import TreeContacts

_DT = 1.0 / 60.0
_HEIGHTS = pytest.mark.parametrize('height', [0.5, 1.5, 2.5])


def post(tension: float = 1e6, **settings: object) -> Simulation:
    """Stand a stone post of 0.3 x 0.3 x 3 m on the ground."""
    scene = Scene.from_parameters({'scene': {'objects': []}, **settings})
    scene.add(bonded([[0.0, 0.0, 1.5]], (0.3, 0.3, 3.0), tension=tension, cohesion=1e6),
              (0.0, 0.0, 0.0), 0.0, 'post')
    return Simulation(scene)


@_HEIGHTS
def test_an_intruder_bends_a_post_by_the_height_at_which_it_pushes(height):
    """Find the moment at the foot, force times height, to 0.1 %."""
    simulation = post(intruder={'shape': 'sphere', 'size': 0.2})
    for _ in range(7):  # some hundreds of newtons then
        way = min(0.05 * simulation.time, 0.0022)
        simulation.place_intruder([way - 0.252, 0.0, height, 0.0, 0.0, 0.0, 1.0])
        simulation.step()
    foot = simulation.state.solver.wrenches()[0]
    assert foot[0] > 100.0 and foot[4] == pytest.approx(foot[0] * height, rel=1e-3)


@pytest.mark.parametrize('shape', ['sphere', 'box'])
@_HEIGHTS
def test_a_blow_on_its_head_cracks_a_post_that_holds_one_on_its_foot(shape, height):
    """Strike with 620 N: 69, 207 and 345 kPa in the foot, which bears 276 with its weight."""
    simulation = post(2.2e5)
    simulation.launch(Projectile(shape, 0.2, 1.0, (-1.0, 0.0, height), (5.0, 0.0, 0.0)))
    simulation.step(30)
    assert len(simulation.impacts) == 1
    assert (simulation.bonds_broken > 0) == (height > 2.0)


@_HEIGHTS
def test_a_branch_bends_a_post_by_the_height_at_which_it_leans(height):
    """Press with 300 N for some seconds; the moment about the middle of the post is that."""
    simulation = post()
    model, state = simulation.model, simulation.state
    state.contacts = TreeContacts(
        np.array([0]), np.array([-1]), np.array([-1]), np.array([0]),
        np.array([[-0.15, 0.0, height]]), np.array([[-300.0 * _DT, 0.0, 0.0]]), np.ones(1),
        np.zeros(1))
    for _ in range(120):
        contact.press_walls(model, state, _DT)
    parts, wrenches = state.loads.layer('branches')
    assert parts.tolist() == [0]
    assert wrenches[0] == pytest.approx([300.0, 0.0, 0.0, 0.0, 300.0 * (height - 1.5), 0.0],
                                        rel=0.02, abs=1e-9)
