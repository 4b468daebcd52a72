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

"""Saws and felling cuts: what is left of a joint, where trees fall, what intruders saw."""

import math

from grown_trees import beam, bush, RADIUS
from masonry_walls import wall
import numpy as np
import pytest

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.trees.breaks import FLOOR, SIDE, WEAK_X, WEAK_Y
from procphys_ros.physics.trees.sections import hinge, kerfed
from procphys_ros.scene import Scene
from procphys_ros.scene.intruders import IntrudersSettings
from procphys_ros.simulation import Simulation
from procphys_ros.simulation.parts import Owner


def _simulation(plan, **more):
    scene = Scene.from_parameters({'scene': {'objects': []}, 'engine': 'native', **more})
    scene.add(plan, name='thing')
    return Simulation(scene)


def _lean(segments, direction, angle):
    """Stand a heavy-topped pole that leans."""
    plan = beam(segments, modulus=1e10, strength=5e7)
    turn = 0.5 * angle * np.array([-math.sin(direction), math.cos(direction), 0.0])
    return plan.placed((0.0, 0.0, 0.0), 0.0) if not angle else _turned(plan, turn)


def _turned(plan, half):
    pose = np.array([0.0, 0.0, 0.0, *half, math.sqrt(1.0 - float(half @ half))])
    plan.poses[:] = rotation.compose(pose, plan.poses)
    plan.bond_frame[:] = rotation.compose(pose, plan.bond_frame)
    return plan


@pytest.mark.parametrize('share', [0.0, 0.3, 0.5, 0.9])
def test_a_kerf_leaves_the_segment_of_a_circle(share):
    """Integrate the remaining section on a grid: moments of area and section modulus."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 2001), np.linspace(-1.0, 1.0, 2001))
    whole = x * x + y * y <= 1.0
    left = whole & (y <= 1.0 - 2.0 * share)
    middle = y[left].mean()
    weak, full = np.square(y[left] - middle).sum(), np.square(y[whole]).sum()
    furthest = max(1.0 - 2.0 * share - middle, middle + 1.0)
    strong = np.square(x[left]).sum()
    got = kerfed(np.array([share]))
    assert got.stiffness[0] == pytest.approx(weak / full, rel=0.01)
    assert got.strength[0] == pytest.approx(weak / furthest / full, rel=0.01)
    assert got.ratio[0] == pytest.approx(math.sqrt(strong / weak), rel=0.01)


def test_a_hinge_is_a_strip():
    """Compare b·h³/12 and b·h²/6 of a strip as long as the diameter with those of the circle."""
    got = hinge(np.array([0.1]))
    assert got.stiffness[0] == pytest.approx((0.1 ** 3 / 12.0) / (math.pi / 64.0))
    assert got.strength[0] == pytest.approx((0.1 ** 2 / 6.0) / (math.pi / 32.0))
    assert got.ratio[0] == pytest.approx(10.0)


@pytest.mark.parametrize('towards,lean', [(0.0, 90.0), (100.0, 0.0), (250.0, 200.0)])
def test_a_tree_falls_over_its_hinge(towards, lean):
    """Fell a pole that leans by 3 degrees to some side: it falls within 8 degrees of its aim."""
    simulation = _simulation(_lean(10, math.radians(lean), math.radians(3.0)))
    way = (math.cos(math.radians(towards)), math.sin(math.radians(towards)), 0.0)
    assert simulation.cut('thing/1', hinge=0.012, towards=way) == 1
    for _ in range(12):
        simulation.step(60)
        top = simulation.poses[-1, :3] - simulation.poses[0, :3]
        if top[2] < 1.0:
            break
    assert top[2] < 1.0
    off = math.degrees(math.atan2(top[1], top[0])) - towards
    assert abs((off + 180.0) % 360.0 - 180.0) < 8.0


def test_a_tree_that_leans_back_sits_on_its_stump():
    """Fell a pole against a lean beyond what a wedge turns: it stands, until it is pulled over."""
    simulation = _simulation(_lean(10, math.pi, math.radians(20.0)))
    simulation.cut('thing/1', hinge=0.03, towards=(1.0, 0.0, 0.0))
    simulation.step(480)
    assert simulation.bonds_broken == 0
    assert simulation.poses[-1, 2] > 4.0
    assert simulation.poses[-1, 0] < 0.0
    simulation.apply_wrench('thing/9', (400.0, 0.0, 0.0))
    simulation.step(240)
    assert simulation.poses[-1, 0] > 2.0


def test_what_is_left_of_a_joint_sags():
    """Saw a level branch from above to its middle: it sinks as its stiffness says, and holds."""
    simulation = _simulation(bush(strength=1e9))
    forest = simulation.state.forest
    axis = rotation.rotate(forest.poses[:, 3:], np.array([0.0, 0.0, 1.0]))
    size = forest.ends - np.arange(len(forest))
    row = int(np.flatnonzero((np.abs(axis[:, 2]) < 0.7) & (size > 3))[0])
    before, stiff = forest.poses[forest.ends[row] - 1, 2], forest.model.swing[row, 0]
    section = kerfed(np.array([0.5]))
    forest.begin_cuts(np.array([row]), np.array([[0.0, 0.0, -1.0]]))
    forest.saw(np.array([row]), section)
    assert forest.model.swing[row, 0] == pytest.approx(section.stiffness[0] * stiff)
    simulation.step(300)
    assert forest.poses[forest.ends[row] - 1, 2] < before
    assert simulation.bonds_broken == 0


def test_a_kerf_shuts_where_it_began():
    """Saw a mast deeper, from another side: its kerf keeps its side, and shuts as far."""
    simulation = _simulation(beam(10), intruder={
        'shape': 'box', 'size': [0.02, 0.6, 0.02], 'cuts': 0.5},
        wind={'velocity': [9.0, 0.0, 0.0]})
    swing = simulation.state.forest.model.swing
    for step in range(25):
        simulation.place_intruder([-0.075 + 0.1 * step / 60.0, 0, 2.4, 0, 0, 0, 1])
        simulation.step()
    row = int(np.flatnonzero(swing[:, SIDE])[0])
    first, deep = swing[row, [WEAK_X, WEAK_Y, FLOOR]].copy(), sum(simulation.state.kerfs.values())
    turned = [0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]
    for step in range(30):
        place = simulation.poses[4, :2] + [0.0, -0.075 + 0.1 * step / 60.0]
        simulation.place_intruder([*place, 2.4, *turned])
        simulation.step()
    assert sum(simulation.state.kerfs.values()) > deep
    assert swing[row, [WEAK_X, WEAK_Y, FLOOR]] == pytest.approx(first, abs=1e-12)


def test_a_saw_that_slows_down_presses_no_longer():
    """Press a saw fast against a wall, and saw on slowly: the wall is free of its push."""
    simulation = _simulation(wall(9, 14), intruder={
        'shape': 'box', 'size': [0.3, 0.3, 0.3], 'cuts': 0.02})
    y, pressed = -0.2025, False
    for speed in (*np.full(5, 0.04), *np.full(20, 0.01)):
        simulation.place_intruder([1.0, y, 0.55, 0.0, 0.0, 0.0, 1.0])
        y += speed / 60.0
        simulation.step()
        pressed |= 'intruder intruder' in simulation.state.loads.sources
    assert pressed
    assert 'intruder intruder' not in simulation.state.loads.sources


def test_a_saw_goes_through_a_branch():
    """Move a blade slowly through a beam: it pushes nothing, and the top comes down."""
    simulation = _simulation(beam(10), intruder={
        'shape': 'box', 'size': [0.02, 0.6, 0.02], 'cuts': 0.5})
    pushed = 0.0
    for step in range(120):
        simulation.place_intruder([-0.2 + 0.2 * step / 60.0, 0.0, 2.4, 0.0, 0.0, 0.0, 1.0])
        simulation.step()
        pushed = max(pushed, np.abs(simulation.wrench_on_intruder('intruder')).max())
        if simulation.bonds_broken:
            break
    depth = max(simulation.state.kerfs.values())
    assert 0.5 * 2.0 * RADIUS < depth <= 2.0 * RADIUS + 0.01
    events = simulation.log.take()
    assert simulation.bonds_broken == 1 and pushed == 0.0
    assert events['cause'][0] in (Cause.CUT, Cause.BENDING, Cause.UPROOTING)


def test_a_saw_takes_bricks_out_and_a_fast_one_pushes():
    """Move a blade through a wall: what it saws through loses its bonds by the cause CUT."""
    plan = wall(9, 14)
    for speed, cuts in ((0.1, 0.2), (2.0, 0.2)):
        simulation = _simulation(plan, intruder={
            'shape': 'box', 'size': [0.02, 0.3, 0.02], 'cuts': cuts})
        for step in range(round(0.6 / speed * 60.0)):
            simulation.place_intruder([1.0, -0.3 + speed * step / 60.0, 0.55, 0.0, 0.0, 0.0, 1.0])
            simulation.step()
        first = simulation.log.take()['cause'][0]
        out = int((simulation.state.parts.owner != Owner.STANDING).sum())
        assert out > 0
        assert (first == Cause.CUT) == (speed < cuts)


def test_saws_and_wedges_are_saved():
    """Save and fork in the middle of a felling cut: all go on to the bit."""
    simulation = _simulation(_lean(10, 0.0, 0.02), intruder={
        'shape': 'box', 'size': [0.02, 0.6, 0.02], 'cuts': 0.5})
    simulation.cut('thing/1', hinge=0.012, towards=(1.0, 0.0, 0.0))
    simulation.step(60)
    assert simulation.state.wedges
    data, other = simulation.save(), simulation.fork()
    for run in (simulation, other):
        run.step(120)
    assert np.array_equal(simulation.poses, other.poses)
    poses = simulation.poses.copy()
    simulation.restore(data)
    simulation.step(120)
    assert np.array_equal(simulation.poses, poses)


@pytest.mark.parametrize('cut,told', [
    ({'hinge': 0.02}, 'cut.towards'), ({'hinge': 0.02, 'towards': (0.0, 0.0, 1.0)}, 'level'),
    ({'hinge': 0.5, 'towards': (1.0, 0.0, 0.0)}, 'cut.hinge is 0.5 m'),
    ({'hinge': -1.0}, 'cut.hinge')])
def test_hinges_that_cannot_be_are_refused(cut, told):
    """Name the key and what it may be."""
    simulation = _simulation(beam(10))
    with pytest.raises(CommandError, match=told):
        simulation.cut('thing/1', **cut)
    with pytest.raises(SceneError, match='intruders.cuts'):
        IntrudersSettings(('saw', 'arm'), ('sphere 0.1', 'sphere 0.2'), (0.1,))
    walled = _simulation(wall(4, 5))
    with pytest.raises(CommandError, match='for trees'):
        walled.cut('thing/0', hinge=0.01, towards=(1.0, 0.0, 0.0))
