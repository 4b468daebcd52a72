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

"""Mechanisms in motion: joints of grammars against closed forms of mechanics."""

from math import acos, atan2, cos, hypot, pi, radians, sin

import numpy as np
import pytest

from procphys_ros.errors import CommandError, SceneError
from procphys_ros.geometry import rotation
from procphys_ros.mechanism import MechanismGrammar
from procphys_ros.physics.air import AIR_DENSITY, PLATE_DRAG
from procphys_ros.physics.causes import Cause
from procphys_ros.physics.wind import WindSettings
from procphys_ros.scene import Scene, Settings
from procphys_ros.simulation import Simulation

G = 9.81


def simulate(body, rules='', **settings):
    """Simulate one mechanism `m` of the given statements and rules."""
    scene = Scene(Settings(**settings))
    scene.add(MechanismGrammar.parse(f'mechanism m {{ {body} }} {rules}').build(), name='m')
    return Simulation(scene)


def forces(simulation):
    """Compute the force of each joint in the last step [N], (J,)."""
    rows = simulation.state.world.joints
    return np.linalg.norm(rows.force, axis=1)


def gaps(simulation):
    """Compute the distance between the two points of every joint [m], (J,)."""
    world = simulation.state.world
    rows = world.joints
    one, other = (rotation.compose(world.poses(body), frame)[:, :3] for body, frame in (
        (rows.first, rows.frame), (rows.second, rows.other_frame)))
    return np.linalg.norm(one - other, axis=1)


def test_a_four_bar_linkage_closes(crank=0.3, coupler=1.0, rocker=0.6, ground=1.0):
    """Turn the crank; its rocker follows as the closed loop demands, and no pin opens."""
    def pins(angle):
        x, z = crank * cos(angle), crank * sin(angle)
        far, turn = hypot(ground - x, z), atan2(-z, ground - x)
        turn += acos((coupler ** 2 + far ** 2 - rocker ** 2) / (2.0 * coupler * far))
        return x, z, x + coupler * cos(turn), z + coupler * sin(turn)
    x, z, u, w = pins(0.5)
    near, far = f'{x}, 0, {2.0 + z}', f'{u}, 0, {2.0 + w}'
    simulation = simulate(
        f'rod crank {{ from: 0, 0, 2  to: {near}  diameter: 0.03'
        '  hinge { at: 0, 0, 2  axis: 0, -1, 0  motor: 180, 1000 } }'
        f'rod coupler {{ from: {near}  to: {far}  diameter: 0.03'
        f'  hinge {{ to: crank  at: {near}  axis: 0, -1, 0 }} }}'
        f'rod rocker {{ from: {far}  to: {ground}, 0, 2  diameter: 0.03'
        f'  hinge {{ at: {ground}, 0, 2  axis: 0, -1, 0 }}'
        f'  hinge pin {{ to: coupler  at: {far}  axis: 0, -1, 0 }} }}')
    start = atan2(w, u - ground)
    for _ in range(140):  # more than a turn
        simulation.step()
        angle, _, follows, _ = simulation.joints.position
        _, _, u, w = pins(0.5 + angle)
        error = follows - (atan2(w, u - ground) - start)
        assert abs((error + pi) % (2.0 * pi) - pi) < 1e-4
        assert gaps(simulation).max() < 1e-5
    assert angle == pytest.approx(140 / 60 * pi, rel=1e-3)


def test_a_spinning_wheel_precesses(spin=100.0, arm=0.5, mass=10.0):
    """Hold a wheel by one end of its axle: it turns about the vertical by m·g·r / (I·ω)."""
    simulation = simulate(f'wheel w {{ diameter: 0.6  width: 0.05  mass: {mass}  at: {arm}, 0, 2'
                          '  turn: 0, 0, 90  ball pivot { at: 0, 0, 2 } }')
    rate = mass * G * arm / (0.5 * mass * 0.3 ** 2 * spin)
    simulation.set_body_state('m/0', twist=[0.0, rate * arm, 0.0, spin, 0.0, rate])
    poses = simulation.series(60, ['m/0']).poses[:, 0]
    turned = np.unwrap(np.arctan2(poses[:, 1], poses[:, 0]))[-1]
    assert turned == pytest.approx(rate * 1.0, rel=2e-3)
    assert np.abs(poses[:, 2] - 2.0).max() < 2e-3


def test_a_chain_hangs_as_a_catenary(links=40, link=0.1, slope=0.1):
    """Hang equal rods in the shape of equilibrium: they stay, and pull as statics says."""
    turn = np.arctan(slope * (np.arange(links) - 0.5 * (links - 1)))
    ends = np.cumsum(link * np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)
    ends = np.vstack([[0.0, 3.0], ends + [0.0, 3.0]])
    text = ''
    for k, ((x, z), (u, w)) in enumerate(zip(ends[:-1], ends[1:])):
        last = f'ball end {{ to: ground  at: {u:.12f}, 0, {w:.12f} }}' if k == links - 1 else ''
        text += (f'rod l{k} {{ from: {x:.12f}, 0, {z:.12f}  to: {u:.12f}, 0, {w:.12f}'
                 f'  diameter: 0.02  ball {{ to: {f"l{k - 1}" if k else "ground"}'
                 f'  at: {x:.12f}, 0, {z:.12f} }} {last} }}\n')
    simulation = simulate(text)
    before, weight = simulation.poses, simulation.blueprint.mass[0] * G
    simulation.step(60)
    sag = 3.0 - before[:, 2].min()
    assert np.abs(simulation.poses[:, :3] - before[:, :3]).max() < 0.01 * sag
    # As the continuous one of this span and length, but for the polygon: cosh within 1 %.
    a = weight / slope / (weight / link)
    assert sag == pytest.approx(a * (np.cosh(0.5 * ends[-1, 0] / a) - 1.0), rel=0.01)
    pull = hypot(weight / slope, 0.5 * links * weight)
    assert forces(simulation)[0] == pytest.approx(pull, rel=0.01)


def test_a_motor_does_the_work_that_it_is_told_to_do():
    """Lift a weight at a speed, hold it at a height, and spin a wheel up by a moment."""
    simulation = simulate('box load { size: 0.2, 0.2, 0.2  mass: 10  at: 0, 0, 2'
                          '  slider lift { axis: 0, 0, 1  motor: 0.5, 500 } }')
    simulation.step(60)
    lift = simulation.joints
    assert lift.names == ('m/lift',) and lift.velocity[0] == pytest.approx(0.5, abs=1e-4)
    assert lift.effort[0] * lift.velocity[0] == pytest.approx(10.0 * G * 0.5, rel=1e-3)
    simulation.drive_joint('m/lift', 'position', 1.0)
    simulation.step(90)
    assert simulation.joints.position[0] == pytest.approx(1.0, abs=1e-4)
    simulation.drive_joint('m/lift', 'effort', 10.0 * G + 10.0)
    simulation.step(60)
    assert simulation.joints.velocity[0] == pytest.approx(1.0, rel=0.01)
    wheel = simulate('wheel w { diameter: 1  width: 0.1  mass: 20  at: 0, 0, 2'
                     '  hinge axle { axis: 0, 1, 0  motor: 0, 50 } }')
    wheel.drive_joint('m/axle', 'effort', 5.0)
    work = 0.0
    for _ in range(60):
        before = wheel.joints.velocity[0]
        wheel.step()
        now = wheel.joints
        work += now.effort[0] * 0.5 * (before + now.velocity[0]) / 60.0
    kinetic = 0.5 * (0.5 * 20.0 * 0.25) * now.velocity[0] ** 2
    assert now.velocity[0] == pytest.approx(5.0 / 2.5, rel=0.01)
    assert work == pytest.approx(kinetic, rel=0.01)


@pytest.mark.parametrize('rate', [30, 60, 240])
@pytest.mark.parametrize('body, value, push, weight', [
    # An arm of 2 m with a weight at its end, welded on; a lift, upwards and downwards.
    ('rod arm { from: 0, 0, 5  to: 2, 0, 5  diameter: 0.08  mass: 30'
     '  hinge drive { at: 0, 0, 5  axis: 0, 0, 1  motor: 0, 200, 60 } }'
     'ball { diameter: 0.2  mass: 40  at: 2, 0, 5  weld { to: arm } }', 2.0,
     200.0 / (30.0 * 4.0 / 3.0 + 40.0 * 4.016), 0.0),
    ('box b { size: 1, 1, 1  mass: 100  at: 0, 0, 3'
     '  slider drive { axis: 0, 0, 1  motor: 0, 2000, 2 } }', 3.0, 20.0, -G),
    ('box b { size: 1, 1, 1  mass: 100  at: 0, 0, 5'
     '  slider drive { axis: 0, 0, 1  motor: 0, 1200, 2 } }', -3.0, 12.0, -G)])
def test_a_motor_brakes_in_time_for_its_target(rate, body, value, push, weight):
    """Drive a joint to a position: it takes the time of full thrust, top speed and full brake."""
    simulation = simulate(body, time_step=1.0 / rate)
    simulation.drive_joint('m/drive', 'position', value)
    top, pull = (radians(60.0) if 'hinge' in body else 2.0), np.sign(value) * weight
    shortest = abs(value) / top + 0.5 * top / (push + pull) + 0.5 * top / (push - pull)
    way = []
    for _ in range(round((shortest + 1.0) * rate)):
        simulation.step()
        way.append(abs(simulation.joints.position[0]))
    shortest -= np.sqrt(2.0 * 0.005 * abs(value) / (push - pull))  # that the last 0.5 % take
    arrived = (np.flatnonzero(np.array(way) < 0.995 * abs(value))[-1] + 1) / rate
    assert arrived == pytest.approx(shortest, abs=0.01 + 3.0 / rate)
    assert max(way) < abs(value) + 0.7 * top / rate
    assert way[-1] == pytest.approx(abs(value), rel=1e-3)


def test_a_motor_gives_no_more_than_it_has():
    """Stall a lift that is too weak, whatever it is told."""
    simulation = simulate('box load { size: 0.2, 0.2, 0.2  mass: 10  at: 0, 0, 30'
                          f'  slider lift {{ axis: 0, 0, 1  motor: 0.5, {9.0 * G} }} }}')
    for mode, value in (('velocity', 1.0), ('position', 3.0), ('effort', 1e4)):
        before = simulation.joints.velocity[0]
        simulation.drive_joint('m/lift', mode, value)
        simulation.step(30)
        assert simulation.joints.velocity[0] - before == pytest.approx(-0.1 * G * 0.5, rel=0.02)


@pytest.mark.parametrize('share', [0.99, 1.01])
def test_friction_holds_up_to_its_moment(share):
    """Hold an arm by the friction of its hinge, or let it sink."""
    moment = 7850.0 * 0.01 * G * 0.5
    simulation = simulate('box arm { size: 1, 0.1, 0.1  at: 0.5, 0, 3  material: steel  hinge pin'
                          f' {{ at: 0, 0, 3  axis: 0, 1, 0  friction: {share * moment} }} }}')
    simulation.step(60)
    sunk, effort = simulation.joints.position[0], simulation.joints.effort[0]
    if share < 1.0:  # the rest accelerates m·l²/3
        inertia = 7850.0 * 0.01 * (1.0 / 3.0 + 0.01 / 12.0)
        assert sunk == pytest.approx(0.5 * 0.01 * moment / inertia, rel=0.05)
    assert effort == pytest.approx(-min(share, 1.0) * moment, rel=1e-3)
    assert (sunk > 1e-3) == (share < 1.0)


@pytest.mark.parametrize('share', [0.99, 1.01])
def test_a_joint_breaks_above_its_strength(share):
    """Hang ten kilograms on a joint; record its break once, as an event."""
    simulation = simulate('ball bob { diameter: 0.2  at: 0, 0, 3  mass: 10'
                          f'  ball pin {{ at: 0, 0, 4  strength: {share * 10.0 * G} }} }}')
    simulation.step(40)
    events = simulation.events
    assert len(events) == (share < 1.0) == (simulation.poses[0, 2] < 2.5)
    if len(events):
        assert (events['bond'], events['part_a'], events['part_b']) == (-1, -1, 0)
        assert events['cause'] == Cause.FORCE
        np.testing.assert_allclose(events['position'][0], [0.0, 0.0, 4.0], atol=0.01)


def test_a_hinge_breaks_by_its_moment():
    """Turn the arm of a weld beyond the moment it bears."""
    moment = 7850.0 * 0.01 * G * 0.5
    simulation = simulate('box arm { size: 1, 0.1, 0.1  at: 0.5, 0, 3  material: steel'
                          f'  weld {{ at: 0, 0, 3  strength: 1e6, {0.95 * moment} }} }}')
    simulation.step(10)
    assert simulation.events['cause'].tolist() == [Cause.TWIST]


def test_a_flat_plate_falls_at_its_terminal_speed():
    """Balance its weight by the force of the air on its area, and fall freely on edge."""
    body = 'plate p {{ size: 1, 1, 0.01  mass: 5  at: 0, 0, 300  turn: {}, 0, 0  slider {{}} }}'
    speed = np.sqrt(2.0 * 5.0 * G / (AIR_DENSITY * PLATE_DRAG))
    flat, edge = simulate(body.format(0)), simulate(body.format(90))
    heights = flat.series(210, ['m/0']).poses[:, 0, 2]
    edge.step(60)
    assert (heights[-1] - heights[-7]) * 10.0 == pytest.approx(-speed, rel=1e-3)
    assert edge.velocities[0, 2] == pytest.approx(-G, rel=1e-3)


def test_the_wind_opens_a_flap_to_the_angle_of_equilibrium(wind=10.0):
    """Hang a plate in a steady wind: ½ρCdA·(u·cosα)² is the share of its weight across it."""
    simulation = simulate(
        'plate p { size: 1, 0.01, 1  mass: 3  at: 0, 0, 9.5'
        '  hinge top { at: 0, 0, 10  axis: 1, 0, 0  damper: 6 } }',
        wind=WindSettings(velocity=(0.0, wind, 0.0), turbulence_intensity=0.0,
                          profile='uniform'))
    simulation.step(150)
    angle = abs(simulation.joints.position[0])
    air = simulation.wind.velocity(simulation.poses[:, :3], simulation.time)[0, 1]
    push = 0.5 * AIR_DENSITY * PLATE_DRAG * (air * cos(angle)) ** 2
    assert angle > radians(30.0)
    assert push == pytest.approx(3.0 * G * sin(angle), rel=0.01)


def test_a_state_in_motion_is_saved_to_the_bit():
    """Go on from a saved state, a fork and the original alike, and from a reset as at first."""
    simulation = simulate("""rod arm { from: 0, 0, 5  to: 1, 0, 5  diameter: 0.08
            hinge slew { at: 0, 0, 5  axis: 0, 0, 1  motor: 40, 500 } }
        link(4) { at: 1, 0, 5  on: arm }""", """
        rule link(n) : n > 0 -> { rod link { from: 0, 0, 0  to: 0, 0, -0.3  diameter: 0.03
            ball { at: 0, 0, 0  strength: 400 } }  link(n - 1) { at: 0, 0, -0.3  on: link } }
        rule link(n) -> { ball { diameter: 0.3  mass: 40  ball { at: 0, 0, 0 } } }""")
    simulation.step(20)
    simulation.drive_joint('m/slew', 'position', 2.0)
    simulation.step(10)
    saved, fork = simulation.save(), simulation.fork()
    simulation.step(25)
    end, events = simulation.poses, len(simulation.events)
    fork.step(25)
    simulation.restore(saved)
    simulation.step(25)
    assert np.array_equal(end, fork.poses) and np.array_equal(end, simulation.poses)
    assert len(fork.events) == len(simulation.events) == events
    simulation.reset()
    assert simulation.joints.position.tolist() == [0.0] and not len(simulation.events)
    simulation.step(20)
    simulation.drive_joint('m/slew', 'position', 2.0)
    simulation.step(35)
    assert np.array_equal(end, simulation.poses)


def test_parts_of_a_mechanism_that_overlap_do_not_push_each_other():
    """Weld crossing boxes to a hub; at rest they stay where they are."""
    simulation = simulate("""box hub { size: 0.3, 0.3, 0.3  at: 0, 0, 2  weld {} }
        repeat k(3) { box blade { size: 2, 0.1, 0.1  at: 0, 0, 2  turn: 0, 60 * k, 0
            weld { to: hub } } }""")
    before = simulation.poses
    simulation.step(30)
    np.testing.assert_allclose(simulation.poses, before, atol=1e-3)


@pytest.mark.parametrize('late', [False, True])
@pytest.mark.parametrize('strength', ['', 'strength: 1e6, 1e6'])
def test_what_is_welded_to_the_ground_does_not_push_what_is_welded_there(strength, late):
    """Overlap posts of two mechanisms, built together or one in a running scene."""
    post = MechanismGrammar.parse('mechanism m { box foot { size: 1, 1, 1  at: 0, 0, 0.5  weld { '
                                  f'{strength} }} }}  box top {{ size: 1, 1, 1  at: 0, 0, 1.2  '
                                  f'weld {{ to: foot  {strength} }} }} }}').build()
    scene = Scene()
    scene.add(post, name='one')
    if not late:
        scene.add(post, (0.5, 0.2, 0.0), name='two')
    simulation = Simulation(scene)
    if late:
        simulation.add(post, (0.5, 0.2, 0.0), name='two')
    before = simulation.poses
    simulation.step(60)
    np.testing.assert_allclose(simulation.poses, before, atol=1e-3)
    assert not len(simulation.events)


def test_a_mechanism_joins_and_leaves_a_running_scene():
    """Add a second pendulum, drive the first; remove it without a word of breaking."""
    text = ('mechanism m { ball { diameter: 0.3  at: 1, 0, 2'
            '  hinge pin { at: 0, 0, 2  axis: 0, 1, 0 } } }')
    made = MechanismGrammar.parse(text).build()
    scene = Scene()
    scene.add(made, name='one')
    simulation = Simulation(scene)
    simulation.step(5)
    simulation.add(made, (5.0, 0.0, 0.0), name='two')
    simulation.step(5)
    assert simulation.joints.names == ('one/pin', 'two/pin')
    first, second = simulation.joints.position
    assert first > second > 0.0
    simulation.remove('one')
    simulation.step(5)
    assert simulation.joints.names == ('two/pin',) and not len(simulation.events)
    simulation.reset()
    simulation.step(5)
    assert simulation.joints.names == ('two/pin',)


def test_commands_to_joints_are_checked():
    """Name the joint, the nearest ones, and what is allowed."""
    simulation = simulate('box a { size: 1, 1, 1  at: 0, 0, 2  hinge slew { motor: 0, 10 } }'
                          'box b { size: 1, 1, 1  at: 3, 0, 2  hinge loose {} }')
    for wish, message in (
            (('m/slw', 'velocity', 1.0), 'there is no joint "m/slw"; did you mean m/slew'),
            (('m/loose', 'velocity', 1.0), 'm/loose has no motor'),
            (('m/slew', 'speed', 1.0), "joint.mode is 'speed', it must be one of position"),
            (('m/slew', 'velocity', float('nan')), 'joint.value is nan'),
            (('m/slew', 'velocity', 1e5), 'the velocity of m/slew is 100000, it must be from '
             '-1745.33 to 1745.33'),
            (('m/slew', 'effort', 1e9), 'joint.value is 1e+09')):
        with pytest.raises(CommandError, match=message.replace('+', r'\+')):
            simulation.drive_joint(*wish)


@pytest.mark.parametrize('mode, value', [('effort', 1e6), ('position', 1e6), ('velocity', 1745)])
def test_the_fastest_motor_keeps_its_joint_together(mode, value):
    """Drive a light arm as hard as commands allow: it turns about its pin."""
    simulation = simulate('box a { size: 0.1, 0.02, 0.02  at: 0.2, 0, 2'
                          '  hinge { at: 0, 0, 2  axis: 0, 1, 0  motor: 0, 1e12 } }')
    simulation.drive_joint('m/a', mode, value)
    simulation.step(90)
    assert abs(simulation.joints.velocity[0]) == pytest.approx(1745.0, rel=0.01)
    assert gaps(simulation).max() < 0.1


def test_an_effort_below_its_friction_moves_no_more_than_itself():
    """Accelerate a load with 2 N: a motor that runs does not feel the friction of 5 N."""
    simulation = simulate('box a { size: 1, 1, 1  at: 0, 0, 2  mass: 10'
                          '  slider { axis: 1, 0, 0  friction: 5  motor: 0, 100 } }')
    simulation.drive_joint('m/a', 'effort', 2.0)
    simulation.step(60)
    assert simulation.joints.velocity[0] == pytest.approx(0.2, rel=0.01)
    assert simulation.joints.effort[0] == pytest.approx(2.0, rel=0.01)


def test_a_removed_mechanism_has_no_joints_at_once():
    """Read joints after removal and after a reset that removes it again, without a step."""
    simulation = simulate('box a { size: 1, 1, 1  at: 0, 0, 2  hinge { motor: 0, 10 } }')
    simulation.remove('m')
    assert simulation.joints.names == ()
    simulation.reset()
    assert simulation.joints.names == ()
    with pytest.raises(CommandError, match='is gone'):
        simulation.drive_joint('m/a', 'velocity', 1.0)


def test_cues_drive_joints():
    """Let a scene file drive its joint at a time."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['m'], 'cues': ['0.1 joint target=m/lift mode=velocity value=0.5']},
        'm': {'grammar_text': 'mechanism m { box load { size: 0.2, 0.2, 0.2  at: 0, 0, 2'
                              '  slider lift { motor: 0, 5000 } } }'}})
    simulation = Simulation(scene)
    simulation.step(36)
    assert simulation.joints.position[0] == pytest.approx(0.25, abs=0.01)


def test_a_mechanism_stands_on_a_hill():
    """Raise it as a whole by the ground under its feet, and its joints with it."""
    scene = Scene.from_parameters({
        'scene': {'objects': ['gate']}, 'terrain': {'noise': 3.0, 'extent': 40.0},
        'gate': {'grammar': 'gate.mech', 'origin': [5.0, 3.0, 0.0]}})
    source, flat = scene.blueprint, MechanismGrammar.load('gate.mech').build()
    lift = source.poses[:, 2] - flat.poses[:, 2]
    ground = scene.settings.terrain.height(source.poses[:2, :2])
    np.testing.assert_allclose(lift, ground.max(), atol=1e-9)
    assert abs(lift[0]) > 1e-3
    np.testing.assert_allclose(source.joints.frame[:, 2] - flat.joints.frame[:, 2], lift[0])
    simulation = Simulation(scene)
    simulation.step(10)
    assert gaps(simulation).max() < 1e-4


def test_the_engine_must_have_joints():
    """Choose the engine with joints, and refuse the other one by name."""
    body = 'box a { size: 1, 1, 1  at: 0, 0, 2  hinge {} }'
    assert simulate(body).state.world.engine == 'native'
    with pytest.raises(SceneError, match='engine is "bullet", which has no joints'):
        simulate(body, engine='bullet')


def test_a_mechanism_cannot_join_a_world_without_joints():
    """Refuse it by name, and leave the scene as it is."""
    simulation = Simulation(Scene(Settings(engine='bullet')))
    made = MechanismGrammar.load('gate.mech').build()
    with pytest.raises(CommandError, match='gate has joints, and engine is "bullet"'):
        simulation.add(made, name='gate')
    simulation.step()
    assert not len(simulation.poses)


@pytest.mark.parametrize('stiffness, rest', [(1e4, 720.0), (1e6, 360.0)])
def test_a_spring_that_turns_fast_leaves_what_hangs_on_it_finite(stiffness, rest):
    """Let go an arm of grams at a spring that turns it by more than a turn in a substep."""
    simulation = simulate(f"""
        box arm {{ size: 0.2, 0.01, 0.01  at: 0.1, 0, 2  mass: 0.008
            hinge {{ at: 0, 0, 2  axis: 0, 0, 1  spring: {stiffness}, {rest} }} }}""")
    for _ in range(240):
        simulation.step()
        assert np.isfinite(simulation.poses).all() and np.abs(simulation.poses).max() < 100.0
