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


"""Trees whose shape matters: tapered stems, branches drawn without their weight, root plates."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from procphys_ros.blueprint import skeleton
from procphys_ros.lsystem import LSystem
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees import Forest
from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation

_HEIGHT, _WIDTH, _DENSITY, _MODULUS = 10.0, 0.3, 900.0, 8e9  # SI
_BRANCH = 'axiom: Width(0.04) &(90) Density(800) Modulus(8e9) {shape} {segments}\n'


def _beam_frequency(taper: float, elements: int = 200) -> float:
    """Compute f1 of a tapered cantilever by Euler-Bernoulli elements [Hz]."""
    length = _HEIGHT / elements
    stiffness, mass = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    bend = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]], float)
    carry = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22],
                      [-13, -3, -22, 4]], float) / 420.0
    unit = np.array([1.0, length, 1.0, length])
    for i in range(elements):
        width = _WIDTH * (1.0 + (taper - 1.0) * (i + 0.5) / elements)
        at = slice(2 * i, 2 * i + 4)
        inertia = _MODULUS * np.pi * width ** 4 / 64.0
        stiffness[at, at] += inertia / length ** 3 * bend * np.outer(unit, unit)
        mass[at, at] += (_DENSITY * np.pi * width ** 2 / 4.0 * length * carry
                         * np.outer(unit, unit))
    square = eigh(stiffness[2:, 2:], mass[2:, 2:], eigvals_only=True, subset_by_index=[0, 0])
    return float(np.sqrt(square[0])) / (2.0 * np.pi)


@pytest.mark.parametrize('taper', [1.0, 0.5, 0.3, 0.1])
def test_ten_tapered_segments_sway_like_the_beam(taper):
    """Hold f1 of a stem that tapers down to a tenth within 2 %."""
    nodes = np.zeros((11, 3))
    nodes[:, 2] = np.linspace(0.0, _HEIGHT, 11)
    stem = skeleton.from_nodes(nodes, np.arange(11) - 1,
                               0.5 * _WIDTH * np.linspace(1.0, taper, 11), density=_DENSITY,
                               modulus=_MODULUS, damping_ratio=0.01)
    forest, path, dt = Forest(stem, (0.0, 0.0, 0.0), 0.0), [], 1.0 / 400.0
    forest.apply_impulse(9, linear=(0.1, 0.0, 0.0))
    for _ in range(1600):
        forest.step(dt)
        path.append(forest.poses[3, 0])
    free = np.array(path)
    # The higher modes of the push die out first; what is left is counted from zero to zero.
    late = free[-800:]
    before = np.flatnonzero(late[1:] * late[:-1] < 0.0)
    times = dt * (before + late[before] / (late[before] - late[before + 1]))
    frequency = (len(times) - 1) / (2.0 * (times[-1] - times[0]))
    assert frequency == pytest.approx(_beam_frequency(taper), rel=0.02)


def _branch(shape: str, count: int) -> Forest:
    return Forest(LSystem.parse(_BRANCH.format(shape=shape, segments='F(0.1) ' * count)).build())


def test_a_branch_drawn_unloaded_sags_as_beam_theory():
    """Expect w·L⁴/8EI at the tip of a level branch of 2 m, and no motion afterwards."""
    forest = _branch('Preload(0)', 20)
    drawn = _branch('', 20).poses[19]
    weight = 800.0 * np.pi / 4.0 * 0.04 ** 2 * 9.81
    sag = weight * 2.0 ** 4 / (8.0 * 8e9 * np.pi * 0.04 ** 4 / 64.0)
    tip = forest.poses[19, 2] + 0.05 * (forest.poses[19, 2] - forest.poses[18, 2]) / 0.1
    assert drawn[2] - tip == pytest.approx(sag, rel=0.02)
    rest = forest.poses.copy()
    for _ in range(120):
        forest.step(1.0 / 60.0)
    np.testing.assert_allclose(forest.poses, rest, atol=1e-9)
    forest.reset()
    np.testing.assert_array_equal(forest.poses, rest)


def test_a_whip_that_is_drawn_level_hangs():
    """Let a branch sag that its weight outdoes: it hangs down, at rest, in balance."""
    text = _BRANCH.format(shape='Width(0.004) SwingLimit(90) Preload(0)', segments='F(0.1) ' * 20)
    forest = Forest(LSystem.parse(text).build())
    rest = forest.poses.copy()
    assert rest[19, 2] < -1.0
    for _ in range(120):
        forest.step(1.0 / 60.0)
    np.testing.assert_allclose(forest.poses, rest, atol=1e-6)


def test_half_a_preload_sags_half():
    """Allow for half of the weight in the drawn shape: half of the small sag is left."""
    drawn, half, none = (_branch(shape, 5).poses[4, 2]
                         for shape in ('', 'Preload(0.5)', 'Preload(0)'))
    assert drawn - half == pytest.approx(0.5 * (drawn - none), rel=1e-3)


def test_a_scene_begins_sagged():
    """Show the sagged pose before the first step already."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['twig']},
        'twig': {'grammar_text': _BRANCH.format(shape='Preload(0)', segments='F(0.1) ' * 20)}})
    simulation = Simulation(scene)
    first = simulation.poses.copy()
    assert first[19, 2] < scene.blueprint.poses[19, 2] - 0.01
    simulation.step(30)
    np.testing.assert_allclose(simulation.poses, first, atol=1e-9)


def test_a_root_plate_turns_out_of_the_ground():
    """Push a stem beyond its root moment: it falls whole, and the event says why."""
    text = ('axiom: Width(0.2) Strength(60e6) RootMoment({:g}) F(2) F(2) F(2) F(2) F(2) F(2) F(2) '
            'F(2) F(2)\n')
    holds = 60e6 * np.pi / 32.0 * 0.2 ** 3
    for moment, cause in ((0.8 * holds, Cause.UPROOTING), (1.2 * holds, Cause.BENDING)):
        simulation = Simulation(Scene.from_parameters({
            'scene': {'objects': ['mast']}, 'wind': {'turbulence_intensity': 0.0},
            'mast': {'grammar_text': text.format(moment)}}))
        simulation.set_wind((150.0, 0.0, 0.0))
        while not len(simulation.events) and simulation.time < 20.0:
            simulation.step()
        assert simulation.events['cause'][0] == cause
        assert simulation.events['part_a'][0] == -1
        assert 1.0 < simulation.events['load'][0] < 1.2
        simulation.set_wind((0.0, 0.0, 0.0))
        simulation.step(600)
        assert simulation.poses[:, 2].max() < 4.0


def test_only_joints_in_the_ground_are_uprooted():
    """Leave the root moment of all segments to the first."""
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    stem = skeleton.from_nodes(nodes, [-1, 0, 1], [0.1] * 3)
    loads = Forest(replace(stem, hinges=replace(stem.hinges, root_moment=np.full(2, 10.0))))
    loads.apply_impulse(1, linear=(50.0, 0.0, 0.0))
    loads.step(1.0 / 60.0)
    assert Cause.UPROOTING in loads.overloaded()[1]
    grown = LSystem.parse('axiom: RootMoment(10) F F F\n').build()
    assert np.isinf(grown.hinges.root_moment[1:]).all() and grown.hinges.root_moment[0] == 10.0
