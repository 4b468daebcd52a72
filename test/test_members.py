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

"""Members: beams that break inside, reinforced ones that hang on, tiles that a nail holds."""

from dataclasses import replace

from masonry_walls import blueprint
import numpy as np
import pytest

from procphys_ros.blueprint import chain, GROUND
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.masonry import BondGraph, Fracture, FreeBodies, StressSolver
from procphys_ros.physics.masonry.ties import CRACKED, LEVER
from procphys_ros.scene import Scene
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import breaking, fragments, Simulation
from procphys_ros.wallgrammar import WallGrammar
from procphys_ros.wallgrammar.materials import DEFAULTS

SPAN, WIDTH, DEPTH = 1.2, 0.1, 0.15  # [m]
AREA = WIDTH * DEPTH
_HALF = [[-0.25 * SPAN, 0.0, 1.0], [0.25 * SPAN, 0.0, 1.0]]
_ALONG = [0.0, 0.5 ** 0.5, 0.0, 0.5 ** 0.5]  # z of the bond frame along x: its y is the world's y
_UP = [0.0, 0.0, 0.0, 1.0]
_KNIFE = 0.002  # [m] width of the supports, which stand at mid-depth, so that nothing arches

_HUT = """
building hut
  footprint: (0, 0) (3, 0) (3, 2.4) (0, 2.4)
  facades: front wall
  storey_height: 2.4
  floors: {floors}
  roof: {roof}
rule front -> split(x) {{ ~1: wall | 0.9: opening | ~1: wall }}
rule opening -> split(y) {{ 1.95: gap | 0.225: lintel | ~1: wall }}
layout running {{ unit: 0.215 0.1025 0.065  joint: 0.01  material: brick }}
panel wall: running
panel gap: none
panel lintel: beam({lintel})
"""


def hut(lintel='concrete', floors='none', roof='none'):
    """Build a hut with an opening of 0.9 m; return it and the kinds of both sides of each bond."""
    plan = WallGrammar.parse(_HUT.format(lintel=lintel, floors=floors, roof=roof)).build()
    kinds = np.array((*plan.kinds, 'ground'))
    return plan, kinds[np.where(plan.bonds == GROUND, -1, plan.kind[plan.bonds])]


def between(pairs, *kinds):
    """Find the bonds between parts of two kinds."""
    return np.flatnonzero((np.sort(pairs, axis=1) == sorted(kinds)).all(axis=1))


def beam(material, reinforcement=None):
    """Lay a beam of two pieces on knife edges."""
    made = DEFAULTS[material]
    plan = blueprint(
        _HALF, np.tile([0.5 * SPAN, WIDTH, DEPTH], (2, 1)), [[0, 1], [GROUND, 0], [GROUND, 1]],
        [[0.0, 0.0, 1.0, *_ALONG], [-0.5 * SPAN, 0.0, 1.0, *_UP], [0.5 * SPAN, 0.0, 1.0, *_UP]],
        [[DEPTH, WIDTH], [_KNIFE, WIDTH], [_KNIFE, WIDTH]], made.density)
    columns = {name: np.array([getattr(made, name), 1e9, 1e9])
               for name in ('tension', 'cohesion', 'compression')}
    steel = made.reinforcement if reinforcement is None else reinforcement
    return replace(plan, mortar=replace(plan.mortar, **columns,
                                        reinforcement=np.array([steel, 0.0, 0.0])))


def in_pieces(lengths, fixed=False):
    """
    Lay a reinforced beam, of pieces that are so long [m], on knife edges at its ends.

    :param fixed: whether it is built in at its first end instead.
    """
    concrete = DEFAULTS['concrete']
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    count = len(lengths)
    between = [[x, 0.0, 1.0, *_ALONG] for x in ends[1:-1]]
    first = [0.0, 0.0, 1.0, *(_ALONG if fixed else _UP)]
    plan = blueprint(
        [[x, 0.0, 1.0] for x in 0.5 * (ends[1:] + ends[:-1])],
        [[length, WIDTH, DEPTH] for length in lengths],
        [*([i, i + 1] for i in range(count - 1)), [GROUND, 0], [GROUND, count - 1]],
        [*between, first, [ends[-1], 0.0, 1.0, *_UP]],
        [*([[DEPTH, WIDTH]] * (count - 1)), [DEPTH if fixed else _KNIFE, WIDTH], [_KNIFE, WIDTH]],
        concrete.density)
    inside = np.arange(len(plan.bonds)) < count - 1
    columns = {name: np.where(inside, getattr(concrete, name), 1e9)
               for name in ('tension', 'cohesion', 'compression')}
    steel = np.where(inside, concrete.reinforcement, 0.0)
    return replace(plan, mortar=replace(plan.mortar, **columns, reinforcement=steel))


def loaded(plan, moment):
    """Load a beam evenly, by a moment w·l²/8; return the fracture, and what fails."""
    fracture = Fracture(StressSolver(BondGraph(plan), gravity=(0.0, 0.0, 0.0), tolerance=1e-3))
    return fracture, load(fracture, moment)


def load(fracture, moment):
    """Replace the load of a beam; return rows and whether they broke of what fails."""
    force = np.zeros((2, 3))
    force[:, 2] = -0.5 * SPAN * 8.0 * moment / SPAN ** 2
    fracture.solver.set_loads(force)
    rounds = fracture.advance(5000)
    assert fracture.stable
    return [(int(bond), bool(broken)) for r in rounds for bond, broken in zip(r.bond, r.broken)]


@pytest.mark.parametrize('material', ['timber', 'tile'])
def test_a_beam_breaks_at_its_bending_strength(material):
    """Compare with w·l²/8 = f_t·b·h²/6; the halves fall."""
    limit = DEFAULTS[material].tension * WIDTH * DEPTH ** 2 / 6.0
    fracture, failed = loaded(beam(material), 0.97 * limit)
    assert failed == [] and fracture.solver.supported.all()
    assert (0, True) in load(fracture, 1.03 * limit)
    assert not fracture.solver.supported.any()


def test_a_reinforced_beam_cracks_and_hangs_on_until_its_steel_tears():
    """Crack at f_t·b·h²/6, hang on up to M = A_s·f_y·z, fall beyond; without steel, at once."""
    concrete = DEFAULTS['concrete']
    cracking = concrete.tension * WIDTH * DEPTH ** 2 / 6.0
    yielding = concrete.reinforcement * AREA * LEVER * DEPTH
    assert yielding > 1.5 * cracking
    fracture, failed = loaded(beam('concrete'), 0.97 * cracking)
    assert failed == []
    assert load(fracture, 1.03 * cracking) == [(0, False)]
    graph = fracture.solver.graph
    sag = -fracture.solver.displacement[:2, 2]
    assert fracture.solver.supported.all() and graph.has_cracked(np.array([0]))
    assert load(fracture, 0.97 * yielding) == []
    ratio = 0.97 * yielding / (1.03 * cracking)
    np.testing.assert_allclose(-fracture.solver.displacement[:2, 2], ratio * sag, rtol=0.01)
    assert (0, True) in load(fracture, 1.03 * yielding)
    assert not fracture.solver.supported.any()
    bare, failed = loaded(beam('concrete', 0.0), 1.03 * cracking)
    assert (0, True) in failed and not bare.solver.supported.any()


def evenly(solver, lengths, load):
    """Load each piece by so much per length [N/m], downwards."""
    force = np.zeros((len(lengths), 3))
    force[:, 2] = -load * np.asarray(lengths)
    solver.set_loads(force)


@pytest.mark.parametrize('lengths', [(0.4, 0.4, 0.4), (0.3, 0.5, 0.4), (0.24,) * 5,
                                     (0.1, 0.9, 0.2)], ids=str)
def test_a_beam_of_any_pieces_cracks_at_its_largest_moment(lengths):
    """Compare with w·l²/8 = f_t·b·h²/6 within 2 %, where no joint is in the middle."""
    cracking = DEFAULTS['concrete'].tension * WIDTH * DEPTH ** 2 / 6.0
    fracture = Fracture(StressSolver(BondGraph(in_pieces(lengths)), gravity=(0.0, 0.0, 0.0),
                                     tolerance=1e-3))
    for ratio in (0.98, 1.02):
        evenly(fracture.solver, lengths, 8.0 * ratio * cracking / SPAN ** 2)
        rounds = fracture.advance(5000)
        assert fracture.stable and bool(rounds) == (ratio > 1.0)
    assert not any(r.broken.any() for r in rounds)


def test_a_continuous_beam_is_judged_where_its_shear_changes_sign():
    """Compare the span of a propped cantilever with R²/(2·w), R the reaction of the prop."""
    lengths = (0.3, 0.3, 0.45, 0.15)
    solver = StressSolver(BondGraph(in_pieces(lengths, fixed=True)), gravity=(0.0, 0.0, 0.0),
                          tolerance=1e-6)
    load = 2000.0
    evenly(solver, lengths, load)
    solver.iterate(5000)
    reaction = -solver.wrenches(np.array([4]))[0, 2]
    assert 0.3 * load * SPAN < reaction < 0.45 * load * SPAN
    assert sum(lengths[:2]) < SPAN - reaction / load < sum(lengths[:3])
    concrete = DEFAULTS['concrete']
    share = solver.utilisation()[0][1:3].max()
    moment = share * concrete.tension * WIDTH * DEPTH ** 2 / 6.0
    assert moment == pytest.approx(reaction ** 2 / (2.0 * load), rel=0.01)


def test_a_crack_softens_a_reinforced_beam():
    """Compare the rotation between the halves before and after the crack."""
    cracking = DEFAULTS['concrete'].tension * WIDTH * DEPTH ** 2 / 6.0
    fracture, _ = loaded(beam('concrete'), 0.5 * cracking)
    whole = np.diff(fracture.solver.displacement[:2, 4])
    load(fracture, 1.03 * cracking)
    load(fracture, 0.5 * cracking)
    np.testing.assert_allclose(np.diff(fracture.solver.displacement[:2, 4]), whole / CRACKED,
                               rtol=0.01)
    fracture.solver.reset()
    assert not fracture.solver.graph.has_cracked(np.arange(3)).any()


def test_steel_that_yields_passes_its_load_on():
    """Yield in one span of three: the other two take the rest, and the middle one hangs on."""
    # Three beams of equal stiffness share a load through a stiff block on them; the steel of the
    # middle one holds half of the moment that the others' holds.
    names = ('bonds', 'bond_frame', 'bond_extent', 'bond_area')
    parts = [beam('concrete', s).placed([0.0, y, 0.0])
             for s, y in ((2.5e6, -0.2), (1.0e6, 0.0), (2.5e6, 0.2))]
    block = blueprint([[0.0, 0.0, 1.5]], [[0.2, 0.6, 0.2]], [[0, 0]], [[0, 0, 0, *_UP]],
                      [[0.1, 0.1]])
    block = replace(block, bond_law=block.bond_law[:0], mortar=block.mortar.take(slice(0, 0)),
                    **{name: getattr(block, name)[:0] for name in names})
    plan = chain([*parts, block])
    posts = np.array([[i, 6] for i in range(6)])
    more = blueprint(plan.poses[:, :3], plan.size, posts, np.column_stack(
        [np.tile([[-0.25 * SPAN], [0.25 * SPAN]], (3, 1)), np.repeat([-0.2, 0.0, 0.2], 2),
         np.full(6, 1.1), np.tile(_UP, (6, 1))]), np.full((6, 2), _KNIFE), tension=1e12,
        cohesion=1e12, compression=1e12, normal=1e13, shear=1e6)
    plan = replace(plan, bonds=np.vstack([plan.bonds, more.bonds]), bond_law=np.append(
        plan.bond_law, more.bond_law), **{name: np.concatenate([getattr(plan, name), getattr(
            more, name)]) for name in names[1:]}, mortar=chain([plan, more]).mortar)
    fracture = Fracture(StressSolver(BondGraph(plan), gravity=(0.0, 0.0, 0.0), tolerance=1e-2))
    weakest = 1.0e6 * AREA * LEVER * DEPTH
    force = np.zeros((7, 3))
    for ratio in (0.9, 1.4):
        force[6, 2] = -3.0 * 8.0 * ratio * weakest / SPAN
        fracture.solver.set_loads(force)
        fracture.advance(20_000)
        assert fracture.stable and fracture.solver.supported.all()
        moments = np.abs(fracture.solver.wrenches(np.array([0, 3, 6]))[:, 3:5]).max(axis=1)
        if ratio < 1.0:
            np.testing.assert_allclose(moments, ratio * weakest, rtol=0.05)
    assert 0.45 * weakest < moments[1] <= 1.0 * weakest
    assert moments[0] == pytest.approx(moments[2], rel=0.01)
    assert moments.sum() == pytest.approx(3.0 * 1.4 * weakest, rel=0.03)


def test_what_flies_hangs_together_by_its_steel():
    """Strike beams in their middle: reinforced ones take more by 6·z/h·s over f_t."""
    concrete = DEFAULTS['concrete']
    least = []
    for steel in (0.0, concrete.reinforcement):
        free = FreeBodies(beam('concrete', steel))
        parts = np.arange(2)
        low, high = 0.0, 1e7
        for _ in range(30):
            push = 0.5 * (low + high)
            free.reset()
            free.graph.cut(np.array([1, 2]))
            wrenches = np.zeros((2, 6))
            wrenches[:, 4] = push, -push
            broke = len(free.strike(parts, wrenches, 2).bonds)
            low, high = (low, push) if broke else (push, high)
        least.append(high)
    assert least[1] / least[0] == pytest.approx(
        6.0 * LEVER * concrete.reinforcement / concrete.tension, rel=0.01)


@pytest.mark.parametrize('ball, speed, hangs', [(10.0, 10.0, True), (20.0, 20.0, False)])
def test_halves_of_a_lintel_that_breaks_in_flight_hang_by_its_steel(ball, speed, hangs):
    """Hit it in its middle: the concrete breaks; the steel tears if the blow is hard enough."""
    simulation = Simulation(Scene.from_parameters({
        'scene': {'objects': ['hut']}, 'engine': 'native',
        'hut': {'grammar_text': _HUT.format(lintel='concrete', floors='none', roof='none')}}))
    model, state = simulation.model, simulation.state
    parts = np.flatnonzero(model.blueprint.kind == model.blueprint.kinds.index('lintel'))
    breaking.release(model, state, [parts], cause=Cause.IMPACT)
    body = state.parts.body[parts[:1]]
    state.world.set_poses(body, np.array([[8.0, 0.0, 6.0, *state.world.poses(body)[0, 3:]]]))
    fragments.write_poses(model, state, 0.0)
    simulation.launch(Projectile('sphere', (0.2,), ball, (8.0, -1.0, 6.0), (0.0, speed, 0.0)))
    simulation.step(30)
    assert len(set(state.parts.body[parts])) == 2
    assert state.world.joints.broken.tolist() == [not hangs]
    apart = np.linalg.norm(np.diff(state.parts.poses[parts, :3], axis=0))
    assert (apart < 0.6) == hangs


@pytest.mark.parametrize(('material', 'steel'), [('concrete', True), ('oak', False)])
def test_short_lintels_can_break_in_the_middle(material, steel):
    """Find the joint inside a lintel over 0.9 m, in its middle, with the strength of its stuff."""
    plan, pairs = hut(material)
    inner = between(pairs, 'lintel', 'lintel')
    lintel = plan.poses[plan.kind == plan.kinds.index('lintel'), 0]
    assert len(lintel) == 2 and len(inner) == 1
    assert plan.bond_frame[inner[0], 0] == pytest.approx(lintel.mean())
    assert plan.mortar.tension[inner] == DEFAULTS[material].tension
    assert plan.mortar.reinforcement[inner] == DEFAULTS[material].reinforcement
    assert (DEFAULTS[material].reinforcement > 0.0) == steel
    assert not np.delete(plan.mortar.reinforcement, inner).any()


def test_slabs_and_rafters_can_break_in_the_middle():
    """Find joints across the middle of a slab both ways, and of each rafter."""
    plan, pairs = hut(floors='slab(0.15)', roof='gable(40)')
    slab = plan.bond_frame[between(pairs, 'slab', 'slab'), :2]
    for axis, middle in ((0, 1.5), (1, 1.2)):
        assert np.isclose(slab[:, axis], middle, atol=1e-3).any()
    assert (plan.mortar.reinforcement[between(pairs, 'slab', 'slab')] > 0.0).all()
    rafters = np.count_nonzero(plan.kind == plan.kinds.index('rafter'))
    assert len(between(pairs, 'rafter', 'rafter')) >= rafters / 2


def test_a_nail_holds_a_tile_as_tables_say():
    """Pull a tile off its roof: it holds more than 0.2 kN, and less than 0.9 kN."""
    # A nail of 3.1 mm that is driven 40 mm into C24 holds 20e-6·350²·3.1·40 N (EN 1995-1-1 8.23,
    # 8.25), and there is one at either batten.
    plan, pairs = hut(roof='gable(40)')
    nails = between(pairs, 'batten', 'tile')
    hold = plan.mortar.tension[nails] * plan.bond_area[nails]
    assert np.median(hold) == pytest.approx(20e-6 * 350.0 ** 2 * 3.1 * 40.0, rel=0.02)
    assert hold.max() < 1.02 * np.median(hold)
    tiles = np.flatnonzero(plan.kind == plan.kinds.index('tile'))
    middle = plan.poses[tiles, :3].mean(axis=0) + [0.0, 0.6, 0.0]
    tile = tiles[np.argmin(np.linalg.norm(plan.poses[tiles, :3] - middle, axis=1))]
    normal = np.array([0.0, np.sin(np.radians(40.0)), np.cos(np.radians(40.0))])
    fracture = Fracture(StressSolver(BondGraph(plan)))
    assert fracture.advance(5000) == [] and fracture.stable
    for pull, holds in ((200.0, True), (900.0, False)):
        force = np.zeros((len(plan), 3))
        force[tile] = pull * normal
        fracture.solver.set_loads(force)
        fracture.advance(5000)
        assert fracture.stable and fracture.solver.supported[tile] == holds
    assert fracture.solver.supported.sum() > len(plan) - 8
