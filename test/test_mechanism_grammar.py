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
"""Grammars of mechanisms: what they write, what is refused, and what the shipped ones do."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from procphys_ros.blueprint import GROUND, JointType, Shape
from procphys_ros.errors import GrammarError
from procphys_ros.files.resources import shared_folder
from procphys_ros.mechanism import MechanismGrammar
from procphys_ros.physics.air import AIR_DENSITY, PLATE_DRAG
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.wind import WindSettings
from procphys_ros.scene import Scene, Settings
from procphys_ros.scene.sources import load_grammar, parse_grammar
from procphys_ros.scene.strikes import Projectile
from procphys_ros.simulation import Simulation

SHIPPED = sorted(path.name for path in (shared_folder() / 'grammars').glob('*.mech'))


def build(body, rules='', seed=0, **defines):
    """Build the mechanism of some statements and rules."""
    return MechanismGrammar.parse(f'mechanism m {{ {body} }} {rules}').build(seed, **defines)


def test_kinds_of_parts_have_their_mass_and_inertia():
    """Compare with the closed forms of solids."""
    made = build("""box a { size: 1, 2, 3  material: oak }
        plate b { size: 1, 0.1, 2  at: 5, 0, 0  material: oak  area: 1.5 }
        rod c { from: 0, 0, 0  to: 0, 3, 4  diameter: 0.2  material: steel }
        ball d { diameter: 0.6  mass: 50 }
        wheel e { diameter: 1  width: 0.2  mass: 8 }""")
    np.testing.assert_allclose(made.mass, [640 * 6, 640 * 0.2, 7850 * np.pi * 0.01 * 5, 50, 8])
    np.testing.assert_allclose(made.inertia[0], 640 * 6 / 12 * np.array([13, 10, 5]))
    np.testing.assert_allclose(made.inertia[3], [0.4 * 50 * 0.09] * 3)
    across = 8 / 12 * (3 * 0.25 + 0.04)
    np.testing.assert_allclose(made.inertia[4], [across, across, 0.5 * 8 * 0.25])
    assert made.shape.tolist() == [Shape.BOX] * 2 + [Shape.CAPSULE] * 3
    assert made.balls.tolist() == [False, False, False, True, False]
    assert made.plates.part.tolist() == [1] and made.plates.normal.tolist() == [1]
    assert made.plates.area.tolist() == [1.5]
    np.testing.assert_allclose(made.poses[2, :3], [0, 1.5, 2])
    assert [made.kinds[k] for k in made.kind] == ['a', 'b', 'c', 'ball', 'e']


def test_joints_have_the_values_of_the_text():
    """Read every key, in SI units: angles become radians, slides and forces stay."""
    made = build("""box a { size: 1, 1, 1  at: 0, 0, 3 }
        box b { size: 1, 1, 1  at: 2, 0, 3
            hinge h { to: a  at: 1, 0, 3  axis: 0, 2, 0  limits: -90, 180  spring: 5, 30  damper: 2
                friction: 3  motor: 360, 40, 720  strength: 100, 20  collides: 1 }
            slider s { axis: 1, 0, 0  limits: -0.5, 0.5 }
            rope { to: ground  at: 2, 0, 3.5  end: 2, 0, 6  length: 3 }
            weld { to: a } }""")
    joints = made.joints
    assert [JointType(kind).name for kind in joints.kind] == ['HINGE', 'SLIDER', 'ROPE', 'WELD']
    assert joints.parts.tolist() == [[0, 1], [GROUND, 1], [GROUND, 1], [0, 1]]
    assert made.joint_names == ('h', 's', 'b_0', 'b_1')
    first = {name: column[0] for name, column in vars(joints).items() if column.ndim == 1}
    assert first == pytest.approx({
        'kind': 2, 'low': -np.pi / 2, 'high': np.pi, 'stiffness': 5, 'rest': np.pi / 6,
        'damping': 2, 'friction': 3, 'speed': 2 * np.pi,
        'fastest': 4 * np.pi, 'effort': 40, 'force': 100, 'moment': 20,
        'collides': True, 'name': 0, 'zero': 0})
    assert (joints.low[1], joints.high[1]) == (-0.5, 0.5)
    assert (joints.low[2], joints.high[2]) == (-np.inf, 3.0)
    assert np.isinf(joints.force[1:]).all() and np.isinf(joints.moment[1:]).all()
    np.testing.assert_allclose(np.linalg.norm(joints.anchor, axis=1), [0, 0, 2.5, 0])


def test_rules_have_frames_parents_and_parameters():
    """Turn and move what a rule writes, hang it on a part, and count a recursion down."""
    made = build('box base { size: 1, 1, 1 }  let tall = 2 '
                 'arm(tall) { at: 1, 0, 0  turn: 0, 0, 90  on: base }', """
        rule arm(n) : n > 0 -> { box a { size: 0.1, 0.1, 0.1  at: n, 0, 0  weld {} }
            arm(n - 1) { on: a } }
        rule arm(n) -> { box tip { size: 0.1, 0.1, 0.1  weld w { to: base } } }""")
    np.testing.assert_allclose(made.poses[:, :3], [[0, 0, 0], [1, 2, 0], [1, 1, 0], [1, 0, 0]],
                               atol=1e-12)
    assert made.joints.parts.tolist() == [[0, 1], [1, 2], [0, 3]]


def test_weights_and_random_numbers_follow_the_seed():
    """Draw the same mechanism from the same seed, others from others."""
    rules = """rule one -> { box { size: rand(0.1, 0.5), 0.1, 0.1 } } : 1
        rule one -> { ball { diameter: rand(0.1, 0.5) } } : 2"""
    found = [build('repeat k(20) { one() { at: k, 0, 0 } }', rules, seed) for seed in (0, 0, 1)]
    assert np.array_equal(found[0].mass, found[1].mass)
    assert not np.array_equal(found[0].mass, found[2].mass)
    assert 5 < found[0].balls.sum() < 20


def test_a_grammar_includes_rules_and_materials(tmp_path):
    """Take from another file what is not there itself."""
    (tmp_path / 'links.mech').write_text(
        'mechanism links { ball { diameter: 1 } } material lead { density: 11340 }'
        'rule link() -> { ball { diameter: 1  material: lead } }', 'utf-8')
    text = 'include "links.mech"\nmechanism m { link() }'
    made = MechanismGrammar.parse(text, folder=tmp_path).build()
    np.testing.assert_allclose(made.density, [11340.0])


@pytest.mark.parametrize('text, message', [
    ('rule a -> { }', 'a grammar holds exactly one mechanism, found 0'),
    ('mechanism m { }', 'the mechanism "m" has no parts'),
    ('mechanism m {\n bocks a { size: 1, 1, 1 } }', '2:2: unknown kind "bocks" of part; did you '
     'mean box? (parts: box, plate, rod, ball, wheel)'),
    ('mechanism m { box a { sise: 1, 1, 1 } }', '1:23: unknown key "sise" of a box; did you mean '
     'size, mass? (keys: size, at, turn, material, mass)'),
    ('mechanism m { box a { at: 1, 1, 1 } }', '1:15: a box needs "size:"'),
    ('mechanism m { box a { size: 1, 1 } }', '1:23: "size:" takes 3 numbers with commas between '
     'them, found 2'),
    ('mechanism m { box a { size: 1, 1, 0 } }', '1:23: size is 0, it must be from 0.001 to '
     '1000 m'),
    ('mechanism m { box a { size: 1, 1, 1 size: 1, 1, 1 } }', '"size" stands there twice'),
    ('mechanism m { box a { size: 1, 1, 1  material: wod } }', 'unknown material "wod"'),
    ('mechanism m { box a { size: 1, 1, 1  hing { } } }', 'unknown kind "hing" of joint; did you '
     'mean hinge? (joints: weld, hinge, slider, ball, rope)'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { limit: 0, 1 } } }', 'unknown key "limit" of a '
     'hinge; did you mean limits'),
    ('mechanism m { box a { size: 1, 1, 1  ball { axis: 0, 1, 0 } } }', 'unknown key "axis" of a '
     'ball joint'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { limits: 1, 0 } } }', 'limits are 1, 0: the '
     'first must not be above the second'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { axis: 0, 0, 0 } } }', 'the axis has no '
     'direction'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { motor: 1, -1 } } }', 'motor is 1, -1: its '
     'force or moment must be 0 or more'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { spring: -1 } } }', 'spring is -1: its '
     'stiffness must be 0 or more'),
    ('mechanism m { box post { size: 1, 1, 1 } box a { size: 1, 1, 1  hinge { to: pst } } }',
     'there is no part "pst" yet; did you mean post'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { to: a } } }', 'there is no part "a" yet'),
    ('mechanism m { box a { size: 1, 1, 1  rope { } } }', 'a rope needs "end:"'),
    ('mechanism m { box ground { size: 1, 1, 1 } }', '"ground" names no part'),
    ('mechanism m { rod a { from: 0, 0, 0  to: 0, 0, 0.1  diameter: 0.2 } }', 'a rod is at least '
     'as long as wide, this one is 0.1 m long'),
    ('mechanism m { chain(3) } rule chian(n) -> { }', 'unknown rule "chain"; did you mean chian'),
    ('mechanism m { a(3) } rule a -> { }', 'the rule "a" takes 0 arguments, found 1'),
    ('mechanism m { a() } rule a -> { a() }', 'rules are nested more than 1000 deep: "a" seems to '
     'apply itself without end'),
    ('mechanism m { a(1) } rule a(n) : n > 1 -> { }', 'no rule "a(1)" applies'),
    ('mechanism m { repeat k(2.5) { } }', 'repeat is 2.5, it must be a whole number'),
    ('mechanism m { repeat k(9999) { repeat j(9999) { repeat i(9999) { } } } }',
     'the mechanism takes more than 100000 statements; make it smaller'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { limits: 5, 20 } } }', 'limits are 5, 20: 0, '
     'where it is built, must not be beyond them'),
    ('mechanism m { box a { size: 1, 1, 1  rope { end: 0, 0, 4  length: 3.9 } } }', 'length is '
     '3.9, it must not be below the 4 m between its ends'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { collides: 0.5 } } }', 'collides is 0.5, it '
     'must be 0 or 1'),
    ('mechanism m { box a { size: 1, 1, 1  hinge { motor: 1e6, 1e9 } } }', 'the speed of a motor '
     'is 1e+06, it must be from -100000 to 100000'),
    ('mechanism m { a(1, 2) } rule a(n, n) -> { }', 'the parameter "n" is given twice'),
    ('mechanism m { box a { size: widht, 1, 1 } }', 'unknown name "widht"'),
    ('mechanism m(width = 1) { box a { size: widht, 1, 1 } }', 'did you mean width'),
    ('mechanism m { box a { size: 1 1, 1 } }', 'found "1", expected'),
    ('mechanism m { a() { size: 1, 1, 1 } } rule a -> { }', 'unknown key "size" of a rule (keys: '
     'at, turn, on)'),
    ('mechanism m { ball { diameter: 1 } } material x { tension: 1 }', 'the material "x" needs '
     'density'),
])
def test_errors_name_place_and_remedy(text, message):
    """Raise one error, with line and column, what is wrong and what is allowed."""
    with pytest.raises(GrammarError) as found:
        MechanismGrammar.parse(text, 'my.mech').build()
    assert str(found.value).startswith('my.mech:')
    assert message in str(found.value)


def test_the_language_of_a_text_is_found():
    """Know a mechanism given as a text, and a file by its ending."""
    found = parse_grammar('# a ball\nmechanism m { ball { diameter: 1 } }', 'a.grammar_text')
    assert isinstance(found, MechanismGrammar)
    assert isinstance(load_grammar('gate.mech', 'a.grammar'), MechanismGrammar)


def random_text(rng):
    """Write a mechanism of up to ten parts, each joined to some others at random."""
    def numbers(*values):
        return ', '.join(f'{value:.3f}' for value in values)

    def point():
        return numbers(*rng.uniform(-1.0, 1.0, 2), rng.uniform(1.0, 3.0))
    lines = []
    for k in range(rng.integers(2, 11)):
        kind = rng.choice(['box', 'plate', 'rod', 'ball', 'wheel'])
        a, b = rng.uniform(0.05, 0.4, 2)
        shape = {'box': f'size: {numbers(a, b, a)}  at: {point()}',
                 'plate': f'size: {numbers(a, 0.02, b)}  at: {point()}',
                 'rod': f'from: {point()}  to: {numbers(2.0, *rng.uniform(2, 4, 2))}'
                        f'  diameter: {0.1 * a:.3f}',
                 'ball': f'diameter: {a:.3f}  at: {point()}',
                 'wheel': f'diameter: {a:.3f}  width: {0.5 * a:.3f}  at: {point()}'}[kind]
        joints = ''
        for _ in range(rng.integers(1, 3)):
            to = rng.choice(['ground', *(f'p{i}' for i in range(k))])
            joint = rng.choice(['weld', 'hinge', 'slider', 'ball', 'rope'])
            more = {'rope': f'end: {point()}', 'hinge': f'axis: {numbers(1, *rng.random(2))}',
                    'slider': 'axis: 0, 0, 1  limits: -0.5, 0.5'}.get(joint, '')
            if joint in ('hinge', 'slider') and rng.random() < 0.5:
                more += rng.choice(['  spring: 200  damper: 2', '  motor: 50, 30',
                                    '  friction: 4'])
            if rng.random() < 0.3:
                more += f'  strength: {rng.uniform(10, 5000):.0f}'
            joints += f'\n    {joint} {{ to: {to}  {more} }}'
        lines.append(f'{kind} p{k} {{ {shape} {joints} }}')
    return 'mechanism m {\n' + '\n'.join(lines) + '\n}'


@pytest.mark.parametrize('seed', range(8))
def test_random_mechanisms_stay_finite_and_bounded(seed):
    """Run them for half a second: no number is lost, and nothing is thrown away."""
    text = random_text(np.random.default_rng(seed))
    scene = Scene()
    scene.add(MechanismGrammar.parse(text).build(), name='m')
    simulation = Simulation(scene)
    simulation.step(30)
    assert np.isfinite(simulation.poses).all() and np.isfinite(simulation.velocities).all(), text
    assert np.abs(simulation.velocities[:, :3]).max() < 50.0, text


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_mechanisms_stand_and_stay_finite(name):
    """Run each for a second with its defaults."""
    scene = Scene()
    scene.add(MechanismGrammar.load(name).build(), name='m')
    simulation = Simulation(scene)
    simulation.step(60)
    assert np.isfinite(simulation.poses).all()
    assert not len(simulation.events) and not simulation.warnings


G = 9.81


def simulate(name, wind=0.0, **defines):
    """Simulate a shipped mechanism in a steady wind along y."""
    scene = Scene(Settings(wind=WindSettings(velocity=(0.0, wind, 0.0), turbulence_intensity=0.0,
                                             profile='uniform')))
    scene.add(MechanismGrammar.load(f'{name}.mech').build(**defines), name=name)
    return Simulation(scene)


def kind(simulation, name):
    """List the parts whose kind has a name."""
    source = simulation.blueprint
    return np.flatnonzero(np.array(source.kinds)[source.kind] == name)


def test_the_chain_of_the_crane_bears_the_ball():
    """Hang the ball straight down: the topmost link pulls by its weight and that of the chain."""
    simulation = simulate('crane', back=0.0)
    simulation.step(30)
    parts = np.concatenate([kind(simulation, 'link'), kind(simulation, 'ball')])
    weight = simulation.blueprint.mass[parts].sum() * G
    rows = simulation.state.world.joints
    first = simulation.state.parts.body[parts[0]]
    pull = np.linalg.norm(rows.force[rows.first == first], axis=1).max()
    assert pull == pytest.approx(weight, rel=1e-3)


def test_the_ball_of_the_crane_gains_what_it_falls():
    """Draw it back and let it go: its speed at the lowest point is that of a free fall."""
    simulation = simulate('crane', back=40.0)
    ball = kind(simulation, 'ball')[0]
    height = simulation.poses[ball, 2]
    speed = 0.0
    for _ in range(100):
        simulation.step()
        speed = max(speed, np.linalg.norm(simulation.velocities[ball, :3]))
        height = max(height, simulation.poses[ball, 2])
    fall = height - simulation.poses[ball, 2]
    assert speed == pytest.approx(np.sqrt(2.0 * G * fall), rel=0.25)
    assert not len(simulation.events)


def test_the_windmill_turns_as_its_blade_elements_say(wind=9.0):
    """Balance the moment of all blades with that of load and friction (one law, no wake)."""
    simulation = simulate('windmill', wind)
    simulation.step(240)
    blades, span, chord, pitch, load, friction = 8, 1.6, 0.55, np.radians(35.0), 20.0, 1.0

    def moment(turn):
        def element(r):
            speed = wind * np.cos(pitch) - turn * r * np.sin(pitch)
            return (0.5 * AIR_DENSITY * PLATE_DRAG * chord * abs(speed) * speed
                    * np.sin(pitch) * r)
        return blades * quad(element, 0.3, 0.3 + span)[0] - load * turn - friction
    turn = brentq(moment, 0.0, 50.0)
    assert -simulation.joints.velocity[0] == pytest.approx(turn, rel=0.15)


def test_the_swing_swings_as_a_pendulum():
    """Take all that hangs as one rigid body about the beam; chains bend by little."""
    simulation = simulate('swing', angle=8.0)
    source = simulation.blueprint
    parts = np.concatenate([kind(simulation, name) for name in ('seat', 'child', 'arm', 'link')])
    mass, arm = source.mass[parts], source.poses[parts, :3] - [0.0, 0.0, 2.6]
    far = np.square(arm[:, 1:]).sum(axis=1)
    inertia = (mass * far).sum() + source.inertia[parts].max(axis=1).sum()
    depth = np.linalg.norm((mass[:, None] * arm[:, 1:]).sum(axis=0))
    period = 2.0 * np.pi * np.sqrt(inertia / (G * depth))
    y = simulation.series(205, ['swing/5']).poses[:, 0, 1]
    turns = np.flatnonzero(np.diff(np.sign(y)))
    assert 2.0 * np.diff(turns).mean() / 60.0 == pytest.approx(period, rel=0.05)


def test_the_gate_slams_in_the_wind():
    """Let the wind turn an open gate to its stop, where a storm tears it off."""
    simulation = simulate('gate', 10.0, open=-60.0)
    simulation.step(120)
    assert np.degrees(simulation.joints.position[0]) == pytest.approx(115.0, abs=0.5)
    storm = simulate('gate', 32.0, open=-60.0)
    storm.step(40)
    assert set(storm.events['part_b']) == {2} and not len(storm.joints.names)


def test_the_ropes_of_the_bridge_pull_as_its_sag_says():
    """Compare the springs at their ends with w·L²/8h, in the mean as the bridge bounces."""
    simulation = simulate('rope_bridge')
    mass = simulation.blueprint.mass[np.concatenate([kind(simulation, name) for name in (
        'plank', 'left', 'right')])]
    ropes, told = kind(simulation, 'left'), []
    for _ in range(100):
        simulation.step()
        told.append((2.05 - simulation.poses[ropes, 2].min(),
                     80000.0 * np.abs(simulation.joints.position).mean()))
    sag, pull = np.mean(told[30:], axis=0)
    assert pull == pytest.approx(0.5 * G * mass.sum() * 8.0 / (8.0 * sag), rel=0.05)
    assert not len(simulation.events)


def test_the_rope_bridge_bears_a_load_and_breaks_by_more():
    """Put 80 kg on its middle, but not three tonnes."""
    simulation = simulate('rope_bridge')
    simulation.step(30)
    middle = simulation.poses[kind(simulation, 'plank'), 2].min()
    block = {'shape': 'box', 'size': (0.4, 0.4, 0.4), 'velocity': (0.0, 0.0, 0.0)}
    simulation.launch(Projectile(mass=80.0, position=(0.0, 0.0, middle + 0.25), **block))
    simulation.step(60)
    assert not len(simulation.events)
    simulation.launch(Projectile(mass=3000.0, position=(0.0, 0.0, middle + 1.2), **block))
    while Cause.FORCE not in simulation.events['cause']:
        assert simulation.time < 2.5
        simulation.step()


def test_the_last_domino_tips_the_seesaw():
    """Let the row fall, and the ball on the other end rise."""
    simulation = simulate('dominoes')
    ball = kind(simulation, 'ball')[0]
    heights = simulation.series(300, [int(ball)]).poses[60:, 0, 2]
    assert heights.max() > heights[0] + 0.2


def test_the_cart_rolls_where_it_is_pushed():
    """Push it for a second: it rolls on straight, on all its wheels."""
    simulation = simulate('cart')
    simulation.apply_wrench('cart/0', (40.0, 0.0, 0.0))
    simulation.step(60)
    simulation.clear_wrenches()
    simulation.step(30)
    poses, source = simulation.poses, simulation.blueprint
    moved = poses[0, :3] - source.poses[0, :3]
    assert moved[0] > 0.4 and abs(moved[1]) < 0.05 and abs(moved[2]) < 0.01
    turned = simulation.joints.position
    np.testing.assert_allclose(turned * 0.125, moved[0], rtol=0.05)
