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


"""Told at load: buildings that crack under their weight, that overlap, that are underground."""

import logging

from masonry_walls import wall
import pytest

from procphys_ros.scene import Scene
from procphys_ros.simulation import Simulation
from procphys_ros.wallgrammar import WallGrammar

_SPAN = """
building shed
  footprint: (0, 0) (3, 0)
  facades: front
  storey_height: 1.2
rule front -> split(y) { 0.45: foot | ~1: plain }
rule foot -> split(x) { 0.45: plain | ~1: gap | 0.45: plain }
layout running { unit: 0.215 0.1025 0.065  joint: 0.01  material: brick }
panel plain: running
panel gap: none
material brick { tension: 0.02e6  cohesion: 0.02e6 }
"""


def loaded(*objects):
    """Load named blueprints at places; return the warnings."""
    scene = Scene()
    for name, plan, place in objects:
        scene.add(plan, place, 0.0, name)
    return Simulation(scene).warnings


def test_sound_scenes_say_nothing(caplog):
    """Place two walls beside each other."""
    with caplog.at_level(logging.WARNING):
        assert loaded(('one', wall(4, 4), (0, 0, 0)), ('two', wall(4, 4), (0, 1, 0))) == ()
    assert not caplog.records


def test_a_building_that_cracks_under_its_weight_is_named(caplog):
    """Span 2 m in poor mortar: the log has name, numbers and place of the first crack."""
    plan = WallGrammar.parse(_SPAN).build()
    with caplog.at_level(logging.WARNING):
        line, = loaded(('sound', wall(4, 4), (0, 3, 0)), ('shed', plan, (5, 0, 0)))
    assert [record.getMessage() for record in caplog.records] == [line]
    assert line.startswith('shed does not carry its own weight')
    place = line.partition('the first at (')[2].partition(')')[0]
    x, _, z = map(float, place.split(','))
    assert 5.0 <= x <= 8.0 and 0.4 < z < 1.2
    falls = int(line.rpartition('; ')[2].split()[0])
    assert 0 < falls <= len(plan)


@pytest.mark.parametrize(('shift', 'told'), [(0.095, True), (0.11, False)])
def test_objects_in_each_other_are_named(shift, told):
    """Set a wall of 10.25 cm into another by 7 mm too much, and beside it."""
    lines = loaded(('one', wall(4, 4), (0, 0, 0)), ('two', wall(4, 4), (0, shift - 0.005, 0)))
    assert len(lines) == told
    if told:
        assert 'one and two overlap by up to 0.01 m' in lines[0]


def test_objects_below_the_ground_are_named():
    """Sink a wall by 20 cm."""
    line, = loaded(('sunk', wall(4, 4), (0, 0, -0.2)))
    assert 'sunk is below the ground' in line and '0.20 m' in line


def test_what_joins_a_running_scene_is_checked_against_what_is_there():
    """Name the wall that a new one stands in, and nothing that was told before or has gone."""
    scene = Scene()
    scene.add(wall(4, 4), (0, 0, 0), 0.0, 'one')
    scene.add(wall(4, 4), (0, 0.05, 0), 0.0, 'two')
    simulation = Simulation(scene)
    before = simulation.warnings
    assert len(before) == 1
    simulation.remove('two')
    simulation.add(wall(4, 4), (0, 3, 0), name='aside')
    assert simulation.warnings == before
    simulation.add(wall(4, 4), (0, 3.05, -0.2), name='late')
    sunk, overlap = simulation.warnings[1:]
    assert sunk.startswith('late is below the ground')
    assert overlap.startswith('aside and late overlap')
    simulation.add(wall(4, 4), (0, 0.05, 0), name='again')
    assert simulation.warnings[-1].startswith('one and again overlap')
    assert len(simulation.warnings) == 4


def test_what_joins_a_running_scene_and_cracks_under_its_weight_says_so():
    """Spawn the shed beside a wall: the same line as at load, but for the place."""
    plan = WallGrammar.parse(_SPAN).build()
    at_load, = loaded(('shed', plan, (5, 0, 0)))
    scene = Scene()
    scene.add(wall(4, 4), (0, 0, 0), 0.0, 'one')
    simulation = Simulation(scene)
    simulation.add(wall(4, 4), (0, 3, 0), name='sound')
    assert simulation.warnings == ()
    simulation.add(plan, (5, 0, 0), name='shed')
    assert simulation.warnings == (at_load,)


def test_dry_joints_that_only_open_are_no_failure():
    """Say nothing of a dry wall that stands, though its upright joints bear nothing."""
    dry = WallGrammar.parse(_SPAN.replace('~1: gap', '~1: plain').replace(
        'tension: 0.02e6  cohesion: 0.02e6', 'tension: 0  cohesion: 0')).build()
    assert loaded(('dry', dry, (0, 0, 0))) == ()


def test_what_is_put_above_the_ground_is_told_and_falls():
    """Put a shed half a metre up in a scene file: the ground is at z = 0, and does not hold it."""
    scene = Scene.from_parameters({'scene': {'objects': ['shed']}, 'shed': {
        'grammar_text': _SPAN, 'origin': [0.0, 0.0, 0.5]}})
    simulation = Simulation(scene)
    line = simulation.warnings[0]
    assert line.startswith('shed stands 0.51 m above the ground, so nothing holds it')
    start = simulation.poses[:, 2].max()
    simulation.step(60)
    assert simulation.poses[:, 2].max() < start - 0.3


def test_what_a_program_puts_above_the_ground_falls_too():
    """Add a wall at a metre to a scene, and another while it runs: none hangs on the ground."""
    scene = Scene()
    scene.add(wall(3, 2), (0, 0, 1.0), 0.0, 'one')
    simulation = Simulation(scene)
    simulation.add(wall(3, 2), (0, 3, 1.0), name='two')
    for name, line in zip(('one', 'two'), simulation.warnings, strict=True):
        assert line.startswith(f'{name} stands 1.00 m above the ground, so nothing holds it')
    simulation.step(60)
    assert not simulation.state.standing.any() and simulation.poses[:, 2].max() < 0.3
