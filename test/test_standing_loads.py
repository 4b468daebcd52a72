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

"""Loads on standing walls: their own, lasting and sudden ones, on parts, and told at load."""

from dataclasses import replace
import logging

from grown_trees import beam
from masonry_walls import bonded, wall
import numpy as np
import pytest

from procphys_ros.blueprint import GROUND
from procphys_ros.physics.masonry.contact_forces import PieceBlow
from procphys_ros.physics.masonry.standing_loads import StandingLoads
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.culling import CullingSettings
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Cause, impacts, Owner, Simulation
from procphys_ros.simulation.readings import describe_load, load_of
from procphys_ros.simulation.wall_loads import DEBRIS_LAYER
from procphys_ros.wallgrammar import WallGrammar

_DT = 1.0 / 60.0


class Slow:
    """Take loads as a stress solver does that is not done with them for a while."""

    def __init__(self):
        self.given: list[np.ndarray] = []

    def set_loads(self, force: np.ndarray, moment: np.ndarray) -> None:
        self.given.append(np.hstack([force, moment]))


def push(force: float) -> np.ndarray:
    """Return one wrench along z."""
    return np.array([[0.0, 0.0, force, 0.0, 0.0, 0.0]])


def test_loads_that_jitter_wait_until_earlier_ones_are_judged():
    """Hand over what changes within a moment, then nothing before the judgement."""
    solver = Slow()
    loads = StandingLoads(3)
    for i in range(60):
        loads.set_layer('debris', np.array([1]), push(100.0 + i))
        loads.apply(solver, i * _DT)
    assert 1 < len(solver.given) <= 7
    loads.end_blows()
    loads.apply(solver, 1.0)
    assert solver.given[-1][1, 2] == pytest.approx(159.0)
    count = len(solver.given)
    loads.end_blows()
    loads.apply(solver, 1.0 + _DT)
    assert len(solver.given) == count  # and nothing while nothing changes


def test_blows_end_when_they_have_been_judged_and_those_in_between_are_kept():
    """Judge each blow once, on top of what lasts; one after the other on a part do not add up."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.set_layer('wind', np.array([0, 1]), np.repeat(push(-5.0), 2, axis=0))
    loads.add_blow(np.array([1]), push(1000.0), 10.0)
    loads.add_blow(np.array([1]), push(500.0), 10.0)  # at the same time
    loads.apply(solver, 0.0)
    assert solver.given[-1][:, 2] == pytest.approx([-5.0, 1495.0, 0.0])
    for i in range(30, 60):
        loads.add_blow(np.array([2]), push(200.0 + i), 10.0)
        loads.apply(solver, i * _DT)
    assert len(solver.given) == 1
    loads.end_blows()
    loads.apply(solver, 1.0)
    assert solver.given[-1][:, 2] == pytest.approx([-5.0, -5.0, 259.0])
    loads.end_blows()
    loads.apply(solver, 1.0 + _DT)
    assert solver.given[-1][:, 2] == pytest.approx([-5.0, -5.0, 0.0])


def test_a_blow_is_as_hard_however_long_it_waits():
    """Judge a blow after seconds as if it had just come: how fast stresses are found is no law."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.add_blow(np.array([0]), push(1000.0), 10.0)
    loads.apply(solver, 0.0)
    loads.add_blow(np.array([1]), push(1000.0), 10.0, np.array([[0.0, 0.0, 7.0]]))
    for i in range(30, 210):
        loads.apply(solver, i * _DT)
    loads.end_blows()
    loads.apply(solver, 3.5)
    assert solver.given[-1][:, 2] == pytest.approx([0.0, 1000.0, 0.0])
    assert loads.impulses_on(np.array([1]))[0, 2] == pytest.approx(7.0)


def test_cracks_run_for_three_rounds_under_a_blow_however_long_these_take():
    """Count what fails in rounds, anew for every blow that joins."""
    solver = Slow()
    loads = StandingLoads(2)
    loads.add_blow(np.array([0]), push(1000.0), 10.0)
    loads.apply(solver, 0.0)
    for i in range(1, 6):
        for k in range(30 * i):
            loads.apply(solver, (30 * i + k) * _DT)
        assert loads.struck and loads.cracked == (i > 3), i
        loads.take_more(True)
    loads.add_blow(np.array([1]), push(1000.0), 10.0)
    loads.apply(solver, 10.0)
    assert loads.struck and not loads.cracked and loads.largest_blow == 1000.0
    loads.end_blows()
    loads.apply(solver, 11.0)
    assert not loads.struck and not solver.given[-1].any()


def test_what_leaves_a_wall_has_passed_its_blow_on():
    """Return the impulse of all blows on parts that leave, and apply it to no other part."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.add_blow(np.array([0, 1]), np.repeat(push(100.0), 2, axis=0), 10.0,
                   np.array([0.0, 0.0, 3.0]))
    loads.apply(solver, 0.0)
    loads.add_blow(np.array([1, 2]), np.repeat(push(50.0), 2, axis=0), 10.0,
                   np.array([0.0, 0.0, 2.0]))
    assert loads.take_blows(np.array([1])) == pytest.approx([0.0, 0.0, 5.0])
    assert loads.take_blows(np.array([1])) == pytest.approx(np.zeros(3))
    loads.end_blows()
    loads.apply(solver, _DT)
    assert solver.given[-1][:, 2] == pytest.approx([0.0, 0.0, 50.0])


def test_the_speed_of_what_strikes_is_known_while_its_blow_acts_or_waits():
    """Return that of the fastest on any of some parts, until all blows are over."""
    solver = Slow()
    loads = StandingLoads(3)
    loads.add_blow(np.array([0, 1]), np.repeat(push(100.0), 2, axis=0), np.array([4.0, 7.0]))
    loads.apply(solver, 0.0)
    loads.add_blow(np.array([1]), push(50.0), 5.0)
    assert [loads.striking_speed(np.array(parts)) for parts in ([0], [0, 1], [2])] == [4, 7, 0]
    loads.end_blows()
    loads.apply(solver, _DT)
    assert loads.striking_speed(np.array([1])) == 7.0
    loads.end_blows()
    loads.resize(5)
    assert loads.striking_speed(np.arange(5)) == 0.0


def test_small_changes_of_steady_loads_ask_for_no_new_stresses():
    """Tell the solver of a change beyond a twentieth of the load, of its rest, and of its end."""
    solver, loads = Slow(), StandingLoads(3)
    told = []
    for step, force in enumerate((10e3, 10.3e3, 10.4e3, 11e3, 10.5e3, 10.5e3)):
        loads.follow('debris', np.array([1]), np.array([[0.0, 0.0, -force, 0.0, 0.0, 0.0]]))
        loads.apply(solver, float(step))
        loads.end_blows()
        told.append(-solver.given[-1][1, 2])
    assert told == [10e3, 10e3, 10e3, 11e3, 11e3, 10.5e3]
    loads.follow('debris', np.zeros(0, np.intp), np.zeros((0, 6)))
    loads.apply(solver, 9.0)
    assert not solver.given[-1].any() and loads.sources == ()


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
    """Lay 16 t or 0.3 t on teeth: F at e from the bed joint bends it by 6·F·e/(A·h), A = h·b."""
    # With half of 16 t these are 5.9 MPa, with 0.3 t 0.11 MPa; the joint at the end takes a part.
    # The yoke ties loose teeth together by friction, so they are not bound to fall.
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


GRAVITY = 9.81
STRENGTH = 40e6  # [Pa]


@pytest.fixture(scope='module')
def simulation():
    """Stand a beam and a pier of bricks up, and let a ball lie beside them."""
    scene = Scene()
    scene.add(beam(strength=STRENGTH), name='beam')
    scene.add(wall(2, 9), (9.0, 0.0, 0.0), name='pier')
    made = Simulation(scene)
    made.launch(Projectile(size=0.4, position=(-20.0, 0.0, 0.2), velocity=(0.0, 0.0, 0.0)))
    made.step(30)
    return made


def test_a_bent_trunk_is_loaded_by_the_stress_in_its_fibres(simulation):
    """Push a cantilever aside at its tip: the moment at the foot is force times height."""
    pushed = simulation.fork()
    pushed.apply_wrench(9, (30.0, 0.0, 0.0))
    pushed.step(500)
    foot = load_of(pushed.state, 0)
    arm = pushed.poses[9, 2]
    sag = pushed.poses[:10, 0] @ (GRAVITY * pushed.blueprint.mass[:10])
    np.testing.assert_allclose(foot.moment, 30.0 * arm + sag, rtol=0.03)
    width = pushed.blueprint.bond_extent[0, 0]
    np.testing.assert_allclose(foot.share, foot.moment / (np.pi / 32.0 * width ** 3) / STRENGTH,
                               rtol=1e-3)


def test_a_trunk_may_be_nearest_to_being_uprooted():
    """Push a tree whose root plate gives way long before its wood: the share is that of it."""
    grown = beam(strength=STRENGTH)
    moment = 0.2 * STRENGTH * np.pi / 32.0 * grown.bond_extent[0, 0] ** 3
    root = np.where(grown.bonds[:, 0] == GROUND, moment, np.inf)
    scene = Scene()
    scene.add(replace(grown, hinges=replace(grown.hinges, root_moment=root)), name='tree')
    simulation = Simulation(scene)
    simulation.apply_wrench(9, (30.0, 0.0, 0.0))
    simulation.step(300)
    foot = load_of(simulation.state, 0)
    np.testing.assert_allclose(foot.share, foot.moment / moment, rtol=1e-3)
    assert load_of(simulation.state, 1).share < 0.3 * foot.share


def test_a_tree_that_joins_has_no_load_before_its_first_step(simulation):
    """Say nothing of a new tree, not that it carries nothing, while others go on."""
    grown = simulation.fork()
    late = grown.add(beam(), (30.0, 0.0, 0.0), name='late')
    assert np.isnan(grown.loads()[late.first:]).all()
    assert np.isfinite(grown.loads()[:late.first]).all()
    grown.step()
    weight = GRAVITY * grown.blueprint.mass[late.first:].sum()
    np.testing.assert_allclose(grown.load(late.first).force, weight, rtol=1e-9)


def test_a_branch_that_came_off_has_no_load_at_its_base():
    """Break the foot of a beam, which goes on as a flexible branch: nothing holds it there."""
    grown = beam()
    strength = np.where(grown.bonds[:, 0] == GROUND, 0.1 * STRENGTH, np.inf)
    scene = Scene()
    scene.add(replace(grown, hinges=replace(grown.hinges, strength=strength)), name='beam')
    broken = Simulation(scene)
    broken.apply_impulse(9, (400.0, 0.0, 0.0))
    while not broken.bonds_broken:
        broken.step()
    assert broken.state.parts.owner[0] == Owner.TREE
    assert broken.load(0).force == broken.load(0).share == 0.0 < broken.load(1).force


def test_a_sleeping_tree_carries_its_weight():
    """Let a beam fall asleep: it is stepped no more, and stands on its foot as before."""
    scene = Scene(Settings(culling=CullingSettings(sleeping=True)))
    scene.add(beam(strength=STRENGTH), name='beam')
    resting = Simulation(scene)
    resting.set_wind_enabled(False)
    resting.step(200)
    assert resting.state.trees.lod.asleep.all()
    np.testing.assert_allclose(resting.load(0).force, GRAVITY * resting.blueprint.mass.sum(),
                               rtol=1e-6)


def test_loads_are_said_in_one_line(simulation):
    """Say what carries what, and what lies loose."""
    assert describe_load(simulation.state, 0).startswith('beam/segment_0 carries ')
    ball = len(simulation.poses) - 1
    assert 'is loose' in describe_load(simulation.state, ball)
    assert load_of(simulation.state, ball).force == 0.0
