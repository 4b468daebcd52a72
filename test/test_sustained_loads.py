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


"""Loose masonry bears its own weight where it comes to lie, or breaks."""

from masonry_walls import bonded
import numpy as np
import pytest

from procphys_ros.physics.masonry.contact_forces import PieceBlow
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, impacts, Simulation
from procphys_ros.simulation.wall_loads import DEBRIS_LAYER

_LENGTH, _HEIGHT, _DENSITY = 0.5, 0.3, 1900.0  # [m], [kg/m³] of one block of a beam of seven
_STONE = 0.5  # [m], as wide as its middle block


def laid_on_a_stone(tension, flat=False):
    """Drop a beam of 3.5 m by 0.2 mm onto a stone under its middle, or onto the ground."""
    centres = [[_LENGTH * i, 0.0, 0.5 * _HEIGHT] for i in range(-3, 4)]
    beam = bonded(centres, (_LENGTH, 0.2, _HEIGHT), density=_DENSITY, gap=1e-3, ground=False,
                  tension=tension, cohesion=2.0 * tension)
    scene = Scene()
    if not flat:
        scene.add(bonded([[0.0, 0.0, 0.2]], (_STONE, 0.4, 0.4), tension=1e6))
    scene.add(beam, (0.0, 0.0, 2e-4 + (0.0 if flat else 0.4)), 0.0, 'beam')
    simulation = Simulation(scene)
    simulation.step(90)
    return simulation


@pytest.mark.parametrize(('share', 'breaks'), [(0.85, True), (1.15, False)])
def test_what_is_let_down_gently_breaks_where_its_weight_bends_it_too_far(share, breaks):
    """Lay a beam on its middle: the joint at the stone bears 3·ρ·g·l²/h, at l beyond it."""
    stress = 3.0 * _DENSITY * 9.81 * (3 * _LENGTH) ** 2 / _HEIGHT
    simulation = laid_on_a_stone(share * stress)
    assert (simulation.bonds_broken > 0) == breaks
    first = simulation.events['time'] < simulation.events['time'].min(initial=np.inf) + 0.1
    assert (simulation.events['cause'][first] == Cause.TENSION).all()  # nothing has struck it


def test_what_lies_flat_holds():
    """Lay the same beam on the ground: it bears no more than what is right above."""
    assert laid_on_a_stone(2e4, flat=True).bonds_broken == 0


def yoke_on_teeth(tension, load):
    """
    Lay a yoke on both ends of a tee of five stones, which stick out by half of their length.

    :param tension: of the joints of the tee [Pa].
    :param load: mass of the yoke [kg].
    """
    stone = (0.4, 0.4, 0.2)
    centres = [[-0.2, 0.0, 0.1], [0.2, 0.0, 0.1], [-0.4, 0.0, 0.301], [0.0, 0.0, 0.301],
               [0.4, 0.0, 0.301]]
    tee = bonded(centres, stone, density=_DENSITY, gap=2e-3, ground=False, tension=tension,
                 cohesion=2.0 * tension)
    sizes = np.array([[1.6, 1.6, 0.4], [0.1, 0.4, 0.2], [0.1, 0.4, 0.2]])
    yoke = bonded([[0.0, 0.0, 0.4], [-0.5, 0.0, 0.1], [0.5, 0.0, 0.1]], sizes, gap=2e-3,
                  density=load / sizes.prod(axis=1).sum(), ground=False, tension=1e8,
                  cohesion=1e8)
    scene = Scene(Settings(engine='native'))  # a stack at its limit
    scene.add(tee, name='tee')
    scene.add(yoke, (0.0, 0.0, 0.4014), name='yoke')
    simulation = Simulation(scene)
    simulation.step(60)
    return simulation


@pytest.mark.parametrize(('tension', 'load', 'breaks'), [
    (0.2e6, 16_000.0, True), (20e6, 16_000.0, False), (0.2e6, 300.0, False)])
def test_stones_that_stick_out_come_off_under_what_lies_on_them(tension, load, breaks):
    """
    Lay 16 t or 0.3 t on teeth: F at e from the bed joint bends it by 6·F·e/(A·h), A = h·b.

    With half of 16 t these are 5.9 MPa, with 0.3 t 0.11 MPa; the joint at the end takes a part.
    The yoke ties loose teeth together by friction, so they are not bound to fall.
    """
    simulation = yoke_on_teeth(tension, load)
    assert (simulation.bonds_broken > 0) == breaks
    assert (simulation.events['cause'] == Cause.TENSION).all()
    middle, tooth = simulation.state.parts.body[[3, 4]]
    assert (middle != tooth) == breaks


def test_what_is_pressed_breaks_whatever_room_there_is():
    """Break small pieces under lasting forces into a cell per part, and large ones into sixty."""
    blows = [PieceBlow(0, np.arange(n), None, np.inf) for n in (1000, 15, 5)]
    assert impacts._cells(blows, 0, 10.0) == [60, 15, 5]
    assert impacts._cells(blows, 60, 10.0) == [60, 15, 5]


def test_lumps_break_whatever_room_there_is():
    """Break lumps into some cells without room for more bodies, huge ones into grains."""
    blows = [PieceBlow(0, np.arange(count), None, 0.0)
             for count in (1000, 300, 200, 90, 30)]
    assert impacts._cells(blows, 0, 10.0)[:3] == [60, 30, 2]
    assert max(impacts._cells(blows, 0, 10.0)[3:]) < 2
    assert impacts._cells(blows[2:], 60, 10.0)[0] > 10


@pytest.mark.parametrize('engine', ['native', 'bullet'])
def test_what_falls_asleep_on_masonry_presses_no_more_than_before(engine):
    """Set a block down on a pier, which bears its weight from then on, as long as it sleeps."""
    scene = Scene(settings=Settings(engine=engine))
    scene.add(bonded([[0.0, 0.0, 0.2]], (_STONE, 0.4, 0.4), tension=1e6))
    simulation = Simulation(scene)
    simulation.launch(Projectile('box', (0.3, 0.3, 0.3), 50.0, (0.0, 0.0, 0.59),
                                 (0.0, 0.0, 0.0)))
    simulation.step(30)
    borne = []
    for _ in range(40):
        simulation.step()
        _, loads = simulation.state.loads.layer(DEBRIS_LAYER)
        borne.append(loads[:, 2].sum())
    assert not len(simulation.state.world.awake)
    weight = 50.0 * 9.81
    np.testing.assert_allclose(borne, -weight, rtol=0.05)
